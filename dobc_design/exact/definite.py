"""Definiteness of symmetric rational matrices, decided: elimination over the rationals, no rounding.

Theory, section 3: M > 0 iff every pivot of an LDL' elimination is positive. For larger matrices
with off-diagonal entries <= 0 a vector v > 0 with M v > 0 is tried first. The first pivot that is
not gives a vector v with v'Mv = that pivot; it is multiplied out again before anything is refuted.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, TypeAlias

import numpy as np

from dobc_design.errors import CertificateError, ShapeError
from dobc_design.exact._flint import to_fmpq
from dobc_design.exact.matrix import Matrix, Vector, from_float, matrix
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.exact.zmatrix import positive_vector
from dobc_design.verdict import Verdict

# Fraction, or flint's fmpq for larger matrices; both mix with int.
Scalar: TypeAlias = Any

# From this size on the conversion to flint's rationals has paid for itself.
_FLINT_SIZE: Final = 13
# From this size on a vector is looked for first, because elimination fills sparse matrices in.
_VECTOR_SIZE: Final = 48
# Roundings tried, in bits per entry, to make a strictly negative witness readable.
_WITNESS_BITS: Final = (4, 8, 16, 32, 64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Definiteness:
    """A decision with its proof method; when refuted, a witness v and the value v'Mv.

    The witness has integer entries. The value is <= 0 against "positive definite" and < 0 against
    "positive semidefinite".
    """

    verdict: Verdict
    method: str
    witness: Vector | None = None
    value: Fraction | None = None


def decide_positive_definite(M: Matrix | SparseSymmetric) -> Definiteness:
    """Decide M > 0 for a symmetric M (n, n); the empty matrix is positive definite.

    Returns: PROVED, or REFUTED with an integer witness v != 0, v'Mv <= 0; never UNDECIDED.
    Raises: ShapeError if M is not square and exactly symmetric.
    Source: theory, section 3 (sparse LDL', minimum-degree pivots on the diagonal).
    """
    return _decide(_sparse(M), strict=True)


def decide_positive_semidefinite(M: Matrix | SparseSymmetric) -> Definiteness:
    """Decide M >= 0 for a symmetric M (n, n); the empty matrix is positive semidefinite.

    Returns: PROVED, or REFUTED with an integer witness v, v'Mv < 0; never UNDECIDED.
    Raises: ShapeError if M is not square and exactly symmetric.
    Source: as above; a zero pivot is allowed if the rest of its row is zero.
    """
    return _decide(_sparse(M), strict=False)


def definiteness(matrix: object) -> Verdict:
    """Decide exactly whether a symmetric matrix is positive definite.

    Accepts a SparseSymmetric, or nested sequences of int, Fraction, float (its decimal text: 0.1
    is 1/10) and text ("9/16"), or a two-dimensional NumPy array (numeric data: each float is its
    exact binary value, 0.1 is 3602879701896397/2^55). The empty matrix is positive definite.
    Returns: PROVED iff matrix > 0, REFUTED iff not; never UNDECIDED.
    Raises: ShapeError if not square or not exactly symmetric; SpecError for nan, inf and what is
    no number.
    """
    return decide_positive_definite(_read(matrix)).verdict


def _read(given: object) -> Matrix | SparseSymmetric:
    if isinstance(given, SparseSymmetric):
        return given
    if isinstance(given, np.ndarray) and given.dtype != object:
        if given.ndim != 2 or given.shape[0] != given.shape[1]:
            raise ShapeError(f"matrix must be square; got shape {given.shape}.", key="matrix")
        return from_float(given, None)
    if not isinstance(given, (Sequence, np.ndarray)):
        raise ShapeError(f"matrix must be a list of rows; got {type(given).__name__}.", key="matrix")
    rows: list[Any] = [
        from_float(row[np.newaxis], None)[0]
        if isinstance(row, np.ndarray) and row.ndim == 1 and row.dtype != object
        else row
        for row in given
    ]
    return matrix(rows)


def _sparse(M: Matrix | SparseSymmetric) -> SparseSymmetric:
    return M if isinstance(M, SparseSymmetric) else SparseSymmetric.from_dense(M)


def _decide(M: SparseSymmetric, *, strict: bool) -> Definiteness:
    long = M.size >= _FLINT_SIZE
    if strict and M.size >= _VECTOR_SIZE and positive_vector(M) is not None:
        return Definiteness(verdict=Verdict.PROVED, method="Z-matrix: integers v > 0 with M v > 0")
    method = "LDL' over the rationals" + (" (python-flint)" if long else "")
    rows: list[dict[int, Scalar]] = [{} for _ in range(M.size)]
    for (i, j), value in M.entries.items():
        rows[i][j] = rows[j][i] = to_fmpq(value) if long else value
    found = _eliminate(rows, strict=strict)
    if found is None:
        return Definiteness(verdict=Verdict.PROVED, method=method)
    direction = {i: Fraction(int(x.numerator), int(x.denominator)) for i, x in found.items()}
    witness, value = _checked_witness(M, direction, strict=strict)
    return Definiteness(verdict=Verdict.REFUTED, method=method, witness=witness, value=value)


def _eliminate(rows: list[dict[int, Scalar]], *, strict: bool) -> dict[int, Scalar] | None:
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


def _checked_witness(M: SparseSymmetric, direction: dict[int, Fraction], *, strict: bool) -> tuple[Vector, Fraction]:
    """Return an integer multiple or rounding of the direction that refutes, and its value v'Mv.

    Raises: CertificateError if it does not refute, which would be a mistake in the elimination.
    """
    common = math.lcm(*(x.denominator for x in direction.values()))
    exact = [int(direction.get(i, Fraction(0)) * common) for i in range(M.size)]
    largest = max(abs(x) for x in exact)
    roundings = (
        [(2 * x * 2**bits + largest) // (2 * largest) for x in exact]
        for bits in _WITNESS_BITS
        if largest.bit_length() > bits
    )
    for candidate in (*roundings, exact):
        witness = _primitive(candidate)
        value = M.quadratic_form(witness)
        if value < 0 or (strict and value == 0 and any(witness)):
            return witness, value
    raise CertificateError("the elimination gave a witness that does not refute; nothing is claimed.")


def _primitive(vector: list[int]) -> Vector:
    """Divide by the common factor and make the first entry that is not 0 positive."""
    factor = math.gcd(*vector) or 1
    if next((x for x in vector if x), 1) < 0:
        factor = -factor
    return tuple(Fraction(x // factor) for x in vector)
