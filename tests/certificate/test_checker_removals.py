"""The lone checker with one of its checks taken away at a time: every removal is noticed by a case."""

from __future__ import annotations

import pytest
from checker_cases import FAILS, HOLDS, UNREADABLE, Case, cases
from checker_mutants import Removal, removals, without

#: Removals that no case can notice, each with the reason.
EQUIVALENT = {
    "min(whole) > 0": "conjugate gradients stop at the first direction of curvature <= 0; as long as they run, M is"
    " positive on all they have seen, so that a v with M v > 0 comes out positive but for rounding errors.",
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
    for case in cases():
        if outcome(module.examine, module.Refused, case) != case.code:
            return case.name
    return None


@pytest.mark.slow
def test_no_check_of_the_checker_can_be_left_out():
    """Some 120 conditions; without any of them a case is accepted, crashes or gets another exit code."""
    missed = [str(each) for each in removals() if each.text not in EQUIVALENT and noticed_by(each) is None]
    assert missed == []


def test_the_checks_are_found():
    texts = [each.text for each in removals()]
    assert len(texts) > 100
    assert set(EQUIVALENT) <= set(texts)


@pytest.mark.parametrize(
    "text", ["product(self.P, self.W) == self.Q", "claims.problem_sha256 == self.problem.sha256", "not p.kinked"]
)
def test_a_removed_check_is_missed(text):
    """Three of them at once, in the fast tests."""
    (removal,) = [each for each in removals() if each.text == text]
    assert noticed_by(removal) is not None
