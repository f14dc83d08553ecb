"""Rational matrices against SymPy, NumPy and closed forms."""

from fractions import Fraction
from random import Random

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from dobc_design import exact
from dobc_design._checks import require_shape, require_square
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import matrix, solve_lyapunov

ENTRIES = st.sampled_from(
    [Fraction(0), Fraction(1), Fraction(-1), Fraction(2), Fraction(1, 2), Fraction(-5, 3)]
)


def matrices(rows, columns):
    row = st.lists(ENTRIES, min_size=columns, max_size=columns).map(tuple)
    return st.lists(row, min_size=rows, max_size=rows).map(tuple)


def to_sympy(M):
    rows = [list(map(sympy.Rational, row)) for row in M]
    return sympy.Matrix(rows)


@pytest.mark.parametrize(
    "bad", [[1, 2], ["12", "34"], "12", 5, None, {1: 2}, [{1: 2}], np.array(1.0), [b"1"]]
)
def test_what_is_no_list_of_rows_is_refused(bad):
    with pytest.raises(ShapeError, match=r"^A must"):
        matrix(bad, name="A")


def test_a_bad_entry_is_named_by_its_place():
    with pytest.raises(SpecError, match=r"exosystem\.A\[1\]\[0\] must be a number"):
        matrix([[1, 2], ["x", 4]], name="exosystem.A")
    with pytest.raises(ShapeError, match="rows of one length"):
        matrix([[1, 2], [3]])


@settings(max_examples=15, deadline=None)
@given(matrices(3, 4), matrices(4, 2), matrices(3, 4))
def test_products_and_sums_agree_with_sympy(M, N, other):
    found = to_sympy(exact.multiply(M, N))
    assert found == to_sympy(M) * to_sympy(N)
    found = to_sympy(exact.add(M, other))
    assert found == to_sympy(M) + to_sympy(other)
    found = exact.subtract(exact.add(M, other), other)
    assert found == M
    found = to_sympy(exact.kronecker(M, N))
    assert found == sympy.kronecker_product(to_sympy(M), to_sympy(N))
    assert exact.transpose(exact.transpose(M)) == M
    found = exact.scale(Fraction(1, 3), M)
    unchanged = exact.multiply(exact.identity(3), M)
    assert found == exact.scale(Fraction(1, 3), unchanged)


@settings(max_examples=15, deadline=None)
@given(matrices(4, 4))
def test_inverse_times_matrix_is_the_identity_unless_singular(M):
    if to_sympy(M).det() == 0:
        with pytest.raises(SpecError, match="must be invertible; it is singular"):
            exact.inverse(M)
    else:
        found = exact.multiply(exact.inverse(M), M)
        assert found == exact.identity(4)


@settings(max_examples=15, deadline=None)
@given(matrices(3, 5) | matrices(5, 3))
def test_nullspace_is_annihilated_and_has_the_missing_dimension(M):
    basis = exact.nullspace(M)
    assert exact.rank(M) == to_sympy(M).rank()
    columns = exact.shape(M)[1]
    nullity = columns - exact.rank(M)
    assert len(basis) == nullity
    for vector in basis:
        found = exact.multiply(M, tuple((x,) for x in vector))
        assert found == exact.zeros(len(M), 1)
    if basis:
        assert exact.rank(basis) == len(basis)


def test_long_and_short_sums_give_the_same_numbers():
    """Above a size the work goes to python-flint; NumPy's integers are the oracle."""
    rng = np.random.default_rng(1)
    G = rng.integers(-9, 10, (14, 12))
    H = rng.integers(-9, 10, (12, 13))
    first = exact.from_float(G, None)
    second = exact.from_float(H, None)
    found = exact.multiply(first, second)
    assert found == exact.from_float(G @ H, None)
    product = G[:, :5]
    low_rank = product @ H[:5]
    low = exact.from_float(low_rank, None)
    assert exact.rank(low) == 5
    reduced, pivots = exact.row_echelon(low)
    assert pivots == tuple(to_sympy(low).rref()[1])
    echelon = to_sympy(low).rref()[0]
    wanted = echelon[:5, :]
    assert to_sympy(reduced) == wanted
    square = exact.from_float(G[:12], None)
    found = exact.multiply(exact.inverse(square), square)
    assert found == exact.identity(12)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match="must have 2 rows"):
        exact.multiply(exact.identity(2), exact.identity(3))
    with pytest.raises(ShapeError, match="one shape"):
        exact.add(exact.identity(2), exact.identity(3))
    with pytest.raises(ShapeError, match="one shape"):
        exact.subtract(exact.identity(2), exact.zeros(2, 3))
    with pytest.raises(ShapeError, match="must be square"):
        exact.inverse(exact.zeros(2, 3))
    with pytest.raises(ShapeError, match="N must have shape"):
        solve_lyapunov(exact.identity(1), exact.identity(2))


