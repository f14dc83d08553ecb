"""Simulated agents with [dynamics] against SciPy's solution of the whole loop, written out with A
and B."""

import numpy as np
import pytest
from agents import (
    double_integrators,
    drift,
    felt,
    full_loop,
    matrices,
    pendulums,
    three_states,
)
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import dobc_design as dd
from dobc_design.problem.dynamics import Dynamics

PROBLEMS = [double_integrators(), three_states(), pendulums()]
EACH = pytest.mark.parametrize("problem", PROBLEMS, ids=["carts", "plants", "pendulums"])


def alone(dynamics: Dynamics, coupling: str = "y", **given) -> dd.Problem:
    """One agent, which nobody hears."""
    network = dd.Network.from_arcs([], arrow="listens_to", agents=["a"])
    return dd.Problem(network=network, dynamics=dynamics, coupling=coupling, **given)


def reference(problem, start, times, limit=np.inf, rtol=1e-11):
    """x (T, n, m) and u (T, n, p) of the full loop from x, with xi = that of the run, xihat = 0."""
    x, xi = start
    z = -x @ matrices(problem)["W"].T
    slope, control = full_loop(problem, limit)
    arrays = [x.ravel(), xi.ravel(), z.ravel()]
    state = np.concatenate(arrays)
    t_span = (0, times[-1])
    found = solve_ivp(
        slope, t_span, state, t_eval=times, method="DOP853", rtol=rtol, atol=rtol / 10
    )
    assert found.success
    states = found.y.T
    u = np.array([control(each) for each in states])
    positions = states[:, : x.size]
    return positions.reshape(-1, *x.shape), u


@pytest.mark.parametrize("observer", ["closed-form", "full-loop"])
@EACH
def test_run_is_the_solution_of_the_full_loop(problem, observer):
    """(1), (12), (13), (19); u has p components and holds u0."""
    run = dd.simulate(problem, t_final=3, samples=41, observer=observer)
    start = (run.x[0], run.xi[0])
    x, u = reference(problem, start, run.times)
    assert run.u.shape == run.d.shape == run.dhat.shape == (41, problem.n, problem.inputs)
    assert np.allclose(run.x, x, atol=1e-7)
    assert np.allclose(run.u, u, atol=1e-7)
    C = matrices(problem)["C"]
    wanted = run.xi @ C.T
    assert np.allclose(run.d, wanted, atol=1e-12)


@EACH
def test_saturation_limits_the_true_input(problem):
    """|u_i| <= 0.7 with u0 in it; A x acts on, and the observer is told what is applied."""
    limited = dd.Stress(saturation=0.7)
    run = dd.simulate(problem, t_final=1, samples=11, stress=limited)
    start = (run.x[0], run.xi[0])
    x, u = reference(problem, start, run.times, limit=0.7, rtol=1e-9)
    assert np.abs(run.u).max() == 0.7
    assert np.allclose(run.x, x, atol=1e-6)
    assert np.allclose(run.u, u, atol=1e-6)
    last = run.estimation_error()[-1]
    shrinks = last < run.estimation_error()[0]
    assert shrinks or problem.name == "plants"


def test_agent_that_fails_moves_by_its_own_dynamics():
    """Input 0, couplings go on: a lone agent x' = A x + B u with u0 = -B+ A x falls to e^(A t)
    x."""
    A = [[0, 1], [-1, "-1/2"]]
    B = [[0], [1]]
    plant = Dynamics(A=A, B=B)
    gains = {"a": [[1, 1]]}
    problem = alone(plant, "y1", target=[1, 0], gains=gains)
    given = {"t_final": 3, "samples": 31, "start": [[1, 0]]}
    failures = [dd.Failure(agent="a", time=1.0)]
    vanished = dd.Stress(failures=failures)
    run = dd.simulate(problem, stress=vanished, **given)
    assert np.allclose(run.u[run.times < 1], 1.0)
    assert not run.u[run.times >= 1].any()

    def falls(time, x):
        return [x[1], -x[0] - x[1] / 2]

    later = run.times[10:]
    free = solve_ivp(falls, (1, 3), [1, 0], t_eval=later, rtol=1e-10, atol=1e-12)
    states = run.x[10:, 0]
    assert np.allclose(states, free.y.T, atol=1e-7)
    failures = [dd.Failure(agent="a", time=1.0, kind="freeze")]
    frozen = dd.Stress(failures=failures)
    run = dd.simulate(problem, stress=frozen, **given)
    assert np.allclose(run.x, [1, 0], atol=1e-9)


