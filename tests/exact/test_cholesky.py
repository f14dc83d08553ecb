"""Float factors: the shift and the integer rest prove only what is true."""

from fractions import Fraction

import numpy as np
import pytest

from dobc_design import exact
from dobc_design.exact import IntegerSymmetric, SparseSymmetric, decide_quickly, from_float
from dobc_design.exact.cholesky import (
    HIGH_BITS,
    Scaled,
    UnfinishedError,
    bad_direction,
    integer_factors,
    leaves_dominated_rest,
    proves_by_integers,
    scaled,
)
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.verdict import Verdict


def test_the_work_is_counted_and_not_timed():
    """A full matrix of three rows: three products at the first pivot, one at the second."""
    entries = {(i, j): Fraction(3 if i == j else 1) for i in range(3) for j in range(i, 3)}
    M = SparseSymmetric(3, entries)
    assert bad_direction(M, strict=True, most_work=3 + 1) is None
    with pytest.raises(UnfinishedError, match="stopped at pivot 2 of 3"):
        bad_direction(M, strict=True, most_work=3)


def spectral(eigenvalues: list[float], *, seed: int = 0) -> IntegerSymmetric:
    """Q diag(eigenvalues) Q', rounded: eigenvalues right to about 1e-15."""
    n = len(eigenvalues)
    random = np.random.default_rng(seed).standard_normal((n, n))
    Q, _ = np.linalg.qr(random)
    A = (Q * np.array(eigenvalues)) @ Q.T
    return IntegerSymmetric.from_floats((A + A.T) / 2)


def ladder(n: int, lowest: float) -> list[float]:
    return [lowest, *np.linspace(1, 2, n - 1)]


def form(M: IntegerSymmetric | SparseSymmetric) -> Scaled:
    S = scaled(M)
    assert isinstance(S, Scaled)
    return S


@pytest.mark.parametrize("n", [2, 14, 100, 300])
def test_a_matrix_well_inside_is_proved(n: int):
    """Smallest eigenvalue 1e-6; not the twin at -1e-6, nor what doubles do not resolve."""
    eigenvalues = [1e-6, -1e-6]
    if n < 300:
        eigenvalues += [1e-17, -1e-17, 0.0]
    for lowest in eigenvalues:
        S = form(spectral(ladder(n, lowest)))
        assert proves_by_integers(S) is (lowest == 1e-6)
    one = form(IntegerSymmetric.from_floats(np.array([[1e-6]])))
    assert proves_by_integers(one)


def test_the_scaled_form_holds_the_matrix_to_its_last_bit():
    """whole <= 2^bits D M D < whole + 1, entry by entry, for rationals of every size."""
    r = np.random.default_rng(5)
    n = 6
    size = [Fraction(10) ** int(k) for k in r.integers(-200, 200, n)]
    entries = {}
    for i in range(n):
        for j in range(i, n):
            number = r.integers(1, 99) if i == j else r.integers(-9, 9)
            scale = size[i] * size[j]
            part = Fraction(int(number), 101)
            entries[i, j] = scale * part
    M = SparseSymmetric(n, entries)
    S = form(M)
    bits = 2 * (HIGH_BITS + S.low_bits)
    for i in range(n):
        for j in range(n):
            high = int(S.high[i, j]) << 2 * S.low_bits
            middle = int(S.middle[i, j]) << S.low_bits
            whole = high + middle + int(S.low[i, j])
            value = M.to_dense()[i][j]
            power = int(S.exponents[i] + S.exponents[j])
            entry = value / Fraction(2) ** power
            assert 0 <= entry * 2**bits - whole < 1
            nearest = Fraction(S.floats[i, j])
            allowed = abs(nearest) / 2**53 + Fraction(1, 2**bits)
            assert abs(nearest - entry) <= allowed
        assert Fraction(1, 8) <= Fraction(S.floats[i, i]) < 1


def rest_is_dominated(R: list[list[Fraction]], low: int = 0) -> bool:
    """What the check says of M = L L' + R; L has one column of 3/4 and ``low`` on its diagonal, in
    its last bits."""
    n = len(R)
    low_bits = form(IntegerSymmetric.from_floats(np.eye(n))).low_bits
    high = np.zeros((n, n))
    high[:, 0] = 3 * 2.0 ** (HIGH_BITS - 2)
    unit = Fraction(1, 2 ** (HIGH_BITS + low_bits))
    L = []
    for i in range(n):
        lower_row = [Fraction(3, 4) * (j == 0) + low * unit * (i == j) for j in range(n)]
        L.append(lower_row)
    product = exact.multiply(L, exact.transpose(L))
    M = exact.add(product, R)
    S = form(SparseSymmetric.from_dense(M))
    assert not S.exponents.any()
    return leaves_dominated_rest(S, high, low * np.eye(n))


