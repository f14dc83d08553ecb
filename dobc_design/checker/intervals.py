"""Interval arithmetic, rounded outward: pairs (lo, hi) of rationals or of floating-point numbers.

Every function is written once for both. Rationals are exact as long as they are single numbers of
at most EXACT_BITS bits, or ends of at most PRECISION bits, and are rounded outward to PRECISION
bits otherwise: they serve where slopes at 0 have to be exact. Floating-point numbers serve where
couplings are enclosed on many intervals. The two are never mixed. Sums, products and quotients of
floating-point numbers are those of IEEE 754; exp, ln and sqrt come from the decimal module, the
others from integers.
"""

import decimal
import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import lru_cache, reduce
from typing import TypeVar

from .reading import need

Real = TypeVar("Real", Fraction, float)
Interval = tuple[Real, Real]
Exact = tuple[Fraction, Fraction]
Floats = tuple[float, float]
NOTHING, ONE = (0.0, 0.0), (1.0, 1.0)

EXACT_BITS, PRECISION = 1536, 256  # a longer rational is enclosed; bits of an enclosure
LARGEST = 1e300  # of the floating-point numbers followed here
WAYS = decimal.ROUND_FLOOR, decimal.ROUND_CEILING
CONTEXTS = {
    kind: [decimal.Context(digits, way) for way in WAYS]
    for kind, digits in ((float, 22), (Fraction, 80))
}
# binary places of the integers that sin and atan are made of
PLACES: dict[type, int] = {float: 160, Fraction: 330}
SLACK = 60  # the error of such an integer is at most 2^SLACK units
FAR = 2**14  # exp is followed up to there
OUT_OF_RANGE = "a coupling leaves the range of numbers followed here"


# --- Arithmetic
# --------------------------------------------------------------------------------------------------
def outward(lo: Real, hi: Real) -> Interval[Real]:
    """Room for rounding: the next floating-point numbers outside (a result of IEEE arithmetic is at
    most half as far away), or rationals of PRECISION bits."""
    if isinstance(lo, float):
        lo, hi = math.nextafter(lo, -math.inf), math.nextafter(hi, math.inf)
        need(-LARGEST < lo <= hi < LARGEST, OUT_OF_RANGE)
        return lo, hi

    need(all(x == 0 or abs(magnitude(x)) < 2**15 for x in (lo, hi)), OUT_OF_RANGE)
    longest = EXACT_BITS if lo == hi else PRECISION
    return shortened(lo, math.floor, longest), shortened(hi, math.ceil, longest)


def shortened(x: Fraction, rounding: Callable[[Fraction], int], longest: int) -> Fraction:
    """The rational, or with more than ``longest`` bits the one of PRECISION bits on the side of
    ``rounding``."""
    if max(x.numerator.bit_length(), x.denominator.bit_length()) <= longest:
        return x
    unit = Fraction(2) ** (magnitude(x) - PRECISION)
    return rounding(x / unit) * unit


def magnitude(x: Fraction | float) -> int:
    """About the binary logarithm of |x|: 2^(magnitude - 1) < |x| < 2^(magnitude + 1)."""
    top, bottom = x.as_integer_ratio()
    return top.bit_length() - bottom.bit_length()


@lru_cache(maxsize=100_000)
def enclosed(x: Fraction) -> Floats:
    """A rational between floating-point numbers; Python rounds a quotient of integers correctly."""
    if x.denominator == 1 and abs(x.numerator) < 2**53:
        return float(x), float(x)
    need(abs(x) < LARGEST, "a number leaves the range of numbers followed here")
    return outward(float(x), float(x))


def like(x: Interval[Real], number: Fraction | float) -> Interval[Real]:
    """A number in the arithmetic of x."""
    return type(x[0])(number), type(x[0])(number)


def added(x: Interval[Real], y: Interval[Real]) -> Interval[Real]:
    """x + y; exact where one of the two ends is 0, or their sum."""
    lo, hi = x[0] + y[0], x[1] + y[1]
    low, high = outward(lo, hi)
    return low if lo and x[0] and y[0] else lo, high if hi and x[1] and y[1] else hi


def total(parts: Iterable[Floats]) -> Floats:
    """The sum."""
    return reduce(added, parts, (0.0, 0.0))


def negative(x: Interval[Real]) -> Interval[Real]:
    """-x."""
    return -x[1], -x[0]


