"""Switching signals: fixed, periodic, random, Markov, a schedule, or graphs that follow from positions.

A signal is a value: it can be compared, printed and stored as JSON, a problem's [switching] describes one, and together
with a seed it gives the same ``switches`` every time.  None of this enters a proof.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.reading import counted, is_list, shown
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching
from dobc_design.simulation._arguments import Array, not_negative, positive, seconds, whole

DWELL = 0.5  # s, where [switching] gives none
Times = float | Sequence[float]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Fixed(Shown):
    """One mode for ever: ``mode``, or the problem's first."""

    kind: ClassVar[str] = "fixed"
    mode: str | None = None

    def __str__(self) -> str:
        return "fixed" if self.mode is None else f"fixed in {self.mode}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Periodic(Shown):
    """The modes one after another, over and over: each for ``dwell`` s, or ``dwell[i]`` s for the i-th of ``order``.

    Example:
        >>> run = dd.simulate("paper-switching", signal=dd.Periodic(dwell=0.5), t_final=2, samples=9)
        >>> run.switches.times.tolist()
        [0.0, 0.5, 1.0, 1.5]
    """

    kind: ClassVar[str] = "periodic"
    dwell: Times
    order: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        _set_order(self)
        if is_list(self.dwell):
            times = tuple(seconds(t, f"dwell[{i}]") for i, t in enumerate(self.dwell))  # type: ignore[arg-type]
            if not times:
                raise ShapeError("dwell must hold at least one time; got none.", key="dwell", cure="For example 0.5.")
            object.__setattr__(self, "dwell", times)
        else:
            object.__setattr__(self, "dwell", seconds(self.dwell, "dwell"))

    def __str__(self) -> str:
        times = ", ".join(f"{t:g}" for t in np.atleast_1d(self.dwell))
        return f"periodic, {times} s each"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RandomDwell(Shown):
    """A mode drawn anew, each as likely as the other, after every ``dwell`` s.

    With ``longest`` > dwell the time until the next draw is uniform between the two.
    """

    kind: ClassVar[str] = "random"
    dwell: float
    longest: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "dwell", seconds(self.dwell, "dwell"))
        if self.longest is not None:
            longest = seconds(self.longest, "longest")
            if longest < self.dwell:
                raise SpecError(
                    f"longest must be >= dwell, {self.dwell:g} s; got {longest:g}.",
                    key="longest",
                    cure="Exchange the two.",
                )
            object.__setattr__(self, "longest", longest)

    def __str__(self) -> str:
        until = "" if self.longest is None else f" to {self.longest:g}"
        return f"random, drawn anew every {self.dwell:g}{until} s"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Markov(Shown):
    """A Markov chain in continuous time: ``generator[k][l]`` is the rate in 1/s from the k-th mode to the l-th.

    Rows add up to 0.  ``order`` names the modes of rows and columns (default: the problem's order), ``start`` the
    first mode (default: the first of them).
    """

    kind: ClassVar[str] = "markov"
    generator: tuple[tuple[float, ...], ...]
    order: tuple[str, ...] | None = None
    start: str | None = None

    def __post_init__(self) -> None:
        _set_order(self)
        rows = tuple(tuple(float(x) for x in row) for row in self.generator)
        object.__setattr__(self, "generator", rows)
        if not rows or any(len(row) != len(rows) for row in rows):
            raise ShapeError(
                "generator must be a square matrix, one row and column per mode.",
                key="generator",
                cure="For two modes [[-1, 1], [1, -1]].",
            )
        for k, row in enumerate(rows):
            for other, rate in enumerate(row):
                if other != k:
                    not_negative(rate, f"generator[{k}][{other}]")
            if not abs(sum(row)) <= 1e-9 * max(1.0, *map(abs, row)):
                raise SpecError(
                    f"generator[{k}] must add up to 0, because a chain that leaves a mode enters another;"
                    f" got {sum(row):g}.",
                    key=f"generator[{k}]",
                    cure=f"Put minus the sum of the others at [{k}][{k}].",
                )

    def __str__(self) -> str:
        stays = ", ".join("for ever" if row[k] == 0 else f"{-1 / row[k]:.3g} s" for k, row in enumerate(self.generator))
        return f"Markov, mean stay {stays}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Schedule(Shown):
    """Given instants: mode ``modes[i]`` from ``times[i]`` s on; the first instant is 0."""

    kind: ClassVar[str] = "schedule"
    times: tuple[float, ...]
    modes: tuple[str, ...]

    def __post_init__(self) -> None:
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "modes", tuple(str(mode) for mode in self.modes))
        if len(times) != len(self.modes) or not times:
            raise ShapeError(
                f"times and modes must be equally long, at least 1; got {len(times)} and {len(self.modes)}.",
                key="times",
                cure="Give one mode for every instant.",
            )
        if times[0] != 0 or any(b <= a for a, b in pairwise(times)):
            raise SpecError(
                "times must begin with 0 and increase.", key="times", cure="Sort them, and say what is active at 0."
            )

    def __str__(self) -> str:
        return f"schedule of {counted(len(self.times), 'instant')}"


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


Scheduled = Fixed | Periodic | RandomDwell | Markov | Schedule
Signal = Scheduled | Mobile
_KINDS: dict[str, type[Any]] = {kind.kind: kind for kind in (Fixed, Periodic, RandomDwell, Markov, Schedule, Mobile)}