def test_ensembles_are_their_single_runs():
    """Runs side by side and one by one: errors, and d - dhat with p components."""
    cases = (None, dd.Stress(saturation=2.0, noise=0.01, loss=0.2, disturbance=0.1))
    for stress in cases:
        given = {"t_final": 0.15, "samples": 4, "stress": stress}
        for problem in PROBLEMS:
            many = dd.simulate(problem, runs=2, **given)
            seed = int(many.seeds[1])
            one = dd.simulate(problem, seed=seed, **given)
            assert np.allclose(many.error[1], one.error(), atol=1e-6)
            assert np.allclose(many.estimation_error[1], one.estimation_error(), atol=1e-6)


def test_observer_is_told_what_it_can_know():
    """Noise acts on the A x of the observer, too; without it the estimation error is that of the
    closed form."""
    problem = PROBLEMS[0]
    given = {"t_final": 1, "samples": 9}
    calm = dd.simulate(problem, **given)
    stress = dd.Stress(saturation=0.5)
    limited = dd.simulate(problem, stress=stress, **given)
    calm_error = calm.d - calm.dhat
    limited_error = limited.d - limited.dhat
    assert np.allclose(calm_error, limited_error, atol=1e-7)


def test_matched_disturbance_reaches_the_state_through_b():
    """frequency 0: a constant w per input; near the goal x' = A e + B (-K e + w), so that B K e = B
    w at rest."""
    A = [[0, 1], [0, 0]]
    B = [[0], [2]]
    plant = Dynamics(A=A, B=B)
    gains = {"a": [[2, 2]]}
    problem = alone(plant, "y1", target=[0, 0], gains=gains)
    constant = dd.Stress(disturbance=0.5, frequency=0.0)
    origin = [[0, 0]]
    run = dd.simulate(problem, t_final=40, start=origin, stress=constant)
    last = run.x[-1, 0]
    disturbance = run.d[-1, 0, 0]
    wanted = [disturbance / 2, 0]
    assert last == pytest.approx(wanted, abs=1e-7)


def test_switching_runs_and_files(tmp_path):
    """Two modes; a run is read back from its file with its p inputs; what is unknown is refused by
    its key."""
    one = [["a", "b"], ["b", "c"], ["c", "a"]]
    two = [["b", "a"], ["c", "b"]]
    modes = {"one": one, "two": two}
    labels = ["a", "b", "c"]
    network = dd.Network.from_arcs(modes, arrow="listens_to", agents=labels)
    switching = dd.Switching(signal="random", dwell=0.5)
    problem = PROBLEMS[0].replace(network=network, switching=switching)
    run = dd.simulate(problem, t_final=10, samples=21, tolerance=1e-6)
    assert len(run.switches) > 5
    assert run.final_error < 0.1 * run.error()[0]
    again = dd.load_trajectory(run.save(tmp_path / "run.npz"))
    assert np.array_equal(again.u, run.u)
    assert again.u.shape == (21, 3, 1)
    stress = dd.Stress(disturbance=0.1, worst=True)
    worst = dd.simulate(problem, runs=2, t_final=0.5, stress=stress)
    assert worst.error.shape == (2, 401)


