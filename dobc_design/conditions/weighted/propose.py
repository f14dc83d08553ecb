"""Proposals for weighted Theorems 1 and 2: rates, weights D, vectors w, the observer's P; no
proofs.

For beta below the least real part mu of an eigenvalue of M, w = (M - beta I)^-1 1 and u = (M - beta
I)^-T 1 are positive, and D = diag(u / w) makes D (M - beta I) + (M - beta I)'D positive definite
(theory, section 10).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, combinations, islice
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import csgraph

from dobc_design._checks import noun, positional
from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.consensus.propose import DENSE, decay_rate, is_symmetric
from dobc_design.conditions.numbers import (
    MANY_AGENTS,
    bisected,
    shorten,
    soonest,
    time_to_one_percent,
)
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Array, Matrix, Vector, largest_entry, to_float
from dobc_design.exact.reading import Table
from dobc_design.exact.symmetric import Doubles, largest, least
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.groups import group_numbers
from dobc_design.solvers.conic import Cone, affine_cone, solve_cones
from dobc_design.solvers.program import factored, round_matrix

from .decide import Weighted, observer_bounds
from .network import Alike

# of the rate that is thought possible
PARTS = (1.0, 0.999, 0.99, 0.95, 0.9, 0.75, 0.5, 0.25, 0.1, 0.01, 0.001, 0.0)
CLOSEST = 0.99995  # of mu where eigenvalues are known
NEARLY = 0.995
SHARPENINGS = 30  # of the rate towards mu
SAFE = 1 - 1e-5  # of a rate that floats show
# Of incomplete factorisations: which entries are dropped, and how much they may fill up.
DROPPED = 1e-4
FILL = 10
FEW_ENTRIES = 3  # per row, up to which a factorisation stays sparse
FLOOR = 0.1  # the right side of inverse iteration is at least this part of its largest entry
BISECTIONS = 8
COMPARED = 8  # modes that are compared two by two
# states^3 times modes for which common weights are sought by a semidefinite program
LARGEST_PROGRAM = 10 * 60**3
LONGEST = 60.0  # s, for that program
SOLVER = 10  # steps of work for a solver, and for each solution
EIGENVALUES = 3000  # cubed rows for a step of work
EVEN_PROGRAM = 2 * 12**3  # the same, where the most even ones are sought for several rates
FLAT = 1.01  # times next to that of D = I, which need not be looked for
SOONER = 8  # rates that are tried for the least time to one percent ...
SOONER_LARGE = 2  # ... and with many states
EARLIER = 0.95  # the part of the time that is worth a slower rate
MARGIN = 1e-6  # relative: how far the program stays from singular forms
# A row is met when these parts of its right side and of its terms are left at most.
LEFT = 0.25
ROUNDED = 1e-9
CLOSE = (1e-2, 1e-5)  # where iterations stop
QUICK = 400  # steps of an iteration
#: M of every mode.
Tables = Table
Rated = tuple[float, Array]  # a rate, and weights for it
GIVEN_UP = (ArithmeticError, RuntimeError, ValueError, MemoryError, np.linalg.LinAlgError)


def proposals(
    statements: Statements, W: Matrix | None, *, sooner: bool = True, least: float = 0.0
) -> Iterator[tuple[Weighted, float]]:
    """Claims with their rates (1/s): if ``sooner``, of those with at least ``least`` the one with
    the least time to one percent; then the fastest first."""
    loop = statements.loop
    tables = stiffnesses(loop)
    if tables is None or (loop.groups and W is None):
        return
    pairs = _perron_pairs(tables)
    if not pairs:
        return
    most = SAFE * min(pair.rate for pair in pairs)
    if W is not None and loop.groups:
        decays = [decay_rate(group.exosystem, gain) for group, gain in loop.observed(W)]
        most = min(most, 0.9995 * min(decays))
    # Of one mode the pair gives weights for every rate below its own.
    alone = pairs[0] if len(pairs) == 1 else None
    if alone is None:  # the largest rate that common weights can have, about

        def have_weights(rate: float) -> bool:
            return _weights(tables, rate) is not None

        most, _ = bisected(have_weights, 0.0, most, steps=BISECTIONS)
    planned: list[tuple[float, Array | None]] = []
    if sooner:
        best = soonest_weights(tables, most, None if alone is None else alone.u / alone.w, least)
        if best is not None:
            planned.append(best)
    planned += [(shorten(part * most, digits=6), None) for part in PARTS]
    for rate, D in planned:
        with suppress(*GIVEN_UP):
            aim = _aim(loop, W, rate)
            if aim is None:
                continue
            own: Iterable[Perron | None] = (None,)
            if alone is not None and D is None:
                own = _pairs(next(iter(tables.values())), alone, rate)
            for pair in own:
                found = _scaled(loop, tables, aim, pair=pair, D=D)
                if found is not None:
                    yield found, rate


def _perron_pairs(tables: Tables) -> list[Perron]:
    """The pair of every mode; empty if one of them has none."""
    pairs = []
    with suppress(*GIVEN_UP):
        pairs = [perron(table) for table in tables.values()]
    known = [pair for pair in pairs if pair is not None]
    return known if len(known) == len(tables) else []


def soonest_weights(
    tables: Tables, most: float, fastest: Array | None, least: float = 0.0
) -> Rated | None:
    """The rate from ``least`` to ``most`` (1/s) and the weights D > 0 (n m,) that seem to do for it
    with the least ln(100 sqrt(max D / min D)) / rate.

    ``fastest``: weights for the rate ``most``, where they are known.  None where a slower rate is
    not worth it."""
    size = _rows(tables)

    def at(rate: float) -> tuple[float, Rated] | None:
        rate = shorten(rate, digits=6)
        with suppress(*GIVEN_UP):
            D = even_weights(tables, rate)
            if D is not None:
                return _promised_time(rate, D), (rate, D)
        return None

    if fastest is not None:
        first = _promised_time(most, fastest)
    else:
        first, _ = at(most) or (math.inf, None)
    if not most > 0 or not math.isfinite(first) or first * most < FLAT * math.log(100):
        return None
    steps = SOONER if size <= DENSE else SOONER_LARGE
    found = soonest(at, first=first, longest=most, least=least, steps=steps)
    return next((best for time, best in found if time < EARLIER * first), None)


def _promised_time(rate: float, D: Array) -> float:
    """The time to one percent (s) of V = e'De at a rate (1/s)."""
    return time_to_one_percent(rate, math.sqrt(D.max() / D.min()))


