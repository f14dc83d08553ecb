"""The exact discretisation of x' = A x over a period, enclosed in rational intervals through Arb.

exp of the block matrix [[A, I], [0, 0]] T holds exp(A T) and its integral (Van Loan 1978); both come out of one ball
matrix, whose middles and radii are exact numbers. Interval versions of the characteristic polynomial
and of Routh's test then decide what holds for every matrix in the enclosure, the true one included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from dobc_design.errors import SpecError
from dobc_design.exact.interval import _LOCK, Interval, UndefinedError, _ends
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import to_fmpq
from dobc_design.verdict import Verdict

IntervalMatrix = tuple[tuple[Interval, ...], ...]

_BITS: Final = 320  # of the balls; what is lost in large exponents still leaves the 128 bits that intervals keep


@dataclass(frozen=True, slots=True, kw_only=True)
class Discretisation:
    """Enclosures of exp(A T) and of (1/T) times its integral from 0 to T, both (q, q)."""

    transition: IntervalMatrix
    mean: IntervalMatrix


def discretise(A: Matrix, period: Fraction) -> Discretisation:
    """Enclose the exact discretisation of x' = A x, A (q, q) in 1/s, over ``period`` > 0 (s).

    Raises: SpecError if the period is not positive or the exponential is too large to enclose.
    """
    from flint import arb, arb_mat, ctx

    if period <= 0:
        raise SpecError(f"the sampling period must be > 0 (s); got {period}.")
    q = len(A)
    with _LOCK, ctx.workprec(_BITS):
        entries = [
            arb(to_fmpq(A[i][j] * period)) if i < q and j < q else arb(to_fmpq(period) if j == i + q else 0)
            for i in range(2 * q)
            for j in range(2 * q)
        ]
        found = arb_mat(2 * q, 2 * q, entries).exp()
        try:
            ends = [[_ends(found[i, j]) for j in range(2 * q)] for i in range(q)]
        except OverflowError as cause:
            raise SpecError("exp(A T) must be finite; A T is too large.", cure="Sample faster.") from cause
    rounded = [[Interval(lo, hi).rounded(2 * 128) for lo, hi in row] for row in ends]
    return Discretisation(
        transition=tuple(tuple(row[:q]) for row in rounded),
        mean=tuple(tuple(x * (1 / period) for x in row[q:]) for row in rounded),
    )


def interval_characteristic_polynomial(F: Sequence[Sequence[Interval]]) -> tuple[Interval, ...]:
    """Enclose det(s I - F) for every F in an interval matrix (q, q): Faddeev and LeVerrier in intervals."""
    size = len(F)
    coefficients = [Interval.point(1)]
    product = [[Interval.point(int(i == j)) for j in range(size)] for i in range(size)]
    for k in range(1, size + 1):
        image = [[_total([F[i][r] * product[r][j] for r in range(size)]) for j in range(size)] for i in range(size)]
        value = _total([image[i][i] for i in range(size)]) * Fraction(-1, k)
        coefficients.append(value)
        product = [[x + value if i == j else x for j, x in enumerate(row)] for i, row in enumerate(image)]
    return tuple(coefficients)


def interval_routh(coefficients: Sequence[Interval | Fraction]) -> Verdict:
    """Decide whether every polynomial with coefficients in the intervals has all roots in Re s < 0.

    PROVED: all have; REFUTED: none has; UNDECIDED: an interval of Routh's first column holds 0.
    """
    values = [x if isinstance(x, Interval) else Interval.point(x) for x in coefficients]
    if values[0].lo <= 0 <= values[0].hi:
        return Verdict.UNDECIDED
    if values[0].hi < 0:
        values = [-x for x in values]
    upper, lower = values[0::2], values[1::2]
    zero = Interval.point(0)
    while lower:
        if lower[0].hi <= 0:
            return Verdict.REFUTED
        if lower[0].lo <= 0:
            return Verdict.UNDECIDED
        try:
            factor = upper[0] / lower[0]
            below = [*lower[1:], *([zero] * (len(upper) - len(lower)))]
            upper, lower = lower, [x - factor * y for x, y in zip(upper[1:], below, strict=True)]
        except UndefinedError:
            return Verdict.UNDECIDED
    return Verdict.PROVED


def _total(terms: Sequence[Interval]) -> Interval:
    result = Interval.point(0)
    for term in terms:
        result = result + term
    return result
