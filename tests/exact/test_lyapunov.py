"""Lyapunov equations over the rationals, against SciPy and against the equation itself."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest
from scipy import linalg

from dobc_design.errors import ShapeError
from dobc_design.exact.matrix import add, matrix, multiply, solve_lyapunov, to_float, transpose, zeros


@pytest.mark.parametrize("seed", range(12))
def test_the_solution_satisfies_the_equation_exactly_and_is_that_of_scipy(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    F = matrix([[r.randint(-4, 4) - (9 if i == j else 0) for j in range(q)] for i in range(q)])
    root = matrix([[r.randint(-3, 3) for _ in range(q)] for _ in range(q)])
    N = multiply(root, transpose(root))
    X = solve_lyapunov(F, N)
    assert add(add(multiply(transpose(F), X), multiply(X, F)), N) == zeros(q, q)
    assert to_float(X) == pytest.approx(
        linalg.solve_continuous_lyapunov(to_float(F).T, -to_float(N)), rel=1e-9, abs=1e-12
    )


def test_two_eigenvalues_that_add_up_to_zero_have_no_unique_solution():
    identity = matrix([[1, 0], [0, 1]])
    assert solve_lyapunov(matrix([[0, 1], [-1, 0]]), identity) is None
    assert solve_lyapunov(matrix([[1, 0], [0, -1]]), identity) is None
    assert solve_lyapunov(matrix([[Fraction(1, 10**9), 0], [0, -1]]), identity) is not None


def test_shapes_have_to_fit():
    with pytest.raises(ShapeError, match="N must have shape"):
        solve_lyapunov(matrix([[1]]), matrix([[1, 0], [0, 1]]))