def _rows(tables: Tables) -> int:
    """The rows n m, which all modes share."""
    return int(next(iter(tables.values())).shape[0])


def promised_factor(claim: Weighted | Alike) -> float:
    """The square root of max D / min D, times that of the condition of R, about."""
    if isinstance(claim, Weighted):
        return math.sqrt(float(largest(claim.D)) / float(least(claim.D)))
    of_weights = 1.0 if claim.weights is None else promised_factor(claim.weights)
    return of_weights * math.sqrt(float(np.linalg.cond(to_float(claim.R))))


def even_weights(tables: Tables, rate: float) -> Array | None:
    """Weights for this rate, as even as is seen."""
    D = _weights(tables, rate)
    if D is None or D.max() <= D.min() * FLAT or _rows(tables) ** 3 * len(tables) > EVEN_PROGRAM:
        return D
    even = [each for each in _program(tables, rate) if _do(tables, each, rate)]
    return min((D, *even), key=lambda each: float(each.max() / each.min()))


def _do(tables: Tables, D: Array, rate: float) -> bool:
    """Whether these weights seem to do in every mode."""
    return all(_height(M, D, rate) is not None for M in tables.values())


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
    known = {mode: table for mode, table in tables.items() if table is not None}
    with suppress(*GIVEN_UP):
        for pair in combinations(known, 2):
            if _weights({mode: known[mode] for mode in pair}, 0.0) is None:
                return pair
    return None


