"""Runs against answers from elsewhere: matrix exponentials, Taylor series at 40 digits, CasADi's CVODES."""

from __future__ import annotations

from functools import reduce

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from dobc_design.model.model import build_model
from dobc_design.problem.arrays import consensus_jacobian, pinning_matrix
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.run import simulate
from dobc_design.simulation.signals import Periodic, Schedule

ROUTES = ("closed-form", "full-loop")


def planar() -> Problem:
    """Linear, m = 2, q = 3, two modes, formation, matrix gains, weights."""
    return Problem(
        network=Network.from_arcs(
            {"one": [[1, 2], [2, 3, 2], [3, 1], [1, 3]], "two": [[1, 3, "1/2"], [2, 1]]}, arrow="listens_to", agents=3
        ),
        coupling=["2*y1 + y2", "3*y2 - y1"],
        target=[1, -2],
        gains={"1": 3, "3": [[2, 1], [-1, 2]]},
        exosystem=Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, 0]], C=[[1, 0, 1], [0, 1, 0]]),
        observer=Observer(W=[[2, 0], [0, 2], [1, 0]]),
        offsets={"2": [1, 0]},
        simulation={"t_final": 4, "seed": 3, "xi0": [[1, 0, 2], [0, 1, -1], [3, 0, 0]]},
    )


def error_system(problem: Problem, mode: str):
    """The matrix of (22)."""
    A, C, W = (np.array(M, float) for M in (problem.exosystem.A, problem.exosystem.C, problem.observer.W))
    n, m, q = problem.n, problem.m, problem.q
    J = consensus_jacobian(problem, mode).toarray() - pinning_matrix(problem).toarray()
    return np.block([[J, np.kron(np.eye(n), C)], [np.zeros((n * q, n * m)), np.kron(np.eye(n), A - W @ C)]])


def errors(trajectory, k: int):
    x = (trajectory.x[k] - trajectory.goal).ravel()
    return np.concatenate([x, (trajectory.xi[k] - trajectory.xihat[k]).ravel()])


@pytest.mark.parametrize("observer", ROUTES)
def test_a_linear_loop_follows_the_matrix_exponential_to_a_billionth(observer: str):
    """(22) in closed form, at every sample."""
    problem = planar()
    run = simulate(problem, mode="one", samples=41, observer=observer, tolerance=1e-12)
    loop = error_system(problem, "one")
    for k, t in enumerate(run.times):
        np.testing.assert_allclose(errors(run, k), expm(loop * t) @ errors(run, 0), atol=1e-9)


@pytest.mark.parametrize("observer", ROUTES)
def test_a_switched_linear_loop_is_the_product_of_its_exponentials(observer: str):
    """Instants that no step of equal length would meet; a switch late by 1e-9 s would be seen."""
    problem = planar()
    signal = Schedule(times=[0, 0.7390851, 1.6180339, 3.1415926], modes=["one", "two", "one", "two"])
    run = simulate(problem, signal=signal, samples=5, observer=observer, tolerance=1e-12)
    stays = np.diff([*signal.times, 4.0])
    product = reduce(
        lambda total, each: expm(error_system(problem, each[1]) * each[0]) @ total,
        zip(stays, signal.modes, strict=True),
        np.eye(15),
    )
    np.testing.assert_allclose(errors(run, -1), product @ errors(run, 0), atol=1e-9)
    assert run.switches.times.tolist() == list(signal.times)
    late = np.linalg.norm((error_system(problem, "one") - error_system(problem, "two")) @ errors(run, 2))
    assert late > 0.1  # what a second of the wrong mode would change


def test_no_step_crosses_a_switch(monkeypatch):
    """Every step of the integrator lies between two neighbouring instants, and both ends are hit exactly."""
    from dobc_design.simulation import integrate

    steps = []
    original = integrate._stepped

    def spy(solver):
        before = solver.t
        done = original(solver)
        steps.append((before, solver.t))
        return done

    monkeypatch.setattr(integrate, "_stepped", spy)
    run = simulate(load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=5.0)
    instants = [*run.switches.times.tolist(), 5.0]
    assert len(instants) == 18
    ends = {end for _, end in steps}
    assert set(instants[1:]) <= ends
    for begin, end in steps:
        assert not any(begin < instant < end for instant in instants)


def test_the_observer_error_in_closed_form_is_that_of_the_full_loop():
    """(17), and what follows from it for x, d, dhat and u, on Example 2."""
    problem, signal = load_problem("paper-switching"), Periodic(dwell=0.7)
    fast = simulate(problem, signal=signal, tolerance=1e-12)
    full = simulate(problem, signal=signal, tolerance=1e-12, observer="full-loop")
    for name in ("x", "xi", "xihat", "d", "dhat", "u"):
        np.testing.assert_allclose(getattr(fast, name), getattr(full, name), atol=2e-10, err_msg=name)
    assert fast.method == full.method == "DOP853"


def taylor(h_series, k1: float, start: tuple[float, float], t: float, *, steps: int = 100, order: int = 24):
    """Two agents that hear each other, agent 1 pinned with k1, by a Taylor series at 40 digits.

    e1' = h(e2 - e1) - k1 e1, e2' = h(e1 - e2); h_series(coefficients of y) gives those of h(y) one by one.
    """
    with mpmath.workdps(40):
        e = [mpmath.mpf(s) for s in start]
        dt = mpmath.mpf(t) / steps
        for _ in range(steps):
            a, b = [e[0]], [e[1]]
            forward, back = h_series(), h_series()
            for k in range(order):
                y = b[k] - a[k]
                p, q = forward(y), back(-y)
                a.append((p - k1 * a[k]) / (k + 1))
                b.append(q / (k + 1))
            e = [mpmath.polyval(c[::-1], dt) for c in (a, b)]
        return [float(v) for v in e]


