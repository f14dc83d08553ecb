"""Runs under stress in continuous time side by side: the same runs one by one, where all of the loop is integrated."""

from __future__ import annotations

import numpy as np
import pytest
from side_by_side import FAILING, planar, require_the_same

from dobc_design.errors import SpecError
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation import ensembles, stressed_stack
from dobc_design.simulation.ensembles import simulate_many
from dobc_design.simulation.mobile import Mobile, Waypoints
from dobc_design.simulation.run import simulate
from dobc_design.simulation.signals import Periodic, RandomDwell
from dobc_design.simulation.stress import Stress

EVERYTHING = Stress(noise=0.05, disturbance=0.3, frequency=2, saturation=2.0, loss=0.3, exchange=0.1, failures=FAILING)
STRESSES = {
    "noise": Stress(noise=0.1),
    "saturated": Stress(saturation=1.0),
    "pushed": Stress(disturbance=0.3, frequency=3),
    "pushed for ever": Stress(disturbance=0.3, frequency=0),
    "pushed in resonance": Stress(disturbance=0.3, frequency=1),
    "lost": Stress(loss=0.5, exchange=0.11),
    "failing": Stress(failures=FAILING),
    "everything": EVERYTHING,
}


def agree(problem: Problem, stress: Stress, **given) -> None:
    """To what the integrations are off; single runs integrate the observer, ensembles know it in closed form."""
    require_the_same(problem, stress, **({"runs": 2, "close": 3e-8, "t_final": 0.7, "tolerance": 1e-10} | given))


@pytest.mark.parametrize("name", STRESSES)
def test_every_stress_gives_the_runs_that_single_ones_give(name: str):
    """Modes change within the time between two exchanges."""
    agree(planar(), STRESSES[name], signal=RandomDwell(dwell=0.07))


def test_agents_that_do_not_heed_their_observer_are_the_same_too():
    agree(planar(), EVERYTHING, signal=Periodic(dwell=0.3), observer="off")


def test_graphs_of_a_given_motion_are_shared():
    motion = Waypoints(times=(0, 1), positions=[[[0], [1], [2]], [[0], [1], [9]]])
    agree(planar(), STRESSES["lost"], signal=Mobile(radius=1.5, motion=motion))


def test_without_an_exosystem_only_the_push_is_a_disturbance():
    network = Network.from_arcs([[1, 2], [2, 3], [3, 1]], arrow="listens_to")
    agree(Problem(network=network, coupling="sin(y)", gains={"1": 1}), EVERYTHING)


def test_runs_that_leave_the_floats_end_where_single_ones_do_and_the_others_go_on():
    """e' = e^3 - e: some starts escape, and noise only shakes them."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=2)
    problem = Problem(network=network, coupling="y - y**3", region={"initial_states": [0, 2]})
    stress = Stress(noise=0.01)
    many = simulate_many(problem, runs=12, t_final=0.5, stress=stress, samples=9, seed=5)
    assert many.diverged[:4].tolist() == [False, False, False, True]
    assert np.isfinite(many.error[~many.diverged]).all()
    agree(problem, stress, runs=4, t_final=0.5)


def test_the_noise_of_a_thousand_runs_spreads_as_its_recursion_says():
    """x' = -k (x + held noise): x+ = a x - (1 - a) noise, a = exp(-k T); the variance goes to s^2 (1 - a)/(1 + a)."""
    network = Network.from_arcs({"G": []}, arrow="listens_to", agents=1)
    problem = Problem(network=network, coupling="y", gains={"1": 20})
    many = simulate_many(
        problem, runs=1000, start=[[0]], t_final=1.0, samples=2, stress=Stress(noise=0.3), tolerance=1e-6, states=True
    )
    a = np.exp(-20 * 0.05)
    last = many.states[:, -1, 0, 0]
    assert last.std() == pytest.approx(0.3 * np.sqrt((1 - a) / (1 + a)), rel=0.1)
    assert abs(last.mean()) < 4 * last.std() / np.sqrt(1000)


def test_chunks_make_no_difference(monkeypatch):
    given = {"runs": 5, "signal": Periodic(dwell=0.3), "stress": EVERYTHING, "t_final": 0.5, "samples": 4}
    whole = simulate_many(planar(), **given)
    monkeypatch.setattr(ensembles, "COLUMN_NUMBERS", 12)
    parts: list[float] = []
    cut = simulate_many(planar(), progress=parts.append, **given)
    np.testing.assert_allclose(cut.error, whole.error, atol=1e-8)
    assert parts == sorted(parts)
    assert parts[-1] == 1.0


def test_runs_that_need_too_many_steps_are_made_alone(monkeypatch):
    monkeypatch.setattr(stressed_stack, "MOST_STEPS", 3)
    monkeypatch.setattr(stressed_stack, "LEAST_STEPS", 1)
    given = {"stress": STRESSES["noise"], "t_final": 0.3, "samples": 4, "signal": Periodic(dwell=0.2)}
    many = simulate_many(planar(), runs=2, **given)
    for k in range(2):
        assert np.array_equal(many.error[k], simulate(planar(), seed=k, **given).error())


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"signal": Mobile(radius=1.0)}, "graphs of its own"),
        ({"observer": "full-loop"}, "the full loop was asked for"),
        ({"gain": [[2e6, 0], [0, 1], [0, 0]]}, "too fast for its closed form"),
    ],
)
def test_what_cannot_be_stacked_is_made_one_by_one_and_said(arguments, reason: str):
    many = simulate_many(planar(), runs=1, stress=STRESSES["noise"], t_final=0.1, samples=2, **arguments)
    assert any(f"one by one, because {reason}" in note or reason in note for note in many.notes)


@pytest.mark.parametrize("runs", [None, 2])
def test_too_many_exchanges_are_refused_before_anything_is_integrated(runs: int | None):
    import dobc_design as dd

    with pytest.raises(SpecError, match="2e\\+10 exchanges are too many") as caught:
        dd.simulate(load_problem("paper-fixed"), runs=runs, stress=Stress(exchange=1e-9))
    assert caught.value.key == "exchange"


@pytest.mark.slow
def test_the_papers_example_under_everything_is_the_same_side_by_side():
    problem = load_problem("paper-switching")
    agree(problem, EVERYTHING, signal=RandomDwell(dwell=0.5), t_final=3.0, runs=3, close=1e-6)


def test_an_observer_of_a_growing_disturbance_is_followed_through_the_noise():
    """A has an eigenvalue 1: xi grows while eps decays, and every draw makes eps jump."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    problem = Problem(
        network=network, coupling="y", gains=1, exosystem=Exosystem(A=[[1]], C=[[1]]), observer=Observer(W=[[5]])
    )
    agree(problem, Stress(noise=0.1, saturation=3.0), t_final=1.0)
