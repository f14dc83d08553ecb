"""Traceability and reproduction: every check has its source and its deciders, fingerprints are those of files."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import pytest

import dobc_design
from dobc_design.checker.examine import FACTS, REGIONAL
from dobc_design.conditions.check import CHECK_IDS, Check
from dobc_design.report.html import html_report
from dobc_design.report.markdown import markdown_report
from dobc_design.report.tracing import DECIDED_IN, reproduction, trace_rows
from dobc_design.verdict import Verdict

PACKAGE = Path(dobc_design.__file__).parent


def test_every_check_is_decided_in_modules_that_exist():
    assert set(DECIDED_IN) == set(CHECK_IDS)
    for modules, checker in DECIDED_IN.values():
        for name in (*modules, checker):
            assert (PACKAGE / name).is_file(), name


@pytest.mark.parametrize("id", [*FACTS, *REGIONAL])
def test_the_file_of_the_lone_checker_has_the_function_of_the_check(id: str):
    text = (PACKAGE / DECIDED_IN[id][1]).read_text("utf-8")
    assert f"\ndef {id.replace('-', '_')}(" in text


def test_a_condition_has_one_row_that_counts_its_verdicts(certificate):
    lemma = next(check for check in certificate.checks if check.id == "lemma1")
    other = dataclasses.replace(lemma, mode="Gb", verdict=Verdict.REFUTED)
    rows = trace_rows([lemma, dataclasses.replace(lemma, mode="Gc"), other])
    assert [(row.id, row.found) for row in rows] == [("lemma1", "2 × proved, refuted")]
    assert rows[0].source == "Paper, Lemma 1, (10), with J at the target."
    assert rows[0].checker == "checker/consensus.py"


def test_a_check_that_this_version_does_not_know_is_left_out():
    assert trace_rows([Check(id="strange", verdict=Verdict.PROVED, domain="global", reason="r")]) == []


def test_the_fingerprint_of_the_certificate_is_that_of_its_file(certificate, tmp_path: Path):
    path, _ = certificate.save(tmp_path)
    assert dict(reproduction(certificate)["fingerprints"]) == {
        "problem.json": certificate.claims.problem_sha256,
        "certificate.json": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


@pytest.mark.parametrize(
    ("exact", "verdict", "command"),
    [
        ({"tolerance": "1/20"}, Verdict.PROVED, "dobc certify problem.json --settling 1/20 --out again"),
        ({"tolerance": "1; rm"}, Verdict.PROVED, "dobc certify problem.json --out again"),
        ({"tolerance": "1/20"}, Verdict.UNDECIDED, "dobc certify problem.json --out again"),
    ],
)
def test_the_command_asks_for_the_settling_time_that_is_proved(certificate_of, exact, verdict, command: str):
    check = Check(id="settling", verdict=verdict, domain="global", reason="r", exact=exact)
    assert reproduction(certificate_of(checks=(check,)))["certify"] == command


@pytest.mark.parametrize(
    ("options", "command"),
    [
        (("--search", "--all"), "dobc certify problem.json --all --search --out again"),
        (("--settling 1/20",), "dobc certify problem.json --settling 1/20 --out again"),
        (("--all; rm", "--settling 1 --force", "--force"), "dobc certify problem.json --settling 1/7 --out again"),
    ],
)
def test_the_command_has_the_options_of_the_certificate_that_are_known(certificate_of, options, command: str):
    """A file may say anything: only what can be an option is repeated."""
    proved = Check(id="settling", verdict=Verdict.PROVED, domain="global", reason="r", exact={"tolerance": "1/7"})
    certificate = certificate_of(checks=() if "--search" in options else (proved,), options=options)
    assert reproduction(certificate)["certify"] == command


def test_both_reports_have_the_table_the_commands_and_lines_to_sign(certificate):
    again = reproduction(certificate)
    for text in (
        html_report(certificate, analysis=None, trajectory=None),
        markdown_report(certificate, analysis=None, trajectory=None),
    ):
        for words in ("Traceability", "Signatures", "Prepared by", "Checked by", "Approved by", "Signature"):
            assert words in text
        for words in (again["certify"], again["verify"], again["alone"], *(sha for _, sha in again["fingerprints"])):
            assert words in text
        plain = text.replace("\\", "").replace("<wbr>", "")
        for row in trace_rows(certificate.checks):
            assert row.modules[0] in plain
            assert row.source in plain
