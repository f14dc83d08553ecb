"""Characteristic polynomials, Routh's test and root counts against closed forms and other
libraries."""

from fractions import Fraction
from functools import reduce
from random import Random

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design import exact
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import matrix
from dobc_design.exact.polynomial import (
    cone_image,
    decide_images,
    disk_image,
    has_root_up_to_zero,
    reflected,
    shifted,
)
from dobc_design.verdict import Verdict

PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED
RATIONALS = st.fractions(min_value=-3, max_value=3, max_denominator=4)


def numbers(text) -> tuple[Fraction, ...]:
    """The rationals between blanks: coefficients, the leading one first."""
    return tuple(map(Fraction, text.split()))


def times(p, q):
    length = len(p) + len(q) - 1
    product = [Fraction(0)] * length
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            product[i + j] += x * y
    return tuple(product)


def product(*factors) -> tuple[Fraction, ...]:
    return reduce(times, factors, (1,))


def from_factors(factors):
    """The polynomial of factors, and its numbers of roots with positive real part and on the
    imaginary axis."""
    polynomial = (1,)
    roots = []
    for factor, parts in factors:
        polynomial = times(polynomial, factor)
        roots.extend(parts)
    right = sum(re > 0 for re in roots)
    return polynomial, right, roots.count(0)


def real_root(r):
    """A factor, and the real parts of its roots."""
    return (1, -r), (r,)


def complex_pair(re, im):
    constant = re * re + im * im
    return (1, -2 * re, constant), (re, re)


def quadruple(re, im):
    """Symmetric to both axes."""
    right, _ = complex_pair(re, im)
    left, _ = complex_pair(-re, im)
    return times(right, left), (re, re, -re, -re)


ANYWHERE = st.builds(complex_pair, RATIONALS, RATIONALS)
ON_AXIS = st.builds(complex_pair, st.just(0), RATIONALS)
OPPOSITE = RATIONALS.map(lambda r: ((1, 0, -r * r), (r, -r)))
SYMMETRIC = st.builds(quadruple, RATIONALS, RATIONALS)
FACTOR = RATIONALS.map(real_root) | ANYWHERE | ON_AXIS | OPPOSITE | SYMMETRIC
FACTORS = st.lists(FACTOR, max_size=5).map(from_factors)


@settings(max_examples=20, deadline=None)
@given(FACTORS, st.sampled_from([1, -1, Fraction(2, 7), -5]))
def test_roots_to_the_right_are_counted_exactly_and_routh_agrees(built, factor):
    """Closed form: products of factors with known roots, on the axis, repeated and symmetric ones
    too."""
    polynomial, right, on_axis = built
    scaled = tuple(factor * x for x in polynomial)
    assert exact.count_right_half_plane(scaled) == right
    assert exact.count_right_half_plane((0, *scaled)) == right
    assert (exact.routh(scaled).verdict is PROVED) == (right == on_axis == 0)


@pytest.mark.parametrize(
    ("coefficients", "column", "failing"),
    [
        ("1 3 3 1", "1 3 8/3 1", None),
        ("2 6 6 2", "1 3 8/3 1", None),
        ("-1 -3 -3 -1", "1 3 8/3 1", None),
        ("0 0 1 2", "1 2", None),
        ("5", "1", None),
        ("1 0", "1 0", 1),
        ("1 0 4", "1 0", 1),
        ("1 1 1 1", "1 1 0", 2),
        ("1 1 2 8", "1 1 -6", 2),
        ("1 -1", "1 -1", 1),
        ("1 2 1 2 0", "1 2 0", 2),
        ("1 2 3 0", "1 2 3 0", 3),
    ],
)
def test_the_first_column_of_known_tables(coefficients, column, failing):
    """By hand; the first entry <= 0 ends the table and refutes (theory, section 3)."""
    table = exact.routh(numbers(coefficients))
    assert table.first_column == numbers(column)
    assert table.failing_row == failing
    assert table.verdict is (PROVED if failing is None else REFUTED)


