"""The rows of the max-separable certificate in coordinates z_i = T e_i common to all agents
(theory, section 13).

N(e) = max_{i,c} |(T e_i)_c| / v_ic.  By the mean value theorem h_ij(y) = J y with J between the
claimed gains, and what an agent does by itself is F e_i likewise.  With S = T^-1, G = T J S and
z_ic = s v_ic the row of (i, c) asks, in every mode,

    sum_j w (sum_c' |G_cc'| v_jc' - sum_c' G_cc' x_c') + sum_c' (T (F - B K_i) S)_cc' x_c' <= -alpha
    v_ic

for all x with x_c = v_ic and |x_c'| = v_ic', and all J and F: it is convex in these, so corners
decide.  All exact. The gains hold for |e_j - e_i| as far as N <= rho reaches.  No monotonicity is
assumed.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from operator import mul, sub
from typing import Any, NamedTuple

from dobc_design._checks import noun
from dobc_design.conditions.numbers import VECTOR_BITS, rounded_up
from dobc_design.conditions.quadratic.sectors import (
    GainRange,
    left_open,
    used_couplings,
    widened_gains,
)
from dobc_design.conditions.reason import gap_obstacle
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval, IntervalMatrix
from dobc_design.exact.matrix import Matrix, Vector, identity, inverse, kronecker, multiply, zeros
from dobc_design.exact.number import ONE, ZERO, common_denominator
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.exosystems import Exosystem

from .claim import Separable, error_sizes

MOST_FREE = 6  # gains of one coupling that are no single numbers: 2^6 corners
Numbers = list[list[Any]]  # of integers, or of rationals where they are too long
_DIGITS = 6  # of the differences up to which gains are enclosed
_A_STEP = 50  # corners of arcs that are looked at in one step of work


class Slowest(NamedTuple):
    """The row that allows the least rate (1/s, negative where it fails)."""

    rate: Fraction
    agent: int
    component: int
    mode: str


def seen_through(
    loop: Loop, T: Matrix | None, W: Matrix | None
) -> tuple[Exosystem | None, Matrix | None]:
    """The joint exosystem with the output T C of every group, and the gain W S, so that A - W C is
    the same; both as they are without T."""
    exosystem = loop.joint_exosystem
    if exosystem is None or W is None or T is None:
        return exosystem, W
    groups = identity(max(1, len(loop.groups)))
    turned = Exosystem(A=exosystem.A, C=multiply(kronecker(groups, T), exosystem.C))
    return turned, multiply(W, kronecker(groups, inverse(T)))


def reaches(loop: Loop, T: Matrix, v: Sequence[Fraction], rho: Fraction) -> dict[int, Vector]:
    """For every coupling (its place) the largest |e_jc - e_ic| over its arcs where N <= rho, and
    |e_ic| for that of the nodes, rounded up."""
    sizes = [*error_sizes(T, v), *fixed_sizes(loop)]
    found = {place: [ZERO] * loop.m for place in used_couplings(loop)}
    for arcs in loop.modes.values():
        listeners = arcs.listeners.tolist()
        speakers = arcs.speakers.tolist()
        places = coupling_places(loop, arcs).tolist()
        # A difference is at most as large as both of its errors together.
        for i, j, place in zip(listeners, speakers, places, strict=True):
            known = found[place]
            own = sizes[i]
            other = sizes[j]
            for c in range(loop.m):
                known[c] = max(known[c], own[c] + other[c])
    if loop.drift_place is not None:
        found[loop.drift_place] = [max(column) for column in zip(*sizes, strict=True)]
    rounded = {}
    for place, each in found.items():
        rounded[place] = tuple(rounded_up(rho * x, digits=_DIGITS) for x in each)
    return rounded


def enclosed_ranges(
    loop: Loop, T: Matrix, v: Sequence[Fraction], rho: Fraction | None
) -> tuple[GainRange, ...]:
    """The gains that a claim with these numbers may state.  Raises: UndefinedError; SpecError
    without rho for couplings that are not linear."""
    if rho is None and not loop.is_linear:
        raise SpecError("rho must be a number, because a coupling is not linear.", key="rho")
    far = reaches(loop, T, v, rho or ONE)
    found = []
    for place, each in far.items():
        gains = widened_gains(loop, place, each)
        found.append(GainRange(coupling=place, radius=rho, entries=gains))
    return tuple(found)


def rows_obstacle(loop: Loop, claim: Separable, *, load: Vector = ()) -> str | None:
    """Why the rows of a claim with T, ``load`` (n m,) added, do not hold; None if they are proved.
    Raises: ShapeError unless v and T fit."""
    if claim.T is None or len(claim.T) != loop.m or len(claim.v) != loop.n * loop.m:
        raise ShapeError(f"v must have {loop.n * loop.m} entries, T {loop.m} rows.", key="v")
    if (reason := gap_obstacle(loop)) is not None:
        return reason
    if claim.rho is None and not loop.is_linear:
        return "without rho every coupling has to be linear."
    if (reason := gains_obstacle(loop, claim.T, claim.v, claim.rho, claim.ranges)) is not None:
        return reason
    slowest = slowest_row(loop, claim.T, claim.v, claim.ranges, load=load)
    if slowest.rate >= claim.alpha:
        return None
    agent = loop.labels[slowest.agent]
    component = slowest.component + 1
    return (
        f"the row of agent {agent}, component {component}, in mode {slowest.mode} allows only "
        f"{float(slowest.rate):.4g} 1/s."
    )


def gains_obstacle(
    loop: Loop,
    T: Matrix,
    v: Sequence[Fraction],
    rho: Fraction | None,
    ranges: Sequence[GainRange],
) -> str | None:
    """Why couplings and nodes are not shown to keep to ``ranges`` where N <= rho; None if they
    are."""
    far = reaches(loop, T, v, rho or ONE)
    if far.keys() - {each.coupling for each in ranges}:
        return "the gains of a coupling are missing."
    for each in ranges:
        place = each.coupling
        entries = each.entries
        # those of the nodes are no corners: each of their entries is taken at its worse end
        if place != loop.drift_place and varying(entries) > MOST_FREE:
            return f"more than {MOST_FREE} gains of a coupling vary."
        if (reason := left_open(loop, place, entries, far[place])) is not None:
            return reason
    return None


def varying(entries: IntervalMatrix) -> int:
    """How many gains are no single numbers."""
    return sum(not x.is_point for row in entries for x in row)


def slowest_row(
    loop: Loop,
    T: Matrix,
    v: Sequence[Fraction],
    ranges: Sequence[GainRange],
    *,
    load: Vector = (),
    modes: Sequence[str] | None = None,
) -> Slowest:
    """The least rate that a row of these modes (default: all) allows, ``load`` (n m,) added,
    exactly, in integers where denominators are short."""
    m = loop.m
    table = {each.coupling: each.entries for each in ranges}
    weights, bottom = _integers(v)
    own = [weights[first : first + m] for first in range(0, len(weights), m)]
    every = [*own, *fixed_sizes(loop)]
    added = [x * bottom for x in load] or [ZERO] * len(weights)
    signs = faces(m)
    corners = _corners(loop, T, table)
    sums = _ArcSums(corners, every, signs)
    alone = _rows_alone(loop, T, own, signs, table)
    slowest: list[Slowest] = []
    for mode in loop.modes if modes is None else modes:
        spend(len(loop.modes[mode]) * m * 2 ** (m - 1) * corners.most // _A_STEP)
        # A row is convex in x, and what arcs add to it in their gains: corners decide.
        totals, unit = sums.of_mode(loop, mode)
        for i, (of_own, of_arcs) in enumerate(zip(alone, totals, strict=True)):
            for c in range(m):
                pairs = zip(of_own[c], of_arcs[c], strict=True)
                worst = max(x + Fraction(y) / unit for x, y in pairs)
                rate = -(worst + added[i * m + c]) / own[i][c]
                slowest.append(Slowest(rate, i, c, mode))
        slowest = [min(slowest)]
    return slowest[0]


def fixed_sizes(loop: Loop) -> list[list[Fraction]]:
    """How far fixed nodes are from their places, in every component: not at all."""
    return [[ZERO] * loop.m for _ in loop.fixed]


def faces(m: int) -> list[list[tuple[int, ...]]]:
    """For every component c the signs of the corners of |x_c'| <= 1 on the face x_c = 1."""
    corners = list(product((1, -1), repeat=m))
    return [[corner for corner in corners if corner[c] > 0] for c in range(m)]


