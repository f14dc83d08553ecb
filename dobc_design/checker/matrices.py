"""Matrices over the rationals: elimination, polynomials, definiteness.

Of definiteness True is a proof, False says that there is none here. Floating point only proposes a
vector.
"""

import math
from fractions import Fraction
from itertools import pairwise, zip_longest
from operator import mul
from typing import Any

from .reading import need, still

Matrix = list[list[Fraction]]
Rows = list[dict[int, Fraction]]  # a sparse matrix
ZERO = Fraction(0)


def root(square: Fraction) -> Fraction:
    """An upper bound of a square root."""
    return Fraction(math.isqrt(math.ceil(square * 4**60)) + 1, 2**60)


# --- Sums and products
# ------------------------------------------------------------------------------------------------
def identity(size: int, factor: Fraction | int = 1) -> Matrix:
    """The identity times a factor; 0 gives a matrix of zeros."""
    return [[Fraction(factor * (i == j)) for j in range(size)] for i in range(size)]


def transpose(X: Matrix) -> Matrix:
    """X'."""
    return [list(column) for column in zip(*X, strict=True)]


def product(X: Matrix, Y: Matrix) -> Matrix:
    """X Y, in integers."""
    columns = [integers(column) for column in transpose(Y)]
    return [[Fraction(sum(map(mul, a, b)), c * d) for b, d in columns] for a, c in map(integers, X)]


def plus(X: Matrix, factor: Fraction | int, Y: Matrix) -> Matrix:
    """X + factor Y."""
    return [[a + factor * b for a, b in zip(*rows, strict=True)] for rows in zip(X, Y, strict=True)]


def form(u: list[Fraction], X: Matrix, v: list[Fraction]) -> Fraction:
    """The number u'X v."""
    return sum(
        (a * x * b for a, row in zip(u, X, strict=True) for x, b in zip(row, v, strict=True)), ZERO
    )


def diagonal(blocks: list[Any]) -> Matrix:
    """Blocks along the diagonal, zeros elsewhere."""
    width, before, rows = sum(len(each[0]) for each in blocks), 0, Matrix()
    for each in blocks:
        rows += [[ZERO] * before + list(row) + [ZERO] * (width - before - len(row)) for row in each]
        before += len(each[0])
    return rows


def integers(v: list[Fraction]) -> tuple[list[int], int]:
    """A vector as integers over one integer."""
    bottom = math.lcm(*{x.denominator for x in v})
    return [int(x * bottom) for x in v], bottom


# --- Elimination
# --------------------------------------------------------------------------------------------------
def echelon(X: Matrix) -> tuple[Matrix, list[int]]:
    """The nonzero rows of the reduced row echelon form, and the columns of their leading ones; in
    integers."""
    rest, rows, pivots = [integers(row)[0] for row in X], list[list[int]](), list[int]()
    for column in range(len(X[0]) if X else 0):
        still()
        lead = next((row for row in rest if row[column]), None)
        if lead is not None:
            rest = [without(row, lead, column) for row in rest if row is not lead]
            rows, pivots = [*(without(row, lead, column) for row in rows), lead], [*pivots, column]
    return [
        [Fraction(x, row[lead]) for x in row] for row, lead in zip(rows, pivots, strict=True)
    ], pivots


