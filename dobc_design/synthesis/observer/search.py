"""From a request to an ObserverDesign: refute what is impossible, prove the first gain that does
it, or look nearby.

A gain is a proposal until every statement of its request is proved for the rational W as it is
written.
"""

from collections.abc import Mapping
from dataclasses import replace

from dobc_design.conditions.numbers import claimed, rounded_up, shorten
from dobc_design.conditions.observer.decide import detectability_check, of_outputs
from dobc_design.conditions.statement import refuted
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.observability import decide_detectable
from dobc_design.loop.make import observed, timing_of
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, join
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer import decide
from dobc_design.verdict import Verdict

from .claim import NoiseLimit, ObserverDesign, ObserverRequest, require_sampled
from .propose import estimate_observer, propose_envelopes, propose_gains


def search_groups(problem: Problem, request: ObserverRequest) -> ObserverDesign:
    """Decide a request that every group has to meet with its own W: REFUTED if one is; one group as
    it is."""
    timing = timing_of(problem)
    if timing is not None and timing.sampled:
        request = replace(request, period=timing.period, timing=timing)
        require_sampled(request)
    groups = observed(problem)
    found = [search_observer(group.exosystem, request) for group in groups]
    if problem.outputs is not None:
        every = zip(found, groups, strict=True)
        found = [_of_outputs(each, group, problem.m) for each, group in every]
    if len(groups) == 1:
        return found[0]
    designs = {group.name: each for group, each in zip(groups, found, strict=True)}
    whole = _side_by_side(designs, request)
    if whole.is_proved:
        return whole
    return replace(whole, nearest=_nearest_of_all(designs, request))


def _nearest_of_all(
    designs: Mapping[str, ObserverDesign], request: ObserverRequest
) -> ObserverDesign | None:
    """The design for the nearest request that every group meets; None where one has none."""
    known = {}
    # A group that meets the request as it is keeps its design.
    for name, design in designs.items():
        near = design if design.is_proved else design.nearest
        if near is None:
            return None
        known[name] = near
    asked = [near.request for near in known.values()]
    rates = [each.rate for each in asked if each.rate is not None]
    # A group without a rate leaves all without one.
    slowest = min(rates) if len(rates) == len(asked) else None
    noise = []
    for limits in zip(*(each.noise for each in asked), strict=True):
        loudest = max(limits, key=lambda limit: limit.bound)
        noise.append(loudest)
    loosest = replace(request, rate=slowest, noise=tuple(noise))
    return replace(_side_by_side(known, loosest), relaxed=True)


def _of_outputs(design: ObserverDesign, group: Group, states: int) -> ObserverDesign:
    """The design, which says what outputs do not show in their words."""
    if design.obstacle is None or design.obstacle.kind != "detectable":
        return design
    check = of_outputs(detectability_check(group.exosystem), group, states)
    obstacle = refuted("outputs", f"no W exists: {check.reason}")
    return replace(design, obstacle=obstacle, statements=(obstacle,))


def search_observer(exosystem: Exosystem, request: ObserverRequest) -> ObserverDesign:
    """Decide a request: PROVED with a W, REFUTED with the reason, or UNDECIDED; with the nearest
    possible request."""
    found = _attempt(exosystem, request)
    if found.is_proved:
        return found
    weaker = _weaker(exosystem, found)
    if weaker is None:
        return found
    nearest = _attempt(exosystem, weaker)
    if not nearest.is_proved:
        return found
    if request.noise and not weaker.noise:
        # The bounds that were given up become what the gain without them reaches.
        reached = tuple(_reached(exosystem, nearest, limit) for limit in request.noise)
        nearest = replace(nearest, request=replace(weaker, noise=reached))
    return replace(found, nearest=nearest)


def _weaker(exosystem: Exosystem, found: ObserverDesign) -> ObserverRequest | None:
    """The request without what the refutation is about, or without its bounds on noise; None where
    nothing helps."""
    request = found.request
    kind = found.obstacle.kind if found.obstacle else None
    # Hidden eigenvalues stay where they are: as fast as the slowest of them is possible.
    if kind == "rate":
        pair = decide_detectable(exosystem.A, exosystem.C)
        rate = decide.largest_hidden_rate(pair.unobservable_polynomial)
        return None if rate is None else replace(request, rate=rate)
    if request.noise and kind != "detectable":
        return replace(request, noise=())
    return None


