"""Intervals with floating-point ends, every result rounded outwards: quick, where 53 bits are
enough.

IEEE 754 rounds sums, products, quotients and square roots to the nearest number, so that the next
number outside is a bound, as for values too small to be written; functions come from balls of
python-flint.  Nothing infinite is kept. An interval of floats is an ``Interval``: outside of
operations its ends are the exact rationals that these floats are.
"""

from __future__ import annotations

import math
from fractions import Fraction
from math import inf, nextafter
from typing import Final

from .interval import WAVES, Interval, UndefinedError, float_values
from .number import float_above, float_below

#: Ends beyond are refused.
LARGEST: Final = 1e300
_NARROW: Final = 2.0**-50
_WHOLE: Final = 2**53  # integers up to that are floats
_MAX_ANGLE = 2.0**20  # the largest argument whose multiples of pi floats count,
_MARGIN = 2.0**-30  # and how far off they may be


class Floats(Interval):
    """The closed interval from bottom to top; numbers and other intervals are taken as the least
    one that holds them.
    Raises: UndefinedError for ends beyond LARGEST, or where bottom <= top is not true."""

    __slots__ = ("bottom", "top")
    __setattr__ = object.__setattr__

    def __init__(self, bottom: float, top: float) -> None:
        if not -LARGEST <= bottom <= top <= LARGEST:
            raise UndefinedError(f"[{bottom:.6g}, {top:.6g}] exceeds the floating-point numbers.")
        self.bottom: float = bottom
        self.top: float = top

    @classmethod
    def around(cls, value: Interval | Fraction | int) -> Floats:
        """Return the least interval of floats that contains a number, or an interval, which
        remembers it."""
        if type(value) is Interval:
            found: Floats | None = value.in_floats
            if found is None:
                found = Floats(*value.floats())
                object.__setattr__(value, "in_floats", found)
            return found
        if isinstance(value, Interval):
            return value if type(value) is Floats else Floats(*value.floats())
        if type(value) is int and -_WHOLE <= value <= _WHOLE:
            return Floats(value + 0.0, value + 0.0)
        return Floats(float_below(value), float_above(value))

    def __getattr__(self, name: str) -> Fraction:
        """An end as a rational, made when it is first asked for."""
        if name not in ("lo", "hi"):
            raise AttributeError(name)
        end = self.bottom if name == "lo" else self.top
        rational = Fraction(*end.as_integer_ratio())
        setattr(self, name, rational)
        return rational

    def __reduce__(self) -> tuple[type[Floats], tuple[float, float]]:
        return Floats, (self.bottom, self.top)

    @property
    def is_narrow(self) -> bool:
        width = self.top - self.bottom
        return width <= _NARROW * (width + 2 * abs(self.bottom))

    def __eq__(self, other: object) -> bool:
        return type(other) is Floats and self.bottom == other.bottom and self.top == other.top

    def __hash__(self) -> int:
        return hash((self.bottom, self.top))

    def like(self, other: Interval | Fraction | int) -> Floats:
        return Floats.around(other)

    def __add__(self, other: Interval | Fraction | int) -> Floats:
        y = other if type(other) is Floats else Floats.around(other)
        lo = self.bottom + y.bottom
        hi = self.top + y.top
        if self.bottom and y.bottom:  # with 0 there is no rounding
            lo = nextafter(lo, -inf)
        if self.top and y.top:
            hi = nextafter(hi, inf)
        return Floats(lo, hi)

    def __mul__(self, other: Interval | Fraction | int) -> Floats:
        y = other if type(other) is Floats else Floats.around(other)
        a = self.bottom
        b = self.top
        c = y.bottom
        d = y.top
        # The least product is p q, the largest r s.
        if a >= 0:
            p = a if c >= 0 else b
            q = c
            r = b if d >= 0 else a
            s = d
        elif b <= 0:
            p = a if d >= 0 else b
            q = d
            r = b if c >= 0 else a
            s = c
        elif c >= 0:
            p = a
            q = d
            r = b
            s = d
        elif d <= 0:
            p = b
            q = c
            r = a
            s = c
        else:
            p, q = (a, d) if a * d <= b * c else (b, c)
            r, s = (a, c) if a * c >= b * d else (b, d)
        lo = p * q
        hi = r * s
        # With 0 there is no rounding; a product that is too small to be written has one.
        if p and q:
            lo = nextafter(lo, -inf)
        if r and s:
            hi = nextafter(hi, inf)
        return Floats(lo, hi)

    def __truediv__(self, other: Interval | Fraction | int) -> Floats:
        y = other if type(other) is Floats else Floats.around(other)
        if y.bottom <= 0 <= y.top:
            raise UndefinedError(f"division by {y}, which contains 0, is not defined.")
        x = self
        near = y.bottom
        far = y.top
        if y.bottom < 0:  # x / y = -x / -y
            x = -self
            near = -y.top
            far = -y.bottom
        lo = x.bottom / (far if x.bottom >= 0 else near)
        hi = x.top / (near if x.top >= 0 else far)
        if x.bottom:
            lo = nextafter(lo, -inf)
        if x.top:
            hi = nextafter(hi, inf)
        return Floats(lo, hi)

    __radd__ = __add__
    __rmul__ = __mul__

    def __rtruediv__(self, other: Interval | Fraction | int) -> Floats:
        return Floats.around(other) / self

    def increasing(self, name: str) -> Floats:
        low, high = float_values(name, self.bottom)
        if self.bottom != self.top:
            _, high = float_values(name, self.top)
        return Floats(low, high)

    def wave(self, name: str) -> Floats:
        a = self.bottom
        b = self.top
        shift = WAVES[name]
        if max(-a, b) > _MAX_ANGLE:
            return Floats(-1.0, 1.0)
        first = math.ceil(a / math.pi - shift - _MARGIN)
        last = math.floor(b / math.pi - shift + _MARGIN)
        if last > first:
            return Floats(-1.0, 1.0)
        low, high = float_values(name, a)
        low_there, high_there = float_values(name, b)
        low = min(low, low_there)
        high = max(high, high_there)
        if last == first:  # one extremum lies inside, or may
            if first % 2 == 0:
                high = 1.0
            else:
                low = -1.0
        return Floats(low, high)

    def root(self) -> Floats:
        lo = math.sqrt(self.bottom)
        hi = math.sqrt(self.top)
        if lo:
            lo = nextafter(lo, -inf)
        if hi:
            hi = nextafter(hi, inf)
        return Floats(lo, hi)
