"""arc-wise: V = sum d_i e_i'e_i + sum eps_i'P eps_i decreases, since agents pay for what arcs take.

An arc i <- j of weight w takes 2 d_i w x h(y - x) by component, x of e_i and y of e_j. With u = y -
x, x = u X, c = d_i w and the gain g = h(u)/u this is at most a x^2 + b y^2 iff, for every u > 0,

    (a + b) X^2 + 2 (b - c g) X + b >= 0    where d_i X^2 + d_j (X + 1)^2 <= level / u^2

and the same with -h(-u) for h(u). On a piece of u it is a parabola on an interval.
"""

import math
from collections import defaultdict
from fractions import Fraction
from functools import cache, lru_cache, partial
from typing import Any, NamedTuple

from .claims import Case, need_rate
from .consensus import schur
from .curves import Curve, highest, throughout
from .expressions import Coupling
from .intervals import Floats, added, divided, enclosed, negative, times
from .loop import Arc, Loop, leader_box
from .matrices import (
    ZERO,
    Matrix,
    both_ways,
    identity,
    is_form,
    largest,
    norm,
    plus,
    root,
    semidefinite,
    transpose,
)
from .reading import Refused, an_object, matrix, need, rational, read, vector, weights
from .separable import EXACT, Errors, starts

CLOSE = 2.0**-40  # to the largest gain
ANY = (-math.inf, math.inf)


class Arcs(NamedTuple):
    """An arc between nodes, what it may take of both, and their d; ``c``: the ends of d_i w."""

    h: Coupling
    loose: bool
    a: Fraction
    b: Fraction
    c: tuple[Fraction, Fraction]
    own: Fraction
    other: Fraction


def arc_wise(case: Case, check: Any) -> Any:
    """V decreases, and {V <= level} holds all starts."""
    claim = read_claim(case, check.exact)
    need_rate(check, claim.rate, "the rate is not between 0 and that of V")
    around(case, claim, check.domain)
    decreases(case, claim)
    return claim


def decreases(case: Case, claim: Any) -> None:
    """Arcs take no more than they may, and nodes have it."""
    apart = case.differences and case.q
    need(not apart, "differences have two estimation errors each, which are not known to it")
    need(all(h.single for h in case.functions), "components act on each other")
    S = schur(case, claim.P, claim.rate) if case.q else None
    found: dict[Arcs, Arc] = {}  # those that are the same are decided once
    pulls = list(own_pulls(case, claim, S))
    for mode in case.modes:
        taken = shared(case, claim, mode, found)
        for i, left in enumerate(pulls):
            slack = plus(left, -taken[i], identity(case.m))
            need(semidefinite(slack), f"what arcs take of agent {case.labels[i]} is not shown")
    between(case, claim, found)


def stated_errors(loop: Loop) -> Errors:
    """Errors of weights and gains, where only arcs and pins feel them."""
    plant = loop.uncertainty
    if plant is None or loop.B is not None or (loop.q and not plant.known_to_agents):
        return EXACT
    return Errors(weights=plant.weights, gains=plant.gains)


# --- What is claimed
def read_claim(case: Case, exact: Any) -> Any:
    """d, and a and b of every mode."""
    shape = {
        "d": partial(weights, case.n),
        "a": an_object,
        "b": an_object,
        "level": rational,
        "rate": rational,
    }
    if case.q:
        shape["P"] = matrix(case.q, case.q)
    claim = read(exact, shape)
    need(not case.q or is_form(claim.P), "P > 0 is not shown")
    for each in (claim.a, claim.b):
        need(set(each) == set(case.modes), "there are other modes")
    return claim


def around(case: Case, claim: Any, domain: Any) -> None:
    """V <= level at every start of a box or ball."""
    is_box = getattr(domain, "kind", None) == "box"
    starts(case, domain, "box" if is_box else "ball")
    most = domain.radius**2 * (case.m * sum(claim.d) if is_box else max(claim.d))
    if domain.disturbance:
        most += case.n * domain.disturbance**2 * largest(claim.P)
    need(most <= claim.level, "the starts leave the level set")


