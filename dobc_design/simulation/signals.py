"""Switching signals: fixed, periodic, random, Markov, a schedule, or graphs that follow from
positions.

A signal is a value: it can be compared, printed and stored as JSON, a problem's [switching]
describes one, and together with a seed it gives the same ``switches`` every time.  None of this
enters a proof.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import pairwise
from typing import ClassVar

import numpy as np

from dobc_design._checks import put
from dobc_design._show.cards import Card, Shown, Told
from dobc_design.errors import ShapeError, SpecError, wrong
from dobc_design.exact.number import nearest
from dobc_design.exact.reading import counted, is_list
from dobc_design.problem.arrays import Array
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching
from dobc_design.simulation._arguments import not_negative, positive, seconds, whole

DWELL = 0.5  # s, where [switching] gives none


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Fixed(Shown):
    """One mode for ever: ``mode``, or the problem's first."""

    kind: ClassVar[str] = "fixed"
    mode: str | None = None

    def __str__(self) -> str:
        return "fixed" if self.mode is None else f"fixed in {self.mode}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Periodic(Shown):
    """The modes one after another, over and over: each for ``dwell`` s, or ``dwell[i]`` s for the
    i-th of ``order``.

    Example:
        >>> signal = dd.signals.Periodic(dwell=0.5)
        >>> run = dd.simulate("paper-switching", signal=signal, t_final=2, samples=9)
        >>> run.switches.times.tolist()
        [0.0, 0.5, 1.0, 1.5]
    """

    kind: ClassVar[str] = "periodic"
    dwell: float | Sequence[float]
    order: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        put(self, order=_order(self.order))
        if not is_list(self.dwell):
            put(self, dwell=seconds(self.dwell, "dwell"))
            return
        times = tuple(seconds(t, f"dwell[{i}]") for i, t in enumerate(self.dwell))  # type: ignore[arg-type]
        if not times:
            raise wrong(
                "dwell",
                "must hold at least one time; got none.",
                "For example 0.5.",
                kind=ShapeError,
            )
        put(self, dwell=times)

    def __str__(self) -> str:
        return f"periodic, {', '.join(f'{t:g}' for t in np.atleast_1d(self.dwell))} s each"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RandomDwell(Shown):
    """A mode drawn anew, each as likely as the other, after every ``dwell`` s.

    With ``longest`` every draw is another mode, and how long it lasts is uniform between ``dwell``
    and ``longest``.
    """

    kind: ClassVar[str] = "random"
    dwell: float
    longest: float | None = None

    def __post_init__(self) -> None:
        put(self, dwell=seconds(self.dwell, "dwell"))
        if self.longest is not None:
            put(self, longest=seconds(self.longest, "longest"))
            if self.longest < self.dwell:
                message = f"must be >= dwell, {self.dwell:g} s; got {self.longest:g}."
                raise wrong("longest", message, "Exchange the two.")

    def __str__(self) -> str:
        until = "" if self.longest is None else f" to {self.longest:g}"
        return f"random, drawn anew every {self.dwell:g}{until} s"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Markov(Shown):
    """A Markov chain in continuous time: ``generator[k][l]`` is the rate in 1/s from the k-th mode
    to the l-th.

    Rows add up to 0.  ``order`` names the modes of rows and columns (default: the problem's order),
    ``start`` the first mode (default: the first of them).
    """

    kind: ClassVar[str] = "markov"
    generator: tuple[tuple[float, ...], ...]
    order: tuple[str, ...] | None = None
    start: str | None = None

    def __post_init__(self) -> None:
        rows = tuple(tuple(float(x) for x in row) for row in self.generator)
        put(self, order=_order(self.order), generator=rows)
        if not rows or any(len(row) != len(rows) for row in rows):
            message = "must be a square matrix, one row and column per mode."
            raise wrong("generator", message, "For two modes [[-1, 1], [1, -1]].", kind=ShapeError)
        for k, row in enumerate(rows):
            for other, rate in enumerate(row):
                if other != k:
                    not_negative(rate, f"generator[{k}][{other}]")
            if not abs(sum(row)) <= 1e-9 * max(1.0, *map(abs, row)):
                message = "must add up to 0: the diagonal entry is minus the sum of the others; got"
                cure = f"Put minus the sum of the others at [{k}][{k}]."
                raise wrong(f"generator[{k}]", f"{message} {sum(row):g}.", cure)

    def __str__(self) -> str:
        stays = ", ".join(
            "for ever" if row[k] == 0 else f"{-1 / row[k]:.3g} s"
            for k, row in enumerate(self.generator)
        )
        return f"Markov, mean stay {stays}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Schedule(Shown):
    """Given instants: mode ``modes[i]`` from ``times[i]`` s on; the first instant is 0."""

    kind: ClassVar[str] = "schedule"
    times: tuple[float, ...]
    modes: tuple[str, ...]

    def __post_init__(self) -> None:
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        put(self, times=times, modes=tuple(map(str, self.modes)))
        if len(times) != len(self.modes) or not times:
            message = (
                f"times and modes must be equally long, at least 1; got {len(times)} and "
                f"{len(self.modes)}."
            )
            raise ShapeError(message, key="times", cure="Give one mode for every instant.")
        if times[0] != 0 or any(b <= a for a, b in pairwise(times)):
            raise wrong(
                "times",
                "must begin with 0 and increase.",
                "Sort them, and say what is active at 0.",
            )

    def __str__(self) -> str:
        return f"schedule of {counted(len(self.times), 'instant')}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Waypoints(Shown):
    """A given motion: straight lines between positions at given instants; before and after them it
    rests.

    Shapes: times (T,) in s, increasing; positions (T, n, k), k coordinates of n agents.
    """

    times: tuple[float, ...]
    positions: tuple[tuple[tuple[float, ...], ...], ...]

    def __post_init__(self) -> None:
        places = np.asarray(self.positions, dtype=np.float64)
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        if places.ndim != 3 or len(places) != len(times) or 0 in places.shape:
            message = (
                f"must have shape (times, agents, coordinates) with {len(times)} times; got "
                f"{places.shape}."
            )
            raise wrong(
                "positions", message, "Give one n x k array for every instant.", kind=ShapeError
            )
        if not np.isfinite(places).all() or any(b <= a for a, b in pairwise(times)):
            raise SpecError(
                "positions must be finite and times must increase.",
                key="times",
                cure="Sort the instants.",
            )
        put(self, times=times, positions=tuple(tuple(map(tuple, rows)) for rows in places.tolist()))

    def _card(self) -> Card:
        agents, coordinates = len(self.positions[0]), len(self.positions[0][0])
        where = f"{len(self.times)} instants from {self.times[0]:g} to {self.times[-1]:g} s"
        return Card(
            title="Waypoints", text=f"of {agents} agents in {coordinates} coordinates, {where}"
        )

    def __repr__(self) -> str:
        return f"<Waypoints {self._card().text}>"

    def at(self, time: float, places: Array) -> Array:
        """Positions (n, k) at a time; ``places`` is ``positions`` as an array, made once by the
        caller."""
        if len(self.times) == 1:
            return np.asarray(places[0])
        number = int(
            np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        )
        begin, end = self.times[number], self.times[number + 1]
        part = min(1.0, max(0.0, (time - begin) / (end - begin)))
        return np.asarray(places[number] + part * (places[number + 1] - places[number]))


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Mobile(Told):
    """Who is near enough is heard: all agents within ``radius``, or the ``neighbours`` nearest
    ones.

    ``hysteresis`` >= 0, a distance: a link within the radius is kept up to radius + hysteresis; one
    of the nearest is replaced only by an agent that is nearer by more than it.  ``motion`` gives
    the positions; without it they are the states.  The arcs of the problem's modes are not used;
    couplings of single arcs are.
    """

    kind: ClassVar[str] = "mobile"
    radius: float | None = None
    neighbours: int | None = None
    hysteresis: float = 0.0
    motion: Waypoints | None = None

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.neighbours is None):
            message = "a mobile signal needs either radius or neighbours, and not both."
            raise SpecError(
                message, key="radius", cure="For example Mobile(radius=2.0, hysteresis=0.2)."
            )
        if self.radius is not None:
            put(self, radius=positive(self.radius, "radius"))
        if self.neighbours is not None:
            put(self, neighbours=whole(self.neighbours, "neighbours", least=1))
        put(self, hysteresis=not_negative(self.hysteresis, "hysteresis"))

    def __str__(self) -> str:
        near = (
            f"within {self.radius:g}" if self.radius is not None else f"{self.neighbours} nearest"
        )
        return (
            f"mobile, {near}, hysteresis {self.hysteresis:g}, "
            f"{'given motion' if self.motion else 'the states move'}"
        )


