"""A settling time: what is asked for, the stages that are proposed for it, and the check `settling`.

Theory, section 5, Staging.  Numbers are rounded to the safe side here, so that the chain holds; whether it does is
decided by ``decide`` alone.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, product
from typing import Any, Final

from dobc_design.conditions.check import Check, undecided_check
from dobc_design.conditions.coverage import Progress, asked_radius
from dobc_design.conditions.numbers import claimed, decimal_above, rounded_down, rounded_up
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, verify_lure
from dobc_design.conditions.schedule import decide, propose
from dobc_design.conditions.schedule.checks import settling_check
from dobc_design.conditions.schedule.claim import ONE, ZERO, Stage, Staging
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component
from dobc_design.conditions.separable.decide import largest_rate
from dobc_design.conditions.separable.propose import SeparablePlan, design_separable, first_certificate, flatter_plans
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.interval import Interval, log, sqrt
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import parse_number
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")

#: Agents times state components up to which stages are looked for: quadratic ones are dense.
MOST_ROWS: Final = 100
#: A start counts as settled, where no tolerance is named, when every |e_ic| is below this part of the radius.
SETTLED: Final = Fraction(1, 100)
RADII: Final = (0.03, 0.08, 0.16, 0.25)  # of quadratic stages, as parts of the first level
LONGER: Final = Fraction(3, 1000)  # a settling time, for every further stage: short chains are worth that
ROOM: Final = Fraction(9999, 10000)  # of a rate, so that simpler enclosures confirm it too
DIGITS: Final = 10  # of levels, noises and factors
EXTRA: Final = Fraction(1, 10**9)  # added to them, for whoever encloses exp more widely
SMALLEST: Final = Fraction(1, 10**300)  # of them, unless they are 0
TIMES: Final = 10**4  # hand-overs and settling times have four decimals


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Starts |e|_inf <= radius, |eps_i| <= disturbance, and the tolerance to be kept from some time on."""

    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction


def asked_of(problem: Problem, *, tolerance: Any, radius: Any = None, disturbance: Any = None) -> Asked:
    """Read the numbers; what is None comes from the [region].  Raises: SpecError for a number that is wrong, or missing
    where there is no region to take it from."""
    region = problem.region
    missing = ["radius"] * (radius is None) + ["disturbance"] * (disturbance is None and bool(problem.groups))
    if missing and region is None:
        cure = "Give radius, the largest |e(0)|_inf, and with an [exosystem] disturbance, the largest"
        cure += " |xi_i(0) - xihat_i(0)|; or add a [region]."
        raise wrong(missing[0], "must be given, because the problem has no [region] that says where it starts.", cure)
    reach = max(asked_radius(problem)) if radius is None else parse_number(radius, key="radius")
    error = ZERO if region is None else region.initial_disturbance or ZERO
    error = error if disturbance is None else parse_number(disturbance, key="disturbance")
    if reach <= 0:
        raise SpecError(f"radius must be > 0; got {float(reach):.6g}.", key="radius")
    if error < 0 or (error and not problem.groups):
        why = "it is a length" if error < 0 else "without an [exosystem] there is no observer error"
        raise SpecError(f"disturbance must be {'>= 0' if error < 0 else '0'}, because {why}.", key="disturbance")
    return Asked(radius=reach, disturbance=error, tolerance=read_tolerance(tolerance, key="tolerance"))


def read_tolerance(value: Any, *, key: str = "settling") -> Fraction:
    """A tolerance > 0 in the unit of x.  Raises: SpecError with ``key`` for anything else."""
    limit = parse_number(value, key=key)
    if limit <= 0:
        what = f"must be > 0, because |e(t)| only comes close to 0; got {float(limit):.6g}."
        raise wrong(key, what, "Name how far every state may still be from its goal, for example 1/100.")
    return limit


def asked_beside(problem: Problem, checks: Sequence[Check], *, tolerance: Fraction | None) -> Asked | str:
    """The starts whose settling time a certificate with these ``checks`` shows, or why there are none.  They are the
    region asked for, or where a max-separable proof reaches less far, or no region is asked for, its box.  Without a
    ``tolerance`` it is a hundredth of the radius."""
    found, box = next((check for check in checks if check.id == "max-separable"), None), None
    if found is not None and found.verdict is not Verdict.PROVED:
        prefix = "" if found.applies else "does not apply: "
        return f"{prefix}stages begin with a max-separable certificate, and there is none."
    if found is not None and isinstance(found.domain, Mapping):
        box = claimed(found.domain["radius"]), claimed(found.domain["disturbance"])
    if problem.region is not None:
        error = problem.region.initial_disturbance or ZERO
        wanted = claimed(decimal_above(max(asked_radius(problem)))), claimed(decimal_above(error))
        box = wanted if box is None else min(box, wanted)
    if box is None:
        return "left out, because nothing says where the agents start: add a [region], or have every condition run."
    radius, disturbance = box
    if not radius:
        return "left out, because the region asked for is the target alone."
    return Asked(radius=radius, disturbance=disturbance, tolerance=tolerance or radius * SETTLED)


