"""Stressed loops against closed forms, CasADi's integrator, and each other."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from simulated_runs import pair, planar, simulate, single

import dobc_design as dd
from dobc_design import Failure, Stress
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import scale
from dobc_design.loop.timing import Timing, sampled
from dobc_design.simulation.agents import Heard, StressedRuns
from dobc_design.simulation.field import make_closed_loop
from dobc_design.simulation.sampled import discretised, integral
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.signals import Mobile, Periodic
from dobc_design.simulation.stress import stress_to_json

FAILURES = (Failure(agent="3", time=1.0), Failure(agent="7", time=2.0, kind="freeze"))
SAMPLED = Stress(
    noise=0.01, disturbance=0.2, saturation=4.0, loss=0.3, period=0.04, failures=FAILURES
)
EVERYTHING = replace(SAMPLED, frequency=3.0, period=None, exchange=0.1)


@pytest.mark.parametrize("name", ["paper-switching", "uav-swarm", "planar"])
def test_a_stress_that_never_binds_leaves_the_loop_as_it_is(name: str):
    """Under a stress the full loop is integrated, couplings arc by arc; without one e alone, eps in
    closed form."""
    problem = planar() if name == "planar" else dd.load_problem(name)
    gain = None
    if problem.observer.W is None:
        column = [[1.0], [0.2]]
        gain = np.kron(np.eye(3), column)
    given = {"t_final": 3, "samples": 31, "gain": gain, "tolerance": 1e-11}
    calm = simulate(problem, **given)
    stressed = simulate(problem, stress=Stress(saturation=1e9), **given)
    for part in ("x", "xi", "xihat", "d", "dhat", "u"):
        np.testing.assert_allclose(getattr(stressed, part), getattr(calm, part), atol=1e-7)
    assert "Stress: |u| at most 1e+09." in stressed.notes


def test_a_saturated_agent_falls_in_a_straight_line_until_its_input_is_small_enough():
    """x' = -min(1, 2 x) from 3: x = 3 - t down to 1/2, then exp(-2 t)/2."""
    limited = {"stress": Stress(saturation=1), "tolerance": 1e-10}
    run = simulate(single(), start=[[3]], t_final=5, samples=101, **limited)
    t = run.times
    since = np.maximum(0, t - 2.5)
    decay = np.exp(-2 * since)
    wanted = np.where(t <= 2.5, 3 - t, 0.5 * decay)
    actual = run.x[:, 0, 0]
    np.testing.assert_allclose(actual, wanted, atol=1e-7)
    actual = run.u[:, 0, 0]
    np.testing.assert_allclose(actual, -np.minimum(1, 2 * wanted), atol=1e-7)


def test_the_discretised_observer_lies_in_its_exact_enclosure():
    """Ad - L Cd with L = W/10, against rational intervals from ball arithmetic."""
    problem = planar()
    W = np.array(problem.observer.W) / 10
    gain = tuple(map(tuple, W))
    timing = Timing(period=Fraction(1, 4), sampled=True)
    exact = sampled(problem.exosystem, timing).error(scale(4, gain), timing.period)
    loop = make_closed_loop(problem, None)
    Ad = integral(loop.A, 0.25)[0]
    _, Cd, L = discretised(loop, 0.25, W.astype(float))
    for row, found in zip(exact, Ad - L @ Cd, strict=True):
        middle = [float(entry.midpoint) for entry in row]
        np.testing.assert_allclose(found, middle, atol=1e-15)


def test_between_samples_a_held_loop_follows_its_integral():
    """At any time x = x_k + (t - t_k) v_k + int d: the speed less d is constant."""
    stress = Stress(period=0.25, disturbance=0.3)
    run = simulate(dd.load_problem("paper-fixed"), t_final=0.5, samples=2001, stress=stress)
    inside = slice(1001, 1999)  # within the second period
    positions = run.x[inside, 0, 0]
    speed = np.gradient(positions, run.times[inside])
    free = speed - run.d[inside, 0, 0]
    rest = free[2:-2]
    assert np.ptp(rest) < 1e-5
    found = np.ptp(run.u[inside, 0, 0])
    assert found == 0


