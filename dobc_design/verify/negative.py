"""Negative definiteness of an enclosed symmetric matrix: proved, refuted by a vector, or undecided.

The matrix is known up to what its irrational slopes leave open (``theorems.pencil.Deviation``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.theorems.pencil import Deviation
from dobc_design.verdict import Verdict
from dobc_design.verify.numbers import shorten

ZERO = Fraction(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Enclosed:
    """middle + deviations, each with any t of its own, |t| <= size."""

    middle: SparseSymmetric
    deviations: tuple[Deviation, ...] = ()

    @property
    def radius(self) -> Fraction:
        """A bound of the spectral norm of all deviations together: their largest row sum of absolute values."""
        sums: dict[int, Fraction] = {}
        for each in self.deviations:
            for row in (each.row, each.row, each.speaker, each.listener):
                sums[row] = sums.get(row, ZERO) + each.size
        return max(sums.values(), default=ZERO)

    def value(self, vector: Sequence[Fraction]) -> Interval:
        """Enclose v'Mv: a point where no irrational slope takes part."""
        v, middle = vector, self.middle.quadratic_form(vector)
        spread = sum(
            (2 * d.size * abs(v[d.row] * (v[d.speaker] - v[d.listener])) for d in self.deviations), ZERO
        )
        return Interval(middle - spread, middle + spread)

    def plus_blocks(self, block: Matrix) -> Enclosed:
        """Add I (x) block."""
        m = len(block)
        entries = {
            (agent + i, agent + j): block[i][j]
            for agent in range(0, self.middle.size, m)
            for i in range(m)
            for j in range(i, m)
        }
        return Enclosed(middle=self.middle + SparseSymmetric(self.middle.size, entries), deviations=self.deviations)


def is_negative(matrix: Enclosed, *, shift: Fraction = ZERO) -> bool:
    """Whether matrix + shift I < 0 is proved for everything enclosed."""
    upper = matrix.middle.shifted(matrix.radius + shift).negated()
    return decide_positive_definite(upper).verdict is Verdict.PROVED


def refutes(matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """Whether v has as many entries as the matrix rows, is not 0, and v'Mv >= 0 for everything enclosed."""
    return len(vector) == matrix.middle.size and any(vector) and matrix.value(vector).lo >= 0


def lowest_quotient(matrix: Enclosed, vector: Sequence[Fraction]) -> Fraction:
    """A lower bound of v'Mv / v'v, hence of lambda_max, for everything enclosed.  v is not 0."""
    return matrix.value(vector).lo / sum((x * x for x in vector), ZERO)


def refuted_margin(matrix: Enclosed, vector: Sequence[Fraction]) -> float:
    """Minus the lowest quotient, rounded towards 0: lambda_max is at least minus this number.  At most 0."""
    return 0.0 - shorten(lowest_quotient(matrix, vector))


def find_witness(matrix: Enclosed, candidates: Iterable[Sequence[float]]) -> Vector | None:
    """A rational v != 0 with v'Mv >= 0 proved, or None if M < 0 (or the deviations hide the answer).

    ``candidates`` (indicators of agents, approximate eigenvectors) are rounded to small integers and
    tried first, because they read better; then the elimination's own witness.
    """
    for candidate in candidates:
        for vector in _roundings(candidate):
            if refutes(matrix, vector):
                return vector
    # v'(middle)v >= radius v'v, so v refutes whatever the deviations are.
    return decide_positive_definite(matrix.middle.shifted(-matrix.radius).negated()).witness


def _roundings(candidate: Sequence[float]) -> Iterable[Vector]:
    largest = max((abs(x) for x in candidate), default=0.0)
    if not 0 < largest < float("inf"):
        return
    for top in (9, 99, 9999):
        vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
        if any(vector):
            yield vector
