"""From a request to an ObserverDesign: refute what is impossible, prove the first gain that does it, or look nearby.

Proposals come from outside as functions, so that no solver is imported here; none of them is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_below
from dobc_design.exact.observability import decide_detectable
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.observer_request import NoiseLimit, ObserverRequest
from dobc_design.theorems.spectral_conditions import GainRow, gain_rows
from dobc_design.verdict import Verdict
from dobc_design.verify.impossible import (
    largest_hidden_rate,
    least_gain_squared,
    why_impossible,
    why_undetectable,
)
from dobc_design.verify.norms import channel, h2_squared, root_above
from dobc_design.verify.numbers import claimed, shorten
from dobc_design.verify.observer_design import Envelope, ObserverDesign, first_proved, gain_squared
from dobc_design.verify.observer_measures import proved_measures
from dobc_design.verify.statement import Statement


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
            verdict=Verdict.UNDECIDED, request=request, measures={}, least_gain=bound,
            reason="no W was found that does everything that was asked, and no proof that there is none.",
        )  # fmt: skip
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
    return NoiseLimit(channel=limit.channel, norm=limit.norm, bound=claimed(_up(value)))


def _up(value: float) -> float:
    """A number of six digits that is not smaller."""
    short = float(f"{value:.6g}")
    return short if short >= value else float(f"{value * (1 + 1e-6):.6g}")
