"""Sets of starts, how they are searched, and many starts run side by side, each with its own switches.

Starts are e (n m, R) and eps (n, q, R), one column for each of R runs: at random, at corners, at edges, and projected
back into the set after a step.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact.matrix import to_float
from dobc_design.falsification.levels import Level
from dobc_design.problem.arrays import Gain, arc_groups, consensus_jacobian, pinning_matrix
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import Array
from dobc_design.simulation.columns import COLLAPSED, ESCAPED, HANDED_BACK, Stack, integrate_stack
from dobc_design.simulation.ensemble import COLUMN_NUMBERS
from dobc_design.simulation.field import Loop, Network, make_closed_form, make_loop, network_of
from dobc_design.simulation.switches import IndexArray

Pair = tuple[Array, Array]
BoolArray = NDArray[np.bool_]

RANDOM, CORNERS, EDGES = "random", "corners", "edges"
AWAY = 1.0  # without a region: at most this far from the goal, in every component
MOST_ENUMERATED = 8  # components up to which all corners are taken in turn
SAMPLES = 121
TIME_CONSTANTS = 12.0  # of the slowest decay at the consensus that a run lasts
LONGEST = 20.0  # times the horizon of the problem at most
LARGEST_SPECTRUM = 300  # rows up to which the slowest decay is estimated
NEAR = 1e-3  # of the start: a run that ends closer has converged
STALLED = 0.8  # the part of its error halfway that a run still has at the end


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


StartSet = Box | Boundary


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arena:
    """The loop of a problem, ready to be run from many starts.  ``modes`` are the names of the modes."""

    problem: Problem
    loop: Loop
    modes: tuple[str, ...]
    networks: Callable[[int], Network]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals:
    """The active modes of R runs by index: times and modes (R, S), padded with inf and 0."""

    times: Array
    modes: IndexArray

    def of(self, run: int, names: tuple[str, ...]) -> tuple[tuple[float, str], ...]:
        """The switches of one run with the names of the modes."""
        pairs = zip(self.times[run].tolist(), self.modes[run].tolist(), strict=True)
        return tuple((time, names[mode]) for time, mode in pairs if time != np.inf)

    def chosen(self, runs: IndexArray) -> Signals:
        """Some of the runs."""
        return Signals(times=self.times[runs], modes=self.modes[runs])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runs:
    """What became of R starts: e (n m, R), eps (n, q, R), signals.

    times (T,) in s; error (T, R), |e|_inf, nan after an early end; values (T, R), V of a certified set, or nan;
    ends (n m, R); states (R,) as in ``simulation.columns``.
    """

    times: Array
    error: Array
    values: Array
    ends: Array
    states: IndexArray
    e: Array
    eps: Array
    signals: Signals

    def __len__(self) -> int:
        return int(self.e.shape[1])

    @property
    def unfinished(self) -> BoolArray:
        """Runs that took too many steps, about which nothing is said."""
        return np.asarray(self.states == HANDED_BACK)

    @property
    def diverged(self) -> BoolArray:
        """Runs that left every bound."""
        return np.asarray((self.states == ESCAPED) | (self.states == COLLAPSED))

    @property
    def stalled(self) -> BoolArray:
        """Runs that diverged, or that end far away without having come closer in the second half."""
        count = len(self.times)
        last = np.max(self.error[-count // 10 :], axis=0, initial=0.0)
        middle = np.max(self.error[int(0.45 * count) : int(0.55 * count) + 1], axis=0, initial=0.0)
        with np.errstate(invalid="ignore"):
            away = (last > NEAR * self.error[0]) & (last > STALLED * middle)
        return np.asarray((self.diverged | away) & ~self.unfinished)


def make_arena(problem: Problem, gain: Gain | None) -> Arena:
    """Prepare the loop; ``gain`` (q, m) is W.  Raises: SpecError if there is an exosystem and no W."""
    loop, names = make_loop(problem, gain), tuple(problem.network.modes)
    size = max(1, COLUMN_NUMBERS // (loop.n * loop.m))

    @cache
    def networks(mode: int) -> Network:
        return network_of(loop, arc_groups(problem, names[mode]), runs=size)

    return Arena(problem=problem, loop=loop, modes=names, networks=networks)


def settling_horizon(problem: Problem) -> float:
    """How long a run should last (s): the problem's horizon, or longer where the consensus is slow."""
    horizon = float(problem.simulation.t_final)
    if problem.n * problem.m > LARGEST_SPECTRUM:
        return horizon
    K, slowest = pinning_matrix(problem).toarray(), np.inf
    for mode in problem.network.modes:
        jacobian = consensus_jacobian(problem, mode)
        if jacobian is not None:
            slowest = min(slowest, -float(np.linalg.eigvals(jacobian.toarray() - K).real.max()))
    if not slowest > 0:
        return horizon
    return float(min(max(horizon, TIME_CONSTANTS / slowest), LONGEST * horizon))


