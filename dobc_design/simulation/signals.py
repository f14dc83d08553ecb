"""Switching signals: fixed, periodic, random, Markov, a schedule, or graphs that follow from
positions.

A signal is a value: it can be compared, printed and stored as JSON, a problem's [switching]
describes one, and together with a seed it gives the same ``switches`` every time.  None of this
enters a proof.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from fractions import Fraction
from itertools import pairwise
from typing import ClassVar

import numpy as np

from dobc_design._checks import noun, put
from dobc_design._show.cards import Card, Shown, Told
from dobc_design.errors import ShapeError, misshapen, refused, wrong
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ZERO, nearest
from dobc_design.exact.reading import Names, Texts, counted, is_list
from dobc_design.problem.problem import Problem
from dobc_design.problem.switching import Switching

from ._arguments import NumberRows, not_negative, positive, seconds, whole

DWELL = 0.5  # s, where [switching] gives none


@noun
class Fixed(Shown):
    """One mode for ever: ``mode``, or the problem's first."""

    kind: ClassVar[str] = "fixed"
    mode: str | None = None

    def __str__(self) -> str:
        return "fixed" if self.mode is None else f"fixed in {self.mode}"


@noun
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
    order: Texts | None = None

    def __post_init__(self) -> None:
        put(self, order=_order(self.order))
        if not is_list(self.dwell):
            put(self, dwell=seconds(self.dwell, "dwell"))
            return
        times = tuple(seconds(t, f"dwell[{i}]") for i, t in enumerate(self.dwell))  # type: ignore[arg-type]
        if not times:
            message = "must hold at least one time; got none."
            raise misshapen("dwell", message, "For example 0.5.")
        put(self, dwell=times)

    def __str__(self) -> str:
        times = [f"{time:g}" for time in np.atleast_1d(self.dwell)]
        return f"periodic, {', '.join(times)} s each"


@noun
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


@noun
class Markov(Shown):
    """A Markov chain in continuous time: ``generator[k][l]`` is the rate in 1/s from the k-th mode
    to the l-th.

    Rows add up to 0.  ``order`` names the modes of rows and columns (default: the problem's order),
    ``start`` the first mode (default: the first of them).
    """

    kind: ClassVar[str] = "markov"
    generator: NumberRows
    order: Texts | None = None
    start: str | None = None

    def __post_init__(self) -> None:
        rows = tuple(tuple(float(x) for x in row) for row in self.generator)
        put(self, order=_order(self.order), generator=rows)
        if not rows or any(len(row) != len(rows) for row in rows):
            message = "must be a square matrix, one row and column per mode."
            raise misshapen("generator", message, "For two modes [[-1, 1], [1, -1]].")
        for k, row in enumerate(rows):
            self._check_row(k, row)

    def _check_row(self, k: int, row: tuple[float, ...]) -> None:
        for other, rate in enumerate(row):
            if other != k:
                not_negative(rate, f"generator[{k}][{other}]")
        total = sum(row)
        if not abs(total) <= 1e-9 * max(1.0, *map(abs, row)):
            message = "must add up to 0: the diagonal entry is minus the sum of the others; got"
            cure = f"Put minus the sum of the others at [{k}][{k}]."
            raise wrong(f"generator[{k}]", f"{message} {total:g}.", cure)

    def __str__(self) -> str:
        stays = []
        for k, row in enumerate(self.generator):
            stays.append(f"{-1 / row[k]:.3g} s" if row[k] else "for ever")
        return f"Markov, mean stay {', '.join(stays)}"


@noun
class Schedule(Shown):
    """Given instants: mode ``modes[i]`` from ``times[i]`` s on; the first instant is 0."""

    kind: ClassVar[str] = "schedule"
    times: tuple[float, ...]
    modes: Texts

    def __post_init__(self) -> None:
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        put(self, times=times, modes=tuple(map(str, self.modes)))
        if len(times) != len(self.modes) or not times:
            got = f"{len(times)} and {len(self.modes)}"
            message = f"times and modes must be equally long, at least 1; got {got}."
            raise ShapeError(message, key="times", cure="Give one mode for every instant.")
        if times[0] != 0 or not _increase(times):
            cure = "Sort them, and say what is active at 0."
            raise wrong("times", "must begin with 0 and increase.", cure)

    def __str__(self) -> str:
        return f"schedule of {counted(len(self.times), 'instant')}"


@noun
class Waypoints(Shown):
    """A given motion: straight lines between positions at given instants; before and after them it
    rests.

    Shapes: times (T,) in s, increasing; positions (T, n, k), k coordinates of n agents.
    """

    times: tuple[float, ...]
    positions: tuple[NumberRows, ...]

    def __post_init__(self) -> None:
        places = np.asarray(self.positions, dtype=np.float64)
        times = tuple(not_negative(t, f"times[{i}]") for i, t in enumerate(self.times))
        if places.ndim != 3 or len(places) != len(times) or 0 in places.shape:
            wanted = f"shape (times, agents, coordinates) with {len(times)} times"
            message = f"must have {wanted}; got {places.shape}."
            cure = "Give one n x k array for every instant."
            raise misshapen("positions", message, cure)
        if not np.isfinite(places).all() or not _increase(times):
            message = "positions must be finite and times must increase."
            raise refused("times", message, "Sort the instants.")
        positions = [tuple(map(tuple, rows)) for rows in places.tolist()]
        put(self, times=times, positions=tuple(positions))

    def _card(self) -> Card:
        agents = len(self.positions[0])
        coordinates = len(self.positions[0][0])
        when = f"{len(self.times)} instants from {self.times[0]:g} to {self.times[-1]:g} s"
        text = f"of {agents} agents in {coordinates} coordinates, {when}"
        return Card(title="Waypoints", text=text)

    def __repr__(self) -> str:
        return f"<Waypoints {self._card().text}>"

    def at(self, time: float, places: Array) -> Array:
        """Positions (n, k) at a time; ``places`` is ``positions`` as an array, made once by the
        caller."""
        times = self.times
        if len(times) == 1:  # no line to interpolate on
            return np.asarray(places[0])
        passed = int(np.searchsorted(times, time, side="right")) - 1
        number = min(max(passed, 0), len(times) - 2)
        begin = times[number]
        part = (time - begin) / (times[number + 1] - begin)
        part = min(1.0, max(0.0, part))  # it rests before and after
        return np.asarray(places[number] + part * (places[number + 1] - places[number]))


