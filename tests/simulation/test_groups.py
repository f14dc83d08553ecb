"""Simulation and model where agents have different exosystems, against the loop written out agent
by agent."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulated_runs import HARMONIC, PRINTED, require_the_same

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.export import python_script

ARCS = [(0, 1), (1, 2), (2, 0)]
GAINS = (3.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def problem() -> dd.Problem:
    """Agents 1 and 3 feel a sine, agent 2 a ramp."""
    C = [[1, 0, 1]]
    A = [[0, 1, 0], [0, 0, 0], [0, 0, -1]]
    ramp = dd.Exosystem(A=A, C=C)
    sines = dd.Group(agents=[1, 3], exosystem=HARMONIC, observer=PRINTED)
    W = [[3], [2], [0]]
    observer = dd.Observer(W=W)
    ramps = dd.Group(agents=[2], exosystem=ramp, observer=observer)
    xi0 = [[1, "1/2"], ["0.3", "-0.2", 1], [-1, 2]]
    arcs = [[1, 2], [2, 3], [3, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    gains = {1: 3, 3: 1}
    simulation = {"t_final": 6, "xi0": xi0}
    return dd.Problem(
        network=network,
        coupling="tanh(y) + y",
        gains=gains,
        target=1,
        groups=[sines, ramps],
        simulation=simulation,
    )


SINE = (np.array([[0, 2.0], [-2, 0]]), np.array([1, 0.0]), np.array([3.2, 2.4]))
RAMP = (
    np.array([[0, 1.0, 0], [0, 0, 0], [0, 0, -1]]),
    np.array([1, 0, 1.0]),
    np.array([3.0, 2, 0]),
)
OWN = (SINE, RAMP, SINE)
XI0 = ([1, 0.5], [0.3, -0.2, 1], [-1, 2])


def by_hand(start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """x of the loop (1), (12), (13), (19), every agent with matrices of its own size."""

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        x = state[:3]
        rest = state[3:]
        felt = np.zeros(3)
        for i, j in ARCS:
            pull = np.tanh(x[j] - x[i])
            felt[i] += pull + x[j] - x[i]
        out = [np.zeros(3)]
        for i, (A, C, W) in enumerate(OWN):
            q = len(A)
            xi = rest[:q]
            z = rest[q : 2 * q]
            rest = rest[2 * q :]
            xihat = z + W * x[i]
            u = -GAINS[i] * (x[i] - 1) - C @ xihat
            out[0][i] = felt[i] + u + C @ xi
            own = (A - np.outer(W, C)) @ xihat
            correction = W * (felt[i] + u)
            out += [A @ xi, own - correction]
        return np.concatenate(out)

    first = [start]
    for i, (_, _, W) in enumerate(OWN):
        first += [XI0[i], -W * start[i]]
    span = (0, times[-1])
    done = solve_ivp(slope, span, np.concatenate(first), t_eval=times, rtol=1e-11, atol=1e-12)
    return np.asarray(done.y[:3].T)


@pytest.mark.parametrize("observer", ["closed-form", "full-loop"])
def test_a_run_is_that_of_the_loop_written_out_agent_by_agent(problem, observer):
    start = [[2.0], [-1.0], [0.5]]
    run = dd.simulate(problem, observer=observer, start=start, t_final=3, samples=31)
    positions = run.x[:, :, 0]
    apart = positions - by_hand(run.x[0, :, 0], run.times)
    found = np.abs(apart).max()
    assert found < 1e-7
    wanted = [[1, 0.5, 0, 0, 0], [0, 0, 0.3, -0.2, 1], [-1, 2, 0, 0, 0]]
    assert np.array_equal(run.xi[0], wanted)
    assert not run.xi[:, 0, 2:].any()
    assert not run.xihat[:, 1, :2].any()


def test_ensembles_under_stress_are_the_runs_one_by_one(problem):
    """Noise makes the error of every agent's own observer jump."""
    stress = dd.Stress(noise=0.05, saturation=2.0, loss=0.2)
    require_the_same(problem, stress, runs=2, close=3e-8, tolerance=1e-10, t_final=0.5)
    sampled = dd.Stress(period=0.05, noise=0.05, disturbance=0.1, loss=0.2)
    require_the_same(problem, sampled, runs=2, close=1e-12, t_final=0.5)
    moved = dd.Stress(disturbance=0.1)
    require_the_same(problem, moved, runs=2, close=3e-8, tolerance=1e-10, t_final=0.5)


