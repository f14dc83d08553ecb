"""Z-matrices: a positive vector with a positive image proves positive definiteness."""

import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design.exact import zmatrix as module
from dobc_design.exact.definite import (
    decide_positive_definite,
    decide_positive_semidefinite,
    first_refuting,
    roundings,
)
from dobc_design.exact.symmetric import IntegerSymmetric, SparseSymmetric
from dobc_design.exact.zmatrix import is_z_matrix, proves, row_bound, search
from dobc_design.verdict import Verdict


def grounded_ring(size: int, ground: Fraction) -> SparseSymmetric:
    """The Laplacian of a ring with ``ground`` added at the first node: positive definite iff ground
    > 0."""
    entries = {(i, i): Fraction(2) for i in range(size)}
    entries[0, 0] += ground
    chain = {(i, i + 1): Fraction(-1) for i in range(size - 1)}
    closing = {(0, size - 1): -1}
    entries |= chain | closing
    return SparseSymmetric(size, entries)


@pytest.mark.parametrize("size", [3, 60, 500])
def test_a_ring_held_at_one_node_has_a_positive_vector(size: int):
    """Theory, section 3: exists iff M > 0."""
    M = grounded_ring(size, Fraction(1))
    vector = search(M, strict=True).vector
    assert vector is not None
    rows = [[float(x) for x in row] for row in M.to_dense()]
    dense = np.array(rows)
    floats = np.array([float(x) for x in vector])
    assert np.all(dense @ floats > 0)
    decision = decide_positive_definite(M)
    assert decision.verdict is Verdict.PROVED
    assert decision.vector == (vector if size >= 13 else None)


def test_a_positive_entry_beside_the_diagonal_counts_against_the_vector():
    """v = (1, 1) has M v > 0 for [[1, 2], [2, 1]], which is indefinite: |m_ij| is what has to be
    dominated."""
    entries = {(0, 0): 1, (0, 1): 2, (1, 1): 1}
    M = SparseSymmetric(2, entries)
    assert not proves(M, (1, 1))
    assert search(M, strict=True).vector is None
    entries = {(0, 0): 3, (0, 1): 2, (1, 1): 3}
    inside = SparseSymmetric(2, entries)
    assert proves(inside, (1, 1))
    assert not is_z_matrix(inside)
    assert search(inside, strict=True).vector == (1, 1)


def test_a_vector_that_is_not_positive_or_has_the_wrong_length_proves_nothing():
    M = grounded_ring(3, Fraction(1))
    assert not proves(M, (1, 1, 0))
    assert not proves(M, (0, 0, 0), strict=False)
    assert not proves(M, (1, 1))
    assert not proves(M, (1, 1, 1))
    assert proves(M, (1, 1, 1), strict=False)
    entries = {(0, 0): 1, (0, 1): -5, (1, 1): 1}
    indefinite = SparseSymmetric(2, entries)
    assert not proves(indefinite, (-1, -1))  # M v = (4, 4)
    assert not proves(SparseSymmetric(1, {}), (1,))
    assert proves(SparseSymmetric(0, {}), ())


def arrays(M: SparseSymmetric) -> IntegerSymmetric:
    return IntegerSymmetric.from_sparse(M)


def refuting(M: SparseSymmetric | IntegerSymmetric, *, strict: bool) -> bool:
    """Whether what the search returns refutes, once it is multiplied out."""
    found = search(M, strict=strict)
    tried = []
    for d in found.directions:
        for each in (*roundings(d), d):
            tried.append(each)
    return found.vector is None and first_refuting(M, tried, strict=strict, method="") is not None


def test_the_group_that_nobody_holds_is_the_witness():
    """Two rings, the second one free: the witness is its indicator and nothing else."""
    first = grounded_ring(30, Fraction(1))
    second = grounded_ring(20, Fraction(0))
    shifted_entries = second.entries.items()
    entries = dict(first.entries) | {(i + 30, j + 30): x for (i, j), x in shifted_entries}
    decision = decide_positive_definite(SparseSymmetric(50, entries))
    assert decision.verdict is Verdict.REFUTED
    assert decision.witness == (0,) * 30 + (1,) * 20
    assert decision.value == 0
    assert "group of rows" in decision.method
    slightly_more = Fraction(2) + Fraction(1, 50)
    corner = {(40, 40): slightly_more}
    held = SparseSymmetric(50, entries | corner)
    assert decide_positive_definite(held).verdict is Verdict.PROVED


