"""From a request over a region to a PinningDesign: the smallest gains whose max-separable certificate is proved.

Whether gains do is decided by ``conditions.separable``; that no gains on these agents do, for any v and any radius, by
an order of the agents or by a direction that is too slow near the consensus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.separable.claim import ErrorBound, Separable, acts_by_component, find_ordering
from dobc_design.conditions.separable.decide import (
    composite_rate,
    coupling_profiles,
    covers,
    verify_composite,
    verify_separable,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.conditions.statement import Statement, proved, refuted
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text, parse_number
from dobc_design.exact.reading import counted, shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.claim import PinningDesign, Structure, without_gains
from dobc_design.synthesis.pinning.decide import structural_obstacle, structure_of, too_fast
from dobc_design.synthesis.pinning.propose import slow_directions
from dobc_design.synthesis.pinning.propose_regions import propose_for_box
from dobc_design.synthesis.pinning.request import FEWEST, PinningRequest, cost_of, typed_gains
from dobc_design.verdict import Verdict

#: How much faster than asked a proposal is to be, one after the other.
TILTS = (Fraction(1, 10**7), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
SLOWER = 6  # halvings of the rate that are tried for the nearest request
SMALLEST = Fraction(1, 10**9)  # radius of a box


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Starts |e|_inf <= radius and |eps_i| <= disturbance.

    ``rho``: the box of the certificate, with room for the observer; None for linear couplings, where every start is
    covered.  ``error`` and ``W``: the observer's part where disturbance > 0.
    """

    radius: Fraction
    rho: Fraction | None
    disturbance: Fraction = Fraction(0)
    error: ErrorBound | None = None
    W: Matrix | None = None

    def __str__(self) -> str:
        errors = f", |eps_i| <= {shown_number(self.disturbance)}" if self.disturbance else ""
        return f"|e_i| <= {shown_number(self.radius)}{errors}"


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxGains:
    """Gains (1/s, by agent index) and the certificate that is PROVED for the ``problem`` with them."""

    gains: Mapping[int, Fraction]
    certificate: Separable
    problem: Problem


def search_region(problem: Problem, request: PinningRequest, region: Any) -> PinningDesign:
    """Decide a request over a region: PROVED with gains, REFUTED with the reason, or UNDECIDED; with a slower one.

    ``region``: a radius, or True for the [region] of the problem.  Raises: SpecError for another one.
    """
    asked = _file_region(problem, request) if region is True else _ball(problem, region)
    design = _attempt(problem, request, asked)
    slow = {each.kind for each in design.statements} & {"gains", "rate", "max_gain"}
    for halvings in range(1, SLOWER + 1 if slow and design.verdict is not Verdict.PROVED else 1):
        rate = claimed(shorten(request.rate / 2**halvings, digits=3))
        nearest = _attempt(problem, replace(request, rate=rate), asked)
        if nearest.verdict is Verdict.PROVED:
            return replace(design, nearest=nearest)
    return design


def _ball(problem: Problem, region: Any) -> Region:
    radius = parse_number(region, key="region")
    if radius <= 0:
        raise SpecError(
            f"region must be > 0, because it is a radius; got {shown_number(radius)}.",
            key="region",
            cure="Give the largest |e_i| of a start, or True for the problem's [region].",
        )
    return Region(radius=radius, rho=None if problem.is_linear else radius)


def _file_region(problem: Problem, request: PinningRequest) -> Region:
    region = problem.region
    if region is None:
        raise SpecError(
            "region = True means the [region] of the problem, and there is none.",
            key="region",
            cure="Give a radius, or a [region].",
        )
    radius, disturbance = max(*asked_radius(problem), SMALLEST), region.initial_disturbance or Fraction(0)
    exosystem, W = problem.joint_exosystem, problem.joint_observer.W
    if not disturbance or exosystem is None:
        return Region(radius=radius, rho=None if problem.is_linear else radius)
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
    rho = None if problem.is_linear else radius_needed(radius, error, disturbance)
    return Region(radius=radius, rho=rho, disturbance=disturbance, error=error, W=W)


