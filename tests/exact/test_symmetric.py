"""Sparse symmetric matrices: the same as their dense forms. Vectors of doubles: the rationals that they are."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dobc_design.errors import ShapeError
from dobc_design.exact import SparseSymmetric, add, identity, multiply, scale, to_float
from dobc_design.exact.symmetric import Doubles, least

PLACES = st.tuples(st.integers(0, 4), st.integers(0, 4)).map(lambda p: (min(p), max(p)))
SPARSE = st.dictionaries(PLACES, st.fractions(max_denominator=9)).map(lambda e: SparseSymmetric(5, e))


@given(SPARSE, SPARSE, st.fractions(max_denominator=9))
def test_operations_agree_with_the_dense_ones(M, N, c):
    """Dense rational arithmetic is the oracle."""
    assert SparseSymmetric.from_dense(M.to_dense()) == M
    assert (M + N).to_dense() == add(M.to_dense(), N.to_dense())
    assert M.scaled(c).to_dense() == scale(c, M.to_dense())
    assert M.negated() + M == SparseSymmetric(5, {})
    assert M.shifted(c).to_dense() == add(M.to_dense(), scale(c, identity(5)))


@given(SPARSE, st.lists(st.fractions(max_denominator=9), min_size=5, max_size=5))
def test_the_quadratic_form_is_the_product(M, v):
    """v' M v by dense multiplication."""
    column = tuple((x,) for x in v)
    assert M.quadratic_form(v) == multiply((tuple(v),), multiply(M.to_dense(), column))[0][0]


@given(SPARSE)
def test_triplets_fill_both_triangles(M):
    """The floats of the full matrix, each place once."""
    rows, columns, values = M.triplets()
    full = np.zeros((5, 5))
    np.add.at(full, (rows, columns), values)
    assert (full == to_float(M.to_dense())).all()
    assert len(set(zip(rows.tolist(), columns.tolist(), strict=True))) == len(values)


def test_zeros_are_dropped():
    """Equal matrices are equal objects."""
    assert SparseSymmetric(2, {(0, 1): Fraction(0), (1, 1): Fraction(2)}) == SparseSymmetric(2, {(1, 1): Fraction(2)})


def test_it_survives_pickling():
    """Sweeps send problems between processes."""
    M = SparseSymmetric(2, {(0, 1): Fraction(1, 3)})
    assert pickle.loads(pickle.dumps(M)) == M


@pytest.mark.parametrize("place", [(1, 0), (-1, 0), (0, 2), (2, 2)])
def test_entries_outside_the_upper_triangle_are_refused(place):
    """Below the diagonal an entry would count twice or be lost."""
    with pytest.raises(ShapeError, match="upper triangle"):
        SparseSymmetric(2, {place: Fraction(1)})


def test_sizes_that_do_not_fit_are_refused():
    """Every error path."""
    with pytest.raises(ShapeError, match="size must be 0 or more"):
        SparseSymmetric(-1, {})
    with pytest.raises(ShapeError, match="one size; got 2 and 3"):
        SparseSymmetric(2, {}) + SparseSymmetric(3, {})
    with pytest.raises(ShapeError, match="must have 2 entries; got 3"):
        SparseSymmetric(2, {}).quadratic_form([1, 2, 3])
    with pytest.raises(TypeError):
        SparseSymmetric(2, {}) + 1


def test_a_dense_matrix_must_be_exactly_symmetric():
    """The error names the places that differ."""
    with pytest.raises(ShapeError, match=r"P must be exactly symmetric; entries \[0\]\[1\] and \[1\]\[0\]"):
        SparseSymmetric.from_dense(((Fraction(1), Fraction(2)), (Fraction(3), Fraction(1))), name="P")
    with pytest.raises(ShapeError, match="must be square"):
        SparseSymmetric.from_dense(((Fraction(1), Fraction(2)),))


def test_entries_are_exact_binary_fractions():
    v = Doubles(np.array([0.1, 2.0, -(2.0**-1074)]))
    assert list(v) == [Fraction(0.1), 2, Fraction(-1, 2**1074)]
    assert v[0] == v[-3] == Fraction(0.1) != Fraction(1, 10)
    assert v[1:] == (2, Fraction(-1, 2**1074))
    assert (len(v), least(v), least(tuple(v))) == (3, v[2], v[2])


def test_the_array_can_neither_be_changed_nor_changes_with_its_source():
    source = np.array([1.0, 2.0])
    v = Doubles(source)
    source[0] = 9.0
    assert v[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        v.array[0] = 3.0


def test_equal_vectors_are_equal_and_hash_alike():
    one, same, other = (Doubles(np.array(x)) for x in ([1.0, 2.0], [1.0, 2.0], [1.0, 3.0]))
    assert (one == same, one == other, hash(one) == hash(same)) == (True, False, True)


@pytest.mark.parametrize("array", [np.array([1.0, np.nan]), np.array([np.inf]), np.ones((2, 2))])
def test_what_is_no_finite_vector_is_refused(array):
    with pytest.raises(ValueError, match="one dimension and finite entries"):
        Doubles(array)