@EACH
def test_samples_between_the_instants_are_those_of_the_held_input(problem):
    """x' = f(x) or A x + B (couplings + u + d) with what was held at the instant, and a disturbance
    besides d."""
    data = matrices(problem)
    period = 0.2
    stress = dd.Stress(period=period, disturbance=0.3, frequency=0.0)
    run = dd.simulate(problem, t_final=1, samples=11, stress=stress)
    other = (run.d - run.xi @ data["C"].T)[0]
    own = drift(problem)
    for k in range(0, 10, 2):

        def slope(time, state, k=k):
            motion = expm(data["S"] * time).T
            harmonic = run.xi[k] @ motion
            d = harmonic @ data["C"].T + other
            errors = run.x[k] - data["goals"]
            held = felt(problem, errors) + run.u[k]
            free = own(state.reshape(3, -1))
            driven = (held + d) @ data["B"].T
            return (free + driven).ravel()

        at = [0.1, period]
        start = run.x[k].ravel()
        found = solve_ivp(slope, (0, period), start, t_eval=at, rtol=1e-10, atol=1e-12)
        steps = run.x[k + 1 : k + 3]
        actual = steps.reshape(2, -1)
        np.testing.assert_allclose(actual, found.y.T, atol=1e-7)
    assert np.abs(other).max() > 0.1


def test_agents_that_leave_within_a_period_end_their_run_alone():
    """x' = x^3 from x0: at infinity after 1/(2 x0^2) s, 0.617 s from 0.9; from starts near 0 not
    within 3 s."""
    problem = alone(Dynamics(f=["x**3"]))
    stress = dd.Stress(period=1.0)
    run = dd.simulate(problem, t_final=1, samples=11, start=[[0.9]], stress=stress, tolerance=1e-8)
    assert run.diverged
    assert "collapsed" in run.reason
    assert run.times[-1] == pytest.approx(0.6)
    first = run.x[:, 0, 0]
    inverse_square = 1 / 0.81 - 2 * run.times
    wanted = 1 / np.sqrt(inverse_square)
    assert first == pytest.approx(wanted, rel=1e-6)
    many = dd.simulate(problem, t_final=3, samples=31, runs=8, stress=stress, tolerance=1e-5)
    lost = np.isnan(many.error[:, -1])
    assert 0 < lost.sum() < 8


def test_agents_that_are_too_stiff_between_samples_end_their_run(monkeypatch: pytest.MonkeyPatch):
    """x' = -1e6 x^3 + 1 from 1: after a layer 1e6 x^3 = 1; 1e18 needs 250,000 explicit steps a
    period."""
    monkeypatch.setattr("dobc_design.simulation.sampled.LEAST_STEPS", 200)
    stress = dd.Stress(period=0.5)
    loose = (6, "1/100", False)
    tight = (18, "1e-6", True)
    for k, target, stiff in (loose, tight):
        problem = alone(Dynamics(f=[f"-1e{k}*x**3 + 1"]), target=target)
        run = dd.simulate(problem, t_final=1, samples=3, start=[[1]], stress=stress)
        assert run.diverged is stiff
        assert ("too stiff for 200 steps" in run.reason) is stiff
        assert stiff or run.x[1:] == pytest.approx(0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "problem", [PROBLEMS[0], pytest.param(PROBLEMS[2], marks=pytest.mark.evidence)]
)
def test_what_breaks_first_knows_the_period(monkeypatch: pytest.MonkeyPatch, problem):
    monkeypatch.setattr("dobc_design.simulation.breaking.OPTIONS", ("saturation", "period"))
    found = dd.what_breaks_first(problem, t_final=6)
    answer = [each.option for each in found.sweeps]
    assert answer == ["saturation", "period"]
    assert found.period.converges > 0.05


def test_an_agent_with_fewer_inputs_than_states_can_vanish():
    """What it says has a number for every state, what it commands one for every input."""
    problem = three_states()
    gone = dd.Failure(agent=problem.network.labels[0], time=0.1)
    stress = dd.Stress(failures=[gone])
    run = dd.simulate(problem, t_final=0.2, samples=3, stress=stress)
    assert run.u.shape[2] < run.x.shape[2]
    assert not run.u[1:, 0].any()
    assert run.u[0, 0].any()
    assert np.isfinite(run.x).all()
