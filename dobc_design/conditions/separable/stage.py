"""The max-separable certificate of the region asked for, with what it says about delays and
sampling (section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

from dobc_design.conditions.check import (
    Check,
    cut_check,
    fastest_in_words,
    limited,
    surviving,
    undecided_check,
)
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.domain import EVERYWHERE, Around
from dobc_design.conditions.numbers import bisected, claimed, rounded_down, time_to_one_percent
from dobc_design.conditions.separable import checks, propose
from dobc_design.conditions.separable.claim import EXACT, Errors, Separable, stated_errors
from dobc_design.conditions.separable.decide import composite_rate, covers, verify_separable
from dobc_design.conditions.separable.propose import SeparablePlan
from dobc_design.conditions.separable.propose_coordinates import propose_coordinates
from dobc_design.conditions.separable.propose_limits import longest_delay
from dobc_design.conditions.separable.timing import LEADER_GOES_ON
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted
from dobc_design.verdict import Verdict

#: A second program with simpler enclosures has to confirm the rows, so they keep this part of alpha
#: in hand.
IN_HAND = Fraction(1, 10**4)
# (agents, relative accuracy of the largest box that is still worth the time)
CLOSE = ((60, 0.002), (2000, 0.02), (10**9, 0.25))
ROUGHLY = ((60, 9), (2000, 7), (10**9, 4))  # agents, and bisections in coordinates
HALVINGS = 12
NEARLY = 1.01  # rates that differ by a smaller factor are the same
AS_PLANNED = 0.97  # of a planned rate: where less is proved, other plans may be better
WIDER = Fraction(2)  # how much further out the agent is looked for that is no longer held
KEPT = Fraction(1, 2)  # of the rate, which delays are to leave
#: How many times less steep couplings have to be for a v of its own for sampling; the part of the
#: rate that it keeps.
WORTH, SLOWER, SAMPLES = 2, 0.1, 50
# times slower than without them rows may be with the errors that the file states
SLOWER_WITH_ERRORS = 10**6
#: Arcs of all modes together up to which delays and sampling are examined (a minute in the second
#: program).
TIMED_ARCS = 20_000


def separable_stage(asked: Asked, report: Progress) -> list[Check]:
    """The max-separable certificate, and what it says about delays and sampling; in coordinates z =
    T x where these reach farther, for agents with dynamics and couplings of vectors."""
    found = _by_component(asked, report)
    first, loop = found[0], asked.loop
    apart = (loop.drift is None and first.applies) or (loop.groups and asked.W is None)
    if apart or _size(first) >= asked.radius:
        return found
    report("deciding the region (max-separable, in coordinates)")
    claims, cut = _in_coordinates(asked)
    if not claims and cut is not None:
        return found if first.applies else [cut_check("max-separable", asked.domain, cut)]
    if not claims:
        reason = (
            "no coordinates z = T x with weights v are found in which the largest weighted "
            "error decreases."
        )
        return found if first.applies else [undecided_check("max-separable", asked.domain, reason)]
    radius, s = max(claims), asked.disturbance
    own = checks.max_separable_check(
        loop, asked.W, claims[radius], radius=radius, disturbance=s, domain=asked.domain
    )
    return [own] if _size(own) > _size(first) else found


def _size(check: Check) -> float:
    """The radius of a proved box, 0 without one."""
    if check.verdict is not Verdict.PROVED:
        return 0.0
    return float(check.domain.radius) if isinstance(check.domain, Around) else math.inf


def _in_coordinates(asked: Asked) -> tuple[dict[float, Separable], str | None]:
    """Claims by the radius of their boxes: that asked for, else the largest that are found; why no
    more are sought."""
    claims, everywhere = dict[float, Separable](), asked.domain == EVERYWHERE

    def holds(halvings: float) -> bool:
        radius = _short(asked.radius / 2**halvings) if halvings else asked.radius
        with surviving(f"no coordinates for radius {radius}", WorkLimitError):
            size, s = claimed(radius), claimed(asked.disturbance)
            claim = propose_coordinates(
                asked.loop, asked.W, size, s, everywhere=everywhere, least=asked.rate
            )
            if claim is not None:
                claims[radius] = claim
        return radius in claims

    with at_most(STAGE):
        if not holds(0) and not everywhere and holds(HALVINGS):
            bisected(
                holds,
                float(HALVINGS),
                0.0,
                steps=next(steps for n, steps in ROUGHLY if asked.loop.n <= n),
            )
        cut = exhausted()
    return claims, cut


def _by_component(asked: Asked, report: Progress) -> list[Check]:
    """The certificate for couplings by component."""
    loop, W, domain = asked.loop, asked.W, asked.domain
    report("deciding the region (max-separable)")
    if (reason := checks.obstacle(loop, W)) is not None:
        return [undecided_check("max-separable", domain, reason, applies=False)]
    if (stuck := checks.stuck_check(loop, W, domain=domain)) is not None:
        return [stuck]
    with at_most(STAGE):
        found = largest_claim(asked)
        cut = exhausted()
    if found is None and cut is not None:
        return [cut_check("max-separable", domain, cut)]
    if found is None:
        reason = "no v is found"
        if domain != EVERYWHERE:
            reason += f", not even for |e_i| <= {asked.radius / 2**HALVINGS:.2g}"
        if domain != EVERYWHERE and asked.disturbance:
            reason += (
                f" together with |eps_i| <= {asked.disturbance:.6g}: a smaller initial "
                "disturbance may help"
            )
        return [undecided_check("max-separable", domain, f"{reason}.")]
    claim, radius = found.claim, found.radius
    told = (
        _remark(asked, claim, radius) if cut is None else f" The search for a larger box was {cut}"
    )
    # A plan keeps a little of its rate in hand, so that a claim close to it may prove more than it
    # promises.
    if found.fastest is not None and found.fastest.whole_rate > NEARLY * composite_rate(claim):
        told = fastest_in_words(found.fastest.whole_rate, found.fastest.factor) + told
    check = checks.max_separable_check(
        loop, W, claim, radius=radius, disturbance=asked.disturbance, domain=domain, remark=told
    )
    return (
        [check]
        if check.verdict is not Verdict.PROVED
        else [check, *_timing(asked, claim, check, report)]
    )


@dataclass(frozen=True, slots=True)
class Found:
    """A proved claim and the radius of its box; ``fastest``: the plan with the largest rate, if
    that is another one."""

    claim: Separable
    radius: float
    fastest: SeparablePlan | None = None


def largest_claim(asked: Asked) -> Found | None:
    """A proved claim for the box asked for, else for the largest box that is found.  Where the file
    states errors of weights and gains, one whose rows hold for all of them is looked for first."""
    if any(errors := stated_errors(asked.loop)):
        found = _claim(asked, asked.radius, _plan(asked, asked.radius, errors), errors)
        slow = (
            None
            if found is None
            else replace(found.claim, alpha=found.claim.alpha / SLOWER_WITH_ERRORS)
        )
        if (
            slow is not None
            and verify_separable(asked.loop, slow, errors=errors).verdict is Verdict.PROVED
        ):
            return found
    found = _claim(asked, asked.radius, _plan(asked, asked.radius))
    if found is not None or asked.domain == EVERYWHERE:
        return found
    low, high = _short(asked.radius / 2**HALVINGS), asked.radius
    nearest = _claim(asked, low, _plan(asked, low))
    if nearest is None:
        return None
    for _ in range(HALVINGS - 1):
        radius = _short(high / 2)
        found = _claim(asked, radius, _plan(asked, radius))
        if found is not None:
            nearest, low = found, radius
            break
        high = radius
    plans = list[tuple[float, SeparablePlan]]()  # of boxes that floating point covers, increasing
    close = next(part for size, part in CLOSE if asked.loop.n <= size)
    while high - low > close * high and low < (radius := _short((low + high) / 2)) < high:
        plan = _plan(asked, radius)
        if plan is None:
            high = radius
        else:
            plans.append((radius, plan))
            low = radius
    for radius, plan in reversed(plans):
        found = _claim(asked, radius, plan)
        if found is not None:
            return found
    return nearest


def _starts(asked: Asked, radius: float) -> dict[str, Fraction]:
    """What a plan has to cover; for linear couplings all boxes are alike."""
    if asked.domain == EVERYWHERE:
        return {"radius": Fraction(1), "disturbance": Fraction(0)}
    return {"radius": claimed(radius), "disturbance": claimed(asked.disturbance)}


def _plan(asked: Asked, radius: float, errors: Errors = EXACT) -> SeparablePlan | None:
    """What floating point proposes for a box, with the largest rate."""
    plan = None
    with surviving(f"no max-separable proposal for radius {radius}", WorkLimitError):
        plan = propose.design_separable(
            asked.loop, **_starts(asked, radius), W=asked.W, errors=errors
        )
    return plan


def _claim(
    asked: Asked, radius: float, plan: SeparablePlan | None, errors: Errors = EXACT
) -> Found | None:
    """The plan as a certificate that covers the box, proved, with a little of its rate in hand;
    None if none is.  Where a slower rate reaches one percent earlier, that one."""
    if plan is None:
        return None
    sooner = _sooner(asked, radius, plan, errors)
    try:
        first = None if sooner is plan else _covering(asked, radius, sooner)
        if first is not None and composite_rate(first) >= sooner.whole_rate * AS_PLANNED:
            return Found(first, radius, fastest=plan)
        claim = _covering(asked, radius, plan)
        if claim is None and asked.domain != EVERYWHERE:
            # A steep v compares agents so far apart that a coupling may leave every range there.
            flatter = (
                _covering(asked, radius, each) for each in propose.flatter_plans(asked.loop, plan)
            )
            claim = next((each for each in flatter if each is not None), None)
    except WorkLimitError:  # the boxes proved so far remain
        return None
    claims = [each for each in (first, claim) if each is not None]
    return Found(min(claims, key=_time), radius) if claims else None


def _time(claim: Separable) -> float:
    """The time to one percent (s) that a claim proves."""
    return time_to_one_percent(float(composite_rate(claim)), float(claim.factor))


def _sooner(asked: Asked, radius: float, plan: SeparablePlan, errors: Errors) -> SeparablePlan:
    """The plan for the same box that promises the least time to one percent."""
    # these take of the rate, of which little would be left
    if any(stated_errors(asked.loop)) and not any(errors):
        return plan
    sooner = plan
    with surviving(f"no earlier max-separable proposal for radius {radius}", WorkLimitError):
        starts = _starts(asked, radius)
        sooner = propose.sooner_plan(
            asked.loop,
            plan,
            radius=starts["radius"],
            disturbance=starts["disturbance"],
            W=asked.W,
            least=asked.rate,
            errors=errors,
        )
    return sooner


def _covering(asked: Asked, radius: float, plan: SeparablePlan) -> Separable | None:
    """A proved certificate with the v of the plan that covers the box; None if there is none."""
    claim = propose.first_certificate(
        asked.loop, asked.W, plan, everywhere=asked.domain == EVERYWHERE
    )
    if claim is None or not covers(
        claim, radius=claimed(radius), disturbance=claimed(asked.disturbance)
    ):
        return None
    return replace(claim, alpha=rounded_down(claim.alpha * (1 - IN_HAND), digits=6))


def _timing(asked: Asked, claim: Separable, check: Check, report: Progress) -> list[Check]:
    """Delays and sampling beside a proved max-separable check."""
    loop = asked.loop
    arcs = sum(map(len, loop.modes.values()))
    if arcs > TIMED_ARCS:
        reason = (
            f"left out: the network has {arcs} arcs; delays and sampling are examined up to "
            f"{TIMED_ARCS}."
        )
        return [undecided_check(id, asked.domain, reason) for id in ("delay", "sampling")]
    report("deciding delays and sampling")
    fastest = claim.alpha if claim.error is None else min(claim.alpha, claim.error.beta)

    def delay() -> Check:
        if loop.goals.moves:
            return undecided_check("delay", asked.domain, LEADER_GOES_ON, applies=False)
        bound = longest_delay(loop, claim, rate=rounded_down(fastest * KEPT, digits=4))
        if bound is None:
            return undecided_check(
                "delay", asked.domain, "no delay is found that leaves half the rate."
            )
        bound = replace(bound, rate=rounded_down(bound.rate * (1 - IN_HAND), digits=6))
        return checks.delay_check(loop, claim, bound, check, domain=asked.domain)

    def sampling() -> Check:
        own = _flatter_claim(asked, claim, check)
        return checks.sampling_check(loop, claim, check, domain=asked.domain, W=asked.W, own=own)

    own = loop.drift is not None  # their dynamics are not held between samples
    return [
        limited("delay", asked.domain, delay),
        *([] if own else [limited("sampling", asked.domain, sampling)]),
    ]


def _flatter_claim(asked: Asked, claim: Separable, check: Check) -> Separable | None:
    """Another certificate of the same box, slower but with a flatter v, where that allows far
    longer sampling periods. Values may be held for about 2/h'(rho (v_i + v_j)): steep couplings
    want rho v as small as the box allows."""
    if claim.rho is None or not isinstance(check.domain, Around):
        return None
    farthest = 2 * float(claim.rho) * float(max(claim.v))
    if _steepness(asked, farthest) < WORTH * _steepness(
        asked, 2 * float(claim.rho) * float(claim.least)
    ):
        return None
    radius, disturbance = check.domain.radius, check.domain.disturbance
    R, s, slower = claimed(radius), claimed(disturbance), float(claim.alpha) * SLOWER
    plan = None
    with surviving("no flatter v for sampling"):
        plan = propose.flat_separable(asked.loop, radius=R, disturbance=s, W=asked.W, rate=slower)
    return (
        None if plan is None else _covering(replace(asked, disturbance=disturbance), radius, plan)
    )


def _steepness(asked: Asked, reach: float) -> float:
    """The largest slope of a coupling on |y| <= reach, about; where h is not a number, infinite."""
    worst = 0.0
    for coupling in asked.loop.functions:
        h, step = coupling.numpy_function(), reach / SAMPLES
        values = [h([step * k] * coupling.dimension)[0] for k in range(-SAMPLES, SAMPLES + 1)]
        slopes = [(after - before) / step for before, after in pairwise(values)]
        worst = max(worst, *(slope if math.isfinite(slope) else math.inf for slope in slopes))
    return worst


def _remark(asked: Asked, claim: Separable, radius: float) -> str:
    """Why the box is no larger, where one could ask."""
    if claim.rho is None:
        return ""
    if radius == asked.radius:
        return (
            ""
            if asked.wanted
            else f" No region is asked for; boxes up to {asked.radius:.6g} were tried."
        )
    wish = f"the region asks for {asked.radius:.6g}" if asked.wanted else "no region is asked for"
    wider = replace(claim, rho=claim.rho * min(claimed(asked.radius) / claimed(radius), WIDER))
    who, answer = "", verify_separable(asked.loop, wider)
    if answer.verdict is Verdict.REFUTED and answer.agent is not None:
        label = asked.loop.labels[answer.agent]
        where = f" in mode {answer.mode}" if len(asked.loop.modes) > 1 else ""
        who = f", and with this v the row of agent {label} fails{where}"
    return f" The box reaches |e_i| <= {radius:.6g}, {wish}: beyond, no v is found{who}."


def _short(radius: float) -> float:
    """Four digits, down."""
    return float(rounded_down(claimed(radius), digits=4))
