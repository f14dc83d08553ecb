"""Positive definiteness of sparse Z-matrices by a vector: v > 0 with M v > 0, checked in integers.

A symmetric matrix whose off-diagonal entries are <= 0 is positive definite iff such a v exists
(theory, section 3; it is then a nonsingular M-matrix). Finding v is floating point and may fail;
checking it is exact and linear in the entries, where an elimination would fill in.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact.symmetric import SparseSymmetric

# Bits kept of the largest entry of v: more than a double has, so that rounding loses nothing.
_BITS: Final = 60


def positive_vector(M: SparseSymmetric) -> tuple[int, ...] | None:
    """Return integers v > 0 with M v > 0, proved; None if M is no Z-matrix or none was found."""
    if any(i != j and value > 0 for (i, j), value in M.entries.items()):
        return None
    if any(M.entries.get((i, i), 0) <= 0 for i in range(M.size)):
        return None
    solution = _solve(M)
    if solution is None:
        return None
    largest = float(np.max(solution))
    shift = _BITS - math.frexp(largest)[1]
    vector = tuple(int(math.ldexp(x, shift)) for x in solution.tolist())
    return vector if is_positive_vector(M, vector) else None


def is_positive_vector(M: SparseSymmetric, vector: tuple[int, ...]) -> bool:
    """Tell whether v > 0 and M v > 0 hold, in integers. Proves M > 0 for a Z-matrix M only."""
    if len(vector) != M.size or any(x <= 0 for x in vector):
        return False
    common = math.lcm(1, *{value.denominator for value in M.entries.values()})
    rows = [0] * M.size
    for (i, j), value in M.entries.items():
        entry = value.numerator * (common // value.denominator)
        rows[i] += entry * vector[j]
        if i != j:
            rows[j] += entry * vector[i]
    return all(row > 0 for row in rows)


def _solve(M: SparseSymmetric) -> NDArray[np.float64] | None:
    """Solve M v = diag(M) by conjugate gradients with Jacobi scaling; None on breakdown or v <= 0."""
    rows, columns, values = M.triplets()
    diagonal = np.zeros(M.size)
    on = rows == columns
    diagonal[rows[on]] = values[on]
    if not (np.all(np.isfinite(values)) and np.all(diagonal > 0)):
        return None
    root = 1 / np.sqrt(diagonal)
    scaled = values * root[rows] * root[columns]
    b = np.sqrt(diagonal)
    x = np.zeros(M.size)
    residual, direction = b.copy(), b.copy()
    square = float(residual @ residual)
    for _ in range(2 * M.size + 50):
        product = np.bincount(rows, weights=scaled * direction[columns], minlength=M.size)
        curvature = float(direction @ product)
        if not curvature > 0:
            return None
        x += square / curvature * direction
        residual -= square / curvature * product
        previous, square = square, float(residual @ residual)
        # M v = diag(M) is only a wish: any v with M v > 0 will do, and half of each row is enough.
        if np.all(np.abs(residual) <= 0.5 * b):
            v = x * root
            return v if bool(np.all(v > 0)) else None
        direction = residual + square / previous * direction
    return None
