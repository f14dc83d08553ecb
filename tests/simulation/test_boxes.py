"""Boxes of starts: where starts lie."""

import numpy as np
import pytest

from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.simulation.field import make_closed_loop
from dobc_design.simulation.starts import CORNERS, EDGES, RANDOM, asked_box, unit_cube


def boxed(**more) -> tuple[Problem, object]:
    arcs = [[2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    given = Problem(network=network, coupling="y", gains={1: 1}, target=1, offsets={2: 2}, **more)
    return given, make_closed_loop(given, None)


def test_the_box_is_the_region_less_the_goals():
    """x in [0, 5], goals 1 and 3: e in [-1, 4] and [-3, 2]."""
    region = {"initial_states": [0, 5]}
    given, loop = boxed(region=region)
    box = asked_box(given, loop)
    assert box.low.tolist() == [-1.0, -3.0]
    assert box.high.tolist() == [4.0, 2.0]
    assert box.holds(np.array([4.0, -3.0]))
    assert not box.holds(np.array([4.001, 0.0]))
    found = asked_box(given, loop, radius=2.0).low.tolist()
    assert found == [-2.0, -2.0]
    given, loop = boxed()
    found = asked_box(given, loop).high.tolist()
    assert found == [1.0, 1.0]


@pytest.mark.parametrize("kind", [RANDOM, CORNERS, EDGES])
def test_starts_of_a_box_lie_in_it(kind: str):
    arcs = [[2, 1], [3, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    A = [[0, 1], [-1, 0]]
    C = [[1, 0]]
    sine = Exosystem(A=A, C=C)
    W = [[1], [0]]
    observer = Observer(W=W)
    given = Problem(
        network=network, coupling="tanh(y)", gains={1: 1}, exosystem=sine, observer=observer
    )
    box = asked_box(given, make_closed_loop(given, None), radius=2.0, disturbance=0.5)
    e, eps = box.draw(np.random.default_rng(2), 40, kind)
    lengths = np.linalg.norm(eps, axis=1)
    assert np.all(np.abs(e) <= 2)
    assert np.all(lengths <= 0.5 + 1e-12)
    at_end = np.abs(e) == 2
    if kind == RANDOM:
        assert not at_end.any()
    elif kind == CORNERS:
        assert at_end.all()
    else:
        assert at_end.any(axis=0).all()


def test_all_corners_are_taken_where_there_are_few():
    corners = unit_cube(np.random.default_rng(0), 3, 10, CORNERS)
    first_corners = corners.T[:8].tolist()
    different = {tuple(corner) for corner in first_corners}
    assert len(different) == 8
    many = unit_cube(np.random.default_rng(0), 30, 4, CORNERS)
    found = many[:, 0].tolist()
    assert found == [-1.0] * 30
    assert many[:, 1].tolist() == [1.0] * 30
