"""First and second derivatives over the expression tree; mpmath's numerical derivatives are the oracle."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import pytest
from random_couplings import BITS, OUTER, exact, truth

from dobc_design.coupling.algebra import ONE, ZERO, GradientAlgebra, Jet
from dobc_design.coupling.expression import parse_expression
from dobc_design.coupling.tree import evaluate
from dobc_design.exact.interval import Interval


def jet_of(text: str, Y: Interval, *, restricted: bool = False) -> Jet:
    algebra = GradientAlgebra(1, second=True, restricted=restricted)
    return evaluate(parse_expression(text).node, algebra.variables((Y,)), algebra)


@pytest.mark.parametrize("pattern", OUTER)
@pytest.mark.parametrize("inner", ["y", "sin(2*y) + y**2", "y/(2 + y)"])
def test_jets_at_points_are_value_slope_and_curvature(pattern: str, inner: str):
    """Every function of the grammar, alone and composed, at points off their kinks."""
    text = pattern.replace("#", f"({inner})")
    h, slope = truth(text)
    for y in (Fraction(-3, 7), Fraction(2, 9), Fraction(5, 8)):
        found = jet_of(text, Interval.point(y))
        with mpmath.workprec(BITS):
            at = mpmath.mpf(y.numerator) / y.denominator
            second = mpmath.diff(slope, at)
            wanted = [exact(mpmath.mpf(x)) for x in (h(at), slope(at), second)]
        assert found.curvature is not None
        for enclosure, value in zip((found.value, found.slope, found.curvature), wanted, strict=True):
            slack = Fraction(1, 10**25) * (1 + abs(value))
            assert enclosure.lo - slack <= value <= enclosure.hi + slack
            assert enclosure.width <= slack


@pytest.mark.parametrize("text", ["abs(y)", "max(y, 2*y)", "min(y, y/2)", "clip(y, 0, 1)"])
def test_a_kink_leaves_the_curvature_open(text: str):
    around = jet_of(text, Interval(Fraction(-1, 2), Fraction(1, 2)))
    assert around.curvature is None
    assert around.slope.width > 0


def test_a_kink_at_the_end_is_seen_unless_the_interval_is_all_there_is():
    right = Interval(0, 1)
    assert jet_of("abs(y)", right).slope == Interval(-1, 1)
    assert jet_of("abs(y)", right, restricted=True) == Jet(right, (ONE,), ZERO)


def test_a_constant_has_slope_zero_where_its_function_has_none():
    """sqrt(0)*y and (1 - 1)**(1/2) + y are fine."""
    assert jet_of("sqrt(0)*y + y", Interval(-1, 1)).slope == Interval.point(1)


def test_powers_zero_and_one_need_no_reciprocal():
    """y**1 at y = 0, whose second derivative would be 0 * y**-1."""
    Y = Interval(-1, 1)
    assert jet_of("y**1 + y**0", Y) == Jet(Interval(0, 2), (ONE,), ZERO)
    assert jet_of("y**2", Y).curvature == Interval.point(2)
