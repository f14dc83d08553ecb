"""The max-separable certificate of the region asked for, with what it says about delays and
sampling (section 5)."""

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np

from dobc_design._checks import positional
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
from dobc_design.conditions.kinds import MAX_SEPARABLE, READINGS
from dobc_design.conditions.numbers import bisected, claimed, rounded_down, time_to_one_percent
from dobc_design.conditions.separable import checks, propose
from dobc_design.exact.matrix import to_float
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted, out_of_time
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .claim import EXACT, Errors, Separable, stated_errors
from .decide import composite_rate, covers, verify_separable
from .propose import Cover, SeparablePlan
from .propose_coordinates import propose_coordinates
from .propose_limits import longest_delay
from .propose_readings import Search
from .timing import (
    delay_obstacle,
    readings_obstacle,
    rest_matrix,
    steepness,
    too_steep,
    with_own_delay,
)

#: A second program with simpler enclosures has to confirm the rows, so they keep this part of alpha
#: in hand.
IN_HAND = Fraction(1, 10**4)
# (agents, relative accuracy of the largest box that is still worth the time)
CLOSE = ((60, 0.002), (2000, 0.02), (10**9, 0.25))
ROUGHLY = ((60, 9), (2000, 7), (10**9, 4))  # agents, and bisections in coordinates
HALVINGS = 12
NEAREST = Fraction(1, 10**9)  # a rate, and a radius next to the target
NEARLY = 1.01  # rates that differ by a smaller factor are the same
AS_PLANNED = 0.97  # of a planned rate: where less is proved, other plans may be better
WIDER = Fraction(2)  # how much further out the agent is looked for that is no longer held
KEPT = Fraction(1, 2)  # of the rate, which delays are to leave
WORTH = 2  # how many times less steep couplings have to be for a v of its own for sampling
SLOWER = 0.1  # the part of the rate that it keeps
SAMPLES = 50  # of a coupling, for its steepness
# times slower than without them rows may be with the errors that the file states
SLOWER_WITH_ERRORS = 10**6
#: Arcs of all modes together up to which delays and sampling are examined (a minute in the second
#: program).
TIMED_ARCS = 20_000


def separable_stage(asked: Asked, report: Progress) -> list[Check]:
    """The max-separable certificate, and what it says about delays and sampling; in coordinates z =
    T x where these reach farther, for agents with dynamics and couplings of vectors."""
    by_component = _by_component(asked, report)
    first = by_component[0]
    loop = asked.loop
    # Coordinates gain nothing where components are alone, and need the gain of the observer.
    apart = (loop.drift is None and first.applies) or (loop.groups and asked.W is None)
    if apart or loop.gap or _size(first) >= asked.radius:
        return by_component
    report("deciding the region (max-separable, in coordinates)")
    claims, cut = _in_coordinates(asked)
    if claims:
        radius = max(claims)
        own = checks.max_separable_check(asked, claims[radius], radius=radius)
        return [own] if _size(own) > _size(first) else by_component
    if first.applies:
        return by_component
    if cut is not None:
        return [cut_check(MAX_SEPARABLE, asked.domain, cut)]
    reason = (
        "no coordinates z = T x with weights v are found in which the largest weighted "
        "error decreases."
    )
    return [undecided_check(MAX_SEPARABLE, asked.domain, reason)]


def readings_stage(asked: Asked, report: Progress) -> list[Check]:
    """Whether the box is certified with the readings and the processor that the problem states; no
    check where it states none."""
    loop = asked.loop
    if loop.timing is None:
        return []
    report("deciding late, held and lost readings")

    def decided() -> Check:
        reason = readings_obstacle(loop, asked.W) or checks.obstacle(loop, asked.W)
        if reason is not None:
            return undecided_check(READINGS, asked.domain, reason, applies=False)
        found = _largest_late(asked)
        if found is not None:
            return found
        with surviving("no eigenvalues"):
            M = rest_matrix(loop)
            roots = [] if M is None else np.linalg.eigvals(to_float(M)).tolist()
            diverging = checks.diverging_check(loop, roots, domain=asked.domain)
            if diverging is not None:
                return diverging
        return undecided_check(READINGS, asked.domain, _not_late(loop))

    return [limited(READINGS, asked.domain, decided)]


def _not_late(loop: Loop) -> str:
    """Why nothing is found: agents overshoot even next to the target, or something else."""
    timing = loop.timing
    found = "no weights v are found with these readings."
    if timing is None or timing.steepest is None:
        return found
    near = Separable(v=(Fraction(1),) * loop.n, alpha=NEAREST, rho=NEAREST)
    steep = steepness(loop, near, timing)
    return steep if isinstance(steep, str) else too_steep(timing, steep) or found


