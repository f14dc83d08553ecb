"""The semidefinite programs of the toolbox, stated for pencils: minimise tr P + |Q|^2, F(P, Q) <=
0, P >= floor I."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import structural_rank
from scipy.sparse.linalg import splu

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array, Matrix, largest_entry
from dobc_design.exact.pencil import Pencil

# What a numerical library that gives up raises, or what comes of an answer of a wrong shape;
# LinAlgError, ArpackError and our SpecError are among them.
GIVEN_UP = (ArithmeticError, RuntimeError, ValueError, LookupError)
# how the status of a solver begins that raised, or answered with something that is no point
FAILED = "failed: "
OUT_OF_TIME = "MaxTime"  # Clarabel's word


@noun(eq=False)
class Program:
    """The pencils F, all with the same unknowns, and the floor of P."""

    pencils: tuple[Pencil, ...]
    floor: Fraction = Fraction(0)


@noun(eq=False)
class Solution:
    """What a solver answered.  ``status``, its own word ("Solved", "PrimalInfeasible", ...) or one
    that begins with FAILED, never decides anything.  x (k,), multipliers (all rows,), and of a
    Program ``values``; without a point x and values are empty, ``objective`` nan."""

    status: str
    x: Array = field(default_factory=lambda: np.zeros(0))
    multipliers: Array = field(default_factory=lambda: np.zeros(0))
    objective: float = math.nan
    values: Mapping[str, Array] = field(default_factory=dict)

    @property
    def found(self) -> bool:
        """Whether there is a finite point to look at, whatever the status says."""
        points = [point for point in (self.x, *self.values.values()) if len(point)]
        finite = (bool(np.all(np.isfinite(point))) for point in points)
        return bool(points) and all(finite)

    @property
    def broken(self) -> bool:
        """Whether the solver itself broke down or ran out of time: asking it again would be no
        better."""
        return self.status.startswith(FAILED) or self.status == OUT_OF_TIME


def is_solver_failure(error: BaseException) -> bool:
    """Whether a solver gave up; a panic in Rust arrives as a BaseException that is known by name
    only."""
    ordinary = isinstance(error, Exception) and not isinstance(error, MemoryError)
    return ordinary or type(error).__name__ == "PanicException"


def assemble(pencil: Pencil, numbers: Sequence[float]) -> dict[str, Array]:
    """Turn the vector of independent entries into one array per unknown; there may be more
    numbers."""
    result: dict[str, Array] = {}
    remaining = iter(numbers)
    for unknown in pencil.unknowns:
        array = np.zeros((unknown.rows, unknown.columns))
        # The numbers of all unknowns follow each other: each takes its own and leaves the rest.
        for (_, i, j), number in zip(unknown.places(), remaining, strict=False):
            array[i, j] = number
            if unknown.symmetric:
                array[j, i] = number
        result[unknown.name] = array
    return result


def round_matrix(array: Array, digits: int) -> Matrix:
    """Round to ``digits`` significant decimal digits of the largest entry; symmetry is kept."""
    largest = largest_entry(array)
    places = 0
    if 0 < largest < math.inf:
        places = digits - 1 - math.floor(math.log10(largest))
    unit = Fraction(10) ** places

    def rounded(x: float) -> Fraction:
        return Fraction(round(Fraction(float(x)) * unit)) / unit

    return tuple(tuple(map(rounded, row)) for row in array)


def factored(matrix: Any, **options: Any) -> Any:
    """L U of a square sparse matrix, with `solve`; options as for SciPy's splu.  Raises:
    RuntimeError if the matrix is singular or not finite, also where its places alone show it: there
    SuperLU itself ends the whole process."""
    columns = sparse.csc_array(matrix)
    if not np.all(np.isfinite(columns.data)):
        raise RuntimeError("not finite")
    doubtful = np.any(columns.diagonal() == 0)  # a full diagonal is a matching already
    if doubtful and structural_rank(columns) < columns.shape[0]:
        raise RuntimeError("singular by its places")
    return splu(columns, **options)
