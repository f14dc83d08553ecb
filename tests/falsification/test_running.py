"""Starts run side by side: where they end, what V does on the way, and which of them count as stalled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from equilibrium_cases import half_difference, listening_pair
from lure_cases import HARMONIC, PAPER_GAIN, cycle, field, random_problem
from scipy.integrate import solve_ivp

from dobc_design import Problem
from dobc_design.falsification.starts import constant_signals, drawn_signals, make_arena, run_starts, settling_horizon

SADDLE = float(half_difference(3.3))


def settled(problem: Problem, *columns: list[float], horizon: float = 150.0):
    e = np.array(columns, dtype=float).T
    eps = np.zeros((problem.n, problem.q, e.shape[1]))
    signals = constant_signals(np.zeros(e.shape[1], dtype=np.int64))
    return run_starts(make_arena(problem, None), e, eps, signals, horizon=horizon, tolerance=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_every_start_goes_where_scipy_takes_it_through_its_switches(seed: int):
    problem, rng = random_problem(seed, modes=3), np.random.default_rng(seed)
    signals = drawn_signals(rng, 9, 3, 4.0)
    e = rng.uniform(-2, 2, (problem.n, 9))
    runs = run_starts(make_arena(problem, None), e, np.zeros((problem.n, 0, 9)), signals, horizon=4.0, tolerance=1e-10)
    names = tuple(problem.network.modes)
    for run in range(9):
        state, switches = e[:, run], [*signals.of(run, names), (4.0, "")]
        for (begin, mode), (end, _) in pairwise(switches):
            answer = solve_ivp(lambda t, x, m=mode: field(problem, m, x), (begin, end), state, rtol=1e-10, atol=1e-12)
            state = answer.y[:, -1]
        assert runs.ends[:, run] == pytest.approx(state, abs=1e-7)
        assert runs.error[-1, run] == pytest.approx(np.max(np.abs(state)), abs=1e-7)


def test_the_observers_error_decays_on_the_way():
    """V follows eps = exp((A - W C) t) eps(0); here V is a norm of eps alone, seen through a large P."""
    problem = cycle(3, 3, exosystem=HARMONIC)
    arena = make_arena(problem, PAPER_GAIN)
    A, C, W = np.array([[0, 2], [-2, 0]]), np.array([[1, 0]]), np.array(PAPER_GAIN, dtype=float)
    rng = np.random.default_rng(0)
    e, eps = rng.uniform(-1, 1, (3, 2)), rng.uniform(-1, 1, (3, 2, 2))

    class Norms:
        """|e|_1 + |eps|_1."""

        def value(self, e: np.ndarray, eps: np.ndarray) -> np.ndarray:
            return np.abs(e).sum(axis=0) + np.abs(eps).sum(axis=(0, 1))

    signals = constant_signals(np.zeros(2, dtype=np.int64))
    runs = run_starts(arena, e, eps, signals, horizon=1.0, tolerance=1e-10, level=Norms(), samples=5)

    def loop(t: float, state: np.ndarray) -> np.ndarray:
        own = state[3:].reshape(3, 2)
        return np.concatenate([field(problem, "G", state[:3]) + own @ C[0], (own @ (A - W @ C).T).ravel()])

    for run in range(2):
        start = np.concatenate([e[:, run], eps[:, :, run].ravel()])
        answer = solve_ivp(loop, (0, 1), start, t_eval=runs.times, rtol=1e-11, atol=1e-12)
        assert runs.values[:, run] == pytest.approx(np.abs(answer.y).sum(axis=0), abs=1e-7)


def test_runs_stall_on_the_far_side_of_the_saddle_only():
    """Two agents, sin, k = 1/10: e = (-x, x) converges for x below 1.65387 and not above."""
    runs = settled(listening_pair(), [-SADDLE + 1e-3, SADDLE - 1e-3], [-SADDLE - 1e-3, SADDLE + 1e-3])
    assert runs.stalled.tolist() == [False, True]
    assert runs.diverged.tolist() == [False, False]
    assert np.max(np.abs(runs.ends[:, 1])) == pytest.approx(float(half_difference(6.0)), abs=1e-3)


def test_runs_that_leave_every_bound_have_diverged():
    """Two agents that repel each other; the pins are too weak."""
    runs = settled(listening_pair("-y - y**3"), [1.0, -1.0], [0.0, 0.0], horizon=20.0)
    assert runs.diverged.tolist() == [True, False]
    assert runs.stalled.tolist() == [True, False]


def test_slow_runs_do_not_stall():
    """k = 1/10 and a linear coupling: exp(-t/10) is slow, and falls all the time."""
    runs = settled(listening_pair("y"), [1.0, 1.0], horizon=20.0)
    assert runs.error[-1, 0] == pytest.approx(np.exp(-2), rel=1e-6)
    assert not runs.stalled[0]


def test_runs_last_twelve_time_constants_of_the_consensus():
    """k = 1/10: the slowest rate is 1/10; a pair that is not held keeps the problem's horizon."""
    assert settling_horizon(listening_pair()) == pytest.approx(120.0, rel=1e-6)
    assert settling_horizon(listening_pair(gains=5)) == 20.0
    assert settling_horizon(listening_pair(gains=None)) == 20.0


def test_some_runs_keep_their_mode_and_the_others_switch_at_several_paces():
    signals = drawn_signals(np.random.default_rng(0), 60, 2, 10.0)
    lengths = [len(signals.of(run, ("A", "B"))) for run in range(60)]
    assert 15 <= lengths.count(1) <= 25
    assert max(lengths) > 40
    for run in range(60):
        times = [time for time, _ in signals.of(run, ("A", "B"))]
        assert times[0] == 0
        assert times == sorted(times)
        assert times[-1] < 10
