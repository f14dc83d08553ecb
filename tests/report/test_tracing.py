"""Traceability and reproduction: every check has its source and its deciders, fingerprints are
those of files."""

import hashlib
from pathlib import Path

import pytest
from reports import html_report, markdown_report

import dobc_design
from dobc_design.checker.examine import OF_GROUPS, REGIONAL
from dobc_design.conditions.kinds import KINDS
from dobc_design.report.checks import ALONE, VERIFY, certify_command, trace_section
from dobc_design.report.findings import Findings, fingerprints

PACKAGE = Path(dobc_design.__file__).parent


def rows_of(certificate):
    (section,) = trace_section(Findings(certificate=certificate))
    return section.blocks[1].rows


def test_every_check_is_decided_in_modules_that_exist():
    for kind in KINDS.values():
        for name in (*kind.decided_in, kind.checker):
            assert (PACKAGE / name).is_file(), name


@pytest.mark.parametrize("id", [*OF_GROUPS, *REGIONAL])
def test_the_file_of_the_lone_checker_has_the_function_of_the_check(id: str):
    text = (PACKAGE / KINDS[id].checker).read_text("utf-8")
    assert f"\ndef {id.replace('-', '_')}(" in text


def test_the_fingerprint_of_the_certificate_is_that_of_its_file(certificate, tmp_path: Path):
    path, _ = certificate.save(tmp_path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    expected = {
        "SHA-256 of problem.json": certificate.claims.problem_sha256,
        "SHA-256 of certificate.json": digest,
    }
    assert dict(fingerprints(certificate)) == expected


PLAIN = "dobc certify problem.json --out again"


@pytest.mark.parametrize(
    ("options", "command"),
    [
        (("--all", "--search"), "dobc certify problem.json --all --search --out again"),
        (("--settling 1/20",), "dobc certify problem.json --settling 1/20 --out again"),
        (
            ("--rate 1/2", "--settling-radius 3", "--time-limit 9"),
            "dobc certify problem.json --rate 1/2 --settling-radius 3 --time-limit 9 --out again",
        ),
        (("--all; rm", "--settling 1; rm", "--rate 1 --force", "--force", "--settling"), PLAIN),
    ],
)
def test_the_command_has_the_options_of_the_certificate_that_are_known(
    certificate_of, options, command: str
):
    """A file may say anything: only what can be an option is repeated."""
    assert certify_command(certificate_of(options=options)) == command


def test_both_reports_have_the_table_the_commands_and_lines_to_sign(certificate):
    for text in (html_report(certificate), markdown_report(certificate)):
        for words in (
            "Traceability",
            "Signatures",
            "Prepared by",
            "Checked by",
            "Approved by",
            "Signature",
        ):
            assert words in text
        digests = dict(fingerprints(certificate)).values()
        for words in (
            certify_command(certificate),
            VERIFY,
            ALONE,
            *digests,
        ):
            assert words in text
        plain = text.replace("\\", "").replace("<wbr>", "")
        for _, _, _, source, modules, *_ in rows_of(certificate):
            assert modules.split(", ")[0] in plain
            assert source in plain
