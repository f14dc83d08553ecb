"""Drake's sums of squares: up to which |e| V = e'e decreases.  Called by ``peers.py``; needs drake.

-V' - margin e'e - sigma (R^2 - e'e) and sigma shall be sums of squares; R by bisection.  The
solver's answer is taken at its word: this is what the tool gives, no proof.
"""

import json
import sys
from typing import Any

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.symbolic import Polynomial, Variables

MARGIN = 1e-6
STEPS = 8


def decreases(n: int, pinned: int, gain: float, radius: float) -> bool:
    program = MathematicalProgram()
    e = program.NewIndeterminates(n, "e")
    names = Variables(e)
    y = [e[(i + 1) % n] - e[i] for i in range(n)]
    slope: Any = sum(
        2 * e[i] * (y[i] + y[i] ** 3 - (gain if i < pinned else 0) * e[i]) for i in range(n)
    )
    V: Any = sum(x * x for x in e)
    sigma, _ = program.NewSosPolynomial(names, 2)
    program.AddSosConstraint(
        Polynomial(-slope - MARGIN * V, names) - sigma * Polynomial(radius**2 - V, names)
    )
    return bool(ClarabelSolver().Solve(program).is_success())


def largest(n: int, pinned: int, gain: float, limit: float) -> float:
    if decreases(n, pinned, gain, limit):
        return limit
    low, high = 0.0, limit
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if decreases(n, pinned, gain, middle) else (low, middle)
    return low


def pendulums(n: int) -> float:
    """The ball in {e'Pe <= level} for x'' = -x + x^3/6 - x'/2 + ... on the directed n-cycle of
    ``peers.pendulums``, P from the linearisation's Lyapunov equation, the largest level by
    bisection."""
    M = np.eye(n) - np.roll(np.eye(n), 1, axis=1)
    one = np.eye(n)
    M[0, 0] += 2
    A = np.block([[0 * one, one], [-one - M / 4, -one / 2 - M / 2]])
    unit = np.eye(2 * n)
    P = np.linalg.solve(np.kron(unit, A.T) + np.kron(A.T, unit), -unit.ravel()).reshape(A.shape)
    low = 0.0
    high = 40.0
    top = float(np.linalg.eigvalsh(P)[-1])
    for _ in range(STEPS + 1):
        middle = (low + high) / 2
        program = MathematicalProgram()
        e = program.NewIndeterminates(2 * n, "e")
        names = Variables(e)
        flow = A @ e
        flow[n:] += e[:n] ** 3 / 6
        sigma, _ = program.NewSosPolynomial(names, 2)
        falls = Polynomial(-2 * (e @ P) @ flow - MARGIN * (e @ e), names)
        program.AddSosConstraint(falls - sigma * Polynomial(middle * top - e @ P @ e, names))
        low, high = (
            (middle, high) if ClarabelSolver().Solve(program).is_success() else (low, middle)
        )
    return float(np.sqrt(low))


if __name__ == "__main__":
    n, coupling, pinned, gain, limit = sys.argv[1:]
    if coupling == "pendulums":
        print(json.dumps([pendulums(int(n))]))
        sys.exit()
    if coupling != "y + y**3":
        raise SystemExit("only y + y**3 is a polynomial here")
    print(json.dumps([largest(int(n), int(pinned), float(gain), float(limit))]))
