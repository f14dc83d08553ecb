"""What an observer leaves of sines whose frequencies are known to lie in bands (theory, section
19).

For every disturbance d that acts on the inputs of an agent, d - dhat = S d and what decays, with

    S(s) = I - C (sI - F)^-1 W,    F = A - W C Hurwitz;    m = 1: S = det(sI - A)/det(sI - F),

and in general what acts in its place is S d with S = D + C (sI - F)^-1 G_d of ``channels``.

A sine of one constant frequency w in [low, high] and amplitude a in every component leaves in the
end at most a times the row sums of |S(jw)|.  An entry N/chi_F of S is at most g there iff
g^2 |chi_F(jw)|^2 - |N(jw)|^2 >= 0, a polynomial in w^2.  What decays is C eps, eps being how far
the observer's state is from the one that it comes to.
"""

from collections.abc import Iterator
from fractions import Fraction

from dobc_design.exact.matrix import Matrix, multiply, subtract, transpose
from dobc_design.exact.polynomial import (
    Coefficients,
    characteristic_polynomial,
    is_nonnegative,
    routh,
    squared_modulus,
)
from dobc_design.loop.loop import Loop
from dobc_design.problem.bands import Band

from .channels import Channel, channels

Entries = tuple[tuple[Coefficients, ...], ...]


def filters(loop: Loop, W: Matrix) -> Iterator[tuple[Coefficients, Entries]]:
    """chi_F and the numerators of S (r, p) of every group (``channels``), for the gain W (q, m)."""
    for channel in channels(loop, W):
        below = characteristic_polynomial(channel.F)
        yield below, tuple(_row(channel, below, k) for k in range(len(channel.C)))


def _row(channel: Channel, below: Coefficients, k: int) -> tuple[Coefficients, ...]:
    """The numerators of row k of S: det(sI - F + g c) is chi_F times 1 + c (sI - F)^-1 g."""
    row = []
    for direct, column in zip(channel.D[k], transpose(channel.disturbance), strict=True):
        added = multiply(transpose((column,)), (channel.C[k],))
        whole = characteristic_polynomial(subtract(channel.F, added))
        both = zip(whole, below, strict=True)
        row.append(tuple(x + (direct - 1) * y for x, y in both))
    return tuple(row)


def are_bounded(loop: Loop, W: Matrix, band: Band, gains: Matrix) -> bool:
    """Whether, in every group, A - W C is Hurwitz and every entry of |S(jw)| is at most that of
    ``gains`` (r, p), >= 0, for all w in the band."""
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
