"""Matrices whose definiteness is known and hard to see: H diag(eigenvalues) H / n, H a Hadamard
matrix.

H H = n I, so these are the eigenvalues. One is tiny or 0, the others are 1/4, 1/2 or 1. Only
matrices whose entries are exact as doubles are given, so that floating point is asked the same
question.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from random import Random

import numpy as np

POWERS = range(28, 48)
SCALE = 2**60


def hadamard(size: int) -> np.ndarray:
    """Sylvester's H, symmetric, with H H = size I, as Python integers."""
    H = np.array([[1]], dtype=object)
    while len(H) < size:
        H = np.block([[H, H], [H, -H]]).astype(object)
    return H


def edge_matrix(size: int, small: Fraction, r: Random) -> np.ndarray | None:
    """One matrix with the eigenvalue ``small`` in a random place; None if an entry is not exact as
    a double."""
    eigenvalues = [Fraction(1, r.choice((1, 2, 4, 4))) for _ in range(size)]
    eigenvalues[r.randrange(size)] = small
    return with_eigenvalues(eigenvalues)


def z_edge_matrix(size: int, small: Fraction) -> np.ndarray | None:
    """The same with ``small`` for the vector of ones and 1/2 for all others: a Z-matrix."""
    return with_eigenvalues([small] + [Fraction(1, 2)] * (size - 1))


def with_eigenvalues(eigenvalues: list[Fraction]) -> np.ndarray | None:
    size = len(eigenvalues)
    H = hadamard(size)
    whole = (H * np.array([int(x * SCALE) for x in eigenvalues], dtype=object)) @ H
    floats = np.array([[float(Fraction(x, SCALE * size)) for x in row] for row in whole.tolist()])
    exact = all(
        Fraction(y) * SCALE * size == x
        for p, q in zip(whole.tolist(), floats.tolist(), strict=True)
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
