"""Simulations against closed forms, matrix exponentials, python-control and CasADi's integrator."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import control
import numpy as np
import pytest
from scipy.linalg import expm

from dobc_design.errors import ShapeError, SpecError
from dobc_design.model.model import build_model
from dobc_design.problem.arrays import consensus_jacobian, goals, pinning_matrix
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.run import simulate

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
PRINTED = Observer(W=[["16/5"], ["12/5"]])


def ring(coupling: str = "exp(y) - 1 + y", **settings) -> Problem:
    """The paper's directed cycle of ten agents."""
    network = Network.from_arcs([[i + 1, (i + 1) % 10 + 1] for i in range(10)], arrow="listens_to", agents=10)
    return Problem(network=network, coupling=coupling, **settings)


def planar() -> Problem:
    """Linear, m = 2, q = 3, formation, matrix gains."""
    return Problem(
        network=Network.from_arcs([[1, 2], [2, 3, 2], [3, 1], [1, 3]], arrow="listens_to"),
        coupling=["2*y1 + y2", "3*y2 - y1"],
        target=[1, -2],
        gains={"1": 3, "3": [[2, 1], [-1, 2]]},
        exosystem=Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]]),
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]),
        offsets={"2": [1, 0]},
        simulation={"t_final": 4, "seed": 3, "xi0": [[1, 0, 2], [0, 1, -1], [3, 0, 0]]},
    )


def test_a_linear_loop_follows_the_matrix_exponential():
    """The error system (22), solved in closed form."""
    problem = planar()
    trajectory = simulate(problem, samples=41)
    A, C, W = (np.array(M, float) for M in (problem.exosystem.A, problem.exosystem.C, problem.observer.W))
    J = consensus_jacobian(problem, "G").toarray()
    loop = np.block(
        [
            [J - pinning_matrix(problem).toarray(), np.kron(np.eye(3), C)],
            [np.zeros((9, 6)), np.kron(np.eye(3), A - W @ C)],
        ]
    )
    eps = trajectory.xi - trajectory.xihat
    start = np.concatenate([(trajectory.x[0] - goals(problem)).ravel(), eps[0].ravel()])
    for k, t in enumerate(trajectory.times):
        wanted = expm(loop * t) @ start
        np.testing.assert_allclose((trajectory.x[k] - goals(problem)).ravel(), wanted[:6], atol=1e-6)
        np.testing.assert_allclose(eps[k].ravel(), wanted[6:], atol=1e-6)


def test_the_linear_loop_agrees_with_python_control():
    problem = ring("y", gains={"1": 5}, target=1)
    trajectory = simulate(problem, t_final=8, samples=81)
    J = consensus_jacobian(problem, "G").toarray() - pinning_matrix(problem).toarray()
    system = control.ss(J, np.zeros((10, 1)), np.eye(10), np.zeros((10, 1)))
    response = control.initial_response(system, T=trajectory.times, X0=trajectory.x[0].ravel() - 1)
    np.testing.assert_allclose(trajectory.x[:, :, 0] - 1, response.outputs.T, atol=1e-6)


def test_a_disturbance_that_nobody_compensates_agrees_with_python_control():
    """W = 0: dhat stays 0 and d acts as an input of the linear loop."""
    problem = ring("y", gains={"1": 5}, exosystem=HARMONIC, observer=Observer(W=[[0], [0]]))
    trajectory = simulate(problem, t_final=6, samples=601)
    assert not trajectory.dhat.any()
    J = consensus_jacobian(problem, "G").toarray() - pinning_matrix(problem).toarray()
    system = control.ss(J, np.eye(10), np.eye(10), np.zeros((10, 10)))
    response = control.forced_response(
        system, T=trajectory.times, U=trajectory.d[:, :, 0].T, X0=trajectory.x[0].ravel()
    )
    # python-control takes the input as piecewise linear, hence the tolerance.
    np.testing.assert_allclose(trajectory.x[:, :, 0], response.outputs.T, atol=1e-4)


