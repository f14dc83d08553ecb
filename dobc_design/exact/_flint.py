"""Bridges between Fraction and python-flint, whose rationals are many times faster on long numbers.

The import is deferred to the calls, so that small problems never pay for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flint import fmpq, fmpq_mat


def to_fmpq(value: Fraction) -> fmpq:
    """Return the same rational as a flint number."""
    from flint import fmpq

    return fmpq(value.numerator, value.denominator)


def from_fmpq(value: fmpq) -> Fraction:
    """Return the same rational as a Fraction."""
    return Fraction(int(value.p), int(value.q))


def to_fmpq_mat(rows: Sequence[Sequence[Fraction]]) -> fmpq_mat:
    """Return the same matrix, of at least one row, as a flint matrix."""
    from flint import fmpq_mat

    return fmpq_mat(len(rows), len(rows[0]), [to_fmpq(entry) for row in rows for entry in row])


def from_fmpq_mat(matrix: fmpq_mat) -> tuple[tuple[Fraction, ...], ...]:
    """Return the same matrix as a tuple of row tuples."""
    return tuple(tuple(from_fmpq(entry) for entry in row) for row in matrix.tolist())
