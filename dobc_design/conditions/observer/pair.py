"""Pairs (P, Q) for a given gain W: proposals in order of how well they read, ending with one that must work.

The Decision theorem (theory, section 2) says when a pair exists.  Its proof is the last rung of the
ladder: an exact Lyapunov equation, scaled up until the border term is small enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction

from dobc_design.conditions.consensus.claim import reduced, with_gain
from dobc_design.conditions.observer.scaling import decimal_exponent
from dobc_design.exact.matrix import Matrix, Vector, inverse, multiply, scale, subtract
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.conic import TIME_LIMIT, climb
from dobc_design.solvers.program import Program
from dobc_design.solvers.rounding import round_matrix

DIGITS = (3, 4, 6, 9, 14)
SLACK = (0.9, 0.5, 0.1)
MOST_WORK = 300_000
LADDER = (0, 2, 6, 15, 40, 400)  # powers of ten, the last ones for a bound that is not known


def propose_pairs(
    exosystem: Exosystem, W: Matrix, *, bound: float, decay: float, time_limit: float = TIME_LIMIT
) -> Iterator[tuple[Matrix, Matrix, str]]:
    """Rational (P, P W) to be tried in turn, each with a sentence on how it came about ("" for the usual way).

    ``bound`` is about max lambda_max(Lambda) < 0, ``decay`` about the decay rate of A - WC > 0 (1/s).
    ``time_limit`` in s, for one call of a solver; the last pairs need no solver.
    """
    why = "there was no estimate to start a solver from"
    if bound < 0 < decay and math.isfinite(bound) and math.isfinite(decay):
        for answer, _, how in climb(_programs(exosystem, W, bound=bound, decay=decay), time_limit=time_limit):
            why = f"no proposal of a solver could be proved (the last said: {answer.status})"
            if answer.found:
                for digits in DIGITS:
                    P = round_matrix(answer.values["P"], digits)
                    yield P, multiply(P, W), f"P was found {how}." if how else ""
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    exact = lyapunov(error) if _is_solvable(error) else None
    if exact is not None:
        for P, Q in _scaled_until_small(exact, W, exosystem, bound=bound):
            yield P, Q, f"P solves a Lyapunov equation exactly, because {why}."


def _programs(exosystem: Exosystem, W: Matrix, *, bound: float, decay: float) -> Iterator[tuple[Program, None]]:
    floor = _floor(exosystem, bound, decay)
    for part in SLACK:
        rate = Fraction(part * min(-bound / 2, decay)).limit_denominator(10**6)
        pencil = with_gain(reduced(_tightened(bound, rate), exosystem, rate=rate), W)
        yield Program(pencils=(pencil,), floor=floor), None


def lyapunov(error: Matrix) -> Matrix | None:
    """The exact P with error' P + P error = -I, or None if there is no unique one.  Shape (q, q)."""
    q = len(error)
    places = [(i, j) for i in range(q) for j in range(i, q)]
    index = {place: k for k, place in enumerate(places)}
    rows: list[Vector] = []
    for i, j in places:
        row = [Fraction(0)] * len(places)
        for r in range(q):  # (E'P + PE)_ij = sum_r E_ri P_rj + P_ir E_rj
            row[index[min(r, j), max(r, j)]] += error[r][i]
            row[index[min(i, r), max(i, r)]] += error[r][j]
        rows.append(tuple(row))
    try:
        solution = multiply(inverse(tuple(rows)), tuple((Fraction(-1 if i == j else 0),) for i, j in places))
    except (ArithmeticError, ValueError):
        return None
    return tuple(tuple(solution[index[min(i, j), max(i, j)]][0] for j in range(q)) for i in range(q))


def _is_solvable(error: Matrix) -> bool:
    """Whether the exact equation takes seconds, not hours: unknowns times bits of the common denominator.

    Beyond that the solution has more digits than a certificate can hold in any case.
    """
    common = math.lcm(*(x.denominator for row in error for x in row))
    return len(error) * (len(error) + 1) // 2 * common.bit_length() <= MOST_WORK


def _scaled_until_small(P: Matrix, W: Matrix, exosystem: Exosystem, *, bound: float) -> Iterator[tuple[Matrix, Matrix]]:
    """a (P, P W) with S = C C' / a well below |bound|: Omega0 = -a I, so every a large enough will do."""
    size = sum((x * x for row in exosystem.C for x in row), Fraction(0))  # at least lambda_max(C C')
    wanted = 2 * size / Fraction(-bound) if bound < 0 and math.isfinite(bound) else size
    start = max(0, decimal_exponent(wanted) + 2) if wanted else 0
    for step in LADDER:
        larger = scale(Fraction(10) ** (start + step), P)
        yield larger, multiply(larger, W)


def _floor(exosystem: Exosystem, bound: float, decay: float) -> Fraction:
    """A lower bound for P that keeps it away from singular where C sees nothing."""
    size = sum((x * x for row in exosystem.C for x in row), Fraction(0))
    natural = size / (Fraction(-bound) * Fraction(max(decay, -bound))) / 1000
    return natural.limit_denominator(10**12) or Fraction(1, 10**12)


def _tightened(bound: float, rate: Fraction) -> Fraction:
    """The bound with a little slack, so that rounding P cannot cross it."""
    total = bound + 2 * float(rate)
    return Fraction(bound - 0.05 * total) if total < 0 else Fraction(bound)