@noun(eq=False)
class _Corners:
    """The rows of G = T J S times ``unit`` at all corners J of the gains: by the place of the
    coupling, by component, by corner; rows that are always 0 are left out.  ``most``: corners of
    one coupling."""

    rows: dict[int, dict[int, Numbers]]
    unit: int
    most: int


def _corners(loop: Loop, T: Matrix, table: dict[int, IntervalMatrix]) -> _Corners:
    """Bring the gains of arcs into coordinates, as integers where denominators are short."""
    exact = {}
    for place, entries in table.items():
        if place != loop.drift_place:
            exact[place] = _turned_corners(T, entries)
    numbers = (x for rows in exact.values() for row in rows for corner in row for x in corner)
    # Where a common denominator is long, fractions are no slower than integers.
    unit = common_denominator(numbers, bits=VECTOR_BITS) or 1
    scaled: dict[int, dict[int, Numbers]] = {}
    for place, rows in exact.items():
        scaled[place] = {}
        for c, row in enumerate(rows):
            if any(map(any, row)):
                scaled[place][c] = [[_times(x, unit) for x in corner] for corner in row]
    most = max((len(rows[0]) for rows in exact.values()), default=1)
    return _Corners(rows=scaled, unit=unit, most=most)


def _turned_corners(T: Matrix, entries: IntervalMatrix) -> list[list[Vector]]:
    """The rows of G = T J S for every corner J of the gains: by row, then by corner."""
    m = len(T)
    S = inverse(T)
    ends = [[x.lo] if x.is_point else [x.lo, x.hi] for row in entries for x in row]
    found = []
    for corner in product(*ends):
        J = tuple(corner[c * m : c * m + m] for c in range(m))
        found.append(multiply(multiply(T, J), S))
    return [[G[c] for G in found] for c in range(m)]


