"""The flow of the error system and its gradient, against SciPy's integrator and difference
quotients."""

from collections.abc import Callable

import numpy as np
import pytest
from regional_problems import HARMONIC, PAPER_GAIN, cycle, field, random_problem
from scipy.integrate import solve_ivp

from dobc_design.loop.make import loop_of
from dobc_design.model.flow import build_flow


def end_of_run(slope: Callable, horizon: float, start: np.ndarray) -> np.ndarray:
    accurate = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
    run = solve_ivp(slope, (0, horizon), start, **accurate)
    return run.y[:, -1]


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", range(2))
def test_the_end_is_where_scipy_ends(seed: int, m: int):
    """(22) without a disturbance; the arcs are written out independently."""
    problem = random_problem(seed, m=m, modes=2)
    flow = build_flow(loop_of(problem), "G1", horizon=1.5, steps=300)
    size = problem.n * m
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2, 2, size)

    def slope(t: float, e: np.ndarray) -> np.ndarray:
        return field(problem, "G1", e)

    truth = end_of_run(slope, 1.5, start)
    assert flow.end(start) == pytest.approx(truth, abs=1e-7)
    assert flow.rows == flow.size == size


def test_the_observers_error_is_part_of_the_state():
    """eps' = (A - W C) eps drives e through C."""
    problem = cycle(3, 3, exosystem=HARMONIC)
    flow = build_flow(loop_of(problem), "G", horizon=1.0, steps=400, gain=PAPER_GAIN)
    A = np.array([[0, 2], [-2, 0]])
    C = np.array([[1, 0]])
    W = np.array(PAPER_GAIN, dtype=float)

    def loop(t: float, state: np.ndarray) -> np.ndarray:
        eps = state[3:].reshape(3, 2)
        e_dot = field(problem, "G", state[:3]) + eps @ C[0]
        eps_dot = eps @ (A - W @ C).T
        return np.concatenate([e_dot, eps_dot.ravel()])

    start = np.random.default_rng(0).uniform(-1, 1, 9)
    truth = end_of_run(loop, 1, start)
    assert flow.end(start) == pytest.approx(truth, abs=1e-7)
    assert flow.rows == 3
    assert flow.size == 9


def test_the_gradient_is_that_of_difference_quotients():
    problem = random_problem(3, coupling="sin(y)")
    flow = build_flow(loop_of(problem), "G0", horizon=2.0, steps=100)
    rng = np.random.default_rng(1)
    start = rng.uniform(-2, 2, flow.size)
    weight = rng.normal(size=flow.size)
    end, gradient = flow.pull(start, weight)
    assert end == pytest.approx(flow.end(start), abs=1e-14)
    for _ in range(5):
        step = 1e-5 * rng.normal(size=flow.size)
        moved = flow.end(start + step) - flow.end(start - step)
        assert gradient @ step == pytest.approx(moved @ weight / 2, rel=1e-5, abs=1e-12)
