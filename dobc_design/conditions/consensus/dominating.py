"""A vector v > 0 that shows how far below 0 the largest eigenvalue of a large Lambda is, by conjugate gradients.

With M = -Lambda and a minus sign beside the diagonal, lambda_min(M) >= min (M v)_i / v_i for every v > 0 (theory,
section 8), and that is near it for v from inverse iteration: (M - shift I) v = right with a shift that v itself has
shown to be below the least eigenvalue.  Products with M are counted.  A proposal: ``exact.zmatrix.row_bound`` decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import sparse

from dobc_design.solvers.program import GIVEN_UP, Array

#: The bound is sharpened until it is this close to the least eigenvalue, or so many products are spent; in no case
#: more than MOST_PRODUCTS, unless the first bound took as many.
CLOSE: Final = 0.01
ENOUGH: Final = 250
MOST_PRODUCTS: Final = 450
ROUNDS: Final = 6
# Steps before a factorisation is tried where the network is little more than lines and rings; and in the end.
PATIENCE: Final = 300
MOST_STEPS: Final = 20_000
FEW_ENTRIES: Final = 4
# A row is met when this part of its right side is left at most.
LEFT: Final = 0.25
#: The right side of inverse iteration is at least this part of its largest entry.
FLOOR: Final = 0.1
_FLAT: Final = 1e-15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dominating:
    """v > 0 (n m,) and about min (M v)_i / v_i; or a direction p with p'Mp about <= 0 (``least`` <= 0), or neither.

    ``first``: products until M > 0 was seen; ``products``: all of them.  ``is_z``: M has minus signs beside its
    diagonal; if it has not, that no vector is found says nothing.
    """

    vector: Array
    least: float
    first: int
    products: int
    is_z: bool


def dominating_vector(table: Any) -> Dominating | None:
    """Look for v for a symmetric SciPy array (Lambda), its bound close to the best; None if floats do not hold it."""
    work = _work(table)
    found = None if work is None else _at(work, 0.0)
    if work is None or found is None or not found.least >= 0:
        return found
    vector, least = _sharpened(work, found.vector)
    return Dominating(vector=vector, least=least, first=found.products, products=work.products, is_z=work.is_z)


def vector_at(table: Any, *, shift: float) -> Dominating | None:
    """Look for v with M v > shift v, one question: ``least`` is the shift, or -inf beside a direction."""
    work = _work(table)
    return None if work is None else _at(work, shift)


def _at(work: _Work, shift: float) -> Dominating:
    found = _solve(work, shift=shift, right=np.ones(len(work.diagonal)), start=None)
    least = shift
    if found is None or not np.all(found > 0):
        direction = work.direction if found is None else np.maximum(-found, 0.0)
        found, least = np.zeros(len(work.diagonal)) if direction is None else np.abs(direction), -math.inf
    return Dominating(vector=found, least=least, first=work.products, products=work.products, is_z=work.is_z)


def _work(table: Any) -> _Work | None:
    """M with minus signs beside the diagonal; None for entries that are not finite."""
    matrix = sparse.csr_array(table)
    matrix.sum_duplicates()
    if not np.all(np.isfinite(matrix.data)):
        return None
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    beside = rows != matrix.indices
    data = np.where(beside, -np.abs(matrix.data), -matrix.data)
    return _Work(
        matrix=sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape),
        diagonal=-matrix.diagonal(),
        is_z=bool(np.all(matrix.data[beside] >= 0)),
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Work:
    """M with minus signs beside the diagonal, the products so far, the last direction of curvature <= 0."""

    matrix: Any
    diagonal: Array
    is_z: bool
    products: int = 0
    direction: Array | None = None

    def times(self, x: Array) -> Array:
        self.products += 1
        return np.asarray(self.matrix @ x)


def _sharpened(work: _Work, v: Array) -> tuple[Array, float]:
    """Inverse iteration with a shift at the bound so far, until the bound is close or nothing is gained."""
    least = _least(work, v)
    for _ in range(ROUNDS):
        highest = float(v @ work.times(v)) / float(v @ v)
        if least >= (1 - CLOSE) * highest or work.products >= ENOUGH:
            break
        shift = least * (1 - 1e-3)
        right = np.maximum(v / np.max(v), FLOOR)
        start = right / max(highest - shift, 1e-3 * shift)
        found, _ = _iterate(work, shift, right, start, min(PATIENCE, MOST_PRODUCTS - work.products))
        if found is None or not np.all(found > 0):
            break
        better = _least(work, found)
        if not better > least:
            break
        v, least = found, better
    return v, least


def _least(work: _Work, v: Array) -> float:
    return float(np.min(work.times(v) / v))


def _solve(work: _Work, *, shift: float, right: Array, start: Array | None) -> Array | None:
    """(M - shift I) x = right until every row is met but for a part; None if M - shift I is not seen to be positive."""
    found, done = _iterate(work, shift, right, start, PATIENCE)
    if done or found is None:
        return found
    if work.matrix.nnz <= FEW_ENTRIES * len(right):
        return _factorised(work, shift, right)
    found, done = _iterate(work, shift, right, found, MOST_STEPS)
    return found if done else None


def _iterate(work: _Work, shift: float, right: Array, start: Array | None, most: int) -> tuple[Array | None, bool]:
    """Conjugate gradients with Jacobi scaling: x (None where a direction of curvature <= 0 was met), and whether it is
    done."""
    scale = work.diagonal - shift
    if not np.all(scale > 0):
        work.direction = _unit(len(right), int(np.argmin(scale)))
        return None, False
    x = np.zeros(len(right)) if start is None else start.copy()
    residual = right.copy() if start is None else right - (work.times(x) - shift * x)
    z = residual / scale
    p = z.copy()
    square = float(residual @ z)
    for _ in range(most):
        if np.all(np.abs(residual) <= LEFT * right):
            return x, True
        image = work.times(p) - shift * p
        curvature = float(p @ image)
        if not curvature > _FLAT * float(p @ (scale * p)):
            work.direction = p
            return None, False
        step = square / curvature
        x += step * p
        residual -= step * image
        z = residual / scale
        square, last = float(residual @ z), square
        p = z + (square / last) * p
    return x, False


def _factorised(work: _Work, shift: float, right: Array) -> Array | None:
    """One sparse factorisation; it counts as the products that its time is worth, about."""
    work.products += 20
    try:
        shifted = sparse.csc_array(work.matrix - shift * sparse.eye_array(len(right)))
        found = np.asarray(sparse.linalg.splu(shifted).solve(right))
    except GIVEN_UP:
        return None
    return found if np.all(np.isfinite(found)) else None


def _unit(size: int, place: int) -> Array:
    vector = np.zeros(size)
    vector[place] = 1.0
    return vector
