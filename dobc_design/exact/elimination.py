"""Sparse LDL' elimination over the rationals: the path that decides every matrix, at any cost.

Theory, section 3: M > 0 iff every pivot is positive, M >= 0 iff every pivot is, or is 0 in a row of
zeros. The first pivot that is not gives a direction v with v'Mv = that pivot. Pivots are taken on the
diagonal, least degree first. Fill and the length of the numbers may grow; the faster paths come before.
"""

from __future__ import annotations

import heapq
from fractions import Fraction
from typing import Any, Final, TypeAlias

from dobc_design.exact._flint import to_fmpq
from dobc_design.exact.symmetric import SparseSymmetric

# Fraction, or flint's fmpq for larger matrices; both mix with int.
Scalar: TypeAlias = Any

# From this size on the conversion to flint's rationals has paid for itself.
FLINT_SIZE: Final = 13


class UnfinishedError(Exception):
    """The elimination takes more work than was allowed; nothing is known."""


def bad_direction(
    M: SparseSymmetric, *, strict: bool, flint: bool | None = None, most_work: int | None = None
) -> dict[int, Fraction] | None:
    """Return None if M > 0 (strict) or M >= 0, else a direction v, by its entries, that shows the contrary.

    v'Mv <= 0 if strict, else < 0. ``flint`` chooses the arithmetic; by default the size does. ``most_work``: products
    of numbers of 64 bits, about, None for any number; counted, not timed, so that every machine answers the same.
    Raises: UnfinishedError beyond ``most_work``.
    """
    long = M.size >= FLINT_SIZE if flint is None else flint
    rows: list[dict[int, Scalar]] = [{} for _ in range(M.size)]
    for (i, j), value in M.entries.items():
        rows[i][j] = rows[j][i] = to_fmpq(value) if long else value
    found = _eliminate(rows, strict=strict, most_work=most_work)
    if found is None:
        return None
    return {i: Fraction(int(x.numerator), int(x.denominator)) for i, x in found.items()}


def _eliminate(rows: list[dict[int, Scalar]], *, strict: bool, most_work: int | None) -> dict[int, Scalar] | None:
    """Eliminate in minimum-degree order; return None if every pivot passes, else a witness.

    ``rows`` hold both triangles without zeros, and are consumed. After each step the rows still
    open hold the Schur complement, so a bad diagonal entry there refutes as a bad pivot does.
    """
    for i in range(len(rows)):
        if (bad := _bad_diagonal(rows, i, strict=strict)) is not None:
            return bad
    steps: list[tuple[int, dict[int, Scalar]]] = []
    queue = [(len(row), i) for i, row in enumerate(rows)]
    heapq.heapify(queue)
    closed = [False] * len(rows)
    work = 0
    while queue:
        degree, k = heapq.heappop(queue)
        # Stale entries stay in the queue; the current degree of every open row is there as well.
        if closed[k] or degree != len(rows[k]):
            continue
        closed[k] = True
        row = rows[k]
        if not row:  # a zero row of a semidefinite matrix
            continue
        pivot = row.pop(k)
        if most_work is not None:
            work += len(row) * (len(row) + 1) // 2 * (1 + int(pivot.denominator).bit_length() // 64)
            if work > most_work:
                raise UnfinishedError(f"elimination stopped at pivot {len(steps) + 1} of {len(rows)}")
        factors = {j: x / pivot for j, x in row.items()}
        steps.append((k, factors))
        _subtract_outer(rows, k, factors)
        for i in row:
            if (bad := _bad_diagonal(rows, i, strict=strict)) is not None:
                return _back_substitute(bad, steps)
            heapq.heappush(queue, (len(rows[i]), i))
    return None


def _subtract_outer(rows: list[dict[int, Scalar]], k: int, factors: dict[int, Scalar]) -> None:
    """Subtract row_k' row_k / pivot from the open rows; drop column k and what cancels."""
    neighbours = list(rows[k].items())
    for position, (i, x) in enumerate(neighbours):
        target = rows[i]
        del target[k]
        for j, _ in neighbours[position:]:
            product = x * factors[j]
            value = target[j] - product if j in target else -product
            if value:
                target[j] = rows[j][i] = value
            else:
                del target[j]
                rows[j].pop(i, None)


def _bad_diagonal(rows: list[dict[int, Scalar]], i: int, *, strict: bool) -> dict[int, Scalar] | None:
    """Return a direction in which the open part is not positive because of entry (i, i), or None."""
    row = rows[i]
    diagonal = row.get(i, 0)
    if diagonal > 0:
        return None
    if strict or diagonal < 0:
        return {i: 1}
    if not row:
        return None
    # 0 on the diagonal, b beside it, c on the other diagonal: e_j + t e_i has value 2 t b + c = -1.
    j, b = next(iter(row.items()))
    c = rows[j].get(j, 0)
    return {j: 1, i: -(c + 1) / (2 * b)}


def _back_substitute(bad: dict[int, Scalar], steps: list[tuple[int, dict[int, Scalar]]]) -> dict[int, Scalar]:
    """Extend a direction of the Schur complement to the whole matrix, with the same value."""
    vector = dict(bad)
    for k, factors in reversed(steps):
        entry = -sum(x * vector[j] for j, x in factors.items() if j in vector)
        if entry:
            vector[k] = entry
    return vector
