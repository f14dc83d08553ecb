"""Proposals for pinning gains at the consensus: gains, the multipliers that show how good they are,
sets of agents.

Everything is floating point.  The multipliers are vectors v of every mode: sum of v v'/2 is the
dual point of minimise sum c_i k_i subject to S + 2 sum k_i E_i >= 0 (theory, section 7); ``decide``
makes them rational.

Of many agents a small set of pins is chosen greedily.  With v = sqrt(c) on the pins and (S v)_i = 0
on the others, pinning agent a as well makes the gains cheaper by (v_a - sqrt(c_a))^2 / (2 G_aa), G
the inverse of S on the others, exactly, as long as no gain falls to 0.  G_aa >= 1 / S_aa orders the
agents, so that few G_aa are computed in a step. While the pins do not reach the rate, S is shifted
as far as that takes.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations, product
from math import comb
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import ModeJacobian
from dobc_design.conditions.consensus.pinning import (
    PROGRAM_ROWS,
    Blocks,
    cheapest_gains,
    factorised,
    fastest_rate,
    for_rate,
    lowest_on,
    network_blocks,
    slowest_on,
)
from dobc_design.conditions.consensus.propose import rows_of
from dobc_design.exact.matrix import Array
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem

from .claim import Agents, AgentSet, Gains, PinningRequest

Vectors = list[tuple[str, Array]]  # mode, and a vector over the n m rows
# closed forms spent on exchanges and ties, times agents; agents above which: none
WORK, LARGEST = 200_000, 5_000
MOST_SETS = 3000  # sets of agents that are compared one by one
MANY = 200  # agents from which on greedy steps are quick ones
NEARLY_ZERO = 1e-9
UPDATES = 100  # pins between two eigenvalues
SHIFTED, PART = 8, 300  # while S is shifted; of many agents one in so many
ROOM = 0.05  # by how much more S is shifted than it has to be, as a part
LOOKED_AT = 12  # agents whose saving is computed in one step
DENSE = 400  # agents up to which all eigenvalues are computed
STEPS = 3000  # of the power method above


@noun(eq=False)
class PinningProposer:
    """The blocks of one problem, its costs and caps (inf where there is none)."""

    problem: Problem
    blocks: Blocks
    costs: Array
    caps: Array

    def relax(self, allowed: AgentSet, rate: float) -> tuple[list[float] | None, Vectors]:
        """Gains (n) of least cost, about, and their multipliers; without (None) directions that no
        gains hold."""
        blocks = for_rate(self.blocks, rate)
        chosen = self._mask(allowed)
        found = None
        # Gains without a cap have to hold every direction, as floating point sees it.
        least = NEARLY_ZERO * blocks.scale
        if blocks.z or all(value > least for value, _ in self._lowest(blocks, chosen)):
            found = cheapest_gains(blocks, chosen, self.costs, self.caps)
        if found is None:
            return None, self._loose(blocks, chosen)
        return found.gains.tolist(), self._named(blocks, found.vectors)

    def fastest(self, allowed: AgentSet, factor: float = 1.0) -> float:
        """The rate (1/s) that gains on these agents approach, about, with caps times ``factor``;
        inf without limit."""
        lowest = self._lowest(self.blocks, self._mask(allowed), factor=factor)
        return min((value for value, _ in lowest), default=float("inf")) / 2

    def slow(self, rate: float) -> Vectors:
        """Of every block the eigenvectors of S with eigenvalues below 0; nothing for large
        blocks."""
        blocks = for_rate(self.blocks, rate)
        if blocks.agents * blocks.width > PROGRAM_ROWS * 3:
            return []
        columns = []
        for table in blocks.tables:
            values, vectors = np.linalg.eigh(table.toarray())
            columns.append(list(vectors.T[values < -1e-7 * blocks.scale]))
        return self._named(blocks, columns)

    def greedy(
        self, allowed: AgentSet, groups: Sequence[AgentSet], rate: float, pins: int | None
    ) -> Agents | None:
        """A small set that reaches the rate, or with ``pins`` a cheap one of at most so many; None
        if none was found. One agent of each group first, then where the slowest direction is
        heaviest, then the cheapest to add, then exchanges of one agent for another; of many agents
        those that save most."""
        chosen = self._hitting(allowed, groups)
        blocks = for_rate(self.blocks, rate)
        free = set(allowed)
        if blocks.z and blocks.agents > MANY and not blocks.weighted:
            # Closed forms of every candidate would take too long.
            with np.errstate(all="ignore"):
                many = greedy_set(blocks, chosen, free, self.costs, pins)
            if many is None or self._cost(many, rate) == np.inf:
                return None
            return many
        # Until the rate is reached, fast counts; then cheap does.
        while self._cost(chosen, rate) == np.inf:
            left = free - set(chosen)
            if not left or (pins is not None and len(chosen) >= pins):
                return None
            chosen.append(self._fastest_with(blocks, chosen, left))
        if pins is not None:
            while len(chosen) < pins and set(chosen) != free:
                chosen.append(self._cheapest_with(chosen, sorted(free - set(chosen)), rate, pins))
        return tuple(sorted(self._exchanged(chosen, sorted(free), rate)))

    def _fastest_with(self, blocks: Blocks, chosen: AgentSet, left: AgentSet) -> int:
        """The further agent, of those where the slowest direction is heaviest, that allows the
        fastest rate."""
        count = blocks.agents
        others = np.setdiff1d(np.arange(count), list(chosen))
        weight = np.zeros(count)
        weight[others] = slowest_on(blocks, others)
        order = sorted(left, key=lambda agent: (-round(float(weight[agent]), 9), agent))
        most = 40 if count <= 60 else 8
        return max(
            order[:most],
            key=lambda agent: (fastest_rate(blocks, [*chosen, agent]), -agent),
        )

    def _cheapest_with(self, chosen: AgentSet, left: Sequence[int], rate: float, pins: int) -> int:
        """The further agent with which the gains are cheapest, of as many as are worth the time."""
        most = max(1, self._affordable() // pins)
        step = -(-len(left) // most)
        costs = {agent: self._cost([*chosen, agent], rate) for agent in left[::step]}
        return min(costs, key=lambda agent: (costs[agent], agent))

    def cheapest(self, allowed: AgentSet, pins: int, rate: float) -> Agents:
        """The cheapest of all sets of so many agents, where these are few; () if none is found."""
        if comb(len(allowed), pins) > MOST_SETS:
            return ()
        costs = {each: self._cost(each, rate) for each in combinations(allowed, pins)}
        best = min(costs, key=costs.__getitem__, default=())
        return best if costs.get(best, np.inf) < np.inf else ()

    def replaceable(
        self, chosen: AgentSet, allowed: AgentSet, rate: float
    ) -> list[tuple[int, int]]:
        """Pairs (pinned, other): with the other in its place the cost is the same to six digits."""
        own = self._cost(chosen, rate)
        if own == np.inf or len(chosen) * len(allowed) > self._affordable():
            return []
        alike = []
        for pinned, other in product(chosen, sorted(set(allowed) - set(chosen))):
            exchanged = {*chosen, other} - {pinned}
            if abs(self._cost(exchanged, rate) - own) <= 1e-6 * own:
                alike.append((pinned, other))
        return alike

    def _exchanged(self, chosen: list[int], allowed: AgentSet, rate: float) -> list[int]:
        """The agents after exchanges of one for another, while these make the gains cheaper."""
        cost = self._cost(chosen, rate)
        better = True
        work = 0
        while better:
            better = False
            for place, other in product(range(len(chosen)), allowed):
                work += 1
                if other in chosen or work > self._affordable():
                    continue
                trial = [*chosen[:place], other, *chosen[place + 1 :]]
                value = self._cost(trial, rate)
                if value < cost * (1 - 1e-9):
                    chosen = trial
                    cost = value
                    better = True
        return chosen

    def _affordable(self) -> int:
        """How many closed forms are worth the time."""
        if len(self.costs) > LARGEST:
            return 0
        return WORK // len(self.costs)

    def _cost(self, chosen: AgentSet, rate: float) -> float:
        gains = self.relax(chosen, rate)[0] if chosen else None
        return np.inf if gains is None else float(self.costs @ np.array(gains))

    def _hitting(self, allowed: AgentSet, groups: Sequence[AgentSet]) -> list[int]:
        """Agents that meet all groups, always the one that meets most of those that are left."""
        # Groups without an allowed agent are refuted elsewhere.
        may = set(allowed)
        left = [may & set(group) for group in groups if may & set(group)]
        chosen = []
        while left:
            count = Counter(agent for group in left for agent in group)
            best = min(count, key=lambda agent: (-count[agent], self.costs[agent], agent))
            chosen.append(best)
            left = [group for group in left if best not in group]
        return chosen

    def _mask(self, agents: AgentSet) -> Array:
        mask = np.zeros(self.blocks.agents, dtype=bool)
        mask[list(agents)] = True
        return mask

    def _free_rows(self, blocks: Blocks, chosen: Array) -> Any:
        """The rows that no gain without a cap holds."""
        agents = np.flatnonzero(np.logical_not(chosen) | np.isfinite(self.caps))
        return rows_of(agents, blocks.width)

    def _lowest(
        self, blocks: Blocks, chosen: Array, *, factor: float = 1.0
    ) -> list[tuple[float, Array]]:
        """Of every block the lowest eigenvalue on these rows, with caps times ``factor`` on the
        diagonal."""
        held = np.where(chosen & np.isfinite(self.caps), self.caps, 0.0)
        added = diags_array(np.repeat(2 * held * factor, blocks.width))
        rows = self._free_rows(blocks, chosen)
        tables = [csr_array(table + added) for table in blocks.tables]
        return [lowest_on(table, rows) for table in tables]

    def _loose(self, blocks: Blocks, chosen: Array) -> Vectors:
        """Of every block the direction that allowed gains hold least, zero on the rows of gains
        without a cap."""
        rows = self._free_rows(blocks, chosen)
        columns = []
        for _, vector in self._lowest(blocks, chosen):
            column = np.zeros(blocks.agents * blocks.width)
            column[rows] = np.abs(vector) if blocks.z else vector
            columns.append([column])
        return self._named(blocks, columns)

    def _named(self, blocks: Blocks, columns: Sequence[Sequence[Array]]) -> Vectors:
        """The vectors of every block with its mode, on all n m rows."""
        m = self.problem.m
        result: Vectors = []
        for (mode, component), own in zip(blocks.sources, columns, strict=True):
            # A block has all rows, or those of one state component.
            rows = slice(None) if blocks.width == m else slice(component, None, m)
            for vector in own:
                whole = np.zeros(blocks.agents * m)
                whole[rows] = vector
                result.append((mode, whole))
        return result


def make_proposer(
    problem: Problem, request: PinningRequest, *, weighted: bool = False
) -> PinningProposer | None:
    """The proposer of one problem and request, for V with or without weights; None beyond the
    floats."""
    blocks = network_blocks(loop_of(problem), weighted=weighted)
    if blocks is None:
        return None
    caps = np.array([float(request.caps.get(i, np.inf)) for i in range(problem.n)])
    costs = np.array([float(c) for c in request.costs])
    return PinningProposer(problem=problem, blocks=blocks, costs=costs, caps=caps)


def greedy_set(
    blocks: Blocks,
    chosen: AgentSet,
    free: AgentSet,
    costs: Array,
    pins: int | None,
) -> Agents | None:
    """Agents added until the rate is reached (else None), or ``pins`` are chosen; blocks have to be
    Z-matrices."""
    found = list(chosen)
    while True:
        shift = _needed_shift(blocks, found)
        left = np.array(sorted(set(free) - set(found)), dtype=np.int64)
        room = len(left)
        if pins is not None:
            room = min(room, pins - len(found))
        if room <= 0 or (shift == 0 and pins is None):
            return tuple(sorted(found)) if shift == 0 else None
        steps = UPDATES
        if shift:
            steps = max(SHIFTED, blocks.agents // PART)
        added = shift * eye_array(len(costs))
        shifted = [csr_array(table + added) for table in blocks.tables]
        for _ in range(min(room, steps)):
            found.append(_best(shifted, found, left, costs))
            left = left[left != found[-1]]


def _needed_shift(blocks: Blocks, pinned: list[int]) -> float:
    """What has to be added to S for the pins to hold the others; 0 where they do."""
    others = np.setdiff1d(np.arange(blocks.agents), pinned)
    lowest = min(lowest_on(table, others)[0] for table in blocks.tables)
    if lowest > 1e-9 * blocks.scale:
        return 0.0
    return ROOM * blocks.scale * 1e-3 - lowest * (1 + ROOM)


def _best(matrices: Sequence[Any], found: list[int], left: Any, costs: Array) -> int:
    """The agent that saves most, among those whose bound is largest."""
    others = np.setdiff1d(np.arange(len(costs)), found)
    place = np.searchsorted(others, left)
    root = np.sqrt(costs)
    # Of each S how far v is above sqrt(c) on agents that may be pinned, and what solves with S.
    held = []
    # 1/G_aa <= S_aa bounds what each agent saves (module docstring).
    bounds = np.zeros(len(left))
    for matrix in matrices:
        rows = matrix[others]
        solve = factorised(rows[:, others])
        # Where nobody is pinned yet: by how loosely everybody is held.
        v = solve(-(rows[:, found] @ root[found]) if found else np.ones(len(others)))
        above = np.maximum(v[place] - root[left], 0.0)
        held.append((above, solve))
        bounds += above**2 * matrix.diagonal()[left]

    def saving(candidate: int) -> float:
        at = place[candidate]
        unit = (np.arange(len(others)) == at).astype(float)
        return sum(float(above[candidate]) ** 2 / float(solve(unit)[at]) for above, solve in held)

    largest = np.argsort(-bounds, kind="stable")[:LOOKED_AT]
    return int(left[max(largest, key=saving)])


def slow_directions(
    mode: ModeJacobian, component: int, pinned: AgentSet, caps: Gains, *, size: int
) -> Iterator[list[float]]:
    """Directions (n) >= 0 worth an exact look: the Perron vector, and the agent alone that is
    pulled least."""
    slopes = np.array([float(gain[component][component].midpoint) for gain in mode.gains])
    values = slopes[mode.kind] if len(slopes) else np.zeros(0)
    listeners = mode.arcs.listeners
    speakers = mode.arcs.speakers
    pull = np.bincount(listeners, weights=values, minlength=size).astype(float)
    for i in pinned:
        pull[i] += float(caps[i]) if i in caps else np.inf
    rows = np.flatnonzero(np.isfinite(pull))
    if not len(rows) or not np.all(np.isfinite(values)):
        return
    arcs = coo_array((values, (listeners, speakers)), shape=(size, size))
    heard = csr_array(arcs)[rows][:, rows]
    slowest = np.zeros(size)
    slowest[rows] = _perron(csr_array(heard - diags_array(pull[rows])))
    yield slowest.tolist()
    alone = np.zeros(size)
    alone[int(np.argmin(pull))] = 1.0
    yield alone.tolist()


def _perron(matrix: csr_array) -> Array:
    """The vector >= 0 of the eigenvalue with the largest real part, of a matrix that is >= 0 off
    its diagonal."""
    size = matrix.shape[0]
    if size <= DENSE:
        values, vectors = np.linalg.eig(matrix.toarray())
        slowest = int(np.argmax(values.real))
        vector = np.abs(vectors[:, slowest].real)
        return np.where(vector > 1e-9 * np.max(vector, initial=0.0), vector, 0.0)
    shift = float(np.max(-matrix.diagonal(), initial=0.0)) + 1.0
    vector = np.ones(size)
    for _ in range(STEPS):
        vector = matrix @ vector + shift * vector
        vector = vector / np.max(vector)
    return np.asarray(vector)
