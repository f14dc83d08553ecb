"""Certified settling times: proposed stages, put together exactly and handed to ``verify_staging``.

Theory, section 5, Staging.  Numbers are rounded to the safe side here, so that the chain holds; whether it does is
decided by ``decide`` alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from typing import Final

from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, verify_lure
from dobc_design.conditions.schedule.asked import Asked
from dobc_design.conditions.schedule.claim import ONE, ZERO, Stage, Staging
from dobc_design.conditions.schedule.decide import (
    guard_limits,
    next_level,
    noise_left,
    observer_matrix,
    proved_reason,
    stage_rate,
    verify_staging,
)
from dobc_design.conditions.schedule.propose import (
    SHARE,
    StagePlan,
    matching_diagonal,
    plan_stages,
    propose_quadratic_stages,
    relative_bound,
)
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component
from dobc_design.conditions.separable.decide import largest_rate
from dobc_design.conditions.separable.observer import first_certificate
from dobc_design.conditions.separable.propose import SeparablePlan, design_separable, flatter_plans, rounded_vectors
from dobc_design.exact.interval import Interval, log, sqrt
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Progress = Callable[[str], None]

#: Radii of quadratic stages, as parts of the first level.
RADII: Final = (0.03, 0.08, 0.16, 0.25)
ROOM: Final = Fraction(9999, 10000)  # of a rate, so that simpler enclosures confirm it too
DIGITS: Final = 10  # of levels, noises and factors
EXTRA: Final = Fraction(1, 10**9)  # added to them, for whoever encloses exp more widely
SMALLEST: Final = Fraction(1, 10**300)  # of them, unless they are 0
TIMES: Final = 10**4  # hand-overs and settling times have four decimals


def settle(problem: Problem, W: Matrix | None, asked: Asked, *, progress: Progress) -> Settling:
    """Find and prove a settling time for the starts asked for, with the gain W (q, m); None without an exosystem.

    PROVED by ``verify_staging``, or UNDECIDED with the reason.
    """
    best = single = None
    starts = f"from |e|_inf <= {float(asked.radius):.6g} and |eps_i| <= {float(asked.disturbance):.6g}"
    if not acts_by_component(problem):
        reason = (
            "does not apply: stages begin with a max-separable certificate, which needs couplings that"
            " act on each state component by itself."
        )
    else:
        progress("looking for a certificate of the whole box")
        plan = design_separable(problem, radius=asked.radius, disturbance=asked.disturbance, W=W)
        plans = () if plan is None else chain((plan,), flatter_plans(problem, plan))
        whole = next((found for each in plans if (found := _whole(problem, W, each)) is not None), None)
        if plan is None or whole is None:
            reason = (
                f"no max-separable certificate was found {starts}. Try a smaller radius or disturbance, or more pins."
            )
        else:
            goal = Goal(problem=problem, W=W, asked=asked)
            single = goal.proved([goal.first(whole)])
            chains = [each for each in (single, *_staged(goal, plan, progress)) if each is not None]
            best = min(chains, key=lambda each: each.time, default=None)
            reason = "a certificate of the whole box was found, but no settling time was proved."
    return Settling(
        verdict=Verdict.UNDECIDED if best is None else Verdict.PROVED,
        reason=reason if best is None else f"{starts}, {proved_reason(best)}",
        problem_name=problem.name,
        radius=asked.radius,
        disturbance=asked.disturbance,
        tolerance=asked.tolerance,
        staging=best,
        single=single,
    )


def _whole(problem: Problem, W: Matrix | None, plan: SeparablePlan) -> Separable | None:
    return first_certificate(
        problem, W, rounded_vectors(plan.proposal), rho=plan.rho, error=plan.error, wanted=plan.proposal.rate
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What is asked, and how stages are joined so that it holds: levels up, times up, rates down."""

    problem: Problem
    W: Matrix | None
    asked: Asked

    def first(self, claim: Separable) -> Stage:
        """The stage that begins at 0 with all starts."""
        noise = ZERO
        if claim.error is not None:
            noise = _up(sqrt(Interval.point(claim.error.size)).hi * self.asked.disturbance)
        # Without a rho, couplings are linear and every level will do.
        level = self.asked.radius / claim.least + (ZERO if claim.error is None else claim.error.kappa * noise)
        return Stage(
            certificate=claim,
            start=ZERO,
            level=_up(level) if claim.rho is None else claim.rho,
            height=max(claim.v),
            noise=noise,
        )

    def following(self, before: Stage, certificate: Separable | Lure) -> Stage:
        """The stage that takes over as soon as its guard is known to hold."""
        old = before.certificate
        draft = Stage(
            certificate=certificate,
            start=before.start,
            level=ONE,
            height=_height(certificate),
            diagonal=_diagonal(self.problem, old, certificate),
            factor=relative_bound(certificate.P_e, old.P_e)
            if isinstance(old, Lure) and isinstance(certificate, Lure)
            else None,
            stretch=_stretch(before, certificate),
        )
        limits = [r / sqrt(Interval.point(a)).hi for a, r in guard_limits(self.problem, before, draft) if a]
        draft = replace(draft, start=_when(before, min(limits, default=before.level)))
        draft = replace(draft, noise=_up(noise_left(before, draft.start).hi * draft.stretch))
        level = next_level(self.problem, before, draft)
        return replace(draft, level=_up((sqrt(level) if draft.is_quadratic else level).hi))

    def proved(self, stages: Sequence[Stage]) -> Staging | None:
        """The chain with its settling time, if ``verify_staging`` proves it."""
        last = stages[-1]
        staging = Staging(
            stages=tuple(stages),
            radius=self.asked.radius,
            disturbance=self.asked.disturbance,
            tolerance=self.asked.tolerance,
            time=_when(last, self.asked.tolerance / last.height),
        )
        return staging if verify_staging(self.problem, self.W, staging).verdict is Verdict.PROVED else None