def exponential_series():
    """exp(y) - 1 + y: the coefficients obey k p_k = sum_j j y_j p_{k-j}."""
    y, p = [], []

    def next_coefficient(value):
        k = len(y)
        y.append(value)
        p.append(mpmath.exp(value) if k == 0 else sum(j * y[j] * p[k - j] for j in range(1, k + 1)) / k)
        return p[k] + value - (1 if k == 0 else 0)

    return next_coefficient


def cubic_series():
    """y + y**3 by Cauchy products."""
    y, square = [], []

    def next_coefficient(value):
        y.append(value)
        k = len(y) - 1
        square.append(sum(y[j] * y[k - j] for j in range(k + 1)))
        return value + sum(square[j] * y[k - j] for j in range(k + 1))

    return next_coefficient


@pytest.mark.parametrize(
    ("coupling", "series", "start"),
    [("exp(y) - 1 + y", exponential_series, (0.5, -1.0)), ("y + y**3", cubic_series, (1.0, -0.5))],
)
def test_two_agents_follow_the_taylor_series_at_high_precision(coupling: str, series, start):
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    problem = Problem(network=network, coupling=coupling, gains={"1": 3})
    run = simulate(problem, start=[[start[0]], [start[1]]], t_final=1.0, tolerance=1e-13, samples=2)
    wanted = taylor(series, 3, start, 1.0)
    assert wanted == pytest.approx(taylor(series, 3, start, 1.0, steps=75), rel=1e-14, abs=0)
    np.testing.assert_allclose(run.x[-1, :, 0], wanted, rtol=2e-12)


def test_the_error_falls_with_the_tolerance_at_the_order_of_the_method():
    """DOP853 has order 8: halving the steps makes the error at the end about 256 times smaller."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    problem = Problem(network=network, coupling="exp(y) - 1 + y", gains={"1": "1/2"})
    wanted = np.array(taylor(exponential_series, 0.5, (0.5, -1.0), 4.0, steps=150))
    work, off = [], []
    for tolerance in 10.0 ** -np.arange(4, 13):
        run = simulate(problem, start=[[0.5], [-1.0]], t_final=4.0, tolerance=tolerance, samples=2)
        work.append(run.evaluations)
        off.append(np.abs(run.x[-1, :, 0] - wanted).max())
    order = -np.polyfit(np.log(work), np.log(off), 1)[0]
    assert 6.5 < order < 9.5
    assert off[-1] < 1e-11
    assert all(b < a for a, b in zip(off, off[2:], strict=False))


def test_example_2_with_switching_agrees_with_cvodes():
    """Integrated mode by mode by CasADi's CVODES from the symbolic closed loop."""
    problem = load_problem("paper-switching")
    signal = Periodic(dwell=0.4)
    run = simulate(problem, signal=signal, t_final=2.0, samples=6)
    state = np.concatenate([run.x[0].ravel(), run.xi[0].ravel(), -np.kron(run.x[0].ravel(), [3.2, 2.4])])
    for k, mode in enumerate(["Ga", "Gb", "Gc", "Gd", "Ga"]):
        x, xi, z = (ca.SX.sym(name, size) for name, size in (("x", 10), ("xi", 20), ("z", 20)))
        loop = {"x": ca.vertcat(x, xi, z), "ode": ca.vertcat(*build_model(problem, mode).closed_loop(x, xi, z))}
        step = ca.integrator("loop", "cvodes", loop, 0, 0.4, {"abstol": 1e-12, "reltol": 1e-12})
        state = step(x0=state)["xf"].full().ravel()
        np.testing.assert_allclose(run.x[k + 1].ravel(), state[:10], atol=1e-8)
        np.testing.assert_allclose(run.xi[k + 1].ravel(), state[10:30], atol=1e-8)


def test_example_1_tracks_within_a_percent_after_three_seconds_and_reaches_the_target():
    """Figs. 2 and 3: the printed W, at every start in [0, 5]."""
    problem = load_problem("paper-fixed")
    for seed in range(5):
        start = np.random.default_rng(seed).uniform(0, 5, size=(10, 1))
        run = simulate(problem, start=start)
        late = run.times >= 3
        assert run.estimation_error()[late].max() < 0.01 * np.abs(run.d).max()
        assert run.final_error < 1e-3
        np.testing.assert_allclose(run.x[-1], 1, atol=1e-3)


def test_example_1_without_its_observer_stays_away_from_the_target():
    """The residual: about 0.3 for ever, with the amplitude 0.5 of the disturbance; nothing decays."""
    run = simulate(load_problem("paper-fixed"), observer="off", t_final=60)
    assert not run.dhat.any()
    residual = run.error()[run.times >= 30]
    assert 0.25 < residual.max() < 0.35
    first, second = (run.error()[(run.times >= a) & (run.times < a + 5 * np.pi)].max() for a in (20, 40))
    assert second == pytest.approx(first, rel=1e-2)
    assert simulate(load_problem("paper-fixed"), t_final=60).error()[-1] < 1e-9
