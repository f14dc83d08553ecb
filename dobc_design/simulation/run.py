"""One run of the closed loop (1), (12), (13), (19), with any switching signal.

The observer's error is known in closed form, so by default only e is integrated; the full loop as printed is the
reference, and is taken where the closed form is out of reach.  Loops whose observer is never heard run without.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from dobc_design.problem.arrays import Gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation.agents import Agents, Outcome
from dobc_design.simulation.air import Links
from dobc_design.simulation.closed_form import evolve
from dobc_design.simulation.integrate import Run, integrate
from dobc_design.simulation.mobile import Mobile, Record, groups_of, near
from dobc_design.simulation.plans import Errors, Full, Moving, Scheduled
from dobc_design.simulation.sampled import LinksAt, run_sampled, sample_instants
from dobc_design.simulation.setting import (
    TOLERANCE,
    Progress,
    Setting,
    closed_form_of,
    describe,
    error_matrix,
    groups_for,
    is_stiff,
    make_setting,
    switches_for,
)
from dobc_design.simulation.signal_files import Signal, signal_to_json
from dobc_design.simulation.starts import Given, Start
from dobc_design.simulation.stress import Stress, stress_to_json
from dobc_design.simulation.stressed import Stressed, run_continuously
from dobc_design.simulation.switches import Array, Switches
from dobc_design.simulation.trajectory import Trajectory


def simulate(
    problem: Problem,
    *,
    mode: str | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    gain: Gain | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = "closed-form",
    tolerance: float = TOLERANCE,
    stress: Stress | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Integrate the closed loop in one mode (the first, or ``mode``), or under a switching ``signal``.

    Starts: see ``starts.make_starts``; without ``start`` x is drawn from region.initial_states by ``seed``, and
    xihat = 0.  ``t_final`` in s and ``seed`` default to the problem's; ``gain`` (q, m) takes the place of
    problem.observer.W.  ``samples`` is their number, or the times themselves from 0 on, in s.
    ``observer``: "closed-form" integrates e with eps = exp((A - W C) t) eps(0), "full-loop" all of (1), (12), (13),
    (19) as printed, "off" leaves the disturbance uncompensated (dhat = 0).  ``tolerance`` is relative.
    ``stress``: what the theorems leave out, from noise to failing agents; always the full loop.  d then holds all of
    the disturbance and u the input that is applied.
    ``progress`` is called with the part of the horizon that is done, from 0 to 1.
    Returns: a Trajectory.  A run that diverges raises nothing: it is flagged with a reason and keeps the samples
    before, the last of which is where it had to stop.
    Raises: SpecError for a wrong argument, or if there is an exosystem and no W.
    """
    setting = make_setting(
        problem,
        mode=mode,
        signal=signal,
        start=start,
        t_final=t_final,
        seed=seed,
        gain=gain,
        samples=samples,
        observer=observer,
        tolerance=tolerance,
        stress=stress,
    )
    return run_once(setting, setting.seed, progress=progress)


def run_once(setting: Setting, seed: int, *, progress: Progress | None = None) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a warning.
    with np.errstate(all="ignore"):
        start = setting.starts.draw(seed)
        if setting.stress is not None:
            return _under_stress(setting, setting.stress, seed, start, progress)
        system, flat, closed = system_of(setting, start)
        plan, switches = _plan(setting, system, seed)
        run = integrate(
            plan,
            flat,
            setting.times,
            tolerance=setting.tolerance,
            implicit=is_stiff(setting, closed=closed),
            progress=progress,
        )
        if isinstance(plan, Moving):
            switches = plan.record.switches()
        return _trajectory(setting, seed, start, run, switches, full=isinstance(system, Full))


def system_of(setting: Setting, start: Start) -> tuple[Errors | Full, Array, bool]:
    """What is integrated, its flat start, and whether the observer's error is left to the closed form."""
    loop = setting.loop
    closed = None if setting.observer == "full-loop" else closed_form_of(setting)
    if setting.observer == "full-loop" or (loop.q and closed is None):
        z = start.xihat - loop.correction(start.x)
        return Full(loop), np.concatenate([start.x.ravel(), start.xi.ravel(), z.ravel()]), False
    return Errors(loop, closed, start.xi - start.xihat), (start.x - loop.goal).ravel(), True


def _plan(setting: Setting, system: Errors | Full, seed: int) -> tuple[Scheduled | Moving, Switches | None]:
    if isinstance(setting.signal, Mobile) and setting.signal.motion is None:
        return Moving(system, setting.signal, setting.problem, setting.horizon), None
    switches = switches_for(setting, seed)
    return Scheduled(system, switches, groups_for(setting, switches), setting.horizon), switches


