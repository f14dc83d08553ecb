"""Gains shared by several Z-matrices: the geometric program of theory, section 7, solved through its dual.

S_r + 2 K >= 0 iff (S_r + 2 K) v_r >= 0 for some v_r = exp(u_r) > 0: posynomials in v.  The dual shares the cost of
every pinned agent among the modes, sum over r of v_r,i^2 <= c_i, and maximises -1/2 sum of v_r' S_r v_r, where the
others follow by one solve with a factor that stays.  On products of spheres that is a quadratic form, for L-BFGS; the
gains are its prices.  Sparse; floating point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize, sparse
from scipy.sparse.linalg import splu

from dobc_design.solvers.program import Array

FEW_ROWS = 15  # up to which a conic program is the quicker way
ROWS = 5000  # agents up to which factors of sparse networks stay small
DENSE = 300  # pins up to which a dense Schur complement is multiplied, which is quicker than a solve
STEPS = 1500
UNUSED = 0.1  # the part of the cost that is nobody's at the beginning, to mode 1's
# What the gains are raised by, relatively, until all matrices are definite.
RISES = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
SMALL = 1e-9  # gains below this part of the largest are left out
# For splu: an order that suits a symmetric pattern, and no exchange of rows.  A random graph of degree 8 with 2000
# agents takes a quarter of the time (0.09 s in place of 0.34 s), with 40 % of the entries in the factor.
SYMMETRIC: Any = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedOptimum:
    """Gains (n,) of least cost, about; v (n,) of every matrix, with v v'/2 its multiplier; the ``bound`` they give."""

    gains: Array
    vectors: tuple[Array, ...]
    bound: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """One matrix, split into pinned rows and others; ``factor`` is that of the others, None if there are none.

    ``whole``: its Schur complement on the pins, where they are few enough for a dense one.
    """

    own: Any
    across: Any
    factor: Any
    whole: Array | None


def solve_shared(tables: Sequence[Any], chosen: Array, costs: Array, caps: Array | None = None) -> SharedOptimum | None:
    """Gains of least cost on the ``chosen`` agents (n,) for symmetric Z-matrices (n, n); None if none are found.

    An agent whose gain would exceed its cap (inf: none) is held at it.
    """
    limits = np.full(len(costs), np.inf) if caps is None else caps
    full = np.zeros(len(costs), dtype=bool)
    for _ in range(int(np.sum(chosen)) + 1):
        extra = np.where(full, limits, 0.0)
        held = [sparse.csr_array(table + sparse.diags_array(2 * extra)) for table in tables]
        free = chosen & np.logical_not(full)
        found = _uncapped(held, free, costs)
        if found is None:
            return None
        over = found.gains > limits * (1 + 1e-9)
        if not np.any(over):
            bound = found.bound + float(costs @ extra)
            return SharedOptimum(gains=found.gains + extra, vectors=found.vectors, bound=bound)
        full |= over
    return None


def _uncapped(tables: Sequence[Any], chosen: Array, costs: Array) -> SharedOptimum | None:
    pins, others = np.flatnonzero(chosen), np.flatnonzero(np.logical_not(chosen))
    if not len(pins) or len(costs) > ROWS:
        return None
    try:
        blocks = [_split(table, pins, others) for table in tables]
    except RuntimeError:  # exactly singular
        return None
    root, scale = np.sqrt(costs[pins]), max(float(np.max(np.abs(table.data), initial=0.0)) for table in tables)
    if not scale > 0:
        return None

    def value(x: Array) -> tuple[float, Array]:
        norms, unit = _on_spheres(x, len(tables))
        shares = root * unit[:-1]
        flows = np.array([_flow(block, v) for block, v in zip(blocks, shares, strict=True)])
        slope = np.zeros_like(unit)
        slope[:-1] = flows * root
        slope = (slope - unit * np.sum(slope * unit, axis=0)) / norms
        return float(np.sum(shares * flows)) / (2 * scale), (slope / scale).ravel()

    start = np.ones((len(tables) + 1, len(pins)))
    start[-1] = UNUSED
    options: Any = {"maxiter": STEPS, "maxfun": 2 * STEPS, "maxcor": 20, "ftol": 1e-15, "gtol": 1e-12}
    answer = optimize.minimize(value, start.ravel(), jac=True, method="L-BFGS-B", options=options)
    shares = root * np.abs(_on_spheres(answer.x, len(tables))[1][:-1])
    return _finished(tables, blocks, pins, others, shares, costs)


def _on_spheres(x: Array, count: int) -> tuple[Array, Array]:
    """The columns of x, one per pin, and their lengths: one part for every matrix and one that nobody uses."""
    parts = x.reshape(count + 1, -1)
    norms = np.sqrt(np.sum(parts**2, axis=0))
    return norms, parts / norms


def _split(table: Any, pins: Any, others: Any) -> _Block:
    rows = sparse.csr_array(table)[pins]
    factor = splu(sparse.csc_array(table[others][:, others]), **SYMMETRIC) if len(others) else None
    own, across = rows[:, pins], rows[:, others]
    whole = None
    if len(pins) <= DENSE:
        whole = own.toarray()
        if factor is not None:
            whole -= across @ factor.solve(across.T.toarray())
    return _Block(own=own, across=across, factor=factor, whole=whole)


def _follow(block: _Block, v: Array) -> Array:
    """v on the other agents, where S v is 0."""
    return np.zeros(0) if block.factor is None else np.asarray(-block.factor.solve(block.across.T @ v))


def _flow(block: _Block, v: Array) -> Array:
    """S v on the pinned agents."""
    if block.whole is not None:
        return np.asarray(block.whole @ v)
    flow = block.own @ v
    return np.asarray(flow if block.factor is None else flow + block.across @ _follow(block, v))


def _finished(
    tables: Sequence[Any], blocks: Sequence[_Block], pins: Any, others: Any, shares: Array, costs: Array
) -> SharedOptimum | None:
    """Gains are the mean of what the matrices ask for, weighted by their shares, raised until all are definite."""
    flows = np.array([_flow(block, v) for block, v in zip(blocks, shares, strict=True)])
    gains = np.zeros(len(costs))
    gains[pins] = np.maximum(0.0, -np.sum(shares * flows, axis=0) / (2 * costs[pins]))
    gains[gains < SMALL * np.max(gains)] = 0.0
    vectors = []
    for block, v in zip(blocks, shares, strict=True):
        whole = np.zeros(len(costs))
        whole[pins], whole[others] = v, np.maximum(_follow(block, v), 0.0)
        vectors.append(whole)
    bound = -float(np.sum(shares * flows)) / 2
    for rise in RISES:
        raised = gains * (1 + rise)
        if all(_is_positive(table, raised) for table in tables):
            return SharedOptimum(gains=raised, vectors=tuple(vectors), bound=bound)
    return None


def _is_positive(table: Any, gains: Array) -> bool:
    """Whether S + 2 K is positive definite: a Z-matrix is if its inverse is >= 0."""
    try:
        w = splu(sparse.csc_array(table + sparse.diags_array(2 * gains)), **SYMMETRIC).solve(np.ones(len(gains)))
    except RuntimeError:  # exactly singular
        return False
    return bool(np.all(np.isfinite(w)) and np.all(w > 0))
