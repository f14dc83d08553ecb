"""The exhaustive proof of the region asked for, for small networks: boxes around a quadratic certificate.

Theory, section 4.  ``propose`` cuts up the set between two levels of V, ``decide`` looks at every box again.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

from dobc_design.conditions.boxes.claim import LARGEST, Shell
from dobc_design.conditions.boxes.decide import exhaustive_check
from dobc_design.conditions.boxes.propose import grow_shell
from dobc_design.conditions.check import Check, surviving, undecided_check
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.numbers import claimed, rounded_down
from dobc_design.conditions.quadratic.claim import Shape
from dobc_design.conditions.quadratic.decide import border_of, certified_ball, eigenvalue_bound, quadratic_obstacle
from dobc_design.conditions.quadratic.propose import linear_rate
from dobc_design.conditions.quadratic.stage import propose
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted

SMALL: Final = 4  # rows n m up to which boxes are counted out without being asked for
MOST_BOXES: Final = 50_000  # that a certificate may hold, so that a checker in plain Python gets through them
#: Starts up to this many times the ball asked for, or that of the inner certificate, are looked at.
BEYOND: Final = 2
RATES: Final = (Fraction(1, 2), Fraction(1, 10))  # of that near the consensus, tried where the region is covered


def exhaustive_stage(asked: Asked, report: Progress) -> list[Check]:
    """Boxes around the quadratic certificates, for small networks.  Unless everything is wanted, only where they may
    cover the region asked for, and for n m <= 4."""
    problem = asked.problem
    largest = LARGEST if asked.everything else SMALL
    if not (asked.everything or asked.wanted) or problem.n * problem.m > largest or asked.domain == "global":
        return []
    reason = quadratic_obstacle(problem, asked.W)
    if reason is None and not acts_by_component(problem):
        reason = "does not apply: the exhaustive method needs couplings that act on each state component by itself."
    if reason is not None:
        return [undecided_check("exhaustive", asked.domain, reason, applies=False)] if asked.everything else []
    report("deciding the region (exhaustive)")
    needed = 0.0 if asked.everything else math.nextafter(asked.ball, 0.0)
    with at_most(STAGE * (2 if asked.everything else 1)):  # for each shape
        best = _shell(asked, "identity", beyond=needed)
        if best is None or asked.everything:
            best = _shell(asked, "full", beyond=needed if best is None else _ball(asked, best)) or best
        cut = exhausted()
    if best is None and cut is not None:
        return [undecided_check("exhaustive", asked.domain, cut)]
    if best is None:
        where = "reach beyond the quadratic certificate" if asked.everything else f"cover |e| <= {asked.ball:.6g}"
        many = f"too many would be needed (at most {MOST_BOXES})"
        reason = f"no boxes are found that {where}: V' < 0 fails closer in, or {many}."
        return [undecided_check("exhaustive", asked.domain, reason)]
    radius, remark = _ball(asked, best), ""
    if not asked.wanted or radius < asked.ball:
        wish = f"the region asks for {asked.ball:.6g}" if asked.wanted else "no region is asked for"
        remark = f" The ball reaches |e| <= {radius:.6g}, {wish}: beyond, this V rises somewhere, or more than"
        remark += f" {MOST_BOXES} boxes would be needed."
    starts = {"radius": radius, "disturbance": asked.disturbance}
    return [exhaustive_check(problem, asked.W, best, **starts, domain=asked.domain, remark=remark)]


def _shell(asked: Asked, shape: Shape, *, beyond: float) -> Shell | None:
    """Boxes around the largest ball of a shape, at a rate > 0 where the region is covered even so.  None if they prove
    no larger ball than ``beyond``."""
    slow = _grown(asked, shape, Fraction(0), beyond=beyond)
    if slow is None or not asked.wanted or _ball(asked, slow) < asked.ball:
        return slow
    top, whole = linear_rate(asked.problem, asked.W), math.nextafter(asked.ball, 0.0)
    rates = (rounded_down(Fraction(top) * part, digits=4) for part in RATES if top > 0)
    faster = (_grown(asked, shape, rate, beyond=max(beyond, whole)) for rate in rates)
    return next((shell for shell in faster if shell is not None), slow)


def _grown(asked: Asked, shape: Shape, rate: Fraction, *, beyond: float) -> Shell | None:
    """None also where no box proof reaches beyond the inner certificate, or a numerical library breaks down."""
    inner, shell = propose(asked, shape, rate=rate), None
    if inner is None:
        return None
    with surviving(f"no boxes ({shape})", WorkLimitError):
        shell = grow_shell(
            asked.problem,
            inner.lure,
            S=border_of(asked.problem, inner.lure, inner.lure.rate),
            largest=BEYOND * claimed(max(asked.ball, inner.radius)),
            most=MOST_BOXES,
            least=eigenvalue_bound(inner.lure.P_e) * claimed(beyond) ** 2,
        )
    return shell if shell is not None and _ball(asked, shell) > beyond else None


def _ball(asked: Asked, shell: Shell) -> float:
    return certified_ball(asked.problem, shell.whole, disturbance=asked.disturbance)