def _side_by_side(
    designs: Mapping[str, ObserverDesign], request: ObserverRequest
) -> ObserverDesign:
    """The designs of all groups as one: block diagonal W, P and Q, and the measures of the worst
    group."""
    found = list(designs.values())
    verdict = Verdict.all_of([design.verdict for design in found])
    worst = {}
    for key in found[0].measures:
        if all(key in design.measures for design in found):
            values = [design.measures[key] for design in found]
            # A rate is worst where it is small, a gain, norm or peak where it is large.
            worst[key] = min(values) if key == "rate" else max(values)
    statements = []
    for name, design in designs.items():
        for each in design.statements:
            # Of an answer that is not proved, only what stands in the way.
            if verdict is Verdict.PROVED or each.verdict is verdict:
                text = f"Group of agent {name}: {each.text}"
                statements.append(replace(each, text=text))
    sources = dict.fromkeys(design.source for design in found if design.source is not None)
    return ObserverDesign(
        verdict=verdict,
        request=request,
        measures=worst,
        groups=designs,
        W=join([design.W for design in found]),
        P=join([design.P for design in found]),
        Q=join([design.Q for design in found]),
        source=", ".join(sources) or None,
        statements=tuple(statements),
    )


def _attempt(exosystem: Exosystem, request: ObserverRequest) -> ObserverDesign:
    obstacle = decide.why_impossible(exosystem, request)
    if obstacle is not None:
        return ObserverDesign(
            verdict=Verdict.REFUTED,
            request=request,
            measures={},
            obstacle=obstacle,
            statements=(obstacle,),
        )
    # A solver's word counts for nothing: what it proposes is decided exactly, as it is rounded.
    for W, source in propose_gains(exosystem, request):
        statements = decide.gain_statements(exosystem, W, request)
        if all(statement.is_proved for statement in statements):
            design = ObserverDesign(
                verdict=Verdict.PROVED,
                request=request,
                W=W,
                source=source,
                statements=statements,
                measures={"gain": decide.size_above(W)},
            )
            # P and the other measures are those of an observer in continuous time.
            if request.period is None:
                design = _with_envelope(exosystem, W, design)
            return design
    return ObserverDesign(verdict=Verdict.UNDECIDED, request=request, measures={})


def _with_envelope(exosystem: Exosystem, W: Matrix, design: ObserverDesign) -> ObserverDesign:
    """The design of a W in continuous time with a P, where one is proved, and with measures."""
    request = design.request
    rate = request.rate
    estimates = estimate_observer(exosystem, W)
    measures = decide.proved_measures(exosystem, W, estimates, norms=request.norms)
    # The rate asked for is proved as well, and exact where eigenvalues are hard to estimate.
    if rate is not None:
        measures["rate"] = max(measures.get("rate", 0.0), shorten(rate))
    design = replace(design, measures=measures)
    for envelope in propose_envelopes(exosystem, W, rate):
        bound = decide.envelope_statement(exosystem, W, envelope)
        if bound is not None:
            P = envelope.P
            statements = (*design.statements, bound)
            return replace(design, P=P, Q=multiply(P, W), statements=statements)
    return design


def _reached(exosystem: Exosystem, found: ObserverDesign, limit: NoiseLimit) -> NoiseLimit:
    """The limit, or what W reaches where that is more."""
    channel = limit.channel
    norm = limit.norm
    value = found.measures.get(f"{norm} {channel}")
    if norm == "h2" and found.W is not None:
        # The exact square is also known where measures leave norms out.
        square = decide.h2_squared(decide.channel(exosystem, found.W, channel))
        value = None if square is None else decide.root_above(square)
    if value is None or claimed(value) < limit.bound:
        return limit
    bound = rounded_up(claimed(value), digits=6)
    return NoiseLimit(channel=channel, norm=norm, bound=bound)
