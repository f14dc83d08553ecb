"""Rounding to rationals that can be read, and putting solver vectors into matrices."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse

from dobc_design.conditions.consensus.claim import reduced
from dobc_design.solvers.conic import smat, svec, symmetric_basis
from dobc_design.solvers.program import Solution, assemble, round_matrix, without_values


@pytest.mark.parametrize("size", [1e-300, 1e-9, 1.0, 12345.678, 1e300])
@pytest.mark.parametrize("digits", [1, 3, 6, 15])
def test_the_largest_entry_keeps_its_digits(size, digits):
    array = size * np.array([[1.0, -0.123456789012345], [0.987654321012345, 0.0]])
    exact = round_matrix(array, digits)
    largest = float(np.max(np.abs(array)))
    for row, values in zip(exact, array.tolist(), strict=True):
        for x, value in zip(row, values, strict=True):
            assert abs(float(x) - value) <= 0.51 * largest * 10.0 ** (1 - digits)


def test_rounding_is_decimal_and_keeps_symmetry():
    array = np.array([[0.5, 1 / 3], [1 / 3, 2 / 3]])
    assert round_matrix(array, 3) == ((Fraction(1, 2), Fraction(333, 1000)), (Fraction(333, 1000), Fraction(667, 1000)))


def test_nothing_and_zero_are_rounded_too():
    assert round_matrix(np.zeros((2, 1)), 3) == ((0,), (0,))
    assert round_matrix(np.zeros((0, 0)), 3) == ()


def test_numbers_go_to_their_places(harmonic):
    """Unknowns in order: P_11, P_12, P_22, Q_11, Q_21."""
    values = assemble(reduced(Fraction(-1), harmonic), [1.0, 2.0, 3.0, 4.0, 5.0])
    assert values["P"].tolist() == [[1, 2], [2, 3]]
    assert values["Q"].tolist() == [[4], [5]]


def test_a_solution_is_found_only_with_finite_values():
    assert not without_values("failed", solver="x").found
    bad = Solution(status="Solved", solver="x", objective=1.0, values={"P": np.array([[np.nan]])})
    assert not bad.found


@pytest.mark.parametrize("size", [1, 2, 5])
def test_svec_keeps_inner_products_and_smat_takes_it_back(size):
    """<A, B> = svec(A)'svec(B); Clarabel's order is the upper triangle, column by column."""
    rng = np.random.default_rng(size)
    A, B = (M + M.T for M in rng.standard_normal((2, size, size)))
    assert svec(A) @ svec(B) == pytest.approx(np.sum(A * B))
    assert np.allclose(smat(svec(A)), A)
    assert np.array_equal(svec(sparse.csr_array(A)), svec(A))
    units = np.stack([svec(unit) for unit in symmetric_basis(size)])
    assert np.array_equal(units != 0, np.eye(len(units), dtype=bool))
