"""Many starts of one problem, run side by side in floats: which of them converge.

What is seen is an observation, never a proof; searches take their points from the ends of runs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Texts
from dobc_design.loop.arrays import Gain, error_arcs
from dobc_design.loop.make import errors_of
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.problem.network import BoolArray, IndexArray
from dobc_design.problem.problem import Problem

from .closed_form import make_closed_form
from .columns import COLLAPSED, COLUMN_NUMBERS, ESCAPED, HANDED_BACK, MOST_STEPS, CalmColumns
from .field import ClosedLoop, Network, Networks, make_closed_loop, network_of
from .switches import ModeTable

Value = Callable[[Array, Array], Array]

SAMPLES = 121
TIME_CONSTANTS = 12.0  # of the slowest decay at the consensus that a run lasts
LONGEST = 20.0  # times the horizon of the problem at most
LARGEST_SPECTRUM = 300  # rows up to which the slowest decay is estimated
NEAR = 1e-3  # of the start: a run that ends closer has converged
STALLED = 0.8  # the part of its error halfway that a run still has at the end


@noun(eq=False)
class Arena:
    """The loop of a problem, ready to be run from many starts.  ``modes`` are the names of the
    modes, ``networks`` the right-hand sides by their index."""

    problem: Problem
    loop: ClosedLoop
    modes: Texts
    networks: Networks

    @property
    def chunk(self) -> int:
        """How many runs are made at once."""
        return max(1, COLUMN_NUMBERS // self.loop.size)


def make_arena(problem: Problem, gain: Gain | None) -> Arena:
    """Prepare the loop; ``gain`` (q, m) is W.  Raises: SpecError if there is an exosystem and no
    W."""
    exact = errors_of(problem)
    loop = make_closed_loop(problem, gain)
    names = tuple(problem.network.modes)

    @cache
    def network(mode: int) -> Network:
        return network_of(loop, error_arcs(exact, names[mode]), runs=arena.chunk)

    arena = Arena(problem=problem, loop=loop, modes=names, networks=network)
    return arena


@noun(eq=False)
class Batch:
    """Starts of R runs, e (n m, R) and eps (n, q, R), and their switches."""

    e: Array
    eps: Array
    switches: ModeTable

    def __len__(self) -> int:
        return len(self.switches.times)

    def of(self, runs: IndexArray) -> Batch:
        """Some of the starts."""
        return Batch(e=self.e[:, runs], eps=self.eps[:, :, runs], switches=self.switches.of(runs))


@noun
class Effort:
    """How long runs last, in s, how exact they are (relative), at how many times they are looked
    at, and how many steps each may take."""

    horizon: float
    tolerance: float
    samples: int = SAMPLES
    most: int = MOST_STEPS


@noun(eq=False)
class Trials:
    """What became of R starts: error and values (T, R) are |e|_inf and V, or nan; ends (n m, R),
    nan where a run ended early; states (R,) as in ``columns``."""

    times: Array
    error: Array
    values: Array
    ends: Array
    states: IndexArray
    starts: Batch

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def unfinished(self) -> BoolArray:
        """Runs that took too many steps, about which nothing is said."""
        return np.asarray(self.states == HANDED_BACK)

    @property
    def diverged(self) -> BoolArray:
        """Runs that could not be carried to their end."""
        return np.isin(self.states, (ESCAPED, COLLAPSED))

    @property
    def stalled(self) -> BoolArray:
        """Runs that diverged, or that end far away without having come closer in the second
        half."""
        error = self.error
        count = len(self.times)
        last = np.max(error[-count // 10 :], axis=0, initial=0.0)
        # over a tenth of the time: an error that oscillates is not 0 by chance
        halfway = error[int(0.45 * count) : int(0.55 * count) + 1]
        middle = np.max(halfway, axis=0, initial=0.0)
        with np.errstate(invalid="ignore"):
            away = (last > NEAR * error[0]) & (last > STALLED * middle)
        return np.asarray((self.diverged | away) & ~self.unfinished)

    @property
    def resting_points(self) -> list[Array]:
        """Where runs stalled, (n m,) each."""
        return list(self.ends.T[self.stalled & ~self.diverged])


def settling_horizon(problem: Problem) -> float:
    """How long a run should last (s): the problem's horizon, or longer where the consensus is
    slow."""
    horizon = float(problem.simulation.t_final)
    if problem.n * problem.m > LARGEST_SPECTRUM:
        return horizon
    loop = errors_of(problem)
    pulls = pull_matrix(loop).toarray()
    # the mode in which errors last longest
    slowest = np.inf
    for mode in loop.modes:
        jacobian = consensus_jacobian(loop, mode)
        if jacobian is not None:
            eigenvalues = np.linalg.eigvals(jacobian.toarray() - pulls)
            slowest = min(slowest, -float(eigenvalues.real.max()))
    if not slowest > 0:
        return horizon
    return float(min(max(horizon, TIME_CONSTANTS / slowest), LONGEST * horizon))


def run_starts(
    arena: Arena, starts: Batch, effort: Effort, *, value: Value | None = None
) -> Trials:
    """Simulate every start; V = ``value``(e, eps) is followed, (R,) of states (n m, R) and (n, q,
    R).  Where the observer is too fast, eps = 0 from the start."""
    horizon = effort.horizon
    loop = arena.loop
    q = loop.q
    closed = make_closed_form(loop.F, loop.C, horizon) if q else None
    states = make_closed_form(loop.F, np.eye(q), horizon) if q else None
    # |F| times the horizon is too large for a table
    if closed is None or states is None:
        starts = Batch(e=starts.e, eps=np.zeros_like(starts.eps), switches=starts.switches)
    times = np.linspace(0.0, horizon, effort.samples)
    shape = (len(times), len(starts))
    # nothing is known yet
    trials = Trials(
        times=times,
        error=np.full(shape, np.nan),
        values=np.full(shape, np.nan),
        ends=np.full_like(starts.e, np.nan),
        states=np.zeros(len(starts), dtype=np.int64),
        starts=starts,
    )
    transition = None if states is None else np.moveaxis(states.many(times), 2, 0)
    for begin in range(0, len(starts), arena.chunk):
        chosen = np.arange(begin, min(len(starts), begin + arena.chunk))
        part = starts.of(chosen)
        columns = CalmColumns(
            loop=loop,
            networks=arena.networks,
            closed=closed,
            e=part.e,
            eps=part.eps,
            switches=part.switches,
        )
        watch = _Watch(trials=trials, chosen=chosen, transition=transition, value=value)
        with np.errstate(all="ignore"):
            ends = columns.integrate(
                times, tolerance=effort.tolerance, visit=watch.visit, most=effort.most
            )
        trials.states[chosen] = ends.states
    return trials


@noun(eq=False)
class _Watch:
    """Puts down what is seen of the ``chosen`` runs; ``transition``: exp(F t), which takes eps from
    the start to every sample."""

    trials: Trials
    chosen: IndexArray
    transition: Array | None
    value: Value | None

    def visit(self, sample: IndexArray, run: IndexArray, e: Array) -> None:
        """Errors e (n m, k) of runs at their samples."""
        trials = self.trials
        run = self.chosen[run]
        trials.error[sample, run] = np.abs(e).max(axis=0)
        if self.value is not None:
            eps = trials.starts.eps[:, :, run]
            if self.transition is not None:
                eps = np.einsum("kab,nbk->nak", self.transition[sample], eps)
            trials.values[sample, run] = self.value(e, eps)
        last = sample == len(trials.times) - 1
        trials.ends[:, run[last]] = e[:, last]