def _largest_late(asked: Asked) -> Check | None:
    """The check for the box asked for, else for the largest that is found."""
    everywhere = asked.domain == EVERYWHERE
    reached = 0.0

    def proved(radius: float, *, soonest: bool) -> Check | None:
        search = Search(
            loop=asked.loop,
            W=asked.W,
            radius=claimed(radius),
            disturbance=claimed(asked.disturbance),
            everywhere=everywhere,
        )
        found = None
        with surviving(f"no proposal for late readings for radius {radius}", WorkLimitError):
            claims = search.soonest(asked.rate) if soonest else search.claims()
            checked = (checks.readings_check(asked, claim, radius=radius) for claim in claims)
            found = next((check for check in checked if check.is_proved), None)
        return found

    def holds(radius: float) -> bool:
        nonlocal reached
        if proved(radius, soonest=False) is None:
            return False
        reached = radius
        return True

    with at_most(STAGE):
        _try_boxes(asked, holds)
    if not reached:
        return None
    with at_most(STAGE):
        return proved(reached, soonest=True) or proved(reached, soonest=False)


def _size(check: Check) -> float:
    """The radius of a proved box, 0 without one."""
    if not check.is_proved:
        return 0.0
    return float(check.domain.radius) if isinstance(check.domain, Around) else math.inf


def _in_coordinates(asked: Asked) -> tuple[dict[float, Separable], str | None]:
    """Claims by the radius of their boxes: that asked for, else the largest that are found; why no
    more are sought."""
    claims: dict[float, Separable] = {}
    everywhere = asked.domain == EVERYWHERE

    def holds(radius: float) -> bool:
        with surviving(f"no coordinates for radius {radius}", WorkLimitError):
            claim = propose_coordinates(
                _Box(asked, radius).cover, everywhere=everywhere, least=asked.rate
            )
            if claim is not None:
                claims[radius] = claim
        return radius in claims

    with at_most(STAGE):
        _try_boxes(asked, holds)
        cut = exhausted()
    return claims, cut


def _try_boxes(asked: Asked, holds: Callable[[float], bool]) -> None:
    """Ask whether the box that is asked for holds, else by bisection which is about the largest."""

    def at(halvings: float) -> bool:
        return holds(_short(asked.radius / 2**halvings) if halvings else asked.radius)

    if not at(0) and asked.domain != EVERYWHERE and at(HALVINGS):
        steps = next(steps for n, steps in ROUGHLY if asked.loop.n <= n)
        bisected(at, float(HALVINGS), 0.0, steps=steps)


def _by_component(asked: Asked, report: Progress) -> list[Check]:
    """The certificate for couplings by component."""
    loop = asked.loop
    W = asked.W
    domain = asked.domain
    report("deciding the region (max-separable)")
    reason = checks.obstacle(loop, W)
    if reason is not None:
        return [undecided_check(MAX_SEPARABLE, domain, reason, applies=False)]
    late = out_of_time()
    if late is not None:
        return [cut_check(MAX_SEPARABLE, domain, late)]
    stuck = checks.stuck_check(loop, W, domain=domain)
    if stuck is not None:
        return [stuck]
    with at_most(STAGE):
        found = largest_claim(asked)
        cut = exhausted()
    if found is None and cut is not None:
        return [cut_check(MAX_SEPARABLE, domain, cut)]
    if found is None:
        return [undecided_check(MAX_SEPARABLE, domain, _not_found(asked))]
    claim = found.claim
    fastest = found.fastest
    if cut is None:
        told = _remark(asked, claim, found.radius)
    else:
        told = f" The search for a larger box was {cut}"
    # A plan keeps a little of its rate in hand, so that a claim close to it may prove more than it
    # promises.
    if fastest is not None and fastest.whole_rate > NEARLY * composite_rate(claim):
        told = fastest_in_words(fastest.whole_rate, fastest.factor) + told
    check = checks.max_separable_check(asked, claim, radius=found.radius, remark=told)
    if not check.is_proved:
        return [check]
    # What is stated is decided for itself.
    if loop.timing is not None:
        return [check]
    return [check, *_timing(asked, claim, check, report)]


def _not_found(asked: Asked) -> str:
    """What is said where no v is found."""
    if asked.domain == EVERYWHERE:
        return "no v is found."
    reason = f"no v is found, not even for |e_i| <= {asked.radius / 2**HALVINGS:.2g}"
    if not asked.disturbance:
        return f"{reason}."
    return (
        f"{reason} together with |eps_i| <= {asked.disturbance:.6g}: a smaller initial "
        "disturbance may help."
    )


