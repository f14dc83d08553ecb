"""Factors of sparse matrices: singular ones end in an error, never in SuperLU's crash."""

import re
from pathlib import Path
from random import Random

import numpy as np
import pytest
from scipy import sparse

import dobc_design
from dobc_design.solvers.program import factored


def test_matrices_whose_places_make_them_singular_are_refused():
    for seed in range(200):
        r = Random(seed)
        n = r.randint(2, 25)
        M = sparse.lil_array((n, n))
        for i in range(1, n):  # row 0 is empty
            for j in r.sample(range(n), r.randint(1, min(n, 4))):
                M[i, j] = r.uniform(-1, 3)
        for matrix in (M, M.T):
            with pytest.raises(RuntimeError, match="singular by its places"):
                factored(matrix)


def test_numbers_that_are_not_finite_are_refused():
    first = [1.0, np.nan]
    rows = [first, [0.0, 1.0]]
    with pytest.raises(RuntimeError, match="not finite"):
        factored(sparse.csr_array(np.array(rows)))


def test_solutions_are_those_of_a_dense_solver_also_with_zeros_on_the_diagonal():
    r = np.random.default_rng(3)
    drawn = r.normal(size=(9, 9))
    shift = np.roll(4 * np.eye(9), 1, axis=0)
    M = drawn * (r.random((9, 9)) < 0.5) + shift
    np.fill_diagonal(M, 0.0)
    right = r.normal(size=9)
    found = factored(sparse.csr_array(M)).solve(right)
    expected = np.linalg.solve(M, right)
    assert found == pytest.approx(expected)


def test_nothing_else_calls_superlu():
    sources = Path(dobc_design.__file__).parent.rglob("*.py")
    found = [
        path.name
        for path in sources
        if re.search(r"\bsplu\(|\bspsolve\(", path.read_text(encoding="utf-8"))
    ]
    assert found == ["program.py"]