def test_a_margin_of_ten_to_the_minus_fifty_decides():
    """(s + 1)(s^2 + d s + 1): Hurwitz iff d > 0."""
    tiny = Fraction(1, 10**50)
    for d, verdict in ((tiny, PROVED), (0, REFUTED), (-tiny, REFUTED)):
        coefficients = times((1, 1), (1, d, 1))
        found = exact.routh(coefficients)
        assert found.verdict is verdict
    coefficients = times((1, 1), (1, -tiny, 1))
    found = exact.count_right_half_plane(coefficients)
    assert found == 2
    coefficients = times((1, 1), (1, 0, 1))
    found = exact.count_right_half_plane(coefficients)
    assert found == 0


def test_the_zero_polynomial_and_matrices_that_are_not_square_are_refused():
    for function in (exact.routh, exact.count_right_half_plane):
        with pytest.raises(SpecError, match="a coefficient that is not 0"):
            function((0, 0))
        with pytest.raises(SpecError, match="a coefficient that is not 0"):
            function(())
    with pytest.raises(ShapeError, match="A must be square"):
        exact.characteristic_polynomial(exact.zeros(2, 3))
    assert exact.characteristic_polynomial(()) == (1,)
    assert exact.decide_hurwitz(()).verdict is PROVED


MATRICES = st.lists(st.lists(RATIONALS, min_size=4, max_size=4), min_size=4, max_size=4).map(matrix)


@settings(max_examples=10, deadline=None)
@given(MATRICES)
def test_the_characteristic_polynomial_agrees_with_sympy(A):
    rows = [list(map(sympy.Rational, row)) for row in A]
    expected = sympy.Matrix(rows)
    found = exact.characteristic_polynomial(A)
    found_coefficients = list(map(sympy.Rational, found))
    expected_coefficients = expected.charpoly().all_coeffs()
    assert found_coefficients == expected_coefficients
    total = exact.zeros(4, 4)
    for x in found:
        product_with_A = exact.multiply(total, A)
        shift = exact.scale(-x, exact.identity(4))
        total = exact.subtract(product_with_A, shift)
    assert total == exact.zeros(4, 4)


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [
        ("1 0 4", "s^2 + 4"),
        ("1 0", "s"),
        ("1", "1"),
        ("", "0"),
        ("0 0", "0"),
        ("-1 -1/2 1 -1", "-s^3 - 1/2 s^2 + s - 1"),
        ("16/5 0 0", "16/5 s^2"),
    ],
)
def test_polynomials_read_as_in_the_book(coefficients, text):
    """Theory, section 9: two equal oscillators seen as one leave s^2 + 4."""
    assert exact.polynomial_text(numbers(coefficients)) == text
    assert exact.polynomial_text((1, 1), "z") == "z + 1"


def quadratic(re, im) -> tuple[Fraction, ...]:
    """The real polynomial with the roots re +- i im."""
    return complex_pair(Fraction(re), Fraction(im))[0]


@pytest.mark.parametrize(
    ("by", "expected"), [(0, (True, False)), ("-1/1000", (False, False)), ("1/1000", (True, True))]
)
def test_a_shift_decides_the_half_plane_with_and_without_its_border(by, expected):
    """Roots -2 +- 3i and -2: on the line Re s = -2."""
    polynomial = product(quadratic(-2, 3), (1, 2))
    images = [shifted(polynomial, -2 + Fraction(by))]
    found = decide_images(images, degree=3)
    assert found == expected


def test_reflections_and_shifts_move_the_roots():
    coefficients = product((1, -1), (1, -2))
    found = reflected(coefficients)
    assert found == product((1, 1), (1, 2))
    p = (2, -3, Fraction(1, 2), 7)
    cubic = np.poly1d([2, -3, 0.5, 7])
    line = np.poly1d([1, 1.5])
    expected = cubic(line).coefficients
    moved = shifted(p, Fraction(3, 2))
    found = [float(x) for x in moved]
    assert found == pytest.approx(expected.tolist())


def disk(polynomial, radius):
    image = disk_image(polynomial, centre=0, radius=Fraction(radius))
    return decide_images([image], degree=len(polynomial) - 1)


def cone(polynomial, damping):
    image = cone_image(polynomial, damping=Fraction(damping))
    return decide_images([image], degree=2 * (len(polynomial) - 1))