@positional
class Found:
    """A proved claim and the radius of its box; ``fastest``: the plan with the largest rate, if
    that is another one."""

    claim: Separable
    radius: float
    fastest: SeparablePlan | None = None


def largest_claim(asked: Asked) -> Found | None:
    """A proved claim for the box asked for, else for the largest box that is found.  Where the file
    states errors of weights and gains, one whose rows hold for all of them is looked for first."""
    loop = asked.loop
    errors = stated_errors(loop)
    if any(errors):
        box = _Box(asked, asked.radius, errors)
        found = box.claim(box.plan())
        if found is not None:
            slow = replace(found.claim, alpha=found.claim.alpha / SLOWER_WITH_ERRORS)
            if verify_separable(loop, slow, errors=errors).wrong is None:
                return found

    def at(radius: float) -> Found | None:
        box = _Box(asked, radius)
        return box.claim(box.plan())

    found = at(asked.radius)
    if found is not None or asked.domain == EVERYWHERE:
        return found
    # Boxes may be far too large: halved first, then cut between the last one and the next.
    low = _short(asked.radius / 2**HALVINGS)
    high = asked.radius
    nearest = at(low)
    if nearest is None:
        return None
    for _ in range(HALVINGS - 1):
        radius = _short(high / 2)
        found = at(radius)
        if found is not None:
            nearest = found
            low = radius
            break
        high = radius
    plans: list[tuple[_Box, SeparablePlan]] = []  # that floating point covers, increasing
    close = next(part for size, part in CLOSE if loop.n <= size)
    # Floating point says quickly where no v is left; the largest box that it covers is proved.
    while high - low > close * high:
        radius = _short((low + high) / 2)
        if not low < radius < high:
            break
        box = _Box(asked, radius)
        plan = box.plan()
        if plan is None:
            high = radius
        else:
            plans.append((box, plan))
            low = radius
    for box, plan in reversed(plans):
        found = box.claim(plan)
        if found is not None:
            return found
    return nearest


@positional
class _Box:
    """A box of starts to be covered.  ``errors``: weights and gains take their worse ends."""

    asked: Asked
    radius: float
    errors: Errors = EXACT

    @property
    def cover(self) -> Cover:
        """What a plan has to cover; for linear couplings all boxes are alike."""
        whole = Cover(
            loop=self.asked.loop,
            W=self.asked.W,
            radius=claimed(self.radius),
            disturbance=claimed(self.asked.disturbance),
            errors=self.errors,
        )
        if self.asked.domain == EVERYWHERE:
            return replace(whole, radius=Fraction(1), disturbance=Fraction(0))
        return whole

    def plan(self) -> SeparablePlan | None:
        """What floating point proposes, with the largest rate."""
        plan = None
        with surviving(f"no max-separable proposal for radius {self.radius}", WorkLimitError):
            plan = self.cover.fastest()
        return plan

    def sooner(self, plan: SeparablePlan) -> SeparablePlan:
        """The plan that promises the least time to one percent."""
        # errors take of the rate, of which little would be left
        if any(stated_errors(self.asked.loop)) and not any(self.errors):
            return plan
        sooner = plan
        with surviving(
            f"no earlier max-separable proposal for radius {self.radius}", WorkLimitError
        ):
            sooner = self.cover.sooner(plan, least=self.asked.rate)
        return sooner

    def covering(self, plan: SeparablePlan) -> Separable | None:
        """A proved certificate with the v of the plan that covers the box; None if there is
        none."""
        asked = self.asked
        everywhere = asked.domain == EVERYWHERE
        claim = propose.first_certificate(asked.loop, asked.W, plan, everywhere=everywhere)
        disturbance = claimed(asked.disturbance)
        if claim is None or not covers(claim, radius=claimed(self.radius), disturbance=disturbance):
            return None
        return replace(claim, alpha=rounded_down(claim.alpha * (1 - IN_HAND), digits=6))

    def claim(self, plan: SeparablePlan | None) -> Found | None:
        """The plan as a certificate that covers the box, proved, with a little of its rate in hand;
        None if none is.  Where a slower rate reaches one percent earlier, that one."""
        if plan is None:
            return None
        sooner = self.sooner(plan)
        first = None
        try:
            if sooner is not plan:
                first = self.covering(sooner)
            if first is not None and composite_rate(first) >= sooner.whole_rate * AS_PLANNED:
                return Found(first, self.radius, fastest=plan)
            claim = self.covering(plan)
            if claim is None and self.asked.domain != EVERYWHERE:
                # A steep v compares agents so far apart that a coupling may leave every range
                # there.
                flatter = propose.flatter_plans(self.asked.loop, plan)
                claim = next(filter(None, map(self.covering, flatter)), None)
        except WorkLimitError:  # the boxes proved so far remain
            return None
        claims = [each for each in (first, claim) if each is not None]
        return Found(min(claims, key=_time), self.radius) if claims else None


