"""The lone checker's part about graphs that move or that a Markov chain draws: its cases, and what the package says."""

from __future__ import annotations

import pytest
from checker_cases import FAILS, HOLDS, misjudged
from checker_mutants import removals
from checker_removals import EQUIVALENT, noticed_by
from graphs_cases import graphs_cases, judged


def test_every_case_gets_its_exit_code():
    """Claims whose truth is known, and twins that just fail in one place each."""
    assert misjudged(graphs_cases()) == []
    assert sum(case.code == HOLDS for case in graphs_cases()) >= 20
    assert sum(case.code == FAILS for case in graphs_cases()) > 100


def test_the_package_says_the_same():
    """But for problem files that it cannot read."""
    others = [case for case in graphs_cases() if "bent problem" not in case.name]
    assert [case.name for case in others if (judged(case) == HOLDS) != (case.code == HOLDS)] == []


@pytest.mark.parametrize("place", range(len(removals("graphs"))))
def test_the_removal_of_any_check_is_noticed(place: int):
    removal = removals("graphs")[place]
    assert removal.text in EQUIVALENT or noticed_by(removal) is not None, str(removal)
