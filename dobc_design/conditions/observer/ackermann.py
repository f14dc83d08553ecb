"""A gain W by exact pole placement: what remains when floating point finds none.

On the observable part of (A, C) all poles of A - WC are put to one place by Ackermann's formula over the
rationals.  For several outputs a small feedback and a mix of the outputs make one output enough.
The numbers are seldom short; they exist whenever (A, C) is detectable.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import comb
from random import Random

from dobc_design.exact.matrix import (
    Matrix,
    add,
    identity,
    inverse,
    multiply,
    scale,
    subtract,
    to_float,
    transpose,
    zeros,
)
from dobc_design.exact.observability import decide_observable, observability_matrix, observable_reduction
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.rounding import round_matrix
from dobc_design.verdict import Verdict

TRIES = 20  # a random choice fails with probability zero; small integers may need a few


def placed_gains(exosystem: Exosystem, *, rate: Fraction) -> Iterator[Matrix]:
    """W (q, m) with every observable pole of A - WC at -(rate + 1), in roundings and then exactly."""
    A, C, T = observable_reduction(exosystem.A, exosystem.C)
    if not A:
        yield zeros(exosystem.order, exosystem.outputs)
        return
    back = multiply(transpose(T), inverse(multiply(T, transpose(T))))
    random = Random(0)  # the same choice every time
    for attempt in range(TRIES):
        first = _small(random, len(A), len(C), attempt)
        mix = _small(random, 1, len(C), max(1, attempt))
        error, output = subtract(A, multiply(first, C)), multiply(mix, C)
        if decide_observable(error, output).verdict is Verdict.PROVED:
            gain = multiply(back, add(first, multiply(_ackermann(error, output, pole=rate + 1), mix)))
            for digits in (6, 12):
                try:
                    yield round_matrix(to_float(gain), digits)
                except OverflowError:  # beyond the floats; the exact one is still there
                    break
            yield gain
            return


def _ackermann(A: Matrix, c: Matrix, *, pole: Fraction) -> Matrix:
    """L (r, 1) with det(sI - A + L c) = (s + pole)^r, for an observable pair of one output."""
    r = len(A)
    polynomial, power = zeros(r, r), identity(r)
    for k in range(r + 1):
        polynomial = add(polynomial, scale(comb(r, k) * pole ** (r - k), power))
        power = multiply(power, A)
    last = tuple((Fraction(int(i == r - 1)),) for i in range(r))
    return multiply(polynomial, multiply(inverse(observability_matrix(A, c)), last))


def _small(random: Random, rows: int, columns: int, size: int) -> Matrix:
    """Small random integers; all zero (or one) at the first attempt."""
    return tuple(
        tuple(Fraction(random.randint(-size, size) or int(i == j and rows == 1)) for j in range(columns))
        for i in range(rows)
    )