Scheduled = Fixed | Periodic | RandomDwell | Markov | Schedule
Signal = Scheduled | Mobile


def _order(given: Sequence[str] | None) -> tuple[str, ...] | None:
    return None if given is None else tuple(map(str, given))


def signal_to_json(signal: Signal) -> str:
    """A signal as one JSON object."""
    return json.dumps({"signal": signal.kind} | asdict(signal), ensure_ascii=False)


def signal_of(problem: Problem) -> tuple[Signal, str | None]:
    """The signal of a problem's [switching], and a remark where something had to be chosen.
    Raises: SpecError."""
    names, own = tuple(problem.network.modes), problem.switching
    if own is None:
        return Fixed(), f"No signal was given: {names[0]} is active throughout." if len(
            names
        ) > 1 else None
    if own.signal in ("schedule", "mobile"):
        unused = (
            None if own.dwell is None else f"switching.dwell is not used by a {own.signal} signal."
        )
        if own.signal == "mobile":
            radius = None if own.radius is None else _float(own.radius, "switching.radius")
            hysteresis = _float(own.hysteresis or Fraction(0), "switching.hysteresis")
            return Mobile(radius=radius, neighbours=own.neighbours, hysteresis=hysteresis), unused
        instants = own.schedule or ()
        times = tuple(
            _float(time, f"switching.schedule[{k}][0]") for k, (time, _) in enumerate(instants)
        )
        return Schedule(times=times, modes=tuple(mode for _, mode in instants)), unused
    if len(names) == 1:
        return Fixed(), "There is one mode: nothing switches."
    if own.signal == "periodic" and (own.schedule or own.period):
        return _rounds(own, names), None
    if own.generator is not None:
        rows = (tuple(_float(rate, "switching.generator") for rate in row) for row in own.generator)
        return Markov(generator=tuple(rows)), None
    dwell = DWELL if own.dwell is None else _float(own.dwell, "switching.dwell")
    remark = f"switching.dwell is not given: {DWELL} s." if own.dwell is None else None
    if own.signal == "random":
        longest = None if own.longest is None else _float(own.longest, "switching.longest")
        return RandomDwell(dwell=dwell, longest=longest), remark
    if own.signal == "periodic":
        return Periodic(dwell=dwell, order=own.sequence), remark
    rate, count = 1 / (dwell * (len(names) - 1)), range(len(names))
    table = tuple(tuple(-1 / dwell if k == other else rate for other in count) for k in count)
    return Markov(
        generator=table
    ), "Markov: stays last switching.dwell on average, all other modes are equally likely."


def _rounds(own: Switching, names: tuple[str, ...]) -> Periodic:
    whole = own.period or Fraction(0)
    if own.schedule is None:
        return Periodic(
            dwell=_float(whole / len(own.sequence or names), "switching.period"), order=own.sequence
        )
    ends = [*(time for time, _ in own.schedule[1:]), whole]
    stays = [
        _float(end - time, "switching.schedule")
        for (time, _), end in zip(own.schedule, ends, strict=True)
    ]
    return Periodic(dwell=tuple(stays), order=tuple(mode for _, mode in own.schedule))


def _float(value: Fraction, key: str) -> float:
    """Raises: SpecError for a number beyond the range of floats."""
    number = nearest(value)
    if math.isinf(number) or (number == 0 and value):
        raise wrong(key, "is beyond the range of floats.", "Choose other units.")
    return number
