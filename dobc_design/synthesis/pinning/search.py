"""From a request to a PinningDesign: refute what is impossible, prove gains, bound what is cheaper.

Near the consensus, by V = e'e or by V = e'De.  Which agents to pin is decided in ``choose``; gains
over a region are designed in ``search_regions``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import TypeVar

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import carriers, name_agents
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.numbers import bisected, claimed, rounded_up, shorten
from dobc_design.conditions.statement import Statement, proved, refuted
from dobc_design.conditions.weighted.decide import network_holds, why_not
from dobc_design.conditions.weighted.propose import network_claim
from dobc_design.errors import refused
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, shown_number
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning import decide
from dobc_design.verdict import Verdict

from .choose import Choice
from .claim import (
    FEWEST,
    Agents,
    AgentSet,
    Alternatives,
    Gains,
    Limits,
    PinningDesign,
    PinningRequest,
    Structure,
    holding,
    typed_gains,
    with_gains,
    without_gains,
)
from .decide import Ground
from .propose import PinningProposer, make_proposer, slow_directions

# of the last digit but two: how much faster a rate is designed for
TILTS = (1, 10, 1000, Fraction(1, 100))
LONGEST = 400  # entries of a witness that a statement writes out
MOST_CAPS = 1e6  # times the caps that were asked for
# rates faster than asked
WEIGHTED_TILTS = (Fraction(1, 10**6), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
# ways from what every mode needs by itself to gains for V = e'e,
MIXED = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8)
MORE = 4  # or to so many times as much
AS_WRITTEN = "for the gains as they are written."
Asked = TypeVar("Asked", bound=Limits)
#: The agents to pin, and what was proved of the choice; no choice where so few cannot do.
Chosen = tuple[Choice | None, tuple[Statement, ...]]


@noun
class Task:
    """One request: what decides it (``ground``), what proposes gains for V = e'e (``plain``, with
    the problem without gains), and which groups of agents need a pin."""

    ground: Ground
    plain: PinningProposer
    structure: Structure
    progress: Progress

    @property
    def request(self) -> PinningRequest:
        """What is asked."""
        return self.ground.request

    @property
    def rate(self) -> float:
        """The rate asked for (1/s), for proposals."""
        return float(self.request.rate)

    @property
    def bare(self) -> Problem:
        """The problem without gains."""
        return self.plain.problem

    def asking(self, request: PinningRequest) -> Task:
        """The same problem with another request."""
        return Task(
            ground=replace(self.ground, request=request),
            plain=make_proposer(self.bare, request) or self.plain,
            structure=decide.structure_of(self.bare, request.allowed),
            progress=self.progress,
        )

    def fails(self, obstacle: Statement | None) -> PinningDesign:
        """No gains, because of the obstacle, or because none were found (None)."""
        return without_gains(self.request, self.structure, obstacle)


def search_pinning(problem: Problem, request: PinningRequest, progress: Progress) -> PinningDesign:
    """Decide a request, with the nearest possible one.  Raises: SpecError for couplings without a
    derivative."""
    bare = changed_problem(problem, {"pinning.gains": None})
    statements = state_theorems(loop_of(bare))
    proposer = None
    if not statements.inapplicable:
        proposer = make_proposer(bare, request)
    if proposer is None:
        why = statements.inapplicable or "an entry of J + J is too large."
        must = "coupling must have a derivative at the consensus that floats can hold"
        raise refused(
            "coupling.h",
            f"{must}, because gains are designed for the linearisation; {why}",
            "Use a smooth coupling, such as tanh(y).",
        )
    lambdas = {mode: enclosed_lambda(statements, mode) for mode in statements.lambdas}
    task = Task(
        ground=Ground(problem=problem, request=request, lambdas=lambdas),
        plain=proposer,
        structure=decide.structure_of(bare, request.allowed),
        progress=progress,
    )
    # Where J is symmetric, V = e'e has the true rate already.
    weights_help = why_not(statements) is None and not decide.is_undirected(statements)
    attempt = _weighted_attempt if weights_help and not request.conservative else _attempt
    found = attempt(task)
    if found.is_proved:
        return found
    for weaker in _weaker(task, found.obstacle):
        nearest = attempt(task.asking(weaker))
        if nearest.is_proved:
            return replace(found, nearest=nearest)
    return found


def _attempt(task: Task) -> PinningDesign:
    """Decide by V = e'e, with a proved bound of what is cheaper."""
    request = task.request
    obstacle = decide.structural_obstacle(task.bare, request.pins, task.structure)
    obstacle = obstacle or _too_fast(task)
    if obstacle is not None:
        return task.fails(obstacle)
    if request.pins is None:
        return _designed(task, request.allowed)
    choice, statements = _chosen(task)
    if choice is None or choice.agents is None:
        refutations = [each for each in statements if each.verdict is Verdict.REFUTED]
        return task.fails(next(iter(refutations), None))
    return _designed(task, choice.agents, choice, statements)


