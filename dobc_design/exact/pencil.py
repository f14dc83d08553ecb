"""One affine matrix inequality with exact coefficients: F(x) = F0 + sum_k x_k F_k < 0.

Both sides read it: the solver turns it into floats, the verifier puts rational numbers in.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction

from dobc_design._checks import noun, positional
from dobc_design.errors import ShapeError

from .matrix import Matrix
from .number import ZERO
from .symmetric import SparseSymmetric, Symmetric

Place = tuple[str, int, int]  # unknown, row, column


@noun
class Unknown:
    """A matrix to be found."""

    name: str
    rows: int
    columns: int
    symmetric: bool

    def places(self) -> Iterator[Place]:
        """Its independent entries; of a symmetric one the upper triangle."""
        for i in range(self.rows):
            for j in range(i if self.symmetric else 0, self.columns):
                yield self.name, i, j


@positional
class Deviation:
    """What one irrational slope adds to v'Fv: 2 t v[row] (v[speaker] - v[listener]), |t| <= size.
    It is J + J' of one entry of one arc: t at (row, speaker), -t at (row, listener), and the
    transpose."""

    row: int
    speaker: int
    listener: int
    size: Fraction


@noun(eq=False)
class Pencil:
    """F(x) = constant + sum over places of x[place] coefficients[place], to be negative definite.
    ``deviations``: what the constant may differ by where slopes are irrational; none if it is
    exact.  Lambda of a large network is an IntegerSymmetric (``arrays``)."""

    name: str
    constant: Symmetric
    unknowns: tuple[Unknown, ...]
    coefficients: Mapping[Place, SparseSymmetric]
    deviations: Sequence[Deviation] = ()

    @property
    def size(self) -> int:
        return self.constant.size

    def at(self, values: Mapping[str, Matrix]) -> SparseSymmetric:
        """F at rational values of the unknowns.  Raises ShapeError if one is missing or has a wrong
        shape."""
        # Entry by entry: a sum of sparse matrices would be made anew for every unknown.
        entries = dict(self.constant.entries)
        for unknown in self.unknowns:
            value = values.get(unknown.name)
            wanted = (unknown.rows, unknown.columns)
            got = None if value is None else (len(value), len(value[0]))
            if value is None or got != wanted:
                what = (
                    f"{self.name}: {unknown.name} must have shape {wanted}; got {got or 'nothing'}."
                )
                raise ShapeError(what, key=unknown.name)
            for place in unknown.places():
                x = value[place[1]][place[2]]
                if x:
                    for where, coefficient in self.coefficients[place].entries.items():
                        entries[where] = entries.get(where, ZERO) + x * coefficient
        return SparseSymmetric(self.size, entries)


def positive(unknown: Unknown, *, floor: Fraction = ZERO) -> Pencil:
    """floor I - X < 0 for a symmetric unknown X, as a pencil."""
    return _beside(unknown, floor, factor=-1, name=f"{unknown.name} > {floor}")


def below(unknown: Unknown, *, ceiling: Fraction) -> Pencil:
    """X - ceiling I < 0 for a symmetric unknown X, as a pencil."""
    return _beside(unknown, -ceiling, factor=1, name=f"{unknown.name} < {ceiling}")


def _beside(unknown: Unknown, shift: Fraction, *, factor: int, name: str) -> Pencil:
    """Return shift I + factor X < 0."""
    n = unknown.rows
    units = {place: SparseSymmetric(n, {place[1:]: Fraction(factor)}) for place in unknown.places()}
    return Pencil(
        name=name,
        constant=SparseSymmetric(n, {}).shifted(shift),
        unknowns=(unknown,),
        coefficients=units,
    )
