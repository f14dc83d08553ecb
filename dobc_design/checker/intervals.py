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
At = Callable[[Real], Interval[Real]]  # a function at points
Span = TypeVar("Span", Exact, Floats)  # an interval of one of the two kinds
NOTHING = (0.0, 0.0)
ONE = (1.0, 1.0)

EXACT_BITS = 1536  # a longer rational is enclosed
PRECISION = 256  # bits of an enclosure
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
def outward(lo: Real, hi: Real) -> Interval[Real]:
    """Room for rounding: the next floating-point numbers outside (a result of IEEE arithmetic is at
    most half as far away), or rationals of PRECISION bits."""
    if isinstance(lo, float):
        lo = math.nextafter(lo, -math.inf)
        hi = math.nextafter(hi, math.inf)
        need(-LARGEST < lo <= hi < LARGEST, OUT_OF_RANGE)
        return lo, hi

    # Fractions of any size would be exact, and take for ever
    need(all(x == 0 or abs(magnitude(x)) < 2**15 for x in (lo, hi)), OUT_OF_RANGE)
    # single numbers stay exact as long as the format page asks it
    longest = EXACT_BITS if lo == hi else PRECISION
    return shortened(lo, math.floor, longest), shortened(hi, math.ceil, longest)


def shortened(x: Fraction, rounding: Callable[[Fraction], int], longest: int) -> Fraction:
    """The rational, or with more than ``longest`` bits the one of PRECISION bits on the side of
    ``rounding``."""
    bits = max(x.numerator.bit_length(), x.denominator.bit_length())
    if bits <= longest:
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
        return float(x), float(x)  # exactly
    need(abs(x) < LARGEST, "a number leaves the range of numbers followed here")
    return outward(float(x), float(x))


def like(x: Span, number: Fraction | float) -> Span:
    """A number in the arithmetic of x."""
    end = type(x[0])(number)
    return end, end


def added(x: Span, y: Span) -> Span:
    """x + y; exact where one of the two ends is 0, or their sum."""
    lo = x[0] + y[0]
    hi = x[1] + y[1]
    low, high = outward(lo, hi)
    # IEEE sums are 0 only where the numbers cancel exactly
    if lo and x[0] and y[0]:
        lo = low
    if hi and x[1] and y[1]:
        hi = high
    return lo, hi


def total(parts: Iterable[Floats]) -> Floats:
    """The sum."""
    return reduce(added, parts, (0.0, 0.0))


def negative(x: Span) -> Span:
    """-x."""
    return -x[1], -x[0]


def times(x: Span, y: Span) -> Span:
    """x y; a product of signs that are known keeps its sign."""
    if x[0] == 0 == x[1] or y == (1, 1):
        return x
    if y[0] == 0 == y[1] or x == (1, 1):
        return y
    if x == (-1, -1):
        return negative(y)

    if x[0] >= 0 <= y[0]:
        lo, hi = outward(x[0] * y[0], x[1] * y[1])
    else:
        corners = [a * b for a in x for b in y]
        lo, hi = outward(min(corners), max(corners))
    # what outward steps over 0 comes back
    if (x[0] >= 0 and y[0] >= 0) or (x[1] <= 0 and y[1] <= 0):
        lo = max(lo, lo * 0)
    elif (x[0] >= 0 and y[1] <= 0) or (x[1] <= 0 and y[0] >= 0):
        hi = min(hi, hi * 0)
    return lo, hi


def dot(x: Iterable[Floats], y: Iterable[Floats]) -> Floats:
    """The sum of the products."""
    return total(map(times, x, y))


def divided(x: Span, y: Span) -> Span:
    """x / y."""
    need(y[0] > 0 or y[1] < 0, "a coupling divides by something that may be 0")
    return times(x, outward(1 / y[1], 1 / y[0]))


