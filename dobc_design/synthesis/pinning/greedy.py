"""A small set of pins for many agents, greedily: one solve per step with a factor that is updated, lazily evaluated.

With v = sqrt(c) on the pins and (S v)_i = 0 on the others, pinning agent a as well makes the gains cheaper by

    (v_a - sqrt(c_a))^2 / (2 G_aa)          G the inverse of S on the others, G_aa >= 1 / S_aa

exactly, as long as no gain falls to 0.  The bound orders the agents, so that few G_aa are computed in a step (fewer
still, as the bound is known to be too large by about the same factor), and a pin takes a rank one away from G.  While
the pins do not reach the rate, S is shifted as far as that takes.  Floating point: a proposal.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.pinning import Blocks, factorised, lowest_on
from dobc_design.solvers.program import Array

UPDATES = 100  # pins between two factorisations
SHIFTED, PART = 8, 300  # while S is shifted; of many agents one in so many
ROOM = 0.05  # by how much more S is shifted than it has to be, as a part
LOOKED_AT = 12  # agents whose saving is computed in one step at most
CERTAIN, PESSIMISM = 2, 1.1  # after so many, bounds are taken to be too large by nearly the least factor seen


def greedy_set(
    blocks: Blocks, chosen: Sequence[int], free: Collection[int], costs: Array, pins: int | None
) -> tuple[int, ...] | None:
    """Agents of ``free`` added to ``chosen`` until the rate of the blocks is reached, or ``pins`` are chosen.

    ``pins`` None: no more than reach it.  None if they do not reach it.  The blocks have to be Z-matrices.
    """
    found = list(chosen)
    while True:
        shift = _shift(blocks, found)
        left = np.array(sorted(set(free) - set(found)), dtype=np.int64)
        room = len(left) if pins is None else min(len(left), pins - len(found))
        if (shift == 0 and pins is None) or room <= 0:
            return tuple(sorted(found)) if shift == 0 else None
        states = [_State.of(table, found, costs, shift) for table in blocks.tables]
        for _ in range(min(room, max(SHIFTED, blocks.agents // PART) if shift else UPDATES)):
            agent = _best(states, left, costs)
            found.append(agent)
            left = left[left != agent]
            for state in states:
                state.pin(agent, float(np.sqrt(costs[agent])))


def _shift(blocks: Blocks, chosen: Sequence[int]) -> float:
    """What has to be added to S for the pins to hold the others; 0 if they do."""
    others = np.setdiff1d(np.arange(blocks.agents), chosen)
    lowest = min(lowest_on(table, others)[0] for table in blocks.tables)
    return 0.0 if lowest > 1e-9 * blocks.scale else (ROOM * blocks.scale * 1e-3 - lowest * (1 + ROOM))


def _best(states: Sequence[_State], left: Any, costs: Array) -> int:
    """The agent that saves most, among those whose bound is largest."""
    bounds = np.sum([state.bounds(left, costs) for state in states], axis=0)
    order = np.argsort(-bounds, kind="stable")[:LOOKED_AT]
    best, agent, part = -1.0, int(left[order[0]]), 0.0
    for count, place in enumerate(order.tolist()):
        if bounds[place] * (min(1.0, PESSIMISM * part) if count >= CERTAIN else 1.0) <= best:
            break
        saving = sum(state.saving(int(left[place]), costs) for state in states)
        part = max(part, saving / max(float(bounds[place]), 1e-300))
        if saving > best:
            best, agent = saving, int(left[place])
    return agent


@dataclass(kw_only=True, eq=False)
class _State:
    """One matrix with its pins: v (n,), the inverse on the others as a factor less ``rank`` columns."""

    v: Array
    diagonal: Array
    place: Any
    solve: Any
    rank: list[Array]
    column: dict[int, Array]

    @classmethod
    def of(cls, table: Any, chosen: Sequence[int], costs: Array, shift: float) -> _State:
        n = len(costs)
        matrix = sparse.csr_array(table + shift * sparse.eye_array(n))
        mask = np.zeros(n, dtype=bool)
        mask[list(chosen)] = True
        v = np.where(mask, np.sqrt(costs), 0.0)
        others, pins = np.flatnonzero(~mask), np.flatnonzero(mask)
        place = np.full(n, -1)
        place[others] = np.arange(len(others))
        rows = matrix[others]
        solve = factorised(rows[:, others])
        # Where nobody is pinned yet: by how loosely everybody is held.
        v[others] = solve(-(rows[:, pins] @ v[pins]) if len(pins) else np.ones(len(others)))
        return cls(v=v, diagonal=matrix.diagonal(), place=place, solve=solve, rank=[], column={})

    def bounds(self, agents: Any, costs: Array) -> Array:
        above = np.maximum(self.v[agents] - np.sqrt(costs[agents]), 0.0)
        return np.asarray(above**2 * self.diagonal[agents])

    def saving(self, agent: int, costs: Array) -> float:
        own = max(float(self.v[agent] - np.sqrt(costs[agent])), 0.0)
        return own**2 / float(self._column(agent)[self.place[agent]])

    def pin(self, agent: int, value: float) -> None:
        """Hold v of one more agent at ``value``."""
        column = self._column(agent)
        own = self.place[agent]
        others = self.place >= 0
        self.v[others] += column[self.place[others]] * (value - self.v[agent]) / column[own]
        self.v[agent] = value
        self.rank.append(column / np.sqrt(column[own]))
        self.column.clear()

    def _column(self, agent: int) -> Array:
        """The column of the inverse that belongs to an agent, after the pins since the factorisation."""
        if agent not in self.column:
            own = self.place[agent]
            unit = np.zeros(int(np.max(self.place)) + 1)
            unit[own] = 1.0
            column = self.solve(unit)
            for each in self.rank:
                column -= each * each[own]
            self.column[agent] = column
        return self.column[agent]
