"""Pinning gains on request, at the consensus or over a region: proposals of ``design``, decided by ``verify``.

The region is a radius, or what the problem's [region] asks, with room for the observer's part.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.negative import Enclosed
from dobc_design.conditions.consensus.statements import Statements, state_theorems
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number, root_above
from dobc_design.exact.reading import shown, shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.bound import Ground
from dobc_design.synthesis.pinning.boxes import NearProposals
from dobc_design.synthesis.pinning.choice import PinningProposals
from dobc_design.synthesis.pinning.design import PinningDesign
from dobc_design.synthesis.pinning.flows import bounding_flows, hopeless_weights, near_optimum
from dobc_design.synthesis.pinning.proposals import PinningProposer, make_proposer
from dobc_design.synthesis.pinning.propose_balls import propose_for_ball
from dobc_design.synthesis.pinning.propose_boxes import propose_for_box
from dobc_design.synthesis.pinning.regions import BALL, BOX, RegionAsked, RegionProposals, search_region
from dobc_design.synthesis.pinning.request import PinningRequest
from dobc_design.synthesis.pinning.search import search_pinning

Progress = Callable[[str], None]
DECIMALS = 10**9


def designed_pinning(
    problem: Problem, request: PinningRequest, *, region: Any = None, method: Any = None, progress: Progress
) -> PinningDesign:
    """Decide the request at the consensus (``region`` None), for a radius, or for the [region] (True).

    Raises: SpecError for a wrong region or method, or for couplings without a derivative where that is needed.
    """
    bare = changed_problem(problem, {"pinning.gains": None})
    asked = None if region is None else _region(problem, request, region, method)
    if region is None and method is not None:
        raise SpecError(
            f"method is for a region; got {shown(method)} without one.", key="method", cure="Give region, or no method."
        )
    statements = state_theorems(bare)
    proposer = None if statements.inapplicable else make_proposer(bare, request)
    if proposer is None and (asked is None or asked.method == BALL):
        raise SpecError(
            "coupling must have a derivative at the consensus that floats can hold, because gains are designed for"
            f" the linearisation; {statements.inapplicable or 'an entry of J + J is too large.'}",
            key="coupling.h",
            cure="Use a smooth coupling, such as tanh(y).",
        )
    ground = Ground(problem=problem, request=request, lambdas={} if proposer is None else _enclosed(statements))
    consensus = None if proposer is None else _consensus(proposer, progress)
    if asked is None and consensus is not None:
        return search_pinning(ground, consensus)
    progress("looking for gains that do over the region")
    proposals = RegionProposals(
        box=propose_for_box,
        ball=propose_for_ball,
        consensus=consensus,
        near=NearProposals(optimum=near_optimum, flows=bounding_flows, hopeless=hopeless_weights),
    )
    return search_region(ground, asked or _region(problem, request, True, method), proposals)


def _enclosed(statements: Statements) -> dict[str, Enclosed]:
    return {
        mode: Enclosed(middle=each.constant, deviations=each.deviations) for mode, each in statements.lambdas.items()
    }


def _consensus(proposer: PinningProposer, progress: Progress) -> Callable[[PinningRequest], PinningProposals]:
    def proposals_for(asked: PinningRequest) -> PinningProposals:
        own = proposer.asked(asked)
        return PinningProposals(
            relax=own.relax,
            greedy=own.greedy,
            replaceable=own.replaceable,
            fastest=own.fastest,
            slow=own.slow,
            progress=progress,
        )

    return proposals_for


def _region(problem: Problem, request: PinningRequest, region: Any, method: Any) -> RegionAsked:
    if method not in (None, BOX, BALL):
        raise SpecError(
            f'method must be "{BOX}" or "{BALL}"; got {shown(method)}.',
            key="method",
            cure=f'Leave it out for "{BOX}" where the couplings act by component.',
        )
    chosen = method or (BOX if acts_by_component(problem) else BALL)
    if region is True:
        return _file_region(problem, request, chosen)
    radius = parse_number(region, key="region")
    if radius <= 0:
        raise SpecError(
            f"region must be > 0, because it is a radius; got {shown_number(radius)}.",
            key="region",
            cure="Give the largest |e_i| (|e| for lure) of a start, or True for the problem's [region].",
        )
    return RegionAsked(method=chosen, radius=radius, rho=None if problem.is_linear else radius)


def _file_region(problem: Problem, request: PinningRequest, method: str) -> RegionAsked:
    """What the [region] asks for; a ball holds all of its starts."""
    region = problem.region
    if region is None:
        raise SpecError(
            "region = True means the [region] of the problem, and there is none.",
            key="region",
            cure="Give a radius, or a [region].",
        )
    reach, disturbance = asked_radius(problem), region.initial_disturbance or Fraction(0)
    if method == BALL:
        if disturbance:
            raise SpecError(
                'method "lure" designs gains for eps = 0, and the [region] has an initial_disturbance.',
                key="method",
                cure=f'Use method "{BOX}", or give a radius that leaves room for the observer.',
            )
        square = problem.n * sum((r * r for r in reach), Fraction(0))
        radius = root_above(square, unit=DECIMALS)
        return RegionAsked(method=BALL, radius=radius, rho=None)
    radius = max(*reach, Fraction(1, DECIMALS))
    exosystem, W = problem.joint_exosystem, problem.joint_observer.W
    if not disturbance or exosystem is None:
        return RegionAsked(method=BOX, radius=radius, rho=None if problem.is_linear else radius)
    if W is None:
        raise SpecError(
            "observer.W is needed, because the [region] has an initial_disturbance.",
            key="observer.W",
            cure="Design W first, with design_observer.",
        )
    error = propose_error_bound(exosystem, W, rate=float(request.rate))
    if error is None:
        raise SpecError(
            f"rate must be below the decay rate of the observer, because V = N + kappa E is to reach it; got"
            f" {shown_number(request.rate)}.",
            key="rate",
            cure="Ask for less, or for a faster W.",
        )
    return RegionAsked(
        method=BOX,
        radius=radius,
        rho=None if problem.is_linear else radius_needed(radius, error, disturbance),
        disturbance=disturbance,
        error=error,
        W=W,
    )