def without(row: list[int], lead: list[int], column: int) -> list[int]:
    """A multiple of the row, less one of ``lead``, so that its entry in the column is 0, without
    common factors."""
    left = [lead[column] * x - row[column] * y for x, y in zip(row, lead, strict=True)]
    return [x // factor for factor in [math.gcd(*left) or 1] for x in left]


def nullspace(X: Matrix, size: int) -> tuple[Matrix, list[int]]:
    """A basis of {v: X v = 0} in R^size, one vector per free column, and the free columns."""
    rows, pivots = echelon(X)
    free, row = (
        [column for column in range(size) if column not in pivots],
        dict(zip(pivots, rows, strict=True)),
    )
    return [
        [-row[k][column] if k in row else Fraction(k == column) for k in range(size)]
        for column in free
    ], free


def meets(rows: Matrix, basis: list[int], box: list[Any]) -> bool:
    """True iff some v with rows v = 0 lies in a box; rows in echelon form, basis: the columns of
    their leading ones.

    The simplex method without an objective, with the rule of Bland, which ends: x has the other
    entries of v.
    """
    x = [ZERO if k in basis else max(lo, min(hi, ZERO)) for k, (lo, hi) in enumerate(box)]
    while wrong := [
        (k, value, row)
        for k, value, row in zip(basis, (-sum(map(mul, row, x)) for row in rows), rows, strict=True)
        if not box[k][0] <= value <= box[k][1]
    ]:
        k, value, lead = min(wrong)
        x[k] = max(box[k][0], min(box[k][1], value))
        helps = (
            (x[j] < hi) if (lead[j] < 0) == (value < x[k]) else (x[j] > lo)
            for j, (lo, hi) in enumerate(box)
        )
        able = [j for j, each in enumerate(helps) if each and lead[j] and j != k]
        if not able:
            return False
        x[able[0]], scaled = ZERO, [entry / lead[able[0]] for entry in lead]
        rows = [scaled if row is lead else plus([row], -row[able[0]], [scaled])[0] for row in rows]
        basis = [able[0] if each == k else each for each in basis]
    return True


# --- Polynomials
# --------------------------------------------------------------------------------------------------
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
        upper, lower = (
            lower,
            [a - factor * b for a, b in zip_longest(upper[1:], lower[1:], fillvalue=ZERO)],
        )
    return column


def stable(X: Matrix) -> bool:
    """True iff every eigenvalue of X has a negative real part."""
    return min(routh(characteristic(X))) > 0


def unstable(X: Matrix, count: int) -> bool:
    """True if X is seen to have at least ``count`` eigenvalues with positive real part.

    Sign changes in Routh's column count the roots to the right of delta >= 0, if no entry of it is
    0.
    """
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
        need(
            max(abs(c.numerator), c.denominator) < 10**4000,
            "a polynomial has coefficients of more than 4000 digits",
        )
        symbol = "" if power == 0 else "s" if power == 1 else f"s^{power}"
        size = "" if abs(c) == 1 and symbol else f"{abs(c)} "
        text += f" {'-' if c < 0 else '+'} {size}{symbol}".rstrip() if c else ""
    return text.removeprefix(" + ")


# --- Definiteness
# --------------------------------------------------------------------------------------------------
def definite(X: Matrix, sign: int = 1) -> bool:
    """True only if the symmetric matrix sign X is positive definite."""
    return positive([{j: sign * x for j, x in enumerate(row)} for row in X])


def positive(M: Rows) -> bool:
    """True only if the symmetric matrix M is positive definite."""
    top = max(row[i] for i, row in enumerate(M))
    if top <= 0 or any(abs(x) > top for row in M for x in row.values()):
        return False
    M = [{j: x / top for j, x in row.items() if x} for row in M]
    signs = ((x > 0) == (i == j) for i, row in enumerate(M) for j, x in row.items())
    # else it takes minutes
    lengths = (bits for bits in (60, 250, 1000, 4000) if bits * len(M) < 80_000)
    return (len(M) > 20 and all(signs) and by_vector(M)) or any(
        by_factor(M, bits) for bits in lengths
    )


def by_vector(M: Rows) -> bool:
    """True if a v > 0 with M v > 0 is found: then M, whose other entries are <= 0, is positive
    definite.

    Conjugate gradients on M v = 1 propose v in floating point; the check is exact.
    """
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
    """True if Cholesky in integers runs to its end for M - shift; the entries of M are at most 1.

    In units of 2^-bits for L and 4^-bits for M, every entry of M - shift - L L' beside the diagonal
    is a remainder of a division by L_jj <= 2^bits, plus less than 1 from rounding M down, so at
    most 2^bits; on the diagonal it is not negative. With shift = (n + 1) 2^bits the matrix M - L L'
    is diagonally dominant, so M > 0.
    """
    L: list[list[int]] = []
    for i, row in enumerate(M):
        own: list[int] = []
        for j, other in enumerate(L):
            own.append(
                (math.floor(row.get(j, ZERO) * 4**bits) - sum(map(mul, own, other))) // other[j]
            )
        square = (
            math.floor(row.get(i, ZERO) * 4**bits)
            - ((len(M) + 1) << bits)
            - sum(map(mul, own, own))
        )
        if square <= 0:
            return False
        L.append([*own, math.isqrt(square)])
    return True


def semidefinite(X: Matrix) -> bool:
    """True iff the symmetric matrix X is positive semidefinite, by elimination."""
    while X:
        (top, *rest), *rows = X
        if top < 0 or (top == 0 and any(rest)):
            return False
        X = [
            [x - row[0] * y / top if top else x for x, y in zip(row[1:], rest, strict=True)]
            for row in rows
        ]
    return True


def nonnegative(X: Matrix) -> bool:
    """True only if X is positive semidefinite: positive definite beside its rows of zeros, or else
    by elimination."""
    kept = [k for k, row in enumerate(X) if any(row)]
    X = [[X[a][b] for b in kept] for a in kept]
    return not X or definite(X) or (len(X) <= 20 and semidefinite(X))


def largest(X: Matrix) -> Fraction:
    """An upper bound of the eigenvalues of a positive definite X, by bisection."""
    lo, hi = ZERO, max(sum(map(abs, row), ZERO) for row in X)
    for _ in range(40):
        middle = (lo + hi) / 2
        lo, hi = (lo, middle) if definite(plus(identity(len(X), middle), -1, X)) else (middle, hi)
    return hi
