"""The NumPy right-hand side is the symbolic closed loop (1), (12), (13), (19)."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from dobc_design.model.model import build_model
from dobc_design.problem.arrays import arc_groups
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import make_field, make_loop, network_of


def mixed() -> Problem:
    """m = 2, q = 3, weights, an exception, matrix gains, offsets: nothing is symmetric."""
    return Problem(
        network=Network.from_arcs([[1, 2, 3], [2, 3], [3, 1, "1/2"], [4, 1]], arrow="listens_to"),
        coupling=["y1 + y1*y2", "sin(y2) - y1"],
        exceptions={(1, 2): ["exp(y1) - 1", "2*y2"]},
        target=[1, -2],
        gains={"1": 3, "4": [[1, 2], [-2, 1]]},
        exosystem=Exosystem(A=[[0, 1, 2], [3, -4, 5], [6, 7, -8]], C=[[1, 2, 0], [0, 3, 1]]),
        observer=Observer(W=[[1, 2], [3, 4], [5, 6]]),
        offsets={"2": [1, 0], "3": [0, "1/3"]},
    )


def without_disturbance() -> Problem:
    network = Network.from_arcs([[1, 2], [2, 1], [1, 3]], arrow="listens_to")
    return Problem(network=network, coupling="exp(y) - 1 + y", target=[0, 1], gains={"3": 2})


PROBLEMS = [mixed(), without_disturbance(), load_problem("paper-fixed")]
IDS = ["mixed", "without disturbance", "paper-fixed"]


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_the_field_is_the_symbolic_closed_loop(problem: Problem):
    field = make_field(problem, next(iter(problem.network.modes)), None)
    model = build_model(problem)
    rng = np.random.default_rng(0)
    for _ in range(5):
        state = rng.normal(size=problem.n * (problem.m + 2 * problem.q))
        wanted = np.asarray(ca.vertcat(*model.closed_loop(*[part.ravel() for part in field.split(state)]))).ravel()
        np.testing.assert_allclose(field(0.0, state), wanted, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_the_pattern_covers_the_jacobian_of_the_closed_loop(problem: Problem):
    field = make_field(problem, next(iter(problem.network.modes)), None)
    symbols = [ca.SX.sym("s", problem.n * width) for width in (problem.m, problem.q, problem.q)]
    closed_loop = ca.vertcat(*build_model(problem).closed_loop(*symbols))
    rows, columns = ca.jacobian(closed_loop, ca.vertcat(*symbols)).sparsity().get_triplet()
    pattern = field.pattern().toarray() != 0
    assert pattern.shape == (closed_loop.numel(),) * 2
    assert pattern[rows, columns].all()


def test_states_are_cut_agent_by_agent():
    field = make_field(mixed(), "G", None)
    x, xi, z = field.split(np.arange(32.0))
    assert x[1].tolist() == [2, 3]
    assert xi[0].tolist() == [8, 9, 10]
    assert z[3].tolist() == [29, 30, 31]


def test_an_overflow_gives_no_warning_where_it_is_expected():
    """Trial steps go far; NumPy's own functions stay silent there."""
    field = make_field(without_disturbance(), "G", None)
    with np.errstate(all="ignore"):
        assert not np.isfinite(field(0.0, np.array([0, 0, 1e4, 0, 0, 0.0]))).all()


def test_errors_alone_obey_the_same_loop():
    """(22): the derivative of x - goal in the full loop is h(e) - K e + C eps."""
    problem = mixed()
    field, loop = make_field(problem, "G", None), make_loop(problem, None)
    network = network_of(loop, arc_groups(problem, "G"))
    state = np.random.default_rng(1).normal(size=loop.width)
    x, xi, z = field.split(state)
    eps = xi - (z + x @ loop.W.T)
    wanted = field.split(field(0.0, state))[0]
    found = network((x - loop.goal).ravel()).reshape(4, 2) + eps @ loop.C.T
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-11)
