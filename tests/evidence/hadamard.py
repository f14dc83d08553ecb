"""Symmetric matrices whose definiteness is known and hard to see: H diag(lambda) H / n, H a Hadamard matrix.

H H = n I, so lambda are the eigenvalues, and the matrix is positive definite iff all are positive.  All but
one are 1, 2 or 4; that one is 0 or +-2^-28 to +-2^-47.  Only matrices whose entries are exact as floats are
used, so that NumPy is asked the same question.
"""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np
from evidence.row import Row

from dobc_design.exact.definite import definiteness
from dobc_design.verdict import Verdict

SIZES = (4, 16, 64)


def run(count: int, seed: int) -> Row:
    failures: list[str] = []
    accepted = {"cholesky": 0, "eigvalsh > 0": 0}
    rejected = {"cholesky": 0, "eigvalsh > 0": 0, "eigvalsh > 1e-10": 0}
    positive = 0
    for k in range(count):
        floats, small = edge_matrix(SIZES[k % 3], Random(seed + k))
        truth = small > 0
        positive += truth
        if (definiteness(floats) is Verdict.PROVED) is not truth:
            failures.append(f"seed {seed + k}: eigenvalue {float(small):.3g}")
        lowest = float(np.linalg.eigvalsh(floats)[0])
        opinions = {"cholesky": _cholesky(floats), "eigvalsh > 0": lowest > 0, "eigvalsh > 1e-10": lowest > 1e-10}
        for name, opinion in opinions.items():
            if opinion and not truth:
                accepted[name] = accepted.get(name, 0) + 1
            elif truth and not opinion:
                rejected[name] += 1
    wrong = ", ".join(f"{name}: {accepted.get(name, 0)} accepted, {rejected[name]} rejected" for name in rejected)
    return Row(
        what="exact.definiteness on Hadamard edge matrices, n = 4, 16, 64", count=count, failures=tuple(failures),
        notes=(f"{positive} are positive definite; NumPy is wrong on: {wrong}",),
    )  # fmt: skip


def edge_matrix(size: int, r: Random) -> tuple[np.ndarray, Fraction]:
    """The matrix as floats, exactly, and its small eigenvalue."""
    while True:
        small = r.choice((0, 1, -1)) * Fraction(1, 2 ** r.randint(28, 47))
        eigenvalues = [Fraction(r.choice((1, 1, 2, 4))) for _ in range(size)]
        eigenvalues[r.randrange(size)] = small
        scale = 2**60
        H = _hadamard(size)
        integers = H @ np.diag([int(x * scale) for x in eigenvalues]).astype(object) @ H
        floats = np.array([[float(Fraction(x, scale * size)) for x in row] for row in integers])
        exact = all(
            Fraction(y) == Fraction(x, scale * size)
            for p, q in zip(integers, floats.tolist(), strict=True)
            for x, y in zip(p, q, strict=True)
        )
        if exact:
            return floats, small


def _hadamard(size: int) -> np.ndarray:
    H = np.array([[1]], dtype=object)
    while len(H) < size:
        H = np.block([[H, H], [H, -H]]).astype(object)
    return H


def _cholesky(matrix: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
