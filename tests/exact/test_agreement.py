"""All paths on the same random rational matrices; the oracle is flint's characteristic polynomial.

A symmetric matrix has real roots only, so det(sI - M) = sum c_k s^k has only positive roots iff the signs of
the c_k alternate strictly, and none that is negative iff they alternate with zeros allowed.
"""

from __future__ import annotations

from fractions import Fraction

import flint
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design.exact import (
    IntegerSymmetric,
    SparseSymmetric,
    decide_positive_definite,
    decide_positive_semidefinite,
    decide_quickly,
)
from dobc_design.exact.cholesky import (
    Scaled,
    bad_direction,
    decide_lifted,
    proves_by_integers,
    scaled,
    shifted_cholesky,
)
from dobc_design.exact.zmatrix import proves, search
from dobc_design.verdict import Verdict

PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED


def oracle(M: SparseSymmetric) -> tuple[bool, bool]:
    """Whether M > 0 and whether M >= 0."""
    whole = [flint.fmpq(x.numerator, x.denominator) for row in M.to_dense() for x in row]
    coefficients = flint.fmpq_mat(M.size, M.size, whole).charpoly().coeffs()
    signed = [c * (-1) ** (M.size - k) for k, c in enumerate(coefficients)]
    return all(c > 0 for c in signed), all(c >= 0 for c in signed)


@st.composite
def matrices(draw: st.DrawFn) -> SparseSymmetric:
    """Gram matrices of any rank, shifted by little or nothing, some scaled badly, some Z-matrices; 2 to 24 rows."""
    n = draw(st.integers(2, 24))
    r = np.random.default_rng(draw(st.integers(0, 2**32)))
    kind = draw(st.sampled_from(["gram", "laplacian", "sparse"]))
    if kind == "gram":
        G = r.integers(-4, 5, (n, draw(st.integers(max(1, n - 3), n + 2))))
        whole = (G @ G.T).tolist()
    else:
        A = np.triu(r.integers(0, 4, (n, n)) * (r.random((n, n)) < 0.4), 1)
        signs = -1 if kind == "laplacian" else r.choice([-1, 1], (n, n))
        whole = (np.triu(signs * A) + np.triu(signs * A).T + np.diag((A + A.T).sum(axis=1))).tolist()
    shift = draw(st.sampled_from([Fraction(0), Fraction(1), Fraction(-1), Fraction(1, 10**9), Fraction(-1, 10**20)]))
    denominator = draw(st.sampled_from([1, 7, 2**40]))
    D = [Fraction(2) ** int(k) for k in r.integers(-20, 20, n)] if draw(st.booleans()) else [Fraction(1)] * n
    return SparseSymmetric(
        n,
        {
            (i, j): D[i] * D[j] * (Fraction(whole[i][j], denominator) + (i == j) * shift)
            for i in range(n)
            for j in range(i, n)
        },
    )


@settings(max_examples=80, deadline=None)
@given(matrices())
def test_no_path_contradicts_the_characteristic_polynomial(M: SparseSymmetric):
    """Paths that decide agree with the oracle; those that may pass on do not contradict it."""
    definite, semidefinite = oracle(M)
    for form in (M, IntegerSymmetric.from_sparse(M)):
        strict, weak = decide_positive_definite(form), decide_positive_semidefinite(form)
        assert strict.verdict is (PROVED if definite else REFUTED)
        assert weak.verdict is (PROVED if semidefinite else REFUTED)
        assert decide_quickly(form).verdict is not (REFUTED if definite else PROVED)
        for decision, most in ((strict, 0), (weak, -1)):
            if decision.verdict is REFUTED:
                value = dense_form(M, decision.witness)
                assert decision.value == value <= 0 and (value < 0 or most == 0)
                assert any(decision.witness)
            elif decision.vector is not None:
                assert proves(M, decision.vector, strict=most == 0)
    for flint_numbers in (True, False):
        assert (bad_direction(M, strict=True, flint=flint_numbers) is None) == definite
        assert (bad_direction(M, strict=False, flint=flint_numbers) is None) == semidefinite
    assert_cautious_paths(M, definite=definite, semidefinite=semidefinite)


def assert_cautious_paths(M: SparseSymmetric, *, definite: bool, semidefinite: bool) -> None:
    S = scaled(M)
    if isinstance(S, Scaled):
        assert definite or not (shifted_cholesky(S) or proves_by_integers(S))
        for strict, truth in ((True, definite), (False, semidefinite)):
            assert decide_lifted(M, S, *np.linalg.eigh(S.floats), strict=strict) is None or (
                (decide_lifted(M, S, *np.linalg.eigh(S.floats), strict=strict) == {}) == truth
            )
    elif S is not None:
        assert not semidefinite
    for strict, truth in ((True, definite), (False, semidefinite)):
        assert truth or search(M, strict=strict).vector is None


def dense_form(M: SparseSymmetric, v) -> Fraction:
    dense = M.to_dense()
    return sum((v[i] * dense[i][j] * v[j] for i in range(M.size) for j in range(M.size)), Fraction(0))
