"""Proposals for weighted Theorems 1 and 2: rates, weights D, vectors w, the observer's P; no proofs.

For beta below the least real part mu of an eigenvalue of M, w = (M - beta I)^-1 1 and u = (M - beta I)^-T 1 are
positive, and D = diag(u / w) makes D (M - beta I) + (M - beta I)'D positive definite (theory, section 10).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from dobc_design.solvers.conic import Cone, solve_cones, svec
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
BISECTIONS = 8
LARGEST_PROGRAM = 60  # states for which the weights of several modes are sought by a semidefinite program
MARGIN = 1e-6
PART = 1e-3
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
    several = len(known) > 1
    if several:  # the largest rate that common weights can have, about
        low, high = 0.0, most
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (low, middle) if not _weights(known, middle) else (middle, high)
        most = low
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
    """Solutions of (M - rate I) x = b > 0, or with the transpose ("T"), about: by iteration where that is quick and the
    network large, else by a factorisation.  None where none is positive, each row met up to a part of its terms."""
    size = table.shape[0]
    shifted = sparse.csc_array(table - rate * sparse.eye_array(size))
    matrices = {"N": sparse.csr_array(shifted), "T": sparse.csr_array(shifted.T)}
    scale = shifted.diagonal()
    if not np.all(scale > 0):
        return None
    factors: list[Any] = []

    def answers(right: Array, which: str) -> Iterator[Array]:
        matrix = matrices[which]
        if size > DENSE and not factors:
            near = sparse.diags_array(1 / scale)
            yield sparse.linalg.bicgstab(matrix, right, x0=right / scale, M=near, rtol=CLOSE, maxiter=QUICK)[0]
        if not factors:
            whole = (
                {"drop_tol": DROPPED, "fill_factor": FILL} if size > DENSE else {"drop_tol": 0.0, "fill_factor": size}
            )
            factors.append(sparse.linalg.spilu(shifted, **whole))
        start = factors[0].solve(right, which)
        yield start
        near = sparse.linalg.LinearOperator(matrix.shape, matvec=lambda x: factors[0].solve(x, which))
        yield sparse.linalg.bicgstab(matrix, right, x0=start, M=near, rtol=CLOSE, maxiter=QUICK)[0]

    def solve(right: Array, which: str) -> Array | None:
        with np.errstate(all="ignore"), suppress(*GIVEN_UP):
            for x in answers(right, which):
                missed = np.abs(matrices[which] @ x - right)
                if np.all(np.isfinite(x)) and np.all(x > 0) and np.all(missed <= PART * (scale * x + right)):
                    return np.asarray(x)
        return None

    return solve


def _weights(tables: Mapping[str, Any], rate: float) -> list[Array]:
    """Weights D (n m,) that seem to do for this rate in every mode, the largest 1; none if none are seen."""
    logarithms = []
    for M in tables.values():
        solve, ones = _solver(M, rate), np.ones(M.shape[0])
        w, u = (None, None) if solve is None else (solve(ones, "N"), solve(ones, "T"))
        if w is None or u is None:
            return []
        logarithms.append(np.log(u) - np.log(w))
    found = [np.mean(logarithms, axis=0), *(logarithms if len(logarithms) > 1 else ())]
    weights = [np.exp(each - each.max()) for each in found]
    if len(tables) == 1:
        return weights
    if len(weights[0]) <= LARGEST_PROGRAM:
        weights += _program(tables, rate)
    return [D for D in weights if all(_height(M, D, rate) is not None for M in tables.values())]


def _program(tables: Mapping[str, Any], rate: float) -> list[Array]:
    """The most even D >= 1 with D (M - rate I) + (M - rate I)'D >= 0 and a little more, by a semidefinite program."""
    size = len(next(iter(tables.values())).toarray())
    cones = [
        Cone("nonnegative", np.column_stack([-np.eye(size), np.zeros(size)]), -np.ones(size)),
        Cone("nonnegative", np.column_stack([np.eye(size), -np.ones(size)]), np.zeros(size)),
    ]
    for M in tables.values():
        rows = M.toarray() - rate * np.eye(size)
        units = [np.outer(e, row) + np.outer(row, e) for e, row in zip(np.eye(size), rows, strict=True)]
        columns = np.column_stack([*(-svec(unit) for unit in units), np.zeros(size * (size + 1) // 2)])
        cones.append(Cone("semidefinite", columns, -svec(MARGIN * float(np.abs(rows).max()) * np.eye(size))))
    answer = solve_cones(np.append(np.zeros(size), 1.0), cones)
    found = answer.x[:size] if answer.found else np.zeros(0)
    return [found / found.max()] if len(found) and found.min() > 0 else []


def _height(M: Any, D: Array, rate: float) -> tuple[Array, Array] | None:
    """w > 0 with N w > 0 for N = D (M - rate I) + (M - rate I)'D, and N w; None if none is seen."""
    root = np.sqrt(D)  # N = diag(root) (X + X') diag(root), and X is scaled alike in all rows
    X = sparse.diags_array(root) @ M @ sparse.diags_array(1 / root) - rate * sparse.eye_array(len(D))
    even = sparse.csc_array(X + X.T)
    solve = _solver(even, 0.0)
    z = None if solve is None else solve(np.ones(len(D)), "N")
    rise = np.zeros(len(D)) if z is None else root * np.asarray(even @ z)
    return None if z is None or not np.all(rise > 0) else (z / root, rise)


def _at(problem: Problem, tables: Mapping[str, Any], W: Matrix | None, rate: float) -> Weighted | None:
    """Weights for this rate, common to all modes; None if none is seen."""
    P = _lyapunov(problem, W, rate) if problem.groups and W is not None else None
    sigma = observer_bounds(problem, P, W, rate=Fraction(repr(rate)))
    return None if sigma is None else _scaled(problem, tables, rate, sigma, P)


def network_claim(problem: Problem, rate: float) -> Weighted | None:
    """Weights of the network alone (eps = 0) for a rate (1/s), common to all modes; None if none are seen."""
    tables = {mode: table for mode in problem.network.modes if (table := _stiffness(problem, mode)) is not None}
    try:
        sigma = (Fraction(0),) * max(1, len(problem.groups))
        return _scaled(problem, tables, rate, sigma, None) if len(tables) == len(problem.network.modes) else None
    except GIVEN_UP:
        return None


def _scaled(
    problem: Problem, tables: Mapping[str, Any], rate: float, sigma: Sequence[Fraction], P: Matrix | None
) -> Weighted | None:
    owners = np.repeat(group_numbers(problem.groups, problem.network.labels), problem.m)
    weight = np.array([float(x) for x in sigma])[owners]
    for D in _weights(tables, rate):
        heights = {mode: _height(M, D, rate) for mode, M in tables.items()}
        known = {mode: found for mode, found in heights.items() if found is not None}
        if len(known) < len(tables):
            continue
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            room = min(float(np.min(rise / (weight * D * D * w))) for w, rise in known.values())
        scale = min(1.0, room / 2)
        return Weighted(D=rounded(scale * D), w={mode: rounded(w) for mode, (w, _) in known.items()}, P=P)
    return None


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
