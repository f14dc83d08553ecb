"""Detectability over the rationals against the numerical PBH test on random integer pairs.

PBH: (A, C) is detectable iff [A - s I; C] has full column rank at every eigenvalue s of A with Re s >= 0.
Where the smallest singular value there, or Re s, is within 1e-6 of zero, rounding may tip the numerical test.
"""

from __future__ import annotations

from random import Random

import numpy as np
from evidence.row import Row

from dobc_design.exact.matrix import matrix
from dobc_design.exact.observability import decide_detectable
from dobc_design.verdict import Verdict

TINY = 1e-6
Rows = list[list[int]]


def run(count: int, seed: int) -> Row:
    failures, borderline, detectable = [], [], 0
    for k in range(seed, seed + count):
        A, C = random_pair(k)
        exact = decide_detectable(matrix(A), matrix(C)).verdict is Verdict.PROVED
        numerical, distance = pbh(np.array(A, dtype=float), np.array(C, dtype=float))
        detectable += exact
        if exact is not numerical:
            if distance <= TINY:
                borderline.append(f"{k}: {distance:.0e}")
            else:
                failures.append(f"seed {k}: exact {exact}, numerical {numerical}, distance {distance:.1e}")
    listed = [", ".join(borderline[start : start + 8]) for start in range(0, len(borderline), 8)]
    what = "detectability: exact = numerical PBH, integer pairs, q = 1 to 6, m = 1 or 2"
    notes = [f"{detectable} detectable; {len(borderline)} disagree within {TINY:g} of zero (seed: distance):", *listed]
    return Row(what, count, failures, notes)


def pbh(A: np.ndarray, C: np.ndarray) -> tuple[bool, float]:
    """The numerical verdict, and how far the closest decision in it was from tipping."""
    detectable, closest = True, np.inf
    for s in np.linalg.eigvals(A):
        smallest = float(np.linalg.svd(np.vstack([A - s * np.eye(len(A)), C]), compute_uv=False)[-1])
        unstable, seen = s.real >= 0, smallest > 1e-9
        detectable &= bool(seen or not unstable)
        closest = min(closest, max(smallest, 0.0) if unstable else max(smallest, abs(s.real)))
    return detectable, closest


def random_pair(seed: int) -> tuple[Rows, Rows]:
    """Half of them hide a block from C, behind a change of coordinates with an integer inverse."""
    r = Random(seed)
    q, m = r.randint(1, 6), r.choice((1, 1, 2))
    A = [[r.randint(-3, 3) if r.random() < 0.7 else 0 for _ in range(q)] for _ in range(q)]
    C = [[r.choice((0, 0, 1, -1, 2)) for _ in range(q)] for _ in range(m)]
    if r.random() < 0.5 and q > 1:
        hidden = r.randint(1, q - 1)
        for i in range(q):
            for j in range(q - hidden, q):
                if i < q - hidden:
                    A[i][j] = 0
                elif r.random() < 0.5:
                    A[i][j] -= 4 * (i == j)
        for row in C:
            row[q - hidden :] = [0] * hidden
        for _ in range(q):
            i, j = r.sample(range(q), 2)
            A, C = _sheared(A, C, i, j, r.choice((1, -1)))
    return A, C


def _sheared(A: Rows, C: Rows, i: int, j: int, factor: int) -> tuple[Rows, Rows]:
    """T A T^-1 and C T^-1 for T = I + factor e_i e_j'."""
    A = [[x + factor * A[j][c] if row == i else x for c, x in enumerate(line)] for row, line in enumerate(A)]
    A = [[x - factor * line[i] if c == j else x for c, x in enumerate(line)] for line in A]
    C = [[x - factor * line[i] if c == j else x for c, x in enumerate(line)] for line in C]
    return A, C
