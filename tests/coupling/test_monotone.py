"""Where a coupling rises and falls."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.coupling.expression import parse_expression
from dobc_design.exact.interval import UndefinedError


def profile_of(text: str, radius: str):
    return profile(Curve(parse_expression(text)), Fraction(radius))


@pytest.mark.parametrize("text", ["exp(y) - 1 + y", "tanh(y)", "y**3", "clip(y, -1, 1)", "y + sin(y)/2", "max(y, 2*y)"])
def test_monotone_couplings_are_one_rising_cell(text: str):
    found = profile_of(text, "9")
    assert found.is_nondecreasing
    assert found.tops == found.bottoms == ()


def test_sin_turns_at_odd_multiples_of_half_pi():
    """Maxima at -3 pi/2 and pi/2, minima at -pi/2 and 3 pi/2, each in a cell of 1e-6 with the value +-1 inside."""
    found = profile_of("sin(y)", "5")
    assert not found.is_nondecreasing
    for cells, value, places in ((found.tops, 1, (-1.5, 0.5)), (found.bottoms, -1, (-0.5, 1.5))):
        turning = [cell for cell in cells if cell.values.contains(value)]
        assert [round(float(cell.place.midpoint) / math.pi, 5) for cell in turning] == list(places)
        assert all(cell.values.width < 1e-9 for cell in turning)


def test_just_inside_half_pi_sin_rises_and_just_outside_it_does_not():
    assert profile_of("sin(y)", "1.5707963").is_nondecreasing
    assert not profile_of("sin(y)", "1.5708").is_nondecreasing


def test_a_corner_between_rising_and_falling_is_a_top():
    """min(y, 1 - y) turns at 1/2; its kink may be met exactly or enclosed."""
    found = profile_of("min(y, 1 - y)", "2")
    assert any(cell.place.contains(Fraction(1, 2)) and cell.values.contains(Fraction(1, 2)) for cell in found.tops)


def test_cells_cover_the_interval_without_gaps():
    found = profile_of("sin(3*y)*exp(-y)", "2")
    assert found.cells[0].place.lo == -2
    assert found.cells[-1].place.hi == 2
    assert all(left.place.hi == right.place.lo for left, right in zip(found.cells, found.cells[1:], strict=False))


def test_a_coupling_that_is_not_defined_so_far_out_is_refused():
    with pytest.raises(UndefinedError, match=r'h = "log\(1 \+ y\)" cannot be enclosed on \[-1, 1\]: log'):
        profile_of("log(1 + y)", "1")
