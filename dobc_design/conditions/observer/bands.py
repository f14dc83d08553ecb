"""What an observer leaves of sines whose frequencies are known to lie in bands (theory, section
19).

For every disturbance d that acts on the inputs of an agent, d - dhat = S d and what decays, with

    S(s) = I - C (sI - F)^-1 W,    F = A - W C Hurwitz;    m = 1: S = det(sI - A)/det(sI - F).

A sine of one constant frequency w in [low, high] and amplitude a in every component leaves in the
end at most a times the row sums of |S(jw)|.  An entry N/chi_F of S is at most g there iff
g^2 |chi_F(jw)|^2 - |N(jw)|^2 >= 0, a polynomial in w^2.  What decays is C eps, eps being how far
the observer's state is from the one that it comes to.
"""

from collections.abc import Iterator
from fractions import Fraction

from dobc_design.exact.matrix import Matrix, add, multiply
from dobc_design.exact.polynomial import (
    Coefficients,
    characteristic_polynomial,
    is_nonnegative,
    routh,
    squared_modulus,
)
from dobc_design.loop.loop import Loop
from dobc_design.problem.bands import Band

from .decide import error_matrix

Entries = tuple[tuple[Coefficients, ...], ...]


def filters(loop: Loop, W: Matrix) -> Iterator[tuple[Coefficients, Entries]]:
    """chi_F and the numerators (p, p) of S, of every group with its block of the gain W (q, m)."""
    own = loop.drift
    for group, gain in loop.observed(W):
        F = error_matrix(group.exosystem, gain)
        C = group.exosystem.C
        entering = gain
        if own is not None:  # d acts on the inputs
            C = multiply(own.left_inverse, C)
            entering = multiply(gain, own.B)
        below = characteristic_polynomial(F)
        yield below, tuple(_row(F, C, entering, k) for k in range(len(C)))


def _row(F: Matrix, C: Matrix, gain: Matrix, k: int) -> tuple[Coefficients, ...]:
    """The numerators of row k of S: det(sI - F - w c) is chi_F times 1 - c (sI - F)^-1 w."""
    below = characteristic_polynomial(F)
    row = []
    for column in range(len(C)):
        added = multiply(tuple((line[column],) for line in gain), (C[k],))
        entry = characteristic_polynomial(add(F, added))
        if column != k:
            entry = tuple(x - y for x, y in zip(entry, below, strict=True))
        row.append(entry)
    return tuple(row)


def are_bounded(loop: Loop, W: Matrix, band: Band, gains: Matrix) -> bool:
    """Whether, in every group, A - W C is Hurwitz and every entry of |S(jw)| is at most that of
    ``gains`` (p, p), >= 0, for all w in the band."""
    low = band.low**2
    high = band.high**2
    for below, entries in filters(loop, W):
        if not routh(below).is_proved:
            return False
        most = squared_modulus(below)
        for row, claimed in zip(entries, gains, strict=True):
            for above, gain in zip(row, claimed, strict=True):
                if gain < 0 or not is_nonnegative(_left(most, gain, above), low, high):
                    return False
    return True


def _left(most: Coefficients, gain: Fraction, above: Coefficients) -> Coefficients:
    """gain^2 |chi_F|^2 - |N|^2, a polynomial in w^2."""
    passed = squared_modulus(above)
    missing = len(most) - len(passed)
    passed = (Fraction(0),) * missing + passed
    return tuple(gain**2 * x - y for x, y in zip(most, passed, strict=True))
