"""Runs as bad as [uncertainty] and [actuators] allow: they attain the worst case of linear loops,
and no more."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from simulated_runs import HARMONIC, PRINTED

import dobc_design as dd
from dobc_design.simulation import worst
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.worst import STEPS, Worst, worst_signal

BOUND = 0.1 * (1 + 1.33276)  # theory, section 12: omega (1 + |C e^(F t) W|_1) for the paper's data
SHARES = (1, 3, 5 / 2, 2, 3 / 2) * 2  # M^-1 1 of the linearised network


def paper(**changes: object) -> dd.Problem:
    given = {"coupling": "2*y", "uncertainty": {"disturbance": "0.1"}, "region": None} | changes
    return dd.load_problem("paper-fixed").replace(**given)


def pair(**changes: object) -> dd.Problem:
    arcs = [[2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    return dd.Problem(network=network, coupling="y", gains={1: 1}, **changes)


def largest(agent: int) -> float:
    """0.1 times the integral of |response of the agent to every residual|, by SciPy: [e; eps], w
    enters both."""
    own = np.eye(10)
    ring = np.roll(own, 1, axis=1)
    pulls = np.zeros(10)
    pulls[[0, 5]] = 5.0
    A = np.array([[0, 2], [-2, 0]])
    C = np.array([[1, 0]])
    W = np.array([[3.2], [2.4]])
    M = np.zeros((30, 30))
    coupled = 2 * (ring - own)
    M[:10, :10] = coupled - np.diag(pulls)
    M[:10, 10:] = np.kron(own, C)
    M[10:, 10:] = np.kron(own, A - W @ C)
    blocks = [own, -np.kron(own, W)]
    entry = np.vstack(blocks)
    step = expm(M * 0.002)
    row = np.eye(30)[agent]
    total = 0.0
    for _ in range(15_000):
        total += 0.002 * np.abs(row @ entry).sum()
        row = row @ step
    return 0.1 * total


@pytest.mark.parametrize("agent", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_the_worst_run_attains_what_the_linear_loop_allows_and_none_exceeds_the_bound(agent: int):
    given = {"t_final": 12, "samples": 31, "tolerance": 1e-6, "seed": 10 + agent}
    start = np.ones((10, 1))
    run = dd.simulate(paper(), stress="worst", start=start, **given)
    reached = np.abs(run.x - 1)[:, :, 0]
    largest_reached = reached.max(axis=0)
    assert (largest_reached <= BOUND * np.array(SHARES)).all()
    last = reached[-1, agent]
    assert 0.97 * largest(agent) < last < 1.01 * largest(agent)


def test_without_an_observer_the_worst_case_of_a_positive_loop_is_attained():
    """Chain of two: a constant 0.1 on both gives e = (0.1, 0.2)."""
    problem = pair(uncertainty={"disturbance": "0.1"})
    start = {"x": [[0], [0]]}
    run = dd.simulate(problem, stress="worst", start=start, t_final=30, samples=31)
    last = run.x[-1, :, 0]
    assert last == pytest.approx([0.1, 0.2], abs=1e-6)
    assert "switched to be as bad as it can be" in " ".join(run.notes)


def test_runs_of_an_ensemble_are_the_single_ones(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(worst, "STEPS", 20)
    problem = pair(uncertainty={"disturbance": "0.1"}, exosystem=HARMONIC, observer=PRINTED)
    given = {"stress": "worst", "t_final": 2, "samples": 9, "tolerance": 1e-6}
    many = dd.simulate(problem, runs=2, seed=5, **given)
    one = dd.simulate(problem, seed=6, **given)
    sizes = np.abs(one.x)
    wanted = sizes.max(axis=(1, 2))
    assert many.error[1] == pytest.approx(wanted, rel=1e-6)


def test_the_run_is_that_of_another_integrator():
    actuators = {"limit": {1: "0.05"}}
    problem = pair(uncertainty={"disturbance": "0.1"}, actuators=actuators)
    start = {"x": [[1], [-1]]}
    run = dd.simulate(problem, stress="worst", start=start, t_final=3, samples=7)

    def slope(time: float, e: np.ndarray) -> list[float]:
        first = np.clip(-e[0], -0.05, 0.05) + 0.1
        second = e[0] - e[1] + 0.1
        return [first, second]

    other = solve_ivp(slope, (0, 3), [1, -1], t_eval=run.times, rtol=1e-9, atol=1e-11)
    found = run.x[:, :, 0]
    assert found == pytest.approx(other.y.T, abs=1e-5)


def test_signs_of_a_run_are_those_of_the_impulse_response_reversed():
    """The response of the observer's error turns: d = w + C eps rings at 2 rad/s."""
    gain = dd.load_problem("paper-fixed").observer.W
    setting = make_setting(paper(), gain=gain, t_final=10.0)
    signs = Worst(paper(), setting.loop, [0], observed=True).signs(1.0, horizon=10.0)
    assert signs.values.shape == (STEPS, 10, 1, 1)
    own = signs.values[:, 0, 0, 0]
    assert own[-1] == 1
    assert 1 < np.count_nonzero(np.diff(own)) < 20
    integral = signs.integral(0, 10)[0, 0, 0]
    expected = own.sum() * 10 / STEPS
    assert integral == pytest.approx(expected)