def stiffnesses(loop: Loop) -> dict[str, Any] | None:
    """M of every mode; None where one cannot be had."""
    tables = {mode: stiffness(loop, mode) for mode in loop.modes}
    return None if any(table is None for table in tables.values()) else tables


def stiffness(loop: Loop, mode: str) -> Any:
    """M = K - dh/de at the target, (n m, n m) sparse; None where it cannot be had."""
    with np.errstate(all="ignore"), suppress(SpecError):
        jacobian = consensus_jacobian(loop, mode)
        if jacobian is None:
            return None
        table = sparse.csc_array(pull_matrix(loop) - jacobian)
        return table if np.all(np.isfinite(table.data)) else None
    return None


@positional(eq=False)
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
    ones = np.ones(size)
    parts, _ = csgraph.connected_components(table, connection="strong")
    acyclic = parts == size
    if size <= DENSE or acyclic:
        spend(0 if acyclic else size**3 // EIGENVALUES)
        # Without cycles the eigenvalues stand on the diagonal.
        values = table.diagonal() if acyclic else np.linalg.eigvals(table.toarray()).real
        mu = float(values.min())
        if not mu > 0:
            return None
        for part in (CLOSEST, *PARTS[1:-1]):
            pair = _pair(table, part * mu, ones, ones)
            if pair is not None:
                return pair
        return None
    best = None
    low = 0.0
    w = u = ones
    for _ in range(SHARPENINGS):
        pair = _pair(table, low, w, u)
        if pair is None or (best is not None and pair.rate <= best.rate * (1 + 1e-3)):
            break
        best = pair
        w = pair.w / np.max(pair.w)
        u = w if pair.u is pair.w else pair.u / np.max(pair.u)
        if pair.rate >= NEARLY * float(u @ (table @ w)) / float(u @ w):
            break
        low = (1 - 1e-3) * pair.rate
    return best


def _pair(table: Any, shift: float, w: Array, u: Array) -> Perron | None:
    """One step of inverse iteration on both sides; None where it gives no positive vectors or no
    rate > 0."""
    solve = _solver(table, shift)
    if solve is None:
        return None
    floor = FLOOR if table.shape[0] > DENSE else 1.0
    x = solve(np.maximum(w, floor), "N")
    if x is None:
        return None
    # Of a symmetric matrix both sides are the same.
    y: Array | None = x
    if w is not u or not is_symmetric(table):
        y = solve(np.maximum(u, floor), "T")
    if y is None:
        return None
    with np.errstate(all="ignore"):
        rate = float(np.min((table @ x) / x + (table.T @ y) / y)) / 2
    return Perron(x, y, rate) if rate > 0 else None


def _solver(table: Any, rate: float) -> _Solver | None:
    """Solutions of (M - rate I) x = b > 0, or with the transpose ("T"), about: by a factorisation
    where the network is small or stays sparse, else by iteration.  None where none is positive,
    each row met up to a part of its terms."""
    size = table.shape[0]
    spend(SOLVER)
    shifted = sparse.csc_array(table - rate * sparse.eye_array(size))
    scale = shifted.diagonal()
    if not np.all(scale > 0):
        return None
    iterates = size > DENSE and table.nnz > FEW_ENTRIES * size
    return _Solver(
        shifted=shifted,
        matrices={"N": sparse.csr_array(shifted), "T": sparse.csr_array(shifted.T)},
        scale=scale,
        iterates=iterates,
        symmetric=iterates and is_symmetric(table),
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Solver:
    """A shifted matrix with its transpose, and a factor once one was needed."""

    shifted: Any
    matrices: Table
    scale: Array
    iterates: bool
    symmetric: bool
    factor: Any = None

    def __call__(self, right: Array, which: str) -> Array | None:
        """The first answer > 0 that meets every row; None if none does."""
        spend(SOLVER)
        with np.errstate(all="ignore"), suppress(*GIVEN_UP):
            for x in self._answers(right, which):
                if self._is_met(x, right, which):
                    return np.asarray(x)
        return None

    def _is_met(self, x: Array, right: Array, which: str) -> bool:
        missed = np.abs(self.matrices[which] @ x - right)
        if not np.all(np.isfinite(x)) or not np.all(x > 0):
            return False
        return bool(np.all(missed <= LEFT * right + ROUNDED * self.scale * x))

    def _answers(self, right: Array, which: str) -> Iterator[Array]:
        """Answers, the cheapest first."""
        matrix = self.matrices[which]
        start = right / self.scale
        if self.iterates and self.factor is None:
            iterate = sparse.linalg.bicgstab
            if self.symmetric:
                iterate = sparse.linalg.cg  # one product a step, and no breakdown
            near = sparse.diags_array(1 / self.scale)
            for close in CLOSE:
                start, _ = iterate(matrix, right, x0=start, M=near, rtol=close, maxiter=QUICK)
                yield start
        factor = self._factored()
        start = factor.solve(right, which)
        yield start
        if self.iterates:
            near = sparse.linalg.LinearOperator(
                matrix.shape, matvec=lambda x: factor.solve(x, which)
            )
            start, _ = sparse.linalg.bicgstab(
                matrix, right, x0=start, M=near, rtol=CLOSE[-1], maxiter=QUICK
            )
            yield start

    def _factored(self) -> Any:
        """A factor of the matrix, an incomplete one where it only speeds up iterations."""
        if self.factor is None and self.iterates:
            self.factor = sparse.linalg.spilu(self.shifted, drop_tol=DROPPED, fill_factor=FILL)
        elif self.factor is None:
            # without exchanges, which an M-matrix does not need, no digits of small entries are
            # lost
            self.factor = factored(self.shifted, diag_pivot_thresh=0.0)
        return self.factor


def _weights(tables: Tables, rate: float) -> Array | None:
    """Weights D (n m,) that seem to do for this rate in every mode, the largest 1; None if none are
    seen."""
    (first, *others) = tables.values()
    if not others and first.shape[0] > DENSE and is_symmetric(first):
        return np.ones(first.shape[0])  # u = w
    logarithms = []
    for M in tables.values():
        solve = _solver(M, rate)
        ones = np.ones(M.shape[0])
        w = None if solve is None else solve(ones, "N")
        u = None if solve is None else solve(ones, "T")
        if w is None or u is None:
            return None
        logarithms.append(np.log(u) - np.log(w))
    if not others:
        return _largest_one(np.mean(logarithms, axis=0))
    # The geometric mean of the weights of all modes may serve them all, or those of one mode.
    found = [np.mean(logarithms, axis=0), *logarithms[:COMPARED]]
    tried = chain(map(_largest_one, found), _program(tables, rate))
    return next((D for D in tried if _do(tables, D, rate)), None)


def _largest_one(logarithms: Array) -> Array:
    """The weights with these logarithms, scaled so that the largest is 1."""
    return np.asarray(np.exp(logarithms - logarithms.max()))


def _program(tables: Tables, rate: float) -> Iterator[Array]:
    """The most even D >= 1 with D (M - rate I) + (M - rate I)'D > 0, by a semidefinite program;
    none for large ones."""
    size = _rows(tables)
    if size**3 * len(tables) > LARGEST_PROGRAM:
        return
    eye = np.eye(size)
    # The unknowns are D and its largest entry, which is minimised.
    cones = [
        Cone("nonnegative", np.column_stack([-eye, np.zeros(size)]), -np.ones(size)),
        Cone("nonnegative", np.column_stack([eye, -np.ones(size)]), np.zeros(size)),
    ]
    for M in tables.values():
        rows = M.toarray() - rate * eye
        units = [np.outer(e, row) + np.outer(row, e) for e, row in zip(eye, rows, strict=True)]
        room = MARGIN * largest_entry(rows)
        cones.append(affine_cone([*units, 0 * eye], -room * eye))
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
    # N = diag(root) (X + X') diag(root), and X is scaled alike in all rows
    root = np.sqrt(D)
    scaled = sparse.diags_array(root) @ M @ sparse.diags_array(1 / root)
    X = scaled - rate * sparse.eye_array(len(D))
    even = sparse.csc_array(X + X.T)
    solve = _solver(even, 0.0)
    z = None if solve is None else solve(np.ones(len(D)), "N")
    if z is None:
        return None
    rise = root * np.asarray(even @ z)
    return (z / root, rise) if np.all(rise > 0) else None


def network_claim(loop: Loop, rate: float) -> Weighted | None:
    """Weights of the network alone (eps = 0) for a rate (1/s), common to all modes; None if none
    are seen."""
    tables = stiffnesses(loop)
    return None if tables is None else weights_claim(loop, tables, rate)


def weights_claim(
    loop: Loop, tables: Tables, rate: float, D: Array | None = None
) -> Weighted | None:
    """The same, with these weights if they are given."""
    # without errors of observers
    sigma = (Fraction(0),) * max(1, len(loop.groups))
    with suppress(*GIVEN_UP):
        return _scaled(loop, tables, _Aim(rate=rate, sigma=sigma, P=None), D=D)
    return None


@noun
class _Aim:
    """A rate (1/s), and the observers beside it: P, and of each group a bound ``sigma`` of what its
    errors take."""

    rate: float
    sigma: Sequence[Fraction]
    P: Matrix | None


def _aim(loop: Loop, W: Matrix | None, rate: float) -> _Aim | None:
    """The rate with the observers of the gain W (q, m); None where these are too slow for it."""
    P = _lyapunov(loop, W, rate) if loop.groups and W is not None else None
    sigma = observer_bounds(loop, P, W, rate=Fraction(repr(rate)))
    return None if sigma is None else _Aim(rate=rate, sigma=sigma, P=P)


def _scaled(
    loop: Loop,
    tables: Tables,
    aim: _Aim,
    *,
    pair: Perron | None = None,
    D: Array | None = None,
) -> Weighted | None:
    """The claim, its weights D small enough for the observer; of one mode perhaps those of its
    ``pair``."""
    owners = np.repeat(group_numbers(loop.groups, loop.labels), loop.m)
    weight = np.array([*map(float, aim.sigma), 0.0])[owners]  # 0 for an agent without a disturbance
    if D is None:
        D = _weights(tables, aim.rate) if pair is None else pair.u / pair.w
    if D is None:
        return None
    w: dict[str, Array] = {}
    rooms = []
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for mode, M in tables.items():
            found = _height(M, D, aim.rate, pair)
            if found is None:
                return None
            w[mode], rise = found
            rooms.append(float(np.min(rise / (weight * D * D * w[mode]))))
    # Half of the room, so that what the observers take leaves every row clearly positive.
    scale = min(1.0, min(rooms) / 2)
    if not scale * D.min() > 0:
        return None
    return Weighted(
        D=rounded(scale * D), w={mode: rounded(each) for mode, each in w.items()}, P=aim.P
    )


def rounded(x: Array) -> Vector | Doubles:
    """Decimals of eight digits for few agents, doubles for many."""
    if len(x) > MANY_AGENTS:
        return Doubles(x)
    return tuple(Fraction(f"{value:.8g}") for value in x.tolist())


def _lyapunov(loop: Loop, W: Matrix, rate: float) -> Matrix | None:
    """P with (A - WC)'P + P(A - WC) + 2 rate P about -I, for each group."""
    blocks = []
    for group, gain in loop.observed(W):
        A = to_float(group.exosystem.A)
        C = to_float(group.exosystem.C)
        eye = np.eye(len(A))
        error = A - to_float(gain) @ C + rate * eye
        P = linalg.solve_continuous_lyapunov(error.T, -eye)
        if not np.all(np.isfinite(P)):
            return None
        blocks.append(round_matrix((P + P.T) / 2, 9))
    return block_diagonal(blocks)
