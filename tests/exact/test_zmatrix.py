"""Z-matrices: a positive vector with a positive image proves positive definiteness."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.exact.zmatrix import is_positive_vector, positive_vector
from dobc_design.verdict import Verdict


def grounded_ring(size: int, ground: Fraction) -> SparseSymmetric:
    """The Laplacian of a ring with ``ground`` added at the first node: positive definite iff ground > 0."""
    entries = {(i, i): Fraction(2) for i in range(size)}
    entries[0, 0] += ground
    entries |= {(i, i + 1): Fraction(-1) for i in range(size - 1)} | {(0, size - 1): Fraction(-1)}
    return SparseSymmetric(size, entries)


@pytest.mark.parametrize("size", [3, 60, 500])
def test_a_ring_held_at_one_node_has_a_positive_vector(size: int):
    """Theory, section 3: exists iff M > 0."""
    M = grounded_ring(size, Fraction(1))
    vector = positive_vector(M)
    assert vector is not None
    dense = np.array([[float(x) for x in row] for row in M.to_dense()])
    assert np.all(dense @ np.array([float(x) for x in vector]) > 0)
    assert decide_positive_definite(M).verdict is Verdict.PROVED


@pytest.mark.parametrize("ground", [Fraction(0), Fraction(-1, 10**9)])
def test_a_ring_held_by_nothing_has_none_and_is_refuted(ground: Fraction):
    """The constant vector has v'Mv = ground <= 0."""
    M = grounded_ring(60, ground)
    assert positive_vector(M) is None
    decision = decide_positive_definite(M)
    assert decision.verdict is Verdict.REFUTED
    assert decision.witness is not None and M.quadratic_form(decision.witness) <= 0


def test_a_barely_held_ring_is_proved_one_way_or_the_other():
    """ground = 1e-9 is positive definite; where the vector is not found, elimination decides."""
    assert decide_positive_definite(grounded_ring(60, Fraction(1, 10**9))).verdict is Verdict.PROVED


def test_a_positive_off_diagonal_entry_rules_the_method_out():
    """v = (1, 1) has M v > 0 for [[1, 2], [2, 1]], which is indefinite: the sign pattern is what makes it a proof."""
    M = SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(2), (1, 1): Fraction(1)})
    assert is_positive_vector(M, (1, 1))
    assert positive_vector(M) is None


def test_a_vector_that_is_not_positive_or_has_the_wrong_length_proves_nothing():
    M = grounded_ring(3, Fraction(1))
    assert not is_positive_vector(M, (1, 1, 0))
    assert not is_positive_vector(M, (1, 1))


def test_fractions_in_the_entries_are_exact():
    """1/3 - 1/3 is zero: M v must be > 0, not >= 0."""
    M = SparseSymmetric(2, {(0, 0): Fraction(1, 3), (0, 1): Fraction(-1, 3), (1, 1): Fraction(1, 3)})
    assert not is_positive_vector(M, (1, 1))
    assert positive_vector(M) is None


@pytest.mark.parametrize("seed", range(5))
def test_random_sparse_z_matrices_agree_with_eigenvalues(seed: int):
    """Random graphs of 80 nodes; the oracle is NumPy's eigvalsh, away from 0."""
    random = np.random.default_rng(seed)
    size = 80
    entries = {(i, i): Fraction(int(random.integers(1, 6))) for i in range(size)}
    for _ in range(120):
        i, j = sorted(random.choice(size, 2, replace=False).tolist())
        entries[i, j] = Fraction(-int(random.integers(1, 3)))
    M = SparseSymmetric(size, entries)
    smallest = float(np.linalg.eigvalsh(np.array([[float(x) for x in row] for row in M.to_dense()]))[0])
    assert abs(smallest) > 1e-6
    assert (decide_positive_definite(M).verdict is Verdict.PROVED) == (smallest > 0)
