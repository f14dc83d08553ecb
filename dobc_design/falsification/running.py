"""Many starts run side by side, each with its own switches, and which of them do not settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dobc_design.falsification.levels import Level
from dobc_design.problem.arrays import Gain, arc_groups, consensus_jacobian, pinning_matrix
from dobc_design.problem.problem import Problem
from dobc_design.simulation.columns import COLLAPSED, ESCAPED, HANDED_BACK, Stack, integrate_stack
from dobc_design.simulation.ensemble import COLUMN_NUMBERS
from dobc_design.simulation.field import Loop, Network, make_closed_form, make_loop, network_of

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SAMPLES = 121
TIME_CONSTANTS = 12.0  # of the slowest decay at the consensus that a run lasts
LONGEST = 20.0  # times the horizon of the problem at most
LARGEST_SPECTRUM = 300  # rows up to which the slowest decay is estimated
NEAR = 1e-3  # of the start: a run that ends closer has converged
STALLED = 0.8  # the part of its error halfway that a run still has at the end


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
    shown: Callable[[float], None] | None = None,
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
        if shown is not None:
            shown((part.stop) / count)
    return Runs(times=times, error=error, values=values, ends=ends, states=outcome, e=e, eps=eps, signals=signals)