def links(modes: dict[str, list[list[int]]], n: int, **turns: object) -> dd.Problem:
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=n)
    own = dd.Switching(**({"guarantee": "dwell", "dwell": 1} | turns))
    return dd.Problem(network=network, coupling="y", gains={1: 1}, switching=own)


def test_the_slowest_signal_of_three_agents_is_the_one_on_paper():
    """Agent 3 hears in A for a s, agent 2 in B for b s: the rate is min (a, b) / (a + b), the least
    for 1 and 2 s."""
    modes = {"A": [[3, 2]], "B": [[2, 1]]}
    problem = links(modes, 3, longest=2)
    assert sorted(worst_signal(problem).dwell) == [1, 2]
    start = {"x": [[1], [1], [1]]}
    given = {"start": start, "t_final": 36, "samples": 13}
    run = dd.simulate(problem, stress="worst", **given)
    assert run.stress == ""
    assert "keep the guarantee" in run.notes[0]
    last = run.error()[-1]
    before = run.error()[-5]
    factor = last / before
    assert factor == pytest.approx(np.exp(-12 / 3), rel=1e-3)
    for seed in range(3):
        usual = dd.simulate(problem, seed=seed, **given)
        assert run.final_error > 3 * usual.final_error


def test_without_a_longest_time_it_stays_in_the_slowest_mode():
    """(3 - sqrt(5))/2 in B, where agent 1 hears agent 2; 1 in A."""
    modes = {"A": [[2, 1]], "B": [[2, 1], [1, 2]]}
    problem = links(modes, 2)
    assert worst_signal(problem).order == ("B",)
    run = dd.simulate(problem, stress="worst", t_final=4)
    assert run.switches.names[run.switches.modes[0]] == "B"
    assert len(run.switches) == 1


WITHOUT_CHOICE = [{"guarantee": "sequence"}, {"guarantee": "arbitrary"}]
WITHOUT_CHOICE.append({"guarantee": None, "signal": "random"})


@pytest.mark.parametrize("turns", WITHOUT_CHOICE)
def test_where_the_guarantee_leaves_no_choice_there_is_no_worst_signal(turns: dict[str, object]):
    modes = {"A": [[2, 1]], "B": []}
    problem = links(modes, 2, **turns)
    assert worst_signal(problem) is None
    with pytest.raises(dd.errors.SpecError, match="and no signal"):
        dd.simulate(problem, stress="worst")


def test_signals_and_stress_are_at_their_worst_together():
    modes = {"A": [[2, 1]], "B": []}
    problem = links(modes, 2, longest=2)
    problem = problem.replace(uncertainty={"disturbance": "0.1"})
    run = dd.simulate(problem, stress="worst", t_final=3)
    assert "worst" in run.stress
    assert "periodic" in run.signal


def test_a_problem_that_bounds_nothing_is_refused():
    problem = pair(uncertainty={"weights": "0.1"})
    with pytest.raises(dd.errors.SpecError, match="bounds no disturbance"):
        dd.simulate(problem, stress="worst")


def left_out(problem: dd.Problem, **given: object) -> list[str]:
    notes = dd.simulate(problem, t_final=1, **given).notes
    return [each for each in notes if each.startswith("Not")]


def test_a_run_without_stress_says_which_tables_it_leaves_out():
    assert left_out(pair()) == []
    told = "Not simulated: what [uncertainty] of the file states."
    found = left_out(pair(uncertainty={"weights": "0.1"}))
    assert found == [told]
    both = pair(uncertainty={"disturbance": "0.1"}, actuators={"limit": 3})
    told = (
        "Not simulated: what [uncertainty] and [actuators] of the file states; `dobc stress FILE "
        "--worst` applies the limits, disturbance and noise."
    )
    assert left_out(both) == [told]
    assert left_out(both, stress="worst") == []
