"""Proposals for weighted Theorems 1 and 2: rates, weights D, vectors w, the observer's P; no
proofs.

For beta below the least real part mu of an eigenvalue of M, w = (M - beta I)^-1 1 and u = (M - beta
I)^-T 1 are positive, and D = diag(u / w) makes D (M - beta I) + (M - beta I)'D positive definite
(theory, section 10).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, combinations, islice
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import csgraph

from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.consensus.propose import DENSE, decay_rate, is_symmetric
from dobc_design.conditions.numbers import (
    MANY_AGENTS,
    bisected,
    golden_section,
    shorten,
    time_to_one_percent,
)
from dobc_design.conditions.weighted.decide import Weighted, observer_bounds
from dobc_design.conditions.weighted.network import Alike
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, Vector, to_float
from dobc_design.exact.symmetric import Doubles, largest, least
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.groups import gains_of, group_numbers
from dobc_design.solvers.conic import Cone, solve_cones, svec
from dobc_design.solvers.program import Array, factored, round_matrix

# of the rate that is thought possible
PARTS = (1.0, 0.999, 0.99, 0.95, 0.9, 0.75, 0.5, 0.25, 0.1, 0.01, 0.001, 0.0)
CLOSEST = 0.99995  # of mu where eigenvalues are known
NEARLY = 0.995
SHARPENINGS = 30  # of the rate towards mu
SAFE = 1 - 1e-5  # of a rate that floats show
DROPPED, FILL = 1e-4, 10  # of incomplete factorisations
FEW_ENTRIES = 3  # per row, up to which a factorisation stays sparse
FLOOR = 0.1  # the right side of inverse iteration is at least this part of its largest entry
BISECTIONS = 8
COMPARED = 8  # modes that are compared two by two
# states^3 times modes for which common weights are sought by a semidefinite program
LARGEST_PROGRAM = 10 * 60**3
LONGEST = 60.0  # s, for that program
# steps of work for a solver and each solution; cubed rows for a step
SOLVER, EIGENVALUES = 10, 3000
EVEN_PROGRAM = 2 * 12**3  # the same, where the most even ones are sought for several rates
# Times to one percent: those next to that of D = I, rates that are tried for few and for many
# states, what is worth it.
FLAT, SOONER, SOONER_LARGE, EARLIER = 1.01, 8, 2, 0.95
MARGIN = 1e-6
# a row is met when these parts of its right side and of its terms are left at most
LEFT, ROUNDED = 0.25, 1e-9
CLOSE, QUICK = (1e-2, 1e-5), 400  # where iterations stop
GIVEN_UP = (ArithmeticError, RuntimeError, ValueError, MemoryError, np.linalg.LinAlgError)


def proposals(
    statements: Statements, W: Matrix | None, *, sooner: bool = True, least: float = 0.0
) -> Iterator[tuple[Weighted, float]]:
    """Claims with their rates (1/s): if ``sooner``, of those with at least ``least`` the one with
    the least time to one percent; then the fastest first."""
    loop = statements.loop
    tables = {mode: stiffness(loop, mode) for mode in loop.modes}
    if any(table is None for table in tables.values()) or (loop.groups and W is None):
        return
    pairs = dict[str, Perron | None]()
    with suppress(*GIVEN_UP):
        pairs = {mode: perron(table) for mode, table in tables.items()}
    if not pairs or any(pair is None for pair in pairs.values()):
        return
    most = SAFE * min(pair.rate for pair in pairs.values() if pair is not None)
    if W is not None and loop.groups:
        most = min(
            most,
            0.9995 * min(decay_rate(group.exosystem, gain) for group, gain in _gains(loop, W)),
        )
    (first, *others) = pairs.values()
    if others:  # the largest rate that common weights can have, about
        most = bisected(
            lambda rate: _weights(tables, rate) is not None, 0.0, most, steps=BISECTIONS
        )[0]
    best = None
    if sooner:
        best = soonest_weights(
            tables, most, None if others or first is None else first.u / first.w, least
        )
    planned = [] if best is None else [(best.rate, best.D)]
    for rate, D in [*planned, *((shorten(part * most, digits=6), None) for part in PARTS)]:
        with suppress(*GIVEN_UP):
            P = _lyapunov(loop, W, rate) if loop.groups and W is not None else None
            sigma = observer_bounds(loop, P, W, rate=Fraction(repr(rate)))
            own = (
                (None,)
                if others or D is not None
                else _pairs(next(iter(tables.values())), first, rate)
            )
            for pair in own:
                found = None if sigma is None else _scaled(loop, tables, rate, sigma, P, pair, D)
                if found is not None:
                    yield found, rate


@dataclass(frozen=True, slots=True, eq=False)
class Sooner:
    """Weights D > 0 (n m,) that seem to do for a rate (1/s), and the time to one percent that they
    promise."""

    time: float
    rate: float
    D: Array


def soonest_weights(
    tables: Mapping[str, Any], most: float, fastest: Array | None, least: float = 0.0
) -> Sooner | None:
    """The weights and the rate from ``least`` to ``most`` (1/s) with the least ln(100 sqrt(max D /
    min D)) / rate.

    ``fastest``: weights for the rate ``most``, where they are known.  None where a slower rate is
    not worth it."""
    size, found = next(iter(tables.values())).shape[0], list[Sooner]()

    def at(rate: float) -> float:
        rate = shorten(rate, digits=6)
        with suppress(*GIVEN_UP):
            D = even_weights(tables, rate)
            if D is not None:
                found.append(
                    Sooner(time_to_one_percent(rate, math.sqrt(D.max() / D.min())), rate, D)
                )
                return found[-1].time
        return math.inf

    first = (
        at(most)
        if fastest is None
        else time_to_one_percent(most, math.sqrt(fastest.max() / fastest.min()))
    )
    if not most > 0 or not math.isfinite(first) or first * most < FLAT * math.log(100):
        return None
    shortest = max(math.log(100) / first, least)  # slower ones are later even with D = I
    if shortest >= most:
        return None
    golden_section(at, shortest, most, steps=SOONER if size <= DENSE else SOONER_LARGE)
    best = min(found, key=lambda each: each.time, default=None)
    return best if best is not None and best.time < EARLIER * first else None


def promised_factor(claim: Weighted | Alike) -> float:
    """The square root of max D / min D, times that of the condition of R, about."""
    D = claim.D if isinstance(claim, Weighted) else claim.weights.D
    ratio = float(largest(D)) / float(least(D))
    return math.sqrt(
        ratio if isinstance(claim, Weighted) else ratio * float(np.linalg.cond(to_float(claim.R)))
    )


def even_weights(tables: Mapping[str, Any], rate: float) -> Array | None:
    """Weights for this rate, as even as is seen."""
    size = next(iter(tables.values())).shape[0]
    D = _weights(tables, rate)
    if D is None or D.max() <= D.min() * FLAT or size**3 * len(tables) > EVEN_PROGRAM:
        return D
    even = (
        each
        for each in _program(tables, rate)
        if all(_height(M, each, rate) for M in tables.values())
    )
    return min((D, *even), key=lambda each: float(each.max() / each.min()))


def _pairs(table: Any, first: Perron | None, rate: float) -> Iterator[Perron | None]:
    """The fastest pair; then, as its entries may lie too far apart for doubles, one for this rate
    alone."""
    yield first
    ones = np.ones(table.shape[0])
    pair = _pair(table, rate, ones, ones)
    if pair is not None:
        yield pair


def disagreeing(loop: Loop) -> tuple[str, str] | None:
    """Two modes that seem to have no weights in common; None if none of the first ones do."""
    tables = {mode: stiffness(loop, mode) for mode in islice(loop.modes, COMPARED)}
    with suppress(*GIVEN_UP):
        for pair in combinations(tables, 2):
            own = {mode: tables[mode] for mode in pair}
            if all(table is not None for table in own.values()) and _weights(own, 0.0) is None:
                return pair
    return None


def stiffness(loop: Loop, mode: str) -> Any:
    """M = K - dh/de at the target, (n m, n m) sparse; None where it cannot be had."""
    with np.errstate(all="ignore"), suppress(SpecError):
        jacobian = consensus_jacobian(loop, mode)
        table = None if jacobian is None else sparse.csc_array(pull_matrix(loop) - jacobian)
        return table if table is not None and np.all(np.isfinite(table.data)) else None
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Perron:
    """Vectors w, u > 0 (n m,) about (M - rate I)^-1 1 and (M - rate I)^-T 1.  With D = diag(u / w)
    and N = D (M - rate I) + (M - rate I)'D they give N w = u ((M w)_i / w_i + (M'u)_i / u_i - 2
    rate) > 0 for every smaller rate."""

    w: Array
    u: Array
    rate: float


def perron(table: Any) -> Perron | None:
    """The pair of an M-matrix with a rate close to mu, its least Re of an eigenvalue; None if mu >
    0 is not seen."""
    size = table.shape[0]
    w = u = ones = np.ones(size)
    acyclic = csgraph.connected_components(table, connection="strong")[0] == size
    if size <= DENSE or acyclic:
        spend(0 if acyclic else size**3 // EIGENVALUES)
        mu = float(
            table.diagonal().min() if acyclic else np.linalg.eigvals(table.toarray()).real.min()
        )
        pairs = (_pair(table, part * mu, ones, ones) for part in (CLOSEST, *PARTS[1:-1]) if mu > 0)
        return next((pair for pair in pairs if pair is not None), None)
    best, low = None, 0.0
    for _ in range(SHARPENINGS):
        pair = _pair(table, low, w, u)
        if pair is None or (best is not None and pair.rate <= best.rate * (1 + 1e-3)):
            break
        best, w = pair, pair.w / np.max(pair.w)
        u = w if pair.u is pair.w else pair.u / np.max(pair.u)
        if pair.rate >= NEARLY * float(u @ (table @ w)) / float(u @ w):
            break
        low = (1 - 1e-3) * pair.rate
    return best


def _pair(table: Any, shift: float, w: Array, u: Array) -> Perron | None:
    """One step of inverse iteration on both sides; None where it gives no positive vectors or no
    rate > 0."""
    solve = _solver(table, shift)
    floors = [np.maximum(x, FLOOR if table.shape[0] > DENSE else 1.0) for x in (w, u)]
    x = None if solve is None else solve(floors[0], "N")
    y = x
    if solve is not None and x is not None and (w is not u or not is_symmetric(table)):
        y = solve(floors[1], "T")
    if x is None or y is None:
        return None
    with np.errstate(all="ignore"):
        rate = float(np.min((table @ x) / x + (table.T @ y) / y)) / 2
    return Perron(x, y, rate) if rate > 0 else None


def _solver(table: Any, rate: float) -> Callable[[Array, str], Array | None] | None:
    """Solutions of (M - rate I) x = b > 0, or with the transpose ("T"), about: by a factorisation
    where the network is small or stays sparse, else by iteration.  None where none is positive,
    each row met up to a part of its terms."""
    size = table.shape[0]
    spend(SOLVER)
    shifted = sparse.csc_array(table - rate * sparse.eye_array(size))
    matrices = {"N": sparse.csr_array(shifted), "T": sparse.csr_array(shifted.T)}
    scale = shifted.diagonal()
    if not np.all(scale > 0):
        return None
    iterates = size > DENSE and table.nnz > FEW_ENTRIES * size
    iterate = sparse.linalg.bicgstab
    if iterates and is_symmetric(table):
        iterate = sparse.linalg.cg  # one product a step, and no breakdown
    factors: list[Any] = []

    def answers(right: Array, which: str) -> Iterator[Array]:
        matrix, start = matrices[which], right / scale
        for close in CLOSE if iterates and not factors else ():
            near = sparse.diags_array(1 / scale)
            start = iterate(matrix, right, x0=start, M=near, rtol=close, maxiter=QUICK)[0]
            yield start
        if not factors:
            if iterates:
                factors.append(sparse.linalg.spilu(shifted, drop_tol=DROPPED, fill_factor=FILL))
            # without exchanges, which an M-matrix does not need, no digits of small entries are
            # lost
            else:
                factors.append(factored(shifted, diag_pivot_thresh=0.0))
        start = factors[0].solve(right, which)
        yield start
        if iterates:
            near = sparse.linalg.LinearOperator(
                matrix.shape, matvec=lambda x: factors[0].solve(x, which)
            )
            yield sparse.linalg.bicgstab(
                matrix, right, x0=start, M=near, rtol=CLOSE[-1], maxiter=QUICK
            )[0]

    def solve(right: Array, which: str) -> Array | None:
        spend(SOLVER)
        with np.errstate(all="ignore"), suppress(*GIVEN_UP):
            for x in answers(right, which):
                missed = np.abs(matrices[which] @ x - right)
                if (
                    np.all(np.isfinite(x))
                    and np.all(x > 0)
                    and np.all(missed <= LEFT * right + ROUNDED * scale * x)
                ):
                    return np.asarray(x)
        return None

    return solve


def _weights(tables: Mapping[str, Any], rate: float) -> Array | None:
    """Weights D (n m,) that seem to do for this rate in every mode, the largest 1; None if none are
    seen."""
    (first, *others) = tables.values()
    if not others and first.shape[0] > DENSE and is_symmetric(first):
        return np.ones(first.shape[0])  # u = w
    logarithms = []
    for M in tables.values():
        solve, ones = _solver(M, rate), np.ones(M.shape[0])
        w, u = (None, None) if solve is None else (solve(ones, "N"), solve(ones, "T"))
        if w is None or u is None:
            return None
        logarithms.append(np.log(u) - np.log(w))
    found = [np.mean(logarithms, axis=0), *(logarithms[:COMPARED] if len(logarithms) > 1 else ())]
    weights: list[Array] = [np.exp(each - each.max()) for each in found]
    if len(tables) == 1:
        return weights[0]
    tried = chain(weights, _program(tables, rate))
    return next(
        (D for D in tried if all(_height(M, D, rate) is not None for M in tables.values())), None
    )


def _program(tables: Mapping[str, Any], rate: float) -> Iterator[Array]:
    """The most even D >= 1 with D (M - rate I) + (M - rate I)'D > 0, by a semidefinite program;
    none for large ones."""
    size = next(iter(tables.values())).shape[0]
    if size**3 * len(tables) > LARGEST_PROGRAM:
        return
    cones = [
        Cone("nonnegative", np.column_stack([-np.eye(size), np.zeros(size)]), -np.ones(size)),
        Cone("nonnegative", np.column_stack([np.eye(size), -np.ones(size)]), np.zeros(size)),
    ]
    for M in tables.values():
        rows = M.toarray() - rate * np.eye(size)
        units = [
            np.outer(e, row) + np.outer(row, e) for e, row in zip(np.eye(size), rows, strict=True)
        ]
        columns = np.column_stack(
            [*(-svec(unit) for unit in units), np.zeros(size * (size + 1) // 2)]
        )
        cones.append(
            Cone("semidefinite", columns, -svec(MARGIN * float(np.abs(rows).max()) * np.eye(size)))
        )
    answer = solve_cones(np.append(np.zeros(size), 1.0), cones, time_limit=LONGEST)
    found = answer.x[:size] if answer.found else np.zeros(0)
    if len(found) and found.min() > 0:
        yield found / found.max()


def _height(
    M: Any, D: Array, rate: float, pair: Perron | None = None
) -> tuple[Array, Array] | None:
    """w > 0 with N w > 0 for N = D (M - rate I) + (M - rate I)'D, and N w; None if not seen.
    ``pair``: D = u / w."""
    if pair is not None:
        rise = D * (M @ pair.w) + M.T @ pair.u - 2 * rate * pair.u
        return (pair.w, rise) if np.all(rise > 0) else None
    root = np.sqrt(D)  # N = diag(root) (X + X') diag(root), and X is scaled alike in all rows
    X = sparse.diags_array(root) @ M @ sparse.diags_array(1 / root) - rate * sparse.eye_array(
        len(D)
    )
    even = sparse.csc_array(X + X.T)
    solve = _solver(even, 0.0)
    z = None if solve is None else solve(np.ones(len(D)), "N")
    rise = np.zeros(len(D)) if z is None else root * np.asarray(even @ z)
    return None if z is None or not np.all(rise > 0) else (z / root, rise)


def network_claim(loop: Loop, rate: float) -> Weighted | None:
    """Weights of the network alone (eps = 0) for a rate (1/s), common to all modes; None if none
    are seen."""
    tables = {mode: stiffness(loop, mode) for mode in loop.modes}
    try:
        sigma = (Fraction(0),) * max(1, len(loop.groups))
        return (
            None
            if any(table is None for table in tables.values())
            else _scaled(loop, tables, rate, sigma, None)
        )
    except GIVEN_UP:
        return None


def weights_claim(loop: Loop, tables: Mapping[str, Any], rate: float, D: Array) -> Weighted | None:
    """The same with these weights."""
    try:
        return _scaled(loop, tables, rate, (Fraction(0),) * max(1, len(loop.groups)), None, None, D)
    except GIVEN_UP:
        return None


def _scaled(
    loop: Loop,
    tables: Mapping[str, Any],
    rate: float,
    sigma: Sequence[Fraction],
    P: Matrix | None,
    pair: Perron | None = None,
    D: Array | None = None,
) -> Weighted | None:
    """The claim, its weights D small enough for the observer; of one mode perhaps those of its
    ``pair``."""
    owners = np.repeat(group_numbers(loop.groups, loop.labels), loop.m)
    weight = np.array([*map(float, sigma), 0.0])[owners]  # 0 for an agent without a disturbance
    if D is None:
        D = _weights(tables, rate) if pair is None else pair.u / pair.w
    known = {} if D is None else {mode: _height(M, D, rate, pair) for mode, M in tables.items()}
    heights = {mode: found for mode, found in known.items() if found is not None}
    if D is None or len(heights) < len(tables):
        return None
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        room = min(float(np.min(rise / (weight * D * D * w))) for w, rise in heights.values())
    scale = min(1.0, room / 2)
    if not scale * D.min() > 0:
        return None
    return Weighted(
        D=rounded(scale * D), w={mode: rounded(w) for mode, (w, _) in heights.items()}, P=P
    )


def rounded(x: Array) -> Vector | Doubles:
    """Decimals of eight digits for few agents, doubles for many."""
    if len(x) > MANY_AGENTS:
        return Doubles(x)
    return tuple(Fraction(f"{value:.8g}") for value in x.tolist())


def _gains(loop: Loop, W: Matrix) -> Iterator[tuple[Any, Matrix]]:
    return zip(loop.groups, gains_of(loop.groups, W), strict=True)


def _lyapunov(loop: Loop, W: Matrix, rate: float) -> Matrix | None:
    """P with (A - WC)'P + P(A - WC) + 2 rate P about -I, for each group."""
    blocks = []
    for group, gain in _gains(loop, W):
        A, C = to_float(group.exosystem.A), to_float(group.exosystem.C)
        error = A - to_float(gain) @ C + rate * np.eye(len(A))
        P = linalg.solve_continuous_lyapunov(error.T, -np.eye(len(A)))
        if not np.all(np.isfinite(P)):
            return None
        blocks.append(round_matrix((P + P.T) / 2, 9))
    return block_diagonal(blocks)
