"""Certified sets and starts: V against its definition, where starts lie, where runs end and which
of them stall."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from equilibrium_cases import half_difference, listening_pair
from lure_cases import cycle, field, identity
from lure_cases import random_problem as switched_problem
from scipy.integrate import solve_ivp

from dobc_design import Exosystem, Group, Network, Observer, Problem, Switching
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.errors import SpecError
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.falsification.levels import Boundary, level_of
from dobc_design.falsification.paces import drawn_signals
from dobc_design.simulation.boxes import CORNERS, EDGES, RANDOM, asked_box, unit_cube
from dobc_design.simulation.field import make_loop
from dobc_design.simulation.trials import (
    Batch,
    Effort,
    constant_signals,
    make_arena,
    run_starts,
)

F = Fraction
P = ((F(2), F(1, 2)), (F(1, 2), F(1)))
SEPARABLE = Separable(
    v=(F(1), F(2), F(3)),
    alpha=F(1),
    rho=F(4),
    error=ErrorBound(P=P, beta=F(3), kappa=F(1, 2), size=F(3)),
)
FULL = SparseSymmetric(3, {(0, 0): F(2), (0, 1): F(1, 2), (1, 1): F(1), (2, 2): F(3)})
LURE = Lure(P_e=FULL, ranges=(), radius=F(1), level=F(5), rate=F(1, 4), P=P, Q=((F(1),), (F(1),)))


def problem(q: int = 2) -> Problem:
    network = Network.from_arcs([[2, 1], [3, 2]], arrow="listens_to", agents=3)
    exosystem = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]]) if q else None
    observer = Observer(W=[[1], [0]]) if q else None
    return Problem(
        network=network, coupling="tanh(y)", gains={1: 1}, exosystem=exosystem, observer=observer
    )


def separable_value(e: np.ndarray, eps: np.ndarray) -> float:
    """(N + kappa E) / rho, from the definition."""
    N = max(abs(e[i]) / (i + 1) for i in range(3))
    E = max(float(row @ np.array(P, dtype=float) @ row) ** 0.5 for row in eps)
    return (N + E / 2) / 4


def lure_value(e: np.ndarray, eps: np.ndarray) -> float:
    """Root of V / level."""
    M = np.array([[2, 0.5, 0], [0.5, 1, 0], [0, 0, 3]])
    return float((e @ M @ e + sum(row @ np.array(P, dtype=float) @ row for row in eps)) / 5) ** 0.5


@pytest.mark.parametrize(("claim", "truth"), [(SEPARABLE, separable_value), (LURE, lure_value)])
def test_v_is_that_of_the_definition_and_its_gradient_that_of_differences(claim, truth):
    level = level_of(problem(), claim)
    rng = np.random.default_rng(0)
    e = rng.normal(size=(3, 20))
    eps = rng.normal(size=(3, 2, 20))
    values = level.value(e, eps)
    for run in range(20):
        assert values[run] == pytest.approx(truth(e[:, run], eps[:, :, run]), rel=1e-12)
        along, along_eps = level.gradient(e[:, run], eps[:, :, run])
        step = 1e-7 * rng.normal(size=3)
        other = 1e-7 * rng.normal(size=(3, 2))
        change = truth(e[:, run] + step, eps[:, :, run] + other) - truth(
            e[:, run] - step, eps[:, :, run] - other
        )
        assert 2 * (along @ step + np.sum(along_eps * other)) == pytest.approx(
            change, rel=1e-4, abs=1e-12
        )


@pytest.mark.parametrize("kind", [RANDOM, CORNERS, EDGES])
@pytest.mark.parametrize(("claim", "truth"), [(SEPARABLE, separable_value), (LURE, lure_value)])
def test_starts_lie_on_the_boundary_some_of_them_without_a_disturbance(claim, truth, kind: str):
    starts = Boundary(level=level_of(problem(), claim), loop=make_loop(problem(), None))
    e, eps = starts.draw(np.random.default_rng(1), 60, kind)
    assert [truth(e[:, run], eps[:, :, run]) for run in range(60)] == pytest.approx(
        [1.0] * 60, rel=1e-12
    )
    without = np.all(eps == 0, axis=(0, 1)).sum()
    assert 5 < without < 50
    back, back_eps = starts.project(3 * e, 3 * eps)
    assert back == pytest.approx(e, rel=1e-12)
    assert back_eps == pytest.approx(eps, rel=1e-12)


def test_starts_of_what_holds_everywhere_without_a_matrix_and_of_another_problem():
    claim = Lure(P_e=FULL, ranges=(), radius=F(1), level=F(5))
    starts = Boundary(level=level_of(problem(), claim), loop=make_loop(problem(), None))
    assert not np.any(starts.draw(np.random.default_rng(1), 10, RANDOM)[1])
    everywhere = Separable(v=(F(1), F(2), F(3)), alpha=F(1), rho=None)
    assert level_of(problem(0), everywhere).value(
        np.array([[1.0], [0], [0]]), np.zeros((3, 0, 1))
    ) == [1.0]
    linear = Lure(P_e=identity(3), ranges=(), radius=None, level=None)
    assert level_of(problem(0), linear).value(np.array([[0.0], [0], [1]]), np.zeros((3, 0, 1))) == [
        1.0
    ]
    with pytest.raises(SpecError, match="weights v for this problem"):
        level_of(cycle(5, 3), SEPARABLE)
    with pytest.raises(SpecError, match="P_e of 5 rows"):
        level_of(cycle(5, 3), LURE)


def boxed(**more) -> tuple[Problem, object]:
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    given = Problem(network=network, coupling="y", gains={1: 1}, target=1, offsets={2: 2}, **more)
    return given, make_loop(given, None)


def test_the_box_is_the_region_less_the_goals():
    """x in [0, 5], goals 1 and 3: e in [-1, 4] and [-3, 2]."""
    given, loop = boxed(region={"initial_states": [0, 5]})
    box = asked_box(given, loop)
    assert box.low.tolist() == [-1.0, -3.0]
    assert box.high.tolist() == [4.0, 2.0]
    assert box.holds(np.array([4.0, -3.0]))
    assert not box.holds(np.array([4.001, 0.0]))
    assert asked_box(given, loop, radius=2.0).low.tolist() == [-2.0, -2.0]
    given, loop = boxed()
    assert asked_box(given, loop).high.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("kind", [RANDOM, CORNERS, EDGES])
def test_starts_of_a_box_lie_in_it_and_steps_are_brought_back(kind: str):
    given = problem()
    box = asked_box(given, make_loop(given, None), radius=2.0, disturbance=0.5)
    e, eps = box.draw(np.random.default_rng(2), 40, kind)
    lengths = np.linalg.norm(eps, axis=1)
    assert np.all(np.abs(e) <= 2)
    assert np.all(lengths <= 0.5 + 1e-12)
    at_end = np.abs(e) == 2
    assert {
        RANDOM: not at_end.any(),
        CORNERS: at_end.all(),
        EDGES: at_end.any(axis=0).all(),
    }[kind]
    back, back_eps = box.project(5 * e, 5 * eps)
    assert np.all(np.abs(back) <= 2)
    assert np.all(np.linalg.norm(back_eps, axis=1) <= 0.5 + 1e-12)


def test_starts_keep_to_the_states_of_the_own_group():
    """Agents 1 and 3 have places 0 and 1, agent 2 has place 2."""
    own = np.array([[1, 1, 0], [0, 0, 1], [1, 1, 0]], dtype=bool)
    sine = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]])
    constant = Exosystem(A=[[0]], C=[[1]])
    groups = [
        Group(agents=[1, 3], exosystem=sine, observer=Observer(W=[[1], [0]])),
        Group(agents=[2], exosystem=constant, observer=Observer(W=[[1]])),
    ]
    given = Problem(network=problem().network, coupling="tanh(y)", gains={1: 1}, groups=groups)
    P = np.diag([F(2), F(1), F(3)]).tolist()
    claim = replace(SEPARABLE, error=ErrorBound(P=P, beta=F(3), kappa=F(1), size=F(3)))
    level = level_of(given, claim)
    loop = make_loop(given, None)
    box = asked_box(given, loop, radius=2.0, disturbance=0.5)
    edge = Boundary(level=level, loop=loop)
    for starts in (box, edge):
        e, eps = starts.draw(np.random.default_rng(2), 30, RANDOM)
        for kept in (eps, starts.project(2 * e, np.ones_like(eps))[1]):
            assert np.all(kept[~own] == 0)
            assert np.any(kept[own] != 0)
        assert np.all(starts.reach[1][~own] == 0)


def test_all_corners_are_taken_where_there_are_few():
    corners = unit_cube(np.random.default_rng(0), 3, 10, CORNERS)
    assert len({tuple(corner) for corner in corners.T[:8].tolist()}) == 8
    many = unit_cube(np.random.default_rng(0), 30, 4, CORNERS)
    assert many[:, 0].tolist() == [-1.0] * 30
    assert many[:, 1].tolist() == [1.0] * 30


SADDLE = float(half_difference(3.3))


def settled(problem: Problem, *columns: list[float], horizon: float = 150.0):
    e = np.array(columns, dtype=float).T
    eps = np.zeros((problem.n, problem.q, e.shape[1]))
    signals = constant_signals(np.zeros(e.shape[1], dtype=np.int64))
    starts = Batch(e=e, eps=eps, switches=signals)
    return run_starts(make_arena(problem, None), starts, Effort(horizon=horizon, tolerance=1e-9))


@pytest.mark.parametrize("seed", range(2))
def test_every_start_goes_where_scipy_takes_it_through_its_switches(seed: int):
    problem = switched_problem(seed, modes=3)
    rng = np.random.default_rng(seed)
    signals = drawn_signals(rng, 9, problem, 4.0)
    e = rng.uniform(-2, 2, (problem.n, 9))
    starts = Batch(e=e, eps=np.zeros((problem.n, 0, 9)), switches=signals)
    runs = run_starts(make_arena(problem, None), starts, Effort(horizon=4.0, tolerance=1e-10))
    names = tuple(problem.network.modes)
    for run in (0, 4, 8):  # the first stays in its mode
        state = e[:, run]
        switches = [*signals.named(run, names), (4.0, "")]
        for (begin, mode), (end, _) in pairwise(switches):
            answer = solve_ivp(
                lambda t, x, m=mode: field(problem, m, x),
                (begin, end),
                state,
                rtol=1e-10,
                atol=1e-12,
            )
            state = answer.y[:, -1]
        assert runs.ends[:, run] == pytest.approx(state, abs=1e-7)
        assert runs.error[-1, run] == pytest.approx(np.max(np.abs(state)), abs=1e-7)


def test_runs_stall_diverge_or_are_slow():
    """Two agents, sin, k = 1/10: e = (-x, x) converges for x below 1.65387 and not above."""
    runs = settled(
        listening_pair(), [-SADDLE + 1e-3, SADDLE - 1e-3], [-SADDLE - 1e-3, SADDLE + 1e-3]
    )
    assert runs.stalled.tolist() == [False, True]
    assert runs.diverged.tolist() == [False, False]
    assert np.max(np.abs(runs.ends[:, 1])) == pytest.approx(float(half_difference(6.0)), abs=1e-3)
    # Two agents that repel each other; the pins are too weak.
    runs = settled(listening_pair("-y - y**3"), [1.0, -1.0], [0.0, 0.0], horizon=20.0)
    assert runs.diverged.tolist() == [True, False]
    assert runs.stalled.tolist() == [True, False]
    # k = 1/10 and a linear coupling: exp(-t/10) is slow, and falls all the time.
    runs = settled(listening_pair("y"), [1.0, 1.0], horizon=20.0)
    assert runs.error[-1, 0] == pytest.approx(np.exp(-2), rel=1e-6)
    assert not runs.stalled[0]


def test_some_runs_keep_their_mode_and_the_others_switch_at_several_paces():
    signals = drawn_signals(np.random.default_rng(0), 60, switched_problem(0, modes=2), 10.0)
    lengths = [len(signals.named(run, ("A", "B"))) for run in range(60)]
    assert 15 <= lengths.count(1) <= 25
    assert max(lengths) > 40
    for run in range(60):
        times = [time for time, _ in signals.named(run, ("A", "B"))]
        assert times[0] == 0
        assert times == sorted(times)
        assert times[-1] < 10


@pytest.mark.parametrize("longest", [None, 3])
def test_under_a_guarantee_all_runs_keep_it(longest):
    turns = Switching(guarantee="dwell", dwell=1, longest=longest)
    own = switched_problem(0, modes=3)
    kept = Problem(
        network=own.network, coupling="y", gains={1: 1}, target=[0] * own.m, switching=turns
    )
    signals = drawn_signals(np.random.default_rng(0), 40, kept, 10.0)
    names = tuple(own.network.modes)
    for run in range(40):
        switches = signals.named(run, names)
        for (before, old), (after, new) in pairwise(switches):
            assert old != new
            assert 1 <= after - before <= (longest or 10)
    assert {signals.named(run, names)[0][1] for run in range(40)} == set(names)
