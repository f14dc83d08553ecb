"""Dense matrices decided by a floating-point Cholesky factor: bounded (Rump), or checked in exact integers.

Both work on D M D, D powers of two that bring the diagonal into [1/8, 1); M > 0 iff D M D > 0.
``shifted_cholesky``: Rump, "Verification of positive definiteness", BIT 2006 (theory, section 3).
``integer_factor`` proposes a factor L in integers, ``leaves_dominated_rest`` proves: D M D - L L' is computed in
integers and has to be dominated by its diagonal, hence D M D = L L' + (positive definite).
Neither ever answers "not positive definite"; eigenvectors that may show it come from ``low_directions``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact.integers import IntegerSymmetric
from dobc_design.exact.symmetric import SparseSymmetric

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

_UNIT: Final = 2.0**-53
# Products of integers are exact in doubles, in any order of summation, while no partial sum reaches this.
_EXACT: Final = 2.0**53
# Float bounds below are multiplied by this: their own rounding errors are below (n + 10) 2^-53 of them.
_UPWARDS: Final = 1 + 2.0**-20
HIGH_BITS: Final = 25
_BLOCK: Final = 256
# Bits kept of a rounded eigenvector.
_DIRECTION_BITS: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaled:
    """D M D (n, n), D = diag(2^-exponents): whole numbers of 2^-bits, rounded down, and the nearest doubles.

    whole <= 2^bits D M D < whole + 1 in every entry, whole = high 2^(2 low_bits) + middle 2^low_bits + low
    with middle and low in [0, 2^low_bits), bits = 2 (25 + low_bits). ``floats`` differ from D M D by at most
    2^-53 |floats| + 2^-bits per entry.
    """

    exponents: Whole
    low_bits: int
    high: Whole
    middle: Whole
    low: Whole
    floats: Floats

    @property
    def size(self) -> int:
        """Return n."""
        return len(self.floats)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IntegerFactor:
    """L = high 2^-25 + low 2^-(25 + low_bits), lower triangular; both hold integers as doubles."""

    high: Floats
    low: Floats


def scaled(M: SparseSymmetric | IntegerSymmetric) -> Scaled | list[int] | None:
    """Return D M D, or None if the diagonal is not positive, or integers v with v'Mv < 0.

    The last where an entry is too large beside its two diagonal entries: |(D M D)_ij| >= 1, and both of those < 1.
    """
    low_bits = 27 - (max(M.size - 1, 1).bit_length() + 1) // 2
    bits = 2 * (HIGH_BITS + low_bits)
    found = _whole_entries(M, bits)
    if found is None:
        return None
    exponents, rows, columns, whole = found
    large = np.flatnonzero((rows != columns) & ((whole >= 1 << bits) | (whole < -(1 << bits))))
    if len(large):
        return _against(int(rows[large[0]]), int(columns[large[0]]), int(whole[large[0]]), exponents)

    def dense(values: NDArray[Any]) -> NDArray[Any]:
        full = np.zeros((M.size, M.size), dtype=values.dtype)
        full[rows, columns] = full[columns, rows] = values
        return full

    mask = (1 << low_bits) - 1
    return Scaled(
        exponents=exponents,
        low_bits=low_bits,
        high=dense((whole >> 2 * low_bits).astype(np.int64)),
        middle=dense(((whole >> low_bits) & mask).astype(np.int64)),
        low=dense((whole & mask).astype(np.int64)),
        floats=dense(np.ldexp(whole.astype(np.float64), -bits)),
    )


def _whole_entries(M: SparseSymmetric | IntegerSymmetric, bits: int) -> tuple[Whole, Whole, Whole, NDArray[Any]] | None:
    """Return exponents, rows, columns, and 2^bits D M D at these places rounded down; None as above.

    Of an IntegerSymmetric the denominator is left out: it changes no sign.
    """
    denominators: Any = 1
    if isinstance(M, IntegerSymmetric):
        rows, columns, numerators = M.rows, M.columns, M.values.astype(object)
    else:
        rows, columns = (np.array([place[k] for place in M.entries], dtype=np.int64) for k in (0, 1))
        numerators = np.array([x.numerator for x in M.entries.values()], dtype=object)
        denominators = np.array([x.denominator for x in M.entries.values()], dtype=object)
    on = rows == columns
    if np.count_nonzero(on) < M.size or not (numerators[on] > 0).all():
        return None
    below = denominators[on].tolist() if isinstance(denominators, np.ndarray) else [1] * M.size
    # M_ii lies in (2^(e-1), 2^(e+1)), e the difference of the bit lengths; hence (D M D)_ii in [1/8, 1).
    lengths = [x.bit_length() - y.bit_length() for x, y in zip(numerators[on].tolist(), below, strict=True)]
    exponents = np.zeros(M.size, dtype=np.int64)
    exponents[rows[on]] = [(e + 2) // 2 for e in lengths]
    shift = bits - exponents[rows] - exponents[columns]
    left, right = (np.maximum(x, 0).astype(object) for x in (shift, -shift))
    return exponents, rows, columns, (numerators << left) // (denominators << right)


def _against(i: int, j: int, entry: int, exponents: Whole) -> list[int]:
    """Return D (e_i -+ e_j) as integers: its value is d_ii + d_jj - 2 |d_ij| < 0 for D M D = (d_ij)."""
    top = max(int(exponents[i]), int(exponents[j]))
    direction = [0] * len(exponents)
    direction[i] = 1 << (top - int(exponents[i]))
    direction[j] = (-1 if entry > 0 else 1) << (top - int(exponents[j]))
    return direction


def shifted_cholesky(S: Scaled) -> bool:
    """Tell whether M > 0 is proved by a Cholesky factorisation of fl(A - c I) that completes (Rump).

    c >= g/(1 - g) tr A + 2u max a_ii + |radius| + underflow, u = 2^-53. Rump's g is (n + 3) u; (n + 10) u also
    covers implementations that multiply by rounded reciprocals of the pivots. The radius is a norm: what
    the doubles leave out of D M D, by its largest row sum. The underflow term covers flush to zero.
    """
    n, A = S.size, S.floats
    diagonal = A.diagonal()
    g = (n + 10) * _UNIT
    radius = _UNIT * float(np.abs(A).sum(axis=1).max()) + n * 2.0 ** -(2 * (HIGH_BITS + S.low_bits))
    c = g / (1 - g) * float(diagonal.sum()) + 2 * _UNIT * float(diagonal.max()) + radius + 8 * (n + 2) ** 2 * 2.0**-1000
    return _factor(A, c * _UPWARDS) is not None


def proves_by_integers(S: Scaled) -> bool:
    """Tell whether M > 0 is proved by one of the proposed factors. Exact."""
    return any(leaves_dominated_rest(S, factor) for factor in integer_factors(S))


def margin(S: Scaled) -> float:
    """Return about the smallest eigenvalue of D M D that ``integer_factors`` can show: twice n roundings."""
    return 2 * S.size * 2.0 ** -(HIGH_BITS + S.low_bits)


def integer_factors(S: Scaled) -> Iterator[IntegerFactor]:
    """Propose integer factors of D M D - c I, c the margin and then 16 times that."""
    for often in (1, 16):
        L = _factor(S.floats, often * margin(S))
        if L is None:
            return
        high = np.rint(np.ldexp(L, HIGH_BITS))
        low = np.rint(np.ldexp(L - np.ldexp(high, -HIGH_BITS), HIGH_BITS + S.low_bits))
        yield IntegerFactor(high=high, low=low)


def leaves_dominated_rest(S: Scaled, factor: IntegerFactor) -> bool:
    """Tell whether D M D - L L' > 0 is proved: every diagonal entry exceeds the sum of the others' sizes.

    Matrix products of integers in doubles, bounded by Cauchy and Schwarz to stay below 2^53; the rest in int64.
    Any L of integers will do; what it has to do with a Cholesky factor does not matter.
    """
    high, low = factor.high, factor.low
    if not all(np.array_equal(part, np.rint(part)) for part in (high, low)):
        return False
    longest, shortest = (float(np.sqrt((part * part).sum(axis=1).max())) for part in (high, low))
    if max(longest, shortest) ** 2 * _UPWARDS >= _EXACT:
        return False
    n, shift = S.size, S.low_bits
    for start in range(0, n, _BLOCK):
        rows = slice(start, min(start + _BLOCK, n))
        rest = (S.low[rows] - _product(low[rows], low)) >> shift
        rest += S.middle[rows] - _product(high[rows], low) - _product(low[rows], high)
        top = S.high[rows] - _product(high[rows], high)
        # Beyond these limits the rest is not small, and the sums below might leave 64 bits.
        if int(np.abs(top).max()) >= 1 << (60 - shift - n.bit_length()):
            return False
        rest += top << shift
        if int(np.abs(rest).max()) >= 1 << (61 - n.bit_length()):
            return False
        # In units of 2^-(50 + low_bits) the true entries lie in [rest, rest + 2).
        here = np.arange(rows.start, rows.stop)
        diagonal = rest[here - start, here].copy()
        rest[here - start, here] = 0
        if not (diagonal > np.abs(rest).sum(axis=1) + 2 * n).all():
            return False
    return True


def low_directions(S: Scaled, eigenvectors: Floats) -> list[list[int]]:
    """Return D w for the columns w of ``eigenvectors`` (n, k), as integers: v'Mv is w'(D M D)w but for a factor."""
    exponents = S.exponents.tolist()
    lift = [max(exponents) - x for x in exponents]
    return [
        [int(x) << e for x, e in zip(np.rint(np.ldexp(w, _DIRECTION_BITS)).tolist(), lift, strict=True)]
        for w in eigenvectors.T
    ]


def _product(left: Floats, right: Floats) -> Whole:
    return (left @ right.T).astype(np.int64)


def _factor(A: Floats, shift: float) -> Floats | None:
    """Return the Cholesky factor of A - shift I in doubles, or None. It is finite; it proves nothing by itself."""
    shifted = A.copy()
    shifted.flat[:: len(A) + 1] -= shift
    try:
        L: Floats = np.linalg.cholesky(shifted).astype(np.float64)
    except np.linalg.LinAlgError:
        return None
    return L if bool(np.isfinite(L).all()) else None
