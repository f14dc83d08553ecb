"""Rational matrices as tuples of row tuples, and the linear algebra on them, without rounding.

A matrix without rows is (); it stands for 0 x anything. Long products and eliminations are
python-flint's.
"""

import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dobc_design._checks import require_shape, require_square
from dobc_design.errors import ShapeError, SpecError, misshapen

from .number import ONE, ZERO, from_fmpq_mat, parse_number, to_fmpq_mat

Matrix: TypeAlias = tuple[tuple[Fraction, ...], ...]
Vector: TypeAlias = tuple[Fraction, ...]
Array: TypeAlias = NDArray[np.float64]
Side: TypeAlias = tuple[Fraction, Fraction]  # of a box, from and to

# Above this many scalar products the conversion to flint and back has paid for itself.
_FLINT_WORK: Final = 1000


def matrix(rows: Sequence[Sequence[object]] | NDArray[Any], *, name: str = "matrix") -> Matrix:
    """Return nested rows of numbers as an exact matrix; entries are read by ``parse_number``.
    Raises: ShapeError if the rows differ in length or are no rows; SpecError for a bad entry, with
    the key ``name[i][j]``, counted from 0."""
    if not _is_list(rows):
        raise misshapen(name, f"must be a list of rows; got {type(rows).__name__}.")
    for row in rows:
        if not _is_list(row):
            what = f"must have lists as rows; got {str(row)[:40]!r} as one."
            raise misshapen(name, what)
    require_shape(rows, (None, None), name=name)

    def read(entry: object, i: int, j: int) -> Fraction:
        if type(entry) is Fraction:
            return entry
        return parse_number(entry, f"{name}[{i}][{j}]")

    found: list[Vector] = []
    for i, row in enumerate(rows):
        found.append(tuple(read(entry, i, j) for j, entry in enumerate(row)))
    return tuple(found)


def shape(M: Matrix) -> tuple[int, int]:
    """Return (rows, columns); a matrix without rows is (0, 0)."""
    return (len(M), len(M[0]) if M else 0)


def identity(size: int) -> Matrix:
    """Return the identity, (size, size)."""
    rows: list[Vector] = []
    for i in range(size):
        rows.append(tuple(Fraction(int(i == j)) for j in range(size)))
    return tuple(rows)


def zeros(rows: int, columns: int) -> Matrix:
    """Return the zero matrix, (rows, columns)."""
    row = (ZERO,) * columns
    return (row,) * rows


def transpose(M: Matrix) -> Matrix:
    """Return M'; that of a matrix without rows is one without rows."""
    return tuple(zip(*M, strict=True))


def add(M: Matrix, N: Matrix) -> Matrix:
    """Return M + N, both (a, b). Raises: ShapeError if the shapes differ."""
    return _entrywise(operator.add, M, N)


def subtract(M: Matrix, N: Matrix) -> Matrix:
    """Return M - N, both (a, b). Raises: ShapeError if the shapes differ."""
    return _entrywise(operator.sub, M, N)


def scale(factor: Fraction | int, M: Matrix) -> Matrix:
    """Return factor * M."""
    return tuple(tuple(factor * x for x in row) for row in M)


def multiply(M: Matrix, N: Matrix) -> Matrix:
    """Return M N for M (a, b) and N (b, c). Raises: ShapeError if they do not fit."""
    a, b = shape(M)
    rows, c = shape(N)
    if b != rows:
        raise ShapeError(
            f"the right factor must have {b} rows, one per column of the left; got {rows}."
        )
    # Below that the way to flint and back takes longer than the products.
    if a * b * c > _FLINT_WORK:
        return from_fmpq_mat(to_fmpq_mat(M) * to_fmpq_mat(N))
    columns = transpose(N)
    return tuple(tuple(dot(row, column) for column in columns) for row in M)


def dot(v: Vector, w: Vector) -> Fraction:
    """Return v'w, both of one length."""
    return sum((x * y for x, y in zip(v, w, strict=True)), ZERO)


def trace(M: Matrix) -> Fraction:
    """Return the sum of the diagonal."""
    return sum((row[i] for i, row in enumerate(M)), ZERO)


def kronecker(M: Matrix, N: Matrix) -> Matrix:
    """Return the Kronecker product: M (a, b), N (c, d) give (a c, b d)."""
    rows: list[Vector] = []
    for left in M:
        for right in N:
            rows.append(tuple(x * y for x in left for y in right))
    return tuple(rows)


