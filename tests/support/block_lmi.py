"""The block LMI of the paper solved through cvxpy, the oracle of the reduced form; and its program
for a margin."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np

from dobc_design.solvers import conic
from dobc_design.solvers.program import Program, Solution, as_sparse, assemble


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin(Program):
    """Minimise t subject to F(P, Q) <= t I, I <= P <= ratio I, |Q| <= radius, the normalisation of
    theory, section 2: t < 0 proposes a pair; t >= 0 says nothing."""

    ratio: Fraction = Fraction(100)
    radius: Fraction = Fraction(100)


def solve_dense(program: Program, *, solver: str = "CLARABEL") -> Solution:
    """The answer of one of cvxpy's solvers; without values where it finds no point."""
    problem, variables = conic.build_dense(program)
    if isinstance(program, Margin):
        problem = _margin(program, variables)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that an answer is inaccurate stands in the status
        problem.solve(solver=solver)
    unknowns = program.pencils[0].unknowns
    if any(variables[unknown.name].value is None for unknown in unknowns):
        return Solution(status=str(problem.status))
    numbers = [
        float(variables[unknown.name].value[i, j])
        for unknown in unknowns
        for _, i, j in unknown.places()
    ]
    values = assemble(program.pencils[0], numbers)
    return Solution(status=str(problem.status), objective=float(problem.value), values=values)


def _margin(program: Margin, variables: dict[str, Any]) -> Any:
    P, Q, t, constraints = variables["P"], variables.get("Q"), cp.Variable(), []
    for pencil in program.pencils:
        total = cp.Constant(as_sparse(pencil.constant))
        for (name, i, j), coefficient in pencil.coefficients.items():
            total = total + variables[name][i, j] * as_sparse(coefficient)
        constraints.append(total << t * np.eye(pencil.size))
    one = np.eye(P.shape[0])
    constraints += [P >> one * float(1 + program.floor), P << one * float(program.ratio)]
    if Q is not None:
        constraints.append(cp.norm(Q, "fro") <= float(program.radius))
    return cp.Problem(cp.Minimize(t), constraints)
