"""Intervals of floats against the exact rationals, which are the independent oracle."""

import copy
import math
import operator
import pickle
from fractions import Fraction
from itertools import product

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dobc_design.coupling.enclosures import Curve, jet, secant, slope_form, value
from dobc_design.coupling.expression import parse_expression
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.exact import floats, interval
from dobc_design.exact.floats import LARGEST, Floats
from dobc_design.exact.interval import Interval, UndefinedError, float_values

OPERATORS = (operator.add, operator.sub, operator.mul, operator.truediv)
ONE_ARGUMENT = sorted(name for name, row in FUNCTIONS.items() if row.arguments == (1, 1))
# All magnitudes, the numbers that cannot be written in full among them, and those of couplings.
ENDS = st.one_of(
    st.floats(-LARGEST, LARGEST),
    st.floats(-4, 4),
    st.sampled_from(
        [0.0, -0.0, 1.0, -1.0, 5e-324, -5e-324, 2.0**-1022, 1e-200, -1e160, math.pi / 2, 1e15]
    ),
)


@st.composite
def intervals(draw: st.DrawFn) -> Floats:
    a = draw(ENDS)
    b = a if draw(st.booleans()) else draw(ENDS)
    return Floats(min(a, b), max(a, b))


def exact(x: Interval) -> Interval:
    return Interval(x.lo, x.hi)


def contains(found: Interval, truth: Interval) -> bool:
    """By rationals, which were rounded outwards themselves where they are long: their last bits do
    not count."""
    slack = Fraction(1, 2**120)
    allowed = abs(truth.lo) * slack
    return found.lo <= truth.lo + allowed and truth.hi - abs(truth.hi) * slack <= found.hi


@given(intervals(), intervals())
def test_sums_differences_products_and_quotients_contain_those_of_all_ends(
    x: Floats, y: Floats
) -> None:
    for each in OPERATORS:
        try:
            found = each(x, y)
        except UndefinedError:  # too large, or a division by 0
            continue
        assert -LARGEST <= found.bottom <= found.top <= LARGEST
        ends_of_x = (x.lo, x.hi)
        ends_of_y = (y.lo, y.hi)
        for u, v in product(ends_of_x, ends_of_y):
            assert found.lo <= each(u, v) <= found.hi


@given(intervals(), st.integers(-6, 9))
def test_powers_contain_those_of_the_ends_and_of_0(x: Floats, exponent: int) -> None:
    assume(exponent >= 0 or not x.contains(0))
    try:
        found = x**exponent
    except UndefinedError:
        return
    for u in (x.lo, x.hi, Fraction(0)):
        assert not x.contains(u) or found.lo <= u**exponent <= found.hi


@pytest.mark.parametrize("name", ONE_ARGUMENT)
@settings(max_examples=20)
@given(x=intervals())
def test_functions_contain_what_the_rationals_enclose(name: str, x: Floats) -> None:
    try:
        found = FUNCTIONS[name].interval(x)
    except UndefinedError:
        return
    truth = FUNCTIONS[name].interval(exact(x))
    assert contains(found, truth)


@settings(max_examples=20)
@given(intervals(), intervals(), st.fractions())
def test_hulls_common_parts_halves_and_conversions_lose_nothing(
    x: Floats, y: Floats, number: Fraction
) -> None:
    assert x.hull(y).contains(exact(x))
    assert x.hull(y).contains(exact(y))
    low, high = x.halves()
    assert low.lo == x.lo
    assert low.hi == high.lo == x.middle().lo
    assert high.hi == x.hi
    assert x.lo <= x.middle().lo <= x.hi
    assert exact(abs(x)) == abs(exact(x))
    assert exact(-x) == -exact(x)
    around = Floats.around(number)
    below = around.bottom
    above = around.top
    assert Fraction(below) <= number <= Fraction(above)
    assert above <= math.nextafter(below, math.inf)
    if max(x.lo, y.lo) <= min(x.hi, y.hi):
        found = exact(x.meet(y))
        assert found == exact(x).meet(exact(y))


