"""The conic program behind shared gains: minimise c'k subject to S + 2 sum k_i E_i >= 0 for every block, k >= 0.

E_i is the identity on the rows of agent i.  Handed to Clarabel directly; its answer is a proposal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.solvers.program import Array, is_solver_failure

ROOT2 = math.sqrt(2.0)
SMALL = 1e-8  # gains below this part of the largest are noise of the solver


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProgramOptimum:
    """Gains (n,) of least cost, about, and the multiplier Z >= 0 of every block."""

    gains: Array
    multipliers: tuple[Array, ...]


def solve_for_gains(
    tables: Sequence[Any], allowed: Any, costs: Array, *, width: int, scale: float, time_limit: float = 20.0
) -> Array | None:
    """The gains (n,) of least cost, about; None if the solver gives none.

    ``tables``: symmetric SciPy arrays (n width, n width); ``scale`` their largest entry; ``allowed`` agent indices.
    """
    found = solve_program(tables, allowed, costs, width=width, scale=scale, time_limit=time_limit)
    return None if found is None else found.gains


def solve_program(
    tables: Sequence[Any],
    allowed: Any,
    costs: Array,
    *,
    width: int,
    scale: float,
    caps: Array | None = None,
    time_limit: float = 20.0,
) -> ProgramOptimum | None:
    """The same with its multipliers, and with k <= ``caps`` (n,), where inf is no cap."""
    import clarabel

    if not len(allowed) or not scale > 0:
        return None
    limits = np.full(len(costs), np.inf) if caps is None else caps
    program = _Program(tables=tables, allowed=allowed, costs=costs, caps=limits, width=width, scale=scale)
    try:
        answer = _run(program, clarabel, time_limit=time_limit)
    except BaseException as error:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(error):
            raise
        return None
    numbers, dual = np.asarray(answer.x, dtype=np.float64), np.asarray(answer.z, dtype=np.float64)
    if "Infeasible" in str(answer.status) or not np.all(np.isfinite(numbers)):
        return None
    gains = np.zeros(len(costs))
    gains[allowed] = np.maximum(numbers, 0.0) * scale
    gains[gains < SMALL * np.max(gains, initial=0.0)] = 0.0
    multipliers, start = [], 0
    for table in tables:
        length = table.shape[0] * (table.shape[0] + 1) // 2
        multipliers.append(_smat(dual[start : start + length], table.shape[0]))
        start += length
    return ProgramOptimum(gains=gains, multipliers=tuple(multipliers))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Program:
    tables: Sequence[Any]
    allowed: Any
    costs: Array
    caps: Array
    width: int
    scale: float


def _run(program: _Program, clarabel: Any, *, time_limit: float) -> Any:
    count, scale = len(program.allowed), program.scale
    rows: list[Any] = []
    right: list[Array] = []
    cones: list[Any] = []
    for table in program.tables:
        size = table.shape[0]
        rows.append(_columns(program.allowed, size, program.width))
        right.append(_svec(table / scale))
        cones.append(clarabel.PSDTriangleConeT(size))
    rows.append(sparse.csc_array(-sparse.eye_array(count)))
    right.append(np.zeros(count))
    cones.append(clarabel.NonnegativeConeT(count))
    own = program.caps[program.allowed]
    capped = np.flatnonzero(np.isfinite(own))
    if len(capped):
        rows.append(sparse.csc_array(sparse.eye_array(count).tocsr()[capped]))
        right.append(own[capped] / scale)
        cones.append(clarabel.NonnegativeConeT(len(capped)))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    nothing = sparse.csc_matrix((count, count))
    matrix = sparse.csc_matrix(sparse.vstack(rows))
    linear = program.costs[program.allowed]
    return clarabel.DefaultSolver(nothing, linear, matrix, np.concatenate(right), cones, settings).solve()


def _columns(allowed: Any, size: int, width: int) -> Any:
    """-2 svec(E_i), one column per allowed agent."""
    j = (allowed[:, None] * width + np.arange(width)).ravel()
    places = j * (j + 3) // 2  # of the diagonal, see _svec
    columns = np.repeat(np.arange(len(allowed)), width)
    shape = (size * (size + 1) // 2, len(allowed))
    return sparse.csc_array((np.full(len(places), -2.0), (places, columns)), shape=shape)


def _svec(table: Any) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    each = table.tocoo()
    size = each.shape[0]
    result = np.zeros(size * (size + 1) // 2)
    upper = each.row <= each.col
    i, j, values = each.row[upper].astype(np.int64), each.col[upper].astype(np.int64), each.data[upper]
    np.add.at(result, j * (j + 1) // 2 + i, np.where(i == j, values, ROOT2 * values))
    return result


def _smat(vector: Array, size: int) -> Array:
    """The symmetric matrix whose upper triangle, as ``_svec`` writes it, is the vector."""
    result = np.zeros((size, size))
    columns = np.repeat(np.arange(size), np.arange(1, size + 1))
    rows = np.concatenate([np.arange(j + 1) for j in range(size)])
    result[rows, columns] = np.where(rows == columns, vector, vector / ROOT2)
    return result + np.triu(result, 1).T