def test_a_group_that_only_fails_to_be_definite_is_no_witness_against_semidefinite():
    """A free ring of 20 (sum 0) beside one of 30 with a negative sum: the larger one is the
    witness."""
    first = grounded_ring(30, Fraction(-1))
    second = grounded_ring(20, Fraction(0))
    shifted_entries = second.entries.items()
    entries = dict(first.entries) | {(i + 30, j + 30): x for (i, j), x in shifted_entries}
    decision = decide_positive_semidefinite(SparseSymmetric(50, entries))
    assert decision.witness == (1,) * 30 + (0,) * 20
    assert decision.value == -1
    assert "group of rows" in decision.method


def test_a_vector_that_rounds_to_zero_somewhere_proves_nothing(monkeypatch: pytest.MonkeyPatch):
    """The search is made to return 10^-40 on an indefinite part: M v >= 0 would hold with v = 0
    there."""
    beside = {(0, 1): -2, (2, 3): -5}
    diagonal = {(0, 0): 1, (1, 1): 6, (2, 2): 1, (3, 3): 1}
    entries = beside | diagonal | {(3, 3): 9}
    M = SparseSymmetric(4, entries)
    monkeypatch.setattr(
        module, "_conjugate_gradients", lambda rows: (np.array([5.0, 2.0, 1e-40, 1e-40]), None)
    )
    assert search(M, strict=False).vector is None


def test_a_witness_for_a_local_cause_is_sparse():
    """300 rows held well, but one row's diagonal is halved twice: the rounded direction is 0 far
    from there."""
    n = 300
    diagonal = {(i, i): Fraction(5) for i in range(n)}
    beside = {(i, i + 1): Fraction(-1) for i in range(n - 1)}
    entries = diagonal | beside
    entries[150, 150] = Fraction(1, 5)
    M = SparseSymmetric(n, entries)
    decision = decide_positive_definite(M)
    assert decision.verdict is Verdict.REFUTED
    assert M.quadratic_form(decision.witness) == decision.value <= 0
    assert sum(x != 0 for x in decision.witness) <= 9


def test_long_denominators_everywhere_are_rounded_to_the_safe_side():
    """Every entry has its own prime: the common denominator would have 10 000 bits."""
    primes = []
    for p in range(2, 9000):
        if all(p % q for q in range(2, int(p**0.5) + 1)):
            primes.append(p)
    n = 500
    entries = {}
    for i in range(n - 1):
        entries[i, i + 1] = Fraction(-primes[i], primes[i + 500])
    positive = (Fraction(1, 10**6), True)
    negative = (Fraction(-1, 10**6), False)
    cases = (positive, negative)
    for excess, truth in cases:
        diagonal = {}
        for i in range(n):
            before = entries.get((i - 1, i), 0)
            after = entries.get((i, i + 1), 0)
            beside = before + after
            diagonal[i, i] = excess - beside
        M = SparseSymmetric(n, entries | diagonal)
        found = search(M, strict=True)
        assert (found.vector is not None) == truth
        assert found.vector is None or proves(M, found.vector)
        assert truth or refuting(M, strict=True)


@pytest.mark.parametrize("lift", [1, 2**70, 2**1100])
def test_integers_of_any_length_are_taken(lift: int):
    """Beyond 64 bits and beyond what a double holds."""
    M = arrays(grounded_ring(40, Fraction(1)))
    values = M.values.astype(object) * lift
    lifted = IntegerSymmetric(size=40, rows=M.rows, columns=M.columns, values=values)
    found = search(lifted, strict=True)
    assert found.vector is not None
    assert proves(lifted, found.vector)
    assert not proves(lifted, (1,) * 40)


def test_the_search_leaves_bad_diagonals_and_zero_rows_to_others():
    entries = {(0, 0): 1}
    found = search(SparseSymmetric(3, entries), strict=True)
    assert found.vector is None
    entries = {(0, 0): 1, (0, 1): -1}
    M = SparseSymmetric(2, entries)
    assert search(M, strict=True).vector is None


