"""Numbers that a certificate claims: floats on the safe side, read back as the decimal text they show."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

SHRINK = (1e-9, 1e-6, 1e-3, 0.1, 0.5)


def claimed(value: float) -> Fraction:
    """The exact number a claimed float stands for: its shortest decimal text."""
    return Fraction(repr(float(value)))


def shorten(value: float, *, digits: int = 9) -> float:
    """Round a positive float down to ``digits`` significant decimal digits."""
    if not math.isfinite(value) or value <= 0:
        return 0.0
    exponent = math.floor(math.log10(value)) - digits + 1
    unit = Fraction(10) ** exponent
    return float(f"{int(Fraction(value) / unit)}e{exponent}")


def largest_proved(estimate: float, holds: Callable[[Fraction], bool]) -> float | None:
    """The first number a little below ``estimate`` for which ``holds`` proves the claim; 0 last; None if none.

    ``estimate`` is a proposal from floating point; only ``holds``, which is exact, decides.
    """
    if estimate > 0 and math.isfinite(estimate):
        for part in SHRINK:
            candidate = shorten(estimate * (1 - part))
            if candidate > 0 and holds(claimed(candidate)):
                return candidate
    return 0.0 if holds(Fraction(0)) else None
