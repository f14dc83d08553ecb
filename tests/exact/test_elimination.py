"""LDL' elimination: both arithmetics, both questions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from dobc_design.exact import SparseSymmetric, from_float
from dobc_design.exact.cholesky import FLINT_SIZE, UnfinishedError, bad_direction


@pytest.mark.parametrize("size", [5, 12, 13, 20])
def test_both_arithmetics_give_the_same_direction(size: int):
    """Fraction and python-flint; the size chooses unless told."""
    G = np.random.default_rng(size).integers(-5, 6, (size, size))
    for shift in (0, -3, -200):
        M = SparseSymmetric.from_dense(from_float((G @ G.T + shift * np.eye(size)).astype(float), None))
        for strict in (True, False):
            one, two = (bad_direction(M, strict=strict, flint=flint) for flint in (True, False))
            assert one == two == bad_direction(M, strict=strict)
            assert (one is None) == (shift == 0)
    assert FLINT_SIZE == 13


@pytest.mark.parametrize("flint", [True, False])
def test_a_zero_row_is_semidefinite_and_not_definite(flint: bool):
    """diag(1, 0)."""
    M = SparseSymmetric(2, {(0, 0): Fraction(1)})
    assert bad_direction(M, strict=False, flint=flint) is None
    assert bad_direction(M, strict=True, flint=flint) == {1: 1}


@pytest.mark.parametrize("most_work", [1 + 2, 3 + 1])
def test_the_work_is_counted_and_not_timed(most_work):
    """A full matrix of three rows: three products at the first pivot, one at the second."""
    M = SparseSymmetric(3, {(i, j): Fraction(3 if i == j else 1) for i in range(3) for j in range(i, 3)})
    if most_work >= 4:
        assert bad_direction(M, strict=True, most_work=most_work) is None
    else:
        with pytest.raises(UnfinishedError, match="stopped at pivot 2 of 3"):
            bad_direction(M, strict=True, most_work=most_work)
