"""The lone checker: decides every claim of certificate.json again, from problem.json and nothing else.

    python -I -S checker.py certificate.json problem.json

Standard library only, nothing of the package: written from docs/certificate-format.md alone, to be read in an evening
by somebody who does not trust the rest. The problem is trusted, the certificate is not. Every decision is made in
rational arithmetic; floating point only proposes a vector, which is then checked. Files beside this one decide what not
every certificate has: region_checker.py and quadratic_checker.py regions and long vectors, groups_checker.py groups.
Exit code 0: every claim holds. 1: one does not, or could not be confirmed. 2: a file cannot be read.
"""

from __future__ import annotations

import ast
import decimal
import hashlib
import json
import math
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, partial
from importlib.util import module_from_spec, spec_from_file_location
from itertools import pairwise, zip_longest
from operator import add, mul, sub, truediv
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

# The length of this file is counted, so its lines are set by hand.


__all__ = ["MAX_BYTES", "Refused", "examine", "main"]

MAX_BYTES, MAX_DIGITS = 16 * 2**20, 10_000  # of a file; characters of one number
EXACT_BITS, PRECISION = 1536, 256  # a longer rational in an expression is enclosed; bits of an enclosure
ROOTS_SIZE = 60  # largest matrix whose eigenvalues are counted
VECTOR_BITS, MATRIX_BITS = 2**16, 2**14  # of the common denominator of a vector; of P, and of a designed W
Matrix = list[list[Fraction]]
Rows = list[dict[int, Fraction]]  # a sparse matrix
ZERO = Fraction(0)


class Refused(Exception):
    """A file that is not what the format page describes, or a claim that is not shown."""


def need(condition: bool, message: str) -> None:
    if not condition:
        raise Refused(message)


# --- Enclosed numbers with their slopes: rounded outward to PRECISION bits once they are not exact any more ----------
@dataclass(frozen=True, slots=True)
class Number:
    """A value between lo and hi (exact if they are equal), its slopes (none: constant), its degree as a polynomial
    (inf: it is none), and whether a variable occurs in it."""

    lo: Fraction
    hi: Fraction
    slopes: tuple[Number, ...] = ()
    degree: float = 0
    varies: bool = False

    def __add__(self, other: Number) -> Number:
        degree = max(self.degree, other.degree)
        return number(self.lo + other.lo, self.hi + other.hi, degree, (ONE, self), (ONE, other))

    def __neg__(self) -> Number:
        return number(-self.hi, -self.lo, self.degree, (MINUS, self))

    def __sub__(self, other: Number) -> Number:
        return self + -other

    def __mul__(self, other: Number) -> Number:
        ends = (self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi)
        return number(min(ends), max(ends), self.degree + other.degree, (other, self), (self, other))

    def __truediv__(self, other: Number) -> Number:
        need(other.lo > 0 or other.hi < 0, "a coupling divides by something that may be 0")
        x = number(1 / other.hi, 1 / other.lo)
        return self * number(x.lo, x.hi, math.inf if other.degree else 0, (MINUS * x * x, other))

    def __pow__(self, n: int) -> Number:
        if n < 0:
            return ONE / self**-n
        ends, degree = (self.lo**n, self.hi**n), math.inf if self.degree == math.inf else self.degree * n
        low = ZERO if n > 0 == n % 2 and self.lo <= 0 <= self.hi else min(ends)
        factor = point(n) * Number(self.lo, self.hi) ** (n - 1) if n and self.slopes else point(0)
        return number(low, max(ends), degree, (factor, self))


def bits(x: Fraction) -> int:
    """About the binary logarithm of |x|: 2^(bits - 1) < |x| < 2^(bits + 1)."""
    return x.numerator.bit_length() - x.denominator.bit_length()


def number(lo: Fraction, hi: Fraction, degree: float = 0, *parts: tuple[Number, Number]) -> Number:
    """A value between lo and hi whose slopes are the sum of factor * slopes over the parts (factor, number)."""
    need(all(x == 0 or abs(bits(x)) < 2**15 for x in (lo, hi)), "a coupling leaves the range of numbers followed here")
    if lo != hi or max(lo.numerator.bit_length(), lo.denominator.bit_length()) > EXACT_BITS:
        below, above = Fraction(2) ** (bits(lo) - PRECISION), Fraction(2) ** (bits(hi) - PRECISION)
        lo, hi = math.floor(lo / below) * below, math.ceil(hi / above) * above
    slopes = [[Number(factor.lo, factor.hi) * slope for slope in x.slopes] for factor, x in parts if x.slopes]
    total = tuple(sum(column[1:], column[0]) for column in zip(*slopes, strict=True))
    return Number(lo, hi, total, degree, any(x.varies for _, x in parts))


def point(x: Fraction | int) -> Number:
    return Number(Fraction(x), Fraction(x))


def absolute(x: Number) -> Number:
    return Number(max(x.lo, -x.hi, ZERO), max(-x.lo, x.hi))


def lowest(*x: Number) -> Number:
    return Number(min(each.lo for each in x), min(each.hi for each in x))


def series(term: Number, step: Number, factor: Callable[[int], Fraction]) -> Number:
    """Sum of term, term * step * factor(1), ...; from the 20th on, all the rest is smaller than the last one added."""
    total, n = term, 0
    while n < 20 or absolute(term).hi > Fraction(1, 2**PRECISION):
        n += 1
        term = term * step * point(factor(n))
        total = total + term
    return total + Number(-absolute(term).hi, absolute(term).hi)


def by_decimal(name: str, x: Number) -> Number:
    """exp, ln or sqrt, which the decimal module rounds correctly: one unit further out is outside."""
    root = Fraction(math.isqrt(max(0, x.lo.numerator)), math.isqrt(x.lo.denominator))
    where, value = {"exp": (0, ONE), "ln": (1, point(0)), "sqrt": (root**2, point(root))}[name]
    if x.lo == x.hi == where:
        return value
    inside = {"exp": absolute(x).hi < 2**14, "ln": x.lo > 0, "sqrt": x.lo >= 0}[name]
    need(inside, f"a coupling leaves the numbers for which {name} is known")
    down, up = (decimal.Context(prec=80, rounding=way) for way in (decimal.ROUND_FLOOR, decimal.ROUND_CEILING))
    low = down.next_minus(getattr(down, name)(down.divide(x.lo.numerator, x.lo.denominator)))
    high = up.next_plus(getattr(up, name)(up.divide(x.hi.numerator, x.hi.denominator)))
    return number(Fraction(low), Fraction(high))