def _time(claim: Separable) -> float:
    """The time to one percent (s) that a claim proves."""
    return time_to_one_percent(float(composite_rate(claim)), float(claim.factor))


def _timing(asked: Asked, claim: Separable, check: Check, report: Progress) -> list[Check]:
    """Delays and sampling beside a proved max-separable check."""
    loop = asked.loop
    domain = asked.domain
    arcs = loop.arc_count
    if arcs > TIMED_ARCS:
        reason = (
            f"left out: the network has {arcs} arcs; delays and sampling are examined up to "
            f"{TIMED_ARCS}."
        )
        return [undecided_check(id, domain, reason) for id in ("delay", "sampling")]
    report("deciding delays and sampling")
    fastest = claim.alpha if claim.error is None else min(claim.alpha, claim.error.beta)

    def delay() -> Check:
        if (reason := delay_obstacle(loop)) is not None:
            return undecided_check("delay", domain, reason, applies=False)
        bound = longest_delay(loop, claim, rate=rounded_down(fastest * KEPT, digits=4))
        if bound is None:
            return undecided_check("delay", domain, "no delay is found that leaves half the rate.")
        bound = replace(bound, rate=rounded_down(bound.rate * (1 - IN_HAND), digits=6))
        bound = with_own_delay(loop, claim, bound)
        return checks.delay_check(loop, claim, bound, check, domain=domain)

    def sampling() -> Check:
        own = _flatter_claim(asked, claim, check)
        return checks.sampling_check(asked.case, claim, check, own=own)

    found = [limited("delay", domain, delay)]
    # Own dynamics are not held between samples; nor are fixed nodes that move.
    if loop.drift is None and not loop.gap:
        found.append(limited("sampling", domain, sampling))
    return found


def _flatter_claim(asked: Asked, claim: Separable, check: Check) -> Separable | None:
    """Another certificate of the same box, slower but with a flatter v, where that allows far
    longer sampling periods. Values may be held for about 2/h'(rho (v_i + v_j)): steep couplings
    want rho v as small as the box allows."""
    if claim.rho is None or not isinstance(check.domain, Around):
        return None
    twice = 2 * float(claim.rho)
    steepest = _steepness(asked.loop, twice * float(max(claim.v)))
    if steepest < WORTH * _steepness(asked.loop, twice * float(claim.least)):
        return None
    own = replace(asked, disturbance=check.domain.disturbance)
    box = _Box(own, check.domain.radius)
    plan = None
    with surviving("no flatter v for sampling"):
        plan = box.cover.flat(float(claim.alpha) * SLOWER)
    return None if plan is None else box.covering(plan)


def _steepness(loop: Loop, reach: float) -> float:
    """The largest slope of a coupling on |y| <= reach, about; where h is not a number, infinite."""
    worst = 0.0
    step = reach / SAMPLES
    places = [step * k for k in range(-SAMPLES, SAMPLES + 1)]
    for coupling in loop.functions:
        h = coupling.numpy_function()
        values = [h([y] * coupling.dimension)[0] for y in places]
        for before, after in pairwise(values):
            slope = (after - before) / step
            worst = max(worst, slope if math.isfinite(slope) else math.inf)
    return worst


def _remark(asked: Asked, claim: Separable, radius: float) -> str:
    """Why the box is no larger, where one could ask."""
    loop = asked.loop
    if claim.rho is None:
        return ""
    if radius == asked.radius:
        tried = f" No region is asked for; boxes up to {asked.radius:.6g} were tried."
        return "" if asked.wanted else tried
    wish = f"the region asks for {asked.radius:.6g}" if asked.wanted else "no region is asked for"
    wider = replace(claim, rho=claim.rho * min(claimed(asked.radius) / claimed(radius), WIDER))
    answer = verify_separable(loop, wider)
    who = ""
    if answer.verdict is Verdict.REFUTED and answer.agent is not None:
        where = f" in mode {answer.mode}" if len(loop.modes) > 1 else ""
        who = f", and with this v the row of agent {loop.labels[answer.agent]} fails{where}"
    return f" The box reaches |e_i| <= {radius:.6g}, {wish}: beyond, no v is found{who}."


def _short(radius: float) -> float:
    """Four digits, down."""
    return float(rounded_down(claimed(radius), digits=4))
