"""Interval arithmetic with rational end points, every result rounded outwards, and the
discretisation of x' = A x.

Theory, section 3: enclosures of h' and of the secant gain must contain every true value. Short
rationals stay exact; long ones are rounded outwards to 128 bits. Nothing here is ever too narrow;
it may be too wide.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import field
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, cast

from dobc_design._checks import noun, positional
from dobc_design._show.cards import Told
from dobc_design.errors import SpecError
from dobc_design.verdict import Verdict

from .matrix import Matrix
from .number import (
    ONE,
    ZERO,
    float_above,
    float_below,
    height,
    number_text,
    root_above,
    root_below,
    to_fmpq,
)
from .polynomial import routh_column

if TYPE_CHECKING:
    from flint import arb

Bounds: TypeAlias = tuple[Fraction, Fraction]  # lower and upper

# Significant bits an end point is rounded to.
BITS: Final = 128
# Largest exponent of two kept; without a bound, powers of powers would fill the memory.
MAX_EXPONENT: Final = 65_536


def round_down(value: Fraction, bits: int = BITS) -> Fraction:
    """Return a number <= value of at most ``bits`` significant bits.  Raises: OverflowError below
    -2^65536."""
    if not value:
        return value
    numerator = value.numerator
    denominator = value.denominator
    exponent = numerator.bit_length() - denominator.bit_length()
    if exponent > MAX_EXPONENT:
        if value < 0:
            raise OverflowError(f"a value beyond 2^{MAX_EXPONENT} has no enclosure")
        return Fraction(1 << MAX_EXPONENT)
    if exponent < -MAX_EXPONENT:
        return ZERO if value > 0 else Fraction(-1, 1 << MAX_EXPONENT)
    shift = bits - exponent
    # // rounds down on both sides of 0.
    if shift >= 0:
        return Fraction((numerator << shift) // denominator, 1 << shift)
    return Fraction((numerator // (denominator << -shift)) << -shift)


def round_up(value: Fraction, bits: int = BITS) -> Fraction:
    """Return a number >= value of at most ``bits`` significant bits. Raises: OverflowError for
    values above 2^65536."""
    return -round_down(-value, bits)


def sqrt_bounds(value: Fraction) -> Bounds:
    """Return lower and upper bounds of the root of value >= 0, equal if it is rational."""
    root = Fraction(math.isqrt(value.numerator), math.isqrt(value.denominator))
    if root * root == value:
        return root, root
    exponent = value.numerator.bit_length() - value.denominator.bit_length()
    # So many binary places that BITS digits count, however small the root is.
    shift = max(0, BITS + 2 - exponent // 2)
    return root_below(value, unit=1 << shift), root_above(value, unit=1 << shift)


# Working bits beyond the BITS that are kept, and the longest argument taken at full length.
_GUARD: Final = 32
_MAX_HEIGHT: Final = 4096
# Exponents of two beyond which a ball is not written out.
_MAX_EXPONENT: Final = 4 * MAX_EXPONENT
# flint keeps its precision in one place for all threads.
FLINT: Final = threading.Lock()

# (function, argument) -> value, where that is rational; there are no others (Lindemann).
_EXACT: Final = {("log", 1): 0} | {(name, 0): 1 for name in ("exp", "cos", "cosh")}
_EXACT.update({(name, 0): 0 for name in ("sin", "tan", "atan", "sinh", "tanh")})
_LEAST: Final = {"exp": 0, "sin": -1, "cos": -1, "cosh": 1, "tanh": -1}
# Shifts of the extrema, in multiples of pi.
WAVES: Final = {"sin": 0.5, "cos": 0.0}
_GREATEST: Final = {"sin": 1, "cos": 1, "tanh": 1}


def bounds(name: str, x: Fraction) -> Bounds:
    """Return bounds of exp, log, sin, cos, tan, atan, sinh, cosh or tanh at x, equal where the
    value is rational.  They differ by about 2^-128 of the value, or of 1. Raises: OverflowError if
    there is no finite enclosure."""
    known = _EXACT.get((name, int(x))) if x.denominator == 1 else None
    if known is not None:
        return Fraction(known), Fraction(known)
    from flint import arb, ctx

    # A long argument needs more bits, or its last ones would be lost.
    bits = BITS + _GUARD + min(height(x), _MAX_HEIGHT)
    with FLINT, ctx.workprec(bits):
        lower, upper = _ends(getattr(arb(to_fmpq(x)), name)())
    # No rounding leads beyond what the function takes.
    if name in _LEAST:
        lower = max(lower, Fraction(_LEAST[name]))
    if name in _GREATEST:
        upper = min(upper, Fraction(_GREATEST[name]))
    return lower, upper


@lru_cache(maxsize=1 << 14)
def float_values(name: str, x: float) -> tuple[float, float]:
    """Return floats below and above the value that ``bounds`` encloses at x; infinite where there
    is no enclosure."""
    known = _EXACT.get((name, int(x))) if x in (0, 1) else None
    if known is not None:
        return known, known
    from flint import arb, ctx

    with FLINT:  # workprec alone would take a quarter of the time
        before = ctx.prec
        ctx.prec = 64
        ball = getattr(arb(x), name)()
        low = float(ball.lower())
        high = float(ball.upper())
        ctx.prec = before
    low = math.nextafter(low, -math.inf)  # float() rounds to the nearest
    high = math.nextafter(high, math.inf)
    return max(low, _LEAST.get(name, low)), min(high, _GREATEST.get(name, high))


def pi_bounds(bits: int) -> Bounds:
    """Return bounds of pi that differ by about 2^-bits."""
    from flint import arb, ctx

    with FLINT, ctx.workprec(bits + 4):
        return _ends(arb.pi())


def _ends(ball: arb) -> Bounds:
    # arb.lower() and upper() would round once more; middle and radius are exact numbers.
    if not ball.is_finite():
        raise OverflowError("there is no finite enclosure")
    middle, error = _dyadic(ball.mid())
    radius, more = _dyadic(ball.rad())
    around = radius + error + more
    return middle - around, middle + around


def _dyadic(number: arb) -> Bounds:
    """An exact ball's value and the error of dropping tiny exponents: fmpq() ends the process at
    radii of 2^-15000."""
    mantissa, exponent = map(int, number.man_exp())
    below_one = -exponent - mantissa.bit_length()  # |number| < 2^-below_one
    if exponent < -_MAX_EXPONENT and below_one > 0:
        return ZERO, Fraction(1, 1 << min(_MAX_EXPONENT, below_one))
    if exponent > _MAX_EXPONENT:
        raise OverflowError("there is no finite enclosure")
    if exponent >= 0:
        return Fraction(mantissa << exponent), ZERO
    return Fraction(mantissa, 1 << -exponent), ZERO


# End points of this many bits stay as they are. Points have more: 1e-400 is a number of 1329 bits,
# and a point that becomes an interval can no longer prove that something vanishes.
_KEPT = 256
_KEPT_POINT = 1536
# exp(575) is below 1e250: enclosures stay within what doubles hold, with room for products, so that
# readers of a certificate who calculate in doubles can follow. To the left exp leaves the range of
# 2^-65536, and only nears 0.
_MAX_EXP = 575
_MIN_EXP = -45_000
# Beyond this the argument of a periodic function says nothing about its value.
_MAX_ANGLE: Final = 1 << 2048


class UndefinedError(ArithmeticError):
    """An operation is not defined on a whole interval, or its values are too large to enclose."""


@positional
class Interval(Told):
    """The closed interval from lo to hi; integers are taken as Fractions, by its operators too.
    Raises: SpecError if lo > hi or an end is not an int or Fraction."""

    lo: Fraction
    hi: Fraction
    # The least interval of floats around it, once that was asked for.
    in_floats: Any = field(default=None, init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        if type(self.lo) is not Fraction or type(self.hi) is not Fraction:
            object.__setattr__(self, "lo", _rational(self.lo))
            object.__setattr__(self, "hi", _rational(self.hi))
        if self.lo is not self.hi and self.lo > self.hi:
            raise SpecError(f"interval must have lo <= hi; got {self}.")

    @classmethod
    def point(cls, value: Fraction | int) -> Interval:
        number = Fraction(value)
        return Interval(number, number)

    @property
    def bottom(self) -> Any:
        """The lower end as it is kept, to be compared: a rational, or a float in a subclass."""
        return self.lo

    @property
    def top(self) -> Any:
        return self.hi

    @property
    def is_point(self) -> bool:
        return bool(self.bottom == self.top)

    @property
    def is_narrow(self) -> bool:
        """Whether it is a point, up to rounding."""
        return self.is_point

    @property
    def width(self) -> Fraction:
        return self.hi - self.lo

    @property
    def midpoint(self) -> Fraction:
        return (self.lo + self.hi) / 2

    @property
    def magnitude(self) -> Fraction:
        return max(-self.lo, self.hi)

    @property
    def _mixed(self) -> bool:
        return self.lo.numerator < 0 < self.hi.numerator

    @property
    def sign(self) -> int:
        """1 if no number in the interval is < 0, -1 if none is > 0, else 0."""
        return 1 if self.bottom >= 0 else -1 if self.top <= 0 else 0

    @property
    def is_zero(self) -> bool:
        return not self.bottom and not self.top

    def ends(self) -> tuple[Self, Self]:
        return type(self)(self.bottom, self.bottom), type(self)(self.top, self.top)

    def middle(self) -> Self:
        return self.halves()[0].ends()[1]

    def contains(self, value: Fraction | int | Interval) -> bool:
        other = _interval(value)
        return self.lo <= other.lo and other.hi <= self.hi

    def like(self, other: Interval | Fraction | int) -> Self:
        """Return an interval around the other one with ends of the kind that this one has."""
        return cast("Self", _interval(other))

    def hull(self, other: Interval) -> Self:
        """Return the smallest interval that contains both."""
        y = self.like(other)
        return type(self)(min(self.bottom, y.bottom), max(self.top, y.top))

    def meet(self, other: Interval) -> Self:
        """Return the common part of two enclosures of the same thing."""
        y = self.like(other)
        return type(self)(max(self.bottom, y.bottom), min(self.top, y.top))

    def halves(self) -> tuple[Self, Self]:
        """Return the lower and the upper half; they share the midpoint."""
        middle = (self.bottom + self.top) / 2
        return type(self)(self.bottom, middle), type(self)(middle, self.top)

    def rounded(self, bits: int = BITS) -> Interval:
        """Return an interval around this one with end points of at most ``bits`` bits."""
        return _enclose(self.lo, self.hi, "rounding", self, kept=0, bits=bits)

    def floats(self) -> tuple[float, float]:
        """Return (largest float <= lo, smallest float >= hi)."""
        return float_below(self.lo), float_above(self.hi)

    def __str__(self) -> str:
        return f"[{_brief(self.lo)}, {_brief(self.hi)}]"

    def __neg__(self) -> Self:
        return type(self)(-self.top, -self.bottom)

    def __pos__(self) -> Self:
        return self

    def __abs__(self) -> Self:
        if self.sign:
            return self if self.sign > 0 else -self
        most = max(-self.bottom, self.top)
        return type(self)(0 * most, most)

    def __add__(self, other: Interval | Fraction | int) -> Interval:
        y = _interval(other)
        return _enclose(self.lo + y.lo, self.hi + y.hi, "+", self, y)

    def __sub__(self, other: Interval | Fraction | int) -> Interval:
        return self + -other

    def __mul__(self, other: Interval | Fraction | int) -> Interval:
        x = self
        y = _interval(other)
        if x._mixed:
            x, y = y, x
        if x._mixed:
            low = min(x.lo * y.hi, x.hi * y.lo)
            high = max(x.lo * y.lo, x.hi * y.hi)
            return _enclose(low, high, "*", x, y)
        # x has one sign: two products, chosen by the signs of y's ends, are enough.
        if x.lo.numerator >= 0:
            low = y.lo * (x.lo if y.lo.numerator >= 0 else x.hi)
            high = y.hi * (x.hi if y.hi.numerator >= 0 else x.lo)
        else:
            low = y.hi * (x.lo if y.hi.numerator >= 0 else x.hi)
            high = y.lo * (x.hi if y.lo.numerator >= 0 else x.lo)
        return _enclose(low, high, "*", self, y)

    def __truediv__(self, other: Interval | Fraction | int) -> Interval:
        """Return the quotient. Raises: UndefinedError if the divisor contains 0."""
        y = _interval(other)
        if y.lo.numerator <= 0 <= y.hi.numerator:
            raise UndefinedError(f"division by {y}, which contains 0, is not defined.")
        x = self
        near = y.lo
        far = y.hi
        if y.lo.numerator < 0:  # x / y = -x / -y
            x = -self
            near = -y.hi
            far = -y.lo
        low = x.lo / (far if x.lo.numerator >= 0 else near)
        high = x.hi / (near if x.hi.numerator >= 0 else far)
        return _enclose(low, high, "/", self, y)

    def __pow__(self, exponent: int) -> Interval:
        """Return the integer power; 0 ** 0 is 1. Raises: UndefinedError for a negative one if 0
        lies inside."""
        if exponent < 0:
            return 1 / self**-exponent
        if exponent < 2:
            return self if exponent else self.like(1)
        # Products of one interval with itself would forget that both factors are the same.
        if self.bottom < 0:
            if exponent % 2 == 0:
                return abs(self) ** exponent
            if self.top <= 0:
                return -((-self) ** exponent)
            low, high = self.ends()
            return (low**exponent).hull(high**exponent)
        half = self ** (exponent // 2) if exponent > 3 else self
        square = half * half
        return square * self if exponent % 2 else square

    def increasing(self, name: str) -> Interval:
        """Enclose an increasing function, by the name that python-flint has for it."""
        lower = bounds(name, self.lo)
        upper = lower if self.is_point else bounds(name, self.hi)
        return _enclose(lower[0], upper[1], name, self)

    def wave(self, name: str) -> Interval:
        """Enclose sin or cos: 1 at (k + shift) pi for even k, -1 for odd k, monotone in between."""
        turns = _multiples_of_pi(self, shift=Fraction(WAVES[name]))
        if turns is None or turns[1] > turns[0]:
            return Interval(Fraction(-1), ONE)
        low, high = bounds(name, self.lo)
        if not self.is_point:
            low_there, high_there = bounds(name, self.hi)
            low = min(low, low_there)
            high = max(high, high_there)
        if turns[0] == turns[1]:  # one extremum lies inside, or may
            if turns[0] % 2 == 0:
                high = ONE
            else:
                low = Fraction(-1)
        return _enclose(low, high, name, self)

    def root(self) -> Interval:
        return _enclose(sqrt_bounds(self.lo)[0], sqrt_bounds(self.hi)[1], "sqrt", self)

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Interval | Fraction | int) -> Interval:
        return -self + other

    def __rtruediv__(self, other: Interval | Fraction | int) -> Interval:
        return self.like(other) / self


def pi() -> Interval:
    """Return an interval around pi, about 2^-126 wide."""
    return _enclose(*pi_bounds(BITS + 8), "pi", kept=0)


def exp(x: Interval) -> Interval:
    """Enclose exp. Raises: UndefinedError beyond exp(575), about 1e250."""
    return _growing("exp", x)


def log(x: Interval) -> Interval:
    """Enclose the natural logarithm. Raises: UndefinedError unless x > 0."""
    if x.lo <= 0:
        raise UndefinedError(f"log is not defined on the whole of {x}.")
    return x.increasing("log")


def sin(x: Interval) -> Interval:
    """Enclose sin."""
    return x.wave("sin")


def cos(x: Interval) -> Interval:
    """Enclose cos."""
    return x.wave("cos")


def tan(x: Interval) -> Interval:
    """Enclose tan. Raises: UndefinedError if x contains a pole, or may contain one."""
    poles = _multiples_of_pi(x, shift=Fraction(1, 2))
    if poles is None or poles[0] <= poles[1]:
        raise UndefinedError(f"tan is not defined on the whole of {x}.")
    return x.increasing("tan")


def sinh(x: Interval) -> Interval:
    """Enclose sinh. Raises: UndefinedError where |x| exceeds 575."""
    return _growing("sinh", x)


def cosh(x: Interval) -> Interval:
    """Enclose cosh. Raises: UndefinedError where |x| exceeds 575."""
    return _growing("cosh", abs(x))


def sqrt(x: Interval) -> Interval:
    """Enclose the square root, exact for squares of rationals. Raises: UndefinedError unless x >=
    0."""
    if x.lo < 0:
        raise UndefinedError(f"sqrt is not defined on the whole of {x}.")
    return x.root()


def minimum(x: Interval, y: Interval) -> Interval:
    """Enclose min(x, y); exact."""
    return Interval(min(x.lo, y.lo), min(x.hi, y.hi))


def maximum(x: Interval, y: Interval) -> Interval:
    """Enclose max(x, y); exact."""
    return Interval(max(x.lo, y.lo), max(x.hi, y.hi))


def clip(x: Interval, low: Interval, high: Interval) -> Interval:
    """Enclose min(max(x, low), high); exact."""
    return minimum(maximum(x, low), high)


def _rational(value: object) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, (int, Fraction)):
        raise SpecError(f"interval ends must be int or Fraction; got {type(value).__name__}.")
    return Fraction(value)


def _interval(value: Interval | Fraction | int) -> Interval:
    if isinstance(value, Interval):
        return value if type(value) is Interval else Interval(value.lo, value.hi)
    number = _rational(value)
    return Interval(number, number)


def _enclose(
    lo: Fraction,
    hi: Fraction,
    operation: str,
    *operands: Interval,
    kept: int | None = None,
    bits: int = BITS,
) -> Interval:
    """Return the interval, end points of more than ``kept`` bits rounded outwards."""
    if kept is None:
        kept = _KEPT_POINT if lo == hi else _KEPT
    try:
        low = lo if height(lo) <= kept else round_down(lo, bits)
        high = hi if height(hi) <= kept else round_up(hi, bits)
        return Interval(low, high)
    except OverflowError as cause:
        shown = " and ".join(str(operand) for operand in operands)
        raise UndefinedError(
            f"{operation} of {shown} exceeds the bound 2^{MAX_EXPONENT}."
        ) from cause


def _growing(name: str, x: Interval) -> Interval:
    """Enclose an increasing function of exponential growth; far to the left exp is above 0."""
    if x.hi > _MAX_EXP or (x.lo < -_MAX_EXP and name != "exp"):
        raise UndefinedError(
            f"{name} of {x} is too large to enclose: |x| may be at most {_MAX_EXP}."
        )
    # Farther to the left exp is only known to be above 0.
    if x.lo >= _MIN_EXP:
        return x.increasing(name)
    right = Interval.point(max(x.hi, Fraction(_MIN_EXP)))
    return Interval(ZERO, right.increasing(name).hi)


def _multiples_of_pi(x: Interval, *, shift: Fraction) -> tuple[int, int] | None:
    """Return first and last k for which (k + shift) pi may lie in x (first > last: none does); None
    far out."""
    if x.magnitude > _MAX_ANGLE:
        return None
    low, high = pi_bounds(BITS + int(x.magnitude).bit_length())
    # The end of pi that makes the range wider, whatever the signs.
    first = x.lo / (high if x.lo >= 0 else low) - shift
    last = x.hi / (low if x.hi >= 0 else high) - shift
    return math.ceil(first), math.floor(last)


def _brief(value: Fraction) -> str:
    if height(value) <= 64:
        return number_text(value)
    nearest = float_below(value)
    return f"about {nearest:.6g}" if math.isfinite(nearest) else "beyond the floats"


Box = tuple[Interval, ...]  # a side for each component
IntervalMatrix = tuple[Box, ...]


@noun
class Discretisation:
    """Enclosures of exp(A T) and of (1/T) times its integral from 0 to T, both (q, q)."""

    transition: IntervalMatrix
    mean: IntervalMatrix


def discretise(A: Matrix, period: Fraction) -> Discretisation:
    """Enclose the exact discretisation of x' = A x, A (q, q) in 1/s, over ``period`` > 0 (s).

    exp of the block matrix [[A, I], [0, 0]] T holds exp(A T) and its integral (Van Loan 1978), in
    balls of 320 bits: what is lost in large exponents still leaves the bits that intervals keep.

    Raises: SpecError if the period is not positive or the exponential is too large to enclose.
    """
    from flint import arb, arb_mat, ctx

    if period <= 0:
        raise SpecError(f"the sampling period must be > 0 (s); got {period}.")
    q = len(A)
    with FLINT, ctx.workprec(320):
        blocks = arb_mat(2 * q, 2 * q)
        for i, row in enumerate(A):
            for j, x in enumerate(row):
                blocks[i, j] = arb(to_fmpq(x * period))
            blocks[i, q + i] = arb(to_fmpq(period))
        found = blocks.exp()
        try:
            ends = [[_ends(found[i, j]) for j in range(2 * q)] for i in range(q)]
        except OverflowError as cause:
            raise SpecError(
                "exp(A T) must be finite; A T is too large.", cure="Sample faster."
            ) from cause
    transition: list[Box] = []
    mean: list[Box] = []
    for pairs in ends:
        rounded = tuple(Interval(lo, hi).rounded(2 * BITS) for lo, hi in pairs)
        transition.append(rounded[:q])
        mean.append(tuple(x * (1 / period) for x in rounded[q:]))
    return Discretisation(transition=tuple(transition), mean=tuple(mean))


def interval_characteristic_polynomial(F: Sequence[Sequence[Interval]]) -> Box:
    """Enclose det(s I - F) for every F in an interval matrix (q, q): Faddeev and LeVerrier in
    intervals."""
    places = range(len(F))
    coefficients = [Interval.point(1)]
    product = [[Interval.point(int(i == j)) for j in places] for i in places]
    for k in range(1, len(F) + 1):
        columns = list(zip(*product, strict=True))
        image = [[_dot(row, column) for column in columns] for row in F]
        value = _total([image[i][i] for i in places]) * Fraction(-1, k)
        coefficients.append(value)
        for i in places:
            image[i][i] = image[i][i] + value
        product = image
    return tuple(coefficients)


def interval_routh(coefficients: Sequence[Interval | Fraction]) -> Verdict:
    """Decide whether polynomials with such coefficients have all roots left: PROVED all, REFUTED
    none, or UNDECIDED."""
    values = [x if isinstance(x, Interval) else Interval.point(x) for x in coefficients]
    if values[0].lo <= 0 <= values[0].hi:
        return Verdict.UNDECIDED
    # Routh's column starts with a positive number; the roots stay the same.
    if values[0].hi < 0:
        values = [-x for x in values]
    try:
        for entry in routh_column(values):
            if not entry.lo > 0:
                return Verdict.REFUTED if entry.hi <= 0 else Verdict.UNDECIDED
    except UndefinedError:
        return Verdict.UNDECIDED
    return Verdict.PROVED


@noun
class Middle:
    """A symmetric matrix of intervals as ``centre``, which is rational, and ``room``, a diagonal
    that is at least as large as every difference from it."""

    centre: Matrix
    room: Matrix


def middle(M: IntervalMatrix) -> Middle:
    """Of a symmetric M, whose upper triangle counts: |x'D x| is at most the sum of x_i^2 times the
    row of the |D_ij|."""
    places = range(len(M))
    upper = [[M[min(i, j)][max(i, j)] for j in places] for i in places]
    rooms = [sum((x.width / 2 for x in row), ZERO) for row in upper]
    return Middle(
        centre=tuple(tuple(x.midpoint for x in row) for row in upper),
        room=tuple(tuple(rooms[i] if i == j else ZERO for j in places) for i in places),
    )


def points(M: Matrix) -> IntervalMatrix:
    """A matrix as one of intervals."""
    return tuple(tuple(map(Interval.point, row)) for row in M)


def interval_product(M: IntervalMatrix, N: IntervalMatrix) -> IntervalMatrix:
    """Enclose M N."""
    columns = tuple(zip(*N, strict=True))
    return tuple(tuple(_dot(row, column) for column in columns) for row in M)


def _dot(v: Sequence[Interval], w: Sequence[Interval]) -> Interval:
    return _total([x * y for x, y in zip(v, w, strict=True)])


def _total(terms: Sequence[Interval]) -> Interval:
    return sum(terms, Interval.point(0))