class _ArcSums:
    """What arcs add to the rows of those who listen.  Agents hear many others by few functions, so
    each pair of a function and an agent is worked out once."""

    def __init__(
        self, corners: _Corners, own: Sequence[Any], signs: Sequence[Sequence[tuple[int, ...]]]
    ) -> None:
        self.corners = corners
        self.own = own
        self.signs = signs
        self.heard = cache(self._heard)
        self.felt = cache(self._felt)

    def of_mode(self, loop: Loop, mode: str) -> tuple[list[Numbers], int]:
        """The sums by agent, component and signs, and what they are multiplied by."""
        arcs = loop.modes[mode]
        factors, bottom = _integers(arcs.weights)
        totals: list[Numbers] = [[[0] * len(each) for each in self.signs] for _ in loop.labels]
        listeners = arcs.listeners.tolist()
        speakers = arcs.speakers.tolist()
        places = coupling_places(loop, arcs).tolist()
        sure = len(arcs) - arcs.optional
        ends = zip(listeners, speakers, places, factors, strict=True)
        for number, (i, j, place, w) in enumerate(ends):
            total = totals[i]
            for theirs, (c, mine) in zip(self.heard(place, j), self.felt(place, i), strict=True):
                sums = total[c]
                for s, each in enumerate(mine):
                    most = max(map(sub, theirs, each))
                    # an optional arc may be absent
                    if number < sure or most > 0:
                        sums[s] += w * most
        return totals, self.corners.unit * bottom

    def _heard(self, place: int, j: int) -> Numbers:
        """sum_c' |G_cc'| v_jc', by component and corner."""
        own = self.own[j]
        found = []
        for row in self.corners.rows[place].values():
            sizes = [list(map(abs, g)) for g in row]
            found.append([sum(map(mul, g, own)) for g in sizes])
        return found

    def _felt(self, place: int, i: int) -> list[tuple[int, Numbers]]:
        """sum_c' G_cc' x_c', by component, by the signs of x, by corner."""
        found = []
        for c, row in self.corners.rows[place].items():
            by_signs = []
            for sign in self.signs[c]:
                x = list(map(mul, sign, self.own[i]))
                by_signs.append([sum(map(mul, g, x)) for g in row])
            found.append((c, by_signs))
        return found


def _rows_alone(
    loop: Loop,
    T: Matrix,
    own: Sequence[Any],
    signs: Sequence[Any],
    table: dict[int, IntervalMatrix],
) -> list[list[list[Fraction]]]:
    """For every agent what gains and nodes add to its rows, by component and signs."""
    S = inverse(T)
    none = zeros(loop.m, loop.m)
    pulls = loop.pulls.each(lambda k: multiply(multiply(T, k), S))
    F: list[list[Interval]] = []
    if loop.drift_place is not None:
        # the slopes A are in the pulls already
        for slopes, known in zip(table[loop.drift_place], loop.slopes, strict=True):
            F.append([x - a for x, a in zip(slopes, known, strict=True)])

    def row(i: int, c: int, sign: Sequence[int]) -> Fraction:
        x = list(map(mul, sign, own[i]))
        pull = pulls.get(i, none)[c]
        found = -sum(map(mul, pull, x), ZERO)
        if F:
            e = [sum(map(mul, each, x)) for each in S]
            for t, slopes in zip(T[c], F, strict=True):
                for slope, y in zip(slopes, e, strict=True):
                    found += max(t * y * slope.lo, t * y * slope.hi)
        return found

    return [[[row(i, c, sign) for sign in signs[c]] for c in range(loop.m)] for i in range(loop.n)]


def _integers(values: Sequence[Fraction]) -> tuple[list[Any], int]:
    """Numbers times a common denominator, as integers; as they are, where that is long."""
    bottom = common_denominator(values, bits=VECTOR_BITS)
    if bottom is None:
        return list(values), 1
    return [_times(x, bottom) for x in values], bottom


def _times(x: Fraction, bottom: int) -> Any:
    """x bottom; an integer where it is one."""
    top, left = divmod(x.numerator * bottom, x.denominator)
    return x * bottom if left else top
