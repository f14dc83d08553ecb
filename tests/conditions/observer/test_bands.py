"""Sines of unknown frequencies: what is left of them by closed forms, NumPy and both programs."""

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from dobc_design import Dynamics, Exosystem, Group, Network, Observer, Problem
from dobc_design.checker import bands as second
from dobc_design.checker.channels import Channel
from dobc_design.checker.reading import Refused
from dobc_design.conditions.observer.bands import are_bounded, filters
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.observer.propose import band_gains, observer_gain
from dobc_design.exact.matrix import Matrix, matrix, multiply
from dobc_design.exact.polynomial import characteristic_polynomial, is_nonnegative, squared_modulus
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.problem.bands import Band, nodes

ONE = Fraction(1)
PAPER = ["16/5", "44/5"]  # chi_F of the paper's A, C and W, less s^2
SMALL = st.integers(-3, 3)


def observed(chi_a: list[Any], chi_f: list[Any], **more: Any) -> Problem:
    """A pinned agent with these characteristic polynomials (without the leading 1), in observer
    form."""
    q = len(chi_a)
    A = np.zeros((q, q), dtype=object)
    for row, a in enumerate(chi_a):
        A[row, 0] = -Fraction(a)
        if row + 1 < q:
            A[row, row + 1] = 1
    W = [[Fraction(f) - Fraction(a)] for f, a in zip(chi_f, chi_a, strict=True)]
    exosystem = Exosystem(A=A.tolist(), C=[[1] + [0] * (q - 1)])
    return pinned(exosystem, W, **more)


def channel_of(F: Any, C: Any, W: Any) -> Channel:
    """d - dhat of measured states, as the second program has it."""
    one = [[Fraction(i == j) for j in range(len(C))] for i in range(len(C))]
    entering = [[-x for x in row] for row in W]
    return Channel(F, C, one, entering, [], [], [], len(C))


def pinned(exosystem: Exosystem, W: Any, **more: Any) -> Problem:
    m = exosystem.outputs
    network = Network.from_arcs({"G": []}, agents=1, arrow="listens_to")
    given = {"network": network, "coupling": "y", "gains": {"1": 1}, "target": [0] * m}
    return Problem(**given | {"exosystem": exosystem, "observer": Observer(W=W)} | more)


def loop_and_gain(problem: Problem) -> tuple[Loop, Matrix]:
    loop = loop_of(problem)
    W = observer_gain(loop)
    assert W is not None
    return loop, W


def both(problem: Problem, band: Band, gains: Matrix) -> tuple[bool, bool]:
    """Whether the package and the second program say that no more is left."""
    loop, W = loop_and_gain(problem)
    lone = True
    for group, gain in loop.observed(W):
        F = error_matrix(group.exosystem, gain)
        C = group.exosystem.C
        entering = gain
        if loop.drift is not None:
            C = multiply(loop.drift.left_inverse, C)
            entering = multiply(gain, loop.drift.B)
        lists = [[list(row) for row in each] for each in (F, C, entering, gains)]
        try:
            second.need_bands([list(band)], channel_of(*lists[:3]), lists[3:])
        except Refused:
            lone = False
    return are_bounded(loop, W, band, gains), lone


def in_band(low: Any, high: Any) -> Band:
    return Band(Fraction(low), Fraction(high), ONE)


def bounded(problem: Problem, band: Band, *gain: Any) -> tuple[bool, bool]:
    """The same of one entry."""
    return both(problem, band, ((Fraction(*gain),),))


#: (s^2 + 4.04 - 0.8/sqrt(2))(s^2 + 4.04 + 0.8/sqrt(2)), and the square of the paper's chi_F.
TWO_PAIRS = [0, "8.08", 0, "16.0016"], ["32/5", "696/25", "1408/25", "1936/25"]


