"""The lone checker's reader of couplings: slopes at 0 are exact or enclosed, and intervals are
rounded outward."""

import itertools
import random
from fractions import Fraction

import mpmath
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_functions import KNOWN, OF_SEVERAL

from dobc_design import Network, Problem
from dobc_design.checker import intervals
from dobc_design.checker.curves import Curve
from dobc_design.checker.expressions import (
    FUNCTIONS,
    SMOOTH,
    Expression,
    applied,
    read_coupling,
    variables,
)
from dobc_design.checker.intervals import ONE, Exact
from dobc_design.checker.reading import Refused

RATIONALS = st.builds(Fraction, st.integers(-4000, 4000), st.integers(1, 500))


def test_every_function_of_the_grammar_is_enclosed_here():
    assert set(KNOWN) == set(SMOOTH)
    assert {*KNOWN, *OF_SEVERAL} == set(FUNCTIONS)


# --- On rationals
# --------------------------------------------------------------------------------------------------
def contains(enclosure: Exact, value: mpmath.mpf) -> bool:
    """Up to the rounding of mpmath at 120 digits; the enclosures have about 77."""
    low, high = (mpmath.mpf(x.numerator) / x.denominator for x in enclosure)
    unit = mpmath.mpf(10) ** -110
    slack = unit * (1 + abs(value))
    return bool(low - slack <= value <= high + slack)


@pytest.mark.parametrize("name", sorted(KNOWN))
@settings(max_examples=20)
@given(x=RATIONALS)
def test_values_and_derivatives_are_those_of_mpmath(name, x):
    """At rational points: enclosed, and within 1e-60 of the size of the value."""
    if name in ("log", "sqrt"):
        x = abs(x) + Fraction(1, 1000)
    elif name == "abs" and not x:
        x = Fraction(1)
    known = KNOWN[name]
    with mpmath.workdps(120):
        at = mpmath.mpf(x.numerator) / x.denominator
        variable = variables([(x, x)])
        value, (slope,) = applied(SMOOTH[name], *variable)
        of_value = (value, known.value(at))
        of_slope = (slope, known.slope(at))
        cases = (of_value, of_slope)
        for found, true in cases:
            assert contains(found, true)
            width = found[1] - found[0]
            allowed = Fraction(1, 10**60) * (1 + abs(found[1]))
            assert width <= allowed


@pytest.mark.parametrize("x", [Fraction(10**20), 1e20, 1e60])
def test_sines_of_large_numbers_have_as_many_places_as_they_need(x):
    with mpmath.workdps(120):
        lo, hi = intervals.wave((x, x), 0)
        exactly = mpmath.sin(mpmath.mpf(int(x)))
        assert float(lo) - 1e-15 <= exactly <= float(hi) + 1e-15
        assert hi - lo < 1e-12


@pytest.mark.parametrize(
    ("slope", "texts"),
    [
        ("-2", "(1 + y)**-2 - 1"),
        ("-1/4", "y**3 - y/4"),
        ("1/1000", "1e-3*y"),
        ("1/4", "sqrt(4 + y) - 2"),
        ("1/2", "2**-1*y"),
        (
            "1",
            "tanh(y)/(1 + y**2); log(1 + y); sinh(y) + cosh(y) - 1; tan(y)*y + y; clip(5, "
            "0, 1)*y; --y; y**0*y",
        ),
        ("3/2", "sqrt(9/4)*y"),
        ("2", "2*y; exp(y) - 1 + y; abs(-2)*y"),
        ("3", "-y**2 + 3*y; atan(3*y); max(2, 3)*y"),
        ("6", "sin(2*y)*3"),
        ("400", " + ".join(["y"] * 400)),
    ],
)
def test_rational_slopes_are_exact(slope, texts):
    zero = Fraction(0)
    exact = Fraction(slope)
    for h in texts.split("; "):
        coupling = Expression(h, ["y"])
        variable = variables([(zero, zero)])
        value, (found,) = coupling.run(coupling.steps, variable)
        assert value == (0, 0)
        assert found == (exact, exact)


