"""Graphs from positions: who is near, when a link is made and broken, and that no step crosses that
instant."""

import numpy as np
import pytest
from scipy.linalg import expm
from simulated_runs import simulate, simulate_many

from dobc_design import Network, Problem
from dobc_design.errors import ShapeError, SpecError
from dobc_design.simulation.mobile import motion_switches, near
from dobc_design.simulation.signals import Mobile, Waypoints


def alone(n: int, *, m: int = 1, **settings) -> Problem:
    """n agents whose listed arcs do not matter: a mobile signal does not use them."""
    arcs = [[1, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    given = {"coupling": "y", "target": [0] * m}
    return Problem(network=network, **(given | settings))


def pairs(codes, n: int) -> set[tuple[int, int]]:
    return {(code // n, code % n) for code in codes.tolist()}


def by_hand_within(positions, radius: float, hysteresis: float, before) -> set[tuple[int, int]]:
    n = len(positions)
    found = set()
    for i in range(n):
        for j in range(n):
            distance = np.linalg.norm(positions[i] - positions[j])
            if i != j and (
                distance <= radius or ((i, j) in before and distance <= radius + hysteresis)
            ):
                found.add((i, j))
    return found


@pytest.mark.parametrize("k", [1, 2, 3])
def test_links_within_a_radius_are_made_and_kept_as_said(k: int):
    rng = np.random.default_rng(k)
    signal = Mobile(radius=0.4, hysteresis=0.1)
    codes = None
    wanted = set()
    for _ in range(20):
        positions = rng.random((25, k))
        codes = near(signal, positions, codes)
        wanted = by_hand_within(positions, 0.4, 0.1, wanted)
        assert pairs(codes, 25) == wanted
        assert (np.diff(codes) > 0).all()


def test_the_nearest_neighbours_are_heard():
    rng = np.random.default_rng(0)
    positions = rng.random((30, 2))
    codes = near(Mobile(neighbours=4), positions, None)
    found = pairs(codes, 30)
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    wanted = set()
    for i in range(30):
        for j in np.argsort(distances[i])[1:5]:
            wanted.add((i, int(j)))
    assert found == wanted
    answer = near(Mobile(neighbours=50), positions, None)
    assert len(answer) == 30 * 29


def test_a_neighbour_is_replaced_only_by_one_that_is_nearer_by_the_hysteresis():
    signal = Mobile(neighbours=1, hysteresis=0.3)
    places = []
    for x in (2.0, 0.9, 0.71, 0.69, 0.9, 1.4):
        place = [[0.0], [1.0], [-x]]
        places.append(np.array(place))
    codes = None
    heard = []
    for positions in places:
        codes = near(signal, positions, codes)
        speaker = next(j for i, j in pairs(codes, 3) if i == 0)
        heard.append(speaker)
    assert heard == [1, 1, 1, 2, 2, 1]


def test_links_are_broken_at_the_instant_of_the_closed_form():
    """Agents 1 and 2 leave each other like cosh: h(y) = -y repels, e' = -h; |x1 - x2| = 0.5 exp(2
    t) until 1.5."""
    problem = alone(2, coupling="-y")
    signal = Mobile(radius=1, hysteresis=0.5)
    start = [[-0.25], [0.25]]
    run = simulate(
        problem,
        signal=signal,
        start=start,
        t_final=2.0,
        tolerance=1e-12,
    )
    instant = np.log(3) / 2
    assert len(run.switches) == 2
    assert run.switches.times[1] == pytest.approx(instant, rel=1e-11)
    found = [graph.shape[1] for graph in run.switches.graphs]
    assert found == [2, 0]
    actual = run.x[-1, :, 0]
    np.testing.assert_allclose(actual, [-0.75, 0.75], rtol=1e-10)
    assert run.mode_index[run.times < instant].max() == 0
    assert run.mode_index[run.times > instant].min() == 1


def test_without_hysteresis_a_graph_may_chatter_and_that_is_said():
    """Linked agents repel and single ones, pinned at 0, attract: a sliding motion at distance 1."""
    problem = alone(2, coupling="-2*y", gains=1)
    start = [[1], [-1]]
    with pytest.raises(SpecError, match="it chatters") as caught:
        simulate(problem, signal=Mobile(radius=1), start=start, t_final=2.0, tolerance=1e-6)
    assert "hysteresis" in caught.value.cure
    signal = Mobile(radius=1, hysteresis=0.5)
    start = [[1], [-1]]
    calm = simulate(
        problem,
        signal=signal,
        start=start,
        t_final=5.0,
        tolerance=1e-6,
    )
    assert 3 < len(calm.switches) < 100


def crossing() -> Waypoints:
    """Agent 2 flies past agent 1: distance |2 t - 4| to t = 4; agent 3 stays away."""
    positions = [[[0, 0], [-4, 0], [50, 0]], [[0, 0], [4, 0], [50, 0]]]
    return Waypoints(times=[0, 4], positions=positions)


def test_a_given_motion_switches_at_exact_instants():
    signal = Mobile(radius=1, hysteresis=0.5, motion=crossing())
    switches = motion_switches(signal, signal.motion, alone(3), 10.0)
    expected_times = [0, 1.5, 2.75]
    np.testing.assert_allclose(switches.times, expected_times, rtol=1e-15)
    found = [graph.shape[1] for graph in switches.graphs]
    assert found == [0, 2]
    assert switches.modes.tolist() == [0, 1, 0]


def test_under_a_given_motion_the_loop_is_a_product_of_exponentials():
    """Stacked runs and single ones alike."""
    gains = {"1": 1, "2": "1/2", "3": 2}
    problem = alone(3, gains=gains)
    signal = Mobile(radius=1, hysteresis=0.5, motion=crossing())
    start = np.array([[1.0], [-3], [2]])
    run = simulate(problem, signal=signal, start=start, t_final=4.0, tolerance=1e-12)
    K = np.diag([1, 0.5, 2])
    laplacian = [[-1.0, 1, 0], [1, -1, 0], [0, 0, 0]]
    linked = np.array(laplacian) - K
    together = expm(-K * 1.25) @ expm(linked * 1.25)
    wanted = together @ expm(-K * 1.5) @ start
    np.testing.assert_allclose(run.x[-1], wanted, rtol=1e-10)
    runs = simulate_many(problem, runs=2, signal=signal, start=start, t_final=4.0, tolerance=1e-12)
    actual = runs.error[1, -1]
    desired = np.abs(wanted).max()
    np.testing.assert_allclose(actual, desired, rtol=1e-10)


def test_a_motion_of_other_agents_is_refused():
    signal = Mobile(radius=1, motion=crossing())
    with pytest.raises(ShapeError, match="one position per agent, 2; got 3"):
        simulate(alone(2), signal=signal)
