"""C exp(F t) and the states that it moves, against mpmath at 60 digits."""

import mpmath
import numpy as np
import pytest

from dobc_design.simulation.closed_form import evolve, make_closed_form


def precise(F, t: float):
    """exp(F t) from mpmath, rounded once."""
    with mpmath.workdps(60):
        scaled = mpmath.matrix(F.tolist()) * mpmath.mpf(t)
        found = mpmath.expm(scaled, method="taylor")
        return np.array(found.tolist(), dtype=float)


CASES = {
    "the paper's observer": [[-3.2, 2], [-4.4, 0]],
    "a double pole": [[-2, 1], [0, -2]],
    "a ramp": [[0, 1], [0, 0]],
    "an oscillator": [[0, 7], [-7, 0]],
    "three states": [[-1, 2, 0.5], [0, -3, 1], [0.25, 0, -2]],
    "growth": [[1.0]],
    "nothing": [[0.0]],
}


@pytest.mark.parametrize("name", CASES)
def test_the_table_agrees_with_mpmath(name: str):
    """(17): eps(t) = exp((A - W C) t) eps(0)."""
    F = np.array(CASES[name], dtype=float)
    C = np.arange(1.0, len(F) + 1)[None]
    closed = make_closed_form(F, C, 20.0)
    assert closed is not None
    points = [0.0, 1e-9, 0.03, 0.5, 1.234567, 7.7, 19.99, 20.0]
    times = np.array(points)
    found = closed.many(times.reshape(2, 4))
    together = found.reshape(1, len(F), -1)
    for k, t in enumerate(times):
        wanted = C @ precise(F, t)
        largest = np.abs(wanted).max()
        slope = 1e-3 * np.linalg.norm(C)
        scale = max(1e-300, largest, slope)
        np.testing.assert_allclose(closed.at(t), wanted, atol=2e-14 * scale, rtol=0)
        np.testing.assert_allclose(together[..., k], wanted, atol=2e-14 * scale, rtol=0)


def test_the_table_is_given_up_where_it_would_be_too_long():
    very_fast = np.array([[-1e6]])
    found = make_closed_form(very_fast, np.eye(1), 20.0)
    assert found is None
    fast = np.array([[-100.0]])
    found = make_closed_form(fast, np.eye(1), 20.0)
    assert found is not None
    infinite = np.array([[np.inf]])
    found = make_closed_form(infinite, np.eye(1), 20.0)
    assert found is None


def test_states_evolve_row_by_row():
    F = np.array(CASES["three states"])
    points = [[1.0, 2, 3], [0, -1, 0]]
    start = np.array(points)
    times = np.array([0.0, 0.4, 5])
    found = evolve(F, start, times)
    for k, t in enumerate(times):
        desired = start @ precise(F, t).T
        np.testing.assert_allclose(found[k], desired, atol=1e-13)


def test_states_evolve_also_beyond_the_table():
    """|F| times the horizon is 8e6: SciPy's expm takes over."""
    stiff = [[-4e5, 0], [0, -1.0]]
    F = np.array(stiff)
    start = np.ones((1, 2))
    times = np.array([0.0, 20])
    found = evolve(F, start, times)
    desired = [[0, np.exp(-20)]]
    np.testing.assert_allclose(found[1], desired, rtol=1e-7)