@noun
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
            cure = "For example Mobile(radius=2.0, hysteresis=0.2)."
            raise refused("radius", message, cure)
        if self.radius is not None:
            put(self, radius=positive(self.radius, "radius"))
        if self.neighbours is not None:
            put(self, neighbours=whole(self.neighbours, "neighbours", least=1))
        put(self, hysteresis=not_negative(self.hysteresis, "hysteresis"))

    def __str__(self) -> str:
        near = f"{self.neighbours} nearest"
        if self.radius is not None:
            near = f"within {self.radius:g}"
        moving = "given motion" if self.motion else "the states move"
        return f"mobile, {near}, hysteresis {self.hysteresis:g}, {moving}"


Scheduled = Fixed | Periodic | RandomDwell | Markov | Schedule
Signal = Scheduled | Mobile


def _increase(times: Sequence[float]) -> bool:
    return all(a < b for a, b in pairwise(times))


def _order(given: Names | None) -> Texts | None:
    return None if given is None else tuple(map(str, given))


def signal_to_json(signal: Signal) -> str:
    """A signal as one JSON object."""
    return json.dumps({"signal": signal.kind} | asdict(signal), ensure_ascii=False)


def signal_of(problem: Problem) -> tuple[Signal, str | None]:
    """The signal of a problem's [switching], and a remark where something had to be chosen.
    Raises: SpecError."""
    names = tuple(problem.network.modes)
    own = problem.switching
    if own is None:
        chosen = f"No signal was given: {names[0]} is active throughout."
        return Fixed(), chosen if len(names) > 1 else None
    kind = own.signal
    if kind in ("schedule", "mobile"):
        remark = None
        if own.dwell is not None:
            remark = f"switching.dwell is not used by a {kind} signal."
        return _mobile(own) if kind == "mobile" else _schedule(own), remark
    # all other signals need another mode to switch to
    if len(names) == 1:
        return Fixed(), "There is one mode: nothing switches."
    if kind == "periodic" and (own.schedule or own.period):
        return _rounds(own, names), None
    if own.generator is not None:
        rows = []
        for row in own.generator:
            rows.append(tuple(_float(rate, "switching.generator") for rate in row))
        return Markov(generator=tuple(rows)), None
    dwell, remark = DWELL, f"switching.dwell is not given: {DWELL} s."
    if own.dwell is not None:
        dwell, remark = _float(own.dwell, "switching.dwell"), None
    if kind == "random":
        longest = None if own.longest is None else _float(own.longest, "switching.longest")
        return RandomDwell(dwell=dwell, longest=longest), remark
    if kind == "periodic":
        return Periodic(dwell=dwell, order=own.sequence), remark
    remark = "Markov: stays last switching.dwell on average, all other modes are equally likely."
    return even_chain(dwell, len(names)), remark


def _mobile(own: Switching) -> Mobile:
    """Graphs of a radius or of the nearest."""
    radius = None if own.radius is None else _float(own.radius, "switching.radius")
    hysteresis = _float(own.hysteresis or ZERO, "switching.hysteresis")
    return Mobile(radius=radius, neighbours=own.neighbours, hysteresis=hysteresis)


def _schedule(own: Switching) -> Schedule:
    """The instants that are stated."""
    times = []
    modes = []
    for k, (time, mode) in enumerate(own.schedule or ()):
        times.append(_float(time, f"switching.schedule[{k}][0]"))
        modes.append(mode)
    return Schedule(times=tuple(times), modes=tuple(modes))


def _rounds(own: Switching, names: Texts) -> Periodic:
    """Rounds of one period: of equal stays, or of a schedule."""
    period = own.period or ZERO
    if own.schedule is None:
        each = _float(period / len(own.sequence or names), "switching.period")
        return Periodic(dwell=each, order=own.sequence)
    instants = [time for time, _ in own.schedule]
    stays = []
    for begin, end in pairwise([*instants, period]):
        stays.append(_float(end - begin, "switching.schedule"))
    return Periodic(dwell=tuple(stays), order=tuple(mode for _, mode in own.schedule))


def even_chain(dwell: float, count: int) -> Markov:
    """A chain that stays in every mode for ``dwell`` s on average, and leaves for each other mode
    alike."""
    rate = 1 / (dwell * (count - 1))
    rows = []
    for k in range(count):
        row = [rate] * count
        row[k] = -1 / dwell
        rows.append(tuple(row))
    return Markov(generator=tuple(rows))


def _float(value: Fraction, key: str) -> float:
    """Raises: SpecError for a number beyond the range of floats."""
    number = nearest(value)
    if math.isinf(number) or (number == 0 and value):
        raise wrong(key, "is beyond the range of floats.", "Choose other units.")
    return number
