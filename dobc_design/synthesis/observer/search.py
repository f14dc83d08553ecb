"""From a request to an ObserverDesign: refute what is impossible, prove the first gain that does
it, or look nearby.

A gain is a proposal until every statement of its request is proved for the rational W as it is
written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from dobc_design.conditions.numbers import claimed, rounded_up, shorten
from dobc_design.conditions.statement import Statement
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.observability import decide_detectable
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, join
from dobc_design.synthesis.observer import decide
from dobc_design.synthesis.observer.claim import NoiseLimit, ObserverDesign, ObserverRequest
from dobc_design.synthesis.observer.propose import (
    estimate_observer,
    propose_envelopes,
    propose_gains,
)
from dobc_design.verdict import Verdict


def search_groups(groups: Sequence[Group], request: ObserverRequest) -> ObserverDesign:
    """Decide a request that every group has to meet with its own W: REFUTED if one is; one group as
    it is."""
    found = [search_observer(group.exosystem, request) for group in groups]
    if len(groups) == 1:
        return found[0]
    names = [group.name for group in groups]
    verdict = Verdict.all_of([design.verdict for design in found])
    if verdict is Verdict.PROVED:
        reason = "W of every group, with its rounded entries, meets all requirements."
        return _side_by_side(names, found, request, verdict, reason)
    name, worst = next((n, d) for n, d in zip(names, found, strict=True) if d.verdict is verdict)
    near = [design if design.verdict is Verdict.PROVED else design.nearest for design in found]
    known = [design for design in near if design is not None]
    nearest = None
    if len(known) == len(near):
        rates = [each.request.rate for each in known if each.request.rate is not None]
        limits = zip(*(each.request.noise for each in known), strict=True)
        noise = tuple(max(each, key=lambda limit: limit.bound) for each in limits)
        loosest = replace(
            request, rate=min(rates) if len(rates) == len(known) else None, noise=noise
        )
        nearest = _side_by_side(
            names, known, loosest, Verdict.PROVED, "every group meets this request."
        )
    whole = _side_by_side(names, found, request, verdict, f"group of agent {name}: {worst.reason}")
    return replace(whole, nearest=nearest)


def search_observer(exosystem: Exosystem, request: ObserverRequest) -> ObserverDesign:
    """Decide a request: PROVED with a W, REFUTED with the reason, or UNDECIDED; with the nearest
    possible request."""
    found, weaker = _attempt(exosystem, request), None
    if found.verdict is Verdict.PROVED:
        return found
    kind = found.statements[0].kind if found.statements else None
    if kind == "rate":
        rate = decide.largest_hidden_rate(
            decide_detectable(exosystem.A, exosystem.C).unobservable_polynomial
        )
        weaker = None if rate is None else replace(request, rate=rate)
    elif request.noise and kind != "detectable":
        weaker = replace(request, noise=())
    nearest = None if weaker is None else _attempt(exosystem, weaker)
    if nearest is None or nearest.verdict is not Verdict.PROVED:
        return found
    if request.noise and not nearest.request.noise:
        limits = tuple(_reached(exosystem, nearest, limit) for limit in request.noise)
        nearest = replace(nearest, request=replace(nearest.request, noise=limits))
    return replace(found, nearest=nearest)


def _side_by_side(
    names: Sequence[str],
    found: Sequence[ObserverDesign],
    request: ObserverRequest,
    verdict: Verdict,
    reason: str,
) -> ObserverDesign:
    """The designs of all groups as one: block diagonal W, P and Q, and the measures of the worst
    group."""
    shared = [key for key in found[0].measures if all(key in design.measures for design in found)]
    worst = {
        key: (min if key == "rate" else max)(design.measures[key] for design in found)
        for key in shared
    }
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


def _attempt(exosystem: Exosystem, request: ObserverRequest) -> ObserverDesign:
    without = partial(ObserverDesign, request=request, measures={})
    obstacle = decide.why_impossible(exosystem, request)
    if obstacle is not None:
        return without(verdict=Verdict.REFUTED, reason=obstacle.text, statements=(obstacle,))
    for W, source in propose_gains(exosystem, request):
        statements = decide.gain_statements(exosystem, W, request)
        if all(statement.verdict is Verdict.PROVED for statement in statements):
            return _proved(exosystem, request, W, source, statements)
    none = "no W was found that meets all requirements, and no proof that there is none."
    return without(verdict=Verdict.UNDECIDED, reason=none)


def _proved(
    exosystem: Exosystem,
    request: ObserverRequest,
    W: Matrix,
    source: str,
    statements: tuple[Statement, ...],
) -> ObserverDesign:
    """The design of a W that does what was asked, with a P where one is proved, and with
    measures."""
    P: Matrix | None = None
    measures = {"gain": decide.size_above(W)}
    if request.period is None:
        for envelope in propose_envelopes(exosystem, W, request.rate):
            bound = decide.envelope_statement(exosystem, W, envelope)
            if bound is not None:
                P, statements = envelope.P, (*statements, bound)
                break
        measures = decide.proved_measures(
            exosystem, W, estimate_observer(exosystem, W), norms=request.norms
        )
        # proved as well, and exact where eigenvalues are hard to estimate
        if request.rate is not None:
            measures["rate"] = max(measures.get("rate", 0.0), shorten(request.rate))
    return ObserverDesign(
        verdict=Verdict.PROVED,
        request=request,
        W=W,
        P=P,
        Q=None if P is None else multiply(P, W),
        source=source,
        statements=statements,
        measures=measures,
        reason="W, with its rounded entries, meets all requirements.",
    )


def _reached(exosystem: Exosystem, found: ObserverDesign, limit: NoiseLimit) -> NoiseLimit:
    """The limit, or what W reaches where that is more."""
    value = found.measures.get(f"{limit.norm} {limit.channel}")
    if limit.norm == "h2" and found.W is not None:
        square = decide.h2_squared(decide.channel(exosystem, found.W, limit.channel))
        value = None if square is None else decide.root_above(square)
    if value is None or claimed(value) < limit.bound:
        return limit
    return NoiseLimit(
        channel=limit.channel, norm=limit.norm, bound=rounded_up(claimed(value), digits=6)
    )
