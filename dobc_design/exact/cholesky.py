"""Dense matrices decided by a floating-point Cholesky factor that is checked in exact integers.

It works on D M D, D powers of two that bring the diagonal into [1/8, 1); M > 0 iff D M D > 0. It
never answers "not positive definite"; eigenvectors that may show it come from ``low_directions``.
"""

import heapq
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun, positional

from .number import to_fmpq
from .symmetric import IntegerSymmetric, SparseSymmetric

# Fraction, or flint's fmpq for larger matrices; both mix with int.
Scalar: TypeAlias = Any
# which row, its pivot, and the rest of the row over the pivot
Row: TypeAlias = dict[int, Scalar]  # column -> value, where it is not 0
Step: TypeAlias = tuple[int, Scalar, Row]

# From this size on the conversion to flint's rationals has paid for itself.
FLINT_SIZE: Final = 13


class UnfinishedError(Exception):
    """The elimination takes more work than was allowed; nothing is known."""


def bad_direction(
    M: SparseSymmetric, *, strict: bool, flint: bool | None = None, most_work: int | None = None
) -> dict[int, Fraction] | None:
    """Return None if M > 0 (strict) or M >= 0, else a direction v, by its entries, with v'Mv <= 0
    (< 0).  ``flint`` chooses the arithmetic; by default the size does. ``most_work``: products of
    numbers of 64 bits, about; counted, not timed, so that every machine answers the same. Raises:
    UnfinishedError beyond it."""
    if flint is None:
        flint = M.size >= FLINT_SIZE
    rows: list[Row] = M.rows()
    if flint:
        rows = [{j: to_fmpq(value) for j, value in row.items()} for row in rows]
    found = _eliminate(rows, [], strict=strict, most_work=most_work)
    if found is None:
        return None
    return {i: Fraction(int(x.numerator), int(x.denominator)) for i, x in found.items()}


@positional
class Square:
    """d (x_pivot + sum of others[i] x_i)^2: one entry of D and one column of L.  ``others`` are the
    entries of the column that are neither 0 nor the 1 at the pivot, by rising index."""

    weight: Fraction
    pivot: int
    others: Mapping[int, Fraction]


def squares_of(M: SparseSymmetric, *, strict: bool = True) -> tuple[Square, ...] | None:
    """The squares M is the sum of, pivots by least degree, then least index; None unless M > 0
    (strict) or M >= 0."""
    steps: list[Step] = []
    if _eliminate(M.rows(), steps, strict=strict, most_work=None) is not None:
        return None
    squares: list[Square] = []
    for pivot, weight, others in steps:
        squares.append(Square(weight, pivot, dict(sorted(others.items()))))
    return tuple(squares)


def _eliminate(
    rows: list[Row], steps: list[Step], *, strict: bool, most_work: int | None
) -> Row | None:
    """Eliminate in minimum-degree order; return None if every pivot passes, else a witness.
    ``rows`` hold both triangles without zeros, and are consumed: the open ones hold the Schur
    complement.  ``steps`` gets every pivot."""
    # An entry that is bad from the start refutes without elimination.
    for i in range(len(rows)):
        bad = _bad_diagonal(rows, i, strict=strict)
        if bad is not None:
            return bad
    queue = [(len(row), i) for i, row in enumerate(rows)]
    heapq.heapify(queue)
    closed = [False] * len(rows)
    work = 0
    while queue:
        degree, k = heapq.heappop(queue)
        # Stale entries stay in the queue; the current degree of every open row is there as well.
        if closed[k] or degree != len(rows[k]):
            continue
        closed[k] = True
        row = rows[k]
        if not row:  # a zero row of a semidefinite matrix
            continue
        pivot = row.pop(k)
        if most_work is not None:
            # The outer product below; long numbers count once for every 64 bits.
            products = len(row) * (len(row) + 1) // 2
            words = 1 + int(pivot.denominator).bit_length() // 64
            work += products * words
            if work > most_work:
                raise UnfinishedError(
                    f"elimination stopped at pivot {len(steps) + 1} of {len(rows)}"
                )
        factors = {j: x / pivot for j, x in row.items()}
        steps.append((k, pivot, factors))
        _subtract_outer(rows, k, factors)
        # No other row has changed.
        for i in row:
            bad = _bad_diagonal(rows, i, strict=strict)
            if bad is not None:
                return _back_substitute(bad, steps)
            heapq.heappush(queue, (len(rows[i]), i))
    return None


