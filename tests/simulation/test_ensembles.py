"""Many runs side by side are the same runs one by one; one that goes wrong leaves the others in
peace."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from simulated_runs import (
    EVERYTHING,
    HARMONIC,
    nonlinear_planar,
    pair,
    ring,
    simulate,
    simulate_many,
)

from dobc_design import Network, Problem, Stress, load_problem
from dobc_design.errors import SpecError
from dobc_design.simulation import columns, execution, stressed
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.signals import Fixed, Markov, Mobile, Periodic, RandomDwell

MARKOV = Markov(generator=[[-3, 1, 1, 1], [1, -3, 1, 1], [1, 1, -3, 1], [1, 1, 1, -3]])


NONLINEAR = nonlinear_planar()
CASES = {
    "the paper, random": (load_problem("paper-switching"), RandomDwell(dwell=0.5)),
    "the paper, Markov": (load_problem("paper-switching"), MARKOV),
    "planar": (NONLINEAR, Periodic(dwell=[0.4, 0.3])),
    "planar, random stays": (NONLINEAR, RandomDwell(dwell=0.2, longest=0.7)),
    "no disturbance": (ring(n=6, gains={"1": 2}), Fixed()),
}


@pytest.mark.parametrize("name", CASES)
def test_runs_side_by_side_are_the_runs_one_by_one(name: str):
    """Errors and estimates at every sample, by two integrators with one tolerance."""
    problem, signal = CASES[name]
    given = {"signal": signal, "t_final": 1.2, "samples": 15, "tolerance": 1e-11}
    many = simulate_many(problem, runs=3, seed=3, **given)
    assert many.seeds.tolist() == list(range(3, 6))
    for k in range(3):
        one = simulate(problem, seed=3 + k, **given)
        np.testing.assert_allclose(many.error[k], one.error(), atol=1e-9)
        np.testing.assert_allclose(many.estimation_error[k], one.estimation_error(), atol=1e-12)
        np.testing.assert_allclose(many.states[k], one.x, atol=1e-9)
        assert many.switches[k] == len(one.switches) - 1
    assert many.method == "DOP853, side by side"
    rows = many.error.tolist()
    different = {tuple(row) for row in rows}
    assert len(different) == 3


@pytest.mark.parametrize(
    "stress", [None, EVERYTHING, replace(EVERYTHING, exchange=None, period=0.05)]
)
def test_chunks_do_not_change_the_runs(monkeypatch, stress: Stress | None):
    problem, signal = CASES["planar, random stays"]
    given = {"runs": 4, "signal": signal, "t_final": 0.6, "samples": 7, "stress": stress}
    whole = simulate_many(problem, **given)
    monkeypatch.setattr(execution, "COLUMN_NUMBERS", 18)  # three runs of 3 agents with 2 components
    parts: list[float] = []
    chunked = simulate_many(problem, progress=parts.append, **given)
    np.testing.assert_allclose(chunked.error, whole.error, rtol=1e-6, atol=1e-8)
    assert parts == (sorted(parts) if stress else [0.0, 0.75, 1.0])
    assert parts[-1] == 1.0


def unstable_beyond_one() -> Problem:
    """Agent 2 stands still, and e = x1 - x2 has e' = -e + e^3."""
    region = {"initial_states": [0, 2]}
    return pair("y - y**3", region=region)


def test_runs_that_escape_are_named_and_the_others_go_on():
    """e' = e^3 - e with e = x1 - x2: blow-up iff |e(0)| > 1, at t = -ln(1 - e(0)^-2) / 2."""
    many = simulate_many(unstable_beyond_one(), runs=60, t_final=4.0, tolerance=1e-6)
    starts = make_setting(unstable_beyond_one(), gain=None).starts
    gaps = [np.diff(starts.draw(seed).x[:, 0])[0] for seed in range(60)]
    gap = np.abs(gaps)
    blown_up = (gap > 1 / np.sqrt(1 - np.exp(-8))).tolist()
    assert many.diverged.tolist() == blown_up
    assert 3 < many.diverged.sum() < 57
    for run in np.flatnonzero(many.diverged):
        time = -np.log(1 - gap[run] ** -2) / 2
        assert many.ended[run] == pytest.approx(time, rel=1e-3)
        assert "t = " in many.reasons[run]
        before = many.error[run, many.times < 0.99 * time]
        assert np.isfinite(before).all()
        after = many.error[run, many.times > many.ended[run]]
        assert np.isnan(after).all()
    assert many.summary()["diverged"] is True
    assert many.summary()["diverged_runs"] == many.diverged.sum()
    assert many.summary()["settling_time"]["max"] is None
    calm = np.flatnonzero(~many.diverged)
    assert np.isfinite(many.error[calm]).all()
    failed = np.flatnonzero(many.diverged).tolist()
    assert set(many.reasons) == set(failed)