@pytest.mark.parametrize(
    ("h", "linear", "kinked"),
    [
        *((h, True, False) for h in ("2*y", "2**-1*y", "y**1", "exp(1)*y", "y/2", "abs(-2)*y")),
        *((h, False, False) for h in ("y + y**2", "exp(y) - 1", "y/(1 + y)", "y*y")),
        *((h, False, True) for h in ("abs(y)", "max(y, 2*y)", "clip(y, -1, 1)")),
        ("y + 0*abs(y**0)", True, True),
    ],
)
def test_linear_and_kinked_are_read_as_written(h, linear, kinked):
    """The two facts of the format page, and what the package reads."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    problem = Problem(network=network, coupling=h)
    found = read_coupling((h,), 1)
    assert (found.parts[0].degree <= 1) is linear
    assert found.kinked is kinked
    assert found.straight is (linear and not kinked)
    assert problem.is_linear == linear
    assert bool(problem.coupling.nonsmooth) == kinked


def test_partial_derivatives_of_a_vector_coupling():
    """h = (y1 + 3 y2, sin(y1) y2 - 2 y2): the matrix of slopes at 0 by hand."""
    slopes = read_coupling(("y1 + 3*y2", "sin(y1)*y2 - 2*y2"), 2).slopes
    expected = {(0, 0): (1, 1), (0, 1): (3, 3), (1, 1): (-2, -2)}
    assert slopes == expected


def test_a_divisor_far_from_1_is_no_obstacle_for_doubles():
    """Its square, which a derivative by the divisor would need, is beyond the range of doubles."""
    for h in ("1e160*y/1e160", "y*1e-160/1e-160"):
        coupling = Expression(h, ["y"])
        variable = variables([(1.0, 2.0)])
        (lo, hi), ((low, high),) = coupling.run(coupling.steps, variable)
        assert 0.999 < lo <= 1
        assert 2 <= hi < 2.001
        assert 0.999 < low <= 1 <= high < 1.001


# --- On floating-point numbers
# --------------------------------------------------------------------------------------
def pieces(name: str, count: int) -> list[tuple[float, float]]:
    """Intervals of all sizes, single numbers among them."""
    r = random.Random(name)
    found = []
    for _ in range(count):
        size = 10 ** r.uniform(-6, 1.5)
        first = (r.uniform(-size, size), r.uniform(-size, size))
        a, b = sorted(first)
        if name in ("log(y)", "sqrt(y)"):
            positive = (abs(a) + 1e-9, abs(b) + 1e-9)
            a, b = sorted(positive)
        found.append((a, a if r.random() < 0.2 else b))
    return found


def clipped(y: mpmath.mpf) -> mpmath.mpf:
    top = y**2 + mpmath.mpf(1) / 3
    return max(-1, min(2 * y, top))


def smooth_quotient(y: mpmath.mpf) -> mpmath.mpf:
    hump = mpmath.exp(-(y**2))
    top = mpmath.tanh(y) * hump
    bottom = 2 + mpmath.sin(3 * y)
    return top / bottom


def negative_power(y: mpmath.mpf) -> mpmath.mpf:
    base = y + mpmath.mpf(1) / 10
    return base**-3 + mpmath.mpf("0.1") * mpmath.pi * y


COMPOSED = {f"{name}(y)": known.value for name, known in KNOWN.items()}
COMPOSED |= {
    "min(y, y**2, 1 - y)": lambda y: min(y, y**2, 1 - y),
    "max(y**3 - y, -y/2)": lambda y: max(y**3 - y, -y / 2),
    "clip(2*y, -1, y**2 + 1/3)": clipped,
    "tanh(y)*exp(-y**2)/(2 + sin(3*y))": smooth_quotient,
    "(y + 1/10)**-3 + 0.1*pi*y": negative_power,
    "-y**4 + 7*y**5 - 1e-3": lambda y: -(y**4) + 7 * y**5 - mpmath.mpf("1e-3"),
}


@pytest.mark.parametrize("source", sorted(COMPOSED))
@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_enclosures_of_compositions_hold_random_points_and_all_their_secants(source, count):
    """Slopes of kinked functions are Clarke's: they bound every secant inside the interval."""
    r = random.Random(source)
    formula = Expression(source, ["y"])
    h = COMPOSED[source]
    seen = 0
    with mpmath.workprec(200):
        for a, b in pieces(source, count):
            try:
                value, slopes = formula.at(((a, b), (ONE,)))
            except Refused:
                continue
            slope = slopes[0] if slopes else (0.0, 0.0)
            points = []
            for _ in range(10):
                points.append(mpmath.mpf(r.uniform(a, b)))
            following = [mpmath.mpf(b), *points]
            for x, y in zip(points, following, strict=False):
                assert value[0] <= h(x) <= value[1]
                gap_allowed = mpmath.mpf(2) ** -150
                size = 1 + abs(h(x))
                gap = gap_allowed * size
                steps = [each * (y - x) for each in slope]
                step = h(y) - h(x)
                assert min(steps) - gap <= step <= max(steps) + gap
                seen += 1
    assert seen > 5 * count


