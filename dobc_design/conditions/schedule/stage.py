"""A settling time: what is asked for, the moving box and the certificate proposed for it, and the
check `settling`; and the check `schedule` of signals that keep a guarantee.

Theory, section 11.  Numbers are rounded to the safe side here; whether the claim holds is decided
by ``decide`` alone.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import Any

from dobc_design.conditions.arcs.stage import claims_in
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, cut_check, surviving, undecided_check
from dobc_design.conditions.coverage import Asked as Region
from dobc_design.conditions.coverage import Progress, asked_radius
from dobc_design.conditions.domain import Around, Box
from dobc_design.conditions.numbers import claimed, decimal_above, rounded_up
from dobc_design.conditions.quadratic.claim import Quadratic
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse
from dobc_design.conditions.reason import first_missing, gap_obstacle
from dobc_design.conditions.schedule import decide, propose, propose_cycles
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component
from dobc_design.conditions.separable.propose import (
    Cover,
    first_certificate,
    flatter_plans,
)
from dobc_design.conditions.stated import stated_in
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.interval import Interval, log, sqrt
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ONE, ZERO, parse_number
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .checks import cycles_check, settling_check, settling_of
from .claim import SETTLED, Cycles, Descent, Last, Tube
from .cycles import holds_starts, late_obstacle, rises, unreached_in_words
from .cycles import why_not as why_not_cycles
from .propose import Asked
from .rounds import growth_check
from .settling import Settling, proved_reason

logger = logging.getLogger("dobc_design")

#: Agents times state components up to which settling times are looked for.
MOST_ROWS = 100
MOST_PHASES = 2000  # up to which weights are looked for
WORK = 3  # stages' work for one search of weights
DIGITS = 10  # of levels and roots
EXTRA = Fraction(1, 10**9)  # added to them, for whoever encloses exp more widely
SMALLEST = Fraction(1, 10**300)
TIMES = 10**4  # settling times have four decimals


def starts_given(loop: Loop, *, tolerance: Any, radius: Any, disturbance: Any) -> Asked | None:
    """The starts that somebody names for a settling time; None where none are named.  A number that
    is left out comes from the [region].  Raises: SpecError for one that is wrong or missing."""
    if radius is None and disturbance is None:
        return None
    if tolerance is None:
        raise wrong(
            "settling",
            "must be given where starts of a settling time are.",
            "Give the tolerance, in the unit of x.",
        )
    return Asked(
        radius=_radius_given(loop, radius),
        disturbance=_disturbance_given(loop, disturbance),
        tolerance=read_tolerance(tolerance),
    )


def _radius_given(loop: Loop, value: Any) -> Fraction:
    key = "settling_radius"
    if value is None:
        if loop.starts is None:
            raise _no_region(key, "Give it, the largest |e(0)|_inf, or add a [region].")
        return max(asked_radius(loop))
    radius = parse_number(value, key)
    if radius <= 0:
        raise wrong(key, f"must be > 0; got {float(radius):.6g}.")
    return radius


def _disturbance_given(loop: Loop, value: Any) -> Fraction:
    key = "settling_disturbance"
    if value is None:
        if not loop.groups:
            return ZERO
        if loop.starts is None:
            cure = "Give it, the largest |xi_i(0) - xihat_i(0)|, or add a [region]."
            raise _no_region(key, cure)
        return loop.starts.disturbance or ZERO
    error = parse_number(value, key)
    if error < 0:
        raise wrong(key, "must be >= 0, because it is a length.")
    if error and not loop.groups:
        raise wrong(key, "must be 0, because without an [exosystem] there is no observer error.")
    return error


def _no_region(key: str, cure: str) -> SpecError:
    what = "must be given, because the problem has no [region] that says where it starts."
    return wrong(key, what, cure)


def read_tolerance(value: Any) -> Fraction:
    """A tolerance > 0 in the unit of x.  Raises: SpecError for anything else."""
    key = "settling"
    limit = parse_number(value, key)
    if limit <= 0:
        what = f"must be > 0, because |e(t)| only comes close to 0; got {float(limit):.6g}."
        cure = "Name how far every state may still be from its goal, for example 1/100."
        raise wrong(key, what, cure)
    return limit


def asked_beside(case: Case, *, tolerance: Fraction | None) -> Asked | str:
    """The starts whose settling time can be shown beside the checks of ``case``, or why there are
    none.  They are the region asked for, or where a max-separable proof reaches less far, or no
    region is asked for, its box.  Without a ``tolerance`` it is a hundredth of the radius."""
    loop = case.loop
    boxes = list[tuple[Fraction, Fraction]]()
    found = case.proof(Separable)
    if found is not None and isinstance(found.domain, Around):
        boxes.append((claimed(found.domain.radius), claimed(found.domain.disturbance)))
    if loop.starts is not None:
        reach = decimal_above(max(asked_radius(loop)))
        error = decimal_above(loop.starts.disturbance or ZERO)
        boxes.append((claimed(reach), claimed(error)))
    if not boxes:
        return (
            "left out, because nothing says where the agents start: add a [region], or have "
            "every condition run."
        )
    # What is proved from the smaller box; a larger one may hold none.
    radius, disturbance = min(boxes)
    if not radius:
        return "left out, because the region asked for is the target alone."
    limit = tolerance or radius * SETTLED
    return Asked(radius=radius, disturbance=disturbance, tolerance=limit)


def settle(loop: Loop, W: Matrix | None, asked: Asked, *, progress: Progress) -> Settling:
    """Find and prove a settling time for the starts asked for, with the gain W (q, m); None without
    an exosystem."""
    single = None
    best = None
    starts = (
        f"from |e|_inf <= {float(asked.radius):.6g} and |eps_i| <= {float(asked.disturbance):.6g}"
    )
    reason = "does not apply: boxes need couplings that act on each state component by itself."
    if acts_by_component(loop):
        progress("looking for a certificate of the whole box")
        single = _by_one_certificate(loop, W, asked)
        progress("following the box of all starts")
        best = _by_a_tube(loop, W, asked, single)
        reason = (
            f"no moving box was found {starts}. Try a smaller radius or disturbance, or more pins."
        )
    if best is not None:
        found = settling_of(loop, best, f"{starts}, {proved_reason(loop, best)}")
        return replace(found, single=single)
    return Settling(
        verdict=Verdict.UNDECIDED,
        reason=reason,
        problem_name=loop.name,
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        single=single,
        unit=loop.unit,
    )


def _by_one_certificate(loop: Loop, W: Matrix | None, asked: Asked) -> Descent | None:
    """A proved claim by a max-separable or arc-wise certificate that holds all starts."""
    plan = Cover(loop=loop, radius=asked.radius, disturbance=asked.disturbance, W=W).fastest()
    plans = () if plan is None else chain((plan,), flatter_plans(loop, plan))
    for each in plans:
        whole = propose.slowed(loop, W, first_certificate(loop, W, each))
        if whole is not None:
            start = Tube.start(loop, asked.radius, whole.error)
            return _proved(loop, W, asked, start, whole)
    if loop.timing is not None:
        return None
    box = Box(decimal_above(asked.radius), decimal_above(asked.disturbance))
    for last in claims_in(loop, W, box):
        start = Tube.start(loop, asked.radius, propose.observed(loop, W))
        return _proved(loop, W, asked, start, last)
    return None


def _by_a_tube(
    loop: Loop, W: Matrix | None, asked: Asked, single: Descent | None
) -> Descent | None:
    """A proved claim by a box that moves, or ``single`` where none is faster."""
    limit = None if single is None else float(single.time)
    # The tightest tubes come first, so that the first proved one is nearly the fastest.
    for tube, last in propose.approach(loop, W, asked, limit=limit):
        found = _proved(loop, W, asked, tube, last)
        if found is not None:
            return found if single is None or found.time < single.time else single
    return single


def _proved(
    loop: Loop, W: Matrix | None, asked: Asked, tube: Tube, certificate: Last
) -> Descent | None:
    """The claim of a tube and the certificate that takes over, levels and times rounded up, if it
    is proved."""
    draft = Descent(
        tube=tube,
        certificate=certificate,
        level=ONE,
        height=_height(certificate),
        stretch=_stretch(certificate, tube),
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        time=tube.ends,
    )
    size = decide.level_at_the_end(loop, draft)
    if isinstance(certificate, Quadratic):
        level = _up(sqrt(size).hi)
    else:
        level = _up(size.hi)
        if certificate.rho is not None:
            level = min(level, certificate.rho)  # the whole box may fill the level set exactly
    draft = replace(draft, level=level)
    # From then on |e|_inf <= height times the size is within the tolerance.
    when = _when(draft, asked.tolerance / draft.height)
    if when is None:
        return None
    claim = replace(draft, time=when)
    return claim if decide.why_not(loop, W, claim) is None else None


def _height(certificate: Last) -> Fraction:
    """The largest |e|_inf of errors whose size is at most 1, rounded up."""
    if isinstance(certificate, Quadratic):
        return _root_above(max(diagonal_of_inverse(certificate.P_e)))
    return decide.tallest(certificate)


def _stretch(certificate: Last, tube: Tube) -> Fraction:
    """A number s with P' <= s^2 P, for the observer's P' of a quadratic certificate; else 1."""
    if not isinstance(certificate, Quadratic) or certificate.P is None or tube.error is None:
        return ONE
    return _root_above(propose.relative_bound(certificate.P, tube.error.P))


