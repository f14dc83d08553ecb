"""One run of the closed loop (1), (12), (13), (19), with any switching signal.

The observer's error is known in closed form, so by default only e is integrated; the full loop as printed is the
reference, and is taken where the closed form is out of reach.  A run under stress is a stack of one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from dobc_design.problem.arrays import ArcGroup, Gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation.agents import StressedRuns
from dobc_design.simulation.field import evolve
from dobc_design.simulation.integrate import Errors, Full, Moving, Outcome, Progress, Scheduled, integrate
from dobc_design.simulation.sampled import run_sampled_alone
from dobc_design.simulation.setting import (
    Options,
    Setting,
    Start,
    closed_form_of,
    describe,
    error_matrix,
    groups_for,
    is_stiff,
    make_setting,
    switches_for,
)
from dobc_design.simulation.signals import Mobile, signal_to_json
from dobc_design.simulation.stress import Stress, stress_to_json
from dobc_design.simulation.stressed import run_alone
from dobc_design.simulation.switches import Nearby, Switches
from dobc_design.simulation.trajectory import Trajectory


def simulate(
    problem: Problem, *, gain: Gain | None = None, progress: Progress | None = None, **given: Unpack[Options]
) -> Trajectory:
    """Integrate the closed loop in one mode (the first, or ``mode``), or under a switching ``signal``.

    ``gain`` (q, m) takes the place of problem.observer.W; the other arguments, what is returned and what is raised are
    those of ``simulations.simulate``, but nothing is designed and [switching] is not looked at.
    """
    setting = make_setting(problem, gain=gain, **given)
    return run_once(setting, setting.seed, progress=progress)


def run_once(setting: Setting, seed: int, *, progress: Progress | None = None) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    problem, loop, stress = setting.problem, setting.loop, setting.stress
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a warning.
    with np.errstate(all="ignore"):
        start, modes = setting.starts.draw(seed), _modes(setting, seed)
        if stress is None:
            done = _calm(setting, start, modes, progress)
        else:
            nearby = modes.nearby if isinstance(modes, Moving) else None
            switches = () if isinstance(modes, Moving) else (modes.switches,)
            runs = stressed_runs(setting, stress, [seed], switches, modes.groups, nearby=nearby)
            if stress.period is not None:
                done = run_sampled_alone(runs, setting.times, progress=progress)
            else:
                implicit, tolerance = is_stiff(setting, closed=False), setting.tolerance
                done = run_alone(runs, modes, setting.times, tolerance=tolerance, implicit=implicit, progress=progress)
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
        d=done.d,
        dhat=done.dhat,
        u=done.u,
        goal=loop.goal.copy(),
        diverged=bool(done.reason),
        reason=done.reason,
        method=done.method,
        evaluations=done.evaluations,
        notes=(*setting.notes, *done.notes, *(() if stress is None else (f"Stress: {stress}.",))),
        signal=signal_to_json(setting.signal),
        observer=setting.observer,
        stress="" if stress is None else stress_to_json(stress),
        switches=_kept(modes.switches, float(done.times[-1])) if done.reason else modes.switches,
    )


def stressed_runs(
    setting: Setting,
    stress: Stress,
    seeds: Sequence[int],
    switches: Sequence[Switches],
    groups: Callable[[int], Sequence[ArcGroup]],
    *,
    nearby: Nearby | None = None,
) -> StressedRuns:
    """Runs under a stress, side by side."""
    return StressedRuns(
        loop=setting.loop,
        stress=stress,
        failing=stress.failing(setting.problem),
        heeds=setting.observer != "off",
        groups=groups,
        starts=[setting.starts.draw(seed) for seed in seeds],
        seeds=seeds,
        switches=switches,
        nearby=nearby,
    )


def _modes(setting: Setting, seed: int) -> Scheduled | Moving:
    signal = setting.signal
    if isinstance(signal, Mobile) and signal.motion is None:
        return Moving(Nearby(signal, setting.problem), setting.horizon)
    switches = switches_for(setting, seed)
    return Scheduled(switches, groups_for(setting, switches), setting.horizon)


def _calm(setting: Setting, start: Start, modes: Scheduled | Moving, progress: Progress | None) -> Outcome:
    """A run without stress: e alone with eps in closed form, or the full loop."""
    loop, asked = setting.loop, setting.observer == "full-loop"
    closed = None if asked else closed_form_of(setting)
    full = asked or (loop.q > 0 and closed is None)
    plan: Errors | Full = Full(loop, modes)
    flat = np.concatenate([start.x.ravel(), start.xi.ravel(), (start.xihat - loop.correction(start.x)).ravel()])
    if not full:
        plan, flat = Errors(loop, modes, closed, start.xi - start.xihat), (start.x - loop.goal).ravel()
    implicit, tolerance = is_stiff(setting, closed=not full), setting.tolerance
    run = integrate(plan, flat, setting.times, tolerance=tolerance, implicit=implicit, progress=progress)
    if full:
        x, xi, z = (part.copy() for part in loop.split(run.states))
        xihat = z + loop.correction(x)
    else:
        x = run.states.reshape(-1, loop.n, loop.m) + loop.goal
        xi = evolve(loop.A, start.xi, run.times)
        xihat = xi - evolve(error_matrix(setting), start.xi - start.xihat, run.times)
        if setting.observer == "off":
            xihat = np.zeros_like(xi)
    dhat, notes = xihat @ loop.C.T, list(run.notes)
    if run.method.startswith("Radau"):
        notes.append("The loop is stiff: integrated by the implicit method Radau.")
    if full and not asked:
        notes.append("The observer is too fast for its closed form: the full loop was integrated.")
    return Outcome(
        times=run.times,
        x=x,
        xi=xi,
        xihat=xihat,
        d=xi @ loop.C.T,
        dhat=dhat,
        u=loop.control(x - loop.goal, dhat),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=tuple(notes),
    )


def _kept(switches: Switches, end: float) -> Switches:
    """The switches up to where the run ended."""
    count = int(np.searchsorted(switches.times, end, side="right"))
    return replace(switches, times=switches.times[:count].copy(), modes=switches.modes[:count].copy())
