"""Ranks and margins of (A, C) in floating point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dobc_design.analysis.analysis import check_observability
from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import matrix
from dobc_design.exact.observability import decide_observable

PAPER_A, PAPER_C = matrix([[0, 2], [-2, 0]]), matrix([[1, 0]])


def test_the_papers_pair_is_observable():
    """O = [C; CA] = [[1, 0], [0, 2]]."""
    result = check_observability(PAPER_A, PAPER_C)
    assert (result.rank, result.order) == (2, 2)
    assert result.singular_values == pytest.approx((2, 1))


def test_the_margins_of_the_papers_pair_are_those_found_by_hand():
    """At +-2i, G = M* M of M = [A - 2i I; C] is [[9, 8i], [-8i, 8]], so the margin squared is (17 - sqrt(257))/2."""
    result = check_observability(PAPER_A, PAPER_C)
    assert [mode.margin for mode in result.modes] == pytest.approx([math.sqrt((17 - math.sqrt(257)) / 2)] * 2)
    assert result.margin == min(mode.margin for mode in result.modes)
    assert sorted(mode.eigenvalue.imag for mode in result.modes) == pytest.approx([-2, 2])


def test_a_constant_that_is_not_measured_has_margin_zero():
    """A = [0], C = [0] (theory, known answers)."""
    result = check_observability(matrix([[0]]), matrix([[0]]))
    assert (result.rank, result.margin) == (0, 0)


def test_two_equal_oscillators_seen_together_are_told_apart_by_nobody():
    """s^2 + 4 is unobservable (theory, known answers)."""
    A = matrix([[0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 2], [0, 0, -2, 0]])
    result = check_observability(A, matrix([[1, 0, 1, 0]]))
    assert result.rank == 2
    assert result.margin < 1e-12


def test_a_mode_that_is_not_seen_is_the_one_with_margin_zero():
    result = check_observability(matrix([[-1, 0], [0, -3]]), matrix([[1, 0]]))
    margins = {round(mode.eigenvalue.real): mode.margin for mode in result.modes}
    assert margins[-3] == pytest.approx(0)
    assert margins[-1] == pytest.approx(1)


def test_the_rank_agrees_with_exact_arithmetic_on_small_integers():
    rng = np.random.default_rng(0)
    for _ in range(60):
        q, m = rng.integers(1, 5), rng.integers(1, 3)
        A, C = matrix(rng.integers(-1, 2, size=(q, q)).tolist()), matrix(rng.integers(-1, 2, size=(m, q)).tolist())
        assert check_observability(A, C).rank == decide_observable(A, C).rank


def test_a_rank_that_overflows_is_unknown():
    result = check_observability(matrix([["1e200", 0, 0], [0, 1, 0], [0, 0, 2]]), matrix([[1, 1, 1]]))
    assert result.rank is None
    assert result.singular_values == ()
    assert "rank unknown of 3" in str(result)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match="A must be square"):
        check_observability(matrix([[0, 1]]), matrix([[1]]))
    with pytest.raises(ShapeError, match="C must have 2 columns, one column per exosystem state"):
        check_observability(PAPER_A, matrix([[1]]))


def test_the_result_is_said_in_words():
    assert str(check_observability(PAPER_A, PAPER_C)) == "rank 2 of 2, smallest mode margin 0.696"