def _weighted_attempt(task: Task) -> PinningDesign:
    """Decide by V = e'De on the agents that either V would choose; gains for V = e'e stand in,
    without their bounds."""
    bare = task.bare
    request = task.request
    obstacle = decide.structural_obstacle(bare, request.pins, task.structure)
    obstacle = obstacle or decide.too_fast(bare, request, slow_directions)
    proposer = make_proposer(bare, request, weighted=True)
    if obstacle is not None or proposer is None:
        return task.fails(obstacle)
    # Its gains stand in where no weights are proved, and its agents are worth a look.
    plain = _attempt(task)
    sets = [request.allowed]
    if request.pins is not None:
        task.progress("looking for the agents that a gain helps most")
        sets = _promising(task, proposer, plain)
    task.progress("proving the gains")
    designs = []
    for agents in dict.fromkeys(filter(None, sets)):
        found = _with_weights(task, proposer, agents)
        if found is not None:
            designs.append(found)
    if plain.is_proved:
        designs.append(_unbounded(plain))
    if not designs:
        return task.fails(None)
    # Fewer pins count more than cheaper ones only where the fewest are asked for.
    if request.pins != FEWEST:
        return min(designs, key=lambda design: design.cost or 0)
    best = min(designs, key=lambda design: (len(design.gains), design.cost or 0))
    return replace(best, statements=(*best.statements, _fewest_in(task, len(best.gains))))


def _promising(task: Task, proposer: PinningProposer, plain: PinningDesign) -> list[Agents]:
    """Sets of agents that are worth a proof by V = e'De: those of V = e'e, and the greedy ones."""
    request = task.request
    allowed = request.allowed
    most = request.pins if isinstance(request.pins, int) else None
    index = task.bare.network.index
    own = tuple(sorted(index[label] for label in plain.gains))
    greedy = proposer.greedy(allowed, task.structure.groups, task.rate, most)
    if not greedy:
        greedy = proposer.cheapest(allowed, most or len(allowed), task.rate)
    return [own, greedy]


def _fewest_in(task: Task, pins: int) -> Statement:
    """Whether fewer pins are excluded by the graph, or one by one."""
    request = task.request
    needed = max(1, task.structure.least)
    if pins > needed:
        fewer = replace(request, pins=pins - 1)
        if decide.too_fast(task.bare, fewer, slow_directions) is not None:
            needed = pins
    return decide.fewest(pins, needed)


def _unbounded(design: PinningDesign) -> PinningDesign:
    """A design by V = e'e without what holds for V = e'e alone."""
    kept = [each for each in design.statements if each.kind in ("rate", "structure")]
    return replace(
        design,
        statements=tuple(kept),
        lower_bound=None,
        bound=None,
        bound_for=(),
        alternatives=None,
    )


def _with_weights(task: Task, proposer: PinningProposer, agents: AgentSet) -> PinningDesign | None:
    """The smallest gains found on these agents for which weights of V are proved; None if none
    are."""
    request = task.request
    several = len(task.ground.lambdas) > 1
    for tilt in WEIGHTED_TILTS:
        speed = float(request.rate * (1 + tilt))
        least = proposer.relax(agents, speed)[0]
        if least is None:
            continue
        # What every mode needs by itself may not do for all; gains for V = e'e do.
        most = task.plain.relax(agents, speed)[0] if several else None
        if most is None:
            most = [MORE * k for k in least]
        # The first that is proved is the cheapest of them.
        for part in MIXED if several else MIXED[:1]:
            mixed = {i: least[i] + part * (most[i] - least[i]) for i in agents}
            gains = typed_gains(mixed, request)
            found = _proved_by_weights(task, gains)
            if found is not None:
                return found
    return None


