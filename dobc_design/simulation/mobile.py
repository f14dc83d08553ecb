"""Graphs that follow from positions: which agents are near, and when a link is made or broken.

A link that is made at one distance is broken at a larger one, so that an agent at the edge does not
make the graph chatter.  Arcs of such graphs have weight 1.
"""

from functools import partial
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from dobc_design.conditions.numbers import bisected
from dobc_design.errors import misshapen, refused
from dobc_design.exact.matrix import Array
from dobc_design.loop.arcs import places_at, split_by
from dobc_design.loop.arrays import ArcGroup, ArcGroups
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import IndexArray

from .signals import Mobile, Waypoints
from .switches import Planned, PositionsAt, Stay, Switches

LOOKS = 8  # times at which the graph is looked at within one step of the integrator
LOOKS_OF_MOTION = 64  # ... and within one piece of a given motion
CHATTER = 50  # switches of a run within a billionth of the time so far, which count as chattering
MOST_CHANGES = 100_000  # switches of one run whose graphs follow from its states


def near(signal: Mobile, positions: Array, before: IndexArray | None) -> IndexArray:
    """The links at positions (n, k) after those ``before``: sorted codes listener * n + speaker."""
    kept = np.zeros(0, dtype=np.int64) if before is None else before
    if signal.radius is not None:
        return _within(positions, signal.radius, signal.hysteresis, kept)
    count = min(signal.neighbours or 1, len(positions) - 1)
    return _nearest(positions, count, signal.hysteresis, kept)


def _within(positions: Array, radius: float, hysteresis: float, kept: IndexArray) -> IndexArray:
    """All links within the radius, and those ``kept`` within radius + hysteresis."""
    n = len(positions)
    # a tree: not all n^2 distances
    pairs = cKDTree(positions).query_pairs(radius + hysteresis, output_type="ndarray")
    first, second = pairs.astype(np.int64).T
    distances = np.linalg.norm(positions[first] - positions[second], axis=1)
    linked = (distances <= radius) | np.isin(first * n + second, kept)
    first = first[linked]
    second = second[linked]
    return np.sort(np.concatenate([first * n + second, second * n + first]))