def inverse(M: Matrix) -> Matrix:
    """Return the inverse of a square matrix (k, k).  Raises: ShapeError; SpecError if it is
    singular."""
    size = require_square(M, "matrix to invert")
    try:
        return from_fmpq_mat(to_fmpq_mat(M).inv()) if size else ()
    except ZeroDivisionError:
        raise SpecError(f"the {size}x{size} matrix must be invertible; it is singular.") from None


def multiple_of(M: Matrix, G: Matrix) -> Fraction | None:
    """The number g with M = g G; None if there is none, or G = 0."""
    pairs: list[tuple[Fraction, Fraction]] = []
    for row, other in zip(M, G, strict=True):
        pairs += zip(row, other, strict=True)
    g = next((x / y for x, y in pairs if y), None)
    return None if g is None or any(x != g * y for x, y in pairs) else g


def left_inverse(B: Matrix) -> Matrix:
    """(B'B)^-1 B', the (p, m) matrix with left_inverse(B) B = I of a B (m, p) with full column
    rank."""
    turned = transpose(B)
    return multiply(inverse(multiply(turned, B)), turned)


def row_echelon(M: Matrix) -> tuple[Matrix, tuple[int, ...]]:
    """Return the nonzero rows of the reduced row echelon form, and the pivot column of each."""
    if 0 in shape(M):
        return (), ()
    reduced, rank_found = to_fmpq_mat(M).rref()
    # The rows of zeros come last.
    kept = from_fmpq_mat(reduced)[:rank_found]
    pivots = tuple(next(j for j, x in enumerate(row) if x) for row in kept)
    return kept, pivots


def rank(M: Matrix) -> int:
    """Return the rank."""
    return len(row_echelon(M)[1])


def nullspace(M: Matrix) -> tuple[Vector, ...]:
    """Return a basis of {v : M v = 0}, M (a, b): each vector is 1 at its own free column, 0 at
    those of the others."""
    reduced, pivots = row_echelon(M)
    size = shape(M)[1]
    basis: list[Vector] = []
    for free in range(size):
        if free in pivots:
            continue
        # The entries at the pivots follow from this one.
        vector = [ZERO] * size
        vector[free] = ONE
        for pivot, row in zip(pivots, reduced, strict=True):
            vector[pivot] = -row[free]
        basis.append(tuple(vector))
    return tuple(basis)


def find_in_nullspace(M: Matrix, box: Sequence[Side]) -> Vector | None:
    """Return a v != 0 with M v = 0, M (a, b), in a box of b sides [lo, hi]; None if there is none.
    Exact.  A box without 0 asks whether a program has a solution.  In one with 0 the longest
    multiple of any v ends at a side: then one end of a side after the other is tried."""
    if any(lo > hi for lo, hi in box):
        return None
    if not all(lo <= 0 <= hi for lo, hi in box):
        return _solve(M, box)
    for k, side in enumerate(box):
        for end in filter(None, side):
            found = _solve(M, [*box[:k], (end, end), *box[k + 1 :]])
            if found is not None:
                return found
    return None


def _solve(M: Matrix, box: Sequence[Side]) -> Vector | None:
    """A v in a nonempty box with M v = 0, by the simplex method with Bland's rule, so that it
    ends."""
    rows, basis = row_echelon(M)
    v = [max(lo, min(hi, ZERO)) for lo, hi in box]
    while True:
        solved = dict(zip(basis, rows, strict=True))
        for p, row in solved.items():  # the entries of v that follow from the others
            v[p] -= dot(row, tuple(v))
        leaving = min((p for p in basis if not box[p][0] <= v[p] <= box[p][1]), default=None)
        if leaving is None:
            return tuple(v)
        lo, hi = box[leaving]
        # The entry of least index leaves its place and the least that can help takes it (Bland).
        goal = max(lo, min(hi, v[leaving]))
        lead = solved[leaving]
        able: list[int] = []  # entries that may move so that the leaving one moves to its goal
        for k, x in enumerate(lead):
            rises = (x < 0) == (goal > v[leaving])
            if x and k not in basis and (v[k] < box[k][1] if rises else v[k] > box[k][0]):
                able.append(k)
        # The row alone shows that nothing in the box solves it.
        if not able:
            return None
        v[leaving] = goal
        k = able[0]
        basis = tuple(k if p == leaving else p for p in basis)
        pivot = tuple(x / lead[k] for x in lead)
        rows = tuple(pivot if row is lead else _without(row, pivot, k) for row in rows)