def atan(x: Number) -> Number:
    """The inverse tangent: atan x = 2 atan(x / (1 + sqrt(1 + x^2))), twice, makes |x| < 1/2."""
    for _ in range(2):
        x = x / (ONE + by_decimal("sqrt", ONE + x * x))
    return FOUR * series(x, -x * x, lambda n: Fraction(2 * n - 1, 2 * n + 1))


ONE, MINUS, TWO, FOUR = point(1), point(-1), point(2), point(4)
PI, exp = FOUR * atan(ONE), partial(by_decimal, "exp")


def wave(x: Number, first: int) -> Number:
    """Sine (first 1) or cosine (first 0): within half the width of x of the value at its middle."""
    middle, spread = (x.lo + x.hi) / 2, (x.hi - x.lo) / 2
    z = point(middle) - point(2 * round(middle / (2 * PI.lo))) * PI
    value = series(z if first else ONE, -z * z, lambda n: Fraction(1, (2 * n + first) * (2 * n + first - 1)))
    return value + Number(-spread, spread)


def growing(at: Callable[[Number], Number], x: Number) -> Number:
    """A nondecreasing function on x, from its values at points."""
    return Number(at(point(x.lo)).lo, at(point(x.hi)).hi)


def hyperbolic(x: Number, sign: Number) -> Number:
    return growing(lambda z: (exp(z) + sign * exp(-z)) / TWO, x)


# Every function: its derivative from the argument x and the value f (None: it has kinks), how many arguments it takes.
FUNCTIONS: dict[str, tuple[Callable[..., Number], Callable[[Number, Number], Number] | None, int, float]] = {
    "exp": (exp, lambda x, f: f, 1, 1),
    "log": (partial(by_decimal, "ln"), lambda x, f: ONE / x, 1, 1),
    "sqrt": (partial(by_decimal, "sqrt"), lambda x, f: ONE / (f + f), 1, 1),
    "sin": (lambda x: wave(x, 1), lambda x, f: wave(x, 0), 1, 1),
    "cos": (lambda x: wave(x, 0), lambda x, f: -wave(x, 1), 1, 1),
    "tan": (lambda x: wave(x, 1) / wave(x, 0), lambda x, f: ONE + f * f, 1, 1),
    "atan": (lambda x: growing(atan, x), lambda x, f: ONE / (ONE + x * x), 1, 1),
    "tanh": (lambda x: growing(lambda z: ONE - TWO / (exp(z + z) + ONE), x), lambda x, f: ONE - f * f, 1, 1),
    "sinh": (lambda x: hyperbolic(x, MINUS), lambda x, f: hyperbolic(absolute(x), ONE), 1, 1),
    "cosh": (lambda x: hyperbolic(absolute(x), ONE), lambda x, f: hyperbolic(x, MINUS), 1, 1),
    "abs": (absolute, None, 1, 1),
    "min": (lowest, None, 2, math.inf),
    "max": (lambda *x: -lowest(*(-each for each in x)), None, 2, math.inf),
    "clip": (lambda y, lo, hi: -lowest(-lo, -lowest(y, hi)), None, 3, 3),
}

# --- Expressions: Python reads the text (it runs nothing), and whatever is not in the grammar is refused --------------
UNSIGNED = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?0*(?:[0-3]?[0-9]{1,2}|400))?"  # exponents up to 400
OPERATIONS: dict[type, Callable[[Any, Any], Number]] = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv}


