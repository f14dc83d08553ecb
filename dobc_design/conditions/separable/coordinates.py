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

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from operator import mul, sub
from typing import Any, Final, NamedTuple

from dobc_design.conditions.numbers import VECTOR_BITS, rounded_up
from dobc_design.conditions.quadratic.sectors import (
    Entries,
    GainRange,
    left_open,
    used_couplings,
    widened_gains,
)
from dobc_design.conditions.reason import pins_obstacle
from dobc_design.conditions.separable.claim import Separable, error_sizes
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix, Vector, identity, inverse, kronecker, multiply, zeros
from dobc_design.exact.number import common_denominator
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.exosystems import Exosystem

MOST_FREE: Final = 6  # gains of one coupling that are no single numbers: 2^6 corners
_DIGITS: Final = 6  # of the differences up to which gains are enclosed
_A_STEP: Final = 50  # corners of arcs that are looked at in one step of work


class Slowest(NamedTuple):
    """The row that allows the least rate (1/s, negative where it fails)."""

    rate: Fraction
    agent: int
    component: int
    mode: str


def seen_through(loop: Loop, T: Matrix, W: Matrix | None) -> tuple[Exosystem | None, Matrix | None]:
    """The joint exosystem with the output T C of every group, and the gain W S, so that A - W C is
    the same."""
    exosystem, every = loop.joint_exosystem, identity(max(1, len(loop.groups)))
    if exosystem is None or W is None:
        return exosystem, W
    turned = Exosystem(A=exosystem.A, C=multiply(kronecker(every, T), exosystem.C))
    return turned, multiply(W, kronecker(every, inverse(T)))


def reaches(loop: Loop, T: Matrix, v: Sequence[Fraction], rho: Fraction) -> dict[int, Vector]:
    """For every coupling (its place) the largest |e_jc - e_ic| over its arcs where N <= rho, and
    |e_ic| for that of the nodes, rounded up."""
    sizes, m = list(error_sizes(T, v)), range(loop.m)
    found: dict[int, list[Fraction]] = {
        place: [Fraction(0)] * loop.m for place in used_couplings(loop)
    }
    for arcs in loop.modes.values():
        ends = (
            arcs.listeners.tolist(),
            arcs.speakers.tolist(),
            coupling_places(loop, arcs).tolist(),
        )
        for i, j, place in zip(*ends, strict=True):
            known, own, other = found[place], sizes[i], sizes[j]
            for c in m:
                known[c] = max(known[c], own[c] + other[c])
    if loop.drift_place is not None:
        found[loop.drift_place] = [max(column) for column in zip(*sizes, strict=True)]
    return {
        k: tuple(rounded_up(rho * x, digits=_DIGITS) for x in each) for k, each in found.items()
    }


def enclosed_ranges(
    loop: Loop, T: Matrix, v: Sequence[Fraction], rho: Fraction | None
) -> tuple[GainRange, ...]:
    """The gains that a claim with these numbers may state.  Raises: UndefinedError; SpecError
    without rho for couplings that are not linear."""
    if rho is None and not loop.is_linear:
        raise SpecError("rho must be a number, because a coupling is not linear.", key="rho")
    far = reaches(loop, T, v, Fraction(1) if rho is None else rho)
    gains = {place: widened_gains(loop, place, each) for place, each in far.items()}
    return tuple(
        GainRange(coupling=place, radius=rho, entries=each) for place, each in gains.items()
    )


