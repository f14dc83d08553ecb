"""Characteristic polynomials, Routh's test and root counts against closed forms and other libraries."""

import time
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact import (
    characteristic_polynomial,
    count_right_half_plane,
    decide_hurwitz,
    from_float,
    identity,
    multiply,
    polynomial_text,
    right_half_plane_roots_at_least,
    routh,
    scale,
    subtract,
    zeros,
)
from dobc_design.exact import polynomial as module
from dobc_design.exact.matrix import matrix
from dobc_design.verdict import Verdict

PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED
RATIONALS = st.fractions(min_value=-3, max_value=3, max_denominator=4)


def times(p, q):
    """The product of two polynomials."""
    product = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return tuple(product)


def from_factors(factors):
    """The polynomial of factors, and its number of roots with positive real part."""
    polynomial, right = (Fraction(1),), 0
    for factor, count in factors:
        polynomial, right = times(polynomial, factor), right + count
    return polynomial, right


def real_root(r):
    return (Fraction(1), -r), int(r > 0)


def complex_pair(re, im):
    return (Fraction(1), -2 * re, re * re + im * im), 2 * int(re > 0)


FACTORS = st.lists(
    RATIONALS.map(real_root)
    | st.tuples(RATIONALS, RATIONALS).map(lambda z: complex_pair(*z))
    | RATIONALS.map(lambda im: complex_pair(Fraction(0), im))
    | RATIONALS.map(lambda r: ((Fraction(1), Fraction(0), -r * r), int(r != 0)))
    | st.tuples(RATIONALS, RATIONALS).map(  # a quadruple symmetric to both axes
        lambda z: (times(complex_pair(*z)[0], complex_pair(-z[0], z[1])[0]), 2 * int(z[0] != 0))
    ),
    max_size=5,
).map(from_factors)


@settings(max_examples=120, deadline=None)
@given(FACTORS, st.sampled_from([1, -1, Fraction(2, 7), -5]))
def test_roots_to_the_right_are_counted_exactly(built, factor):
    """Closed form: products of factors with known roots, on the axis, repeated and symmetric ones too."""
    polynomial, right = built
    scaled = tuple(factor * x for x in polynomial)
    assert count_right_half_plane(scaled) == right
    assert right_half_plane_roots_at_least((0, *scaled)) == right


@settings(max_examples=120, deadline=None)
@given(FACTORS)
def test_routh_agrees_with_the_known_roots(built):
    """Hurwitz iff no root to the right of p(s), nor of p(s - d) for a d below every gap to the axis."""
    polynomial, _ = built
    hurwitz = not any(root >= -1e-9 for root in np.roots([float(x) for x in polynomial]).real)
    exact_hurwitz = count_right_half_plane(polynomial) == 0 and not _has_axis_root(polynomial)
    assert (routh(polynomial).verdict is PROVED) == exact_hurwitz
    if len(set(np.sign([float(x) for x in polynomial]))) > 1:  # a sign other than + decides by itself
        assert routh(polynomial).verdict is REFUTED
    elif exact_hurwitz:
        assert hurwitz or min(abs(np.roots([float(x) for x in polynomial]).real)) < 1e-3


def _has_axis_root(polynomial):
    """Oracle by SymPy: gcd of real and imaginary part of p(iw) has a real root."""
    w = sympy.symbols("w", real=True)
    p = sum(
        sympy.Rational(x.numerator, x.denominator) * (sympy.I * w) ** (len(polynomial) - 1 - n)
        for n, x in enumerate(polynomial)
    )
    real, imaginary = sympy.expand(p).as_real_imag()
    common = sympy.gcd(sympy.Poly(real, w), sympy.Poly(imaginary, w))
    return not common.is_ground and sympy.Poly(common, w).count_roots() > 0


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(-9, 9), min_size=1, max_size=8))
def test_any_polynomial_agrees_with_floating_roots_away_from_the_axis(coefficients):
    """np.roots is the oracle where no root is near the imaginary axis."""
    if not any(coefficients):
        return
    roots = np.roots(coefficients)
    if all(abs(roots.real) > 1e-4):
        assert count_right_half_plane(coefficients) == (roots.real > 0).sum()
        assert (routh(coefficients).verdict is PROVED) == all(roots.real < 0)


@pytest.mark.parametrize(
    ("coefficients", "column", "failing"),
    [
        ((1, 3, 3, 1), (1, 3, Fraction(8, 3), 1), None),
        ((2, 6, 6, 2), (1, 3, Fraction(8, 3), 1), None),
        ((-1, -3, -3, -1), (1, 3, Fraction(8, 3), 1), None),
        ((0, 0, 1, 2), (1, 2), None),
        ((5,), (1,), None),
        ((1, 0), (1, 0), 1),
        ((1, 0, 4), (1, 0), 1),
        ((1, 1, 1, 1), (1, 1, 0), 2),
        ((1, 1, 2, 8), (1, 1, -6), 2),
        ((1, -1), (1, -1), 1),
        ((1, 2, 1, 2, 0), (1, 2, 0), 2),
        ((1, 2, 3, 0), (1, 2, 3, 0), 3),
    ],
)
def test_the_first_column_of_known_tables(coefficients, column, failing):
    """By hand; the first entry <= 0 ends the table and refutes (theory, section 3)."""
    table = routh(coefficients)
    assert (table.first_column, table.failing_row) == (column, failing)
    assert table.verdict is (PROVED if failing is None else REFUTED)


