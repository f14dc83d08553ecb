"""Float arrays of a problem, and the choice of mode and gain."""

from fractions import Fraction

import numpy as np
import pytest
from networks import network_of

from dobc_design import Exosystem, Observer, Problem
from dobc_design.errors import ShapeError, SpecError
from dobc_design.loop.arrays import (
    chosen_gain,
    chosen_mode,
    difference_matrix,
    error_arcs,
    gathering_matrix,
    goals,
    pinning_matrix,
    plant_arcs,
    required_gain,
)
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian


def triangle(**settings) -> Problem:
    """1 hears 2 (weight 3), 2 hears 3, 1 hears 3; the last arc may have a coupling of its own."""
    network = network_of([[1, 2, 3], [2, 3], [1, 3]], 3)
    return Problem(**({"network": network, "coupling": "2*y"} | settings))


def two_modes() -> Problem:
    return Problem(network=network_of({"a": [[1, 2]], "b": [[2, 1]]}), coupling="y")


EXOSYSTEM = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


def test_the_first_mode_is_the_default_and_an_unknown_one_is_refused_with_those_that_exist():
    assert chosen_mode(two_modes(), None) == "a"
    assert chosen_mode(two_modes(), "b") == "b"
    with pytest.raises(
        SpecError, match=r"mode must be one of the problem's modes \(a, b\); got 'c'"
    ):
        chosen_mode(two_modes(), "c")


def test_a_gain_that_is_handed_over_wins_and_may_have_more_digits_than_a_problem_file_may():
    problem = triangle(exosystem=EXOSYSTEM, observer=Observer(W=[[1], [2]]))
    assert chosen_gain(loop_of(problem), None) == ((1,), (2,))
    assert chosen_gain(loop_of(problem), [["16/5"], [3]]) == ((Fraction(16, 5),), (3,))
    assert required_gain(loop_of(problem), None).tolist() == [[1.0], [2.0]]
    long = Fraction(3**900, 2**1400)
    assert chosen_gain(loop_of(triangle(exosystem=EXOSYSTEM)), ((long,), (long,))) == (
        (long,),
        (long,),
    )


def test_a_gain_that_is_missing_or_of_the_wrong_shape_or_without_an_exosystem_is_refused():
    with pytest.raises(
        SpecError, match=r"observer.W must be known .* no W\. Give W in \[observer\], or design one"
    ):
        required_gain(loop_of(triangle(exosystem=EXOSYSTEM)), None)
    with pytest.raises(
        ShapeError, match=r"gain must have shape \(2, 1\), one row per exosystem state"
    ):
        chosen_gain(loop_of(triangle(exosystem=EXOSYSTEM)), [[1, 2]])
    with pytest.raises(SpecError, match="gain has no meaning without an"):
        chosen_gain(loop_of(triangle()), [[1]])
    assert pinning_matrix(triangle()).nnz == 0


def test_goals_are_target_plus_offset():
    problem = triangle(target=[1, 2], offsets={"2": [10, "1/2"]})
    assert goals(problem).tolist() == [[1, 2], [11, 2.5], [1, 2]]


def test_arcs_are_grouped_by_coupling():
    groups = error_arcs(loop_of(triangle(exceptions={(0, 2): "sin(y)"})), "G")
    assert [group.coupling.texts for group in groups] == [("2*y",), ("sin(y)",)]
    assert groups[0].weights.tolist() == [3, 1]
    assert (groups[1].listeners.tolist(), groups[1].speakers.tolist()) == ([0], [2])


def test_arcs_of_errors_have_the_functions_of_the_loop_and_those_of_the_plant_its_couplings():
    """B h of two states in place of h of one input."""
    problem = triangle(dynamics={"A": [[0, 1], [0, 0]], "B": [[0], [2]]}, coupling="y1 + 3*y2")
    (errors,) = error_arcs(loop_of(problem), "G")
    (plant,) = plant_arcs(problem, "G")
    assert (errors.coupling.outputs, plant.coupling.outputs) == (2, 1)
    assert plant.coupling is problem.coupling
    assert errors.weights.tolist() == plant.weights.tolist()
    assert errors.coupling.texts[1] == "2*(y1 + 3*y2)"


def test_what_no_arc_of_the_mode_uses_makes_no_group():
    network = network_of({"a": [[1, 2]], "b": [[2, 1]]})
    problem = Problem(network=network, coupling="y", exceptions={(0, 1): "sin(y)"})
    assert [group.coupling.texts for group in error_arcs(loop_of(problem), "a")] == [("sin(y)",)]
    assert [group.coupling.texts for group in error_arcs(loop_of(problem), "b")] == [("y",)]
    problem = Problem(network=network_of({"a": [[1, 2]], "b": []}), coupling="y")
    assert error_arcs(loop_of(problem), "b") == ()
    assert consensus_jacobian(loop_of(problem), "b").nnz == 0


def test_differences_and_their_sums_follow_the_arcs():
    """Agent i feels w h(x_j - x_i) of whom it hears (1)."""
    (group,) = plant_arcs(triangle(), "G")
    x = np.array([1.0, 10.0, 100.0])
    assert (difference_matrix(group, 3) @ x).tolist() == [9, 90, 99]
    assert (gathering_matrix(group, 3) @ [9, 90, 99]).tolist() == [3 * 9 + 99, 90, 0]


def test_the_jacobian_at_the_consensus_is_minus_the_laplacian_of_the_gains_where_there_is_one():
    """(11) at e = 0, by hand: gains 6, 2 and 1."""
    expected = [[-7, 6, 1], [0, -2, 2], [0, 0, 0]]
    assert (
        consensus_jacobian(loop_of(triangle(exceptions={(0, 2): "sin(y)"})), "G").toarray().tolist()
        == expected
    )
    assert consensus_jacobian(loop_of(triangle(exceptions={(0, 2): "y + abs(y)"})), "G") is None
    assert (
        consensus_jacobian(loop_of(triangle(exceptions={(0, 2): "clip(y, -1, 1)"})), "G")
        is not None
    )
