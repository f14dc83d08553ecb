"""Every path of ``exact.definite`` by itself, as a function from a float array to a verdict.

UNDECIDED: the path passed on. None: it is not asked (too slow at this size).
"""

from collections.abc import Callable

import numpy as np

from dobc_design.exact.cholesky import (
    Scaled,
    bad_direction,
    decide_lifted,
    proves_by_integers,
    scaled,
)
from dobc_design.exact.definite import (
    decide_positive_definite,
    decide_quickly,
    first_refuting,
    roundings,
)
from dobc_design.exact.symmetric import IntegerSymmetric
from dobc_design.exact.zmatrix import search
from dobc_design.verdict import Verdict

Path = Callable[[np.ndarray], Verdict | None]
PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
FRACTIONS_MOST = 16
FLINT_MOST = 64


def by_fractions(matrix: np.ndarray) -> Verdict | None:
    return _eliminated(matrix, flint=False) if len(matrix) <= FRACTIONS_MOST else None


def by_flint(matrix: np.ndarray) -> Verdict | None:
    return _eliminated(matrix, flint=True) if len(matrix) <= FLINT_MOST else None


def by_quick(matrix: np.ndarray) -> Verdict:
    return decide_quickly(IntegerSymmetric.from_floats(matrix)).verdict


def by_integers(matrix: np.ndarray) -> Verdict:
    S = scaled(IntegerSymmetric.from_floats(matrix))
    return PROVED if isinstance(S, Scaled) and proves_by_integers(S) else UNDECIDED


def by_vector(matrix: np.ndarray) -> Verdict:
    M = IntegerSymmetric.from_floats(matrix)
    found = search(M, strict=True)
    if found.vector is not None:
        return PROVED
    tried = [each for d in found.directions for each in (*roundings(d), d)]
    return UNDECIDED if first_refuting(M, tried, strict=True, method="") is None else REFUTED


def by_lift(matrix: np.ndarray) -> Verdict:
    M = IntegerSymmetric.from_floats(matrix)
    S = scaled(M)
    if not isinstance(S, Scaled):
        return UNDECIDED
    direction = decide_lifted(M, S, *np.linalg.eigh(S.floats), strict=True)
    if direction is None:
        return UNDECIDED
    return REFUTED if direction else PROVED


def by_choice(matrix: np.ndarray) -> Verdict:
    return decide_positive_definite(IntegerSymmetric.from_floats(matrix)).verdict


def _eliminated(matrix: np.ndarray, *, flint: bool) -> Verdict:
    M = IntegerSymmetric.from_floats(matrix).to_sparse()
    return PROVED if bad_direction(M, strict=True, flint=flint) is None else REFUTED


PATHS: dict[str, Path] = {
    "LDL' in Fractions": by_fractions,
    "LDL' in flint": by_flint,
    "quick": by_quick,
    "integer rest": by_integers,
    "vector": by_vector,
    "lift": by_lift,
    "choice": by_choice,
}
# They may not pass on.
EXACT = {"LDL' in Fractions", "LDL' in flint", "choice"}


def numpy_cholesky(matrix: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
