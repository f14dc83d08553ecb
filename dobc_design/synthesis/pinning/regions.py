"""From a request over a region to a PinningDesign: gains whose certificate is proved, and what they cost at least.

Two certificates: "max-separable" (a box, theory section 5) and "lure" (V = e'e on a ball, all arc gains in their
sectors, section 4).  Proposals come from outside as functions; none of them is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.observer import composite_rate, covers, verify_composite
from dobc_design.conditions.statement import Statement
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, shown_number
from dobc_design.synthesis.pinning.balls import BallGains, ProposeBall, gains_for_ball
from dobc_design.synthesis.pinning.bound import Ground, bound_from
from dobc_design.synthesis.pinning.boxes import BoxGains, NearProposals, Propose, gains_for_box
from dobc_design.synthesis.pinning.choice import PinningProposals
from dobc_design.synthesis.pinning.design import PinningDesign
from dobc_design.synthesis.pinning.request import FEWEST, PinningRequest
from dobc_design.synthesis.pinning.search import structural_obstacle, without_gains
from dobc_design.synthesis.pinning.structure import structure_of
from dobc_design.verdict import Verdict

BOX, BALL = "max-separable", "lure"
SLOWER = 6  # halvings of the rate that are tried for the nearest request


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionAsked:
    """Starts |e|_inf <= radius ("max-separable") or |e| <= radius ("lure"), and |eps_i| <= disturbance.

    ``rho``: the box of the certificate, with room for the observer; None for linear couplings, where every start is
    covered.  ``error`` and ``W``: the observer's part where disturbance > 0.
    """

    method: str
    radius: Fraction
    rho: Fraction | None
    disturbance: Fraction = Fraction(0)
    error: ErrorBound | None = None
    W: Matrix | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionProposals:
    """``box``, ``near``, ``ball``: see ``pinning_boxes`` and ``pinning_balls``.

    ``consensus``: those of the request at the consensus; None where the couplings have no derivative there.
    """

    box: Propose
    near: NearProposals
    ball: ProposeBall
    consensus: Callable[[PinningRequest], PinningProposals] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Answer:
    """Gains that are proved, by the agents that were allowed; ``bound``: no gains on the allowed agents cost less."""

    found: BoxGains | BallGains
    bound: Fraction


def search_region(ground: Ground, asked: RegionAsked, proposals: RegionProposals) -> PinningDesign:
    """Decide a request over a region: PROVED with gains, REFUTED with the reason, or UNDECIDED; with a slower one."""
    design = _attempt(ground, asked, proposals)
    slow = {each.kind for each in design.statements} & {"gains", "rate"}
    for halvings in range(1, SLOWER + 1 if slow and design.verdict is not Verdict.PROVED else 1):
        rate = claimed(shorten(ground.request.rate / 2**halvings, digits=3))
        slower = replace(ground, request=replace(ground.request, rate=rate))
        nearest = _attempt(slower, asked, proposals)
        if nearest.verdict is Verdict.PROVED:
            return replace(design, nearest=nearest)
    return design


def _attempt(ground: Ground, asked: RegionAsked, proposals: RegionProposals) -> PinningDesign:
    request = ground.request
    structure = structure_of(ground.problem, request.allowed)
    obstacle = structural_obstacle(ground, structure)
    least = structure.least if structure.exact else None
    if obstacle is not None:
        return without_gains(ground, structure, obstacle)
    answer = _on(ground, asked, proposals, request.allowed)
    if isinstance(answer, Statement):
        return PinningDesign(
            verdict=answer.verdict,
            request=request,
            gains={},
            structural_minimum=least,
            reason=answer.text,
            statements=(answer,),
            method=asked.method,
            radius=asked.radius,
        )
    fewest: Statement | None = None
    if request.pins is not None and not (isinstance(request.pins, int) and len(answer.found.gains) <= request.pins):
        chosen, fewest = _with_fewer(ground, asked, proposals, answer, max(1, structure.least))
        if chosen is None:
            return PinningDesign(
                verdict=Verdict.UNDECIDED,
                request=request,
                gains={},
                structural_minimum=least,
                method=asked.method,
                radius=asked.radius,
                reason=f"no {request.pins} of the allowed agents were found with which the certificate reaches the rate"
                f" {shown_number(request.rate)} over the region; {len(answer.found.gains)} agents do.",
            )
        answer = _Answer(found=chosen, bound=answer.bound)
    return _designed(ground, asked, answer, least, () if fewest is None else (fewest,))


def _on(ground: Ground, asked: RegionAsked, proposals: RegionProposals, agents: Sequence[int]) -> _Answer | Statement:
    """Gains on these agents, proved, with what gains on them cost at least."""
    request = replace(ground.request, allowed=tuple(sorted(agents)))
    if asked.method == BALL:
        ball = gains_for_ball(ground.problem, request, radius=asked.radius, propose=proposals.ball)
        if isinstance(ball, Statement):
            return ball
        return _Answer(found=ball, bound=_at_consensus(replace(ground, request=request), proposals))
    box = gains_for_box(ground.problem, request, rho=asked.rho, propose=proposals.box, near=proposals.near)
    if isinstance(box, Statement):
        return box
    certificate = replace(box.certificate, error=asked.error)
    decided = verify_composite(box.problem, asked.W, certificate) if asked.error is not None else None
    outside = not covers(certificate, radius=asked.radius, disturbance=asked.disturbance)
    slow = composite_rate(certificate) < request.rate
    if outside or slow or (decided is not None and decided.verdict is not Verdict.PROVED):
        return Statement(
            kind="observer",
            verdict=Verdict.UNDECIDED,
            text="the observer's part is not proved" + ("." if decided is None else f": {decided.reason}"),
        )
    return _Answer(found=replace(box, certificate=certificate), bound=box.lower_bound)


def _at_consensus(ground: Ground, proposals: RegionProposals) -> Fraction:
    """What gains cost at least with which V = e'e decays at the rate next to the consensus: proved, 0 if not found."""
    if proposals.consensus is None:
        return Fraction(0)
    request = ground.request
    vectors = proposals.consensus(request).relax(request.allowed, float(request.rate))[1]
    return bound_from(ground, vectors, request.allowed, request.rate).value


