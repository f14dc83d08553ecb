"""Definiteness: decided without a mistake where floating point makes them, at the edge too."""

from fractions import Fraction
from functools import cache
from random import Random

import flint
import numpy as np
import pytest
from definiteness import (
    EXACT,
    PATHS,
    POWERS,
    by_choice,
    by_integers,
    by_quick,
    by_vector,
    edge_matrices,
    edge_matrix,
    z_edge_matrix,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design import exact
from dobc_design.errors import CertificateError, ShapeError, SpecError
from dobc_design.exact.cholesky import (
    Scaled,
    bad_direction,
    proves_by_integers,
    scaled,
)
from dobc_design.exact.definite import decide_quickly, first_refuting, refuted, roundings
from dobc_design.exact.zmatrix import proves, search
from dobc_design.verdict import Verdict

IDENTITY = exact.SparseSymmetric(2, {(0, 0): 1, (1, 1): 1})
SINGULAR = exact.SparseSymmetric(2, {(0, 0): 1, (0, 1): -1, (1, 1): 1})


def test_a_witness_refutes_is_primitive_and_begins_with_a_positive_entry():
    with pytest.raises(CertificateError, match="nothing is claimed"):
        refuted(IDENTITY, {0: 1}, strict=True, method="")
    direction = {0: 1, 1: 1}
    with pytest.raises(CertificateError, match="nothing is claimed"):
        refuted(SINGULAR, direction, strict=False, method="")
    directions = ([0, 0], [1, 2])
    answer = first_refuting(IDENTITY, directions, strict=True, method="")
    assert answer is None
    # (-1/3, -1/3) is told as (1, 1).
    first = Fraction(-1, 3)
    direction = {0: first, 1: first}
    decision = refuted(SINGULAR, direction, strict=True, method="m")
    assert decision.verdict is Verdict.REFUTED
    assert decision.witness == (1, 1)
    assert decision.value == 0
    assert decision.method == "m"

    candidates = ([0, 0], [1, 0], [5, 5], [1, 1])
    found = first_refuting(SINGULAR, candidates, strict=True, method="")
    assert found.witness == (1, 1)


def test_roundings_grow_finer_and_drop_small_entries():
    """1000 : 999 : 1 to 1, 2, 4, 8 bits."""
    found = roundings([1000, -999, 1])
    expected = [[2, -2, 0], [4, -4, 0], [16, -16, 0], [256, -256, 0]]
    assert list(found) == expected
    assert list(roundings([1, 0])) == []


PROVED, REFUTED = Verdict.PROVED, Verdict.REFUTED


def gram(n, columns, *, seed=0):
    """G G' with small integers in G (n, columns)."""
    rng = np.random.default_rng(seed)
    G = rng.integers(-3, 4, (n, columns))
    return exact.from_float((G @ G.T).astype(float), None)


def band(n, diagonal, beside):
    entries = {(i, i): Fraction(diagonal) for i in range(n)}
    for i in range(n - 1):
        entries[i, i + 1] = Fraction(beside)
    return exact.SparseSymmetric(n, entries)


def value_of(M, v):
    column = exact.transpose((v,))
    image = exact.multiply(M, column)
    product = exact.multiply((v,), image)
    return product[0][0]


def test_the_directed_ten_cycle_without_pins_is_refuted_by_all_ones():
    """Theory, section 9: none pinned, lambda_max = 0, witness v = 1."""
    entries = {(0, 9): -2}
    cycle = band(10, 4, -2) + exact.SparseSymmetric(10, entries)
    decision = exact.decide_positive_definite(cycle)
    assert decision.witness == (1,) * 10
    assert decision.value == 0
    entries = {(0, 0): Fraction(1, 10**9)}
    pinned = cycle + exact.SparseSymmetric(10, entries)
    assert exact.decide_positive_definite(pinned).verdict is PROVED


def test_a_readable_witness_is_preferred():
    """Strictly negative forms leave room for rounding: no entry beyond 4 bits is needed here."""
    decision = exact.decide_positive_definite(band(40, "19/10", -1))
    assert decision.value < 0
    assert max(abs(x) for x in decision.witness) <= 16


@pytest.mark.parametrize(
    "given_matrix",
    [
        [[2, 1], [1, 2]],
        ((Fraction(2), Fraction(1)), (Fraction(1), Fraction(2))),
        [["2", "1/2"], ["0.5", 2.0]],
        np.array([[2, 1], [1, 2]]),
        np.array([[2.0, 0.1], [0.1, 2.0]], dtype=np.float32),
        np.array([["2", Fraction(1)], [1, 2]], dtype=object),
        list(np.array([[2.0, 0.1], [0.1, 2.0]])),
        exact.SparseSymmetric(2, {(0, 0): 2, (0, 1): 1, (1, 1): 2}),
        [],
        (),
        np.zeros((0, 0)),
        exact.SparseSymmetric(0, {}),
        exact.IntegerSymmetric(
            size=2, rows=np.array([0, 1]), columns=np.array([0, 1]), values=np.array([1, 2])
        ),
        np.eye(20),
        np.eye(20, dtype=np.float32) * 1e-40,
        np.diag([5e-324] * 10 + [1.7e308] * 10),
        [[5e-324]],
    ],
)
def test_definiteness_takes_every_kind_of_matrix(given_matrix):
    """Contract: dd.exact.definiteness(matrix); the empty matrix is positive definite."""
    assert exact.definiteness(given_matrix) is PROVED


def test_a_numpy_float_is_its_binary_value_and_a_listed_one_its_decimal_text():
    """0.1 + 0.2 > 0.3 in binary: [[0.1 + 0.2, ...]] tells the two readings apart."""
    entries = [[0.1, 0.3], [0.3, 0.9]]
    assert exact.definiteness(entries) is REFUTED  # 1/10 * 9/10 = (3/10)^2: singular
    assert exact.definiteness(np.array(entries)) is PROVED  # binary 0.1 * 0.9 > 0.3^2
    assert Fraction(0.1) * Fraction(0.9) > Fraction(0.3) ** 2


NOT_SYMMETRIC = [[[1, 2]], [[]], [[1], [2]], [[1, 2], [2]], [[1, 2], [3, 1]]]
NOT_SYMMETRIC += [5, None, "12", ["12", "21"], {(0, 0): 1}, [1, 2], np.array(1.0)]
NOT_SYMMETRIC += [np.zeros(shape) for shape in ((2, 3), (0, 3), 4, (2, 2, 2), (20, 21))]
NOT_SYMMETRIC += [np.array([[1.0, 1.0], [1.0 + 2**-52, 2.0]]), np.triu(np.ones((20, 20)))]


@pytest.mark.parametrize("bad", NOT_SYMMETRIC)
def test_what_is_not_square_and_symmetric_is_refused(bad):
    """np.linalg.cholesky accepts non-symmetric input; this must not."""
    with pytest.raises(ShapeError, match="must"):
        exact.definiteness(bad)


NO_NUMBERS = [[[x]] for x in (float("nan"), float("inf"), True, "x", None)]
NO_NUMBERS += [np.array([[x]]) for x in (np.nan, 1j, True)]
NO_NUMBERS += [np.array([[1.0, np.inf], [np.inf, 1.0]])]
NO_NUMBERS += [np.full((20, 20), np.nan), np.diag([np.inf] * 20)]


@pytest.mark.parametrize("bad", NO_NUMBERS)
def test_what_is_no_number_is_refused(bad):
    """np.linalg.cholesky accepts inf and nan; this must not."""
    with pytest.raises(SpecError, match="must"):
        exact.definiteness(bad)


@pytest.mark.parametrize(
    ("M", "named"),
    [
        (band(12, 3, -1), "LDL' over the rationals; 12 rows, 23 entries"),
        (band(60, 3, -1), "Z-matrix: integers v > 0 with M v > 0; 60 rows, 119 entries"),
        (band(60, 3, 1), "beside the diagonal: integers v > 0"),
        (
            gram(60, 70),
            "Cholesky factor in integers, its exact rest dominated by the diagonal; 60 rows",
        ),
        (gram(120, 119), "multiplied out|characteristic polynomial"),
        (band(60, 0, -1), "entry of the diagonal"),
        (band(60, 2, -1).shifted(Fraction(-1)), "a group of rows"),
        (band(60, 2, -1).shifted(Fraction(-1, 10)), "search direction"),
        (band(20, 1, 9), "entry too large|search direction"),
    ],
)
def test_the_answer_says_which_path_gave_it_and_for_what_size(M, named):
    """The table in the module docstring, row by row."""
    method = exact.decide_positive_definite(M).method
    assert any(part in method for part in named.split("|"))


def signed_ring(size: int) -> exact.SparseSymmetric:
    """2 on the diagonal and a ring of ones, one of them -1: eigenvalues 2 + 2 cos((2 k + 1) pi /
    size).

    For even sizes the least one is positive, but without the signs it would be 0: no v > 0 shows
    it.
    """
    entries = {(0, size - 1): -1}
    return band(size, 2, 1) + exact.SparseSymmetric(size, entries)


@pytest.mark.parametrize(
    ("size", "work", "verdict"),
    [
        (2002, 100, Verdict.UNDECIDED),
        (2002, 10**7, PROVED),
        (2002, None, PROVED),
        (2001, 10**7, REFUTED),
    ],
)
def test_a_large_sparse_matrix_is_left_undecided_only_by_a_bound_of_its_work(size, work, verdict):
    found = exact.decide_positive_definite(signed_ring(size), most_work=work)
    assert found.verdict is verdict
    assert ("stopped at pivot" in found.method) is (verdict is Verdict.UNDECIDED)


def test_up_to_2000_rows_no_bound_leaves_anything_undecided():
    found = exact.decide_positive_definite(signed_ring(100), most_work=1)
    assert found.verdict is Verdict.PROVED


# All paths on the same random rational matrices; the oracle is flint's characteristic polynomial:
# real roots only, so det(sI - M) = sum c_k s^k has only positive roots iff the signs of the c_k
# alternate strictly.


def oracle(M: exact.SparseSymmetric) -> tuple[bool, bool]:
    """Whether M > 0 and whether M >= 0."""
    whole = [flint.fmpq(x.numerator, x.denominator) for row in M.to_dense() for x in row]
    polynomial = flint.fmpq_mat(M.size, M.size, whole).charpoly()
    signed = []
    for k, coefficient in enumerate(polynomial.coeffs()):
        signed.append(coefficient * (-1) ** (M.size - k))
    definite = all(c > 0 for c in signed)
    semidefinite = all(c >= 0 for c in signed)
    return definite, semidefinite


@st.composite
def matrices(draw: st.DrawFn) -> exact.SparseSymmetric:
    """Gram matrices of any rank, shifted by little or nothing, some scaled badly, some Z-matrices;
    2 to 24 rows."""
    n = draw(st.integers(2, 24))
    r = np.random.default_rng(draw(st.integers(0, 2**32)))
    kind = draw(st.sampled_from(["gram", "laplacian", "sparse"]))
    if kind == "gram":
        fewest = max(1, n - 3)
        columns = draw(st.integers(fewest, n + 2))
        G = r.integers(-4, 5, (n, columns))
        whole = (G @ G.T).tolist()
    else:
        weights = r.integers(0, 4, (n, n))
        present = r.random((n, n)) < 0.4
        A = np.triu(weights * present, 1)
        signs = -1 if kind == "laplacian" else r.choice([-1, 1], (n, n))
        upper = np.triu(signs * A)
        degrees = np.diag((A + A.T).sum(axis=1))
        whole = (upper + upper.T + degrees).tolist()
    small = Fraction(1, 10**9)
    shifts = [0, 1, -1, small, Fraction(-1, 10**20)]
    shift = draw(st.sampled_from(shifts))
    denominator = draw(st.sampled_from([1, 7, 2**40]))
    D = [Fraction(1)] * n
    if draw(st.booleans()):
        powers = r.integers(-20, 20, n)
        D = [Fraction(2) ** int(k) for k in powers]
    entries = {}
    for i in range(n):
        for j in range(i, n):
            entry = Fraction(whole[i][j], denominator)
            if i == j:
                entry += shift
            entries[i, j] = D[i] * D[j] * entry
    return exact.SparseSymmetric(n, entries)


@settings(max_examples=25, deadline=None)
@given(matrices())
def test_no_path_contradicts_the_characteristic_polynomial(M: exact.SparseSymmetric):
    """Paths that decide agree with the oracle; those that may pass on do not contradict it."""
    definite, semidefinite = oracle(M)
    for form in (M, exact.IntegerSymmetric.from_sparse(M)):
        strict = exact.decide_positive_definite(form)
        weak = exact.decide_positive_semidefinite(form)
        assert strict.verdict is (PROVED if definite else REFUTED)
        assert weak.verdict is (PROVED if semidefinite else REFUTED)
        assert decide_quickly(form).verdict is not (REFUTED if definite else PROVED)
        for decision, most in ((strict, 0), (weak, -1)):
            if decision.verdict is REFUTED:
                value = value_of(M.to_dense(), decision.witness)
                assert decision.value == value <= 0
                assert value < 0 or most == 0
                assert any(decision.witness)
            elif decision.vector is not None:
                assert proves(M, decision.vector, strict=most == 0)
    for flint_numbers in (True, False):
        assert (bad_direction(M, strict=True, flint=flint_numbers) is None) == definite
        assert (bad_direction(M, strict=False, flint=flint_numbers) is None) == semidefinite
    assert_cautious_paths(M, definite=definite, semidefinite=semidefinite)


def assert_cautious_paths(M: exact.SparseSymmetric, *, definite: bool, semidefinite: bool) -> None:
    S = scaled(M)
    if isinstance(S, Scaled):
        assert definite or not proves_by_integers(S)
    elif S is not None:
        assert not semidefinite
    for strict, truth in ((True, definite), (False, semidefinite)):
        assert truth or search(M, strict=strict).vector is None


UNDECIDED = Verdict.UNDECIDED


@cache
def edges() -> list[tuple[Fraction, np.ndarray]]:
    """Smallest eigenvalue and matrix; not made where the tests are only collected."""
    small = edge_matrices((4, 16), seed=7, repeats=1)
    large = edge_matrices((64,), seed=8, repeats=1, powers=(28, 46))
    return [*small, *large]


def truth(small: Fraction) -> Verdict:
    return PROVED if small > 0 else REFUTED


SLOW = ("LDL' in flint",)  # what the choice rests on as well


PATH_NAMES = []
for path in PATHS:
    marks = pytest.mark.slow if path in SLOW else ()
    PATH_NAMES.append(pytest.param(path, marks=marks))


@pytest.mark.parametrize("name", PATH_NAMES)
def test_no_path_is_wrong_at_the_edge(name: str):
    """H diag(lambda) H / n has the eigenvalues lambda: the truth is known in closed form."""
    verdicts = []
    for small, matrix in edges():
        verdicts.append((truth(small), PATHS[name](matrix)))
    asked = [(known, found) for known, found in verdicts if found is not None]
    assert asked
    for known, found in asked:
        assert found in (known, UNDECIDED)
    if name in EXACT:
        assert all(found is known for known, found in asked)
    elif name != "vector":
        # Passing on always would be no mistake either, but useless: 2^-28 is far above what doubles
        # resolve.
        assert sum(found is known for known, found in asked) > len(asked) // 4


def test_the_semidefinite_twin_is_right_at_the_edge_and_witnesses_refute():
    """A zero eigenvalue is allowed there and only there; witnesses are multiplied out in Python
    integers."""
    small_ones = edges()[3:120:4]
    large_ones = edges()[120::2]
    some_of_each_sign_and_size = small_ones + large_ones
    for small, table in some_of_each_sign_and_size:
        M = exact.IntegerSymmetric.from_floats(table)
        strict = exact.decide_positive_definite(M)
        weak = exact.decide_positive_semidefinite(M)
        assert (weak.verdict is PROVED) == (small >= 0)
        whole = []
        for row in table.tolist():
            whole.append([Fraction(x) for x in row])
        for decision, bound in ((strict, 0), (weak, -1)):
            if decision.witness is None:
                continue
            v = decision.witness
            image = []
            for row in whole:
                entry = sum(x * y for x, y in zip(row, v, strict=True))
                image.append(entry)
            terms = zip(image, v, strict=True)
            value = sum(x * y for x, y in terms)
            assert any(v)
            assert decision.value == value <= 0
            assert value < 0 or bound == 0


@pytest.mark.parametrize("size", [4, 16, pytest.param(64, marks=pytest.mark.slow)])
def test_z_matrices_at_the_edge(size: int):
    """The small eigenvalue belongs to v = 1: M v = small v decides by its sign, both ways."""
    for power in POWERS[3::4]:
        for sign in (-1, 0, 1):
            small = sign * Fraction(1, 2**power)
            matrix = z_edge_matrix(size, small)
            assert matrix is not None
            assert by_vector(matrix) is truth(small)
            weak = exact.decide_positive_semidefinite(exact.IntegerSymmetric.from_floats(matrix))
            assert (weak.verdict is PROVED) == (small >= 0)


@pytest.mark.slow
@pytest.mark.parametrize("power", [28, 46])
def test_no_path_is_wrong_at_the_edge_with_256_rows(power: int):
    """The same for a size where an elimination over the rationals is out of reach."""
    for sign in (-1, 0, 1):
        small = sign * Fraction(1, 2**power)
        matrix = edge_matrix(256, small, Random(power))
        if matrix is None:
            continue
        assert by_choice(matrix) is truth(small)
        for path in (by_quick, by_integers, by_vector):
            assert path(matrix) in (truth(small), UNDECIDED)


@pytest.mark.parametrize("rows", [[[0, 1], [1, 5]], [[1, 1, 0], [1, 1, 1], [0, 1, 9]]])
def test_a_zero_pivot_with_a_full_row_has_a_strictly_negative_witness(rows):
    """Semidefinite: a zero on the diagonal asks for a zero row."""
    M = exact.from_float(np.array(rows, dtype=float), None)
    decision = exact.decide_positive_semidefinite(M)
    assert decision.verdict is REFUTED
    assert decision.value == value_of(M, decision.witness) < 0
    diagonal = np.diag([0.0, 5.0])
    found = exact.decide_positive_semidefinite(exact.from_float(diagonal, None))
    assert found.verdict is PROVED