def settle(problem: Problem, W: Matrix | None, asked: Asked, *, progress: Progress) -> Settling:
    """Find and prove a settling time for the starts asked for, with the gain W (q, m); None without an exosystem.
    PROVED by ``verify_staging``, or UNDECIDED with the reason."""
    best = single = None
    starts = f"from |e|_inf <= {float(asked.radius):.6g} and |eps_i| <= {float(asked.disturbance):.6g}"
    if not acts_by_component(problem):
        needs = "a max-separable certificate, which needs couplings that act on each state component by itself"
        reason = f"does not apply: stages begin with {needs}."
    else:
        progress("looking for a certificate of the whole box")
        plan = design_separable(problem, radius=asked.radius, disturbance=asked.disturbance, W=W)
        plans = () if plan is None else chain((plan,), flatter_plans(problem, plan))
        proofs = (first_certificate(problem, W, each) for each in plans)
        whole = next((found for found in proofs if found is not None), None)
        reason = f"no max-separable certificate was found {starts}. Try a smaller radius or disturbance, or more pins."
        if plan is not None and whole is not None:
            goal = Goal(problem=problem, W=W, asked=asked)
            single = goal.proved([goal.first(whole)])
            chains = [each for each in (single, *_staged(goal, plan, progress)) if each is not None]
            best = min(chains, key=lambda each: each.time, default=None)
            reason = "a certificate of the whole box was found, but no settling time was proved."
    return Settling(
        verdict=Verdict.UNDECIDED if best is None else Verdict.PROVED,
        reason=reason if best is None else f"{starts}, {decide.proved_reason(best)}",
        problem_name=problem.name,
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        staging=best,
        single=single,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What is asked, and how stages are joined so that it holds: levels up, times up, rates down."""

    problem: Problem
    W: Matrix | None
    asked: Asked

    def first(self, claim: Separable) -> Stage:
        """The stage that begins at 0 with all starts."""
        noise, level = ZERO, self.asked.radius / claim.least
        if claim.error is not None:
            noise = _up(sqrt(Interval.point(claim.error.size)).hi * self.asked.disturbance)
            level += claim.error.kappa * noise
        level = claim.rho or _up(level)  # without a rho, couplings are linear and every level will do
        return Stage(certificate=claim, start=ZERO, level=level, height=max(claim.v), noise=noise)

    def following(self, before: Stage, certificate: Separable | Lure) -> Stage:
        """The stage that takes over as soon as its guard is known to hold."""
        problem, old, new = self.problem, before.certificate, certificate
        height = max(new.v) if isinstance(new, Separable) else _root_above(max(diagonal_of_inverse(new.P_e)))
        diagonal = factor = None
        if isinstance(old, Lure) and isinstance(new, Lure):
            factor = propose.relative_bound(new.P_e, old.P_e)
        elif isinstance(old, Separable) and isinstance(new, Lure):  # D for the box {N <= 1}, row by row of e
            diagonal = propose.matching_diagonal(new.P_e, tuple(x for x in old.v for _ in range(problem.m)))
        observer, next_, stretch = decide.observer_matrix(old), decide.observer_matrix(new), ONE
        if observer is not None and next_ is not None and observer != next_:  # P <= stretch^2 (the old P)
            pair = (SparseSymmetric.from_dense(next_), SparseSymmetric.from_dense(observer))
            stretch = _root_above(propose.relative_bound(*pair))
        draft = Stage(
            certificate=new,
            start=before.start,
            level=ONE,
            height=height,
            diagonal=diagonal,
            factor=factor,
            stretch=stretch,
        )
        limits = [r / sqrt(Interval.point(a)).hi for a, r in decide.guard_limits(problem, before, draft) if a]
        draft = replace(draft, start=_when(before, min(limits, default=before.level)))
        draft = replace(draft, noise=_up(decide.noise_left(before, draft.start).hi * draft.stretch))
        level = decide.next_level(problem, before, draft)
        return replace(draft, level=_up((sqrt(level) if draft.is_quadratic else level).hi))

    def time(self, stages: Sequence[Stage]) -> Fraction:
        """The settling time (s) of a chain."""
        return _when(stages[-1], self.asked.tolerance / stages[-1].height)

    def proved(self, stages: Sequence[Stage]) -> Staging | None:
        """The chain with its settling time, if ``verify_staging`` proves it."""
        asked = {"radius": self.asked.radius, "disturbance": self.asked.disturbance, "tolerance": self.asked.tolerance}
        staging = Staging(stages=tuple(stages), time=self.time(stages), **asked)
        return staging if decide.verify_staging(self.problem, self.W, staging).verdict is Verdict.PROVED else None


def _staged(goal: Goal, plan: SeparablePlan, progress: Progress) -> list[Staging | None]:
    """The quickest chain with quadratic stages, and that without them; None for one that is not proved."""
    problem = goal.problem
    progress("looking for quadratic stages")
    quadratics = propose.propose_quadratic_stages(
        problem,
        W=goal.W,
        holds=lambda lure: verify_lure(problem, lure).verdict is Verdict.PROVED,
        radii=[part * float(plan.rho) for part in RADII],
        slowest=plan.rate,
    )
    progress("choosing the stages")
    stages: list[Stage] = []
    fastest = math.inf if plan.error is None else float(propose.SHARE * plan.error.beta)
    for v, rho in propose.plan_stages(problem, rho=plan.rho, tolerance=goal.asked.tolerance, fastest=fastest):
        claim = _claim(problem, v, rho, plan.error, first=not stages)
        if claim is not None:  # one that is not proved is left out
            stages.append(goal.following(stages[-1], claim) if stages else goal.first(claim))
        elif not stages:
            return []
    if not stages:
        return []
    chains = [stages]
    for count, first in product(range(1, len(stages) + 1), range(len(quadratics))):
        joined = stages[:count]
        for lure in quadratics[first::-1]:  # the largest radius first
            joined.append(goal.following(joined[-1], lure))
        chains.append(joined)
    progress("deciding the hand-overs")
    quickest = min(chains, key=lambda each: goal.time(each) * (1 + LONGER) ** len(each))
    return [goal.proved(each) for each in ([quickest] if quickest is stages else [quickest, stages])]


def _claim(problem: Problem, v: Vector, level: Fraction, error: ErrorBound | None, *, first: bool) -> Separable | None:
    """A planned vector with the rate that is proved for it, and a kappa that lets V have that rate."""
    rho = None if problem.is_linear else level
    alpha = largest_rate(problem, v, rho=rho)
    if alpha is None:
        return None
    alpha = rounded_down(alpha * ROOM, digits=6)
    if error is not None and not first:
        rate = min(alpha, propose.SHARE * error.beta)
        kappa = Fraction(math.ceil(10**6 / ((error.beta - rate) * min(v))), 10**6)
        error = replace(error, kappa=kappa)
    return Separable(v=v, alpha=alpha, rho=rho, error=error)


def _when(stage: Stage, size: Fraction) -> Fraction:
    """A time (s) from which on the stage's size is at most ``size``."""
    if size >= stage.level:
        return stage.start
    wait = log(Interval.point(stage.level / size)).hi / decide.stage_rate(stage.certificate)
    return Fraction(math.ceil((stage.start + wait) * TIMES) + 1, TIMES)  # one more, for wider enclosures of log


def _root_above(value: Fraction) -> Fraction:
    return _up(sqrt(Interval.point(value)).hi)


def _up(value: Fraction) -> Fraction:
    """DIGITS significant digits, not below a value > 0."""
    if value <= 0:
        return ZERO
    return rounded_up(max(value * (1 + EXTRA), SMALLEST), digits=DIGITS)


def settling_stage(
    problem: Problem,
    W: Matrix | None,
    checks: Sequence[Check],
    *,
    tolerance: Fraction | None,
    domain: str,
    report: Progress,
) -> Check:
    """The check `settling` beside ``checks``, which are for the gain W (q, m); PROVED or UNDECIDED.  ``tolerance`` in
    the unit of x, None for a hundredth of the radius; ``domain``: that of Lemma 1."""
    if (reason := obstacle(problem, W)) is not None:
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
        with at_most(STAGE):
            spend(0)
            found = settle(problem, W, asked, progress=report)
    except WorkLimitError as limit:
        return undecided_check("settling", domain, str(limit))
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no settling time: %s", error)
        return undecided_check("settling", domain, "no settling time is found: a numerical library broke down.")
    return settling_check(problem, W, found, domain=domain)
