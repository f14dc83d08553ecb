"""Enclosed matrices: a proof holds for everything enclosed, a witness refutes everything enclosed."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np

from dobc_design.conditions.consensus.network import (
    Enclosed,
    find_witness,
    is_negative,
    lowest_quotient,
    refuted_margin,
    refutes,
)
from dobc_design.conditions.numbers import claimed
from dobc_design.exact.pencil import Deviation
from dobc_design.exact.symmetric import SparseSymmetric


def random_enclosed(seed):
    r = Random(seed)
    n = r.randint(1, 5)
    entries = {(i, j): Fraction(r.randint(-6, 2 if i != j else -1)) for i in range(n) for j in range(i, n)}
    places = [(r.randrange(n), r.randrange(n), r.randrange(n)) for _ in range(r.randint(0, 4))]
    deviations = tuple(Deviation(*place, Fraction(1, r.randint(1, 30))) for place in places)
    return Enclosed(middle=SparseSymmetric(n, entries), deviations=deviations)


def corners(matrix):
    """The matrix at every choice t = +-size, as floats."""
    n = matrix.middle.size
    base = np.array(matrix.middle.to_dense(), dtype=float)
    for signs in np.ndindex(*(2,) * len(matrix.deviations)):
        total = base.copy()
        for sign, d in zip(signs, matrix.deviations, strict=True):
            t = float(d.size) * (2 * sign - 1)
            J = np.zeros((n, n))
            J[d.row, d.speaker] += t
            J[d.row, d.listener] -= t
            total += J + J.T
        yield total


def test_proofs_and_witnesses_hold_at_every_corner():
    decided = 0
    for seed in range(300):
        matrix = random_enclosed(seed)
        tops = [float(np.linalg.eigvalsh(each)[-1]) for each in corners(matrix)]
        if is_negative(matrix):
            assert max(tops) < 1e-9
            decided += 1
        vector = find_witness(matrix, [])
        if vector is not None:
            v = np.array(vector, dtype=float)
            assert all(v @ each @ v >= -1e-9 * (v @ v) for each in corners(matrix))
            assert -refuted_margin(matrix, vector) <= min(tops) + 1e-9
            decided += 1
        assert not (is_negative(matrix) and vector is not None)
    assert decided > 200


def test_the_radius_bounds_the_norm_of_all_deviations_together():
    for seed in range(200):
        matrix = random_enclosed(seed)
        base = np.array(matrix.middle.to_dense(), dtype=float)
        assert all(np.linalg.norm(each - base, 2) <= float(matrix.radius) + 1e-9 for each in corners(matrix))


def test_values_enclose_every_corner_tightly():
    """v'Mv is affine in each t, so that its range is spanned by the corners."""
    for seed in range(200):
        matrix, r = random_enclosed(seed), Random(-seed)
        vector = [Fraction(r.randint(-3, 3)) for _ in range(matrix.middle.size)]
        v = np.array(vector, dtype=float)
        values = [v @ each @ v for each in corners(matrix)]
        found = matrix.value(vector)
        assert np.isclose(min(values), float(found.lo))
        assert np.isclose(max(values), float(found.hi))


def test_without_deviations_there_is_always_an_answer():
    for seed in range(100):
        matrix = Enclosed(middle=random_enclosed(seed).middle)
        assert is_negative(matrix) is (find_witness(matrix, []) is None)


def test_zero_short_and_long_vectors_refute_nothing():
    matrix = Enclosed(middle=SparseSymmetric(2, {(0, 0): Fraction(1)}))
    one, zero = Fraction(1), Fraction(0)
    assert refutes(matrix, (one, zero))
    assert refutes(matrix, (zero, one))  # v'Mv = 0 is not < 0
    assert not refutes(matrix, (zero, zero))
    assert not refutes(matrix, (one,))
    assert not refutes(matrix, (one, zero, zero))


def test_a_refuted_margin_never_says_more_than_the_vector_shows():
    """-margin <= v'Mv / v'v, read as the decimal text that is written; 3/10 - 10^-40 rounds down, not to 0.3."""
    for value in (
        Fraction(3, 10),
        Fraction(3, 10) - Fraction(1, 10**40),
        Fraction(1, 3),
        Fraction(10) ** 320,
        Fraction(1, 10**330),
        Fraction(0),
    ):
        matrix = Enclosed(middle=SparseSymmetric(1, {(0, 0): value}))
        margin = refuted_margin(matrix, (Fraction(7),))
        assert margin <= 0
        assert -claimed(margin) <= lowest_quotient(matrix, (Fraction(7),)) == value


def test_candidates_are_preferred_when_they_refute_and_ignored_when_not():
    matrix = Enclosed(middle=SparseSymmetric(2, {(0, 1): Fraction(1), (1, 1): Fraction(-1)}))
    assert find_witness(matrix, [[1.0, 1.0]]) == (1, 1)
    assert refutes(matrix, find_witness(matrix, [[1.0, -1.0], [float("nan"), 1.0], [float("inf"), 1.0], [0.0, 0.0]]))
