"""Couplings as bounded gains: the channels reproduce h exactly, and their ranges contain the
truth."""

from fractions import Fraction

import numpy as np
import pytest
from networks import linked
from regional_problems import PAPER, cycle, random_problem

from dobc_design.conditions.quadratic.sectors import (
    GainRange,
    build_sectors,
    enclose_ranges,
    gains_on,
    relied_differences,
)
from dobc_design.coupling.coupling import make_coupling
from dobc_design.errors import SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.loop.make import loop_of

TWO = Fraction(2)


def test_the_secant_gain_of_the_paper_on_two_is_that_of_the_theory():
    """Theory, section 9: [1.432332, 4.194528], widened by 1e-5 of it and a digit."""
    ((gain,),) = enclose_ranges(loop_of(cycle(3, 1)), radius=TWO)[0].entries
    assert 1.4322 < gain.lo <= Fraction((1 - np.exp(-2)) / 2 + 1) + Fraction(1, 10**12)
    assert Fraction((np.exp(2) - 1) / 2 + 1) - Fraction(1, 10**12) <= gain.hi < 4.19458


@pytest.mark.parametrize(
    "text", [PAPER, "tanh(y)", "y + y**3", "sin(2*y)", "clip(y, -1, 1)", "y*cos(3*y)"]
)
def test_gains_of_random_points_lie_in_the_range(text):
    """H(y)/y in floats at 2000 points."""
    coupling = make_coupling(text, dimension=1)
    ((gain,),) = gains_on(coupling, TWO)
    y = np.random.default_rng(0).uniform(-2, 2, 2000)[:, None]
    values = (coupling.value(y) / y).ravel()
    assert float(gain.lo) - 1e-9 <= values.min()
    assert values.max() <= float(gain.hi) + 1e-9
    assert float(gain.lo) > values.min() - 0.02
    assert float(gain.hi) < values.max() + 0.02


def test_a_coupling_of_vectors_has_mean_jacobians_in_its_range():
    """int_0^1 J(s y) ds at 300 points of the box, by Gauss quadrature of the Jacobian written out
    by hand."""
    coupling = make_coupling(["y1 + y2**3", "tanh(y2) - y1/2"], dimension=2)
    entries = gains_on(coupling, TWO)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    for y in np.random.default_rng(1).uniform(-2, 2, (300, 2)):
        z = (nodes + 1) / 2 * y[1]
        mean = np.array(
            [[1.0, weights @ (3 * z**2) / 2], [-0.5, weights @ (1 - np.tanh(z) ** 2) / 2]]
        )
        for c, d in np.ndindex(2, 2):
            assert float(entries[c][d].lo) - 1e-6 <= mean[c, d] <= float(entries[c][d].hi) + 1e-6
    assert entries[0][0] == Interval.point(1)
    assert entries[1][0] == Interval.point(Fraction(-1, 2))
    assert entries[0][1].contains(Interval(Fraction(0), Fraction(4)))  # of a sum, y2^3 / y2
    product = gains_on(make_coupling(["y1*y2", "y2"], dimension=2), TWO)
    assert product[0][0].contains(Interval(-TWO, TWO))


