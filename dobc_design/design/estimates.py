"""Floating-point estimates that the exact side then proves or not: eigenvalues, directions, rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, sparse

from dobc_design.design.program import Array
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.spec.exosystem import Exosystem
from dobc_design.theorems.statements import Statements

DENSE = 400  # rows up to which a dense symmetric eigensolver is the faster one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Top:
    """Largest eigenvalue of a symmetric matrix, about, and its direction."""

    value: float
    vector: Array


def largest_eigenvalue(matrix: SparseSymmetric) -> Top:
    """Estimate the largest eigenvalue and its vector."""
    rows, columns, values = matrix.triplets()
    table = sparse.csr_array((values, (rows, columns)), shape=(matrix.size, matrix.size))
    if matrix.size <= DENSE:
        eigenvalues, vectors = np.linalg.eigh(table.toarray())
        return Top(value=float(eigenvalues[-1]), vector=vectors[:, -1])
    start = np.ones(matrix.size)  # a fixed start keeps the answer reproducible
    eigenvalues, vectors = sparse.linalg.eigsh(table, k=1, which="LA", v0=start, tol=1e-9, maxiter=20 * matrix.size)
    return Top(value=float(eigenvalues[0]), vector=vectors[:, 0])


def lambda_tops(statements: Statements) -> dict[str, Top]:
    """lambda_max(Lambda) and its direction, for every mode."""
    return {mode: largest_eigenvalue(pencil.constant) for mode, pencil in statements.lambdas.items()}


def decay_rate(exosystem: Exosystem, W: Matrix) -> float:
    """-max Re of the spectrum of A - WC (1/s); negative when the error grows."""
    error = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
    return float(-np.max(np.linalg.eigvals(error).real))


def pair_margin(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """-(lambda_max(Lambda) + lambda_max(S)): how much Lambda may still rise.  -inf if Omega0 is not negative."""
    return -(max(top.value for top in tops.values()) + _lambda_max_of_s(P, Q, exosystem, rate=0.0))


def pair_rate(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """The largest beta with Psi + 2 beta diag(I, I (x) P) < 0, about; 0 if there is none."""
    bound = max(top.value for top in tops.values())
    low, high = 0.0, max(0.0, -bound / 2)
    for _ in range(60):
        middle = (low + high) / 2
        if bound + 2 * middle + _lambda_max_of_s(P, Q, exosystem, rate=middle) < 0:
            low = middle
        else:
            high = middle
    return low


def _lambda_max_of_s(P: Array, Q: Array, exosystem: Exosystem, *, rate: float) -> float:
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    block = -(P @ A + A.T @ P - Q @ C - C.T @ Q.T) - 2 * rate * P
    try:
        factor = linalg.cho_factor((block + block.T) / 2)
    except (linalg.LinAlgError, ValueError):
        return float("inf")
    S = C @ linalg.cho_solve(factor, C.T)
    return float(np.linalg.eigvalsh((S + S.T) / 2)[-1])


def directions(tops: Mapping[str, Top]) -> list[Sequence[float]]:
    """The directions, slowest mode first: candidates for witnesses."""
    return [top.vector.tolist() for top in sorted(tops.values(), key=lambda top: -top.value)]
