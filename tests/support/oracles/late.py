"""Agents that know each other late, wrongly or rarely, stepped by numpy alone.

    e_i' = sum_j w_ij h(r_ij - e_i(theta)) - k_i e_i(theta) + C eps_i,      eps_i' = F eps_i,

r_ij within ``event`` |e_j(t')| of e_j(t'), t' at most ``heard`` steps ago and theta at most ``own``
steps ago, never before the start; per arc, component and run, as a habit chooses.  In continuous
time: Runge-Kutta steps, in which late readings are held, so that ages keep their bounds.  On ticks
of T: e+ = e + T (sum h - k e) + G eps, eps+ = F eps, exactly.

Nothing of the package is imported.  A habit is one of ``AGES`` with one of ``MARKS``; all of them
are within the bounds, none is the worst for every network.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.linalg import expm

AGES = ("oldest", "random", "sawtooth", "packets", "outward", "along", "constant")
MARKS = ("outward", "random", "trigger", "quantised")
WILD = ("outward", "along")  # readings are chosen by what they do


@dataclass(frozen=True, kw_only=True)
class Plant:
    """Arcs (i, j) with weights (modes, arcs), h of arrays, gains (n, m), and the observer error:
    eps' = F eps (q, q) drives e' by C eps (m, q); with ticks eps+ = F eps and C eps is added.
    ``mode_at``: which mode is on at a time (s); by default each run changes its own at random."""

    arcs: list[tuple[int, int]]
    weights: Any
    h: Callable[[Any], Any]
    gains: Any
    F: Any = None
    C: Any = None
    mode_at: Callable[[float], int] | None = None

    @property
    def heads(self) -> Any:
        return np.array([i for i, _ in self.arcs], dtype=int)

    @property
    def tails(self) -> Any:
        return np.array([j for _, j in self.arcs], dtype=int)


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Largest ages in steps of ``step`` (s); ``lost`` of them are losses; ``ticks``: everything is
    held over a step."""

    step: float
    heard: int = 0
    own: int = 0
    lost: int = 0
    event: float = 0.0
    ticks: bool = False


def continuous(delay: float, own_delay: float, event: float, *, fastest: float) -> Bounds:
    """Steps that are short for rates up to ``fastest`` (1/s).  What is held over a step is one step
    older at its end."""
    step = 0.05 / fastest
    for age in (delay, own_delay):
        step = min(step, age / 6) if age else step
    late = [max(math.floor(age / step * (1 + 1e-12)) - 1, 0) for age in (delay, own_delay)]
    return Bounds(step=step, heard=late[0], own=late[1], event=event)


def on_ticks(period: float, delay: float, own_delay: float, lost: int, event: float) -> Bounds:
    """A message is used from the first tick after ``delay`` on."""
    heard, own = (math.ceil(age / period * (1 - 1e-12)) for age in (delay, own_delay))
    return Bounds(step=period, heard=heard + lost, own=own, lost=lost, event=event, ticks=True)


def held_error(F: Any, C: Any, period: float) -> tuple[Any, Any]:
    """What a period makes of eps' = F eps, and what C eps adds to e meanwhile."""
    q, m = len(F), len(C)
    block = np.zeros((q + m, q + m))
    block[:q, :q] = F
    block[q:, :q] = C
    flow = expm(block * period)
    return flow[:q, :q], flow[q:, :q]


def sampled_error(A: Any, C: Any, W: Any, period: float) -> tuple[Any, Any]:
    """The same where a processor compensates the mean: A_d - W C Gamma, and C Gamma."""
    transition, added = held_error(A, C, period)
    return transition - W @ added, added


