"""The checks of the region asked for: design proposes in floating point, verify decides exactly.

Cheapest first, and no further than needed: what comes after a proof that covers the region is tried on request only.
Paper: the region is what the text claims globally and its proof does not give (theory, sections 1, 4 and 5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dobc_design.conditions.asked import Asked, Progress, read_region
from dobc_design.conditions.boxes.stage import exhaustive_stage
from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import covers
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem

#: Cheapest first.
STAGES: tuple[Callable[[Asked, Progress], list[Check]], ...] = (separable_stage, quadratic_stage, exhaustive_stage)


def region_checks(
    problem: Problem, W: Matrix | None, checks: Sequence[Check], *, domain: str, everything: bool, report: Progress
) -> list[Check]:
    """Examine the region, or with ``everything`` the largest box where none is asked for; W is what ``checks`` are for.

    Nothing is examined where ``checks`` cover the region already, unless ``everything`` is wanted.
    """
    if not everything and (problem.region is None or any(covers(problem, check, checks) for check in checks)):
        return []
    asked = read_region(problem, W, domain=domain, everything=everything)
    found: list[Check] = []
    for stage in STAGES:
        found += stage(asked, report)
        if not everything and any(covers(problem, check, found) for check in found):
            break
    return found
