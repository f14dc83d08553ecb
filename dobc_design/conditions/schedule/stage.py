"""A settling time: what is asked for, the moving box and the certificate proposed for it, and the
check `settling`.

Theory, section 11.  Numbers are rounded to the safe side here; whether the claim holds is decided
by ``decide`` alone.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import Any, Final

from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, cut_check, surviving, undecided_check
from dobc_design.conditions.coverage import Asked as Region
from dobc_design.conditions.coverage import Progress, asked_radius
from dobc_design.conditions.domain import Around
from dobc_design.conditions.numbers import claimed, decimal_above, rounded_up
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse
from dobc_design.conditions.schedule import decide, propose, propose_cycles
from dobc_design.conditions.schedule.checks import cycles_check, settling_check
from dobc_design.conditions.schedule.claim import ONE, SETTLED, ZERO, Descent, Last, Tube
from dobc_design.conditions.schedule.cycles import Cycles, holds_starts, unreached_cycles
from dobc_design.conditions.schedule.cycles import why_not as why_not_cycles
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.conditions.schedule.propose import Asked
from dobc_design.conditions.schedule.rounds import growth_check
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component
from dobc_design.conditions.separable.propose import (
    design_separable,
    first_certificate,
    flatter_plans,
)
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.interval import Interval, log, sqrt
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import parse_number
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")

#: Agents times state components up to which settling times are looked for.
MOST_ROWS: Final = 100
MOST_PHASES: Final = 2000  # up to which weights are looked for
WORK: Final = 3  # stages' work for one search of weights
DIGITS: Final = 10  # of levels and roots
EXTRA: Final = Fraction(1, 10**9)  # added to them, for whoever encloses exp more widely
SMALLEST: Final = Fraction(1, 10**300)
TIMES: Final = 10**4  # settling times have four decimals


def asked_of(loop: Loop, *, tolerance: Any, radius: Any = None, disturbance: Any = None) -> Asked:
    """Read the numbers; what is None comes from the [region].  Raises: SpecError for one that is
    wrong or missing."""
    region = loop.starts
    missing = ["radius"] * (radius is None) + ["disturbance"] * (
        disturbance is None and bool(loop.groups)
    )
    if missing and region is None:
        cure = (
            "Give radius, the largest |e(0)|_inf, and with an [exosystem] disturbance, the largest"
        )
        cure += " |xi_i(0) - xihat_i(0)|; or add a [region]."
        raise wrong(
            missing[0],
            "must be given, because the problem has no [region] that says where it starts.",
            cure,
        )
    reach = max(asked_radius(loop)) if radius is None else parse_number(radius, key="radius")
    error = ZERO if region is None else region.disturbance or ZERO
    error = error if disturbance is None else parse_number(disturbance, key="disturbance")
    if reach <= 0:
        raise SpecError(f"radius must be > 0; got {float(reach):.6g}.", key="radius")
    if error < 0 or (error and not loop.groups):
        why = "it is a length" if error < 0 else "without an [exosystem] there is no observer error"
        raise SpecError(
            f"disturbance must be {'>= 0' if error < 0 else '0'}, because {why}.", key="disturbance"
        )
    return Asked(
        radius=reach, disturbance=error, tolerance=read_tolerance(tolerance, key="tolerance")
    )


def read_tolerance(value: Any, *, key: str = "settling") -> Fraction:
    """A tolerance > 0 in the unit of x.  Raises: SpecError with ``key`` for anything else."""
    limit = parse_number(value, key=key)
    if limit <= 0:
        what = f"must be > 0, because |e(t)| only comes close to 0; got {float(limit):.6g}."
        raise wrong(
            key, what, "Name how far every state may still be from its goal, for example 1/100."
        )
    return limit


def asked_beside(case: Case, *, tolerance: Fraction | None) -> Asked | str:
    """The starts whose settling time can be shown beside the checks of ``case``, or why there are
    none.  They are the region asked for, or where a max-separable proof reaches less far, or no
    region is asked for, its box.  Without a ``tolerance`` it is a hundredth of the radius."""
    loop = case.loop
    found, box = case.proof(Separable), None
    if found is not None and isinstance(found.domain, Around):
        box = claimed(found.domain.radius), claimed(found.domain.disturbance)
    if loop.starts is not None:
        error = loop.starts.disturbance or ZERO
        wanted = claimed(decimal_above(max(asked_radius(loop)))), claimed(decimal_above(error))
        box = wanted if box is None else min(box, wanted)
    if box is None:
        return (
            "left out, because nothing says where the agents start: add a [region], or have "
            "every condition run."
        )
    radius, disturbance = box
    if not radius:
        return "left out, because the region asked for is the target alone."
    return Asked(radius=radius, disturbance=disturbance, tolerance=tolerance or radius * SETTLED)


def settle(loop: Loop, W: Matrix | None, asked: Asked, *, progress: Progress) -> Settling:
    """Find and prove a settling time for the starts asked for, with the gain W (q, m); None without
    an exosystem."""
    best = single = None
    starts = (
        f"from |e|_inf <= {float(asked.radius):.6g} and |eps_i| <= {float(asked.disturbance):.6g}"
    )
    if not acts_by_component(loop):
        reason = "does not apply: boxes need couplings that act on each state component by itself."
    else:
        progress("looking for a certificate of the whole box")
        plan = design_separable(loop, radius=asked.radius, disturbance=asked.disturbance, W=W)
        plans = () if plan is None else chain((plan,), flatter_plans(loop, plan))
        proofs = (first_certificate(loop, W, each) for each in plans)
        whole = next((found for found in proofs if found is not None), None)
        if whole is not None:
            single = _proved(loop, W, asked, Tube.start(loop, asked.radius, whole.error), whole)
        progress("following the box of all starts")
        tubes = propose.approach(
            loop, W, asked, limit=None if single is None else float(single.time)
        )
        best = next(
            (found for tube, last in tubes if (found := _proved(loop, W, asked, tube, last))),
            None,
        )
        if best is None or (single is not None and single.time <= best.time):
            best = single
        reason = (
            f"no moving box was found {starts}. Try a smaller radius or disturbance, or more pins."
        )
    return Settling(
        verdict=Verdict.UNDECIDED if best is None else Verdict.PROVED,
        reason=reason if best is None else f"{starts}, {decide.proved_reason(loop, best)}",
        problem_name=loop.name,
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        claim=best,
        single=single,
        guarantee=None if best is None else decide.guarantee_of(loop, best),
    )


def _proved(
    loop: Loop, W: Matrix | None, asked: Asked, tube: Tube, certificate: Last
) -> Descent | None:
    """The claim of a tube and the certificate that takes over, levels and times rounded up, if it
    is proved."""
    stretch = ONE
    if isinstance(certificate, Separable):
        height = max(certificate.v)
    elif isinstance(certificate, Cycles):
        height = certificate.most
    else:
        height = _root_above(max(diagonal_of_inverse(certificate.P_e)))
        if certificate.P is not None and tube.error is not None:
            stretch = _root_above(propose.relative_bound(certificate.P, tube.error.P))
    draft = Descent(
        tube=tube,
        certificate=certificate,
        level=ONE,
        height=height,
        stretch=stretch,
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        time=tube.ends,
    )
    found = decide.level_at_the_end(loop, draft)
    level = _up((sqrt(found) if isinstance(certificate, Lure) else found).hi)
    if not isinstance(certificate, Lure) and certificate.rho is not None:
        level = min(level, certificate.rho)  # the whole box may fill the level set exactly
    draft = replace(draft, level=level)
    when = _when(draft, asked.tolerance / height)
    claim = None if when is None else replace(draft, time=when)
    return claim if claim is not None and decide.why_not(loop, W, claim) is None else None


def _when(claim: Descent, size: Fraction) -> Fraction | None:
    """A time (s) from which on the size of the certificate is at most ``size``; None if there is
    none."""
    rate = decide.rate_near(claim.certificate)
    if size >= claim.level or rate <= 0:
        return claim.tube.ends if size >= claim.level else None
    wait = log(Interval.point(claim.level / size)).hi / rate
    return Fraction(
        math.ceil((decide.counted_from(claim) + wait) * TIMES) + 1, TIMES
    )  # one more, for wider enclosures of log


def _root_above(value: Fraction) -> Fraction:
    return _up(sqrt(Interval.point(value)).hi)


def _up(value: Fraction) -> Fraction:
    """DIGITS significant digits, not below a value > 0."""
    return rounded_up(max(value * (1 + EXTRA), SMALLEST), digits=DIGITS) if value > 0 else ZERO


def settling_stage(case: Case, *, tolerance: Fraction | None, report: Progress) -> Check:
    """The check `settling` beside those of a case; ``tolerance`` None: a hundredth of the
    radius."""
    loop, W, domain = case.loop, case.W, case.domain
    if (reason := obstacle(loop, W)) is not None:
        return undecided_check("settling", domain, reason)
    rows = loop.n * loop.m
    if rows > MOST_ROWS:
        reason = (
            f"left out, because it takes long with {rows} rows n m; it is examined up to "
            f"{MOST_ROWS}."
        )
        return undecided_check("settling", domain, reason)
    asked = asked_beside(case, tolerance=tolerance)
    if isinstance(asked, str):
        return undecided_check("settling", domain, asked)
    report("deciding the settling time")
    try:
        with at_most(STAGE):
            spend(0)
            found = settle(loop, W, asked, progress=report)
    except WorkLimitError as limit:
        return cut_check("settling", domain, str(limit))
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no settling time: %s", error)
        return undecided_check(
            "settling", domain, "no settling time is found: a numerical library broke down."
        )
    return settling_check(loop, W, found, domain=domain)


def schedule_stage(asked: Region, report: Progress) -> list[Check]:
    """The check `schedule`, where [switching] has a guarantee; PROVED or UNDECIDED."""
    loop, W = asked.loop, asked.W
    if not loop.guarantee.phases:
        return []
    undecided = partial(undecided_check, "schedule", asked.domain)
    if (grows := growth_check(loop, asked.domain)) is not None:
        return [grows]
    turned = not acts_by_component(loop)
    if (reason := obstacle(loop, W, turned=turned)) is not None:
        return [undecided(reason)]
    report("following the weights from mode to mode")
    own = (_turned_cycles,) if loop.drift is not None else ()  # where A couples components
    phases, cut = len(loop.guarantee.phases), None
    searches = (_turned_cycles,) if turned else (_weighted_cycles, *own, _bare_cycles)
    if phases > MOST_PHASES:
        searches = () if turned else (_bare_cycles,)
    for search in searches:
        try:
            with at_most(WORK * STAGE), surviving("no weights under the guarantee"):
                spend(0)
                claim = search(loop, W, asked)
                if claim is not None:
                    return [cycles_check(loop, W, claim, asked)]
        except WorkLimitError as limit:
            cut = str(limit)
    if cut is not None:
        return [cut_check("schedule", asked.domain, cut)]
    missed = None if turned or own else next(unreached_cycles(loop, loop.guarantee.phases), None)
    reason = f"no weights are found that fall for {loop.guarantee.in_words()}."
    if missed is not None:
        reason = (
            f"while modes {' and '.join(missed[0])} are on in turn, no pin reaches agent "
            f"{missed[1]}."
        )
    elif phases > MOST_PHASES:
        reason = (
            f"left out, because it takes long with {phases} phases; weights are looked for up "
            f"to {MOST_PHASES}."
        )
    return [undecided(reason)]


def _reach(asked: Region, error: ErrorBound | None, times: int) -> Fraction:
    """How far V may reach at the start, with so many times what the estimation error adds."""
    noise = (
        ZERO
        if error is None
        else error.kappa * _root_above(error.size) * claimed(asked.disturbance)
    )
    return claimed(asked.radius) + times * noise


def _weighted_cycles(loop: Loop, W: Matrix | None, asked: Region) -> Cycles | None:
    """A claim with weights and a rate that is proved and holds the starts asked for."""
    error, box = propose.observed(loop, W), (claimed(asked.radius), claimed(asked.disturbance))
    if loop.n * loop.m > MOST_ROWS or (loop.groups and error is None):
        return None
    rho = None if loop.is_linear else _reach(asked, error, 2)
    claims = propose_cycles.propose(loop, W, rho=rho, error=error)
    return next(
        (each for each in claims if holds_starts(loop, each, radius=box[0], disturbance=box[1])),
        None,
    )


def _turned_cycles(loop: Loop, W: Matrix | None, asked: Region) -> Cycles | None:
    """The same in coordinates."""
    box = claimed(asked.radius), claimed(asked.disturbance)
    if loop.n * loop.m > MOST_ROWS:
        return None
    seen = partial(propose.observed, loop, W)
    claims = propose_cycles.propose_in_coordinates(
        loop, W, box=None if loop.is_linear else box, observed=seen
    )
    return next(
        (each for each in claims if holds_starts(loop, each, radius=box[0], disturbance=box[1])),
        None,
    )


def _bare_cycles(loop: Loop, W: Matrix | None, asked: Region) -> Cycles | None:
    """The same by the graphs alone, without a rate."""
    error = propose.observed(loop, W)
    rho = None if loop.is_linear else _up(_reach(asked, error, 1))
    claim = Cycles(phases=(), rate=None, rho=rho, error=error)
    return claim if why_not_cycles(loop, W, claim) is None else None
