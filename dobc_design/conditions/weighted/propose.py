"""Proposals for weighted Theorems 1 and 2: rates, weights D, vectors w, the observer's P; no proofs.

For beta below the least real part mu of an eigenvalue of M, w = (M - beta I)^-1 1 and u = (M - beta I)^-T 1 are
positive, and D = diag(u / w) makes D (M - beta I) + (M - beta I)'D positive definite (theory, section 10).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import csgraph

from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.consensus.propose import DENSE, decay_rate
from dobc_design.conditions.numbers import MANY_AGENTS, shorten
from dobc_design.conditions.weighted.claim import Weighted
from dobc_design.conditions.weighted.decide import observer_bounds
from dobc_design.exact.matrix import Matrix, Vector, to_float
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.arrays import consensus_jacobian, pinning_matrix
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.groups import gains_of, group_numbers
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array, round_matrix

PARTS = (
    0.99995,
    0.999,
    0.995,
    0.98,
    0.95,
    0.9,
    0.75,
    0.5,
    0.25,
    0.1,
    0.01,
    0.0,
)  # of the rate that is thought possible
STEPS = 30  # towards mu
NEARLY = 0.99
DROPPED, FILL = 1e-4, 10  # of incomplete factorisations
CLOSE, QUICK = 1e-6, 100  # where iterations stop
GIVEN_UP = (ArithmeticError, RuntimeError, ValueError, np.linalg.LinAlgError)


def proposals(statements: Statements, W: Matrix | None) -> Iterator[tuple[Weighted, float]]:
    """Claims with their rates (1/s), the fastest first."""
    problem = statements.problem
    tables = {mode: _stiffness(problem, mode) for mode in problem.network.modes}
    if any(table is None for table in tables.values()):
        return
    known: dict[str, Any] = {mode: table for mode, table in tables.items() if table is not None}
    most = min(map(abscissa, known.values()))
    if not most > 0:
        return
    if problem.groups:
        if W is None:
            return
        decay = min(decay_rate(group.exosystem, gain) for group, gain in _gains(problem, W))
        most = min(most, 0.9995 * decay)
    for part in PARTS:
        rate = shorten(part * most, digits=6)
        try:
            found = _at(problem, known, W, rate)
        except GIVEN_UP:
            continue
        if found is not None:
            yield found, rate


def _stiffness(problem: Problem, mode: str) -> Any:
    """M = K - dh/de at the target, (n m, n m) sparse; None where it cannot be had."""
    jacobian = consensus_jacobian(problem, mode)
    return None if jacobian is None else sparse.csc_array(pinning_matrix(problem) - jacobian)


def abscissa(table: Any) -> float:
    """About the least real part mu of an eigenvalue of an M-matrix; from below for large ones, 0 if none is seen."""
    if table.shape[0] <= DENSE:
        return float(np.linalg.eigvals(table.toarray()).real.min())
    if csgraph.connected_components(table, connection="strong")[0] == table.shape[0]:
        return float(table.diagonal().min())  # nobody hears back: M is triangular in some order
    low, w = 0.0, np.ones(table.shape[0])
    for _ in range(STEPS):
        solve = _solver(table, low)
        better = None if solve is None else solve(w, "N")
        if better is None:
            break
        gain = float(np.min(w / better))  # (M - low I) better = w >= gain better, so mu - low >= gain
        low, w = low + NEARLY * gain, better / np.max(better)
        if gain <= 1e-3 * low:
            break
    return low


def _solver(table: Any, rate: float) -> Callable[[Array, str], Array | None] | None:
    """Solutions of (M - rate I) x = b > 0, or with the transpose ("T"): by iteration where that is quick, else by a
    factorisation.  None for a solution that is not positive: then rate is not below mu."""
    shifted = sparse.csc_array(table - rate * sparse.eye_array(table.shape[0]))
    matrices = {"N": sparse.csr_array(shifted), "T": sparse.csr_array(shifted.T)}
    scale = shifted.diagonal()
    if not np.all(scale > 0):
        return None
    factors: list[Any] = []

    def solve(right: Array, which: str) -> Array | None:
        matrix = matrices[which]
        with np.errstate(all="ignore"), suppress(*GIVEN_UP):
            if not factors:
                near = sparse.diags_array(1 / scale)
                found, missed = sparse.linalg.bicgstab(matrix, right, x0=right / scale, M=near, rtol=CLOSE, maxiter=QUICK)
                if not missed and np.all(np.isfinite(found)) and np.all(found > 0):
                    return found
                factors.append(sparse.linalg.spilu(shifted, drop_tol=DROPPED, fill_factor=FILL))
            near = sparse.linalg.LinearOperator(matrix.shape, matvec=lambda x: factors[0].solve(x, which))
            start = factors[0].solve(right, which)
            found, _ = sparse.linalg.bicgstab(matrix, right, x0=start, M=near, rtol=CLOSE, maxiter=QUICK)
            return found if np.all(np.isfinite(found)) and np.all(found > 0) else None
        return None

    return solve


def _at(problem: Problem, tables: Mapping[str, Any], W: Matrix | None, rate: float) -> Weighted | None:
    """Weights for this rate, common to all modes; None if none is seen."""
    pairs = []
    for M in tables.values():
        solve, ones = _solver(M, rate), np.ones(M.shape[0])
        pairs.append((None, None) if solve is None else (solve(ones, "N"), solve(ones, "T")))
    if any(w is None or u is None for w, u in pairs):
        return None
    own = [np.log(u) - np.log(w) for w, u in pairs if w is not None and u is not None]
    candidates = [np.mean(own, axis=0), *(own if len(own) > 1 else ())]
    P = _lyapunov(problem, W, rate) if problem.groups and W is not None else None
    sigma = observer_bounds(problem, P, W, rate=Fraction(repr(rate)))
    if sigma is None:
        return None
    owners = np.repeat(group_numbers(problem.groups, problem.network.labels), problem.m)
    weight = np.array([float(x) for x in sigma])[owners]
    for logarithms in candidates:
        D = np.exp(logarithms - logarithms.max())
        heights = {}
        for mode, M in tables.items():
            symmetric = sparse.diags_array(D) @ M
            symmetric = sparse.csc_array(symmetric + symmetric.T - 2 * rate * sparse.diags_array(D))
            w = pairs[0][0] if len(tables) == 1 else _positive(symmetric)
            if w is None:
                break
            heights[mode] = (w, np.asarray(symmetric @ w))
        else:
            with np.errstate(divide="ignore", over="ignore"):
                room = min(float(np.min(rise / (weight * D * D * w))) for w, rise in heights.values())
            if not room > 0:
                continue
            D *= min(1.0, room / 2)
            return Weighted(D=rounded(D), w={mode: rounded(w) for mode, (w, _) in heights.items()}, P=P)
    return None


def _positive(symmetric: Any) -> Array | None:
    found = np.asarray(sparse.linalg.splu(symmetric).solve(np.ones(symmetric.shape[0])))
    return found if np.all(np.isfinite(found)) and np.all(found > 0) else None


def rounded(x: Array) -> Vector | Doubles:
    """Decimals of eight digits for few agents, doubles for many."""
    if len(x) > MANY_AGENTS:
        return Doubles(x)
    return tuple(Fraction(f"{value:.8g}") for value in x.tolist())


def _gains(problem: Problem, W: Matrix) -> Iterator[tuple[Any, Matrix]]:
    return zip(problem.groups, gains_of(problem.groups, W), strict=True)


def _lyapunov(problem: Problem, W: Matrix, rate: float) -> Matrix | None:
    """P with (A - WC)'P + P(A - WC) + 2 rate P about -I, for each group."""
    blocks = []
    for group, gain in _gains(problem, W):
        A, C = to_float(group.exosystem.A), to_float(group.exosystem.C)
        error = A - to_float(gain) @ C + rate * np.eye(len(A))
        P = linalg.solve_continuous_lyapunov(error.T, -np.eye(len(A)))
        if not np.all(np.isfinite(P)):
            return None
        blocks.append(round_matrix((P + P.T) / 2, 9))
    return block_diagonal(blocks)
