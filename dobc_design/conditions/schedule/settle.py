"""Certified settling times: proposals of ``design`` for the stages, put together exactly and handed to ``verify``.

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
from dobc_design.conditions.quadratic.decide import verify_lure
from dobc_design.conditions.schedule.asked import Asked
from dobc_design.conditions.schedule.claim import ONE, ZERO, Stage, Staging
from dobc_design.conditions.schedule.decide import (
    diagonal_of_inverse,
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
    PlannedStage,
    StagePlan,
    matching_diagonal,
    plan_stages,
    relative_bound,
)
from dobc_design.conditions.schedule.propose_quadratic import propose_quadratic_stages
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
    if not acts_by_component(problem):
        return _answer(
            problem,
            asked,
            "does not apply: stages begin with a max-separable certificate, which needs couplings that"
            " act on each state component by itself.",
        )
    progress("looking for a certificate of the whole box")
    plan = design_separable(problem, radius=asked.radius, disturbance=asked.disturbance, W=W)
    whole = None
    for each in () if plan is None else chain((plan,), flatter_plans(problem, plan)):
        whole = _whole(problem, W, each)
        if whole is not None:
            break
    if plan is None or whole is None:
        return _answer(
            problem,
            asked,
            f"no max-separable certificate was found from |e|_inf <= {float(asked.radius):.6g} and"
            f" |eps_i| <= {float(asked.disturbance):.6g}. Try a smaller radius or disturbance, or more pins.",
        )
    goal = Goal(problem=problem, W=W, asked=asked)
    single = goal.proved([goal.first(whole)])
    progress("looking for quadratic stages")
    quadratics = _quadratics(problem, W, plan)
    progress("choosing the stages")
    found = _staged(goal, plan, quadratics)
    progress("deciding the hand-overs")
    chains = [each for each in (single, *found) if each is not None]
    if not chains:
        return _answer(problem, asked, "a certificate of the whole box was found, but no settling time was proved.")
    best = min(chains, key=lambda each: each.time)
    reason = f"from |e|_inf <= {float(asked.radius):.6g} and |eps_i| <= {float(asked.disturbance):.6g}, "
    return _answer(problem, asked, reason + proved_reason(best), best, single)


def _answer(
    problem: Problem, asked: Asked, reason: str, best: Staging | None = None, single: Staging | None = None
) -> Settling:
    return Settling(
        verdict=Verdict.UNDECIDED if best is None else Verdict.PROVED,
        reason=reason,
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
        draft = Stage(
            certificate=certificate,
            start=before.start,
            level=ONE,
            height=_height(certificate),
            diagonal=_diagonal(self.problem, before.certificate, certificate),
            factor=_factor(before.certificate, certificate),
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


def _whole(problem: Problem, W: Matrix | None, plan: SeparablePlan) -> Separable | None:
    return first_certificate(
        problem, W, rounded_vectors(plan.proposal), rho=plan.rho, error=plan.error, wanted=plan.proposal.rate
    )


def _quadratics(problem: Problem, W: Matrix | None, plan: SeparablePlan) -> list[Lure]:
    return propose_quadratic_stages(
        problem,
        W=W,
        holds=lambda lure: verify_lure(problem, lure).verdict is Verdict.PROVED,
        radii=[part * float(plan.rho) for part in RADII],
        slowest=plan.proposal.rate,
    )


def _staged(goal: Goal, plan: SeparablePlan, quadratics: Sequence[Lure]) -> list[Staging]:
    """Proved chains: with the quadratic stages and without them."""
    fastest = math.inf if plan.error is None else float(SHARE * plan.error.beta)
    paths = plan_stages(
        goal.problem, rho=plan.rho, tolerance=goal.asked.tolerance, fastest=fastest, quadratics=quadratics
    )
    found = []
    for path in paths:
        stages = _joined(goal, plan, path)
        proved = goal.proved(stages) if stages else None
        if proved is not None:
            found.append(proved)
    return found


def _joined(goal: Goal, plan: SeparablePlan, path: StagePlan) -> list[Stage]:
    """The stages of a path, exactly; empty if the first one is not proved, others that are not are left out."""
    stages: list[Stage] = []
    for planned in path.separable:
        claim = _claim(goal.problem, planned, plan.error, first=not stages)
        if claim is not None:
            stages.append(goal.following(stages[-1], claim) if stages else goal.first(claim))
        elif not stages:
            return []
    for lure in path.quadratic:
        stages.append(goal.following(stages[-1], lure))
    return stages


def _claim(problem: Problem, planned: PlannedStage, error: ErrorBound | None, *, first: bool) -> Separable | None:
    """The planned vector with the rate that is proved for it, and a kappa that lets V have that rate."""
    alpha = largest_rate(problem, planned.v, rho=None if problem.is_linear else planned.rho)
    if alpha is None:
        return None
    alpha = rounded_down(alpha * ROOM, digits=6)
    if error is not None and not first:
        rate = min(alpha, SHARE * error.beta)
        kappa = Fraction(math.ceil(10**6 / ((error.beta - rate) * min(planned.v))), 10**6)
        error = replace(error, kappa=kappa)
    return Separable(v=planned.v, alpha=alpha, rho=None if problem.is_linear else planned.rho, error=error)


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


def _factor(old: Separable | Lure, new: Separable | Lure) -> Fraction | None:
    """A number f with P_e <= f (the old P_e)."""
    if not (isinstance(old, Lure) and isinstance(new, Lure)):
        return None
    return relative_bound(new.P_e, old.P_e)


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