def _set_order(signal: Periodic | Markov) -> None:
    if signal.order is not None:
        object.__setattr__(signal, "order", tuple(str(mode) for mode in signal.order))


def signal_to_json(signal: Signal) -> str:
    """Write a signal as one JSON object; ``signal_from_json`` gives an equal signal back."""
    document: dict[str, Any] = {"signal": signal.kind}
    for field in fields(signal):
        value = getattr(signal, field.name)
        if isinstance(value, Waypoints):
            value = {"times": _plain(value.times), "positions": _plain(value.positions)}
        document[field.name] = _plain(value)
    return json.dumps(document, ensure_ascii=False)


def signal_from_json(text: str) -> Signal:
    """Read a signal back.  Raises: SpecError for anything that is not one."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SpecError(f"the signal is not valid JSON ({error}).", key="signal", cure="Write it anew.") from None
    if not isinstance(document, Mapping) or document.get("signal") not in _KINDS:
        raise SpecError(
            f"signal must be one of {', '.join(_KINDS)}; got {shown(document)}.",
            key="signal",
            cure='For example {"signal": "periodic", "dwell": 0.5}.',
        )
    kind = _KINDS[document["signal"]]
    known = {field.name for field in fields(kind)}
    given = {str(name): _frozen(value) for name, value in document.items() if name != "signal"}
    if not set(given) <= known:
        wrong = sorted(set(given) - known)[0]
        raise SpecError(f"{wrong} is an unknown key of {kind.kind}.", key=wrong, cure=f"Known: {sorted(known)}.")
    try:
        motion = given.get("motion")
        if motion is not None:
            given["motion"] = Waypoints(times=motion["times"], positions=motion["positions"])
        signal: Signal = kind(**given)
    except (TypeError, KeyError, ValueError) as error:
        if isinstance(error, SpecError):
            raise
        raise SpecError(f"the signal cannot be read ({error}).", key="signal", cure="Write it anew.") from None
    return signal


def signal_of(problem: Problem) -> tuple[Signal, str | None]:
    """The signal that a problem's [switching] section describes, and a remark where something had to be chosen.

    Raises: SpecError for numbers beyond the range of floats.
    """
    names, own = tuple(problem.network.modes), problem.switching
    if own is None:
        remark = f"No signal was given: {names[0]} is active throughout." if len(names) > 1 else None
        return Fixed(), remark
    if own.signal in ("schedule", "mobile"):
        unused = None if own.dwell is None else f"switching.dwell is not used by a {own.signal} signal."
        return (_mobile(own) if own.signal == "mobile" else _schedule(own)), unused
    if len(names) == 1:
        return Fixed(), "There is one mode: nothing switches."
    if own.signal == "periodic" and (own.schedule or own.period):
        return _rounds(own, names), None
    if own.generator is not None:
        rows = [[_float(rate, "switching.generator") for rate in row] for row in own.generator]
        return Markov(generator=_frozen(rows)), None
    dwell = DWELL if own.dwell is None else _float(own.dwell, "switching.dwell")
    remark = f"switching.dwell is not given: {DWELL} s." if own.dwell is None else None
    if own.signal == "random":
        return RandomDwell(dwell=dwell), remark
    if own.signal == "periodic":
        return Periodic(dwell=dwell, order=own.sequence), remark
    rate = 1 / (dwell * (len(names) - 1))
    table = tuple(tuple(-1 / dwell if k == other else rate for other in range(len(names))) for k in range(len(names)))
    return Markov(generator=table), "Markov: stays last switching.dwell on average, all other modes are equally likely."


def _mobile(own: Switching) -> Mobile:
    return Mobile(
        radius=None if own.radius is None else _float(own.radius, "switching.radius"),
        neighbours=own.neighbours,
        hysteresis=_float(own.hysteresis or Fraction(0), "switching.hysteresis"),
    )


def _schedule(own: Switching) -> Schedule:
    instants = own.schedule or ()
    times = tuple(_float(time, f"switching.schedule[{k}][0]") for k, (time, _) in enumerate(instants))
    return Schedule(times=times, modes=tuple(mode for _, mode in instants))


def _rounds(own: Switching, names: tuple[str, ...]) -> Periodic:
    """One round in a given time: equal stays, or those of a schedule."""
    whole = own.period or Fraction(0)
    if own.schedule is None:
        order = own.sequence or names
        return Periodic(dwell=_float(whole / len(order), "switching.period"), order=own.sequence)
    ends = [*(time for time, _ in own.schedule[1:]), whole]
    stays = [_float(end - time, "switching.schedule") for (time, _), end in zip(own.schedule, ends, strict=True)]
    return Periodic(dwell=tuple(stays), order=tuple(mode for _, mode in own.schedule))


def _float(value: Fraction, key: str) -> float:
    """Raises: SpecError for a number beyond the range of floats."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if math.isinf(number) or (number == 0 and value):
        raise SpecError(f"{key} is beyond the range of floats.", key=key, cure="Choose other units.")
    return number


def _frozen(value: Any) -> Any:
    return tuple(_frozen(each) for each in value) if isinstance(value, list) else value


def _plain(value: Any) -> Any:
    """Tuples as lists, for JSON."""
    return [_plain(each) for each in value] if isinstance(value, (tuple, list)) else value
