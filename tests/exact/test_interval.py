"""Intervals: every true value is inside; mpmath at 120 digits is the oracle."""

import itertools
import math
import threading
import time
from fractions import Fraction
from random import Random

import mpmath
import numpy as np
import pytest
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st
from texts import exact_matrix

from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.errors import SpecError
from dobc_design.exact import Interval, UndefinedError, interval
from dobc_design.exact import interval as elementary
from dobc_design.exact.interval import (
    cos,
    discretise,
    exp,
    interval_characteristic_polynomial,
    interval_routh,
    round_down,
    round_up,
    sin,
    sqrt_bounds,
)
from dobc_design.exact.matrix import matrix
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.verdict import Verdict

ORACLE = mpmath.mp.clone()
ORACLE.dps = 120
# The oracle itself is off by less than this part of the value (or of 1).
SLACK = Fraction(1, 10**100)

# An argument is a rational of moderate size, a very small or a large one.
small_fractions = st.fractions(min_value=-9, max_value=9, max_denominator=50)
POINTS = (
    small_fractions
    | st.integers(-40, 40).map(Fraction)
    | st.integers(-300, 300).map(lambda k: Fraction(k) / 10**30)
    | st.integers(-300, 300).map(lambda k: Fraction(k) * 7)
)
pairs = st.tuples(POINTS, POINTS)
INTERVALS = pairs.map(lambda p: Interval(min(p), max(p)))
SHARES = st.fractions(min_value=0, max_value=1, max_denominator=20)


def true_value(name, x):
    """The value at a rational, as a rational within SLACK."""
    point = ORACLE.mpf(x.numerator) / x.denominator
    value = getattr(ORACLE, name)(point)
    sign, mantissa, exponent, _ = value._mpf_
    signed = (-1) ** sign * Fraction(int(mantissa))
    return signed * Fraction(2) ** exponent


def assert_contains(enclosure, value):
    slack = SLACK * max(1, abs(value))
    assert enclosure.lo - slack <= value <= enclosure.hi + slack


def enclosed(name, x):
    try:
        return FUNCTIONS[name].interval(x)
    except UndefinedError:
        return None


NAMES = ("exp", "log", "sin", "cos", "tan", "tanh", "atan", "sinh", "cosh", "sqrt")


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(NAMES), INTERVALS, SHARES)
def test_function_values_inside_an_interval_are_enclosed(name, x, share):
    """Theory, section 3: enclosures round outwards."""
    inside = x.lo + share * x.width
    enclosure = enclosed(name, x)
    if enclosure is not None:
        assert_contains(enclosure, true_value(name, inside))
    elif name not in ("log", "sqrt", "tan") and not (
        name in ("exp", "sinh", "cosh") and max(-x.lo, x.hi) > 575
    ):
        pytest.fail(f"{name} must be defined on {x}")


def test_ranges_are_as_narrow_as_the_function():
    """Closed forms: monotone ones take their end points, cos and sin their extremes."""
    x = Interval(-2, 2)
    for name in ("exp", "tanh", "atan", "sinh"):
        found = FUNCTIONS[name].interval(x)
        below = (found.lo, true_value(name, x.lo))
        above = (found.hi, true_value(name, x.hi))
        cases = (below, above)
        for end, value in cases:
            assert abs(end - value) < Fraction(1, 2**115)
    assert interval.cosh(x).lo == 1
    assert interval.cos(x).hi == 1
    assert interval.cos(Interval(3, 4)).lo == -1
    assert interval.sin(Interval(1, 2)).hi == 1
    assert interval.sin(Interval(4, 5)).lo == -1
    answer = interval.sin(Interval(0, 5))
    assert answer == Interval(-1, 1)
    assert interval.sin(x) == Interval(-1, 1)
    answer = interval.sin(Interval(0, Fraction(3, 2)))
    assert answer.lo == 0
    assert answer.hi < 1


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_extremes_are_found_wherever_they_lie(name):
    """A grid over many turns: +-1 is attained iff the critical point is inside (mpmath's is the
    oracle)."""
    for k in range(-9, 10):
        shift = Fraction(1, 2) if name == "sin" else Fraction(0)
        critical = (k + shift) * true_value("acos", Fraction(-1))
        gap = Fraction(1, 10**15)
        around = FUNCTIONS[name].interval(Interval(critical - gap, critical + gap))
        left = FUNCTIONS[name].interval(Interval(critical - 1, critical - gap))
        assert (around.hi == 1) if k % 2 == 0 else (around.lo == -1)
        assert left.magnitude < 1


