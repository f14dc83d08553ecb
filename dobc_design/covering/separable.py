"""The max-separable certificate of the region asked for, with what it says about delays and sampling.

Theory, section 5.  ``design.separable`` proposes in floating point, ``verify`` decides exactly.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from fractions import Fraction

from dobc_design.covering.asked import Asked, Progress
from dobc_design.design.separable import SeparablePlan, design_separable, flatter_plans, rounded_vectors
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.theorems.separable import Separable
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check
from dobc_design.verify.numbers import claimed
from dobc_design.verify.regions import (
    delay_check,
    max_separable_check,
    obstacle,
    sampling_check,
    stuck_check,
    undecided_check,
)
from dobc_design.verify.separable import coupling_profiles, rounded_down, verify_separable
from dobc_design.verify.separable_observer import covers as box_is_inside
from dobc_design.verify.separable_observer import first_certificate
from dobc_design.verify.separable_timing import longest_delay

logger = logging.getLogger("dobc_design")

#: A second program with simpler enclosures has to confirm the rows, so they keep this part of alpha in hand.
IN_HAND = Fraction(1, 10**4)
# (agents, relative accuracy of the largest box that is still worth the time)
CLOSE = ((60, 0.002), (2000, 0.02), (10**9, 0.25))
HALVINGS = 12
#: How much further out the agent is looked for that is no longer held.
WIDER = Fraction(2)
#: The part of the rate that delays are to leave.
KEPT = Fraction(1, 2)
#: Arcs of all modes together up to which delays and sampling are examined: exact rows for each of them take long.
TIMED_ARCS = 3000
#: Arcs of all modes together up to which boxes are tried on which a coupling falls: exact rows for each of them, too.
FALLING_ARCS = 3000


def separable_stage(asked: Asked, report: Progress) -> list[Check]:
    """The max-separable certificate, and what it says about delays and sampling."""
    problem, W = asked.problem, asked.W
    report("deciding the region (max-separable)")
    reason = obstacle(problem, W)
    if reason is not None:
        return [undecided_check("max-separable", asked.domain, reason)]
    stuck = stuck_check(problem, W, domain=asked.domain)
    if stuck is not None:
        return [stuck]
    claim, radius = _largest_claim(asked)
    if claim is None:
        return [undecided_check("max-separable", asked.domain, _nothing_found(asked))]
    check = max_separable_check(
        problem, W, claim, radius=radius, disturbance=asked.disturbance, domain=asked.domain,
        remark=_remark(asked, claim, radius),
    )  # fmt: skip
    return [check] if check.verdict is not Verdict.PROVED else [check, *_timing(asked, claim, check, report)]


def _largest_claim(asked: Asked) -> tuple[Separable | None, float]:
    """A proved claim for the box asked for, else for the largest box that is found; and the radius of that box."""
    claim = _claim(asked, asked.radius, _plan(asked, asked.radius))
    if claim is not None or asked.domain == "global":
        return claim, asked.radius
    low, high = _short(asked.radius / 2**HALVINGS), asked.radius
    claim = _claim(asked, low, _plan(asked, low))
    if claim is None:
        return None, 0.0
    for _ in range(HALVINGS - 1):
        radius = _short(high / 2)
        found = _claim(asked, radius, _plan(asked, radius))
        if found is not None:
            claim, low = found, radius
            break
        high = radius
    for radius, plan in reversed(_plans(asked, low, high)):
        found = _claim(asked, radius, plan)
        if found is not None:
            return found, radius
    return claim, low


def _plans(asked: Asked, low: float, high: float) -> list[tuple[float, SeparablePlan]]:
    """Boxes between the two that floating point covers, up to about the largest; increasing."""
    found: list[tuple[float, SeparablePlan]] = []
    close = next(part for size, part in CLOSE if asked.problem.n <= size)
    while high - low > close * high:
        radius = _short((low + high) / 2)
        if not low < radius < high:
            break
        plan = _plan(asked, radius)
        if plan is None:
            high = radius
        else:
            found.append((radius, plan))
            low = radius
    return found


def _plan(asked: Asked, radius: float) -> SeparablePlan | None:
    """What floating point proposes for a box; None also when a numerical library breaks down.

    For linear couplings all boxes are alike.
    """
    size = Fraction(1) if asked.domain == "global" else claimed(radius)
    disturbance = Fraction(0) if asked.domain == "global" else claimed(asked.disturbance)
    try:
        return design_separable(asked.problem, radius=size, disturbance=disturbance, W=asked.W)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no max-separable proposal for radius %s: %s", radius, error)
        return None


def _claim(asked: Asked, radius: float, plan: SeparablePlan | None) -> Separable | None:
    """The plan as a certificate that covers the box, proved; None if none is."""
    if plan is None:
        return None
    rho = None if asked.domain == "global" else plan.rho
    if _takes_long(asked, next(rounded_vectors(plan.proposal)), rho):
        return None
    claim = _covering(asked, radius, plan, rho)
    if claim is None:
        # A steep v compares agents so far apart that a coupling may leave every range there.
        plans = flatter_plans(asked.problem, plan) if rho is not None else ()
        flatter = (_covering(asked, radius, each, rho) for each in plans)
        claim = next((each for each in flatter if each is not None), None)
    return None if claim is None else replace(claim, alpha=rounded_down(claim.alpha * (1 - IN_HAND), digits=6))


def _covering(asked: Asked, radius: float, plan: SeparablePlan, rho: Fraction | None) -> Separable | None:
    """A proved certificate with the v of the plan that covers the box; None if there is none."""
    vectors, wanted = rounded_vectors(plan.proposal), plan.proposal.rate
    claim = first_certificate(asked.problem, asked.W, vectors, rho=rho, error=plan.error, wanted=wanted)
    if claim is None:
        return None
    inside = box_is_inside(claim, radius=claimed(radius), disturbance=claimed(asked.disturbance))
    return claim if inside else None


def _takes_long(asked: Asked, v: Vector, rho: Fraction | None) -> bool:
    """Whether a coupling falls somewhere in the rows of a network too large for rows one by one."""
    problem = asked.problem
    if rho is None or _arcs(asked) <= FALLING_ARCS:
        return False
    try:
        profiles = coupling_profiles(problem, v, rho=rho, modes=tuple(problem.network.modes))
    except UndefinedError:  # the decision says so
        return False
    return not all(kind.is_nondecreasing for kind in profiles)


def _arcs(asked: Asked) -> int:
    return sum(len(mode) for mode in asked.problem.network.modes.values())


def _timing(asked: Asked, claim: Separable, check: Check, report: Progress) -> list[Check]:
    """Delays and sampling beside a proved max-separable check."""
    problem = asked.problem
    arcs = _arcs(asked)
    if arcs > TIMED_ARCS:
        reason = f"left out, because exact rows for {arcs} arcs take long; it is examined up to {TIMED_ARCS}."
        return [undecided_check(id, asked.domain, reason) for id in ("delay", "sampling")]
    report("deciding delays and sampling")
    fastest = claim.alpha if claim.error is None else min(claim.alpha, claim.error.beta)
    bound = longest_delay(problem, claim, rate=rounded_down(fastest * KEPT, digits=4))
    if bound is None:
        delay = undecided_check("delay", asked.domain, "no delay is found that leaves half the rate.")
    else:
        bound = replace(bound, rate=rounded_down(bound.rate * (1 - IN_HAND), digits=6))
        delay = delay_check(problem, claim, bound, check, domain=asked.domain)
    return [delay, sampling_check(problem, claim, check, domain=asked.domain)]


def _remark(asked: Asked, claim: Separable, radius: float) -> str:
    """Why the box is no larger, where one could ask."""
    if claim.rho is None or (asked.wanted and radius == asked.radius):
        return ""
    if not asked.wanted and radius == asked.radius:
        return f" No region is asked for; boxes up to {asked.radius:.6g} were tried."
    wish = f"the region asks for {asked.radius:.6g}" if asked.wanted else "no region is asked for"
    wider = replace(claim, rho=claim.rho * min(claimed(asked.radius) / claimed(radius), WIDER))
    who, answer = "", None
    if _takes_long(asked, wider.v, wider.rho):
        who = f" that is quick to decide: a coupling falls there, and exact rows for {_arcs(asked)} arcs take long"
    else:
        answer = verify_separable(asked.problem, wider)
    if answer is not None and answer.verdict is Verdict.REFUTED and answer.agent is not None:
        label = asked.problem.network.labels[answer.agent]
        where = f" in mode {answer.mode}" if len(asked.problem.network.modes) > 1 else ""
        who = f", and with this one agent {label} is no longer held{where}"
    return f" The box reaches |e_i| <= {radius:.6g}, {wish}: beyond, no v is found{who}."


def _nothing_found(asked: Asked) -> str:
    if asked.domain == "global":
        return "no v is found."
    least = f"no v is found, not even for |e_i| <= {asked.radius / 2**HALVINGS:.2g}"
    if not asked.disturbance:
        return f"{least}."
    return f"{least} together with |eps_i| <= {asked.disturbance:.6g}: a smaller initial disturbance may help."


def _short(radius: float) -> float:
    """Four digits, down."""
    return float(rounded_down(claimed(radius), digits=4))
