"""Boxes of starts in terms of e and eps, and how starts are drawn from them.

Starts are e (n m, R) and eps = xi - xihat (n, q, R), a column for each run.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from dobc_design.exact.matrix import to_float
from dobc_design.loop.matrices import Array
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import ClosedLoop
from dobc_design.simulation.starts import AWAY, TINY

Pair = tuple[Array, Array]  # e and eps

RANDOM, CORNERS, EDGES = "random", "corners", "edges"
MOST_ENUMERATED = 8  # components up to which all corners are taken in turn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """low <= e <= high, both (n m,), and |eps_i| <= radius for every agent of the loop."""

    words: str
    loop: ClosedLoop
    low: Array
    high: Array
    radius: float

    @property
    def owned(self) -> Array:
        """1 where a number of eps is the agent's own, (n, q)."""
        return self.loop.owned.astype(np.float64)

    @property
    def reach(self) -> Pair:
        """How far the set reaches from side to side, by number of e and of eps."""
        return self.high - self.low, 2 * self.radius * self.owned

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        """Starts of one kind: anywhere, at corners, or on sides; eps anywhere or at the most."""
        part = unit_cube(rng, len(self.low), count, kind)
        width = (self.high - self.low)[:, None]
        e = self.low[:, None] + width * (part + 1) / 2
        own = self.owned
        lengths: Array | float = 1.0
        if kind == RANDOM:
            sizes = np.maximum(1.0, own.sum(axis=1))[:, None, None]
            lengths = rng.random((len(own), 1, count)) ** (1 / sizes)
        return e, self.radius * lengths * sphere(rng, own, count)

    def project(self, e: Array, eps: Array) -> Pair:
        """The nearest starts of the set, about."""
        eps = eps * self.owned[:, :, None]
        lengths = np.linalg.norm(eps, axis=1, keepdims=True)
        factor = np.minimum(1.0, self.radius / np.maximum(lengths, TINY))
        return np.clip(e, self.low[:, None], self.high[:, None]), eps * factor

    def holds(self, e: Array) -> bool:
        """Whether e (n m,) with eps = 0 is in the set, but for rounding."""
        slack = 1e-9 * (1 + np.abs(self.high) + np.abs(self.low))
        above = self.low - slack <= e
        return bool(np.all(above & (e <= self.high + slack)))


def asked_box(
    problem: Problem,
    loop: ClosedLoop,
    *,
    radius: float | None = None,
    disturbance: float | None = None,
) -> Box:
    """|e|_inf <= radius, else the region, else |e|_inf <= 1; |eps_i| as asked, else the region's,
    else 0."""
    region = problem.region
    goal = loop.goal.ravel()
    if radius is None and region is not None:
        low, high = np.tile(to_float(region.initial_states), (problem.n, 1)).T - goal
        words = "the region"
    else:
        far = AWAY if radius is None else radius
        high = np.full(len(goal), far)
        low = -high
        words = f"|e|_inf <= {far:.4g}"
    if disturbance is None:
        disturbance = 0.0 if region is None else float(region.initial_disturbance or 0)
    return Box(words=words, low=low, high=high, radius=disturbance, loop=loop)


def unit_cube(rng: np.random.Generator, rows: int, count: int, kind: str) -> Array:
    """Points of [-1, 1]^rows, (rows, count): anywhere, at corners (all where there are few), or on
    sides."""
    inside = rng.uniform(-1, 1, (rows, count))
    signs = rng.choice((-1.0, 1.0), (rows, count))
    if kind == RANDOM:
        return inside
    if kind == EDGES:
        at_end = rng.random((rows, count)) < rng.random(count)
        sides = rng.integers(rows, size=count)
        at_end[sides, np.arange(count)] = True  # one at least
        return np.where(at_end, signs, inside)
    if rows <= MOST_ENUMERATED:
        every = np.array(list(product((-1.0, 1.0), repeat=rows))).T
        signs[:, : every.shape[1]] = every[:, :count]
    else:
        signs[:, :2] = np.array([-1.0, 1.0])[:count]
    return signs


def sphere(rng: np.random.Generator, own: Array, count: int) -> Array:
    """Unit vectors of the numbers that are an agent's own, (n, q, count) for ``own`` (n, q)."""
    directions = rng.standard_normal((*own.shape, count)) * own[:, :, None]
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(directions / np.maximum(lengths, TINY))
