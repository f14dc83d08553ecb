"""The ladder of solvers: Clarabel directly, then SCS through cvxpy; what comes after them needs no solver.

Whatever a solver answers is a proposal that exact arithmetic decides about, so a wrong answer costs time and
nothing else.  A solver that breaks (raises, runs out of time, answers with something that is no point) is not
asked again for the same design.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from dobc_design.solvers.dense import solve_dense
from dobc_design.solvers.direct import solve_directly
from dobc_design.solvers.program import Program, Solution

T = TypeVar("T")

TIME_LIMIT = 20.0  # seconds for one call of one solver; the programs here take milliseconds
SECOND = "SCS"


def climb(
    programs: Iterable[tuple[Program, T]], *, time_limit: float = TIME_LIMIT
) -> Iterator[tuple[Solution, T, str]]:
    """Solve each program by Clarabel and, where that gave no point for one of them, by SCS.

    ``programs``: each with a label.  ``time_limit``: seconds for one call.
    Returns: the answer (perhaps without values), the label, and how it came about: "" for Clarabel, else such as
    "by SCS, after Clarabel gave no point (MaxTime)".
    """
    source = iter(programs)
    asked: list[tuple[Program, T]] = []
    trouble: str | None = None
    for program, label in source:
        asked.append((program, label))
        answer = solve_directly(program, time_limit=time_limit)
        if answer.broken or not answer.found:
            trouble = answer.status
        yield answer, label, ""
        if answer.broken:
            break
    if trouble is None:
        return
    for program, label in (*asked, *source):
        answer = solve_dense(program, solver=SECOND, time_limit=time_limit)
        yield answer, label, f"by {SECOND}, after Clarabel gave no point ({trouble})"
        if answer.broken:
            return
