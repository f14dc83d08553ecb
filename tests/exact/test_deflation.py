"""Lifted eigenvalues: singular and nearly singular dense matrices, decided exactly at sizes beyond elimination."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from dobc_design.exact import IntegerSymmetric, SparseSymmetric
from dobc_design.exact.cholesky import Scaled, bad_direction, decide_lifted, scaled


def gram(n: int, columns: int, *, seed: int) -> np.ndarray:
    """G G' with G (n, columns) of small integers: rank ``columns``, so n - columns eigenvalues are exactly 0."""
    G = np.random.default_rng(seed).integers(-5, 6, (n, columns))
    return (G @ G.T).astype(float)


def lifted(M: IntegerSymmetric | SparseSymmetric, *, strict: bool) -> dict[int, Fraction] | None:
    S = scaled(M)
    assert isinstance(S, Scaled)
    return decide_lifted(M, S, *np.linalg.eigh(S.floats), strict=strict)


@pytest.mark.parametrize(("n", "columns"), [(20, 19), (40, 38), (60, 57), (120, 119)])
def test_a_singular_gram_matrix_is_semidefinite_and_not_definite(n: int, columns: int):
    """Closed form: rank below n. The direction is an exact null vector."""
    M = IntegerSymmetric.from_floats(gram(n, columns, seed=n))
    assert lifted(M, strict=False) == {}
    direction = lifted(M, strict=True)
    assert direction
    assert M.quadratic_form([direction.get(i, Fraction(0)) for i in range(n)]) == 0


@pytest.mark.parametrize("shift", [Fraction(1, 10**40), Fraction(-1, 10**40)])
def test_the_sign_of_a_shift_far_below_the_doubles_is_seen(shift: Fraction):
    """G G' + shift I is definite iff shift > 0; the decimal matrix is exact, not a double."""
    n = 30
    M = IntegerSymmetric.from_floats(gram(n, n - 1, seed=1)).to_sparse().shifted(shift)
    for strict in (True, False):
        direction = lifted(M, strict=strict)
        assert direction is not None
        assert (direction == {}) == (shift > 0)
        if direction:
            assert M.quadratic_form([direction.get(i, Fraction(0)) for i in range(n)]) < 0


def test_it_agrees_with_elimination_on_badly_scaled_matrices():
    """D G G' D + shift with entries from 2^-60 to 2^60."""
    n = 24
    D = [Fraction(2) ** int(k) for k in np.random.default_rng(2).integers(-30, 30, n)]
    whole = gram(n, n - 1, seed=3)
    for shift in (Fraction(-1, 2**90), Fraction(0), Fraction(1, 2**90)):
        entries = {
            (i, j): D[i] * D[j] * (Fraction(whole[i, j]) + (i == j) * shift) for i in range(n) for j in range(i, n)
        }
        M = SparseSymmetric(n, entries)
        for strict in (True, False):
            assert (lifted(M, strict=strict) == {}) == (bad_direction(M, strict=strict) is None)


def test_it_passes_on_where_nothing_or_too_much_is_small():
    """No eigenvalue near 0: nothing to lift. Half of them 0: elimination is as good."""
    assert lifted(IntegerSymmetric.from_floats(gram(20, 60, seed=0) + 100 * np.eye(20)), strict=True) is None
    assert lifted(IntegerSymmetric.from_floats(gram(20, 10, seed=0)), strict=True) is None


def test_wrong_eigenvectors_never_give_a_wrong_answer():
    """The guesses are random directions: it passes on, or is right all the same."""
    n = 20
    M = IntegerSymmetric.from_floats(gram(n, n - 1, seed=4))
    S = scaled(M)
    assert isinstance(S, Scaled)
    values = np.linalg.eigh(S.floats)[0]
    for seed in range(5):
        Q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))
        assert decide_lifted(M, S, values, Q, strict=True) != {}
        assert not decide_lifted(M, S, values, Q, strict=False)


def test_what_is_left_after_the_lift_has_to_be_proved_definite():
    """One eigenvalue is -1/2; the largest is lifted instead. G > 0 then, and M is not: it has to pass on."""
    n = 8
    Q, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((n, n)))
    A = (Q * np.array([-0.5, *range(2, n + 1)])) @ Q.T
    M = IntegerSymmetric.from_floats((A + A.T) / 2)
    S = scaled(M)
    assert isinstance(S, Scaled)
    vectors = np.linalg.eigh(S.floats)[1]
    assert decide_lifted(M, S, np.array([0.0] + [1.0] * (n - 1)), vectors[:, ::-1], strict=True) is None