def test_a_gain_for_the_sampled_observer_can_be_given():
    """Deadbeat for a constant disturbance: A = 0, Cd = 1, L = 1 makes eps vanish after one
    sample."""
    exosystem = dd.Exosystem(A=[[0]], C=[[1]])
    observer = dd.Observer(W=[[1]])
    problem = single(exosystem=exosystem, observer=observer)
    stress = Stress(period=0.1, sampled_gain=[[1]])
    run = simulate(problem, t_final=1, samples=11, stress=stress)
    estimates = run.dhat[1:]
    disturbances = run.d[1:]
    np.testing.assert_allclose(estimates, disturbances, atol=1e-12)
    estimate = run.dhat[0, 0, 0]
    disturbance = run.d[0, 0, 0]
    assert abs(estimate - disturbance) == 1
    stress = Stress(period=0.1, sampled_gain=[[1, 2]])
    with pytest.raises(ShapeError, match=r"sampled_gain must have shape \(1, 1\)"):
        simulate(problem, stress=stress)


def test_links_that_stay_keep_what_was_heard_and_new_ones_hold_nothing():
    modes = {"a": [[1, 2], [2, 3]], "b": [[3, 1], [2, 3]]}
    network = dd.Network.from_arcs(modes, arrow="listens_to")
    problem = dd.Problem(network=network, coupling="y")
    signal = Periodic(dwell=0.15)
    setting = make_setting(problem, gain=None, stress=Stress(exchange=0.1), signal=signal)
    switches = setting.switches(0)
    starts = [setting.starts.draw(0)]
    runs = StressedRuns(setting=setting, starts=starts, seeds=[0], switches=[switches])
    instants = np.array([0.0, 0.1])
    heard = Heard(runs, instants, keep=True)
    sent = [[[10.0]], [[20.0]], [[30.0]]]
    heard.exchange(0, np.array(sent))
    agents = np.array([0])
    factors = np.array([1])
    heard.tune(agents, factors)
    second = heard.links[1]
    values = heard.values[heard.places[1]]
    assert second.listeners.tolist() == [2, 1]
    assert second.speakers.tolist() == [0, 2]
    new, stayed = values[:, 0, 0]
    assert stayed == 30
    assert np.isnan(new)
    zero = np.zeros((3, 1, 1))
    answer = second.felt(zero, values)
    found = answer.ravel().tolist()
    assert found == [0, 30, 0]


@pytest.mark.parametrize("period", [None, 0.004])
def test_a_vanished_agent_drifts_and_is_heard_by_nobody(period: float | None):
    """Agent 2 is held at 0 by k = 2 until it vanishes at 1 s; then x_2' = d = 1, and agent 1, free,
    stays."""
    constant = dd.Exosystem(A=[[0]], C=[[1]])
    observer = dd.Observer(W=[[5]])
    problem = pair(gains={"2": 2}, exosystem=constant, observer=observer)
    failures = (Failure(agent="2", time=1.0),)
    stress = Stress(period=period, failures=failures)
    x = [[4], [0]]
    xi = [[0], [1]]
    xihat = [[0], [1]]
    start = {"x": x, "xi": xi, "xihat": xihat}
    run = simulate(problem, start=start, t_final=3, samples=31, stress=stress)
    after = run.times >= 1
    wanted = np.where(after, run.times - 1, 0)
    actual = run.x[:, 1, 0]
    np.testing.assert_allclose(actual, wanted, atol=5e-3 if period else 1e-7)
    found = np.ptp(run.x[after, 0, 0])
    assert found < 1e-7
    expected = 4 * np.exp(-1)
    assert run.x[10, 0, 0] == pytest.approx(expected, abs=1e-2 if period else 1e-6)
    assert not run.u[after, 1].any()


def test_a_frozen_agent_keeps_its_input_and_what_others_hear_of_it():
    """At 1 s agent 2 is at exp(-2) with u = -2 exp(-2): it falls on in a line; agent 1 goes to
    exp(-2)."""
    failures = (Failure(agent="2", time=1.0, kind="freeze"),)
    stress = Stress(failures=failures)
    problem = pair(gains={"2": 2})
    start = [[4], [1]]
    run = simulate(problem, start=start, t_final=20, samples=201, stress=stress)
    late = run.times >= 1
    value = np.exp(-2)
    line = value - 2 * value * (run.times[late] - 1)
    actual = run.x[late, 1, 0]
    np.testing.assert_allclose(actual, line, atol=1e-7)
    last = run.x[-1, 0, 0]
    assert last == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    "stress", [Stress(saturation=0.5), Stress(period=0.02, loss=0.2), Stress(loss=0.2)], ids=str
)
def test_moving_agents_can_be_stressed(stress: Stress):
    network = dd.Network.from_arcs({"G": []}, arrow="listens_to", agents=6)
    # the others hear of it
    problem = dd.Problem(network=network, coupling="y", target=[0, 0], gains={"1": 1})
    rng = np.random.default_rng(2)
    start = rng.uniform(-1, 1, size=(6, 2))
    signal = Mobile(radius=1.2, hysteresis=0.1)
    run = simulate(problem, signal=signal, start=start, t_final=4, stress=stress)
    assert len(run.switches) > 1
    assert run.final_error < 0.25  # 0.89 if nobody hears anybody


