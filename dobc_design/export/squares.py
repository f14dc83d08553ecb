"""LDL' of a sparse positive definite rational matrix, one column at a time, for others to multiply out.

M = sum over k of d_k l_k l_k', with d_k > 0 and l_k equal to 1 at its pivot and to 0 at the pivots before:
L is unit lower triangular in the order of the pivots.  So x'Mx = sum d_k (l_k'x)^2, which is 0 for x = 0
only.  ``exact.definite`` decides; here the factors are kept because they are the witness.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.symmetric import SparseSymmetric


@dataclass(frozen=True, slots=True)
class Square:
    """d (x_pivot + sum of others[i] x_i)^2: one entry of D and one column of L.

    ``others`` are the entries of the column that are neither 0 nor the 1 at the pivot, by rising index.
    """

    weight: Fraction
    pivot: int
    others: Mapping[int, Fraction]


def factor(M: SparseSymmetric) -> tuple[Square, ...] | None:
    """Return the squares M is the sum of, in the order of elimination, or None if M is not positive definite.

    Pivots are taken on the diagonal by least degree, then least index, so the answer is unique.
    """
    rows: list[dict[int, Fraction]] = [{} for _ in range(M.size)]
    for (i, j), value in M.entries.items():
        rows[i][j] = rows[j][i] = value
    queue = [(len(row), i) for i, row in enumerate(rows)]
    heapq.heapify(queue)
    closed = [False] * M.size
    squares: list[Square] = []
    while queue:
        degree, pivot = heapq.heappop(queue)
        if closed[pivot] or degree != len(rows[pivot]):
            continue  # stale: the row has changed since, and stands in the queue again
        closed[pivot] = True
        weight = rows[pivot].pop(pivot, Fraction(0))
        if weight <= 0:
            return None
        others = {i: rows[pivot][i] / weight for i in sorted(rows[pivot])}
        squares.append(Square(weight, pivot, others))
        _eliminate(rows, pivot, weight, others)
        for i in others:
            heapq.heappush(queue, (len(rows[i]), i))
    return tuple(squares)


def _eliminate(rows: list[dict[int, Fraction]], pivot: int, weight: Fraction, others: Mapping[int, Fraction]) -> None:
    """Subtract weight l l' from the rows still open; drop the pivot's column and what cancels."""
    for i, x in others.items():
        row, scaled = rows[i], weight * x
        del row[pivot]
        for j, y in others.items():
            value = row.get(j, Fraction(0)) - scaled * y
            if value:
                row[j] = value
            else:
                row.pop(j, None)
