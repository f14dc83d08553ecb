"""Matrices at the edge of definiteness: no path errs, the exact ones always answer, floating point errs."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from functools import cache
from random import Random

import numpy as np
import pytest
from definiteness_paths import EXACT, PATHS, by_choice, by_integers, by_lift, by_quick, by_vector, numpy_cholesky
from edge_matrices import POWERS, edge_matrices, edge_matrix, z_edge_matrix

from dobc_design.exact import IntegerSymmetric, decide_positive_definite, decide_positive_semidefinite
from dobc_design.verdict import Verdict

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


@cache
def edges() -> list[tuple[Fraction, np.ndarray]]:
    """Smallest eigenvalue and matrix; not made where the tests are only collected."""
    return [*edge_matrices((4, 16), seed=7, repeats=2), *edge_matrices((64,), seed=8, repeats=1)]


def truth(small: Fraction) -> Verdict:
    return PROVED if small > 0 else REFUTED


def test_there_are_enough_of_them():
    assert len(edges()) >= 240
    assert Counter(len(matrix) for _, matrix in edges()) == {4: 120, 16: 120, 64: 60}
    assert {small for small, _ in edges()} == {s * Fraction(1, 2**p) for p in POWERS for s in (-1, 0, 1)}


SLOW = ("LDL' in flint", "lift")  # what the choice rests on as well


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in PATHS])
def test_no_path_is_wrong_at_the_edge(name: str):
    """H diag(lambda) H / n has the eigenvalues lambda: the truth is known in closed form."""
    verdicts = [(truth(small), PATHS[name](matrix)) for small, matrix in edges()]
    asked = [(known, found) for known, found in verdicts if found is not None]
    assert asked
    assert all(found in (known, UNDECIDED) for known, found in asked)
    if name in EXACT:
        assert all(found is known for known, found in asked)
    elif name != "vector":
        # Passing on always would be no mistake either, but useless: 2^-28 is far above what doubles resolve.
        assert sum(found is known for known, found in asked) > len(asked) // 4


def test_the_semidefinite_twin_is_right_at_the_edge_and_witnesses_refute():
    """A zero eigenvalue is allowed there and only there; witnesses are multiplied out in Python integers."""
    for small, matrix in edges()[:240] + edges()[240::7]:  # of 64 rows, a few of each sign
        M = IntegerSymmetric.from_floats(matrix)
        strict, weak = decide_positive_definite(M), decide_positive_semidefinite(M)
        assert (weak.verdict is PROVED) == (small >= 0)
        whole = [[Fraction(x) for x in row] for row in matrix.tolist()]
        for decision, bound in ((strict, 0), (weak, -1)):
            if decision.witness is None:
                continue
            v = decision.witness
            image = [sum(x * y for x, y in zip(row, v, strict=True)) for row in whole]
            value = sum(x * y for x, y in zip(image, v, strict=True))
            assert any(v)
            assert decision.value == value <= 0
            assert value < 0 or bound == 0


def test_numpy_cholesky_is_wrong_on_some_of_them():
    """Without this the tests above would have no teeth."""
    wrong = Counter((small > 0) for small, matrix in edges() if numpy_cholesky(matrix) != (small > 0))
    assert wrong[False] > 0


@pytest.mark.parametrize("size", [4, 16, pytest.param(64, marks=pytest.mark.slow)])
def test_z_matrices_at_the_edge(size: int):
    """The small eigenvalue belongs to v = 1: M v = small v decides by its sign, both ways."""
    for power in POWERS:
        for sign in (-1, 0, 1):
            small = sign * Fraction(1, 2**power)
            matrix = z_edge_matrix(size, small)
            assert matrix is not None
            assert by_vector(matrix) is truth(small)
            weak = decide_positive_semidefinite(IntegerSymmetric.from_floats(matrix))
            assert (weak.verdict is PROVED) == (small >= 0)


def test_z_matrices_at_the_edge_scaled_away_from_ones():
    """D M D with D = diag(1, 2, 4, 1, ...): the vector that decides is D^-1 1, and has to be found."""
    for power in POWERS:
        for sign in (-1, 0, 1):
            small = sign * Fraction(1, 2**power)
            matrix = z_edge_matrix(16, small)
            assert matrix is not None
            D = 2.0 ** (np.arange(16) % 3)
            assert by_vector(matrix * np.outer(D, D)) in (truth(small), UNDECIDED)
            assert by_choice(matrix * np.outer(D, D)) is truth(small)


@pytest.mark.slow
@pytest.mark.parametrize("power", [28, 37, 46])
def test_no_path_is_wrong_at_the_edge_with_256_rows(power: int):
    """The same for a size where an elimination over the rationals is out of reach."""
    for sign in (-1, 0, 1):
        small = sign * Fraction(1, 2**power)
        matrix = edge_matrix(256, small, Random(power))
        if matrix is None:
            continue
        assert by_choice(matrix) is truth(small)
        for path in (by_quick, by_integers, by_lift, by_vector):
            assert path(matrix) in (truth(small), UNDECIDED)
