"""The block LMI of Theorems 1 and 2 as the paper writes it, through cvxpy: an oracle."""

from __future__ import annotations

import math
import warnings
from typing import Any

import cvxpy as cp
import numpy as np
from scipy import sparse

from dobc_design.exact.pencil import Pencil
from dobc_design.exact.symmetric import Symmetric
from dobc_design.solvers.program import Program, Solution, assemble


def build_dense(program: Program) -> tuple[Any, dict[str, Any]]:
    """The cvxpy problem of a Program and its variables by name (P, declared symmetric, Q and perhaps t): the block LMI
    of Theorems 1 and 2 as the paper writes it, size n (m + q) per mode; the oracle of the reduced form."""
    first = program.pencils[0]
    variables: dict[str, Any] = {
        unknown.name: cp.Variable((unknown.rows, unknown.columns), symmetric=unknown.symmetric, name=unknown.name)
        for unknown in first.unknowns
    }
    P, Q = variables["P"], variables.get("Q")
    q = first.unknowns[0].rows
    constraints = []
    if program.objective == "margin":
        t = variables["t"] = cp.Variable(name="t")
        constraints += [_affine(each, variables) << t * np.eye(each.size) for each in program.pencils]
        constraints += [P >> np.eye(q) * float(1 + program.floor), P << np.eye(q) * float(program.ratio)]
        if Q is not None:
            constraints.append(cp.norm(Q, "fro") <= float(program.radius))
        objective = cp.Minimize(t)
    else:
        constraints += [_affine(each, variables) << 0 for each in program.pencils]
        constraints.append(P >> np.eye(q) * float(program.floor))
        objective = cp.Minimize(cp.trace(P) + (cp.sum_squares(Q) if Q is not None else 0))
    return cp.Problem(objective, constraints), variables


def solve_dense(program: Program, *, solver: str = "CLARABEL") -> Solution:
    """Solve the block LMI through cvxpy by one of its solvers."""
    problem, variables = build_dense(program)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that an answer is inaccurate stands in the status
        problem.solve(solver=solver)
    return _read_dense(program, problem, variables)


def _read_dense(program: Program, problem: Any, variables: dict[str, Any]) -> Solution:
    """What the solver answered.  Raises what comes of it if that is no point at all."""
    unknowns = program.pencils[0].unknowns
    missing = problem.value is None or any(variables[unknown.name].value is None for unknown in unknowns)
    if missing or not math.isfinite(problem.value):
        return Solution(status=str(problem.status))
    numbers = [float(variables[unknown.name].value[i, j]) for unknown in unknowns for _, i, j in unknown.places()]
    values = assemble(program.pencils[0], numbers)
    return Solution(status=str(problem.status), objective=float(problem.value), values=values)


def _affine(pencil: Pencil, variables: dict[str, Any]) -> Any:
    total = cp.Constant(_as_sparse(pencil.constant))
    for (name, i, j), coefficient in pencil.coefficients.items():
        total = total + variables[name][i, j] * _as_sparse(coefficient)
    return total


def _as_sparse(matrix: Symmetric) -> Any:
    """The nearest floats of an exact symmetric matrix, as a SciPy array.  Raises: OverflowError beyond the floats."""
    rows, columns, values = matrix.triplets()
    return sparse.csr_array((values, (rows, columns)), shape=(matrix.size, matrix.size))
