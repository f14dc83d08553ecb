"""lure: V = e'P_e e + sum eps_i'P eps_i decreases where the gains of all arcs are inside their
ranges."""

import ast
import itertools
import re
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

from .claims import Case
from .consensus import schur
from .curves import CELLS, Curve, below, follow, throughout
from .expressions import Coupling, read_coupling, variables
from .intervals import NOTHING, Floats, added, enclosed, halved, times
from .loop import Loop, leader_box
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    both_ways,
    definite,
    diagonal,
    identity,
    is_form,
    largest,
    nonnegative,
    opposite,
    paired,
    plus,
    product,
    transpose,
)
from .reading import (
    MATRIX_BITS,
    Object,
    an_object,
    index,
    integer,
    matrix,
    maybe,
    need,
    rational,
    read,
    short,
    text,
)
from .saturation import to_target
from .separable import starts

ROWS = 100  # of a quadratic certificate at most
Ranges = dict[Coupling, Any]  # the gains [lo, hi] of a coupling, m x m of them


def lure(case: Case, check: Any) -> Any:
    """V decreases, and the level set holds all starts of the domain."""
    claim = read_quadratic(case, check.exact, check.rate)
    if claim.level is None:
        need(check.domain == "global", "it has no level and is not global")
        return claim
    ball = check.domain
    starts(case, ball, "ball")
    # the largest V at a start: both parts at their largest eigenvalue
    most = largest(claim.P_e) * ball.radius**2
    if ball.disturbance:
        most += case.n * ball.disturbance**2 * largest(claim.P)
    need(most <= claim.level, "the ball leaves the level set")
    return claim


# --- what a quadratic certificate claims but for its domain
def gains_shape(m: int) -> Any:
    """The shape of the ranges of a claim."""
    return [{"coupling": integer, "gains": (((rational, rational),) * m,) * m}]


def read_quadratic(case: Case, exact: Any, rate: Fraction | None = None) -> Any:
    """V decreases at the rate where V <= level (null: everywhere)."""
    m = case.m
    size = case.n * m
    # its arcs are between agents, each with an estimation error of its own, or to the target
    need(not case.fixed or to_target(case), "arcs to fixed nodes are not known to it")
    need(size <= ROWS, f"quadratic certificates are decided up to {ROWS} rows")
    shape: Object = {
        "method": text,
        "P_e": partial(read_form, size),
        "level": maybe(rational),
        "radius": maybe(rational),
        "ranges": gains_shape(m),
        "multipliers": an_object,
        "rate": rational,
    }
    if case.q:
        shape["P"] = matrix(case.q, case.q)
    claim = read(exact, shape)
    need(claim.method == "lure", "the method is no longer decided; certify again")
    need(claim.rate >= 0, "the rate is negative")
    allowed = rate is None or 0 < rate <= claim.rate
    need(allowed, "the rate is not between 0 and that of the inequality")
    need((claim.level is None) == (claim.radius is None), "level and radius are not both there")
    if case.q:
        need(is_form(claim.P), "P > 0 is not shown")

    everywhere = claim.radius is None
    reach = None if everywhere else [claim.radius] * m
    ranges = read_ranges(case, claim, dict.fromkeys(case.functions, reach))
    costs = noise(case, claim)
    need(set(claim.multipliers) == set(case.modes), "there are other multipliers")
    for mode in case.modes:
        gains = channels(case, mode, ranges)
        taus = read(claim.multipliers[mode], (rational,) * len(gains))
        # the same P_e in every mode: V decreases however the signal switches
        X = inequality(case, claim, gains, taus, costs)
        need(definite(X, -1), "V is not shown to decrease")
    # where no level bounds e the gains have to hold for all y
    if everywhere:
        need(case.domain == "global", "it has no level, and the couplings are not all linear")
    else:
        positive = claim.level > 0 and claim.radius > 0
        need(positive, "the level or the radius is not positive")
        contained(case, claim.P_e, claim.level, claim.radius)
    return claim


def read_form(size: int, value: Any) -> Matrix:
    """P_e from its entries on and above the diagonal."""
    place = partial(index, size)
    entries = read(value, [(place, place, rational)])
    short((x for _, _, x in entries), MATRIX_BITS)
    upper = all(a <= b and x != 0 for a, b, x in entries)
    need(upper, "P_e does not list its entries that are not 0, a <= b")
    need(len({(a, b) for a, b, _ in entries}) == len(entries), "an entry of P_e stands there twice")
    P_e = identity(size, 0)
    for a, b, x in entries:
        P_e[a][b] = x
        P_e[b][a] = x
    need(definite(P_e), "P_e > 0 is not shown")
    return P_e


def noise(case: Case, claim: Any) -> Matrix:
    """I (x) S: what eps costs."""
    S = schur(case, claim.P, claim.rate) if case.q else identity(case.m, 0)
    return diagonal([case.block(S, i) for i in case.nodes])


def inside(P_e: Matrix, z: Vector, square: Fraction, limit: Fraction) -> bool:
    """square z'P_e^-1 z <= limit^2: |z'e| <= limit where e'P_e e <= square."""
    # the same without an inverse: P_e - (square / limit^2) z z' >= 0
    return nonnegative(plus(P_e, -square / limit**2, product(transpose([z]), [z])))


