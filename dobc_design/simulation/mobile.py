"""Graphs that follow from positions: everyone within a radius, or the k nearest, with hysteresis.

Positions are the states themselves, formation offsets included, or a given motion.  A link that is made at one
distance is broken at a larger one, so that an agent at the edge does not make the graph chatter.  Arcs have weight 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import ShapeError, SpecError
from dobc_design.problem.arcs import places_at, split_by
from dobc_design.problem.arrays import ArcGroup
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import not_negative, positive, whole
from dobc_design.simulation.signals import MOST_SWITCHES, refuse_too_many
from dobc_design.simulation.switches import Switches

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
LOOKS = 8  # times at which the graph is looked at within one step of the integrator
LOOKS_OF_MOTION = 64  # ... and within one piece of a given motion
CHATTER = 50  # switches of a run within a billionth of the time so far, which count as chattering
MOST_CHANGES = 100_000  # switches of one run


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Waypoints(Shown):
    """A given motion: straight lines between positions at given instants; before and after them it rests.

    Shapes: times (T,) in s, increasing; positions (T, n, k), k coordinates of n agents.
    """

    times: tuple[float, ...]
    positions: tuple[tuple[tuple[float, ...], ...], ...]

    def __post_init__(self) -> None:
        places = np.asarray(self.positions, dtype=np.float64)
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        if places.ndim != 3 or len(places) != len(times) or 0 in places.shape:
            raise ShapeError(
                f"positions must have shape (times, agents, coordinates) with {len(times)} times; got {places.shape}.",
                key="positions",
                cure="Give one n x k array for every instant.",
            )
        if not np.isfinite(places).all() or any(b <= a for a, b in pairwise(times)):
            raise SpecError("positions must be finite and times must increase.", key="times", cure="Sort the instants.")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", tuple(tuple(map(tuple, rows)) for rows in places.tolist()))

    def _card(self) -> Card:
        agents, coordinates = len(self.positions[0]), len(self.positions[0][0])
        where = f"{len(self.times)} instants from {self.times[0]:g} to {self.times[-1]:g} s"
        return Card(title="Waypoints", text=f"of {agents} agents in {coordinates} coordinates, {where}")

    def __repr__(self) -> str:
        return f"<Waypoints {self._card().text}>"

    def at(self, time: float, places: Array) -> Array:
        """Positions (n, k) at a time; ``places`` is ``positions`` as an array, made once by the caller."""
        number = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, max(0, len(self.times) - 2)))
        if len(self.times) == 1:
            return np.asarray(places[0])
        begin, end = self.times[number], self.times[number + 1]
        part = min(1.0, max(0.0, (time - begin) / (end - begin)))
        return np.asarray(places[number] + part * (places[number + 1] - places[number]))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Mobile(Shown):
    """Who is near enough is heard: all agents within ``radius``, or the ``neighbours`` nearest ones.

    ``hysteresis`` >= 0, a distance: a link within the radius is kept up to radius + hysteresis; one of the nearest
    is replaced only by an agent that is nearer by more than it.  ``motion`` gives the positions; without it they are
    the states.  The arcs of the problem's modes are not used; couplings of single arcs are.
    """

    kind: ClassVar[str] = "mobile"
    radius: float | None = None
    neighbours: int | None = None
    hysteresis: float = 0.0
    motion: Waypoints | None = None

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.neighbours is None):
            raise SpecError(
                "a mobile signal needs either radius or neighbours, and not both.",
                key="radius",
                cure="For example Mobile(radius=2.0, hysteresis=0.2).",
            )
        if self.radius is not None:
            object.__setattr__(self, "radius", positive(self.radius, "radius"))
        if self.neighbours is not None:
            object.__setattr__(self, "neighbours", whole(self.neighbours, "neighbours", least=1))
        object.__setattr__(self, "hysteresis", not_negative(self.hysteresis, "hysteresis"))

    def _card(self) -> Card:
        return Card(title="Mobile", text=str(self))

    def __str__(self) -> str:
        near = f"within {self.radius:g}" if self.radius is not None else f"{self.neighbours} nearest"
        return f"mobile, {near}, hysteresis {self.hysteresis:g}, {'given motion' if self.motion else 'the states move'}"


def near(signal: Mobile, positions: Array, before: IndexArray | None) -> IndexArray:
    """The links at these positions (n, k): sorted codes listener * n + speaker.

    ``before`` holds the links so far, for the hysteresis; None at the start, when there are none.
    """
    kept = np.zeros(0, dtype=np.int64) if before is None else before
    if signal.radius is not None:
        return _within(positions, signal.radius, signal.hysteresis, kept)
    return _nearest(positions, min(signal.neighbours or 1, len(positions) - 1), signal.hysteresis, kept)


def _within(positions: Array, radius: float, hysteresis: float, kept: IndexArray) -> IndexArray:
    n = len(positions)
    pairs = cKDTree(positions).query_pairs(radius + hysteresis, output_type="ndarray").astype(np.int64)
    first, second = pairs[:, 0], pairs[:, 1]
    distances = np.linalg.norm(positions[first] - positions[second], axis=1)
    linked = (distances <= radius) | np.isin(first * n + second, kept)
    first, second = first[linked], second[linked]
    return np.sort(np.concatenate([first * n + second, second * n + first]))


def _nearest(positions: Array, count: int, hysteresis: float, kept: IndexArray) -> IndexArray:
    """Each agent's ``count`` smallest distances, where those to present neighbours count less by the hysteresis."""
    n = len(positions)
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    _, found = cKDTree(positions).query(positions, k=min(n, count + 1))
    agents = np.repeat(np.arange(n), found.shape[1])
    codes = np.unique(np.concatenate([agents * n + found.ravel(), kept]))
    listeners, speakers = codes // n, codes % n
    other = listeners != speakers
    codes, listeners, speakers = codes[other], listeners[other], speakers[other]
    distances = np.linalg.norm(positions[listeners] - positions[speakers], axis=1)
    counted = distances - hysteresis * np.isin(codes, kept)
    order = np.lexsort((codes, counted, listeners))
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


