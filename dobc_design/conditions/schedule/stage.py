"""The check `settling` of a certificate: a settling time for the region asked for, or for what is proved of it.

Theory, section 5, Staging.  ``settling`` proposes, ``checks`` decides.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Final

from dobc_design.conditions.check import Check, undecided_check
from dobc_design.conditions.schedule.asked import asked_beside
from dobc_design.conditions.schedule.checks import settling_check
from dobc_design.conditions.schedule.settle import settle
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem

logger = logging.getLogger("dobc_design")

#: Agents times state components up to which stages are looked for: quadratic ones are dense.
MOST_ROWS: Final = 100


def settling_stage(
    problem: Problem,
    W: Matrix | None,
    checks: Sequence[Check],
    *,
    tolerance: Fraction | None,
    domain: str,
    report: Callable[[str], None],
) -> Check:
    """The check `settling` beside ``checks``, which are for the gain W (q, m); PROVED or UNDECIDED.

    ``tolerance`` in the unit of x, None for a hundredth of the radius; ``domain``: that of Lemma 1.
    """
    reason = obstacle(problem, W)
    if reason is not None:
        return undecided_check("settling", domain, reason)
    rows = problem.n * problem.m
    if rows > MOST_ROWS:
        reason = f"left out, because it takes long with {rows} rows n m; it is examined up to {MOST_ROWS}."
        return undecided_check("settling", domain, reason)
    asked = asked_beside(problem, checks, tolerance=tolerance)
    if isinstance(asked, str):
        return undecided_check("settling", domain, asked)
    report("deciding the settling time")
    try:
        found = settle(problem, W, asked, progress=report)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no settling time: %s", error)
        return undecided_check("settling", domain, "no settling time is found: a numerical library broke down.")
    return settling_check(problem, W, found, domain=domain)
