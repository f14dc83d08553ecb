"""Lyapunov equations over the rationals: F'X + X F + N = 0, solved without rounding."""

from __future__ import annotations

from fractions import Fraction

from dobc_design._checks import require_shape, require_square
from dobc_design.exact.matrix import Matrix, Vector, row_echelon


def solve_lyapunov(F: Matrix, N: Matrix) -> Matrix | None:
    """Return the symmetric X with F'X + X F + N = 0, or None if there is no unique one.

    Shapes: F, N and X (q, q), N symmetric. X is unique iff no two eigenvalues of F add up to 0.
    Raises: ShapeError if the shapes do not fit. Source: Lyapunov 1892, as q (q + 1)/2 linear equations.
    """
    q = require_square(F, name="F")
    require_shape(N, (q, q), name="N", because="as F")
    places = [(i, j) for i in range(q) for j in range(i, q)]
    index = {place: k for k, place in enumerate(places)}
    rows: list[Vector] = []
    for i, j in places:
        row = [Fraction(0)] * (len(places) + 1)
        for r in range(q):  # (F'X + XF)_ij = sum_r F_ri X_rj + X_ir F_rj
            row[index[min(r, j), max(r, j)]] += F[r][i]
            row[index[min(i, r), max(i, r)]] += F[r][j]
        row[-1] = -N[i][j]
        rows.append(tuple(row))
    reduced, pivots = row_echelon(tuple(rows))
    if pivots != tuple(range(len(places))):
        return None
    return tuple(tuple(reduced[index[min(i, j), max(i, j)]][-1] for j in range(q)) for i in range(q))
