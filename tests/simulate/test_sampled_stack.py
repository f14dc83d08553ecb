"""Sampled runs under stress side by side are the same runs one by one, whatever the stress combines."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.simulate import ensembles
from dobc_design.simulate.ensembles import simulate_many
from dobc_design.simulate.mobile import Mobile, Waypoints
from dobc_design.simulate.signals import Periodic, RandomDwell
from dobc_design.simulate.simulate import simulate
from dobc_design.simulate.stress import Failure, Stress, stress_to_json
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.load import load_problem
from dobc_design.spec.network import Network
from dobc_design.spec.observer import Observer
from dobc_design.spec.problem import Problem

FAILING = (Failure(agent="3", time=0.4, kind="freeze"), Failure(agent="2", time=0.5))
STRESSES = {
    "sampled": Stress(period=0.05),
    "too slow": Stress(period=0.4),
    "noise": Stress(period=0.05, noise=0.1),
    "lost": Stress(period=0.05, loss=0.5),
    "all at once": Stress(period=0.05, noise=0.05, disturbance=0.3, frequency=2, saturation=2.0, loss=0.3,
                          failures=FAILING),
    "constant push": Stress(period=0.1, disturbance=0.3, frequency=0),
}  # fmt: skip
RUNS = 4


def planar() -> Problem:
    """m = 2, q = 3, two modes, a coupling of vectors, a formation, gains that are matrices, drawn disturbances."""
    modes = {"one": [[1, 2], [2, 3, 2], [3, 1], [1, 3]], "two": [[1, 3, "1/2"], [2, 1]]}
    return Problem(
        network=Network.from_arcs(modes, arrow="listens_to", agents=3), exceptions={(0, 2): ["3*y1", "y2"]},
        coupling=["tanh(y1) + y2/4", "y2 + y2**3/9"], target=[1, -2], gains={"1": 3, "3": [[2, 1], [-1, 2]]},
        exosystem=Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]]),
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]), offsets={"2": [1, 0]},
        region={"initial_states": [[0, 1], [-3, -1]], "initial_disturbance": 2},
    )  # fmt: skip


def agree(problem: Problem, stress: Stress, **given) -> None:
    many = simulate_many(problem, runs=RUNS, seed=5, t_final=1.2, samples=23, stress=stress, states=True, **given)
    for k in range(RUNS):
        one = simulate(problem, seed=5 + k, t_final=1.2, samples=23, stress=stress, **given)
        count = len(one.times)
        scale = 1 + np.abs(one.x).max()
        np.testing.assert_allclose(many.states[k, :count], one.x, atol=1e-12 * scale)
        np.testing.assert_allclose(many.estimation_error[k, :count], one.estimation_error(), atol=1e-11 * scale)
        np.testing.assert_allclose(many.error[k, :count], one.error(), atol=1e-12 * scale)
        assert np.isnan(many.error[k, count:]).all()
        assert np.isnan(many.states[k, count:]).all()
        assert (many.diverged[k], many.ended[k]) == (one.diverged, one.times[-1])
        assert many.reasons.get(k, "") == one.reason
        assert many.switches[k] == len(one.switches) - 1
        np.testing.assert_allclose((many.error[k, 0], many.lengths[k], many.disturbances[k]), one.start_size())
    assert "side by side" in many.method


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


def test_stress_in_continuous_time_is_one_by_one_and_says_why():
    many = simulate_many(planar(), runs=2, stress=Stress(noise=0.1), mode="one", t_final=0.2, samples=3)
    assert any("one by one, because the stress acts in continuous time" in note for note in many.notes)
