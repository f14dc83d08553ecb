"""Sparse symmetric rational matrices: what a pencil over a network becomes, one entry per arc."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import require_square
from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import MAX_SHOWN
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import Matrix


@dataclass(frozen=True, slots=True, repr=False)
class SparseSymmetric(Shown):
    """A symmetric matrix (size, size), by the entries (i, j), i <= j, of its upper triangle.

    Zero entries are dropped, so equal matrices are equal objects. ``entries`` is for reading only.
    Raises: ShapeError for a negative size or an index outside the upper triangle.
    """

    size: int
    entries: Mapping[tuple[int, int], Fraction]

    def __post_init__(self) -> None:
        if self.size < 0:
            raise ShapeError(f"size must be 0 or more; got {self.size}.")
        for i, j in self.entries:
            if not 0 <= i <= j < self.size:
                raise ShapeError(f"entry ({i}, {j}) must lie in the upper triangle, 0 <= i <= j < {self.size}.")
        kept = {
            place: value if type(value) is Fraction else Fraction(value)
            for place, value in self.entries.items()
            if value
        }
        object.__setattr__(self, "entries", kept)

    def _card(self) -> Card:
        text = f"{self.size} × {self.size}, {len(self.entries)} entries in the upper triangle"
        facts = [("M", self.to_dense())] if 0 < self.size <= MAX_SHOWN else []
        return Card(title="Symmetric matrix", text=text, facts=facts)

    def __repr__(self) -> str:
        return f"<SparseSymmetric of size {self.size} with {len(self.entries)} entries>"

    @classmethod
    def from_dense(cls, M: Matrix, *, name: str = "matrix") -> SparseSymmetric:
        """Return the sparse form of M (n, n).

        Raises: ShapeError if M is not square, or not exactly symmetric.
        """
        size = require_square(M, name=name)
        for i in range(size):
            for j in range(i):
                if M[i][j] != M[j][i]:
                    raise ShapeError(
                        f"{name} must be exactly symmetric; entries [{j}][{i}] and [{i}][{j}] differ.",
                        key=name,
                        cure="Take (M + M')/2 if its symmetric part is meant.",
                    )
        return cls(size, {(i, j): M[i][j] for i in range(size) for j in range(i, size)})

    def to_dense(self) -> Matrix:
        """Return the full matrix (n, n)."""
        rows = [[Fraction(0)] * self.size for _ in range(self.size)]
        for (i, j), value in self.entries.items():
            rows[i][j] = rows[j][i] = value
        return tuple(tuple(row) for row in rows)

    def diagonal(self) -> list[Fraction]:
        """Return the n entries of the diagonal."""
        return [self.entries.get((i, i), Fraction(0)) for i in range(self.size)]

    def negated(self) -> SparseSymmetric:
        """Return -M."""
        return self.scaled(-1)

    def scaled(self, factor: Fraction | int) -> SparseSymmetric:
        """Return factor * M."""
        return SparseSymmetric(self.size, {place: factor * x for place, x in self.entries.items()})

    def shifted(self, shift: Fraction | int) -> SparseSymmetric:
        """Return M + shift * I."""
        return self + SparseSymmetric(self.size, {(i, i): Fraction(shift) for i in range(self.size)})

    def __add__(self, other: SparseSymmetric) -> SparseSymmetric:
        """Return the sum. Raises: ShapeError if the sizes differ."""
        if not isinstance(other, SparseSymmetric):
            return NotImplemented
        if self.size != other.size:
            raise ShapeError(f"both matrices must have one size; got {self.size} and {other.size}.")
        total = dict(self.entries)
        for place, value in other.entries.items():
            total[place] = total.get(place, Fraction(0)) + value
        return SparseSymmetric(self.size, total)

    def restricted(self, rows: Sequence[int]) -> SparseSymmetric:
        """Return the matrix of these rows and columns, in their order."""
        place = {row: k for k, row in enumerate(rows)}
        return SparseSymmetric(
            len(place),
            {
                (min(place[i], place[j]), max(place[i], place[j])): value
                for (i, j), value in self.entries.items()
                if i in place and j in place
            },
        )

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
                product = (1 if i == j else 2) * value.numerator * v[i] * v[j]
                sums[value.denominator] = sums.get(value.denominator, 0) + product
        return _pairwise_sum([Fraction(x, y) for y, x in sums.items()]) / (common * common)

    def triplets(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
        """Return rows, columns and nearest floats of the full matrix, both triangles."""
        places = [
            (i, j, float(value))
            for (a, b), value in self.entries.items()
            for i, j in ({(a, b), (b, a)} if a != b else {(a, b)})
        ]
        places.sort()
        rows = np.array([place[0] for place in places], dtype=np.intp)
        columns = np.array([place[1] for place in places], dtype=np.intp)
        return rows, columns, np.array([place[2] for place in places], dtype=np.float64)


def _pairwise_sum(terms: list[Fraction]) -> Fraction:
    """Add up by halves, so that long denominators arise in the last sums only."""
    while len(terms) > 1:
        terms = [sum(terms[k : k + 2], Fraction(0)) for k in range(0, len(terms), 2)]
    return terms[0] if terms else Fraction(0)
