"""The block LMI of the paper solved through cvxpy, the oracle of the reduced form; and programs for a margin."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np

from dobc_design.exact.pencil import Pencil, below, positive
from dobc_design.solvers import conic
from dobc_design.solvers.program import Program, Solution, as_sparse, assemble


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin(Program):
    """Minimise t subject to F(P, Q) <= t I, I <= P <= ratio I, |Q| <= radius, the normalisation of theory, section 2:
    t < 0 proposes a pair; t >= 0 says nothing."""

    ratio: Fraction = Fraction(100)
    radius: Fraction = Fraction(100)


PROGRAMS = {"size": Program, "margin": Margin}


def solve_directly(program: Program, *, time_limit: float = 60.0) -> Solution:
    """By Clarabel, without a modelling layer."""
    if not isinstance(program, Margin):
        return conic.solve_directly(program, time_limit=time_limit)
    first = program.pencils[0]
    places = [place for unknown in first.unknowns for place in unknown.places()]
    gains, P = [k for k, place in enumerate(places) if place[0] == "Q"], first.unknowns[0]

    def cone(pencil: Pencil, t: float) -> conic.Cone:
        columns = [pencil.coefficients.get(place) for place in places]
        none = np.zeros(pencil.size * (pencil.size + 1) // 2)
        rows = [none if each is None else conic.svec_exact(each) for each in columns]
        return conic.Cone(
            "semidefinite",
            np.column_stack([*rows, -t * conic.svec(np.eye(pencil.size))]),
            -conic.svec_exact(pencil.constant),
        )

    bounds = positive(P, floor=program.floor + 1), below(P, ceiling=program.ratio)
    try:
        cones = [*(cone(each, 1.0) for each in program.pencils), *(cone(each, 0.0) for each in bounds)]
    except (ArithmeticError, ValueError) as error:
        return Solution(status=f"failed: {type(error).__name__}")
    if gains:  # [[radius, q'], [q, radius I]] >= 0
        arrow = [np.zeros((len(gains) + 1,) * 2) for _ in range(len(places) + 1)]
        for place, k in enumerate(gains, start=1):
            arrow[k][0, place] = arrow[k][place, 0] = -1.0
        right = conic.svec(float(program.radius) * np.eye(len(gains) + 1))
        cones.append(conic.Cone("semidefinite", np.column_stack([conic.svec(each) for each in arrow]), right))
    answer = conic.solve_cones(np.append(np.zeros(len(places)), 1.0), cones, time_limit=time_limit)
    if not answer.found:
        return Solution(status=answer.status)
    return Solution(status=answer.status, objective=answer.objective, values=assemble(first, answer.x.tolist()))


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
    numbers = [float(variables[unknown.name].value[i, j]) for unknown in unknowns for _, i, j in unknown.places()]
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
