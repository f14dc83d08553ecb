"""The lone checker's part about regions: max-separable, delay, sampling and equilibrium.

It lies beside checker.py, which loads it when a certificate holds such claims. Standard library only, nothing of the
package but checker.py: written from docs/certificate-format.md, section "Regions", alone.
Couplings are enclosed on intervals of floating-point numbers that are rounded outward after every operation; sums,
products and quotients are those of IEEE 754, the other functions come from the decimal module or from integers.
"Not shown" is no claim that something is false.
"""

from __future__ import annotations

import ast
import base64
import binascii
import decimal
import heapq
import math
import struct
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import lru_cache, partial, reduce
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple, cast

# The length of this file is counted, so its lines are set by hand.

# isort: off
from .checker import (
    MATRIX_BITS,
    PI,
    VECTOR_BITS,
    Matrix,
    Number,
    Refused,
    an_object,
    by_decimal,
    definite,
    echelon,
    matrix,
    maybe,
    need,
    plus,
    product,
    rational,
    read,
    read_coupling,
    same,
    short,
    text,
    transpose,
)

__all__ = ["Decisions"]
PIECES = 20_000  # into which one row is cut at most
EQUATIONS, ROWS = 60, 100  # of an equilibrium and of a quadratic certificate at most
CELLS = 12  # halvings of an interval on which the sign of a slope is sought
BITS = 160  # of the integers that sines and inverse tangents are made of
UNIT, SLACK = 1 << BITS, 1 << 60  # 1, and the error of such an integer at most
HALF_TURN = math.floor(PI.lo * UNIT)
LARGEST, WIDEST = 1e300, 2.0**40  # of the values followed here; of the arguments of sin, cos, tan and atan
ZERO = Fraction(0)
Interval = tuple[float, float]
Jet = tuple[Interval, tuple[Interval, ...]]  # a value and its slopes along the variables (none: constant)


# --- Intervals of floating-point numbers, rounded outward -------------------------------------------------------------
def outward(lo: float, hi: float) -> Interval:
    """The numbers next to lo and hi outside; a result of IEEE arithmetic is at most half as far away."""
    lo, hi = math.nextafter(lo, -math.inf), math.nextafter(hi, math.inf)
    need(-LARGEST < lo <= hi < LARGEST, "a coupling leaves the range of numbers followed here")
    return lo, hi


def added(x: Interval, y: Interval) -> Interval:
    """x + y; exact where one of the two ends is 0, or their sum."""
    lo, hi = x[0] + y[0], x[1] + y[1]
    low, high = outward(lo, hi)
    return low if lo and x[0] and y[0] else lo, high if hi and x[1] and y[1] else hi


def negative(x: Interval) -> Interval:
    return -x[1], -x[0]


def times(x: Interval, y: Interval) -> Interval:
    """x y; a product of signs that are known keeps its sign."""
    if NOTHING in (x, y):
        return NOTHING
    if x in (ONE, MINUS):
        return y if x == ONE else negative(y)
    if x[0] >= 0 <= y[0]:
        lo, hi = outward(x[0] * y[0], x[1] * y[1])
        return max(lo, 0.0), hi
    ends = (x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1])
    lo, hi = outward(min(ends), max(ends))
    if x[1] <= 0 and y[1] <= 0:
        lo = max(lo, 0.0)
    elif (x[0] >= 0 and y[1] <= 0) or (x[1] <= 0 and y[0] >= 0):
        hi = min(hi, 0.0)
    return lo, hi


def divided(x: Interval, y: Interval) -> Interval:
    need(y[0] > 0 or y[1] < 0, "a coupling divides by something that may be 0")
    return times(x, outward(1 / y[1], 1 / y[0]))


def power(x: Interval, n: int) -> Interval:
    """x^n for n >= 0 from products, in the order of the binary digits of n."""
    if n % 2 == 0 and x[0] < 0 < x[1]:
        return 0.0, power((max(-x[0], x[1]),) * 2, n)[1]
    if x[0] < x[1]:
        ends = power((x[0],) * 2, n), power((x[1],) * 2, n)
        return min(end[0] for end in ends), max(end[1] for end in ends)
    result, square = ONE, x
    while n:
        result = times(result, square) if n % 2 else result
        n, square = n // 2, times(square, square) if n > 1 else square
    return result


def hull(*parts: Interval) -> Interval:
    return min(part[0] for part in parts), max(part[1] for part in parts)


def quotient(top: int, bottom: int) -> Interval:
    """top / bottom, which Python rounds correctly; bottom > 0."""
    try:
        return outward(top / bottom, top / bottom) if top else NOTHING
    except OverflowError:
        raise Refused("a number leaves the range of numbers followed here") from None


@lru_cache(maxsize=100_000)
def enclosed(x: Fraction) -> Interval:
    small = x.denominator == 1 and abs(x.numerator) < 2**53
    return (float(x), float(x)) if small else quotient(x.numerator, x.denominator)


NOTHING, ONE, MINUS = (0.0, 0.0), (1.0, 1.0), (-1.0, -1.0)
CONTEXT = decimal.Context(prec=22)


