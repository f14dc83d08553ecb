"""Trade-offs: every curve against a closed form, and what shows them."""

import sys
from fractions import Fraction

import pytest
from networks import BOX, CONSTANT, NOISY_BOX, ring, star

import dobc_design as dd
from dobc_design.errors import SpecError


@pytest.mark.slow
def test_the_gain_curve_of_a_linear_ring_is_proved_and_follows_the_closed_form():
    """One hard pin, h = y: k = b + (1 - b)^-(n - 1) - 1 at the rate b; b is 0.5 % faster, and k has
    three digits."""
    found = dd.trade_off(ring(4, region=BOX), points=3)
    assert len(found.points) >= 2
    for point in found.points:
        rates = (point.x, 1.005 * point.x)
        least, most = (b + (1 - b) ** -3 - 1 for b in rates)
        assert least <= point.y <= 1.01 * most
        assert point.proved
    assert list(found.points) == sorted(found.points, key=lambda point: point.x)


def test_near_the_consensus_the_chosen_point_lies_on_the_gain_curve():
    """Two agents that listen to each other, one pinned: 2 (1 - b) (1 + k - b) = 2 at the boundary
    of V = e'e."""
    pair = ring(2)
    chosen = dd.design(pair, rate="0.2")
    found = dd.trade_off(pair, design=chosen, points=3)
    assert len(found.points) == 3
    for point in found.points:
        pull = 1 / (1 - point.x)
        expected = pull - 1 + point.x
        assert point.y == pytest.approx(expected, rel=0.02)
    assert found.chosen.y == float(chosen.cost or 0)
    assert found.chosen.y == pytest.approx(1 / (1 - found.chosen.x) - 1 + found.chosen.x, rel=0.02)


def test_the_pin_curve_of_a_star_jumps_when_every_leaf_is_held():
    """Leaves return at 1 until each has its own pin: before, a further pin buys nothing."""
    found = dd.trade_off(star(4, region=BOX), curve="pins", max_gain=5)
    answer = [point.x for point in found.points]
    assert answer == [1, 2, 3, 4]
    answer = [point.y for point in found.points[:3]]
    assert answer == pytest.approx([1, 1, 1], rel=0.03)
    assert found.points[3].y == pytest.approx(5, rel=0.03)
    assert "from 3 to 4 pins" in found.sensitivity[0]


def test_the_noise_curve_of_a_constant_disturbance_is_w_itself():
    """A = 0, C = 1: the error decays at W and noise reaches dhat with the gain s W / (s + W) <
    W."""
    problem = ring(3, region=NOISY_BOX, exosystem=CONSTANT)
    found = dd.trade_off(problem, curve="noise", points=2)
    assert len(found.points) == 2
    for point in found.points:
        assert point.y == pytest.approx(point.x, rel=1e-6)
        assert point.y >= point.x * (1 - 1e-12)


@pytest.fixture(scope="module")
def small():
    return dd.trade_off(ring(2, exosystem=CONSTANT), curve="noise", points=2)


def test_a_trade_off_becomes_a_table(small):
    pytest.importorskip("pandas", reason="needs pandas: pip install dobc_design[store]")
    table = small.to_pandas()
    assert list(table.columns)[-3:] == ["pinned", "proved", "chosen"]
    assert len(table) == 2


def test_without_pandas_the_cure_is_named(small, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(SpecError, match="pip install"):
        small.to_pandas()


WRONG = [
    {"curve": "speed"},
    {"points": 1},
    {"points": True},
    {"curve": "noise"},
    {"curve": "pins", "allowed": ["2"]},
]


@pytest.mark.parametrize("changes", WRONG)
def test_wrong_arguments_are_named(changes):
    with pytest.raises(SpecError) as caught:
        dd.trade_off(star(3), **changes)
    assert caught.value.key == list(changes)[-1]


def test_the_chosen_point_is_that_of_the_design():
    problem = ring(2, region=BOX)
    design = dd.design(problem, rate="0.2")
    found = dd.trade_off(problem, curve="pins", design=design, points=2)
    assert found.chosen.x == 1
    assert found.chosen.y == design.rate
    assert Fraction(found.chosen.y) >= Fraction("0.2")
