"""The lone checker's part about signals that keep a guarantee: its cases, what the package says, and hostile claims."""

from __future__ import annotations

from typing import Any

import pytest
from checker_cases import FAILS, HOLDS, misjudged, outcome
from checker_mutants import removals
from checker_removals import EQUIVALENT, noticed_by
from cycles_cases import A_ENDS, A_STARTS, CHAINED, GRAPHS, bent, certificate, cycles_cases, judged, moved, retimed

Document = dict[str, Any]


def test_every_case_gets_its_exit_code():
    """Claims whose truth is known, and twins that just fail in one place each."""
    assert misjudged(cycles_cases()) == []
    assert sum(case.code == HOLDS for case in cycles_cases()) >= 18
    assert sum(case.code == FAILS for case in cycles_cases()) > 80


def test_the_package_says_the_same():
    """But for problem files that it cannot read."""
    others = [case for case in cycles_cases() if "bent problem" not in case.name]
    assert [case.name for case in others if (judged(case) == HOLDS) != (case.code == HOLDS)] == []


@pytest.mark.parametrize("place", range(len(removals("cycles"))))
def test_the_removal_of_any_check_is_noticed(place: int):
    removal = removals("cycles")[place]
    assert removal.text in EQUIVALENT or noticed_by(removal) is not None, str(removal)


MANY = [f"{k}/5000" for k in range(5001)]


@pytest.mark.parametrize(
    "check",
    [
        bent(CHAINED, own="1e400"),
        bent(CHAINED, own="-1e400"),
        bent(CHAINED, own={}),
        bent(CHAINED, phases={}),
        bent(CHAINED, phases=[CHAINED["exact"]["phases"]] * 2),
        bent(GRAPHS, phases=[{}]),
        bent(GRAPHS, rho="1e400"),
        retimed(CHAINED, MANY, *[A_STARTS] * 5001),
        retimed(CHAINED, ["0", "1e-400", "1"], A_STARTS, A_ENDS, A_ENDS),
        retimed(CHAINED, ["0", "1"], {"float64": "AAAA"}, A_ENDS),
        moved(CHAINED, 0, 1, 0, "1e400"),
        moved(CHAINED, 0, 1, 0, "1e-400"),
        moved(CHAINED, 1, 0, 1, "1" + "0" * 9000 + "1"),
    ],
)
def test_hostile_claims_are_refused(check: Document):
    assert outcome(*certificate("chain", check)) == FAILS
