"""``loop_of``: the error system of a problem, against the plant that the problem states."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import network_of

import dobc_design as dd
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of, observed

ARCS = {"a": [[2, 1], [3, 2, 2]], "b": [[3, 1], [1, 3, "1/2"]]}
CART = dd.Dynamics(A=[[0, 1], [-1, 0]], B=[[0], [2]])
PENDULUM = dd.Dynamics(f=["x2", "-sin(x1)"], B=[[0], [2]])


def network() -> dd.Network:
    return network_of(ARCS, 3)


def integrators() -> dd.Problem:
    return dd.Problem(
        network=network(),
        coupling="tanh(y)",
        exceptions={(1, 0): "2*y"},
        gains={1: 2, 3: "1/3"},
        target=1,
        offsets={2: 5},
        exosystem=dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        observer=dd.Observer(W=[["16/5"], ["12/5"]]),
    )


def with_dynamics(dynamics: dd.Dynamics) -> dd.Problem:
    return dd.Problem(
        network=network(),
        coupling="y1 + tanh(y2)",
        exceptions={(1, 0): "3*y1"},
        gains={1: [[2, 1]]},
        dynamics=dynamics,
        exosystem=dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        observer=dd.Observer(W=[["16/5"], ["12/5"]]),
    )


def value(coupling: dd.Coupling, y: np.ndarray) -> np.ndarray:
    """h(y), (p,)."""
    return coupling.value(y)


def errors_move(loop: Loop, mode: str, e: np.ndarray, eps: np.ndarray) -> np.ndarray:
    """e' of the loop, (n, m): arcs, pulls, the curved part of the drift, and C eps."""
    moved = np.zeros_like(e)
    for i, j, weight in loop.modes[mode]:
        moved[i] += float(weight) * value(loop.function_of(i, j), e[j] - e[i])
    for i, gain in loop.pulls.gains.items():
        moved[i] -= to_float(gain) @ e[i]
    if loop.drift_place is not None:
        # the slopes at 0 are in the pulls already
        slopes = to_float(loop.slopes)
        for i in range(loop.n):
            moved[i] += value(loop.functions[loop.drift_place], e[i]) - slopes @ e[i]
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
        felt[i] += float(weight) * value(problem.coupling_of(i, j), e[j] - e[i])
    for i, gain in problem.pinning.gains.items():
        felt[i] -= to_float(gain) @ e[i]
    exosystem = problem.exosystem
    assert exosystem is not None
    felt += eps @ to_float(exosystem.C).T
    if dynamics.A is not None:
        own = e @ to_float(dynamics.A).T
    else:
        own = np.stack([e[:, 1], -np.sin(e[:, 0])], axis=1)
    return own + felt @ to_float(dynamics.B).T


@pytest.mark.parametrize("dynamics", [CART, PENDULUM])
@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_errors_of_agents_with_dynamics_move_as_the_plant_does(dynamics: dd.Dynamics, seed: int):
    """Theory, section 13, at random errors, in both modes."""
    problem = with_dynamics(dynamics)
    loop = loop_of(problem)
    rng = np.random.default_rng(seed)
    e, eps = rng.uniform(-2, 2, (3, 2)), rng.uniform(-2, 2, (3, 2))
    for mode in ARCS:
        expected = plant_moves(problem, mode, e, eps)
        assert errors_move(loop, mode, e, eps) == pytest.approx(expected, abs=1e-12)


def test_the_product_of_gain_and_output_is_that_of_the_file():
    """W C is (q, q) in the file and in the states: B+ B = I."""
    problem = with_dynamics(CART)
    stated, seen = problem.exosystem, loop_of(problem).joint_exosystem
    W, on_states = problem.observer.W, loop_of(problem).observer.W
    assert stated is not None and seen is not None and W is not None and on_states is not None
    assert np.array_equal(to_float(on_states) @ to_float(seen.C), to_float(W) @ to_float(stated.C))


def test_integrators_are_their_own_loop():
    problem = integrators()
    loop = loop_of(problem)
    assert loop.functions == problem.couplings
    assert loop.pins is loop.pulls
    assert loop.pins.gains == {0: ((Fraction(2),),), 2: ((Fraction(1, 3),),)}
    assert loop.drift is None and loop.drift_place is None and loop.slopes == ()
    assert [loop.goals.of(i) for i in range(3)] == [(1,), (6,), (1,)]
    assert loop.goals.different(range(3)) == {(1,), (6,)}
    assert loop.groups == problem.groups and loop.joint_exosystem == problem.joint_exosystem


def test_what_pulls_a_node_is_its_pin_less_the_slopes_of_its_drift():
    """B K - A at the pinned agent, -A at the others, whose pins stay none."""
    loop = loop_of(with_dynamics(CART))
    assert loop.pins.nodes == (0,)
    assert loop.pulls.nodes == (0, 1, 2)
    A: Matrix = ((0, 1), (-1, 0))
    assert to_float(loop.pulls.gains[1]).tolist() == (-to_float(A)).tolist()
    assert to_float(loop.pulls.gains[0]).tolist() == [[0.0, -1.0], [5.0, 2.0]]


def test_a_problem_has_one_loop_and_an_equal_problem_has_another():
    """What is computed about a loop is kept with it; equal problems are not looked for."""
    problem = integrators()
    assert loop_of(problem) is loop_of(problem)
    assert loop_of(problem) is not loop_of(integrators())


def test_equal_functions_of_arcs_stand_there_once():
    """With B = 2 the couplings y and 2 y/2 become one function."""
    problem = dd.Problem(
        network=network(),
        coupling="y",
        exceptions={(1, 0): "y"},
        gains={1: 2},
        dynamics=dd.Dynamics(A=[[-1]], B=[[2]]),
    )
    loop = loop_of(problem)
    assert len(loop.functions) == 1
    assert loop.place_of(1, 0) == 0


def test_a_gain_acts_on_the_inputs_where_they_are_fewer_than_the_states():
    """C of the inputs, as in the file; B C where W acts on x."""
    problem = with_dynamics(CART)
    assert observed(problem) is problem.groups
    square = problem.replace(
        dynamics=dd.Dynamics(A=[[0, 1], [-1, 0]], B=[[2, 0], [0, 3]]),
        coupling="y",
        exceptions={},
        gains=1,
        exosystem=dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0], [0, 1]]),
        observer=None,
    )
    assert observed(square)[0].exosystem.C == ((2, 0), (0, 3))


def test_agents_that_pull_alike_differ_in_their_drift():
    """B K - A = 1 for both."""

    def pulled(*, A: int, gain: int) -> Loop:
        agents = dd.Dynamics(A=[[A]])
        return loop_of(dd.Problem(network=network(), coupling="y", gains=gain, dynamics=agents))

    one = pulled(A=1, gain=2)
    other = pulled(A=0, gain=1)
    assert one.pulls.gains == other.pulls.gains
    assert one.slopes != other.slopes and one.pins.gains != other.pins.gains


def test_a_curved_drift_is_the_last_function():
    loop = loop_of(with_dynamics(PENDULUM))
    assert loop.drift_place == len(loop.functions) - 1
    assert loop.slopes == ((0, 1), (-1, 0)) and not loop.is_linear and not loop.slopes_move