def _nearest(positions: Array, count: int, hysteresis: float, kept: IndexArray) -> IndexArray:
    """Each agent's ``count`` smallest distances, where those to present neighbours count less by
    the hysteresis."""
    n = len(positions)
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    # the agent itself is the nearest
    _, found = cKDTree(positions).query(positions, k=min(n, count + 1))
    closest = np.repeat(np.arange(n), found.shape[1]) * n + found.ravel()
    # present neighbours compete even where others are nearer now
    codes = np.unique(np.concatenate([closest, kept]))
    codes = codes[codes // n != codes % n]
    listeners = codes // n
    distances = np.linalg.norm(positions[listeners] - positions[codes % n], axis=1)
    order = np.lexsort((codes, distances - hysteresis * np.isin(codes, kept), listeners))
    in_order = listeners[order]
    rank = np.arange(len(order)) - np.searchsorted(in_order, in_order)
    return np.sort(codes[order[rank < count]])


def groups_of(loop: Loop, codes: IndexArray) -> ArcGroups:
    """The links as arcs of weight 1, grouped by function."""
    found = []
    for place, links in split_by(places_at(loop.exceptions, codes, size=loop.n)):
        group = ArcGroup(
            coupling=loop.functions[place],
            listeners=codes[links] // loop.n,
            speakers=codes[links] % loop.n,
            weights=np.ones(len(links)),
        )
        found.append(group)
    return tuple(found)


class Nearby:
    """The graphs of one run as they follow from positions, each kept once."""

    def __init__(self, signal: Mobile, loop: Loop, horizon: float) -> None:
        self.signal = signal
        self.loop = loop
        self.horizon = horizon
        self.now: IndexArray | None = None
        self.times: list[float] = []
        self.modes: list[int] = []
        self.codes: list[IndexArray] = []
        self.numbers: dict[bytes, int] = {}

    def look(self, time: float, positions: Array) -> int:
        """The number of the graph at positions (n, k), active from ``time`` on.  Raises: SpecError
        on chattering."""
        graph = near(self.signal, positions, self.now)
        if self.now is None or not np.array_equal(graph, self.now):
            self.refuse_chatter(time)
            # a graph that comes back is the same mode as before
            number = self.numbers.setdefault(graph.tobytes(), len(self.codes))
            if number == len(self.codes):
                self.codes.append(graph)
            self.now = graph
            self.times.append(time)
            self.modes.append(number)
        return self.modes[-1]

    def refuse_chatter(self, time: float) -> None:
        """Raises: SpecError where graphs changed too often up to this time."""
        many = len(self.times)
        # many switches at one instant: the states push back what they caused
        chatters = many >= CHATTER and time - self.times[-CHATTER] < 1e-9 * max(1.0, time)
        if many >= MOST_CHANGES or chatters:
            message = f"the graph changed {many} times up to t = {time:.6g} s: it chatters."
            raise refused("signal", message, "Give a (larger) hysteresis.")

    def stay(self, time: float, positions: Array) -> Stay:
        """The graph at a time and positions."""
        return Stay(self.look(time, positions), self.horizon, self.change)

    def groups(self, number: int) -> ArcGroups:
        """The arcs of a graph by its number."""
        return groups_of(self.loop, self.codes[number])

    def change(self, times: Array, positions_at: PositionsAt) -> float | None:
        """The first float at which the graph is another one and still is at the next of the
        times."""
        for before, after in pairwise(times.tolist()):
            if not self.stays(positions_at(after)):
                return self.bisected(before, after, positions_at)
        return None

    def stays(self, positions: Array) -> bool:
        """Whether the graph at these positions is the present one."""
        if self.now is None:
            return False
        return np.array_equal(near(self.signal, positions, self.now), self.now)

    def bisected(self, low: float, high: float, positions_at: PositionsAt) -> float:
        """The float, up to ``high``, from which on the graph is another one than at ``low``."""

        def middle(low: float, high: float) -> float:
            return low + (high - low) / 2

        _, changed = bisected(
            lambda time: self.stays(positions_at(time)),
            low,
            high,
            middle=middle,
            close=lambda low, high: middle(low, high) in (low, high),  # no float is between
        )
        return float(changed)

    @property
    def switches(self) -> Switches:
        """What was looked at so far."""
        n = self.loop.n
        return Switches(
            times=np.array(self.times),
            modes=np.array(self.modes, dtype=np.int64),
            names=tuple(f"graph {k + 1}" for k in range(len(self.codes))),
            graphs=tuple(np.stack([codes // n, codes % n]) for codes in self.codes),
        )


Modes = Planned | Nearby


def motion_switches(signal: Mobile, motion: Waypoints, loop: Loop, horizon: float) -> Switches:
    """The switches under a given motion.  Raises: ShapeError, SpecError."""
    places = np.asarray(motion.positions)
    if places.shape[1] != loop.n:
        message = f"must have one position per agent, {loop.n}; got {places.shape[1]}."
        cure = "Give positions of shape (times, agents, coordinates)."
        raise misshapen("motion", message, cure)
    nearby = Nearby(signal, loop, horizon)
    positions = partial(motion.at, places=places)
    nearby.look(0.0, positions(0.0))
    # between two of these instants all agents move along straight lines
    instants = np.unique(np.clip([0.0, *motion.times, horizon], 0.0, horizon))
    for begin, end in pairwise(instants.tolist()):
        looks = np.linspace(begin, end, LOOKS_OF_MOTION + 1)
        while True:
            change = nearby.change(looks, positions)
            if change is None or change >= horizon:
                break
            nearby.look(change, positions(change))
            looks = np.concatenate([[change], looks[looks > change]])
    return nearby.switches
