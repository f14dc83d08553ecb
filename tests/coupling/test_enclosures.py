"""Enclosures of h, h' and the secant gain: they contain the truth, and are tight."""

import math
from fractions import Fraction
from itertools import pairwise
from random import Random
from typing import Any

import mpmath
import pytest
from couplings import BITS, OUTER, coupling_text, exact, holds, outside, true_values, truth

from dobc_design.coupling.enclosures import (
    Curve,
    profile,
    secant,
    secant_range,
    slope_form,
    tight_range,
    value_form,
)
from dobc_design.coupling.expression import parse_expression
from dobc_design.coupling.tree import ONE, ZERO, GradientAlgebra, Jet, evaluate
from dobc_design.exact.interval import Interval, UndefinedError

TWO = Interval(Fraction(-2), Fraction(2))
TOLERANCE = Fraction(1, 10**6)


def value_range(h: Curve, Y: Interval, tolerance: Fraction = TOLERANCE) -> Interval:
    return tight_range(h, value_form, Y, tolerance=tolerance)


def slope_range(h: Curve, Y: Interval, tolerance: Fraction = TOLERANCE) -> Interval:
    return tight_range(h, slope_form, Y, tolerance=tolerance, what="h'")


def curve(text: str) -> Curve:
    return Curve(parse_expression(text))


GAINS: list[Any] = [
    ("exp(y) - 1 + y", (1 - math.exp(-2)) / 2 + 1, (math.exp(2) - 1) / 2 + 1),
    ("y + y**3", 1, 5),
    ("clip(y, -1, 1)", 0.5, 1),
    ("sqrt(2 + y) - sqrt(2)", (2 - math.sqrt(2)) / 2, math.sqrt(2) / 2),
    ("atan(y)*(2 + cos(y))", math.atan(2) * (2 + math.cos(2)) / 2, 3),
]


@pytest.mark.parametrize(("text", "low", "high"), GAINS)
def test_secant_gains_on_minus_two_to_two_are_those_of_the_theory(
    text: str, low: float, high: float
):
    """Theory, section 9: within 1e-3, and the truth inside."""
    found = secant_range(curve(text), TWO)
    rounding = Fraction(1, 10**12)  # of the closed forms
    assert low - 1e-3 < found.lo <= Fraction(low) + rounding
    assert Fraction(high) - rounding <= found.hi < high + 1e-3


SLOPES: list[Any] = []


def slope(text: str, low: float, high: float) -> None:
    SLOPES.append((text, low, high))


slope("exp(y) - 1 + y", 1 + math.exp(-2), 1 + math.exp(2))
slope("abs(y) + 2*y", 1, 3)
slope("clip(y, -1, 1)", 0, 1)
slope("y/(2 + y**2)", -1 / 18, 0.5)


@pytest.mark.parametrize(("text", "low", "high"), SLOPES)
def test_slopes_are_tight_and_clarkes_at_kinks(text: str, low: float, high: float):
    """Closed forms of h'."""
    found = slope_range(curve(text), TWO)
    assert low - 1e-5 < found.lo <= low + 1e-12
    assert high - 1e-12 <= found.hi < high + 1e-5


def test_slopes_are_enclosed_as_tightly_as_requested_where_the_curvature_changes_sign():
    """tanh on [-1/1000, 1]: h' is 1 at 0 and 1 - tanh(1)^2 at 1."""
    low_end = Fraction(-1, 1000)
    found = slope_form(curve("tanh(y)"), Interval(low_end, Fraction(1)))
    slope_at_end = 1 - math.tanh(1) ** 2
    assert found.lo <= slope_at_end < 1 <= found.hi
    # y/(2 + y^2) has its extremes +-1/(2 sqrt 2) inside; natural interval arithmetic gives +-1.
    truth = 1 / (2 * math.sqrt(2))
    fine = Fraction(1, 10**3)
    finest = Fraction(1, 10**8)
    for tolerance in (Fraction(1, 10), fine, finest):
        found = value_range(curve("y/(2 + y**2)"), TWO, tolerance=tolerance)
        room = 1.01 * float(tolerance)
        assert truth <= found.hi <= truth + room
        assert -truth - room <= found.lo <= -truth


