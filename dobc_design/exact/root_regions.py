"""Whether all roots of a real polynomial lie in a half plane, a disk or a cone, decided over the rationals.

Each region is mapped onto the left half plane: by a shift, by w = (v + 1)/(v - 1), or by a rotation. A
closed region holds all roots iff the image has none in the open right half plane, which is counted
exactly; the open region iff Routh's test of the image passes. No root is ever computed.
Polynomials are coefficient tuples, highest power first, monic.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import comb
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.polynomial import Coefficients, _changes, _integers, _sturm_chain, count_right_half_plane, routh
from dobc_design.verdict import Verdict


def shifted(coefficients: Sequence[Any], by: Fraction) -> tuple[Any, ...]:
    """Return p(s + by), by Horner's scheme. Entries may be rationals or intervals."""
    values = list(coefficients)
    for end in range(len(values), 1, -1):
        for k in range(1, end):
            values[k] = values[k] + values[k - 1] * by
    return tuple(values)


def reflected(coefficients: Coefficients) -> Coefficients:
    """Return the monic polynomial whose roots are the negatives of those of a monic p."""
    return tuple(-x if k % 2 else x for k, x in enumerate(coefficients))


def disk_image(coefficients: Sequence[Any], *, centre: Fraction, radius: Fraction) -> tuple[Any, ...]:
    """Return the polynomial in v whose roots lie left iff those of p lie in the disk: s = centre + radius w.

    With w = (v + 1)/(v - 1), |w| < 1 iff Re v < 0. A root w = 1 makes the first coefficient 0.
    Raises: SpecError unless radius > 0.
    """
    if radius <= 0:
        raise SpecError(f"the radius of a disk must be > 0; got {radius}.")
    moved = shifted(coefficients, centre)
    degree = len(moved) - 1
    result: list[Any] = [Fraction(0)] * (degree + 1)
    for k, x in enumerate(moved):  # x w^(degree - k), multiplied by (v - 1)^degree
        factor = radius ** (degree - k)
        for j, binomial in enumerate(_binomials(degree - k, k)):
            result[j] = result[j] + x * (factor * binomial)
    return tuple(result)


def cone_image(coefficients: Coefficients, *, damping: Fraction) -> Coefficients:
    """Return a polynomial of twice the degree whose roots lie left iff those of p lie in the cone.

    The cone holds the s with Re s <= 0 and Re(s)^2 >= damping^2 |s|^2: damping is the cosine of its half
    angle. p rotated by the angle phi with sin phi = damping, times its conjugate, has coefficients with
    cos(k phi); for odd k they hold the root of 1 - damping^2 once, and scaling s by that root clears it.
    Raises: SpecError unless 0 < damping < 1.
    """
    if not 0 < damping < 1:
        raise SpecError(f"the damping ratio must lie between 0 and 1; got {damping}.")
    squared = 1 - damping * damping  # of cos phi
    cosines = _cosines(len(coefficients), squared)
    degree = len(coefficients) - 1
    result = [Fraction(0)] * (2 * degree + 1)
    for j, x in enumerate(coefficients):
        for k, y in enumerate(coefficients):
            result[j + k] += x * y * cosines[abs(j - k)]
    # The coefficient of s^i is rational for even i, and a rational times cos phi for odd i.
    return tuple(x * squared ** ((2 * degree - n + 1) // 2) for n, x in enumerate(result))


def decide_images(images: Sequence[Coefficients], *, degree: int) -> tuple[bool, bool]:
    """Return (all roots of all images left or on the axis, all strictly left), exactly.

    ``degree`` is that of an image that lost no root to infinity; one that did has a root on the border.
    """
    inside = all(count_right_half_plane(image) == 0 for image in images)
    strictly = inside and all(
        len(image) == degree + 1 and image[0] != 0 and routh(image).verdict is Verdict.PROVED for image in images
    )
    return inside, strictly


def has_root_up_to_zero(coefficients: Sequence[Fraction]) -> bool:
    """Return whether a polynomial has a real root x <= 0, by Sturm's theorem.

    Raises: SpecError for the zero polynomial.
    """
    integers = _integers([Fraction(x) for x in coefficients])
    if not integers:
        raise SpecError("the polynomial must have a coefficient that is not 0.")
    if integers[-1] == 0:
        return True
    if len(integers) == 1:
        return False
    degree = len(integers) - 1
    chain = _sturm_chain(integers, _integers([Fraction(x * (degree - n)) for n, x in enumerate(integers[:-1])]))
    at_minus_infinity = _changes([(x[0] > 0) == (len(x) % 2 == 1) for x in chain])
    return at_minus_infinity > _changes([x[-1] > 0 for x in chain if x[-1] != 0])


def _binomials(plus: int, minus: int) -> list[int]:
    """Coefficients of (v + 1)^plus (v - 1)^minus, highest power first."""
    result = [0] * (plus + minus + 1)
    for i in range(plus + 1):
        for j in range(minus + 1):
            result[i + j] += comb(plus, i) * comb(minus, j) * (-1) ** j
    return result


def _cosines(count: int, squared: Fraction) -> list[Fraction]:
    """cos(k phi) for even k and cos(k phi) / cos phi for odd k, from cos^2 phi, by Chebyshev's recursion."""
    values = [Fraction(1), Fraction(1)]
    for k in range(1, count):
        factor = 2 * squared if k % 2 else Fraction(2)
        values.append(factor * values[k] - values[k - 1])
    return values
