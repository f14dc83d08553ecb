"""Matrices whose definiteness is known and hard to see, and every path of ``exact.definite`` by
itself."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from random import Random

import numpy as np

from dobc_design.exact.cholesky import (
    Scaled,
    bad_direction,
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

POWERS = range(28, 48)
SCALE = 2**60


def hadamard(size: int) -> np.ndarray:
    """Sylvester's H, symmetric, with H H = size I, as Python integers."""
    H = np.array([[1]], dtype=object)
    while len(H) < size:
        blocks = [[H, H], [H, -H]]
        H = np.block(blocks).astype(object)
    return H


def edge_matrix(size: int, small: Fraction, r: Random) -> np.ndarray | None:
    """One matrix with the eigenvalue ``small`` in a random place; None if an entry is not exact as
    a double."""
    eigenvalues = []
    for _ in range(size):
        denominator = r.choice((1, 2, 4, 4))
        eigenvalues.append(Fraction(1, denominator))
    eigenvalues[r.randrange(size)] = small
    return with_eigenvalues(eigenvalues)


def z_edge_matrix(size: int, small: Fraction) -> np.ndarray | None:
    """The same with ``small`` for the vector of ones and 1/2 for all others: a Z-matrix."""
    return with_eigenvalues([small] + [Fraction(1, 2)] * (size - 1))


def with_eigenvalues(eigenvalues: list[Fraction]) -> np.ndarray | None:
    size = len(eigenvalues)
    H = hadamard(size)
    integers = [int(x * SCALE) for x in eigenvalues]
    diagonal = np.array(integers, dtype=object)
    whole = (H * diagonal) @ H
    rows = [[float(Fraction(x, SCALE * size)) for x in row] for row in whole.tolist()]
    floats = np.array(rows)
    rows_and_floats = zip(whole.tolist(), floats.tolist(), strict=True)
    exact = all(
        Fraction(y) * SCALE * size == x
        for p, q in rows_and_floats
        for x, y in zip(p, q, strict=True)
    )
    return floats if exact else None


def edge_matrices(
    sizes: tuple[int, ...], *, seed: int, repeats: int, powers: Sequence[int] = POWERS
) -> Iterator[tuple[Fraction, np.ndarray]]:
    """The tiny eigenvalue and the matrix: 0 and +-2^-28 to +-2^-47 in turn, ``repeats`` times for
    every size."""
    r = Random(seed)
    for size in sizes:
        for power in powers:
            for sign in (-1, 0, 1) * repeats:
                small = sign * Fraction(1, 2**power)
                matrix = edge_matrix(size, small, r)
                if matrix is not None:
                    yield small, matrix


Path = Callable[[np.ndarray], Verdict | None]
PROVED = Verdict.PROVED
REFUTED = Verdict.REFUTED
UNDECIDED = Verdict.UNDECIDED
FRACTIONS_MOST = 16
FLINT_MOST = 64


def by_fractions(matrix: np.ndarray) -> Verdict | None:
    if len(matrix) <= FRACTIONS_MOST:
        return _eliminated(matrix, flint=False)
    return None


def by_flint(matrix: np.ndarray) -> Verdict | None:
    if len(matrix) <= FLINT_MOST:
        return _eliminated(matrix, flint=True)
    return None


def by_quick(matrix: np.ndarray) -> Verdict:
    return decide_quickly(IntegerSymmetric.from_floats(matrix)).verdict


def by_integers(matrix: np.ndarray) -> Verdict:
    S = scaled(IntegerSymmetric.from_floats(matrix))
    if isinstance(S, Scaled) and proves_by_integers(S):
        return PROVED
    return UNDECIDED


def by_vector(matrix: np.ndarray) -> Verdict:
    M = IntegerSymmetric.from_floats(matrix)
    found = search(M, strict=True)
    if found.vector is not None:
        return PROVED
    tried = [each for d in found.directions for each in (*roundings(d), d)]
    if first_refuting(M, tried, strict=True, method="") is None:
        return UNDECIDED
    return REFUTED


def by_choice(matrix: np.ndarray) -> Verdict:
    return decide_positive_definite(IntegerSymmetric.from_floats(matrix)).verdict


def _eliminated(matrix: np.ndarray, *, flint: bool) -> Verdict:
    M = IntegerSymmetric.from_floats(matrix).to_sparse()
    if bad_direction(M, strict=True, flint=flint) is None:
        return PROVED
    return REFUTED


PATHS: dict[str, Path] = {
    "LDL' in Fractions": by_fractions,
    "LDL' in flint": by_flint,
    "quick": by_quick,
    "integer rest": by_integers,
    "vector": by_vector,
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