def contained(loop: Loop, P_e: Matrix, square: Fraction, radius: Fraction | None) -> None:
    """{e'P_e e <= square} lies inside the radius (none: there is no limit)."""
    if radius is None:
        return
    # gains are known within the radius only: no difference that one of them needs may leave it
    for a, b in relied(loop):
        # of the target, the row after the last: nothing
        z = [Fraction((k == b) - (k == a)) for k in range(len(P_e))]
        need(inside(P_e, z, square, radius), "the level set leaves the radius")


def relied(loop: Loop) -> set[tuple[int, int]]:
    """The rows of e_id and e_jd for each difference e_jd - e_id that a coupling depends on, if it
    is not linear."""
    m = loop.m
    found = set()
    for arc in loop.arcs:
        for d in range(m):
            if bends(arc.coupling, d):
                found.add((arc.i * m + d, min(arc.j * m + d, loop.size)))
    if loop.own is not None:
        for d in range(m):
            if bends(loop.own, d):
                found |= {(i * m + d, loop.n * m) for i in loop.nodes}
    return found


def bends(h: Coupling, d: int) -> bool:
    """Whether component d of its argument has to stay within the radius: it occurs in an
    expression whose degree is not at most 1."""
    if h.straight or h.single:
        return not h.straight
    bent = [part.source for part in h.parts if part.degree > 1]
    return any(re.search(rf"y{d + 1}(?![0-9])", each) for each in bent)


# --- gains of the couplings
def read_ranges(loop: Loop, claim: Any, far: dict[Coupling, Any]) -> Ranges:
    """The gains of every coupling that an arc has, shown on |y_c| <= far_c of the coupling."""
    used = {arc.coupling for arc in loop.arcs}
    wanted = [k for k, h in enumerate(loop.functions) if h in used or h is loop.own]
    listed = sorted(each.coupling for each in claim.ranges)
    # each once: a second range of a coupling would replace the first, unseen
    need(listed == wanted, "the ranges are not those of the couplings")
    found = {loop.functions[each.coupling]: each.gains for each in claim.ranges}
    moving = loop.own if loop.leader is not None else None
    for h, gains in found.items():
        need(h is moving or gains_hold(h, gains, far[h]), "the gains are not shown")
    if moving is not None:  # f(s + e) - f(s) for s in the box of the leader
        need(far[moving] is not None, "the slopes of f need a radius")
        around = []
        for side, x in paired(leader_box(loop), far[moving]):
            r = enclosed(x)[1]
            around.append(added(side, (-r, r)))
        rows = list(paired(moving.parts, found[moving]))
        need(slopes_inside(rows, around, CELLS), "the slopes of f are not shown")
    return found


def gains_hold(h: Coupling, gains: Any, far: Vector | None) -> bool:
    """h(y) = G(y) y with G(y) inside the gains, for |y_c| <= far_c."""
    m = len(gains)
    if h.straight:
        return all(holds_slope(h, c, d, gains[c][d]) for c in range(m) for d in range(m))
    # without a bound of y, or with an empty one, nothing is shown on intervals
    if far is None or min(far) <= 0:
        return False
    sides = [enclosed(r)[1] for r in far]
    if h.single:
        beside = [gains[c][d] for c in range(m) for d in range(m) if c != d]
        if not all(lo <= 0 <= hi for lo, hi in beside):
            return False
        return all(secants_inside(h, gains[c][c], sides[c]) for c in range(m))
    rest = []
    # a sum of functions of one variable has gains component by component
    for c, expression in enumerate(h.h):
        if not sum_of_curves(expression):
            rest.append((h.parts[c], gains[c]))
            continue
        # the gain in each component by itself: the others are 0 there
        if not all(secants_along(expression, d, gains[c][d], sides[d]) for d in range(m)):
            return False
    return slopes_inside(rest, [(-r, r) for r in sides], CELLS)


def holds_slope(h: Coupling, c: int, d: int, gain: Vector) -> bool:
    """Whether the slope of a linear coupling lies inside a gain."""
    lo, hi = h.slope(c, d)
    return gain[0] <= lo and hi <= gain[1]


def sum_of_curves(source: str) -> bool:
    """True if an expression is, as it is written, a sum of functions of one variable each."""
    left: list[ast.expr] = [ast.parse(source, mode="eval").body]
    while left:
        node = left.pop()
        if variables_of(node) < 2:
            continue
        match node:
            case ast.UnaryOp(operand=operand):
                left.append(operand)
            case ast.BinOp(left=a, op=ast.Add() | ast.Sub(), right=b):
                left += [a, b]
            case ast.BinOp(left=a, op=ast.Mult(), right=b):
                if variables_of(a) and variables_of(b):
                    return False
                left += [a, b]
            case _:
                return False
    return True


def variables_of(node: ast.expr) -> int:
    """How many variables occur."""
    names = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    return sum(re.fullmatch("y[0-9]*", name) is not None for name in names)