def by_digits(name: str, x: float) -> Interval:
    """exp or ln of a number: correct to 22 digits, then to a float, so that the next float is outside."""
    need(abs(x) < 1000 if name == "exp" else x > 0, f"a coupling leaves the numbers for which {name} is known")
    value = float(getattr(CONTEXT, name)(decimal.Decimal(x)))
    lo, hi = outward(value, value)
    return (value, value) if (name, x) in (("exp", 0), ("ln", 1)) else (max(lo, 0.0) if name == "exp" else lo, hi)


def exp(x: float) -> Interval:
    return (0.0, 1e-300) if x < -700 else by_digits("exp", x)  # exp(-700) is just below 1e-304


def whole(x: float) -> int:
    """x as an integer in units of 2^-BITS, within one unit."""
    need(abs(x) < WIDEST, "a coupling takes the sine or the inverse tangent of something too large")
    top, bottom = x.as_integer_ratio()
    return top * UNIT // bottom


def near(z: int) -> Interval:
    """The number that z stands for, within SLACK."""
    return outward((z - SLACK) / UNIT, (z + SLACK) / UNIT)


def sine(z: int) -> Interval:
    """The Taylor series, once whole turns are taken off, which are off by 2^40 units at most; the series by 1000."""
    z -= (z + HALF_TURN) // (2 * HALF_TURN) * 2 * HALF_TURN
    sign, z = -1 if z < 0 else 1, abs(z)
    term, total, n, square = z, z, 1, z * z >> BITS
    while term:
        n += 2
        term = (term * square >> BITS) // (n * (n - 1))
        total += term if n % 4 == 1 else -term
    lo, hi = near(sign * total)
    return max(lo, -1.0), min(hi, 1.0)


