"""Float arrays of a problem, and the choice of mode and gain."""

from collections.abc import Iterable
from fractions import Fraction

import numpy as np
import pytest
from networks import linked

from dobc_design import Exosystem, Observer, Problem
from dobc_design.errors import ShapeError, SpecError
from dobc_design.loop.arrays import (
    ArcGroup,
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
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian


def triangle(**settings) -> Problem:
    """1 hears 2 (weight 3), 2 hears 3, 1 hears 3; the last arc may have a coupling of its own."""
    arcs = [[1, 2, 3], [2, 3], [1, 3]]
    return linked(arcs, 3, **{"coupling": "2*y"} | settings)


def with_last(coupling: str) -> Loop:
    return loop_of(triangle(exceptions={(0, 2): coupling}))


def texts(arcs: Iterable[ArcGroup]) -> list[tuple[str, ...]]:
    return [group.coupling.texts for group in arcs]


def two_modes(**settings) -> Problem:
    arcs = [[1, 2]]
    modes = {"a": arcs, "b": [[2, 1]]}
    return linked(modes, **settings)


EXOSYSTEM = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


def test_the_first_mode_is_the_default_and_an_unknown_one_is_refused_with_those_that_exist():
    assert chosen_mode(two_modes(), None) == "a"
    assert chosen_mode(two_modes(), "b") == "b"
    said = r"mode must be one of a, b; got 'c'"
    with pytest.raises(SpecError, match=said):
        chosen_mode(two_modes(), "c")


def test_a_gain_that_is_handed_over_wins_and_may_have_more_digits_than_a_problem_file_may():
    observer = Observer(W=[[1], [2]])
    loop = loop_of(triangle(exosystem=EXOSYSTEM, observer=observer))
    assert chosen_gain(loop, None) == ((1,), (2,))
    found = chosen_gain(loop, [["16/5"], [3]])
    expected = ((Fraction(16, 5),), (3,))
    assert found == expected
    assert required_gain(loop, None).tolist() == [[1.0], [2.0]]

    without_gain = loop_of(triangle(exosystem=EXOSYSTEM))
    long = Fraction(3**900, 2**1400)
    handed_over = ((long,), (long,))
    assert chosen_gain(without_gain, handed_over) == handed_over


def test_a_gain_that_is_missing_or_of_the_wrong_shape_or_without_an_exosystem_is_refused():
    loop = loop_of(triangle(exosystem=EXOSYSTEM))
    missing = r"observer.W must be known .* no W\. Give W in \[observer\], or design one"
    with pytest.raises(SpecError, match=missing):
        required_gain(loop, None)
    shape = r"gain must have shape \(2, 1\), one row per exosystem state"
    with pytest.raises(ShapeError, match=shape):
        chosen_gain(loop, [[1, 2]])
    with pytest.raises(SpecError, match="gain has no meaning without an"):
        chosen_gain(loop_of(triangle()), [[1]])
    assert pinning_matrix(triangle()).nnz == 0


def test_goals_are_target_plus_offset():
    offsets = {"2": [10, "1/2"]}
    problem = triangle(target=[1, 2], offsets=offsets)
    found = goals(problem).tolist()
    expected = [[1, 2], [11, 2.5], [1, 2]]
    assert found == expected


def test_arcs_are_grouped_by_coupling():
    groups = error_arcs(with_last("sin(y)"), "G")
    assert texts(groups) == [("2*y",), ("sin(y)",)]
    first, last = groups
    assert first.weights.tolist() == [3, 1]
    assert last.listeners.tolist() == [0]
    assert last.speakers.tolist() == [2]


def test_arcs_of_errors_have_the_functions_of_the_loop_and_those_of_the_plant_its_couplings():
    """B h of two states in place of h of one input."""
    A = [[0, 1], [0, 0]]
    B = [[0], [2]]
    dynamics = {"A": A, "B": B}
    problem = triangle(dynamics=dynamics, coupling="y1 + 3*y2")
    (errors,) = error_arcs(loop_of(problem), "G")
    (plant,) = plant_arcs(problem, "G")
    assert errors.coupling.outputs == 2
    assert plant.coupling.outputs == 1
    assert plant.coupling is problem.coupling
    assert errors.weights.tolist() == plant.weights.tolist()
    assert errors.coupling.texts[1] == "2*(y1 + 3*y2)"


def test_what_no_arc_of_the_mode_uses_makes_no_group():
    loop = loop_of(two_modes(exceptions={(0, 1): "sin(y)"}))
    assert texts(error_arcs(loop, "a")) == [("sin(y)",)]
    assert texts(error_arcs(loop, "b")) == [("y",)]
    arcs = [[1, 2]]
    modes = {"a": arcs, "b": []}
    empty = loop_of(linked(modes))
    assert error_arcs(empty, "b") == ()
    assert consensus_jacobian(empty, "b").nnz == 0


def test_differences_and_their_sums_follow_the_arcs():
    """Agent i feels w h(x_j - x_i) of whom it hears (1)."""
    (group,) = plant_arcs(triangle(), "G")
    x = np.array([1.0, 10.0, 100.0])
    differences = difference_matrix(group, 3) @ x
    assert differences.tolist() == [9, 90, 99]
    sums = gathering_matrix(group, 3) @ differences
    assert sums.tolist() == [3 * 9 + 99, 90, 0]


def test_the_jacobian_at_the_consensus_is_minus_the_laplacian_of_the_gains_where_there_is_one():
    """(11) at e = 0, by hand: gains 6, 2 and 1."""
    found = consensus_jacobian(with_last("sin(y)"), "G")
    found_rows = found.toarray().tolist()
    expected = [[-7, 6, 1], [0, -2, 2], [0, 0, 0]]
    assert found_rows == expected
    assert consensus_jacobian(with_last("y + abs(y)"), "G") is None
    assert consensus_jacobian(with_last("clip(y, -1, 1)"), "G") is not None
