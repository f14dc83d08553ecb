"""The rows of the max-separable certificate in floating point, for all agents at once.

The largest row over modes, faces and a grid of s, with its derivatives in v.  Theory, section 5; an estimate only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.conditions.separable.claim import holding_gains
from dobc_design.problem.arcs import coupling_places, split_by
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

SAMPLES = 4001  # points of a coupling's table
MOST_TURNS = 200  # of a coupling in it: sine as far as 300
WORK = 1_000_000  # evaluations of h per pass that are worth a finer grid of s
FINEST, COARSEST = 33, 5
NEAREST = 1e-5  # the smallest s, as a part of rho
STEP = 1e-6  # of central differences


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One coupling: h, and where it has maxima and minima on the sampled range."""

    h: Callable[[Array], Array]
    tops: tuple[Array, Array]  # places, values
    bottoms: tuple[Array, Array]


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The arcs of one mode with one coupling."""

    listeners: Any
    speakers: Any
    weights: Array
    shape: Shape


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """All rows: ``modes`` holds the groups of every mode, ``grid`` the values of s."""

    size: int
    gains: Array
    modes: tuple[tuple[Group, ...], ...]
    grid: Array

    def rows(self, v: Array, *, alpha: float) -> tuple[Array, Any, Array]:
        """The largest row of every agent, its Jacobian in v (n, n), and the size of its terms."""
        worst = np.full(self.size, -np.inf)
        scale = (np.abs(self.gains) + alpha) * v
        chosen = np.zeros(self.size, dtype=np.int64)
        choices = [(m, f, k) for m in range(len(self.modes)) for f in (1, -1) for k in range(len(self.grid))]
        for number, (mode, face, k) in enumerate(choices):
            row = self._sum(mode, face, float(self.grid[k]), v)
            chosen[row > worst] = number
            worst = np.fmax(worst, row)  # a row that is no number is left out
            scale = np.maximum(scale, np.abs(row))
        residual = worst - (self.gains - alpha) * v
        return residual, self._jacobian(chosen, choices, v, alpha), scale

    def rates(self, v: Array) -> Array:
        """The rate that v has at each s of the grid, (grid,): the least over agents, modes and faces."""
        found = np.full(len(self.grid), np.inf)
        for k, s in enumerate(self.grid.tolist()):
            for mode in range(len(self.modes)):
                for face in (1, -1):
                    rate = self.gains - self._sum(mode, face, s, v) / v
                    found[k] = min(found[k], float(np.min(rate)))
        return found

    def values(self, mode: int, face: int, v: Array) -> Array:
        """One face of one mode: the largest sum of every agent at each s of the grid, without its gain, (grid, n)."""
        return np.array([self._sum(mode, face, s, v) for s in self.grid.tolist()])

    def slopes(self, mode: int, face: int, places: Any, v: Array) -> Any:
        """The derivatives in v, (n, n), of these sums, each agent at its own place (n,) of the grid."""
        choices = [(mode, face, k) for k in range(len(self.grid))]
        return self._jacobian(np.asarray(places), choices, v, 0.0) + sparse.diags_array(self.gains)

    def _sum(self, mode: int, face: int, s: float, v: Array) -> Array:
        total = np.zeros(self.size)
        for group in self.modes[mode]:
            value, _ = _sup(group.shape, face, s, v[group.listeners], v[group.speakers])
            total += np.bincount(group.listeners, weights=group.weights * value, minlength=self.size)
        return total

    def _jacobian(self, chosen: Any, choices: Sequence[tuple[int, int, int]], v: Array, alpha: float) -> Any:
        """Each agent has the choice (mode, face, place in the grid) of its own number."""
        parts_i, parts_j, parts_x = [np.arange(self.size)], [np.arange(self.size)], [alpha - self.gains]
        for number in np.unique(chosen).tolist():
            mode, face, k = choices[number]
            mine = chosen == number
            for group in self.modes[mode]:
                here = mine[group.listeners]
                i, j, w = group.listeners[here], group.speakers[here], group.weights[here]
                own, other = _derivatives(group.shape, face, float(self.grid[k]), v[i], v[j])
                parts_i += [i, i]
                parts_j += [i, j]
                parts_x += [w * own, w * other]
        entries = (np.concatenate(parts_x), (np.concatenate(parts_i), np.concatenate(parts_j)))
        return sparse.csr_array(sparse.coo_array(entries, shape=(self.size, self.size)))


def field_of(problem: Problem, *, rho: float, modes: Sequence[str] | None = None, spread: float = 4.0) -> Field:
    """Prepare the rows for s in (0, rho]; turning points of h are looked for on |y| <= 2 spread rho."""
    shapes = [shape_of(_scalar(coupling), radius=2 * spread * rho) for coupling in problem.couplings]
    names = list(problem.network.modes if modes is None else modes)
    grouped = []
    total = 1
    for name in names:
        arcs = problem.network.modes[name]
        total += len(arcs)
        weights = np.array([float(w) for w in arcs.weights])
        grouped.append(
            tuple(
                Group(arcs.listeners[own], arcs.speakers[own], weights[own], shapes[kind])
                for kind, own in split_by(coupling_places(problem, arcs))
            )
        )
    count = int(np.clip(WORK // total, COARSEST, FINEST))
    return Field(
        size=problem.n,
        gains=np.array([float(k) for k in holding_gains(problem)]),
        modes=tuple(grouped),
        grid=rho * np.concatenate([[NEAREST], np.linspace(0, 1, count)[1:]]),
    )


def shape_of(h: Callable[[Array], Array], *, radius: float) -> Shape:
    """Sample h on [-radius, radius] for its turning points.  Raises: ArithmeticError if they are too many."""
    y = np.linspace(-radius, radius, SAMPLES)
    values = h(y)
    values = np.where(np.isfinite(values), values, 0.0)
    up = np.diff(values) > 0
    down = np.diff(values) < 0
    tops, bottoms = np.flatnonzero(up[:-1] & down[1:]) + 1, np.flatnonzero(down[:-1] & up[1:]) + 1
    if len(tops) + len(bottoms) > MOST_TURNS:
        raise ArithmeticError(f"the coupling has more than {MOST_TURNS} turning points within {radius:g}")
    return Shape(h=h, tops=_refined(h, y, tops, +1.0), bottoms=_refined(h, y, bottoms, -1.0))


def _refined(h: Callable[[Array], Array], y: Array, places: Any, sign: float) -> tuple[Array, Array]:
    """Places and values of local extremes near the samples, by a finer sample around each."""
    found = []
    for place in places.tolist():
        near = np.linspace(y[place - 1], y[place + 1], 2001)
        values = sign * h(near)
        best = int(np.argmax(values))
        found.append((near[best], sign * values[best]))
    pairs = np.array(found, dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _sup(shape: Shape, face: int, s: float, own: Array, other: Array) -> tuple[Array, Any]:
    """phi = sup { h(s t)/s : -(own + other) <= t <= other - own }; where: 0 right end, 1 left end, 2 inside."""
    high, low = s * (other - own), -s * (other + own)
    best = face * shape.h(face * high) / s
    where = np.zeros(len(best), dtype=np.int64)
    places, values = shape.tops if face > 0 else shape.bottoms
    if not len(places):
        return best, where
    left = face * shape.h(face * low) / s
    where[left > best] = 1
    best = np.maximum(best, left)
    for place, top in zip((face * places).tolist(), (face * values).tolist(), strict=True):
        better = (low < place) & (place < high) & (top / s > best)
        best = np.where(better, top / s, best)
        where[better] = 2
    return best, where


def _derivatives(shape: Shape, face: int, s: float, own: Array, other: Array) -> tuple[Array, Array]:
    """The derivatives of phi in own and other."""
    where = _sup(shape, face, s, own, other)[1]
    at = face * s * np.where(where == 1, -(own + other), other - own)
    step = STEP * (1.0 + np.abs(at))
    slope = (shape.h(at + step) - shape.h(at - step)) / (2 * step)
    slope = np.where(where == 2, 0.0, np.where(where == 1, -slope, slope))
    return np.where(where == 1, slope, -slope), slope


def _scalar(coupling: Any) -> Callable[[Array], Array]:
    from dobc_design.coupling.expression import numpy_function

    return numpy_function(coupling.components[0])
