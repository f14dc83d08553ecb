"""The CasADi and SymPy models of agents that measure y = H x, against runs and the whole loop as
``support/measured.py`` writes it out (theory, section 18)."""

import casadi as ca
import numpy as np
import pytest
from measured import CARTS, by_agent, floats, whole_loop

import dobc_design as dd
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.export import to_numpy, to_sympy
from dobc_design.loop.arrays import disturbance_arrays, error_arcs
from dobc_design.loop.make import errors_of
from dobc_design.simulation.field import make_closed_loop, network_of

LINEAR = ["estimates", "outputs", "groups"]


def flat(value):
    return np.asarray(value).ravel()


@pytest.mark.parametrize("name", LINEAR)
def test_the_jacobian_of_the_closed_loop_has_the_spectrum_of_the_whole_loop(name):
    """And that of the disturbances, which nothing stops; places of other groups' states are left
    out."""
    problem = with_observer(CARTS[name])
    model = dd.build_model(problem)
    x, xi, z = (ca.SX.sym(part, *model.closed_loop.size_in(part)) for part in ("x", "xi", "z"))
    state = ca.vertcat(x, xi, z)
    slopes = ca.jacobian(ca.vertcat(*model.closed_loop(x, xi, z)), state)
    J = np.asarray(ca.DM(ca.Function("slopes", [state], [slopes])(np.zeros(state.size1()))))
    if name == "groups":
        used = np.ones(len(J), dtype=bool)
        used[model.n * model.m :] = False
        at = model.n * model.m
        for first in (0, 1):
            for i in range(3):
                own = (0, 1, 2, 3) if i != 1 else (4, 5, 6)
                parts = (0, 1) if i != 1 else (2,)
                here, width = (parts, 3) if not first else (own, 7)
                used[at + i * width + np.array(here)] = True
            at += 3 * 3
        J = J[np.ix_(used, used)]
    found = np.poly(np.linalg.eigvals(J))
    wanted = np.linalg.eigvals(whole_loop(problem, "G"))
    free = [np.linalg.eigvals(A) for A, _, _ in by_agent(problem)]
    assert np.allclose(found, np.poly(np.concatenate([wanted, *free])), rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", CARTS)
def test_the_errors_of_the_model_move_as_those_of_runs(name):
    """(e, eps), and the derivatives of (x, xi, z) in these coordinates."""
    problem = with_observer(CARTS[name])
    model = dd.build_model(problem)
    loop = errors_of(problem)
    run = make_closed_loop(problem, None)
    network = network_of(run, error_arcs(loop, "G"))
    own = disturbance_arrays(loop, None)
    rng = np.random.default_rng(5)
    mine = np.ones((3, loop.q)) if own.own is None else own.own
    e = rng.standard_normal(6)
    eps = rng.standard_normal((3, loop.q)) * mine
    s = [] if problem.leader is None else [rng.standard_normal(2)]
    e_dot, eps_dot = model.error_dynamics(e, eps.ravel(), *s)
    moved = network(np.concatenate([e, *s]))[:6] + flat(eps @ own.C.T)
    assert np.allclose(flat(e_dot), moved, rtol=1e-12, atol=1e-12)
    assert np.allclose(flat(eps_dot), flat(eps @ own.F.T), rtol=1e-12, atol=1e-12)
    if name == "groups":
        return
    xi = rng.standard_normal((3, 2))
    known = e.reshape(3, 2) + run.goal + (s[0] if s else 0)
    x = known + eps[:, :2] if problem.dynamics.acts_on is None else known
    z = np.hstack([x, xi]) - eps
    x_dot, xi_dot, z_dot, *s_dot = map(
        flat, model.closed_loop(x.ravel(), xi.ravel(), z.ravel(), *s)
    )
    true = np.hstack([x_dot.reshape(3, 2), xi_dot.reshape(3, 2)])
    assert np.allclose(true - z_dot.reshape(3, 4), eps @ own.F.T, atol=1e-11)
    known_dot = z_dot.reshape(3, 4)[:, :2] if problem.dynamics.acts_on is None else true[:, :2]
    led = s_dot[0] if s else 0
    assert np.allclose(flat(known_dot - led), moved, atol=1e-11)


def test_the_observer_takes_no_more_of_the_states_than_y():
    """A speed that no encoder shows moves neither estimate nor input."""
    for name in ("estimates", "outputs"):
        problem = with_observer(CARTS[name])
        model = dd.build_model(problem)
        rng = np.random.default_rng(6)
        z, u, x = rng.standard_normal(12), rng.standard_normal(3), rng.standard_normal((3, 2))
        other = x + np.array([0, 1])
        for one, two in zip(
            model.observer(z, x.ravel(), u), model.observer(z, other.ravel(), u), strict=True
        ):
            assert np.array_equal(flat(one), flat(two))


def test_matrices_have_h_and_the_gains_that_act_on_it():
    """K of outputs is k H; SymPy has the same as rationals."""
    problem = with_observer(CARTS["outputs"])
    found = to_numpy(problem)
    assert np.array_equal(found["H"], floats(problem.dynamics.H))
    assert found["K"].shape == (3, 6)
    assert np.array_equal(found["K"][0], [4, 0, 0, 0, 0, 0])
    assert np.array_equal(np.array(to_sympy(problem)["K"], dtype=float), found["K"])
