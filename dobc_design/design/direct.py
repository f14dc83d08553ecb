"""The programs handed to Clarabel directly: no modelling layer, microseconds of set-up for small ones."""

from __future__ import annotations

import math

import numpy as np
from scipy import sparse

from dobc_design.design.program import Array, Program, Solution, assemble
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.theorems.conditions import below, positive
from dobc_design.theorems.pencil import Pencil, Place

ROOT2 = math.sqrt(2.0)


def solve_directly(program: Program, *, time_limit: float = 60.0) -> Solution:
    """Solve a Program by Clarabel.  A crash of the solver is a Solution without values, never an exception."""
    import clarabel

    columns, blocks, cones = _constraints(program, clarabel)
    places = _places(program)
    margin = program.objective == "margin"
    size = len(places) + (1 if margin else 0)
    quadratic = np.zeros(size)
    linear = np.zeros(size)
    if margin:
        linear[-1] = 1.0
    else:
        for k, (name, i, j) in enumerate(places):
            if name == "P" and i == j:
                linear[k] = 1.0
            elif name == "Q":
                quadratic[k] = 2.0
    rows = np.vstack(columns) if columns else np.zeros((0, size))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    try:
        solver = clarabel.DefaultSolver(
            sparse.csc_matrix(np.diag(quadratic)), linear, sparse.csc_matrix(rows), np.concatenate(blocks), cones, settings
        )
        answer = solver.solve()
    except Exception as error:  # the solver is foreign code and may panic in ways of its own
        return Solution(status=f"failed: {type(error).__name__}", solver="Clarabel", objective=math.nan)
    numbers = np.asarray(answer.x, dtype=float)
    if not np.all(np.isfinite(numbers)) or "Infeasible" in str(answer.status):
        return Solution(status=str(answer.status), solver="Clarabel", objective=math.nan)
    return Solution(
        status=str(answer.status), solver="Clarabel", objective=float(answer.obj_val),
        values=assemble(program.pencils[0], numbers.tolist()),
    )  # fmt: skip


def _places(program: Program) -> list[Place]:
    return [place for unknown in program.pencils[0].unknowns for place in unknown.places()]


def _constraints(program: Program, clarabel: object) -> tuple[list[Array], list[Array], list[object]]:
    """Rows [A | t], right-hand sides and cones of every constraint, s = b - A x in the cone."""
    places = _places(program)
    margin = program.objective == "margin"
    P = program.pencils[0].unknowns[0]
    columns: list[Array] = []
    blocks: list[Array] = []
    cones: list[object] = []

    def add(pencil: Pencil, *, with_t: bool) -> None:
        matrix = np.zeros((pencil.size * (pencil.size + 1) // 2, len(places) + (1 if margin else 0)))
        for k, place in enumerate(places):
            if place in pencil.coefficients:
                matrix[:, k] = _svec(pencil.coefficients[place])
        if with_t:
            matrix[:, -1] = -_svec(SparseSymmetric(pencil.size, {}).shifted(1))
        columns.append(matrix)
        blocks.append(-_svec(pencil.constant))
        cones.append(clarabel.PSDTriangleConeT(pencil.size))  # type: ignore[attr-defined]

    for pencil in program.pencils:
        add(pencil, with_t=margin)
    if margin:
        add(positive(P, floor=program.floor + 1), with_t=False)
        add(below(P, ceiling=program.ratio), with_t=False)
        gains = [k for k, place in enumerate(places) if place[0] == "Q"]
        if gains:
            cone = np.zeros((len(gains) + 1, len(places) + 1))
            cone[np.arange(1, len(gains) + 1), gains] = -1.0
            columns.append(cone)
            blocks.append(np.array([float(program.radius)] + [0.0] * len(gains)))
            cones.append(clarabel.SecondOrderConeT(len(gains) + 1))  # type: ignore[attr-defined]
    else:
        add(positive(P, floor=program.floor), with_t=False)
    return columns, blocks, cones


def _svec(matrix: SparseSymmetric) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    result = np.zeros(matrix.size * (matrix.size + 1) // 2)
    for (i, j), value in matrix.entries.items():
        result[j * (j + 1) // 2 + i] = float(value) * (1.0 if i == j else ROOT2)
    return result