class Expression:
    """An expression at 0: its ``value`` with the slopes along ``names``, and whether a kink meets a variable."""

    def __init__(self, source: str, names: list[str]) -> None:
        need(re.fullmatch(r"[a-zE0-9.+*/(), -]{1,2000}", source) is not None, "it is no expression, or it is too long")
        self.source, self.kinked = source.strip(), False
        self.names = {name: Number(ZERO, ZERO, tuple(point(name == each) for each in names), 1, True) for name in names}
        self.names["pi"] = PI
        try:
            self.value = self.read(ast.parse(self.source, mode="eval").body)
        except (SyntaxError, MemoryError, RecursionError):
            raise Refused("an expression does not follow the grammar, or is nested too deeply") from None

    def read(self, node: ast.expr) -> Number:
        segment = self.source[node.col_offset : node.end_col_offset]
        match node:
            case ast.Constant():
                return point(rational(segment))
            case ast.Name(id=name):
                need(name in self.names, "an expression holds a name that the grammar does not know")
                return self.names[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.read(operand)
            case ast.BinOp(left=left, op=ast.Pow(), right=ast.expr(col_offset=start, end_col_offset=end)):
                exponent = re.fullmatch(r"-?[0-9]{1,2}", self.source[start:end])
                need(exponent is not None and abs(int(exponent[0])) <= 64, "an exponent is no integer up to 64")
                return self.read(left) ** int(self.source[start:end])
            case ast.BinOp():
                chain, first = list[ast.BinOp](), cast(ast.expr, node)  # a long sum leans to the left
                while isinstance(first, ast.BinOp) and not isinstance(first.op, ast.Pow):
                    chain, first = [first, *chain], first.left
                value = self.read(first)
                for part in chain:
                    need(type(part.op) in OPERATIONS, "an expression holds an operation that the grammar does not know")
                    value = OPERATIONS[type(part.op)](value, self.read(part.right))
                return value
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self.call(name, [self.read(argument) for argument in arguments])
        raise Refused("an expression holds something that the grammar does not know")

    def call(self, name: str, arguments: list[Number]) -> Number:
        values, varies = [Number(x.lo, x.hi) for x in arguments], any(x.varies for x in arguments)
        degree = math.inf if any(x.degree for x in arguments) else 0
        need(name in FUNCTIONS, "an expression holds a function that the grammar does not know")
        function, derivative, fewest, most = FUNCTIONS[name]
        need(fewest <= len(values) <= most, "a function has the wrong number of arguments")
        value, self.kinked = function(*values), self.kinked or (varies and derivative is None)
        slope = derivative(values[0], value) if derivative and varies and not self.kinked else point(0)
        return number(value.lo, value.hi, degree, *((slope, x) for x in arguments))


class Coupling(NamedTuple):
    """h at 0: linear and kinked as it is written, and its nonzero slopes dh_c/dy_d (none if it is kinked)."""

    linear: bool
    kinked: bool
    slopes: dict[tuple[int, int], Number]


@lru_cache(maxsize=1000)
def read_coupling(h: tuple[str, ...], m: int) -> Coupling:
    """A single expression for every component, or m expressions."""
    names = ["y"] if len(h) == 1 else [f"y{d + 1}" for d in range(m)]
    parts = [Expression(each, names) for each in h]
    need(all(part.value.lo == part.value.hi == 0 for part in parts), "a coupling is not shown to vanish at 0")
    slopes = {(c, d): slope for c, part in enumerate(parts) for d, slope in enumerate(part.value.slopes)}
    if len(h) == 1:
        slopes = {(c, c): slope for c in range(m) for slope in slopes.values()}
    kinked = any(part.kinked for part in parts)
    seen = {place: slope for place, slope in slopes.items() if (slope.lo or slope.hi) and not kinked}
    return Coupling(all(part.value.degree <= 1 for part in parts), kinked, seen)


# --- Matrices over the rationals --------------------------------------------------------------------------------------
def transpose(X: Matrix) -> Matrix:
    return [list(column) for column in zip(*X, strict=True)]


def product(X: Matrix, Y: Matrix) -> Matrix:
    columns = transpose(Y)
    return [[sum(map(mul, row, column), ZERO) for column in columns] for row in X]


def plus(X: Matrix, factor: Fraction | int, Y: Matrix) -> Matrix:
    return [[a + factor * b for a, b in zip(*rows, strict=True)] for rows in zip(X, Y, strict=True)]


def form(u: list[Fraction], X: Matrix, v: list[Fraction]) -> Fraction:
    """The number u'X v."""
    return sum((a * x * b for a, row in zip(u, X, strict=True) for x, b in zip(row, v, strict=True)), ZERO)


def echelon(X: Matrix) -> tuple[Matrix, list[int]]:
    """The nonzero rows of the reduced row echelon form, and the columns of their leading ones."""
    rest, rows, pivots = X, Matrix(), list[int]()
    for column in range(len(X[0]) if X else 0):
        lead = next((row for row in rest if row[column]), None)
        if lead is not None:
            rest = [row for row in rest if row is not lead]
            lead = [entry / lead[column] for entry in lead]
            rest, rows = ([plus([row], -row[column], [lead])[0] for row in block] for block in (rest, rows))
            rows, pivots = [*rows, lead], [*pivots, column]
    return rows, pivots


def nullspace(X: Matrix, size: int) -> tuple[Matrix, list[int]]:
    """A basis of {v: X v = 0} in R^size, one vector per free column, and the free columns."""
    rows, pivots = echelon(X)
    free, row = [column for column in range(size) if column not in pivots], dict(zip(pivots, rows, strict=True))
    return [[-row[k][column] if k in row else Fraction(k == column) for k in range(size)] for column in free], free


def characteristic(X: Matrix) -> list[Fraction]:
    """Coefficients of det(s I - X), highest power first (Faddeev and LeVerrier, in integers)."""
    scale, size = math.lcm(*(entry.denominator for row in X for entry in row)), len(X)
    rows = [[int(entry * scale) for entry in row] for row in X]
    B, coefficients = [[int(i == j) for j in range(size)] for i in range(size)], [Fraction(1)]
    for k in range(1, size + 1):
        columns = list(zip(*B, strict=True))
        B = [[sum(map(mul, row, column)) for column in columns] for row in rows]
        c = -sum(B[i][i] for i in range(size)) // k
        B = [[x + c * (i == j) for j, x in enumerate(row)] for i, row in enumerate(B)]
        coefficients.append(Fraction(c, scale**k))
    return coefficients


def routh(polynomial: list[Fraction]) -> list[Fraction]:
    """Routh's first column, up to its first zero."""
    upper, lower = polynomial[0::2], polynomial[1::2]
    column = upper[:1]
    while lower and column[-1]:
        column.append(lower[0])
        factor = upper[0] / lower[0] if lower[0] else ZERO
        upper, lower = lower, [a - factor * b for a, b in zip_longest(upper[1:], lower[1:], fillvalue=ZERO)]
    return column


def stable(X: Matrix) -> bool:
    """True iff every eigenvalue of X has a negative real part."""
    return min(routh(characteristic(X))) > 0


def unstable(X: Matrix, count: int) -> bool:
    """True if X is seen to have at least ``count`` eigenvalues with positive real part: sign changes in Routh's
    column count the roots to the right of delta >= 0, if no entry of it is 0."""
    polynomial = characteristic(X)
    for delta in (ZERO, *(Fraction(1, 2**k) for k in (0, 2, 4, 8, 16, 32, 64))):
        moved = list(polynomial)
        for k in (k for end in range(len(moved), 1, -1) for k in range(1, end)):
            moved[k] += delta * moved[k - 1]
        column = routh(moved)
        changes = sum(a * b < 0 for a, b in pairwise(column))
        if column[-1] and (changes >= count or delta == 0):
            return changes >= count
    return False


def polynomial_text(polynomial: list[Fraction]) -> str:
    """A polynomial in s as the format writes it."""
    text = ""
    for power, c in zip(range(len(polynomial) - 1, -1, -1), polynomial, strict=True):
        need(max(abs(c.numerator), c.denominator) < 10**4000, "a polynomial has coefficients of more than 4000 digits")
        symbol = "" if power == 0 else "s" if power == 1 else f"s^{power}"
        size = "" if abs(c) == 1 and symbol else f"{abs(c)} "
        text += f" {'-' if c < 0 else '+'} {size}{symbol}".rstrip() if c else ""
    return text.removeprefix(" + ")


# --- Definiteness: True is a proof, False says that there is none here ------------------------------------------------
def definite(X: Matrix, sign: int) -> bool:
    """True only if sign X is positive definite."""
    return positive([{j: sign * x for j, x in enumerate(row)} for row in X])


def positive(M: Rows) -> bool:
    """True only if the symmetric matrix M is positive definite."""
    top = max(row[i] for i, row in enumerate(M))
    if top <= 0 or any(abs(x) > top for row in M for x in row.values()):
        return False
    M = [{j: x / top for j, x in row.items() if x} for row in M]
    signs = all((x > 0) == (i == j) for i, row in enumerate(M) for j, x in row.items())
    if signs and len(M) > 20 and by_vector(M):
        return True
    return any(by_factor(M, bits) for bits in (60, 250, 1000, 4000) if bits * len(M) < 80_000)  # else it takes minutes


def by_vector(M: Rows) -> bool:
    """True if a v > 0 with M v > 0 is found: then M, whose other entries are <= 0, is positive definite.
    Conjugate gradients on M v = 1 propose v in floating point; the check is exact."""
    rows, size = [[(j, float(x)) for j, x in row.items()] for row in M], len(M)
    v, rest, direction, square = [0.0] * size, [1.0] * size, [1.0] * size, float(size)
    for _ in range(min(2 * size, 2000)):
        image = [sum([x * direction[j] for j, x in row]) for row in rows]
        curvature = sum(map(mul, direction, image))
        if curvature <= 0 or max(map(abs, rest)) < 0.25:
            break
        step, last = square / curvature, square
        v = [a + step * b for a, b in zip(v, direction, strict=True)]
        rest = [a - step * b for a, b in zip(rest, image, strict=True)]
        square = sum(map(mul, rest, rest))
        direction = [a + square / last * b for a, b in zip(rest, direction, strict=True)]
    top = max(map(abs, v)) or 1.0
    whole = [round(entry / top * 2**64) if top < math.inf else 0 for entry in v]
    return min(whole) > 0 and all(sum(x * whole[j] for j, x in row.items()) > 0 for row in M)


def by_factor(M: Rows, bits: int) -> bool:
    """True if Cholesky in integers runs to its end for M - shift; the entries of M are at most 1. In units of 2^-bits
    for L and 4^-bits for M, every entry of M - shift - L L' beside the diagonal is a remainder of a division by
    L_jj <= 2^bits, plus less than 1 from rounding M down, so at most 2^bits; on the diagonal it is not negative.
    With shift = (n + 1) 2^bits the matrix M - L L' is diagonally dominant, so M > 0."""
    L: list[list[int]] = []
    for i, row in enumerate(M):
        own: list[int] = []
        for j, other in enumerate(L):
            own.append((math.floor(row.get(j, ZERO) * 4**bits) - sum(map(mul, own, other))) // other[j])
        square = math.floor(row.get(i, ZERO) * 4**bits) - ((len(M) + 1) << bits) - sum(map(mul, own, own))
        if square <= 0:
            return False
        L.append([*own, math.isqrt(square)])
    return True


# --- Reading: whatever is not on the format page is refused -----------------------------------------------------------
def rational(text: Any) -> Fraction:
    """A rational as the files write it: a quotient of integers or a decimal."""
    need(type(text) is str and len(text) <= MAX_DIGITS, f"a number is no text of at most {MAX_DIGITS} characters")
    good = re.fullmatch(rf"([+-]?{UNSIGNED})|([+-]?[0-9]+)/([+-]?0*[1-9][0-9]*)", text)
    need(good is not None, "a number is not written as it should")
    top, _, bottom = text.partition("/")
    return Fraction(decimal.Decimal(top)) / Fraction(decimal.Decimal(bottom or "1"))


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    need(len(dict(pairs)) == len(pairs), "a key stands there twice")
    return dict(pairs)


def document(data: bytes, kind: str) -> dict[str, Any]:
    """The JSON object of a file."""
    need(len(data) <= MAX_BYTES, f"the file is larger than {MAX_BYTES} bytes")
    try:
        value = json.loads(data.decode(), object_pairs_hook=once, parse_float=decimal.Decimal, parse_constant=rational)
    except (ValueError, ArithmeticError, RecursionError) as error:
        raise Refused(f"the file is no JSON in UTF-8, or nested too deeply ({type(error).__name__})") from None
    need(type(value) is dict and value.get("format") == kind, f"the file is no {kind}")
    need(type(value.get("version")) is int and value["version"] == 1, "the version is not 1")
    return dict(value)


def read(value: Any, shape: Any) -> Any:
    """The value with Fractions for rationals and attributes for keys. A shape is a dict of keys ("key?" may be absent:
    None), a list with the shape of all items, a tuple with the shape of each, or a function that reads the value."""
    if isinstance(shape, dict):
        known = {key.rstrip("?"): part for key, part in shape.items()}
        need(type(value) is dict, "there is something else than an object")
        need(set(value) <= set(known), f"there are other keys than {', '.join(known)}")
        need(all(key in value for key in shape if key[-1] != "?"), f"one of the keys {', '.join(known)} is missing")
        return SimpleNamespace(**{key: read(value[key], part) if key in value else None for key, part in known.items()})
    if isinstance(shape, list | tuple):
        need(type(value) is list, "there is something else than a list")
        shapes = shape if isinstance(shape, tuple) else shape * len(value)
        need(len(value) == len(shapes), f"there are {len(value)} things where {len(shapes)} were expected")
        return [read(item, part) for item, part in zip(value, shapes, strict=True)]
    return shape(value)


anything: Any = lambda value: value  # noqa: E731


def of(*types: type) -> Callable[[Any], Any]:
    """The shape of what has one of these types (and is no boolean)."""

    def shape(value: Any) -> Any:
        need(type(value) in types, f"there is something else than {' or '.join(kind.__name__ for kind in types)}")
        return value

    return shape


def maybe(part: Any) -> Callable[[Any], Any]:
    return lambda value: None if value is None else read(value, part)


text, an_object = of(str), of(dict)
json_number = maybe(lambda value: rational(str(of(int, decimal.Decimal)(value))))


def direction(size: int) -> Callable[[Any], list[Fraction]]:
    def shape(value: Any) -> list[Fraction]:
        v = list(read(value, (rational,) * size))
        short(v, VECTOR_BITS)
        need(any(v), "a vector is 0")
        return v

    return shape


def short(numbers: Iterable[Fraction], limit: int) -> None:
    """Refuse numbers whose common denominator is too long to go on with."""
    common = 1
    for x in numbers:
        common = math.lcm(common, x.denominator)
        need(common.bit_length() <= limit, f"numbers have a common denominator of more than {limit} bits")


def matrix(rows: int, columns: int) -> tuple[tuple[Any, ...], ...]:
    return ((rational,) * columns,) * rows


# --- The problem ------------------------------------------------------------------------------------------------------
class Problem:
    """problem.json, the trusted side: agents, arcs, slopes, gains, exosystem, region."""

    def __init__(self, data: bytes) -> None:
        source = document(data, "dobc-problem")
        self.n = n = len(read(source.get("labels"), [text]))
        self.m = m = of(int)(source.get("dimension"))
        need(1 <= m <= 100, "the dimension is not between 1 and 100")
        system = source.get("exosystem")
        self.q = q = len(read(system, {"A": [anything], "C": anything}).A) if system is not None else 0

        def agent(value: Any) -> int:
            need(type(value) is int and 0 <= value < n, f"an integer from 0 to {n - 1} was expected")
            return int(value)

        h: Any = lambda value: (value,) if type(value) is str else tuple(read(value, (text,) * m))  # noqa: E731
        self.file = file = read(
            source,
            {
                "format": text,
                "version": anything,
                "name": text,
                "notes": [text],
                "labels": [text],
                "dimension": anything,
                "target": (rational,) * m,
                "modes": [{"name": text, "arcs": [(agent, agent, rational)]}],
                "coupling": {"h": h, "exceptions": [{"arc": (agent, agent), "h": h}]},
                "gains": [(agent, matrix(m, m))],
                "exosystem": maybe({"A": matrix(q, q), "C": matrix(m, q)}),
                "offsets": [(agent, (rational,) * m)],
                "observer": {"W": maybe(matrix(q, m)), "P": maybe(matrix(q, q)), "rate": maybe(rational)},
                "region": maybe({"initial_states": matrix(m, 2), "initial_disturbance": maybe(rational)}),
                "switching": anything,
                "simulation": anything,
            },
        )
        self.modes: dict[str, list[Any]] = {mode.name: mode.arcs for mode in file.modes}
        need(0 < n == len(set(file.labels)), "labels have to be different, and at least one")
        need(0 < len(file.modes) == len(self.modes), "modes have to be different, and at least one")
        need(file.observer.P is None or file.observer.W is not None, "the observer has a P without a W")
        self.sha256, self.labels, self.gains = hashlib.sha256(data).hexdigest(), file.labels, dict(file.gains)
        self.W, self.P, self.region = file.observer.W, file.observer.P, file.region
        self.A: Matrix = file.exosystem.A if q else []
        self.C: Matrix = file.exosystem.C if q else [[] for _ in range(m)]
        offsets = dict(file.offsets)
        self.goals = [plus([file.target], 1, [offsets.get(i, [ZERO] * m)])[0] for i in range(n)]
        self.coupling = read_coupling(file.coupling.h, m)
        self.exceptions = {tuple(each.arc): read_coupling(each.h, m) for each in file.coupling.exceptions}
        every = (self.coupling, *self.exceptions.values())
        self.kinked = any(coupling.kinked for coupling in every)
        self.domain = "global" if all(each.linear and not each.kinked for each in every) else "consensus"
        self.bounds: dict[str, Rows] = {}

    def terms(self, mode: str) -> Iterator[tuple[int, int, int, Number]]:
        """(a, b, c, G): row a of J - K has +G in column b and -G in column c, the agent's own. A gain is an arc from
        the target, where the error is 0: it has the column n m, which is dropped in the end."""
        m = self.m
        for i, j, w in self.modes[mode]:
            for (c, d), slope in self.exceptions.get((i, j), self.coupling).slopes.items():
                yield i * m + c, j * m + d, i * m + d, slope * point(w)
        for i, k in self.gains.items():
            yield from ((i * m + c, self.n * m, i * m + d, point(k[c][d])) for c in range(m) for d in range(m))

    def bound(self, mode: str) -> Rows:
        """A rational U with Lambda <= U for every slope in its enclosure: one that is off by r moves v'Lambda v by at
        most 2 r |v_a| |v_b - v_c| <= r (2 v_a^2 + v_b^2 + v_c^2)."""
        if mode not in self.bounds:
            rows: Rows = [{i: ZERO} for i in range(self.n * self.m + 1)]
            for a, b, c, slope in self.terms(mode):
                x, r = (slope.lo + slope.hi) / 2, (slope.hi - slope.lo) / 2
                wide = ((a, a, 2 * r), (b, b, r), (c, c, r)) if r else ()
                for i, j, y in ((a, b, x), (b, a, x), (a, c, -x), (c, a, -x), *wide):
                    rows[i][j] = rows[i].get(j, ZERO) + y
            self.bounds[mode] = [{j: x for j, x in row.items() if j < self.n * self.m} for row in rows[:-1]]
        return self.bounds[mode]

    def low(self, mode: str, v: list[Fraction]) -> Fraction:
        """A lower bound of v'Lambda v, exact where the slopes that take part are; v ends with a 0."""
        weights = ((2 * v[a] * (v[b] - v[c]), slope) for a, b, c, slope in self.terms(mode))
        return sum((weight * (slope.lo if weight > 0 else slope.hi) for weight, slope in weights), ZERO)

    def jacobian(self, mode: str) -> Matrix:
        """J - K, if every slope is exact."""
        size = self.n * self.m
        need(size <= ROOTS_SIZE, f"unstable roots are counted up to size {ROOTS_SIZE} only")
        X = [[ZERO] * (size + 1) for _ in range(size)]
        for a, b, c, slope in self.terms(mode):
            need(slope.lo == slope.hi, "unstable roots are counted for exact slopes only")
            X[a][b] += slope.lo
            X[a][c] -= slope.lo
        return [row[:-1] for row in X]

    def edges(self, modes: Iterable[str], hears: bool) -> list[list[int]]:
        """Whom every agent listens to, or who listens to it."""
        found: list[list[int]] = [[] for _ in self.labels]
        for i, j, _ in (arc for mode in modes for arc in self.modes[mode]):
            found[i if hears else j].append(j if hears else i)
        return found

    def escapes(self) -> bool:
        """A closed set of agents (they listen to nobody outside) can stay away from the target, inside the region. The
        smallest closed set around an agent has the fewest gains; a nonsingular gain in it holds the agent."""
        nonsingular = [i for i, k in self.gains.items() if len(echelon(k)[0]) == self.m]
        hears, held = self.edges(self.modes, True), reach(nonsingular, self.edges(self.modes, False))
        return any(self.leaves_free(reach([i], hears)) for i in range(self.n) if i not in held)

    def leaves_free(self, group: set[int]) -> bool:
        """No gain of the group acts on some shift c other than 0, and the region holds such a shift."""
        free, _ = nullspace([row for i in group for row in self.gains.get(i, [])], self.m)
        if self.region is None or not free:
            return bool(free)
        box = []
        for c, (lo, hi) in enumerate(self.region.initial_states):
            box.append((lo - min(self.goals[i][c] for i in group), hi - max(self.goals[i][c] for i in group)))
        if len(free) == self.m or any(lo > hi for lo, hi in box):
            return all(lo <= hi for lo, hi in box) and any(lo or hi for lo, hi in box)
        for shift in free:  # is t shift in the box for some t other than 0?
            ends = [sorted((lo / x, hi / x)) for x, (lo, hi) in zip(shift, box, strict=True) if x]
            low, high = max(end[0] for end in ends), min(end[1] for end in ends)
            across = all(x or lo <= 0 <= hi for x, (lo, hi) in zip(shift, box, strict=True))
            if across and (low < high or low == high != 0):
                return True
        return False


def reach(starts: Collection[int], edges: list[list[int]]) -> set[int]:
    found, stack = set(starts), list(starts)
    while stack:
        fresh = set(edges[stack.pop()]) - found
        found |= fresh
        stack += fresh
    return found


# --- The claims -------------------------------------------------------------------------------------------------------
FACTS = ("observability", "detectability", "hurwitz", "reachability")
QUADRATIC = ("lure", "exhaustive", "settling")
REGIONAL = ("max-separable", "delay", "sampling", "equilibrium", *QUADRATIC)
STARTS = {"kind": text, "radius": json_number, "disturbance": json_number}
CHECK = {
    "id": text,
    "group?": text,
    "verdict": text,
    "margin": json_number,
    "rate": json_number,
    "reason": text,
    "domain": lambda value: value if type(value) is str else read(value, STARTS),
    "mode?": text,
    "exact?": an_object,
    "witness?": an_object,
    "fix?": {"kind": text, "set": an_object, "text": text},
}


def same(value: Any, expected: Any) -> bool:
    """True if a part of the certificate says what it has to: rationals as numbers, the rest as it is."""
    if isinstance(expected, dict):
        return type(value) is dict and set(value) == set(expected) and all(same(value[k], expected[k]) for k in value)
    if isinstance(expected, list):
        return type(value) is list and len(value) == len(expected) and all(map(same, value, expected))
    return rational(value) == expected if isinstance(expected, Fraction) else bool(value == expected)


class Examination:
    """One certificate against one problem: every method decides one claim, and raises Refused if it is not shown."""

    def __init__(self, certificate: bytes, problem: Problem) -> None:
        self.problem, self.parts, p = problem, [cast(Any, None)], problem
        gain, P = maybe(matrix(p.q, len(p.C))), maybe(matrix(p.q, p.q))
        self.claims = read(
            document(certificate, "dobc-certificate"),
            {
                "program": {"name": text, "version": text, "options?": [text]},
                "covered_by": maybe(text),
                "problem": text,
                "observer": {"W": gain, "source": maybe(text), "P": P, "Q": gain},
                "version": anything,
                "rate": json_number,
                "problem_sha256": text,
                "format": text,
                "verdict": text,
                "reason": text,
                "checks": [CHECK],
                "notes": [text],
            },
        )
        self.W, self.P, self.Q = self.claims.observer.W, self.claims.observer.P, self.claims.observer.Q
        for X in ([] if p.W else self.W, self.P):
            short((x for row in X or [] for x in row), MATRIX_BITS)
        self.checks, self.theorem = self.claims.checks, "theorem1" if len(p.modes) == 1 else "theorem2"
        self.regions: Any = None
        for part, ids in (("region", REGIONAL), ("quadratic", QUADRATIC)):  # the second needs the first
            if any(check.id in ids for check in self.checks):
                self.regions = sibling(f"{part}_checker").Decisions(self)

    def belonging(self) -> None:
        claims, notes = self.claims, self.problem.file.notes
        need(claims.problem == self.problem.file.name, "the problem has another name")
        need(claims.problem_sha256 == self.problem.sha256, "the problem file has another hash")
        need(claims.notes[: len(notes)] == notes, "the notes of the problem are not repeated")

    def completeness(self) -> None:
        wanted: list[Any] = [(id, mode, None) for mode in self.problem.modes for id in ("reachability", "lemma1")]
        if self.problem.q:
            wanted += [(id, None, group) for id in FACTS[:3] for group in self.parts] + [(self.theorem, None, None)]
            wanted += [(self.theorem + "-printed", None, None)] if self.problem.P is not None else []
        found = [(check.id, check.mode, check.group) for check in self.checks]
        need(set(found) <= {*wanted, *((id, None, None) for id in REGIONAL)}, "there is a check that nobody asked for")
        need(len(set(found)) == len(found), "a check stands there twice")
        need(set(wanted) <= set(found), "a check is missing")

    def observer(self) -> None:
        p = self.problem
        source = None if self.W is None else "designed" if p.W is None else "given"
        need(self.claims.observer.source == source, "the source of the observer gain is wrong")
        need(self.W is None or p.q > 0, "there is an observer, but no exosystem")
        need(p.W is None or self.W == p.W, "the observer gain is not the one of the problem")
        proved = any(check.id == self.theorem and check.verdict == "proved" for check in self.checks)
        need((self.P is not None) == (self.Q is not None) == proved, "P and Q belong beside a proved theorem, both")
        if self.P is not None:
            need(transpose(self.P) == self.P, "P is not symmetric")
            need(self.W is not None and product(self.P, self.W) == self.Q, "Q is not P W")

    def confirm(self, check: Any) -> None:
        p, proved = self.problem, check.verdict == "proved"
        if check.id in REGIONAL and check.verdict != "undecided":
            self.regions.confirm(check)
            return
        need(check.domain == ("global" if check.id in FACTS else p.domain), "the domain is wrong")
        if check.verdict == "undecided":
            claimed = (check.margin, check.rate, check.exact, check.witness)
            need(claimed == (None,) * 4, "it is undecided and claims something")
            return
        need(proved or check.verdict == "refuted", "the verdict is none of proved, refuted and undecided")
        if check.id in FACTS:
            found, exact, witness = getattr(self, check.id)(check)
            need(check.margin is None, "it has no margin to claim")
            need(check.rate is None or check.id == "hurwitz", "it has no rate to claim")
            need(proved == found, f"it is {'proved' if found else 'refuted'} here")
            need(same(check.exact, exact), "the exact value is another one here")
            need(same(check.witness, None if found else witness), "the witness is another one here")
            return
        need(not p.kinked, "a coupling has a kink, so the theorems do not apply")
        if proved:
            need(check.witness is None, "it is proved and carries a witness")
            need(check.margin is not None and check.margin >= 0, "a proof needs a margin of at least 0")
            need(check.rate is None or check.rate > 0, "a rate has to be positive")
        else:
            need(check.rate is None, "it is refuted and claims a rate")
            need(check.margin is None or check.margin <= 0, "it is refuted and claims a positive margin")
        disproof = {"lemma1": self.lemma_refuted, self.theorem: self.theorem_refuted}.get(check.id, self.pair_refuted)
        (self.proof if proved else disproof)(check)

    # --- facts of the exosystem, of W and of the graph: is it proved, the exact value, the witness
    def observable(self) -> tuple[Matrix, list[int]]:
        """T and the columns of its leading ones."""
        rows, block = Matrix(), self.problem.C
        for _ in range(self.problem.q):
            rows, block = rows + block, product(block, self.problem.A)
        return echelon(rows)

    def observability(self, check: Any) -> tuple[bool, Any, Any]:
        T, q = self.observable()[0], self.problem.q
        return len(T) == q, {"rank": Fraction(len(T))}, {"kind": "vector", "values": [*nullspace(T, q)[0], []][0]}

    def detectability(self, check: Any) -> tuple[bool, Any, Any]:
        basis, free = nullspace(self.observable()[0], self.problem.q)
        images = product(basis, transpose(self.problem.A))
        R = transpose([[image[k] for k in free] for image in images])
        p = polynomial_text(characteristic(R))
        return stable(R), {"unobservable_polynomial": p}, {"kind": "polynomial", "values": [p]}

    def closed(self, b: Fraction = ZERO) -> Matrix:
        """A - W C + b I."""
        X = plus(self.problem.A, -1, product(self.W, self.problem.C))
        return [[x + b * (i == j) for j, x in enumerate(row)] for i, row in enumerate(X)]

    def hurwitz(self, check: Any) -> tuple[bool, Any, Any]:
        need(self.W is not None, "there is no observer gain")
        need(check.rate is None or (check.rate > 0 and stable(self.closed(check.rate))), "the rate is not shown")
        column = routh(characteristic(self.closed()))
        end = next((k for k, entry in enumerate(column) if entry <= 0), 0)
        return end == 0, None if end else {"routh": column}, {"kind": "routh_row", "values": column[: end + 1]}

    def reachability(self, check: Any) -> tuple[bool, Any, Any]:
        reached = reach(self.problem.gains, self.problem.edges([check.mode], False))
        rest = [label for i, label in enumerate(self.problem.labels) if i not in reached]
        return not rest, None, {"kind": "agents", "labels": rest}

    # --- Lemma 1 and the theorems
    def negative(self, mode: str, shift: Fraction, S: Matrix | None = None) -> bool:
        """Lambda + I (x) S + shift I < 0 in that mode; if a vector stands beside Lemma 1, it has to show this."""
        lemma, m = next(each for each in self.checks if (each.id, each.mode) == ("lemma1", mode)), self.problem.m
        if lemma.verdict == "proved" and lemma.exact is not None:
            lemma.room = getattr(lemma, "room", None) or sibling("region_checker").room(self.problem, lemma)
            room = [[(lemma.room - shift) * (i == j) for j in range(m)] for i in range(m)]
            return definite(plus(room, -1, S) if S else room, 1)
        rows = [{j: -x for j, x in row.items()} for row in self.problem.bound(mode)]
        for i, row in enumerate(rows):
            row[i] -= shift
            for d, x in enumerate(S[i % m] if S else []):
                short, j = number(x, x), i - i % m + d
                row[j] = row.get(j, ZERO) - (short.lo + short.hi) / 2
                row[i] -= short.hi - short.lo
        return positive(rows)

    def lemma_refuted(self, check: Any) -> None:
        exact = read(check.exact, {"unstable_roots": rational, "value?": rational})
        low, count = self.vector(check, check.mode), exact.unstable_roots
        need(exact.value is None or exact.value <= low, "v'Lambda v is less than the value that is claimed")
        need(count >= 0 and count.denominator == 1, "unstable_roots is no number of roots")
        need(count == 0 or unstable(self.problem.jacobian(check.mode), int(count)), "unstable roots are not shown")

    def vector(self, check: Any, mode: str, S: Matrix | None = None) -> Fraction:
        """The witness v shows that X = Lambda + I (x) S has v'Xv >= max(0, -M v'v); a lower bound of v'Xv."""
        p = self.problem
        witness = read(check.witness, {"kind": text, "labels": [text], "values": direction(p.n * p.m)})
        v, parts = witness.values, [witness.values[i : i + p.m] for i in range(0, p.n * p.m, p.m)]
        need(witness.kind == "vector", "the witness is no vector")
        support = [label for label, part in zip(p.labels, parts, strict=True) if any(part)]
        need(witness.labels == support, "the labels are not the agents where the vector is not 0")
        low = p.low(mode, [*v, ZERO]) + sum((form(part, S, part) for part in parts if S), ZERO)
        need(low >= max(ZERO, -(check.margin or ZERO) * sum(map(mul, v, v))), "the vector does not show it")
        return low

    def omega(self, P: Matrix, b: Fraction) -> Matrix:
        """P A + A'P - Q C - C'Q' + 2 b P, with Q = P W."""
        half = product(P, self.closed(b))
        return plus(half, 1, transpose(half))

    def schur(self, P: Matrix, b: Fraction) -> Matrix:
        """C (-Omega)^-1 C', once Omega < 0 is shown."""
        Omega, C = self.omega(P, b), self.problem.C
        need(definite(Omega, -1), "Omega < 0 is not shown")
        rows, _ = echelon([[-x for x in row] + column for row, column in zip(Omega, transpose(C), strict=True)])
        return product(C, [row[len(Omega) :] for row in rows])

    def values(self, P: Matrix) -> dict[str, Any]:
        """What is listed for a pair: P, Q, S, and the bound -s if S = s I."""
        S = self.schur(P, ZERO)
        scalar = all(x == S[0][0] * (i == j) for i, row in enumerate(S) for j, x in enumerate(row))
        return {"P": P, "Q": product(P, self.W), "S": S} | ({"bound": -S[0][0]} if scalar else {})

    def proof(self, check: Any) -> None:
        """Lambda < 0 in the mode, or Psi < 0 for the pair in every mode, with the margin and the rate."""
        lemma, P = check.id == "lemma1", self.P if check.id == self.theorem else self.problem.P
        need(lemma or definite(P, 1), "P > 0 is not shown")
        need(lemma or same(check.exact, self.values(P)), "P, Q, S or the bound is another one here")
        modes = [check.mode] if lemma else list(self.problem.modes)
        for b, shift in [(ZERO, check.margin)] + ([(check.rate, 2 * check.rate)] if check.rate is not None else []):
            S = None if lemma else self.schur(P, b)
            need(all(self.negative(mode, shift, S) for mode in modes), "the margin or the rate is not shown")

    def theorem_refuted(self, check: Any) -> None:
        exact = read(check.exact, {"block": text, "mode?": text})
        if exact.block == "Lambda":
            need(exact.mode in self.problem.modes, "there is no such mode")
            self.vector(check, exact.mode)
            return
        need(exact.mode is None and check.margin is None, "a cause in the exosystem has no mode and no margin")
        need(exact.block in ("detectability", "hurwitz"), "the cause is none of Lambda, detectability and hurwitz")
        need(exact.block == "detectability" or self.problem.W is not None, "a designed W refutes nothing")
        found, _, witness = getattr(self, exact.block)(check)
        need(not found and same(check.witness, witness), "the cause is not there, or it has another witness")

    def pair_refuted(self, check: Any) -> None:
        """The pair of the problem does not do: P > 0, Omega < 0 or, in a mode, Lambda + I (x) S < 0 fails."""
        p, exact, P = self.problem, check.exact or {}, self.problem.P
        if exact in ({"block": "P"}, {"block": "Omega0"}):
            witness = read(check.witness, {"kind": text, "values": direction(p.q)})
            v, X = witness.values, P if exact["block"] == "P" else [[-x for x in row] for row in self.omega(P, ZERO)]
            need(witness.kind == "vector", "the witness is no vector")
            need(check.margin is None, "it has no margin to claim")
            need(form(v, X, v) <= 0, "the vector does not show it")
            return
        values, mode = self.values(P), exact.get("mode")
        need(type(mode) is str and mode in p.modes, "there is no such mode")
        need(same(exact, values | {"mode": mode}), "P, Q, S or the bound is another one here")
        self.vector(check, str(mode), values["S"])

    # --- the overall verdict, once all checks are confirmed
    def overall(self) -> None:
        proofs = [check for check in self.checks if check.verdict == "proved" and self.covers(check)]
        lemmas = [check for check in proofs if check.id == "lemma1"]
        slowest = min(lemmas, key=rate, default=None) if len(lemmas) == len(self.problem.modes) else None
        best = max((check for check in proofs if check.id != "lemma1" or check is slowest), key=rate, default=None)
        verdict = "proved" if best else "refuted" if self.refuted() else "undecided"
        need(self.claims.verdict == verdict, f"the verdict that follows is {verdict}")
        need(self.claims.rate == (best and best.rate), "the rate is another one")
        need(self.claims.covered_by == (best and best.id), "it is covered by another check")

    def covers(self, check: Any) -> bool:
        """True if what is proved holds from all starts that are asked for (lemma1: in its mode)."""
        p = self.problem
        if check.id in ((self.theorem, self.theorem + "-printed") if p.q else ("lemma1",)):
            return p.region is None or p.domain == "global"
        return check.id in REGIONAL and bool(self.regions.covers(check))

    def refuted(self) -> bool:
        """True if a closed group, an equilibrium, the problem's own W or an unstable mode shows that it fails."""
        p, (T, columns) = self.problem, self.observable()
        found = [check for check in self.checks if check.verdict == "refuted"]
        disturbed = p.W is not None and (p.region is None or (p.region.initial_disturbance or 0) > 0)
        if (
            p.escapes()
            or (p.region and any(check.id == "equilibrium" for check in found))
            or (disturbed and not stable([[row[k] for k in columns] for row in product(T, self.closed())]))
        ):
            return True
        lemmas = [check.exact for check in found if check.id == "lemma1"]
        sides = [] if p.region is None else p.region.initial_states
        inside = all(lo < goal[c] < hi for goal in p.goals for c, (lo, hi) in enumerate(sides))
        return inside and any(rational(exact["unstable_roots"]) > 0 for exact in lemmas)


rate: Any = lambda check: check.rate or ZERO  # noqa: E731


def sibling(part: str) -> Any:
    """A file beside this one, by its path: the folder of a lone file is not searched for modules."""
    name, own = (f"{__package__ or 'lone'}.{each}" for each in (part, "checker"))
    if name not in sys.modules:
        sys.modules.setdefault(own, sys.modules[__name__])
        path = Path(__file__).with_name(f"{part}.py")
        need(path.is_file(), f"checker.py needs {path.name} beside it for these files")
        spec: Any = spec_from_file_location(name, path)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]


# --- Running ----------------------------------------------------------------------------------------------------------
def examine(certificate: bytes, problem: bytes) -> list[tuple[bool, str]]:
    """Every claim of a certificate: does it hold, what it is, and why it fails. It is confirmed iff all of them hold.
    Raises: Refused if one of the two files is not what the format page describes."""
    grouped = "'groups'" in str(document(problem, "dobc-problem").get("exosystem"))
    reader, kind = sibling("groups_checker").KINDS if grouped else (Problem, Examination)
    case = kind(certificate, reader(problem))
    stages: list[list[tuple[str, Callable[[], None]]]] = [
        [
            ("it belongs to this problem", case.belonging),
            ("its list of checks", case.completeness),
            ("its observer gain and pair (P, Q)", case.observer),
        ],
        [(f"{check.id} {check.mode or ''}: {check.verdict}", partial(case.confirm, check)) for check in case.checks],
        [(f"overall verdict: {case.claims.verdict}", case.overall)],
    ]
    findings: list[tuple[bool, str]] = []
    for title, step in (step for stage in stages if all(holds for holds, _ in findings) for step in stage):
        try:
            step()
            findings.append((True, title))
        except Refused as error:
            findings.append((False, f"{title}: {error}"))
    return findings


def main(arguments: list[str]) -> int:
    """Run as a program; the result is the exit code."""
    lines, code = ["usage: python -I -S checker.py certificate.json problem.json"], 2
    try:
        if len(arguments) == 2:
            need(all(Path(name).is_file() or not Path(name).exists() for name in arguments), "it is no regular file")
            with open(arguments[0], "rb") as certificate, open(arguments[1], "rb") as problem:
                findings = examine(certificate.read(MAX_BYTES + 1), problem.read(MAX_BYTES + 1))
            lines, code = [("holds  " if holds else "FAILS  ") + what for holds, what in findings], 0
            if not all(holds for holds, _ in findings):
                lines, code = [*lines, "NOT CONFIRMED: the certificate proves nothing."], 1
    except (Refused, OSError) as error:
        lines = [f"unreadable: {error}"]
    for line in [*lines, "Every claim holds."] if code == 0 else lines:
        shown = "".join(c if c.isprintable() else "?" for c in line)  # nothing that could steer a terminal
        sys.stdout.write(shown.encode("ascii", "backslashreplace").decode() + "\n")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
