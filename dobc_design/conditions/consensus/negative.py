"""Negative definiteness of an enclosed symmetric matrix: proved, refuted by a vector, or undecided.

The matrix is known up to what its irrational slopes leave open (``exact.pencil.Deviation``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.consensus.claim import Deviations
from dobc_design.conditions.numbers import shorten
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import float_above
from dobc_design.exact.pencil import Deviation
from dobc_design.exact.symmetric import IntegerSymmetric, SparseSymmetric, Symmetric, in_integers
from dobc_design.exact.zmatrix import row_bound
from dobc_design.verdict import Verdict

ZERO = Fraction(0)
TOPS = (1, 2, 3, 5, 9, 20, 99, 9999)  # the largest entry of a rounded direction
LONG, SHORT = 1024, 256  # bits of entries that are rounded first, and of what they are rounded to
MOST_WORK = 20_000_000  # products in an elimination of more than 2000 rows, some tens of seconds
LARGEST_SUPPORT = 300  # rows up to which a candidate's rows are eliminated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Enclosed:
    """middle + a block for each agent + deviations, each with any t of its own, |t| <= size.

    ``blocks``: none, one for all agents, or several, and ``owners`` says for each agent which.
    ``bound``: a number that is proved to be at least the largest eigenvalue of middle + deviations.
    """

    middle: Symmetric
    deviations: Sequence[Deviation] = ()
    blocks: tuple[Matrix, ...] = ()
    owners: Sequence[int] = ()
    bound: Fraction | None = None

    @property
    def total(self) -> Symmetric:
        """The middle with the blocks."""
        if not self.blocks:
            return self.middle
        m = len(self.blocks[0])
        owners = self.owners or (0,) * (self.middle.size // m)
        entries = {
            (agent * m + i, agent * m + j): self.blocks[owner][i][j]
            for agent, owner in enumerate(owners)
            for i in range(m)
            for j in range(i, m)
        }
        return self.middle + SparseSymmetric(self.middle.size, entries)

    @property
    def radius(self) -> Fraction:
        """A bound of the spectral norm of all deviations together: their largest row sum of absolute values."""
        if isinstance(self.deviations, Deviations):
            largest = _largest_sum(self.deviations, self.middle.size)
            if math.isfinite(largest):
                return Fraction(largest)
        sums: dict[int, Fraction] = {}
        for each in self.deviations:
            for row in (each.row, each.row, each.speaker, each.listener):
                sums[row] = sums.get(row, ZERO) + each.size
        return max(sums.values(), default=ZERO)

    def value(self, vector: Sequence[Fraction]) -> Interval:
        """Enclose v'Mv: a point where no irrational slope takes part."""
        v, middle = vector, self.total.quadratic_form(vector)
        spread = sum((2 * d.size * abs(v[d.row] * (v[d.speaker] - v[d.listener])) for d in self.deviations), ZERO)
        return Interval(middle - spread, middle + spread)

    def plus_blocks(self, blocks: Sequence[Matrix], owners: Sequence[int] = ()) -> Enclosed:
        """Add a block for each agent: the one of the number in ``owners``, or the only one for all.

        Raises: ValueError if they do not fit.
        """
        agents = len(owners) if owners else self.middle.size // len(blocks[0])
        if agents * len(blocks[0]) != self.middle.size or (len(blocks) > 1 and not owners):
            raise ValueError(f"{agents} blocks of {len(blocks[0])} rows do not make {self.middle.size} rows")
        return replace(self, blocks=tuple(blocks), owners=owners)


def _largest_sum(deviations: Deviations, size: int) -> float:
    """The same bound for very many deviations, in floats rounded up; inf where floats do not hold it."""
    sizes = np.array([float_above(x) for x in deviations.sizes])[deviations.kinds]
    sums, counts = np.zeros(size), np.zeros(size)
    for rows in (deviations.rows, deviations.rows, deviations.speakers, deviations.listeners):
        sums += np.bincount(rows, sizes, size)
        counts += np.bincount(rows, minlength=size)
    return float(np.max(sums * (1 + (counts + 8) * 2.0**-52)))


def shown_bound(matrix: Enclosed, vector: NDArray[np.float64]) -> Fraction | None:
    """A number that v > 0 (rows,) proves to be at least the largest eigenvalue of all but the blocks; None if none."""
    middle = in_integers(matrix.middle)
    bound = math.inf if middle is None else row_bound(middle, vector)
    return Fraction(bound) + matrix.radius if math.isfinite(bound) else None


def is_negative(matrix: Enclosed, *, shift: Fraction = ZERO) -> bool:
    """Whether matrix + shift I < 0 is proved for everything enclosed.

    A matrix with a ``bound`` is decided by it: nothing sharper is looked for.
    """
    if matrix.bound is not None:
        return all(_is_below(block, -matrix.bound - shift) for block in matrix.blocks or (((ZERO,),),))
    upper = matrix.total.shifted(matrix.radius + shift).negated()
    short = None if isinstance(upper, IntegerSymmetric) else _shorter(upper)
    if short is not None and decide_positive_definite(short, most_work=MOST_WORK).verdict is Verdict.PROVED:
        return True
    return decide_positive_definite(upper, most_work=MOST_WORK).verdict is Verdict.PROVED


