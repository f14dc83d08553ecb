"""Intervals with floating-point ends, every result rounded outwards: quick, where 53 bits are enough.

IEEE 754 rounds sums, products, quotients and square roots to the nearest number, so that the next number outside is a
bound, as for values too small to be written; functions come from balls of python-flint.  Nothing infinite is kept.
An interval of floats is an ``Interval``: outside of operations its ends are the exact rationals that these floats are.
"""

from __future__ import annotations

import math
from fractions import Fraction
from math import inf, nextafter
from typing import Final

from dobc_design.exact.interval import WAVES, Interval, UndefinedError, float_values

#: Ends beyond are refused.
LARGEST: Final = 1e300
# The largest argument whose multiples of pi floats count, and how far off they may be.
_WHOLE: Final = 1 << 53
_NARROW: Final = 2.0**-50
_MAX_ANGLE, _MARGIN = 2.0**20, 2.0**-30


def float_bounds(number: Fraction | int) -> tuple[float, float]:
    """Return the largest float <= number and the smallest float >= it.  Raises: UndefinedError beyond the floats."""
    top, bottom = number.numerator, number.denominator
    if bottom == 1 and -_WHOLE <= top <= _WHOLE:
        return float(top), float(top)
    try:
        nearest = top / bottom
    except OverflowError as error:
        raise UndefinedError("a number exceeds the floating-point numbers.") from error
    p, q = nearest.as_integer_ratio()
    if p * bottom == top * q:
        return nearest, nearest
    below = p * bottom < top * q
    return (nearest, nextafter(nearest, inf)) if below else (nextafter(nearest, -inf), nearest)


def _below(x: float, y: float) -> float:
    """A number <= x y; a product with 0 is exact, one that is too small to be written is not."""
    product = x * y
    return nextafter(product, -inf) if x and y else product


def _above(x: float, y: float) -> float:
    product = x * y
    return nextafter(product, inf) if x and y else product