# --- Nodes
def own_pulls(case: Case, claim: Any, S: Matrix | None) -> Any:
    """Of every node what it has: d (K + K') less the rate, the observer, and what it does beside
    A."""
    error = stated_errors(case).gains
    for i, d in enumerate(claim.d):
        left = plus(both_ways(case.gain(i)), -2 * claim.rate, identity(case.m))
        if error:
            K = case.gain(i)
            left = plus(left, -error * (norm(K) + norm(transpose(K))), identity(case.m))
        if S:
            left = plus(left, -d, case.block(S, i))
        if case.own is not None:
            beside = drift(case, root(claim.level / d)) - case.node.A[0][0]
            left = plus(left, -2 * beside, identity(case.m))
        yield [[d * x for x in row] for row in left]


def shared(case: Case, claim: Any, mode: str, found: dict[Arcs, Arc]) -> list[Fraction]:
    """What the arcs of a mode take of every node; those between nodes are added to ``found``."""
    d = claim.d
    taken = [ZERO] * case.n
    arcs = case.modes[mode]
    free = [arc for arc in arcs if arc.j < case.n]
    a, b = (vector(len(free), each[mode]) for each in (claim.a, claim.b))
    errors = stated_errors(case)
    for arc, x, y in zip(free, a, b, strict=True):
        taken[arc.i] += x
        taken[arc.j] += y
        c = d[arc.i] * arc.w
        ends = c * (1 - errors.weights), c * (1 + errors.weights)
        each = Arcs(arc.coupling, arc.loose, x, y, ends, d[arc.i], d[arc.j])
        found.setdefault(each, arc)
    for arc in arcs:
        if arc.j >= case.n:  # y = 0
            least = -most(arc.coupling, -1, root(claim.level / d[arc.i]))
            if arc.loose:
                least = min(least, ZERO)
            least -= max(errors.weights, errors.gains) * abs(least)  # a pin, perhaps
            taken[arc.i] -= 2 * d[arc.i] * arc.w * least
    return taken


@lru_cache(maxsize=1000)
def most(h: Coupling, sign: int, end: Fraction) -> Fraction:
    """An upper bound of sign h(y)/y for 0 < |y| <= end."""
    if h.straight:
        return max(sign * slope for slope in h.slope(0, 0))
    tops = []
    for mirrored in (False, True):
        gains = Gains(h, mirrored)
        tops.append(highest(partial(gains.top, sign), 0.0, enclosed(end)[1], CLOSE))
    need(max(tops) < math.inf, "a gain is not shown to be bounded")
    return Fraction(max(tops))


@lru_cache(maxsize=1000)
def drift(case: Any, end: Fraction) -> Fraction:
    """An upper bound of the gain of f; of its slopes in the box of a leader."""
    if case.leader is None:
        return most(case.own, 1, end)
    (box,) = leader_box(case)
    r = enclosed(end)[1]
    low, high = added(box, (-r, r))
    return Fraction(highest(Curve(case.own, False).slope, low, high, CLOSE))


# --- Arcs between nodes
def between(case: Case, claim: Any, found: dict[Arcs, Arc]) -> None:
    """None takes more than it may."""
    alike = defaultdict(list)
    for each, arc in found.items():
        ends = f"from {case.labels[arc.j]} to {case.labels[arc.i]}"
        may_be_away = each.a >= 0 <= each.b or not each.loose
        need(may_be_away, f"an arc {ends} that may be away takes less than nothing")
        alike[each.h].append((each, ends))
    for h, arcs in alike.items():
        farthest = max(1 / each.own + 1 / each.other for each, _ in arcs)
        end = enclosed(root(claim.level * farthest))[1]
        faces = [Gains(h, mirrored) for mirrored in (False, True)]
        for each, ends in arcs:
            disc = Disc(each, claim.level)
            shown = all(throughout(end, partial(disc.settled, gains)) for gains in faces)
            need(shown, f"what the arc {ends} takes is not shown")


