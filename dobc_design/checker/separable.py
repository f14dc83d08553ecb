"""max-separable, delay and sampling: N = max |e_ic| / v_i decreases, shown row by row on every face
of a box.

With an exosystem V = N + kappa max sqrt(eps_i'P eps_i) decreases. At the end: equilibrium, another
place of rest.
"""

import heapq
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple

from .consensus import omega
from .expressions import Coupling, variables
from .files import Arc, Certificate, Problem
from .intervals import (
    NOTHING,
    ONE,
    Exact,
    Floats,
    absolute,
    added,
    by_decimal,
    divided,
    dot,
    enclosed,
    hull,
    negative,
    times,
    total,
)
from .matrices import (
    ZERO,
    Matrix,
    definite,
    echelon,
    identity,
    integers,
    nonnegative,
    plus,
    product,
    transpose,
)
from .reading import (
    MATRIX_BITS,
    an_object,
    matrix,
    maybe,
    need,
    rational,
    read,
    same,
    short,
    still,
    text,
    weights,
)

EQUATIONS = 60  # of an equilibrium at most
PIECES = 20_000  # into which one row is cut at most
SHORTEST = 2.0**-200  # part of rho: a row that fails at s = 0 fails on every piece (0, s]
CUTS = 1024  # of the interval on which |h(y)/y| is bounded
# halvings of an interval on which the sign of a slope is sought; 2^(CELLS + 2) pieces of a coupling
CELLS = 12


# --- One scalar coupling on intervals: where it rises and falls, and upper bounds of it
# -------------------------------
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
        self.formula, self.mirrored, self.points = coupling.parts[0], mirrored, dict[float, float]()
        self.table: list[Cell] = []
        # couplings like to have their kink at 0
        sides = [(a, b) for a, b in ((lo, 0.0), (0.0, hi)) if a < b]
        for cell in sorted(self.cells(sides, (hi - lo) / 2**40)):
            joined = bool(self.table) and cell.way != 0 and self.table[-1].way == cell.way
            self.table.append(
                Cell(self.table.pop().lo, cell.hi, cell.way, math.inf) if joined else cell
            )

    def at(self, y: Floats) -> tuple[Floats, Floats]:
        """Values and slopes on y."""
        value, slopes = self.formula.at((negative(y) if self.mirrored else y, (ONE,)))
        return negative(value) if self.mirrored else value, slopes[0] if slopes else NOTHING

    def top(self, y: float) -> float:
        """An upper bound of h at a point."""
        if y == 0:
            return 0.0  # the reader has found that h(0) = 0
        if y not in self.points:
            value, _ = self.formula.at(((-y, -y) if self.mirrored else (y, y), ()))
            self.points[y] = -value[0] if self.mirrored else value[1]
        return self.points[y]

    def steepest(self, lo: float, hi: float) -> float:
        """An upper bound of h' on [lo, hi]: the piece with the largest one is halved until a point
        comes close."""
        pieces = [(-self.at((lo, hi))[1][1], lo, hi)]
        reached = max(self.at((y, y))[1][1] for y in (lo, hi))
        for _ in range(500):
            bound, a, b = pieces[0]
            middle = (a + b) / 2
            if not a < middle < b or -bound - reached <= abs(reached) / 4096:
                break
            heapq.heapreplace(pieces, (-self.at((a, middle))[1][1], a, middle))
            heapq.heappush(pieces, (-self.at((middle, b))[1][1], middle, b))
            reached = max(reached, self.at((middle, middle))[1][1])
        return -pieces[0][0]

    def cells(self, pieces: list[Floats], finest: float) -> Iterator[Cell]:
        """Cells of these pieces, halved until the sign of the slope is known; the widest first, if
        that is hopeless."""
        for a, b in pieces:  # it grows
            value, slope = self.at((a, b))
            way = 1 if slope[0] >= 0 else -1 if slope[1] <= 0 else 0
            if way or b - a <= finest or len(pieces) > 2 ** (CELLS + 2):
                yield Cell(a, b, way, value[1])
            else:
                pieces += [(a, (a + b) / 2), ((a + b) / 2, b)]

    def between(self, lo: float, hi: float) -> list[Cell]:
        """The cells of the table between two numbers."""
        first = bisect_right(self.table, lo, key=itemgetter(0)) - 1
        return self.table[max(0, first) : bisect_left(self.table, hi, key=itemgetter(0))]


