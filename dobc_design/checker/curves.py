"""One scalar coupling on intervals: where it rises and falls, upper bounds of it and of its slopes,
and sums of such bounds on pieces of an interval.

Floating point, rounded outward: every bound holds for the exact function.
"""

import heapq
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple

from .expressions import Coupling
from .intervals import NOTHING, ONE, Floats, absolute, added, divided, hull, negative, times, total
from .reading import still

PIECES = 20_000  # into which one row is cut at most
SHORTEST = 2.0**-200  # part of rho: a row that fails at s = 0 fails on every piece (0, s]
CUTS = 1024  # of the interval on which |h(y)/y| is bounded
# halvings of an interval on which the sign of a slope is sought; 2^(CELLS + 2) pieces of a coupling
CELLS = 12
STEPS = 500  # towards the largest slope


class Cell(NamedTuple):
    """h rises (1) or falls (-1) on [lo, hi], or it is not known (0); there it is at most
    ``top``."""

    lo: float
    hi: float
    way: int
    top: float


class Curve:
    """h for the upper face, -h(-y) for the lower one; the table holds its cells between the two
    ends."""

    def __init__(
        self, coupling: Coupling, mirrored: bool, lo: float = 0.0, hi: float = 0.0
    ) -> None:
        self.formula = coupling.parts[0]
        self.mirrored = mirrored
        self.tops = dict[float, float]()
        self.table: list[Cell] = []
        # couplings like to have their kink at 0
        sides = [(a, b) for a, b in ((lo, 0.0), (0.0, hi)) if a < b]
        for cell in sorted(self.cells(sides, (hi - lo) / 2**40)):
            joined = cell
            if self.table and cell.way != 0 and self.table[-1].way == cell.way:
                first = self.table.pop().lo
                joined = cell._replace(lo=first, top=math.inf)  # asked of cells of way 0 only
            self.table.append(joined)

    def at(self, y: Floats) -> tuple[Floats, Floats]:
        """Values and slopes on y."""
        if self.mirrored:
            y = negative(y)
        value, slopes = self.formula.at((y, (ONE,)))
        if self.mirrored:
            value = negative(value)
        return value, slopes[0] if slopes else NOTHING

    def top(self, y: float) -> float:
        """An upper bound of h at a point."""
        if y == 0:
            return 0.0  # the reader has found that h(0) = 0
        if y not in self.tops:
            # a point has no slopes to ask for, and is asked often
            end = -y if self.mirrored else y
            (lo, hi), _ = self.formula.at(((end, end), ()))
            self.tops[y] = -lo if self.mirrored else hi
        return self.tops[y]

    def slope(self, lo: float, hi: float) -> float:
        """An upper bound of h' on [lo, hi], by one evaluation."""
        return self.at((lo, hi))[1][1]

    def steepest(self, lo: float, hi: float) -> float:
        """An upper bound of h' on [lo, hi]."""
        return highest(self.slope, lo, hi, 1 / 4096)

    def cells(self, pieces: list[Floats], finest: float) -> Iterator[Cell]:
        """Cells of these pieces, halved until the sign of the slope is known; the widest first, if
        that is hopeless."""
        for a, b in pieces:  # the list grows while it is read
            value, slope = self.at((a, b))
            way = 0
            if slope[0] >= 0:
                way = 1
            elif slope[1] <= 0:
                way = -1
            if way or b - a <= finest or len(pieces) > 2 ** (CELLS + 2):
                yield Cell(a, b, way, value[1])
            else:
                middle = (a + b) / 2
                pieces += [(a, middle), (middle, b)]

    def between(self, lo: float, hi: float) -> list[Cell]:
        """The cells of the table between two numbers."""
        first = bisect_right(self.table, lo, key=itemgetter(0)) - 1
        return self.table[max(0, first) : bisect_left(self.table, hi, key=itemgetter(0))]


def highest(bound: Callable[[float, float], float], lo: float, hi: float, close: float) -> float:
    """An upper bound on [lo, hi] from those on pieces: the piece with the largest one is halved
    until a point comes close."""
    pieces = [(-bound(lo, hi), lo, hi)]
    # what is certainly reached: no bound can come below it
    reached = max(bound(lo, lo), bound(hi, hi))
    for _ in range(STEPS):
        top, a, b = pieces[0]
        middle = (a + b) / 2
        if not a < middle < b or -top - reached <= abs(reached) * close:
            break
        heapq.heapreplace(pieces, (-bound(a, middle), a, middle))
        heapq.heappush(pieces, (-bound(middle, b), middle, b))
        reached = max(reached, bound(middle, middle))
    return -pieces[0][0]


Curves = dict[tuple[Coupling, bool], Curve]  # h and -h(-y)


def both_faces(couplings: Any, lo: float, hi: float) -> Curves:
    """Couplings and their mirror images, with tables between two ends."""
    found: Curves = {}
    for h in couplings:
        for mirrored in (False, True):
            found[h, mirrored] = Curve(h, mirrored, lo, hi)
    return found


def secants(h: Coupling, end: float) -> Iterator[Fraction]:
    """Upper bounds of |h(y)/y| on pieces of |y| <= end: |h| over the nearer end, or the steepest
    slope so far."""
    steepest = 0.0
    curves = [Curve(h, mirrored) for mirrored in (False, True)]
    ends = [end * (k / CUTS) for k in range(CUTS)]
    for a, b in pairwise([*ends, end]):
        both = [curve.at((a, b)) for curve in curves]
        steepest = max(steepest, *(absolute(slope)[1] for _, slope in both))
        largest = steepest
        if a:
            # on [a, b] |y| >= a, so that |h|/a is not below |h(y)/y|
            largest = max(divided(absolute(value), (a, a))[1] for value, _ in both)
        yield Fraction(min(steepest, largest))