def constant_signals(modes: IndexArray) -> Signals:
    """Each run in one mode (R,) all the time."""
    return Signals(times=np.zeros((len(modes), 1)), modes=modes[:, None].astype(np.int64))


def drawn_signals(rng: np.random.Generator, count: int, modes: int, horizon: float) -> Signals:
    """Every third run in one mode, the modes in turn; the others switch at random, at quite different paces."""
    first = np.arange(count) % modes
    if modes == 1:
        return constant_signals(first)
    paces = rng.choice((5, 20, 80), count)
    longest = 2 * int(paces.max(initial=1))
    steps = rng.exponential(size=(count, longest)) * (horizon / paces)[:, None]
    times = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
    chosen = np.concatenate([first[:, None], rng.integers(modes, size=(count, longest))], axis=1)
    fixed = np.arange(count) // modes % 3 == 0
    times[:, 1:][fixed] = np.inf
    times[times >= horizon] = np.inf
    return Signals(times=times, modes=np.where(np.isinf(times), 0, chosen))


def run_starts(
    arena: Arena,
    e: Array,
    eps: Array,
    signals: Signals,
    *,
    horizon: float,
    tolerance: float,
    samples: int = SAMPLES,
    level: Level | None = None,
) -> Runs:
    """Simulate every start; V of ``level`` is followed where there is one.

    eps decays in closed form; where the observer is too fast for that it counts as 0 from the start.
    """
    loop, count, times = arena.loop, e.shape[1], np.linspace(0.0, horizon, samples)
    closed = make_closed_form(loop.F, loop.C, horizon) if loop.q else None
    states = make_closed_form(loop.F, np.eye(loop.q), horizon) if loop.q else None
    if closed is None or states is None:
        eps = np.zeros_like(eps)
    error, values = np.full((samples, count), np.nan), np.full((samples, count), np.nan)
    ends, outcome = np.full_like(e, np.nan), np.zeros(count, dtype=np.int64)
    weights = None if states is None else np.moveaxis(states.many(times), 2, 0)
    size = max(1, COLUMN_NUMBERS // (loop.n * loop.m))
    for begin in range(0, count, size):
        part = slice(begin, min(count, begin + size))
        own = eps[:, :, part]

        def visit(sample: IndexArray, run: IndexArray, state: Array, begin: int = begin, own: Array = own) -> None:
            error[sample, begin + run] = np.abs(state).max(axis=0)
            if level is not None:
                there = own[:, :, run]
                if weights is not None:
                    there = np.einsum("kab,nbk->nak", weights[sample], there)
                values[sample, begin + run] = level.value(state, there)
            last = sample == samples - 1
            ends[:, begin + run[last]] = state[:, last]

        stack = Stack(
            loop=loop,
            networks=arena.networks,
            closed=closed,
            e=e[:, part],
            eps=own,
            switch_times=signals.times[part],
            switch_modes=signals.modes[part],
        )
        with np.errstate(all="ignore"):
            outcome[part] = integrate_stack(stack, times, tolerance=tolerance, visit=visit).states
    return Runs(times=times, error=error, values=values, ends=ends, states=outcome, e=e, eps=eps, signals=signals)
