"""What a simulation was asked for: checked arguments, where runs start, and what follows before anything is integrated.

xihat starts at 0 unless it is given.  Drawn starts are the same for the same seed.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Vector, to_float
from dobc_design.exact.reading import shown
from dobc_design.problem.arrays import ArcGroup, Gain, arc_groups, no_gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import Array, finite_array, positive, seconds, whole
from dobc_design.simulation.field import ClosedForm, Loop, make_closed_form, make_loop
from dobc_design.simulation.integrate import STIFF, fastest_decay, observer_decay
from dobc_design.simulation.signals import Fixed, Mobile, Signal
from dobc_design.simulation.stress import Stress
from dobc_design.simulation.switches import Switches, groups_of, mode_index, motion_switches, scheduled_switches

TOLERANCE = 1e-9  # relative, of the integrator; the absolute one is a hundredth of it
SAMPLES = 401
MOST_NUMBERS = 1 << 26  # in a trajectory whose samples nobody asked for: half a GiB
OBSERVERS = ("closed-form", "full-loop", "off")
OFF = "The observer is off: the disturbance is not compensated."
Given = Mapping[str, Any] | Array | list[Any] | str | PathLike[str]

AWAY = 1.0  # drawn starts without a region: at most this far from the goal, in every component
PARTS = ("x", "xi", "xihat")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """One start: x (n, m), xi (n, q), xihat (n, q)."""

    x: Array
    xi: Array
    xihat: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Starts:
    """Draws starts by seed.  Arrays that are not None are the same for every seed.

    x: uniform in [low, high] by component, (n, m).  xi: where it is not given, uniform in the ball of ``radius``.
    ``own``: which states of the exosystems of all groups are an agent's own, where agents have different ones.
    """

    low: Array
    high: Array
    radius: float
    x: Array | None
    xi: Array | None
    xihat: Array
    own: NDArray[np.bool_] | None = None

    def draw(self, seed: int) -> Start:
        """The start of the run with this seed."""
        rng = np.random.default_rng(seed)
        x, xi = self.x, self.xi
        if x is None:
            with np.errstate(all="ignore"):
                x = self.low + (self.high - self.low) * rng.random(self.low.shape)
        if xi is None:
            n, q = self.xihat.shape
            directions, exponent = rng.standard_normal((n, q)), 1 / max(1, q)
            if self.own is not None:
                directions, exponent = directions * self.own, 1 / self.own.sum(axis=1, keepdims=True)
            lengths = np.linalg.norm(directions, axis=1, keepdims=True)
            xi = self.radius * rng.random((n, 1)) ** exponent * directions / np.maximum(lengths, 1e-300)
        return Start(x=x, xi=xi, xihat=self.xihat)


def make_starts(problem: Problem, loop: Loop, given: Given | None) -> Starts:
    """Decide where runs start.

    ``given``: x as an array (n, m) (or m numbers for all agents); a mapping with some of x, xi, xihat; a path to a CSV
    file with n rows of m numbers (x), or to an .npz file with arrays x, xi, xihat, where a saved trajectory
    gives its last sample.  What is not given: x from simulation.x0, else from region.initial_states, without a region
    within 1 of the goal; xi from simulation.xi0, else from the ball region.initial_disturbance, else ones; xihat = 0.
    Raises: SpecError or ShapeError for what does not fit or is not finite.
    """
    parts = _parts(given)
    n, m, q = loop.n, loop.m, loop.q
    x = None if parts.get("x") is None else _rows(parts["x"], "start.x", n, m, "component")
    xi = None if parts.get("xi") is None else _rows(parts["xi"], "start.xi", n, q, "exosystem state")
    xihat = np.zeros((n, q))
    if parts.get("xihat") is not None:
        xihat = _rows(parts["xihat"], "start.xihat", n, q, "exosystem state")
    _refuse_foreign(loop, {"xi": xi, "xihat": xihat})
    if x is None and problem.simulation.x0 is not None:
        x = np.array(np.broadcast_to(to_float(problem.simulation.x0), (n, m)))
    region = problem.region
    if region is None:
        low, high = loop.goal - AWAY, loop.goal + AWAY
    else:
        pairs = to_float(region.initial_states)
        low, high = np.broadcast_to(pairs[:, 0], (n, m)), np.broadcast_to(pairs[:, 1], (n, m))
    xi0 = problem.simulation.xi0
    radius = 0.0
    if xi is None and xi0 is not None:
        xi = _placed(xi0, loop)
    if xi is None and region is not None and region.initial_disturbance is not None:
        radius = float(region.initial_disturbance)
    elif xi is None:
        xi = np.ones((n, q)) if loop.own is None else loop.own.astype(float)
    return Starts(low=low, high=high, radius=radius, x=x, xi=xi, xihat=xihat, own=loop.own)


def _placed(rows: Sequence[Vector], loop: Loop) -> Array:
    """xi0 of the problem, one row for all agents or one each, where the states of an agent's own exosystem are."""
    if loop.own is None:
        return np.array(np.broadcast_to(to_float(tuple(rows)), (loop.n, loop.q)))
    xi = np.zeros((loop.n, loop.q))
    for agent in range(loop.n):
        xi[agent, loop.own[agent]] = to_float((rows[agent if len(rows) > 1 else 0],))[0]
    return xi


