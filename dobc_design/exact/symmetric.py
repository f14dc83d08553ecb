"""Sparse symmetric rational matrices: what a pencil over a network becomes, one entry per arc."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Final, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun, positional, require_square
from dobc_design._show.cards import Card, Shown, plain
from dobc_design._show.text import MAX_SHOWN
from dobc_design.errors import ShapeError, SpecError, misshapen, wrong

from .matrix import Matrix, Vector
from .number import ZERO, common_denominator

# rows, columns and values


Entries: TypeAlias = dict[tuple[int, int], Fraction]  # (row, column) -> value


@positional
class SparseSymmetric(Shown):
    """A symmetric matrix (size, size), by the entries (i, j), i <= j, of its upper triangle; for
    reading only.  Zeros are dropped: equal matrices are equal objects. Raises: ShapeError for an
    index outside the upper triangle."""

    size: int
    entries: Mapping[tuple[int, int], Fraction]

    def __post_init__(self) -> None:
        if self.size < 0:
            raise ShapeError(f"size must be 0 or more; got {self.size}.")
        for i, j in self.entries:
            if not 0 <= i <= j < self.size:
                raise ShapeError(
                    f"entry ({i}, {j}) must lie in the upper triangle, 0 <= i <= j < {self.size}."
                )
        kept: Entries = {}
        for place, x in self.entries.items():
            if x:
                kept[place] = x if type(x) is Fraction else Fraction(x)
        object.__setattr__(self, "entries", kept)

    def _card(self) -> Card:
        text = f"{self.size} × {self.size}, {len(self.entries)} entries in the upper triangle"
        facts = [("M", self.to_dense())] if 0 < self.size <= MAX_SHOWN else []
        return Card(title="Symmetric matrix", text=text, facts=facts)

    def __repr__(self) -> str:
        return f"<SparseSymmetric of size {self.size} with {len(self.entries)} entries>"

    @classmethod
    def from_dense(cls, M: Matrix, *, name: str = "matrix") -> SparseSymmetric:
        """Return the sparse form of M (n, n). Raises: ShapeError if M is not square, or not exactly
        symmetric."""
        size = require_square(M, name)
        entries: Entries = {}
        for i in range(size):
            for j in range(i, size):
                if M[i][j] != M[j][i]:
                    what = f"must be exactly symmetric; entries [{i}][{j}] and [{j}][{i}] differ."
                    cure = "Take (M + M')/2 if its symmetric part is meant."
                    raise misshapen(name, what, cure)
                entries[i, j] = M[i][j]
        return cls(size, entries)

    def to_dense(self) -> Matrix:
        """Return the full matrix, (size, size)."""
        rows = [[ZERO] * self.size for _ in range(self.size)]
        for (i, j), value in self.entries.items():
            rows[i][j] = rows[j][i] = value
        return tuple(tuple(row) for row in rows)

    def rows(self) -> list[dict[int, Fraction]]:
        """Return the entries of every row by column, both triangles."""
        rows: list[dict[int, Fraction]] = [{} for _ in range(self.size)]
        for (i, j), value in self.entries.items():
            rows[i][j] = rows[j][i] = value
        return rows

    def diagonal(self) -> list[Fraction]:
        return [self.entries.get((i, i), ZERO) for i in range(self.size)]

    @property
    def is_diagonal(self) -> bool:
        """Whether it has no entries beside the diagonal, not even zeros."""
        return all(i == j for i, j in self.entries)

    def negated(self) -> SparseSymmetric:
        return self.scaled(-1)

    def scaled(self, factor: Fraction | int) -> SparseSymmetric:
        entries = {place: factor * x for place, x in self.entries.items()}
        return SparseSymmetric(self.size, entries)

    def shifted(self, shift: Fraction | int) -> SparseSymmetric:
        """Return M + shift I."""
        diagonal = {(i, i): Fraction(shift) for i in range(self.size)}
        return self + SparseSymmetric(self.size, diagonal)

    def __add__(self, other: SparseSymmetric) -> SparseSymmetric:
        """Return the sum. Raises: ShapeError if the sizes differ."""
        if not isinstance(other, SparseSymmetric):
            return NotImplemented
        if self.size != other.size:
            raise ShapeError(f"both matrices must have one size; got {self.size} and {other.size}.")
        total = dict(self.entries)
        for place, value in other.entries.items():
            total[place] = total.get(place, ZERO) + value
        return SparseSymmetric(self.size, total)

    def restricted(self, rows: Sequence[int]) -> SparseSymmetric:
        """Return the matrix of these rows and columns, in their order."""
        place = {row: k for k, row in enumerate(rows)}
        kept: Entries = {}
        for (i, j), x in self.entries.items():
            if i in place and j in place:
                low, high = sorted((place[i], place[j]))
                kept[low, high] = x
        return SparseSymmetric(len(place), kept)

    def quadratic_form(self, vector: Sequence[Fraction | int]) -> Fraction:
        """Return v' M v for a vector of length n. Raises: ShapeError if the length differs."""
        if len(vector) != self.size:
            raise ShapeError(f"vector must have {self.size} entries; got {len(vector)}.")
        # Integers over one denominator: sums of long fractions would reduce at every step.
        common = math.lcm(1, *(x.denominator for x in vector))
        v = [x.numerator * (common // x.denominator) for x in vector]
        # One integer sum per denominator: a common one may be as long as the matrix has entries.
        sums: dict[int, int] = {}
        for (i, j), value in self.entries.items():
            if v[i] and v[j]:
                often = 1 if i == j else 2
                product = often * value.numerator * v[i] * v[j]
                sums[value.denominator] = sums.get(value.denominator, 0) + product
        total = _pairwise_sum([Fraction(x, y) for y, x in sums.items()])
        return total / (common * common)


def _pairwise_sum(terms: list[Fraction]) -> Fraction:
    """Add up by halves, so that long denominators arise in the last sums only."""
    while len(terms) > 1:
        pairs = (terms[k : k + 2] for k in range(0, len(terms), 2))
        terms = [sum(pair, ZERO) for pair in pairs]
    return terms[0] if terms else ZERO


Integers = NDArray[Any]  # int64, or object with Python integers where 64 bits are too few
Places = NDArray[np.int64]

# Entries whose Python integers exist at one time, where Python integers are needed.
_CHUNK: Final = 1 << 16
# A common denominator longer than this is not worth its length in every entry.
DENOMINATOR_BITS: Final = 512
# A double is an integer below 2^53 times a power of two.
_MANTISSA: Final = 53
# int64 is used for numbers below this, so that the sum of two still fits.
_LIMIT: Final = 1 << 62


@noun(eq=False)
class IntegerSymmetric(Shown):
    """A symmetric matrix (size, size): values / denominator at the places (rows, columns), rows <=
    columns.

    ``values`` are int64, or an object array of int. The constructor takes the places in any order,
    adds up what is given for one place, drops zeros, and sorts by row, then column. The arrays are
    for reading only.
    Raises: ShapeError for places outside the upper triangle or arrays of different lengths;
    SpecError for values that are no integers or a denominator below 1.
    """

    size: int
    rows: Places
    columns: Places
    values: Integers
    denominator: int = 1

    def __post_init__(self) -> None:
        if not len(self.rows) == len(self.columns) == len(self.values):
            lengths = f"{len(self.rows)}, {len(self.columns)} and {len(self.values)}"
            raise ShapeError(f"rows, columns and values must have one length; got {lengths}.")
        if self.denominator < 1:
            raise SpecError(f"denominator must be at least 1; got {self.denominator}.")
        rows = np.asarray(self.rows, dtype=np.int64)
        columns = np.asarray(self.columns, dtype=np.int64)
        if not self._holds(rows, columns):
            raise ShapeError(
                f"every entry must lie in the upper triangle, 0 <= i <= j < {self.size}."
            )
        values = _integers(self.values)
        if self.size < 1 << 31:  # then places are numbers of 64 bits, which are sorted faster
            order = np.argsort(rows * self.size + columns, kind="stable")
        else:
            order = np.lexsort((columns, rows))
        rows, columns, values = _added_up(rows[order], columns[order], values[order])
        for name, array in (("rows", rows), ("columns", columns), ("values", values)):
            # Other matrices may share them.
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def _holds(self, rows: Places, columns: Places) -> bool:
        """Whether all places lie in the upper triangle."""
        if self.size < 0:
            return False
        if not len(rows):
            return True
        return bool(rows.min() >= 0 and columns.max() < self.size and (rows <= columns).all())

    def _card(self) -> Card:
        text = f"{self.size} × {self.size}, {len(self.values)} entries in the upper triangle"
        text += f", over {plain(self.denominator)}"
        return Card(title="Symmetric matrix of integers", text=text)

    def __repr__(self) -> str:
        return f"<IntegerSymmetric of size {self.size} with {len(self.values)} entries>"

    @classmethod
    def from_sparse(cls, M: SparseSymmetric) -> IntegerSymmetric:
        """Return the same matrix. The common denominator is the least one; it may be long."""
        denominator = math.lcm(1, *{x.denominator for x in M.entries.values()})
        values = [x.numerator * (denominator // x.denominator) for x in M.entries.values()]
        return cls._of(M, values, denominator)

    @classmethod
    def weakened(cls, M: Symmetric, *, bits: int) -> IntegerSymmetric:
        """Return a matrix over 2^bits, rounded to where domination by the diagonal is harder
        (``zmatrix``)."""
        rounded: list[int] = []
        for (i, j), x in M.entries.items():
            # Downwards, which makes the diagonal smaller and what is < 0 beside it larger in size;
            # what is > 0 beside it upwards.
            if i == j or x < 0:
                rounded.append((x.numerator << bits) // x.denominator)
            else:
                rounded.append(-((-x.numerator << bits) // x.denominator))
        return cls._of(M, rounded, 1 << bits)

    @classmethod
    def _of(cls, M: Symmetric, values: list[int], denominator: int) -> IntegerSymmetric:
        """The matrix with these values, over the denominator, at the places of M, in its order."""
        count = len(M.entries)
        rows = np.fromiter((i for i, _ in M.entries), dtype=np.int64, count=count)
        columns = np.fromiter((j for _, j in M.entries), dtype=np.int64, count=count)
        whole = as_integers(values)
        return cls(size=M.size, rows=rows, columns=columns, values=whole, denominator=denominator)

    @classmethod
    def from_floats(cls, matrix: NDArray[np.floating[Any]]) -> IntegerSymmetric:
        """Return the exact binary value of a symmetric float array (n, n).  Raises: ShapeError;
        SpecError."""
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            raise misshapen("matrix", f"must be square; got shape {matrix.shape}.")
        if not np.isfinite(matrix).all():
            raise wrong("matrix", "must have finite entries only; it holds nan or inf.")
        if not np.array_equal(matrix, matrix.T):
            raise misshapen("matrix", "must be exactly symmetric.", "Take (M + M')/2.")
        rows, columns = np.nonzero(np.triu(matrix))
        # Every entry is fraction 2^exponent, fraction 2^53 an integer; the lowest power of two is
        # what all have in common.
        fractions, exponents = np.frexp(matrix[rows, columns].astype(np.float64))
        whole = np.ldexp(fractions, _MANTISSA).astype(np.int64)
        lowest = int(exponents.min(initial=_MANTISSA)) - _MANTISSA
        shifts = exponents - _MANTISSA - lowest
        if shifts.max(initial=0) < 10:  # 53 bits and these stay below 64
            values = whole << shifts
        else:
            values = whole.astype(object) << shifts.astype(object)
        if lowest > 0:
            values = as_integers(values * (1 << lowest))
        denominator = 1 << max(-lowest, 0)
        size = len(matrix)
        return cls(size=size, rows=rows, columns=columns, values=values, denominator=denominator)

    def to_sparse(self) -> SparseSymmetric:
        """Return the same matrix, with reduced fractions."""
        entries: Entries = {}
        listed = zip(self.rows.tolist(), self.columns.tolist(), self.values.tolist(), strict=True)
        for i, j, x in listed:
            entries[i, j] = Fraction(x, self.denominator)
        return SparseSymmetric(self.size, entries)

    def to_dense(self) -> Matrix:
        return self.to_sparse().to_dense()

    @property
    def entries(self) -> Mapping[tuple[int, int], Fraction]:
        """The entries one by one, made anew at each call: for few."""
        return self.to_sparse().entries

    def negated(self) -> IntegerSymmetric:
        return replace(self, values=-self.values)

    def shifted(self, shift: Fraction | int) -> IntegerSymmetric:
        """Return M + shift I."""
        top, bottom = Fraction(shift).as_integer_ratio()
        # A long shift needs Python's integers.
        kind = np.int64 if abs(top) < _LIMIT else object
        places = np.arange(self.size)
        tops = np.full(self.size, top, dtype=kind)
        diagonal = IntegerSymmetric(
            size=self.size, rows=places, columns=places, values=tops, denominator=bottom
        )
        return self + diagonal

    def __add__(self, other: SparseSymmetric | IntegerSymmetric) -> IntegerSymmetric:
        """Return the sum.  Raises: ShapeError if the sizes differ."""
        if not isinstance(other, SparseSymmetric | IntegerSymmetric):
            return NotImplemented
        if self.size != other.size:
            raise ShapeError(f"both matrices must have one size; got {self.size} and {other.size}.")
        more = other if isinstance(other, IntegerSymmetric) else IntegerSymmetric.from_sparse(other)
        # Numerators over one denominator, so that sums are those of integers.
        common = math.lcm(self.denominator, more.denominator)
        own = _times(self.values, common // self.denominator)
        others = _times(more.values, common // more.denominator)
        return IntegerSymmetric(  # which adds up what lies at one place
            size=self.size,
            rows=np.concatenate((self.rows, more.rows)),
            columns=np.concatenate((self.columns, more.columns)),
            values=np.concatenate([own, others]),
            denominator=common,
        )

    __radd__ = __add__

    def restricted(self, rows: Sequence[int]) -> SparseSymmetric:
        """Return the matrix of these rows and columns, in their order."""
        # -1: not among the rows.
        place = np.full(self.size, -1, dtype=np.int64)
        place[list(rows)] = np.arange(len(rows))
        i = place[self.rows]
        j = place[self.columns]
        chosen = (i >= 0) & (j >= 0)
        low = np.minimum(i, j)[chosen].tolist()
        high = np.maximum(i, j)[chosen].tolist()
        values = self.values[chosen].tolist()
        entries: Entries = {}
        for first, second, x in zip(low, high, values, strict=True):
            entries[first, second] = Fraction(x, self.denominator)
        return SparseSymmetric(len(rows), entries)

    def diagonal(self) -> list[Fraction]:
        on = self.rows == self.columns
        found = dict(zip(self.rows[on].tolist(), self.values[on].tolist(), strict=True))
        return [Fraction(found.get(i, 0), self.denominator) for i in range(self.size)]

    def quadratic_form(self, vector: Any) -> Fraction:
        """Return v' M v for integers or fractions v, n of them. Raises: ShapeError if the length
        differs."""
        if len(vector) != self.size:
            raise ShapeError(f"vector must have {self.size} entries; got {len(vector)}.")
        common = math.lcm(1, *{x.denominator for x in vector})
        v = np.array([x.numerator * (common // x.denominator) for x in vector], dtype=object)
        support = np.array([bool(x) for x in vector], dtype=bool)
        # Of a sparse vector few entries count.
        where = np.flatnonzero(support[self.rows] & support[self.columns])
        total = 0
        for start in range(0, len(where), _CHUNK):
            k = where[start : start + _CHUNK]
            rows = self.rows[k]
            columns = self.columns[k]
            often = np.where(rows == columns, 1, 2)
            products = often * self.values[k].astype(object) * v[rows] * v[columns]
            total += int(np.sum(products))
        return Fraction(total, self.denominator * common * common)


Symmetric: TypeAlias = SparseSymmetric | IntegerSymmetric


def in_integers(M: Symmetric) -> IntegerSymmetric | None:
    """Return the same matrix in arrays, or None if its least common denominator is longer than 512
    bits."""
    if isinstance(M, IntegerSymmetric):
        return M
    short = common_denominator(M.entries.values(), bits=DENOMINATOR_BITS) is not None
    return IntegerSymmetric.from_sparse(M) if short else None


@noun(eq=False)
class Rows:
    """Both triangles, row by row: row i has the columns and values from starts[i] on. No row is
    empty."""

    starts: Places
    rows: Places
    columns: Places
    values: Integers


def both_triangles(M: IntegerSymmetric) -> Rows | None:
    """Return the full matrix row by row, or None if a row is zero or the matrix is empty."""
    beside = M.rows != M.columns
    rows = np.concatenate((M.rows, M.columns[beside]))
    order = np.argsort(rows, kind="stable")
    rows = rows[order]
    starts = np.searchsorted(rows, np.arange(M.size))
    # ``reduceat`` knows no empty rows.
    if M.size == 0 or np.bincount(rows, minlength=M.size).min() == 0:
        return None
    columns = np.concatenate((M.columns, M.rows[beside]))[order]
    values = np.concatenate((M.values, M.values[beside]))[order]
    return Rows(starts=starts, rows=rows, columns=columns, values=values)


def signs_of_product(M: Rows, vector: Integers) -> NDArray[np.int64]:
    """Return the sign of every entry of M v, exactly, v integers: sums of limbs stay below 2^62, 16
    pairs per level."""
    degree = int(np.diff(M.starts, append=len(M.rows)).max())
    bits = (58 - degree.bit_length()) // 2
    left = limbs(M.values, bits)
    right = limbs(vector, bits)
    # More pairs of limbs in one level than 62 bits hold.
    if min(len(left), len(right)) > 16:
        product = np.add.reduceat(M.values.astype(object) * vector[M.columns], M.starts)
        return (product > 0).astype(np.int64) - (product < 0)
    size = len(M.starts)
    # Limb times limb: a product belongs to the level of the power of two that both stand for.
    levels = [np.zeros(size, dtype=np.int64) for _ in range(len(left) + len(right) - 1)]
    for upper, y in enumerate(right):
        gathered = y[M.columns]
        for lower, x in enumerate(left):
            levels[lower + upper] += np.add.reduceat(x * gathered, M.starts)
    carry = np.zeros(size, dtype=np.int64)
    rest = np.zeros(size, dtype=bool)  # whether anything is left below the carry
    for level in levels:
        total = level + carry
        carry = total >> bits
        rest |= (total & ((1 << bits) - 1)) != 0
    # The number is carry 2^(..) + rest with 0 <= rest: its sign is the carry's, or that of the
    # rest.
    return np.where(carry != 0, np.sign(carry), rest.astype(np.int64))


def limbs(values: Integers, bits: int) -> list[NDArray[np.int64]]:
    """Cut integers into limbs in [0, 2^bits), low first; the last one has the sign, and is in
    [-2^bits, 2^bits)."""
    found: list[NDArray[np.int64]] = []
    mask = (1 << bits) - 1
    while True:
        found.append((values & mask).astype(np.int64))
        values = values >> bits
        # Nothing but signs is left.
        if len(values) == 0 or (values.min() >= -1 and values.max() <= 0):
            found[-1] += values.astype(np.int64) << bits
            return found


def as_integers(values: Any) -> Integers:
    """Return int64 where every integer is below 2^62 in size, else an object array of int."""
    numbers = np.array(values, dtype=object)
    return numbers.astype(np.int64) if _is_short(numbers) else numbers


def _times(values: Integers, factor: int) -> Integers:
    """The products, in 64 bits where they fit."""
    if factor == 1:
        return values
    if values.dtype != object and len(values) and _magnitude(values) * factor < _LIMIT:
        return values * factor
    return as_integers(values.astype(object) * factor)


def _magnitude(values: Integers) -> int:
    """The largest size of some integers, at least one."""
    return max(int(values.max()), -int(values.min()))


def _is_short(array: Integers) -> bool:
    return len(array) == 0 or (array.max() < _LIMIT and array.min() > -_LIMIT)


def _integers(values: Any) -> Integers:
    array = np.asarray(values)
    if array.dtype.kind in "iu" and _is_short(array):
        return array.astype(np.int64)
    if not all(type(x) is int for x in array.tolist()):
        raise SpecError(
            "values must be integers; put what they have in common into the denominator."
        )
    return as_integers(array)


def _added_up(rows: Places, columns: Places, values: Integers) -> tuple[Places, Places, Integers]:
    """Add up the values of equal neighbouring places, and drop what is 0."""
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[1:] != rows[:-1]) | (columns[1:] != columns[:-1])
    if not new.all():
        starts = np.flatnonzero(new)
        rows = rows[starts]
        columns = columns[starts]
        most = int(np.diff(starts, append=len(new)).max())  # values at one place
        # Their sum has to fit into 64 bits, else Python's integers add up.
        if values.dtype == object or most * _magnitude(values) >= _LIMIT:
            values = values.astype(object)
        values = np.add.reduceat(values, starts)
        if values.dtype == object:
            values = as_integers(values)
    kept = values != 0
    if kept.all():
        return rows, columns, values
    return rows[kept], columns[kept], values[kept]


class Doubles(Sequence[Fraction]):
    """Finite doubles (n,), read as the exact binary fractions that they are.  Never changed."""

    __slots__ = ("array",)

    def __init__(self, array: NDArray[np.float64]) -> None:
        """Raises: ValueError unless the array has one dimension and finite entries."""
        if array.ndim != 1 or not np.all(np.isfinite(array)):
            raise ValueError("a vector of doubles must have one dimension and finite entries.")
        self.array = np.array(array, dtype=np.float64)
        self.array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.array)

    @overload
    def __getitem__(self, place: int) -> Fraction: ...

    @overload
    def __getitem__(self, place: slice) -> Vector: ...

    def __getitem__(self, place: int | slice) -> Fraction | Vector:
        found = self.array[place].tolist()
        if isinstance(found, list):
            return tuple(map(Fraction, found))
        return Fraction(found)

    def __iter__(self) -> Iterator[Fraction]:
        return map(Fraction, self.array.tolist())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Doubles) and np.array_equal(self.array, other.array)

    def __hash__(self) -> int:
        return hash(self.array.tobytes())

    def __repr__(self) -> str:
        return f"Doubles({len(self)} entries)"


def least(v: Sequence[Fraction]) -> Fraction:
    """Return the least of some numbers, at least one."""
    return Fraction(float(v.array.min())) if isinstance(v, Doubles) else min(v)


def largest(v: Sequence[Fraction]) -> Fraction:
    """Return the largest of some numbers, at least one."""
    return Fraction(float(v.array.max())) if isinstance(v, Doubles) else max(v)
