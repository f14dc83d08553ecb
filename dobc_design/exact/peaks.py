"""Peak gains of a stable linear system: upper bounds of the integral of |C exp(F t) B| over all t >
0, by Arb.

On a step of length h every entry f of C exp(F t) B has |f| <= the chord of |f(t)| and |f(t + h)| +
(h^2/8) sup |f''|: its integral is at most h (|f(t)| + |f(t + h)|)/2 + (h^3/12) sup |f''|, f'' = C
F^2 exp(F s) (exp(F t) B), s <= h. What is left after T = steps h is a part of the whole: exp(F (T +
t)) = exp(F t) exp(F T) with |exp(F T)|_inf = r < 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any, Final

from dobc_design.exact import matrix as exact
from dobc_design.exact.interval import FLINT, _ends
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import to_fmpq

MOST_STEPS: Final = 20_000
MOST_GROWTH: Final = 2000  # of |F| steps h: what rounding errors may grow to, as a power of e

LONGEST: Final = Fraction(1, 2)  # of |F| h: steps are to be short


def row_norm(M: Matrix) -> Fraction:
    """The largest row sum of absolute values, |M|_inf."""
    return max(sum(map(abs, row), Fraction(0)) for row in M)


def peak_gains(
    F: Matrix, C: Matrix, inputs: Sequence[Matrix], *, step: Fraction, steps: int
) -> tuple[Fraction, ...] | None:
    """As ``peak_gains_by_row``, for every block the largest of all rows of C."""
    found = peak_gains_by_row(F, C, inputs, step=step, steps=steps)
    return None if found is None else tuple(map(max, zip(*found, strict=True)))


def peak_gains_by_row(
    F: Matrix, C: Matrix, inputs: Sequence[Matrix], *, step: Fraction, steps: int
) -> tuple[tuple[Fraction, ...], ...] | None:
    """Upper bounds of the integral over t > 0 of the row sums of |C exp(F t) B|: for every row of C
    one for I and then for every B (q, m) of ``inputs``.  ``step`` > 0 (s).  None where no bound is
    shown: F (q, q) is not Hurwitz, or the steps end too early or are too many; a bound proves that
    F is Hurwitz."""
    from flint import arb, arb_mat, ctx

    size = len(F)
    if not 0 < step * row_norm(F) < LONGEST or not 0 < steps <= MOST_STEPS:
        return None
    if row_norm(F) * step * steps > MOST_GROWTH:
        return None
    blocks = [exact.identity(size), *inputs]
    ends = [sum(len(B[0]) for B in blocks[:k]) for k in range(len(blocks) + 1)]

    def sums(rows: Any) -> list[list[Any]]:
        """Sums of absolute values, by row and block."""
        table = [[abs(x) for x in row] for row in rows.tolist()]
        return [[sum(row[a:b], arb(0)) for a, b in pairwise(ends)] for row in table]

    with FLINT, ctx.workprec(192 + 2 * _error_growth(F, step, steps)):
        h, G = arb(to_fmpq(step)), arb_mat([[arb(to_fmpq(x)) for x in row] for row in C])
        phi = arb_mat([[arb(to_fmpq(x * step)) for x in row] for row in F]).exp()
        Z = arb_mat([[arb(to_fmpq(x)) for B in blocks for x in B[i]] for i in range(size)])
        total, mass = [[arb(0)] * len(blocks) for _ in C], [arb(0)] * len(blocks)
        for k in range(steps + 1):
            share = h / 2 if k in (0, steps) else h
            total = [
                [x + share * y for x, y in zip(*rows, strict=True)]
                for rows in zip(total, sums(G * Z), strict=True)
            ]
            norms = [_largest(column) for column in zip(*sums(Z), strict=True)]
            if k < steps:
                mass = [x + y for x, y in zip(mass, norms, strict=True)]
                Z = phi * Z
        bend = h**3 / 12 * arb(to_fmpq(row_norm(F) * step)).exp()
        curved = [
            sum(map(abs, row), Fraction(0)) for row in exact.multiply(C, exact.multiply(F, F))
        ]
        if not norms[0] < 1:
            return None
        found: list[tuple[Fraction, ...]] = []
        for row, most in zip(total, curved, strict=True):
            bounds = [x + bend * arb(to_fmpq(most)) * y for x, y in zip(row, mass, strict=True)]
            whole = bounds[0] / (1 - norms[0])
            found.append(tuple(_ends(x + whole * y)[1] for x, y in zip(bounds, norms, strict=True)))
        return tuple(found)


def _error_growth(F: Matrix, step: Fraction, steps: int) -> int:
    """About how much rounding errors grow, as a power of e: |exp(F h)| <= |I + F h| + (|F| h)^2 for
    |F| h < 1."""
    euler = [[(i == j) + float(x * step) for j, x in enumerate(row)] for i, row in enumerate(F)]
    norm = max(sum(map(abs, row)) for row in euler) + float(row_norm(F) * step) ** 2
    return math.ceil(steps * max(0.0, math.log(norm)))


def _largest(values: Sequence[Any]) -> Any:
    best = values[0]
    for value in values[1:]:
        best = best.max(value)
    return best
