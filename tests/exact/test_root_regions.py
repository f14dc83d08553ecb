"""Half planes, disks and cones of roots, against polynomials whose roots are known."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np
import pytest

from dobc_design.errors import SpecError
from dobc_design.exact.polynomial import (
    cone_image,
    decide_images,
    disk_image,
    has_root_up_to_zero,
    reflected,
    shifted,
)


def quadratic(re, im) -> tuple[Fraction, ...]:
    """The real polynomial with the roots re +- i im."""
    a, b = Fraction(re), Fraction(im)
    return (Fraction(1), -2 * a, a * a + b * b)


def product(*factors) -> tuple[Fraction, ...]:
    result = [Fraction(1)]
    for factor in factors:
        longer = [Fraction(0)] * (len(result) + len(factor) - 1)
        for i, x in enumerate(result):
            for j, y in enumerate(factor):
                longer[i + j] += x * y
        result = longer
    return tuple(result)


@pytest.mark.parametrize(
    ("by", "expected"), [(0, (True, False)), ("-1/1000", (False, False)), ("1/1000", (True, True))]
)
def test_a_shift_decides_the_half_plane_with_and_without_its_border(by, expected):
    """Roots -2 +- 3i and -2: on the line Re s = -2."""
    polynomial = product(quadratic(-2, 3), (Fraction(1), Fraction(2)))
    assert decide_images([shifted(polynomial, -2 + Fraction(by))], degree=3) == expected


def test_a_reflected_polynomial_has_the_negative_roots():
    assert reflected(product((Fraction(1), Fraction(-1)), (Fraction(1), Fraction(-2)))) == product(
        (Fraction(1), Fraction(1)), (Fraction(1), Fraction(2))
    )


@pytest.mark.parametrize(
    ("radius", "expected"), [("5", (True, False)), ("5.001", (True, True)), ("4.999", (False, False))]
)
def test_the_disk_is_decided_at_its_border(radius, expected):
    """-3 +- 4i lies at the distance 5 from 0; so does -5, in the direction of the other end."""
    for polynomial in (quadratic(-3, 4), product(quadratic(-3, 4), (Fraction(1), Fraction(5)))):
        image = disk_image(polynomial, centre=Fraction(0), radius=Fraction(radius))
        assert decide_images([image], degree=len(polynomial) - 1) == expected


def test_a_root_at_the_right_end_of_the_disk_is_on_its_border():
    """w = 1 goes to infinity under the map: the image loses a degree."""
    for roots in ((2,), (2, 2), (2, 0)):
        polynomial = product(*((Fraction(1), -Fraction(r)) for r in roots))
        image = disk_image(polynomial, centre=Fraction(1), radius=Fraction(1))
        assert decide_images([image], degree=len(roots)) == (True, False)


@pytest.mark.parametrize(
    ("damping", "expected"), [("3/5", (True, False)), ("0.59", (True, True)), ("0.61", (False, False))]
)
def test_the_cone_is_decided_at_its_border(damping, expected):
    """-3 +- 4i has the damping ratio 3/5 exactly."""
    for polynomial in (quadratic(-3, 4), product(quadratic(-3, 4), (Fraction(1), Fraction(7)))):
        image = cone_image(polynomial, damping=Fraction(damping))
        assert decide_images([image], degree=2 * (len(polynomial) - 1)) == expected


def test_the_cone_excludes_the_right_half_plane_and_holds_its_tip():
    assert not decide_images([cone_image(quadratic(3, 0), damping=Fraction(1, 2))], degree=4)[0]
    assert decide_images([cone_image((Fraction(1), Fraction(0)), damping=Fraction(1, 2))], degree=2) == (True, False)


@pytest.mark.parametrize("seed", range(40))
def test_random_polynomials_agree_with_their_roots(seed):
    """Roots are drawn, the polynomial is multiplied out exactly; none is closer than 1e-9 to a border."""
    r = Random(seed)
    pairs = [(Fraction(r.randint(-60, 10), 7), Fraction(r.randint(0, 60), 7)) for _ in range(r.randint(1, 3))]
    roots = [complex(a, s * b) for a, b in pairs for s in (1, -1)]
    polynomial = product(*(quadratic(a, b) for a, b in pairs))
    damping, centre = Fraction(r.randint(1, 99), 100), Fraction(r.randint(-60, 0), 11)
    radius = Fraction(r.randint(1, 90), 11)
    degree = len(polynomial) - 1
    in_cone = all(-z.real >= float(damping) * abs(z) for z in roots)
    in_disk = all(abs(z - float(centre)) <= float(radius) for z in roots)
    assert decide_images([cone_image(polynomial, damping=damping)], degree=2 * degree)[0] == in_cone
    assert decide_images([disk_image(polynomial, centre=centre, radius=radius)], degree=degree)[0] == in_disk


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((1, 0), True),
        ((1, 1), True),
        ((1, -1), False),
        ((1, 0, 1), False),
        ((1, 2, 1), True),
        ((5,), False),
        ((1, -3, 2), False),
        ((1, -1, -2), True),
        ((1, 0, 0), True),
        ((1, -2, 2), False),
    ],
)
def test_roots_up_to_zero_are_found_by_sturm(coefficients, expected):
    assert has_root_up_to_zero([Fraction(x) for x in coefficients]) is expected


@pytest.mark.parametrize("seed", range(30))
def test_sturm_agrees_with_the_drawn_roots(seed):
    r = Random(seed)
    reals = [Fraction(r.randint(-4, 9), 3) for _ in range(r.randint(0, 4))]
    factors = [(Fraction(1), -x) for x in reals] + [quadratic(r.randint(-3, 3), 1) for _ in range(r.randint(0, 2))]
    assert has_root_up_to_zero(product(*factors)) == any(x <= 0 for x in reals)


def test_a_disk_without_radius_and_a_cone_without_width_are_refused():
    with pytest.raises(SpecError, match="radius of a disk must be > 0"):
        disk_image((Fraction(1), Fraction(1)), centre=Fraction(0), radius=Fraction(0))
    for damping in (0, 1, 2):
        with pytest.raises(SpecError, match="between 0 and 1"):
            cone_image((Fraction(1), Fraction(1)), damping=Fraction(damping))
    with pytest.raises(SpecError, match="coefficient that is not 0"):
        has_root_up_to_zero([Fraction(0)])


def test_the_shift_is_that_of_numpy():
    p = (Fraction(2), Fraction(-3), Fraction(1, 2), Fraction(7))
    expected = np.poly1d([2, -3, 0.5, 7])(np.poly1d([1, 1.5])).coefficients
    assert [float(x) for x in shifted(p, Fraction(3, 2))] == pytest.approx(expected.tolist())