def _when(claim: Descent, size: Fraction) -> Fraction | None:
    """A time (s) from which on the size of the certificate is at most ``size``; None if there is
    none."""
    if size >= claim.level:
        return claim.tube.ends
    rate = decide.rate_near(claim.certificate)
    if rate <= 0:
        return None
    wait = log(Interval.point(claim.level / size)).hi / rate
    steps = math.ceil((decide.counted_from(claim) + wait) * TIMES)
    return Fraction(steps + 1, TIMES)  # one more, for wider enclosures of log


def _root_above(value: Fraction) -> Fraction:
    return _up(sqrt(Interval.point(value)).hi)


def _up(value: Fraction) -> Fraction:
    """DIGITS significant digits, not below a value > 0."""
    if value <= 0:
        return ZERO
    more = max(value * (1 + EXTRA), SMALLEST)
    return rounded_up(more, digits=DIGITS)


def settling_stage(
    case: Case, *, tolerance: Fraction | None, report: Progress, starts: Asked | None = None
) -> Check:
    """The check `settling` beside those of a case, from the ``starts`` that somebody names or from
    those of ``asked_beside``; ``tolerance`` None: a hundredth of the radius."""
    loop = case.loop
    undecided = partial(undecided_check, "settling", case.domain)
    reason = obstacle(loop, case.W) or late_obstacle(loop, case.W)
    if reason is not None:
        return undecided(reason)
    if stated_in(loop).absolute:
        return undecided(
            "what no exosystem generates acts for ever, so that |e| need not stay below the "
            "tolerance; the check accuracy has the final bounds.",
            applies=False,
        )
    if loop.size > MOST_ROWS:
        return undecided(
            f"left out, because it takes long with {loop.size} rows n m; it is examined up to "
            f"{MOST_ROWS}."
        )
    asked = starts or asked_beside(case, tolerance=tolerance)
    if isinstance(asked, str):
        return undecided(asked)
    report("deciding the settling time")
    try:
        with at_most(STAGE):
            spend(0)
            found = settle(loop, case.W, asked, progress=report)
    except WorkLimitError as limit:
        return cut_check("settling", case.domain, str(limit))
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no settling time: %s", error)
        return undecided("no settling time is found: a numerical library broke down.")
    return settling_check(loop, case.W, found, domain=case.domain)


