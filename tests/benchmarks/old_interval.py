"""The interval arithmetic that `make bench` measures against: rational ends and all four products, as it was before
there were intervals of floats (commit 847adbe); with the operations that couplings need."""

from __future__ import annotations

from fractions import Fraction

from dobc_design.exact.interval import BITS, Interval, height, round_down, round_up

KEPT, KEPT_POINT = 256, 1536


class OldInterval(Interval):
    """An interval with rational ends; every operation makes one new interval."""

    __slots__ = ()

    @staticmethod
    def enclosed(lo: Fraction, hi: Fraction) -> OldInterval:
        kept = KEPT_POINT if lo == hi else KEPT
        return OldInterval(
            lo if height(lo) <= kept else round_down(lo, BITS),
            hi if height(hi) <= kept else round_up(hi, BITS),
        )

    def like(self, other: Interval | Fraction | int) -> Interval:
        return other if isinstance(other, Interval) else OldInterval(Fraction(other), Fraction(other))

    def __add__(self, other: Interval | Fraction | int) -> OldInterval:
        y = self.like(other)
        return self.enclosed(self.lo + y.lo, self.hi + y.hi)

    def __sub__(self, other: Interval | Fraction | int) -> OldInterval:
        y = self.like(other)
        return self.enclosed(self.lo - y.hi, self.hi - y.lo)

    def __mul__(self, other: Interval | Fraction | int) -> OldInterval:
        y = self.like(other)
        products = (self.lo * y.lo, self.lo * y.hi, self.hi * y.lo, self.hi * y.hi)
        return self.enclosed(min(products), max(products))

    def __pow__(self, exponent: int) -> OldInterval:
        low, high = power(abs(self.lo), exponent), power(abs(self.hi), exponent)
        if exponent % 2:
            return OldInterval((-low if self.lo < 0 else low).lo, (-high if self.hi < 0 else high).hi)
        if self.lo <= 0 <= self.hi and exponent:
            return OldInterval(Fraction(0), max(low.hi, high.hi))
        return OldInterval(min(low.lo, high.lo), max(low.hi, high.hi))

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Interval | Fraction | int) -> OldInterval:
        return OldInterval(Fraction(other), Fraction(other)) - self

    def increasing(self, name: str) -> OldInterval:
        return OldInterval(*_ends(super().increasing(name)))

    def wave(self, name: str) -> OldInterval:
        return OldInterval(*_ends(super().wave(name)))


def power(base: Fraction, exponent: int) -> OldInterval:
    """An enclosure of a power of base >= 0, exponent >= 0, by squaring."""
    result, square = OldInterval(Fraction(1), Fraction(1)), OldInterval(base, base)
    while exponent:
        if exponent & 1:
            result = result * square
        exponent >>= 1
        if exponent:
            square = square * square
    return result


def _ends(x: Interval) -> tuple[Fraction, Fraction]:
    return x.lo, x.hi
