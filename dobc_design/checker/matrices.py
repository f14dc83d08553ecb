"""Matrices over the rationals: elimination, polynomials, definiteness.

Of definiteness True is a proof, False says that there is none here. Floating point only proposes a
vector.
"""

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import pairwise, zip_longest
from operator import mul
from typing import Any, TypeVar

from .reading import need, still

Vector = list[Fraction]
Matrix = list[Vector]
Rows = list[dict[int, Fraction]]  # a sparse matrix
ZERO = Fraction(0)
ONE = Fraction(1)
S = TypeVar("S")
T = TypeVar("T")


def paired(x: Iterable[S], y: Iterable[T]) -> Iterator[tuple[S, T]]:
    """The items of two lists of the same length, side by side."""
    return zip(x, y, strict=True)


def root(square: Fraction) -> Fraction:
    """An upper bound of a square root."""
    # isqrt rounds down, so that one unit more is above the root
    units = math.isqrt(math.ceil(square * 4**60))
    return Fraction(units + 1, 2**60)


# --- Sums and products
def identity(size: int, factor: Fraction | int = 1) -> Matrix:
    """The identity times a factor; 0 gives a matrix of zeros."""
    rows = []
    for i in range(size):
        row = [ZERO] * size
        row[i] = Fraction(factor)
        rows.append(row)
    return rows


def transpose(X: Matrix) -> Matrix:
    """X'."""
    return [list(column) for column in zip(*X, strict=True)]


def product(X: Matrix, Y: Matrix) -> Matrix:
    """X Y, in integers: a row of X and a column of Y are each brought over one denominator."""
    columns = [integers(column) for column in transpose(Y)]
    rows = []
    for row in X:
        a, bottom = integers(row)
        rows.append([Fraction(sum(map(mul, a, b)), bottom * d) for b, d in columns])
    return rows


def plus(X: Matrix, factor: Fraction | int, Y: Matrix) -> Matrix:
    """X + factor Y."""
    return [combined(x, factor, y) for x, y in paired(X, Y)]


def combined(x: Vector, factor: Fraction | int, y: Vector) -> Vector:
    """x + factor y of vectors."""
    return [a + factor * b for a, b in paired(x, y)]


def opposite(X: Matrix) -> Matrix:
    """-X."""
    return [[-x for x in row] for row in X]


def both_ways(X: Matrix) -> Matrix:
    """X + X'."""
    return plus(X, 1, transpose(X))


def form(u: Vector, X: Matrix, v: Vector) -> Fraction:
    """The number u'X v."""
    return product([u], product(X, transpose([v])))[0][0]


def norm(X: Any) -> Any:
    """The largest row sum of absolute values."""
    return max(sum(map(abs, row)) for row in X)


def diagonal(blocks: list[Any]) -> Matrix:
    """Blocks along the diagonal, zeros elsewhere."""
    width = sum(len(block[0]) for block in blocks)
    before = 0
    rows = Matrix()
    for block in blocks:
        own = len(block[0])
        after = width - before - own
        rows += [[ZERO] * before + list(row) + [ZERO] * after for row in block]
        before += own
    return rows


def is_diagonal(X: Matrix) -> bool:
    """Whether all entries beside the diagonal are 0."""
    return not any(any(row[:i] + row[i + 1 :]) for i, row in enumerate(X))


def integers(v: Vector) -> tuple[list[int], int]:
    """A vector as integers over one integer."""
    bottom = math.lcm(*{x.denominator for x in v})
    return [int(x * bottom) for x in v], bottom


# --- Elimination
def echelon(X: Matrix) -> tuple[Matrix, list[int]]:
    """The nonzero rows of the reduced row echelon form, and the columns of their leading ones; in
    integers."""
    rest = [integers(row)[0] for row in X]
    rows = list[list[int]]()
    pivots = list[int]()
    for column in range(len(X[0]) if X else 0):
        still()
        # any row that is not 0 there may lead: there is no rounding that a choice could spare
        lead = next((row for row in rest if row[column]), None)
        if lead is None:
            continue
        rest = [without(row, lead, column) for row in rest if row is not lead]
        rows = [without(row, lead, column) for row in rows]
        rows.append(lead)
        pivots.append(column)
    reduced = []
    for row, lead_column in paired(rows, pivots):
        reduced.append([Fraction(x, row[lead_column]) for x in row])
    return reduced, pivots


