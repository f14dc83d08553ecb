"""Runs of problems that state [readings], [processor] or discrete time, against a simulator that
shares no code and against what is certified."""

from fractions import Fraction
from itertools import islice

import numpy as np
import pytest
from networks import linked
from oracles.late import Plant, held_error, late_runs, on_ticks, sampled_error

import dobc_design as dd
from dobc_design import Observer, Region, Stress, load_problem, simulate
from dobc_design.errors import SpecError
from dobc_design.simulation import integrate

A = np.array([[0.0, 2.0], [-2.0, 0.0]])
C = np.array([[1.0, 0.0]])
W = np.array([[3.2], [2.4]])
NEAR = Region(initial_states=["9/10", "11/10"], initial_disturbance="1/100")
LATE = {"delay": "1/10", "own_delay": "1/50", "lost": 2, "event": "1/10"}


def paper(**stated):
    return load_problem("paper-fixed").replace(region=NEAR, **stated)


def plant(F, added):
    gains = np.array([[5.0 if i in (0, 5) else 0.0] for i in range(10)])
    arcs = [(i, (i + 1) % 10) for i in range(10)]
    return Plant(
        arcs=arcs,
        weights=np.ones((1, 10)),
        h=lambda y: np.expm1(y) + y,
        gains=gains,
        F=F,
        C=added,
    )


def recursion(run, F, added, period, *, old=0):
    """|e|_inf of the oracle at the ticks, from the start of a run."""
    e = run.errors()[0][..., None]
    eps = (run.xi[0] - run.xihat[0])[..., None]
    bounds = on_ticks(period, old * period, old * period, 0, 0)
    habit = ("oldest", "outward")
    found = late_runs(plant(F, added), bounds, e, eps, habit, np.random.default_rng(0))
    return np.array([x[..., 0] for _, x, _ in islice(found, len(run.times))])


def ticks(period, count):
    return [period * k for k in range(count)]


def test_a_processor_runs_by_itself_and_is_the_exact_recursion_of_its_gain():
    times = ticks(0.02, 201)
    run = simulate(paper(processor={"period": "1/50"}), t_final=times[-1], samples=times)
    F, added = sampled_error(A, C, W, 0.02)
    assert np.allclose(run.errors(), recursion(run, F, added, 0.02), atol=1e-12)
    assert any("computed every 0.02 s" in note for note in run.notes)
    assert run.stress == ""


def test_held_readings_are_the_recursion_with_a_compensation_that_acts_all_the_time():
    times = ticks(0.05, 81)
    run = simulate(paper(readings={"period": "1/20"}), t_final=times[-1], samples=times)
    F, added = held_error(A - W @ C, C, 0.05)
    assert np.allclose(run.errors(), recursion(run, F, added, 0.05), atol=1e-8)


def test_agents_in_discrete_time_move_in_steps():
    turn = [["3/5", "4/5"], ["-4/5", "3/5"]]
    gain = np.array([[0.6], [-0.5]])
    problem = linked(
        [[1, 2, "1/4"], [2, 1, "1/8"]],
        gains={1: "1/2"},
        time="discrete",
        exosystem=dd.Exosystem(A=turn, C=[[1, 0]]),
        observer=Observer(W=[["3/5"], ["-1/2"]]),
    )
    run = simulate(problem, t_final=60)
    assert run.times.tolist() == list(range(61))
    e = run.errors()[..., 0]
    eps = run.xi - run.xihat
    M = np.array([[0.25, 0.25], [0.125, 0.875]])
    assert np.allclose(e[1:], e[:-1] @ M.T + eps[:-1, :, 0], atol=1e-12)
    F = np.array([[0.6, 0.8], [-0.8, 0.6]]) - gain @ C
    assert np.allclose(eps[1:], eps[:-1] @ F.T, atol=1e-12)
    with pytest.raises(SpecError, match=r"t_final must be a whole number of steps"):
        simulate(problem, t_final=20.5)


@pytest.mark.parametrize("stress", [None, "worst"])
@pytest.mark.parametrize(
    "stated",
    [
        {"readings": LATE, "processor": {"period": "1/50"}},
        {"readings": {"delay": "1/2", "own_delay": "1/10"}},
        {"readings": {"delay": "1/10", "lost": 1, "period": "1/50"}},
    ],
)
def test_runs_side_by_side_are_those_alone(stated, stress):
    problem = paper(**stated)
    many = simulate(problem, runs=3, t_final=1, samples=11, stress=stress)
    for number in range(3):
        alone = simulate(problem, seed=number, t_final=1, samples=11, stress=stress)
        assert np.allclose(many.error[number], alone.error(), atol=1e-7)


def test_readings_that_are_late_change_a_run_and_are_worst_at_their_worst():
    times = ticks(0.02, 501)
    runs = {}
    for stress in (None, "worst"):
        problem = paper(readings=LATE, processor={"period": "1/50"})
        runs[stress] = simulate(problem, t_final=10, samples=times, stress=stress)
    prompt = simulate(paper(processor={"period": "1/50"}), t_final=10, samples=times)
    late = [run.error()[-1] for run in (prompt, runs[None], runs["worst"])]
    assert late[0] < late[1] < late[2]
    assert "at its worst" in runs["worst"].notes[-1]