def test_other_signs_are_refuted_by_their_own_direction():
    """A ring with +1 beside the diagonal: the direction alternates, and |p| would not refute."""
    n = 60
    diagonal = {(i, i): Fraction(19, 10) for i in range(n)}
    beside = {(i, i + 1): Fraction(1) for i in range(n - 1)}
    entries = diagonal | beside
    M = SparseSymmetric(n, entries | {(0, n - 1): 1})
    assert not is_z_matrix(M)
    assert not is_z_matrix(arrays(M))
    assert is_z_matrix(arrays(grounded_ring(9, Fraction(1))))
    assert decide_positive_definite(M).verdict is Verdict.REFUTED
    found = decide_positive_definite(M.shifted(Fraction(2, 10)))
    assert found.verdict is Verdict.PROVED


def peak_of(size: int, ground: Fraction, *, strict: bool) -> int:
    """Peak of what one decision allocates, NumPy's arrays included, in bytes."""
    M = grounded_ring(size, ground)
    extra = {(i, i): Fraction(1, 2) for i in range(0, size, 10)} if ground > 0 else {}
    M = M + SparseSymmetric(size, extra)
    decide = decide_positive_definite if strict else decide_positive_semidefinite
    tracemalloc.start()
    try:
        expected = ground > 0 or not strict
        assert (decide(M).verdict is Verdict.PROVED) == expected
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("ground", "strict"), [(1, True), (0, True), (0, False)])
def test_memory_is_linear_in_the_arcs(ground: Fraction, strict: bool):
    """A ring of 4000 rows, proved, refuted, and semidefinite: four times the rows, four times the
    memory."""
    small, large = (peak_of(size, ground, strict=strict) for size in (1000, 4000))
    assert large < 4.6 * small
    assert large < 1500 * 4000  # bytes per arc; a dense matrix of doubles would take 128 MB


FRACTIONS = st.builds(Fraction, st.integers(-(2**70), 2**70), st.sampled_from([1, 3, 10**9, 2**40]))
POSITIVE = st.floats(2.0**-200, 2.0**200)


@settings(max_examples=25)
@given(st.integers(1, 6), st.data())
def test_the_bound_of_a_vector_is_never_below_the_exact_one_and_close_to_it(
    n: int, data: st.DataObject
):
    """Rows without entries, signs of both kinds, numbers that floats do not hold."""
    places = []
    for i in range(n):
        for j in range(i, n):
            if data.draw(st.booleans()):
                places.append((i, j))
    entries = {place: data.draw(FRACTIONS) for place in places}
    M = SparseSymmetric(n, entries)
    floats = [data.draw(POSITIVE) for _ in range(n)]
    v = list(map(Fraction, floats))
    sums = []
    sizes = []
    for i, row in enumerate(M.to_dense()):
        terms = zip(row, v, strict=True)
        total = sum(abs(x) * y for x, y in terms)
        around = total / v[i]
        sizes.append(around)
        # the entry on the diagonal counts with its sign
        sums.append(around - abs(row[i]) + row[i])
    bound = Fraction(row_bound(IntegerSymmetric.from_sparse(M), np.array(floats)))
    assert bound >= max(sums)
    assert bound - max(sums) <= max(sizes) * Fraction(1, 2**45)


@pytest.mark.parametrize(
    "vector", [[1.0, 0.0], [1.0, -1.0], [1.0, np.nan], [1.0], [], [1.0, 1e-300], [1.0, np.inf]]
)
def test_a_vector_that_is_not_positive_bounds_nothing(vector: list[float]):
    entries = {(0, 0): -1, (0, 1): Fraction(1, 2)}
    M = IntegerSymmetric.from_sparse(SparseSymmetric(2, entries))
    assert row_bound(M, np.array(vector)) == np.inf


@pytest.mark.parametrize("entry", [Fraction(10) ** 400, Fraction(1, 10**400)])
def test_entries_that_floats_do_not_hold_bound_nothing(entry: Fraction):
    entries = {(0, 0): entry}
    one_entry = IntegerSymmetric.from_sparse(SparseSymmetric(1, entries))
    found = row_bound(one_entry, np.ones(1))
    assert found == np.inf
