"""Observability and detectability against known answers, SymPy and constructed pairs."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from texts import exact_matrix

from dobc_design import exact
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import matrix
from dobc_design.verdict import Verdict

PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED
PAPER = exact_matrix("0 2; -2 0"), exact_matrix("1 0")
TWINS = (exact_matrix("0 2 0 0; -2 0 0 0; 0 0 0 2; 0 0 -2 0"), exact_matrix("1 0 1 0"))


def test_the_papers_pair_is_observable():
    """Theory, section 9: paper pair yes."""
    result = exact.decide_observable(*PAPER)
    assert result.rank == 2
    assert result.size == 2
    assert result.verdict == PROVED
    assert result.unobservable == ()
    assert exact.observability_matrix(*PAPER) == exact_matrix("1 0; 0 2")
    detectable = exact.decide_detectable(*PAPER)
    assert detectable.verdict == PROVED
    assert detectable.unobservable_polynomial == (1,)
    assert detectable.unobservable_text == "1"


def test_what_is_not_seen_is_detectable_iff_it_dies_out():
    """Theory, section 9: A = [0], C = [0] no (mode 0)."""
    result = exact.decide_detectable(exact_matrix("0"), exact_matrix("0"))
    assert result.verdict == REFUTED
    assert result.unobservable_text == "s"
    found = exact.decide_detectable(exact_matrix("0"), exact_matrix("1e-300"))
    assert found.verdict is PROVED
    found = exact.decide_detectable(exact_matrix("-1e-300"), exact_matrix("0"))
    assert found.verdict is PROVED
    A = exact_matrix("0 1; 0 -3")
    pair = A, exact_matrix("0 0")
    assert exact.decide_detectable(*pair).verdict is REFUTED
    unseen = exact_matrix("0 0; 1 -3"), exact_matrix("1 0")
    assert exact.decide_observable(*unseen).verdict is REFUTED
    assert exact.decide_observable(*unseen).unobservable == ((0, 1),)
    assert exact.decide_detectable(*unseen).verdict is PROVED
    assert exact.decide_detectable(*unseen).unobservable_text == "s + 3"


def test_two_equal_oscillators_seen_as_one_are_not_detectable_and_different_ones_are():
    """Theory, section 9: C = [1, 0, 1, 0] no (s^2 + 4)."""
    result = exact.decide_detectable(*TWINS)
    assert result.verdict == REFUTED
    assert result.unobservable_text == "s^2 + 4"
    assert result.table == exact.routh((1, 0, 4))
    assert exact.decide_observable(*TWINS).rank == 2
    # The twin: a frequency of 2 + 10^-30 tells them apart, which no rank in floats can.
    A, C = TWINS
    faster = 2 + Fraction(1, 10**30)
    rows = (*A[:2], (0, 0, 0, faster), (0, 0, -faster, 0))
    near = matrix(rows)
    assert exact.decide_observable(near, C).verdict is PROVED
    in_floats = exact.to_float(exact.observability_matrix(near, C))
    assert np.linalg.matrix_rank(in_floats) == 2


def test_reductions_of_the_theory_and_of_nothing():
    assert exact.observable_reduction(*PAPER) == (*PAPER, exact.identity(2))
    # Theory, section 2: the reduced exosystem is the fix.
    A_o, C_o, T = exact.observable_reduction(*TWINS)
    assert exact_matrix("1 0 1 0; 0 1 0 1") == T
    assert (A_o, C_o) == PAPER
    # r = 0: A_o and T have no rows, C_o empty ones.
    blind = exact.identity(2), exact.zeros(3, 2)
    expected = ((), ((), (), ()), ())
    assert exact.observable_reduction(*blind) == expected
    assert exact.decide_observable(*blind).rank == 0
    found = exact.decide_observable(exact.identity(2), ())
    assert found.unobservable == exact.identity(2)
    assert exact.decide_observable((), ()).verdict is PROVED
    assert exact.decide_detectable((), ()).verdict is PROVED


ENTRIES = st.integers(-2, 2).map(Fraction)


def matrices(rows, columns):
    row = st.lists(ENTRIES, min_size=columns, max_size=columns).map(tuple)
    return st.lists(row, min_size=rows, max_size=rows).map(tuple)


@settings(max_examples=30, deadline=None)
@given(matrices(3, 3), matrices(2, 3))
def test_a_reduction_keeps_what_is_seen(A, C):
    """T A = A_o T, C = C_o T, T of full row rank = rank, and (A_o, C_o) observable."""
    A_o, C_o, T = exact.observable_reduction(A, C)
    found = exact.decide_observable(A, C)
    assert len(T) == exact.rank(T) == found.rank == exact.rank(exact.observability_matrix(A, C))
    if T:
        assert exact.multiply(T, A) == exact.multiply(A_o, T)
        assert exact.multiply(C_o, T) == C
        assert exact.shape(C_o) == (2, found.rank)
        assert exact.decide_observable(A_o, C_o).verdict is PROVED
    for vector in found.unobservable:
        column = exact.transpose((vector,))
        answer = exact.multiply(exact.observability_matrix(A, C), column)
        assert answer == exact.zeros(6, 1)


@settings(max_examples=20, deadline=None)
@given(matrices(2, 2), matrices(2, 2), matrices(2, 2), matrices(1, 2), matrices(4, 4))
def test_a_hidden_block_shows_its_polynomial_in_any_coordinates(A1, A2, coupling, C1, S):
    """Kalman's form, transformed: the unobservable polynomial is that of A2 times what C1 misses of
    A1."""
    if exact.rank(S) < 4:
        return
    seen = [(*row, 0, 0) for row in A1]
    both = zip(coupling, A2, strict=True)
    hidden = [c + a for c, a in both]
    block = matrix([*seen, *hidden])
    in_coordinates = exact.multiply(block, S)
    A = exact.multiply(exact.inverse(S), in_coordinates)
    C = exact.multiply(matrix([(*C1[0], 0, 0)]), S)
    found = exact.decide_detectable(A, C)
    if exact.decide_observable(A1, C1).verdict is PROVED:
        (a, b), (c, d) = A2
        trace = a + d
        det = a * d - b * c
        assert found.unobservable_polynomial == (1, -trace, det)
        assert (found.verdict is PROVED) == (trace < 0 < det)


def test_shapes_that_do_not_fit_are_refused():
    for name in (
        "observability_matrix",
        "decide_observable",
        "decide_detectable",
        "observable_reduction",
    ):
        function = getattr(exact, name)
        with pytest.raises(ShapeError, match="A must be square"):
            function(exact.zeros(2, 3), exact.zeros(1, 3))
        with pytest.raises(
            ShapeError, match=r"C must have 2 columns, one per row of A \(A is 2x2\)"
        ):
            function(exact.identity(2), exact.zeros(1, 3))
