"""One run of the closed loop (1), (12), (13), (19), with any switching signal.

The observer's error is known in closed form, so by default only e is integrated; the full loop as printed is the
reference, and is taken where the closed form is out of reach.  Loops whose observer is never heard run without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.model.arrays import ArcGroup, Gain
from dobc_design.simulate._arguments import finite_array, positive, seconds, whole
from dobc_design.simulate.closed_form import ClosedForm, evolve, make_closed_form
from dobc_design.simulate.field import Loop, make_loop
from dobc_design.simulate.graph import groups_of_mode
from dobc_design.simulate.integrate import Run, integrate
from dobc_design.simulate.mobile import Mobile, groups_of, motion_switches
from dobc_design.simulate.plans import Errors, Full, Moving, Scheduled
from dobc_design.simulate.signal_files import Signal, signal_to_json
from dobc_design.simulate.signals import Fixed, mode_index, scheduled_switches
from dobc_design.simulate.starts import Given, Start, make_starts
from dobc_design.simulate.stiffness import STIFF, fastest_decay, observer_decay
from dobc_design.simulate.switches import Array, Switches
from dobc_design.simulate.trajectory import Trajectory
from dobc_design.spec.problem import Problem

Progress = Callable[[float], None]

TOLERANCE = 1e-9  # relative, of the integrator; the absolute one is a hundredth of it
SAMPLES = 401
MOST_NUMBERS = 1 << 26  # in a trajectory whose samples nobody asked for: half a GiB
OBSERVERS = ("closed-form", "full-loop", "off")


def simulate(
    problem: Problem, *, mode: str | None = None, signal: Signal | None = None, start: Given | None = None,
    t_final: float | None = None, seed: int | None = None, gain: Gain | None = None,
    samples: int | Sequence[float] | None = None, observer: str = "closed-form", tolerance: float = TOLERANCE,
    progress: Progress | None = None,
) -> Trajectory:  # fmt: skip
    """Integrate the closed loop in one mode (the first, or ``mode``), or under a switching ``signal``.

    Starts: see ``starts.make_starts``; without ``start`` x is drawn from region.initial_states by ``seed``, and
    xihat = 0.  ``t_final`` in s and ``seed`` default to the problem's; ``gain`` (q, m) takes the place of
    problem.observer.W.  ``samples`` is their number, or the times themselves from 0 on, in s.
    ``observer``: "closed-form" integrates e with eps = exp((A - W C) t) eps(0), "full-loop" all of (1), (12), (13),
    (19) as printed, "off" leaves the disturbance uncompensated (dhat = 0).  ``tolerance`` is relative.
    ``progress`` is called with the part of the horizon that is done, from 0 to 1.
    Returns: a Trajectory.  A run that diverges raises nothing: it is flagged with a reason and keeps the samples
    before, the last of which is where it had to stop.
    Raises: SpecError for a wrong argument, or if there is an exosystem and no W.
    """
    setting = make_setting(
        problem, mode=mode, signal=signal, start=start, t_final=t_final, seed=seed, gain=gain, samples=samples,
        observer=observer, tolerance=tolerance,
    )  # fmt: skip
    return run_once(setting, setting.seed, progress=progress)


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
    notes: tuple[str, ...]


def make_setting(
    problem: Problem, *, mode: str | None, signal: Signal | None, start: Given | None, t_final: float | None,
    seed: int | None, gain: Gain | None, samples: int | Sequence[float] | None, observer: str, tolerance: float,
) -> Setting:  # fmt: skip
    """Check the arguments of ``simulate``.  Raises: SpecError."""
    if mode is not None:
        if signal is not None:
            raise SpecError("mode and signal exclude each other.", key="signal", cure="Leave one of them out.")
        mode_index(mode, tuple(problem.network.modes))
    if observer not in OBSERVERS:
        raise SpecError(
            f"observer must be one of {', '.join(OBSERVERS)}; got {str(observer)[:40]}.", key="observer",
            cure='"closed-form" is the fast one.',
        )  # fmt: skip
    horizon = seconds(_horizon(problem) if t_final is None else t_final, "t_final", example="20")
    if observer == "off" and gain is None:
        gain = [[0] * problem.m for _ in range(problem.q)] if problem.q else None
    loop = make_loop(problem, gain)
    times, notes = _times(samples, horizon, loop.n * (4 * loop.m + 2 * loop.q))
    return Setting(
        problem=problem, loop=loop, groups=cache(partial(groups_of_mode, problem)),
        signal=Fixed(mode=mode) if signal is None else signal,
        starts=make_starts(problem, loop, start), horizon=horizon,
        seed=problem.simulation.seed if seed is None else whole(seed, "seed", least=0), times=times,
        observer=observer, tolerance=positive(tolerance, "tolerance", example="1e-9"), notes=notes,
    )  # fmt: skip


def run_once(setting: Setting, seed: int, *, progress: Progress | None = None) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a warning.
    with np.errstate(all="ignore"):
        start = setting.starts.draw(seed)
        system, flat, closed = system_of(setting, start)
        plan, switches = _plan(setting, system, seed)
        run = integrate(
            plan, flat, setting.times, tolerance=setting.tolerance, implicit=is_stiff(setting, closed=closed),
            progress=progress,
        )  # fmt: skip
        if isinstance(plan, Moving):
            switches = plan.record.switches()
        return _trajectory(setting, seed, start, run, switches, full=isinstance(system, Full))


def error_matrix(setting: Setting) -> Array:
    """The F of eps' = F eps: A - W C; A alone where the observer is off."""
    loop = setting.loop
    return loop.A if setting.observer == "off" else loop.A - loop.W @ loop.C


