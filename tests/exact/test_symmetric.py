"""Sparse symmetric matrices, in integer arrays and without: the same as their dense forms; vectors
of doubles."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from texts import exact_matrix

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact import (
    IntegerSymmetric,
    SparseSymmetric,
    add,
    from_float,
    identity,
    multiply,
    scale,
)
from dobc_design.exact.symmetric import (
    Doubles,
    both_triangles,
    in_integers,
    least,
    signs_of_product,
)

PLACES = st.tuples(st.integers(0, 4), st.integers(0, 4)).map(lambda p: (min(p), max(p)))
SPARSE = st.dictionaries(PLACES, st.fractions(max_denominator=9)).map(
    lambda e: SparseSymmetric(5, e)
)
WIDE = st.one_of(st.integers(-9, 9), st.integers(-(2**62), 2**62), st.integers(-(2**300), 2**300))


def arrays(size, entries, denominator=1):
    rows, columns = (np.array([e[k] for e in entries], dtype=int) for k in (0, 1))
    values = np.array([e[2] for e in entries], dtype=object)
    return IntegerSymmetric(
        size=size, rows=rows, columns=columns, values=values, denominator=denominator
    )


@settings(max_examples=12)
@given(SPARSE, st.lists(st.fractions(max_denominator=9), min_size=5, max_size=5))
def test_it_says_the_same_as_the_sparse_form(M, v):
    whole = IntegerSymmetric.from_sparse(M)
    assert whole.to_sparse() == M
    assert whole.diagonal() == M.diagonal() == [M.to_dense()[i][i] for i in range(5)]
    assert whole.quadratic_form(v) == M.quadratic_form(v)


@settings(max_examples=30)
@given(st.lists(st.tuples(PLACES, WIDE), max_size=20))
@example([((0, 0), 2**61)] * 5 + [((1, 1), 1)])
@example([((0, 0), -(2**61))] * 5 + [((1, 1), -1)])
def test_what_is_given_twice_for_a_place_is_added_up(given_entries):
    """Arcs between the same agents, in exact integers of any length."""
    total: dict[tuple[int, int], int] = {}
    for place, value in given_entries:
        total[place] = total.get(place, 0) + value
    entries = [(*place, value) for place, value in given_entries]
    M = arrays(5, entries)
    entries = {p: Fraction(x) for p, x in total.items()}
    assert M.to_sparse() == SparseSymmetric(5, entries)
    in_words = M.values.dtype == np.int64
    fits = all(abs(x) < 2**62 for x in total.values())
    assert in_words == fits


@settings(max_examples=30)
@given(st.data(), st.sampled_from([3, 60, 62, 100, 2000]), st.sampled_from([3, 61, 90, 1500]))
def test_signs_of_a_product_are_exact(data, entry_bits, vector_bits):
    """Against Python integers; one row is made to cancel to -1, 0 or 1."""
    n = 4
    numbers = st.integers(-(2**entry_bits) + 1, 2**entry_bits - 1)
    upper = {(i, j): data.draw(numbers) or 1 for i in range(n) for j in range(i, n)}
    head = [data.draw(st.integers(1, 2**vector_bits)) for _ in range(n - 1)]
    v = [*head, 1]
    drawn = data.draw(st.integers(-1, 1))
    others = sum(upper[0, j] * v[j] for j in range(n - 1))
    upper[0, n - 1] = drawn - others
    entries = [(i, j, x) for (i, j), x in upper.items()]
    M = arrays(n, entries)
    rows = both_triangles(M)
    expected = []
    for i in range(n):
        entry = sum(upper.get((min(i, j), max(i, j)), 0) * v[j] for j in range(n))
        expected.append(entry)
    if rows is not None:
        short = max(v) < 2**62
        vector = np.array(v, dtype=np.int64 if short else object)
        signs = signs_of_product(rows, vector)
        expected_signs = [(x > 0) - (x < 0) for x in expected]
        assert signs.tolist() == expected_signs


def test_signs_are_exact_for_numbers_of_any_length():
    """a a - a^2 = 0 with all bits of a set, 8000 of them."""
    a = 2**8000 - 1
    entries = [(0, 0, a), (0, 1, 1), (1, 1, 5)]
    rows = both_triangles(arrays(2, entries))
    assert rows is not None
    for excess in (-1, 0, 1):
        vector = np.array([a, excess - a * a], dtype=object)
        found = signs_of_product(rows, vector)
        assert found[0] == excess


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=6, max_size=6))
def test_floats_are_taken_at_their_exact_value(values):
    """Denormal, huge and zero entries too; Fraction is the oracle."""
    matrix = np.zeros((3, 3))
    matrix[np.triu_indices(3)] = values
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    found = IntegerSymmetric.from_floats(matrix).to_sparse()
    assert found == SparseSymmetric.from_dense(from_float(matrix, None))


def test_rounding_that_weakens_never_helps():
    """Diagonal rounded down, the others away from 0, by less than 2^-bits."""
    M = SparseSymmetric.from_dense(exact_matrix("1/3 1/3; 1/3 -1/3"))
    weak = IntegerSymmetric.weakened(M, bits=2)
    assert weak.to_dense() == exact_matrix("1/4 1/2; 1/2 -1/2")
    entries = {(0, 1): Fraction(-1, 3)}
    negative = SparseSymmetric(2, entries)
    weak = IntegerSymmetric.weakened(negative, bits=2)
    assert weak.to_dense() == exact_matrix("0 -1/2; -1/2 0")


def test_a_long_common_denominator_is_not_taken():
    """The first 200 primes have a product of over 512 bits."""
    candidates = [p for p in range(2, 1230) if all(p % q for q in range(2, int(p**0.5) + 1))]
    primes = candidates[:200]
    entries = {}
    for i, p in enumerate(primes):
        entries[i, i] = Fraction(1, p)
    M = SparseSymmetric(200, entries)
    assert in_integers(M) is None
    entries = {}
    for i in range(200):
        entries[i, i] = Fraction(1, i % 7 + 1)
    short = SparseSymmetric(200, entries)
    assert in_integers(short).denominator == 420


def test_zeros_are_dropped_and_it_survives_pickling():
    entries = [(0, 0, 1)]
    found = both_triangles(arrays(2, entries))
    assert found is None
    assert both_triangles(arrays(0, [])) is None
    entries = {(0, 1): 0, (1, 1): 2}
    found = SparseSymmetric(2, entries)
    assert found == SparseSymmetric(2, {(1, 1): 2})
    # Sweeps send problems between processes.
    entries = {(0, 1): Fraction(1, 3)}
    M = SparseSymmetric(2, entries)
    assert pickle.loads(pickle.dumps(M)) == M


@pytest.mark.parametrize("place", [(1, 0), (-1, 0), (0, 2), (2, 2)])
def test_entries_outside_the_upper_triangle_are_refused(place):
    with pytest.raises(ShapeError, match="upper triangle"):
        arrays(2, [(*place, 1)])
    with pytest.raises(ShapeError, match="upper triangle"):
        SparseSymmetric(2, {place: 1})


def test_what_does_not_fit_is_refused():
    here = np.array([0])
    two_values = np.array([1, 2])
    with pytest.raises(ShapeError, match="one length; got 1, 1 and 2"):
        IntegerSymmetric(size=1, rows=here, columns=here, values=two_values)
    entries = [(0, 0, 1)]
    with pytest.raises(SpecError, match="denominator must be at least 1; got 0"):
        arrays(1, entries, denominator=0)
    floats = np.array([1.0])
    halves = [Fraction(1, 2)]
    fractions = np.array(halves, dtype=object)
    cases = (floats, fractions, np.array([True]))
    for values in cases:
        with pytest.raises(SpecError, match="values must be integers"):
            IntegerSymmetric(size=1, rows=here, columns=here, values=values)
    with pytest.raises(ShapeError, match="upper triangle"):
        arrays(-1, [])
    entries = [(0, 0, 1)]
    with pytest.raises(ShapeError, match="must have 1 entries; got 2"):
        arrays(1, entries).quadratic_form([1, 2])
    with pytest.raises(ShapeError, match="must be square"):
        IntegerSymmetric.from_floats(np.zeros((1, 2)))
    nearly_symmetric = [[1.0, 2.0], [2.0 + 2**-51, 1.0]]
    matrix = np.array(nearly_symmetric)
    with pytest.raises(ShapeError, match="must be exactly symmetric"):
        IntegerSymmetric.from_floats(matrix)
    with pytest.raises(SpecError, match="must have finite entries"):
        IntegerSymmetric.from_floats(np.array([[np.inf]]))
    entries = [(0, 0, 1)]
    with pytest.raises(ShapeError, match="one size"):
        arrays(2, entries) + arrays(3, [(0, 0, 1)])
    with pytest.raises(ShapeError, match="size must be 0 or more"):
        SparseSymmetric(-1, {})
    with pytest.raises(ShapeError, match="one size; got 2 and 3"):
        SparseSymmetric(2, {}) + SparseSymmetric(3, {})
    with pytest.raises(ShapeError, match="must have 2 entries; got 3"):
        SparseSymmetric(2, {}).quadratic_form([1, 2, 3])
    with pytest.raises(TypeError):
        SparseSymmetric(2, {}) + 1
    not_symmetric = ((1, 2), (3, 1))
    with pytest.raises(
        ShapeError, match=r"P must be exactly symmetric; entries \[0\]\[1\] and \[1\]\[0\]"
    ):
        SparseSymmetric.from_dense(not_symmetric, name="P")
    with pytest.raises(ShapeError, match="must be square"):
        SparseSymmetric.from_dense(((1, 2),))


@settings(max_examples=12)
@given(SPARSE, SPARSE, st.fractions(max_denominator=9))
def test_sums_and_shifts_are_those_of_the_sparse_form(M, N, shift):
    """Of both forms in any order; denominators that differ."""
    whole = IntegerSymmetric.from_sparse(M)
    found = (whole + N).to_sparse()
    assert found == (N + whole).to_sparse() == M + N
    found = (whole + IntegerSymmetric.from_sparse(N)).to_sparse()
    assert found == M + N
    found = whole.shifted(shift).to_sparse()
    assert found == M.shifted(shift)
    assert whole.negated().to_sparse() == M.negated()
    assert whole.entries == M.entries


@settings(max_examples=12)
@given(SPARSE, st.lists(st.integers(0, 4), unique=True))
def test_some_rows_and_columns_in_their_order(M, rows):
    full = M.to_dense()
    part = []
    for i in rows:
        part.append([M.to_dense()[i][j] for j in rows])
    restricted = IntegerSymmetric.from_sparse(M).restricted(rows).to_dense()
    found = [list(row) for row in restricted]
    assert found == part
    found = [list(row) for row in M.restricted(rows).to_dense()]
    assert found == part
    assert len(full) == 5


@settings(max_examples=12)
@given(SPARSE, SPARSE, st.fractions(max_denominator=9))
def test_operations_agree_with_the_dense_ones(M, N, c):
    """Dense rational arithmetic is the oracle."""
    assert SparseSymmetric.from_dense(M.to_dense()) == M
    found = (M + N).to_dense()
    assert found == add(M.to_dense(), N.to_dense())
    found = M.scaled(c).to_dense()
    assert found == scale(c, M.to_dense())
    assert M.negated() + M == SparseSymmetric(5, {})
    found = M.shifted(c).to_dense()
    assert found == add(M.to_dense(), scale(c, identity(5)))


@settings(max_examples=12)
@given(SPARSE, st.lists(st.fractions(max_denominator=9), min_size=5, max_size=5))
def test_the_quadratic_form_is_the_product(M, v):
    column = tuple((x,) for x in v)
    image = multiply(M.to_dense(), column)
    expected = multiply((tuple(v),), image)[0][0]
    assert M.quadratic_form(v) == expected


def test_doubles_are_exact_frozen_and_equal_by_value():
    smallest = -(2.0**-1074)
    numbers = [0.1, 2.0, smallest]
    v = Doubles(np.array(numbers))
    expected = [Fraction(0.1), 2, Fraction(-1, 2**1074)]
    assert list(v) == expected
    assert v[0] == v[-3] == Fraction(0.1) != Fraction(1, 10)
    expected = (2, Fraction(-1, 2**1074))
    assert v[1:] == expected
    assert len(v) == 3
    assert least(v) == v[2]
    assert least(tuple(v)) == v[2]
    source = np.array([1.0, 2.0])
    v = Doubles(source)
    source[0] = 9.0
    assert v[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        v.array[0] = 3.0
    one, same, other = (Doubles(np.array(x)) for x in ([1.0, 2.0], [1.0, 2.0], [1.0, 3.0]))
    comparisons = (one == same, one == other, hash(one) == hash(same))
    assert comparisons == (True, False, True)


@pytest.mark.parametrize("array", [np.array([1.0, np.nan]), np.array([np.inf]), np.ones((2, 2))])
def test_what_is_no_finite_vector_is_refused(array):
    with pytest.raises(ValueError, match="one dimension and finite entries"):
        Doubles(array)