def late_runs(
    plant: Plant, bounds: Bounds, e: Any, eps: Any, habit: tuple[str, str], r: Any
) -> Iterator[tuple[float, Any, Any]]:
    """Times, e (n, m, R) and eps (n, q, R) from the start on, for ever."""
    readings = _Readings(plant, bounds, habit, e.shape[-1], r)
    step = bounds.step
    k = 0
    while True:
        yield k * step, e, eps
        readings.look(e, k)
        before = e
        if bounds.ticks:
            e = e + step * readings.speed(e)
            if plant.F is not None:
                e = e + np.einsum("cq,iqr->icr", plant.C, eps)
                eps = np.einsum("pq,iqr->ipr", plant.F, eps)
        else:
            e, eps = _runge_kutta(plant, readings, step, e, eps)
        readings.velocity = e - before
        k += 1


def _runge_kutta(
    plant: Plant, readings: "_Readings", step: float, e: Any, eps: Any
) -> tuple[Any, Any]:
    def slope(x: Any, y: Any) -> tuple[Any, Any]:
        speed = readings.speed(x)
        if plant.F is None:
            return speed, 0 * y
        driven = np.einsum("cq,iqr->icr", plant.C, y)
        return speed + driven, np.einsum("pq,iqr->ipr", plant.F, y)

    a, p = slope(e, eps)
    b, q = slope(e + step / 2 * a, eps + step / 2 * p)
    c, s = slope(e + step / 2 * b, eps + step / 2 * q)
    d, t = slope(e + step * c, eps + step * s)
    return e + step / 6 * (a + 2 * b + 2 * c + d), eps + step / 6 * (p + 2 * q + 2 * s + t)


