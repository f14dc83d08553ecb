"""Every condition of the lone checker's files, taken away: a case has to notice."""

from __future__ import annotations

from checker_removals import EQUIVALENT, unnoticed
from evidence.row import Row


def run(count: int, seed: int) -> Row:
    """``count`` of the removals, evenly spread; the cases are always the same."""
    tried, missed = unnoticed(count)
    return Row(
        what="the lone checker with one of its checks removed: noticed",
        count=tried,
        failures=tuple(missed),
        notes=(f"{len(EQUIVALENT)} removals that nothing can notice are listed with their reasons",),
    )
