"""How many pins a rate needs at least, whatever the gains: by the number of slow directions.

If Lambda0 + 2 rate I >= 0 on a space of dimension d, and fewer than d / m agents are pinned, a direction of that space
is 0 on all of them, and no gain holds it.  The space is a proposal; its dimension and the sign are decided exactly.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.negative import Enclosed
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.synthesis.pinning.bound import Ground, Vectors
from dobc_design.verdict import Verdict

LARGEST = 200  # rows of Lambda
TOP = 2**20  # the largest entry of a rounded direction


def pins_needed(ground: Ground, rate: Fraction, directions: Vectors) -> int:
    """The largest number of pins that the proposed ``directions`` of one mode prove to be needed; 0 if none."""
    m, least = ground.problem.m, 0
    if ground.problem.n * m > LARGEST:
        return 0
    for mode, enclosed in ground.lambdas.items():
        vectors = [v for name, v in directions if name == mode]
        if len(vectors) > least * m and _are_slow(enclosed, rate, vectors):
            least = -(-len(vectors) // m)
    return least


def _are_slow(enclosed: Enclosed, rate: Fraction, vectors: list[Any]) -> bool:
    """Whether the directions are independent, and v'(Lambda0 + 2 rate I)v >= 0 for all their combinations."""
    columns = np.array([[round(x / max(map(abs, v)) * TOP) for x in v] for v in vectors], dtype=object).T
    lower = enclosed.middle.shifted(2 * rate - enclosed.radius)
    common = math.lcm(1, *(x.denominator for x in lower.entries.values()))
    matrix = np.zeros((lower.size, lower.size), dtype=object)
    for (i, j), value in lower.entries.items():
        matrix[i, j] = matrix[j, i] = int(value * common)
    independent = decide_positive_definite(_symmetric(columns.T @ columns)).verdict is Verdict.PROVED
    form = columns.T @ (matrix @ columns)
    return independent and decide_positive_semidefinite(_symmetric(form)).verdict is Verdict.PROVED


def _symmetric(table: Any) -> SparseSymmetric:
    size = len(table)
    return SparseSymmetric(size, {(i, j): Fraction(int(table[i, j])) for i in range(size) for j in range(i, size)})