def closed_form_of(setting: Setting) -> ClosedForm | None:
    """C exp(F t) up to the horizon; None if there is no disturbance, or if it is out of reach."""
    if setting.loop.q == 0:
        return None
    return make_closed_form(error_matrix(setting), setting.loop.C, setting.horizon)


def system_of(setting: Setting, start: Start) -> tuple[Errors | Full, Array, bool]:
    """What is integrated, its flat start, and whether the observer's error is left to the closed form."""
    loop = setting.loop
    closed = None if setting.observer == "full-loop" else closed_form_of(setting)
    if setting.observer == "full-loop" or (loop.q and closed is None):
        z = start.xihat - start.x @ loop.W.T
        return Full(loop), np.concatenate([start.x.ravel(), start.xi.ravel(), z.ravel()]), False
    return Errors(loop, closed, start.xi - start.xihat), (start.x - loop.goal).ravel(), True


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


def _plan(setting: Setting, system: Errors | Full, seed: int) -> tuple[Scheduled | Moving, Switches | None]:
    if isinstance(setting.signal, Mobile) and setting.signal.motion is None:
        return Moving(system, setting.signal, setting.problem, setting.horizon), None
    switches = switches_for(setting, seed)
    return Scheduled(system, switches, groups_for(setting, switches), setting.horizon), switches


def _trajectory(
    setting: Setting, seed: int, start: Start, run: Run, switches: Switches | None, *, full: bool
) -> Trajectory:
    loop = setting.loop
    if full:
        x, xi, z = (part.copy() for part in loop.split(run.states))
        xihat = z + x @ loop.W.T
    else:
        x = run.states.reshape(-1, loop.n, loop.m) + loop.goal
        xi = evolve(loop.A, start.xi, run.times)
        xihat = xi - evolve(error_matrix(setting), start.xi - start.xihat, run.times)
        if setting.observer == "off":
            xihat = np.zeros_like(xi)
    dhat = xihat @ loop.C.T
    notes = [*setting.notes, *run.notes]
    if run.method.startswith("Radau"):
        notes.append("The loop is stiff: integrated by the implicit method Radau.")
    if full and setting.observer == "closed-form":
        notes.append("The observer is too fast for its closed form: the full loop was integrated.")
    return Trajectory(
        name=setting.problem.name, mode=describe(setting.signal, setting.problem),
        labels=setting.problem.network.labels, t_final=setting.horizon, seed=seed, times=run.times, x=x, xi=xi,
        xihat=xihat, d=xi @ loop.C.T, dhat=dhat, u=loop.control(x - loop.goal, dhat), goal=loop.goal.copy(),
        diverged=bool(run.reason), reason=run.reason, method=run.method, evaluations=run.evaluations,
        notes=tuple(notes), signal=signal_to_json(setting.signal), switches=_kept(switches, run),
    )  # fmt: skip


def _kept(switches: Switches | None, run: Run) -> Any:
    """The switches up to where the run ended."""
    if switches is None or not run.reason:
        return switches
    count = int(np.searchsorted(switches.times, run.times[-1], side="right"))
    return Switches(
        times=switches.times[:count].copy(), modes=switches.modes[:count].copy(), names=switches.names,
        graphs=switches.graphs,
    )  # fmt: skip


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
            f"samples must be a number, or times that increase from 0 to t_final, {horizon:g} s.", key="samples",
            cure="For example 401.",
        )  # fmt: skip
    return times, ()