def test_the_nonlinear_loop_agrees_with_casadis_integrator():
    """Example 1, integrated by CVODES from the symbolic closed loop."""
    problem = load_problem("paper-fixed")
    trajectory = simulate(problem, t_final=2, samples=5)
    x, xi, z = (ca.SX.sym(name, size) for name, size in (("x", 10), ("xi", 20), ("z", 20)))
    loop = {"x": ca.vertcat(x, xi, z), "ode": ca.vertcat(*build_model(problem).closed_loop(x, xi, z))}
    integrator = ca.integrator("loop", "cvodes", loop, 0, trajectory.times, {"abstol": 1e-11, "reltol": 1e-11})
    x0 = trajectory.x[0].ravel()
    start = np.concatenate([x0, trajectory.xi[0].ravel(), -np.kron(x0, [3.2, 2.4])])
    states = integrator(x0=start)["xf"].full()
    np.testing.assert_allclose(trajectory.x[:, :, 0], states[:10].T, atol=1e-6)


def test_the_disturbance_of_example_1_is_a_sine():
    """(12) with xi(0) = (0.5 sin 1, 0.5 cos 1): d = 0.5 sin(2 t + 1)."""
    trajectory = simulate(load_problem("paper-fixed"))
    wanted = np.broadcast_to(0.5 * np.sin(2 * trajectory.times + 1)[:, None], (401, 10))
    np.testing.assert_allclose(trajectory.d[:, :, 0], wanted, atol=1e-6)


def test_the_observer_of_example_1_tracks_within_one_percent_after_three_seconds():
    """Fig. 3: the printed W."""
    trajectory = simulate(load_problem("paper-fixed"))
    late = trajectory.times >= 3
    assert trajectory.estimation_error()[0] == pytest.approx(0.5 * np.sin(1))
    assert trajectory.estimation_error()[late].max() < 0.01 * np.abs(trajectory.d).max()


@pytest.mark.parametrize("mode", ["Ga", "Gb", "Gc", "Gd"])
def test_the_agents_of_the_examples_reach_the_target(mode: str):
    """Figs. 2 and 4, mode by mode."""
    trajectory = simulate(load_problem("paper-switching"), mode=mode)
    assert not trajectory.diverged
    assert trajectory.mode == mode
    assert trajectory.final_error < 1e-3
    np.testing.assert_allclose(trajectory.x[-1], 1, atol=1e-3)


def test_with_one_pin_the_simulated_decay_is_about_a_quarter():
    """Theory, known answers: about 0.24 on the cycle with one pin k = 5."""
    trajectory = simulate(ring(gains={"1": 5}, target=1), t_final=40)
    assert trajectory.decay_rate() == pytest.approx(0.24, abs=0.05)


def test_starts_without_a_region_are_drawn_within_one_of_the_goal():
    """The verdict is then about the consensus, so the picture starts near it: [0, 2] for xbar = 1."""
    x = np.concatenate([simulate(ring(target=1), t_final=0.1, samples=2, seed=s).x[0].ravel() for s in range(40)])
    assert x.min() >= 0
    assert x.max() <= 2
    assert x.min() < 0.05
    assert x.max() > 1.95


def test_starts_are_drawn_in_the_region_component_by_component():
    network = Network.from_arcs([[i + 1, i] for i in range(1, 50)], arrow="listens_to", agents=50)
    region = {"initial_states": [[10, 11], [-3, -2]]}
    problem = Problem(network=network, coupling="y", target=[0, 0], region=region)
    x = simulate(problem, t_final=0.1, samples=2).x[0]
    assert np.all((x[:, 0] >= 10) & (x[:, 0] <= 11) & (x[:, 1] >= -3) & (x[:, 1] <= -2))


def test_the_estimate_starts_at_zero_and_the_disturbance_where_the_problem_says():
    trajectory = simulate(planar(), samples=2)
    np.testing.assert_allclose(trajectory.xihat[0], 0, atol=1e-15)
    assert trajectory.xi[0].tolist() == [[1, 0, 2], [0, 1, -1], [3, 0, 0]]
    without = simulate(ring(exosystem=HARMONIC, observer=PRINTED, gains=1), samples=2, t_final=1)
    assert np.array_equal(without.xi[0], np.ones((10, 2)))