class Floats(Interval):
    """The closed interval from a to b; numbers and other intervals are taken as the least one that holds them.

    Raises: UndefinedError for ends beyond LARGEST, or where a <= b is not true.
    """

    __slots__ = ("a", "b")
    __setattr__ = object.__setattr__

    def __init__(self, a: float, b: float) -> None:
        if not -LARGEST <= a <= b <= LARGEST:
            raise UndefinedError(f"[{a:.6g}, {b:.6g}] exceeds the floating-point numbers.")
        self.a = a
        self.b = b

    @classmethod
    def around(cls, value: Interval | Fraction | int) -> Floats:
        """Return the least interval of floats that contains a number, or an interval."""
        if type(value) is Floats:
            return value
        if type(value) is int and -_WHOLE <= value <= _WHOLE:
            return Floats(float(value), float(value))
        if isinstance(value, Interval):
            low, high = float_bounds(value.lo)
            return Floats(low, high if value.hi is value.lo else float_bounds(value.hi)[1])
        return Floats(*float_bounds(value))

    def __getattr__(self, name: str) -> Fraction:
        """An end as a rational, made when it is first asked for."""
        if name not in ("lo", "hi"):
            raise AttributeError(name)
        end = Fraction(*(self.a if name == "lo" else self.b).as_integer_ratio())
        setattr(self, name, end)
        return end

    @property
    def bottom(self) -> float:
        return self.a

    @property
    def top(self) -> float:
        return self.b

    @property
    def is_point(self) -> bool:
        return self.a == self.b

    @property
    def is_narrow(self) -> bool:
        return self.b - self.a <= _NARROW * (self.b - self.a + 2 * abs(self.a))

    @property
    def sign(self) -> int:
        return 1 if self.a >= 0 else -1 if self.b <= 0 else 0

    @property
    def is_zero(self) -> bool:
        return not self.a and not self.b

    def __eq__(self, other: object) -> bool:
        return type(other) is Floats and self.a == other.a and self.b == other.b

    def __hash__(self) -> int:
        return hash((self.a, self.b))

    def ends(self) -> tuple[Floats, Floats]:
        return Floats(self.a, self.a), Floats(self.b, self.b)

    def middle(self) -> Floats:
        return Floats((middle := (self.a + self.b) / 2), middle)

    def halves(self) -> tuple[Floats, Floats]:
        middle = (self.a + self.b) / 2
        return Floats(self.a, middle), Floats(middle, self.b)

    def hull(self, other: Interval) -> Floats:
        y = Floats.around(other)
        return Floats(min(self.a, y.a), max(self.b, y.b))

    def like(self, other: Interval | Fraction) -> Floats:
        return Floats.around(other)

    def meet(self, other: Interval) -> Floats:
        y = Floats.around(other)
        return Floats(max(self.a, y.a), min(self.b, y.b))

    def __neg__(self) -> Floats:
        return Floats(-self.b, -self.a)

    def __abs__(self) -> Floats:
        if self.a >= 0:
            return self
        return -self if self.b <= 0 else Floats(0.0, max(-self.a, self.b))

    def __add__(self, other: Interval | Fraction | int) -> Floats:
        y = Floats.around(other)
        lo, hi = self.a + y.a, self.b + y.b
        return Floats(
            nextafter(lo, -inf) if self.a and y.a else lo,  # with 0 there is no rounding
            nextafter(hi, inf) if self.b and y.b else hi,
        )

    def __sub__(self, other: Interval | Fraction | int) -> Floats:
        return self + -Floats.around(other)

    def __mul__(self, other: Interval | Fraction | int) -> Floats:
        y = Floats.around(other)
        a, b, c, d = self.a, self.b, y.a, y.b
        if a >= 0:
            return Floats(_below(a if c >= 0 else b, c), _above(b if d >= 0 else a, d))
        if b <= 0:
            return Floats(_below(a if d >= 0 else b, d), _above(b if c >= 0 else a, c))
        if c >= 0:
            return Floats(_below(a, d), _above(b, d))
        if d <= 0:
            return Floats(_below(b, c), _above(a, c))
        return Floats(min(_below(a, d), _below(b, c)), max(_above(a, c), _above(b, d)))

    def __truediv__(self, other: Interval | Fraction | int) -> Floats:
        y = Floats.around(other)
        if y.a <= 0 <= y.b:
            raise UndefinedError(f"division by {y}, which contains 0, is not defined.")
        x, near, far = (self, y.a, y.b) if y.a > 0 else (-self, -y.b, -y.a)
        lo, hi = x.a / (far if x.a >= 0 else near), x.b / (near if x.b >= 0 else far)
        return Floats(nextafter(lo, -inf) if x.a else lo, nextafter(hi, inf) if x.b else hi)

    def __pow__(self, exponent: int) -> Floats:
        if exponent < 0:
            return 1 / self**-exponent
        if self.a < 0:
            if exponent % 2 == 0:
                return abs(self) ** exponent
            if self.b <= 0:
                return -((-self) ** exponent)
            return Floats(-(Floats(0.0, -self.a) ** exponent).b, (Floats(0.0, self.b) ** exponent).b)
        if exponent < 2:
            return self if exponent else Floats(1.0, 1.0)
        half = self ** (exponent // 2)
        return half * half * self if exponent % 2 else half * half

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Interval | Fraction | int) -> Floats:
        return -self + other

    def __rtruediv__(self, other: Interval | Fraction | int) -> Floats:
        return Floats.around(other) / self

    def increasing(self, name: str) -> Floats:
        low = float_values(name, self.a)
        return Floats(low[0], low[1] if self.a == self.b else float_values(name, self.b)[1])

    def wave(self, name: str) -> Floats:
        a, b, shift = self.a, self.b, WAVES[name]
        if max(-a, b) > _MAX_ANGLE:
            return Floats(-1.0, 1.0)
        first = math.ceil(a / math.pi - shift - _MARGIN)
        last = math.floor(b / math.pi - shift + _MARGIN)
        if last > first:
            return Floats(-1.0, 1.0)
        (low, high), (low_there, high_there) = float_values(name, a), float_values(name, b)
        turns = None if last < first else first % 2
        return Floats(-1.0 if turns == 1 else min(low, low_there), 1.0 if turns == 0 else max(high, high_there))

    def root(self) -> Floats:
        lo, hi = math.sqrt(self.a), math.sqrt(self.b)
        return Floats(nextafter(lo, -inf) if lo else lo, nextafter(hi, inf) if hi else hi)
