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


def drawn(model, *sizes):
    rng = np.random.default_rng(3)
    return [rng.standard_normal(model.n * size) for size in sizes]


@pytest.mark.parametrize("problem", PROBLEMS, ids=["carts", "plants", "pendulums"])
def test_closed_loop_is_the_plant_the_observer_and_the_controller(problem):
    """(1), (12), (13), (19) with x_i' = A x_i + B (couplings + u_i + d_i), written out in NumPy."""
    model = build_model(problem)
    x, xi, z = drawn(model, model.m, model.q, model.q)
    found = np.concatenate([np.asarray(each).ravel() for each in model.closed_loop(x, xi, z)])
    assert np.allclose(
        found, full_loop(problem)[0](0.0, np.concatenate([x, xi, z])), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("problem", PROBLEMS, ids=["carts", "plants", "pendulums"])
def test_errors_of_the_plant_are_those_of_its_loop(problem):
    """e' = h(e) - (B K - A) e + B C eps, where h has all that is curved; the inputs are p for each
    agent."""
    model, loop = build_model(problem), loop_of(problem)
    felt, residual = felt_errors(loop, "G"), disturbance_arrays(loop, None)
    e, eps = drawn(model, model.m, model.q)
    e_dot, eps_dot = (np.asarray(each).ravel() for each in model.error_dynamics(e, eps))
    pulled = np.asarray(felt.h(e)).ravel() - pull_matrix(loop) @ e
    unknown = eps.reshape(model.n, -1) @ residual.C.T
    assert np.allclose(pulled + unknown.ravel(), e_dot, rtol=1e-12, atol=1e-12)
    assert np.allclose((eps.reshape(model.n, -1) @ residual.F.T).ravel(), eps_dot)
    steps = 1e-6 * np.eye(len(e))
    columns = [np.asarray(felt.h(e + step) - felt.h(e - step)).ravel() / 2e-6 for step in steps]
    assert np.allclose(np.asarray(ca.DM(felt.jacobian(e))), np.array(columns).T, atol=1e-7)
    assert model.controller.size_out("u") == (model.n * problem.inputs, 1)


@pytest.mark.parametrize("problem", PROBLEMS, ids=["carts", "plants", "pendulums"])
def test_input_at_the_goal_is_the_feedforward(problem):
    """u = u0 where e = 0 and dhat = 0, with A goal + B u0 = 0."""
    model, data = build_model(problem), matrices(problem)
    u = np.asarray(model.controller(data["goals"].ravel(), np.zeros(problem.n * problem.inputs)))
    assert np.allclose(u.ravel(), data["u0"].ravel(), atol=1e-12)
    assert np.allclose(drift(problem)(data["goals"]) + data["u0"] @ data["B"].T, 0)


@pytest.mark.parametrize("problem", PROBLEMS, ids=["carts", "plants", "pendulums"])
def test_derivatives_of_the_errors_are_the_error_dynamics(problem):
    """(22): e' = A e + B (h - K e + C eps), eps' = (A_xi - W C) eps, at any x, xi, z."""
    model, data = build_model(problem), matrices(problem)
    x, xi, z = drawn(model, model.m, model.q, model.q)
    x_dot, xi_dot, z_dot = (np.asarray(each).ravel() for each in model.closed_loop(x, xi, z))

    def corrected(y):
        return (y.reshape(model.n, -1) @ data["W"].T).ravel()

    e_dot, eps_dot = model.error_dynamics(x - data["goals"].ravel(), xi - z - corrected(x))
    assert np.allclose(np.asarray(e_dot).ravel(), x_dot, atol=1e-12)
    assert np.allclose(np.asarray(eps_dot).ravel(), xi_dot - z_dot - corrected(x_dot), atol=1e-12)


def test_jacobian_of_the_couplings_has_a_row_for_each_input():
    """dh/de (n p, n m) by central differences."""
    model = build_model(three_states())
    (e,) = drawn(model, model.m)
    steps = 1e-6 * np.eye(len(e))
    columns = [np.asarray(model.h(e + step) - model.h(e - step)).ravel() / 2e-6 for step in steps]
    assert np.allclose(np.asarray(ca.DM(model.jacobian(e))), np.array(columns).T, atol=1e-8)


def test_observer_error_is_free_of_the_network_for_every_plant():
    """eps' = (A_xi - W C) eps with free symbols: A, B (p = 1), W, C, x, v; only B+ B = 1 is
    used."""
    m, q = 2, 2
    A, S = (
        sympy.Matrix(k, k, sympy.symbols(f"{letter}:{k * k}")) for letter, k in (("a", m), ("s", q))
    )
    B, C, W = (
        sympy.Matrix(m, 1, sympy.symbols("b:2")),
        sympy.Matrix(1, q, sympy.symbols("c:2")),
        sympy.Matrix(q, 1, sympy.symbols("w:2")),
    )
    x, xi, z = (sympy.Matrix(2, 1, sympy.symbols(f"{letter}:2")) for letter in ("x", "xi", "z"))
    v = sympy.Matrix([sympy.Symbol("v")])  # couplings + u
    left = (B.T * B).inv() * B.T
    xihat = z + W * left * x
    z_dot = (S - W * C) * xihat - W * (left * A * x + v)
    eps_dot = S * xi - z_dot - W * left * (A * x + B * (v + C * xi))
    assert (eps_dot - (S - W * C) * (xi - xihat)).applyfunc(sympy.cancel) == sympy.zeros(q, 1)