class _Readings:
    """What every arc and every pin knows in this step."""

    def __init__(
        self, plant: Plant, bounds: Bounds, habit: tuple[str, str], runs: int, r: Any
    ) -> None:
        self.plant = plant
        self.bounds = bounds
        self.ages, self.marks = habit
        self.r = r
        self.heads = plant.heads
        self.tails = plant.tails
        self.own_past: deque[Any] = deque(maxlen=bounds.own + 1)  # the newest last
        self.said_past: deque[Any] = deque(maxlen=bounds.heard + 1)
        m = plant.gains.shape[1]
        self.arc_shape = (len(self.heads), m, runs)
        self.pin_shape = (*plant.gains.shape, runs)
        self.fixed = r.integers(0, bounds.heard + 1, self.arc_shape)
        self.packet = np.full(self.arc_shape, bounds.heard - bounds.lost)
        self.last: Any = None
        self.velocity: Any = None
        self.mode = r.integers(0, len(plant.weights), runs)
        # where readings are those of this instant, these are used by ``speed``
        self.other: Any = None
        self.own: Any = None
        self.own_pin: Any = None
        self.factor: Any = 1.0

    def look(self, e: Any, k: int) -> None:
        """A step begins with e."""
        r = self.r
        moved = r.random(len(self.mode)) < 0.1
        self.mode = np.where(moved, r.integers(0, len(self.plant.weights), len(moved)), self.mode)
        if self.plant.mode_at is not None:
            # half a step later, so that a switch at the step itself has happened
            self.mode[:] = self.plant.mode_at((k + 0.5) * self.bounds.step)
        self.weights = self.plant.weights.T[:, None, self.mode]
        self.direction = np.sign(e)
        if self.ages == "along" and self.velocity is not None:
            self.direction = np.sign(self.velocity)
        event = self.bounds.event
        if self.last is None:
            self.last = e
        room = event * np.abs(e)
        self.last = np.where(np.abs(self.last - e) <= room, self.last, e)
        if self.marks == "quantised":
            self.last = _quantised(e, event)
        marked = self.last if self.marks in ("trigger", "quantised") else e
        if self.marks == "random":
            marked = e * (1 + r.uniform(-event, event, e.shape))
        self.own_past.append(e)
        self.said_past.append(marked)
        if self.ages in WILD:
            self._choose(e)
        else:
            self._read(k)

    def _read(self, k: int) -> None:
        """Ages that do not look at the states."""
        bounds = self.bounds
        if bounds.heard:
            ages = self._ages(bounds.heard, self.arc_shape, k)
            value = _at(self.said_past, ages, self.tails)
            self.other = value
            if self.marks == "outward":
                side = self.direction[self.heads] * np.sign(value)
                self.other = value * (1 + bounds.event * side)
        if bounds.own:
            self.own = _at(self.own_past, self._ages(bounds.own, self.arc_shape, k), self.heads)
            agents = np.arange(self.pin_shape[0])
            self.own_pin = _at(self.own_past, self._ages(bounds.own, self.pin_shape, k), agents)

    def _ages(self, most: int, shape: Any, k: int) -> Any:
        if self.ages == "oldest":
            return np.full(shape, most)
        if self.ages == "random":
            return self.r.integers(0, most + 1, shape)
        if self.ages == "sawtooth":
            return np.full(shape, k % (most + 1))
        if shape is not self.arc_shape or most != self.bounds.heard:
            return np.full(shape, most)
        if self.ages == "constant":
            return self.fixed
        # a loss makes the last one that arrived a step older
        least = most - self.bounds.lost
        arrives = (self.packet == most) | (self.r.random(shape) < 0.3)
        self.packet = np.where(arrives, least, self.packet + 1)
        return self.packet

    def _choose(self, e: Any) -> None:
        """The readings that push an agent furthest its way."""
        side = self.direction[self.heads]
        heard = [np.max(self.said_past, axis=0), np.min(self.said_past, axis=0)]
        known = [np.max(self.own_past, axis=0), np.min(self.own_past, axis=0)]
        others = []
        for each in heard:
            value = each[self.tails]
            more = self.bounds.event * np.abs(value) if self.marks == "outward" else 0.0
            others += [value + more, value - more]
        best = np.full(self.arc_shape, -np.inf)
        for other, own in product(others, [each[self.heads] for each in known]):
            gain = side * self.plant.h(other - own)
            better = gain > best
            best = np.where(better, gain, best)
            if self.bounds.heard:
                self.other = other if self.other is None else np.where(better, other, self.other)
            if self.bounds.own:
                self.own = own if self.own is None else np.where(better, own, self.own)
        if self.bounds.own:
            self.own_pin = np.where(self.direction > 0, known[1], known[0])

    def speed(self, e: Any) -> Any:
        """e' but for the observer."""
        bounds = self.bounds
        other = self.other if bounds.heard else self._marked(e)
        own = self.own if bounds.own else e[self.heads]
        pin = self.own_pin if bounds.own else e
        total = -self.plant.gains[..., None] * pin
        np.add.at(total, self.heads, self.weights * self.plant.h(other - own))
        return total

    def _marked(self, e: Any) -> Any:
        """What is said of e at this instant, within ``event`` of it."""
        value = e[self.tails]
        room = self.bounds.event * np.abs(value)
        if self.marks == "outward":
            return value + room * self.direction[self.heads]
        said = self.said_past[-1][self.tails]
        return np.clip(said, value - room, value + room)


def _at(past: Any, ages: Any, agents: Any) -> Any:
    """Entry ``ages`` steps ago, or the first."""
    stack = np.stack(list(past))
    places = np.maximum(len(stack) - 1 - ages, 0)
    _, components, runs = np.ogrid[: ages.shape[0], : ages.shape[1], : ages.shape[2]]
    return stack[places, agents[:, None, None], components, runs]


def _quantised(e: Any, event: float) -> Any:
    """The middle of the logarithmic level of e: within ``event`` of it, relatively."""
    if not event:
        return e
    wide = math.log((1 + event) / (1 - event))
    size = np.maximum(np.abs(e), 1e-300)
    level = np.floor(np.log(size) / wide) + 0.5
    middle = np.sign(e) * np.exp(level * wide) * math.sqrt(1 - event * event)
    return np.clip(middle, e - event * np.abs(e), e + event * np.abs(e))
