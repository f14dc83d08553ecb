"""Units of time and of disturbance in which an exosystem has numbers near 1, for the solvers' sake.

With A = a A1 and C = c C1 (a, c powers of ten) and a rate b = a b1: W1 serves (A1, C1, b1) iff
W = (a/c) W1 serves (A, C, b), because A - WC = a (A1 - W1 C1).  A1 and C1 are rounded to floats, since what
comes of them is a proposal.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.matrix import Matrix
from dobc_design.problem.exosystems import Exosystem


@dataclass(frozen=True, slots=True, kw_only=True)
class Scaled:
    """An exosystem in other units: ``time`` (1/s) is worth 1 there, and ``gain`` turns its W into the real one."""

    exosystem: Exosystem
    time: Fraction
    gain: Fraction


def natural_units(exosystem: Exosystem, *, rate: Fraction) -> tuple[Fraction, Fraction]:
    """Powers of ten near the largest of (A, rate) and of C."""
    return _unit([*(x for row in exosystem.A for x in row), rate]), _unit([x for row in exosystem.C for x in row])


def scaled_exosystem(exosystem: Exosystem, *, time: Fraction, output: Fraction) -> Scaled:
    """(A / time, C / output); the exosystem itself where both are 1."""
    if time == output == 1:
        return Scaled(exosystem=exosystem, time=time, gain=time)
    copy = Exosystem(A=_rounded(exosystem.A, time), C=_rounded(exosystem.C, output))
    return Scaled(exosystem=copy, time=time, gain=time / output)


def _unit(numbers: list[Fraction]) -> Fraction:
    """A power of ten near the largest number; 1 if that is 0."""
    largest = max((abs(x) for x in numbers), default=Fraction(0))
    return Fraction(10) ** decimal_exponent(largest) if largest else Fraction(1)


def decimal_exponent(x: Fraction) -> int:
    """The e with 10^e about x > 0, within one or two; for numbers of any length."""
    bits = x.numerator.bit_length() - x.denominator.bit_length()
    return round(bits * 0.30103)


def _rounded(matrix: Matrix, unit: Fraction) -> list[list[str]]:
    return [[repr(float(x / unit)) for x in row] for row in matrix]
