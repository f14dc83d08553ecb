"""The P_e that decreases best at given matrices, with the dual: one semidefinite program for Clarabel.

    minimise t   subject to   A_k'P + P A_k <= t I for all k,   P >= 0,   tr P = 1

Its dual: X_k >= 0 with sum tr X_k = 1 and sum (A_k X_k + X_k A_k') >= t I (for a diagonal P: that diagonal >= t).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.solvers.program import Array, is_solver_failure

ROOT2 = math.sqrt(2.0)


@dataclass(frozen=True, slots=True)
class Corners:
    """The least t, P (N, N) and X_k (N, N), symmetric."""

    value: float
    P: Array
    X: list[Array]


def solve_corners(matrices: Sequence[Array], *, diagonal: bool, time_limit: float = 30.0) -> Corners | None:
    """Solve for all A_k (N, N) of ``matrices``; None where the solver gives no point.  P diagonal or full."""
    import clarabel

    size = len(matrices[0])
    places = [(i, i) for i in range(size)] if diagonal else [(i, j) for j in range(size) for i in range(j + 1)]
    rows = size * (size + 1) // 2
    columns, right, cones = [], [], []
    for A in matrices:
        block = np.zeros((rows, len(places) + 1))
        for k, (i, j) in enumerate(places):
            block[:, k] = _svec(_derivative(A, i, j))
        block[_diagonal_places(size), -1] = -1.0
        columns.append(block)
        right.append(np.zeros(rows))
        cones.append(clarabel.PSDTriangleConeT(size))
    columns += [_positive(places, size, rows, diagonal=diagonal), _trace(places)]
    right += [np.zeros(len(columns[-2])), np.ones(1)]
    cones += [clarabel.NonnegativeConeT(size) if diagonal else clarabel.PSDTriangleConeT(size), clarabel.ZeroConeT(1)]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.time_limit = False, time_limit
    width = len(places) + 1
    cost = np.zeros(width)
    cost[-1] = 1.0
    try:
        answer: Any = clarabel.DefaultSolver(
            sparse.csc_matrix((width, width)),
            cost,
            sparse.csc_matrix(np.vstack(columns)),
            np.concatenate(right),
            cones,
            settings,
        ).solve()
    except BaseException as error:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(error):
            raise
        return None
    x, z = np.asarray(answer.x, dtype=float), np.asarray(answer.z, dtype=float)
    if "Infeasible" in str(answer.status) or not (np.all(np.isfinite(x)) and np.all(np.isfinite(z))):
        return None
    P = np.zeros((size, size))
    for (i, j), value in zip(places, x, strict=False):
        P[i, j] = P[j, i] = value
    return Corners(float(x[-1]), P, [_smat(z[k * rows : (k + 1) * rows], size) for k in range(len(matrices))])


def _derivative(A: Array, i: int, j: int) -> Array:
    """A'E + E A for the symmetric unit matrix E of the place (i, j)."""
    E = np.zeros_like(A)
    E[i, j] = E[j, i] = 1.0
    product: Array = E @ A
    return product + product.T


def _positive(places: Sequence[tuple[int, int]], size: int, rows: int, *, diagonal: bool) -> Array:
    block = np.zeros((size if diagonal else rows, len(places) + 1))
    for k, (i, j) in enumerate(places):
        if diagonal:
            block[i, k] = -1.0
        else:
            block[j * (j + 1) // 2 + i, k] = -1.0 if i == j else -ROOT2
    return block


def _trace(places: Sequence[tuple[int, int]]) -> Array:
    return np.array([[*(1.0 if i == j else 0.0 for i, j in places), 0.0]])


def _svec(matrix: Array) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    j, i = np.tril_indices(len(matrix))
    return np.asarray(matrix[i, j] * np.where(i == j, 1.0, ROOT2))


def _smat(vector: Array, size: int) -> Array:
    j, i = np.tril_indices(size)
    matrix = np.zeros((size, size))
    matrix[i, j] = matrix[j, i] = vector / np.where(i == j, 1.0, ROOT2)
    return matrix


def _diagonal_places(size: int) -> Any:
    j = np.arange(size)
    return j * (j + 3) // 2
