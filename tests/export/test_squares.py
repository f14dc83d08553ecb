"""LDL' with its factors kept: it multiplies out, and stops where there is none."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.rocq import Square, factor
from dobc_design.verdict import Verdict


@st.composite
def symmetric(draw):
    size = draw(st.integers(1, 5))
    entry = st.fractions(-3, 3, max_denominator=4)
    entries = {(i, j): draw(entry) for i in range(size) for j in range(i, size)}
    lift = draw(st.integers(0, 12))
    return SparseSymmetric(size, {(i, j): x + (lift if i == j else 0) for (i, j), x in entries.items()})


def multiplied_out(squares, size):
    entries = {}
    for square in squares:
        column = {square.pivot: Fraction(1), **square.others}
        for i, x in column.items():
            for j, y in column.items():
                if i <= j:
                    entries[i, j] = entries.get((i, j), Fraction(0)) + square.weight * x * y
    return SparseSymmetric(size, entries)


@given(symmetric())
def test_factors_exist_exactly_for_positive_definite_matrices_and_multiply_out(M):
    squares = factor(M)
    assert (squares is not None) == (decide_positive_definite(M).verdict is Verdict.PROVED)
    if squares is not None:
        assert multiplied_out(squares, M.size) == M
        pivots = [square.pivot for square in squares]
        assert sorted(pivots) == list(range(M.size))
        for k, square in enumerate(squares):
            assert square.weight > 0
            assert set(square.others) <= set(pivots[k + 1 :])


def test_a_semidefinite_matrix_has_no_factors():
    assert factor(SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(1), (1, 1): Fraction(1)})) is None


def test_a_zero_row_has_no_factors():
    assert factor(SparseSymmetric(2, {(0, 0): Fraction(1)})) is None


def test_the_empty_matrix_has_the_empty_sum():
    assert factor(SparseSymmetric(0, {})) == ()


def test_the_leaves_of_a_star_go_first():
    """Least degree first: no fill-in."""
    leaves = {(i, i): Fraction(1) for i in (1, 2, 3)} | {(0, i): Fraction(1) for i in (1, 2, 3)}
    M = SparseSymmetric(4, {(0, 0): Fraction(4)} | leaves)
    squares = factor(M)
    assert squares == (
        Square(Fraction(1), 1, {0: Fraction(1)}),
        Square(Fraction(1), 2, {0: Fraction(1)}),
        Square(Fraction(2), 0, {3: Fraction(1, 2)}),
        Square(Fraction(1, 2), 3, {}),
    )
