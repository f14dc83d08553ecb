"""Which agents to pin, at most so many: branch and bound in which every bound is exact.

A node fixes agents that are pinned and agents that are not; all other allowed agents may have a
gain, which costs no more than any set of the node. Its bound is a proved one, or the node is proved
impossible.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.numbers import claimed, shorten, text_below
from dobc_design.conditions.statement import Statement, proved, refuted
from dobc_design.exact.number import ZERO, number_text
from dobc_design.synthesis.pinning import decide

from .claim import Agents, AgentSet
from .decide import Ground
from .propose import PinningProposer

WORK = 60_000  # nodes times agents, of few agents
# up to so many; then nodes times squared agents, for a node takes a solve
FEW, MOST_WORK = 300, 18_000_000
ALIKE = Fraction(1, 10**7)  # bounds this close (relatively) to the best cost close a node
REPORTED = 20  # nodes between two reports
MOST_RIVALS = 10_000  # sets whose cost is kept
SIX_DIGITS = 1e-6  # costs that differ by less (relatively) are alike
SUPPORT = 1e-7  # gains below this part of the largest pin nobody


@noun
class _Node:
    inside: frozenset[int]
    outside: frozenset[int]
    bound: Fraction
    # agents with a gain at the optimum of the node, the largest gain first
    support: Agents


@dataclass(eq=False, kw_only=True)
class Choice:
    """The cheapest set of at most ``pins`` allowed agents at the rate asked, with a proved bound.
    ``agents``: the cheapest set found, or None; ``cost`` about.  ``bound``: no set of so many costs
    less (proved). ``impossible``: proved that no such set reaches the rate.  ``rivals``: other sets
    that were met and cost the same to six digits. ``start``: a set to begin with.  ``groups``: each
    needs a pin."""

    ground: Ground
    proposer: PinningProposer
    progress: Progress
    pins: int
    groups: Sequence[AgentSet]
    start: AgentSet | None = None
    agents: Agents | None = None
    cost: float = float("inf")
    # open nodes, the lowest bound first
    _heap: list[tuple[Fraction, int, _Node]] = field(default_factory=list)
    # bounds of closed nodes that are not impossible
    _closed: list[Fraction] = field(default_factory=list)
    _nodes: int = 0
    _met: dict[Agents, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.start is not None:
            self._try_set(self.start)
        self._add(frozenset(), frozenset(), ZERO)
        n = self.ground.problem.n
        most = max(50, WORK // n) if n <= FEW else max(1, MOST_WORK // n**2)
        while self._heap and self._nodes < most:
            node = heapq.heappop(self._heap)[2]
            if self._is_beaten(node):
                self._closed.append(node.bound)
            else:
                self._branch(node)
        bounds = [node.bound for _, _, node in self._heap] + self._closed
        self.bound = min(bounds, default=ZERO)
        self.impossible = not bounds and self.agents is None

    def _branch(self, node: _Node) -> None:
        """The free agent with the largest gain is pinned, or it is not."""
        inside = node.inside
        if self._nodes % REPORTED == 0:
            so_far = f"{self._nodes} parts of the choice so far"
            self.progress(f"comparing sets of agents ({so_far})")
        agent = next(agent for agent in node.support if agent not in inside)
        self._add(inside | {agent}, node.outside, node.bound)
        self._add(inside, node.outside | {agent}, node.bound)

    @property
    def rivals(self) -> list[Agents]:
        """Other sets that were met and cost the same to six digits."""
        most = self.cost * (1 + SIX_DIGITS)
        alike = {agents for agents, cost in self._met.items() if cost <= most}
        return sorted(alike - {self.agents})

    def statement(self) -> Statement:
        """What is proved of all sets of so many agents."""
        nodes = self._nodes
        pins = self.pins
        if self.impossible:
            none = f"no {pins} of the allowed agents reach"
            if pins == 1:
                none = "none of the allowed agents alone reaches"
            how = f"every choice is excluded, {nodes} parts of the choice one by one"
            by = "each by a direction that stays too slow or a group without a pin"
            return refuted(
                "pins", f"{none} this rate: {how}, {by}.", pins=str(pins), nodes=str(nodes)
            )
        finished = all(self._is_beaten(node) for _, _, node in self._heap)
        how = "all choices compared" if finished else f"{nodes} parts of the choice looked at"
        agents = "one agent" if pins == 1 else f"at most {pins} agents"
        return proved(
            "choice",
            f"No gains on {agents} cost less than {text_below(self.bound, digits=6)} ({how}).",
            bound=number_text(claimed(shorten(self.bound))),
        )

    def _try_set(self, agents: AgentSet) -> None:
        """Compare a set with the best one so far."""
        request = self.ground.request
        chosen = tuple(sorted(agents))
        gains = self.proposer.relax(chosen, float(request.rate))[0]
        if gains is None:
            return
        cost = sum(float(c) * k for c, k in zip(request.costs, gains, strict=True))
        if len(self._met) < MOST_RIVALS:
            self._met[chosen] = cost
        if cost < self.cost:
            self.cost = cost
            self.agents = chosen

    def _add(self, inside: frozenset[int], outside: frozenset[int], above: Fraction) -> None:
        """Open a node with its exact bound, at least its parent's; or close it: impossible, known,
        or not better."""
        pins = self.pins
        unmet = [set(group) - outside for group in self.groups if not set(group) & inside]
        if len(inside) + len(decide.apart(unmet)) > pins:
            return
        self._nodes += 1
        node = self._bounded(inside, outside, above)
        if node is None:
            return
        support = node.support
        free = [agent for agent in support if agent not in inside]
        if len(support) > pins:
            self._try_set(inside | set(free[: pins - len(inside)]))
        elif support:
            self._try_set(support)
        known = len(support) <= pins or len(inside) >= pins or not free
        if known or self._is_beaten(node):
            self._closed.append(node.bound)
        else:
            heapq.heappush(self._heap, (node.bound, self._nodes, node))

    def _bounded(
        self, inside: frozenset[int], outside: frozenset[int], above: Fraction
    ) -> _Node | None:
        """The node with a proved bound of its cost; None if it is proved impossible."""
        ground = self.ground
        request = ground.request
        left = inside
        if len(inside) < self.pins:
            left = frozenset(request.allowed) - outside
        gains, vectors = self.proposer.relax(left, float(request.rate))
        if gains is None:
            if decide.obstacle_to(ground, left, vectors) is not None:
                return None
            return _Node(inside=inside, outside=outside, bound=above, support=())
        own = decide.bound_from(ground, vectors, left)
        kept = [agent for agent in left if gains[agent] > SUPPORT * max(gains)]
        kept.sort(key=lambda agent: (-gains[agent], agent))
        bound = max(above, own.value)
        return _Node(inside=inside, outside=outside, bound=bound, support=tuple(kept))

    def _is_beaten(self, node: _Node) -> bool:
        return self.agents is not None and node.bound >= Fraction(self.cost) * (1 - ALIKE)
