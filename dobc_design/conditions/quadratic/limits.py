"""How far quadratic certificates can reach at most: rational duals beside a proved ``lure``, from above.

Theory, section 4, last line.  ``dual_search`` proposes, ``decide_duals`` multiplies out.  Not part of a certificate.
"""

from __future__ import annotations

import logging
from typing import Final

from dobc_design.conditions.asked import Progress
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import read_rational
from dobc_design.conditions.quadratic.checks import IN_WORDS
from dobc_design.conditions.quadratic.decide_duals import verify_dual
from dobc_design.conditions.quadratic.dual_search import propose_dual
from dobc_design.conditions.quadratic.duals import SHAPES, QuadraticDual
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")

#: Rows n m up to which duals are looked for, by shape of P_e.
MOST_ROWS: Final = {"identity": 60, "diagonal": 30, "full": 12}
#: A P_e of one shape may reach so much less far than the best one.
LESS: Final = 50
#: Times the certified radius up to which is looked.
FARTHER: Final = 30


def quadratic_limits(problem: Problem, lure: Check | None, *, report: Progress) -> tuple[QuadraticDual, ...]:
    """The proved limits of quadratic certificates, by shape of P_e; where none is found nothing is said.

    ``lure``: the proved check of a region, which says from where on to look; without one, or where it holds
    everywhere, there is nothing to be limited.
    """
    radius = None if lure is None or lure.verdict is not Verdict.PROVED else (lure.exact or {}).get("radius")
    if radius is None:
        return ()
    certified, found = read_rational(radius), list[QuadraticDual]()
    for shape in SHAPES:
        if problem.n * problem.m > MOST_ROWS[shape]:
            continue
        report(f"looking for the limit of quadratic certificates ({IN_WORDS[shape]})")
        try:
            dual = propose_dual(
                problem,
                shape,
                holds=lambda each: verify_dual(problem, each).verdict is Verdict.PROVED,
                beyond=certified if shape == "full" else certified / LESS,
                largest=certified * FARTHER,
            )
        except (ArithmeticError, RuntimeError, ValueError) as error:
            logger.warning("no dual (%s): %s", shape, error)
            continue
        if dual is not None:
            found.append(dual)
    return tuple(found)