def schedule_stage(asked: Region, report: Progress) -> list[Check]:
    """The check `schedule`, where [switching] has a guarantee; PROVED or UNDECIDED."""
    loop = asked.loop
    turned = not acts_by_component(loop)
    # Of one graph the weights of pairs say more, where there are few enough; signs have none.
    alone = (loop.is_apart or loop.signed) and len(loop.modes) == 1 and not turned
    if not (loop.guarantee.phases or alone):
        return []
    # What cannot hold is not searched for.
    grows = growth_check(loop, asked.domain)
    if grows is not None:
        return [grows]
    reason = obstacle(loop, asked.W, turned=turned)
    if reason is None and turned:
        reason = gap_obstacle(loop)
    if reason is not None:
        return [undecided_check("schedule", asked.domain, reason)]
    report("following the weights from mode to mode")
    return [_searched(asked, turned=turned)]


def _searched(asked: Region, *, turned: bool) -> Check:
    """The check of the first weights that are found and proved; ``turned``: in coordinates only."""
    loop = asked.loop
    cut = None
    searches = _searches(loop, turned=turned)
    if loop.timing is not None and _weighted_cycles in searches:
        searches = (partial(_weighted_cycles, late=True), *searches)
    for search in searches:
        try:
            # Each search has its own time; one that breaks down leaves the others.
            with at_most(WORK * STAGE), surviving("no weights under the guarantee"):
                spend(0)
                claim = search(asked)
                if claim is not None:
                    return cycles_check(claim, asked)
        except WorkLimitError as limit:
            cut = str(limit)
    if cut is not None:
        return cut_check("schedule", asked.domain, cut)
    nothing = _nothing_found(loop, turned=turned)
    if loop.gap or not loop.guarantee.phases:
        rho = None if loop.is_linear else claimed(asked.radius)
        nothing = first_missing(rises(loop, rho)) or nothing
    return undecided_check("schedule", asked.domain, nothing)


