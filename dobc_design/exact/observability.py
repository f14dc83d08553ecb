"""Observability and detectability of a pair (A, C), decided over the rationals.

Paper: the observer error (17) can be placed freely only if (A, C) is observable. Theory, section 2:
Theorem 1 needs detectability; where it fails, the observable part of the exosystem does as well,
because d = C xi depends on that part only. No eigenvalue is computed.
"""

from dobc_design._checks import noun, require_shape, require_square
from dobc_design._show.cards import Shown
from dobc_design.verdict import Decided, Verdict

from .matrix import (
    Matrix,
    Vector,
    identity,
    inverse,
    multiply,
    nullspace,
    row_echelon,
    transpose,
)
from .number import from_fmpq_mat, to_fmpq_mat
from .polynomial import (
    Coefficients,
    RouthTable,
    characteristic_polynomial,
    polynomial_text,
    routh,
)


@noun
class Observability(Shown, Decided):
    """Rank of the observability matrix of (A, C), A (q, q), and what C never sees.  ``verdict`` is
    PROVED iff rank = size; ``unobservable`` is a basis of the states xi0 from which d = C xi stays
    0, q entries each."""

    rank: int
    size: int
    verdict: Verdict
    unobservable: tuple[Vector, ...]


@noun
class Detectability(Shown, Decided):
    """Whether what C never sees dies out by itself.  ``unobservable_polynomial`` is the
    characteristic polynomial of A on the unobservable subspace, highest power first, (1,) if that
    is {0}; ``table`` is its Routh table and ``verdict`` follows."""

    verdict: Verdict
    unobservable_polynomial: Coefficients
    table: RouthTable

    @property
    def unobservable_text(self) -> str:
        """The unobservable polynomial as text, "s^2 + 4"; "1" for an observable pair."""
        return polynomial_text(self.unobservable_polynomial)


def observability_matrix(A: Matrix, C: Matrix) -> Matrix:
    """Return [C; C A; ...; C A^(q-1)], (q m, q), for A (q, q) and C (m, q).  Raises: ShapeError."""
    size = _require_pair(A, C)
    if not size or not C:
        return ()
    block = to_fmpq_mat(C)
    flow = to_fmpq_mat(A)
    rows = list(C)
    # By Cayley and Hamilton higher powers of A show nothing new.
    for _ in range(size - 1):
        block = block * flow
        rows.extend(from_fmpq_mat(block))
    return tuple(rows)


def decide_observable(A: Matrix, C: Matrix) -> Observability:
    """Decide exactly whether (A, C) is observable, A (q, q), C (m, q).  Returns: PROVED or REFUTED,
    with the rank and the unobservable states; q = 0 is observable. Raises: ShapeError if the shapes
    do not fit. Source: Kalman 1963; paper, below (16)."""
    size = _require_pair(A, C)
    unobservable = nullspace(observability_matrix(A, C)) if C else identity(size)
    found = size - len(unobservable)
    verdict = Verdict.PROVED if found == size else Verdict.REFUTED
    return Observability(rank=found, size=size, verdict=verdict, unobservable=unobservable)


def decide_detectable(A: Matrix, C: Matrix) -> Detectability:
    """Decide exactly whether (A, C) is detectable: A Hurwitz on the unobservable subspace.  Shapes:
    A (q, q) in 1/s, C (m, q). Returns: PROVED or REFUTED, with the polynomial of the undetected
    modes. Raises: ShapeError if the shapes do not fit. Source: theory, section 2."""
    # What C sees can be placed by W; only what it never sees has to die out by itself.
    basis: Matrix = decide_observable(A, C).unobservable
    R: Matrix = ()
    if basis:  # A N = N R: the subspace that the columns N of the basis span is invariant
        N = transpose(basis)
        R = multiply(multiply(inverse(multiply(basis, N)), basis), multiply(A, N))
    polynomial = characteristic_polynomial(R)
    table = routh(polynomial)
    return Detectability(verdict=table.verdict, unobservable_polynomial=polynomial, table=table)


def observable_reduction(A: Matrix, C: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return (A_o, C_o, T): the observable part xi_o = T xi, with T A = A_o T and C = C_o T.

    Shapes: A (q, q), C (m, q); with r = rank of the observability matrix, A_o (r, r), C_o (m, r), T
    (r, q) of full row rank; (A_o, C_o) is observable. An observable pair comes back with T = I;
    with r = 0, A_o and T have no rows and C_o has empty rows. Raises: ShapeError if the shapes do
    not fit. Source: Kalman decomposition.
    """
    _require_pair(A, C)
    T = row_echelon(observability_matrix(A, C))[0]
    if not T:
        return (), tuple(() for _ in C), ()
    # The rows of T span the rows of C and of T A, so this right inverse solves both equations.
    right = multiply(transpose(T), inverse(multiply(T, transpose(T))))
    return multiply(multiply(T, A), right), multiply(C, right), T


def _require_pair(A: Matrix, C: Matrix) -> int:
    size = require_square(A, "A")
    require_shape(C, (None, size), name="C", because=f"one per row of A (A is {size}x{size})")
    return size
