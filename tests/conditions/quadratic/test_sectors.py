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


def sectors_of(problem, ranges, radius=TWO):
    return build_sectors(loop_of(problem), ranges, radius=radius)


def ranges_of(problem, radius=TWO):
    return enclose_ranges(loop_of(problem), radius=radius)


def relied_on(arcs, coupling, **more):
    problem = linked(arcs, coupling=coupling, gains=1, **more)
    loop = loop_of(problem)
    return relied_differences(loop)


def test_the_secant_gain_of_the_paper_on_two_is_that_of_the_theory():
    """Theory, section 9: [1.432332, 4.194528], widened by 1e-5 of it and a digit."""
    ranges = ranges_of(cycle(3, 1))[0]
    ((gain,),) = ranges.entries
    lowest = Fraction((1 - np.exp(-2)) / 2 + 1)
    highest = Fraction((np.exp(2) - 1) / 2 + 1)
    rounding = Fraction(1, 10**12)
    assert 1.4322 < gain.lo <= lowest + rounding
    assert highest - rounding <= gain.hi < 4.19458


@pytest.mark.parametrize(
    "text", [PAPER, "tanh(y)", "y + y**3", "sin(2*y)", "clip(y, -1, 1)", "y*cos(3*y)"]
)
def test_gains_of_random_points_lie_in_the_range(text):
    """H(y)/y in floats at 2000 points."""
    coupling = make_coupling(text, dimension=1)
    ((gain,),) = gains_on(coupling, TWO)
    rng = np.random.default_rng(0)
    drawn = rng.uniform(-2, 2, 2000)
    y = drawn[:, None]
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
    drawn = np.random.default_rng(1)
    for y in drawn.uniform(-2, 2, (300, 2)):
        z = (nodes + 1) / 2 * y[1]
        cubed = weights @ (3 * z**2) / 2
        bent = weights @ (1 - np.tanh(z) ** 2) / 2
        mean = np.array([[1.0, cubed], [-0.5, bent]])
        for c, d in np.ndindex(2, 2):
            gain = entries[c][d]
            lower = float(gain.lo) - 1e-6
            assert lower <= mean[c, d] <= float(gain.hi) + 1e-6
    assert entries[0][0] == Interval.point(1)
    assert entries[1][0] == Interval.point(Fraction(-1, 2))
    first_entry = entries[0][1]
    expected = Interval(Fraction(0), Fraction(4))
    assert first_entry.contains(expected)  # of a sum, y2^3 / y2
    product = gains_on(make_coupling(["y1*y2", "y2"], dimension=2), TWO)
    assert product[0][0].contains(Interval(-TWO, TWO))


@pytest.mark.parametrize("seed", range(8))
def test_channels_with_the_true_gains_give_h_back(seed):
    """Theory, section 1: h(e) = -L(g(e)) e, for components and for vectors, weights included."""
    vector = seed % 2 == 1
    coupling = ["y1 + y2**2*y1/4", "y2/2 - y1"] if vector else "exp(y) - 1"
    problem = random_problem(seed, m=2, coupling=coupling)
    sectors = sectors_of(problem, ranges_of(problem))
    rng = np.random.default_rng(seed)
    e = rng.uniform(-0.9, 0.9, problem.n * 2)
    x = e.reshape(-1, 2)
    felt = np.zeros_like(e)
    wanted = np.zeros_like(x)
    weights = {}
    for listener, speaker, weight in problem.network.modes["G0"]:
        weights[listener, speaker] = float(weight)
        difference = x[speaker] - x[listener]
        pull = problem.coupling.value(difference)
        wanted[listener] += float(weight) * pull
    for channel in sectors.modes["G0"]:
        y = e[channel.plus] - e[channel.minus]
        other = e[channel.plus ^ 1] - e[channel.minus ^ 1]  # the other component of the same arc
        listener, c = divmod(channel.target, 2)
        speaker, d = divmod(channel.plus, 2)
        weight = weights[listener, speaker]
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
    (found,) = ranges_of(problem, None)
    expected = ((Interval.point(Fraction(2, 3)),),)
    assert found.entries == expected
    channel = sectors_of(problem, (found,), None).modes["G"][0]
    assert channel.spread == 0

    arcs = [[1, 2, "1/2"], [2, 1], [2, 3]]
    exceptions = {(1, 0): "2*y"}
    problem = linked(arcs, coupling=PAPER, exceptions=exceptions, gains=1)
    ranges = ranges_of(problem)
    answer = [(each.coupling, each.radius) for each in ranges]
    expected = [(0, 2), (1, 2)]
    assert answer == expected
    channels = sectors_of(problem, ranges).modes["G"]
    by_arc = {(channel.target, channel.plus): channel for channel in channels}
    ((gain,),) = ranges[0].entries
    assert by_arc[1, 0].low == by_arc[1, 0].high == 2
    assert by_arc[0, 1].high == gain.hi / 2
    assert by_arc[1, 2].high == gain.hi


def test_a_radius_has_to_be_positive_or_left_out_if_linear_and_ranges_have_to_fit():
    problem = cycle(3, 1)
    with pytest.raises(SpecError, match="radius must be > 0; got 0"):
        ranges_of(problem, Fraction(0))
    with pytest.raises(SpecError, match="is not linear; got None"):
        ranges_of(problem, None)
    with pytest.raises(UndefinedError, match=r"\[-2, 2\]"):
        ranges_of(cycle(3, 1, coupling="log(1 + y)"))
    narrow = ranges_of(problem, Fraction(1))
    with pytest.raises(SpecError, match=r"needs a range of shape \(1, 1\) at the radius 2"):
        sectors_of(problem, narrow)
    entries = ((Interval.point(1),) * 2,) * 2
    wide = GainRange(coupling=0, radius=TWO, entries=entries)
    with pytest.raises(SpecError, match=r"needs a range of shape \(1, 1\)"):
        sectors_of(problem, (wide,))


def test_ranges_rely_on_the_differences_of_arcs_and_components_that_are_not_linear():
    """Both directions of an arc count once; what is linear alone needs no radius."""
    linear = {(1, 2): "2*y"}
    arcs = [[1, 2], [2, 1], [2, 3]]
    found = relied_on(arcs, PAPER, exceptions=linear)
    assert found == ((0, 1),)
    found = relied_on([[1, 2]], ["y1 + y1**3", "y2"])
    assert found == ((0, 2),)
    found = relied_on([[1, 2]], ["y1 + y1*y2**2", "y2"])
    expected = ((0, 2), (1, 3))
    assert found == expected
