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
from typing import TYPE_CHECKING, Any, Final

from dobc_design.exact import matrix as exact

from .interval import FLINT, _ends
from .matrix import Matrix, row_norm
from .number import to_fmpq

if TYPE_CHECKING:
    from flint import arb_mat

MOST_STEPS: Final = 20_000
SWEEPS: Final = 30  # over the coordinates, to balance them
MOST_GROWTH: Final = 2000  # of |F| steps h: what rounding errors may grow to, as a power of e

LONGEST: Final = Fraction(1, 2)  # of |F| h: steps are to be short


def peak_gains(
    F: Matrix, C: Matrix, inputs: Sequence[Matrix], *, step: Fraction, steps: int
) -> tuple[tuple[Fraction, ...], ...] | None:
    """Upper bounds of the integral over t > 0 of the row sums of |C exp(F t) B|: for every row of C
    one for every B (q, m) of ``inputs``.  ``step`` > 0 (s).  None where no bound is shown: F (q, q)
    is not Hurwitz, or the steps end too early or are too many; a bound proves that F is Hurwitz.
    What is followed is D^-1 F D, which is better balanced."""
    F, scales = balanced(F)
    C = tuple(tuple(x * d for x, d in zip(row, scales, strict=True)) for row in C)
    inputs = [tuple(_times(1 / d, row) for d, row in zip(scales, B, strict=True)) for B in inputs]
    from flint import arb, ctx

    growth = row_norm(F) * step
    # Long steps, or many, give balls that say nothing.
    if not 0 < growth < LONGEST or not 0 < steps <= MOST_STEPS or growth * steps > MOST_GROWTH:
        return None
    blocks = [exact.identity(len(F)), *inputs]
    widths = [len(B[0]) for B in blocks]
    cuts = [sum(widths[:k]) for k in range(len(blocks) + 1)]

    def sums(rows: Any) -> list[list[Any]]:
        """Sums of absolute values, by row and block."""
        found: list[list[Any]] = []
        for row in rows.tolist():
            sizes = [abs(x) for x in row]
            found.append([sum(sizes[a:b], arb(0)) for a, b in pairwise(cuts)])
        return found

    with FLINT, ctx.workprec(192 + 2 * _error_growth(F, step, steps)):
        h = arb(to_fmpq(step))
        G = balls(C)
        phi = balls(exact.scale(step, F)).exp()
        side_by_side = tuple(sum(rows, ()) for rows in zip(*blocks, strict=True))
        Z = balls(side_by_side)
        chords = [[arb(0)] * len(blocks) for _ in C]  # of every row of C and block
        mass = [arb(0)] * len(blocks)  # sum of |exp(F t) B|_inf at the beginnings of all steps
        for k in range(steps + 1):
            # The trapezoidal rule takes half of both ends.
            share = h / 2 if k in (0, steps) else h
            for row, sizes in zip(chords, sums(G * Z), strict=True):
                for block, size in enumerate(sizes):
                    row[block] = row[block] + share * size
            norms = [_largest(column) for column in zip(*sums(Z), strict=True)]
            if k < steps:
                mass = [x + y for x, y in zip(mass, norms, strict=True)]
                Z = phi * Z
        if not norms[0] < 1:  # |exp(F T)|_inf
            return None
        bend = h**3 / 12 * arb(to_fmpq(growth)).exp()
        second = exact.multiply(C, exact.multiply(F, F))  # C F^2, of f''
        found: list[tuple[Fraction, ...]] = []
        for row, derivative in zip(chords, second, strict=True):
            most = sum(map(abs, derivative), Fraction(0))
            bounds = [x + bend * arb(to_fmpq(most)) * y for x, y in zip(row, mass, strict=True)]
            whole = bounds[0] / (1 - norms[0])  # of I: what is left after T is a part of it
            ends = [_ends(x + whole * y)[1] for x, y in zip(bounds, norms, strict=True)]
            found.append(tuple(ends[1:]))
        return tuple(found)


def balanced(F: Matrix) -> tuple[Matrix, exact.Vector]:
    """D^-1 F D with a diagonal D of powers of two, with which every row is at most four times as
    large as its column and the other way round, but for their diagonal; and the entries of D.  The
    second program does the same steps: another D gives other bounds."""
    rows = [list(row) for row in F]
    d = [Fraction(1)] * len(F)
    for _ in range(SWEEPS):
        before = list(d)
        for i, row in enumerate(rows):
            own = abs(row[i])
            left = sum(map(abs, row), -own)
            heard = sum((abs(each[i]) for each in rows), -own)
            factor = Fraction(1)
            while left and heard and left > 4 * heard * factor**2:
                factor *= 2
            while left and heard and heard * factor**2 > 4 * left:
                factor /= 2
            d[i] *= factor
            for each in rows:
                each[i] *= factor
            rows[i] = [x / factor for x in row]
        if d == before:
            break
    return tuple(map(tuple, rows)), tuple(d)


def _times(factor: Fraction, row: Sequence[Fraction]) -> exact.Vector:
    return tuple(factor * x for x in row)


def balls(M: Matrix) -> arb_mat:
    """The same matrix for Arb, at the precision of the moment."""
    from flint import arb, arb_mat

    return arb_mat([[arb(to_fmpq(x)) for x in row] for row in M])


def _error_growth(F: Matrix, step: Fraction, steps: int) -> int:
    """About how much rounding errors grow, as a power of e: |exp(F h)| <= |I + F h| + (|F| h)^2 for
    |F| h < 1."""
    euler = 0.0  # |I + F h|, in the norm of the largest row sum
    for i, row in enumerate(F):
        entries = [(i == j) + float(x * step) for j, x in enumerate(row)]
        euler = max(euler, sum(map(abs, entries)))
    norm = euler + float(row_norm(F) * step) ** 2
    return math.ceil(steps * max(0.0, math.log(norm)))


def _largest(values: Sequence[Any]) -> Any:
    best = values[0]
    for value in values[1:]:
        best = best.max(value)
    return best
