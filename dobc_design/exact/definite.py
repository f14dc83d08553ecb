"""Definiteness of symmetric rational matrices: decided exactly at every size, by the path that
fits.

Up to 12 rows LDL' over the rationals; from 13 on the paths of ``_PATHS``, in this order, then LDL'
by python-flint. A path answers or passes on; the last one always answers, unless the caller bounds
its work. "Proved" comes from exact or outward-rounded arithmetic, "refuted" only from a vector that
is multiplied out exactly.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Final

import numpy as np

from dobc_design._checks import noun
from dobc_design._show.cards import Shown
from dobc_design.errors import CertificateError, misshapen
from dobc_design.exact.matrix import Array
from dobc_design.verdict import Decided, Verdict

from .cholesky import (
    FLINT_SIZE,
    Scaled,
    UnfinishedError,
    bad_direction,
    low_directions,
    margin,
    proves_by_integers,
    scaled,
)
from .matrix import Matrix, Vector, from_float, matrix, nullspace
from .polynomial import characteristic_polynomial
from .symmetric import IntegerSymmetric, SparseSymmetric, Symmetric, in_integers
from .zmatrix import is_z_matrix, search

# Roundings tried, in bits of the largest entry, to make a witness readable and sparse.
_WITNESS_BITS: Final = (1, 2, 4, 8, 16, 32, 64)


@noun
class Definiteness(Shown, Decided):
    """A decision with its proof method, a short sentence that names the path by size and
    structure.  Refuted: an integer ``witness`` v and the ``value`` v'Mv, <= 0, or < 0 against
    "semidefinite". Proved by a vector: the positive integers v, with M v > 0 (>= 0), positive
    entries beside the diagonal taken as negative."""

    verdict: Verdict
    method: str
    witness: Vector | None = None
    value: Fraction | None = None
    vector: tuple[int, ...] | None = None


def refuted(
    M: Symmetric, direction: Mapping[int, Fraction], *, strict: bool, method: str
) -> Definiteness:
    """Return the decision REFUTED by an integer multiple or rounding of an exact direction, by its
    entries.  Raises: CertificateError if it does not refute, which would be a mistake in the path
    that gave it."""
    # A multiple of a direction refutes as well, and integers multiply out faster.
    common = math.lcm(*(x.denominator for x in direction.values()))
    exact = [int(direction.get(i, 0) * common) for i in range(M.size)]
    decision = first_refuting(M, (*roundings(exact), exact), strict=strict, method=method)
    if decision is None:
        raise CertificateError(
            "the elimination gave a witness that does not refute; nothing is claimed."
        )
    return decision


def first_refuting(
    M: Symmetric, candidates: Iterable[Sequence[int]], *, strict: bool, method: str
) -> Definiteness | None:
    """Return the decision REFUTED by the first candidate, a vector of integers, that refutes; else
    None."""
    refuted = Verdict.REFUTED
    for candidate in filter(any, candidates):
        # Without a common factor, and the first entry that is not 0 positive.
        factor = math.gcd(*candidate)
        if next(filter(None, candidate)) < 0:
            factor = -factor
        witness = tuple(Fraction(x // factor) for x in candidate)
        value = M.quadratic_form(witness)
        if value < 0 or (strict and value == 0):
            return Definiteness(verdict=refuted, method=method, witness=witness, value=value)
    return None


def roundings(vector: Sequence[int]) -> Iterator[list[int]]:
    """Yield shorter and shorter roundings of integers, the coarsest first; small entries become
    0."""
    largest = max((abs(x) for x in vector), default=0)
    for bits in _WITNESS_BITS:
        if largest.bit_length() > bits:
            yield [(2 * x * 2**bits + largest) // (2 * largest) for x in vector]


# The borders, by CPU times measured in one run (Gram matrices of random integers; rings with
# chords): up to 12 rows Fractions take 2 ms at most, and nothing is easier to trust. LDL' with
# flint takes 11 to 60 times as long as the integer rest at 32 rows, over 1000 times as long as the
# vector on a ring of 400.
_DENSE_SIZE: Final = 2000
# A characteristic polynomial of so many rows takes some two minutes.
_POLYNOMIAL_SIZE: Final = 400
# Sparse: at most one entry of the upper triangle in so many.
_SPARSE: Final = 8
# Eigenvectors tried as witnesses, lowest first.
_EIGENVECTORS: Final = 2


def decide_positive_definite(
    M: Matrix | Symmetric, *, most_work: int | None = None
) -> Definiteness:
    """Decide M > 0 for a symmetric M (n, n); the empty matrix is positive definite.

    ``most_work`` bounds the last path above 2000 rows, where no other is without a bound
    (``elimination``). Returns: PROVED, or REFUTED with an integer witness v != 0, v'Mv <= 0;
    UNDECIDED only beyond ``most_work``. Raises: ShapeError if M is not square and exactly
    symmetric. Source: theory, sections 3 and 8; the table above.
    """
    return _decide(_Case(given=_symmetric(M), strict=True, most_work=most_work))


def decide_positive_semidefinite(M: Matrix | Symmetric) -> Definiteness:
    """Decide M >= 0 for a symmetric M (n, n); the empty matrix is positive semidefinite.  Returns:
    PROVED, or REFUTED with an integer witness v, v'Mv < 0; never UNDECIDED. Raises: ShapeError if M
    is not square and exactly symmetric.
    Source: as above. What proves M > 0 proves this; singular M are left to the vector, the
    polynomial and LDL'."""
    return _decide(_Case(given=_symmetric(M), strict=False))


