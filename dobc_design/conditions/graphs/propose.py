"""Proposals for the mean and the mean square of a Markov signal: weights, matrices and rates; no proofs.

The means of |e_i| in each mode obey a linear system with nonnegative entries beside the diagonal, those of e e' another
linear one.  With M minus that of the former, transposed, the means decay faster than at a rate iff (M - rate I)^-1 1 is
positive; these are weights for it.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, Final

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.graphs.claim import MEAN, SQUARE, Kept
from dobc_design.conditions.numbers import MANY_AGENTS, rounded_down
from dobc_design.conditions.separable.claim import holding_gains
from dobc_design.exact.matrix import Matrix, Vector, to_float
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.arrays import arc_table
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import round_matrix
from dobc_design.solvers.sparse import factored

BISECTIONS: Final = 14
SMALLEST: Final = 1e-9  # rate that counts (1/s)
SAFE: Final = 1 - 1e-6  # of a rate that floats show
STEADY: Final = 0.999  # of the best rate
MOST_ROWS: Final = 12  # n m, for the mean square
MOST_UNKNOWNS: Final = 1000
DIGITS: Final = 15


def mean_claim(problem: Problem, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Weights of every mode and the rate that they give, about; None where the means do not decay."""
    modes, n = problem.network.modes, problem.n
    slopes = np.array([float(each.jacobian_at_zero()[0][0].midpoint) for each in problem.couplings])
    blocks = []
    for mode in modes:
        table = arc_table(problem, mode)
        entries = to_float((table.weights,))[0][table.weight] * slopes[table.coupling]
        A = sparse.csr_array((entries, (table.listeners, table.speakers)), shape=(n, n))
        blocks.append((A - sparse.diags_array(A.sum(axis=1) + to_float((holding_gains(problem),))[0])).T)
    chain = sparse.kron(sparse.csr_array(to_float(generator)), sparse.eye_array(n))
    M = sparse.csr_array(-(sparse.block_diag(blocks) + chain))
    w = _weights(M, 0.0)
    if w is None:
        return None
    low, high = float(np.min(M @ w / w)), float(np.min(M.diagonal()))  # the best rate lies between
    for _ in range(BISECTIONS):
        middle = math.sqrt(max(low, SMALLEST) * high)
        found = _weights(M, middle)
        low, high, w = (low, middle, w) if found is None else (middle, high, found)
    rate = _observed(problem, W, float(np.min(M @ w / w)) * SAFE)
    if rate <= SMALLEST:
        return None
    each: list[Vector | Doubles] = []
    for part in w.reshape(len(modes), n):
        texts = tuple(Fraction(f"{x:.{DIGITS}g}") for x in part.tolist()) if n <= MANY_AGENTS else ()
        each.append(texts or Doubles(part))
    return Kept(kind=MEAN, rate=rounded_down(rate), w=dict(zip(modes, each, strict=True)))


def _weights(M: Any, rate: float) -> Any:
    """(M - rate I)^-1 1, up to a factor; None where that is not positive: M does not have the rate."""
    try:
        w = factored(M - rate * sparse.eye_array(M.shape[0])).solve(np.ones(M.shape[0]))
    except RuntimeError:  # singular
        return None
    w = w / np.max(np.abs(w))
    return w if np.all(w > 0) else None


def square_claim(problem: Problem, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Matrices of every mode for nearly the best rate; None for larger networks, and where none are found."""
    size, modes, statements = problem.n * problem.m, problem.network.modes, state_theorems(problem)
    if size > MOST_ROWS or len(modes) * size**2 > MOST_UNKNOWNS:
        return None
    parts = [linear_part(statements, mode) for mode in modes]
    known = [to_float(part) for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    unit = np.eye(size)
    blocks = [np.kron(A.T, unit) + np.kron(unit, A.T) for A in known]
    T: Any = sparse.block_diag(blocks).toarray() + np.kron(to_float(generator), np.eye(size**2))
    rate = _observed(problem, W, -float(np.max(np.linalg.eigvals(T).real)) / 2 * STEADY)
    if rate <= SMALLEST:
        return None
    P = np.linalg.solve(T + 2 * rate * np.eye(len(T)), -np.tile(unit.ravel(), len(known))).reshape(-1, size, size)
    forms = [round_matrix((each + each.T) / 2, 12) for each in P]
    return Kept(kind=SQUARE, rate=rounded_down(rate), P=dict(zip(modes, forms, strict=True)))


def _observed(problem: Problem, W: Matrix | None, rate: float) -> float:
    """The rate, below that of the estimation error."""
    exosystem = problem.joint_exosystem
    return rate if exosystem is None or W is None else min(rate, decay_rate(exosystem, W) * SAFE)
