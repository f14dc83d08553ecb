"""What an analysis hands to python-control: observability matrix, observer, error system."""

import control
import numpy as np
import pytest

import dobc_design as dd
from dobc_design.errors import SpecError


def test_the_observability_matrix_is_that_of_python_control():
    analysis = dd.analyse("paper-fixed")
    A = np.array([[0, 2], [-2, 0]])
    C = np.array([[1, 0]])
    assert np.array_equal(analysis.obsv, control.obsv(A, C))


def test_the_observer_is_that_of_the_exported_loop():
    analysis = dd.analyse("paper-fixed")
    exported = dd.export.to_control(dd.load_problem("paper-fixed")).observer
    w = np.array([0.1, 1.0, 10.0])
    assert np.allclose(analysis.observer(1j * w), exported(1j * w))
    assert np.allclose(np.sort(analysis.poles), np.sort(analysis.observer.poles()))


@pytest.mark.parametrize("name", ["paper-fixed", "platoon", "clock-sync"])
def test_the_error_system_has_the_poles_of_the_linearised_closed_loop(name):
    """python-control's own linearisation of the nonlinear loop: these poles, and those of the
    exosystems."""
    problem = dd.load_problem(name)
    poles = dd.analyse(problem).error_system().poles()
    loop = dd.export.to_control(problem)
    goals = [float(x) for i in range(problem.n) for x in problem.goal_of(i)]
    at = np.concatenate([goals, np.zeros(loop.nstates - len(goals))])
    # the estimate z + W x is 0 at the goal
    W = np.array(problem.joint_observer.W, dtype=float) if problem.joint_observer.W else None
    if W is None:
        W = dd.certify(problem).W
    start = problem.n * (problem.m + problem.q)
    for i in range(problem.n):
        x = np.array(goals[i * problem.m : (i + 1) * problem.m])
        at[start + i * problem.q : start + (i + 1) * problem.q] = -W @ x
    whole = control.linearize(loop, at, np.zeros(loop.ninputs)).poles()
    for pole in poles:
        assert np.min(np.abs(whole - pole)) < 5e-3 * (1 + abs(pole))  # multiple poles are sensitive


def test_without_a_disturbance_there_is_nothing_to_observe():
    network = dd.Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    analysis = dd.analyse(dd.Problem(network=network, coupling="y", gains={1: 2}))
    assert sorted(analysis.error_system().poles().real) == [-2, -1]
    with pytest.raises(SpecError, match="exosystem is missing"):
        _ = analysis.obsv
    with pytest.raises(SpecError, match=r"observer\.W is missing"):
        _ = analysis.poles
