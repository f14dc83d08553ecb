"""From a request to a PinningDesign: refute what is impossible, prove gains that do it, bound what is cheaper.

Proposals come from outside as functions, so that no solver is imported here; none of them is believed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

from dobc_design.conditions.consensus.network import carriers, name_agents
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.statement import Statement
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.synthesis.pinning.bound import Ground, bound_from, bound_holds, cost_of, obstacle_to, reaches
from dobc_design.synthesis.pinning.choice import Choice, PinningProposals, choose
from dobc_design.synthesis.pinning.count import pins_needed
from dobc_design.synthesis.pinning.design import PinningDesign, prices_in_words
from dobc_design.synthesis.pinning.nearest import weaker_requests
from dobc_design.synthesis.pinning.request import PinningRequest
from dobc_design.synthesis.pinning.structure import Structure, structure_of
from dobc_design.verdict import Verdict

TILTS = (1, 10, 1000, Fraction(1, 100))  # of the last digit but two: how much faster a rate is designed for
NOISE = 1e-9  # gains below this part of the largest are left out
SHOWN = 5  # ties put into words
LONGEST = 400  # entries of a witness that a statement writes out


def search_pinning(ground: Ground, proposals_for: Callable[[PinningRequest], PinningProposals]) -> PinningDesign:
    """Decide a request: PROVED with gains, REFUTED with the reason, or UNDECIDED; with the nearest possible request."""
    proposals = proposals_for(ground.request)
    found = _attempt(ground, proposals)
    if found.verdict is Verdict.PROVED:
        return found
    kind = found.statements[0].kind if found.statements else None
    for weaker in weaker_requests(ground, proposals, kind):
        nearest = _attempt(replace(ground, request=weaker), proposals_for(weaker))
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=nearest)
    return found


def _attempt(ground: Ground, proposals: PinningProposals) -> PinningDesign:
    request = ground.request
    structure = structure_of(ground.problem, request.allowed)
    obstacle = structural_obstacle(ground, structure) or _too_fast(ground, proposals, structure)
    if obstacle is not None:
        return without_gains(ground, structure, obstacle)
    if request.pins is None:
        return _designed(ground, proposals, structure, request.allowed, choice=None)
    choice, statements = _chosen(ground, proposals, structure)
    if choice is None or choice.agents is None:
        refuted = next((each for each in statements if each.verdict is Verdict.REFUTED), None)
        return without_gains(ground, structure, refuted)
    return _designed(ground, proposals, structure, choice.agents, choice=choice, more=statements)


def structural_obstacle(ground: Ground, structure: Structure) -> Statement | None:
    """A proof by the graph alone that the allowed agents, or so few pins, cannot do."""
    labels, pins = ground.problem.network.labels, ground.request.pins
    if structure.unmet is not None:
        group = name_agents([labels[i] for i in structure.unmet])
        return Statement(
            kind="structure",
            verdict=Verdict.REFUTED,
            exact={"group": _names(ground, structure.unmet)},
            text=f"no gains on the allowed agents can do: {group} listen{'s' if len(structure.unmet) == 1 else ''} to"
            " nobody else in one of the modes, and none of them may be pinned, so moved together they stay moved.",
        )
    if isinstance(pins, int) and pins < structure.least:
        groups = structure.apart if len(structure.apart) > pins else structure.groups
        named = "; ".join(name_agents([labels[i] for i in group]) for group in groups[:8])
        apart = "they have no agent in common" if len(structure.apart) > pins else f"no {pins} agents meet them all"
        return Statement(
            kind="pins",
            verdict=Verdict.REFUTED,
            exact={"least": str(structure.least), "groups": " | ".join(_names(ground, group) for group in groups)},
            text=f"{pins} pin{'s' if pins > 1 else ''} cannot do, whatever the gains: at least {structure.least} are"
            f" needed. Each of these groups listens to nobody outside in one of the modes and needs a pin of its own,"
            f" and {apart}: {named}.",
        )
    return None


def _too_fast(ground: Ground, proposals: PinningProposals, structure: Structure) -> Statement | None:
    """A proof that even gains on all allowed agents, at their caps, do not reach the rate."""
    request = ground.request
    gains, vectors = proposals.relax(request.allowed, float(request.rate))
    if gains is not None:
        return None
    obstacle = obstacle_to(ground, request.allowed, request.rate, vectors)
    if obstacle is None:
        return None
    moved = carriers(ground.problem, obstacle.vector)
    capped = {ground.problem.network.labels[i] for i in set(request.allowed) & set(request.caps)} & set(moved)
    values = {"v": ", ".join(map(number_text, obstacle.vector))} if len(obstacle.vector) <= LONGEST else {}
    because = (
        "even with every gain at its cap the direction shown decays more slowly"
        if capped
        else "the direction shown moves none of the agents that may be pinned, and decays more slowly by itself"
    )
    where = f" in mode {obstacle.mode}" if len(ground.lambdas) > 1 else ""
    return Statement(
        kind="max_gain" if capped else "rate",
        verdict=Verdict.REFUTED,
        exact={"mode": obstacle.mode, **values},
        text=f"no gains reach the rate {shown_number(request.rate)}{where}: {because}. It is carried by"
        f" {name_agents(moved)}.",
    )


def _chosen(
    ground: Ground, proposals: PinningProposals, structure: Structure
) -> tuple[Choice | None, tuple[Statement, ...]]:
    """The agents to pin: at most so many, or the fewest."""
    request, rate = ground.request, ground.request.rate
    groups = structure.groups
    needed = max(structure.least, pins_needed(ground, rate, proposals.slow(float(rate))))
    if isinstance(request.pins, int):
        if request.pins < needed:
            return None, (_too_few(request.pins, needed),)
        start = proposals.greedy(request.allowed, groups, float(rate), request.pins)
        choice = choose(ground, proposals, rate, request.pins, groups, start)
        return choice, (_choice_statement(request.pins, choice),)
    start = proposals.greedy(request.allowed, groups, float(rate), None)
    enough = len(request.allowed) if start is None else len(start)
    for pins in range(max(1, needed), enough):
        proposals.progress(f"looking for {counted(pins, 'agent')} that will do")
        choice = choose(ground, proposals, rate, pins, groups)
        if choice.agents is not None:
            return choice, (_fewest_statement(len(choice.agents), needed), _choice_statement(pins, choice))
        if not choice.impossible:
            break
        needed = pins + 1
    start = proposals.greedy(request.allowed, groups, float(rate), enough) if start is None else start
    choice = choose(ground, proposals, rate, enough, groups, start)
    count = 0 if choice.agents is None else len(choice.agents)
    return choice, (_fewest_statement(count, needed), _choice_statement(enough, choice))


def _too_few(pins: int, needed: int) -> Statement:
    return Statement(
        kind="pins",
        verdict=Verdict.REFUTED,
        exact={"least": str(needed)},
        text=f"{pins} pin{'s' if pins > 1 else ''} cannot do at this rate: at least {needed} are needed. So many"
        " independent directions are slower than that without gains, and each pin holds one of them.",
    )


def _fewest_statement(pins: int, needed: int) -> Statement:
    if pins <= needed:
        return Statement(
            kind="pins",
            verdict=Verdict.PROVED,
            exact={"least": str(pins)},
            text=f"No fewer than {counted(pins, 'pinned agent')} reach this rate.",
        )
    return Statement(
        kind="pins",
        verdict=Verdict.UNDECIDED,
        exact={"least": str(needed)},
        text=f"{pins} pinned agents do; whether fewer do was not decided, but at least {needed} are needed.",
    )


def _choice_statement(pins: int, choice: Choice) -> Statement:
    if choice.impossible:
        none = "none of the allowed agents alone reaches" if pins == 1 else f"no {pins} of the allowed agents reach"
        return Statement(
            kind="pins",
            verdict=Verdict.REFUTED,
            exact={"pins": str(pins), "nodes": str(choice.nodes)},
            text=f"{none} this rate: every choice is excluded, {choice.nodes} parts of the choice one by one, each by a"
            " direction that stays too slow or a group without a pin.",
        )
    how = "all choices compared" if choice.finished else f"{choice.nodes} parts of the choice looked at"
    agents = "one agent" if pins == 1 else f"at most {pins} agents"
    return Statement(
        kind="choice",
        verdict=Verdict.PROVED,
        exact={"bound": number_text(_short(choice.bound))},
        text=f"No gains on {agents} cost less than {shorten(choice.bound, digits=6):.6g} ({how}).",
    )


def _designed(
    ground: Ground,
    proposals: PinningProposals,
    structure: Structure,
    agents: Sequence[int],
    *,
    choice: Choice | None,
    more: tuple[Statement, ...] = (),
) -> PinningDesign:
    request, labels = ground.request, ground.problem.network.labels
    proposals.progress("proving the gains and their bound")
    gains = _proved_gains(ground, proposals, agents)
    if gains is None:
        return without_gains(ground, structure, None)
    vectors = proposals.relax(agents, float(request.rate))[1]
    bound = bound_from(ground, vectors, agents, request.rate)
    if not bound_holds(ground, bound, agents):  # unreachable: it was made to fit
        bound = bound_from(ground, (), agents, request.rate)
    least = bound.value if choice is None else _short(choice.bound)
    cost = cost_of(request, gains)
    pinned = tuple(labels[i] for i in gains)
    reached = Statement(
        kind="rate",
        verdict=Verdict.PROVED,
        exact={"rate": number_text(request.rate)},
        text=f"Lambda < -2 ({number_text(request.rate)}) I in every mode, for the gains as they are written.",
    )
    return PinningDesign(
        verdict=Verdict.PROVED,
        request=request,
        gains={labels[i]: k for i, k in gains.items()},
        rate=request.rate,
        cost=cost,
        lower_bound=least,
        bound=bound,
        bound_for=tuple(labels[i] for i in agents),
        structural_minimum=structure.least if structure.exact else None,
        statements=(reached, *_structure_statements(ground, structure), *more),
        prices=tuple(prices_in_words(ground.problem, request, bound, dict.fromkeys(agents))),
        ties=() if choice is None else _ties(ground, proposals, tuple(gains), choice),
        problem=changed_problem(ground.problem, {"pinning.gains": {labels[i]: k for i, k in gains.items()}}),
        reason=f"gains on {name_agents(pinned)} reach the rate {shown_number(request.rate)} at the cost"
        f" {float(cost):.6g}, and nothing that does costs less than {shorten(least, digits=6):.6g}.",
    )


def _proved_gains(ground: Ground, proposals: PinningProposals, agents: Sequence[int]) -> dict[int, Fraction] | None:
    """Gains for a rate a little faster, rounded up, that are proved for the rate asked."""
    request = ground.request
    for tilt in TILTS:
        part = max(Fraction(1, 10 ** (request.digits + 2)), Fraction(1, 10**10)) * tilt
        gains, vectors = proposals.relax(agents, float(request.rate * (1 + part)))
        if gains is None:
            continue
        least = max(gains) * NOISE
        rounded = {i: _typed(gains[i], request, i) for i in sorted(agents) if gains[i] > least}
        if reaches(ground, rounded, request.rate, hints=vectors):
            return rounded
    return None


def _typed(gain: float, request: PinningRequest, agent: int) -> Fraction:
    """The next number of so many digits, or the cap if that is less."""
    exact = Fraction(gain)
    exponent = math.floor(math.log10(gain)) - request.digits + 1
    unit = Fraction(10) ** exponent
    return min(math.ceil(exact / unit) * unit, request.caps.get(agent, math.ceil(exact / unit) * unit))


def _structure_statements(ground: Ground, structure: Structure) -> tuple[Statement, ...]:
    if not structure.exact:
        return ()
    count, agents = structure.least, ground.problem.network.labels
    example = name_agents([agents[i] for i in structure.agents])
    return (
        Statement(
            kind="structure",
            verdict=Verdict.PROVED,
            exact={"least": str(count)},
            text=f"Structural minimum: {count} pin{'s' if count > 1 else ''}, one for each group that listens to nobody"
            f" outside ({len(structure.groups)} over all modes); {example} would do for that.",
        ),
    )


def _ties(ground: Ground, proposals: PinningProposals, chosen: tuple[int, ...], choice: Choice) -> tuple[str, ...]:
    labels = ground.problem.network.labels
    pairs = proposals.replaceable(chosen, ground.request.allowed, float(ground.request.rate))
    others: dict[int, list[str]] = {}
    for agent, other in pairs:
        others.setdefault(agent, []).append(labels[other])
    single = [
        f"In place of agent {labels[agent]}, {name_agents(names)} would cost the same (to six digits)."
        for agent, names in others.items()
    ]
    known = {tuple(sorted({*chosen, other} - {agent})) for agent, other in pairs}
    rest = [name_agents([labels[i] for i in rival]) for rival in choice.rivals if rival not in known]
    if rest:
        single.append(
            f"As good (to six digits) among the sets that were met: {'; '.join(rest[:SHOWN])}"
            + (f"; and {len(rest) - SHOWN} more." if len(rest) > SHOWN else ".")
        )
    return tuple(single)


def without_gains(ground: Ground, structure: Structure, obstacle: Statement | None) -> PinningDesign:
    """REFUTED by the obstacle; UNDECIDED without one."""
    least = structure.least if structure.exact else None
    if obstacle is None:
        return PinningDesign(
            verdict=Verdict.UNDECIDED,
            request=ground.request,
            gains={},
            structural_minimum=least,
            reason="no gains were found that are proved to reach the rate, and no proof that there are none.",
        )
    return PinningDesign(
        verdict=Verdict.REFUTED,
        request=ground.request,
        gains={},
        structural_minimum=least,
        reason=obstacle.text,
        statements=(obstacle,),
    )


def _short(bound: Fraction) -> Fraction:
    """The bound as a number of nine digits, not larger."""
    return claimed(shorten(bound))


def _names(ground: Ground, group: Sequence[int]) -> str:
    return ", ".join(ground.problem.network.labels[i] for i in group[:50])
