"""The loop at the target: the slopes of its couplings, and what the linearisation has of them.

J - K is the linearisation and Lambda = J + J' - (K + K') what e'e changes by. A slope that is not
rational is an interval that holds it, and what is said here holds for every value in it.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

from .intervals import Exact, times
from .loop import Loop
from .matrices import ZERO, Matrix, Rows, Vector, identity
from .reading import need

ROOTS_SIZE = 60  # largest matrix whose eigenvalues are counted


class Term(NamedTuple):
    """Row a of J - K has the slope in column b, and less it in column c, the node's own."""

    a: int
    b: int
    c: int
    slope: Exact


def terms(loop: Loop, mode: str) -> Iterator[Term]:
    """Those of arcs and pins in a mode. A pin is an arc from the target, where the error is 0: it
    has the column n m, which is dropped in the end."""
    m = loop.m
    for i, j, w, coupling, loose in loop.modes[mode]:
        factor = (ZERO if loose else w, w)
        for (c, d), slope in coupling.slopes.items():
            yield Term(i * m + c, j * m + d, i * m + d, times(slope, factor))
    for i, k in loop.hold.items():
        for c, row in enumerate(k):
            for d, gain in enumerate(row):
                yield Term(i * m + c, loop.n * m, i * m + d, (gain, gain))


@lru_cache(maxsize=1)  # every check of a mode asks
def upper_bounds(loop: Loop) -> dict[str, Rows]:
    """In every mode a rational U with Lambda <= U for every slope in its enclosure: one that is
    off by r moves v'Lambda v by at most 2 r |v_a| |v_b - v_c| <= r (2 v_a^2 + v_b^2 + v_c^2)."""
    return {mode: upper_bound(loop, mode) for mode in loop.modes}


def upper_bound(loop: Loop, mode: str) -> Rows:
    """U of one mode."""
    size = loop.size
    rows: Rows = [{i: ZERO} for i in range(size + 1)]

    def add(i: int, j: int, x: Fraction) -> None:
        rows[i][j] = rows[i].get(j, ZERO) + x

    for a, b, c, (lo, hi) in terms(loop, mode):
        middle = (lo + hi) / 2
        add(a, b, middle)
        add(b, a, middle)
        add(a, c, -middle)
        add(c, a, -middle)
        r = (hi - lo) / 2
        if r:
            add(a, a, 2 * r)
            add(b, b, r)
            add(c, c, r)
    # the target has no error: its row and column go
    return [{j: x for j, x in row.items() if j < size} for row in rows[:-1]]


def lower_form(found: Iterable[Term], v: Vector) -> Fraction:
    """A lower bound of v'Lambda v, exact where the slopes that take part are; v ends with a 0."""
    low = ZERO
    for a, b, c, (lo, hi) in found:
        weight = 2 * v[a] * (v[b] - v[c])
        # the end that makes the form smaller
        low += weight * (lo if weight > 0 else hi)
    return low


def jacobian(loop: Loop, mode: str) -> Matrix:
    """J - K, if every slope is exact."""
    size = loop.size
    # exact characteristic polynomials take long
    need(size <= ROOTS_SIZE, f"unstable roots are counted up to size {ROOTS_SIZE} only")
    X = identity(size + 1, 0)
    for a, b, c, (lo, hi) in terms(loop, mode):
        need(lo == hi, "unstable roots are counted for exact slopes only")
        X[a][b] += lo
        X[a][c] -= lo
    return [row[:-1] for row in X[:-1]]


def is_symmetric(loop: Loop, mode: str) -> bool:
    """Whether J - K is known exactly, and symmetric."""
    X: dict[tuple[int, int], Fraction] = {}
    for a, b, c, (lo, hi) in terms(loop, mode):
        if lo != hi:
            return False
        X[a, b] = X.get((a, b), ZERO) + lo
        X[a, c] = X.get((a, c), ZERO) - lo
    size = loop.size  # the node that nobody is, which pins name, comes last
    return all(x == X.get((b, a), ZERO) for (a, b), x in X.items() if max(a, b) < size)
