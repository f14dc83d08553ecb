"""Simulation of the full loop (1), (12), (13), (19) in a fixed mode.

The observer runs as printed in (13), although its error is known in closed form: this is the reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import DOP853, Radau

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.model.arrays import Array, Gain, chosen_mode, consensus_jacobian
from dobc_design.simulate.field import Field, make_field
from dobc_design.simulate.trajectory import Trajectory
from dobc_design.spec.problem import Problem

Progress = Callable[[float], None]

RELATIVE, ABSOLUTE = 1e-8, 1e-10  # tolerances of the integrator
FARTHEST = 1e9  # an error so many times its start (or 1, if that is larger) counts as divergence
STIFF = 2e4  # horizon times fastest decay from which an explicit method would need too many steps
AWAY = 1.0  # default starts: at most this far from the goal, in every component


def simulate(
    problem: Problem, *, mode: str | None = None, t_final: float | None = None, seed: int | None = None,
    gain: Gain | None = None, samples: int = 401, progress: Progress | None = None,
) -> Trajectory:  # fmt: skip
    """Integrate the closed loop of one mode, the first unless ``mode`` names another.

    Starts: x uniform in region.initial_states, without a region within 1 of each agent's goal by component;
    xi as simulation.xi0 says, ones without; xihat = 0, hence z = -W x.
    ``t_final`` in s and ``seed`` default to the problem's; ``gain`` (q, m) takes the place of problem.observer.W.
    ``progress`` is called with the part of the horizon that is done, from 0 to 1.
    Returns: ``samples`` equally spaced samples.  A run that diverges raises nothing: it is flagged, has fewer
    samples, and the last of them is where it had to stop.
    Raises: SpecError for a wrong argument, or if there is an exosystem and no W.
    """
    name = chosen_mode(problem, mode)
    horizon = _seconds(problem.simulation.t_final if t_final is None else t_final)
    seed = problem.simulation.seed if seed is None else _whole(seed, "seed", least=0)
    _whole(samples, "samples", least=2)
    field = make_field(problem, name, gain)
    times = np.linspace(0.0, horizon, samples)
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a warning.
    with np.errstate(all="ignore"):
        start = initial_state(problem, field, seed)
        run = _integrate(field, start, times, _method(problem, field, name, horizon), progress)
        x, xi, z = (part.copy() for part in field.split(run.states))
        xihat = z + x @ field.W.T
        return Trajectory(
            name=problem.name, mode=name, labels=problem.network.labels, t_final=horizon, seed=seed, times=run.times,
            x=x, xi=xi, xihat=xihat, d=xi @ field.C.T, dhat=xihat @ field.C.T,
            u=field.control(x - field.goal, xihat), goal=field.goal.copy(), diverged=run.diverged,
        )  # fmt: skip


def initial_state(problem: Problem, field: Field, seed: int) -> Array:
    """Draw x, set xi, and let xihat start at 0: the flat vector [x; xi; z]."""
    if problem.region is None:
        low, high = field.goal - AWAY, field.goal + AWAY
    else:
        low, high = to_float(problem.region.initial_states).T
    n, q = field.n, field.q
    x = low + (high - low) * np.random.default_rng(seed).random((n, field.m))
    xi0 = problem.simulation.xi0
    xi = np.ones((n, q)) if xi0 is None else np.broadcast_to(to_float(xi0), (n, q))
    return np.concatenate([x.ravel(), xi.ravel(), (-x @ field.W.T).ravel()])


def _method(problem: Problem, field: Field, mode: str, horizon: float) -> Any:
    """Choose an explicit method, or an implicit one where the fastest decay at the consensus asks for tiny steps."""
    jacobian = consensus_jacobian(problem, mode)
    loop = field.K if jacobian is None else jacobian - field.K
    fastest = float(abs(loop).sum(axis=1).max())
    observer = field.A - field.W @ field.C
    if field.q and np.isfinite(observer).all():
        fastest = max(fastest, float(-np.linalg.eigvals(observer).real.min()))
    return Radau if horizon * fastest > STIFF else DOP853


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """Times (T,) and states (T, n (m + 2 q)); if the run diverged, those before and where it had to stop."""

    times: Array
    states: Array
    diverged: bool


def _integrate(
    field: Field, start: Array, times: Array, method: Any, progress: Progress | None
) -> _Run:
    states = [start]
    farthest = FARTHEST * max(1.0, _error(field, start))
    options = {"jac_sparsity": field.pattern} if method is Radau else {}
    report = progress or (lambda part: None)
    report(0.0)
    if not np.isfinite(field(0.0, start)).all():
        return _stopped(times, states, 0.0, start)
    solver = method(field, 0.0, start, times[-1], rtol=RELATIVE, atol=ABSOLUTE, **options)
    while len(states) < len(times):
        before, state = solver.t, solver.y
        if not _stepped(solver) or not np.isfinite(solver.y).all():
            return _stopped(times, states, before, state)
        if _error(field, solver.y) > farthest:
            return _stopped(times, states, solver.t, solver.y)
        done = int(np.searchsorted(times, solver.t, side="right"))
        if done > len(states):
            states.extend(solver.dense_output()(times[len(states) : done]).T)
        report(solver.t / times[-1])
    return _Run(times=times, states=np.array(states), diverged=False)


def _stopped(times: Array, states: list[Array], time: float, state: Array) -> _Run:
    reached = times[: len(states)]
    if time > reached[-1]:
        reached, states = np.append(reached, time), [*states, state]
    return _Run(times=reached.copy(), states=np.array(states), diverged=True)


def _stepped(solver: Any) -> bool:
    """Advance by one accepted step; False if that is impossible."""
    try:
        solver.step()
    except (RuntimeError, ValueError, np.linalg.LinAlgError):  # the implicit method met a Jacobian that is not finite
        return False
    return bool(solver.status != "failed")


def _error(field: Field, state: Array) -> float:
    return float(np.abs(field.split(state)[0] - field.goal).max())


def _seconds(value: Any) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise SpecError(
            f"t_final must be a time > 0 in s, within the range of floats; got {str(value)[:40]}.", key="t_final",
            cure="For example 20.",
        )  # fmt: skip
    return number


def _whole(value: Any, name: str, *, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SpecError(f"{name} must be a whole number >= {least}; got {str(value)[:40]}.", key=name)
    return int(value)
