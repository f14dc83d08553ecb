"""What a simulation was asked for: checked arguments, and what follows from them before anything is integrated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.problem.arrays import ArcGroup, Gain, arc_groups, no_gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import finite_array, positive, seconds, whole
from dobc_design.simulation.closed_form import ClosedForm, make_closed_form
from dobc_design.simulation.field import Loop, make_loop
from dobc_design.simulation.mobile import Mobile, groups_of, motion_switches
from dobc_design.simulation.signal_files import Signal
from dobc_design.simulation.signals import Fixed, mode_index, scheduled_switches
from dobc_design.simulation.starts import Given, make_starts
from dobc_design.simulation.stiffness import STIFF, fastest_decay, observer_decay
from dobc_design.simulation.stress import Stress
from dobc_design.simulation.switches import Array, Switches

Progress = Callable[[float], None]

TOLERANCE = 1e-9  # relative, of the integrator; the absolute one is a hundredth of it
SAMPLES = 401
MOST_NUMBERS = 1 << 26  # in a trajectory whose samples nobody asked for: half a GiB
OBSERVERS = ("closed-form", "full-loop", "off")
OFF = "The observer is off: the disturbance is not compensated."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setting:
    """The checked arguments of a simulation, and what all its runs share."""

    problem: Problem
    loop: Loop
    groups: Callable[[str], Sequence[ArcGroup]]
    signal: Signal
    starts: Any
    horizon: float
    seed: int
    times: Array
    observer: str
    tolerance: float
    stress: Stress | None
    notes: tuple[str, ...]


def make_setting(
    problem: Problem,
    *,
    mode: str | None,
    signal: Signal | None,
    start: Given | None,
    t_final: float | None,
    seed: int | None,
    gain: Gain | None,
    samples: int | Sequence[float] | None,
    observer: str,
    tolerance: float,
    stress: Stress | None = None,
) -> Setting:
    """Check the arguments of ``simulate``.  Raises: SpecError."""
    _refuse_other_kinds(signal, stress)
    if mode is not None:
        if signal is not None:
            raise SpecError("mode and signal exclude each other.", key="signal", cure="Leave one of them out.")
        mode_index(mode, tuple(problem.network.modes))
    if observer not in OBSERVERS:
        raise SpecError(
            f"observer must be one of {', '.join(OBSERVERS)}; got {str(observer)[:40]}.",
            key="observer",
            cure='"closed-form" is the fast one.',
        )
    horizon = seconds(_horizon(problem) if t_final is None else t_final, "t_final", example="20")
    if observer == "off" and gain is None:
        gain = no_gain(problem)
    loop = make_loop(problem, gain)
    times, notes = _times(samples, horizon, loop.n * (4 * loop.m + 2 * loop.q))
    if stress is not None:
        stress.failing(problem)  # refuses agents that are not there
    return Setting(
        problem=problem,
        loop=loop,
        groups=cache(partial(arc_groups, problem)),
        signal=Fixed(mode=mode) if signal is None else signal,
        starts=make_starts(problem, loop, start),
        horizon=horizon,
        seed=problem.simulation.seed if seed is None else whole(seed, "seed", least=0),
        times=times,
        observer=observer,
        tolerance=positive(tolerance, "tolerance", example="1e-9"),
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