def rows_obstacle(loop: Loop, claim: Separable, *, load: Vector = ()) -> str | None:
    """Why the rows of a claim with T, ``load`` (n m,) added, do not hold; None if they are proved.
    Raises: ShapeError unless v and T fit."""
    if claim.T is None or len(claim.T) != loop.m or len(claim.v) != loop.n * loop.m:
        raise ShapeError(f"v must have {loop.n * loop.m} entries, T {loop.m} rows.", key="v")
    if (reason := pins_obstacle(loop)) is not None:
        return reason
    if claim.rho is None and not loop.is_linear:
        return "without rho every coupling has to be linear."
    if (reason := gains_obstacle(loop, claim.T, claim.v, claim.rho, claim.ranges)) is not None:
        return reason
    slowest = slowest_row(loop, claim.T, claim.v, claim.ranges, load=load)
    where = (
        f"agent {loop.labels[slowest.agent]}, component {slowest.component + 1}, in "
        f"mode {slowest.mode}"
    )
    return (
        None
        if slowest.rate >= claim.alpha
        else f"the row of {where} allows only {float(slowest.rate):.4g} 1/s."
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
    far = reaches(loop, T, v, Fraction(1) if rho is None else rho)
    if far.keys() - {each.coupling for each in ranges}:
        return "the gains of a coupling are missing."
    for place, _, entries in ((each.coupling, each.radius, each.entries) for each in ranges):
        if (
            place != loop.drift_place
            and sum(not x.is_point for row in entries for x in row) > MOST_FREE
        ):
            return f"more than {MOST_FREE} gains of a coupling vary."
        if (reason := left_open(loop, place, entries, far[place])) is not None:
            return reason
    return None


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
    m, table, (weights, bottom) = (
        loop.m,
        {each.coupling: each.entries for each in ranges},
        _integers(v),
    )
    added = [x * bottom for x in load] or [Fraction(0)] * len(weights)
    own = [weights[first : first + m] for first in range(0, len(weights), m)]
    signs = [[sign for sign in product((1, -1), repeat=m) if sign[c] > 0] for c in range(m)]
    corners = {
        place: _corners(T, entries) for place, entries in table.items() if place != loop.drift_place
    }
    every = (x for rows in corners.values() for row in rows for corner in row for x in corner)
    unit = common_denominator(every, bits=VECTOR_BITS) or 1
    scaled = {
        place: {
            c: [[_times(x, unit) for x in g] for g in row]
            for c, row in enumerate(rows)
            if any(map(any, row))
        }
        for place, rows in corners.items()
    }

    @cache
    def heard(place: int, j: int) -> list[list[Any]]:
        return [
            [sum(abs(x) * y for x, y in zip(g, own[j], strict=True)) for g in row]
            for row in scaled[place].values()
        ]

    @cache
    def felt(place: int, i: int) -> list[tuple[int, list[list[Any]]]]:
        x = [
            [[a * y for a, y in zip(sign, own[i], strict=True)] for sign in each] for each in signs
        ]
        return [
            (c, [[sum(map(mul, g, at)) for g in row] for at in x[c]])
            for c, row in scaled[place].items()
        ]

    alone, found = _rows_alone(loop, T, own, signs, table), list[Slowest]()
    for mode in loop.modes if modes is None else modes:
        arcs = loop.modes[mode]
        spend(
            len(arcs)
            * m
            * 2 ** (m - 1)
            * max((len(rows[0]) for rows in corners.values()), default=1)
            // _A_STEP
        )
        factors, over = _integers(arcs.weights)
        totals = [[[0] * len(each) for each in signs] for _ in own]
        places, sure = coupling_places(loop, arcs).tolist(), len(arcs) - arcs.optional
        ends = zip(arcs.listeners.tolist(), arcs.speakers.tolist(), places, factors, strict=True)
        for number, (i, j, place, w) in enumerate(ends):
            total = totals[i]
            for theirs, (c, mine) in zip(heard(place, j), felt(place, i), strict=True):
                for s, each in enumerate(mine):
                    most = max(map(sub, theirs, each))
                    # an optional arc may be absent
                    total[c][s] += w * most if number < sure or most > 0 else 0
        for i, (of_arcs, of_own) in enumerate(zip(totals, alone, strict=True)):
            for c in range(m):
                worst = max(
                    x + Fraction(y) / (unit * over)
                    for x, y in zip(of_own[c], of_arcs[c], strict=True)
                )
                found.append(Slowest(-(worst + added[i * m + c]) / own[i][c], i, c, mode))
        found = [min(found)]
    return found[0]


def _corners(T: Matrix, entries: Entries) -> list[list[Vector]]:
    """The rows of G = T J S for every corner J of the gains: by row, then by corner."""
    m, S, found = len(T), inverse(T), []
    for ends in product(*([x.lo] if x.is_point else [x.lo, x.hi] for row in entries for x in row)):
        J = tuple(ends[c * m : c * m + m] for c in range(m))
        found.append(multiply(multiply(T, J), S))
    return [[G[c] for G in found] for c in range(m)]


def _rows_alone(
    loop: Loop, T: Matrix, own: Sequence[Any], signs: Sequence[Any], table: dict[int, Entries]
) -> list[list[list[Fraction]]]:
    """For every agent what gains and nodes add to its rows, by component and signs."""
    m, S, A, none = loop.m, inverse(T), loop.slopes, zeros(loop.m, loop.m)
    # agents often share one matrix
    different = {id(k): k for k in (none, *loop.pulls.gains.values())}
    known = {key: multiply(multiply(T, k), S) for key, k in different.items()}
    nodes = () if loop.drift_place is None else table[loop.drift_place]
    F = [[x - A[a][b] for b, x in enumerate(row)] for a, row in enumerate(nodes)]

    def rows(i: int, c: int) -> Iterator[Fraction]:
        for sign in signs[c]:
            x = [a * y for a, y in zip(sign, own[i], strict=True)]
            found = -sum(map(mul, known[id(loop.pulls.gains.get(i, none))][c], x), Fraction(0))
            e = [sum(map(mul, row, x)) for row in S] if F else []
            for t, row in zip(T[c] if F else (), F, strict=True):
                found += sum(max(t * y * z.lo, t * y * z.hi) for z, y in zip(row, e, strict=True))
            yield found

    return [[list(rows(i, c)) for c in range(m)] for i in range(loop.n)]


def _integers(values: Sequence[Fraction]) -> tuple[list[Any], int]:
    """Numbers times a common denominator, as integers; as they are, where that is long."""
    bottom = common_denominator(values, bits=VECTOR_BITS)
    return (list(values), 1) if bottom is None else ([_times(x, bottom) for x in values], bottom)


def _times(x: Fraction, bottom: int) -> Any:
    """x bottom; an integer where it is one."""
    top, left = divmod(x.numerator * bottom, x.denominator)
    return x * bottom if left else top