def test_a_start_at_rest_stays_at_rest():
    """The consensus is an equilibrium (3)."""
    trajectory = simulate(ring(gains=1, target=2, region={"initial_states": [2, 2]}))
    assert not trajectory.error().any()


def test_the_seed_decides_the_start():
    problem = ring(gains=1, simulation={"seed": 7, "t_final": 1})
    first, again, other = simulate(problem, samples=3), simulate(problem, seed=7, samples=3), simulate(problem, seed=8)
    assert np.array_equal(first.x, again.x)
    assert not np.array_equal(first.x[0], other.x[0])
    assert (first.seed, first.t_final) == (7, 1)


def test_the_input_is_that_of_the_controller():
    """(19)."""
    trajectory = simulate(planar(), samples=3)
    controller = build_model(planar()).controller
    for k in range(3):
        wanted = controller(trajectory.x[k].ravel(), trajectory.dhat[k].ravel()).full().ravel()
        np.testing.assert_allclose(trajectory.u[k].ravel(), wanted, atol=1e-12)


def test_shapes_and_labels():
    trajectory = simulate(planar(), samples=7)
    assert trajectory.times.shape == (7,)
    assert trajectory.times[-1] == 4
    assert trajectory.x.shape == trajectory.d.shape == trajectory.dhat.shape == trajectory.u.shape == (7, 3, 2)
    assert trajectory.xi.shape == trajectory.xihat.shape == (7, 3, 3)
    assert trajectory.goal.tolist() == [[1, -2], [2, -2], [1, -2]]
    assert trajectory.labels == ("1", "2", "3")


def test_without_an_exosystem_the_disturbance_is_zero():
    trajectory = simulate(ring(gains={"1": 5}), t_final=1, samples=3)
    assert trajectory.xi.shape == (3, 10, 0)
    assert not trajectory.d.any()
    assert not trajectory.dhat.any()


@pytest.mark.parametrize(
    ("problem", "earliest", "latest"),
    [
        (ring("-y", gains={"1": 1}), 5, 20),
        (ring("-y**3", gains={"1": 1}), 0, 5),
        (ring("1 - exp(y)", gains={"1": 1}), 0, 5),
        (ring("-y**3", gains={"1": 10**7}), 0, 5),
        (ring(gains=1, exosystem=HARMONIC, observer=Observer(W=[[-6], [0]])), 1, 20),
    ],
    ids=["linear", "cubic", "exponential", "cubic and stiff", "observer"],
)
def test_a_run_that_diverges_stops_and_keeps_what_is_valid(problem: Problem, earliest: float, latest: float):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trajectory = simulate(problem)
    assert trajectory.diverged
    assert earliest < trajectory.times[-1] < latest
    assert np.isfinite(trajectory.x).all()
    assert trajectory.final_error > 5 * trajectory.error()[0]
    assert len(trajectory.times) == len(trajectory.x) == len(trajectory.u) < 401
    assert "diverged at about" in str(trajectory)


def test_blow_up_comes_when_the_closed_form_says():
    """x_1' = (x_1 - x_2)^3, where agent 2 is held at 0 almost at once: blow-up at 1/(2 x_1(0)^2)."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=2)
    problem = Problem(network=network, coupling="-y**3", gains={"2": 2000}, region={"initial_states": [0, 2]})
    trajectory = simulate(problem, t_final=5)
    assert trajectory.diverged
    assert trajectory.times[-1] == pytest.approx(1 / (2 * trajectory.x[0, 0, 0] ** 2), rel=5e-3)


@pytest.mark.parametrize("region", [[0, 2000], [0, "1e308"], ["-1e308", "1e308"]])
def test_a_start_at_which_the_field_overflows_is_kept_as_the_only_sample(region):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trajectory = simulate(ring(gains={"1": 5}, region={"initial_states": region}))
    assert trajectory.diverged
    assert trajectory.times.tolist() == [0]


def test_trial_steps_that_overflow_are_rejected_and_the_run_goes_on():
    """exp(50) at the start."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trajectory = simulate(ring(gains={"1": 5}, region={"initial_states": [0, 50]}), t_final=2)
    assert not trajectory.diverged
    assert trajectory.final_error < trajectory.error()[0]


