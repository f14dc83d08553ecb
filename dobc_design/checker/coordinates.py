"""max-separable in coordinates z_i = T e_i: N = max |z_ic| / v_ic decreases while N <= rho, where
gains are bounded.

By the mean value theorem h_ij = J (e_j - e_i) with J in the gains of the arc, and what f adds to A
is F e_i. The worst corner of J and F counts in every row, and the worst signs of the agent's other
components.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cache, cached_property, partial
from operator import mul
from typing import Any, NamedTuple

from .claims import Case, need_rate
from .expressions import Coupling
from .loop import Loop
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    combined,
    echelon,
    identity,
    integers,
    paired,
    product,
)
from .quadratic import Ranges, gains_shape, read_ranges
from .reading import matrix, maybe, need, rational, read, short_matrix, weights
from .separable import contains, max_separable, observed, pace

MOST = 6  # components of an agent; gains of a coupling that vary


def boxes(case: Case, check: Any) -> Any:
    """V decreases in the region, at the rate of the check, in coordinates or without."""
    if "T" not in (check.exact or {}):
        need(case.single, "a coupling is a list, or nodes are curved")
        return max_separable(case, check)
    shape = {
        "T": matrix(case.m, case.m),
        "v": partial(weights, case.size),
        "alpha": rational,
        "rho": maybe(rational),
        "ranges": gains_shape(case.m),
    }
    need(not case.gap, "coordinates are those of an error from one target")
    claim = read(check.exact, shape | observed(case))
    S = inverse(claim.T)
    need(case.q == 0 or claim.kappa > 0, "kappa is not positive")
    need_rate(check, pace(case, claim), "the rate does not follow")
    contains(case, claim, check.domain)
    shown(case, claim, S)
    return claim


def sizes(S: Matrix, v: Sequence[Fraction]) -> Iterator[Vector]:
    """The largest |e_ic| of every agent where N <= 1."""
    for k in range(0, len(v), len(S)):
        own = v[k : k + len(S)]
        yield [sum((abs(s) * x for s, x in paired(row, own)), ZERO) for row in S]


def far(loop: Loop, S: Matrix, claim: Any) -> dict[Coupling, Any]:
    """How far the arguments of every coupling go where N <= rho, by component."""
    if claim.rho is None:
        return dict.fromkeys(loop.functions)
    reach = loop.with_fixed(list(sizes(S, claim.v)), [ZERO] * loop.m)
    found = {h: [ZERO] * loop.m for h in loop.functions}
    # |e_j - e_i| is at most the sum of both
    for arc in loop.arcs:
        both = combined(reach[arc.i], 1, reach[arc.j])
        found[arc.coupling] = list(map(max, found[arc.coupling], both))
    if loop.own is not None:
        found[loop.own] = [max(column) for column in zip(*reach, strict=True)]
    return {h: [claim.rho * x for x in each] for h, each in found.items()}


def inverse(T: Matrix) -> Matrix:
    """T^-1, of few bits and not too large."""
    m = len(T)
    need(m <= MOST, f"there are more than {MOST} components")
    short_matrix(T)
    rows, pivots = echelon([[*own, *unit] for own, unit in paired(T, identity(m))])
    # else N does not bound e
    need(pivots == [*range(m)], "T is singular")
    return [row[m:] for row in rows]


def shown(case: Case, claim: Any, S: Matrix, load: Vector | None = None) -> None:
    """The gains are those of the couplings, and the rows hold at the rate alpha with ``load`` (n
    m,) added."""
    # a box that shrinks at the rate alpha: its faces move inwards by alpha v
    outward = [claim.alpha * x for x in claim.v]
    if load:
        outward = combined(outward, 1, load)
    rows = RowsOfCoordinates(case, claim.T, S, read_ranges(case, claim, far(case, S, claim)))
    rows.hold(claim.v, outward, case.modes)


class Corners(NamedTuple):
    """A row of G = T J S for every corner J of the gains, in units of 1 / ``unit``."""

    rows: list[list[int]]
    unit: int


class RowsOfCoordinates:
    """What shows rows in coordinates, for gains that hold."""

    def __init__(self, loop: Loop, T: Matrix, S: Matrix, ranges: Ranges) -> None:
        self.loop = loop
        self.T = T
        self.S = S
        self.ranges = ranges
        self.corners = cache(self.find_corners)
        #: T (pin less A) S of every node.
        self.hold_z = [product(product(T, loop.gain(i)), S) for i in loop.nodes]

    @cached_property
    def beside(self) -> list[list[Any]]:
        """F: the gains of f less A, which pins less A hold; none where f is linear."""
        loop = self.loop
        if loop.own is None:
            return []
        found = []
        for gains, drift in paired(self.ranges[loop.own], loop.drift):
            found.append([(lo - a, hi - a) for (lo, hi), a in paired(gains, drift)])
        return found

    def find_corners(self, h: Coupling) -> list[Corners]:
        """For every row c of G = T J S those of all corners J of the gains."""
        m = self.loop.m
        ends = [sorted(set(pair)) for row in self.ranges[h] for pair in row]
        vary = sum(len(each) > 1 for each in ends)
        need(vary <= MOST, "too many gains of a coupling vary")
        every = []
        for entries in itertools.product(*ends):
            J = [list(entries[k : k + m]) for k in range(0, m * m, m)]
            every.append(product(product(self.T, J), self.S))
        found = []
        for c in range(m):
            flat, unit = integers([x for G in every for x in G[c]])
            found.append(Corners([flat[k : k + m] for k in range(0, len(flat), m)], unit))
        return found

    def hold(self, weights: Any, load: Sequence[Fraction], modes: Iterable[str]) -> None:
        """For weights v, a load (n m,) and every one of the modes: for every row c of G = T J S,
        all x with x_c = v_ic and |x_d| = v_id: sum of w (|G| v_j - G x) + T (F - B K) S x + load_ic
        <= 0."""
        loop = self.loop
        m = loop.m
        v, bottom = integers(weights)
        own = loop.with_fixed([v[k : k + m] for k in range(0, len(v), m)], [0] * m)

        @cache
        def pull(h: Coupling, c: int, j: int) -> list[int]:
            """|G| v_j at every corner."""
            return [sum(map(mul, map(abs, G), own[j])) for G in self.corners(h)[c].rows]

        def heard(arc: Any, c: int, x: list[int]) -> Fraction:
            """The worst of |G| v_j - G x; an arc that may be away adds 0 at least."""
            rows, unit = self.corners(arc.coupling)[c]
            pairs = paired(pull(arc.coupling, c, arc.j), rows)
            worst = max(y - sum(map(mul, G, x)) for y, G in pairs)
            if arc.loose:
                worst = max(0, worst)
            return Fraction(worst, unit)

        for i in loop.nodes:
            for c, x in faces(own[i]):
                alone = load[i * m + c] * bottom + self.by_itself(i, c, x)
                for mode in modes:
                    left = alone
                    # every arc at its own worst corner: they vary independently
                    for arc in loop.heard[mode][i]:
                        left += arc.w * heard(arc, c, x)
                    need(left <= 0, f"the row of agent {loop.labels[i]} is not shown")

    def by_itself(self, i: int, c: int, x: list[int]) -> Fraction:
        """The largest (T (F - hold) S x)_c."""
        found = -sum(map(mul, self.hold_z[i][c], x), ZERO)
        if not self.beside:
            return found
        e = [sum(map(mul, row, x)) for row in self.S]
        for t, row in paired(self.T[c], self.beside):
            for y, (lo, hi) in paired(e, row):
                # F is somewhere between its ends: the worse one counts, entry by entry
                found += max(t * y * lo, t * y * hi)
        return found


def faces(v: list[int]) -> Iterator[tuple[int, list[int]]]:
    """The corners of the box |x| <= v on its faces x_c = v_c, with c."""
    for c in range(len(v)):
        for signs in itertools.product((1, -1), repeat=len(v)):
            # the face x_c = -v_c is the mirror image: rows are linear in x, and gains the same
            if signs[c] > 0:
                yield c, [sign * x for sign, x in paired(signs, v)]
