"""What is proposed for arcs: hulls, tangents, how they are shared out."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from arc_wise import claimed
from networks import around, linked

from dobc_design import Problem
from dobc_design.conditions.arcs.decide import open_terms
from dobc_design.conditions.arcs.propose import (
    Network,
    Search,
    Z,
    _hull,
    network_of,
    shared_out,
)
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.make import loop_of

F = Fraction
FUNCTIONS: dict[str, Any] = {
    "sin(y)": np.sin,
    "y + sin(3*y)": lambda y: y + np.sin(3 * y),
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "-y": lambda y: -y,
}
PAIRS = ((1.0, 1.0), (0.4, 1.0), (1.0, 0.3))


def taken_on_the_disc(h: Any, rho: float, d: tuple[float, float], z: np.ndarray) -> np.ndarray:
    """The most of 2 d_i x h(y - x) over r^2 on all rays with shares z of the disc, over r up to
    rho."""
    x, y = np.sqrt((1 - z) / d[0]), np.sqrt(z / d[1])
    most = np.full(len(z), -np.inf)
    for r in np.linspace(0.01, 1, 150) * rho:
        for sign in (1, -1):
            for turn in (1, -1):
                taken = 2 * d[0] * turn * x * h(r * turn * (sign * y - x)) / r
                most = np.maximum(most, taken)
    return most


@pytest.mark.parametrize("text", FUNCTIONS)
@pytest.mark.parametrize("d", PAIRS)
def test_the_hull_is_concave_and_lies_above_what_arcs_take(text: str, d: tuple[float, float]):
    h = make_coupling(text, dimension=1)
    hull = _hull(h, 1.7, d, loose=False)
    rise = np.diff(hull) / np.diff(Z)
    assert np.all(np.diff(rise) <= 1e-6 * np.abs(rise).max())
    taken = taken_on_the_disc(FUNCTIONS[text], 1.7, d, Z)
    assert np.all(hull >= taken - 2e-3 * np.abs(taken).max())
    loose = _hull(h, 1.7, d, loose=True)
    assert np.all(loose >= np.maximum(hull, 0) - 1e-12)


def network(problem: Problem, rho: float) -> Network:
    loop = loop_of(problem)
    pull = np.zeros(loop.n)
    for i, gain in loop.pulls.gains.items():
        pull[i] = 2 * float(gain[0][0])
    return network_of(loop, "G", np.ones(loop.n), rho, pull)


@pytest.mark.parametrize("text", FUNCTIONS)
def test_tangents_lie_nowhere_below_the_hull_and_touch_it(text: str):
    net = network(linked([[1, 2]], 2, text, gains=9), 1.5)
    lines = net.lines(0)
    hull = net.hulls[0]
    for own, other in zip(lines.own[0][1:-1:16], lines.other[0][1:-1:16], strict=True):
        above = own * (1 - Z) + other * Z - hull
        assert above.min() > -2e-3 * np.abs(hull).max()
        assert above.min() < 2e-3 * np.abs(hull).max()


def test_what_is_left_is_the_same_for_all_agents_of_a_connected_part():
    net = network(linked(around(6), 6, "sin(y)", gains={1: 3, 4: 1}), 1.0)
    found = shared_out(net, None)
    assert found.least > 0
    assert np.ptp(found.left) < 0.01 * net.pull.max()


def test_no_other_shares_of_a_cycle_leave_the_least_well_off_more():
    """Against tangents at random places: none does better by 1 %."""
    net = network(linked(around(5), 5, "exp(y) - 1 + y", gains={1: 3}), 2.0)
    best = shared_out(net, None)
    rng = np.random.default_rng(5)
    lines = net.lines(0)
    for width in (0.05, 0.3, 1.0, 3.0):
        for _ in range(300):
            tried = net.shares(lines, best.y + rng.normal(0, width, 5))
            assert tried.least <= best.least + 0.01 * abs(best.least)


def test_parts_that_do_not_hear_each_other_are_balanced_one_by_one():
    arcs = [*around(3), [4, 5], [5, 4]]
    net = network(linked(arcs, 5, "tanh(y)", gains={1: 6, 4: 2}), 0.5)
    found = shared_out(net, None)
    assert list(net.part) == [0, 0, 0, 1, 1]
    for part in (found.left[:3], found.left[3:]):
        assert np.ptp(part) < 0.02 * net.pull.max()
    assert found.left[:3].mean() != pytest.approx(found.left[3:].mean(), rel=0.05)


@pytest.mark.parametrize("d", [(1, 1, 1, 1), (1, F(1, 2), F(3, 4), F(5, 8))])
def test_what_is_proposed_is_proved_arc_by_arc_and_stays_so_with_more(d: Any):
    problem = linked(around(4), 4, "sin(y)", gains={1: 3, 2: 2, 3: 2})
    loop = loop_of(problem)
    search = Search(
        loop=loop,
        W=None,
        d=Doubles(np.array(d, dtype=float)),
        disturbance=F(0),
        known={},
    )
    found = next(search.claims(1.0))
    assert not list(open_terms(loop, found))
    more = claimed(
        loop, [x + 1 for x in found.a["G"]], found.b["G"], level=found.level, rate=1, d=d
    )
    assert not list(open_terms(loop, more))
    less = claimed(
        loop, [x - F(1, 2) for x in found.a["G"]], found.b["G"], level=found.level, rate=1, d=d
    )
    assert {mode for mode, _ in open_terms(loop, less)} == {"G"}
    assert len(list(open_terms(loop, less))) == 4