def _attempt(problem: Problem, request: PinningRequest, asked: Region) -> PinningDesign:
    structure = structure_of(problem, request.allowed)
    bare = changed_problem(problem, {"pinning.gains": None})
    obstacle = structural_obstacle(problem, request.pins, structure) or _unordered(bare, request)
    obstacle = obstacle or too_fast(
        problem, request.rate, allowed=request.allowed, caps=request.caps, pins=request.pins, propose=slow_directions
    )
    if obstacle is not None:
        return without_gains(request, structure, obstacle, radius=asked.radius)
    found = _on(bare, request, asked, request.allowed)
    if isinstance(found, Statement):
        return without_gains(request, structure, found, radius=asked.radius)
    if request.pins is None or (request.pins != FEWEST and len(found.gains) <= int(request.pins)):
        return _designed(request, asked, found, structure, ())
    if request.pins != FEWEST:
        fewer = _on(bare, request, asked, _heaviest(found, request, structure.groups, int(request.pins)))
        if isinstance(fewer, Statement):
            text = (
                f"no {request.pins} of the allowed agents were found with which the certificate reaches the rate"
                f" {shown_number(request.rate)} over the region; {len(found.gains)} agents do."
            )
            few = Statement(kind="pins", verdict=Verdict.UNDECIDED, text=text)
            return without_gains(request, structure, few, radius=asked.radius)
        return _designed(request, asked, fewer, structure, ())
    low, high = max(1, structure.least), len(found.gains)
    while low < high:
        middle = (low + high) // 2
        fewer = _on(bare, request, asked, _heaviest(found, request, structure.groups, middle))
        if isinstance(fewer, Statement):
            low = middle + 1
        else:
            found, high = fewer, len(fewer.gains)
    pins = len(found.gains)
    known = pins <= max(1, structure.least)
    fewest = Statement(
        kind="pins",
        verdict=Verdict.PROVED if known else Verdict.UNDECIDED,
        exact={"least": str(structure.least)},
        text=f"No fewer than {counted(pins, 'pinned agent')} can do."
        if known
        else f"{pins} pinned agents do; at least {structure.least} are needed, and fewer than {pins} were not found.",
    )
    return _designed(request, asked, found, structure, (fewest,))


def _unordered(bare: Problem, request: PinningRequest) -> Statement | None:
    """A proof that no v exists for any radius, whatever the gains: agents that no order serves."""
    if not acts_by_component(bare):
        return None
    labels = bare.network.labels
    held = changed_problem(bare, {"pinning.gains": {labels[i]: Fraction(1) for i in request.allowed}})
    ordering = find_ordering(held)
    if ordering.exists:
        return None
    stuck = name_agents([labels[i] for i in ordering.stuck])
    modes = f" ({', '.join(dict.fromkeys(ordering.blocking))})" if len(bare.network.modes) > 1 else ""
    return refuted(
        "ordering",
        f"no gains on the allowed agents have a max-separable certificate, of any radius: each of {stuck} may not be"
        f" pinned and in one of the modes hears nobody but these{modes}.",
        agents=", ".join(labels[i] for i in ordering.stuck[:50]),
    )


def _on(bare: Problem, request: PinningRequest, asked: Region, agents: Sequence[int]) -> BoxGains | Statement:
    """Gains on these agents with the whole certificate of the region, or why not."""
    found = gains_for_box(bare, replace(request, allowed=tuple(sorted(agents))), rho=asked.rho)
    if isinstance(found, Statement):
        return found
    certificate = replace(found.certificate, error=asked.error)
    wrong = ""
    if asked.error is not None:
        decided = verify_composite(found.problem, asked.W, certificate)
        wrong = "" if decided.verdict is Verdict.PROVED else f": {decided.reason}"
    reaches = covers(certificate, radius=asked.radius, disturbance=asked.disturbance)
    if wrong or not reaches or composite_rate(certificate) < request.rate:
        text = f"the observer's part is not proved{wrong or '.'}"
        return Statement(kind="observer", verdict=Verdict.UNDECIDED, text=text)
    return replace(found, certificate=certificate)