def secants(h: Any, end: float) -> Iterator[Fraction]:
    """Upper bounds of |h(y)/y| on pieces of |y| <= end: |h| over the nearer end, or the steepest
    slope so far."""
    steepest, curves = 0.0, [Curve(h, mirrored) for mirrored in (False, True)]
    for a, b in pairwise([*(end * (k / CUTS) for k in range(CUTS)), end]):
        both = [curve.at((a, b)) for curve in curves]
        steepest = max(steepest, *(absolute(slope)[1] for _, slope in both))
        largest = max(divided(absolute(value), (a, a))[1] for value, _ in both) if a else steepest
        yield Fraction(min(steepest, largest))


# --- Bounds on a piece a <= s <= b
# ------------------------------------------------------------------------------------
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
        return curve.top(y[1]) if rising or y[0] == y[1] else curve.at(y)[0][1]

    return Bound(value[0], value[1], at, times(side, slope))


def supremum(curve: Curve, p: Floats, q: Floats, a: float, b: float) -> Bound:
    """Of sup {h(y): -s p <= y <= s q} for a < s <= b: it is taken at one of the ends, or at a
    summit between them."""
    left, last = times((b, b), negative(p))[0], max(times((s, s), q)[1] for s in (a, b))
    cells = curve.between(left, last)
    if len(cells) == 1 and cells[0].way == 1:
        return follow(curve, q, a, b, rising=True)

    if a == 0:  # h(y) = g y with a slope g: at most s max (-g p, g q)
        slope = curve.at((left, max(0.0, last)))[1]
        steepest = max(times(slope, side)[1] for side in (negative(p), q))
        return Bound(
            -math.inf, math.inf, lambda s: times((s, s), (steepest,) * 2)[1], (steepest,) * 2
        )

    # The largest value between two cells, or in one that is not known to rise or fall.
    tops = [curve.top(one.hi) for one, other in pairwise(cells) if one.way == 1 and other.way == -1]
    tops += [cell.top for cell in cells if not cell.way]
    bounds = [follow(curve, side, a, b) for side in (q, negative(p))]
    bounds += [Bound(-math.inf, max(tops), lambda _: max(tops), NOTHING)] if tops else []
    floor = max(bound.low for bound in bounds)
    bounds = [bound for bound in bounds if bound.high >= floor]  # the others are never the largest
    slopes = hull(*(bound.slope for bound in bounds))
    return Bound(floor, math.inf, lambda s: max(bound.at(s) for bound in bounds), slopes)


def below(a: float, b: float, at: Callable[[float], float], slope: Floats) -> bool:
    """True if F <= 0 on the piece: it lies below F(a) + (s - a) sup F' and below F(b) - (b - s) inf
    F'."""
    (low, high), start = slope, at(a)
    if high <= 0:
        return start <= 0
    end = at(b)
    if low >= 0:
        return end <= 0
    lines = [times((-low, -low), (start, start)), times((high, high), (end, end))]
    # where they meet
    return (
        total([*lines, times(times((-low, -low), (high, high)), added((b, b), (-a, -a)))])[1] <= 0
    )


def throughout(rho: float, settled: Callable[[float, float], bool], start: float = 0.0) -> bool:
    """Cut (0, rho], or [start, rho], until every piece is settled."""
    left, done = [(start, rho)], 0
    while left:
        a, b = left.pop()
        middle, done = (a + b) / 2, done + 1
        still()
        if not settled(a, b):
            if done > PIECES or b - a <= rho * SHORTEST or not a < middle < b:
                return False
            left += [(middle, b), (a, middle)]
    return True


# --- max-separable
# --------------------------------------------------------------------------------------------------
def max_separable(case: Certificate, check: Any) -> None:
    """V decreases in the region, at the rate of the check; or no v does."""
    if check.verdict == "refuted":
        stuck(case.problem, check)
    else:
        claim, rate = read_separable(case, check.exact), check.rate
        need(
            rate is not None and 0 < rate <= pace(case, claim),
            "the rate is not between 0 and what follows",
        )
        contains(case, claim, check.domain)


