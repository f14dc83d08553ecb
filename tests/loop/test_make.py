"""``loop_of``: the error system of a problem, against the plant that the problem states."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import linked

import dobc_design as dd
from dobc_design.exact.matrix import to_float
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of, observed

ARCS: dict[str, Any] = {}
ARCS["a"] = [[2, 1], [3, 2, 2]]
ARCS["b"] = [[3, 1], [1, 3, "1/2"]]
CART = dd.Dynamics(A=[[0, 1], [-1, 0]], B=[[0], [2]])
# a force of 2 for each unit of u, as for the cart
PENDULUM = dd.Dynamics(f=["x2", "-sin(x1)"], B=[[0], [2]])


SINE = [[0, 2], [-2, 0]]
OBSERVED: dict[str, Any] = {"exosystem": dd.Exosystem(A=SINE, C=[[1, 0]])}
OBSERVED["observer"] = dd.Observer(W=[["16/5"], ["12/5"]])


def integrators() -> dd.Problem:
    given = OBSERVED | {"target": 1, "offsets": {2: 5}}
    given["exceptions"] = {(1, 0): "2*y"}
    given["gains"] = {1: 2, 3: "1/3"}
    return linked(ARCS, 3, "tanh(y)", **given)


def with_dynamics(dynamics: dd.Dynamics) -> dd.Problem:
    given = OBSERVED | {"dynamics": dynamics}
    given["exceptions"] = {(1, 0): "3*y1"}
    given["gains"] = {1: [[2, 1]]}
    return linked(ARCS, 3, "y1 + tanh(y2)", **given)


def errors_move(loop: Loop, mode: str, e: np.ndarray, eps: np.ndarray) -> np.ndarray:
    """e' of the loop, (n, m): arcs, pulls, the curved part of the drift, and C eps."""
    moved = np.zeros_like(e)
    for i, j, weight in loop.modes[mode]:
        h = loop.function_of(i, j).value(e[j] - e[i])
        moved[i] += float(weight) * h
    for i, gain in loop.pulls.gains.items():
        moved[i] -= to_float(gain) @ e[i]
    if loop.drift_place is not None:
        # the slopes at 0 are in the pulls already
        drift = loop.functions[loop.drift_place]
        slopes = to_float(loop.slopes)
        for i in range(loop.n):
            moved[i] += drift.value(e[i]) - slopes @ e[i]
    exosystem = loop.joint_exosystem
    assert exosystem is not None
    return moved + eps @ to_float(exosystem.C).T


def plant_moves(problem: dd.Problem, mode: str, e: np.ndarray, eps: np.ndarray) -> np.ndarray:
    """The same from the plant: x_i' = A x_i + B (sum h + u_i + d_i), u_i = -K_i e_i - dhat_i,
    d_i - dhat_i = C eps_i, with the target at 0."""
    dynamics = problem.dynamics
    assert dynamics is not None
    felt = np.zeros((problem.n, problem.inputs))
    for i, j, weight in problem.network.modes[mode]:
        h = problem.coupling_of(i, j).value(e[j] - e[i])
        felt[i] += float(weight) * h
    for i, gain in problem.pinning.gains.items():
        felt[i] -= to_float(gain) @ e[i]
    exosystem = problem.exosystem
    assert exosystem is not None
    felt += eps @ to_float(exosystem.C).T
    if dynamics.A is not None:
        own = e @ to_float(dynamics.A).T
    else:
        slopes = -np.sin(e[:, 0])
        field = [e[:, 1], slopes]
        own = np.stack(field, axis=1)
    return own + felt @ to_float(dynamics.B).T


@pytest.mark.parametrize("dynamics", [CART, PENDULUM])
@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_errors_of_agents_with_dynamics_move_as_the_plant_does(dynamics: dd.Dynamics, seed: int):
    """Theory, section 13, at random errors, in both modes."""
    problem = with_dynamics(dynamics)
    loop = loop_of(problem)
    rng = np.random.default_rng(seed)
    e = rng.uniform(-2, 2, (3, 2))
    eps = rng.uniform(-2, 2, (3, 2))
    for mode in ARCS:
        expected = plant_moves(problem, mode, e, eps)
        assert errors_move(loop, mode, e, eps) == pytest.approx(expected, abs=1e-12)