@pytest.mark.parametrize(
    ("name", "x", "value"),
    [
        *((name, 0, 1) for name in ("exp", "cos", "cosh")),
        *((name, 0, 0) for name in ("sin", "tan", "atan", "sinh", "tanh", "sqrt")),
        ("log", 1, 0),
        ("sqrt", Fraction(16, 25), Fraction(4, 5)),
        ("sqrt", Fraction(1, 10**400), Fraction(1, 10**200)),
        ("abs", Fraction(-16, 5), Fraction(16, 5)),
    ],
)
def test_rational_values_are_exact(name, x, value):
    """So that h(0) = 0 can be proved: exp(0) - 1 is 0, not an interval around it."""
    found = FUNCTIONS[name].interval(Interval.point(x))
    assert found == Interval.point(value)


@pytest.mark.parametrize(
    ("name", "x"),
    [
        ("log", (0, 1)),
        ("log", (-1, 1)),
        ("sqrt", (-1, 1)),
        ("sqrt", (Fraction(-1, 10**99), 0)),
        ("tan", (1, 2)),
        ("tan", (-100, 100)),
        ("tan", (Fraction("1.5707963267948966192313216916397514420985"), 2)),
        ("tan", (10**700, 10**700)),
    ],
)
def test_functions_refuse_where_they_are_not_defined(name, x):
    with pytest.raises(UndefinedError, match=rf"^{name} is not defined on the whole of \["):
        FUNCTIONS[name].interval(Interval(*map(Fraction, x)))


def test_tan_is_defined_right_up_to_its_poles():
    """The twin of the refusals: 10^-30 beside the pole."""
    half_pi = interval.pi().hi / 2
    beside = Interval(half_pi + Fraction(1, 10**30), 2)
    assert interval.tan(beside).lo < -(10**29)
    with pytest.raises(UndefinedError, match="tan"):
        interval.tan(Interval(half_pi - Fraction(1, 10**30), 2))


def test_pi_is_enclosed_narrowly():
    lower_end = interval.pi().lo
    true_pi = true_value("acos", Fraction(-1))
    assert lower_end < true_pi < interval.pi().hi
    assert interval.pi().width < Fraction(1, 2**120)


@settings(max_examples=25, deadline=None)
@given(INTERVALS, INTERVALS, SHARES, SHARES)
def test_arithmetic_encloses_every_pair_and_is_tight(x, y, s, t):
    """Exact rational arithmetic on points inside, and on the four corners."""
    a = x.lo + s * x.width
    b = y.lo + t * y.width
    ends_of_x = (x.lo, x.hi)
    ends_of_y = (y.lo, y.hi)
    corners = list(itertools.product(ends_of_x, ends_of_y))
    sums = (x + y, a + b, [p + q for p, q in corners])
    differences = (x - y, a - b, [p - q for p, q in corners])
    products = (x * y, a * b, [p * q for p, q in corners])
    cases = [sums, differences, products]
    if not y.contains(0):
        quotients = [p / q for p, q in corners]
        divisions = (x / y, a / b, quotients)
        cases.append(divisions)
    for enclosure, value, values in cases:
        assert enclosure.contains(value)
        assert enclosure == Interval(min(values), max(values))
    assert interval.minimum(x, y).contains(min(a, b))
    assert interval.maximum(x, y).contains(max(a, b))
    assert abs(x).contains(abs(a))
    clipped = interval.clip(x, Interval(-1, -1), Interval(1, 1))
    raised = max(a, Fraction(-1))
    truth = min(raised, Fraction(1))
    assert clipped.contains(truth)
    assert x.hull(y).contains(a)
    assert x.hull(y).contains(b)


@settings(max_examples=25, deadline=None)
@given(INTERVALS, SHARES, st.integers(-7, 7))
def test_powers_enclose_and_even_ones_know_their_minimum(x, share, exponent):
    """Trap: an interval straddling 0 (arb ** int gives NaN there)."""
    inside = x.lo + share * x.width
    if exponent < 0 and x.contains(0):
        with pytest.raises(UndefinedError, match="contains 0, is not defined"):
            _ = x**exponent
    else:
        power = x**exponent
        assert power.contains(inside**exponent)
        if exponent > 0:
            ends = [x.lo**exponent, x.hi**exponent]
            least = 0 if exponent % 2 == 0 and x.contains(0) else min(ends)
            assert power.contains(Interval(least, max(ends)))
            if not power.is_point:
                size = max(map(abs, ends))
                allowed = Fraction(1, 2**100) * size
                assert power.width <= (max(ends) - least) + allowed