def stuck(p: Problem, check: Any) -> None:
    """Agents each of which has, in some mode, no gain that holds it and hears nobody outside the
    set."""
    witness = read(check.witness, {"kind": text, "labels": [text]})
    need(
        check.exact is None and witness.kind == "agents",
        "it claims a value, or its witness is no set of agents",
    )
    group = set(witness.labels)
    need(
        group <= set(p.labels) and 0 < len(group) == len(witness.labels),
        "the witness names no different agents",
    )
    for i in (i for i, label in enumerate(p.labels) if label in group):
        inside = any(
            all(arc.loose or p.labels[arc.j] in group for arc in heard[i])
            for heard in p.heard.values()
        )
        need(
            p.least_gain(i) <= 0 and inside,
            "an agent of the witness is held, or hears somebody outside",
        )


def observed(p: Problem) -> dict[str, Any]:
    """The shape of the observer's part of a claim."""
    return (
        {"P": matrix(p.q, p.q), "beta": rational, "kappa": rational, "size": rational}
        if p.q
        else {}
    )


def read_separable(case: Certificate, exact: Any) -> Any:
    """What a max-separable claims: N decays at alpha where N <= rho (null: everywhere); with an
    exosystem, that |C eps_i| <= E = max sqrt(eps_i'P eps_i), which decays at the rate beta."""
    p = case.problem
    claim = read(
        exact, {"v": partial(weights, p.n), "alpha": rational, "rho": maybe(rational)} | observed(p)
    )
    need(p.q == 0 or claim.kappa > 0, "kappa is not positive")
    return claim


def pace(case: Certificate, claim: Any) -> Fraction:
    """The rate of V that follows."""
    second = claim.beta - 1 / (claim.kappa * min(claim.v)) if case.problem.q else claim.alpha
    return Fraction(min(claim.alpha, second))


def contains(case: Certificate, claim: Any, domain: Any) -> None:
    """The rows, the observer's part, and all starts of the domain."""
    composite(case, claim)
    if claim.rho is None:
        need(domain == "global" == case.problem.domain, "it has no rho and is not global")
    else:
        starts(case, domain, "box")
        holds_box(claim, domain, claim.rho)
    rows(case, claim, claim.alpha, Fraction(1))


def composite(case: Certificate, claim: Any, C: Matrix | None = None) -> None:
    """The observer's part, if there is an exosystem; for errors that feel another C."""
    for P in [claim.P] if case.problem.q else []:
        short((x for row in P for x in row), MATRIX_BITS)
        need(transpose(P) == P and definite(P), "P > 0 is not shown")
        need(
            nonnegative([[-x for x in row] for row in omega(case, P, claim.beta)]),
            "beta is not shown",
        )
        squares = [product(transpose([c]), [c]) for c in C or case.problem.C]
        need(all(nonnegative(plus(P, -1, square)) for square in squares), "c'c <= P is not shown")
        need(
            nonnegative(plus(identity(case.problem.q, claim.size), -1, P)),
            "P <= size I is not shown",
        )


def starts(case: Certificate, domain: Any, kind: str) -> None:
    """The domain is a box or ball of starts."""
    need(type(domain) is not str and domain.kind == kind, f"the domain is no {kind}")
    need(
        None not in (domain.radius, domain.disturbance) and domain.radius > 0 <= domain.disturbance,
        "it is empty",
    )
    need(case.problem.q > 0 or domain.disturbance == 0, "there is a disturbance, but no exosystem")


def holds_box(claim: Any, box: Any, level: Fraction, spread: Fraction | None = None) -> None:
    """V <= level at every start of the box; ``spread``: of |e| <= 1, if N is in coordinates."""
    left, s = level - box.radius * (spread or 1 / min(claim.v)), box.disturbance
    need(left >= 0, "the box leaves the region")
    need(
        s == 0 or (claim.kappa * s) ** 2 * claim.size <= left**2,
        "the disturbance leaves the region",
    )


Curves = dict[tuple[Coupling, bool], Curve]  # h and -h(-y)
Term = tuple[Curve, Floats, Floats, Floats]  # w, p and q


# --- rows: sum of w sup {h(y): -s p <= y <= s q} <= s c for all s in (0, rho], with p = v_i + v_j
# and q = v_j - v_i
class Row(NamedTuple):
    """The row of an agent: its v, the bound c, and the coupling, weight and v_j of every arc; v and
    c in one unit. Of a loose arc the supremum is taken up to y = 0 at least: there it adds nothing,
    as if it were absent."""

    own: int
    c: Fraction
    terms: tuple[tuple[Coupling, Fraction, int, bool], ...]

    def steps(self) -> list[int]:
        """v_j - v_i of every arc, or 0 for a loose one if that is more."""
        return [
            max(top - self.own, 0) if loose else top - self.own for _, _, top, loose in self.terms
        ]


