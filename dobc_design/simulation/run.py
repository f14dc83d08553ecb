"""One run of the closed loop (1), (12), (13), (19), with any switching signal.

The observer's error is known in closed form, so by default only e is integrated; the full loop as printed is the
reference, and is taken where the closed form is out of reach.  A run under stress is a stack of one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Unpack

import numpy as np

from dobc_design.problem.arrays import Gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import evolve
from dobc_design.simulation.integrate import Errors, Full, Integration, Moving, Progress, Run, Samples, Scheduled
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
from dobc_design.simulation.stress import stress_to_json
from dobc_design.simulation.stressed import StressedRuns, run_alone
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
            run, parts = _calm(setting, start, modes, progress)
        else:
            runs = StressedRuns(
                setting=setting,
                stress=stress,
                groups=modes.groups,
                starts=[start],
                seeds=[seed],
                switches=[modes.switches] if isinstance(modes, Scheduled) else [],
                nearby=None if isinstance(modes, Scheduled) else modes.nearby,
            )
            sampled = stress.period is not None
            run, parts = (
                run_sampled_alone(runs, progress=progress) if sampled else run_alone(runs, modes, progress=progress)
            )
    return Trajectory(
        name=problem.name,
        mode=describe(setting.signal, problem),
        labels=problem.network.labels,
        t_final=setting.horizon,
        seed=seed,
        goal=loop.goal.copy(),
        times=run.times,
        diverged=bool(run.reason),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=(*setting.notes, *run.notes, *(() if stress is None else (f"Stress: {stress}.",))),
        signal=signal_to_json(setting.signal),
        observer=setting.observer,
        stress="" if stress is None else stress_to_json(stress),
        switches=_kept(modes.switches, float(run.times[-1])) if run.reason else modes.switches,
        **parts,
    )


def _modes(setting: Setting, seed: int) -> Scheduled | Moving:
    signal = setting.signal
    if isinstance(signal, Mobile) and signal.motion is None:
        return Moving(Nearby(signal, setting.problem), setting.horizon)
    switches = switches_for(setting, seed)
    return Scheduled(switches, groups_for(setting, switches), setting.horizon)


def _calm(setting: Setting, start: Start, modes: Scheduled | Moving, progress: Progress | None) -> tuple[Run, Samples]:
    """A run without stress: e alone with eps in closed form, or the full loop."""
    loop, asked = setting.loop, setting.observer == "full-loop"
    closed = None if asked else closed_form_of(setting)
    full = asked or (loop.q > 0 and closed is None)
    plan: Errors | Full = Full(loop, modes)
    flat = np.concatenate([start.x.ravel(), start.xi.ravel(), (start.xihat - loop.correction(start.x)).ravel()])
    if not full:
        plan, flat = Errors(loop, modes, closed, start.xi - start.xihat), (start.x - loop.goal).ravel()
    implicit, tolerance = is_stiff(setting, closed=not full), setting.tolerance
    run = Integration(plan, flat, setting.times, tolerance=tolerance, implicit=implicit, progress=progress).run()
    if full:
        x, xi, z = (part.copy() for part in loop.split(run.states))
        xihat = z + loop.correction(x)
    else:
        x = run.states.reshape(-1, loop.n, loop.m) + loop.goal
        xi = evolve(loop.A, start.xi, run.times)
        xihat = xi - evolve(error_matrix(setting), start.xi - start.xihat, run.times)
        if setting.observer == "off":
            xihat = np.zeros_like(xi)
    if run.method.startswith("Radau"):
        run.notes.append("The loop is stiff: integrated by the implicit method Radau.")
    if full and not asked:
        run.notes.append("The observer is too fast for its closed form: the full loop was integrated.")
    dhat = xihat @ loop.C.T
    u = loop.control(x - loop.goal, dhat)
    return run, {"x": x, "xi": xi, "xihat": xihat, "d": xi @ loop.C.T, "dhat": dhat, "u": u}


def _kept(switches: Switches, end: float) -> Switches:
    """The switches up to where the run ended."""
    count = int(np.searchsorted(switches.times, end, side="right"))
    return replace(switches, times=switches.times[:count].copy(), modes=switches.modes[:count].copy())
