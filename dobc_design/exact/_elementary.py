"""Rational bounds of elementary functions at one rational point, through python-flint's balls.

A ball contains the true value whatever its precision, so nothing here can be too narrow; the
functions are only asked at points, where balls are tight (on wide arguments they are not).
"""

from __future__ import annotations

import threading
from fractions import Fraction
from typing import TYPE_CHECKING, Final

from dobc_design.exact._flint import to_fmpq
from dobc_design.exact._rounding import BITS, MAX_EXPONENT, height

if TYPE_CHECKING:
    from flint import arb

# Working bits beyond the BITS that are kept, and the longest argument taken at full length.
_GUARD: Final = 32
_MAX_HEIGHT: Final = 4096
# Exponents of two beyond which a ball is not written out.
_MAX_EXPONENT: Final = 4 * MAX_EXPONENT
# flint keeps its precision in one place for all threads.
_LOCK: Final = threading.Lock()

# (function, argument) -> value, where that is rational; there are no others (Lindemann).
_EXACT: Final = {
    ("exp", 0): 1,
    ("log", 1): 0,
    ("sin", 0): 0,
    ("cos", 0): 1,
    ("tan", 0): 0,
    ("atan", 0): 0,
    ("sinh", 0): 0,
    ("cosh", 0): 1,
    ("tanh", 0): 0,
}
_RANGE: Final = {
    "exp": (Fraction(0), None),
    "sin": (Fraction(-1), Fraction(1)),
    "cos": (Fraction(-1), Fraction(1)),
    "cosh": (Fraction(1), None),
    "tanh": (Fraction(-1), Fraction(1)),
}


def bounds(name: str, x: Fraction) -> tuple[Fraction, Fraction]:
    """Return lower and upper bounds of exp, log, sin, cos, tan, atan, sinh, cosh or tanh at x.

    They differ by about 2^-128 of the value (of 1 near the zeros of sin, cos, tan) and are equal
    where the value is rational. Raises: OverflowError if there is no finite enclosure.
    """
    known = _EXACT.get((name, int(x))) if x.denominator == 1 else None
    if known is not None:
        return Fraction(known), Fraction(known)
    from flint import arb, ctx

    with _LOCK, ctx.workprec(BITS + _GUARD + min(height(x), _MAX_HEIGHT)):
        lower, upper = _ends(getattr(arb(to_fmpq(x)), name)())
    least, greatest = _RANGE.get(name, (None, None))
    lower = lower if least is None else max(lower, least)
    return lower, upper if greatest is None else min(upper, greatest)


def pi_bounds(bits: int) -> tuple[Fraction, Fraction]:
    """Return bounds of pi that differ by about 2^-bits."""
    from flint import arb, ctx

    with _LOCK, ctx.workprec(bits + 4):
        return _ends(arb.pi())


def _ends(ball: arb) -> tuple[Fraction, Fraction]:
    # arb.lower() and upper() would round once more; middle and radius are exact numbers.
    if not ball.is_finite():
        raise OverflowError("there is no finite enclosure")
    (middle, error), (radius, more) = _dyadic(ball.mid()), _dyadic(ball.rad())
    around = radius + error + more
    return middle - around, middle + around


def _dyadic(number: arb) -> tuple[Fraction, Fraction]:
    """Return an exact ball's value and the error made by leaving out exponents below any use.

    A radius can have an exponent of -2^15000 (tanh far out), for which fmpq() ends the process.
    """
    mantissa, exponent = (int(part) for part in number.man_exp())
    if exponent < -_MAX_EXPONENT and mantissa.bit_length() + exponent < 0:
        return Fraction(0), Fraction(1, 1 << min(_MAX_EXPONENT, -exponent - mantissa.bit_length()))
    if exponent > _MAX_EXPONENT:
        raise OverflowError("there is no finite enclosure")
    return Fraction(mantissa) * Fraction(2) ** exponent, Fraction(0)