def rows(
    case: Certificate,
    claim: Any,
    alpha: Fraction,
    theta: Fraction,
    errors: Exact = (ZERO, ZERO),
    local: bool = False,
) -> None:
    """Both faces of all rows, equal ones once; v_j counts theta times.  ``errors``: relative ones
    of all weights and gains; ``local``: for slopes at the target."""
    p, (v, bottom) = case.problem, integers(claim.v)
    tops, bottom = [theta.numerator * x for x in v], theta.denominator * bottom
    found: dict[Row, int] = {}
    for i, heard in ((i, heard[i]) for heard in p.heard.values() for i in range(p.n)):
        own = v[i] * theta.denominator
        each = ((arc.coupling, arc.w, tops[arc.j], arc.loose) for arc in heard)
        terms = sorted(each, key=lambda term: (term[0].h, *term[1:]))
        found.setdefault(Row(own, (p.least_gain(i, errors[1]) - alpha) * own, tuple(terms)), i)

    curves = tables(
        claim, ((h, row.own, top) for row in found for h, _, top, _ in row.terms), bottom, False
    )
    for row, i in found.items():
        faces = (False, True) if claim.rho is not None else ()
        curved = (curved_row(row, bottom, claim.rho, curves, face, errors[0]) for face in faces)
        need(
            linear_row(row, errors[0], local) or (bool(faces) and all(curved)),
            f"the row of agent {p.labels[i]} is not shown",
        )


def tables(
    claim: Any, arcs: Iterable[tuple[Coupling, int, int]], bottom: int, wide: bool
) -> Curves:
    """All couplings, with tables as far as the arcs need them: to v_j - v_i, or (``wide``) to v_i +
    v_j as well."""
    reach: dict[Coupling, tuple[int, int]] = {}
    for h, own, other in arcs:
        p, q = reach.get(h, (0, 0))
        reach[h] = max(p, own + other), max(q, own + other if wide else other - own)

    curves: Curves = {}
    for h, ends in reach.items() if claim.rho is not None else ():
        low, high = (times(enclosed(claim.rho), enclosed(Fraction(x, bottom)))[1] for x in ends)
        curves |= {(h, face): Curve(h, face, -low, high) for face in (False, True)}
    return curves


def linear_row(
    row: Row, error: Fraction = ZERO, local: bool = False, load: Fraction = ZERO
) -> bool:
    """True if a row of linear couplings holds, with a load added: its two faces are the same, and s
    does not matter."""
    arcs = zip(row.terms, row.steps(), strict=True)
    ends = [(h.slope(0, 0), w, (step, -top - row.own)) for (h, w, top, _), step in arcs]
    largest = ((w, max(g * y for g in slopes for y in sides)) for slopes, w, sides in ends)
    suprema = (max(w * (1 - error) * x, w * (1 + error) * x) for w, x in largest)
    return all(local or h.straight for h, *_ in row.terms) and sum(suprema, load) <= row.c


def curved_row(
    row: Row,
    bottom: int,
    rho: Fraction,
    curves: Curves,
    mirrored: bool,
    error: Fraction = ZERO,
    start: Fraction = ZERO,
    load: Fraction = ZERO,
) -> bool:
    """One face of a row, with a load added, on pieces of (0, rho], or of [start, rho]; a weight is
    an interval, so that products have the worse end."""
    # for huge ones
    unit = max(Fraction(2**400), abs(row.c) / bottom, load, *(w for _, w, *_ in row.terms)) / 2**400
    c, added_load = enclosed(row.c / bottom / unit), enclosed(load / unit)
    steps = row.steps()
    sides = {
        x: enclosed(Fraction(x, bottom))
        for x in (*(v + row.own for _, _, v, _ in row.terms), *steps)
    }
    wide = [
        hull(*(enclosed(w * (1 + sign * error) / unit) for sign in (-1, 1)))
        for _, w, *_ in row.terms
    ]
    arcs = zip(row.terms, wide, steps, strict=True)
    terms = [
        (curves[h, mirrored], w, sides[v + row.own], sides[step]) for (h, _, v, _), w, step in arcs
    ]

    return on_pieces(terms, c, added_load, enclosed(rho)[1], enclosed(start)[0])