@pytest.mark.parametrize(
    ("chi_a", "chi_f", "band", "gain"),
    [
        ([0, 4], PAPER, ("1.8", "2.2"), "0.103995"),
        ([0, 4], PAPER, ("1.9", "2.1"), "0.051079"),
        ([0, "4.04"], PAPER, ("1.8", "2.2"), "0.099929"),
        (*TWO_PAIRS, ("1.8", "2.2"), "0.004998"),
    ],
)
def test_both_programs_prove_the_known_answers_and_refuse_what_is_just_below(
    chi_a, chi_f, band, gain
):
    """Theory, section 19: the six digits are rounded up."""
    problem = observed(chi_a, chi_f)
    proved = Fraction(gain)
    assert bounded(problem, in_band(*band), proved) == (True, True)
    below = proved - Fraction(1, 10**6)
    assert bounded(problem, in_band(*band), below) == (False, False)


def test_the_observer_of_the_paper_makes_every_sine_smaller():
    """|chi_F|^2 - |chi_A|^2 = (16 w^2 + 1536)/25 > 0 for every w, and the gain tends to 1."""
    problem = observed([0, 4], PAPER)
    difference = np.subtract(
        squared_modulus((ONE, Fraction("16/5"), Fraction("44/5"))),
        squared_modulus((ONE, Fraction(0), Fraction(4))),
    )
    assert difference.tolist() == [0, Fraction(16, 25), Fraction(1536, 25)]
    everywhere = in_band(0, 10**6)
    assert bounded(problem, everywhere, 1) == (True, True)
    assert bounded(problem, everywhere, Fraction("0.999999")) == (False, False)


def test_nothing_is_left_of_a_frequency_of_the_model_and_something_of_every_other():
    """Internal model: S vanishes at the roots of chi_A only."""
    problem = observed([0, 4], PAPER)
    assert bounded(problem, in_band(2, 2), 0) == (True, True)
    for band in (in_band(2, "2.000001"), in_band("1.999999", 2), in_band("2.1", "2.1")):
        assert bounded(problem, band, 0) == (False, False)


def test_no_gain_bounds_what_an_observer_that_is_not_hurwitz_leaves():
    """chi_F = s^2 + 4 has its roots on the axis, though |S| = 1 there for all w."""
    still = observed([0, 4], [0, 4])
    assert bounded(still, in_band(1, 3), 5) == (False, False)
    assert bounded(observed([0, 4], ["-1/10", 5]), in_band(1, 3), 5) == (False, False)


def test_a_negative_gain_is_refused_although_its_square_would_do():
    problem = observed([0, 4], PAPER)
    assert bounded(problem, in_band(1, 3), -1) == (False, False)


def drawn(data: st.DataObject, p: int, q: int, m: int | None = None) -> tuple[Exosystem, Matrix]:
    """C (p, q), W (q, m) small integers, and A that makes A - W C stable."""

    def table(rows: int, columns: int) -> Matrix:
        entries = st.lists(st.lists(SMALL, min_size=columns, max_size=columns), min_size=rows)
        return matrix(data.draw(entries.map(lambda found: found[:rows])))

    C = table(p, q)
    W = table(q, m or p)
    stable = np.array(table(q, q))
    shift = 1 + max(sum(map(abs, row)) for row in stable)  # Gershgorin
    F = stable - shift * np.eye(q, dtype=int)
    return Exosystem(A=(F + np.array(multiply(W, C))).tolist(), C=C), W


def response(A: Any, C: Any, W: Any, w: float) -> Any:
    """|I - C (jw - F)^-1 W| in floats."""
    A, C, W = (np.array(x, dtype=float) for x in (A, C, W))
    F = A - W @ C
    inner = linalg.solve(1j * w * np.eye(len(F)) - F, W)
    return np.abs(np.eye(len(C)) - C @ inner)