def power(x: Span, n: int) -> Span:
    """x^n from products, in the order of the binary digits of n."""
    if n < 0:
        return divided(like(x, 1), power(x, -n))
    if n % 2 == 0 and x[0] < 0 < x[1]:  # it is 0 in between
        top = max(-x[0], x[1])
        return top * 0, power((top, top), n)[1]
    if x[0] < x[1]:
        return hull(power((x[0], x[0]), n), power((x[1], x[1]), n))

    # of a single number, or between equal ends
    result = like(x, 1)
    square = x
    while n:
        if n % 2:
            result = times(result, square)
        if n > 1:
            square = times(square, square)
        n //= 2
    return result


def hull(*parts: Span) -> Span:
    """The least interval that holds all parts."""
    return min(part[0] for part in parts), max(part[1] for part in parts)


def halved(box: list[Interval[Real]]) -> list[list[Interval[Real]]]:
    """The two halves of a box, across its widest side."""
    side = max(box, key=lambda each: each[1] - each[0])
    k = box.index(side)
    lo, hi = side
    middle = (lo + hi) / 2
    lower = list(box)
    upper = list(box)
    lower[k] = (lo, middle)
    upper[k] = (middle, hi)
    return [lower, upper]


def absolute(x: Span) -> Span:
    """|x|."""
    return max(x[0], -x[1], x[0] * 0), max(-x[0], x[1])


def growing(at: At[Real]) -> Callable[[Interval[Real]], Interval[Real]]:
    """A nondecreasing function on intervals, from its values at points."""

    def on(x: Interval[Real]) -> Interval[Real]:
        low = at(x[0])
        if x[0] == x[1]:
            return low
        return low[0], at(x[1])[1]

    return on


def odd(at: At[Real]) -> Callable[[Interval[Real]], Interval[Real]]:
    """The same for an odd function, from its values at points z >= 0."""
    return growing(lambda z: at(z) if z >= 0 else negative(at(-z)))


# --- exp, ln and sqrt: the decimal module rounds them correctly, so one unit further is outside
def by_decimal(name: str, x: Span) -> Span:
    """exp, ln or sqrt, all of which are nondecreasing. Rational by the rules of the format page are
    exp 0, ln 1, and roots of squares."""
    lo, hi = x
    exact = rational_value(name, lo)
    if lo == hi and exact is not None:
        return like(x, exact)

    known = {"exp": hi < FAR, "ln": lo > 0, "sqrt": lo >= 0}
    # beyond them the decimal module would return infinity, NaN, or take for ever
    need(known[name], f"a coupling leaves the numbers for which {name} is known")
    kind = type(lo)
    down, up = CONTEXTS[kind]
    # the quotient is rounded in the same direction, since all three grow
    low = down.next_minus(getattr(down, name)(down.divide(*lo.as_integer_ratio())))
    high = up.next_plus(getattr(up, name)(up.divide(*hi.as_integer_ratio())))
    least, most = outward(kind(low), kind(high))
    if name != "ln":
        least = max(least, kind(0))
    return least, most


def rational_value(name: str, x: Fraction | float) -> Fraction | None:
    """exp, ln or sqrt of x where it is rational by these rules, else none."""
    if name == "sqrt":
        top, bottom = x.as_integer_ratio()
        root = Fraction(math.isqrt(max(0, top)), math.isqrt(bottom))
        if x == root**2:
            return root
        return None
    where, value = (0, 1) if name == "exp" else (1, 0)
    if x == where:
        return Fraction(value)
    return None


@odd
def hyperbolic_tangent(z: Real) -> Interval[Real]:
    """tanh, from t = exp(-2 z)."""
    t = by_decimal("exp", (-2 * z, -2 * z))  # a product with 2 is exact
    return divided(added(like(t, 1), negative(t)), added(like(t, 1), t))


@odd
def inverse_sine(z: Real) -> Interval[Real]:
    """asinh, log(z + sqrt(1 + z^2))."""
    point = (z, z)
    square = times(point, point)
    root = by_decimal("sqrt", added(like(point, 1), square))
    return by_decimal("ln", added(point, root))


def hyperbolic(x: Interval[Real], cosine: bool) -> Interval[Real]:
    """cosh or sinh; cosh grows with |x|."""

    def at(z: Real) -> Interval[Real]:
        rising = by_decimal("exp", (z, z))
        falling = by_decimal("exp", (-z, -z))
        if not cosine:
            falling = negative(falling)
        return times(like(rising, 0.5), added(rising, falling))

    return growing(at)(absolute(x) if cosine else x)


