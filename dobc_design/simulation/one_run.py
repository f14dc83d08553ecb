"""One run of a setting: calm, under a stress, or sampled."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from dobc_design.loop.matrices import Array
from dobc_design.simulation import setting as settings
from dobc_design.simulation.agents import StressedRuns
from dobc_design.simulation.closed_form import evolve
from dobc_design.simulation.integrate import Integration, Outcome, Progress, Samples, errors
from dobc_design.simulation.mobile import Modes, Nearby
from dobc_design.simulation.sampled import run_sampled_alone
from dobc_design.simulation.setting import Setting
from dobc_design.simulation.signals import Mobile, signal_to_json
from dobc_design.simulation.starts import Start
from dobc_design.simulation.stress import stress_to_json
from dobc_design.simulation.stressed import run_alone
from dobc_design.simulation.switches import Planned
from dobc_design.simulation.trajectory import Trajectory


def run_once(
    setting: Setting, *, seed: int | None = None, progress: Progress | None = None
) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    seed = setting.seed if seed is None else seed
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a
    # warning.
    with np.errstate(all="ignore"):
        start = setting.starts.draw(seed)
        modes = _modes(setting, seed)
        if setting.is_full:
            outcome = _full(setting, start, seed, modes, progress)
        else:
            outcome = _calm(setting, start, modes, progress)
    return _trajectory(setting, seed, modes, outcome)


def _trajectory(setting: Setting, seed: int, modes: Modes, outcome: Outcome) -> Trajectory:
    """The run as it is shown."""
    run = outcome.run
    seen = outcome.samples
    switches = modes.switches
    if run.reason:  # those up to where the run ended
        switches = switches.until(float(run.times[-1]))
    problem = setting.problem
    return Trajectory(
        name=problem.name,
        mode=settings.describe(setting.signal, problem),
        labels=problem.network.labels,
        t_final=setting.horizon,
        seed=seed,
        times=run.times,
        x=seen.x,
        xi=seen.xi,
        xihat=seen.xihat,
        d=seen.d,
        dhat=seen.dhat,
        u=seen.u,
        goal=setting.loop.goal.copy(),
        diverged=bool(run.reason),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=(*setting.notes, *run.notes, *setting.stress_notes),
        signal=signal_to_json(setting.signal),
        observer=setting.observer,
        stress="" if setting.stress is None else stress_to_json(setting.stress),
        switches=switches,
        leader=np.zeros(0) if seen.leader is None else seen.leader,
    )


def _modes(setting: Setting, seed: int) -> Modes:
    """The modes of the run of one seed."""
    signal = setting.signal
    if isinstance(signal, Mobile) and signal.motion is None:
        return Nearby(signal, setting.exact, setting.horizon)
    drawn = settings.switches_for(setting, seed)
    return Planned(drawn, partial(settings.groups_for, setting, drawn), setting.horizon)


def _full(
    setting: Setting, start: Start, seed: int, modes: Modes, progress: Progress | None
) -> Outcome:
    """A run of the full loop as printed, or under a stress: a stack of one."""
    alone = StressedRuns(setting=setting, groups=modes.groups, starts=[start], seeds=[seed])
    if isinstance(modes, Nearby):
        runs = replace(alone, nearby=modes)
    else:
        runs = replace(alone, switches=[modes.switches])
    if setting.is_sampled:
        return run_sampled_alone(runs, progress)
    return run_alone(runs, modes, progress)


def _calm(setting: Setting, start: Start, modes: Modes, progress: Progress | None) -> Outcome:
    """A run without stress: e with eps in closed form, else both of them."""
    loop = setting.loop
    F = setting.residual_matrix
    eps0 = start.xi - start.xihat
    closed = settings.closed_form_of(setting)
    both = loop.q > 0 and closed is None
    # xihat = xi - eps: nothing else of the observer has to be integrated
    e0 = np.concatenate([start.errors(loop).ravel(), start.s])
    state = np.concatenate([e0, eps0.ravel()]) if both else e0
    integration = Integration(
        errors(loop, modes, closed, eps0, F),
        state,
        setting.times,
        tolerance=setting.tolerance,
        implicit=settings.is_stiff(setting, closed=not both),
        progress=progress,
    )
    run = integration.run()
    if both:
        note = "The observer is too fast for its closed form: its error was integrated as well."
        run.notes.append(note)
    cut = len(e0)
    xi = evolve(loop.A, start.xi, run.times)
    eps = run.states[:, cut:].reshape(xi.shape) if both else evolve(F, eps0, run.times)
    xihat = np.zeros_like(xi) if setting.observer == settings.WITHOUT else xi - eps
    return Outcome(run=run, samples=_samples(setting, run.states[:, :cut], xi, xihat))


def _samples(setting: Setting, states: Array, xi: Array, xihat: Array) -> Samples:
    """What is seen of the errors, flat and those of a leader after them: (T, n m) or more."""
    loop = setting.loop
    e, s = np.split(states, [loop.n * loop.m], axis=1)
    e = e.reshape(-1, loop.n, loop.m)
    x = e + loop.goal
    if loop.lead:
        x = x + s[:, None]
    dhat = xihat @ loop.output.T
    return Samples(
        x=x,
        xi=xi,
        xihat=xihat,
        d=xi @ loop.output.T,
        dhat=dhat,
        u=loop.control(e, dhat),
        leader=s if loop.lead else None,
    )