NAN, INFINITE = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("lo", "hi"),
    [
        (1.0, 0.0),
        (-INFINITE, 0.0),
        (0.0, INFINITE),
        (NAN, 0.0),
        (0.0, NAN),
        (-Fraction(2**40000), Fraction(0)),
    ],
)
def test_what_is_no_interval_of_numbers_in_range_is_refused(lo, hi):
    with pytest.raises(Refused, match="leaves the range"):
        intervals.outward(lo, hi)


def assert_holds(interval: tuple[float, float], values: list[Fraction]) -> None:
    lo, hi = map(Fraction, interval)
    assert lo <= min(values)
    assert max(values) <= hi


def random_interval(r: random.Random) -> tuple[float, float]:
    one = r.uniform(-3, 3)
    other = r.uniform(-3, 3)
    return min(one, other), max(one, other)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 7, 10])
def test_arithmetic_is_rounded_outward(n):
    """Against exact rational arithmetic at the ends of random intervals."""
    r = random.Random(n)
    for _ in range(300):
        x = random_interval(r)
        y = random_interval(r)
        pairs = itertools.product(map(Fraction, x), map(Fraction, y))
        corners = list(pairs)
        values = [a * b for a, b in corners]
        assert_holds(intervals.times(x, y), values)
        values = [a + b for a, b in corners]
        assert_holds(intervals.added(x, y), values)
        powers = [Fraction(a) ** n for a in x]
        if x[0] < 0 < x[1]:
            powers.append(Fraction(0) ** n)
        assert_holds(intervals.power(x, n), powers)
        if not y[0] <= 0 <= y[1]:
            values = [a / b for a, b in corners]
            assert_holds(intervals.divided(x, y), values)


def test_products_of_known_signs_keep_them_where_floats_underflow():
    tiny = 5e-324
    found = intervals.times((tiny, 1.0), (tiny, 1.0))
    assert found[0] == 0
    found = intervals.times((-1.0, -tiny), (tiny, 1.0))
    assert found[1] == 0
    found = intervals.times((-tiny, 0.0), (0.0, tiny))
    assert found[0] < 0


def test_the_table_of_a_coupling_names_its_rising_and_falling_stretches():
    """sin rises on [-pi/2, pi/2] and falls to the left of it down to -3 pi/2."""
    coupling = read_coupling(("sin(y)",), 1)
    curve = Curve(coupling, False, -4.0, 1.0)
    ways = [cell.way for cell in curve.table if cell.way]
    assert ways == [-1, 1]
    rising = next(cell for cell in curve.table if cell.way == 1)
    assert rising.lo == pytest.approx(-mpmath.pi / 2, abs=2e-3)
    assert rising.lo >= -mpmath.pi / 2
