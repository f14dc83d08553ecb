"""Instability of the linearisation at the consensus, proved: roots of det(s I - (J - K)) counted exactly."""

from __future__ import annotations

from fractions import Fraction

from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.numbers import has_short_denominator
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.polynomial import characteristic_polynomial, right_half_plane_roots_at_least

LARGEST = 60  # rows; counting roots takes seconds there, minutes at twice the size
MOST_WORK = 2_000_000  # rows^2 times the bits of the common denominator: as long as 60 rows with about 550 bits


def unstable_roots(statements: Statements, mode: str) -> int:
    """A proved lower bound of the eigenvalues of J - K with positive real part, with multiplicity.

    0 also means "not examined": irrational slopes, more than 60 rows, or entries with so long a common denominator that
    counting would take minutes.  With diagonal slopes >= 0 and scalar gains J - K has none (its rows are weakly
    dominated by a diagonal <= 0).
    """
    jacobians = statements.jacobians
    if jacobians is None or jacobians.size * jacobians.dimension > LARGEST:
        return 0
    each = next(item for item in jacobians.modes if item.name == mode)
    if not each.is_point or (each.is_nonnegative_diagonal and statements.problem.pinning.is_scalar):
        return 0
    matrix = linearisation(statements, mode)
    if not has_short_denominator((x for row in matrix for x in row), MOST_WORK // len(matrix) ** 2):
        return 0
    return right_half_plane_roots_at_least(characteristic_polynomial(matrix))


def linearisation(statements: Statements, mode: str) -> Matrix:
    """J - K of one mode, (n m) x (n m), for rational slopes (the middle of an interval otherwise)."""
    jacobians = statements.jacobians
    if jacobians is None:
        return ()
    each = next(item for item in jacobians.modes if item.name == mode)
    m = jacobians.dimension
    rows = [[Fraction(0)] * (jacobians.size * m) for _ in range(jacobians.size * m)]
    for (listener, speaker, _), kind in zip(each.arcs, each.kind.tolist(), strict=True):
        for c in range(m):
            for d in range(m):
                entry = each.gains[kind][c][d]
                slope = (entry.lo + entry.hi) / 2
                rows[listener * m + c][speaker * m + d] += slope
                rows[listener * m + c][listener * m + d] -= slope
    for agent, gain in statements.problem.pinning.gains.items():
        for c in range(m):
            for d in range(m):
                rows[agent * m + c][agent * m + d] -= gain[c][d]
    return tuple(tuple(row) for row in rows)