def _under_stress(setting: Setting, stress: Stress, seed: int, start: Start, progress: Progress | None) -> Trajectory:
    """One run of the full loop under a stress."""
    loop = setting.loop
    agents = Agents(loop, stress, stress.failing(setting.problem), seed=seed, heeds=setting.observer != "off")
    if stress.period is not None:
        links_at, record = _sampled_links(setting, seed)
        done = run_sampled(loop, agents, start, setting.times, links_at, progress=progress)
        switches: Switches | None = record.switches() if isinstance(record, Record) else record
    else:
        if stress.draws is not None:
            sample_instants(stress.draws, setting.horizon, name="exchange")  # refuses too many
        system = Stressed(loop, agents)
        plan, scheduled = _plan(setting, system, seed)
        done = run_continuously(
            plan,
            system,
            start,
            setting.times,
            tolerance=setting.tolerance,
            implicit=is_stiff(setting, closed=False),
            progress=progress,
        )
        switches = plan.record.switches() if isinstance(plan, Moving) else scheduled
    return _stressed_trajectory(setting, agents, seed, done, switches)


def _sampled_links(setting: Setting, seed: int) -> tuple[LinksAt, Record | Switches]:
    """The arcs at a sample: those of the active mode, or those that follow from the positions there."""
    loop, problem, signal = setting.loop, setting.problem, setting.signal
    if isinstance(signal, Mobile) and signal.motion is None:
        record = Record(loop.n)

        def nearby(time: float, x: Array) -> Links:
            graph = near(signal, x, record.codes[record.modes[-1]] if record.modes else None)
            if not record.modes or not np.array_equal(graph, record.codes[record.modes[-1]]):
                record.add(time, graph)
            return Links(groups_of(problem, graph), loop.n, loop.m)

        return nearby, record
    switches = switches_for(setting, seed)
    groups = groups_for(setting, switches)
    made = cache(lambda mode: Links(groups(mode), loop.n, loop.m))
    return lambda time, x: made(int(switches.at(np.array([time]))[0])), switches


def _stressed_trajectory(
    setting: Setting, agents: Agents, seed: int, done: Outcome, switches: Switches | None
) -> Trajectory:
    problem, loop, stress = setting.problem, setting.loop, agents.stress
    d = done.xi @ loop.C.T + (agents.extra(done.times) if stress.disturbance else 0.0)
    return Trajectory(
        name=problem.name,
        mode=describe(setting.signal, problem),
        labels=problem.network.labels,
        t_final=setting.horizon,
        seed=seed,
        times=done.times,
        x=done.x,
        xi=done.xi,
        xihat=done.xihat,
        d=d,
        dhat=done.dhat,
        u=done.u,
        goal=loop.goal.copy(),
        diverged=bool(done.reason),
        reason=done.reason,
        method=done.method,
        evaluations=done.evaluations,
        notes=(*setting.notes, *done.notes, f"Stress: {stress}."),
        signal=signal_to_json(setting.signal),
        observer=setting.observer,
        stress=stress_to_json(stress),
        switches=_kept(switches, done.times, bool(done.reason)),
    )


def _trajectory(
    setting: Setting, seed: int, start: Start, run: Run, switches: Switches | None, *, full: bool
) -> Trajectory:
    loop = setting.loop
    if full:
        x, xi, z = (part.copy() for part in loop.split(run.states))
        xihat = z + loop.correction(x)
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
        name=setting.problem.name,
        mode=describe(setting.signal, setting.problem),
        labels=setting.problem.network.labels,
        t_final=setting.horizon,
        seed=seed,
        times=run.times,
        x=x,
        xi=xi,
        xihat=xihat,
        d=xi @ loop.C.T,
        dhat=dhat,
        u=loop.control(x - loop.goal, dhat),
        goal=loop.goal.copy(),
        diverged=bool(run.reason),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=tuple(notes),
        signal=signal_to_json(setting.signal),
        observer=setting.observer,
        switches=_kept(switches, run.times, bool(run.reason)),
    )


def _kept(switches: Any, times: Array, ended: bool) -> Any:
    """The switches up to where the run ended."""
    if switches is None or not ended:
        return switches
    count = int(np.searchsorted(switches.times, times[-1], side="right"))
    return Switches(
        times=switches.times[:count].copy(),
        modes=switches.modes[:count].copy(),
        names=switches.names,
        graphs=switches.graphs,
    )