# --- Bounds on a piece a <= s <= b
class Bound(NamedTuple):
    """An upper bound of a function of s on a piece: not below ``low``, at most ``high``, its values
    and slopes."""

    low: float
    high: float
    at: Callable[[float], float]
    slope: Floats


def follow(curve: Curve, side: Floats, a: float, b: float, rising: bool = False) -> Bound:
    """h(s side) for a <= s <= b."""
    value, slope = curve.at(hull(times((a, a), side), times((b, b), side)))

    def at(s: float) -> float:
        y = times((s, s), side)
        # of a rising one the upper end decides; a point may be remembered
        if rising or y[0] == y[1]:
            return curve.top(y[1])
        return curve.at(y)[0][1]

    return Bound(value[0], value[1], at, times(side, slope))


def supremum(curve: Curve, p: Floats, q: Floats, a: float, b: float) -> Bound:
    """Of sup {h(y): -s p <= y <= s q} for a < s <= b: it is taken at one of the ends, or at a
    summit between them."""
    left = times((b, b), negative(p))[0]
    last = max(times((s, s), q)[1] for s in (a, b))
    cells = curve.between(left, last)
    # it rises all the way: the upper end decides
    if len(cells) == 1 and cells[0].way == 1:
        return follow(curve, q, a, b, rising=True)
    if a == 0:
        # h(y) = g y with a slope g on the piece, at most s max (-g p, g q)
        slope = curve.at((left, max(0.0, last)))[1]
        steepest = max(times(slope, side)[1] for side in (negative(p), q))
        line = (steepest, steepest)
        return Bound(-math.inf, math.inf, lambda s: times((s, s), line)[1], line)

    bounds = [follow(curve, side, a, b) for side in (q, negative(p))]
    # The largest value between two cells, or in one that is not known to rise or fall.
    summits = [cell.top for cell in cells if not cell.way]
    for one, other in pairwise(cells):
        if one.way == 1 and other.way == -1:
            summits.append(curve.top(one.hi))
    if summits:
        top = max(summits)
        bounds.append(Bound(-math.inf, top, lambda _: top, NOTHING))
    # the supremum is the largest of all bounds, at every s
    floor = max(bound.low for bound in bounds)
    bounds = [bound for bound in bounds if bound.high >= floor]  # the others are never the largest
    slopes = hull(*(bound.slope for bound in bounds))
    return Bound(floor, math.inf, lambda s: max(bound.at(s) for bound in bounds), slopes)


def largest(curve: Curve, p: Floats, q: Floats) -> float:
    """An upper bound of h between -p and q."""
    cells = curve.between(-p[1], q[1])
    # where it rises all the way, values at the upper end are enough: slopes take longest
    if len(cells) == 1 and cells[0].way == 1:
        return curve.top(q[1])
    return supremum(curve, p, q, 1.0, 1.0).at(1.0)


def below(a: float, b: float, at: Callable[[float], float], slope: Floats) -> bool:
    """True if F <= 0 on the piece: it lies below F(a) + (s - a) sup F' and below F(b) - (b - s) inf
    F'."""
    low, high = slope
    start = at(a)
    if high <= 0:
        return start <= 0
    end = at(b)
    if low >= 0:
        return end <= 0
    # the two lines meet at (-low F(a) + high F(b) - low high (b - a)) / (high - low)
    falling = (-low, -low)
    rising = (high, high)
    lines = [times(falling, (start, start)), times(rising, (end, end))]
    length = added((b, b), (-a, -a))
    # the upper end of an outward sum: F <= 0 at the crossing is certain
    return total([*lines, times(times(falling, rising), length)])[1] <= 0


def throughout(rho: float, settled: Callable[[float, float], bool], start: float = 0.0) -> bool:
    """Cut (0, rho], or [start, rho], until every piece is settled."""
    left = [(start, rho)]
    done = 0
    while left:
        a, b = left.pop()
        done += 1
        still()
        if settled(a, b):
            continue
        middle = (a + b) / 2
        # not shown; the row may hold with less room than floating point can see
        if done > PIECES or b - a <= rho * SHORTEST or not a < middle < b:
            return False
        left += [(middle, b), (a, middle)]
    return True


# --- Sums of suprema
class Term(NamedTuple):
    """w sup {h(y): -s p <= y <= s q}."""

    curve: Curve
    w: Floats
    p: Floats
    q: Floats


def on_pieces(terms: list[Term], c: Floats, load: Floats, rho: float, start: float = 0.0) -> bool:
    """True if the sum of the terms + load <= s c for all s of (0, rho], or of [start, rho]."""

    def settled(a: float, b: float) -> bool:
        bounds = [(w, supremum(curve, p, q, a, b)) for curve, w, p, q in terms]

        def at(s: float) -> float:
            parts = []
            for w, bound in bounds:
                value = bound.at(s)
                parts.append(times(w, (value, value)))
            return total([*parts, times((-s, -s), c), load])[1]

        slopes = [times(w, bound.slope) for w, bound in bounds]
        return below(a, b, at, total([*slopes, negative(c)]))

    return throughout(rho, settled, start)


def at_once(terms: list[Term], c: Floats) -> bool:
    """True if the sum of the terms <= s c for s = 1."""
    parts = [negative(c)]
    for curve, w, p, q in terms:
        most = largest(curve, p, q)
        parts.append(times(w, (most, most)))
    return total(parts)[1] <= 0