def _proved_by_weights(task: Task, gains: Gains) -> PinningDesign | None:
    """The design of these gains, if weights of V = e'De are proved for them."""
    if not gains:
        return None
    request = task.request
    held = holding(task.ground.problem, gains)
    claim = network_claim(loop_of(held), task.rate)
    if claim is None or not network_holds(claim, state_theorems(loop_of(held)), rate=request.rate):
        return None
    rate = number_text(request.rate)
    decay = f"V' <= -2 ({rate}) V near the target in every mode, {AS_WRITTEN}"
    text = f"V = e'De with a weight for each agent: {decay}"
    design = with_gains(request, task.structure, gains, held)
    return replace(design, weights=claim, statements=(proved("rate", text, rate=rate),))


def _too_fast(task: Task) -> Statement | None:
    """A proof that even gains on all allowed agents, at their caps, do not reach the rate."""
    request = task.request
    allowed = request.allowed
    gains, vectors = task.plain.relax(allowed, task.rate)
    if gains is not None:
        return None
    obstacle = decide.obstacle_to(task.ground, allowed, vectors)
    if obstacle is None:
        return None
    mode, v = obstacle
    labels = task.bare.network.labels
    moved = carriers(loop_of(task.bare), v)
    capped = {labels[i] for i in set(allowed) & set(request.caps)}
    if capped & set(moved):
        kind = "max_gain"
        because = "even with every gain at its cap the direction shown decays more slowly"
    else:
        kind = "rate"
        still = "the direction shown moves none of the agents that may be pinned"
        because = f"{still}, and decays more slowly by itself"
    where = f" in mode {mode}" if len(task.ground.lambdas) > 1 else ""
    none = f"no gains reach the rate {shown_number(request.rate)}{where}"
    text = f"{none}: {because}. It involves {name_agents(moved)}."
    if len(v) > LONGEST:
        return refuted(kind, text, mode=mode)
    return refuted(kind, text, mode=mode, v=", ".join(map(number_text, v)))


def _chosen(task: Task) -> Chosen:
    """The agents to pin: at most so many, or the fewest."""
    request = task.request
    pins = request.pins
    slow = task.plain.slow(task.rate)
    needed = max(task.structure.least, decide.pins_needed(task.ground, slow))
    if not isinstance(pins, int):
        return _fewest_chosen(task, needed)
    if pins < needed:
        few = f"{counted(pins, 'pin')} cannot do at this rate: at least {needed} are needed"
        why = "So many independent directions are slower than that without gains"
        text = f"{few}. {why}, and each pin holds one of them."
        return None, (refuted("pins", text, least=str(needed)),)
    choice = _choice(task, pins, start=_greedy(task, pins))
    return choice, (choice.statement(),)


def _fewest_chosen(task: Task, needed: int) -> Chosen:
    """The fewest agents, from those that are needed at least up to as many as a greedy set has."""
    start = _greedy(task, None)
    enough = len(task.request.allowed) if start is None else len(start)
    for number in range(max(1, needed), enough):
        task.progress(f"looking for {counted(number, 'agent')} that will do")
        choice = _choice(task, number)
        if choice.agents is not None:
            return choice, (decide.fewest(len(choice.agents), needed), choice.statement())
        # Neither found nor excluded: larger sets would say nothing about fewer.
        if not choice.impossible:
            break
        needed = number + 1
    if start is None:
        start = _greedy(task, enough)
    choice = _choice(task, enough, start=start)
    return choice, (decide.fewest(len(choice.agents or ()), needed), choice.statement())


def _greedy(task: Task, pins: int | None) -> Agents | None:
    return task.plain.greedy(task.request.allowed, task.structure.groups, task.rate, pins)


def _choice(task: Task, pins: int, *, start: Agents | None = None) -> Choice:
    return Choice(
        ground=task.ground,
        proposer=task.plain,
        progress=task.progress,
        pins=pins,
        groups=task.structure.groups,
        start=start,
    )