@pytest.mark.parametrize(
    "stress", [Stress(period=0.4), Stress(saturation=0.01, disturbance=2.0, frequency=0)], ids=str
)
def test_a_stressed_run_that_fails_keeps_what_is_valid(stress: Stress):
    problem = dd.load_problem("paper-fixed")
    horizon = 20 if stress.period else 5
    run = simulate(problem, start=np.arange(10.0), stress=stress, t_final=horizon)
    if stress.period:
        assert run.diverged
        assert "overflows" in run.reason or "exceeded" in run.reason
    assert np.isfinite(run.x).all()
    assert len(run.times) == len(run.x) == len(run.u)
    assert run.final_error > 1


@pytest.mark.parametrize(
    "stress", [Stress(), EVERYTHING, SAMPLED, Stress(period=0.1, sampled_gain=[[1], [2]])], ids=str
)
def test_the_json_of_a_stress_holds_all_of_it(stress: Stress):
    document = json.loads(stress_to_json(stress))
    failures = [Failure(**each) for each in document.pop("failures")]
    assert Stress(**document, failures=failures) == stress
    assert str(stress)


RAGGED = [[1], [2, 3]]
NAN = [[1], [float("nan")]]
TWICE = (Failure(agent="1"), Failure(agent="1"))
STRANGER = Stress(failures=Failure(agent="9"))

WRONG = {  # what is said -> a stress that cannot be
    "noise must be a number >= 0": lambda: Stress(noise=-1),
    "loss must be a prob": lambda: Stress(loss=1.5),
    "saturation must be a number > 0": lambda: Stress(saturation=0),
    "period must be": lambda: Stress(period=0),
    "exchange must be left out": lambda: Stress(period=1, exchange=0.5),
    "sampled_gain needs a period": lambda: Stress(sampled_gain=[[1]]),
    "sampled_gain must be an array of numbers": lambda: Stress(period=1, sampled_gain=RAGGED),
    "sampled_gain must be finite; row 2, column 1": lambda: Stress(period=1, sampled_gain=NAN),
    "failure.kind must be one of": lambda: Failure(agent="1", kind="explode"),
    "fails twice": lambda: Stress(failures=TWICE),
    "failures must be a list of Failure": lambda: Stress(failures=("1",)),
    "no agent has this label": lambda: simulate(single(), stress=STRANGER),
    "samples are too many": lambda: simulate(single(), stress=Stress(period=1e-9)),
}


@pytest.mark.parametrize(("message", "make"), WRONG.items())
def test_a_wrong_stress_is_refused(make, message: str):
    with pytest.raises(SpecError, match=message):
        make()


def test_a_mode_that_switches_within_a_period_is_seen_at_the_next_sample():
    """Modes "on" and "off" alternate every 0.15 s: samples at 0, 0.1 and 0.3 find "on", that at 0.2
    finds "off"."""
    off = [[2, 3]]
    modes = {"on": [[1, 2]], "off": off}
    network = dd.Network.from_arcs(modes, arrow="listens_to")
    problem = dd.Problem(network=network, coupling="y")
    signal = Periodic(dwell=0.15)
    sampled = {"t_final": 0.4, "samples": 5, "stress": Stress(period=0.1)}
    start = [[1], [0], [0]]
    run = simulate(problem, signal=signal, start=start, **sampled)
    wanted = [1.0]
    x = 1.0
    on = [True, True, False, True]
    for each in on:
        x = x - 0.1 * x if each else x
        wanted.append(x)
    actual = run.x[:, 0, 0]
    np.testing.assert_allclose(actual, wanted, atol=1e-12)