@pytest.mark.parametrize(("p", "q"), [(1, 1), (1, 3), (2, 2), (2, 4), (3, 3)])
@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_both_programs_have_the_numerators_of_the_matrix(p, q, data):
    exosystem, W = drawn(data, p, q)
    loop, gain = loop_and_gain(pinned(exosystem, W))
    ((below, rows),) = filters(loop, gain)
    F = error_matrix(exosystem, gain)
    assert below == characteristic_polynomial(F)
    lists = ([list(row) for row in x] for x in (F, exosystem.C, W))
    lone = second.numerators(channel_of(*lists), list(below))
    assert [[tuple(x) for x in row] for row in lone] == [list(row) for row in rows]
    for w in (0.0, 0.7, 3.1):
        bottom = np.polyval(np.array(below, dtype=float), 1j * w)
        found = [
            [abs(np.polyval(np.array(x, dtype=float), 1j * w) / bottom) for x in r] for r in rows
        ]
        assert np.allclose(found, response(exosystem.A, exosystem.C, W, w))


@given(data=st.data())
@settings(max_examples=15, deadline=None)
def test_what_is_proposed_is_proved_by_both_programs_and_one_percent_less_by_neither(data):
    exosystem, W = drawn(data, 2, 3)
    problem = pinned(exosystem, W)
    band = in_band("1/2", 3)
    gains = band_gains(*loop_and_gain(problem), band)
    assert both(problem, band, gains) == (True, True)
    largest = [response(exosystem.A, exosystem.C, W, w) for w in np.linspace(0.5, 3, 301)]
    most = np.max(largest, axis=0)
    assert np.all(np.array(gains, dtype=float) >= most)
    assert np.allclose(np.array(gains, dtype=float), most, rtol=0.01, atol=1e-6)
    if np.all(most > 1e-3):
        less = tuple(tuple(x * Fraction(98, 100) for x in row) for row in gains)
        assert both(problem, band, less) == (False, False)


def test_a_disturbance_of_the_inputs_is_measured_there():
    """x'' = u + d with W on the speed alone: dhat' = w (d - dhat), |S| = w/sqrt(w^2 + 25)."""
    dynamics = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
    problem = pinned(
        Exosystem(A=[[0]], C=[[1]]),
        [[0, 5]],
        dynamics=dynamics,
        coupling="y1",
        gains={"1": [[2, 2]]},
        target=[0, 0],
    )
    band = in_band(1, "15/4")  # (15/4)/(25/4) = 3/5
    assert bounded(problem, band, 3, 5) == (True, True)
    assert bounded(problem, band, Fraction("0.5999999")) == (False, False)


def test_the_worst_of_all_groups_counts():
    """S = s/(s + 1) leaves 2/sqrt(5) at w = 2, S = s/(s + 9) much less."""
    still = Exosystem(A=[[0]], C=[[1]])
    groups = []
    for label, w in (("1", 1), ("2", 9)):
        groups.append(Group(agents=[label], exosystem=still, observer=Observer(W=[[w]])))
    network = Network.from_arcs({"G": []}, agents=2, arrow="listens_to")
    gains = {"1": 1, "2": 1}
    problem = Problem(network=network, coupling="y", gains=gains, groups=groups, target=[0])
    assert bounded(problem, in_band(1, 2), Fraction("0.8944272")) == (True, True)
    assert bounded(problem, in_band(1, 2), Fraction("0.8944271")) == (False, False)


@pytest.mark.parametrize("scale", ["1e-30", "1e-6", "1e6", "1e30"])
def test_gains_are_found_in_every_unit_of_time(scale):
    """The paper's observer in units of time by which all its rates are as large."""
    unit = Fraction(scale)
    chi_f = [Fraction(PAPER[0]) * unit, Fraction(PAPER[1]) * unit**2]
    problem = observed([0, 4 * unit**2], chi_f)
    band = in_band(Fraction("1.8") * unit, Fraction("2.2") * unit)
    ((gain,),) = band_gains(*loop_and_gain(problem), band)
    assert float(gain) == pytest.approx(0.103995, rel=1e-5)
    assert both(problem, band, ((gain,),)) == (True, True)