def test_the_product_of_gain_and_output_is_that_of_the_file():
    """W C is (q, q) in the file and in the states: B+ B = I."""
    problem = with_dynamics(CART)
    loop = loop_of(problem)
    stated = to_float(problem.observer.W) @ to_float(problem.exosystem.C)
    on_states = to_float(loop.observer.W) @ to_float(loop.joint_exosystem.C)
    assert np.array_equal(on_states, stated)


def test_integrators_are_their_own_loop():
    problem = integrators()
    loop = loop_of(problem)
    assert loop.functions == problem.couplings
    assert loop.pins is loop.pulls
    first = ((Fraction(2),),)
    third = ((Fraction(1, 3),),)
    expected = {0: first, 2: third}
    assert loop.pins.gains == expected
    assert loop.drift is None
    assert loop.drift_place is None
    assert loop.slopes == ()
    found = [loop.goals.of(i) for i in range(3)]
    assert found == [(1,), (6,), (1,)]
    different = loop.goals.different(range(3))
    expected_goals = {(1,), (6,)}
    assert different == expected_goals
    assert loop.groups == problem.groups
    assert loop.joint_exosystem == problem.joint_exosystem


def test_what_pulls_a_node_is_its_pin_less_the_slopes_of_its_drift():
    """B K - A at the pinned agent, -A at the others, whose pins stay none."""
    loop = loop_of(with_dynamics(CART))
    assert loop.pins.nodes == (0,)
    assert loop.pulls.nodes == (0, 1, 2)
    found = loop.pulls.gains[1]
    expected = ((0, -1), (1, 0))
    assert found == expected
    found_pinned = loop.pulls.gains[0]
    expected_pinned = ((0, -1), (5, 2))
    assert found_pinned == expected_pinned


def test_a_problem_has_one_loop_and_an_equal_problem_has_another():
    """What is computed about a loop is kept with it; equal problems are not looked for."""
    problem = integrators()
    assert loop_of(problem) is loop_of(problem)
    assert loop_of(problem) is not loop_of(integrators())


def test_equal_functions_of_arcs_stand_there_once():
    """With B = 2 the couplings y and 2 y/2 become one function."""
    dynamics = dd.Dynamics(A=[[-1]], B=[[2]])
    exceptions = {(1, 0): "y"}
    given: dict[str, Any] = {"exceptions": exceptions, "gains": {1: 2}}
    loop = loop_of(linked(ARCS, 3, dynamics=dynamics, **given))
    assert len(loop.functions) == 1
    assert loop.place_of(1, 0) == 0


def test_a_gain_acts_on_the_inputs_where_they_are_fewer_than_the_states():
    """C of the inputs, as in the file; B C where W acts on x."""
    problem = with_dynamics(CART)
    assert observed(problem) is problem.groups
    A = [[0, 1], [-1, 0]]
    B = [[2, 0], [0, 3]]
    dynamics = dd.Dynamics(A=A, B=B)
    C = [[1, 0], [0, 1]]
    exosystem = dd.Exosystem(A=SINE, C=C)
    square = linked(ARCS, 3, gains=1, dynamics=dynamics, exosystem=exosystem)
    (group,) = observed(square)
    assert group.exosystem.C == ((2, 0), (0, 3))


def test_agents_that_pull_alike_differ_in_their_drift():
    """B K - A = 1 for both."""

    def pulled(*, A: int, gain: int) -> Loop:
        agents = dd.Dynamics(A=[[A]])
        return loop_of(linked(ARCS, 3, gains=gain, dynamics=agents))

    one = pulled(A=1, gain=2)
    other = pulled(A=0, gain=1)
    assert one.pulls.gains == other.pulls.gains
    assert one.slopes != other.slopes
    assert one.pins.gains != other.pins.gains


def test_a_curved_drift_is_the_last_function():
    loop = loop_of(with_dynamics(PENDULUM))
    assert loop.drift_place == len(loop.functions) - 1
    assert loop.slopes == ((0, 1), (-1, 0))
    assert not loop.is_linear
    assert not loop.slopes_move