def test_leaving_the_domain_of_the_coupling_ends_the_run():
    """log(1 + y) is undefined below y = -1."""
    trajectory = simulate(ring("log(1 + y)", gains={"1": 5}, region={"initial_states": [0, 5]}))
    assert trajectory.diverged


def test_a_disturbance_that_grows_is_no_divergence():
    """xi' = xi grows to e^20 while the observer follows it."""
    problem = ring("y", gains=1, exosystem=Exosystem(A=[[1]], C=[[1]]), observer=Observer(W=[[5]]))
    trajectory = simulate(problem)
    assert not trajectory.diverged
    assert trajectory.final_error < 1e-6
    assert trajectory.xi[-1].min() == pytest.approx(np.exp(20), rel=1e-6)


@pytest.mark.parametrize(
    ("gains", "observer"), [({"1": 10**6}, PRINTED), ({"1": 5}, Observer(W=[[2 * 10**6], ["12/5"]]))]
)
def test_stiff_loops_are_simulated_in_reasonable_time(gains, observer: Observer):
    trajectory = simulate(ring(gains=gains, exosystem=HARMONIC, observer=observer, target=1))
    assert not trajectory.diverged
    assert trajectory.final_error < 0.1


def test_the_implicit_method_agrees_with_the_matrix_exponential():
    problem = ring("y", gains={"1": 10**5})
    trajectory = simulate(problem, t_final=3, samples=31)
    J = consensus_jacobian(problem, "G").toarray() - pinning_matrix(problem).toarray()
    for k in (1, 10, 30):
        wanted = expm(J * trajectory.times[k]) @ trajectory.x[0].ravel()
        np.testing.assert_allclose(trajectory.x[k].ravel(), wanted, atol=1e-6)


def test_progress_runs_from_zero_to_one():
    parts: list[float] = []
    simulate(ring(gains=1), t_final=2, progress=parts.append)
    assert parts[0] == 0
    assert parts[-1] == 1
    assert parts == sorted(parts)


def test_runs_in_several_threads_do_not_disturb_each_other():
    problem = ring(gains={"1": 5})
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda seed: simulate(problem, seed=seed, t_final=2), [0, 1, 0, 1]))
    assert np.array_equal(runs[0].x, runs[2].x)
    assert np.array_equal(runs[1].x, runs[3].x)


def test_a_gain_can_be_handed_over_and_a_missing_one_is_refused():
    problem = ring(gains=1, exosystem=HARMONIC)
    assert simulate(problem, gain=[["16/5"], ["12/5"]], t_final=1).estimation_error()[-1] < 1
    with pytest.raises(SpecError, match=r"observer\.W must be known to build the observer"):
        simulate(problem)
    with pytest.raises(ShapeError, match="gain must have shape"):
        simulate(problem, gain=[[1]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mode": "H"}, "mode must be one of"),
        ({"t_final": 0}, "t_final must be a time > 0"),
        ({"t_final": float("nan")}, "t_final must be a time > 0"),
        ({"t_final": "soon"}, "got soon"),
        ({"seed": -1}, "seed must be a whole number >= 0"),
        ({"samples": 1}, "samples must be a whole number >= 2"),
        ({"seed": True}, "seed must be a whole number"),
        ({"samples": 2.5}, "samples must be a whole number"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message: str):
    with pytest.raises(SpecError, match=message):
        simulate(ring(), **arguments)


def test_a_horizon_beyond_the_floats_is_refused():
    with pytest.raises(SpecError, match="within the range of floats"):
        simulate(ring(simulation={"t_final": "1e400"}))
