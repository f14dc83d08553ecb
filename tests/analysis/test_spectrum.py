"""Eigenvalues of A - W C in floating point (17)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dobc_design.analysis.analysis import check_spectrum
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import matrix

PAPER_A, PAPER_C, PAPER_W = matrix([[0, 2], [-2, 0]]), matrix([[1, 0]]), matrix([["16/5"], ["12/5"]])


def test_the_papers_observer_decays_at_eight_fifths():
    """-8/5 +- (2/5) sqrt(39) i (theory, known answers)."""
    result = check_spectrum(PAPER_A, PAPER_C, PAPER_W)
    assert result.rate == pytest.approx(1.6)
    wanted = [complex(-1.6, -0.4 * math.sqrt(39)), complex(-1.6, 0.4 * math.sqrt(39))]
    np.testing.assert_allclose(result.eigenvalues, wanted)
    assert str(result) == "the estimation error decays at 1.6 1/s"


def test_without_a_gain_the_error_does_not_decay():
    result = check_spectrum(PAPER_A, PAPER_C, matrix([[0], [0]]))
    assert result.rate == pytest.approx(0)
    assert "does not decay" in str(result)


def test_the_rate_is_negative_where_the_error_grows():
    assert check_spectrum(matrix([[1]]), matrix([[1]]), matrix([["1/2"]])).rate == pytest.approx(-0.5)


def test_the_slowest_eigenvalue_comes_first():
    result = check_spectrum(matrix([[-5, 0], [0, -1]]), matrix([[1, 0], [0, 1]]), matrix([[1, 0], [0, 1]]))
    assert result.eigenvalues == pytest.approx((-2, -6))


def test_a_zero_matrix_keeps_all_its_states():
    """python-control drops states without effect unless told not to."""
    result = check_spectrum(matrix([[0, 0], [0, 0]]), matrix([[0, 0]]), matrix([[0], [0]]))
    assert result.eigenvalues == (0, 0)


def test_random_spectra_agree_with_numpy():
    rng = np.random.default_rng(1)
    for _ in range(20):
        q, m = rng.integers(1, 6), rng.integers(1, 4)
        A, C, W = rng.integers(-3, 4, (q, q)), rng.integers(-3, 4, (m, q)), rng.integers(-3, 4, (q, m))
        result = check_spectrum(matrix(A.tolist()), matrix(C.tolist()), matrix(W.tolist()))
        wanted = np.linalg.eigvals(A - W @ C)
        assert result.rate == pytest.approx(-wanted.real.max(), abs=1e-6)
        np.testing.assert_allclose(sum(result.eigenvalues), wanted.sum(), atol=1e-9)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match=r"W must have shape \(2, 1\), one row per exosystem state"):
        check_spectrum(PAPER_A, PAPER_C, matrix([[1, 2]]))
    with pytest.raises(ShapeError, match="C must have 2 columns"):
        check_spectrum(PAPER_A, matrix([[1]]), PAPER_W)