@pytest.mark.parametrize(
    ("shape", "border", "outer", "inner"),
    [(disk, "5", "5.001", "4.999"), (cone, "3/5", "0.59", "0.61")],
)
def test_a_disk_and_a_cone_are_decided_at_their_borders(shape, border, outer, inner):
    """-3 +- 4i lies at the distance 5 from 0, as does -5, and has the damping ratio 3/5 exactly."""
    pair_of_roots = quadratic(-3, 4)
    with_a_real_root = product(quadratic(-3, 4), (1, 5))
    cases = (pair_of_roots, with_a_real_root)
    for polynomial in cases:
        found = [shape(polynomial, size) for size in (border, outer, inner)]
        expected = [(True, False), (True, True), (False, False)]
        assert found == expected


def test_borders_of_disk_and_cone_hold_their_ends():
    """w = 1 goes to infinity under the map: the image loses a degree."""
    for roots in ((2,), (2, 2), (2, 0)):
        polynomial = product(*((1, -Fraction(r)) for r in roots))
        image = disk_image(polynomial, centre=1, radius=1)
        found = decide_images([image], degree=len(roots))
        assert found == (True, False)
    found = cone(quadratic(3, 0), "1/2")
    assert found == (False, False)
    assert cone((1, 0), "1/2") == (True, False)


@pytest.mark.parametrize("seed", range(40))
def test_random_polynomials_agree_with_their_roots(seed):
    """Roots are drawn, the polynomial is multiplied out exactly; none is closer than 1e-9 to a
    border."""
    r = Random(seed)
    roots = []
    polynomial = (1,)
    for _ in range(r.randint(1, 3)):
        re = Fraction(r.randint(-60, 10), 7)
        im = Fraction(r.randint(0, 60), 7)
        roots += [complex(re, im), complex(re, -im)]
        polynomial = times(polynomial, quadratic(re, im))
    damping = Fraction(r.randint(1, 99), 100)
    centre = Fraction(r.randint(-60, 0), 11)
    radius = Fraction(r.randint(1, 90), 11)
    degree = len(polynomial) - 1
    in_cone = all(-z.real >= float(damping) * abs(z) for z in roots)
    in_disk = all(abs(z - float(centre)) <= float(radius) for z in roots)
    found_in_cone, _ = cone(polynomial, damping)
    assert found_in_cone == in_cone
    image = disk_image(polynomial, centre=centre, radius=radius)
    found_in_disk, _ = decide_images([image], degree=degree)
    assert found_in_disk == in_disk


@pytest.mark.parametrize("coefficients", ["1 0", "1 1", "1 2 1", "1 -1 -2", "1 0 0"])
def test_roots_up_to_zero_are_found_by_sturm(coefficients):
    assert has_root_up_to_zero(numbers(coefficients)) is True


@pytest.mark.parametrize("coefficients", ["1 -1", "1 0 1", "5", "1 -3 2", "1 -2 2"])
def test_where_no_root_is_up_to_zero_sturm_finds_none(coefficients):
    assert has_root_up_to_zero(numbers(coefficients)) is False


@pytest.mark.parametrize("seed", range(30))
def test_sturm_agrees_with_the_drawn_roots(seed):
    r = Random(seed)
    reals = []
    for _ in range(r.randint(0, 4)):
        reals.append(Fraction(r.randint(-4, 9), 3))
    factors = [(1, -x) for x in reals]
    factors += (quadratic(r.randint(-3, 3), 1) for _ in range(r.randint(0, 2)))
    assert has_root_up_to_zero(product(*factors)) == any(x <= 0 for x in reals)


def test_a_disk_without_radius_and_a_cone_without_width_are_refused():
    with pytest.raises(SpecError, match="radius of a disk must be > 0"):
        disk_image((1, 1), centre=0, radius=0)
    for damping in (0, 1, 2):
        with pytest.raises(SpecError, match="between 0 and 1"):
            cone_image((1, 1), damping=Fraction(damping))
    with pytest.raises(SpecError, match="coefficient that is not 0"):
        has_root_up_to_zero([Fraction(0)])