def wave(x: Interval, quarter: int) -> Interval:
    """Sine (quarter 0) or cosine (quarter 1): the values at the ends, and 1 or -1 where it turns between them."""
    low, high = (whole(end) + quarter * HALF_TURN // 2 for end in x)
    first = -((HALF_TURN // 2 - low + SLACK) // HALF_TURN)  # it turns at (k + 1/2) pi; wider by SLACK is no harm
    last = (high + SLACK - HALF_TURN // 2) // HALF_TURN
    turns = [((1.0, 1.0), (-1.0, -1.0))[k % 2] for k in range(first, last + 1)[:2]]
    return hull(sine(low), *turns, *([sine(high)] if low < high else []))


def tangent(x: Interval) -> Interval:
    need(wave(x, 1)[0] > 0 or wave(x, 1)[1] < 0, "a coupling takes a tangent where there may be none")
    return growing(lambda z: divided(wave((z, z), 0), wave((z, z), 1)), x)


def arctangent(x: float) -> Interval:
    """atan x = 2 atan(x / (1 + sqrt(1 + x^2))), three times, makes |x| < 1/5; then the Taylor series."""
    z = abs(whole(x))
    for _ in range(3):
        z = z * UNIT // (UNIT + math.isqrt(UNIT * UNIT + z * z))
    total, term, n = z, z, 1
    while term:
        n, term = n + 2, term * (z * z >> BITS) >> BITS
        total += term // n if n % 4 == 1 else -term // n
    return near(8 * total if x > 0 else -8 * total)


def hyperbolic_tangent(x: float) -> Interval:
    t = exp(-2 * abs(x))  # a product with 2 is exact
    value = divided(added(ONE, negative(t)), added(ONE, t))
    return value if x >= 0 else negative(value)


def hyperbolic(x: float, cosine: bool) -> Interval:
    return times((0.5, 0.5), added(exp(x), exp(-x) if cosine else negative(exp(-x))))


def root(x: float) -> Interval:
    need(x >= 0, "a coupling takes the square root of something that may be negative")
    return outward(math.sqrt(x), math.sqrt(x)) if x else NOTHING


def growing(at: Callable[[float], Interval], x: Interval) -> Interval:
    """A nondecreasing function on x, from its values at points."""
    low = at(x[0])
    return low if x[0] == x[1] else (low[0], at(x[1])[1])


def absolute(x: Interval) -> Interval:
    return max(x[0], -x[1], 0.0), max(-x[0], x[1])


def hyperbolic_cosine(x: Interval) -> Interval:
    return growing(lambda z: hyperbolic(z, True), absolute(x))


def rest(x: Interval) -> Interval:
    """1 - x for a number x that is at most 1."""
    lo, hi = added(ONE, negative(x))
    return max(lo, 0.0), hi


# Every function of one argument: its values, and its derivative from the argument x and the value f.
FUNCTIONS: dict[str, tuple[Callable[[Interval], Interval], Callable[[Interval, Interval], Interval]]] = {
    "exp": (partial(growing, exp), lambda x, f: f),
    "log": (partial(growing, partial(by_digits, "ln")), lambda x, f: divided(ONE, x)),
    "sqrt": (partial(growing, root), lambda x, f: divided((0.5, 0.5), f)),
    "sin": (lambda x: wave(x, 0), lambda x, f: wave(x, 1)),
    "cos": (lambda x: wave(x, 1), lambda x, f: negative(wave(x, 0))),
    "tan": (tangent, lambda x, f: added(ONE, power(f, 2))),
    "atan": (partial(growing, arctangent), lambda x, f: divided(ONE, added(ONE, power(x, 2)))),
    "tanh": (partial(growing, hyperbolic_tangent), lambda x, f: rest(power(f, 2))),
    "sinh": (partial(growing, lambda x: hyperbolic(x, False)), lambda x, f: hyperbolic_cosine(x)),
    "cosh": (hyperbolic_cosine, lambda x, f: growing(lambda z: hyperbolic(z, False), x)),
    "abs": (absolute, lambda x, f: ONE if x[0] >= 0 else MINUS if x[1] <= 0 else (-1.0, 1.0)),
}


# --- Couplings on intervals: values and slopes (Clarke's at a kink) ---------------------------------------------------
def plus_jet(x: Jet, y: Jet) -> Jet:
    slopes = tuple(map(added, x[1], y[1])) if x[1] and y[1] else x[1] or y[1]
    return added(x[0], y[0]), slopes


def variables(box: list[Interval]) -> list[Jet]:
    return [(y, tuple(ONE if k == own else NOTHING for k in range(len(box)))) for own, y in enumerate(box)]


def minus_jet(x: Jet) -> Jet:
    return negative(x[0]), tuple(map(negative, x[1]))


def scaled(factor: Interval, slopes: tuple[Interval, ...]) -> tuple[Interval, ...]:
    return tuple([times(factor, slope) for slope in slopes])


def times_jet(x: Jet, y: Jet) -> Jet:
    left, right = scaled(y[0], x[1]), scaled(x[0], y[1])
    return times(x[0], y[0]), tuple(map(added, left, right)) if left and right else left or right


def divided_jet(x: Jet, y: Jet) -> Jet:
    inverse = divided(ONE, y[0])
    return times_jet(x, (inverse, scaled(negative(power(inverse, 2)), y[1])))


def power_jet(n: int, x: Jet) -> Jet:
    if n < 0:
        return divided_jet((ONE, ()), power_jet(-n, x))
    slopes = scaled(times((float(n),) * 2, power(x[0], n - 1)), x[1]) if x[1] and n else ()
    return power(x[0], n), slopes


def function_jet(name: str, x: Jet) -> Jet:
    function, derivative = FUNCTIONS[name]
    value = function(x[0])
    return value, scaled(derivative(x[0], value), x[1]) if x[1] else ()


def least(x: Jet, *others: Jet) -> Jet:
    for y in others:
        value = min(x[0][0], y[0][0]), min(x[0][1], y[0][1])
        if x[0][1] <= y[0][0] or y[0][1] <= x[0][0]:
            x = (value, x[1] if x[0][1] <= y[0][0] else y[1])
        else:
            size = max(len(x[1]), len(y[1]))
            x = (value, tuple(map(hull, x[1] or (NOTHING,) * size, y[1] or (NOTHING,) * size)))
    return x


def greatest(*x: Jet) -> Jet:
    return minus_jet(least(*map(minus_jet, x)))


OPERATIONS: dict[type, Callable[[Jet, Jet], Jet]] = {
    ast.Add: plus_jet,
    ast.Sub: lambda x, y: plus_jet(x, minus_jet(y)),
    ast.Mult: times_jet,
    ast.Div: divided_jet,
}
SEVERAL: dict[str, Callable[..., Jet]] = {
    "min": least,
    "max": greatest,
    "clip": lambda y, lo, hi: greatest(lo, least(y, hi)),
}


class Formula:
    """An expression of the problem, which checker.py has read already, as a list of steps: every step takes jets with
    the numbers named in it; a constant is a step without operation."""

    def __init__(self, source: str, names: list[str]) -> None:
        self.source, self.names = source.strip(), names
        self.steps: list[tuple[Callable[..., Jet] | None, Any]] = []
        self.result = self.step(ast.parse(self.source, mode="eval").body)

    def constant(self, value: Interval) -> int:
        return self.append(None, (value, ()))

    def append(self, operation: Callable[..., Jet] | None, arguments: Any) -> int:
        """A new step; one that depends on constants only is done at once."""
        size = len(self.names)
        known = operation is not None and all(k >= size and self.steps[k - size][0] is None for k in arguments)
        value = operation(*(self.steps[k - size][1] for k in arguments)) if operation and known else arguments
        self.steps.append((None if known else operation, value))
        return size + len(self.steps) - 1

    def step(self, node: ast.expr) -> int:
        """The number of the jet that a part of the expression is."""
        match node:
            case ast.Constant():
                return self.constant(enclosed(rational(self.source[node.col_offset : node.end_col_offset])))
            case ast.Name(id="pi"):
                return self.constant(quotient(HALF_TURN, UNIT))
            case ast.Name(id=name):
                return self.names.index(name)
            case ast.UnaryOp(operand=operand):
                return self.append(minus_jet, (self.step(operand),))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                exponent = int(self.source[right.col_offset : right.end_col_offset])
                return self.append(partial(power_jet, exponent), (self.step(left),))
            case ast.BinOp():
                chain, first = list[ast.BinOp](), cast(ast.expr, node)  # a long sum leans to the left
                while isinstance(first, ast.BinOp) and not isinstance(first.op, ast.Pow):
                    chain, first = [first, *chain], first.left
                place = self.step(first)
                for part in chain:
                    place = self.append(OPERATIONS[type(part.op)], (place, self.step(part.right)))
                return place
            case ast.Call(func=ast.Name(id=name), args=arguments):
                operation = SEVERAL.get(name, partial(function_jet, name))
                return self.append(operation, tuple(map(self.step, arguments)))
        raise Refused("an expression holds something that the grammar does not know")

    def at(self, *variables: Jet) -> Jet:
        jets = list(variables)
        for operation, arguments in self.steps:
            jets.append(arguments if operation is None else operation(*[jets[k] for k in arguments]))
        return jets[self.result]


# --- One scalar coupling, h or its mirror image -h(-y), and where it rises and falls ----------------------------------
class Cell(NamedTuple):
    """h rises (1) or falls (-1) on [lo, hi], or it is not known (0); there it is at most ``top``."""

    lo: float
    hi: float
    way: int
    top: float


class Curve:
    """h for the upper face, -h(-y) for the lower one."""

    def __init__(self, formula: Formula, mirrored: bool) -> None:
        self.formula, self.mirrored, self.points = formula, mirrored, dict[float, float]()
        self.table: list[Cell] = []

    def at(self, y: Interval) -> tuple[Interval, Interval]:
        """Values and slopes on y."""
        value, slopes = self.formula.at((negative(y) if self.mirrored else y, (ONE,)))
        return negative(value) if self.mirrored else value, slopes[0] if slopes else NOTHING

    def steepest(self, lo: float, hi: float) -> float:
        """An upper bound of h' on [lo, hi]: the piece with the largest one is halved until a point comes close."""
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

    def top(self, y: float) -> float:
        """An upper bound of h at a point."""
        if y == 0:
            return 0.0  # checker.py has found that h(0) = 0
        if y not in self.points:
            value, _ = self.formula.at(((-y, -y) if self.mirrored else (y, y), ()))
            self.points[y] = -value[0] if self.mirrored else value[1]
        return self.points[y]

    def cells(self, lo: float, hi: float, halvings: int) -> Iterator[Cell]:
        value, slope = self.at((lo, hi))
        way = 1 if slope[0] >= 0 else -1 if slope[1] <= 0 else 0
        middle = (lo + hi) / 2
        if way or not halvings or not lo < middle < hi:
            yield Cell(lo, hi, way, value[1])
        else:
            yield from (*self.cells(lo, middle, halvings - 1), *self.cells(middle, hi, halvings - 1))

    def prepare(self, lo: float, hi: float) -> None:
        """The table of cells from lo < 0 to hi >= 0, those that rise or fall merged with their neighbours."""
        self.table = []
        sides = [(a, b) for a, b in ((lo, 0.0), (0.0, hi)) if a < b]  # couplings like to have their kink at 0
        for cell in (cell for a, b in sides for cell in self.cells(a, b, CELLS)):
            joined = bool(self.table) and cell.way != 0 and self.table[-1].way == cell.way
            self.table.append(Cell(self.table.pop().lo, cell.hi, cell.way, math.inf) if joined else cell)

    def between(self, lo: float, hi: float) -> list[Cell]:
        """The cells of the table between two numbers."""
        first = bisect_right(self.table, lo, key=itemgetter(0)) - 1
        return self.table[max(0, first) : bisect_left(self.table, hi, key=itemgetter(0))]


# --- Rows: sum of w sup {h(y): -s p <= y <= s q} <= s c for all s in (0, rho] -----------------------------------------
class Term(NamedTuple):
    """One arc in a row: p = v_i + v_j and q = v_j - v_i."""

    curve: Curve
    w: Interval
    p: Interval
    q: Interval


class Bound(NamedTuple):
    """An upper bound of a function of s on a piece: not below ``low``, at most ``high``, its values and slopes."""

    low: float
    high: float
    at: Callable[[float], float]
    slope: Interval


def total(parts: Iterable[Interval]) -> Interval:
    return reduce(added, parts, NOTHING)


def below(a: float, b: float, at: Callable[[float], float], slope: Interval) -> bool:
    """True if F <= 0 on the piece: it lies below F(a) + (s - a) sup F' and below F(b) - (b - s) inf F'."""
    (low, high), start = slope, at(a)
    if high <= 0:
        return start <= 0
    end = at(b)
    if low >= 0:
        return end <= 0
    lines = [times((-low, -low), (start, start)), times((high, high), (end, end))]
    return total([*lines, times(times((-low, -low), (high, high)), added((b, b), (-a, -a)))])[1] <= 0  # where they meet


def throughout(rho: float, settled: Callable[[float, float], bool]) -> bool:
    """Cut (0, rho] until every piece is settled."""
    left, done = [(0.0, rho)], 0
    while left:
        a, b = left.pop()
        middle, done = (a + b) / 2, done + 1
        if not settled(a, b):
            if done > PIECES or not a < middle < b:
                return False
            left += [(middle, b), (a, middle)]
    return True


def row_settled(terms: list[Term], c: Interval, a: float, b: float) -> bool:
    """True if a row is shown for a < s <= b."""
    bounds = [supremum(term, a, b) for term in terms]

    def at(s: float) -> float:
        tops = [(bound.at(s),) * 2 for bound in bounds]
        return total([*(times(term.w, top) for term, top in zip(terms, tops, strict=True)), times((-s, -s), c)])[1]

    slopes = [times(term.w, bound.slope) for term, bound in zip(terms, bounds, strict=True)]
    return below(a, b, at, total([*slopes, negative(c)]))


def supremum(term: Term, a: float, b: float) -> Bound:
    """Of sup {h(y): -s p <= y <= s q} for a < s <= b: it is taken at one of the ends, or at a summit between them."""
    curve, left, last = term.curve, times((b, b), negative(term.p))[0], max(times((s, s), term.q)[1] for s in (a, b))
    cells = curve.between(left, last)
    if len(cells) == 1 and cells[0].way == 1:
        return follow(curve, term.q, a, b, rising=True)
    if a == 0:  # h(y) = g y with a slope g: at most s max (-g p, g q)
        slope = curve.at((left, max(0.0, last)))[1]
        steepest = max(times(slope, side)[1] for side in (negative(term.p), term.q))
        return Bound(-math.inf, math.inf, lambda s: times((s, s), (steepest,) * 2)[1], (steepest,) * 2)
    # The largest value between two cells, or in one that is not known to rise or fall.
    tops = [curve.top(one.hi) for one, other in pairwise(cells) if one.way == 1 and other.way == -1]
    tops += [cell.top for cell in cells if not cell.way]
    bounds = [follow(curve, side, a, b) for side in (term.q, negative(term.p))]
    bounds += [Bound(-math.inf, max(tops), lambda _: max(tops), NOTHING)] if tops else []
    floor = max(bound.low for bound in bounds)
    bounds = [bound for bound in bounds if bound.high >= floor]  # the others are never the largest
    slopes = hull(*(bound.slope for bound in bounds))
    return Bound(floor, math.inf, lambda s: max(bound.at(s) for bound in bounds), slopes)


def follow(curve: Curve, side: Interval, a: float, b: float, rising: bool = False) -> Bound:
    """h(s side) for a <= s <= b."""
    value, slope = curve.at(hull(times((a, a), side), times((b, b), side)))

    def at(s: float) -> float:
        y = times((s, s), side)
        return curve.top(y[1]) if rising or y[0] == y[1] else curve.at(y)[0][1]

    return Bound(value[0], value[1], at, times(side, slope))


# --- The claims -------------------------------------------------------------------------------------------------------
def semidefinite(X: Matrix) -> bool:
    """True iff the symmetric matrix X is positive semidefinite: elimination in rational numbers."""
    while X:
        (top, *rest), *rows = X
        if top < 0 or (top == 0 and any(rest)):
            return False
        X = [[x - row[0] * y / top if top else x for x, y in zip(row[1:], rest, strict=True)] for row in rows]
    return True


def identity(size: int, factor: Fraction) -> Matrix:
    return [[factor * (i == j) for j in range(size)] for i in range(size)]


def positive_vector(size: int) -> Callable[[Any], tuple[list[int], int]]:
    """The shape of n positive numbers, rationals or doubles in base64; it makes them integers over one integer."""

    def shape(value: Any) -> tuple[list[int], int]:
        if type(value) is dict:
            data = read(value, {"float64": text}).float64
            try:
                doubles = struct.unpack(f"<{size}d", base64.b64decode(data, validate=True))
            except (binascii.Error, ValueError, struct.error):
                raise Refused(f"a block of doubles does not hold {size} of them in base64") from None
            need(all(0 < x < math.inf for x in doubles), "an entry of v is no positive number")
            v = list(map(Fraction, doubles))
        else:
            v = list(read(value, (rational,) * size))
            short(v, VECTOR_BITS)
        need(min(v) > 0, "an entry of v is not positive")
        bottom = math.lcm(*{x.denominator for x in v})
        return [int(x * bottom) for x in v], bottom

    return shape


def room(problem: Any, lemma: Any) -> Fraction:
    """The least -(U v)_i / v_i for the vector v beside a proved Lemma 1, where U >= Lambda has its entries beside the
    diagonal taken by their sizes: every eigenvalue of Lambda is at most minus that."""
    v, _ = read(lemma.exact, {"v": positive_vector(problem.n * problem.m)}).v
    need(type(lemma.exact["v"]) is dict, "the vector is no block of doubles")
    rows: list[dict[int, Fraction]] = problem.bound(lemma.mode)
    least: Fraction = min(
        sum((-abs(x) * v[j] for j, x in row.items() if j != i), -row[i] * v[i]) / v[i] for i, row in enumerate(rows)
    )
    return least


class Decisions:
    """The regional claims of one certificate."""

    def __init__(self, case: Any) -> None:
        self.case, self.problem, p = case, case.problem, case.problem
        self.curves, self.formulas = dict[Any, Curve](), dict[Any, Formula]()
        self.exceptions = {tuple(each.arc): each.h for each in p.file.coupling.exceptions}
        self.least = [
            min([k[c][c] - sum(map(abs, k[c][:c] + k[c][c + 1 :])) for c in range(p.m)]) if k else ZERO
            for k in map(p.gains.get, range(p.n))
        ]
        self.most = [max(k[c][c] for c in range(p.m)) if k else ZERO for k in map(p.gains.get, range(p.n))]
        self.heard: dict[str, list[list[tuple[Any, Fraction, int]]]] = {}
        for mode, arcs in p.modes.items():
            self.heard[mode] = [[] for _ in range(p.n)]
            for i, j, w in arcs:
                self.heard[mode][i].append((self.exceptions.get((i, j), p.file.coupling.h), w, j))

    def confirm(self, check: Any) -> None:
        """Decide a claim that is proved or refuted."""
        p, proved = self.problem, check.verdict == "proved"
        need(check.margin is None, "it has no margin to claim")
        need(p.q == 0 or self.case.W is not None, "there is no observer gain")
        if check.id not in ("lure", "equilibrium"):
            need(all(len(h) == 1 for h in (p.file.coupling.h, *self.exceptions.values())), "a coupling is a list")
        if proved:
            need(check.witness is None, "it is proved and carries a witness")
        else:
            need(check.domain == p.domain, "the domain is wrong")
            need(check.rate is None and check.verdict == "refuted", "it is refuted and claims a rate")
            need(check.id in ("max-separable", "equilibrium"), "it cannot be refuted")
        name = "stuck" if check.id == "max-separable" and not proved else check.id.replace("-", "_")
        getattr(self, name)(check)  # lure, exhaustive and settling: in quadratic_checker.py

    def covers(self, check: Any) -> bool:
        """True if the box or ball of a proved check holds the region that is asked for."""
        p, domain = self.problem, check.domain
        if p.region is None or check.id not in ("max-separable", "lure", "exhaustive"):
            return False
        if domain == "global":
            return True
        sides = [
            max(abs(end - goal[c]) for goal in p.goals for end in side)
            for c, side in enumerate(p.region.initial_states)
        ]
        square = max(sides) ** 2 if domain.kind == "box" else p.n * sum(side**2 for side in sides)
        return bool(domain.radius**2 >= square and domain.disturbance >= (p.region.initial_disturbance or 0))

    def stuck(self, check: Any) -> None:
        """Agents each of which has, in some mode, no gain that holds it and hears nobody outside the set."""
        p, witness = self.problem, read(check.witness, {"kind": text, "labels": [text]})
        need(check.exact is None, "it is refuted and claims a value")
        need(witness.kind == "agents", "the witness is no set of agents")
        group = set(witness.labels)
        known = group <= set(p.labels) and len(group) == len(witness.labels)
        need(bool(group) and known, "the witness does not name different agents of the problem")
        for i in (i for i, label in enumerate(p.labels) if label in group):
            inside = any(all(p.labels[j] in group for _, _, j in heard[i]) for heard in self.heard.values())
            need(self.least[i] <= 0 and inside, "an agent of the witness is held, or hears somebody outside")

    # --- max-separable
    def separable(self, exact: Any) -> Any:
        """What a proved max-separable claims; its pace is the rate that follows."""
        p = self.problem
        shape: dict[str, Any] = {"v": positive_vector(p.n), "alpha": rational, "rho": maybe(rational)}
        if p.q:
            shape |= {"P": matrix(p.q, p.q), "beta": rational, "kappa": rational, "size": rational}
        claim = read(exact, shape)
        claim.tops, claim.bottom = claim.v
        claim.lowest = Fraction(min(claim.tops), claim.bottom)
        need(p.q == 0 or claim.kappa > 0, "kappa is not positive")
        claim.pace = min(claim.alpha, claim.beta - 1 / (claim.kappa * claim.lowest)) if p.q else claim.alpha
        return claim

    def max_separable(self, check: Any) -> None:
        claim = self.separable(check.exact)
        need(check.rate is not None and 0 < check.rate <= claim.pace, "the rate is not between 0 and what follows")
        self.contains(claim, check.domain)

    def contains(self, claim: Any, domain: Any) -> None:
        """The rows, the observer's part, and all starts of the domain."""
        if self.problem.q:
            self.composite(claim)
        if claim.rho is None:
            need(domain == "global" == self.problem.domain, "it has no rho and is not global")
        else:
            self.start(domain, "box")
            room, s = claim.rho - domain.radius / claim.lowest, domain.disturbance
            need(room >= 0, "the box leaves the region")
            need(s == 0 or (claim.kappa * s) ** 2 * claim.size <= room**2, "the disturbance leaves the region")
        self.rows(claim, claim.alpha, Fraction(1))

    def start(self, domain: Any, kind: str) -> None:
        """A box or ball of starts."""
        good = type(domain) is not str and domain.kind == kind and None not in (domain.radius, domain.disturbance)
        need(good, f"the domain is no {kind}")
        need(domain.radius > 0 and domain.disturbance >= 0, f"the {kind} is empty")
        need(self.problem.q > 0 or domain.disturbance == 0, "there is a disturbance, but no exosystem")

    def composite(self, claim: Any) -> None:
        """The observer's part: |C eps_i| <= E = max sqrt(eps_i'P eps_i), which decays at the rate beta."""
        P, C, q = claim.P, self.problem.C, self.problem.q
        short((x for row in P for x in row), MATRIX_BITS)
        need(transpose(P) == P and definite(P, 1), "P > 0 is not shown")
        half = product(P, self.case.closed(claim.beta))
        need(semidefinite(plus(identity(q, ZERO), -1, plus(half, 1, transpose(half)))), "beta is not shown")
        need(all(semidefinite(plus(P, -1, product(transpose([c]), [c]))) for c in C), "c'c <= P is not shown")
        need(semidefinite(plus(identity(q, claim.size), -1, P)), "P <= size I is not shown")

    def formula(self, h: Any, c: int) -> Formula:
        """Component c of a coupling."""
        if (h, c) not in self.formulas:
            self.formulas[h, c] = Formula(h[c % len(h)], ["y"] if len(h) == 1 else [f"y{d + 1}" for d in range(len(h))])
        return self.formulas[h, c]

    def curve(self, h: Any, mirrored: bool) -> Curve:
        if (h, mirrored) not in self.curves:
            self.curves[h, mirrored] = Curve(self.formula(h, 0), mirrored)
        return self.curves[h, mirrored]

    def rows(self, claim: Any, alpha: Fraction, theta: Fraction) -> None:
        """Both faces of all rows, equal ones once; v_j counts theta times."""
        tops, bottom = [theta.numerator * x for x in claim.tops], theta.denominator * claim.bottom
        rows: dict[Any, int] = {}
        for i, heard in ((i, heard[i]) for heard in self.heard.values() for i in range(self.problem.n)):
            own = claim.tops[i] * theta.denominator
            rows.setdefault((own, self.least[i], tuple(sorted((h, w, tops[j]) for h, w, j in heard))), i)
        self.prepare(claim, [(h, own, top) for own, _, heard in rows for h, _, top in heard], bottom, False)
        for key, i in rows.items():
            c = (self.least[i] - alpha) * key[0]
            good = self.linear_row(key, c) or (
                claim.rho is not None and all(self.row(key, c, bottom, claim.rho, face) for face in (False, True))
            )
            need(good, f"the row of agent {self.problem.labels[i]} is not shown")

    def prepare(self, claim: Any, arcs: list[tuple[Any, int, int]], bottom: int, wide: bool) -> None:
        """Tables of all couplings, as far as the arcs need them: to v_j - v_i, or (``wide``) to v_i + v_j as well."""
        reach: dict[Any, tuple[int, int]] = {}
        for h, own, other in arcs:
            p, q = reach.get(h, (0, 0))
            reach[h] = max(p, own + other), max(q, own + other if wide else other - own)
        for h, face in ((h, face) for h in reach for face in (False, True) if claim.rho is not None):
            low, high = (times(enclosed(claim.rho), quotient(x, bottom))[1] for x in reach[h])
            self.curve(h, face).prepare(-low, high)

    def linear_row(self, key: Any, c: Fraction) -> bool:
        """True if a row of linear couplings holds: its two faces are the same, and s does not matter."""
        own, _, heard = key
        if not all(self.straight(h) for h, _, _ in heard):
            return False
        tops = [
            w * max(g * y for g in (slope.lo, slope.hi) for y in (top - own, -top - own))
            for slope, w, top in ((self.slope(h, 0, 0), w, top) for h, w, top in heard)
        ]
        return sum(tops, ZERO) <= c

    def row(self, key: Any, c: Fraction, bottom: int, rho: Fraction, mirrored: bool) -> bool:
        own, _, heard = key
        unit = max(Fraction(1), *(x / 2**400 for x in (abs(c) / bottom, *(w for _, w, _ in heard))))  # for huge ones
        terms = [
            Term(self.curve(h, mirrored), enclosed(w / unit), *(quotient(top + y, bottom) for y in (own, -own)))
            for h, w, top in heard
        ]
        return throughout(enclosed(rho)[1], partial(row_settled, terms, enclosed(c / bottom / unit)))

    def slope(self, h: Any, c: int, d: int) -> Number:
        return read_coupling(h, self.problem.m).slopes.get((c, d), Number(ZERO, ZERO))

    def straight(self, h: Any) -> bool:
        coupling = read_coupling(h, self.problem.m)
        return coupling.linear and not coupling.kinked

    # --- delay and sampling
    def beside(self, check: Any) -> Any:
        """The proved max-separable with the same domain."""
        found = [each for each in self.case.checks if each.id == "max-separable" and each.verdict == "proved"]
        need(any(each.domain == check.domain for each in found), "no max-separable with this domain is proved")
        return self.separable(found[0].exact)

    def delay(self, check: Any) -> None:
        claim = self.beside(check)
        exact = read(check.exact, {"delay": rational, "rate": rational})
        need(exact.delay >= 0, "the delay is negative")
        need(check.rate is not None and 0 < check.rate <= exact.rate, "the rate is not between 0 and that of the rows")
        need(self.problem.q == 0 or exact.rate <= claim.beta, "the rate is larger than that of the observer")
        x = exact.delay * exact.rate
        theta = by_decimal("exp", Number(x, x)).hi
        self.rows(claim, exact.rate, Fraction(math.ceil(theta * 2**60), 2**60))

    def sampling(self, check: Any) -> None:
        claim = self.beside(check)
        exact = read(check.exact, {"period": rational, "factor": rational, "certificate?": an_object})
        need(check.rate is None, "it has no rate to claim")
        if exact.certificate is not None:
            claim = self.separable(exact.certificate)
            need(claim.pace > 0, "its own certificate has no rate")
            self.contains(claim, check.domain)
        need(1 - exact.period * claim.alpha <= exact.factor < 1, "the factor does not follow from the period")
        pairs = ((claim.tops[i], arc) for heard in self.heard.values() for i, arcs in enumerate(heard) for arc in arcs)
        self.prepare(claim, [(h, own, claim.tops[j]) for own, (h, _, j) in pairs], claim.bottom, True)
        seen: dict[Any, Fraction] = {}

        def short(i: int, arcs: Any, mirrored: bool, closely: bool) -> bool:
            steepest = self.most[i]  # in rational numbers: periods like 1 are often the largest ones
            for h, w, j in arcs:
                key = (h, mirrored, claim.tops[i], claim.tops[j], closely)
                if key not in seen:
                    seen[key] = self.steepness(claim, *key)
                steepest += w * seen[key]
            return bool(exact.period * steepest <= 1)

        for heard in self.heard.values():
            for i, arcs in enumerate(heard):
                for mirrored in (False, True):
                    late = f"the period is too long for agent {self.problem.labels[i]}"
                    need(any(short(i, arcs, mirrored, closely) for closely in (False, True)), late)

    def steepness(self, claim: Any, h: Any, mirrored: bool, own: int, other: int, closely: bool) -> Fraction:
        """An upper bound of L: eight slices of x, the supremum of h' over each of the growing intervals."""
        if claim.rho is None:
            return max(ZERO, self.slope(h, 0, 0).hi)
        rho, curve, bottom = enclosed(claim.rho)[1], self.curve(h, mirrored), claim.bottom
        p, q = (times((rho, rho), quotient(y, bottom)) for y in (own + other, other - own))
        rises = all(cell.way == 1 for cell in curve.between(-p[1], p[1]))
        left, slope, mean = min(q[0], 0.0) if rises else -p[1], 0.0, ZERO
        for k in range(9):
            right = max(0.0, times((rho, rho), quotient(4 * (other - own) + k * own, 4 * bottom))[1])
            for a, b in pairwise([left + (right - left) * part / 4 for part in range(4)] + [right]):
                slope = max(slope, curve.steepest(a, max(a, b)) if closely else curve.at((a, max(a, b)))[1][1])
            mean += Fraction(slope) / 8 if k else 0
            left = right
        return mean

    # --- equilibrium
    def forces(self, mode: str, e: list[list[Fraction]]) -> tuple[list[Interval], list[dict[int, Interval]]]:
        """h(e) - K e and its slopes for all e in a box."""
        p, m = self.problem, self.problem.m
        values, slopes = [NOTHING] * len(e), [dict[int, Interval]() for _ in e]

        def act(row: int, w: Interval, value: Interval, parts: Iterable[tuple[int, Interval]]) -> None:
            values[row] = added(values[row], times(w, value))
            for column, slope in parts:
                slopes[row][column] = added(slopes[row].get(column, NOTHING), times(w, slope))

        arcs = [(i, *arc) for i, heard in enumerate(self.heard[mode]) for arc in heard]
        for i, h, w, j, c in ((*arc, c) for arc in arcs for c in range(m)):
            places = [(i * m + d, j * m + d) for d in ([c] if len(h) == 1 else range(m))]
            y = [(enclosed(e[b][0] - e[a][1])[0], enclosed(e[b][1] - e[a][0])[1]) for a, b in places]
            value, parts = self.formula(h, c).at(*variables(y))
            both = list(zip(places, parts or [NOTHING] * len(y), strict=True))
            act(i * m + c, enclosed(w), value, [(b, slope) for (_, b), slope in both])
            act(i * m + c, enclosed(-w), NOTHING, [(a, slope) for (a, _), slope in both])
        for i, c, d in ((i, c, d) for i in p.gains for c in range(m) for d in range(m)):
            a = i * m + d
            act(i * m + c, enclosed(-p.gains[i][c][d]), hull(*map(enclosed, e[a])), [(a, ONE)])
        return values, slopes

    def equilibrium(self, check: Any) -> None:
        """Krawczyk: c - Y f(c) + (I - Y F'(X)) (X - c) inside X, so that f vanishes somewhere in X."""
        p, size = self.problem, self.problem.n * self.problem.m
        need(size <= EQUATIONS, f"an equilibrium is looked at up to {EQUATIONS} equations")
        exact = read(check.exact, {"mode": text, "box": ((rational, rational),) * size})
        need(exact.mode in p.modes, "there is no such mode")
        middle = [(lo + hi) / 2 for lo, hi in exact.box]
        need(same(check.witness, {"kind": "start", "values": middle}), "the witness is not the middle of the box")
        need(any(lo > 0 or hi < 0 for lo, hi in exact.box), "the box contains the target")
        if p.region is not None:
            sides = [(side, goal[c]) for goal in p.goals for c, side in enumerate(p.region.initial_states)]
            for (lo, hi), ((low, high), goal) in zip(exact.box, sides, strict=True):
                need(low <= lo + goal and hi + goal <= high, "the box leaves the region")
        (_, slopes), (values, _) = (self.forces(exact.mode, e) for e in (exact.box, [[x, x] for x in middle]))
        rough = [[Fraction(round(sum(row.get(k, NOTHING)) * 2**30), 2**31) for k in range(size)] for row in slopes]
        rows, _ = echelon([x + unit for x, unit in zip(rough, identity(size, Fraction(1)), strict=True)])
        for a, (lo, hi) in enumerate(exact.box):
            factors = [enclosed(-x) for x in rows[a][size:]]
            parts = [enclosed(middle[a]), *map(times, factors, values)]
            rest = {k: [ONE] * (k == a) for k in range(size)}
            for factor, row in zip(factors, slopes, strict=True):
                for k, slope in row.items():
                    rest[k].append(times(factor, slope))
            for k, each in rest.items():
                half = enclosed((exact.box[k][1] - exact.box[k][0]) / 2)[1]
                parts.append(times(total(each), (-half, half)))
            image = total(parts)
            need(lo < Fraction(image[0]) and Fraction(image[1]) < hi, "the box is not shown to hold an equilibrium")
