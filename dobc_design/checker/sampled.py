"""From sample to sample: exp(A T) and its mean, enclosed, and Jury's table for what they give.

A processor computes everything from samples and holds it over T; in discrete time agents move from
tick to tick, and T is 1.
"""

import math
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

from .intervals import PRECISION, Exact, shortened
from .matrices import (
    ONE,
    ZERO,
    Matrix,
    characteristic,
    identity,
    nonnegative,
    norm,
    paired,
    plus,
    product,
    transpose,
)
from .reading import need, still

BITS = 256
LARGEST = BITS + 128  # bits of an exponential


class Ball(NamedTuple):
    """A matrix in units of 2^-BITS, and a bound of what its rows may miss, in all."""

    entries: list[list[int]]
    missed: int

    @property
    def middle(self) -> Matrix:
        """The matrix."""
        return [[Fraction(x, 2**BITS) for x in row] for row in self.entries]

    def part(self, k: int) -> "Ball":
        """One k-th; rounding each entry misses less than one unit."""
        rows = [[x // k for x in row] for row in self.entries]
        return Ball(rows, self.missed // k + 1 + len(rows))


def multiplied(X: Ball, Y: Ball) -> Ball:
    """The product; rounding each entry misses less than one unit."""
    still()
    columns = list(zip(*Y.entries, strict=True))
    entries = []
    for row in X.entries:
        entries.append([sum(map(mul, row, column)) >> BITS for column in columns])
    passed = norm(X.entries) * Y.missed + norm(Y.entries) * X.missed + X.missed * Y.missed
    return Ball(entries, (passed >> BITS) + 1 + len(entries))


def summed(X: Ball, Y: Ball) -> Ball:
    """The sum."""
    rows = [[a + b for a, b in paired(*both)] for both in paired(X.entries, Y.entries)]
    return Ball(rows, X.missed + Y.missed)


def exponential(X: Matrix) -> Ball:
    """exp(X)."""
    return with_mean(X)[0]


def with_mean(X: Matrix) -> tuple[Ball, Ball]:
    """exp(X), and the mean of exp(X r) over 0 <= r <= 1: their series at X / 2^k with rows of at
    most 1/4, whose rests are below one unit, doubled k times."""
    size = len(X)
    largest = norm(X)
    halvings = 0
    while largest > Fraction(2**halvings, 4):
        halvings += 1
    # rounded down: every row misses less than one unit for each entry
    small = Ball([[int(x * 2**BITS // 2**halvings) for x in row] for row in X], size)
    unit = Ball([[(a == b) << BITS for b in range(size)] for a in range(size)], 0)
    term = unit
    whole = mean = unit._replace(missed=1)
    for k in range(1, BITS // 4):
        term = multiplied(term, small).part(k)
        whole = summed(whole, term)
        mean = summed(mean, term.part(k + 1))
    for _ in range(halvings):
        # the second half of the interval is the first one, exp(X / 2) later
        mean = multiplied(summed(unit, whole), mean).part(2)
        whole = multiplied(whole, whole)
        need(norm(whole.entries) >> LARGEST == 0, "exp(A T) is too large to be followed here")
    return whole, mean


class Ticks(NamedTuple):
    """eps+ = F eps, of which C eps reaches the states, on average; the rows of F may miss ``off``
    in all, those of C ``around``."""

    F: Matrix
    C: Matrix
    off: Fraction
    around: Fraction


def ticks(system: Any, timing: Any) -> Ticks:
    """What becomes of the observers of a system between two samples."""
    A, C, W = system.A, system.C, system.W
    need(W is not None, "there is no observer gain")
    if timing.steps:
        return Ticks(plus(A, -1, product(W, C)), C, ZERO, ZERO)
    T = timing.period
    whole, mean = with_mean([[x * T for x in row] for row in A])
    seen = product(C, mean.middle)
    F = plus(whole.middle, -T, product(W, seen))
    unit = Fraction(1, 2**BITS)
    around = norm(C) * mean.missed * unit
    return Ticks(F, seen, whole.missed * unit + T * norm(W) * around, around)


def shrinks(P: Matrix, found: Ticks, part: Fraction) -> bool:
    """Whether sqrt(eps'P eps) becomes at most that part of itself: part^2 P - F'P F >= 0."""
    moved = product(P, found.F)
    size = len(P)
    # in the norm |X| <= size (largest row of X)
    off = size * found.off
    room = off * size * (2 * norm(moved) + off * norm(P))
    left = plus(plus(identity(size, 0), part**2, P), -1, product(transpose(found.F), moved))
    return nonnegative(plus(left, -room, identity(size)))


def decays(system: Any, timing: Any, growth: Fraction = ONE) -> bool | None:
    """Whether all eigenvalues of F are smaller than 1/growth in size; None where it is not seen."""
    found = ticks(system, timing)
    return inside(spread_out([[x * growth for x in row] for row in found.F], found.off * growth))


def spread_out(F: Matrix, off: Fraction) -> list[Exact]:
    """Coefficients of det(s I - X), highest power first, for every X whose rows differ by ``off``
    at most from those of F.

    They are sums of minors, and a determinant of k rows changes by at most (r + off)^k - r^k, r the
    size of the rows: it is linear in every one of them.
    """
    r = norm(F)
    found = []
    for k, c in enumerate(characteristic(F)):
        room = math.comb(len(F), k) * ((r + off) ** k - r**k)
        found.append((c - room, c + room))
    return found


def inside(p: list[Exact]) -> bool | None:
    """Whether all roots have a size below 1, by Jury's table; None where that depends on what is
    not known of p. Single numbers stay exact."""
    while len(p) > 1:
        (lo, hi), last = p[0], p[-1]
        if lo <= 0:  # it is not known well enough
            return None
        # the product of all roots
        far = [x / y for x in last for y in (lo, hi)]
        if min(far) >= 1 or max(far) <= -1:
            return False
        if not -1 < min(far) <= max(far) < 1:
            return None
        turned = p[:0:-1]
        p = [less(a, (min(far), max(far)), b) for a, b in paired(p[:-1], turned)]
    return True


def less(a: Exact, k: Exact, b: Exact) -> Exact:
    """a - k b."""
    still()
    parts = [x * y for x in k for y in b]
    lo, hi = a[0] - max(parts), a[1] - min(parts)
    if lo == hi:
        return lo, hi
    return shortened(lo, math.floor, PRECISION), shortened(hi, math.ceil, PRECISION)
