"""Ensembles under stress and the same runs one by one, compared in everything that both have."""

from __future__ import annotations

from typing import Any

import numpy as np

from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.ensemble import simulate_many
from dobc_design.simulation.run import simulate
from dobc_design.simulation.stress import Failure, Stress

FAILING = (Failure(agent="3", time=0.4, kind="freeze"), Failure(agent="2", time=0.5))


def planar() -> Problem:
    """m = 2, q = 3, two modes, a coupling of vectors, a formation, gains that are matrices, drawn disturbances."""
    modes = {"one": [[1, 2], [2, 3, 2], [3, 1], [1, 3]], "two": [[1, 3, "1/2"], [2, 1]]}
    return Problem(
        network=Network.from_arcs(modes, arrow="listens_to", agents=3),
        exceptions={(0, 2): ["3*y1", "y2"]},
        coupling=["tanh(y1) + y2/4", "y2 + y2**3/9"],
        target=[1, -2],
        gains={"1": 3, "3": [[2, 1], [-1, 2]]},
        exosystem=Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]]),
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]),
        offsets={"2": [1, 0]},
        region={"initial_states": [[0, 1], [-3, -1]], "initial_disturbance": 2},
    )


def require_the_same(problem: Problem, stress: Stress, *, runs: int, close: float, **given: Any) -> None:
    """States, errors, estimates, switches, starts and early ends of runs 5, 6, ... to ``close`` times their size."""
    given = {"t_final": 1.2, "samples": 23, "stress": stress} | given
    many = simulate_many(problem, runs=runs, seed=5, states=True, **given)
    for k in range(runs):
        one = simulate(problem, seed=5 + k, **given)
        count = int(np.searchsorted(many.times, one.times[-1], side="right"))
        scale = close * (1 + np.abs(one.x).max())
        np.testing.assert_allclose(many.states[k, :count], one.x[:count], atol=scale)
        np.testing.assert_allclose(many.estimation_error[k, :count], one.estimation_error()[:count], atol=10 * scale)
        np.testing.assert_allclose(many.error[k, :count], one.error()[:count], atol=scale)
        assert np.isnan(many.error[k, count:]).all()
        assert np.isnan(many.states[k, count:]).all()
        assert many.diverged[k] == one.diverged == (k in many.reasons)
        np.testing.assert_allclose(many.ended[k], one.times[-1], rtol=1e-6)
        assert many.switches[k] == len(one.switches) - 1
        sizes = (many.error[k, 0], many.lengths[k], many.disturbances[k])
        jumped = bool(stress.noise) and stress.period is None  # an ensemble's starts are those before the first noise
        np.testing.assert_allclose(sizes[: 3 - jumped], one.start_size()[: 3 - jumped])
    assert "side by side" in many.method