#: A search of weights for what is asked.
Search = Callable[[Region], Cycles | None]


def _searches(loop: Loop, *, turned: bool) -> tuple[Search, ...]:
    """The searches that are worth their time, the fastest rates first."""
    if len(loop.guarantee.phases) > MOST_PHASES:
        return () if turned else (_bare_cycles,)
    if turned:
        return (_turned_cycles,)
    if loop.goal == "roots" or not loop.guarantee.phases:
        return (_bare_cycles,)
    if loop.drift is not None:
        # A couples the components of an agent, so coordinates may help.
        return (_weighted_cycles, _turned_cycles, _bare_cycles)
    return (_weighted_cycles, _bare_cycles)


def _nothing_found(loop: Loop, *, turned: bool) -> str:
    """Why no weights are found."""
    # Where coordinates are in question, a pin need not reach every agent for weights to exist.
    missed = None
    if not turned and loop.drift is None:
        missed = unreached_in_words(loop)
    if missed is not None:
        return missed
    phases = len(loop.guarantee.phases)
    if phases > MOST_PHASES:
        return (
            f"left out, because it takes long with {phases} phases; weights are looked for up "
            f"to {MOST_PHASES}."
        )
    if not loop.guarantee.phases:
        return "no proof by the graph is found."
    return f"no weights are found that fall for {loop.guarantee.in_words()}."


def _reach(asked: Region, error: ErrorBound | None, times: int) -> Fraction:
    """How far V may reach at the start, with so many times what the estimation error adds."""
    noise = ZERO
    if error is not None:
        noise = error.kappa * _root_above(error.size) * claimed(asked.disturbance)
    return claimed(asked.radius) + times * noise


def _if_it_holds(claim: Cycles | None, asked: Region) -> Cycles | None:
    """The claim, if its region holds the starts asked for."""
    radius = claimed(asked.radius)
    disturbance = claimed(asked.disturbance)
    if claim is None:
        return None
    holds = holds_starts(asked.loop, claim, radius=radius, disturbance=disturbance)
    return claim if holds else None


def _weighted_cycles(asked: Region, *, late: bool = False) -> Cycles | None:
    """A claim with weights and a rate that is proved and holds the starts asked for; ``late``: with
    the readings that the problem states."""
    loop = asked.loop
    error = propose.observed(loop, asked.W)
    if loop.size > MOST_ROWS or (loop.groups and error is None):
        return None
    if late and late_obstacle(loop, asked.W) is not None:
        return None
    rho = None if loop.is_linear else _reach(asked, error, 2)
    found = propose_cycles.propose(loop, asked.W, rho=rho, error=error, late=late)
    return _if_it_holds(found, asked)


def _turned_cycles(asked: Region) -> Cycles | None:
    """The same in coordinates."""
    loop = asked.loop
    if loop.size > MOST_ROWS:
        return None
    box = None if loop.is_linear else (claimed(asked.radius), claimed(asked.disturbance))
    seen = partial(propose.observed, loop, asked.W)
    claim = propose_cycles.propose_in_coordinates(loop, asked.W, box=box, observed=seen)
    return _if_it_holds(claim, asked)


def _bare_cycles(asked: Region) -> Cycles | None:
    """The same by the graphs alone, without a rate."""
    loop = asked.loop
    error = propose.observed(loop, asked.W)
    rho = None if loop.is_linear else _up(_reach(asked, error, 1))
    claim = Cycles(phases=(), rate=None, rho=rho, error=error)
    return claim if why_not_cycles(loop, asked.W, claim) is None else None
