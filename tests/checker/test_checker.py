"""The lone checker: accepts what is proved, refuses everything else, as one folder without any
package.

Its cases are in tests/support/checker_files/files.py."""

import json
import os

import pytest
from certified import certified, consensus_claims
from checker_files import files
from checker_files.files import FAILS, NOTHING, OPEN, UNREADABLE, alone, bend, cases
from oracles.regions import Regions

from dobc_design import Network, Problem, Verdict, verify
from dobc_design.certificate.text import certificate_bytes, certificate_document
from dobc_design.certification.recheck import recheck, verify_twice
from dobc_design.checker import examine as checker
from dobc_design.checker.__main__ import main
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes, canonical_document
from dobc_design.problem.load import builtin_names, load_problem

PAPER_W, PAPER_P = [["16/5"], ["12/5"]], [["1/2", "-1/4"], ["-1/4", "1/3"]]


#: It takes seconds to certify and to check.
LONG = "neurons"


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name == LONG else name
        for name in builtin_names()
    ],
)
def test_a_built_in_problem_is_certified_and_confirmed_by_both_programs(tmp_path, name):
    """The paper's own starts [0, 5] for arbitrary switching; regions also by an oracle that shares
    no code."""
    problem = load_problem(name)
    certificate = certified(name)
    assert certificate.problem == problem
    assert recheck(certificate_bytes(certificate.claims), problem).holds
    done = alone(tmp_path, certificate_bytes(certificate.claims), canonical_bytes(problem))
    assert done.returncode == 0
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[-1] == "Every claim holds."
    held = sum(line.startswith("holds") for line in lines)
    expected = len(certificate.checks) + 4
    assert held == expected
    if problem.region is None or problem.dynamics is not None:  # the oracle knows integrators
        return
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "max-separable"
    covering = certificate.check("max-separable")
    claimed_ball = claimed(covering.domain.radius)
    asked = max(asked_radius(loop_of(problem)))
    assert claimed_ball >= asked
    assert claimed(covering.domain.disturbance) >= problem.region.initial_disturbance
    assert certificate.rate == covering.rate
    document = json.loads(json.dumps(certificate_document(certificate.claims)))
    truth = Regions(canonical_document(problem), document["observer"]["W"])
    for each in document["checks"]:
        if each["id"] in ("max-separable", "delay", "sampling"):
            assert truth.false(each, document, "consensus") == []


@pytest.mark.parametrize("code", [FAILS, UNREADABLE])
def test_the_lone_folder_says_why_it_refuses_and_never_shows_a_traceback(tmp_path, code):
    bad = next(case for case in cases() if case.code == code)
    done = alone(tmp_path, bad.certificate, bad.problem)
    assert done.returncode == code
    assert done.stderr == ""
    assert ("FAILS  " if code == FAILS else "unreadable: ") in done.stdout


def test_what_is_missing_or_no_regular_file_is_unreadable_at_once(tmp_path, capsys):
    """A pipe would make it wait for ever."""
    os.mkfifo(tmp_path / "pipe")
    paths = (tmp_path / "pipe", tmp_path, tmp_path / "no.json")
    codes = [main(2 * [str(path)]) for path in paths]
    expected = [2, 2, 2]
    assert codes == expected
    assert main([]) == 2
    shown = capsys.readouterr().out
    assert shown.count("it is no regular file") == 2
    assert "unreadable: [Errno 2]" in shown


def test_the_output_cannot_steer_a_terminal(capsys, tmp_path):
    """A mode may have any name that a problem file can hold."""
    arcs = {"\u00e9": [[1, 2]]}
    network = Network.from_arcs(arcs, arrow="listens_to")
    problem = Problem(network=network, coupling="y", gains=1)
    document = json.loads(certificate_bytes(consensus_claims(problem))) | {"verdict": "\x1b[31m"}
    (tmp_path / "c").write_text(json.dumps(document), "utf-8")
    (tmp_path / "p").write_bytes(canonical_bytes(problem))
    assert main([str(tmp_path / "c"), str(tmp_path / "p")]) == 1
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    assert shown.isascii()
    assert "NOT CONFIRMED" in shown and "Every claim holds" not in shown


@pytest.mark.parametrize("keep", ["verdict", "nothing"])
def test_a_certificate_stripped_of_its_claims_proves_nothing(keep):
    """All checks undecided: "proved" does not follow; without the verdict it claims nothing, and is
    no proof."""
    stripped = files.document("paper")
    problem = canonical_bytes(files.problems()["paper"])
    for each in stripped["checks"]:
        bend(each, NOTHING)
    stripped["observer"] |= {"P": None, "Q": None}
    if keep == "nothing":
        stripped |= OPEN
    findings = checker.examine(json.dumps(stripped).encode(), problem)
    if keep == "verdict":
        assert findings[-1] == (
            False,
            "overall verdict: proved: the verdict that follows is undecided",
        )
    else:
        assert findings[-1] == (True, "overall verdict: undecided")
    emptied = stripped | {"checks": []}
    read = json.dumps(emptied).encode()
    assert not all(holds for holds, _ in checker.examine(read, problem))


@pytest.mark.parametrize("refusals", [[(False, "lemma1: no")], None])
def test_two_programs_that_disagree_confirm_nothing(monkeypatch, refusals):
    """``verify`` asks the package and the lone checker; either alone is not enough."""
    problem = load_problem("paper-fixed")
    claims = certified("paper-fixed").claims
    honest = verify(claims, problem)
    assert honest.holds is True
    assert honest.lone_checker == "it accepts every claim"
    if refusals is None:
        claims = json.loads(certificate_bytes(claims)) | {"rate": 5.0}
        claims = json.dumps(claims).encode()
        assert not recheck(claims, problem).holds
    monkeypatch.setattr(checker, "examine", lambda *files: refusals or [(True, "")])
    found = verify(claims, problem)
    assert not found.holds
    assert "two programs that decide the same claims disagree" in found.failures[-1]


@pytest.mark.parametrize("name", ["LONE_ARCS", "LONE_ROWS", "checker.MAX_BYTES"])
def test_what_is_too_large_for_plain_python_is_left_to_the_user(monkeypatch, name):
    monkeypatch.setattr(f"dobc_design.certification.recheck.{name}", 5)
    problem = load_problem("paper-fixed")
    found = verify_twice(certified("paper-fixed").claims, problem)
    if name == "checker.MAX_BYTES":
        assert "at most 5 bytes" in found.lone_checker
    else:
        assert found.holds
        assert "left to you" in str(found)
