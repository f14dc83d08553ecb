"""Directed rounding and flint's balls at their limits."""

from fractions import Fraction

import pytest
from flint import arb
from hypothesis import given
from hypothesis import strategies as st

from dobc_design.exact import interval as elementary
from dobc_design.exact.interval import height, round_down, round_up, sqrt_bounds


@given(st.fractions(), st.integers(1, 200))
def test_rounding_goes_the_right_way_by_less_than_one_unit(x, bits):
    """At most ``bits`` significant bits, and a relative error below 2^(1 - bits)."""
    low, high = round_down(x, bits), round_up(x, bits)
    assert low <= x <= high
    assert high - low <= abs(x) * Fraction(4, 2**bits)
    for end in (low, high):
        odd = abs(end.numerator) // ((end.numerator & -end.numerator) or 1)
        assert odd.bit_length() <= bits + 1
        assert round_down(end, bits + 1) == round_up(end, bits + 1) == end


def test_rounding_beyond_the_largest_exponent_keeps_its_direction():
    """A lower bound may fall to 2^65536 or to 0; an upper one beyond it does not exist."""
    huge, tiny = Fraction(3) ** 50_000, Fraction(1, 3**50_000)
    assert round_down(huge) == Fraction(2) ** 65_536
    assert round_up(-huge) == -(Fraction(2) ** 65_536)
    with pytest.raises(OverflowError, match=r"2\^65536"):
        round_up(huge)
    with pytest.raises(OverflowError, match=r"2\^65536"):
        round_down(-huge)
    assert (round_down(tiny), round_up(tiny)) == (0, Fraction(1, 2**65_536))
    assert (round_down(-tiny), round_up(-tiny)) == (-Fraction(1, 2**65_536), 0)


@given(st.fractions(min_value=0))
def test_root_bounds_hold_and_are_narrow(x):
    """Squares compared exactly."""
    low, high = sqrt_bounds(x)
    assert low * low <= x <= high * high
    assert high - low <= high / 2**120
    assert sqrt_bounds(x * x) == (x, x)


def test_height_is_the_longer_of_the_two():
    """Numerator or denominator."""
    assert (height(Fraction(7, 1024)), height(Fraction(-7)), height(Fraction(0))) == (11, 3, 1)


def test_a_ball_with_a_tiny_exponent_is_widened_and_not_written_out():
    """Trap met: arb.rad().fmpq() ends the process for tanh(10^5000), whose radius is 2^-(10^5000)."""
    low, high = elementary.bounds("tanh", Fraction(10) ** 5000)
    assert low < 1
    assert high == 1
    low, high = elementary._ends(arb((1, -(10**30))))
    assert low <= 0 < high < Fraction(1, 2**200_000)


@pytest.mark.parametrize("ball", [arb.nan(), arb.pos_inf(), arb((1, 10**30)), arb(0, (1, 10**30))])
def test_a_ball_without_finite_ends_is_refused(ball):
    """Trap met: Python's min and max drop nan in silence."""
    with pytest.raises(OverflowError, match="no finite enclosure"):
        elementary._ends(ball)
