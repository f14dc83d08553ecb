"""Rounding what a solver proposes to rationals that a person can read."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from dobc_design.exact.matrix import Matrix
from dobc_design.solvers.program import Array


def round_matrix(array: Array, digits: int) -> Matrix:
    """Round to ``digits`` significant decimal digits of the largest entry; symmetry is kept."""
    largest = float(np.max(np.abs(array))) if array.size else 0.0
    places = digits - 1 - math.floor(math.log10(largest)) if 0 < largest < math.inf else 0
    unit = Fraction(10) ** places
    return tuple(tuple(Fraction(round(Fraction(float(x)) * unit)) / unit for x in row) for row in array)
