"""Agents that measure y = H x only, by an observer of x and xi together with the gain W of the
file, (m + q, r). Its errors eps = (x - xhat, xi - xihat) obey

    eps' = F eps,    F = [[A - W_x H, B C], [-W_xi H, A_xi]]

and act on the errors e of the loop by E eps: where couplings and pins act on estimates, e is that
of xhat and E = W_x [H, 0]; where they act on outputs, e is that of x and E = B [0, C].
"""

from typing import Any

from .matrices import ZERO, Matrix, product


def pair_of(dynamics: Any, A: Matrix, C: Matrix) -> tuple[Matrix, Matrix]:
    """What the observer works with: how (x, xi) moves, and what of it is measured."""
    q = len(A)
    m = len(dynamics.A)
    felt = product(dynamics.B, C)
    moves = [[*dynamics.A[i], *felt[i]] for i in range(m)]
    moves += [[ZERO] * m + list(row) for row in A]
    return moves, [list(row) + [ZERO] * q for row in dynamics.H]


def error_of(dynamics: Any, A: Matrix, C: Matrix, W: Matrix) -> tuple[Matrix, Matrix]:
    """F and E."""
    m = len(dynamics.A)
    moves, seen = pair_of(dynamics, A, C)
    fed = product(W, seen)
    F = [[x - y for x, y in zip(*rows, strict=True)] for rows in zip(moves, fed, strict=True)]
    if dynamics.acts_on is None:
        return F, fed[:m]
    felt = product(dynamics.B, C)
    return F, [[ZERO] * m + list(row) for row in felt]