def _designed(
    task: Task,
    agents: AgentSet,
    choice: Choice | None = None,
    chosen: tuple[Statement, ...] = (),
) -> PinningDesign:
    """The cheapest gains on these agents, proved, with what they cost at least, and what was proved
    of the choice of the agents."""
    task.progress("proving the gains and their bound")
    request = task.request
    structure = task.structure
    gains = _proved_gains(task, agents)
    if gains is None:
        return task.fails(None)
    vectors = task.plain.relax(agents, task.rate)[1]
    bound = decide.bound_from(task.ground, vectors, agents)
    lower_bound = bound.value
    alternatives = None
    if choice is not None:
        # The bound holds for every set of so many agents, not for these alone.
        lower_bound = claimed(shorten(choice.bound))
        alternatives = _alternatives(task, tuple(gains), choice)
    rate = number_text(request.rate)
    text = f"Lambda < -2 ({rate}) I in every mode, {AS_WRITTEN}"
    statements = [proved("rate", text, rate=rate)]
    labels = task.bare.network.labels
    if structure.exact:
        # How many pins the graph alone asks for.
        least = counted(structure.least, "pin")
        each = f"{least}, one for each group that listens to nobody outside"
        example = name_agents([labels[i] for i in structure.agents])
        modes = f"{len(structure.groups)} over all modes"
        text = f"Structural minimum: {each} ({modes}); {example} would do for that."
        statements.append(proved("structure", text, least=str(structure.least)))
    design = with_gains(request, structure, gains, holding(task.ground.problem, gains))
    return replace(
        design,
        lower_bound=lower_bound,
        bound=bound,
        bound_for=tuple(labels[i] for i in agents),
        statements=(*statements, *chosen),
        alternatives=alternatives,
    )


def _proved_gains(task: Task, agents: AgentSet) -> Gains | None:
    """Gains for a rate a little faster, rounded up, that are proved for the rate asked."""
    request = task.request
    digit = max(Fraction(1, 10 ** (request.digits + 2)), Fraction(1, 10**10))
    for tilt in TILTS:
        speed = float(request.rate * (1 + digit * tilt))
        proposed = task.plain.relax(agents, speed)[0]
        if proposed is None or not agents:
            continue
        gains = typed_gains({i: proposed[i] for i in agents}, request)
        if decide.reaches(task.ground, gains):
            return gains
    return None


def _alternatives(task: Task, pinned: Agents, choice: Choice) -> Alternatives:
    """Other agents and sets that cost the same to six digits."""
    labels = task.bare.network.labels
    others = dict[str, list[str]]()
    known = set()
    for own, other in task.plain.replaceable(pinned, task.request.allowed, task.rate):
        others.setdefault(labels[own], []).append(labels[other])
        exchanged = {*pinned, other} - {own}
        known.add(tuple(sorted(exchanged)))
    rivals = []
    for rival in choice.rivals:
        if rival not in known:
            rivals.append([labels[i] for i in rival])
    return Alternatives(others=others, rivals=rivals)


def _weaker(task: Task, obstacle: Statement | None) -> Iterator[PinningRequest]:
    """Requests with one thing given up as far as needed, first what the refutation is about."""
    request = task.request
    n = task.bare.n
    kind = None if obstacle is None else obstacle.kind
    if kind == "structure":
        request = with_lacking(task.bare, request)
        yield request
        yield replace(request, pins=None if request.pins is None else FEWEST)
    if kind == "pins":
        yield replace(request, pins=FEWEST)
    if request.caps:
        factor = _larger_caps(task.plain, request)
        if factor is not None:
            caps = {i: rounded_up(cap * factor, digits=4) for i, cap in request.caps.items()}
            yield replace(request, caps=caps)
    fastest = task.plain.fastest(request.allowed)
    if 0 < fastest < math.inf:
        # At the fastest rate itself gains grow without bound.
        for part in (0.99, 0.9):
            rate = claimed(shorten(fastest * part, digits=3))
            if 0 < rate < request.rate:
                yield replace(request, rate=rate)
    if len(request.allowed) < n:
        yield replace(request, allowed=tuple(range(n)))


def _larger_caps(proposer: PinningProposer, request: PinningRequest) -> Fraction | None:
    """By how much all caps have to grow, about and a little more; None if growing does not help."""

    def enough(factor: float) -> bool:
        return proposer.fastest(request.allowed, factor) > float(request.rate)

    if not enough(MOST_CAPS):
        return None
    factor, _ = bisected(
        enough,
        MOST_CAPS,
        1.0,
        middle=lambda high, low: math.sqrt(low * high),
        close=lambda high, low: not high > low * 1.001,
    )
    return Fraction(factor * 1.001)


def with_lacking(problem: Problem, request: Asked) -> Asked:
    """The request with its allowed agents, and all of every group that has none of them."""
    allowed = request.allowed
    agents = set(allowed)
    for group in decide.structure_of(problem, allowed).groups:
        if not set(allowed) & set(group):
            agents |= set(group)
    return replace(request, allowed=tuple(sorted(agents)))
