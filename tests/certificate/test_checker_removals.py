"""The lone checker with one of its checks taken away at a time: every removal is noticed by a case."""

from __future__ import annotations

import pytest
from checker_cases import FAILS, HOLDS, UNREADABLE, Case, cases
from checker_mutants import FILES, Removal, removals, without
from quadratic_cases import quadratic_cases
from region_cases import region_cases

#: Removals that no case can notice, each with the reason.
EQUIVALENT = {
    "min(whole) > 0": "conjugate gradients stop at the first direction of curvature <= 0; as long as they run, M is"
    " positive on all they have seen, so that a v with M v > 0 comes out positive but for rounding errors.",
    "done > PIECES or not a < middle < b": "it ends the search: without it a row that is not shown is cut for ever.",
    "path.is_file()": "no file is missing here; test_region_checker.py takes one away.",
    "all((Path(name).is_file() or not Path(name).exists() for name in arguments))": "it is about the command line; the"
    " test is in test_checker.py.",
    "size <= EQUATIONS": "it bounds the work; what is shown beyond it is true.",
    "size <= ROWS": "it bounds the work.",
    "len(X) <= 20": "it bounds the work.",
    "size <= COMPONENTS": "it bounds the work.",
    "len(tree) <= LETTERS": "it bounds the work; test_quadratic_checker.py has a longer one.",
    "halvings > 0": "it ends the search: without it a box that is not shown is cut for ever.",
    "room > 0": "it bounds the work.",
    "len(free) <= 12": "it bounds the work.",
    "abs(x) < WIDEST": "beyond it the sine of one number is off by more than is allowed for, but up to far larger"
    " numbers by less than its rounding to a float; an interval of such numbers holds whole turns.",
}


def outcome(examine: object, refused: type[Exception], case: Case) -> int | str:
    try:
        findings = examine(case.certificate, case.problem)  # type: ignore[operator]
    except refused:
        return UNREADABLE
    except Exception as error:  # noqa: BLE001 - whatever it is, it is no clean refusal
        return repr(error)
    return HOLDS if all(holds for holds, _ in findings) else FAILS


def noticed_by(removal: Removal) -> str | None:
    """The first case that comes out differently: accepted, with another exit code, or with a traceback."""
    module = without(removal)
    own = {"checker": cases, "region_checker": region_cases, "quadratic_checker": quadratic_cases}
    for case in (case for file in (removal.file, *own) for case in own[file]()):
        if outcome(module.examine, module.Refused, case) != case.code:
            return case.name
    return None


@pytest.mark.slow
def test_no_check_of_the_checker_can_be_left_out():
    """Some 130 conditions; without any of them a case is accepted, crashes or gets another exit code."""
    found = [each for each in removals("checker") if each.text not in EQUIVALENT]
    assert [str(each) for each in found if noticed_by(each) is None] == []


@pytest.mark.slow
def test_no_check_of_the_regions_can_be_left_out():
    """Some 70 conditions of region_checker.py, with the certificates of regions."""
    found = [each for each in removals("region_checker") if each.text not in EQUIVALENT]
    assert [str(each) for each in found if noticed_by(each) is None] == []


@pytest.mark.slow
def test_no_check_of_the_quadratic_certificates_can_be_left_out():
    """Some 90 conditions of quadratic_checker.py, with certificates of balls, boxes and settling times."""
    found = [each for each in removals("quadratic_checker") if each.text not in EQUIVALENT]
    assert [str(each) for each in found if noticed_by(each) is None] == []


def test_the_checks_are_found():
    texts = {file: [each.text for each in removals(file)] for file in FILES}
    assert len(texts["checker"]) > 100
    assert len(texts["region_checker"]) > 60
    assert len(texts["quadratic_checker"]) > 60
    assert set(EQUIVALENT) <= {text for found in texts.values() for text in found}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("checker", "product(self.P, self.W) == self.Q"), ("checker", "claims.problem_sha256 == self.problem.sha256"),
        ("checker", "not p.kinked"), ("region_checker", "room >= 0"), ("region_checker", "exact.delay >= 0"),
        ("quadratic_checker", "top <= exact.tolerance"), ("quadratic_checker", "claim.outer >= claim.level"),
    ],
)  # fmt: skip
def test_a_removed_check_is_missed(file, text):
    """Five of them at once, in the fast tests."""
    (removal,) = [each for each in removals(file) if each.text == text]
    assert noticed_by(removal) is not None