def test_a_margin_of_ten_to_the_minus_fifty_decides():
    """(s + 1)(s^2 + d s + 1): Hurwitz iff d > 0."""
    tiny = Fraction(1, 10**50)
    for d, verdict in ((tiny, PROVED), (Fraction(0), REFUTED), (-tiny, REFUTED)):
        assert routh(times((1, 1), (1, d, 1))).verdict is verdict
    assert count_right_half_plane(times((1, 1), (1, -tiny, 1))) == 2
    assert count_right_half_plane(times((1, 1), (1, 0, 1))) == 0


def test_the_zero_polynomial_is_refused():
    """Every number is a root of it."""
    for function in (routh, count_right_half_plane, right_half_plane_roots_at_least):
        with pytest.raises(SpecError, match="a coefficient that is not 0"):
            function((0, 0))
        with pytest.raises(SpecError, match="a coefficient that is not 0"):
            function(())


MATRICES = st.lists(st.lists(RATIONALS, min_size=4, max_size=4), min_size=4, max_size=4).map(matrix)


@settings(max_examples=50, deadline=None)
@given(MATRICES)
def test_the_characteristic_polynomial_agrees_with_sympy_and_flint(A):
    """Two independent oracles, and Cayley and Hamilton."""
    expected = sympy.Matrix([[sympy.Rational(x.numerator, x.denominator) for x in row] for row in A])
    found = characteristic_polynomial(A)
    assert found == module._by_flint(A)
    assert [sympy.Rational(x.numerator, x.denominator) for x in found] == expected.charpoly().all_coeffs()
    total = zeros(4, 4)
    for x in found:
        total = subtract(multiply(total, A), scale(-x, identity(4)))
    assert total == zeros(4, 4)


@pytest.mark.parametrize("size", [1, 8, 9, 15])
def test_both_methods_give_the_same_polynomial(size):
    """Faddeev and LeVerrier below 9, python-flint from 9 on."""
    A = from_float(np.random.default_rng(size).integers(-9, 10, (size, size)), None)
    assert characteristic_polynomial(A) == module._by_traces(A) == module._by_flint(A)


def test_the_companion_matrix_gives_its_polynomial_back():
    """Closed form."""
    A = matrix([[0, 1, 0], [0, 0, 1], [-6, -11, -6]])
    assert characteristic_polynomial(A) == (1, 6, 11, 6)
    assert decide_hurwitz(A).verdict is PROVED
    assert decide_hurwitz(matrix([[0, 1, 0], [0, 0, 1], [-66, -11, -6]])).verdict is REFUTED


def test_the_papers_observer_has_its_printed_polynomial():
    """Theory, section 9: eigenvalues of A - W C are -8/5 +- (2/5) sqrt(39) i, so s^2 + 16/5 s + 44/5."""
    A, C, W = matrix([[0, 2], [-2, 0]]), matrix([[1, 0]]), matrix([["16/5"], ["12/5"]])
    closed = subtract(A, multiply(W, C))
    assert characteristic_polynomial(closed) == (1, Fraction(16, 5), Fraction(44, 5))
    assert decide_hurwitz(closed).verdict is PROVED
    assert decide_hurwitz(A).verdict is REFUTED
    assert decide_hurwitz(subtract(A, multiply(scale(-1, W), C))).verdict is REFUTED


def test_the_papers_omega_has_eigenvalues_minus_two_and_four_thirds():
    """Theory, section 9: Omega0 = [[-1, 1/3], [1/3, -1]]."""
    A, C = matrix([[0, 2], [-2, 0]]), matrix([[1, 0]])
    P, W = matrix([["1/2", "-1/4"], ["-1/4", "1/3"]]), matrix([["16/5"], ["12/5"]])
    Q = multiply(P, W)
    assert Q == ((1,), (0,))
    half = subtract(multiply(P, A), multiply(Q, C))
    omega = subtract(half, scale(-1, tuple(zip(*half, strict=True))))
    assert omega == matrix([[-1, "1/3"], ["1/3", -1]])
    assert characteristic_polynomial(omega) == times((1, Fraction(2, 3)), (1, Fraction(4, 3)))


def test_matrices_that_are_not_square_are_refused_and_none_is_hurwitz():
    """The empty matrix has no eigenvalue."""
    with pytest.raises(ShapeError, match="A must be square"):
        characteristic_polynomial(zeros(2, 3))
    assert characteristic_polynomial(()) == (1,)
    assert decide_hurwitz(()).verdict is PROVED


def test_a_large_matrix_is_decided_in_time():
    """Size 50, both answers; NumPy's eigenvalues are far from the axis."""
    G = np.random.default_rng(2).integers(-9, 10, (50, 50))
    start = time.process_time()
    assert decide_hurwitz(from_float(G - 80 * np.eye(50, dtype=int), None)).verdict is PROVED
    polynomial = characteristic_polynomial(from_float(G, None))
    assert count_right_half_plane(polynomial) == (np.linalg.eigvals(G).real > 0).sum()
    assert time.process_time() - start < 20


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [
        ((1, 0, 4), "s^2 + 4"),
        ((1, 0), "s"),
        ((1,), "1"),
        ((), "0"),
        ((0, 0), "0"),
        ((-1, Fraction(-1, 2), 1, -1), "-s^3 - 1/2 s^2 + s - 1"),
        ((Fraction(16, 5), 0, 0), "16/5 s^2"),
    ],
)
def test_polynomials_read_as_in_the_book(coefficients, text):
    """Theory, section 9: two equal oscillators seen as one leave s^2 + 4."""
    assert polynomial_text(coefficients) == text
    assert polynomial_text((1, 1), "z") == "z + 1"