def secants_along(source: str, d: int, gain: Vector, r: float) -> bool:
    """The gain of a sum of functions of one variable each, in component d: the others are 0
    there."""

    def alone(variable: re.Match[str]) -> str:
        if int(variable[1] or 1) == d + 1:
            return "y"
        return "0"

    h = read_coupling((re.sub(r"\by([0-9]*)\b", alone, source),), 1)
    if h.straight:
        return holds_slope(h, 0, 0, gain)
    return secants_inside(h, gain, r)


def secants_inside(h: Coupling, gain: Vector, r: float) -> bool:
    """lo y <= h(y) <= hi y for 0 < y <= r, and the other way round for -r <= y < 0."""
    lo, hi = gain
    for mirrored in (False, True):
        curve = Curve(h, mirrored)
        # h(y) - hi y <= 0 on the right, h(y) - lo y <= 0 on the left
        if not under_line(curve, 1.0, enclosed(-hi), r):
            return False
        if not under_line(curve, -1.0, enclosed(lo), r):
            return False
    return True


def under_line(curve: Curve, side: float, slope: Floats, r: float) -> bool:
    """h(s side) + slope s <= 0 for 0 < s <= r."""

    def settled(a: float, b: float) -> bool:
        bound = follow(curve, (side, side), a, b)

        def at(s: float) -> float:
            value = bound.at(s)
            return added((value, value), times((s, s), slope))[1]

        return below(a, b, at, added(bound.slope, slope))

    return throughout(r, settled)


def slopes_inside(rows: list[Any], box: list[Floats], halvings: int) -> bool:
    """All slopes of expressions lie inside their gains on the box, or on both halves of it."""
    jets = variables(box)
    flat = (NOTHING,) * len(box)
    slopes = [(part.at(*jets)[1] or flat, gains) for part, gains in rows]
    if all(held(found, gains) for found, gains in slopes):
        return True
    if not halvings:
        return False
    return all(slopes_inside(rows, half, halvings - 1) for half in halved(box))


def held(slopes: Any, gains: Any) -> bool:
    """Whether each slope of an expression lies inside its gain."""
    pairs = paired(slopes, gains)
    return all(low <= Fraction(x) and Fraction(y) <= high for (x, y), (low, high) in pairs)


# --- the inequality
class Channel(NamedTuple):
    """A gain between g0 - D and g0 + D from e_other - e_own to row b."""

    b: int
    own: int
    other: int
    g0: Fraction
    D: Fraction


def channel(rows: tuple[int, int, int], lo: Fraction, hi: Fraction) -> Channel:
    """A gain between lo and hi."""
    return Channel(*rows, (lo + hi) / 2, (hi - lo) / 2)


def channels(loop: Loop, mode: str, ranges: Ranges) -> list[Channel]:
    """Those of the arcs of a mode, in the order arcs, c, d, then those of what nodes do beside
    A."""
    m = loop.m
    places = list(itertools.product(range(m), range(m)))
    found = []
    for arc in loop.modes[mode]:
        for c, d in places:
            lo, hi = (arc.w * x for x in ranges[arc.coupling][c][d])
            if not (lo or hi):
                continue
            # it may be away: 0 is one of its gains
            if arc.loose:
                lo = min(lo, ZERO)
                hi = max(hi, ZERO)
            # nodes whose error is 0 are the target, the row after the last
            rows = (arc.i * m + c, arc.i * m + d, min(arc.j * m + d, loop.size))
            found.append(channel(rows, lo, hi))
    if loop.own is None:
        return found
    for i in loop.nodes:
        for c, d in places:
            lo, hi = (x - loop.drift[c][d] for x in ranges[loop.own][c][d])
            # a gain of e_i itself: the difference to the target, the row after the last
            if lo or hi:
                found.append(channel((i * m + c, loop.size, i * m + d), lo, hi))
    return found


def inequality(loop: Loop, claim: Any, gains: list[Channel], taus: Vector, costs: Matrix) -> Matrix:
    """The matrix that has to be negative definite in a mode."""
    P_e = claim.P_e
    size = len(P_e)
    # A0, I (x) S + sum b b'/(2 tau), and sum 2 tau D^2 z z' with the row and column of the target
    A = [[*row, ZERO] for row in opposite(diagonal([*map(loop.gain, loop.nodes)]))]
    M = [list(row) for row in costs]
    extra = identity(size + 1, 0)
    for (b, own, other, g0, D), tau in paired(gains, taus):
        A[b][other] += g0
        A[b][own] -= g0
        need(tau > 0 if D else tau == 0, "a multiplier is not positive")
        if not D:
            continue
        # 2 p q <= p^2 / (2 tau) + 2 tau q^2 for every p and q
        M[b][b] += 1 / (2 * tau)
        square = 2 * tau * D**2
        extra[own][own] += square
        extra[other][other] += square
        extra[own][other] -= square
        extra[other][own] -= square
    half = plus(product(P_e, [row[:size] for row in A]), claim.rate, P_e)
    quadratic = plus(product(product(P_e, M), P_e), 1, [row[:size] for row in extra[:size]])
    return plus(both_ways(half), 1, quadratic)
