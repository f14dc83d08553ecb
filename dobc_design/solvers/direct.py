"""The programs handed to Clarabel directly: no modelling layer, microseconds of set-up for small ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.exact.pencil import Pencil, Place, below, positive
from dobc_design.exact.symmetric import Symmetric
from dobc_design.solvers.program import FAILED, Array, Program, Solution, assemble, is_solver_failure, without_values

ROOT2 = math.sqrt(2.0)
SOLVER = "Clarabel"


def solve_directly(program: Program, *, time_limit: float = 60.0) -> Solution:
    """Solve a Program by Clarabel.  A crash of the solver is a Solution without values, never an exception.

    ``time_limit`` in s.  The status is the solver's own word ("Solved", "PrimalInfeasible", ...).
    """
    import clarabel

    try:
        return _read(program, _run(program, clarabel, time_limit=time_limit))
    except BaseException as error:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(error):
            raise
        return without_values(f"{FAILED}{type(error).__name__}", solver=SOLVER)


def _read(program: Program, answer: Any) -> Solution:
    """What the solver answered.  Raises what comes of it if that is no point at all."""
    status = str(answer.status)
    numbers = np.asarray(answer.x, dtype=float).ravel()
    objective = float(answer.obj_val)
    # The x of an infeasible or unbounded problem is the ray that shows it, not a point.
    if "Infeasible" in status or not (np.all(np.isfinite(numbers)) and math.isfinite(objective)):
        return without_values(status, solver=SOLVER)
    values = assemble(program.pencils[0], numbers.tolist())
    return Solution(status=status, solver=SOLVER, objective=objective, values=values)


def _run(program: Program, clarabel: Any, *, time_limit: float) -> Any:
    columns, blocks, cones = _constraints(program, clarabel)
    quadratic, linear = _objective(program)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    rows, right = _csc(np.vstack(columns)), np.concatenate(blocks)
    return clarabel.DefaultSolver(_csc_diagonal(quadratic), linear, rows, right, cones, settings).solve()


def _objective(program: Program) -> tuple[Array, Array]:
    """The diagonal of the quadratic term and the linear term: tr P + |Q|^2, or t."""
    places = _places(program)
    margin = program.objective == "margin"
    quadratic, linear = np.zeros(len(places) + margin), np.zeros(len(places) + margin)
    if margin:
        linear[-1] = 1.0
        return quadratic, linear
    for k, (name, i, j) in enumerate(places):
        if name == "P" and i == j:
            linear[k] = 1.0
        elif name == "Q":
            quadratic[k] = 2.0
    return quadratic, linear


def _places(program: Program) -> list[Place]:
    return [place for unknown in program.pencils[0].unknowns for place in unknown.places()]


def _constraints(program: Program, clarabel: Any) -> tuple[list[Array], list[Array], list[Any]]:
    """Rows [A | t], right-hand sides and cones of every constraint, s = b - A x in the cone."""
    places = _places(program)
    margin = program.objective == "margin"
    P = program.pencils[0].unknowns[0]
    columns: list[Array] = []
    blocks: list[Array] = []
    cones: list[Any] = []

    def add(pencil: Pencil, *, with_t: bool) -> None:
        matrix = np.zeros((pencil.size * (pencil.size + 1) // 2, len(places) + margin))
        for k, place in enumerate(places):
            if place in pencil.coefficients:
                matrix[:, k] = _svec(pencil.coefficients[place])
        if with_t:
            matrix[_diagonal(pencil.size), -1] = -1.0
        columns.append(matrix)
        blocks.append(-_svec(pencil.constant))
        cones.append(clarabel.PSDTriangleConeT(pencil.size))

    for pencil in program.pencils:
        add(pencil, with_t=margin)
    if margin:
        add(positive(P, floor=program.floor + 1), with_t=False)
        add(below(P, ceiling=program.ratio), with_t=False)
        gains = [k for k, place in enumerate(places) if place[0] == "Q"]
        if gains:
            columns.append(_ball(gains, width=len(places) + 1))
            blocks.append(np.array([float(program.radius)] + [0.0] * len(gains)))
            cones.append(clarabel.SecondOrderConeT(len(gains) + 1))
    else:
        add(positive(P, floor=program.floor), with_t=False)
    return columns, blocks, cones


def _ball(variables: Sequence[int], *, width: int) -> Array:
    """Rows of the cone |x[variables]| <= radius."""
    cone = np.zeros((len(variables) + 1, width))
    cone[np.arange(1, len(variables) + 1), variables] = -1.0
    return cone


def _svec(matrix: Symmetric) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    result = np.zeros(matrix.size * (matrix.size + 1) // 2)
    for (i, j), value in matrix.entries.items():
        result[j * (j + 1) // 2 + i] = float(value) * (1.0 if i == j else ROOT2)
    return result


def _diagonal(size: int) -> Any:
    """Where ``_svec`` puts the diagonal."""
    j = np.arange(size)
    return j * (j + 3) // 2


def _csc(rows: Array) -> Any:
    """The nonzero entries of a dense matrix, column by column."""
    columns, places = np.nonzero(rows.T)
    counts = np.bincount(columns, minlength=rows.shape[1])
    return _compressed(rows[places, columns], places, np.concatenate([[0], np.cumsum(counts)]), rows.shape)


def _csc_diagonal(diagonal: Array) -> Any:
    kept = np.flatnonzero(diagonal)
    starts = np.searchsorted(kept, np.arange(len(diagonal) + 1))
    return _compressed(diagonal[kept], kept, starts, (len(diagonal), len(diagonal)))


def _compressed(data: Array, places: Any, starts: Any, shape: tuple[int, ...]) -> Any:
    """A csc_matrix from its parts, with 32-bit indices, which SciPy does not look through one by one."""
    return sparse.csc_matrix((data, places.astype(np.int32), starts.astype(np.int32)), shape=shape)
