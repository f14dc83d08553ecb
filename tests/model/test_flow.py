"""The flow of the error system and its gradient, against SciPy's integrator and difference
quotients."""

import numpy as np
import pytest
from regional_problems import HARMONIC, PAPER_GAIN, cycle, field, random_problem
from scipy.integrate import solve_ivp

from dobc_design.loop.make import loop_of
from dobc_design.model.flow import build_flow


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", range(2))
def test_the_end_is_where_scipy_ends(seed: int, m: int):
    """(22) without a disturbance; the arcs are written out independently."""
    problem = random_problem(seed, m=m, modes=2)
    flow = build_flow(loop_of(problem), "G1", horizon=1.5, steps=300)
    start = np.random.default_rng(seed).uniform(-2, 2, problem.n * m)
    given = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
    truth = solve_ivp(lambda t, e: field(problem, "G1", e), (0, 1.5), start, **given).y[:, -1]
    assert flow.end(start) == pytest.approx(truth, abs=1e-7)
    assert (flow.rows, flow.size) == (problem.n * m, problem.n * m)


def test_the_observers_error_is_part_of_the_state():
    """eps' = (A - W C) eps drives e through C."""
    problem = cycle(3, 3, exosystem=HARMONIC)
    flow = build_flow(loop_of(problem), "G", horizon=1.0, steps=400, gain=PAPER_GAIN)
    A, C, W = np.array([[0, 2], [-2, 0]]), np.array([[1, 0]]), np.array(PAPER_GAIN, dtype=float)

    def loop(t: float, state: np.ndarray) -> np.ndarray:
        eps = state[3:].reshape(3, 2)
        return np.concatenate(
            [field(problem, "G", state[:3]) + eps @ C[0], (eps @ (A - W @ C).T).ravel()]
        )

    start = np.random.default_rng(0).uniform(-1, 1, 9)
    truth = solve_ivp(loop, (0, 1), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert flow.end(start) == pytest.approx(truth, abs=1e-7)
    assert (flow.rows, flow.size) == (3, 9)


def test_the_gradient_is_that_of_difference_quotients():
    problem = random_problem(3, coupling="sin(y)")
    flow, rng = build_flow(loop_of(problem), "G0", horizon=2.0, steps=100), np.random.default_rng(1)
    start, weight = rng.uniform(-2, 2, flow.size), rng.normal(size=flow.size)
    end, gradient = flow.pull(start, weight)
    assert end == pytest.approx(flow.end(start), abs=1e-14)
    for _ in range(5):
        step = 1e-5 * rng.normal(size=flow.size)
        change = (flow.end(start + step) - flow.end(start - step)) @ weight / 2
        assert gradient @ step == pytest.approx(change, rel=1e-5, abs=1e-12)
