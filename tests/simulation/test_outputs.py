"""Runs of agents whose outputs are measured, against SciPy's solution of states and estimates
written out (theory, section 18)."""

from typing import Any

import numpy as np
import pytest
from measured import by_agent, floats
from networks import network_of
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import dobc_design as dd
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.errors import SpecError
from dobc_design.loop.make import errors_of
from dobc_design.simulation.setting import make_setting

DAMPED = {"A": [[0, 1], [0, -3]], "B": [[0], [1]], "H": [[1, 0]]}
SINE = dd.Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
CONSTANT = dd.Exosystem(A=[[0]], C=[[1]])


def agents(**given: Any) -> dd.Problem:
    """Three carts in a row, of which the first is pinned."""
    sound = {
        "simulation": {"xi0": START},
        "dynamics": DAMPED,
        "coupling": "2*y1 + 3*y2",
        "gains": {1: [[4, 4]]},
        "target": [1, 0],
        "observer": dd.Observer(rate=1),
    }
    if "groups" not in given:
        sound["exosystem"] = SINE
    return dd.Problem(network=network_of([[2, 1], [3, 2]], 3), **sound | given)


START = [[0.5, -0.25], [1, 0], [-0.5, 0.75]]
OUTPUTS = {"dynamics": DAMPED | {"acts_on": "outputs"}, "gains": {1: 4}}
GROUPS = [
    dd.Group(agents=[1, 3], exosystem=SINE),
    dd.Group(agents=[2], exosystem=CONSTANT),
]
PROBLEMS = {
    "estimates": agents(),
    "outputs": agents(coupling="2*y", **OUTPUTS),
    "curved": agents(coupling="tanh(2*y1 + 3*y2)"),
    "curved outputs": agents(coupling="tanh(y)", **OUTPUTS),
    "leader": agents(target=[0, 0], leader={"initial": [[0, 1], [1, 1]]}, dynamics=DAMPED),
    "groups": agents(groups=GROUPS, simulation={"xi0": [START[0], [1], START[2]]}),
}


def estimates_at_start(problem: dd.Problem, horizon: float) -> np.ndarray:
    """x - xhat (n, m) as it is drawn; a run does not say it."""
    setting = make_setting(
        problem,
        gain=errors_of(problem).joint_observer.W,
        mode=None,
        signal=None,
        start=None,
        t_final=horizon,
        seed=None,
        samples=None,
        observer="closed-form",
        tolerance=1e-9,
        stress=None,
    )
    eps = setting.starts.draw(setting.seed).xi
    off = []
    first = 0
    for group in problem.groups:
        off.append(eps[:, first : first + problem.m])
        first += problem.m + group.exosystem.order
    return np.sum(off, axis=0)


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


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_run_is_the_solution_for_states_and_estimates(name):
    problem = with_observer(PROBLEMS[name])
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


def test_a_stress_is_refused_by_name():
    with pytest.raises(SpecError, match=r"^dynamics\.H: .*does not know outputs that are measured"):
        dd.simulate(agents(), observer="full-loop")
