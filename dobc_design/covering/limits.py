"""How far quadratic certificates can reach at most: rational duals beside a proved ``lure``, from above.

Theory, section 4, last line.  ``design.duals`` proposes, ``verify.duals`` multiplies out.  Not part of a certificate.
"""

from __future__ import annotations

import logging
from typing import Final

from dobc_design.covering.asked import Progress
from dobc_design.design.duals import propose_dual
from dobc_design.spec.problem import Problem
from dobc_design.theorems.duals import SHAPES, QuadraticDual
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.duals import verify_dual
from dobc_design.verify.numbers import read_rational
from dobc_design.verify.quadratic_regions import IN_WORDS

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
                problem, shape, holds=lambda each: verify_dual(problem, each).verdict is Verdict.PROVED,
                beyond=certified if shape == "full" else certified / LESS, largest=certified * FARTHER,
            )  # fmt: skip
        except (ArithmeticError, RuntimeError, ValueError) as error:
            logger.warning("no dual (%s): %s", shape, error)
            continue
        if dual is not None:
            found.append(dual)
    return tuple(found)