def _subtract_outer(rows: list[Row], k: int, factors: Row) -> None:
    """Subtract row_k' row_k / pivot from the open rows; drop column k and what cancels."""
    neighbours = list(rows[k].items())
    for position, (i, x) in enumerate(neighbours):
        target = rows[i]
        del target[k]
        for j, _ in neighbours[position:]:
            product = x * factors[j]
            value = target[j] - product if j in target else -product
            # What cancels exactly goes, so that rows stay sparse.
            if value:
                target[j] = rows[j][i] = value
            else:
                del target[j]
                rows[j].pop(i, None)


def _bad_diagonal(rows: list[Row], i: int, *, strict: bool) -> Row | None:
    """Return a direction in which the open part is not positive because of entry (i, i), or
    None."""
    row = rows[i]
    diagonal = row.get(i, 0)
    if diagonal > 0:
        return None
    if strict or diagonal < 0:
        return {i: 1}
    if not row:
        return None
    # 0 on the diagonal, b beside it, c on the other diagonal: e_j + t e_i has value 2 t b + c = -1.
    j, b = next(iter(row.items()))
    c = rows[j].get(j, 0)
    return {j: 1, i: -(c + 1) / (2 * b)}


def _back_substitute(bad: Row, steps: list[Step]) -> Row:
    """Extend a direction of the Schur complement to the whole matrix, with the same value."""
    vector = dict(bad)
    for k, _, factors in reversed(steps):
        entry = -sum(x * vector[j] for j, x in factors.items() if j in vector)
        if entry:
            vector[k] = entry
    return vector


Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

# Products of integers are exact in doubles, in any order of summation, while no partial sum reaches
# this.
_EXACT: Final = 2.0**53
# Float bounds below are multiplied by this: their own rounding errors are below (n + 10) 2^-53 of
# them.
_UPWARDS: Final = 1 + 2.0**-20
HIGH_BITS: Final = 25
_BLOCK: Final = 256
# Bits kept of a rounded eigenvector.
_DIRECTION_BITS: Final = 60


@noun(eq=False)
class Scaled:
    """D M D (n, n), D = diag(2^-exponents): whole numbers of 2^-bits, rounded down, and the nearest
    doubles.

    whole <= 2^bits D M D < whole + 1 in every entry, whole = high 2^(2 low_bits) + middle
    2^low_bits + low with middle and low in [0, 2^low_bits), bits = 2 (25 + low_bits). ``floats``
    differ from D M D by at most 2^-53 |floats| + 2^-bits per entry.
    """

    size: int  # n
    exponents: Whole
    low_bits: int
    high: Whole
    middle: Whole
    low: Whole
    floats: Floats


def scaled(M: SparseSymmetric | IntegerSymmetric) -> Scaled | list[int] | None:
    """Return D M D; None if the diagonal is not positive; integers v with v'Mv < 0 where an entry
    is too large."""
    # So short that sums of products of parts, over a row, are exact in doubles.
    low_bits = 27 - (max(M.size - 1, 1).bit_length() + 1) // 2
    bits = 2 * (HIGH_BITS + low_bits)
    found = _whole_entries(M, bits)
    if found is None:
        return None
    rows = found.rows
    columns = found.columns
    whole = found.values
    # Beside a diagonal below 1 an entry of size 1 or more refutes: see ``_against``.
    beyond_one = (whole >= 1 << bits) | (whole < -(1 << bits))
    large = np.flatnonzero((rows != columns) & beyond_one)
    if len(large):
        first = large[0]
        i = int(rows[first])
        j = int(columns[first])
        return _against(i, j, int(whole[first]), found.exponents)

    def dense(values: NDArray[Any]) -> NDArray[Any]:
        full = np.zeros((M.size, M.size), dtype=values.dtype)
        full[rows, columns] = full[columns, rows] = values
        return full

    mask = (1 << low_bits) - 1
    return Scaled(
        size=M.size,
        exponents=found.exponents,
        low_bits=low_bits,
        high=dense((whole >> 2 * low_bits).astype(np.int64)),
        middle=dense(((whole >> low_bits) & mask).astype(np.int64)),
        low=dense((whole & mask).astype(np.int64)),
        floats=dense(np.ldexp(whole.astype(np.float64), -bits)),
    )


@noun(eq=False)
class _Entries:
    """D = diag(2^-exponents), and 2^bits D M D at (rows, columns), rounded down, in Python's
    integers."""

    exponents: Whole
    rows: Whole
    columns: Whole
    values: NDArray[Any]


