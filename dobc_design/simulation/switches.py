"""When which mode is active on one horizon: drawn from a signal and a seed.

Graphs that follow from positions: ``mobile.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.random import Generator, default_rng

from dobc_design._checks import noun, positional
from dobc_design.errors import misshapen, refused, wrong
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Texts, counted, is_list, shown
from dobc_design.loop.arrays import ArcGroups, mode_index
from dobc_design.loop.make import loop_of
from dobc_design.problem.network import BoolArray, IndexArray
from dobc_design.problem.problem import Problem

from .signals import Fixed, Markov, Periodic, RandomDwell, Schedule, Scheduled

MOST_SWITCHES = 1_000_000  # of one run
STREAM = 1  # starts are drawn from default_rng(seed), switches from default_rng([seed, STREAM])
# of a mode with optional arcs, beside all of its arcs; instants at which some come or go
GRAPHS, CHANGES = 15, 60


@noun(eq=False)
class Switches:
    """Mode ``names[modes[s]]`` is active from ``times[s]`` s on; ``graphs``, by mode (2, arcs),
    where agents move."""

    times: Array
    modes: IndexArray
    names: Texts
    graphs: tuple[IndexArray, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.times, self.modes, *self.graphs):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def at(self, times: Array) -> IndexArray:
        """Index of the active mode at each of the times, (T,); at an instant of switching the new
        one."""
        return self.modes[np.searchsorted(self.times, times, side="right") - 1]

    def until(self, time: float) -> Switches:
        """Those up to a time."""
        count = int(np.searchsorted(self.times, time, side="right"))
        return Switches(
            times=self.times[:count].copy(),
            modes=self.modes[:count].copy(),
            names=self.names,
            graphs=self.graphs,
        )


@noun(eq=False)
class ModeTable:
    """The switches of R runs: instants and indices of modes (R, S), padded with inf and 0."""

    times: Array
    modes: IndexArray

    def of(self, runs: IndexArray) -> ModeTable:
        """The rows of some runs."""
        return ModeTable(times=self.times[runs], modes=self.modes[runs])

    def named(self, run: int, names: Texts) -> tuple[tuple[float, str], ...]:
        """The active modes of one run by name, each with the instant from which it is."""
        found = []
        for time, mode in zip(self.times[run].tolist(), self.modes[run].tolist(), strict=True):
            if time != np.inf:
                found.append((time, names[mode]))
        return tuple(found)


def table_of(switches: Sequence[Switches]) -> ModeTable:
    """The switches of some runs as one table."""
    # one column more: every run has a switch that never comes
    shape = (len(switches), 1 + max(map(len, switches)))
    times = np.full(shape, np.inf)
    modes = np.zeros(shape, dtype=np.int64)
    for row, each in enumerate(switches):
        times[row, : len(each)] = each.times
        modes[row, : len(each)] = each.modes
    return ModeTable(times=times, modes=modes)


def constant_signals(modes: IndexArray) -> ModeTable:
    """Each run in one mode (R,) all the time."""
    return ModeTable(times=np.zeros((len(modes), 1)), modes=modes[:, None].astype(np.int64))


def one_mode(name: str) -> Switches:
    """One mode throughout."""
    return Switches(times=np.zeros(1), modes=np.zeros(1, dtype=np.int64), names=(name,))


Drawn = tuple[Array, IndexArray]  # instants, and the modes from each of them on


def scheduled_switches(signal: Scheduled, names: Texts, horizon: float, seed: int) -> Switches:
    """Draw the switches of one run over ``horizon`` s.  Raises: SpecError for an unknown mode or
    too many switches."""
    rng = default_rng([seed, STREAM])
    if isinstance(signal, Fixed):
        mode = 0 if signal.mode is None else mode_index(signal.mode, names)
        times, modes = np.zeros(1), np.array([mode])
    elif isinstance(signal, Schedule):
        times = np.array([t for t in signal.times if t < horizon])
        modes = np.array([mode_index(mode, names) for mode in signal.modes[: len(times)]])
    elif isinstance(signal, Periodic):
        times, modes = _periodic(signal, names, horizon)
    elif isinstance(signal, RandomDwell):
        times, modes = _random(signal, len(names), horizon, rng)
    else:
        times, modes = _markov(signal, names, horizon, rng)
    # a mode that is drawn after itself goes on
    changes = np.concatenate([[True], modes[1:] != modes[:-1]])
    times = times[changes].astype(np.float64)
    modes = modes[changes].astype(np.int64)
    return Switches(times=times, modes=modes, names=names)


@noun(eq=False)
class DrawnGraph:
    """Some of the arcs of a mode: those that are ``there``, (arcs,)."""

    mode: str
    there: BoolArray


def drawn_graphs(problem: Problem) -> dict[str, DrawnGraph]:
    """Graphs of the modes with optional arcs: none of them, each the other way round, and some at
    random."""
    found = {}
    for mode, arcs in loop_of(problem).modes.items():
        # the same graphs for every run: what they cost is shared
        draws = default_rng(0).random((GRAPHS, arcs.optional)) < 0.5
        if not arcs.optional:
            continue
        draws[0] = False  # the fewest arcs that there can be
        always = np.ones(len(arcs) - arcs.optional, dtype=bool)
        for k, draw in enumerate(draws):
            name = f"{mode}, draw {k}" if k else f"{mode}, no optional arc"
            found[name] = DrawnGraph(mode=mode, there=np.append(always, draw))
    return found


def drawn_switches(signal: Scheduled, problem: Problem, horizon: float, seed: int) -> Switches:
    """``scheduled_switches``, with optional arcs that come and go at random instants."""
    switches = scheduled_switches(signal, tuple(problem.network.modes), horizon, seed)
    graphs = drawn_graphs(problem)
    if not graphs:
        return switches
    # a stream of its own: the switches of the modes stay as they are without optional arcs
    rng = default_rng([seed, STREAM, STREAM])
    # a mode as it stands in the file, or one of its drawn graphs
    names = (*switches.names, *graphs)
    choices = {mode: [names.index(mode)] for mode in switches.names}
    for name, graph in graphs.items():
        choices[graph.mode].append(names.index(name))
    instants = rng.uniform(0.0, horizon, CHANGES)
    times = np.unique(np.concatenate([switches.times, instants]))
    modes = [rng.choice(choices[names[mode]]) for mode in switches.at(times).tolist()]
    return Switches(times=times, modes=np.array(modes), names=names)


def refuse_too_many(count: float) -> None:
    """Refuse a signal that would switch more often than can be stored.  Raises: SpecError."""
    if not count <= MOST_SWITCHES:
        message = (
            f"the signal would switch about {count:.3g} times, and at most {MOST_SWITCHES} are "
            "simulated."
        )
        cure = "Choose a longer dwell time or a shorter horizon."
        raise refused("signal", message, cure)


def _order(order: Texts | None, names: Texts, length: int | None, key: str) -> IndexArray:
    """The modes of a signal by index; ``length`` numbers of the argument ``key`` belong to them."""
    if order is None:
        order = names
    found = np.array([mode_index(mode, names) for mode in order])
    if length is not None and length != len(found):
        entries = counted(len(found), "entry").replace("entrys", "entries")
        message = f"must have {entries}, one per mode; got {length}."
        cure = "Give one per mode, or name the modes with order."
        raise misshapen(key, message, cure)
    return found


def _periodic(signal: Periodic, names: Texts, horizon: float) -> Drawn:
    given = np.atleast_1d(np.asarray(signal.dwell, dtype=np.float64))
    several = is_list(signal.dwell)
    order = _order(signal.order, names, len(given) if several else None, "dwell")
    # one dwell time stands for all modes
    ends = np.cumsum(np.broadcast_to(given, len(order)))
    rounds = horizon / float(ends[-1])
    refuse_too_many(rounds * len(order))
    modes = np.tile(order, int(rounds) + 1)
    # Multiples of the period, not a running sum: the instants carry one rounding each.
    if several:
        begins = np.concatenate([[0.0], ends[:-1]])
        turns = np.arange(int(rounds) + 1)[:, None]
        times = np.asarray((turns * ends[-1] + begins).ravel(), dtype=np.float64)
    else:
        times = np.asarray(given[0] * np.arange(len(modes)), dtype=np.float64)
    seen: BoolArray = times < horizon
    return times[seen], modes[seen]


def _random(signal: RandomDwell, count: int, horizon: float, rng: Generator) -> Drawn:
    dwell = signal.dwell
    draws = horizon / dwell
    refuse_too_many(draws)
    most = int(draws) + 1
    modes = rng.integers(count, size=most)
    if signal.longest is None:
        times = dwell * np.arange(most)
    else:
        # every draw is another mode than the one before: so many places further in the cycle
        further = rng.integers(1, max(2, count), size=most - 1)
        modes = np.cumsum([modes[0], *further]) % count
        stays = rng.uniform(dwell, signal.longest, size=most)
        times = np.concatenate([[0.0], np.cumsum(stays)[:-1]])
    seen: BoolArray = times < horizon
    return np.asarray(times[seen]), modes[seen]


def _markov(signal: Markov, names: Texts, horizon: float, rng: Generator) -> Drawn:
    order = _order(signal.order, names, len(signal.generator), "generator")
    rates = np.array(signal.generator)
    start = order[0] if signal.start is None else mode_index(signal.start, names)
    if start not in order:
        message = f"must be one of order; got {shown(signal.start)}."
        raise wrong("start", message, "Name one of them.")
    now = int(np.flatnonzero(order == start)[0])
    time = 0.0
    times = [time]
    places = [now]
    while True:
        # a jump after an exponential time, to another mode in proportion to its rate
        away = np.where(np.arange(len(rates)) == now, 0.0, rates[now])
        leaving = float(away.sum())
        if leaving == 0:
            break
        # the stay in a mode has no memory
        time += float(rng.exponential(1 / leaving))
        if time >= horizon:
            break
        now = int(np.searchsorted(np.cumsum(away), leaving * rng.random(), side="right"))
        times.append(time)
        places.append(now)
        if len(times) % 1000 == 0:
            refuse_too_many(len(times) * horizon / time)
    return np.array(times), order[np.array(places)]


PositionsAt = Callable[[float], Array]
Change = Callable[[Array, PositionsAt], float | None]


class Stay(NamedTuple):
    """The active mode by index, and until when in s; ``change(times in a step, x by time)`` may
    find an earlier end."""

    mode: int
    end: float
    change: Change | None = None


@positional(eq=False)
class Planned:
    """Modes that are known beforehand; ``groups`` gives the arcs of a mode by its index."""

    switches: Switches
    groups: Callable[[int], ArcGroups]
    horizon: float

    def stay(self, time: float, positions: Array) -> Stay:
        """The mode at a time."""
        switches = self.switches
        place = int(np.searchsorted(switches.times, time, side="right"))
        end = self.horizon
        if place < len(switches):
            end = float(switches.times[place])
        return Stay(int(switches.modes[place - 1]), end)