def test_symmetry_is_exact_and_entries_beyond_the_floats_are_refused():
    """A difference of one part in 10^400 counts."""
    assert exact.is_symmetric(exact.identity(3))
    second_row = (Fraction(1) + Fraction(1, 10**400), 1)
    nearly_symmetric = ((1, 1), second_row)
    assert not exact.is_symmetric(nearly_symmetric)
    assert not exact.is_symmetric(exact.zeros(2, 3))
    with pytest.raises(SpecError, match=r"below 1\.8e308"):
        exact.to_float(((Fraction(10) ** 400,),))


def test_floats_are_rounded_to_decimals_or_kept_exactly():
    """digits: significant decimals; None: the binary value."""
    array = np.array([[0.1, 1234.5678], [1e-20, -2.0]])
    short = (Fraction(1, 10), 1230)
    long = (Fraction(1, 10**20), -2)
    expected = (short, long)
    assert exact.from_float(array, 3) == expected
    row = exact.from_float(array, None)[0]
    tenth = Fraction(3602879701896397, 2**55)
    assert row[0] == tenth
    found = exact.to_float(exact.from_float(array, None)).tolist()
    assert found == array.tolist()
    step = np.finfo(np.longdouble).eps
    found = exact.from_float(np.array([[np.longdouble(1) + step]]), None)
    assert found[0][0] > 1


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        (np.array([[np.nan]]), "must be finite"),
        (np.array([[1.0, np.inf]]), r"entry \[0\]\[1\] must be finite"),
        (np.array([[True]]), "integers or floats"),
        (np.array([[1j]]), "integers or floats"),
        (np.array([1.0]), "2 dimensions"),
    ],
)
def test_arrays_that_are_no_real_matrices_are_refused(bad, text):
    """np.linalg takes them in silence; this must not."""
    with pytest.raises(SpecError, match=text):
        exact.from_float(bad, None)


@pytest.mark.parametrize("seed", range(12))
def test_the_solution_satisfies_the_equation_exactly_and_is_that_of_scipy(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    rows = []
    for i in range(q):
        row = [r.randint(-4, 4) - (9 if i == j else 0) for j in range(q)]
        rows.append(row)
    F = matrix(rows)
    rows = []
    for _ in range(q):
        rows.append([r.randint(-3, 3) for _ in range(q)])
    root = matrix(rows)
    N = exact.multiply(root, exact.transpose(root))
    X = solve_lyapunov(F, N)
    left = exact.multiply(exact.transpose(F), X)
    right = exact.multiply(X, F)
    lyapunov = exact.add(left, right)
    found = exact.add(lyapunov, N)
    assert found == exact.zeros(q, q)
    F_transposed = exact.to_float(F).T
    right_hand_side = -exact.to_float(N)
    wanted = linalg.solve_continuous_lyapunov(F_transposed, right_hand_side)
    assert exact.to_float(X) == pytest.approx(wanted, rel=1e-9, abs=1e-12)


def test_two_eigenvalues_that_add_up_to_zero_have_no_unique_solution():
    unit = matrix([[1, 0], [0, 1]])
    oscillator = [[0, 1], [-1, 0]]
    found = solve_lyapunov(matrix(oscillator), unit)
    assert found is None
    saddle = [[1, 0], [0, -1]]
    found = solve_lyapunov(matrix(saddle), unit)
    assert found is None
    slow = [Fraction(1, 10**9), 0]
    rows = [slow, [0, -1]]
    found = solve_lyapunov(matrix(rows), unit)
    assert found is not None


def test_a_fitting_matrix_gives_its_shape():
    """None leaves a side free; nested sequences cannot say how many columns no rows have."""
    found = require_shape((), (None, 5), name="T")
    assert found == (0, 0)
    shape_of_three = (1, 2, 3)
    found = require_shape((shape_of_three, (4, 5, 6)), (2, None), name="C")
    assert found == (2, 3)
    column = np.zeros((4, 1))
    found = require_shape(column, (None, 1), name="W")
    assert found == (4, 1)
    square = ((1, 2), (3, 4))
    found = require_square(square, name="A")
    assert found == 2


@pytest.mark.parametrize(
    ("matrix", "wanted", "text"),
    [
        (((1, 2),), (2, 2), r"must have shape \(2, 2\); got shape \(1, 2\)"),
        (((1, 2),), (2, None), r"must have 2 rows; got"),
        (((1, 2),), (None, 1), r"must have 1 column; got"),
        (((1, 2), (3,)), (None, None), r"rows of one length; got 2 in row 1 and 1 in row 2"),
        ((), (1, 0), r"must have shape \(1, 0\); got shape \(0, 0\)"),
    ],
)
def test_a_wrong_shape_is_refused(matrix, wanted, text):
    with pytest.raises(ShapeError, match=text):
        require_shape(matrix, wanted, name="M")
    with pytest.raises(ShapeError, match=r"A must be square, xi' = A xi; got shape \(1, 2\)"):
        require_square(((1, 2),), name="A", because="xi' = A xi")