def _whole_entries(M: SparseSymmetric | IntegerSymmetric, bits: int) -> _Entries | None:
    """The entries of D M D; None if the diagonal is not positive.  A common denominator is left
    out: M > 0 does not depend on it."""
    if isinstance(M, IntegerSymmetric):
        rows = M.rows
        columns = M.columns
        numerators = M.values.astype(object)
        denominators = np.ones(len(rows), dtype=object)
    else:
        rows = np.array([i for i, _ in M.entries], dtype=np.int64)
        columns = np.array([j for _, j in M.entries], dtype=np.int64)
        numerators = np.array([x.numerator for x in M.entries.values()], dtype=object)
        denominators = np.array([x.denominator for x in M.entries.values()], dtype=object)
    on = rows == columns
    if np.count_nonzero(on) < M.size or not (numerators[on] > 0).all():
        return None
    # M_ii lies in (2^(e-1), 2^(e+1)), e the difference of the bit lengths; hence (D M D)_ii in
    # [1/8, 1).
    halves: list[int] = []
    for above, below in zip(numerators[on].tolist(), denominators[on].tolist(), strict=True):
        e = above.bit_length() - below.bit_length()
        halves.append((e + 2) // 2)
    exponents = np.zeros(M.size, dtype=np.int64)
    exponents[rows[on]] = halves
    shift = bits - exponents[rows] - exponents[columns]
    left = np.maximum(shift, 0).astype(object)
    right = np.maximum(-shift, 0).astype(object)
    whole = (numerators << left) // (denominators << right)  # // rounds down, also below 0
    return _Entries(exponents=exponents, rows=rows, columns=columns, values=whole)


def _against(i: int, j: int, entry: int, exponents: Whole) -> list[int]:
    """Return D (e_i -+ e_j) as integers: its value is d_ii + d_jj - 2 |d_ij| < 0 for D M D =
    (d_ij)."""
    e_i = int(exponents[i])
    e_j = int(exponents[j])
    top = max(e_i, e_j)
    direction = [0] * len(exponents)
    direction[i] = 1 << (top - e_i)
    direction[j] = (-1 if entry > 0 else 1) << (top - e_j)
    return direction


def proves_by_integers(S: Scaled) -> bool:
    """Tell whether M > 0 is proved by one of the proposed factors. Exact."""
    return any(leaves_dominated_rest(S, high, low) for high, low in integer_factors(S))


def margin(S: Scaled) -> float:
    """Return about the smallest eigenvalue of D M D that ``integer_factors`` can show: twice n
    roundings."""
    return 2 * S.size * 2.0 ** -(HIGH_BITS + S.low_bits)


def integer_factors(S: Scaled) -> Iterator[tuple[Floats, Floats]]:
    """Propose factors L = high 2^-25 + low 2^-(25 + low_bits) of D M D - c I, c the margin and then
    16 times that: lower triangular, both hold integers as doubles."""
    # The least shift that roundings leave room for; where doubles fail at it, a larger one.
    for often in (1, 16):
        L = _factor(S.floats, often * margin(S))
        if L is None:
            return
        high = np.rint(np.ldexp(L, HIGH_BITS))
        low = np.rint(np.ldexp(L - np.ldexp(high, -HIGH_BITS), HIGH_BITS + S.low_bits))
        yield high, low


def leaves_dominated_rest(S: Scaled, high: Floats, low: Floats) -> bool:
    """Whether D M D - L L' is dominated by its diagonal, any integers L; products in doubles stay
    below 2^53."""
    longest = 0.0  # of all rows: no product of two is larger than its square
    for part in (high, low):
        if not np.array_equal(part, np.rint(part)):
            return False
        longest = max(longest, float(np.sqrt((part * part).sum(axis=1).max())))
    if not longest**2 * _UPWARDS < _EXACT:
        return False
    n = S.size
    shift = S.low_bits

    def product(left: Floats, right: Floats) -> Whole:
        return (left @ right.T).astype(np.int64)

    for start in range(0, n, _BLOCK):
        rows = slice(start, min(start + _BLOCK, n))
        rest = (S.low[rows] - product(low[rows], low)) >> shift
        rest += S.middle[rows] - product(high[rows], low) - product(low[rows], high)
        top = S.high[rows] - product(high[rows], high)
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
    """Return D w for the columns w of ``eigenvectors`` (n, k), as integers: v'Mv is w'(D M D)w but
    for a factor."""
    lift = (S.exponents.max() - S.exponents).tolist()
    found: list[list[int]] = []
    for whole in np.rint(np.ldexp(eigenvectors.T, _DIRECTION_BITS)).tolist():
        found.append([int(x) << e for x, e in zip(whole, lift, strict=True)])
    return found


def _factor(A: Floats, shift: float) -> Floats | None:
    """Return the Cholesky factor of A - shift I in doubles, or None. It is finite; it proves
    nothing by itself."""
    shifted = A.copy()
    shifted.flat[:: len(A) + 1] -= shift
    try:
        L: Floats = np.linalg.cholesky(shifted).astype(np.float64)
    except np.linalg.LinAlgError:
        return None
    return L if bool(np.isfinite(L).all()) else None
