"""A short chain of stages with every kind of hand-over, and every kind of stage, for the tests of staging."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

from lure_cases import HARMONIC, PAPER_GAIN, cycle, is_proved

from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.schedule.claim import Staging
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.conditions.schedule.propose import propose_quadratic_stages
from dobc_design.conditions.schedule.stage import Asked, Goal
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import largest_rate
from dobc_design.conditions.separable.propose import propose_separable, rounded_vectors
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

F = Fraction
ASKED = Asked(radius=F(2), disturbance=F(1, 2), tolerance=F(1, 1000))
LEVELS = (F(3), F(1))
RADII = (0.6, 0.1)


@cache
def problem() -> Problem:
    """Three agents on a directed cycle, the first pinned with k = 5, the paper's coupling and exosystem."""
    return cycle(3, {1: 5}, exosystem=HARMONIC)


@cache
def chain() -> Staging:
    """Two max-separable stages with different P, then two quadratic ones; every number as small as it may be."""
    case = problem()
    goal = Goal(problem=case, W=PAPER_GAIN, asked=ASKED)
    stages = []
    for rho, rate in zip(LEVELS, (0.3, 1.1), strict=True):
        v = list(rounded_vectors(propose_separable(case, rho=float(rho))))[1]
        alpha = rounded_down(largest_rate(case, v, rho=rho) * F(9999, 10000), digits=6)
        claim = Separable(v=v, alpha=alpha, rho=rho, error=propose_error_bound(HARMONIC, PAPER_GAIN, rate=rate))
        stages.append(goal.following(stages[-1], claim) if stages else goal.first(claim))
    stages[0] = replace(stages[0], level=_least_first_level(stages[0]))
    stages[1] = goal.following(stages[0], stages[1].certificate)
    quadratics = propose_quadratic_stages(
        case, W=PAPER_GAIN, holds=lambda lure: is_proved(case, lure), radii=RADII, slowest=0.1
    )
    for lure in sorted(quadratics, key=lambda each: -each.radius):
        stages.append(goal.following(stages[-1], lure))
    return goal.proved(stages)


def _least_first_level(stage) -> Fraction:
    """R/min v + kappa s sqrt(size), ten digits, up."""
    claim = stage.certificate
    least = (
        float(ASKED.radius / claim.least)
        + float(claim.error.kappa * ASKED.disturbance) * float(claim.error.size) ** 0.5
    )
    return F(f"{least * (1 + 1e-9):.12g}")


def settling() -> Settling:
    """The chain as what ``certify_settling`` would return."""
    numbers = {"radius": ASKED.radius, "disturbance": ASKED.disturbance, "tolerance": ASKED.tolerance}
    return Settling(verdict=Verdict.PROVED, reason="", problem_name="three", **numbers, staging=chain())
