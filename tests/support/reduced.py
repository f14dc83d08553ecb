"""Theorems 1 and 2 in their reduced form: one eigenvalue per mode and one small SDP (theory,
Reduction).

``certify`` proposes from the same two pieces, with W put in (``pair``).  The block LMI of ``dense``
has the same optimum when m = 1 or Lambda = Lambda_n (x) I_m, and takes up to a thousand times as
long; otherwise this one is the stricter.
"""

import math
from fractions import Fraction

from dobc_design.conditions.consensus.claim import reduced
from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import Program, Solution


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
