"""From a request to an ObserverDesign: refute what is impossible, prove the first gain that does it, or look nearby.

Proposals come from outside as functions, so that no solver is imported here; none of them is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.statement import Statement
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_below
from dobc_design.exact.observability import decide_detectable
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, join
from dobc_design.synthesis.observer.design import Envelope, ObserverDesign, first_proved, gain_squared
from dobc_design.synthesis.observer.impossible import (
    largest_hidden_rate,
    least_gain_squared,
    why_impossible,
    why_undetectable,
)
from dobc_design.synthesis.observer.measures import proved_measures
from dobc_design.synthesis.observer.norms import channel, h2_squared, root_above
from dobc_design.synthesis.observer.request import NoiseLimit, ObserverRequest
from dobc_design.synthesis.observer.spectral_conditions import GainRow, gain_rows
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposals:
    """Where proposals come from: gains for a request, envelopes for a W, multipliers for rows, estimates for a W."""

    gains: Callable[[Exosystem, ObserverRequest], Iterable[tuple[Matrix, str]]]
    envelopes: Callable[[Matrix, ObserverRequest], Iterable[tuple[Matrix, Fraction, Fraction, Fraction]]]
    multipliers: Callable[[Sequence[GainRow]], Sequence[Fraction]]
    estimates: Callable[[Matrix], Mapping[str, float]]


def search_observer(exosystem: Exosystem, request: ObserverRequest, proposals: Proposals) -> ObserverDesign:
    """Decide a request: PROVED with a W, REFUTED with the reason, or UNDECIDED; with the nearest possible request."""
    found = _attempt(exosystem, request, proposals)
    if found.verdict is Verdict.PROVED:
        return found
    for weaker in _weaker(exosystem, request, found):
        nearest = _attempt(exosystem, weaker, proposals)
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=_tightened(exosystem, request, nearest))
    return found


def search_groups(
    groups: Sequence[Group], request: ObserverRequest, proposals_for: Callable[[Exosystem], Proposals]
) -> ObserverDesign:
    """Decide a request that every group of agents has to meet with a W of its own; one group as it is.

    PROVED if every group is, REFUTED if one is.  The nearest request is met by all groups: the loosest limit of each
    kind that one of them needs.
    """
    found = [search_observer(group.exosystem, request, proposals_for(group.exosystem)) for group in groups]
    if len(groups) == 1:
        return found[0]
    names = [group.name for group in groups]
    verdict = Verdict.all_of([design.verdict for design in found])
    reason = "W of every group, as it is written with its rounded entries, does everything that was asked."
    if verdict is not Verdict.PROVED:
        name, worst = next((n, d) for n, d in zip(names, found, strict=True) if d.verdict is verdict)
        reason = f"group of agent {name}: {worst.reason}"
    near = [design if design.verdict is Verdict.PROVED else design.nearest for design in found]
    known = [design for design in near if design is not None]
    nearest = None
    if verdict is not Verdict.PROVED and len(known) == len(near):
        loosest = _loosest(request, [design.request for design in known])
        nearest = _side_by_side(names, known, loosest, Verdict.PROVED, "every group meets this request.")
    return replace(_side_by_side(names, found, request, verdict, reason), nearest=nearest)


def _side_by_side(
    names: Sequence[str], found: Sequence[ObserverDesign], request: ObserverRequest, verdict: Verdict, reason: str
) -> ObserverDesign:
    """The designs of all groups as one: block diagonal W, P and Q, and the measures of the worst group."""
    shared = [key for key in found[0].measures if all(key in design.measures for design in found)]
    worst = {key: (min if key == "rate" else max)(design.measures[key] for design in found) for key in shared}
    sources = dict.fromkeys(design.source for design in found if design.source is not None)
    return ObserverDesign(
        verdict=verdict,
        reason=reason,
        request=request,
        measures=worst,
        groups=dict(zip(names, found, strict=True)),
        W=join([design.W for design in found]),
        P=join([design.P for design in found]),
        Q=join([design.Q for design in found]),
        source=", ".join(sources) or None,
        statements=tuple(
            replace(each, text=f"Group of agent {name}: {each.text}")
            for name, design in zip(names, found, strict=True)
            for each in design.statements
            if verdict is Verdict.PROVED or each.verdict is verdict
        ),
    )


def _loosest(asked: ObserverRequest, requests: Sequence[ObserverRequest]) -> ObserverRequest:
    """The request that holds whenever one of these does: of the same kind, with the loosest limits."""

    def every(values: Sequence[Fraction | None], choose: Callable[[Sequence[Fraction]], Fraction]) -> Fraction | None:
        known = [value for value in values if value is not None]
        return choose(known) if len(known) == len(requests) else None

    limits = None
    if all(len(each.noise) == len(asked.noise) for each in requests):
        own = zip(*(each.noise for each in requests), strict=True)
        limits = [_with_bound(each[0], max(limit.bound for limit in each)) for each in own] or None
    return asked.changed(
        {
            "rate": every([each.rate for each in requests], min),
            "noise": limits,
            "max_gain": every([each.max_gain for each in requests], max),
            "peak": every([each.peak for each in requests], max),
        }
    )


def _with_bound(limit: NoiseLimit, bound: Fraction) -> NoiseLimit:
    """The same limit with another bound."""
    return NoiseLimit(channel=limit.channel, norm=limit.norm, bound=bound)


def _attempt(exosystem: Exosystem, request: ObserverRequest, proposals: Proposals) -> ObserverDesign:
    least = Fraction(0)
    if request.period is not None:
        obstacle = why_undetectable(exosystem)
        if obstacle is not None:
            return _impossible(request, obstacle)
    else:
        rows = gain_rows(exosystem, request.all_regions)
        multipliers = proposals.multipliers(rows)
        obstacle = why_impossible(exosystem, request, rows=rows, multipliers=multipliers)
        if obstacle is not None:
            return _impossible(request, obstacle)
        least = least_gain_squared(rows, multipliers)

    def envelopes(W: Matrix) -> Iterator[Envelope]:
        for P, rate, lower, upper in proposals.envelopes(W, request):
            yield Envelope(P=P, rate=rate, lower=lower, upper=upper)

    bound = float_below(least) ** 0.5 * (1 - 1e-15) if least else None
    found = first_proved(exosystem, request, proposals.gains(exosystem, request), envelopes)
    if found is None or found.W is None:
        return ObserverDesign(
            verdict=Verdict.UNDECIDED,
            request=request,
            measures={},
            least_gain=bound,
            reason="no W was found that does everything that was asked, and no proof that there is none.",
        )
    measures = {"gain": root_above(gain_squared(found.W))}
    if request.period is None:
        measures = proved_measures(exosystem, found.W, proposals.estimates(found.W))
        if request.rate is not None:  # proved as well, and exact where eigenvalues are hard to estimate
            measures["rate"] = max(measures.get("rate", 0.0), shorten(request.rate))
    return replace(found, measures=measures, least_gain=bound)


def _impossible(request: ObserverRequest, obstacle: Statement) -> ObserverDesign:
    return ObserverDesign(
        verdict=Verdict.REFUTED, request=request, reason=obstacle.text, statements=(obstacle,), measures={}
    )


def _weaker(exosystem: Exosystem, request: ObserverRequest, found: ObserverDesign) -> Iterator[ObserverRequest]:
    """Requests with one thing given up, what is most likely the binding one first."""
    kind = found.statements[0].kind if found.statements else None
    if kind == "detectable":
        return
    if kind == "rate":
        hidden = decide_detectable(exosystem.A, exosystem.C).unobservable_polynomial
        rate = largest_hidden_rate(hidden)
        if rate is not None:
            yield request.changed({"rate": rate})
        return
    if request.rate is not None and request.max_gain is not None:
        yield request.changed({"rate": None})
    if request.max_gain is not None:
        yield request.changed({"max_gain": None})
    if request.peak is not None:
        yield request.changed({"peak": None})
    if request.noise:
        yield request.changed({"noise": None})


def _tightened(exosystem: Exosystem, asked: ObserverRequest, found: ObserverDesign) -> ObserverDesign:
    """The design with its request restored as far as W keeps it: limits given up become what W reaches."""
    if found.W is None:
        return found
    request = found.request
    if asked.rate is not None and request.rate is None and found.measures.get("rate"):
        request = request.changed({"rate": claimed(shorten(found.measures["rate"], digits=6))})
    if asked.max_gain is not None and request.max_gain is None:
        request = request.changed({"max_gain": claimed(_up(found.measures["gain"]))})
    if asked.noise and not request.noise:
        request = request.changed({"noise": [_reached(exosystem, found, limit) for limit in asked.noise]})
    return replace(found, request=request)


def _reached(exosystem: Exosystem, found: ObserverDesign, limit: NoiseLimit) -> NoiseLimit:
    """The limit, or what W reaches where that is more."""
    value = found.measures.get(f"{limit.norm} {limit.channel}")
    if limit.norm == "h2" and found.W is not None:
        square = h2_squared(channel(exosystem, found.W, limit.channel))
        value = None if square is None else root_above(square)
    if value is None or claimed(value) < limit.bound:
        return limit
    return _with_bound(limit, claimed(_up(value)))


def _up(value: float) -> float:
    """A number of six digits that is not smaller."""
    short = float(f"{value:.6g}")
    return short if short >= value else float(f"{value * (1 + 1e-6):.6g}")