def times(x: Interval[Real], y: Interval[Real]) -> Interval[Real]:
    """x y; a product of signs that are known keeps its sign."""
    if x[0] == 0 == x[1] or y == (1, 1):
        return x
    if y[0] == 0 == y[1] or x == (1, 1):
        return y
    if x == (-1, -1):
        return negative(y)

    same, cross = (x[0] * y[0], x[1] * y[1]), (x[0] * y[1], x[1] * y[0])
    lo, hi = outward(*(same if x[0] >= 0 <= y[0] else (min(*same, *cross), max(*same, *cross))))
    if (x[0] >= 0 and y[0] >= 0) or (x[1] <= 0 and y[1] <= 0):
        lo = max(lo, lo * 0)
    elif (x[0] >= 0 and y[1] <= 0) or (x[1] <= 0 and y[0] >= 0):
        hi = min(hi, hi * 0)
    return lo, hi


def dot(x: Iterable[Floats], y: Iterable[Floats]) -> Floats:
    """The sum of the products."""
    return total(map(times, x, y))


def divided(x: Interval[Real], y: Interval[Real]) -> Interval[Real]:
    """x / y."""
    need(y[0] > 0 or y[1] < 0, "a coupling divides by something that may be 0")
    return times(x, outward(1 / y[1], 1 / y[0]))


def power(x: Interval[Real], n: int) -> Interval[Real]:
    """x^n from products, in the order of the binary digits of n."""
    if n < 0:
        return divided(like(x, 1), power(x, -n))
    if n % 2 == 0 and x[0] < 0 < x[1]:
        top = max(-x[0], x[1])
        return top * 0, power((top, top), n)[1]
    if x[0] < x[1]:
        return hull(power((x[0], x[0]), n), power((x[1], x[1]), n))

    result, square = like(x, 1), x
    while n:
        result = times(result, square) if n % 2 else result
        n, square = n // 2, times(square, square) if n > 1 else square
    return result


def hull(*parts: Interval[Real]) -> Interval[Real]:
    """The least interval that holds all parts."""
    return min(part[0] for part in parts), max(part[1] for part in parts)


def absolute(x: Interval[Real]) -> Interval[Real]:
    """|x|."""
    return max(x[0], -x[1], x[0] * 0), max(-x[0], x[1])


def odd(at: Callable[[Real], Interval[Real]]) -> Callable[[Real], Interval[Real]]:
    """The odd function that is ``at`` for z >= 0."""
    return lambda z: at(z) if z >= 0 else negative(at(-z))


def growing(at: Callable[[Real], Interval[Real]], x: Interval[Real]) -> Interval[Real]:
    """A nondecreasing function on x, from its values at points."""
    low = at(x[0])
    return low if x[0] == x[1] else (low[0], at(x[1])[1])


# --- exp, ln and sqrt: the decimal module rounds them correctly, so that one unit further out is
# outside --------------
def by_decimal(name: str, x: Interval[Real]) -> Interval[Real]:
    """exp, ln or sqrt, all of which are nondecreasing. Rational by the rules of the format page are
    exp 0, ln 1, and roots of squares."""
    (lo, hi), kind = x, type(x[0])
    top, bottom = lo.as_integer_ratio()
    root = Fraction(math.isqrt(max(0, top)), math.isqrt(bottom)) if name == "sqrt" else Fraction(0)
    where, value = {"exp": (0, Fraction(1)), "ln": (1, Fraction(0)), "sqrt": (root**2, root)}[name]
    if lo == hi == where:
        return like(x, value)

    known = {"exp": hi < FAR, "ln": lo > 0, "sqrt": lo >= 0}
    need(known[name], f"a coupling leaves the numbers for which {name} is known")
    down, up = CONTEXTS[kind]
    low = down.next_minus(getattr(down, name)(down.divide(*lo.as_integer_ratio())))
    high = up.next_plus(getattr(up, name)(up.divide(*hi.as_integer_ratio())))
    least, most = outward(kind(low), kind(high))
    return least if name == "ln" else max(least, kind(0)), most


def hyperbolic_tangent(x: Interval[Real]) -> Interval[Real]:
    """tanh, from t = exp(-2 |x|)."""

    def at(z: Real) -> Interval[Real]:
        t = by_decimal("exp", (-2 * z, -2 * z))  # a product with 2 is exact
        return divided(added(like(t, 1), negative(t)), added(like(t, 1), t))

    return growing(odd(at), x)


def inverse_sine(x: Interval[Real]) -> Interval[Real]:
    """asinh, log(z + sqrt(1 + z^2)) for z >= 0."""
    return growing(
        odd(
            lambda z: by_decimal(
                "ln",
                added((z, z), by_decimal("sqrt", added(like((z, z), 1), times((z, z), (z, z))))),
            )
        ),
        x,
    )


