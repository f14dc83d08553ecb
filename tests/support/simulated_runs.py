"""Small loops that tests of simulations share; ensembles against runs one by one; a certified
envelope against simulated runs."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from networks import around, floats, linked

import dobc_design as dd
from dobc_design import (
    Ensemble,
    Exosystem,
    Failure,
    Observer,
    Problem,
    Settling,
    Stress,
    Trajectory,
)
from dobc_design.exact.matrix import to_float
from dobc_design.loop.arrays import Gain
from dobc_design.simulation.execution import run_many, run_once
from dobc_design.simulation.integrate import silent
from dobc_design.simulation.setting import make_setting

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
PRINTED = Observer(W=[["16/5"], ["12/5"]])


def ring(coupling: str = "exp(y) - 1 + y", n: int = 10, **settings) -> Problem:
    """The paper's directed cycle of n agents."""
    return linked(around(n), n, coupling, **settings)


def single(**settings) -> Problem:
    """One agent by itself, x' = u + d."""
    return linked({"G": []}, 1, gains={"1": 2}, **settings)


def pair(coupling: str = "y", **settings) -> Problem:
    """Agent 1 listens to agent 2."""
    return linked([[1, 2]], 2, coupling, **settings)


def planar(**settings) -> Problem:
    """Linear, m = 2, q = 3, two modes, formation, matrix gains, weights."""
    modes = {"one": [[1, 2], [2, 3, 2], [3, 1], [1, 3]], "two": [[1, 3, "1/2"], [2, 1]]}
    given: dict[str, Any] = {"coupling": ["2*y1 + y2", "3*y2 - y1"]}
    starts = [[1, 0, 2], [0, 1, -1], [3, 0, 0]]
    given["simulation"] = {"t_final": 4, "seed": 3, "xi0": starts}
    given["target"] = [1, -2]
    gain = [[2, 1], [-1, 2]]
    given["gains"] = {"1": 3, "3": gain}
    A = [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]
    C = [[1, 0, 1], [0, 1, 0]]
    given["exosystem"] = Exosystem(A=A, C=C)
    W = [[2, 0], [0, 2], [1, 0]]
    given["observer"] = Observer(W=W)
    offsets = {"2": [1, 0]}
    return linked(modes, 3, **given | settings, offsets=offsets)


def simulate(
    problem: Problem, *, gain: Gain | None = None, progress: Any = silent, **given: Any
) -> Trajectory:
    """One run with this gain; nothing is designed, and [switching] is not looked at."""
    return run_once(make_setting(problem, gain=gain, **given), progress=progress)


def simulate_many(
    problem: Problem, *, runs: int, gain: Gain | None = None, progress: Any = silent, **given
) -> Ensemble:
    """The same for many runs."""
    return run_many(make_setting(problem, gain=gain, **given), runs, progress=progress)


FAILING = (Failure(agent="3", time=0.4, kind="freeze"), Failure(agent="2", time=0.5))
EVERYTHING = Stress(
    noise=0.05,
    disturbance=0.3,
    frequency=2,
    saturation=2.0,
    loss=0.3,
    exchange=0.1,
    failures=FAILING,
)


def nonlinear_planar() -> Problem:
    """m = 2, q = 3, two modes, a coupling of vectors, a formation, gains that are matrices, drawn
    disturbances."""
    exceptions = {(0, 2): ["3*y1", "y2"]}
    states = [[0, 1], [-3, -1]]
    region = {"initial_states": states, "initial_disturbance": 2}
    return planar(
        exceptions=exceptions,
        coupling=["tanh(y1) + y2/4", "y2 + y2**3/9"],
        simulation={},
        region=region,
    )


