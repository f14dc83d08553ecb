"""Sets of starts and how they are searched: at random, at corners, at edges, and back into the set after a step.

Starts are e (n m, R) and eps (n, q, R), one column for each of R runs.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact.matrix import to_float
from dobc_design.falsification.levels import Level
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import Loop

Array = NDArray[np.float64]
Pair = tuple[Array, Array]

RANDOM, CORNERS, EDGES = "random", "corners", "edges"
AWAY = 1.0  # without a region: at most this far from the goal, in every component
MOST_ENUMERATED = 8  # components up to which all corners are taken in turn


class StartSet(Protocol):
    """Where starts may lie."""

    @property
    def words(self) -> str:
        """The set in words."""

    @property
    def reach(self) -> Pair:
        """How far a step may go: lengths by component, e (n m,) and eps (n, q)."""

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        """``count`` starts of one kind."""

    def project(self, e: Array, eps: Array) -> Pair:
        """Starts of the set near those given."""

    def holds(self, e: Array) -> bool:
        """Whether e (n m,) with eps = 0 lies in the set, up to rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """low <= e <= high, both (n m,), and |eps_i| <= radius for n agents with q numbers each.

    ``own`` (n, q): which of these are an agent's own, where agents have different exosystems; the others stay 0.
    """

    words: str
    low: Array
    high: Array
    radius: float
    n: int
    q: int
    own: NDArray[np.bool_] | None = None

    @property
    def reach(self) -> Pair:
        return self.high - self.low, 2 * self.radius * _owned(self)

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        part = unit_cube(rng, len(self.low), count, kind)
        e = self.low[:, None] + (self.high - self.low)[:, None] * (part + 1) / 2
        sizes = np.maximum(1.0, _owned(self).sum(axis=1))[:, None, None]
        lengths = rng.random((self.n, 1, count)) ** (1 / sizes) if kind == RANDOM else 1.0
        return e, self.radius * lengths * sphere(rng, _owned(self), count)

    def project(self, e: Array, eps: Array) -> Pair:
        eps = eps * _owned(self)[:, :, None]
        lengths = np.linalg.norm(eps, axis=1, keepdims=True)
        factor = np.minimum(1.0, self.radius / np.maximum(lengths, 1e-300))
        return np.clip(e, self.low[:, None], self.high[:, None]), eps * factor

    def holds(self, e: Array) -> bool:
        slack = 1e-9 * (1 + np.abs(self.high) + np.abs(self.low))
        return bool(np.all((self.low - slack <= e) & (e <= self.high + slack)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundary:
    """V = 1 for a certified set; a third of the starts has eps = 0.  ``own`` as in ``Box``."""

    words: str
    level: Level
    rows: int
    n: int
    q: int
    own: NDArray[np.bool_] | None = None

    @property
    def reach(self) -> Pair:
        width = 0.0 if self.level.P is None else 2 / np.sqrt(max(1e-300, float(np.trace(self.level.P)) / self.q))
        return self.level.lengths, width * _owned(self)

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        part = rng.standard_normal((self.rows, count)) if kind == RANDOM else unit_cube(rng, self.rows, count, kind)
        e = self.level.directions(part)
        eps = sphere(rng, _owned(self), count) * rng.random((self.n, 1, count))
        none = np.zeros_like(eps)
        sizes, own = self.level.value(e, none), self.level.value(np.zeros_like(e), eps)
        share = rng.random(count) * (rng.random(count) < 2 / 3)
        if self.level.P is None:
            share, eps = np.zeros(count), none
        e = e * ((1 - share) / np.maximum(sizes, 1e-300))
        return self.project(e, eps * (share / np.maximum(own, 1e-300)))

    def project(self, e: Array, eps: Array) -> Pair:
        eps = np.zeros_like(eps) if self.level.P is None else eps * _owned(self)[:, :, None]
        size = np.maximum(self.level.value(e, eps), 1e-300)
        return e / size, eps / size

    def holds(self, e: Array) -> bool:
        return bool(self.level.value(e[:, None], np.zeros((self.n, self.q, 1)))[0] <= 1 + 1e-9)


def asked_box(problem: Problem, loop: Loop, *, radius: float | None, disturbance: float | None) -> Box:
    """The box around the goals, |e|_inf <= radius; without a radius the region, without that |e|_inf <= 1.

    ``disturbance`` bounds |eps_i|; without it the region's, else 0.
    """
    region, goal = problem.region, loop.goal.ravel()
    if radius is None and region is not None:
        pairs = np.tile(to_float(region.initial_states), (problem.n, 1))
        low, high, words = pairs[:, 0] - goal, pairs[:, 1] - goal, "the region"
    else:
        far = AWAY if radius is None else radius
        low, high, words = np.full(len(goal), -far), np.full(len(goal), far), f"|e|_inf <= {far:.4g}"
    if disturbance is None:
        disturbance = 0.0
        if region is not None and region.initial_disturbance is not None:
            disturbance = float(region.initial_disturbance)
    return Box(words=words, low=low, high=high, radius=disturbance, n=problem.n, q=loop.q, own=loop.own)


def _owned(starts: Box | Boundary) -> Array:
    """1 where a number of eps is the agent's own, (n, q)."""
    return np.ones((starts.n, starts.q)) if starts.own is None else starts.own.astype(np.float64)


def unit_cube(rng: np.random.Generator, rows: int, count: int, kind: str) -> Array:
    """Points of [-1, 1]^rows, (rows, count): anywhere, at corners, or on sides of any dimension.

    Corners: all low and all high first, and every one where there are few.
    """
    inside = rng.uniform(-1, 1, (rows, count))
    signs = rng.choice((-1.0, 1.0), (rows, count))
    if kind == RANDOM:
        return inside
    if kind == EDGES:
        at_end = rng.random((rows, count)) < rng.random(count)
        at_end[rng.integers(rows, size=count), np.arange(count)] = True
        return np.where(at_end, signs, inside)
    if rows <= MOST_ENUMERATED:
        every = np.array(list(itertools.product((-1.0, 1.0), repeat=rows))).T
        signs[:, : every.shape[1]] = every[:, :count]
    else:
        signs[:, :2] = np.array([-1.0, 1.0])[:count]
    return signs


def sphere(rng: np.random.Generator, own: Array, count: int) -> Array:
    """Unit vectors of the numbers that are an agent's own, (n, q, count) for ``own`` (n, q)."""
    directions = rng.standard_normal((*own.shape, count)) * own[:, :, None]
    return np.asarray(directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300))
