"""What linear agents with measured outputs can be driven to in the end, from their whole loop of
states and estimates as they stand."""

from random import Random
from typing import Any

import numpy as np
from measured import Floats, by_agent, floats, random_problem, whole_loop
from scipy import linalg

from dobc_design import Problem
from dobc_design.problem.bands import Band
from dobc_design.problem.uncertainty import Uncertainty

SHARE = 0.01  # of the fastest time constant that a step of the quadrature takes
MOST = 40_000  # steps
LENGTH = 30.0  # slowest time constants that are followed


def driven(problem: Problem, mode: str) -> dict[str, Floats]:
    """Label -> the largest |x_ic - goal| of one mode, (m,): integrals of responses by quadrature,
    sines by the response at 60 frequencies."""
    own = problem.dynamics
    plant = problem.uncertainty
    assert own is not None and plant is not None
    n, m = problem.n, problem.m
    M = whole_loop(problem, mode)
    size = len(M)
    entries: dict[str, list[Floats]] = {"disturbance": [], "drift": [], "measurement": []}
    first = 2 * n * m
    for i, (A, _, W) in enumerate(by_agent(problem)):
        x = np.zeros((size, own.inputs))
        x[i * m : (i + 1) * m] = floats(own.B)
        xi = np.eye(size)[:, first : first + len(A)]
        fed = np.zeros((size, W.shape[1]))
        fed[(n + i) * m : (n + i + 1) * m] = W[:m]
        fed[first : first + len(A)] = -W[m:]
        first += len(A)
        for name, entry in zip(entries, (x, xi, fed), strict=True):
            entries[name].append(entry)
    every = np.hstack([float(getattr(plant, k)) * e for k, each in entries.items() for e in each])
    total = _integrals(M, every)[: n * m]
    disturbed = np.hstack(entries["disturbance"])
    for band in plant.bands or ():
        sizes = [
            np.abs(np.linalg.solve(1j * w * np.eye(size) - M, disturbed))[: n * m].sum(axis=1)
            for w in np.linspace(float(band.low), float(band.high), 60)
        ]
        total = total + float(band.amplitude) * np.max(sizes, axis=0)
    return dict(zip(problem.network.labels, total.reshape(n, m), strict=True))


def _integrals(M: Floats, entry: Floats) -> Floats:
    """Row sums of the integral of |exp(M t) entry| over t > 0."""
    values = np.linalg.eigvals(M)
    step = SHARE / float(np.max(np.abs(values)))
    steps = int(min(LENGTH / -float(np.max(values.real)) / step, MOST))
    forward = linalg.expm(M * step)
    total = -step / 2 * np.abs(entry).sum(axis=1)
    for _ in range(steps):
        total += step * np.abs(entry).sum(axis=1)
        entry = forward @ entry
    return np.asarray(total)


def random_plant(seed: int) -> Problem | None:
    """A random problem with something in [uncertainty]; None where its matrices make none, and for
    agents that agree."""
    problem = random_problem(seed)
    if problem is None or problem.agrees or problem.dynamics is None:
        return None
    random = Random(f"outputs {seed}")
    given: dict[str, Any] = {}
    names = ["disturbance", "drift", *["measurement"] * (not problem.dynamics.acts_on)]
    for name in names:
        if random.random() < 0.4:
            given[name] = f"{random.randint(1, 5)}/10"
    if not given or random.random() < 0.5:
        low = random.randint(1, 40)
        high = low * random.randint(10, 13)
        given["bands"] = [Band(f"{low}/10", f"{high}/100", random.randint(1, 5))]
    return problem.replace(uncertainty=Uncertainty(**given))
