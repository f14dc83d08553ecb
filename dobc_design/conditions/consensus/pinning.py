"""The smallest pinning gains: minimise sum c_i k_i over k >= 0 subject to Lambda(K) <= -2 beta I (theory, section 7).

Where -(J + J') is a Z-matrix the optimum has a closed form, one sparse solve per round.  Several modes that share
one K, and couplings that are no Z-matrix, go to a small conic program, or get gains that are valid and not the
smallest.  Everything here is floating point and sits on the boundary: round up, then decide exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import cg, splu

from dobc_design.conditions.consensus.pinning_program import solve_for_gains
from dobc_design.conditions.consensus.pinning_shared import FEW_ROWS, SYMMETRIC, solve_shared
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue, rows_of
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

DENSE = 50  # rows up to which a dense solve is the faster one, and
FULL = 0.3  # the part of the entries from which it is in any size
PROGRAM_ROWS = 80  # rows of one block up to which the conic program is solved
PROGRAM_SIZE = 40_000  # squared rows of all blocks together
LARGE = 3000  # rows from which conjugate gradients go first, with
ITERATIONS = 300  # steps at most
SINGULAR = 1e-11  # relative to the entries: smaller eigenvalues are not told from 0 here
STEPS = 60  # of a bisection


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocks:
    """S = -(J + J') - 2 beta I of every mode; they share the gains: S + 2 k_i on the rows of agent i is to be >= 0.

    ``tables``: symmetric SciPy arrays (n width, n width).  With couplings by component every component is a block
    of its own and ``width`` is 1.  ``z``: all entries off the diagonal are <= 0.  ``scale``: the largest entry.
    ``sources``: of every table its mode and component (0 if ``width`` is m); equal tables are kept once.
    """

    agents: int
    width: int
    tables: tuple[Any, ...]
    scale: float
    z: bool
    sources: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Optimum:
    """Gains k (n,) of least cost for one Z-matrix, and the v (n,) >= 0 that shows it: v v'/2 is the multiplier.

    v_i^2 <= c_i where k_i = 0 though a gain is allowed, v_i^2 = c_i where it is between its limits, v_i^2 >= c_i where
    it is at its cap.
    """

    gains: Array
    v: Array


def network_blocks(problem: Problem, *, pins: bool = False) -> Blocks | None:
    """Build the blocks of a problem, beta = 0; None if an entry is beyond the floats.

    ``pins``: the present gains stay and are part of S, so that further ones come on top of them.
    """
    n, m = problem.n, problem.m
    tables: dict[bytes, Any] = {}
    sources: dict[bytes, tuple[str, int]] = {}
    found = [sparse.coo_array(-float_lambda(problem, mode, pins=pins)) for mode in problem.network.modes]
    for table in found:
        table.sum_duplicates()
    if not all(np.all(np.isfinite(table.data)) for table in found):
        return None
    apart = all(np.all((table.row % m == table.col % m) | (table.data == 0)) for table in found)
    width = 1 if apart else m
    for mode, table in zip(problem.network.modes, found, strict=True):
        for component, part in enumerate(_components(table, m) if apart else [table]):
            each = part.tocsr()
            each.sum_duplicates()
            each.eliminate_zeros()
            key = each.indptr.tobytes() + each.indices.tobytes() + each.data.tobytes()
            tables.setdefault(key, each)
            sources.setdefault(key, (mode, component))
    scale = max((float(np.max(np.abs(t.data), initial=0.0)) for t in tables.values()), default=0.0)
    z = width == 1 and all(_is_z(table) for table in tables.values())
    return Blocks(
        agents=n, width=width, tables=tuple(tables.values()), scale=scale, z=z, sources=tuple(sources.values())
    )


def for_rate(blocks: Blocks, rate: float) -> Blocks:
    """The same blocks for a rate beta (1/s): S - 2 beta I."""
    tables = tuple(sparse.csr_array(t - 2 * rate * sparse.eye_array(t.shape[0])) for t in blocks.tables)
    return replace(blocks, tables=tables, scale=max(blocks.scale, 2 * rate))


def fastest_rate(blocks: Blocks, allowed: Collection[int]) -> float:
    """The rate beta (1/s) that gains on the ``allowed`` agents approach as they grow; about; inf if all are allowed.

    Half the smallest eigenvalue of S on the other agents: positive iff some gains can do at all.
    """
    rows = rows_of(np.setdiff1d(np.arange(blocks.agents), list(allowed)), blocks.width)
    return min((lowest_on(table, rows)[0] / 2 for table in blocks.tables), default=0.0)


def _components(table: Any, m: int) -> list[Any]:
    size = table.shape[0] // m
    parts = []
    for c in range(m):
        own = table.row % m == c
        place = (table.row[own] // m, table.col[own] // m)
        parts.append(sparse.coo_array((table.data[own], place), shape=(size, size)))
    return parts


def _is_z(table: Any) -> bool:
    each = table.tocoo()
    return bool(np.all(each.data[each.row != each.col] <= 0))


def smallest_gains(blocks: Blocks, allowed: Collection[int], *, costs: Sequence[float] | None = None) -> Array | None:
    """The gains k (n,) of least cost on the ``allowed`` agents, about; None if no gains on them can do.

    One Z-matrix: the optimum.  Otherwise the optimum up to the tolerance of a solver while the blocks are not too
    large, else gains that suffice.  ``costs`` c_i > 0 default to 1.
    """
    weights = np.ones(blocks.agents) if costs is None else np.asarray(costs, dtype=np.float64)
    chosen = np.zeros(blocks.agents, dtype=bool)
    chosen[list(allowed)] = True
    if blocks.z:
        found = valid_gains(blocks, chosen, weights)
        if found is None or len(blocks.tables) == 1:
            return found
    elif fastest_rate(blocks, allowed) <= 1e-9 * blocks.scale:
        return None
    else:
        found = None
    rows = blocks.agents * blocks.width
    shared = solve_shared(blocks.tables, chosen, weights) if blocks.z and rows > FEW_ROWS else None
    if shared is not None and (found is None or weights @ shared.gains < weights @ found):
        return shared.gains
    if rows <= PROGRAM_ROWS and rows * rows * len(blocks.tables) <= PROGRAM_SIZE:
        best = solve_for_gains(blocks.tables, np.flatnonzero(chosen), weights, width=blocks.width, scale=blocks.scale)
        if best is not None and (found is None or weights @ best < weights @ found):
            return best
    return _alike(blocks, chosen) if found is None else found


def valid_gains(blocks: Blocks, chosen: Array, weights: Array) -> Array | None:
    """For Z-matrices: the closed form of every block, and of several the largest gain of each agent.

    Lambda only falls when a gain rises, so the largest ones serve every block.
    """
    gains = np.zeros(blocks.agents)
    for table in blocks.tables:
        own = closed_form(table, chosen, weights)
        if own is None:
            return None
        gains = np.maximum(gains, own)
    return gains


def closed_form(table: Any, chosen: Array, weights: Array) -> Array | None:
    """The optimal gains for one symmetric Z-matrix S (n, n); None unless S is positive on the other agents."""
    found = optimum(table, chosen, weights)
    return None if found is None else found.gains


def optimum(table: Any, chosen: Array, weights: Array, caps: Array | None = None) -> Optimum | None:
    """The optimal gains for one symmetric Z-matrix S (n, n), at most ``caps`` (n,); None if none can do.

    An agent whose gain would exceed its cap is held at it, which only raises v and the gains of the others.
    Source: theory, section 7; with caps the multiplier of a cap is v_i^2 - c_i.
    """
    if caps is None:
        return _uncapped(table, chosen, weights)
    full = np.zeros(len(weights), dtype=bool)
    for _ in range(int(np.sum(chosen)) + 1):
        held = table + sparse.diags_array(2 * np.where(full, caps, 0.0)) if np.any(full) else table
        found = _uncapped(sparse.csr_array(held), chosen & ~full, weights)
        if found is None:
            return None
        over = found.gains > caps * (1 + 1e-12)
        if not np.any(over):
            return Optimum(gains=np.where(full, caps, found.gains), v=found.v)
        full |= over
    return None


def _uncapped(table: Any, chosen: Array, weights: Array) -> Optimum | None:
    """v_i = sqrt(c_i) on the chosen agents, (S v)_i = 0 on the others, k_i = -(S v)_i / (2 v_i).

    An agent whose gain would be negative is set free, and v solved again.
    """
    active = np.array(chosen, dtype=bool)
    v = np.where(active, np.sqrt(weights), 0.0)
    size = float(np.max(np.abs(table.data), initial=0.0))
    for _ in range(int(active.sum()) + 1):
        free = np.flatnonzero(~active)
        if len(free):
            held = np.flatnonzero(active)
            rows = table[free]
            solution = _solve(rows[:, free], -(rows[:, held] @ v[held]), size=size)
            if solution is None:
                return None
            v[free] = np.maximum(solution, 0.0)
        flow = table @ v
        gains = np.where(active, -flow / (2 * np.where(active, v, 1.0)), 0.0)
        negative = active & (gains < -1e-13 * size)
        if not np.any(negative):
            return Optimum(gains=np.maximum(gains, 0.0), v=v)
        active &= ~negative
    return None


def _solve(matrix: Any, right: Array, *, size: float) -> Array | None:
    """Solve M x = right for a Z-matrix M; None unless M is positive definite (M w = 1 has a solution w > 0)."""
    if len(right) > LARGE and (quick := _iterated(matrix, right)) is not None:
        return quick
    both = np.column_stack([right, np.ones(len(right))])
    dense = len(right) <= DENSE or matrix.nnz > FULL * len(right) ** 2
    try:
        answer = np.linalg.solve(matrix.toarray(), both) if dense else splu(matrix.tocsc(), **SYMMETRIC).solve(both)
    except (np.linalg.LinAlgError, RuntimeError, ValueError):  # singular
        return None
    w = answer[:, 1]
    if not np.all(np.isfinite(answer)) or not np.all(w > 0) or float(np.max(w)) * size * SINGULAR > 1:
        return None
    x: Array = answer[:, 0]
    return x


def factorised(matrix: Any) -> Callable[[Array], Array]:
    """How to solve with a symmetric sparse matrix, again and again.  Raises: RuntimeError if it is singular."""
    solve: Callable[[Array], Array] = splu(sparse.csc_array(matrix), **SYMMETRIC).solve
    return solve


def _iterated(matrix: Any, right: Array) -> Array | None:
    """The same by conjugate gradients where they are quick: random graphs fill up a factor, a long path does not."""
    diagonal = matrix.diagonal()
    if not np.all(diagonal > 0):
        return None
    scaling = sparse.diags_array(1 / diagonal)
    answers = []
    for side, tolerance in ((np.ones(len(right)), 1e-3), (right, 1e-14)):
        x, status = cg(matrix, side, rtol=tolerance, maxiter=ITERATIONS, M=scaling)
        if status != 0 or not np.all(np.isfinite(x)):
            return None
        answers.append(x)
    w, x = answers
    return x if np.all(w > 0) and np.all(matrix @ w > 0) else None


def looseness(blocks: Blocks, allowed: Collection[int]) -> float:
    """How loosely gains on the ``allowed`` agents hold the others, however large they are; inf if they cannot.

    For Z-matrices 1'M^-1 1 with M = S on the others (about their number over the smallest eigenvalue, and one solve);
    otherwise one over the smallest eigenvalue.
    """
    others = np.setdiff1d(np.arange(blocks.agents), list(allowed))
    if not blocks.z:
        rate = fastest_rate(blocks, allowed)
        return 0.0 if rate == np.inf else 1 / rate if rate > 1e-9 * blocks.scale else np.inf
    worst = 0.0
    for table in blocks.tables if len(others) else ():
        found = _solve(table[others][:, others], np.ones(len(others)), size=blocks.scale)
        worst = np.inf if found is None else max(worst, float(np.sum(found)))
    return worst


def lowest_on(table: Any, rows: Any) -> tuple[float, Array]:
    """The smallest eigenvalue of a principal submatrix and its vector on these rows, about; inf on no rows."""
    if not len(rows):
        return float("inf"), np.zeros(0)
    top = largest_eigenvalue(sparse.coo_array(-table[rows][:, rows]))
    return -top.value, top.vector


def _alike(blocks: Blocks, chosen: Array) -> Array | None:
    """One gain for all chosen agents, by bisection; None if the largest one tried does not do."""
    indicator = np.repeat(chosen.astype(np.float64), blocks.width)

    def does(gain: float) -> bool:
        held = sparse.diags_array(2 * gain * indicator)
        everything = np.arange(len(indicator))
        return all(lowest_on((table + held).tocsr(), everything)[0] > 0 for table in blocks.tables)

    low, high = 0.0, blocks.scale * 1e6
    if not high or not does(high):
        return None
    for _ in range(STEPS):
        middle = (low * high) ** 0.5 if low else high / 100
        if middle <= low or middle >= high or high <= low * (1 + 1e-6) or high < blocks.scale * 1e-9:
            break
        low, high = (low, middle) if does(middle) else (middle, high)
    return high * chosen.astype(np.float64)
