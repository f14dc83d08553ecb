"""The numbers of Krawczyk's test: f at a point, and slopes that hold every difference quotient."""

from fractions import Fraction
from random import Random

import numpy as np
import pytest
from regional_problems import field, listening_pair, random_folded

from dobc_design.conditions.equilibrium.decide import Equilibrium, field_at, slopes_on, why_not
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.loop.make import loop_of

F = Fraction


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", range(8))
def test_the_field_is_that_of_the_arcs_one_by_one(seed: int, m: int):
    """(22) with eps = 0: weights, exceptions, matrix gains; offsets take no part, e has them taken
    off."""
    problem = random_folded(seed, m=m)
    r = Random(seed)
    for _ in range(5):
        point = tuple(F(r.randint(-3000, 3000), 1000) for _ in range(problem.n * m))
        truth = field(problem, "G", np.array(point, dtype=float))
        found = field_at(loop_of(problem), "G", point)
        answer = [float(side.midpoint) for side in found]
        assert answer == pytest.approx(truth, rel=1e-12, abs=1e-12)
        assert max(side.width for side in found) < F(1, 10**25)


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", range(8))
def test_the_slopes_hold_every_difference_on_the_box(seed: int, m: int):
    """f(a) - f(b) lies in F (a - b) for a, b in the box, across kinks too (mean value theorem,
    Clarke)."""
    problem = random_folded(seed, m=m)
    r = Random(f"box {seed}")
    size = problem.n * m
    middle = [F(r.randint(-2000, 2000), 1000) for _ in range(size)]
    box = tuple(Interval(c - F(1, 5), c + F(1, 5)) for c in middle)
    slopes = slopes_on(loop_of(problem), "G", box)
    low = np.zeros((size, size))
    high = np.zeros((size, size))
    for place, slope in slopes.items():
        low[place], high[place] = slope.floats()
    for _ in range(20):
        a, b = (np.array([float(c) + r.uniform(-0.2, 0.2) for c in middle]) for _ in range(2))
        change = field(problem, "G", a) - field(problem, "G", b)
        step = a - b
        least = np.minimum(low * step, high * step).sum(axis=1)
        most = np.maximum(low * step, high * step).sum(axis=1)
        assert np.all(least - 1e-9 <= change)
        assert np.all(change <= most + 1e-9)


def test_what_cannot_be_a_claim_is_refused_and_a_coupling_that_is_not_defined_on_the_box_raises():
    problem = listening_pair("log(1 + y)")
    box = (Interval(F(1), F(2)), Interval(F(0), F(1)))
    with pytest.raises(UndefinedError, match="log"):
        slopes_on(loop_of(problem), "G", box)

    side = Interval(F(1), F(2))
    box = (side, Interval.point(1))
    with pytest.raises(SpecError, match="longer than 0"):
        Equilibrium(mode="G", box=box)
    with pytest.raises(ShapeError, match="one interval per component"):
        Equilibrium(mode="G", box=())
    claim = Equilibrium(mode="G", box=(side,))
    with pytest.raises(ShapeError, match="must have 2 sides"):
        why_not(loop_of(listening_pair()), claim)
    claim = Equilibrium(mode="H", box=(side, side))
    with pytest.raises(SpecError, match="mode must be one"):
        why_not(loop_of(listening_pair()), claim)
