"""The block LMI of Theorems 1 and 2 as the paper writes it, in cvxpy: all modes, one P and one Q.

Size n (m + q) per mode.  It is here for teaching and as the oracle the reduced form is tested against.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from dobc_design.exact.pencil import Pencil
from dobc_design.solvers.program import (
    FAILED,
    Program,
    Solution,
    as_sparse,
    assemble,
    is_solver_failure,
    without_values,
)

TIME_LIMITS = {"CLARABEL": "time_limit", "SCS": "time_limit_secs"}  # the option by solver, in s


def build_dense(program: Program) -> tuple[Any, dict[str, Any]]:
    """The cvxpy problem of a Program and its variables by name (P, Q and, for "margin", t).

    P is declared symmetric, because X >> 0 looks at the symmetric part of X only.
    """
    import cvxpy as cp

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
        constraints += [_affine(cp, each, variables) << t * np.eye(each.size) for each in program.pencils]
        constraints += [P >> np.eye(q) * float(1 + program.floor), P << np.eye(q) * float(program.ratio)]
        if Q is not None:
            constraints.append(cp.norm(Q, "fro") <= float(program.radius))
        objective = cp.Minimize(t)
    else:
        constraints += [_affine(cp, each, variables) << 0 for each in program.pencils]
        constraints.append(P >> np.eye(q) * float(program.floor))
        objective = cp.Minimize(cp.trace(P) + (cp.sum_squares(Q) if Q is not None else 0))
    return cp.Problem(objective, constraints), variables


def solve_dense(program: Program, *, solver: str = "CLARABEL", time_limit: float = 60.0) -> Solution:
    """Solve the block LMI through cvxpy.  A solver's failure is a Solution without values.

    ``solver`` is one of cvxpy's names, "CLARABEL" or "SCS"; ``time_limit`` in s, for these two.
    """
    try:
        problem, variables = build_dense(program)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that an answer is inaccurate stands in the status
            problem.solve(solver=solver, **{TIME_LIMITS[solver]: time_limit} if solver in TIME_LIMITS else {})
        return _read(program, problem, variables, solver=solver)
    except BaseException as error:  # a panic in Rust is no Exception
        if not is_solver_failure(error):
            raise
        return without_values(f"{FAILED}{type(error).__name__}", solver=solver)


def _read(program: Program, problem: Any, variables: dict[str, Any], *, solver: str) -> Solution:
    """What the solver answered.  Raises what comes of it if that is no point at all."""
    unknowns = program.pencils[0].unknowns
    missing = problem.value is None or any(variables[unknown.name].value is None for unknown in unknowns)
    if missing or not math.isfinite(problem.value):
        return without_values(str(problem.status), solver=solver)
    numbers = [float(variables[unknown.name].value[i, j]) for unknown in unknowns for _, i, j in unknown.places()]
    values = assemble(program.pencils[0], numbers)
    return Solution(status=str(problem.status), solver=solver, objective=float(problem.value), values=values)


def _affine(cp: Any, pencil: Pencil, variables: dict[str, Any]) -> Any:
    total = cp.Constant(as_sparse(pencil.constant))
    for (name, i, j), coefficient in pencil.coefficients.items():
        total = total + variables[name][i, j] * as_sparse(coefficient)
    return total