# --- sin, cos, tan and atan: series in integers, in units of 2^-bits
def whole(x: Fraction | float, bits: int) -> int:
    """x in units of 2^-bits, within one unit."""
    top, bottom = x.as_integer_ratio()
    return (top << bits) // bottom


def around(value: int, slack: int, bits: int, kind: type[Real]) -> Interval[Real]:
    """A value in units of 2^-bits, give or take 2^slack of them."""
    unit = 1 << bits
    off = 1 << slack
    # by a power of 2: rounded once
    return outward(kind(value - off) / unit, kind(value + off) / unit)


def arctangent_of(z: int, bits: int) -> int:
    """atan of z >= 0: atan x = 2 atan(x / (1 + sqrt(1 + x^2))), three times, makes x < 1/5; then
    the Taylor series. Every one of the less than 1000 operations is off by at most two units."""
    unit = 1 << bits
    for _ in range(3):
        z = z * unit // (unit + math.isqrt(unit * unit + z * z))
    square = z * z >> bits
    total = z
    term = z
    n = 1
    while term:
        n += 2
        term = term * square >> bits
        total += term // n if n % 4 == 1 else -term // n
    return 8 * total


@odd
def arctangent(z: Real) -> Interval[Real]:
    """atan."""
    if z == 0:
        return z, z
    kind = type(z)
    bits = PLACES[kind]
    return around(arctangent_of(whole(z, bits), bits), SLACK, bits, kind)


@lru_cache(maxsize=1000)
def half_turn(bits: int) -> int:
    """pi in units of 2^-bits."""
    return 4 * arctangent_of(1 << bits, bits)


_PLACES = PLACES[Fraction]
PI: Exact = around(half_turn(_PLACES), SLACK, _PLACES, Fraction)


def sine_of(z: int, bits: int) -> int:
    """The Taylor series, once whole turns are taken off."""
    half = half_turn(bits)
    turns = (z + half) // (2 * half)
    z -= turns * 2 * half
    sign = -1 if z < 0 else 1
    z = abs(z)
    square = z * z >> bits
    term = z
    total = z
    n = 1
    while term:
        n += 2
        term = (term * square >> bits) // (n * (n - 1))
        total += term if n % 4 == 1 else -term
    return sign * total


def wave(x: Span, quarter: int) -> Span:
    """Sine (quarter 0) or cosine (quarter 1): the values at the ends, and 1 or -1 where it turns
    between them. For |x| up to 2^more there are 2^more turns, whose error is made up for by as many
    more places."""
    if x[0] == 0 == x[1]:
        return like(x, quarter)
    kind = type(x[0])
    more = max(1, 1 + magnitude(x[0]), 1 + magnitude(x[1]))
    # pi needs a place more for every doubling of x
    need(more < 500, "a coupling takes the sine of something too large")
    bits = PLACES[kind] + more
    slack = 1 << SLACK + more
    half = half_turn(bits)
    # cos x = sin (x + pi/2)
    low, high = (whole(end, bits) + quarter * half // 2 for end in x)
    parts = []
    for end in {low, high}:
        parts.append(around(sine_of(end, bits), SLACK + more, bits, kind))
    # it turns at (k + 1/2) pi; wider by slack is no harm
    first = -((half // 2 - low + slack) // half)
    last = (high + slack - half // 2) // half
    for k in range(first, last + 1)[:2]:  # two of them have both values
        parts.append(like(x, -1 if k % 2 else 1))
    lo, hi = hull(*parts)
    # no sine is beyond 1, whatever rounding says
    return max(lo, kind(-1)), min(hi, kind(1))


def tangent(x: Interval[Real]) -> Interval[Real]:
    """tan, where the cosine has no zero."""
    lo, hi = wave(x, 1)
    # between two zeros of the cosine the tangent grows
    need(lo > 0 or hi < 0, "a coupling takes a tangent where there may be none")

    def at(z: Real) -> Interval[Real]:
        return divided(wave((z, z), 0), wave((z, z), 1))

    return growing(at)(x)
