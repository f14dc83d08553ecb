"""The CasADi model of agents with [dynamics] against the equations of theory, section 13."""

import casadi as ca
import numpy as np
import pytest
import sympy
from agents import double_integrators, drift, full_loop, matrices, pendulums, three_states

from dobc_design.loop.arrays import disturbance_arrays
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import pull_matrix
from dobc_design.model.couplings import felt_errors
from dobc_design.model.model import build_model

PROBLEMS = [double_integrators(), three_states(), pendulums()]
IDS = ["carts", "plants", "pendulums"]
CLOSE = {"rtol": 1e-12, "atol": 1e-12}


def drawn(model, *sizes):
    rng = np.random.default_rng(3)
    return [rng.standard_normal(model.n * size) for size in sizes]


def flat(value):
    return np.asarray(value).ravel()


def slopes_by_differences(function, e):
    """The Jacobian of a function at e by central differences."""
    columns = []
    for step in 1e-6 * np.eye(len(e)):
        change = function(e + step) - function(e - step)
        columns.append(flat(change) / 2e-6)
    return np.column_stack(columns)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_closed_loop_is_the_plant_the_observer_and_the_controller(problem):
    """(1), (12), (13), (19) with x_i' = A x_i + B (couplings + u_i + d_i), written out in NumPy."""
    model = build_model(problem)
    parts = drawn(model, model.m, model.q, model.q)
    found = [flat(rate) for rate in model.closed_loop(*parts)]
    slope, _ = full_loop(problem)
    expected = slope(0.0, np.concatenate(parts))
    assert np.allclose(np.concatenate(found), expected, **CLOSE)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_errors_of_the_plant_are_those_of_its_loop(problem):
    """e' = h(e) - (B K - A) e + B C eps, where h has all that is curved; the inputs are p for each
    agent."""
    model = build_model(problem)
    loop = loop_of(problem)
    felt = felt_errors(loop, "G")
    residual = disturbance_arrays(loop, None)
    e, eps = drawn(model, model.m, model.q)
    e_dot, eps_dot = model.error_dynamics(e, eps)

    pulled = flat(felt.h(e)) - pull_matrix(loop) @ e
    eps_by_agent = eps.reshape(model.n, -1)
    unknown = eps_by_agent @ residual.C.T
    assert np.allclose(pulled + unknown.ravel(), flat(e_dot), **CLOSE)
    decayed = eps_by_agent @ residual.F.T
    assert np.allclose(decayed.ravel(), flat(eps_dot))

    jacobian = np.asarray(ca.DM(felt.jacobian(e)))
    assert np.allclose(jacobian, slopes_by_differences(felt.h, e), atol=1e-7)
    assert model.controller.size_out("u") == (model.n * problem.inputs, 1)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_input_at_the_goal_is_the_feedforward(problem):
    """u = u0 where e = 0 and dhat = 0, with A goal + B u0 = 0."""
    data = matrices(problem)
    goals, u0 = data["goals"], data["u0"]
    no_disturbance = np.zeros(problem.n * problem.inputs)
    u = build_model(problem).controller(goals.ravel(), no_disturbance)
    assert np.allclose(flat(u), u0.ravel(), atol=1e-12)
    own = drift(problem)
    assert np.allclose(own(goals) + u0 @ data["B"].T, 0)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_derivatives_of_the_errors_are_the_error_dynamics(problem):
    """(22): e' = A e + B (h - K e + C eps), eps' = (A_xi - W C) eps, at any x, xi, z."""
    model = build_model(problem)
    data = matrices(problem)
    x, xi, z = drawn(model, model.m, model.q, model.q)
    x_dot, xi_dot, z_dot = map(flat, model.closed_loop(x, xi, z))

    def corrected(y):
        by_agent = y.reshape(model.n, -1) @ data["W"].T
        return by_agent.ravel()

    e = x - data["goals"].ravel()
    eps = xi - z - corrected(x)
    e_dot, eps_dot = model.error_dynamics(e, eps)
    assert np.allclose(flat(e_dot), x_dot, atol=1e-12)
    expected = xi_dot - z_dot - corrected(x_dot)
    assert np.allclose(flat(eps_dot), expected, atol=1e-12)


def test_jacobian_of_the_couplings_has_a_row_for_each_input():
    """dh/de (n p, n m) by central differences."""
    model = build_model(three_states())
    (e,) = drawn(model, model.m)
    jacobian = np.asarray(ca.DM(model.jacobian(e)))
    assert np.allclose(jacobian, slopes_by_differences(model.h, e), atol=1e-8)


def test_observer_error_is_free_of_the_network_for_every_plant():
    """eps' = (A_xi - W C) eps with free symbols: A, B (p = 1), W, C, x, v; only B+ B = 1 is
    used."""

    def free(name, rows, columns=1):
        return sympy.Matrix(rows, columns, sympy.symbols(f"{name}:{rows * columns}"))

    A = free("a", 2, 2)
    B = free("b", 2)
    S = free("s", 2, 2)
    C = free("c", 1, 2)
    W = free("w", 2)
    x = free("x", 2)
    xi = free("xi", 2)
    z = free("z", 2)
    v = free("v", 1)  # couplings + u
    left = (B.T * B).inv() * B.T
    decay = S - W * C

    xihat = z + W * left * x
    x_dot = A * x + B * (v + C * xi)
    z_dot = decay * xihat - W * (left * A * x + v)
    eps_dot = S * xi - z_dot - W * left * x_dot
    residual = eps_dot - decay * (xi - xihat)
    assert residual.applyfunc(sympy.cancel) == sympy.zeros(2, 1)
