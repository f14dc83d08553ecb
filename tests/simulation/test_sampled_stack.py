"""Sampled runs under stress side by side are the same runs one by one, whatever the stress combines."""

from __future__ import annotations

import numpy as np
import pytest
from side_by_side import FAILING, planar, require_the_same

from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem
from dobc_design.simulation import ensembles
from dobc_design.simulation.ensembles import simulate_many
from dobc_design.simulation.mobile import Mobile, Waypoints
from dobc_design.simulation.signals import Periodic, RandomDwell
from dobc_design.simulation.stress import Stress, stress_to_json

STRESSES = {
    "sampled": Stress(period=0.05),
    "too slow": Stress(period=0.4),
    "noise": Stress(period=0.05, noise=0.1),
    "lost": Stress(period=0.05, loss=0.5),
    "all at once": Stress(
        period=0.05, noise=0.05, disturbance=0.3, frequency=2, saturation=2.0, loss=0.3, failures=FAILING
    ),
    "constant push": Stress(period=0.1, disturbance=0.3, frequency=0),
}


def agree(problem: Problem, stress: Stress, **given) -> None:
    """To rounding."""
    require_the_same(problem, stress, runs=4, close=1e-12, **given)


@pytest.mark.parametrize("name", STRESSES)
def test_every_stress_gives_the_runs_that_single_ones_give(name: str):
    agree(planar(), STRESSES[name], signal=RandomDwell(dwell=0.13))


def test_steep_couplings_that_overflow_end_where_single_runs_end():
    """exp(y) at a period of 0.4 s: some runs leave the floats, the others go on."""
    problem, stress = load_problem("paper-switching"), Stress(period=0.4)
    agree(problem, stress, signal=Periodic(dwell=0.3))


def test_agents_that_do_not_heed_their_observer_are_the_same_too():
    agree(planar(), STRESSES["all at once"], signal=Periodic(dwell=0.3), observer="off")


def test_graphs_of_a_given_motion_are_shared():
    motion = Waypoints(times=(0, 1), positions=[[[0], [1], [2]], [[0], [1], [9]]])
    agree(planar(), STRESSES["lost"], signal=Mobile(radius=1.5, motion=motion))


def test_a_gain_for_the_sampled_observer_takes_its_place():
    agree(planar(), Stress(period=0.1, sampled_gain=((0.1, 0), (0, 0.1), (0.05, 0))), mode="one")


def test_chunks_and_their_number_make_no_difference(monkeypatch):
    problem, stress = planar(), STRESSES["all at once"]
    whole = simulate_many(problem, runs=5, signal=Periodic(dwell=0.3), stress=stress, t_final=1, samples=5)
    monkeypatch.setattr(ensembles, "COLUMN_NUMBERS", 12)
    parts = []
    cut = simulate_many(
        problem, runs=5, signal=Periodic(dwell=0.3), stress=stress, t_final=1, samples=5, progress=parts.append
    )
    np.testing.assert_allclose(cut.error, whole.error, rtol=1e-12)
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert whole.stress == stress_to_json(stress)