def first_change(
    graph_at: Callable[[float], IndexArray], now: IndexArray, times: Sequence[float] | Array
) -> float | None:
    """The first float at which the graph is another one than ``now``, looked for between the given times.

    Found by bisection to neighbouring floats.  A change that is undone before the next of the times is not seen.
    """
    low = float(times[0])
    for time in times[1:]:
        high = float(time)
        if not np.array_equal(graph_at(high), now):
            while (middle := low + (high - low) / 2) not in (low, high):
                if np.array_equal(graph_at(middle), now):
                    low = middle
                else:
                    high = middle
            return high
        low = high
    return None


class Record:
    """The graphs of a run as they come up, each kept once."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.times: list[float] = []
        self.modes: list[int] = []
        self.codes: list[IndexArray] = []
        self.numbers: dict[bytes, int] = {}

    def add(self, time: float, codes: IndexArray) -> int:
        """Note that this graph is active from ``time`` on and return its number.  Raises: SpecError on chattering."""
        many = len(self.times)
        if many >= MOST_CHANGES or (many >= CHATTER and time - self.times[-CHATTER] < 1e-9 * max(1.0, time)):
            raise SpecError(
                f"the graph changed {many} times up to t = {time:.6g} s: it chatters.",
                key="signal",
                cure="Give a (larger) hysteresis.",
            )
        number = self.numbers.setdefault(codes.tobytes(), len(self.codes))
        if number == len(self.codes):
            self.codes.append(codes)
        self.times.append(time)
        self.modes.append(number)
        return number

    def switches(self) -> Switches:
        """What was noted."""
        return Switches(
            times=np.array(self.times),
            modes=np.array(self.modes, dtype=np.int64),
            names=tuple(f"graph {k + 1}" for k in range(len(self.codes))),
            graphs=tuple(np.stack([codes // self.n, codes % self.n]) for codes in self.codes),
        )


def motion_switches(signal: Mobile, motion: Waypoints, n: int, horizon: float) -> tuple[Switches, list[IndexArray]]:
    """The switches under a given motion, and the codes of the graphs.  Raises: ShapeError, SpecError."""
    places = np.asarray(motion.positions)
    if places.shape[1] != n:
        raise ShapeError(
            f"motion must have one position per agent, {n}; got {places.shape[1]}.",
            key="motion",
            cure="Give positions of shape (times, agents, coordinates).",
        )
    refuse_too_many(len(motion.times) * LOOKS_OF_MOTION / MOST_SWITCHES)
    corners = np.unique(np.clip([0.0, *motion.times, horizon], 0.0, horizon))
    record, now = Record(n), near(signal, motion.at(0.0, places), None)
    record.add(0.0, now)

    def graph_at(time: float) -> Any:
        return near(signal, motion.at(time, places), now)

    for begin, end in pairwise(corners.tolist()):
        looks = np.linspace(begin, end, LOOKS_OF_MOTION + 1)
        while (change := first_change(graph_at, now, looks)) is not None and change < horizon:
            now = graph_at(change)
            record.add(change, now)
            looks = np.concatenate([[change], looks[looks > change]])
    return record.switches(), record.codes
