"""Floating-point proposals that the exact side then proves or not: eigenvalues, vectors,
directions, rates.

How far below 0 a large Lambda is, a vector v > 0 shows: with M = -Lambda and a minus sign beside
the diagonal, lambda_min(M) >= the least (M v)_i / v_i (theory, section 8).  An estimate that cannot
be had is nan or an infinity.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import csgraph

from dobc_design._checks import noun
from dobc_design.conditions.numbers import bisected
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Array, Matrix, largest_entry, to_float
from dobc_design.exact.number import nearest
from dobc_design.exact.work import out_of_time
from dobc_design.loop.arcs import arc_table
from dobc_design.loop.loop import Loop
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.program import GIVEN_UP, factored

from .claim import Statements

Agents = tuple[int, ...]


def float_lambda(loop: Loop, mode: str, *, pins: bool = True, twice: bool = False) -> Any:
    """Lambda = J + J' - (K + K') of one mode, or ``twice`` J - K, as a SciPy array (n m, n m) in
    coordinate form, entries not yet summed; inf beyond the floats; ``pins`` False leaves K out.
    Raises: UndefinedError if a coupling has no derivative at 0."""
    m = loop.m
    arcs = arc_table(loop, mode)
    slopes = np.array([_middles(coupling.jacobian_at_zero()) for coupling in loop.functions])
    weights = np.array([nearest(x) for x in arcs.weights])[arcs.weight, None, None]
    # inf, which no estimate survives, and the exact side needs none
    with np.errstate(over="ignore", invalid="ignore"):
        gains = weights * slopes[arcs.coupling]
        lost = np.abs(weights) * slopes[arcs.coupling]
    pulls = loop.pulls.gains if pins else {}
    held = [[[nearest(x) for x in row] for row in gain] for gain in pulls.values()]
    agents = np.array(list(pulls), dtype=np.int64)
    # An arc puts its gain at (listener, speaker) and takes it at (listener, listener).
    free = arcs.speakers < loop.n
    rows = np.concatenate([arcs.listeners[free], arcs.listeners, agents])[:, None, None] * m
    columns = np.concatenate([arcs.speakers[free], arcs.listeners, agents])[:, None, None] * m
    blocks = np.concatenate(
        [gains[free], -lost, -np.array(held, dtype=np.float64).reshape(-1, m, m)]
    )
    i = np.broadcast_to(rows + np.arange(m)[:, None], blocks.shape).ravel()
    j = np.broadcast_to(columns + np.arange(m), blocks.shape).ravel()
    values = blocks.ravel()
    shape = (loop.n * m, loop.n * m)
    if twice:
        return sparse.coo_array((2 * values, (i, j)), shape=shape)
    places = np.concatenate([i, j]), np.concatenate([j, i])
    return sparse.coo_array((np.concatenate([values, values]), places), shape=shape)


def _middles(jacobian: Sequence[Sequence[Interval]]) -> list[list[float]]:
    """The middles of enclosed slopes, in floats."""
    return [[nearest(entry.midpoint) for entry in row] for row in jacobian]


def is_symmetric(table: Any) -> bool:
    """Whether a sparse matrix equals its transpose."""
    return bool((table != table.T).nnz == 0)


def rows_of(agents: Any, width: int) -> Any:
    """The rows that belong to these agents."""
    return (np.asarray(agents)[:, None] * width + np.arange(width)).ravel()


#: The bound is sharpened until it is this close to the least eigenvalue, or so many products are
#: spent; in no case more than MOST_PRODUCTS, unless the first bound took as many.
CLOSE = 0.01
ENOUGH = 250
MOST_PRODUCTS = 450
SHARPENINGS = 6
# Steps before a factorisation is tried where the network is little more than lines and rings; and
# in the end.
PATIENCE = 300
MOST_STEPS = 20_000
FEW_ENTRIES = 4
LEFT = 0.25  # a row is met when this part of its right side is left at most
FLOOR = 0.1  # the right side of inverse iteration is at least this part of its largest entry
_FLAT = 1e-15


@noun(eq=False)
class Dominating:
    """v > 0 (n m,) and about min (M v)_i / v_i; or a direction p with p'Mp about <= 0 (``least`` <=
    0), or neither, which says nothing unless M ``is_z``: minus signs beside its diagonal.
    ``first``: products until M > 0 was seen."""

    vector: Array
    least: float
    first: int
    products: int
    is_z: bool


def dominating_vector(table: Any) -> Dominating | None:
    """Look for v for a symmetric SciPy array (Lambda), its bound close to the best; None if floats
    do not hold it."""
    work = _work(table)
    if work is None:
        return None
    found = _first_answer(work)
    if not found.least >= 0:
        return found
    # Inverse iteration with a shift at the bound so far, until the bound is close or nothing is
    # gained.
    v = found.vector
    least = work.least(v)
    for _ in range(SHARPENINGS):
        highest = float(v @ work.times(v)) / float(v @ v)
        if least >= (1 - CLOSE) * highest or work.products >= ENOUGH:
            break
        shift = least * (1 - 1e-3)
        right = np.maximum(v / np.max(v), FLOOR)
        start = right / max(highest - shift, 1e-3 * shift)
        most = min(PATIENCE, MOST_PRODUCTS - work.products)
        sharper, _ = _iterate(work, shift, right, start, most)
        if sharper is None or not np.all(sharper > 0):
            break
        better = work.least(sharper)
        if not better > least:
            break
        v = sharper
        least = better
    return replace(found, vector=v, least=least, products=work.products)


def _first_answer(work: _Work) -> Dominating:
    """Look for v with M v > 0, one question: ``least`` is 0, or -inf beside a direction."""
    size = len(work.diagonal)
    found = _solved(work, np.ones(size))
    least = 0.0
    if found is None or not np.all(found > 0):
        least = -math.inf
        # Where the solution has negative parts, these are a direction that refutes M > 0.
        direction = work.direction if found is None else np.maximum(-found, 0.0)
        found = np.zeros(size) if direction is None else np.abs(direction)
    return Dominating(
        vector=found, least=least, first=work.products, products=work.products, is_z=work.is_z
    )


def _work(table: Any) -> _Work | None:
    """M with minus signs beside the diagonal; None for entries that are not finite."""
    matrix = sparse.csr_array(table)
    matrix.sum_duplicates()
    if not np.all(np.isfinite(matrix.data)):
        return None
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    beside = rows != matrix.indices
    data = np.where(beside, -np.abs(matrix.data), -matrix.data)
    return _Work(
        matrix=sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape),
        diagonal=-matrix.diagonal(),
        is_z=bool(np.all(matrix.data[beside] >= 0)),
    )


@dataclass(slots=True, kw_only=True, eq=False)
class _Work:
    """M with minus signs beside the diagonal, the products so far, the last direction of curvature
    <= 0."""

    matrix: Any
    diagonal: Array
    is_z: bool
    products: int = 0
    direction: Array | None = None

    def times(self, x: Array) -> Array:
        self.products += 1
        return np.asarray(self.matrix @ x)

    def least(self, v: Array) -> float:
        return float(np.min(self.times(v) / v))


def _solved(work: _Work, right: Array) -> Array | None:
    """M x = right until every row is met but for a part; None if M is not seen to be positive."""
    found, done = _iterate(work, 0.0, right, None, PATIENCE)
    if done or found is None:
        return found
    if work.matrix.nnz > FEW_ENTRIES * len(right):
        found, done = _iterate(work, 0.0, right, found, MOST_STEPS)
        return found if done else None
    work.products += 20  # about what the time of one sparse factorisation is worth
    try:
        found = np.asarray(factored(work.matrix).solve(right))
    except GIVEN_UP:
        return None
    return found if np.all(np.isfinite(found)) else None


def _iterate(
    work: _Work, shift: float, right: Array, start: Array | None, most: int
) -> tuple[Array | None, bool]:
    """Conjugate gradients with Jacobi scaling: x (None where a direction of curvature <= 0 was
    met), whether done."""
    scale = work.diagonal - shift
    if not np.all(scale > 0):
        work.direction = np.zeros(len(right))
        work.direction[int(np.argmin(scale))] = 1.0
        return None, False
    if start is None:
        x = np.zeros(len(right))
        residual = right.copy()
    else:
        x = start.copy()
        residual = right - (work.times(x) - shift * x)
    z = residual / scale
    p = z.copy()
    square = float(residual @ z)
    for _ in range(most):
        if np.all(np.abs(residual) <= LEFT * right):
            return x, True
        image = work.times(p) - shift * p
        curvature = float(p @ image)
        if not curvature > _FLAT * float(p @ (scale * p)):
            work.direction = p
            return None, False
        step = square / curvature
        x += step * p
        residual -= step * image
        z = residual / scale
        last = square
        square = float(residual @ z)
        p = z + (square / last) * p
    return x, False


DENSE = 400  # rows up to which a dense symmetric eigensolver is the faster one
LARGEST_DENSE = 2000  # rows up to which it may step in where the iterative one fails
# Lanczos vectors and tolerance, tried in turn.
LANCZOS = ((20, 1e-9), (80, 1e-7))
RESTARTS = 300  # rings hold it up for ever: their eigenvalues crowd at the top


@noun(eq=False)
class Top:
    """Largest eigenvalue of a symmetric matrix, about, and its direction; nan and zeros if it
    cannot be had."""

    value: float
    vector: Array
    # v > 0 that is to prove it, of large matrices; ``value`` is then that bound
    shows: Array | None = None


def largest_eigenvalue(table: Any) -> Top:
    """Estimate the largest eigenvalue of a symmetric SciPy array (n, n), and its vector."""
    size = table.shape[0]
    largest = largest_entry(table.data)
    if largest == 0:
        return Top(value=0.0, vector=np.ones(size))
    none = Top(value=math.nan, vector=np.zeros(size))
    if not math.isfinite(largest):
        return none
    # entries of size 1: no square over- or underflows
    unit = math.ldexp(1.0, math.frexp(largest)[1] - 1)
    if size > DENSE:
        found = _lanczos(sparse.csr_array(table / unit))
        if found is not None:
            return Top(value=found.value * unit, vector=found.vector)
    if size > max(DENSE, LARGEST_DENSE):
        return none
    last = (size - 1, size - 1)
    try:
        values, vectors = linalg.eigh(table.toarray() / unit, subset_by_index=last)
        return Top(value=float(values[0]) * unit, vector=vectors[:, 0])
    except GIVEN_UP:
        return none


def _lanczos(matrix: Any) -> Top | None:
    """The largest eigenvalue of a sparse matrix by iteration; None where it does not converge."""
    # The start is fixed, so that answers can be reproduced, and irregular: one that has a symmetry
    # of the network never sees a direction without it.
    start = 1.0 + 0.1 * np.random.default_rng(0).standard_normal(matrix.shape[0])
    for ncv, tol in LANCZOS:
        try:
            values, vectors = sparse.linalg.eigsh(
                matrix, k=1, which="LA", v0=start, tol=tol, ncv=ncv, maxiter=RESTARTS
            )
            return Top(value=float(values[0]), vector=vectors[:, 0])
        except GIVEN_UP:  # no convergence among them
            continue
    return None


def lambda_tops(statements: Statements) -> dict[str, Top]:
    """lambda_max(Lambda) and its direction, for every mode to which the theorems apply, until time
    runs out."""
    tops = {}
    for mode in statements.lambdas:
        if out_of_time() is not None:
            break
        tops[mode] = _top_of(float_lambda(statements.loop, mode))
    return tops


def _top_of(table: Any) -> Top:
    """The largest eigenvalue of one mode; of a large one only a bound that a vector v > 0 shows."""
    if table.shape[0] > LARGEST_DENSE:
        found = dominating_vector(table)
        if found is not None and found.least > 0:
            return Top(value=-found.least, vector=found.vector, shows=found.vector)
        # It is not negative, and the vector says where: its eigenvalue is not needed.
        if found is not None and found.is_z and np.any(found.vector):
            return Top(value=math.nan, vector=found.vector)
    return largest_eigenvalue(table)


def decay_of(F: Array) -> float:
    """-max Re of the spectrum of F, about: the rate at which exp(F t) decays."""
    return float(-np.max(np.linalg.eigvals(F).real))


def decay_rate(exosystem: Exosystem, W: Matrix) -> float:
    """-max Re of the spectrum of A - WC (1/s), about; negative when the error grows, nan if it
    cannot be had."""
    try:
        error = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
        return decay_of(error)
    except GIVEN_UP:
        return math.nan


def pair_margin(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """-(lambda_max(Lambda) + lambda_max(S)): how much Lambda may still rise.  -inf if Omega0 is not
    negative."""
    highest = max(top.value for top in tops.values())
    return -(highest + _lambda_max_of_s(P, Q, exosystem, rate=0.0))


def pair_rate(tops: Mapping[str, Top], P: Array, Q: Array, exosystem: Exosystem) -> float:
    """The largest beta with Psi + 2 beta diag(I, I (x) P) < 0, about; 0 if there is none."""
    bound = max(top.value for top in tops.values())
    if not math.isfinite(bound):
        return 0.0

    def holds(rate: float) -> bool:
        return bound + 2 * rate + _lambda_max_of_s(P, Q, exosystem, rate=rate) < 0

    rate, _ = bisected(holds, 0.0, max(0.0, -bound / 2), steps=60)
    return rate


def _lambda_max_of_s(P: Array, Q: Array, exosystem: Exosystem, *, rate: float) -> float:
    try:
        A = to_float(exosystem.A)
        C = to_float(exosystem.C)
        # the factorisation below refuses what is not finite
        with np.errstate(over="ignore", invalid="ignore"):
            block = -(P @ A + A.T @ P - Q @ C - C.T @ Q.T) - 2 * rate * P
            block = (block + block.T) / 2
        factor = linalg.cho_factor(block)
        S = C @ linalg.cho_solve(factor, C.T)
        return float(np.linalg.eigvalsh((S + S.T) / 2)[-1])
    except GIVEN_UP:
        return math.inf


LARGEST_SEARCHED = 2000  # rows up to which supports are looked for
BUDGET = 200_000_000  # cubed rows of all eigenvalue problems of one search, about
CALL = 200_000  # what a small one costs besides
EDGE = 1e-9  # relative: an eigenvalue above minus this may be 0


def witness_directions(loop: Loop, mode: str) -> list[Sequence[float]]:
    """Vectors (n m,) with v' Lambda v about >= 0 or more, fewest agents first, those without a pin
    among equals."""
    table = sparse.csr_array(float_lambda(loop, mode))
    if table.shape[0] > LARGEST_SEARCHED or not np.all(np.isfinite(table.data)):
        return []
    search = _Search(table=table, width=loop.m)
    pinned = set(loop.pulls.nodes)
    everyone = list(range(loop.n))
    free = [agent for agent in everyone if agent not in pinned]
    supports: dict[Agents, None] = {}
    for base in (free, everyone):
        if base and not search.top(base)[0] < -search.edge:
            supports |= dict.fromkeys(search.supports_in(base))
    ordered = sorted(supports, key=lambda s: (len(s), bool(pinned & set(s)), s))
    return [search.direction(support) for support in ordered]


class _Search:
    """Eigenvalues of principal submatrices of one symmetric matrix, by agents."""

    def __init__(self, *, table: Any, width: int) -> None:
        self.table = table
        self.width = width
        largest = largest_entry(table.data)
        self.edge = EDGE * max(largest, 1e-300)
        self.known: dict[Agents, tuple[float, Array]] = {}
        self.left = BUDGET

    def top(self, agents: Sequence[int]) -> tuple[float, Array]:
        """The largest eigenvalue on these agents and its vector, by row."""
        key = tuple(sorted(agents))
        if key not in self.known:
            rows = rows_of(key, self.width)
            self.left -= CALL + len(rows) ** 3
            found = largest_eigenvalue(sparse.coo_array(self.table[rows][:, rows]))
            self.known[key] = (found.value, found.vector)
        return self.known[key]

    def fails(self, agents: Sequence[int]) -> bool:
        """Whether the submatrix seems not to be negative definite."""
        return self.top(agents)[0] >= -self.edge

    def direction(self, agents: Sequence[int]) -> list[float]:
        """The top vector of a support, zero elsewhere."""
        whole = np.zeros(self.table.shape[0])
        rows = rows_of(sorted(agents), self.width)
        _, vector = self.top(agents)
        # Every second solver has every second sign: the heaviest entry is made positive.
        heaviest = vector[int(np.argmax(np.abs(vector)))] if len(vector) else 1.0
        whole[rows] = vector if heaviest >= 0 else -vector
        result: list[float] = whole.tolist()
        return result

    def supports_in(self, base: Sequence[int]) -> list[Agents]:
        """Small supports inside ``base``, whose submatrix fails."""
        single: list[Agents] = [(agent,) for agent in base if self.fails((agent,))]
        if single:
            return single[:5]
        if self.needs_all(base):
            return [tuple(base)]
        order = self.by_weight(base)

        def fail_first(count: int) -> bool:
            return self.fails(order[:count])

        # The submatrix of the heaviest agents fails from some number of them on.
        fewest = bisect_left(range(len(order)), True, lo=1, key=fail_first)
        found = [self.cut(order[:fewest])]
        best = len(found[0])
        for seed in self.by_weight(base):
            grown = self.grown(seed, base, limit=best) if self.left > 0 else None
            if grown is not None:
                found.append(self.cut(grown))
                best = min(best, len(found[-1]))
        return sorted(set(found), key=lambda s: (len(s), s))[:5]

    def needs_all(self, base: Sequence[int]) -> bool:
        """Whether the submatrix is singular, connected and minus a Z-matrix: then no smaller one
        inside it fails."""
        if abs(self.top(base)[0]) > self.edge or self.width > 1:
            return False
        rows = sorted(base)
        part = self.table[rows][:, rows].tocoo()
        if np.any(part.data[part.row != part.col] < 0):
            return False
        return bool(csgraph.connected_components(part, directed=False)[0] == 1)

    def by_weight(self, agents: Sequence[int]) -> list[int]:
        """The agents by what they carry of the slowest direction, heaviest first."""
        ordered = np.array(sorted(agents))
        _, vector = self.top(agents)
        weights = np.max(np.abs(vector.reshape(len(ordered), self.width)), axis=1)
        result: list[int] = ordered[np.argsort(-weights, kind="stable")].tolist()
        return result

    def cut(self, agents: Sequence[int]) -> Agents:
        """Leave out agents as long as the rest still fails, the lightest first."""
        kept = self.by_weight(agents)
        for agent in reversed(list(kept)):
            rest = [other for other in kept if other != agent]
            if rest and self.left > 0 and self.fails(rest):
                kept = rest
        return tuple(sorted(kept))

    def grown(self, seed: int, base: Sequence[int], *, limit: int) -> list[int] | None:
        """Add, one by one, the neighbour that raises the top eigenvalue most; None at ``limit``
        agents."""
        chosen = [seed]
        allowed = set(base)
        while not self.fails(chosen):
            if self.left <= 0:
                return None
            entries = self.table[rows_of(chosen, self.width)].indices
            near = set((entries // self.width).tolist()) & allowed - set(chosen)
            if len(chosen) + 1 >= limit or not near:
                return None
            tops = {agent: self.top([*chosen, agent])[0] for agent in sorted(near)}
            chosen.append(max(tops, key=tops.__getitem__))
        return chosen
