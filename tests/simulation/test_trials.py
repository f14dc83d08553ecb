"""Many starts side by side: where runs end, and which of them stall."""

from itertools import pairwise

import numpy as np
import pytest
from regional_problems import field, half_difference, listening_pair
from regional_problems import random_problem as switched_problem
from scipy.integrate import solve_ivp

from dobc_design import Problem
from dobc_design.falsification.paces import drawn_signals
from dobc_design.simulation.switches import constant_signals
from dobc_design.simulation.trials import (
    Batch,
    Effort,
    Trials,
    make_arena,
    run_starts,
)

SADDLE = float(half_difference(3.3))


def settled(problem: Problem, *columns: list[float], horizon: float = 150.0) -> Trials:
    e = np.array(columns, dtype=float).T
    shape = (problem.n, problem.q, e.shape[1])
    eps = np.zeros(shape)
    modes = np.zeros(e.shape[1], dtype=np.int64)
    signals = constant_signals(modes)
    starts = Batch(e=e, eps=eps, switches=signals)
    effort = Effort(horizon=horizon, tolerance=1e-9)
    return run_starts(make_arena(problem, None), starts, effort)


@pytest.mark.parametrize("seed", range(2))
def test_every_start_goes_where_scipy_takes_it_through_its_switches(seed: int):
    problem = switched_problem(seed, modes=3)
    rng = np.random.default_rng(seed)
    signals = drawn_signals(rng, 9, problem, 4.0)
    e = rng.uniform(-2, 2, (problem.n, 9))
    shape = (problem.n, 0, 9)
    eps = np.zeros(shape)
    starts = Batch(e=e, eps=eps, switches=signals)
    effort = Effort(horizon=4.0, tolerance=1e-10)
    runs = run_starts(make_arena(problem, None), starts, effort)
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
        found = runs.error[-1, run]
        wanted = np.max(np.abs(state))
        assert found == pytest.approx(wanted, abs=1e-7)


def test_runs_stall_diverge_or_are_slow():
    """Two agents, sin, k = 1/10: e = (-x, x) converges for x below 1.65387 and not above."""
    below = SADDLE - 1e-3
    above = SADDLE + 1e-3
    runs = settled(listening_pair(), [-below, below], [-above, above])
    assert runs.stalled.tolist() == [False, True]
    assert runs.diverged.tolist() == [False, False]
    node = float(half_difference(6.0))
    found = np.max(np.abs(runs.ends[:, 1]))
    assert found == pytest.approx(node, abs=1e-3)
    # Two agents that repel each other; the pins are too weak.
    runs = settled(listening_pair("-y - y**3"), [1.0, -1.0], [0.0, 0.0], horizon=20.0)
    assert runs.diverged.tolist() == [True, False]
    assert runs.stalled.tolist() == [True, False]
    # k = 1/10 and a linear coupling: exp(-t/10) is slow, and falls all the time.
    runs = settled(listening_pair("y"), [1.0, 1.0], horizon=20.0)
    wanted = np.exp(-2)
    assert runs.error[-1, 0] == pytest.approx(wanted, rel=1e-6)
    assert not runs.stalled[0]
