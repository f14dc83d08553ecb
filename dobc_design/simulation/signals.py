"""Switching signals that know nothing of the state: fixed, periodic, random, Markov, a schedule.

A signal is a value: it can be compared, printed and stored (``signal_files``), and together with a seed it gives the
same switches every time.  Graphs that follow from positions are in ``mobile``.  None of this enters a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from dobc_design._show.cards import Shown
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.reading import counted, is_list, shown
from dobc_design.simulation._arguments import not_negative, seconds
from dobc_design.simulation.switches import Array, IndexArray, Switches, merged

MOST_SWITCHES = 1_000_000  # of one run
STREAM = 1  # starts are drawn from default_rng(seed), switches from default_rng([seed, STREAM])
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


Scheduled = Fixed | Periodic | RandomDwell | Markov | Schedule


def scheduled_switches(signal: Scheduled, names: tuple[str, ...], horizon: float, seed: int) -> Switches:
    """Draw the switches of one run over ``horizon`` s.  The same arguments give the same switches.

    Raises: SpecError for a mode that is not among ``names``, or for too many switches.
    """
    if isinstance(signal, Fixed):
        modes = np.array([0 if signal.mode is None else mode_index(signal.mode, names)])
        return Switches(times=np.zeros(1), modes=modes, names=names)
    if isinstance(signal, Schedule):
        times = np.array([t for t in signal.times if t < horizon])
        return merged(times, np.array([mode_index(mode, names) for mode in signal.modes[: len(times)]]), names)
    if isinstance(signal, Periodic):
        return merged(*_periodic(signal, names, horizon), names)
    rng = np.random.default_rng([seed, STREAM])
    if isinstance(signal, RandomDwell):
        return merged(*_random(signal, len(names), horizon, rng), names)
    return merged(*_markov(signal, names, horizon, rng), names)


def mode_index(mode: str, names: tuple[str, ...]) -> int:
    """The index of a mode.  Raises: SpecError if there is no such mode."""
    if mode not in names:
        known = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        raise SpecError(
            f"mode must be one of the problem's modes ({known}); got {shown(mode)}.",
            key="mode",
            cure="Leave it out for the first one.",
        )
    return names.index(mode)


def refuse_too_many(count: float, *, cure: str = "Choose a longer dwell time or a shorter horizon.") -> None:
    """Refuse a signal that would switch more often than can be stored.  Raises: SpecError."""
    if not count <= MOST_SWITCHES:
        raise SpecError(
            f"the signal would switch about {count:.3g} times, and at most {MOST_SWITCHES} are simulated.",
            key="signal",
            cure=cure,
        )


def _set_order(signal: Periodic | Markov) -> None:
    if signal.order is not None:
        object.__setattr__(signal, "order", tuple(str(mode) for mode in signal.order))


def _order(order: tuple[str, ...] | None, names: tuple[str, ...], length: int | None, key: str) -> IndexArray:
    found = np.array([mode_index(mode, names) for mode in (names if order is None else order)])
    if length is not None and length != len(found):
        raise ShapeError(
            f"{key} must have {counted(len(found), 'entry').replace('entrys', 'entries')}, one per mode; got {length}.",
            key=key,
            cure="Give one per mode, or name the modes with order.",
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
        times = np.asarray((np.arange(int(rounds) + 1)[:, None] * ends[-1] + begins).ravel(), dtype=np.float64)
    return times[times < horizon], modes[times < horizon]


def _random(signal: RandomDwell, count: int, horizon: float, rng: np.random.Generator) -> tuple[Array, IndexArray]:
    draws = horizon / signal.dwell
    refuse_too_many(draws)
    most = int(draws) + 1
    modes = rng.integers(count, size=most)
    if signal.longest is None:
        times = signal.dwell * np.arange(most)
    else:
        stays = rng.uniform(signal.dwell, signal.longest, size=most)
        times = np.concatenate([[0.0], np.cumsum(stays)[:-1]])
    seen: Any = times < horizon
    return np.asarray(times[seen]), modes[seen]


def _markov(
    signal: Markov, names: tuple[str, ...], horizon: float, rng: np.random.Generator
) -> tuple[Array, IndexArray]:
    order = _order(signal.order, names, len(signal.generator), "generator")
    rates = np.array(signal.generator)
    start = order[0] if signal.start is None else mode_index(signal.start, names)
    if start not in order:
        raise SpecError(
            f"start must be one of order; got {shown(signal.start)}.", key="start", cure="Name one of them."
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


def plain(value: Any) -> Any:
    """Tuples as lists, for JSON."""
    return [plain(each) for each in value] if isinstance(value, (tuple, list)) else value