def decide_quickly(M: Matrix | Symmetric) -> Definiteness:
    """Decide M > 0 by one Cholesky factorisation or one eigenvector, or leave it UNDECIDED near the
    edge.  PROVED by the factor's exact rest; REFUTED by v'Mv <= 0, multiplied out exactly. O(n^3)
    in doubles, O(n^2) memory. Raises: ShapeError if M is not square and exactly symmetric."""
    case = _Case(given=_symmetric(M), strict=True)
    if case.size == 0:
        return case.proved("no rows")
    method = case.named("Cholesky factor in integers")
    unknown = Definiteness(verdict=Verdict.UNDECIDED, method=method)
    return _by_diagonal(case) or _by_integers(case) or _by_eigenvector(case) or unknown


def definiteness(matrix: object) -> Verdict:
    """Decide exactly whether a symmetric matrix is positive definite.

    Accepts a SparseSymmetric or IntegerSymmetric, or nested sequences of int, Fraction, float (its
    decimal text: 0.1 is 1/10) and text ("9/16"), or a two-dimensional NumPy array (each float is
    its exact binary value). The empty matrix is positive definite.  Returns: PROVED iff matrix > 0,
    REFUTED iff not; never UNDECIDED.
    Raises: ShapeError if not square or not exactly symmetric; SpecError for nan, inf and what is no
    number.
    Example:
        >>> matrices = [[2, 1], [1, "1/2"]], [[2, 1], [1, 0.51]]
        >>> tuple(dd.exact.definiteness(each).value for each in matrices)
        ('refuted', 'proved')
    """
    return decide_positive_definite(_read(matrix)).verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class _Case:
    """One question, and what several paths need of the matrix, computed once."""

    given: Symmetric
    strict: bool
    most_work: int | None = None

    @property
    def size(self) -> int:
        return self.given.size

    @cached_property
    def matrix(self) -> Symmetric:
        """The same matrix, in arrays of integers where these are not long: they multiply out
        faster."""
        if self.size < FLINT_SIZE:
            return self.given
        return in_integers(self.given) or self.given

    @cached_property
    def entries(self) -> int:
        if isinstance(self.matrix, IntegerSymmetric):
            return len(self.matrix.values)
        return len(self.matrix.entries)

    @property
    def is_sparse(self) -> bool:
        return _SPARSE * self.entries <= self.size * self.size // 2

    @cached_property
    def scaled(self) -> Scaled | list[int] | None:
        return scaled(self.matrix)

    @cached_property
    def spectrum(self) -> tuple[Array, Array] | None:
        """Eigenvalues, rising, and eigenvectors of the scaled matrix in doubles: guesses."""
        if not isinstance(self.scaled, Scaled):
            return None
        try:
            values, vectors = np.linalg.eigh(self.scaled.floats)
        except np.linalg.LinAlgError:  # it did not converge; the next path needs no guess
            return None
        return values, vectors

    def named(self, method: str) -> str:
        """Say by which path, and of what size and structure M is."""
        return f"{method}; {self.size} rows, {self.entries} entries on and above the diagonal"

    def proved(self, method: str, *, vector: tuple[int, ...] | None = None) -> Definiteness:
        return Definiteness(verdict=Verdict.PROVED, method=self.named(method), vector=vector)


def _decide(case: _Case) -> Definiteness:
    # Small matrices are eliminated at once: nothing is easier to trust.
    paths = _PATHS if case.size >= FLINT_SIZE else ()
    for most, path in paths:
        if case.size <= most:
            decision = path(case)
            if decision is not None:
                return decision
    return _by_elimination(case)


def _by_elimination(case: _Case) -> Definiteness:
    method = "LDL' over the rationals"
    if case.size >= FLINT_SIZE:
        method += " (python-flint)"
    M = case.given.to_sparse() if isinstance(case.given, IntegerSymmetric) else case.given
    most_work = case.most_work if case.size > _DENSE_SIZE else None
    try:
        direction = bad_direction(M, strict=case.strict, most_work=most_work)
    except UnfinishedError as error:
        what = f"{case.named(method)}; {error}, because it was taking too much work"
        return Definiteness(verdict=Verdict.UNDECIDED, method=what)
    if direction is None:
        return case.proved(method)
    return refuted(case.matrix, direction, strict=case.strict, method=case.named(method))