def test_drawn_disturbances_stay_in_the_states_of_the_own_group_and_in_their_ball(problem):
    given = dict(problem.__reduce__()[0].keywords)
    region = {"initial_states": [0, 2], "initial_disturbance": "0.5"}
    given |= {"simulation": {}, "region": region}
    runs = []
    for seed in range(20):
        runs.append(dd.simulate(dd.Problem(**given), seed=seed, t_final=0.1))
    starts = np.array([run.xi[0] for run in runs])
    assert not starts[:, 0, 2:].any()
    assert not starts[:, 1, :2].any()
    lengths = np.linalg.norm(starts, axis=2)
    assert lengths.max() <= 0.5
    assert lengths.min(axis=0).max() < 0.45
    no_region = dd.Problem(**given | {"region": None})
    run_of_ones = dd.simulate(no_region, t_final=0.1)
    ones = run_of_ones.xi[0]
    wanted = [[1, 1, 0, 0, 0], [0, 0, 1, 1, 1], [1, 1, 0, 0, 0]]
    assert np.array_equal(ones, wanted)


def test_what_breaks_first_knows_groups_and_a_start_in_the_states_of_another_is_refused(problem):
    found = dd.what_breaks_first(problem, options=["saturation"], t_final=4)
    assert found.sweeps[0].option == "saturation"
    first_read = [1, 1, 0, 0, 0]
    second_read = [1, 0, 0, 0, 0]
    third_read = [1, 1, 0, 0, 0]
    foreign = [first_read, second_read, third_read]
    told = r"start\.xi must be 0 in the states that belong to other groups; row 1"
    with pytest.raises(SpecError, match=told):
        dd.simulate(problem, start={"xi": foreign})


def test_the_model_has_the_right_hand_side_of_the_simulation(problem):
    model = dd.build_model(problem)
    samples = [0.0, 0.5, 6.0]
    run = dd.simulate(problem, observer="full-loop", samples=samples)
    W = np.array([[3.2, 2.4, 0, 0, 0], [0, 0, 3, 2, 0], [3.2, 2.4, 0, 0, 0]])
    z = run.xihat[1] - W * run.x[1]
    x = run.x[1].ravel()
    xi = run.xi[1].ravel()
    parts = model.closed_loop(x, xi, z.ravel())
    x_dot, xi_dot, z_dot = (np.asarray(ca.DM(part)).reshape(3, -1) for part in parts)
    for i, (A, C, gain) in enumerate(OWN):
        own = slice(2, 5) if i == 1 else slice(0, 2)
        felt = x_dot[i, 0] - C @ run.xi[1, i, own]
        wanted = A @ run.xi[1, i, own]
        assert xi_dot[i, own] == pytest.approx(wanted)
        error_matrix = A - np.outer(gain, C)
        estimate = run.xihat[1, i, own]
        expected = error_matrix @ estimate - gain * felt
        assert z_dot[i, own] == pytest.approx(expected, rel=1e-6, abs=1e-9)
        found = np.count_nonzero(z_dot[i])
        assert found == np.count_nonzero(z_dot[i, own])
    assert model.q == 5


@pytest.mark.parametrize("use", [python_script, dd.export.to_sdpa])
def test_what_does_not_know_groups_yet_says_so(problem, use):
    with pytest.raises(SpecError, match=r"exosystem\.groups: this is not available yet") as caught:
        use(problem)
    assert caught.value.key == "exosystem.groups"
    assert "certify" in str(caught.value)
