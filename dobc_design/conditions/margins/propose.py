"""Proposals of v for the rows at the target with weights and gains at their worst; no proofs."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dobc_design.conditions.separable.claim import Errors, holding_gains
from dobc_design.problem.arrays import coupling_places
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array
from dobc_design.solvers.sparse import factored

ROUNDS, CLOSE = 100, 1e-9


@np.errstate(all="ignore")
def common_vector(problem: Problem, errors: Errors) -> Array | None:
    """v > 0 (n,) with M v >= 1, M = L(w h'(0)) + K, in every mode and for all errors; None if none is seen.  Policy
    iteration: given v every agent takes the mode and the ends of its weights that pull it out most.
    Raises: OverflowError beyond the floats."""
    n, spread, v = problem.n, float(errors.weights), np.ones(problem.n)
    slopes = np.array([float(coupling.jacobian_at_zero()[0][0].midpoint) for coupling in problem.couplings])
    gains, modes = np.array([float(k) for k in holding_gains(problem, error=errors.gains)]), []
    for arcs in problem.network.modes.values():
        weights = np.array([float(w) for w in arcs.weights]) * slopes[coupling_places(problem, arcs)]
        modes.append(sparse.csr_array((weights, (arcs.listeners, arcs.speakers)), shape=(n, n)))
    for _ in range(ROUNDS):
        tables = []
        for mode in modes:
            steps = v[mode.indices] - np.repeat(v, np.diff(mode.indptr))
            ends = mode.data * np.where(steps > 0, 1 + spread, 1 - spread)
            table = sparse.csr_array((ends, mode.indices, mode.indptr), shape=(n, n))
            tables.append(sparse.csr_array(sparse.diags_array(gains + table.sum(axis=1)) - table))
        worst = np.argmin([table @ v for table in tables], axis=0)
        M = sum(sparse.diags_array((worst == k).astype(float)) @ table for k, table in enumerate(tables))
        try:
            found = factored(M).solve(np.ones(n))
        except RuntimeError:  # singular
            return None
        if not np.all(np.isfinite(found)) or not np.all(found > 0):
            return None
        if np.all(np.abs(found - v) <= CLOSE * found):
            return np.asarray(found)
        v = found
    return None
