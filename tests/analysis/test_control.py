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
    poles = np.sort(analysis.poles)
    observer_poles = np.sort(analysis.observer.poles())
    assert np.allclose(poles, observer_poles)


@pytest.mark.parametrize("name", ["paper-fixed", "platoon", "clock-sync"])
def test_the_error_system_has_the_poles_of_the_linearised_closed_loop(name):
    """python-control's own linearisation of the nonlinear loop: these poles, and those of the
    exosystems."""
    problem = dd.load_problem(name)
    poles = dd.analyse(problem).error_system().poles()
    loop = dd.export.to_control(problem)
    goals = [float(x) for i in range(problem.n) for x in problem.goal_of(i)]
    at_rest = np.zeros(loop.nstates - len(goals))
    at = np.concatenate([goals, at_rest])
    # the estimate z + W x is 0 at the goal
    W = np.array(problem.joint_observer.W, dtype=float) if problem.joint_observer.W else None
    if W is None:
        W = dd.certify(problem).W
    start = problem.n * (problem.m + problem.q)
    for i in range(problem.n):
        goal = goals[i * problem.m : (i + 1) * problem.m]
        x = np.array(goal)
        at[start + i * problem.q : start + (i + 1) * problem.q] = -W @ x
    no_input = np.zeros(loop.ninputs)
    linearised = control.linearize(loop, at, no_input)
    whole = linearised.poles()
    for pole in poles:
        distance = np.min(np.abs(whole - pole))
        allowed = 5e-3 * (1 + abs(pole))
        assert distance < allowed  # multiple poles are sensitive


def test_without_a_disturbance_there_is_nothing_to_observe():
    arcs = [[2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    problem = dd.Problem(network=network, coupling="y", gains={1: 2})
    analysis = dd.analyse(problem)
    poles = analysis.error_system().poles().real
    assert sorted(poles) == [-2, -1]
    with pytest.raises(SpecError, match="exosystem is missing"):
        _ = analysis.obsv
    with pytest.raises(SpecError, match=r"observer\.W is missing"):
        _ = analysis.poles