def without(row: list[int], lead: list[int], column: int) -> list[int]:
    """A multiple of the row, less one of ``lead``, so that its entry in the column is 0, without
    common factors."""
    # without a division, so that integers stay integers
    left = [lead[column] * x - row[column] * y for x, y in paired(row, lead)]
    factor = math.gcd(*left) or 1
    return [x // factor for x in left]


def solved(X: Matrix, Y: Matrix) -> Matrix:
    """X^-1 Y, if X is regular."""
    rows, _ = echelon([[*x, *y] for x, y in paired(X, Y)])
    return [row[len(X) :] for row in rows]


def nullspace(X: Matrix, size: int) -> tuple[Matrix, list[int]]:
    """A basis of {v: X v = 0} in R^size, one vector per free column, and the free columns."""
    rows, pivots = echelon(X)
    free = [column for column in range(size) if column not in pivots]
    basis = []
    for column in free:
        v = identity(size)[column]
        for k, row in paired(pivots, rows):
            v[k] = -row[column]
        basis.append(v)
    return basis, free


def meets(rows: Matrix, basis: list[int], box: list[Any]) -> bool:
    """True iff some v with rows v = 0 lies in a box; rows in echelon form, basis: the columns of
    their leading ones.

    The simplex method without an objective, with the rule of Bland, which ends: x has the other
    entries of v.
    """
    x = [ZERO if k in basis else max(lo, min(hi, ZERO)) for k, (lo, hi) in enumerate(box)]
    while True:
        wrong = []
        for k, row in paired(basis, rows):
            value = -sum(map(mul, row, x))
            lo, hi = box[k]
            if not lo <= value <= hi:
                wrong.append((k, value, row))
        if not wrong:
            return True
        k, value, lead = min(wrong)
        x[k] = max(box[k][0], min(box[k][1], value))
        able = None
        for j, (lo, hi) in enumerate(box):
            rises = (lead[j] < 0) == (value < x[k])  # whether x_j has to
            free = x[j] < hi if rises else x[j] > lo
            if free and lead[j] and j != k:
                able = j
                break
        # k cannot come closer to its side, whatever the others do: the row excludes the box
        if able is None:
            return False
        x[able] = ZERO
        scaled = [entry / lead[able] for entry in lead]
        rows = [scaled if row is lead else combined(row, -row[able], scaled) for row in rows]
        basis = [able if each == k else each for each in basis]


# --- Polynomials
def characteristic(X: Matrix) -> Vector:
    """Coefficients of det(s I - X), highest power first (Faddeev and LeVerrier, in integers)."""
    size = len(X)
    scale = math.lcm(*(entry.denominator for row in X for entry in row))
    rows = [[int(entry * scale) for entry in row] for row in X]
    B = [[int(i == j) for j in range(size)] for i in range(size)]
    coefficients = [Fraction(1)]
    for k in range(1, size + 1):
        columns = list(zip(*B, strict=True))
        B = [[sum(map(mul, row, column)) for column in columns] for row in rows]
        c = -sum(B[i][i] for i in range(size)) // k  # without remainder
        for i in range(size):
            B[i][i] += c
        coefficients.append(Fraction(c, scale**k))
    return coefficients


def routh(polynomial: Vector) -> Vector:
    """Routh's first column, up to its first zero."""
    upper = polynomial[0::2]
    lower = polynomial[1::2]
    column = upper[:1]
    while lower and column[-1]:
        column.append(lower[0])
        factor = upper[0] / lower[0] if lower[0] else ZERO
        pairs = zip_longest(upper[1:], lower[1:], fillvalue=ZERO)
        upper = lower
        lower = [a - factor * b for a, b in pairs]
    return column


def stable(X: Matrix) -> bool:
    """True iff every eigenvalue of X has a negative real part."""
    # a column that ends early ends with a 0
    return min(routh(characteristic(X))) > 0


def unstable(X: Matrix, count: int) -> bool:
    """True if X is seen to have at least ``count`` eigenvalues with positive real part.

    Sign changes in Routh's column count the roots to the right of delta >= 0, if no entry of it is
    0.
    """
    polynomial = characteristic(X)
    for delta in (ZERO, *(Fraction(1, 2**k) for k in (0, 2, 4, 8, 16, 32, 64))):
        moved = list(polynomial)
        for end in range(len(moved), 1, -1):
            for k in range(1, end):
                moved[k] += delta * moved[k - 1]
        column = routh(moved)
        changes = sum(a * b < 0 for a, b in pairwise(column))
        # roots to the right of some delta > 0 are fewer than those to the right of 0
        # a 0 in the column counts nothing: then another delta is tried
        if column[-1] and (changes >= count or delta == 0):
            return changes >= count
    return False


def polynomial_text(polynomial: Vector) -> str:
    """A polynomial in s as the format writes it."""
    text = ""
    for k, c in enumerate(polynomial):
        printable = max(abs(c.numerator), c.denominator) < 10**4000
        need(printable, "a polynomial has coefficients of more than 4000 digits")
        if c == 0:
            continue
        power = len(polynomial) - 1 - k
        symbol = f"s^{power}" if power > 1 else "s" * power
        size = "" if abs(c) == 1 and symbol else f"{abs(c)} "
        sign = "-" if c < 0 else "+"
        text += f" {sign} {size}{symbol}".rstrip()
    return text.removeprefix(" + ")


# --- Definiteness
def definite(X: Matrix, sign: int = 1) -> bool:
    """True only if the symmetric matrix sign X is positive definite."""
    return positive([{j: sign * x for j, x in enumerate(row)} for row in X])


def is_form(P: Matrix) -> bool:
    """True only if P is symmetric and positive definite."""
    return transpose(P) == P and definite(P)


def positive(M: Rows) -> bool:
    """True only if the symmetric matrix M is positive definite."""
    top = max(row[i] for i, row in enumerate(M))
    # of a positive definite matrix the largest entry in size stands on the diagonal
    if top <= 0 or any(abs(x) > top for row in M for x in row.values()):
        return False
    # scaled so that no entry is larger than 1, as by_factor asks
    M = [{j: x / top for j, x in row.items() if x} for row in M]
    if len(M) > 20 and has_signs(M) and by_vector(M):
        return True
    # else it takes minutes
    lengths = (bits for bits in (60, 250, 1000, 4000) if bits * len(M) < 80_000)
    return any(by_factor(M, bits) for bits in lengths)


def has_signs(M: Rows) -> bool:
    """Whether entries are positive on the diagonal, and none beside it is."""
    return all((x > 0) == (i == j) for i, row in enumerate(M) for j, x in row.items())


def by_vector(M: Rows) -> bool:
    """True if a v > 0 with M v > 0 is found: then M, whose other entries are <= 0, is positive
    definite.

    Conjugate gradients on M v = 1 propose v in floating point; the check is exact.
    """
    v = proposed(M)
    top = max(map(abs, v)) or 1.0
    whole = [round(entry / top * 2**64) if top < math.inf else 0 for entry in v]
    if not min(whole) > 0:
        return False
    return all(sum(x * whole[j] for j, x in row.items()) > 0 for row in M)


def proposed(M: Rows) -> list[float]:
    """About M^-1 1, in floating point: proves nothing."""
    size = len(M)
    rows = [[(j, float(x)) for j, x in row.items()] for row in M]
    v = [0.0] * size
    rest = [1.0] * size
    direction = [1.0] * size
    square = float(size)
    for _ in range(min(2 * size, 2000)):
        image = [sum([x * direction[j] for j, x in row]) for row in rows]
        curvature = sum(map(mul, direction, image))
        if curvature <= 0 or max(map(abs, rest)) < 0.25:
            break
        step = square / curvature
        v = [a + step * b for a, b in paired(v, direction)]
        rest = [a - step * b for a, b in paired(rest, image)]
        last = square
        square = sum(map(mul, rest, rest))
        direction = [a + square / last * b for a, b in paired(rest, direction)]
    return v


def by_factor(M: Rows, bits: int) -> bool:
    """True if Cholesky in integers runs to its end for M - shift; the entries of M are at most 1.

    In units of 2^-bits for L and 4^-bits for M, every entry of M - shift - L L' beside the diagonal
    is a remainder of a division by L_jj <= 2^bits, plus less than 1 from rounding M down, so at
    most 2^bits; on the diagonal it is not negative. With shift = (n + 1) 2^bits the matrix M - L L'
    is diagonally dominant, so M > 0.
    """
    unit = 4**bits
    shift = (len(M) + 1) << bits
    L: list[list[int]] = []
    for i, row in enumerate(M):
        own: list[int] = []
        for j, other in enumerate(L):
            entry = math.floor(row.get(j, ZERO) * unit)
            own.append((entry - sum(map(mul, own, other))) // other[j])
        square = math.floor(row.get(i, ZERO) * unit) - shift - sum(map(mul, own, own))
        # no proof at this length: M is not positive definite, or has too little room
        if square <= 0:
            return False
        L.append([*own, math.isqrt(square)])
    return True


def semidefinite(X: Matrix) -> bool:
    """True iff the symmetric matrix X is positive semidefinite, by elimination."""
    while X:
        (top, *rest), *rows = X
        # a 0 on the diagonal leaves room for nothing beside it
        if top < 0 or (top == 0 and any(rest)):
            return False
        X = [row[1:] for row in rows]
        if top:
            factors = [row[0] / top for row in rows]
            X = [combined(row, -factor, rest) for factor, row in paired(factors, X)]
    return True


def nonnegative(X: Matrix) -> bool:
    """True only if X is positive semidefinite: positive definite beside its rows of zeros, or else
    by elimination."""
    kept = [k for k, row in enumerate(X) if any(row)]
    if not kept:
        return True
    # a row of zeros adds nothing to v'X v
    X = [[X[a][b] for b in kept] for a in kept]
    return definite(X) or (len(X) <= 20 and semidefinite(X))


def largest(X: Matrix) -> Fraction:
    """An upper bound of the eigenvalues of a positive definite X, by bisection."""
    lo = ZERO
    hi = Fraction(norm(X))
    for _ in range(40):
        middle = (lo + hi) / 2
        # only what is proved lowers the upper bound
        if definite(plus(identity(len(X), middle), -1, X)):
            hi = middle
        else:
            lo = middle
    return hi
