"""lure: V = e'P_e e + sum eps_i'P eps_i decreases where the gains of all arcs are inside their
ranges."""

import ast
import itertools
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from typing import Any

from .consensus import schur
from .expressions import Coupling, read_coupling, variables
from .files import Certificate, Problem
from .intervals import NOTHING, Floats, added, enclosed, times
from .matrices import (
    ZERO,
    Matrix,
    definite,
    diagonal,
    identity,
    largest,
    nonnegative,
    plus,
    product,
    transpose,
)
from .reading import (
    MATRIX_BITS,
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
from .separable import CELLS, Curve, below, follow, starts, throughout

ROWS = 100  # of a quadratic certificate at most
Ranges = dict[Coupling, Any]  # the gains [lo, hi] of a coupling, m x m of them


def lure(case: Certificate, check: Any) -> None:
    """V decreases, and the level set holds all starts of the domain."""
    claim = read_quadratic(case, check.exact, check.rate)
    need(claim.level is not None or check.domain == "global", "it has no level and is not global")
    if claim.level is not None:
        holds_ball(case, check.domain, claim, claim.level)


def holds_ball(case: Certificate, ball: Any, claim: Any, level: Fraction) -> None:
    """Every start of the ball lies in {V <= level}."""
    starts(case, ball, "ball")
    need(
        largest(claim.P_e) * ball.radius**2 + cost(case, claim, ball) <= level,
        "the ball leaves the level set",
    )


def cost(case: Certificate, claim: Any, domain: Any) -> Fraction:
    """An upper bound of sum eps_i'P eps_i at the starts of a domain."""
    return case.problem.n * domain.disturbance**2 * largest(claim.P) if domain.disturbance else ZERO


# --- what a quadratic certificate claims but for its domain
def read_quadratic(
    case: Certificate, exact: Any, rate: Fraction | None = None, more: Any = None
) -> Any:
    """V decreases at the rate where V <= level (null: everywhere)."""
    p, m, size = case.problem, case.problem.m, case.problem.n * case.problem.m
    need(size <= ROWS, f"quadratic certificates are decided up to {ROWS} rows")
    gains = (((rational, rational),) * m,) * m
    shape: dict[str, Any] = {
        "method": text,
        "P_e": partial(read_form, size),
        "level": maybe(rational),
        "radius": maybe(rational),
        "ranges": [{"coupling": integer, "gains": gains}],
        "multipliers": an_object,
        "rate": rational,
    }
    claim = read(exact, shape | ({"P": matrix(p.q, p.q)} if p.q else {}) | (more or {}))
    need(claim.rate >= 0, "the rate is negative")
    need(
        rate is None or 0 < rate <= claim.rate,
        "the rate is not between 0 and that of the inequality",
    )
    need((claim.level is None) == (claim.radius is None), "level and radius are not both there")
    need(p.q == 0 or (transpose(claim.P) == claim.P and definite(claim.P)), "P > 0 is not shown")

    far = dict.fromkeys(p.couplings, None if claim.radius is None else [claim.radius] * m)
    ranges, costs = read_ranges(p, claim, far), noise(case, claim)
    need(
        set(claim.multipliers) == set(p.modes if claim.method == "lure" else ()),
        "there are other multipliers",
    )
    for mode in p.modes:
        forms = inequalities(
            p, claim, channels(p, mode, ranges), claim.multipliers.get(mode, []), costs
        )
        need(all(definite(X, -1) for X in forms), "V is not shown to decrease")
    if claim.level is None:
        need(p.domain == "global", "it has no level, and the couplings are not all linear")
    else:
        need(claim.level > 0 and claim.radius > 0, "the level or the radius is not positive")
        contained(p, claim.P_e, claim.level, claim.radius)
    return claim


def read_form(size: int, value: Any) -> Matrix:
    """P_e from its entries on and above the diagonal."""
    entries, P_e = (
        read(value, [(partial(index, size), partial(index, size), rational)]),
        identity(size, 0),
    )
    short((x for _, _, x in entries), MATRIX_BITS)
    need(
        all(a <= b and x != 0 for a, b, x in entries),
        "P_e does not list its entries that are not 0, a <= b",
    )
    need(len({(a, b) for a, b, _ in entries}) == len(entries), "an entry of P_e stands there twice")
    for a, b, x in entries:
        P_e[a][b] = P_e[b][a] = x
    need(definite(P_e), "P_e > 0 is not shown")
    return P_e


def noise(case: Certificate, claim: Any) -> Matrix:
    """I (x) S: what eps costs."""
    S = schur(case, claim.P, claim.rate) if case.problem.q else identity(case.problem.m, 0)
    return diagonal([case.problem.block(S, i) for i in range(case.problem.n)])


def inside(P_e: Matrix, z: list[Fraction], square: Fraction, limit: Fraction) -> bool:
    """square z'P_e^-1 z <= limit^2: |z'e| <= limit where e'P_e e <= square."""
    return nonnegative(plus(P_e, -square / limit**2, product(transpose([z]), [z])))


def contained(p: Problem, P_e: Matrix, square: Fraction, radius: Fraction | None) -> None:
    """{e'P_e e <= square} lies inside the radius (none: there is no limit)."""
    for a, b in relied(p) if radius is not None else ():
        # of the target, the row after the last: nothing
        z = [Fraction((k == b) - (k == a)) for k in range(len(P_e))]
        need(inside(P_e, z, square, radius or ZERO), "the level set leaves the radius")


def relied(p: Problem) -> set[tuple[int, int]]:
    """The rows of e_id and e_jd for each difference e_jd - e_id that a coupling depends on, if it
    is not linear."""
    found = set()
    for (i, j, _, h, _), d in (
        (arc, d) for heard in p.modes.values() for arc in heard for d in range(p.m)
    ):
        bent = [each for each, part in zip(h.h, h.parts, strict=True) if part.degree > 1]
        if not h.straight and (
            h.single or any(re.search(rf"y{d + 1}(?![0-9])", each) for each in bent)
        ):
            found.add((i * p.m + d, j * p.m + d))
    nodes = p.couplings[-1] if p.nodes else None
    for i, d in itertools.product(range(p.n), range(p.m)):
        if nodes and any(
            part.degree > 1 and named(each, d)
            for each, part in zip(nodes.h, nodes.parts, strict=True)
        ):
            found.add((i * p.m + d, p.n * p.m))
    return found


def named(text: str, d: int) -> bool:
    """Whether an expression names component d."""
    return bool(re.search(rf"\by({d + 1}{'|' if d == 0 else ''})(?![0-9a-z])", text))


# --- gains of the couplings
def read_ranges(p: Problem, claim: Any, far: dict[Coupling, Any]) -> Ranges:
    """The gains of every coupling that an arc has, shown on |y_c| <= far_c of the coupling."""
    used = {arc.coupling for arcs in p.modes.values() for arc in arcs}
    wanted = [k for k, h in enumerate(p.couplings) if h in used or k >= len(p.couplings) - p.nodes]
    need(
        sorted(each.coupling for each in claim.ranges) == wanted,
        "the ranges are not those of the couplings",
    )
    found = {p.couplings[each.coupling]: each.gains for each in claim.ranges}
    nodes = p.couplings[-1] if p.nodes and p.leader else None
    known = ((h, gains) for h, gains in found.items() if h is not nodes)
    need(all(gains_hold(h, gains, far[h]) for h, gains in known), "the gains are not shown")
    if nodes:  # f(s + e) - f(s) for s in the box of the leader
        need(far[nodes] is not None, "the slopes of f need a radius")
        reach = ((-r, r) for r in (enclosed(x)[1] for x in far[nodes]))
        around = [added(*sides) for sides in zip(p.encloses(), reach, strict=True)]
        rows = list(zip(nodes.parts, found[nodes], strict=True))
        need(slopes_inside(rows, around, CELLS), "the slopes of f are not shown")
    return found


def gains_hold(h: Coupling, gains: Any, far: list[Fraction] | None) -> bool:
    """h(y) = G(y) y with G(y) inside the gains, for |y_c| <= far_c."""
    m = len(gains)
    places = [(c, d) for c in range(m) for d in range(m)]
    if h.straight:
        return all(
            gains[c][d][0] <= h.slope(c, d)[0] and h.slope(c, d)[1] <= gains[c][d][1]
            for c, d in places
        )
    if far is None or min(far) <= 0:
        return False
    sides = [enclosed(r)[1] for r in far]
    if h.single:
        beside = [gains[c][d] for c, d in places if c != d]
        return all(lo <= 0 <= hi for lo, hi in beside) and all(
            secants_inside(h, gains[c][c], sides[c]) for c in range(m)
        )
    apart = [k for k, text in enumerate(h.h) if sum_of_curves(text)]
    rest = [
        (part, row)
        for k, (part, row) in enumerate(zip(h.parts, gains, strict=True))
        if k not in apart
    ]
    alone = all(secants_along(h.h[c], d, gains[c][d], sides[d]) for c in apart for d in range(m))
    return alone and slopes_inside(rest, [(-r, r) for r in sides], CELLS)


def sum_of_curves(source: str) -> bool:
    """True if an expression is, as it is written, a sum of functions of one variable each."""
    left: list[ast.expr] = [ast.parse(source, mode="eval").body]
    while left:
        node = left.pop()
        match node:
            case _ if variables_of(node) < 2:
                continue
            case ast.UnaryOp(operand=operand):
                left.append(operand)
            case ast.BinOp(left=a, op=ast.Add() | ast.Sub(), right=b):
                left += [a, b]
            case ast.BinOp(left=a, op=ast.Mult(), right=b) if not variables_of(
                a
            ) or not variables_of(b):
                left += [a, b]
            case _:
                return False
    return True


def variables_of(node: ast.expr) -> int:
    """How many variables occur."""
    return len(
        {
            each.id
            for each in ast.walk(node)
            if isinstance(each, ast.Name) and re.fullmatch("y[0-9]*", each.id)
        }
    )


def secants_along(source: str, d: int, gain: list[Fraction], r: float) -> bool:
    """The gain of a sum of functions of one variable each, in component d: the others are 0
    there."""
    text = re.sub(r"\by([0-9]*)\b", lambda y: "y" if int(y[1] or 1) == d + 1 else "0", source)
    h = read_coupling((text,), 1)
    if h.straight:
        return gain[0] <= h.slope(0, 0)[0] and h.slope(0, 0)[1] <= gain[1]
    return secants_inside(h, gain, r)


def secants_inside(h: Coupling, gain: list[Fraction], r: float) -> bool:
    """lo y <= h(y) <= hi y for 0 < y <= r, and the other way round for -r <= y < 0."""

    def shown(curve: Curve, side: float, slope: Floats) -> bool:
        def settled(a: float, b: float) -> bool:
            bound = follow(curve, (side, side), a, b)

            def at(s: float) -> float:
                return added((bound.at(s),) * 2, times((s, s), slope))[1]

            return below(a, b, at, added(bound.slope, slope))

        return throughout(r, settled)

    sides = [(1.0, enclosed(-gain[1])), (-1.0, enclosed(gain[0]))]
    return all(shown(Curve(h, face), *side) for face in (False, True) for side in sides)


def slopes_inside(rows: list[Any], box: list[Floats], halvings: int) -> bool:
    """All slopes of expressions lie inside their gains on the box, or on both halves of it."""
    slopes = [(part.at(*variables(box))[1] or (NOTHING,) * len(box), gains) for part, gains in rows]
    pairs = [pair for row in slopes for pair in zip(*row, strict=True)]
    shown = all(low <= Fraction(x) and Fraction(y) <= high for (x, y), (low, high) in pairs)
    lo, hi = side = max(box, key=lambda each: each[1] - each[0])
    k, middle = box.index(side), (lo + hi) / 2
    halves = [[*box[:k], half, *box[k + 1 :]] for half in ((lo, middle), (middle, hi))]
    return shown or (
        halvings > 0 and all(slopes_inside(rows, half, halvings - 1) for half in halves)
    )


# --- the inequality
def channels(
    p: Problem, mode: str, ranges: Ranges
) -> list[tuple[int, int, int, Fraction, Fraction]]:
    """(b, own, other, g0, D): a gain between g0 - D and g0 + D from e_other - e_own to row b."""
    found, m = [], p.m
    for arc, c, d in ((arc, c, d) for arc in p.modes[mode] for c in range(m) for d in range(m)):
        lo, hi = (arc.w * x for x in ranges[arc.coupling][c][d])
        if lo or hi:
            lo, hi = (min(lo, ZERO), max(hi, ZERO)) if arc.loose else (lo, hi)
            found.append(
                (arc.i * m + c, arc.i * m + d, arc.j * m + d, (lo + hi) / 2, (hi - lo) / 2)
            )
    for i, c, d in itertools.product(range(p.n), range(m if p.nodes else 0), range(m)):
        lo, hi = (x - p.drift[c][d] for x in ranges[p.couplings[-1]][c][d])
        # beside A, a gain of e_i itself: the difference to the target, the row after the last
        if lo or hi:
            found.append((i * m + c, p.n * m, i * m + d, (lo + hi) / 2, (hi - lo) / 2))
    return found


def inequalities(
    p: Problem, claim: Any, gains: Any, multipliers: Any, costs: Matrix
) -> Iterator[Matrix]:
    """The matrices that have to be negative definite in a mode."""
    P_e, size, method = claim.P_e, len(claim.P_e), claim.method
    need(
        method in ("lure", "interval", "vertices"),
        "the method is none of lure, interval and vertices",
    )
    A, M, extra = (
        plus(identity(size, 0), -1, p.gain_matrix()),
        identity(size, 0),
        identity(size + 1, 0),
    )
    # the last column, and row of ``extra``, are those of the target
    A = [[*row, ZERO] for row in A]
    taus = read(multipliers, (rational,) * (len(gains) if method == "lure" else 0))
    for k, (b, own, other, g0, D) in enumerate(gains):
        A[b][other], A[b][own] = A[b][other] + g0, A[b][own] - g0
        if method == "lure":
            need(taus[k] > 0 if D else taus[k] == 0, "a multiplier is not positive")
            M[b][b] += 1 / (2 * taus[k]) if D else 0
            for x, y, sign in (
                (own, own, 1),
                (other, other, 1),
                (own, other, -1),
                (other, own, -1),
            ):
                extra[x][y] += sign * 2 * taus[k] * D**2
        elif method == "interval" and D:
            z = {own: -1, other: 1}
            for x in range(size):
                extra[x][x] += D * sum(
                    abs(P_e[x][b] * z.get(y, 0) + z.get(x, 0) * P_e[y][b]) for y in range(size)
                )

    quadratic = plus(
        product(product(P_e, plus(M, 1, costs)), P_e), 1, [row[:size] for row in extra[:size]]
    )
    free = [channel for channel in gains if channel[-1] and method == "vertices"]
    need(len(free) <= 12, "there are too many vertices")
    for signs in itertools.product((-1, 1), repeat=len(free)):
        corner = [list(row) for row in A]
        for sign, (b, own, other, _, D) in zip(signs, free, strict=True):
            corner[b][other], corner[b][own] = (
                corner[b][other] + sign * D,
                corner[b][own] - sign * D,
            )
        half = plus(product(P_e, [row[:size] for row in corner]), claim.rate, P_e)
        yield plus(plus(half, 1, transpose(half)), 1, quadratic)
