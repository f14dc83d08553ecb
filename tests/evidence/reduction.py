"""Theorem 1 and 2 as the paper writes them, against their reduced form: the same verdicts, the same optima.

The verdicts are both exact, by different matrices: LDL' of the whole Psi, n (m + q) rows per mode, and of
Lambda + I (x) S.  Pairs (P, Q) lie on both sides of the boundary, some within a thousandth of it.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from evidence.networks import network_problem
from evidence.row import Row
from reduced import solve_reduced

from dobc_design.conditions.consensus.claim import Pair, Statements, state_theorems
from dobc_design.conditions.consensus.decide import psi_is_negative
from dobc_design.conditions.observer.propose import design_gain, lyapunov
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import multiply, scale, subtract, to_float
from dobc_design.solvers.conic import solve_dense
from dobc_design.solvers.program import Program
from dobc_design.verdict import Verdict

RELATIVE = 1e-5
# The optimum t of "margin" may be anything near 0, and solvers are exact to 1e-8 or so of the matrices, which
# have entries near 1: so t is compared relative to at least a tenth.
LEAST = {"size": 0.0, "margin": 0.1}
SIDES = (Fraction(1, 2), Fraction(999, 1000), Fraction(1001, 1000), Fraction(3))


def verdicts(count: int, seed: int) -> Row:
    """LDL' of Psi and the Reduction on ``count`` random problems, four pairs each."""
    failures, proved, refuted, problems, k = [], 0, 0, 0, 0
    while problems < count:
        problem = network_problem(seed + k, separable=False)
        k += 1
        pairs = _pairs(state := state_theorems(problem))
        if not pairs:  # undetectable
            continue
        problems += 1
        for pair in pairs:
            whole = all(
                decide_positive_definite(pencil.at({"P": pair.P, "Q": pair.Q}).negated()).verdict is Verdict.PROVED
                for pencil in state.psi()
            )
            assert problem.exosystem is not None
            if psi_is_negative(state, problem.exosystem, pair) is not whole:
                failures.append(f"seed {seed + k - 1}")
            proved, refuted = proved + whole, refuted + (not whole)
    return Row(
        what="Psi < 0: LDL' of the whole pencil = the Reduction, m = 1 and 2, 1 to 4 modes",
        count=problems,
        failures=tuple(failures),
        notes=(f"{proved + refuted} pairs (P, Q): {proved} proved, {refuted} refuted",),
    )


def _pairs(statements: Statements) -> list[Pair]:
    """Pairs a (P0, P0 W) around the a at which Psi turns definite, if it ever does."""
    exosystem = statements.problem.exosystem
    assert exosystem is not None
    W = design_gain(exosystem).W
    P = None if W is None else lyapunov(subtract(exosystem.A, multiply(W, exosystem.C)))
    if W is None or P is None:
        return []
    top = max(float(np.linalg.eigvalsh(to_float(each.constant.to_dense()))[-1]) for each in statements.lambdas.values())
    output = to_float(exosystem.C)
    size = float(np.linalg.eigvalsh(output @ output.T)[-1])
    edge = Fraction(size / -top if top < -1e-9 else 1.0)
    return [Pair(P=scale(a * edge, P), Q=multiply(scale(a * edge, P), W)) for a in SIDES]


def objectives(count: int, seed: int) -> Row:
    """Optimal values of the block LMI and of the small SDP where the theory says that they are equal."""
    failures, agreed, worst, infeasible, unsolved = [], 0, dict.fromkeys(LEAST, 0.0), 0, 0
    for k in range(seed, seed + count):
        problem = network_problem(k, separable=True)
        pencils = state_theorems(problem).psi()
        for objective, least in LEAST.items():
            dense = solve_dense(Program(pencils=pencils, objective=objective))
            small = solve_reduced(problem, objective=objective)
            text = f"seed {k}, {objective}: {dense.status} {dense.objective}, {small.status} {small.objective}"
            if dense.status == "optimal" and small.status == "Solved":
                agreed += 1
                error = abs(dense.objective - small.objective) / max(abs(dense.objective), least)
                worst[objective] = max(worst[objective], error)
                if not error <= RELATIVE:
                    failures.append(text)
            elif "infeasible" in dense.status and "Infeasible" in small.status:
                infeasible += 1
            else:
                unsolved += 1
                if {dense.status, small.status} & {"optimal", "Solved"} and "feasible" in (dense.status + small.status):
                    failures.append(text)
    sizes = ", ".join(f"{error:.1e} ({name})" for name, error in worst.items())
    return Row(
        what="optimal values: block LMI in cvxpy = small SDP, to 1e-5 relative (t: of at least 0.1)",
        count=agreed,
        failures=tuple(failures),
        least=count,
        notes=(
            f"{count} problems, 2 objectives: both solved {agreed}, worst {sizes}; both infeasible {infeasible};"
            f" a solver gave up {unsolved}",
        ),
    )