def _staged(goal: Goal, plan: SeparablePlan, progress: Progress) -> list[Staging | None]:
    """Chains with quadratic stages and without them; None for one that is not proved."""
    problem = goal.problem
    progress("looking for quadratic stages")
    quadratics = propose_quadratic_stages(
        problem,
        W=goal.W,
        holds=lambda lure: verify_lure(problem, lure).verdict is Verdict.PROVED,
        radii=[part * float(plan.rho) for part in RADII],
        slowest=plan.proposal.rate,
    )
    progress("choosing the stages")
    fastest = math.inf if plan.error is None else float(SHARE * plan.error.beta)
    paths = plan_stages(problem, rho=plan.rho, tolerance=goal.asked.tolerance, fastest=fastest, quadratics=quadratics)
    chains = [_joined(goal, plan, path) for path in paths]
    progress("deciding the hand-overs")
    return [goal.proved(stages) for stages in chains if stages]


def _joined(goal: Goal, plan: SeparablePlan, path: StagePlan) -> list[Stage]:
    """The stages of a path, exactly; empty if the first one is not proved, others that are not are left out."""
    stages: list[Stage] = []
    for v, rho in path.separable:
        claim = _claim(goal.problem, v, rho, plan.error, first=not stages)
        if claim is not None:
            stages.append(goal.following(stages[-1], claim) if stages else goal.first(claim))
        elif not stages:
            return []
    for lure in path.quadratic:
        stages.append(goal.following(stages[-1], lure))
    return stages


def _claim(problem: Problem, v: Vector, level: Fraction, error: ErrorBound | None, *, first: bool) -> Separable | None:
    """A planned vector with the rate that is proved for it, and a kappa that lets V have that rate."""
    rho = None if problem.is_linear else level
    alpha = largest_rate(problem, v, rho=rho)
    if alpha is None:
        return None
    alpha = rounded_down(alpha * ROOM, digits=6)
    if error is not None and not first:
        rate = min(alpha, SHARE * error.beta)
        kappa = Fraction(math.ceil(10**6 / ((error.beta - rate) * min(v))), 10**6)
        error = replace(error, kappa=kappa)
    return Separable(v=v, alpha=alpha, rho=rho, error=error)


def _when(stage: Stage, size: Fraction) -> Fraction:
    """A time (s) from which on the stage's size is at most ``size``."""
    if size >= stage.level:
        return stage.start
    wait = log(Interval.point(stage.level / size)).hi / stage_rate(stage.certificate)
    return Fraction(math.ceil((stage.start + wait) * TIMES) + 1, TIMES)  # one more, for wider enclosures of log


def _height(certificate: Separable | Lure) -> Fraction:
    if isinstance(certificate, Separable):
        return max(certificate.v)
    return _up(sqrt(Interval.point(max(diagonal_of_inverse(certificate.P_e)))).hi)


def _stretch(before: Stage, certificate: Separable | Lure) -> Fraction:
    """A number l with P <= l^2 (the old P)."""
    old, new = observer_matrix(before.certificate), observer_matrix(certificate)
    if old is None or new is None or old == new:
        return ONE
    bound = relative_bound(SparseSymmetric.from_dense(new), SparseSymmetric.from_dense(old))
    return _up(sqrt(Interval.point(bound)).hi)


def _diagonal(problem: Problem, old: Separable | Lure, new: Separable | Lure) -> Vector | None:
    """D for the box {N <= 1}, row by row of e; None between certificates of one kind."""
    if isinstance(old, Lure) or isinstance(new, Separable):
        return None
    return matching_diagonal(new.P_e, tuple(x for x in old.v for _ in range(problem.m)))


def _up(value: Fraction) -> Fraction:
    """DIGITS significant digits, not below a value > 0."""
    if value <= 0:
        return ZERO
    value = max(value * (1 + EXTRA), SMALLEST)
    unit = Fraction(10) ** (DIGITS - 1 - math.floor(math.log10(value)))
    return math.ceil(value * unit) / unit