def require_the_same(
    problem: Problem, stress: Stress, *, runs: int, close: float, **given: Any
) -> Ensemble:
    """Errors, estimates, switches, starts and early ends of runs 5, 6, ... to ``close`` times their
    size.

    Returns: the runs side by side.
    """
    given = {"t_final": 1.2, "samples": 23, "stress": stress} | given
    many = simulate_many(problem, runs=runs, seed=5, **given)
    for k in range(runs):
        one = simulate(problem, seed=5 + k, **given)
        last = one.times[-1]
        following = np.searchsorted(many.times, last, side="right")
        count = int(following)
        scale = close * (1 + np.abs(one.x).max())
        estimates = one.estimation_error()[:count]
        found_estimates = many.estimation_error[k, :count]
        np.testing.assert_allclose(found_estimates, estimates, atol=10 * scale)
        found_errors = many.error[k, :count]
        errors_of_one = one.error()[:count]
        np.testing.assert_allclose(found_errors, errors_of_one, atol=scale)
        assert np.isnan(many.error[k, count:]).all()
        assert many.diverged[k] == one.diverged == (k in many.reasons)
        end = one.times[-1]
        np.testing.assert_allclose(many.ended[k], end, rtol=1e-6)
        assert many.switches[k] == len(one.switches) - 1
        start = many.error[k, 0]
        sizes = (start, many.lengths[k], many.disturbances[k])
        # an ensemble's starts are those before the first noise
        jumped = bool(stress.noise) and stress.period is None
        found_sizes = sizes[: 3 - jumped]
        wanted_sizes = one.start_size()[: 3 - jumped]
        np.testing.assert_allclose(found_sizes, wanted_sizes)
    assert "side by side" in many.method
    return many


CORNERS = 8
SAMPLES = 401
INTEGRATION = 1e-7  # relative, and absolute in the unit of x: what the integrator may be wrong by


@dataclass(frozen=True, kw_only=True)
class Compared:
    """``crossings``: texts of runs that rose above the envelope; ``settled``: the latest settling
    time (s) seen."""

    runs: int
    crossings: tuple[str, ...]
    settled: float
    closest: float  # the largest |e|/envelope that was seen


def compare(problem: Problem, settling: Settling, *, runs: int, seed: int = 0) -> Compared:
    """Simulate ``runs`` random starts and some corners; the starts have to lie in what the settling
    time is about."""
    times = np.linspace(0.0, 1.1 * settling.time, SAMPLES)
    bounds = settling.envelope(times)
    given = {"t_final": times[-1], "samples": times.tolist()}
    many = dd.simulate(problem, runs=runs, seed=seed, **given)
    errors = [*many.error]
    for k in range(CORNERS):
        errors.append(_corner(problem, settling, times, seed + k))
    crossings = []
    settled = closest = 0.0
    for number, error in enumerate(errors):
        assert error[0] <= float(settling.radius) * (1 + INTEGRATION)
        above = np.flatnonzero(error > bounds * (1 + INTEGRATION) + INTEGRATION)
        if len(above):
            at = above[0]
            height = f"|e| = {error[at]:.6g} above {bounds[at]:.6g}"
            crossings.append(f"run {number}: {height} at {times[at]:.4g} s")
        unsettled = times[error > float(settling.tolerance)]
        settled = max(settled, float(np.max(unsettled, initial=0.0)))
        closest = max(closest, float(np.max(error / bounds)))
    return Compared(runs=len(errors), crossings=tuple(crossings), settled=settled, closest=closest)


def _corner(problem: Problem, settling: Settling, times: np.ndarray, seed: int) -> np.ndarray:
    """All agents at the edge of the box, the first two runs on one side, with the largest observer
    error."""
    rng = np.random.default_rng(seed)
    n = problem.n
    m = problem.m
    goal = floats([problem.goal_of(i) for i in range(n)])
    if seed % CORNERS < 2:
        sign = (1.0, -1.0)[seed % 2]
        signs = np.full((n, m), sign)
    else:
        signs = rng.choice([-1.0, 1.0], (n, m))
    start = {"x": goal + float(settling.radius) * signs}
    if problem.exosystem is not None:
        q = len(to_float(problem.exosystem.A))
        directions = rng.standard_normal((n, q))
        sizes = np.linalg.norm(directions, axis=1, keepdims=True)
        start["xi"] = float(settling.disturbance) * directions / sizes
    given = {"t_final": float(times[-1]), "samples": times.tolist()}
    return dd.simulate(problem, start=start, seed=seed, **given).error()