@pytest.mark.parametrize(
    ("stated", "stress", "name"),
    [
        ({"processor": {"period": "1/50"}}, Stress(period=0.05), "period"),
        ({"processor": {"period": "1/50"}}, Stress(exchange=0.05), "exchange"),
        (
            {"processor": {"period": "1/50"}},
            Stress(period=0.02, sampled_gain=[[1], [1]]),
            "sampled_gain",
        ),
        ({"readings": {"period": "1/50"}}, Stress(period=0.02), "period"),
        ({"readings": {"delay": "1/50"}}, Stress(exchange=0.05), "exchange"),
    ],
)
def test_a_stress_that_says_what_a_table_states_is_refused_by_name(stated, stress, name):
    with pytest.raises(SpecError, match=f"^{name} is no stress where the problem has"):
        simulate(paper(**stated), stress=stress, t_final=1)


def test_other_stresses_act_beside_what_is_stated():
    problem = paper(processor={"period": "1/50"})
    stress = Stress(period=0.02, noise=0.01, loss=0.2)
    run = simulate(problem, stress=stress, t_final=1)
    assert "sampled every 0.02 s" in run.notes[-1]
    assert '"noise": 0.01' in run.stress


def test_what_breaks_first_makes_the_stated_period_and_all_delays_longer():
    problem = linked([[1, 2], [2, 1]], gains={1: 1}, processor={"period": "1/10"})
    found = dd.what_breaks_first(problem, options=["period", "delay"], t_final=30)
    period, delay = found.sweeps
    # I - T M has the eigenvalue 1 - T (3 + sqrt 5)/2
    limit = 4 / (3 + np.sqrt(5))
    assert found.period.converges == pytest.approx(limit, rel=0.1)
    assert period.breaks > limit
    assert delay.unit == "s"
    assert delay.breaks is not None
    assert delay.breaks > float(Fraction(1, 10))


def test_times_of_agents_in_steps_are_counted_in_steps():
    problem = linked([[1, 2, "1/4"], [2, 1, "1/8"]], gains={1: "1/2"}, time="discrete")
    run = simulate(problem, t_final=30)
    assert "ran to 30 steps" in str(run)
    assert "4 runs of 30 steps" in str(simulate(problem, t_final=30, runs=4))
    assert b"time t in steps" in run.plot().file("svg")
    assert run.clock == "steps"
    assert simulate(paper(), t_final=1).clock == "s"


@pytest.mark.parametrize(
    "stated",
    [
        pytest.param(
            {"readings": {"delay": "1/2", "own_delay": "1/25", "event": "1/20"}},
            marks=pytest.mark.slow,
        ),
        {"processor": {"period": "1/50"}, "readings": {"delay": "1/10", "lost": 1}},
        pytest.param({"readings": {"period": "1/20", "delay": "1/10"}}, marks=pytest.mark.slow),
    ],
)
def test_runs_at_their_worst_stay_below_the_certified_bound(stated):
    """Without an exosystem the bound holds between samples, too; with one it is about these."""
    box = Region(initial_states=["9/10", "11/10"])
    without = {"exosystem": None, "observer": None, "simulation": None, "region": box}
    problem = paper().replace(**without, **stated)
    proof = dd.certify(problem)
    assert proof.verdict is dd.Verdict.PROVED
    run = simulate(problem, stress="worst", t_final=4)
    bound = proof.envelope(run)
    assert bound.sources == ("readings",)
    assert np.all(run.error() <= bound(run.times))
    assert np.all(run.error() <= proof.bound(run.times))
    observed = paper(simulation=None, **stated)
    proof = dd.certify(observed)
    envelope = proof.envelope(simulate(observed, t_final=1))
    held = "period" in str(stated)
    assert bool(envelope.sources) is not held
    assert ("leaves a ripple" in envelope.reason) is held
    if held:
        with pytest.raises(SpecError, match="leaves a ripple"):
            proof.bound([0.01])


def test_a_run_that_diverges_ends_at_an_instant_at_which_nothing_is_read_any_more():
    steep = linked(
        [(1, 2), (2, 3), (3, 4), (4, 1)],
        coupling="exp(y) - 1 + y",
        gains={1: 5, 3: 5},
        region=Region(initial_states=[-2, 2]),
        readings={"delay": "1/2", "own_delay": "1/2"},
    )
    run = simulate(steep, t_final=20, seed=0)
    assert run.times[-1] < 20
    assert len(run.u) == len(run.times)


@pytest.mark.parametrize("region", [[0, 2], [0, 5]])
def test_a_short_step_between_two_readings_ends_where_the_integrator_does(monkeypatch, region):
    """From [0, 5] couplings are so steep at first that the first steps are not accurate, and left
    to the integrator."""
    states = Region(initial_states=region, initial_disturbance="1/2")
    problem = paper(readings={"delay": "1/10", "own_delay": "1/500"}).replace(region=states)
    run = simulate(problem, t_final=0.3, seed=3)
    monkeypatch.setattr(integrate, "SHORT", 0.0)
    slow = simulate(problem, t_final=0.3, seed=3)
    assert np.abs(run.x - slow.x).max() < 1e-8
    assert run.evaluations < 0.7 * slow.evaluations
