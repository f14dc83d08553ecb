"""When which mode is active on one horizon: drawn from a signal and a seed, or followed from
positions.

A link that is made at one distance is broken at a larger one, so that an agent at the edge does not
make the graph chatter.  Arcs of such graphs have weight 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dobc_design.errors import ShapeError, SpecError, wrong
from dobc_design.exact.reading import counted, is_list, shown
from dobc_design.problem.arrays import ArcGroup, Array, mode_index, places_at, split_by
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem
from dobc_design.simulation.signals import (
    Fixed,
    Markov,
    Mobile,
    Periodic,
    RandomDwell,
    Schedule,
    Scheduled,
    Waypoints,
)

MOST_SWITCHES = 1_000_000  # of one run
STREAM = 1  # starts are drawn from default_rng(seed), switches from default_rng([seed, STREAM])
LOOKS = 8  # times at which the graph is looked at within one step of the integrator
LOOKS_OF_MOTION = 64  # ... and within one piece of a given motion
# of a mode with optional arcs, beside all of its arcs; instants at which some come or go
GRAPHS, CHANGES = 15, 60
CHATTER = 50  # switches of a run within a billionth of the time so far, which count as chattering
MOST_CHANGES = 100_000  # switches of one run whose graphs follow from its states


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Switches:
    """Mode ``names[modes[s]]`` is active from ``times[s]`` s on; ``graphs``, by mode (2, arcs),
    where agents move."""

    times: Array
    modes: IndexArray
    names: tuple[str, ...]
    graphs: tuple[IndexArray, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.times, self.modes, *self.graphs):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.times)

    def at(self, times: Array) -> IndexArray:
        """Index of the active mode at each of the times, (T,); at an instant of switching the new
        one."""
        return np.asarray(self.modes[np.searchsorted(self.times, times, side="right") - 1])


def one_mode(name: str) -> Switches:
    """One mode throughout."""
    return Switches(times=np.zeros(1), modes=np.zeros(1, dtype=np.int64), names=(name,))


def scheduled_switches(
    signal: Scheduled, names: tuple[str, ...], horizon: float, seed: int
) -> Switches:
    """Draw the switches of one run over ``horizon`` s.  Raises: SpecError for an unknown mode or
    too many switches."""
    rng = np.random.default_rng([seed, STREAM])
    if isinstance(signal, Fixed):
        times, modes = (
            np.zeros(1),
            np.array([0 if signal.mode is None else mode_index(signal.mode, names)]),
        )
    elif isinstance(signal, Schedule):
        times = np.array([t for t in signal.times if t < horizon])
        modes = np.array([mode_index(mode, names) for mode in signal.modes[: len(times)]])
    elif isinstance(signal, Periodic):
        times, modes = _periodic(signal, names, horizon)
    elif isinstance(signal, RandomDwell):
        times, modes = _random(signal, len(names), horizon, rng)
    else:
        times, modes = _markov(signal, names, horizon, rng)
    changes = np.concatenate([[True], modes[1:] != modes[:-1]])
    return Switches(
        times=times[changes].astype(np.float64), modes=modes[changes].astype(np.int64), names=names
    )


def drawn_graphs(problem: Problem) -> dict[str, tuple[str, Any]]:
    """Graphs of the modes with optional arcs: none of them, each the other way round, and some at
    random."""
    found = {}
    for mode, arcs in problem.network.modes.items():
        draws = np.random.default_rng(0).random((GRAPHS, arcs.optional)) < 0.5
        draws[:1] = False
        for k, draw in enumerate(draws if arcs.optional else ()):
            name = f"{mode}, {'no optional arc' if not k else f'draw {k}'}"
            found[name] = (mode, np.append(np.ones(len(arcs) - arcs.optional, dtype=bool), draw))
    return found


def drawn_switches(signal: Scheduled, problem: Problem, horizon: float, seed: int) -> Switches:
    """``scheduled_switches``, with optional arcs that come and go at random instants."""
    switches = scheduled_switches(signal, tuple(problem.network.modes), horizon, seed)
    graphs, rng = drawn_graphs(problem), np.random.default_rng([seed, STREAM, STREAM])
    if not graphs:
        return switches
    names = (*switches.names, *graphs)
    choices = {
        mode: [names.index(x) for x in (mode, *(x for x in graphs if graphs[x][0] == mode))]
        for mode in names
    }
    times = np.unique(np.concatenate([switches.times, rng.uniform(0.0, horizon, CHANGES)]))
    modes = np.array([rng.choice(choices[names[mode]]) for mode in switches.at(times).tolist()])
    return Switches(times=times, modes=modes, names=names)


def refuse_too_many(count: float) -> None:
    """Refuse a signal that would switch more often than can be stored.  Raises: SpecError."""
    if not count <= MOST_SWITCHES:
        message = (
            f"the signal would switch about {count:.3g} times, and at most {MOST_SWITCHES} are "
            "simulated."
        )
        raise SpecError(
            message, key="signal", cure="Choose a longer dwell time or a shorter horizon."
        )


def _order(
    order: tuple[str, ...] | None, names: tuple[str, ...], length: int | None, key: str
) -> IndexArray:
    found = np.array([mode_index(mode, names) for mode in (names if order is None else order)])
    if length is not None and length != len(found):
        message = (
            f"must have {counted(len(found), 'entry').replace('entrys', 'entries')}, one per "
            f"mode; got {length}."
        )
        raise wrong(
            key, message, "Give one per mode, or name the modes with order.", kind=ShapeError
        )
    return found


def _periodic(signal: Periodic, names: tuple[str, ...], horizon: float) -> tuple[Array, IndexArray]:
    given = np.atleast_1d(np.asarray(signal.dwell, dtype=np.float64))
    order = _order(signal.order, names, len(given) if is_list(signal.dwell) else None, "dwell")
    ends = np.cumsum(np.broadcast_to(given, len(order)))
    rounds = horizon / float(ends[-1])
    refuse_too_many(rounds * len(order))
    modes = np.tile(order, int(rounds) + 1)
    # Multiples of the period, not a running sum: the instants carry one rounding each.
    times: Array = np.asarray(given[0] * np.arange(len(modes)), dtype=np.float64)
    if is_list(signal.dwell):
        begins = np.concatenate([[0.0], ends[:-1]])
        times = np.asarray(
            (np.arange(int(rounds) + 1)[:, None] * ends[-1] + begins).ravel(), dtype=np.float64
        )
    return times[times < horizon], modes[times < horizon]


def _random(
    signal: RandomDwell, count: int, horizon: float, rng: np.random.Generator
) -> tuple[Array, IndexArray]:
    draws = horizon / signal.dwell
    refuse_too_many(draws)
    most = int(draws) + 1
    modes = rng.integers(count, size=most)
    if signal.longest is None:
        times = signal.dwell * np.arange(most)
    else:
        modes = np.cumsum([modes[0], *rng.integers(1, max(2, count), size=most - 1)]) % count
        times = np.concatenate(
            [[0.0], np.cumsum(rng.uniform(signal.dwell, signal.longest, size=most))[:-1]]
        )
    seen: Any = times < horizon
    return np.asarray(times[seen]), modes[seen]


def _markov(
    signal: Markov, names: tuple[str, ...], horizon: float, rng: np.random.Generator
) -> tuple[Array, IndexArray]:
    order = _order(signal.order, names, len(signal.generator), "generator")
    rates = np.array(signal.generator)
    start = order[0] if signal.start is None else mode_index(signal.start, names)
    if start not in order:
        raise wrong(
            "start", f"must be one of order; got {shown(signal.start)}.", "Name one of them."
        )
    now = int(np.flatnonzero(order == start)[0])
    time, times, modes = 0.0, [0.0], [now]
    while True:
        away = np.where(np.arange(len(rates)) == now, 0.0, rates[now])
        leaving = float(away.sum())
        if leaving == 0:
            break
        time += float(rng.exponential(1 / leaving))
        if time >= horizon:
            break
        now = int(np.searchsorted(np.cumsum(away), leaving * rng.random(), side="right"))
        times.append(time)
        modes.append(now)
        if len(times) % 1000 == 0:
            refuse_too_many(len(times) * horizon / time)
    return np.array(times), order[np.array(modes)]


def near(signal: Mobile, positions: Array, before: IndexArray | None) -> IndexArray:
    """The links at positions (n, k) after those ``before``: sorted codes listener * n + speaker."""
    kept = np.zeros(0, dtype=np.int64) if before is None else before
    if signal.radius is not None:
        return _within(positions, signal.radius, signal.hysteresis, kept)
    return _nearest(
        positions, min(signal.neighbours or 1, len(positions) - 1), signal.hysteresis, kept
    )


def _within(positions: Array, radius: float, hysteresis: float, kept: IndexArray) -> IndexArray:
    n = len(positions)
    pairs = (
        cKDTree(positions).query_pairs(radius + hysteresis, output_type="ndarray").astype(np.int64)
    )
    first, second = pairs[:, 0], pairs[:, 1]
    distances = np.linalg.norm(positions[first] - positions[second], axis=1)
    linked = (distances <= radius) | np.isin(first * n + second, kept)
    first, second = first[linked], second[linked]
    return np.sort(np.concatenate([first * n + second, second * n + first]))


def _nearest(positions: Array, count: int, hysteresis: float, kept: IndexArray) -> IndexArray:
    """Each agent's ``count`` smallest distances, where those to present neighbours count less by
    the hysteresis."""
    n = len(positions)
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    _, found = cKDTree(positions).query(positions, k=min(n, count + 1))
    codes = np.unique(
        np.concatenate([np.repeat(np.arange(n), found.shape[1]) * n + found.ravel(), kept])
    )
    listeners, speakers = codes // n, codes % n
    other = listeners != speakers
    codes, listeners, speakers = codes[other], listeners[other], speakers[other]
    distances = np.linalg.norm(positions[listeners] - positions[speakers], axis=1)
    order = np.lexsort((codes, distances - hysteresis * np.isin(codes, kept), listeners))
    rank = np.arange(len(order)) - np.searchsorted(listeners[order], listeners[order])
    return np.sort(codes[order[rank < count]])


def groups_of(problem: Problem, codes: IndexArray) -> tuple[ArcGroup, ...]:
    """The links as arcs of weight 1, grouped by coupling."""
    n = problem.n
    return tuple(
        ArcGroup(
            coupling=problem.couplings[place],
            listeners=codes[links] // n,
            speakers=codes[links] % n,
            weights=np.ones(len(links)),
        )
        for place, links in split_by(places_at(problem, codes))
    )


Change = Callable[[Array, Callable[[float], Array]], float | None]


class Stay(NamedTuple):
    """The active mode by index, and until when in s; ``change(times in a step, x by time)`` may
    find an earlier end."""

    mode: int
    end: float
    change: Change | None = None


class Planned:
    """Modes that are known beforehand; ``groups`` gives the arcs of a mode by its index."""

    def __init__(
        self, switches: Switches, groups: Callable[[int], Sequence[ArcGroup]], horizon: float
    ) -> None:
        self.switches, self.groups, self.horizon = switches, groups, horizon

    def stay(self, time: float, positions: Array) -> Stay:
        place = int(np.searchsorted(self.switches.times, time, side="right"))
        end = float(self.switches.times[place]) if place < len(self.switches) else self.horizon
        return Stay(int(self.switches.modes[place - 1]), end)


class Nearby:
    """The graphs of one run as they follow from positions, each kept once."""

    def __init__(self, signal: Mobile, problem: Problem, horizon: float) -> None:
        self.signal, self.problem, self.horizon = signal, problem, horizon
        self.now: IndexArray | None = None
        self.times, self.modes = list[float](), list[int]()
        self.codes, self.numbers = list[IndexArray](), dict[bytes, int]()

    def look(self, time: float, positions: Array) -> int:
        """The number of the graph at positions (n, k), active from ``time`` on.  Raises: SpecError
        on chattering."""
        graph, many = near(self.signal, positions, self.now), len(self.times)
        if self.now is None or not np.array_equal(graph, self.now):
            if many >= MOST_CHANGES or (
                many >= CHATTER and time - self.times[-CHATTER] < 1e-9 * max(1.0, time)
            ):
                message = f"the graph changed {many} times up to t = {time:.6g} s: it chatters."
                raise SpecError(message, key="signal", cure="Give a (larger) hysteresis.")
            number = self.numbers.setdefault(graph.tobytes(), len(self.codes))
            if number == len(self.codes):
                self.codes.append(graph)
            self.now = graph
            self.times.append(time)
            self.modes.append(number)
        return self.modes[-1]

    def stay(self, time: float, positions: Array) -> Stay:
        return Stay(self.look(time, positions), self.horizon, self.change)

    def groups(self, number: int) -> tuple[ArcGroup, ...]:
        return groups_of(self.problem, self.codes[number])

    def change(self, times: Array, positions_at: Callable[[float], Array]) -> float | None:
        """The first float at which the graph is another one and still is at the next of the
        times."""

        def stays(time: float) -> bool:
            return self.now is not None and np.array_equal(
                near(self.signal, positions_at(time), self.now), self.now
            )

        for before, after in pairwise(times.tolist()):
            if not stays(after):
                low, high = before, after
                while (middle := low + (high - low) / 2) not in (low, high):
                    low, high = (middle, high) if stays(middle) else (low, middle)
                return float(high)
        return None

    @property
    def switches(self) -> Switches:
        return Switches(
            times=np.array(self.times),
            modes=np.array(self.modes, dtype=np.int64),
            names=tuple(f"graph {k + 1}" for k in range(len(self.codes))),
            graphs=tuple(
                np.stack([codes // self.problem.n, codes % self.problem.n]) for codes in self.codes
            ),
        )


Modes = Planned | Nearby


def motion_switches(
    signal: Mobile, motion: Waypoints, problem: Problem, horizon: float
) -> Switches:
    """The switches under a given motion.  Raises: ShapeError, SpecError."""
    places = np.asarray(motion.positions)
    if places.shape[1] != problem.n:
        message = f"must have one position per agent, {problem.n}; got {places.shape[1]}."
        raise wrong(
            "motion",
            message,
            "Give positions of shape (times, agents, coordinates).",
            kind=ShapeError,
        )
    nearby, positions = Nearby(signal, problem, horizon), partial(motion.at, places=places)
    nearby.look(0.0, positions(0.0))
    for begin, end in pairwise(
        np.unique(np.clip([0.0, *motion.times, horizon], 0.0, horizon)).tolist()
    ):
        looks = np.linspace(begin, end, LOOKS_OF_MOTION + 1)
        while (change := nearby.change(looks, positions)) is not None and change < horizon:
            nearby.look(change, positions(change))
            looks = np.concatenate([[change], looks[looks > change]])
    return nearby.switches