@pytest.mark.parametrize("seed", range(8))
def test_channels_with_the_true_gains_give_h_back(seed):
    """Theory, section 1: h(e) = -L(g(e)) e, for components and for vectors, weights included."""
    vector = seed % 2 == 1
    coupling = ["y1 + y2**2*y1/4", "y2/2 - y1"] if vector else "exp(y) - 1"
    problem = random_problem(seed, m=2, coupling=coupling)
    sectors = build_sectors(
        loop_of(problem), enclose_ranges(loop_of(problem), radius=TWO), radius=TWO
    )
    e = np.random.default_rng(seed).uniform(-0.9, 0.9, problem.n * 2)
    x = e.reshape(-1, 2)
    felt, wanted = np.zeros_like(e), np.zeros_like(x)
    for listener, speaker, weight in problem.network.modes["G0"]:
        wanted[listener] += float(weight) * problem.coupling.value(x[speaker] - x[listener])
    for channel in sectors.modes["G0"]:
        y = e[channel.plus] - e[channel.minus]
        other = e[channel.plus ^ 1] - e[channel.minus ^ 1]  # the other component of the same arc
        arc = (channel.target // 2, channel.plus // 2)
        weight = next(float(w) for i, j, w in problem.network.modes["G0"] if (i, j) == arc)
        c, d = channel.target % 2, channel.plus % 2
        if not vector:
            gain = weight * np.expm1(y) / y
        elif (c, d) == (0, 0):  # mean of 1 + (s y2)^2/4
            gain = weight * (1 + other**2 / 12)
        elif (c, d) == (0, 1):  # mean of s^2 y1 y2/2
            gain = weight * (y * other / 6)
        else:
            gain = weight * (0.5 if d == 1 else -1.0)
        assert float(channel.low) - 1e-6 <= gain <= float(channel.high) + 1e-6
        felt[channel.target] += gain * y
    assert np.allclose(felt, wanted.ravel(), atol=1e-12)


def test_a_linear_coupling_is_one_gain_for_every_radius_and_exceptions_have_their_own():
    problem = cycle(3, 1, coupling="2/3*y")
    (found,) = enclose_ranges(loop_of(problem), radius=None)
    assert found.entries == ((Interval.point(Fraction(2, 3)),),)
    channel = build_sectors(loop_of(problem), (found,), radius=None).modes["G"][0]
    assert channel.spread == 0

    problem = linked(
        [[1, 2, "1/2"], [2, 1], [2, 3]], coupling=PAPER, exceptions={(1, 0): "2*y"}, gains=1
    )
    ranges = enclose_ranges(loop_of(problem), radius=TWO)
    assert [(each.coupling, each.radius) for each in ranges] == [(0, 2), (1, 2)]
    channels = build_sectors(loop_of(problem), ranges, radius=TWO).modes["G"]
    by_arc = {(channel.target, channel.plus): channel for channel in channels}
    assert by_arc[1, 0].low == by_arc[1, 0].high == 2
    assert by_arc[0, 1].high == ranges[0].entries[0][0].hi / 2
    assert by_arc[1, 2].high == ranges[0].entries[0][0].hi


def test_a_radius_has_to_be_positive_or_left_out_if_linear_and_ranges_have_to_fit():
    problem = cycle(3, 1)
    with pytest.raises(SpecError, match="radius must be > 0; got 0"):
        enclose_ranges(loop_of(problem), radius=Fraction(0))
    with pytest.raises(SpecError, match="is not linear; got None"):
        enclose_ranges(loop_of(problem), radius=None)
    with pytest.raises(UndefinedError, match=r"\[-2, 2\]"):
        enclose_ranges(loop_of(cycle(3, 1, coupling="log(1 + y)")), radius=TWO)
    with pytest.raises(SpecError, match=r"needs a range of shape \(1, 1\) at the radius 2"):
        build_sectors(
            loop_of(problem), enclose_ranges(loop_of(problem), radius=Fraction(1)), radius=TWO
        )
    wide = GainRange(coupling=0, radius=TWO, entries=((Interval.point(1),) * 2,) * 2)
    with pytest.raises(SpecError, match=r"needs a range of shape \(1, 1\)"):
        build_sectors(loop_of(problem), (wide,), radius=TWO)


def test_ranges_rely_on_the_differences_of_arcs_and_components_that_are_not_linear():
    """Both directions of an arc count once; what is linear alone needs no radius."""
    problem = linked([[1, 2], [2, 1], [2, 3]], coupling=PAPER, exceptions={(1, 2): "2*y"}, gains=1)
    assert relied_differences(loop_of(problem)) == ((0, 1),)
    assert relied_differences(
        loop_of(linked([[1, 2]], coupling=["y1 + y1**3", "y2"], gains=1))
    ) == ((0, 2),)
    assert relied_differences(
        loop_of(linked([[1, 2]], coupling=["y1 + y1*y2**2", "y2"], gains=1))
    ) == (
        (0, 2),
        (1, 3),
    )
