"""A certified envelope against simulated runs: random starts, corners of the box, and the switching
of the problem."""

from dataclasses import dataclass

import numpy as np

from dobc_design import Problem, Settling, simulate
from dobc_design.exact.matrix import to_float

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
    errors = [
        *simulate(problem, runs=runs, seed=seed, t_final=times[-1], samples=times.tolist()).error,
        *(_corner(problem, settling, times, seed + k) for k in range(CORNERS)),
    ]
    crossings, settled, closest = [], 0.0, 0.0
    for number, error in enumerate(errors):
        assert error[0] <= float(settling.radius) * (1 + INTEGRATION)
        above = np.flatnonzero(error > bounds * (1 + INTEGRATION) + INTEGRATION)
        if len(above):
            at = above[0]
            crossings.append(
                f"run {number}: |e| = {error[at]:.6g} above {bounds[at]:.6g} at {times[at]:.4g} s"
            )
        settled = max(settled, float(np.max(times[error > float(settling.tolerance)], initial=0.0)))
        closest = max(closest, float(np.max(error / bounds)))
    return Compared(runs=len(errors), crossings=tuple(crossings), settled=settled, closest=closest)


def _corner(problem: Problem, settling: Settling, times: np.ndarray, seed: int) -> np.ndarray:
    """All agents at the edge of the box, the first two runs on one side, with the largest observer
    error."""
    rng = np.random.default_rng(seed)
    n, m = problem.n, problem.m
    goal = np.array([[float(x) for x in problem.goal_of(i)] for i in range(n)])
    signs = (
        np.full((n, m), (1.0, -1.0)[seed % 2])
        if seed % CORNERS < 2
        else rng.choice([-1.0, 1.0], (n, m))
    )
    start = {"x": goal + float(settling.radius) * signs}
    if problem.exosystem is not None:
        q = len(to_float(problem.exosystem.A))
        directions = rng.standard_normal((n, q))
        start["xi"] = (
            float(settling.disturbance)
            * directions
            / np.linalg.norm(directions, axis=1, keepdims=True)
        )
    return simulate(
        problem, start=start, seed=seed, t_final=float(times[-1]), samples=times.tolist()
    ).error()