def test_the_secant_gain_at_zero_is_the_slope_and_a_kink_at_the_end_counts_for_the_slope_alone():
    """g(0) = h'(0), exactly; at a kink both sides' slopes."""
    zero = Interval.point(0)
    assert secant(curve("exp(y) - 1 + y"), zero).value == Interval.point(2)
    assert secant(curve("max(y, 2*y)"), zero).value == Interval(1, 2)
    # clip(y, -1, 1) is y on [-1, 1]: its gain is 1 there, while Clarke's slope at the ends is [0,
    # 1].
    one = Interval(-1, 1)
    assert secant_range(curve("clip(y, -1, 1)"), one) == Interval.point(1)
    assert slope_range(curve("clip(y, -1, 1)"), one) == Interval(0, 1)


UNDEFINED: list[Any] = [
    ("log(1 + y)", "log"),
    ("sqrt(1 + y) - 1", "sqrt"),
    ("tan(y)", "tan"),
    ("1/(1 - y) - 1", "division"),
]


@pytest.mark.parametrize(("text", "function"), UNDEFINED)
@pytest.mark.parametrize("ranged", [value_range, slope_range, secant_range])
def test_a_function_that_is_not_defined_is_refused_by_name_and_interval(
    text: str, function: str, ranged
):
    message = rf"cannot be enclosed on \[-2, 2\]: near y = .*{function}"
    with pytest.raises(UndefinedError, match=message):
        ranged(curve(text), TWO)


def test_a_slope_without_bound_is_refused_though_the_value_is_defined():
    """sqrt at the end of its domain."""
    Y = Interval(-1, 1)
    assert value_range(curve("sqrt(1 + y) - 1"), Y).lo == -1
    with pytest.raises(UndefinedError, match=r"h' of h = .* sqrt has no bounded slope"):
        slope_range(curve("sqrt(1 + y) - 1"), Y)


# SymPy takes long with the first text of turn 16
TURNS = [*range(0, 16, 2), 16 + len(OUTER), 18, 20]


@pytest.mark.parametrize("turn", TURNS)
def test_random_points_lie_inside_the_enclosures(turn: int):
    """Every function of the grammar, alone and composed, against 200-bit arithmetic."""
    assert outside(coupling_text(turn), Random(f"enclosures {turn}"), 15) == []


@pytest.mark.parametrize("turn", TURNS)
def test_derivatives_of_the_secant_gain_bound_its_differences(turn: int):
    """g(b) - g(a) = g'(c) (b - a) for the g' that rows are decided with."""
    r = Random(turn)
    for round_number in range(2):
        text = coupling_text(turn + len(OUTER) * round_number)
        lo = Fraction(r.randint(-1500, 1400), 1000)
        Y = Interval(lo, lo + Fraction(r.randint(1, 300), 1000))
        slope = secant(curve(text), Y).slope
        if slope is None:
            continue
        parts = [Fraction(r.randint(0, 1000), 1000) for _ in range(6)]
        places = {Y.lo + Y.width * part for part in parts}
        places.discard(Fraction(0))  # where the gain is no quotient
        for y, z in pairwise(sorted(places)):
            _, _, gain = true_values(text, y)
            _, _, other = true_values(text, z)
            assert holds(slope, (other - gain) / (z - y))


def jet_of(text: str, Y: Interval, *, restricted: bool = False) -> Jet:
    algebra = GradientAlgebra(1, second=True, restricted=restricted)
    variables = algebra.variables((Y,))
    return evaluate(parse_expression(text).node, variables, algebra)


COMPOSED = "sin(2*y) + y**2"
# SymPy takes long to see which of these is the least
LONG = ("min(#, 2*(#), 1)", "clip(#, -1/2, 3/4)")
TWICE = [pytest.param(each, COMPOSED, marks=[pytest.mark.slow] * (each in LONG)) for each in OUTER]