def on_pieces(terms: list[Term], c: Floats, load: Floats, rho: float, start: float = 0.0) -> bool:
    """True if sum of w sup {h(y): -s p <= y <= s q} + load <= s c for all s of (0, rho], or of
    [start, rho]."""

    def settled(a: float, b: float) -> bool:
        bounds = [(w, supremum(curve, p, q, a, b)) for curve, w, p, q in terms]

        def at(s: float) -> float:
            return total(
                [*(times(w, (bound.at(s),) * 2) for w, bound in bounds), times((-s, -s), c), load]
            )[1]

        return below(
            a, b, at, total([*(times(w, bound.slope) for w, bound in bounds), negative(c)])
        )

    return throughout(rho, settled, start)


# --- delay and sampling
# -----------------------------------------------------------------------------------------------
def beside(case: Certificate, check: Any) -> Any:
    """The proved max-separable with the same domain."""
    proofs = [
        each for each in case.checks if (each.id, each.verdict) == ("max-separable", "proved")
    ]
    need(
        any(each.domain == check.domain for each in proofs),
        "no max-separable with this domain is proved",
    )
    return read_separable(case, proofs[0].exact)


def delay(case: Certificate, check: Any) -> None:
    """The rows hold with theta v_j for v_j: agents may hear each other late."""
    claim = beside(case, check)
    exact = read(check.exact, {"delay": rational, "rate": rational})
    need(exact.delay >= 0, "the delay is negative")
    need(
        check.rate is not None and 0 < check.rate <= exact.rate,
        "the rate is not between 0 and that of the rows",
    )
    need(
        case.problem.q == 0 or exact.rate <= claim.beta,
        "the rate is larger than that of the observer",
    )
    theta = by_decimal("exp", (exact.delay * exact.rate,) * 2)[1]
    rows(case, claim, exact.rate, Fraction(math.ceil(theta * 2**60), 2**60))


def sampling(case: Certificate, check: Any) -> None:
    """Couplings and gains held over periods: no step overshoots."""
    p, claim = case.problem, beside(case, check)
    exact = read(check.exact, {"period": rational, "factor": rational, "certificate?": an_object})
    need(check.rate is None, "it has no rate to claim")
    need(p.B is None, "dynamics of the agents themselves are not held")
    if exact.certificate is not None:
        claim = read_separable(case, exact.certificate)
        need(pace(case, claim) > 0, "its own certificate has no rate")
        contains(case, claim, check.domain)
    need(
        1 - exact.period * claim.alpha <= exact.factor < 1,
        "the factor does not follow from the period",
    )

    (v, bottom), agents = (
        integers(claim.v),
        [(i, heard[i]) for heard in p.heard.values() for i in range(p.n)],
    )
    curves = tables(
        claim,
        ((arc.coupling, v[i], v[arc.j]) for i, heard in agents for arc in heard),
        bottom,
        True,
    )

    @cache
    def slope(h: Coupling, mirrored: bool, own: int, other: int, closely: bool) -> Fraction:
        rho, v = claim.rho and enclosed(claim.rho)[1], (own, other, bottom)
        return (
            mean_slope(curves[h, mirrored], rho, v, closely) if rho else max(ZERO, h.slope(0, 0)[1])
        )

    def short(i: int, heard: list[Arc], mirrored: bool, closely: bool) -> bool:
        slopes = (arc.w * slope(arc.coupling, mirrored, v[i], v[arc.j], closely) for arc in heard)
        # exact: a period of 1 is often the largest
        return bool(exact.period * sum(slopes, p.largest_gain(i)) <= 1)

    for i, heard, mirrored in (
        (*agent, mirrored) for agent in agents for mirrored in (False, True)
    ):
        need(
            any(short(i, heard, mirrored, closely) for closely in (False, True)),
            f"too long for agent {p.labels[i]}",
        )


def mean_slope(curve: Curve, rho: float, v: tuple[int, int, int], closely: bool) -> Fraction:
    """An upper bound of L: eight slices of x, the supremum of h' over each of the growing
    intervals."""
    own, other, bottom = v
    p, q = (times((rho, rho), enclosed(Fraction(y, bottom))) for y in (own + other, other - own))
    rises = all(cell.way == 1 for cell in curve.between(-p[1], p[1]))
    left, slope, mean = min(q[0], 0.0) if rises else -p[1], 0.0, ZERO
    for k in range(9):
        right = max(
            0.0, times((rho, rho), enclosed(Fraction(4 * (other - own) + k * own, 4 * bottom)))[1]
        )
        for a, b in pairwise([left + (right - left) * part / 4 for part in range(4)] + [right]):
            slope = max(
                slope, curve.steepest(a, max(a, b)) if closely else curve.at((a, max(a, b)))[1][1]
            )
        mean += Fraction(slope) / 8 if k else 0
        left = right
    return mean