@pytest.mark.parametrize(
    ("diagonal", "beside", "dominated"),
    [
        (5, 2, True),
        (5, -2, True),
        (4, 2, False),
        (4, -2, False),
        (3, 2, False),
        (1, 2, False),
        (-5, 2, False),
    ],
)
@pytest.mark.parametrize("low", [0, 2**25, -(2**25)])
def test_the_rest_has_to_be_dominated_row_by_row(
    diagonal: int, beside: int, dominated: bool, low: int
):
    """M = L L' + R is built in fractions, L almost of rank one, so that R decides; 3 rows, R from
    2^-30 to 2^-60."""
    for unit in (Fraction(1, 2**power) for power in (30, 45, 60)):
        R = []
        for i in range(3):
            upper_row = [unit * (diagonal if i == j else beside) for j in range(3)]
            R.append(upper_row)
        assert rest_is_dominated(R, low) is dominated


def test_the_last_bits_of_the_factor_count():
    """L L' of the last bits alone is 2^-52 here; a rest of -2^-53 is negative all the same."""
    unit = Fraction(1, 2**53)
    positive = exact.scale(unit, exact.identity(3))
    negative = exact.scale(-unit, exact.identity(3))
    assert not rest_is_dominated(negative, 2**25)
    assert rest_is_dominated(positive, 2**25)


def test_a_factor_that_is_too_large_or_no_integers_is_not_believed():
    """Then products in doubles are not exact: 2^27 squared is beyond 2^53; halves are no
    integers."""
    S = form(spectral(ladder(4, 0.5)))
    high, low = next(iter(integer_factors(S)))
    assert leaves_dominated_rest(S, high, low)
    assert not leaves_dominated_rest(S, high * 8, low)
    assert not leaves_dominated_rest(S, high, low + 0.5)
    shift = np.diag([2.0**24] * 4)
    assert not leaves_dominated_rest(S, high - shift, low)
    # The same L, but with last parts so long that their products round.
    moved = np.tril(np.full((4, 4), 4.0))
    assert not leaves_dominated_rest(S, high - moved, low + moved * 2.0**S.low_bits)


def test_a_factorisation_that_breaks_down_proves_nothing_and_others_are_passed_on(monkeypatch):
    """LAPACK lets nan pass; LinAlgError is the ordinary way."""
    S = form(spectral(ladder(4, 0.5)))
    monkeypatch.setattr(np.linalg, "cholesky", lambda A: np.full_like(A, np.nan))
    assert not proves_by_integers(S)


def test_the_quick_answer_has_three_values():
    """Inside, outside, and next to the edge, with a witness for the second."""
    found = decide_quickly(spectral(ladder(40, 1e-6)))
    assert found.verdict is Verdict.PROVED
    M = spectral(ladder(40, -1e-6))
    refuted = decide_quickly(M)
    assert refuted.verdict is Verdict.REFUTED
    assert M.quadratic_form(refuted.witness) == refuted.value < 0
    edge = decide_quickly(spectral(ladder(40, 1e-15)))
    assert edge.verdict is Verdict.UNDECIDED
    assert edge.method.startswith("Cholesky factor")
    found = decide_quickly(from_float(np.diag([1.0, 0.0]), None))
    assert found.verdict is Verdict.REFUTED
    indefinite = [[1.0, 5.0], [5.0, 1.0]]
    found = decide_quickly(from_float(np.array(indefinite), None))
    assert found.verdict is Verdict.REFUTED
    assert decide_quickly(()).verdict is Verdict.PROVED


def gram(n: int, columns: int, *, seed: int) -> np.ndarray:
    """G G' with G (n, columns) of small integers: rank ``columns``, so n - columns eigenvalues are
    exactly 0."""
    rng = np.random.default_rng(seed)
    G = rng.integers(-5, 6, (n, columns))
    return (G @ G.T).astype(float)


@pytest.mark.parametrize(("n", "columns"), [(20, 19), (40, 38), (60, 57), (120, 119)])
def test_a_singular_gram_matrix_is_semidefinite_and_not_definite(n: int, columns: int):
    """Closed form: rank below n. The witness is an exact null vector."""
    M = IntegerSymmetric.from_floats(gram(n, columns, seed=n))
    weak = decide_positive_semidefinite(M)
    assert weak.verdict is Verdict.PROVED
    assert weak.method.startswith("signs of the characteristic polynomial")
    strict = decide_positive_definite(M)
    assert strict.verdict is Verdict.REFUTED
    assert strict.value == M.quadratic_form(strict.witness) == 0


@pytest.mark.parametrize("shift", [Fraction(1, 10**40), Fraction(-1, 10**40)])
def test_the_sign_of_a_shift_far_below_the_doubles_is_seen(shift: Fraction):
    """G G' + shift I is definite iff shift > 0; the decimal matrix is exact, not a double."""
    n = 30
    gram_matrix = IntegerSymmetric.from_floats(gram(n, n - 1, seed=1))
    M = gram_matrix.to_sparse().shifted(shift)
    for decide in (decide_positive_definite, decide_positive_semidefinite):
        found = decide(M)
        assert found.method.startswith("signs of the characteristic polynomial")
        assert found.is_proved == (shift > 0)
        if not found.is_proved:
            assert found.value == M.quadratic_form(found.witness) < 0
