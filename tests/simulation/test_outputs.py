"""Runs of agents whose outputs are measured, against SciPy's solution of states and estimates
written out (theory, section 18)."""

from typing import Any

import numpy as np
import pytest
from measured import CARTS, by_agent, carts, estimates_at_start, floats, whole_loop
from scipy.integrate import solve_ivp, trapezoid
from scipy.linalg import expm

import dobc_design as dd
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.errors import SpecError
from dobc_design.loop.make import errors_of
from dobc_design.simulation.agents import Agents, StressedRuns
from dobc_design.simulation.setting import make_setting


def reference(
    problem: dd.Problem, x: Any, xhat: Any, xi: Any, times: Any, s: Any
) -> tuple[Any, Any]:
    """x (T, n, m) and dhat (T, n, p); ``xi`` and its estimate, 0 at first, by agent; the leader
    starts at ``s``."""
    own = problem.dynamics
    A, B, H = floats(own.A), floats(own.B), floats(own.H)
    n, m = x.shape
    systems = by_agent(problem)
    cuts = np.cumsum([n * m, n * m, *map(len, xi), *map(len, xi)])[:-1]
    target = floats([problem.target])[0]
    u0 = floats([problem.input_at(problem.target)])[0]
    felt = H if own.acts_on else np.eye(m)
    K = {i: floats(gain) for i, gain in problem.pinning.gains.items()}
    curved = problem.coupling.texts[0].startswith("tanh")
    slopes = floats([[g.midpoint for g in row] for row in problem.coupling.jacobian_at_zero()])

    def h(y: Any) -> Any:
        linear = slopes @ y
        return np.tanh(linear) if curved else linear

    def parts(state: Any) -> tuple[Any, Any, list[Any], list[Any]]:
        positions, estimated, *rest = np.split(state, cuts)
        return positions.reshape(n, m), estimated.reshape(n, m), rest[:n], rest[n:]

    def slope(t: float, state: Any) -> Any:
        x, xhat, xi, xihat = parts(state)
        goal = target if s is None else expm(A * t) @ s
        used = (x if own.acts_on else xhat) @ felt.T
        dx, dxhat, dxi, dxihat = [], [], [], []
        for i, (A_xi, C, W) in enumerate(systems):
            v = u0 - C @ xihat[i]
            if i in K:
                v = v - K[i] @ (used[i] - felt @ goal)
            for listener, speaker, w in next(iter(problem.network.modes.values())):
                if listener == i:
                    v = v + float(w) * h(used[speaker] - used[i])
            missed = H @ (x[i] - xhat[i])
            dx.append(A @ x[i] + B @ (v + C @ xi[i]))
            dxhat.append(A @ xhat[i] + B @ (v + C @ xihat[i]) + W[:m] @ missed)
            dxi.append(A_xi @ xi[i])
            dxihat.append(A_xi @ xihat[i] + W[m:] @ missed)
        return np.concatenate([*dx, *dxhat, *dxi, *dxihat])

    start = np.concatenate([x.ravel(), xhat.ravel(), *xi, *(0 * each for each in xi)])
    found = solve_ivp(
        slope, (0, times[-1]), start, t_eval=times, method="DOP853", rtol=1e-10, atol=1e-12
    )
    states = [parts(each) for each in found.y.T]
    estimates = [[C @ each for (_, C, _), each in zip(systems, s[3], strict=True)] for s in states]
    return np.array([s[0] for s in states]), np.array(estimates)


@pytest.mark.parametrize("name", CARTS)
def test_a_run_is_the_solution_for_states_and_estimates(name):
    problem = with_observer(CARTS[name])
    run = dd.simulate(problem, t_final=4, samples=21)
    x = run.x[0]
    xhat = x - estimates_at_start(problem, 4)
    assert np.abs(x - xhat).max() > 0.1
    assert not run.xihat[0].any()
    xi = [floats([row])[0] for row in problem.simulation.xi0]
    s = None if problem.leader is None else run.leader[0]
    wanted, dhat = reference(problem, x, xhat, xi, run.times, s)
    assert np.allclose(run.x, wanted, atol=1e-7)
    assert np.allclose(run.dhat, dhat, atol=1e-7)


@pytest.mark.parametrize("name", ["estimates", "curved outputs", "groups"])
def test_the_full_loop_as_printed_is_that_of_errors(name):
    problem = with_observer(CARTS[name])
    run = dd.simulate(problem, t_final=4, samples=21)
    full = dd.simulate(problem, t_final=4, samples=21, observer="full-loop")
    for part in ("x", "xi", "xihat", "d", "dhat", "u"):
        assert np.allclose(getattr(full, part), getattr(run, part), atol=1e-7), part


@pytest.mark.parametrize("name", ["outputs", "groups"])
def test_a_sampled_loop_comes_near_with_its_period(name):
    """Of first order: the input is held."""
    problem = with_observer(CARTS[name])
    run = dd.simulate(problem, t_final=3, samples=16)
    off = []
    for period in (0.02, 0.01):
        held = dd.simulate(problem, t_final=3, samples=16, stress=dd.Stress(period=period))
        off.append(np.abs(held.x - run.x).max())
    assert off[0] < 0.1 and off[0] == pytest.approx(2 * off[1], rel=0.1)


def test_noise_is_that_of_every_output():
    """Of y = 3 x1 + 4 x2, not of x1 and x2."""
    dynamics = {"A": [[-1, 1], [0, -3]], "B": [[0], [1]], "H": [[3, 4]], "acts_on": "outputs"}
    problem = with_observer(carts(dynamics=dynamics, coupling="y", gains={1: 1}, target=[0, 0]))
    setting = make_setting(
        problem, gain=errors_of(problem).joint_observer.W, stress=dd.Stress(noise=0.5)
    )
    runs = StressedRuns(
        setting=setting,
        starts=[setting.starts.draw(0)],
        seeds=[0],
        switches=[setting.switches(0)],
    )
    agents = Agents(runs, np.arange(2000.0), keep=True)
    noise = np.stack([agents.noise(k)[..., 0] for k in range(2000)])
    assert np.std(noise @ [3, 4]) == pytest.approx(0.5, rel=0.05)


def test_the_worst_disturbance_reaches_the_integral_of_the_impulse_response():
    problem = with_observer(CARTS["outputs"])
    start = {"x": [[1, 0]] * 3, "xi": [[0, 0, 0, 0]] * 3}
    stress = dd.Stress(disturbance=1, worst=True)
    run = dd.simulate(problem, t_final=8, seed=4, start=start, stress=stress)
    M = whole_loop(problem, "G")
    enters = np.zeros((len(M), 3))
    enters[[1, 3, 5], [0, 1, 2]] = 1
    times = np.linspace(0, 8, 4001)
    step = expm(M * times[1])
    responses = []
    for _ in times:
        responses.append(np.abs(enters[4]).sum())
        enters = step @ enters
    assert run.x[-1, 2, 0] - 1 == pytest.approx(trapezoid(responses, times), rel=0.01)


@pytest.mark.parametrize(
    "given", [{"observer": "off"}, {"stress": dd.Stress(period=0.1, sampled_gain=[[1]] * 4)}]
)
def test_what_runs_do_not_know_is_refused_by_name(given):
    with pytest.raises(SpecError, match=r"^dynamics\.H: .*does not know outputs that are measured"):
        dd.simulate(CARTS["estimates"], **given)


@pytest.mark.slow
def test_what_breaks_first_is_found():
    options = ["saturation", "failures"]
    found = dd.what_breaks_first(CARTS["outputs"], options=options, t_final=12)
    assert set(found.order) == set(options)
