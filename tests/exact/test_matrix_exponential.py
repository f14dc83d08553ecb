"""Discretisation enclosed by Arb: known exponentials lie inside, and Routh's test in intervals is never wrong."""

from __future__ import annotations

import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest

from dobc_design.errors import SpecError
from dobc_design.exact.interval import (
    Interval,
    cos,
    discretise,
    exp,
    interval_characteristic_polynomial,
    interval_routh,
    sin,
)
from dobc_design.exact.matrix import matrix
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.verdict import Verdict


def overlap(x: Interval, y: Interval) -> bool:
    return x.lo <= y.hi and y.lo <= x.hi


def test_a_harmonic_turns_by_its_angle():
    """exp([[0, w], [-w, 0]] T) = [[cos wT, sin wT], [-sin wT, cos wT]]; the mean of cos is sin(wT)/(wT)."""
    w, T = Fraction(2), Fraction(1, 10)
    found = discretise(matrix([[0, w], [-w, 0]]), T)
    angle = Interval.point(w * T)
    expected = ((cos(angle), sin(angle)), (-sin(angle), cos(angle)))
    for i in range(2):
        for j in range(2):
            assert overlap(found.transition[i][j], expected[i][j])
            assert found.transition[i][j].width < Fraction(1, 2**200)
    assert overlap(found.mean[0][0], sin(angle) * (1 / (w * T)))


def test_a_ramp_is_discretised_exactly():
    """exp([[0, 1], [0, 0]] T) = [[1, T], [0, 1]], mean [[1, T/2], [0, 1]]."""
    T = Fraction(3, 7)
    found = discretise(matrix([[0, 1], [0, 0]]), T)
    for got, want in zip(
        (*found.transition[0], *found.transition[1], *found.mean[0], *found.mean[1]),
        (1, T, 0, 1, 1, T / 2, 0, 1),
        strict=True,
    ):
        assert got.contains(Fraction(want))
        assert got.width < Fraction(1, 2**120)


def test_a_decay_is_the_exponential_function():
    found = discretise(matrix([["-7/2"]]), Fraction(2))
    assert overlap(found.transition[0][0], exp(Interval.point(-7)))
    assert float(found.mean[0][0].midpoint) == pytest.approx((1 - math.exp(-7)) / 7)


@pytest.mark.parametrize("seed", range(10))
def test_the_polynomial_encloses_the_exact_one(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    F = matrix([[Fraction(r.randint(-9, 9), 7) for _ in range(q)] for _ in range(q)])
    found = interval_characteristic_polynomial([[Interval.point(x) for x in row] for row in F])
    assert all(x.contains(y) for x, y in zip(found, characteristic_polynomial(F), strict=True))


@pytest.mark.parametrize("seed", range(30))
def test_routh_in_intervals_is_right_for_every_polynomial_inside(seed):
    """PROVED and REFUTED are compared with NumPy's roots of corners and of the middle."""
    r = Random(seed)
    width = Fraction(r.choice((0, 1, 10)), 100)
    middle = [Fraction(1)] + [Fraction(r.randint(-3, 40), 10) for _ in range(r.randint(1, 4))]
    answer = interval_routh([Interval(x - width, x + width) if n else Interval.point(x) for n, x in enumerate(middle)])
    signs = [[r.choice((-1, 0, 1)) for _ in middle] for _ in range(10)]
    for choice in signs:
        inside = [float(x + (width * s if n else 0)) for n, (x, s) in enumerate(zip(middle, choice, strict=True))]
        largest = max((z.real for z in np.roots(inside)), default=-1.0)
        if answer is Verdict.PROVED:
            assert largest < 1e-9
        elif answer is Verdict.REFUTED:
            assert largest > -1e-9


def test_an_interval_that_holds_zero_leaves_routh_undecided():
    tiny = Fraction(1, 10**30)
    assert interval_routh([Fraction(1), Interval(-tiny, tiny)]) is Verdict.UNDECIDED
    assert interval_routh([Fraction(1), Interval(tiny, 2 * tiny)]) is Verdict.PROVED
    assert interval_routh([Fraction(1), Interval(-2 * tiny, -tiny)]) is Verdict.REFUTED
    assert interval_routh([Interval(-tiny, tiny), Fraction(1)]) is Verdict.UNDECIDED


def test_a_period_that_is_not_positive_is_refused():
    for period in (0, -1):
        with pytest.raises(SpecError, match="period must be > 0"):
            discretise(matrix([[0]]), Fraction(period))
