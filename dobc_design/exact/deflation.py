"""Dense matrices with a few eigenvalues next to 0, decided exactly: those directions are lifted first.

V holds rounded eigenvectors of the small eigenvalues, B = D M D + V V' is far from singular and proved
positive definite by an integer factor (``cholesky``). The block matrix [[B, V], [V', I]] has the Schur complements
D M D and G = I - V'B^-1 V, so M > 0 iff G > 0, and M >= 0 iff G >= 0. G has one row per small eigenvalue and
comes from an exact linear solve (python-flint, p-adic lifting), where an elimination of M would carry
numbers of thousands of digits through all of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Final

import numpy as np

from dobc_design.exact._flint import from_fmpq_mat, to_fmpq
from dobc_design.exact.cholesky import HIGH_BITS, Floats, Scaled, Whole, margin, proves_by_integers
from dobc_design.exact.elimination import bad_direction
from dobc_design.exact.integers import IntegerSymmetric
from dobc_design.exact.symmetric import SparseSymmetric

if TYPE_CHECKING:
    from flint import fmpq_mat

# Bits of a lifted direction; it only has to point near the eigenvector.
_LIFT_BITS: Final = 12
# More small eigenvalues than this share of the rows, and elimination is as good.
_SHARE: Final = 8


def decide_lifted(
    M: SparseSymmetric | IntegerSymmetric, S: Scaled, values: Floats, vectors: Floats, *, strict: bool
) -> dict[int, Fraction] | None:
    """Decide M > 0 (strict) or M >= 0 exactly, or return None where the method does not get through.

    S: M scaled; values, vectors: the eigenvalues, rising, and eigenvectors of its floats, as guesses only.
    Returns: {} if proved, else a direction v, by its entries, with v'Mv <= 0 (< 0 if not strict).
    """
    few = int(np.count_nonzero(values < 2**10 * margin(S)))
    if not 0 < few <= max(4, S.size // _SHARE):
        return None
    lift = np.rint(np.ldexp(vectors[:, :few], _LIFT_BITS)).astype(np.int64)
    square = lift @ lift.T
    B = replace(
        S, high=S.high + (square << 2 * (HIGH_BITS - _LIFT_BITS)), floats=S.floats + np.ldexp(square, -2 * _LIFT_BITS)
    )
    if not proves_by_integers(B):
        return None
    solution = _solved(M, S, square, lift)
    Z = from_fmpq_mat(solution)
    unit = Fraction(1, 2**_LIFT_BITS)
    V = [[unit * x for x in row] for row in lift.tolist()]
    G = {
        (a, b): (a == b) - sum((V[i][a] * Z[i][b] for i in range(S.size) if V[i][a]), Fraction(0))
        for a in range(few)
        for b in range(a, few)
    }
    found = bad_direction(SparseSymmetric(few, G), strict=strict)
    if found is None:
        return {}
    # With w'Gw <= 0 and v = -Z w: v'(D M D)v <= [v; w]'[[B, V], [V', I]][v; w] = w'Gw.
    exponents = S.exponents.tolist()
    direction = {
        i: Fraction(2) ** -exponents[i] * sum((row[b] * w for b, w in found.items()), Fraction(0))
        for i, row in enumerate(Z)
    }
    return {i: x for i, x in direction.items() if x}


def _solved(M: SparseSymmetric | IntegerSymmetric, S: Scaled, square: Whole, lift: Whole) -> fmpq_mat:
    """Return Z (n, k) with (D M D + V V') Z = V, exactly; M without its denominator if it is an IntegerSymmetric."""
    from flint import fmpq, fmpq_mat

    n = S.size
    exponents = S.exponents.tolist()
    unit = fmpq(1, 2 ** (2 * _LIFT_BITS))
    entries = [[unit * x for x in row] for row in square.tolist()]
    places: Iterable[tuple[int, int, fmpq]]
    if isinstance(M, IntegerSymmetric):
        places = zip(M.rows.tolist(), M.columns.tolist(), (fmpq(x) for x in M.values.tolist()), strict=True)
    else:
        places = ((i, j, to_fmpq(x)) for (i, j), x in M.entries.items())
    for i, j, x in places:
        power = exponents[i] + exponents[j]
        entry = x / 2**power if power >= 0 else x * 2**-power
        entries[i][j] += entry
        if i != j:
            entries[j][i] += entry
    right = fmpq_mat(n, lift.shape[1], [fmpq(x, 2**_LIFT_BITS) for row in lift.tolist() for x in row])
    return fmpq_mat(n, n, [x for row in entries for x in row]).solve(right)
