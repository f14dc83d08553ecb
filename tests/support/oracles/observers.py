"""The conditions of an observer decided by others: the block LMI of the paper through cvxpy, the
reduced form of Theorems 1 and 2, norms by python-control and SciPy."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.consensus.claim import reduced
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.exact.pencil import Pencil
from dobc_design.exact.symmetric import Symmetric
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import Program, Solution, assemble
from dobc_design.synthesis.observer.decide import StateSpace


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin(Program):
    """Minimise t subject to F(P, Q) <= t I, I <= P <= ratio I, |Q| <= radius, the normalisation of
    theory, section 2: t < 0 proposes a pair; t >= 0 says nothing."""

    ratio: Fraction = Fraction(100)
    radius: Fraction = Fraction(100)


def solve_dense(program: Program, *, solver: str = "CLARABEL") -> Solution:
    """The answer of one of cvxpy's solvers; without values where it finds no point."""
    problem, variables = dense_problem(program)
    if isinstance(program, Margin):
        problem = _margin(program, variables)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that an answer is inaccurate stands in the status
        problem.solve(solver=solver)
    unknowns = program.pencils[0].unknowns
    if any(variables[unknown.name].value is None for unknown in unknowns):
        return Solution(status=str(problem.status))
    numbers = []
    for unknown in unknowns:
        for _, i, j in unknown.places():
            numbers.append(float(variables[unknown.name].value[i, j]))
    values = assemble(program.pencils[0], numbers)
    return Solution(status=str(problem.status), objective=float(problem.value), values=values)


def dense_problem(program: Program) -> tuple[Any, dict[str, Any]]:
    """The cvxpy problem of a Program, with all its rows, and its variables."""
    first = program.pencils[0]
    variables: dict[str, Any] = {}
    for unknown in first.unknowns:
        shape = (unknown.rows, unknown.columns)
        name = unknown.name
        variables[name] = cp.Variable(shape, symmetric=unknown.symmetric, name=name)
    constraints = [affine(each, variables) << 0 for each in program.pencils]
    smallest = np.eye(first.unknowns[0].rows) * float(program.floor)
    constraints.append(variables["P"] >> smallest)
    cost = cp.trace(variables["P"])
    if "Q" in variables:
        cost = cost + cp.sum_squares(variables["Q"])
    return cp.Problem(cp.Minimize(cost), constraints), variables


def affine(pencil: Pencil, variables: dict[str, Any]) -> Any:
    """F(P, Q) of a pencil as an expression of cvxpy."""
    total = cp.Constant(_as_sparse(pencil.constant))
    for (name, i, j), coefficient in pencil.coefficients.items():
        total = total + variables[name][i, j] * _as_sparse(coefficient)
    return total


def _as_sparse(matrix: Symmetric) -> Any:
    """The nearest floats of an exact matrix."""
    return sparse.csr_array(to_float(matrix.to_dense()))


def _margin(program: Margin, variables: dict[str, Any]) -> Any:
    P = variables["P"]
    Q = variables.get("Q")
    t = cp.Variable()
    constraints = []
    for pencil in program.pencils:
        constraints.append(affine(pencil, variables) << t * np.eye(pencil.size))
    one = np.eye(P.shape[0])
    lower = P >> one * float(1 + program.floor)
    upper = P << one * float(program.ratio)
    constraints += [lower, upper]
    if Q is not None:
        constraints.append(cp.norm(Q, "fro") <= float(program.radius))
    return cp.Problem(cp.Minimize(t), constraints)


def reduced_program(problem: Problem) -> Program | None:
    """The small program of a problem: one agent with Lambda = max lambda_max I.  None without an
    estimate of it.

    Raises: SpecError without an exosystem; UndefinedError if a coupling has no derivative at 0.
    """
    if problem.exosystem is None:
        raise SpecError(
            "Psi of (18) needs an [exosystem].", key="exosystem", cure="Without one, use Lemma 1."
        )
    bound = max(
        largest_eigenvalue(float_lambda(loop_of(problem), mode)).value
        for mode in problem.network.modes
    )
    if not math.isfinite(bound):
        return None
    return Program(pencils=(reduced(Fraction(bound), problem.exosystem),))


def solve_reduced(problem: Problem) -> Solution:
    """Solve Theorem 1 (one mode) or 2 (several) at the consensus for P and Q.  Raises: as
    ``reduced_program``."""
    program = reduced_program(problem)
    if program is None:
        return Solution(status="failed: no estimate of lambda_max")
    return solve_directly(program)


def sampled_in_floats(exosystem, gain, period):
    A = to_float(exosystem.A)
    C = to_float(exosystem.C)
    q = len(A)
    upper_row = [A, np.eye(q)]
    lower_row = [np.zeros((q, 2 * q))]
    rows = [upper_row, lower_row]
    block = linalg.expm(np.block(rows) * period)
    seen = C @ block[:q, q:] / period
    injected = to_float(gain) @ seen
    return block[:q, :q] - injected


def control_norm(system: StateSpace, kind) -> float:
    """python-control's norm; it wants as many inputs as outputs, so zeros are added, which change
    no norm."""
    import control

    parts = (system.F, system.B, system.C, system.D)
    F, B, C, D = (to_float(x) for x in parts)
    size = max(B.shape[1], C.shape[0])
    wide = np.zeros((len(F), size))
    tall = np.zeros((size, len(F)))
    both = np.zeros((size, size))
    wide[:, : B.shape[1]], tall[: C.shape[0]], both[: D.shape[0], : D.shape[1]] = B, C, D
    return float(
        control.norm(control.ss(F, wide, tall, both, remove_useless_states=False), kind, tol=1e-10)
    )