def test_numbers_mix_with_intervals_on_both_sides():
    """As in Python, so that polynomials have their constant term."""
    zeroth_power = Interval(-1, 1) ** 0
    assert zeroth_power == Interval.point(0) ** 0 == Interval.point(1)
    x = Interval(1, 2)
    assert 1 + x == x + 1 == Interval(2, 3)
    assert 1 - x == Interval(-1, 0)
    assert Fraction(1, 2) * x == Interval(Fraction(1, 2), 1)
    assert 1 / x == Interval(Fraction(1, 2), 1)
    assert +x == x
    with pytest.raises(SpecError, match="must be int or Fraction; got float"):
        x + 0.5


@pytest.mark.parametrize("ends", [(2, 1), (0.5, 1), (0, float("nan")), (True, 2), ("0", 1)])
def test_what_is_no_interval_is_refused(ends):
    with pytest.raises(SpecError, match="interval"):
        Interval(*ends)


def test_an_interval_tells_its_measures():
    x = Interval(-1, Fraction(1, 3))
    assert x.width == Fraction(4, 3)
    assert x.midpoint == Fraction(-1, 3)
    assert x.magnitude == 1
    assert x.is_point is False
    lower = Interval(-1, Fraction(-1, 3))
    upper = Interval(Fraction(-1, 3), Fraction(1, 3))
    expected = (lower, upper)
    assert x.halves() == expected
    assert x.contains(Interval(0, 0))
    assert not x.contains(Interval(0, 1))
    low, high = x.floats()
    assert low == -1
    assert Fraction(high) > Fraction(1, 3)
    assert str(x) == "[-1, 1/3]"
    top = Fraction(10) ** 400 * 2
    huge = Interval(Fraction(10) ** 400, top)
    assert str(huge).startswith("[about 1.79769e+308, ")


def test_end_points_stay_short_under_repeated_squaring():
    """Without rounding, 60 squarings of 9/10 would have 2^60 digits."""
    x = Interval(Fraction(9, 10), Fraction(11, 10))
    start = time.process_time()
    for _ in range(14):
        x = x * x
    lower_bits = x.lo.numerator.bit_length()
    upper_bits = x.hi.numerator.bit_length()
    assert max(lower_bits, upper_bits) < 70_000
    for _ in range(60):
        x = (x - x.lo) / (x.hi - x.lo + 1)
        x = x * x + Fraction(1, 3)
    assert time.process_time() - start < 10
    tiny = Interval.point(Fraction(1, 3))
    for _ in range(40):
        tiny = tiny**64
    assert tiny.lo == 0
    assert 0 < tiny.hi < Fraction(1, 2**65_000)
    minus = Interval.point(Fraction(-1, 3))
    for _ in range(41):
        minus = minus**63
    assert minus.hi == 0
    assert 0 > minus.lo > -Fraction(1, 2**65_000)


def test_values_beyond_the_largest_bound_are_refused():
    """No infinite end points: an enclosure is finite or an error."""
    x = Interval.point(3)
    with pytest.raises(UndefinedError, match=r"\* of \[.*exceeds the bound 2\^65536"):
        for _ in range(40):
            x = x**64
    found = interval.exp(Interval(-45_000, -45_000))
    assert found.lo > 0
    found = interval.exp(Interval(575, 575))
    assert found.hi < Fraction(10) ** 250 < interval.exp(Interval(575, 575)).hi * 10
    with pytest.raises(UndefinedError, match="at most 575"):
        interval.exp(Interval(575, 576))


@pytest.mark.parametrize("name", ["exp", "sinh", "cosh"])
@pytest.mark.parametrize("size", [10**6, 10**300])
def test_huge_arguments_are_refused_at_once(name, size):
    start = time.process_time()
    with pytest.raises(UndefinedError, match=rf"^{name} of \[.*too large to enclose"):
        FUNCTIONS[name].interval(Interval(0, size))
    found = interval.exp(Interval(-size, -size))
    assert found.lo == 0
    assert 0 < found.hi < Fraction(1, 2**60_000)
    assert interval.exp(Interval(-size, 0)).hi == 1
    assert time.process_time() - start < 20