# --- equilibrium: a box that holds one of h(e) - K e other than 0, by the test of Krawczyk
# ----------------------------
def equilibrium(case: Certificate, check: Any) -> None:
    """c - Y f(c) + (I - Y F'(X)) (X - c) lies inside X, so that f = 0 somewhere in X; or X is a
    point with f = 0."""
    p, size = case.problem, case.problem.n * case.problem.m
    need(size <= EQUATIONS, f"an equilibrium is looked at up to {EQUATIONS} equations")
    exact = read(check.exact, {"mode": text, "box": ((rational, rational),) * size})
    mode, box = exact.mode, exact.box
    need(mode in p.modes, "there is no such mode")
    middle = [(lo + hi) / 2 for lo, hi in box]
    need(
        same(check.witness, {"kind": "start", "values": middle}),
        "the witness is not the middle of the box",
    )
    need(any(lo > 0 or hi < 0 for lo, hi in box), "the box contains the target")
    if p.region is not None:
        sides = [
            (side, goal[c]) for goal in p.goals for c, side in enumerate(p.region.initial_states)
        ]
        for (lo, hi), ((low, high), goal) in zip(box, sides, strict=True):
            need(low <= lo + goal and hi + goal <= high, "the box leaves the region")

    (_, slopes), (values, _) = forces(p, mode, box), forces(p, mode, [[x, x] for x in middle])
    still = all(lo == hi for lo, hi in box) and not any(
        map(any, forces(p, mode, box, lambda x: (x, x))[0])
    )
    rough = [  # any Y is allowed, so that it may be cut off
        [
            Fraction(round(max(-1e200, min(sum(row.get(k, NOTHING)), 1e200)) * 2**30), 2**31)
            for k in range(size)
        ]
        for row in slopes
    ]
    rows, _ = echelon([x + unit for x, unit in zip(rough, identity(size), strict=True)])
    for a, (lo, hi) in enumerate(box):
        factors = [enclosed(-x) for x in rows[a][size:]]
        rest = {k: [ONE] * (k == a) for k in range(size)}
        for factor, row in zip(factors, slopes, strict=True):
            for k, slope in row.items():
                rest[k].append(times(factor, slope))
        halves = [enclosed((hi - lo) / 2)[1] for lo, hi in box]
        spread = dot(map(total, rest.values()), ((-half, half) for half in halves))
        image = total([enclosed(middle[a]), dot(factors, values), spread])
        need(
            still or (lo < Fraction(image[0]) and Fraction(image[1]) < hi),
            "no equilibrium is shown in the box",
        )


def forces(
    p: Problem, mode: str, e: Matrix, kind: Any = enclosed
) -> tuple[list[Floats], list[dict[int, Floats]]]:
    """h(e) - K e and its slopes for all e in a box, in the numbers of this kind."""
    m, zero = p.m, kind(ZERO)
    values = [zero] * len(e)
    slopes: list[dict[int, Floats]] = [{} for _ in e]

    def act(row: int, w: Floats, value: Floats, parts: list[tuple[int, Floats]]) -> None:
        values[row] = added(values[row], times(w, value))
        for column, slope in parts:
            slopes[row][column] = added(slopes[row].get(column, zero), times(w, slope))

    for arc, c in ((arc, c) for arc in p.modes[mode] for c in range(m)):
        own, other = (
            [i * m + d for d in ([c] if arc.coupling.single else range(m))] for i in (arc.i, arc.j)
        )
        y = [
            (kind(e[b][0] - e[a][1])[0], kind(e[b][1] - e[a][0])[1])
            for a, b in zip(own, other, strict=True)
        ]
        value, found = arc.coupling.parts[c % len(arc.coupling.parts)].at(*variables(y))
        parts = found or (zero,) * len(y)
        act(arc.i * m + c, kind(arc.w), value, list(zip(other, parts, strict=True)))
        act(arc.i * m + c, kind(arc.w), zero, list(zip(own, map(negative, parts), strict=True)))
    for i, c, d in ((i, c, d) for i in p.gains for c in range(m) for d in range(m)):
        a = i * m + d
        act(i * m + c, kind(-p.gains[i][c][d]), hull(*map(kind, e[a])), [(a, ONE)])
    return values, slopes
