"""The arithmetic of directions, against exact fractions and dense grids."""

from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
import pytest

from dobc_design.conditions.arcs.directions import (
    HALVES,
    TERMS,
    Terms,
    at_least,
    gains_within,
    open_arcs,
)
from dobc_design.conditions.separable.large import gain_table
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.work import at_most

F = Fraction
FUNCTIONS: dict[str, Any] = {
    "sin(y)": np.sin,
    "y + sin(3*y)": lambda y: y + np.sin(3 * y),
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "tanh(y) - y/4": lambda y: np.tanh(y) - y / 4,
    "y + y**3": lambda y: y + y**3,
}


def one(*numbers: Any) -> list[np.ndarray]:
    return [np.array([float(x)]) for x in numbers]


def test_the_bound_of_a_parabola_on_a_piece_is_below_its_least_value_and_close_to_it():
    """The least value of alpha s^2 + beta s + gamma by fractions: an end, or -beta/(2 alpha)."""
    r = Random(37)
    for _ in range(2000):
        scale = 10.0 ** r.randint(-6, 6)
        alpha, beta, gamma = (r.uniform(-2, 2) * scale for _ in range(3))
        s0 = r.choice((0.0, r.random()))
        s1 = s0 + r.choice((1.0, 2.0**-20)) * r.random()
        places = [F(s0), F(s1)]
        if alpha > 0:
            bottom = -F(beta) / (2 * F(alpha))
            places += [bottom] if s0 <= bottom <= s1 else []
        least = min((F(alpha) * s + F(beta)) * s + F(gamma) for s in places)
        (found,) = at_least(*one(alpha, beta, gamma, s0, s1))
        assert F(found) <= least
        assert found >= float(least) - 1e-12 * scale


@pytest.mark.parametrize(
    "values", [(0, 0, 0, 0, 1), (1e-320, -1e-320, 0, 0, 1), (1e308, -1e308, 1e300, 0, 1)]
)
def test_numbers_at_the_ends_of_floats_give_no_bound_that_is_too_high(values: Any):
    with np.errstate(all="ignore"):
        (found,) = at_least(*one(*values))
    alpha, beta, gamma, s0, s1 = map(F, values)
    least = min((alpha * s + beta) * s + gamma for s in (s0, F(1, 2), s1))
    assert not found > least


def direction(half: int, s: F) -> tuple[F, F]:
    """(x, y): from (1, 1) to (1, -1); from (0, 1) to (-1, 1); from (0, 1) to (1, 1)."""
    return ((F(1), 1 - s), (-s, F(1)), (s, F(1)))[half]


@pytest.mark.parametrize("half", range(3))
def test_the_difference_on_the_disc_is_no_longer_than_its_bound(half: int):
    """Squares in fractions: (y - x)^2 rho^2 <= far^2 (d_i x^2 + d_j y^2) for x, y of the piece."""
    r = Random(half)
    for _ in range(300):
        own, other = (10.0 ** r.uniform(-4, 4) for _ in range(2))
        rho = 10.0 ** r.uniform(-3, 3)
        width = HALVES[half].end / 2 ** r.randint(0, 20)
        s0 = r.random() * (HALVES[half].end - width)
        terms = Terms(**dict(zip(TERMS, one(0, 0, 1, 1, own, other), strict=True)))
        (far,) = HALVES[half].reach(terms, *one(s0, s0 + width), rho)
        for share in (F(0), F(1, 3), F(1)):
            x, y = direction(half, F(s0) + share * F(width))
            square = F(own) * x * x + F(other) * y * y
            assert ((y - x) * F(rho)) ** 2 <= F(far) ** 2 * square


def test_the_three_halves_are_all_directions_up_to_the_sign():
    """Every angle of (x, y) in [-45, 135) degrees is met once."""
    angles = []
    for half, piece in enumerate(HALVES):
        for s in np.linspace(0, piece.end, 50):
            x, y = map(float, direction(half, F(float(s))))
            angles.append(np.degrees(np.arctan2(y, x)))
    assert min(angles) == pytest.approx(-45)
    assert max(angles) == pytest.approx(135)
    assert np.diff(np.sort(angles)).max() < 4


@pytest.mark.parametrize("text", FUNCTIONS)
def test_gains_of_an_interval_enclose_those_of_a_grid(text: str):
    h = make_coupling(text, dimension=1)
    table = gain_table(h.components[0], F(4), cells=1024)
    far = np.linspace(0.001, 4, 200)
    least, most = gains_within(table, far)
    for k, end in enumerate(far):
        y = np.linspace(-end, end, 402)
        gains = FUNCTIONS[text](y) / y
        assert least[k] <= gains.min()
        assert most[k] >= gains.max()
        assert most[k] - least[k] <= np.ptp(gains) + 0.02


@pytest.mark.parametrize("steps", range(-4, 5))
def test_no_cell_is_left_out_where_floats_next_to_the_edge_of_one_are_rounded_across_it(steps: int):
    """g has a peak of 2 in the cell before that edge."""
    peak = 84.5 * 3 / 256
    h = make_coupling(f"y*(1 + exp(-10**8*(y - {peak})**2))", dimension=1)
    table = gain_table(h.components[0], F(1), cells=256)
    edge = 85 * table.width
    _, most = gains_within(table, np.array([edge + steps * np.spacing(edge)]))
    assert most[0] >= 2


DRAWS = 2  # of arcs of each function


@pytest.mark.slow
@pytest.mark.parametrize("text", FUNCTIONS)
def test_what_is_shown_of_arcs_holds_on_a_grid_and_what_has_room_there_is_shown(text: str):
    """a as low as a dense grid of the disc allows, and 0.02 lower or higher."""
    h = make_coupling(text, dimension=1)
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 1441), np.linspace(0.01, 1, 60))
    draw = Random(text)
    seen = {False: 0, True: 0}
    for _ in range(DRAWS):
        pull, own, other = (draw.randint(5, 20) / 10 for _ in range(3))
        rho = draw.randint(3, 24) / 10
        x = rho * radius * np.cos(angle) / np.sqrt(own)
        y = rho * radius * np.sin(angle) / np.sqrt(other)
        b = pull * draw.randint(3, 30) / 10
        across = np.abs(x) > 1e-3
        taken = pull * x * FUNCTIONS[text](y - x) - b * y * y
        least = np.max(taken[across] / x[across] ** 2)
        table = gain_table(
            h.components[0], F(rho * (1 / own + 1 / other) ** 0.5 + 0.01), cells=1024
        )
        for room in (-0.02, 0.02):
            terms = Terms(
                **dict(zip(TERMS, one(least + room, b, pull, pull, own, other), strict=True))
            )
            with at_most(10**9):
                (is_open,) = open_arcs(terms, table, F(rho))
            assert is_open is np.bool_(room < 0)
            seen[room > 0] += 1
    assert min(seen.values()) == DRAWS