def _refuse_foreign(loop: Loop, parts: Mapping[str, Array | None]) -> None:
    """No agent may start in a state of another group's exosystem, which it does not have."""
    for name, rows in parts.items():
        if loop.own is not None and rows is not None and rows[~loop.own].any():
            agent = int(np.flatnonzero((rows * ~loop.own).any(axis=1))[0])
            raise SpecError(
                f"start.{name} must be 0 in the states that belong to other groups; row {agent} is not.",
                key=f"start.{name}",
                cure="Each row holds the states of all groups, in the order of problem.groups.",
            )


def _parts(given: Given | None) -> Mapping[str, Any]:
    if given is None:
        return {}
    if isinstance(given, (str, PathLike)):
        return _read(Path(given))
    if isinstance(given, Mapping):
        unknown = sorted(set(map(str, given)) - set(PARTS))
        if unknown:
            raise SpecError(
                f"start has an unknown part {shown(unknown[0])}.", key="start", cure=f"Known: {', '.join(PARTS)}."
            )
        return given
    return {"x": given}


def _rows(value: Any, name: str, n: int, width: int, what: str) -> Array:
    """n rows of ``width`` numbers; one row stands for all agents."""
    because = f"{n} rows of {width}: one per agent, one number per {what}"
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths
        raise ShapeError(f"{name} must be {because}; its rows differ in length.", key=name, cure="Fill them.") from None
    if shape == (n,) and width == 1:
        value = np.reshape(value, (n, 1))
    elif shape == (width,):
        value = np.tile(np.asarray(value), (n, 1))
    return finite_array(value, name, shape=(n, width), because=because)


def _read(path: Path) -> Mapping[str, Any]:
    name = shown(path.name)
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                found = {part: arrays[part] for part in PARTS if part in arrays}
            return {part: array[-1] if array.ndim == 3 else array for part, array in found.items()}
        with path.open(encoding="utf-8", newline="") as stream:
            return {"x": [[float(entry) for entry in row] for row in csv.reader(stream) if row]}
    except OSError as error:
        raise SpecError(
            f"start: {name} cannot be read: {error.strerror or error}.", key="start", cure="Check the path."
        ) from None
    except (ValueError, UnicodeDecodeError, EOFError) as error:
        raise SpecError(
            f"start: {name} does not hold a start ({str(error)[:80]}).",
            key="start",
            cure="Give a CSV file with one row of numbers per agent, or an .npz file with x, xi and xihat.",
        ) from None


class Options(TypedDict, total=False):
    """The arguments of ``simulate`` that a setting is made of."""

    mode: str | None
    signal: Signal | None
    start: Given | None
    t_final: float | None
    seed: int | None
    samples: int | Sequence[float] | None
    observer: str
    tolerance: float
    stress: Stress | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """The checked arguments of a simulation, and what all its runs share."""

    problem: Problem
    loop: Loop
    groups: Callable[[str], Sequence[ArcGroup]]
    signal: Signal
    starts: Starts
    horizon: float
    seed: int
    times: Array
    observer: str
    tolerance: float
    stress: Stress | None
    notes: tuple[str, ...]


def make_setting(problem: Problem, *, gain: Gain | None, **given: Unpack[Options]) -> Setting:
    """Check the arguments of ``simulate``.  Raises: SpecError."""
    mode, signal, stress = given.get("mode"), given.get("signal"), given.get("stress")
    _refuse_other_kinds(signal, stress)
    if mode is not None:
        if signal is not None:
            raise SpecError("mode and signal exclude each other.", key="signal", cure="Leave one of them out.")
        mode_index(mode, tuple(problem.network.modes))
    observer, t_final, seed = given.get("observer", OBSERVERS[0]), given.get("t_final"), given.get("seed")
    if observer not in OBSERVERS:
        raise SpecError(
            f"observer must be one of {', '.join(OBSERVERS)}; got {str(observer)[:40]}.",
            key="observer",
            cure='"closed-form" is the fast one.',
        )
    horizon = seconds(_horizon(problem) if t_final is None else t_final, "t_final", example="20")
    loop = make_loop(problem, no_gain(problem) if observer == "off" and gain is None else gain)
    times, notes = _times(given.get("samples"), horizon, loop.n * (4 * loop.m + 2 * loop.q))
    if stress is not None:
        stress.failing(problem)  # refuses agents that are not there
    return Setting(
        problem=problem,
        loop=loop,
        groups=cache(partial(arc_groups, problem)),
        signal=Fixed(mode=mode) if signal is None else signal,
        starts=make_starts(problem, loop, given.get("start")),
        horizon=horizon,
        seed=problem.simulation.seed if seed is None else whole(seed, "seed", least=0),
        times=times,
        observer=observer,
        tolerance=positive(given.get("tolerance", TOLERANCE), "tolerance", example="1e-9"),
        stress=None if stress is None or stress.is_calm else stress,
        notes=(*notes, OFF) if observer == "off" and problem.q else notes,
    )