@pytest.mark.parametrize(("pattern", "inner"), [*((each, "y") for each in OUTER), *TWICE])
def test_jets_at_points_are_value_slope_and_curvature(pattern: str, inner: str):
    """Every function of the grammar, alone and composed, at points off their kinks."""
    text = pattern.replace("#", f"({inner})")
    h, slope = truth(text)
    for y in (Fraction(-3, 7), Fraction(2, 9), Fraction(5, 8)):
        found = jet_of(text, Interval.point(y))
        with mpmath.workprec(BITS):
            at = mpmath.mpf(y.numerator) / y.denominator
            curvature = mpmath.diff(slope, at)
            values = [h(at), slope(at), curvature]
            wanted = [exact(mpmath.mpf(x)) for x in values]
        assert found.curvature is not None
        enclosures = (found.value, found.slope, found.curvature)
        for enclosure, value in zip(enclosures, wanted, strict=True):
            slack = Fraction(1, 10**25) * (1 + abs(value))
            assert enclosure.lo - slack <= value <= enclosure.hi + slack
            assert enclosure.width <= slack


@pytest.mark.parametrize("text", ["abs(y)", "max(y, 2*y)", "min(y, y/2)", "clip(y, 0, 1)"])
def test_a_kink_leaves_the_curvature_open(text: str):
    minus_half = Fraction(-1, 2)
    around = jet_of(text, Interval(minus_half, Fraction(1, 2)))
    assert around.curvature is None
    assert around.slope.width > 0


def test_a_constant_has_slope_zero_where_its_function_has_none():
    """sqrt(0)*y and (1 - 1)**(1/2) + y are fine."""
    jet_found = jet_of("sqrt(0)*y + y", Interval(-1, 1))
    assert jet_found.slope == Interval.point(1)


def test_powers_zero_and_one_need_no_reciprocal():
    """y**1 at y = 0, whose second derivative would be 0 * y**-1."""
    Y = Interval(-1, 1)
    expected = Jet(Interval(0, 2), (ONE,), ZERO)
    assert jet_of("y**1 + y**0", Y) == expected
    assert jet_of("y**2", Y).curvature == Interval.point(2)


def profile_of(text: str, radius: str):
    return profile(Curve(parse_expression(text)), Fraction(radius))


@pytest.mark.parametrize(
    "text", ["exp(y) - 1 + y", "tanh(y)", "y**3", "clip(y, -1, 1)", "y + sin(y)/2", "max(y, 2*y)"]
)
def test_monotone_couplings_are_one_rising_cell(text: str):
    found = profile_of(text, "9")
    assert found.is_nondecreasing
    assert found.tops == found.bottoms == ()


def test_sin_turns_at_odd_multiples_of_half_pi():
    """Maxima at -3 pi/2 and pi/2, minima at -pi/2 and 3 pi/2, each in a cell of 1e-6 with the value
    +-1 inside."""
    found = profile_of("sin(y)", "5")
    assert not found.is_nondecreasing
    tops = (found.tops, 1, [-1.5, 0.5])
    bottoms = (found.bottoms, -1, [-0.5, 1.5])
    turns = tops, bottoms
    for cells, value, expected in turns:
        turning = [cell for cell in cells if cell.values.contains(value)]
        places = []
        for cell in turning:
            places.append(float(cell.place.midpoint) / math.pi)
        assert [round(place, 5) for place in places] == expected
        assert all(cell.values.width < 1e-9 for cell in turning)
    assert profile_of("sin(y)", "1.5707963").is_nondecreasing
    assert not profile_of("sin(y)", "1.5708").is_nondecreasing


def test_a_corner_is_a_top_and_what_is_not_defined_so_far_out_is_refused():
    """min(y, 1 - y) turns at 1/2; its kink may be met exactly or enclosed."""
    half = Fraction(1, 2)
    found = profile_of("min(y, 1 - y)", "2")
    assert any(cell.place.contains(half) and cell.values.contains(half) for cell in found.tops)
    message = r'h = "log\(1 \+ y\)" cannot be enclosed on \[-1, 1\]: log'
    with pytest.raises(UndefinedError, match=message):
        profile_of("log(1 + y)", "1")