class Gains:
    """h(u)/u for u > 0."""

    def __init__(self, h: Coupling, mirrored: bool) -> None:
        self.curve = Curve(h, mirrored)
        self.on = cache(self.between)  # asked for every arc

    def between(self, a: float, b: float) -> Floats:
        """Its bounds on [a, b]; of 0 the slopes. Any, where it may not be defined."""
        try:
            value, slope = self.curve.at((a, b))
            if a == 0:
                return slope  # h(u) = h'(z) u
            low, high = gain = divided(value, (a, b))
            if a < b:
                # (h/u)' = (h' - h/u)/u
                turns = divided(added(slope, negative(gain)), (a, b))
                grown = times((0.0, above(b - a)), turns)
                for end, way in ((a, grown), (b, negative(grown))):
                    from_end = added(self.on(end, end), way)
                    low = max(low, from_end[0])
                    high = min(high, from_end[1])
        except Refused:
            return ANY
        return low, high

    def top(self, sign: int, a: float, b: float) -> float:
        """Its upper bound, or that of its opposite."""
        return max(sign * end for end in self.on(a, b))


def below(x: float) -> float:
    """Less than what was rounded to x."""
    return math.nextafter(x, -math.inf)


def above(x: float) -> float:
    """More than what was rounded to x."""
    return math.nextafter(x, math.inf)


class Disc:
    """An arc in floating point: every number on the side that makes it harder."""

    def __init__(self, arc: Arcs, level: Fraction) -> None:
        self.square = enclosed(arc.a + arc.b)[0]
        self.b = enclosed(arc.b)
        self.c = enclosed(arc.c[0])[0], enclosed(arc.c[1])[1]
        self.level = enclosed(level)[1]
        self.own, self.other = (enclosed(d)[0] for d in (arc.own, arc.other))

    def settled(self, gains: Gains, a: float, b: float) -> bool:
        """Whether the parabola is not negative for a <= u <= b: with Z = -X on [near, far], and for
        X on [0, last]."""
        near, far, last = self.reach(a)
        if far < near:
            return True
        low, high = gains.on(a, b)
        least = below(low * self.c[low < 0])
        largest = above(high * self.c[high > 0])
        lowest, highest = self.b
        if not rises(self.square, below(least - highest), lowest, near, far):
            return False
        return last < 0 or rises(self.square, below(lowest - largest), lowest, 0.0, last)

    def reach(self, u: float) -> tuple[float, float, float]:
        """Between which ends -X lies, and the upper end of X."""
        everywhere = (0.0, math.inf, math.inf)
        square = below(u * u)
        both = self.own + self.other
        if min(square, below(both)) <= 0:
            return everywhere
        # (both X + other)^2 <= both level / u^2 - own other
        room = above(above(above(self.level / square) * above(both)) - below(self.own * self.other))
        if room < 0:
            return 0.0, -1.0, -1.0
        if not room < math.inf:
            return everywhere
        side = above(math.sqrt(room))
        near = below(below(self.other - side) / above(both))
        far = above(above(side + self.other) / below(both))
        last = above(above(side - self.other) / below(both))
        return max(0.0, near), far, last


def rises(A: float, B: float, C: float, p: float, q: float) -> bool:
    """A z^2 + 2 B z + C >= 0 for 0 <= p <= z <= q."""
    if A >= 0 and C >= 0 and (B >= 0 or below(A * C) >= above(B * B)):
        return True
    for z in (p, q):
        slope = below(below(A * z) + 2 * B)
        if not below(below(slope * z) + C) >= 0:
            return False
    # an end is the lowest point
    return A <= 0 or below(below(A * p) + B) >= 0 or above(above(A * q) + B) <= 0