def _refuse_other_kinds(signal: Any, stress: Any) -> None:
    """Raises: SpecError for a signal or a stress that is none, such as its name."""
    if not (signal is None or isinstance(signal, Signal)):
        raise SpecError(
            f"signal must be a switching signal; got {str(signal)[:40]}.",
            key="signal",
            cure="For example Periodic(dwell=0.5); names belong into [switching] of a problem file.",
        )
    if not (stress is None or isinstance(stress, Stress)):
        raise SpecError(
            f"stress must be a Stress; got {str(stress)[:40]}.", key="stress", cure="For example Stress(noise=0.1)."
        )


def error_matrix(setting: Setting) -> Array:
    """The F of eps' = F eps: A - W C; A alone where the observer is off."""
    loop = setting.loop
    return loop.A if setting.observer == "off" else loop.F


def moves_by_state(setting: Setting) -> bool:
    """Whether the graphs follow from the states."""
    return isinstance(setting.signal, Mobile) and setting.signal.motion is None


def closed_form_of(setting: Setting) -> ClosedForm | None:
    """C exp(F t) up to the horizon; None if there is no disturbance, or if it is out of reach."""
    if setting.loop.q == 0:
        return None
    return make_closed_form(error_matrix(setting), setting.loop.C, setting.horizon)


def is_stiff(setting: Setting, *, closed: bool) -> bool:
    """Whether an explicit method would need too many steps, estimated at the consensus."""
    names = tuple(setting.problem.network.modes)
    if isinstance(setting.signal, Fixed):
        names = (setting.signal.mode or names[0],)
    elif isinstance(setting.signal, Mobile):
        names = ()
    decays = [fastest_decay(setting.loop, setting.groups(name)) for name in names]
    fastest = max(decays, default=fastest_decay(setting.loop, ()))
    if not closed:
        fastest = max(fastest, observer_decay(setting.loop))
    return setting.horizon * fastest > STIFF


def switches_for(setting: Setting, seed: int) -> Switches:
    """The switches of one run.  A mobile signal must have a given motion."""
    signal = setting.signal
    if isinstance(signal, Mobile):
        if signal.motion is None:
            raise SpecError("the switches follow from the states.", key="signal", cure="Give a motion.")
        return motion_switches(signal, signal.motion, setting.loop.n, setting.horizon)[0]
    return scheduled_switches(signal, tuple(setting.problem.network.modes), setting.horizon, seed)


def groups_for(setting: Setting, switches: Switches) -> Callable[[int], Sequence[ArcGroup]]:
    """The arcs of a mode by its index: the problem's own, or those of a mobile graph."""
    problem = setting.problem

    def groups(mode: int) -> Sequence[ArcGroup]:
        if switches.graphs:
            listeners, speakers = switches.graphs[mode]
            return groups_of(problem, listeners * problem.n + speakers)
        return setting.groups(switches.names[mode])

    return groups


def describe(signal: Signal, problem: Problem) -> str:
    """The mode of a fixed signal by name; else the modes and the signal in words."""
    names = tuple(problem.network.modes)
    if isinstance(signal, Fixed):
        return signal.mode or names[0]
    if isinstance(signal, Mobile):
        return str(signal)
    shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    return f"{shown} ({signal})"


def _horizon(problem: Problem) -> Any:
    try:
        return problem.simulation.horizon
    except OverflowError:
        return problem.simulation.t_final


def _times(samples: int | Sequence[float] | None, horizon: float, width: int) -> tuple[Array, tuple[str, ...]]:
    if samples is None:
        count = int(min(SAMPLES, max(2, MOST_NUMBERS // max(1, width))))
        note = () if count == SAMPLES else (f"{count} samples only, because every one holds {width} numbers.",)
        return np.linspace(0.0, horizon, count), note
    if np.ndim(samples) == 0:
        return np.linspace(0.0, horizon, whole(samples, "samples", least=2)), ()
    times = finite_array(samples, "samples", shape=np.shape(samples), because="one list of times")
    if times.ndim != 1 or len(times) < 2 or times[0] != 0 or times[-1] != horizon or (np.diff(times) <= 0).any():
        raise SpecError(
            f"samples must be a number, or times that increase from 0 to t_final, {horizon:g} s.",
            key="samples",
            cure="For example 401.",
        )
    return times, ()