@pytest.mark.parametrize("name", ["sin", "cos", "tanh", "atan", "log", "sqrt"])
@pytest.mark.parametrize("power", [400, -400, 5000])
def test_arguments_of_any_size_are_enclosed_at_once(name, power):
    """Periodic functions of a huge argument: all or nothing is known, never something wrong."""
    x = Fraction(10) ** power
    start = time.process_time()
    found = FUNCTIONS[name].interval(Interval.point(x))
    assert time.process_time() - start < 20
    if abs(power) == 400:
        with ORACLE.workdps(1200):
            assert_contains(found, true_value(name, x))


def test_rounding_is_outward_to_the_bits_asked_and_a_long_point_stays_a_point():
    """1e-400 has 1329 bits: as a coefficient it must still cancel exactly."""
    small = Interval.point(Fraction(1, 10**400))
    assert small * 3 - small - 2 * small == Interval.point(0)
    third = Interval(Fraction(1, 3), Fraction(2, 3))
    x = third.rounded(8)
    assert x.lo == Fraction(85, 256)
    assert x.hi == Fraction(171, 256)
    negative = Interval(Fraction(-2, 3), Fraction(-1, 3))
    found = negative.rounded(8)
    assert found == -x
    found = Interval(Fraction(1000, 3), 1000).rounded(4)
    assert found == Interval(320, 1024)


def test_threads_do_not_disturb_each_other():
    """flint keeps one precision for all threads; results must not depend on who else computes."""
    arguments = [Fraction(k, 7) for k in range(-30, 30)]
    expected = [interval.sin(Interval.point(x)) for x in arguments]
    wrong = []

    def work():
        for _ in range(5):
            if [interval.sin(Interval.point(x)) for x in arguments] != expected:
                wrong.append(1)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@given(st.fractions(), st.integers(1, 200))
def test_rounding_goes_the_right_way_by_less_than_one_unit(x, bits):
    """At most ``bits`` significant bits, and a relative error below 2^(1 - bits)."""
    low = round_down(x, bits)
    high = round_up(x, bits)
    assert low <= x <= high
    assert high - low <= abs(x) * Fraction(4, 2**bits)
    for end in (low, high):
        lowest_bit = end.numerator & -end.numerator
        odd = abs(end.numerator) // (lowest_bit or 1)
        assert odd.bit_length() <= bits + 1
        assert round_down(end, bits + 1) == round_up(end, bits + 1) == end


def test_rounding_beyond_the_largest_exponent_keeps_its_direction():
    """A lower bound may fall to 2^65536 or to 0; an upper one beyond it does not exist."""
    huge = Fraction(3) ** 50_000
    tiny = Fraction(1, 3**50_000)
    assert round_down(huge) == Fraction(2) ** 65_536
    assert round_up(-huge) == -(Fraction(2) ** 65_536)
    with pytest.raises(OverflowError, match=r"2\^65536"):
        round_up(huge)
    with pytest.raises(OverflowError, match=r"2\^65536"):
        round_down(-huge)
    assert round_down(tiny) == 0
    assert round_up(tiny) == Fraction(1, 2**65_536)
    assert round_down(-tiny) == -Fraction(1, 2**65_536)
    assert round_up(-tiny) == 0


@given(st.fractions(min_value=0))
def test_root_bounds_hold_and_are_narrow(x):
    low, high = sqrt_bounds(x)
    assert low * low <= x <= high * high
    assert high - low <= high / 2**120
    assert sqrt_bounds(x * x) == (x, x)


def test_a_ball_with_a_tiny_exponent_is_widened_and_not_written_out():
    """Trap met: arb.rad().fmpq() ends the process for tanh(10^5000), whose radius is
    2^-(10^5000)."""
    low, high = elementary.bounds("tanh", Fraction(10) ** 5000)
    assert low < 1
    assert high == 1
    ball = arb((1, -(10**30)))
    low, high = elementary._ends(ball)
    assert low <= 0 < high < Fraction(1, 2**200_000)


@pytest.mark.parametrize("ball", [arb.nan(), arb.pos_inf(), arb((1, 10**30)), arb(0, (1, 10**30))])
def test_a_ball_without_finite_ends_is_refused(ball):
    """Trap met: Python's min and max drop nan in silence."""
    with pytest.raises(OverflowError, match="no finite enclosure"):
        elementary._ends(ball)


