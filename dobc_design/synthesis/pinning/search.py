"""From a request at the consensus to a PinningDesign: refute what is impossible, prove gains, bound what is cheaper.

Which agents to pin, at most so many: branch and bound in which every bound is exact.  A node fixes agents that are
pinned and agents that are not; all other allowed agents may have a gain, which costs no more than any set of the node.
Its bound is a proved one, or the node is proved impossible.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.network import Enclosed, carriers, name_agents
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.statement import Statement, proved, refuted
from dobc_design.errors import SpecError
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.claim import PinningDesign, Structure, prices_in_words, without_gains
from dobc_design.synthesis.pinning.decide import (
    Ground,
    bound_from,
    obstacle_to,
    packing,
    pins_needed,
    reaches,
    structural_obstacle,
    structure_of,
)
from dobc_design.synthesis.pinning.propose import PinningProposer, make_proposer
from dobc_design.synthesis.pinning.request import FEWEST, PinningRequest, cost_of, rounded_up, typed_gains
from dobc_design.verdict import Verdict

TILTS = (1, 10, 1000, Fraction(1, 100))  # of the last digit but two: how much faster a rate is designed for
SHOWN = 5  # ties put into words
LONGEST = 400  # entries of a witness that a statement writes out
Progress = Callable[[str], None]
WORK = 60_000  # nodes times agents, of few agents
FEW, MOST_WORK = 300, 18_000_000  # up to so many; then nodes times squared agents, for a node takes a solve
ALIKE = Fraction(1, 10**7)  # bounds this close (relatively) to the best cost close a node
REPORTED = 20  # nodes between two reports
MOST_RIVALS = 10_000  # sets whose cost is kept
SIX_DIGITS = 1e-6  # costs that differ by less (relatively) are alike
SUPPORT = 1e-7  # gains below this part of the largest pin nobody


def search_pinning(problem: Problem, request: PinningRequest, progress: Progress) -> PinningDesign:
    """Decide a request: PROVED with gains, REFUTED with the reason, or UNDECIDED; with the nearest possible request.

    Raises: SpecError for couplings without a derivative at the consensus.
    """
    bare = changed_problem(problem, {"pinning.gains": None})
    statements = state_theorems(bare)
    proposer = None if statements.inapplicable else make_proposer(bare, request)
    if proposer is None:
        raise SpecError(
            "coupling must have a derivative at the consensus that floats can hold, because gains are designed for"
            f" the linearisation; {statements.inapplicable or 'an entry of J + J is too large.'}",
            key="coupling.h",
            cure="Use a smooth coupling, such as tanh(y).",
        )
    lambdas = {
        mode: Enclosed(middle=each.constant, deviations=each.deviations) for mode, each in statements.lambdas.items()
    }
    ground = Ground(problem=problem, request=request, lambdas=lambdas)
    found = _attempt(ground, proposer, progress)
    if found.verdict is Verdict.PROVED:
        return found
    kind = found.statements[0].kind if found.statements else None
    for weaker in _weaker(ground, proposer, kind):
        other = make_proposer(bare, weaker) or proposer
        nearest = _attempt(replace(ground, request=weaker), other, progress)
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=nearest)
    return found


def _attempt(ground: Ground, proposer: PinningProposer, progress: Progress) -> PinningDesign:
    request = ground.request
    structure = structure_of(ground.problem, request.allowed)
    obstacle = structural_obstacle(ground.problem, request.pins, structure) or _too_fast(ground, proposer)
    if obstacle is not None:
        return without_gains(ground.request, structure, obstacle)
    agents, choice, statements = request.allowed, None, tuple[Statement, ...]()
    if request.pins is not None:
        choice, statements = _chosen(ground, proposer, structure, progress)
        if choice is None or choice.agents is None:
            refuted = next((each for each in statements if each.verdict is Verdict.REFUTED), None)
            return without_gains(ground.request, structure, refuted)
        agents = choice.agents
    progress("proving the gains and their bound")
    return _designed(ground, proposer, structure, agents, choice=choice, more=statements)


def _too_fast(ground: Ground, proposer: PinningProposer) -> Statement | None:
    """A proof that even gains on all allowed agents, at their caps, do not reach the rate."""
    request = ground.request
    gains, vectors = proposer.relax(request.allowed, float(request.rate))
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
    return refuted(
        "max_gain" if capped else "rate",
        f"no gains reach the rate {shown_number(request.rate)}{where}: {because}. It is carried by"
        f" {name_agents(moved)}.",
        mode=obstacle.mode,
        **values,
    )


def _chosen(
    ground: Ground, proposer: PinningProposer, structure: Structure, progress: Progress
) -> tuple[Choice | None, tuple[Statement, ...]]:
    """The agents to pin: at most so many, or the fewest."""
    request, rate, groups = ground.request, float(ground.request.rate), structure.groups
    needed = max(structure.least, pins_needed(ground, request.rate, proposer.slow(rate)))
    if isinstance(request.pins, int):
        if request.pins < needed:
            pins = f"{request.pins} pin{'s' if request.pins > 1 else ''}"
            text = (
                f"{pins} cannot do at this rate: at least {needed} are needed. So many independent directions are"
                " slower than that without gains, and each pin holds one of them."
            )
            return None, (refuted("pins", text, least=str(needed)),)
        start = proposer.greedy(request.allowed, groups, rate, request.pins)
        choice = Choice(ground, proposer, progress, request.pins, groups, start)
        return choice, (choice.statement(),)
    start = proposer.greedy(request.allowed, groups, rate, None)
    enough = len(request.allowed) if start is None else len(start)
    for number in range(max(1, needed), enough):
        progress(f"looking for {counted(number, 'agent')} that will do")
        choice = Choice(ground, proposer, progress, number, groups)
        if choice.agents is not None:
            return choice, (_fewest(len(choice.agents), needed), choice.statement())
        if not choice.impossible:
            break
        needed = number + 1
    start = proposer.greedy(request.allowed, groups, rate, enough) if start is None else start
    choice = Choice(ground, proposer, progress, enough, groups, start)
    return choice, (_fewest(len(choice.agents or ()), needed), choice.statement())


def _fewest(pins: int, needed: int) -> Statement:
    if pins <= needed:
        return proved("pins", f"No fewer than {counted(pins, 'pinned agent')} reach this rate.", least=str(pins))
    text = f"{pins} pinned agents do; whether fewer do was not decided, but at least {needed} are needed."
    return Statement(kind="pins", verdict=Verdict.UNDECIDED, text=text, exact={"least": str(needed)})


def _designed(
    ground: Ground,
    proposer: PinningProposer,
    structure: Structure,
    agents: Sequence[int],
    *,
    choice: Choice | None,
    more: tuple[Statement, ...] = (),
) -> PinningDesign:
    request, labels = ground.request, ground.problem.network.labels
    gains = _proved_gains(ground, proposer, agents)
    if gains is None:
        return without_gains(ground.request, structure, None)
    vectors = proposer.relax(agents, float(request.rate))[1]
    bound = bound_from(ground, vectors, agents, request.rate)
    least = bound.value if choice is None else claimed(shorten(choice.bound))
    cost = cost_of(request, gains)
    pinned = tuple(labels[i] for i in gains)
    rate = number_text(request.rate)
    statements = [
        proved("rate", f"Lambda < -2 ({rate}) I in every mode, for the gains as they are written.", rate=rate)
    ]
    if structure.exact:
        count = structure.least
        example = name_agents([labels[i] for i in structure.agents])
        text = (
            f"Structural minimum: {count} pin{'s' if count > 1 else ''}, one for each group that listens to nobody"
            f" outside ({len(structure.groups)} over all modes); {example} would do for that."
        )
        statements.append(proved("structure", text, least=str(count)))
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
        statements=(*statements, *more),
        prices=tuple(prices_in_words(ground.problem, request, bound, dict.fromkeys(agents))),
        ties=() if choice is None else _ties(ground, proposer, tuple(gains), choice),
        problem=changed_problem(ground.problem, {"pinning.gains": {labels[i]: k for i, k in gains.items()}}),
        reason=f"gains on {name_agents(pinned)} reach the rate {shown_number(request.rate)} at the cost"
        f" {float(cost):.6g}, and nothing that does costs less than {shorten(least, digits=6):.6g}.",
    )


def _proved_gains(ground: Ground, proposer: PinningProposer, agents: Sequence[int]) -> dict[int, Fraction] | None:
    """Gains for a rate a little faster, rounded up, that are proved for the rate asked."""
    request = ground.request
    for tilt in TILTS:
        part = max(Fraction(1, 10 ** (request.digits + 2)), Fraction(1, 10**10)) * tilt
        gains, vectors = proposer.relax(agents, float(request.rate * (1 + part)))
        if gains is None:
            continue
        rounded = typed_gains({i: gains[i] for i in agents}, digits=request.digits, caps=request.caps)
        if reaches(ground, rounded, request.rate, hints=vectors):
            return rounded
    return None


def _ties(ground: Ground, proposer: PinningProposer, chosen: tuple[int, ...], choice: Choice) -> tuple[str, ...]:
    labels = ground.problem.network.labels
    pairs = proposer.replaceable(chosen, ground.request.allowed, float(ground.request.rate))
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    inside: frozenset[int]
    outside: frozenset[int]
    bound: Fraction
    support: tuple[int, ...]  # agents with a gain at the optimum of the node, the largest gain first


class Choice:
    """The cheapest set of at most ``pins`` allowed agents at the rate asked, with a proved bound.

    ``agents``: the cheapest set found, or None; ``cost`` about.  ``bound``: no set of so many costs less (proved).
    ``impossible``: proved that no such set reaches the rate.  ``rivals``: other sets that were met and cost the same to
    six digits.  ``start``: a set to begin with.  ``groups``: each needs a pin.
    """

    def __init__(
        self,
        ground: Ground,
        proposer: PinningProposer,
        progress: Progress,
        pins: int,
        groups: Sequence[Sequence[int]],
        start: Collection[int] | None = None,
    ) -> None:
        self.ground, self.proposer, self.pins, self.groups = ground, proposer, pins, groups
        self.agents: tuple[int, ...] | None = None
        self.cost = float("inf")
        self._heap: list[tuple[Fraction, int, _Node]] = []  # open nodes, the lowest bound first
        self._closed: list[Fraction] = []  # bounds of closed nodes that are not impossible
        self._nodes = 0
        self._met: dict[tuple[int, ...], float] = {}
        if start is not None:
            self._try_set(start)
        self._add(frozenset(), frozenset(), Fraction(0))
        n = ground.problem.n
        most = max(50, WORK // n) if n <= FEW else max(1, MOST_WORK // n**2)
        while self._heap and self._nodes < most:
            node = heapq.heappop(self._heap)[2]
            if self._is_beaten(node):
                self._closed.append(node.bound)
                continue
            if self._nodes % REPORTED == 0:
                progress(f"comparing sets of agents ({self._nodes} parts of the choice so far)")
            agent = next(agent for agent in node.support if agent not in node.inside)
            self._add(node.inside | {agent}, node.outside, node.bound)
            self._add(node.inside, node.outside | {agent}, node.bound)
        bounds = [node.bound for _, _, node in self._heap] + self._closed
        self.bound = min(bounds, default=Fraction(0))
        self.impossible = not bounds and self.agents is None

    @property
    def rivals(self) -> list[tuple[int, ...]]:
        most = self.cost * (1 + SIX_DIGITS)
        return sorted(agents for agents, cost in self._met.items() if agents != self.agents and cost <= most)

    def statement(self) -> Statement:
        """What is proved of all sets of so many agents."""
        if self.impossible:
            none = f"no {self.pins} of the allowed agents reach"
            none = "none of the allowed agents alone reaches" if self.pins == 1 else none
            text = (
                f"{none} this rate: every choice is excluded, {self._nodes} parts of the choice one by one, each by a"
                " direction that stays too slow or a group without a pin."
            )
            return refuted("pins", text, pins=str(self.pins), nodes=str(self._nodes))
        finished = all(self._is_beaten(node) for _, _, node in self._heap)
        how = "all choices compared" if finished else f"{self._nodes} parts of the choice looked at"
        agents = "one agent" if self.pins == 1 else f"at most {self.pins} agents"
        text = f"No gains on {agents} cost less than {shorten(self.bound, digits=6):.6g} ({how})."
        return proved("choice", text, bound=number_text(claimed(shorten(self.bound))))

    def _try_set(self, agents: Collection[int]) -> None:
        request = self.ground.request
        gains = self.proposer.relax(agents, float(request.rate))[0]
        if gains is not None:
            cost = sum(float(c) * k for c, k in zip(request.costs, gains, strict=True))
            if len(self._met) < MOST_RIVALS:
                self._met[tuple(sorted(agents))] = cost
            if cost < self.cost:
                self.cost, self.agents = cost, tuple(sorted(agents))

    def _add(self, inside: frozenset[int], outside: frozenset[int], above: Fraction) -> None:
        """Open a node with its exact bound, at least that of its parent; or close it.

        It is closed where it is proved impossible, or everything in it is known or not better than the best set.
        """
        request, pins = self.ground.request, self.pins
        if len(inside) + packing([set(group) - outside for group in self.groups], inside) > pins:
            return
        self._nodes += 1
        left = inside if len(inside) >= pins else frozenset(request.allowed) - outside
        gains, vectors = self.proposer.relax(left, float(request.rate))
        bound, support = above, tuple[int, ...]()
        if gains is not None:
            bound = max(above, bound_from(self.ground, vectors, left, request.rate).value)
            kept = [agent for agent in left if gains[agent] > SUPPORT * max(gains)]
            support = tuple(sorted(kept, key=lambda agent: (-gains[agent], agent)))
        elif obstacle_to(self.ground, left, request.rate, vectors) is not None:
            return
        node = _Node(inside=inside, outside=outside, bound=bound, support=support)
        free = [agent for agent in support if agent not in inside]
        if support:
            self._try_set(inside | set(free[: pins - len(inside)]) if len(support) > pins else support)
        if len(support) <= pins or len(inside) >= pins or not free or self._is_beaten(node):
            self._closed.append(bound)
        else:
            heapq.heappush(self._heap, (bound, self._nodes, node))

    def _is_beaten(self, node: _Node) -> bool:
        return self.agents is not None and node.bound >= Fraction(self.cost) * (1 - ALIKE)


def _weaker(ground: Ground, proposer: PinningProposer, kind: str | None) -> Iterator[PinningRequest]:
    """Requests with one thing given up as far as needed, what is binding first.

    ``kind``: what the refutation is about, "structure", "pins", "max_gain" or "rate"; None if nothing was refuted.
    """
    request = ground.request
    if kind == "structure":
        structure = structure_of(ground.problem, request.allowed)
        free = set(request.allowed)
        lacking = {i for group in structure.groups if not free & set(group) for i in group}
        request = replace(request, allowed=tuple(sorted(free | lacking)))
        yield request
        yield replace(request, pins=None if request.pins is None else FEWEST)
    if kind == "pins":
        yield replace(request, pins=FEWEST)
    if request.caps and (factor := _factor(request, proposer)) is not None:
        yield replace(request, caps={i: rounded_up(cap * factor, 4) for i, cap in request.caps.items()})
    fastest = proposer.fastest(request.allowed, 1.0)
    for part in (0.99, 0.9) if 0 < fastest < math.inf else ():
        rate = claimed(shorten(fastest * part, digits=3))
        if 0 < rate < request.rate:
            yield replace(request, rate=rate)
    if len(request.allowed) < ground.problem.n:
        yield replace(request, allowed=tuple(range(ground.problem.n)))


def _factor(request: PinningRequest, proposer: PinningProposer) -> Fraction | None:
    """By how much all caps must grow for the rate, about and a little more; None if that is of no use."""
    low, high, rate = 1.0, 1e6, float(request.rate)
    if not proposer.fastest(request.allowed, high) > rate:
        return None
    while high > low * 1.001:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if proposer.fastest(request.allowed, middle) > rate else (middle, high)
    return Fraction(high * 1.001)
