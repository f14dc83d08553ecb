"""Directed rounding of rationals, so that intervals stay short without ever shrinking."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

# Significant bits an end point is rounded to.
BITS: Final = 128
# Largest exponent of two kept; without a bound, powers of powers would fill the memory.
MAX_EXPONENT: Final = 65_536


def height(value: Fraction) -> int:
    """Return the bits of the longer one of numerator and denominator."""
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def round_down(value: Fraction, bits: int = BITS) -> Fraction:
    """Return a number <= value of at most ``bits`` significant bits, the same if it is that short.

    Beyond 2^65536 a positive value becomes that power, and below 2^-65536 zero.
    Raises: OverflowError for values below -2^65536.
    """
    if not value:
        return value
    numerator, denominator = value.numerator, value.denominator
    exponent = numerator.bit_length() - denominator.bit_length()
    if exponent > MAX_EXPONENT:
        if value < 0:
            raise OverflowError(f"a value beyond 2^{MAX_EXPONENT} has no enclosure")
        return Fraction(1 << MAX_EXPONENT)
    if exponent < -MAX_EXPONENT:
        return Fraction(0) if value > 0 else Fraction(-1, 1 << MAX_EXPONENT)
    shift = bits - exponent
    if shift >= 0:
        return Fraction((numerator << shift) // denominator, 1 << shift)
    return Fraction((numerator // (denominator << -shift)) << -shift)


def round_up(value: Fraction, bits: int = BITS) -> Fraction:
    """Return a number >= value of at most ``bits`` significant bits; see ``round_down``.

    Raises: OverflowError for values above 2^65536.
    """
    return -round_down(-value, bits)


def sqrt_bounds(value: Fraction) -> tuple[Fraction, Fraction]:
    """Return lower and upper bounds of the root of value >= 0, equal if it is rational."""
    n, d = math.isqrt(value.numerator), math.isqrt(value.denominator)
    if n * n == value.numerator and d * d == value.denominator:
        return Fraction(n, d), Fraction(n, d)
    exponent = value.numerator.bit_length() - value.denominator.bit_length()
    shift = max(0, BITS + 2 - exponent // 2)
    root = math.isqrt((value.numerator << 2 * shift) // value.denominator)
    return Fraction(root, 1 << shift), Fraction(root + 1, 1 << shift)
