"""Ensembles under stress and the same runs one by one, compared in everything that both have."""

from typing import Any

import loops
import numpy as np
from loops import simulate, simulate_many

from dobc_design import Ensemble, Failure, Problem, Stress

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


def planar() -> Problem:
    """m = 2, q = 3, two modes, a coupling of vectors, a formation, gains that are matrices, drawn
    disturbances."""
    return loops.planar(
        exceptions={(0, 2): ["3*y1", "y2"]},
        coupling=["tanh(y1) + y2/4", "y2 + y2**3/9"],
        simulation={},
        region={"initial_states": [[0, 1], [-3, -1]], "initial_disturbance": 2},
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
        count = int(np.searchsorted(many.times, one.times[-1], side="right"))
        scale = close * (1 + np.abs(one.x).max())
        np.testing.assert_allclose(
            many.estimation_error[k, :count], one.estimation_error()[:count], atol=10 * scale
        )
        np.testing.assert_allclose(many.error[k, :count], one.error()[:count], atol=scale)
        assert np.isnan(many.error[k, count:]).all()
        assert many.diverged[k] == one.diverged == (k in many.reasons)
        np.testing.assert_allclose(many.ended[k], one.times[-1], rtol=1e-6)
        assert many.switches[k] == len(one.switches) - 1
        sizes = (many.error[k, 0], many.lengths[k], many.disturbances[k])
        # an ensemble's starts are those before the first noise
        jumped = bool(stress.noise) and stress.period is None
        np.testing.assert_allclose(sizes[: 3 - jumped], one.start_size()[: 3 - jumped])
    assert "side by side" in many.method
    return many
