"""Proposals for designed pinning gains: gains, the multipliers that show how good they are, sets of agents.

Everything is floating point.  The multipliers are vectors v of every mode: sum of v v'/2 is the dual point of
minimise sum c_i k_i subject to S + 2 sum k_i E_i >= 0 (theory, section 7); ``verify`` makes them rational.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.pinning import (
    PROGRAM_ROWS,
    PROGRAM_SIZE,
    Blocks,
    Optimum,
    fastest_rate,
    for_rate,
    lowest_on,
    network_blocks,
    optimum,
    smallest_gains,
)
from dobc_design.conditions.consensus.pinning_program import solve_program
from dobc_design.conditions.consensus.pinning_shared import FEW_ROWS, solve_shared
from dobc_design.conditions.consensus.propose import rows_of
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array
from dobc_design.synthesis.pinning.greedy import greedy_set
from dobc_design.synthesis.pinning.request import PinningRequest

Vectors = list[tuple[str, Array]]  # mode, and a vector over the n m rows
# Agents tried in one greedy step, the heaviest of the slowest direction, by the size of the network.
LOOKED_AT = ((60, 40), (float("inf"), 8))
WORK = 200_000  # closed forms spent on exchanges, and on what to add, times agents
LARGEST = 5_000  # agents above which nothing is exchanged
MANY = 200  # agents from which on greedy steps are quick ones
NEARLY_ZERO = 1e-9
CLOSE = 1e-6  # of the cost: a bound this close leaves nothing to look for


@dataclass(kw_only=True, eq=False)
class PinningProposer:
    """The blocks of one problem, its costs and caps (inf where there is none); the blocks of the last rate are kept."""

    problem: Problem
    blocks: Blocks
    costs: Array
    caps: Array
    _kept: dict[float, Blocks] = field(default_factory=dict)

    def asked(self, request: PinningRequest) -> PinningProposer:
        """The same for the costs and caps of a request."""
        caps = [float(request.caps.get(i, np.inf)) for i in range(self.blocks.agents)]
        costs = np.array([float(c) for c in request.costs])
        return PinningProposer(problem=self.problem, blocks=self.blocks, costs=costs, caps=np.array(caps))

    def relax(self, allowed: Collection[int], rate: float) -> tuple[list[float] | None, Vectors]:
        """Gains (n) of least cost on the ``allowed`` agents, about, and their multipliers.

        None if no gains can do: then the vectors are directions that no allowed gain holds.
        """
        blocks = self._at(rate)
        chosen = np.zeros(blocks.agents, dtype=bool)
        chosen[list(allowed)] = True
        if blocks.z:
            single = [optimum(table, chosen, self.costs, self.caps) for table in blocks.tables]
            known = [each for each in single if each is not None]
            if len(known) < len(single):
                return None, self._loose(blocks, chosen)
            if len(known) == 1:
                return known[0].gains.tolist(), self._named(blocks, [[known[0].v]])
            return self._shared(blocks, chosen, known)
        loose = self._loose(blocks, chosen)
        if any(value <= NEARLY_ZERO * blocks.scale for value in self._margins(blocks, chosen)):
            return None, loose
        gains, vectors = self._shared(blocks, chosen, [])
        return (gains, vectors) if gains is not None else (None, loose)

    def fastest(self, allowed: Collection[int], factor: float = 1.0) -> float:
        """The rate (1/s) that gains on these agents approach, about, with caps times ``factor``; inf without limit."""
        chosen = np.zeros(self.blocks.agents, dtype=bool)
        chosen[list(allowed)] = True
        return min(self._margins(self.blocks, chosen, factor=factor), default=float("inf")) / 2

    def slow(self, rate: float) -> Vectors:
        """Of every block the eigenvectors of S with eigenvalues below 0; nothing for large blocks."""
        blocks = self._at(rate)
        if blocks.agents * blocks.width > PROGRAM_ROWS * 3:
            return []
        columns = []
        for table in blocks.tables:
            values, vectors = np.linalg.eigh(table.toarray())
            columns.append([vectors[:, k] for k in np.flatnonzero(values < -1e-7 * blocks.scale)])
        return self._named(blocks, columns)

    def greedy(
        self, allowed: Sequence[int], groups: Sequence[Sequence[int]], rate: float, pins: int | None
    ) -> tuple[int, ...] | None:
        """A small set that reaches the rate, or with ``pins`` a cheap one of at most so many; None if none was found.

        One agent of each group first, then where the slowest direction is heaviest, then the cheapest to add,
        then exchanges of one agent for another.
        """
        chosen = self._hitting(allowed, groups)
        blocks, free = self._at(rate), set(allowed)
        if blocks.z and blocks.agents > MANY:
            with np.errstate(all="ignore"):
                many = greedy_set(blocks, chosen, free, self.costs, pins)
            return many if many is None or self._cost(many, rate) is not None else None
        while self._cost(chosen, rate) is None:
            if not free - set(chosen) or (pins is not None and len(chosen) >= pins):
                return None
            heavy = self._heaviest(blocks, chosen, free - set(chosen))
            chosen.append(
                heavy[0]
                if len(heavy) == 1
                else max(heavy, key=lambda agent: (fastest_rate(blocks, [*chosen, agent]), -agent))
            )
        while pins is not None and len(chosen) < pins and (left := sorted(free - set(chosen))):
            costs = {agent: self._cost([*chosen, agent], rate) for agent in self._spread(left, pins)}
            best = min(costs, key=lambda agent: (costs[agent] if costs[agent] is not None else np.inf, agent))
            chosen.append(best)
        return tuple(sorted(self._exchanged(chosen, sorted(free), rate)))

    def replaceable(self, chosen: Sequence[int], allowed: Sequence[int], rate: float) -> list[tuple[int, int]]:
        """Pairs (pinned, other): with the other in its place the cost is the same to six digits."""
        own = self._cost(chosen, rate)
        found: list[tuple[int, int]] = []
        if own is None or len(chosen) * len(allowed) > self._affordable():
            return found
        for agent in chosen:
            for other in sorted(set(allowed) - set(chosen)):
                cost = self._cost([x for x in chosen if x != agent] + [other], rate)
                if cost is not None and abs(cost - own) <= 1e-6 * own:
                    found.append((agent, other))
        return found

    def _exchanged(self, chosen: list[int], allowed: Sequence[int], rate: float) -> list[int]:
        cost, better = self._cost(chosen, rate), True
        work = 0
        while better and cost is not None:
            better = False
            for place in range(len(chosen)):
                for other in allowed:
                    work += 1
                    if other in chosen or work > self._affordable():
                        continue
                    trial = [*chosen[:place], other, *chosen[place + 1 :]]
                    value = self._cost(trial, rate)
                    if value is not None and value < cost * (1 - 1e-9):
                        chosen, cost, better = trial, value, True
        return chosen

    def _affordable(self) -> int:
        return WORK // len(self.costs) if len(self.costs) <= LARGEST else 0

    def _spread(self, agents: Sequence[int], steps: int) -> Sequence[int]:
        """As many of these agents as can be tried in each of so many steps, evenly over the list."""
        most = max(1, self._affordable() // max(1, steps))
        return agents[:: -(-len(agents) // most)]

    def _cost(self, chosen: Collection[int], rate: float) -> float | None:
        gains = self.relax(chosen, rate)[0] if chosen else None
        return None if gains is None else float(self.costs @ np.array(gains))

    def _hitting(self, allowed: Sequence[int], groups: Sequence[Sequence[int]]) -> list[int]:
        left, chosen, free = [set(group) & set(allowed) for group in groups], [], set(allowed)
        left = [group for group in left if group]
        while left:
            count = {agent: sum(agent in group for group in left) for group in left for agent in group}
            best = min(count, key=lambda agent: (-count[agent], self.costs[agent], agent))
            chosen.append(best)
            left = [group for group in left if best not in group]
        return [agent for agent in chosen if agent in free]

    def _heaviest(self, blocks: Blocks, chosen: Sequence[int], free: Collection[int]) -> list[int]:
        others = np.setdiff1d(np.arange(blocks.agents), list(chosen))
        rows = rows_of(others, blocks.width)
        vector = min((lowest_on(table, rows) for table in blocks.tables), key=lambda found: found[0])[1]
        weight = np.zeros(blocks.agents)
        weight[others] = np.max(np.abs(vector.reshape(len(others), blocks.width)), axis=1)
        order = sorted(free, key=lambda agent: (-round(float(weight[agent]), 9), agent))
        return order[: next(count for most, count in LOOKED_AT if blocks.agents <= most)]

    def _at(self, rate: float) -> Blocks:
        if rate not in self._kept:
            self._kept.clear()
            self._kept[rate] = for_rate(self.blocks, rate)
        return self._kept[rate]

    def _shared(self, blocks: Blocks, chosen: Array, known: Sequence[Optimum]) -> tuple[list[float] | None, Vectors]:
        """Several blocks: their dual or a conic program; else the largest gain of each agent over the blocks."""
        found: tuple[Array, Vectors] | None = None
        if known:
            best = max(range(len(known)), key=lambda k: self.costs @ known[k].gains)
            columns = [[each.v] if k == best else [] for k, each in enumerate(known)]
            found = np.max([each.gains for each in known], axis=0), self._named(blocks, columns)
        rows = blocks.agents * blocks.width
        if known and rows > FEW_ROWS:
            shared = solve_shared(blocks.tables, chosen, self.costs, self.caps)
            if shared is not None:
                cost = float(self.costs @ shared.gains)
                if found is None or cost < self.costs @ found[0] * 1.000001:
                    found = shared.gains, self._named(blocks, [[v] for v in shared.vectors])
                if cost - shared.bound <= CLOSE * cost:
                    return found[0].tolist(), found[1]
        if rows <= PROGRAM_ROWS and rows * rows * len(blocks.tables) <= PROGRAM_SIZE:
            program = solve_program(
                blocks.tables,
                np.flatnonzero(chosen),
                self.costs,
                width=blocks.width,
                scale=blocks.scale,
                caps=self.caps,
            )
            if program is not None and (found is None or self.costs @ program.gains < self.costs @ found[0] * 1.000001):
                columns = [_factors(each, z=blocks.z) for each in program.multipliers]
                return program.gains.tolist(), self._named(blocks, columns)
        if found is None and not np.any(np.isfinite(self.caps)):
            gains = smallest_gains(blocks, np.flatnonzero(chosen).tolist(), costs=self.costs.tolist())
            return (None if gains is None else gains.tolist()), []
        return (None, []) if found is None else (found[0].tolist(), found[1])

    def _held(self, blocks: Blocks, chosen: Array) -> tuple[Array, Array]:
        """What caps add to the diagonal, and the rows that no gain without a cap holds."""
        capped = chosen & np.isfinite(self.caps)
        extra = np.repeat(2 * np.where(capped, self.caps, 0.0), blocks.width)
        return extra, rows_of(np.flatnonzero(np.logical_not(chosen) | capped), blocks.width)

    def _lowest(self, blocks: Blocks, chosen: Array, *, factor: float = 1.0) -> list[tuple[float, Array]]:
        extra, rows = self._held(blocks, chosen)
        added = sparse.diags_array(extra * factor)
        return [lowest_on(sparse.csr_array(table + added), rows) for table in blocks.tables]

    def _margins(self, blocks: Blocks, chosen: Array, *, factor: float = 1.0) -> list[float]:
        return [value for value, _ in self._lowest(blocks, chosen, factor=factor)]

    def _loose(self, blocks: Blocks, chosen: Array) -> Vectors:
        """Of every block the direction that allowed gains hold least, zero on the rows of gains without a cap."""
        rows = self._held(blocks, chosen)[1]
        columns: list[list[Array]] = []
        for _, vector in self._lowest(blocks, chosen):
            whole = np.zeros(blocks.agents * blocks.width)
            whole[rows] = np.abs(vector) if blocks.z else vector
            columns.append([whole])
        return self._named(blocks, columns)

    def _named(self, blocks: Blocks, columns: Sequence[Sequence[Array]]) -> Vectors:
        """The vectors of every block with its mode, on all n m rows."""
        m = self.problem.m
        result: Vectors = []
        for (mode, component), own in zip(blocks.sources, columns, strict=True):
            for vector in own:
                whole = vector
                if blocks.width != m:
                    whole = np.zeros(blocks.agents * m)
                    whole[component::m] = vector
                result.append((mode, whole))
        return result


def make_proposer(problem: Problem, request: PinningRequest) -> PinningProposer | None:
    """The proposer of one problem and request; None if its entries are beyond the floats."""
    blocks = network_blocks(problem)
    if blocks is None:
        return None
    nothing = np.zeros(problem.n)
    return PinningProposer(problem=problem, blocks=blocks, costs=nothing, caps=nothing).asked(request)


def _factors(Z: Array, *, z: bool) -> list[Array]:
    """Vectors with sum v v'/2 = Z, about; of a Z-matrix the one with the same diagonal, which is no worse."""
    if z:
        return [np.sqrt(np.maximum(2 * np.diag(Z), 0.0))]
    values, vectors = np.linalg.eigh((Z + Z.T) / 2)
    top = float(np.max(values, initial=0.0))
    return [np.sqrt(2 * value) * vectors[:, k] for k, value in enumerate(values) if value > 1e-10 * top > 0]
