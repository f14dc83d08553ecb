"""Floating-point estimates that the exact side then proves or not: eigenvalues, directions, rates.

An estimate that cannot be had is nan (or an infinity on the weak side), never an exception: what it would
have proposed is then decided without it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.consensus.dominating import dominating_vector
from dobc_design.conditions.consensus.jacobian import float_lambda
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.program import GIVEN_UP, Array

DENSE = 400  # rows up to which a dense symmetric eigensolver is the faster one
LARGEST_DENSE = 2000  # rows up to which it may step in where the iterative one fails
# Lanczos vectors and tolerance, tried in turn.
LANCZOS = ((20, 1e-9), (80, 1e-7))
RESTARTS = 300  # rings hold it up for ever: their eigenvalues crowd at the top


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Top:
    """Largest eigenvalue of a symmetric matrix, about, and its direction; nan and zeros if it cannot be had."""

    value: float
    vector: Array
    shows: Array | None = None  # v > 0 that is to prove it, of large matrices; ``value`` is then that bound


def largest_eigenvalue(table: Any) -> Top:
    """Estimate the largest eigenvalue of a symmetric SciPy array (n, n), and its vector."""
    size = table.shape[0]
    largest = float(np.max(np.abs(table.data), initial=0.0))
    if largest == 0:
        return Top(value=0.0, vector=np.ones(size))
    if not math.isfinite(largest):
        return Top(value=math.nan, vector=np.zeros(size))
    unit = math.ldexp(1.0, math.frexp(largest)[1] - 1)  # entries of size 1: no square over- or underflows
    found = None
    if size > DENSE:
        found = _lanczos(sparse.csr_array(table / unit))
    if found is None and size <= max(DENSE, LARGEST_DENSE):
        found = _dense(table.toarray() / unit)
    if found is None:
        return Top(value=math.nan, vector=np.zeros(size))
    return Top(value=found.value * unit, vector=found.vector)


def _dense(matrix: Array) -> Top | None:
    last = len(matrix) - 1
    try:
        values, vectors = linalg.eigh(matrix, subset_by_index=(last, last))
        return Top(value=float(values[0]), vector=vectors[:, 0])
    except GIVEN_UP:
        return None


def _lanczos(matrix: Any) -> Top | None:
    # The start is fixed, so that answers can be reproduced, and irregular: one that has a symmetry of
    # the network never sees a direction without it.
    start = 1.0 + 0.1 * np.random.default_rng(0).standard_normal(matrix.shape[0])
    for vectors, tolerance in LANCZOS:
        try:
            values, columns = sparse.linalg.eigsh(
                matrix, k=1, which="LA", v0=start, tol=tolerance, ncv=vectors, maxiter=RESTARTS
            )
            return Top(value=float(values[0]), vector=columns[:, 0])
        except GIVEN_UP:  # no convergence among them
            continue
    return None


def lambda_tops(statements: Statements) -> dict[str, Top]:
    """lambda_max(Lambda) and its direction, for every mode to which the theorems apply."""
    return {mode: _top(float_lambda(statements.problem, mode)) for mode in statements.lambdas}


def _top(table: Any) -> Top:
    """By a vector v > 0 where the matrix is large and one shows that it is negative; else the eigenvalue."""
    if table.shape[0] > LARGEST_DENSE:
        found = dominating_vector(table)
        if found is not None and found.least > 0:
            return Top(value=-found.least, vector=found.vector, shows=found.vector)
        if found is not None and found.is_z and np.any(found.vector):
            return Top(value=math.nan, vector=found.vector)
    return largest_eigenvalue(table)


def decay_rate(exosystem: Exosystem, W: Matrix) -> float:
    """-max Re of the spectrum of A - WC (1/s), about; negative when the error grows, nan if it cannot be had."""
    try:
        error = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
        return float(-np.max(np.linalg.eigvals(error).real))
    except GIVEN_UP:
        return math.nan


def pair_margin(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """-(lambda_max(Lambda) + lambda_max(S)): how much Lambda may still rise.  -inf if Omega0 is not negative."""
    return -(max(top.value for top in tops.values()) + _lambda_max_of_s(P, Q, exosystem, rate=0.0))


def pair_rate(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """The largest beta with Psi + 2 beta diag(I, I (x) P) < 0, about; 0 if there is none."""
    bound = max(top.value for top in tops.values())
    if not math.isfinite(bound):
        return 0.0
    low, high = 0.0, max(0.0, -bound / 2)
    for _ in range(60):
        middle = (low + high) / 2
        if bound + 2 * middle + _lambda_max_of_s(P, Q, exosystem, rate=middle) < 0:
            low = middle
        else:
            high = middle
    return low


def _lambda_max_of_s(P: Array, Q: Array, exosystem: Exosystem, *, rate: float) -> float:
    try:
        A, C = to_float(exosystem.A), to_float(exosystem.C)
        with np.errstate(over="ignore", invalid="ignore"):  # the factorisation below refuses what is not finite
            block = -(P @ A + A.T @ P - Q @ C - C.T @ Q.T) - 2 * rate * P
            block = (block + block.T) / 2
        factor = linalg.cho_factor(block)
        S = C @ linalg.cho_solve(factor, C.T)
        return float(np.linalg.eigvalsh((S + S.T) / 2)[-1])
    except GIVEN_UP:
        return math.inf


def directions(tops: Mapping[str, Top]) -> list[Sequence[float]]:
    """The directions, slowest mode first: candidates for witnesses."""
    return [top.vector.tolist() for top in sorted(tops.values(), key=lambda top: -top.value)]