def _with_fewer(
    ground: Ground, asked: RegionAsked, proposals: RegionProposals, whole: _Answer, least: int
) -> tuple[BoxGains | BallGains | None, Statement | None]:
    """Gains on at most so many agents, or on the fewest that are found, by bisection; with what is known of fewer."""
    request = ground.request
    if request.pins != FEWEST:
        return _cheapest(ground, asked, proposals, whole, int(request.pins or 0)), None
    best, low, high = whole.found, least, len(whole.found.gains)
    while low < high:
        middle = (low + high) // 2
        found = _cheapest(ground, asked, proposals, whole, middle, first=True)
        best, low, high = (best, middle + 1, high) if found is None else (found, low, len(found.gains))
    pins = len(best.gains)
    if pins <= least:
        text, verdict = f"No fewer than {counted(pins, 'pinned agent')} can do.", Verdict.PROVED
    else:
        text = f"{pins} pinned agents do; at least {least} are needed, and fewer than {pins} were not found."
        verdict = Verdict.UNDECIDED
    return best, Statement(kind="pins", verdict=verdict, exact={"least": str(least)}, text=text)


def _cheapest(
    ground: Ground, asked: RegionAsked, proposals: RegionProposals, whole: _Answer, pins: int, *, first: bool = False
) -> BoxGains | BallGains | None:
    """The cheapest of the sets that are tried; the first one that does where the cost is not asked."""
    best: BoxGains | BallGains | None = None
    for agents in _sets(ground, proposals, whole, pins):
        answer = _on(ground, asked, proposals, agents)
        if isinstance(answer, _Answer) and (best is None or answer.found.cost < best.cost):
            best = answer.found
            if first:
                break
    return best


def _sets(ground: Ground, proposals: RegionProposals, whole: _Answer, pins: int) -> Iterator[tuple[int, ...]]:
    """Sets worth trying: those that carry most of the gains without the limit, here and at the consensus."""
    request = ground.request
    groups = structure_of(ground.problem, request.allowed).groups

    def heaviest_of(gains: Mapping[int, Any]) -> tuple[int, ...]:
        order = sorted(request.allowed, key=lambda i: (-gains.get(i, 0), i))
        chosen: list[int] = []
        for group in groups:  # each needs one
            if not set(group) & set(chosen):
                chosen.append(next(i for i in order if i in group))
        return tuple(sorted((chosen + [i for i in order if i not in chosen])[:pins]))

    heaviest = heaviest_of(whole.found.gains)
    yield heaviest
    if proposals.consensus is not None:
        near = proposals.consensus(request).relax(request.allowed, float(request.rate))[0]
        if near is not None:
            others = heaviest_of(dict(enumerate(near)))
            if others != heaviest:
                yield others


def _designed(
    ground: Ground, asked: RegionAsked, answer: _Answer, least: int | None, more: tuple[Statement, ...]
) -> PinningDesign:
    request, found = ground.request, answer.found
    labels = ground.problem.network.labels
    gains = {labels[i]: k for i, k in found.gains.items()}
    bound = claimed(shorten(answer.bound)) if answer.bound > 0 else Fraction(0)
    reached = Statement(
        kind="region",
        verdict=Verdict.PROVED,
        exact={"rate": number_text(request.rate), "radius": number_text(asked.radius)},
        text=f"{_in_words(asked, found.certificate)}, at the rate {number_text(request.rate)}, for the gains as they"
        " are written.",
    )
    floor = Statement(
        kind="bound",
        verdict=Verdict.PROVED,
        exact={"bound": number_text(bound)},
        text=f"No gains on the allowed agents that cost less than {shorten(bound, digits=6):.6g} have such a"
        " certificate, of any radius: next to the consensus already they do not suffice.",
    )
    return PinningDesign(
        verdict=Verdict.PROVED,
        request=request,
        gains=gains,
        rate=request.rate,
        cost=found.cost,
        lower_bound=bound,
        bound_for=tuple(labels[i] for i in request.allowed),
        structural_minimum=least,
        statements=(reached, floor, *more),
        problem=found.problem,
        certificate=found.certificate,
        method=asked.method,
        radius=asked.radius,
        reason=f"gains on {name_agents(tuple(gains))} reach the rate {shown_number(request.rate)} over"
        f" {_where(asked)} at the cost {float(found.cost):.6g}; nothing that does costs less than"
        f" {shorten(bound, digits=6):.6g}.",
    )


def _where(asked: RegionAsked) -> str:
    norm = "|e|" if asked.method == BALL else "|e_i|"
    errors = f", |eps_i| <= {shown_number(asked.disturbance)}" if asked.disturbance else ""
    return f"{norm} <= {shown_number(asked.radius)}{errors}"


def _in_words(asked: RegionAsked, certificate: Separable | Lure) -> str:
    if isinstance(certificate, Lure):
        return f"V = e'e decays while {_where(asked)}, for all arc gains that occur there, with eps = 0"
    weights = f"max_i |e_i|/v_i (v from 1 to {float(max(certificate.v)):.4g})"
    if asked.error is None:
        return f"{weights} decays from every start {_where(asked)}, with eps = 0"
    return f"{weights} plus the observer's part decays from every start {_where(asked)}"