def gains_for_box(bare: Problem, request: PinningRequest, *, rho: Fraction | None) -> BoxGains | Statement:
    """Cheap gains on the allowed agents of a problem without gains, with a max-separable certificate of the box rho.

    It decays at ``request.rate`` for all s in (0, rho] (None: linear couplings, every s), for every switching among the
    modes.  Returns: an UNDECIDED Statement where none were found.
    """
    if not acts_by_component(bare):
        return Statement(
            kind="method",
            verdict=Verdict.UNDECIDED,
            text="does not apply: the max-separable certificate is for couplings that act on each state component by"
            " itself.",
        )
    try:  # whatever v is, |e_j - e_i| reaches 2 rho at least
        coupling_profiles(bare, (Fraction(1),) * bare.n, rho=rho)
    except UndefinedError as error:
        return Statement(kind="method", verdict=Verdict.UNDECIDED, text=f"does not apply: {error}")
    labels = bare.network.labels
    for tilt in TILTS:
        for v, proposed in propose_for_box(bare, request, rho=rho, rate=float(request.rate * (1 + tilt))):
            gains = typed_gains(dict(enumerate(proposed.tolist())), digits=request.digits, caps=request.caps)
            held = changed_problem(bare, {"pinning.gains": {labels[i]: k for i, k in gains.items()}})
            claim = Separable(v=v, alpha=request.rate, rho=rho)
            if gains and verify_separable(held, claim).verdict is Verdict.PROVED:
                return BoxGains(gains=gains, certificate=claim, problem=held)
    where = "" if rho is None else f" over |e_i| <= {shown_number(rho)}"
    return Statement(
        kind="gains",
        verdict=Verdict.UNDECIDED,
        text="no gains on the allowed agents were found with which the max-separable certificate reaches the rate"
        f" {shown_number(request.rate)}{where}, and no proof that there are none.",
    )


def _heaviest(found: BoxGains, request: PinningRequest, groups: Sequence[Sequence[int]], pins: int) -> tuple[int, ...]:
    """The agents that carry most of the gains without the limit; each group needs one."""
    order = sorted(request.allowed, key=lambda i: (-found.gains.get(i, 0), i))
    chosen: list[int] = []
    for group in groups:
        if not set(group) & set(chosen):
            chosen.append(next(i for i in order if i in group))
    return tuple((chosen + [i for i in order if i not in chosen])[:pins])


def _designed(
    request: PinningRequest, asked: Region, found: BoxGains, structure: Structure, more: tuple[Statement, ...]
) -> PinningDesign:
    labels = found.problem.network.labels
    gains, cost = {labels[i]: k for i, k in found.gains.items()}, cost_of(request, found.gains)
    weights = f"max_i |e_i|/v_i (v from 1 to {float(max(found.certificate.v)):.4g})"
    errors = "" if asked.error is None else " plus the observer's part"
    still = ", with eps = 0" if asked.error is None else ""
    reached = proved(
        "region",
        f"{weights}{errors} decays from every start {asked}{still}, at the rate {number_text(request.rate)}, for the"
        " gains as they are written.",
        rate=number_text(request.rate),
        radius=number_text(asked.radius),
    )
    return PinningDesign(
        verdict=Verdict.PROVED,
        request=request,
        gains=gains,
        rate=request.rate,
        cost=cost,
        structural_minimum=structure.least if structure.exact else None,
        statements=(reached, *more),
        problem=found.problem,
        certificate=found.certificate,
        radius=asked.radius,
        reason=f"gains on {name_agents(tuple(gains))} reach the rate {shown_number(request.rate)} over {asked} at the"
        f" cost {float(cost):.6g}.",
    )