def test_a_run_that_escapes_counts_the_switches_until_then():
    """Two modes that are the same, every 0.03 s."""
    arcs = {"a": [[1, 2]], "b": [[1, 2]]}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    region = {"initial_states": [0, 2]}
    problem = Problem(network=network, coupling="y - y**3", region=region)
    given = {"signal": Periodic(dwell=0.03), "t_final": 1.0, "samples": 5, "tolerance": 1e-6}
    many = simulate_many(problem, runs=12, **given)
    assert 0 < many.diverged.sum() < 12
    desired = np.ceil(many.ended / 0.03 - 1e-9) - 1
    np.testing.assert_array_equal(many.switches, desired)


STRESSES = [None, Stress(noise=0.1)]
WITH_AND_WITHOUT_NOISE = pytest.mark.parametrize("stress", STRESSES, ids=["calm", "noise"])


@WITH_AND_WITHOUT_NOISE
def test_runs_that_need_too_many_steps_are_made_alone(monkeypatch, stress: Stress | None):
    monkeypatch.setattr(columns, "MOST_STEPS", 5)
    monkeypatch.setattr(stressed, "MOST_STEPS", 3)
    monkeypatch.setattr(stressed, "LEAST_STEPS", 1)
    problem, signal = CASES["planar"]
    given = {"signal": signal, "t_final": 0.5 if stress else 3.0, "samples": 4, "stress": stress}
    many = simulate_many(problem, runs=2, **given)
    for k in range(2):
        wanted = simulate(problem, seed=k, **given).error()
        assert np.array_equal(many.error[k], wanted)


FAST = "too fast for its closed|the loop is stiff"
ONE_BY_ONE = [  # a problem, arguments, and why its runs are made one by one
    (NONLINEAR, {"signal": Mobile(radius=1.0)}, "every run has graphs of its own"),
    (ring(n=3, exosystem=HARMONIC), {"gain": [[2e6], [1]]}, FAST),
    (ring("y", 2, gains=10**6), {}, "the loop is stiff"),
]


@WITH_AND_WITHOUT_NOISE
@pytest.mark.parametrize(("problem", "given", "reason"), ONE_BY_ONE)
def test_what_cannot_be_stacked_is_made_one_by_one_and_said(
    problem, given, reason: str, stress: Stress | None
):
    given = given | {"t_final": 0.06, "samples": 3, "stress": stress, "tolerance": 1e-4}
    many = simulate_many(problem, runs=2, **given)
    assert any(re.search(reason, note) for note in many.notes)
    found = many.error[1].tolist()
    one_by_one = simulate(problem, seed=1, **given)
    assert found == one_by_one.error().tolist()


def test_quantiles_and_intervals_are_those_of_the_runs():
    many = simulate_many(load_problem("paper-fixed"), runs=41, t_final=4.0)
    low, middle, high = many.quantiles()
    medians = np.median(many.error, axis=0)
    assert middle.tolist() == medians.tolist()
    assert (low < middle).all()
    assert (middle < high).all()
    intervals = many.intervals()
    below, above = intervals["median_final_error"]
    assert below < np.median(many.final_error) < above
    assert intervals["probability_of_divergence"][0] == 0


def test_an_ensemble_is_saved_whole_and_not_overwritten(tmp_path):
    many = simulate_many(load_problem("paper-fixed"), runs=3, t_final=1.0)
    path = many.save(tmp_path / "runs.npz")
    with np.load(path, allow_pickle=False) as stored:
        assert np.array_equal(stored["error"], many.error)
        found = json.loads(str(stored["about"]))
        assert found["name"] == "paper-fixed"
    with pytest.raises(SpecError, match="exists already"):
        many.save(path, force=False)
    many.save(path)
    found = [each.name for each in tmp_path.iterdir()]
    assert found == ["runs.npz"]