def _is_below(block: Matrix, room: Fraction) -> bool:
    """Whether block < room I."""
    rest = tuple(tuple((room if i == j else ZERO) - x for j, x in enumerate(row)) for i, row in enumerate(block))
    return decide_positive_definite(rest).verdict is Verdict.PROVED


def _shorter(matrix: SparseSymmetric) -> SparseSymmetric | None:
    """A matrix below it (in the sense of <=) with short entries, where the entries are long; None where they are not.

    Elimination multiplies digits: with numbers of thousands of digits, which a certificate may hold, it takes minutes.
    Rounding every entry to a multiple of u changes the matrix by at most u/2 times its longest row.
    """
    sizes = [max(x.numerator.bit_length(), x.denominator.bit_length()) for x in matrix.entries.values()]
    if max(sizes, default=0) <= LONG:
        return None
    lengths: dict[int, int] = {}
    for i, j in matrix.entries:
        for row in {i, j}:
            lengths[row] = lengths.get(row, 0) + 1
    largest = max(abs(x) for x in matrix.entries.values())
    unit = Fraction(2) ** (largest.numerator.bit_length() - largest.denominator.bit_length() - SHORT)
    rounded = {place: round(x / unit) * unit for place, x in matrix.entries.items()}
    return SparseSymmetric(matrix.size, rounded).shifted(-unit / 2 * max(lengths.values()))


def why_undecided(matrix: Enclosed) -> str:
    """What to say where neither M < 0 nor a witness against it was found."""
    if matrix.deviations:
        return "is closer to 0 than the irrational slopes of h are known; change a gain a little."
    return (
        f"was not told from 0: with {matrix.middle.size} rows the exact elimination would take too long. Change a gain"
        " a little, or use couplings that act by component with slopes >= 0, which need no elimination."
    )


def refutes(matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """Whether v has as many entries as the matrix rows, is not 0, and v'Mv >= 0 for everything enclosed."""
    return len(vector) == matrix.middle.size and any(vector) and matrix.value(vector).lo >= 0


def lowest_quotient(matrix: Enclosed, vector: Sequence[Fraction]) -> Fraction:
    """A lower bound of v'Mv / v'v, hence of lambda_max, for everything enclosed.  v is not 0."""
    return matrix.value(vector).lo / sum((x * x for x in vector), ZERO)


def refuted_margin(matrix: Enclosed, vector: Sequence[Fraction]) -> float:
    """Minus the lowest quotient, rounded towards 0: lambda_max is at least minus this number.  At most 0."""
    return 0.0 - shorten(lowest_quotient(matrix, vector))


def find_witness(
    matrix: Enclosed, candidates: Iterable[Sequence[float]], *, rows: Sequence[int] | None = None
) -> Vector | None:
    """A rational v != 0 with v'Mv >= 0 proved, or None if M < 0 (or the deviations hide the answer, or M is too large).

    ``candidates`` (indicators of agents, approximate eigenvectors) are tried in order of how few entries they have:
    rounded to small integers, because they read better, then by elimination of the rows they live on.  Last comes the
    elimination of ``rows``, all of them if that is None; candidates that leave ``rows`` are skipped.
    """
    inside = None if rows is None else set(rows)
    ordered = sorted(((_support(each), each) for each in candidates), key=lambda pair: len(pair[0]))
    for support, candidate in ordered:
        if not support or len(candidate) != matrix.middle.size or (inside is not None and not inside >= set(support)):
            continue
        for vector in _roundings(candidate):
            if refutes(matrix, vector):
                return vector
        if len(support) < matrix.middle.size and len(support) <= LARGEST_SUPPORT:
            found = _eliminated(matrix, support)
            if found is not None:
                return found
    return _eliminated(matrix, range(matrix.middle.size) if rows is None else rows)


def _support(candidate: Sequence[float]) -> list[int]:
    return [row for row, x in enumerate(candidate) if x]


def _eliminated(matrix: Enclosed, rows: Sequence[int]) -> Vector | None:
    """The elimination's own witness on these rows, zero elsewhere.

    v'(middle)v >= radius v'v, so v refutes whatever the deviations are.
    """
    shifted = matrix.total.shifted(-matrix.radius).negated()
    if len(rows) == matrix.middle.size:
        return decide_positive_definite(shifted, most_work=MOST_WORK).witness
    found = decide_positive_definite(shifted.restricted(rows), most_work=MOST_WORK).witness
    if found is None:
        return None
    place = {row: k for k, row in enumerate(rows)}
    return tuple(found[place[row]] if row in place else ZERO for row in range(matrix.middle.size))


def _roundings(candidate: Sequence[float]) -> Iterable[Vector]:
    largest = max((abs(x) for x in candidate), default=0.0)
    if not 0 < largest < float("inf"):
        return
    for top in TOPS:
        vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
        if any(vector):
            yield vector