def overlap(x: Interval, y: Interval) -> bool:
    return x.lo <= y.hi and y.lo <= x.hi


def test_discretisation_has_its_closed_forms():
    """exp([[0, w], [-w, 0]] T) = [[cos wT, sin wT], [-sin wT, cos wT]]; the mean of cos is
    sin(wT)/(wT)."""
    w = 2
    T = Fraction(1, 10)
    rotation = [[0, w], [-w, 0]]
    found = discretise(matrix(rotation), T)
    angle = Interval.point(w * T)
    first_row = (cos(angle), sin(angle))
    second_row = (-sin(angle), cos(angle))
    expected = (first_row, second_row)
    for i in range(2):
        for j in range(2):
            assert overlap(found.transition[i][j], expected[i][j])
            assert found.transition[i][j].width < Fraction(1, 2**200)
    entry = found.mean[0][0]
    expected_entry = sin(angle) * (1 / (w * T))
    assert overlap(entry, expected_entry)
    # exp([[0, 1], [0, 0]] T) = [[1, T], [0, 1]], mean [[1, T/2], [0, 1]].
    T = Fraction(3, 7)
    found = discretise(exact_matrix("0 1; 0 0"), T)
    entries = (*found.transition[0], *found.transition[1], *found.mean[0], *found.mean[1])
    wanted = (1, T, 0, 1, 1, T / 2, 0, 1)
    for got, want in zip(entries, wanted, strict=True):
        assert got.contains(Fraction(want))
        assert got.width < Fraction(1, 2**120)
    found = discretise(exact_matrix("-7/2"), Fraction(2))
    assert overlap(found.transition[0][0], exp(Interval.point(-7)))
    mean = float(found.mean[0][0].midpoint)
    expected_mean = (1 - math.exp(-7)) / 7
    assert mean == pytest.approx(expected_mean)
    for period in (0, -1):
        with pytest.raises(SpecError, match="period must be > 0"):
            discretise(exact_matrix("0"), Fraction(period))


@pytest.mark.parametrize("seed", range(10))
def test_the_polynomial_encloses_the_exact_one(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    rows = []
    for _ in range(q):
        rows.append([Fraction(r.randint(-9, 9), 7) for _ in range(q)])
    F = matrix(rows)
    points = [[Interval.point(x) for x in row] for row in F]
    found = interval_characteristic_polynomial(points)
    for x, y in zip(found, characteristic_polynomial(F), strict=True):
        assert x.contains(y)


@pytest.mark.parametrize("seed", range(30))
def test_routh_in_intervals_is_right_for_every_polynomial_inside(seed):
    """PROVED and REFUTED are compared with NumPy's roots of corners and of the middle."""
    r = Random(seed)
    width = Fraction(r.choice((0, 1, 10)), 100)
    others = [Fraction(r.randint(-3, 40), 10) for _ in range(r.randint(1, 4))]
    middle = [Fraction(1), *others]
    coefficients = []
    for n, x in enumerate(middle):
        coefficients.append(Interval(x - width, x + width) if n else Interval.point(x))
    answer = interval_routh(coefficients)
    signs = []
    for _ in range(10):
        drawn_signs = [r.choice((-1, 0, 1)) for _ in middle]
        signs.append(drawn_signs)
    for choice in signs:
        inside = []
        for n, (x, s) in enumerate(zip(middle, choice, strict=True)):
            inside.append(float(x + (width * s if n else 0)))
        largest = max((z.real for z in np.roots(inside)), default=-1.0)
        if answer is Verdict.PROVED:
            assert largest < 1e-9
        elif answer is Verdict.REFUTED:
            assert largest > -1e-9


def test_an_interval_that_holds_zero_leaves_routh_undecided():
    tiny = Fraction(1, 10**30)
    coefficients = [Fraction(1), Interval(-tiny, tiny)]
    found = interval_routh(coefficients)
    assert found is Verdict.UNDECIDED
    coefficients = [Fraction(1), Interval(tiny, 2 * tiny)]
    found = interval_routh(coefficients)
    assert found is Verdict.PROVED
    coefficients = [Fraction(1), Interval(-2 * tiny, -tiny)]
    found = interval_routh(coefficients)
    assert found is Verdict.REFUTED
    coefficients = [Interval(-tiny, tiny), Fraction(1)]
    found = interval_routh(coefficients)
    assert found is Verdict.UNDECIDED