def hyperbolic(x: Interval[Real], cosine: bool) -> Interval[Real]:
    """cosh or sinh; cosh grows with |x|."""

    def at(z: Real) -> Interval[Real]:
        rising, falling = by_decimal("exp", (z, z)), by_decimal("exp", (-z, -z))
        return times(like(rising, 0.5), added(rising, falling if cosine else negative(falling)))

    return growing(at, absolute(x) if cosine else x)


# --- sin, cos, tan and atan: series in integers, in units of 2^-bits
# --------------------------------------------------
def whole(x: Fraction | float, bits: int) -> int:
    """x in units of 2^-bits, within one unit."""
    top, bottom = x.as_integer_ratio()
    return (top << bits) // bottom


def between(low: int, high: int, bits: int, kind: type[Real]) -> Interval[Real]:
    """From low to high units of 2^-bits."""
    # by a power of 2: rounded once
    return outward(kind(low) / (1 << bits), kind(high) / (1 << bits))


def arctangent_of(z: int, bits: int) -> int:
    """atan of z >= 0: atan x = 2 atan(x / (1 + sqrt(1 + x^2))), three times, makes x < 1/5; then
    the Taylor series. Every one of the less than 1000 operations is off by at most two units."""
    unit = 1 << bits
    for _ in range(3):
        z = z * unit // (unit + math.isqrt(unit * unit + z * z))
    total, term, n = z, z, 1
    while term:
        n, term = n + 2, term * (z * z >> bits) >> bits
        total += term // n if n % 4 == 1 else -term // n
    return 8 * total


def arctangent(x: Interval[Real]) -> Interval[Real]:
    """atan."""

    def at(z: Real) -> Interval[Real]:
        kind, bits, slack = type(z), PLACES[type(z)], 1 << SLACK
        if z == 0:
            return z, z
        value = arctangent_of(whole(z, bits), bits)
        return between(value - slack, value + slack, bits, kind)

    return growing(odd(at), x)


@lru_cache(maxsize=1000)
def half_turn(bits: int) -> int:
    """pi in units of 2^-bits."""
    return 4 * arctangent_of(1 << bits, bits)


PI: Exact = between(
    half_turn(PLACES[Fraction]) - 2**SLACK,
    half_turn(PLACES[Fraction]) + 2**SLACK,
    PLACES[Fraction],
    Fraction,
)


def sine_of(z: int, bits: int) -> int:
    """The Taylor series, once whole turns are taken off."""
    half = half_turn(bits)
    z -= (z + half) // (2 * half) * 2 * half
    sign, z = -1 if z < 0 else 1, abs(z)
    term, total, n, square = z, z, 1, z * z >> bits
    while term:
        n += 2
        term = (term * square >> bits) // (n * (n - 1))
        total += term if n % 4 == 1 else -term
    return sign * total


def wave(x: Interval[Real], quarter: int) -> Interval[Real]:
    """Sine (quarter 0) or cosine (quarter 1): the values at the ends, and 1 or -1 where it turns
    between them. For |x| up to 2^more there are 2^more turns, whose error is made up for by as many
    more places."""
    if x[0] == 0 == x[1]:
        return like(x, quarter)
    kind, more = type(x[0]), max(1, 1 + magnitude(x[0]), 1 + magnitude(x[1]))
    need(more < 500, "a coupling takes the sine of something too large")
    bits, slack = PLACES[kind] + more, 1 << SLACK + more
    half = half_turn(bits)
    low, high = (whole(end, bits) + quarter * half // 2 for end in x)
    # it turns at (k + 1/2) pi; wider by slack is no harm
    first = -((half // 2 - low + slack) // half)
    last = (high + slack - half // 2) // half
    turns = [like(x, (1, -1)[k % 2]) for k in range(first, last + 1)[:2]]
    ends = [sine_of(end, bits) for end in {low, high}]
    lo, hi = hull(*(between(end - slack, end + slack, bits, kind) for end in ends), *turns)
    return max(lo, kind(-1)), min(hi, kind(1))


def tangent(x: Interval[Real]) -> Interval[Real]:
    """tan, where the cosine has no zero."""
    lo, hi = wave(x, 1)
    need(lo > 0 or hi < 0, "a coupling takes a tangent where there may be none")
    return growing(lambda z: divided(wave((z, z), 0), wave((z, z), 1)), x)