def _without(row: Vector, pivot: Vector, k: int) -> Vector:
    """The row less the multiple of the pivot's, which has a 1 there, that makes entry k 0."""
    return tuple(x - row[k] * y for x, y in zip(row, pivot, strict=True))


def row_norm(M: Matrix) -> Fraction:
    """The largest row sum of absolute values, |M|_inf."""
    return max(sum(map(abs, row), ZERO) for row in M)


def is_symmetric(M: Matrix) -> bool:
    """Return whether M is square and equals its transpose exactly."""
    return transpose(M) == tuple(map(tuple, M))


def largest_entry(values: ArrayLike) -> float:
    """The largest |entry| of an array, 0 of none."""
    return float(np.max(np.abs(values), initial=0.0))


def to_float(M: Matrix) -> Array:
    """Return the nearest floats, (a, b). Raises: SpecError if an entry is beyond their range."""
    try:
        rows = [list(map(float, row)) for row in M]
        return np.array(rows, dtype=np.float64).reshape(shape(M))
    except OverflowError as cause:
        raise SpecError("matrix entries must be below 1.8e308 to become floats.") from cause


def from_float(array: NDArray[Any], digits: int | None) -> Matrix:
    """Return a 2-D array as rationals, each entry rounded to ``digits`` significant decimals.
    ``digits`` None keeps the exact binary value. Equal floats give equal rationals, so symmetry
    stays. Raises: ShapeError unless 2-D, SpecError for nan, inf, booleans and complex numbers."""
    array = np.asarray(array)
    if array.ndim != 2:
        raise ShapeError(f"array must have 2 dimensions; got {array.ndim}.")
    if array.dtype.kind not in "iuf":
        raise SpecError(f"array must hold integers or floats; got dtype {array.dtype}.")
    if not np.isfinite(array).all():
        i, j = np.argwhere(~np.isfinite(array))[0]
        raise SpecError(f"array entry [{i}][{j}] must be finite; got {array[i, j]}.")

    def read(x: Any) -> Fraction:
        if digits is not None:
            return Fraction(f"{float(x):.{digits - 1}e}")
        if array.dtype.kind in "iu":
            return Fraction(int(x))
        # as_integer_ratio also for longdouble, which float() would round.
        return Fraction(*x.as_integer_ratio())

    return tuple(tuple(map(read, row)) for row in array)


def _is_list(value: object) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes))


def _entrywise(operation: Callable[[Fraction, Fraction], Fraction], M: Matrix, N: Matrix) -> Matrix:
    if shape(M) != shape(N):
        raise ShapeError(f"both matrices must have one shape; got {shape(M)} and {shape(N)}.")
    pairs = zip(M, N, strict=True)
    return tuple(tuple(map(operation, *pair)) for pair in pairs)


def solve_lyapunov(F: Matrix, N: Matrix) -> Matrix | None:
    """Return the symmetric X with F'X + X F + N = 0, or None if there is no unique one.  Shapes: F,
    N and X (q, q), N symmetric. X is unique iff no two eigenvalues of F add up to 0. Raises:
    ShapeError if the shapes do not fit. Source: Lyapunov 1892, as q (q + 1)/2 linear equations."""
    q = require_square(F, "F")
    require_shape(N, (q, q), name="N", because="as F")
    places = [(i, j) for i in range(q) for j in range(i, q)]
    index: dict[tuple[int, int], int] = {}  # of the unknown that stands at a place
    for k, (i, j) in enumerate(places):
        index[i, j] = index[j, i] = k
    # Only the upper triangle is unknown: X is symmetric.
    equations: list[Vector] = []
    for i, j in places:
        row = [ZERO] * len(places)
        for r in range(q):  # (F'X + XF)_ij = sum_r F_ri X_rj + X_ir F_rj
            row[index[r, j]] += F[r][i]
            row[index[i, r]] += F[r][j]
        equations.append((*row, -N[i][j]))
    reduced, pivots = row_echelon(tuple(equations))
    if pivots != tuple(range(len(places))):
        return None
    unknowns = [row[-1] for row in reduced]
    return tuple(tuple(unknowns[index[i, j]] for j in range(q)) for i in range(q))