def _by_diagonal(case: _Case) -> Definiteness | None:
    """Refute by the first entry of the diagonal that is not positive."""
    for bad, x in enumerate(case.matrix.diagonal()):
        if x < 0 or (case.strict and x == 0):
            unit = [int(i == bad) for i in range(case.size)]
            return _first(case, (unit,), "entry of the diagonal")
    return None


def _by_vector(case: _Case) -> Definiteness | None:
    """Of a Z-matrix, or one with few entries, or with too many rows for dense work in any case."""
    # Of dense rows a factor is found sooner, unless the signs are those that a vector needs.
    if not (case.is_sparse or case.size > _DENSE_SIZE or is_z_matrix(case.matrix)):
        return None
    found = search(case.matrix, strict=case.strict)
    if found.vector is None:
        return _first(case, found.directions, found.kind)
    sign = ">" if case.strict else ">="
    beside = "Z-matrix" if is_z_matrix(case.matrix) else "M with negative sizes beside the diagonal"
    return case.proved(f"{beside}: integers v > 0 with M v {sign} 0", vector=found.vector)


def _by_integers(case: _Case) -> Definiteness | None:
    if not isinstance(case.scaled, Scaled) or not proves_by_integers(case.scaled):
        return None
    return case.proved("Cholesky factor in integers, its exact rest dominated by the diagonal")


def _by_eigenvector(case: _Case) -> Definiteness | None:
    """Refute by a pair of rows with a large entry, or by the lowest eigenvectors."""
    if isinstance(case.scaled, list):
        return _first(case, (case.scaled,), "an entry too large beside the diagonal")
    if case.scaled is None or case.spectrum is None:
        return None
    # Eigenvalues above the margin are positive beyond rounding: their vectors refute nothing.
    values, vectors = case.spectrum
    below = int(np.count_nonzero(values < margin(case.scaled)))
    low = vectors[:, : min(_EIGENVECTORS, below)]
    return _first(case, low_directions(case.scaled, low), "eigenvector, rounded and multiplied out")


def _by_polynomial(case: _Case) -> Definiteness | None:
    """Decide next to the edge: the eigenvalues are real, so that none is below 0 iff the signs of
    det(s I - M) alternate (Descartes)."""
    # Of sparse rows few fill in: LDL' is quick.
    if case.is_sparse or case.spectrum is None or not isinstance(case.scaled, Scaled):
        return None
    M = case.matrix.to_dense()
    coefficients = characteristic_polynomial(M)
    alternate = all(x * (-1) ** k >= 0 for k, x in enumerate(coefficients))
    method = "signs of the characteristic polynomial (python-flint)"
    if alternate and (coefficients[-1] or not case.strict):
        return case.proved(method)
    # u with M u = 0, else with M u = v for the lowest eigenvector v, about: u'Mu = v'M^-1 v < 0,
    # where an eigenvalue is just below 0.
    (v,) = low_directions(case.scaled, case.spectrum[1][:, :1])
    u = nullspace(tuple((*row, Fraction(-x)) for row, x in zip(M, v, strict=True)))[0][:-1]
    common = math.lcm(*(x.denominator for x in u))
    return _first(case, ([int(x * common) for x in u],), method)


def _first(case: _Case, directions: Iterable[list[int]], method: str) -> Definiteness | None:
    """Refute by the first direction or rounding of one that does; None if none does."""
    candidates = (each for d in directions for each in (*roundings(d), d))
    return first_refuting(case.matrix, candidates, strict=case.strict, method=case.named(method))


def _read(given: object) -> Matrix | Symmetric:
    if isinstance(given, SparseSymmetric | IntegerSymmetric):
        return given
    if isinstance(given, np.ndarray) and given.dtype != object:
        if given.ndim != 2 or given.shape[0] != given.shape[1]:
            raise misshapen("matrix", f"must be square; got shape {given.shape}.")
        if len(given) >= FLINT_SIZE and given.dtype in (np.float32, np.float64):
            return IntegerSymmetric.from_floats(given)
        return from_float(given, None)
    if not isinstance(given, (Sequence, np.ndarray)):
        what = f"must be a list of rows; got {type(given).__name__}."
        raise misshapen("matrix", what)
    # Floats of an array are binary values; those in a list mean their decimal text.
    rows: list[Any] = []
    for row in given:
        numeric = isinstance(row, np.ndarray) and row.ndim == 1 and row.dtype != object
        rows.append(from_float(row[None], None)[0] if numeric else row)
    return matrix(rows)


def _symmetric(M: Matrix | Symmetric) -> Symmetric:
    return M if isinstance(M, SparseSymmetric | IntegerSymmetric) else SparseSymmetric.from_dense(M)


# The paths from FLINT_SIZE rows on, each with the most rows that it is tried for.
_PATHS: Final[tuple[tuple[float, Callable[[_Case], Definiteness | None]], ...]] = (
    (math.inf, _by_diagonal),
    (math.inf, _by_vector),
    (_DENSE_SIZE, _by_integers),
    (_DENSE_SIZE, _by_eigenvector),
    (_POLYNOMIAL_SIZE, _by_polynomial),
)
