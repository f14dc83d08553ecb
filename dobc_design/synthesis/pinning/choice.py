"""Which agents to pin, at most so many: branch and bound in which every bound is exact.

A node fixes agents that are pinned and agents that are not; all other allowed agents may have a gain, which costs no
more than any set of the node.  Its bound is a proved one (``pinning_bound``), or the node is proved impossible.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.synthesis.pinning.bound import Ground, Vectors, bound_from, obstacle_to
from dobc_design.synthesis.pinning.structure import packing

Relax = Callable[[Collection[int], float], tuple[Sequence[float] | None, Vectors]]
WORK = 60_000  # nodes times agents, of few agents
FEW, MOST_WORK = 300, 18_000_000  # up to so many; then nodes times squared agents, for a node takes a solve
ALIKE = Fraction(1, 10**7)  # bounds this close (relatively) to the best cost close a node
REPORTED = 20  # nodes between two reports
MOST_RIVALS = 10_000  # sets whose cost is kept
SIX_DIGITS = 1e-6  # costs that differ by less (relatively) are alike
SUPPORT = 1e-7  # gains below this part of the largest pin nobody


@dataclass(frozen=True, slots=True, kw_only=True)
class PinningProposals:
    """Where proposals come from.

    ``relax(allowed, rate)``: gains and multipliers.  ``greedy(allowed, groups, rate, pins)``: a set of agents.
    ``replaceable(chosen, allowed, rate)``: pairs that tie.  ``fastest(allowed, factor)``: the largest rate, about,
    with all caps times ``factor``.  ``slow(rate)``: of every mode the directions that are slower without any gain.
    ``progress`` is called with what is being done.
    """

    relax: Relax
    greedy: Callable[[Sequence[int], Sequence[Sequence[int]], float, int | None], tuple[int, ...] | None]
    replaceable: Callable[[Sequence[int], Sequence[int], float], Sequence[tuple[int, int]]]
    fastest: Callable[[Collection[int], float], float]
    slow: Callable[[float], Vectors]
    progress: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """``agents``: the cheapest set found, or None; ``cost`` about.  ``bound``: no set of so many costs less (proved).

    ``rivals``: other sets that were met and cost the same to six digits.

    ``impossible``: proved that no such set reaches the rate.  ``nodes``: how many were looked at; ``finished``: whether
    none was left open.
    """

    agents: tuple[int, ...] | None
    cost: float
    bound: Fraction
    impossible: bool
    finished: bool
    nodes: int
    rivals: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    inside: frozenset[int]
    outside: frozenset[int]
    bound: Fraction
    support: tuple[int, ...]  # agents with a gain at the optimum of the node, the largest gain first


def choose(
    ground: Ground,
    proposals: PinningProposals,
    rate: Fraction,
    pins: int,
    groups: Sequence[Sequence[int]],
    start: Collection[int] | None = None,
) -> Choice:
    """The cheapest set of at most ``pins`` allowed agents at this rate, with a proved bound.

    ``start``: a set to begin with.  ``groups``: each needs a pin.
    """
    search = _Search(ground=ground, proposals=proposals, rate=rate, pins=pins, groups=groups)
    if start is not None:
        search.try_set(start)
    root = search.node(frozenset(), frozenset(), Fraction(0))
    if root is not None:
        search.add(root)
    search.run(_nodes(ground.problem.n))
    return search.result()


def _nodes(agents: int) -> int:
    """How many nodes are worth the time."""
    return max(50, WORK // agents) if agents <= FEW else max(1, MOST_WORK // agents**2)


class _Search:
    """The open nodes, lowest bound first; what closed nodes proved."""

    def __init__(
        self, *, ground: Ground, proposals: PinningProposals, rate: Fraction, pins: int, groups: Sequence[Sequence[int]]
    ) -> None:
        self.ground, self.rate, self.pins, self.groups = ground, rate, pins, groups
        self.relax, self.progress = proposals.relax, proposals.progress
        self.allowed = frozenset(ground.request.allowed)
        self.heap: list[tuple[Fraction, int, _Node]] = []
        self.best: tuple[float, tuple[int, ...]] | None = None
        self.closed: Fraction | None = None  # the lowest bound of a closed node that is not impossible
        self.count = 0
        self.met: dict[tuple[int, ...], float] = {}

    def try_set(self, agents: Collection[int]) -> None:
        gains = self.relax(agents, float(self.rate))[0]
        if gains is not None:
            cost = sum(float(c) * k for c, k in zip(self.ground.request.costs, gains, strict=True))
            if len(self.met) < MOST_RIVALS:
                self.met[tuple(sorted(agents))] = cost
            if self.best is None or cost < self.best[0]:
                self.best = cost, tuple(sorted(agents))

    def node(self, inside: frozenset[int], outside: frozenset[int], above: Fraction) -> _Node | None:
        """The node with its exact bound; None if it is proved impossible.  ``above``: the bound of its parent."""
        if len(inside) + packing([set(group) - outside for group in self.groups], inside) > self.pins:
            return None
        self.count += 1
        left = inside if len(inside) >= self.pins else self.allowed - outside
        gains, vectors = self.relax(left, float(self.rate))
        if gains is None:
            if obstacle_to(self.ground, left, self.rate, vectors) is not None:
                return None
            return _Node(inside=inside, outside=outside, bound=above, support=())
        bound = max(above, bound_from(self.ground, vectors, left, self.rate).value)
        top = max(gains)
        support = [agent for agent in left if gains[agent] > SUPPORT * top]
        order = tuple(sorted(support, key=lambda agent: (-gains[agent], agent)))
        return _Node(inside=inside, outside=outside, bound=bound, support=order)

    def add(self, node: _Node) -> None:
        """Open a node, or close it: everything in it is known, or not better than the best set."""
        free = [agent for agent in node.support if agent not in node.inside]
        if node.support:
            room = self.pins - len(node.inside)
            self.try_set(node.inside | set(free[:room]) if len(node.support) > self.pins else node.support)
        done = len(node.support) <= self.pins or len(node.inside) >= self.pins or not free
        if done or self.is_beaten(node):
            self.close(node)
        else:
            heapq.heappush(self.heap, (node.bound, self.count, node))

    def close(self, node: _Node) -> None:
        self.closed = node.bound if self.closed is None else min(self.closed, node.bound)

    def is_beaten(self, node: _Node) -> bool:
        return self.best is not None and node.bound >= Fraction(self.best[0]) * (1 - ALIKE)

    def run(self, most: int) -> None:
        while self.heap and self.count < most:
            node = heapq.heappop(self.heap)[2]
            if self.is_beaten(node):
                self.close(node)
                continue
            if self.count % REPORTED == 0:
                self.progress(f"comparing sets of agents ({self.count} parts of the choice so far)")
            agent = next(agent for agent in node.support if agent not in node.inside)
            for inside, outside in ((node.inside | {agent}, node.outside), (node.inside, node.outside | {agent})):
                child = self.node(inside, outside, node.bound)
                if child is not None:
                    self.add(child)

    def result(self) -> Choice:
        bounds = [node.bound for _, _, node in self.heap] + ([] if self.closed is None else [self.closed])
        cost, agents = (float("inf"), None) if self.best is None else self.best
        rivals = tuple(sorted(x for x, value in self.met.items() if x != agents and value <= cost * (1 + SIX_DIGITS)))
        return Choice(
            agents=agents,
            cost=cost,
            bound=min(bounds, default=Fraction(0)),
            nodes=self.count,
            rivals=rivals,
            impossible=not bounds and agents is None,
            finished=not self.heap or all(self.is_beaten(node) for _, _, node in self.heap),
        )
