"""Characteristic polynomials, the Routh test and exact root counts, over the rationals.

Theory, section 3: A is Hurwitz iff Routh's first column, started with a positive number, stays
positive; a zero in it means not Hurwitz. Polynomials are coefficient tuples, highest power first.
No root is ever computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from dobc_design._checks import noun, require_square
from dobc_design._show.cards import Shown
from dobc_design.errors import SpecError
from dobc_design.verdict import Decided, Verdict

from .matrix import Matrix
from .number import ONE, ZERO, from_fmpq, quotient_text, to_fmpq, to_fmpq_mat

if TYPE_CHECKING:
    from flint import fmpq_poly

Coefficients = tuple[Fraction, ...]


@noun
class RouthTable(Shown, Decided):
    """Routh's test of one polynomial.  ``first_column`` is for the polynomial made monic, and ends
    with the first entry <= 0. ``verdict`` is PROVED iff every root has a negative real part, else
    REFUTED; ``failing_row`` is the index of that last entry, counted from 0 (row 0 is the leading
    coefficient), or None."""

    first_column: Coefficients
    verdict: Verdict
    failing_row: int | None


def characteristic_polynomial(A: Matrix) -> Coefficients:
    """Return det(s I - A) for A (q, q): q + 1 coefficients, the first is 1. Raises: ShapeError if A
    is not square."""
    if not require_square(A, "A"):
        return (ONE,)
    from_the_lowest = to_fmpq_mat(A).charpoly().coeffs()
    return tuple(map(from_fmpq, reversed(from_the_lowest)))


def routh(coefficients: Sequence[Fraction | int]) -> RouthTable:
    """Decide exactly whether all roots of a polynomial lie in the open left half plane.  Leading
    zeros are dropped; a nonzero constant has no roots, and is PROVED. Raises: SpecError for the
    zero polynomial. Source: Routh 1877; theory, section 3."""
    monic = [to_fmpq(x) for x in _monic(coefficients)]
    column: list[Fraction] = []
    verdict = Verdict.PROVED
    failing_row = None
    # The first entry that is not positive decides; what follows would divide by it.
    for row, entry in enumerate(routh_column(monic)):
        column.append(from_fmpq(entry))
        if entry <= 0:
            verdict = Verdict.REFUTED
            failing_row = row
            break
    return RouthTable(first_column=tuple(column), verdict=verdict, failing_row=failing_row)


def routh_column(coefficients: Sequence[Any]) -> Iterator[Any]:
    """Return the entries of Routh's first column, rationals or intervals, as long as they are asked
    for."""
    upper = coefficients[0::2]
    lower = coefficients[1::2]
    yield upper[0]
    while lower:
        yield lower[0]
        factor = upper[0] / lower[0]
        below = [x - factor * y for x, y in zip(upper[1:], lower[1:], strict=False)]
        upper, lower = lower, [*below, *upper[len(lower) :]]


def decide_hurwitz(A: Matrix) -> RouthTable:
    """Decide exactly whether every eigenvalue of A (q, q), in 1/s, has a negative real part.
    Raises: ShapeError."""
    return routh(characteristic_polynomial(A))


def count_right_half_plane(coefficients: Sequence[Fraction | int]) -> int:
    """Return the exact number of roots with positive real part, each as often as it occurs.

    On the imaginary axis p(iw) = U(w) + i V(w). A Sturm chain of U and V gives the Cauchy index of
    their quotient, which is the surplus of left over right roots; it ends in their greatest common
    divisor, whose roots lie on the axis or come in pairs +-s, and Sturm counts those on the axis.
    Raises: SpecError for the zero polynomial. Source: Gantmacher, Theory of Matrices II, ch. XV.
    """
    monic = _monic(coefficients)
    degree = len(monic) - 1
    # i^k runs through 1, i, -1, -i: split by parity of the power k, with signs alternating.
    real: list[Fraction] = []
    imaginary: list[Fraction] = []
    for n, x in enumerate(monic):
        power = (degree - n) % 4
        real.append(x * (1, 0, -1, 0)[power])
        imaginary.append(x * (0, 1, 0, -1)[power])
    high, low = (real, imaginary) if degree % 2 == 0 else (imaginary, real)
    chain = _sturm_chain(_flint(high), _flint(low))
    # The argument of p(iw) grows by pi (left - right) and falls by pi at each step up of V/U.
    surplus = _real_roots(chain) if degree % 2 else -_real_roots(chain)
    symmetric = chain[-1]
    paired = symmetric.degree()
    on_axis = 0
    # gcd(p, p') has every root of p once less: the others are counted again and again
    while symmetric.degree() > 0:
        chain = _sturm_chain(symmetric, symmetric.derivative())
        on_axis += _real_roots(chain)
        symmetric = chain[-1]
    return (degree - paired - surplus) // 2 + (paired - on_axis) // 2


def polynomial_text(coefficients: Sequence[Fraction | int], variable: str = "s") -> str:
    """Return a polynomial as text, "s^2 - 1/2 s + 4"; "0" for the zero polynomial."""
    text = ""
    degree = len(coefficients) - 1
    for position, value in enumerate(map(Fraction, coefficients)):
        if not value:
            continue
        if text:
            text += " - " if value < 0 else " + "
        elif value < 0:
            text = "-"
        text += _term(abs(value), variable, degree - position)
    return text or "0"


def _term(size: Fraction, variable: str, power: int) -> str:
    if power == 0:
        return quotient_text(size)
    name = variable if power == 1 else f"{variable}^{power}"
    return name if size == 1 else f"{quotient_text(size)} {name}"


def _monic(coefficients: Sequence[Fraction | int]) -> Coefficients:
    values = [Fraction(x) for x in coefficients]
    for start, leading in enumerate(values):
        if leading:
            return tuple(x / leading for x in values[start:])
    raise SpecError("the polynomial must have a coefficient that is not 0.")


def _flint(coefficients: Sequence[Fraction]) -> fmpq_poly:
    from flint import fmpq_poly

    return fmpq_poly([to_fmpq(x) for x in reversed(coefficients)])


def _sturm_chain(first: fmpq_poly, second: fmpq_poly) -> list[fmpq_poly]:
    """Return the chain of negated remainders, but for positive factors; it ends in the greatest
    common divisor."""
    chain = [first]
    while second:
        chain.append(second)
        rest = chain[-2] % second
        # Positive factors change no sign, and monic remainders stay short.
        second = rest / -abs(rest.leading_coefficient()) if rest else rest
    return chain


def _changes(signs: Iterable[bool]) -> int:
    return sum(x != y for x, y in pairwise(signs))


def _changes_at_minus_infinity(chain: list[fmpq_poly]) -> int:
    return _changes((each.leading_coefficient() > 0) == (each.degree() % 2 == 0) for each in chain)


def _real_roots(chain: list[fmpq_poly]) -> int:
    """Return the sign changes that the chain loses from -infinity to infinity: of p and p' the real
    roots of p."""
    at_infinity = _changes(each.leading_coefficient() > 0 for each in chain)
    return _changes_at_minus_infinity(chain) - at_infinity


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


def without_repeats(coefficients: Sequence[Fraction]) -> Coefficients:
    """The monic polynomial with the same roots, each once."""
    p = _flint(coefficients)
    return tuple(map(from_fmpq, reversed((p // p.gcd(p.derivative())).coeffs())))


def disk_image(
    coefficients: Sequence[Any], *, centre: Fraction, radius: Fraction
) -> tuple[Any, ...]:
    """Return the polynomial in v whose roots lie left iff those of p lie in the disk: s = centre +
    radius w.  With w = (v + 1)/(v - 1), |w| < 1 iff Re v < 0. A root w = 1 makes the first
    coefficient 0. Raises: SpecError unless radius > 0."""
    from flint import fmpz_poly

    if radius <= 0:
        raise SpecError(f"the radius of a disk must be > 0; got {radius}.")
    moved = shifted(coefficients, centre)
    degree = len(moved) - 1
    result: list[Any] = [ZERO] * (degree + 1)
    for k, x in enumerate(moved):  # x w^(degree - k), multiplied by (v - 1)^degree
        binomials = fmpz_poly([1, 1]) ** (degree - k) * fmpz_poly([-1, 1]) ** k
        for j, binomial in enumerate(reversed(binomials.coeffs())):
            result[j] = result[j] + x * (radius ** (degree - k) * int(binomial))
    return tuple(result)


def cone_image(coefficients: Coefficients, *, damping: Fraction) -> Coefficients:
    """Return a polynomial of twice the degree whose roots lie left iff those of p lie in the cone.

    The cone holds the s with Re s <= 0 and Re(s)^2 >= damping^2 |s|^2: damping is the cosine of its
    half angle. p rotated by the angle phi with sin phi = damping, times its conjugate, has
    coefficients with cos(k phi); for odd k they hold the root of 1 - damping^2 once, and scaling s
    by that root clears it.
    Raises: SpecError unless 0 < damping < 1.
    """
    if not 0 < damping < 1:
        raise SpecError(f"the damping ratio must lie between 0 and 1; got {damping}.")
    squared = 1 - damping * damping  # of cos phi
    cosines = _cosines(len(coefficients), squared)
    degree = len(coefficients) - 1
    result = [ZERO] * (2 * degree + 1)
    for j, x in enumerate(coefficients):
        for k, y in enumerate(coefficients):
            result[j + k] += x * y * cosines[abs(j - k)]
    # The coefficient of s^i is rational for even i, and a rational times cos phi for odd i.
    scaled: list[Fraction] = []
    for n, x in enumerate(result):
        power = 2 * degree - n
        scaled.append(x * squared ** ((power + 1) // 2))
    return tuple(scaled)


def decide_images(images: Sequence[Coefficients], *, degree: int) -> tuple[bool, bool]:
    """(All roots of all images left or on the axis, all strictly); roots lost to infinity are on
    the border."""
    inside = all(count_right_half_plane(image) == 0 for image in images)
    strictly = inside
    for image in images:
        # A map may send a root to infinity; where it came from is on the border.
        complete = len(image) == degree + 1 and image[0] != 0
        strictly = strictly and complete and routh(image).is_proved
    return inside, strictly


def has_root_up_to_zero(coefficients: Sequence[Fraction]) -> bool:
    """Return whether a polynomial has a real root x <= 0 (Sturm).  Raises: SpecError for the zero
    polynomial."""
    polynomial = _flint(_monic(coefficients))
    # Sturm counts between points that are no roots.
    if polynomial[0] == 0:
        return True
    chain = _sturm_chain(polynomial, polynomial.derivative())
    at_zero = _changes(each[0] > 0 for each in chain if each[0] != 0)
    return _changes_at_minus_infinity(chain) > at_zero


def squared_modulus(coefficients: Sequence[Fraction]) -> Coefficients:
    """Return the polynomial in x = w^2, highest power first, that is |p(jw)|^2."""
    # p(jw) = even(x) + jw odd(x): powers of j give the signs.
    signs = (1, 1, -1, -1)
    rising = [x * signs[k % 4] for k, x in enumerate(reversed(coefficients))]
    even = _flint(rising[0::2][::-1])
    odd = _flint(rising[1::2][::-1])
    total = even * even + _flint([ONE, ZERO]) * odd * odd
    return tuple(map(from_fmpq, reversed(total.coeffs())))


def is_nonnegative(coefficients: Sequence[Fraction], low: Fraction, high: Fraction) -> bool:
    """Return whether p(x) >= 0 for all x in [low, high], 0 <= low <= high (Sturm); roots of even
    order are allowed."""
    polynomial = _flint(coefficients)
    if not polynomial:
        return True
    ends = [to_fmpq(low), to_fmpq(high)]
    if any(polynomial(x) < 0 for x in ends):
        return False
    # p changes its sign at the roots of odd order only; at an end of the interval it may.
    _, factors = polynomial.factor_squarefree()
    odd = _flint([ONE])
    for factor, order in factors:
        if order % 2:
            odd *= factor
    for x in ends:
        if odd(x) == 0:
            odd //= _flint([ONE, -from_fmpq(x)])
    chain = _sturm_chain(odd, odd.derivative())
    lost = [_changes(each(x) > 0 for each in chain if each(x) != 0) for x in ends]
    if lost[0] != lost[1]:
        return False
    # Without a change of sign inside, one point that is no root speaks for all.
    step = (ends[1] - ends[0]) / (polynomial.degree() + 2)
    inside = (ends[0] + step * k for k in range(1, polynomial.degree() + 2))
    return all(polynomial(x) >= 0 for x in inside)


def _cosines(count: int, squared: Fraction) -> list[Fraction]:
    """cos(k phi) for even k and cos(k phi) / cos phi for odd k, from cos^2 phi, by Chebyshev's
    recursion."""
    values = [ONE, ONE]
    for k in range(1, count):
        factor = 2 * squared if k % 2 else Fraction(2)
        values.append(factor * values[k] - values[k - 1])
    return values