def test_where_nothing_is_left_a_gain_above_zero_is_proposed():
    """Bounds of 0 would be reached after all time only."""
    ((gain,),) = band_gains(*loop_and_gain(observed([0, 4], PAPER)), in_band(2, 2))
    assert 0 < gain < 1e-8


@pytest.mark.parametrize("pairs", [1, 2, 3, 10])
def test_poles_stand_at_the_chebyshev_nodes_of_the_square(pairs):
    """On them |w^2 - x_1| ... |w^2 - x_r| is at most 2 (half the width/2)^r."""
    low, high = Fraction("1.8"), Fraction("2.2")
    found = nodes(low, high, pairs)
    assert len(found) == pairs
    assert all(low < w < high for w in found)
    squares = np.linspace(float(low) ** 2, float(high) ** 2, 2001)
    product = np.prod([squares - float(w) ** 2 for w in found], axis=0)
    assert np.max(np.abs(product)) == pytest.approx(2 * 0.4**pairs, rel=1e-4)


def test_a_band_of_one_frequency_has_one_pole():
    assert nodes(Fraction(2), Fraction(2), 3) == [2]


ROOTS = st.fractions(min_value=0, max_value=4, max_denominator=5)


@given(
    roots=st.lists(ROOTS, max_size=5),
    ends=st.tuples(ROOTS, ROOTS).map(sorted),
    factor=st.sampled_from([-2, -1, 1, 3]),
    extra=st.booleans(),
)
@settings(max_examples=30, deadline=None)
def test_signs_on_an_interval_agree_with_the_roots(roots, ends, factor, extra):
    """Also where roots are of even order or at the ends; without the factor x^2 + 1, too."""
    coefficients = np.array([Fraction(factor)], dtype=object)
    for root in roots:
        coefficients = np.convolve(coefficients, np.array([ONE, -root], dtype=object))
    if extra:
        coefficients = np.convolve(coefficients, np.array([ONE, 0, ONE], dtype=object))
    low, high = ends
    points = sorted({low, high, *(x for x in roots if low < x < high)})
    between = [(a + b) / 2 for a, b in pairwise(points)]

    def value(x: Fraction) -> Fraction:
        found = Fraction(factor)
        for root in roots:
            found *= x - root
        return found

    expected = all(value(x) >= 0 for x in (*points, *between))
    falling = tuple(Fraction(x) for x in coefficients)
    assert is_nonnegative(falling, low, high) is expected
    lone = second.nonnegative(list(falling[::-1]), low, high)
    # Halving never ends at a root of even order inside; then it says nothing.
    assert lone is expected or (expected and not lone and any(low < x < high for x in roots))
    if all(value(x) > 0 for x in (*points, *between)):
        assert lone


@pytest.mark.parametrize("order", [2, 4])
def test_a_double_root_in_the_middle_is_seen_by_both(order):
    """(x - 1)^order on [0, 2]: halves end at the root."""
    coefficients = (ONE,)
    for _ in range(order):
        coefficients = tuple(np.convolve(coefficients, (ONE, -ONE)))
    assert is_nonnegative(coefficients, Fraction(0), Fraction(2))
    assert second.nonnegative(list(coefficients[::-1]), Fraction(0), Fraction(2))
    dented = (*coefficients[:-1], coefficients[-1] - Fraction(1, 10**9))
    assert not is_nonnegative(dented, Fraction(0), Fraction(2))
    assert not second.nonnegative(list(dented[::-1]), Fraction(0), Fraction(2))


def test_the_zero_polynomial_is_nowhere_negative():
    for zero in ((), (Fraction(0),), (Fraction(0), Fraction(0))):
        assert is_nonnegative(zero, Fraction(0), ONE)
    assert second.nonnegative([Fraction(0)], Fraction(0), ONE)
