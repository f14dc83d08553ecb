"""Directions in which Lambda is not negative, carried by as few agents as can be found: proposals for witnesses.

A principal submatrix with an eigenvalue >= 0 is enough.  Small supports are grown from single agents and cut out
of the slowest direction.  Floating point: every direction is decided exactly before anything is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dobc_design.conditions.consensus.estimates import largest_eigenvalue
from dobc_design.conditions.consensus.jacobian import float_lambda
from dobc_design.conditions.consensus.pinning import rows_of
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

LARGEST = 2000  # rows up to which supports are looked for
BUDGET = 200_000_000  # cubed rows of all eigenvalue problems of one search, about
CALL = 200_000  # what a small one costs besides
EDGE = 1e-9  # relative: an eigenvalue above minus this may be 0


def witness_directions(problem: Problem, mode: str) -> list[Sequence[float]]:
    """Vectors (n m,) with v' Lambda v about >= 0 or more, those with the fewest agents first.

    Agents without a pin come first among equals: what they carry, no gain on the present pins changes.
    """
    table = sparse.csr_array(float_lambda(problem, mode))
    if table.shape[0] > LARGEST or not np.all(np.isfinite(table.data)):
        return []
    search = _Search(table=table, width=problem.m)
    pinned = set(problem.pinning.agents)
    free = [agent for agent in range(problem.n) if agent not in pinned]
    supports: dict[tuple[int, ...], None] = {}
    for base in (free, list(range(problem.n))):
        if not base or search.top(base)[0] < -search.edge:
            continue
        supports |= dict.fromkeys(search.supports_in(base))
    ordered = sorted(supports, key=lambda s: (len(s), bool(pinned & set(s)), s))
    return [search.direction(support) for support in ordered]


class _Search:
    """Eigenvalues of principal submatrices of one symmetric matrix, by agents."""

    def __init__(self, *, table: Any, width: int) -> None:
        self.table, self.width = table, width
        self.edge = EDGE * max(float(np.max(np.abs(table.data), initial=0.0)), 1e-300)
        self.known: dict[tuple[int, ...], tuple[float, Array]] = {}
        self.left = BUDGET

    def top(self, agents: Sequence[int]) -> tuple[float, Array]:
        """The largest eigenvalue on these agents and its vector, by row."""
        key = tuple(sorted(agents))
        if key not in self.known:
            rows = rows_of(np.array(key, dtype=np.int64), self.width)
            self.left -= CALL + len(rows) ** 3
            found = largest_eigenvalue(sparse.coo_array(self.table[rows][:, rows]))
            self.known[key] = (found.value, found.vector)
        return self.known[key]

    def fails(self, agents: Sequence[int]) -> bool:
        """Whether the submatrix seems not to be negative definite."""
        return self.top(agents)[0] >= -self.edge

    def direction(self, agents: Sequence[int]) -> list[float]:
        """The top vector of a support, zero elsewhere."""
        whole = np.zeros(self.table.shape[0])
        rows = rows_of(np.array(sorted(agents), dtype=np.int64), self.width)
        vector = self.top(agents)[1]
        # Every second solver has every second sign: the heaviest entry is made positive.
        heaviest = vector[int(np.argmax(np.abs(vector)))] if len(vector) else 1.0
        whole[rows] = vector if heaviest >= 0 else -vector
        result: list[float] = whole.tolist()
        return result

    def supports_in(self, base: Sequence[int]) -> list[tuple[int, ...]]:
        """Small supports inside ``base``, whose submatrix fails."""
        single: list[tuple[int, ...]] = [(agent,) for agent in base if self.fails((agent,))]
        if single:
            return single[:5]
        if self.needs_all(base):
            return [tuple(base)]
        found = [self.cut(self.heavy(base))]
        best = len(found[0])
        for seed in self.by_weight(base):
            grown = self.grown(seed, base, limit=best) if self.left > 0 else None
            if grown is not None:
                found.append(self.cut(grown))
                best = min(best, len(found[-1]))
        return sorted(set(found), key=lambda s: (len(s), s))[:5]

    def needs_all(self, base: Sequence[int]) -> bool:
        """Whether the submatrix is singular, connected and minus a Z-matrix: then no smaller one inside it fails."""
        if abs(self.top(base)[0]) > self.edge or self.width > 1:
            return False
        rows = np.array(sorted(base), dtype=np.int64)
        part = self.table[rows][:, rows].tocoo()
        beside = part.row != part.col
        if np.any(part.data[beside] < 0):
            return False
        return bool(csgraph.connected_components(part, directed=False)[0] == 1)

    def heavy(self, base: Sequence[int]) -> list[int]:
        """The fewest of the heaviest agents of the slowest direction that still fail."""
        order = self.by_weight(base)
        low, high = 0, len(order)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.fails(order[:middle]) else (middle, high)
        return order[:high]

    def by_weight(self, agents: Sequence[int]) -> list[int]:
        """The agents by what they carry of the slowest direction, heaviest first."""
        ordered = np.array(sorted(agents))
        weights = np.max(np.abs(self.top(agents)[1].reshape(len(ordered), self.width)), axis=1)
        result: list[int] = ordered[np.argsort(-weights, kind="stable")].tolist()
        return result

    def cut(self, agents: Sequence[int]) -> tuple[int, ...]:
        """Leave out agents as long as the rest still fails, the lightest first."""
        kept = self.by_weight(agents)
        for agent in reversed(list(kept)):
            rest = [other for other in kept if other != agent]
            if rest and self.left > 0 and self.fails(rest):
                kept = rest
        return tuple(sorted(kept))

    def grown(self, seed: int, base: Sequence[int], *, limit: int) -> list[int] | None:
        """Add, one by one, the neighbour that raises the top eigenvalue most; None at ``limit`` agents."""
        chosen, allowed = [seed], set(base)
        while not self.fails(chosen):
            if self.left <= 0:
                return None
            near = {agent for each in chosen for agent in self.neighbours(each)} & allowed - set(chosen)
            if len(chosen) + 1 >= limit or not near:
                return None
            chosen.append(max(sorted(near), key=lambda agent: self.top([*chosen, agent])[0]))
        return chosen

    def neighbours(self, agent: int) -> set[int]:
        """The agents with an entry in the rows of this one."""
        rows = rows_of(np.array([agent]), self.width)
        return set((self.table[rows].indices // self.width).tolist())