@pytest.mark.parametrize(
    "h", ["sin(y)", "tanh(y)", "exp(y) - 1 + y", "y/(1 + y**2)", "clip(2*y, -1, 1)", "atan(y)*y**2"]
)
@settings(max_examples=20)
@given(a=st.floats(-3, 3), b=st.floats(-3, 3))
def test_couplings_and_their_gains_and_slopes_are_enclosed(h: str, a: float, b: float) -> None:
    curve = Curve(parse_expression(h))
    Y = Floats(min(a, b), max(a, b))
    try:
        by_secants = secant(curve, Y).value
        by_slopes = jet(curve, Y).slope
        found = (value(curve, Y), slope_form(curve, Y), by_secants, by_slopes)
    except UndefinedError:  # quotients of numbers next to 0
        return
    lowest = Interval.point(Y.lo)
    middle = Interval.point(Y.midpoint)
    cases = (lowest, middle, Interval.point(Y.hi))
    for y in cases:
        points = (
            value(curve, y),
            slope_form(curve, y),
            secant(curve, y).value,
            jet(curve, y).slope,
        )
        for each, point in zip(found, points, strict=True):
            assert each.lo <= point.hi
            assert point.lo <= each.hi


@pytest.mark.parametrize(
    "a, b", [(math.nan, 1.0), (0.0, math.nan), (0.0, math.inf), (-math.inf, 0.0), (1.0, 0.0)]
)
def test_what_is_no_interval_of_finite_numbers_is_refused(a: float, b: float) -> None:
    with pytest.raises(UndefinedError, match="exceeds"):
        Floats(a, b)


def test_intervals_of_floats_are_equal_where_both_ends_are() -> None:
    assert Floats(1.0, 2.0) == Floats(1.0, 2.0)
    for other in (Floats(1.0, 3.0), Floats(0.0, 2.0), (1.0, 2.0)):
        assert Floats(1.0, 2.0) != other


def test_too_large_numbers_are_refused_and_too_small_ones_are_bounded() -> None:
    large = Floats(1e200, 1e200)
    small = Floats(1e-200, 1e-200)
    with pytest.raises(UndefinedError, match="exceeds"):
        large * large
    with pytest.raises(UndefinedError, match="exceeds"):
        Floats.around(Fraction(10) ** 400)
    assert (small * small).bottom < 0 < (small * small).top
    found = Floats.around(Fraction(1, 10**400))
    assert found.top == 5e-324


def test_without_rounding_outwards_the_rationals_are_not_contained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The twin: the properties above can fail."""
    x = Floats(0.1, 0.1)
    y = Floats(0.3, 0.3)
    with monkeypatch.context() as still:
        still.setattr(floats, "nextafter", lambda number, towards: number)
        sums = x + y
        products = x * y
        quotients = x / y
    assert not sums.contains(x.lo + y.lo)
    assert not products.contains(x.lo * y.lo)
    assert not quotients.contains(x.lo / y.lo)
    float_values.cache_clear()
    with monkeypatch.context() as still:
        still.setattr(interval.math, "nextafter", lambda number, towards: number)
        found = []
        for k in range(1, 40):
            found.append(FUNCTIONS["exp"].interval(Floats(k / 7, k / 7)))
    float_values.cache_clear()
    truth = []
    for k in range(1, 40):
        truth.append(FUNCTIONS["exp"].interval(exact(Floats(k / 7, k / 7))))
    both = zip(found, truth, strict=True)
    assert not all(contains(f, t) for f, t in both)


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
def test_an_interval_of_floats_can_be_copied_and_pickled(copied):
    x = Floats(0.1, 0.3)
    assert copied(x) == x
    assert copied(x).lo == x.lo == Fraction(0.1)


def test_numbers_remembered_in_floats_change_neither_what_is_shown_nor_what_is_written():
    third = Interval.point(Fraction(1, 3))
    before = repr(third)
    found = Floats.around(third)
    assert Floats.around(third) is found
    assert found.contains(third)
    assert repr(third) == before
    assert third == Interval.point(Fraction(1, 3))
    answer = pickle.loads(pickle.dumps([third, found]))
    assert answer == [third, found]
