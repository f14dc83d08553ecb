"""Negative definiteness of an enclosed symmetric matrix: proved, refuted by a vector, or undecided.

The matrix is known up to a symmetric deviation of spectral norm at most ``radius`` (irrational slopes).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import float_below
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.verdict import Verdict

ZERO = Fraction(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Enclosed:
    """middle + deviation, |deviation|_2 <= radius."""

    middle: SparseSymmetric
    radius: Fraction

    def plus_blocks(self, block: Matrix) -> Enclosed:
        """Add I (x) block."""
        m = len(block)
        entries = {
            (agent + i, agent + j): block[i][j]
            for agent in range(0, self.middle.size, m)
            for i in range(m)
            for j in range(i, m)
            if block[i][j]
        }
        return Enclosed(middle=self.middle + SparseSymmetric(self.middle.size, entries), radius=self.radius)


def is_negative(matrix: Enclosed, *, shift: Fraction = ZERO) -> bool:
    """Whether matrix + shift I < 0 is proved for everything enclosed."""
    upper = matrix.middle.shifted(matrix.radius + shift).negated()
    return decide_positive_definite(upper).verdict is Verdict.PROVED


def refutes(matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """Whether v'Mv >= 0 is proved for everything enclosed, v != 0."""
    return any(vector) and _lowest(matrix, vector) >= 0


def refuted_margin(matrix: Enclosed, vector: Sequence[Fraction]) -> float:
    """-(v'Mv)/(v'v) rounded towards zero: lambda_max is at least minus this number.  At most 0."""
    square = sum((x * x for x in vector), ZERO)
    return min(0.0, -float_below(_lowest(matrix, vector) / square)) + 0.0


def find_witness(matrix: Enclosed, candidates: Iterable[Sequence[float]]) -> Vector | None:
    """A rational v != 0 with v'Mv >= 0 proved, or None if M < 0 (or the deviation hides the answer).

    ``candidates`` (indicators of agents, approximate eigenvectors) are rounded to small integers and
    tried first, because they read better; then the elimination's own witness.
    """
    for candidate in candidates:
        for vector in _roundings(candidate):
            if refutes(matrix, vector):
                return vector
    decision = decide_positive_definite(matrix.middle.shifted(-matrix.radius).negated())
    return decision.witness if decision.verdict is Verdict.REFUTED else None


def _lowest(matrix: Enclosed, vector: Sequence[Fraction]) -> Fraction:
    value = matrix.middle.quadratic_form(vector)
    return value - matrix.radius * sum((x * x for x in vector), ZERO) if matrix.radius else value


def _roundings(candidate: Sequence[float]) -> Iterable[Vector]:
    largest = max((abs(x) for x in candidate), default=0.0)
    if not 0 < largest < float("inf"):
        return
    for top in (9, 99, 9999):
        vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
        if any(vector):
            yield vector
