"""One run: against closed forms, matrix exponentials, Taylor series at 40 digits, python-control
and CasADi's CVODES; what must hold for every loop; and what is said when a run goes wrong."""

import re
import warnings
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from simulated_runs import HARMONIC, PRINTED, pair, planar, ring, simulate

import dobc_design as dd
from dobc_design.errors import ShapeError, SpecError
from dobc_design.loop.arrays import pinning_matrix
from dobc_design.loop.make import loop_of
from dobc_design.loop.matrices import consensus_jacobian
from dobc_design.simulation import integrate
from dobc_design.simulation import setting as module
from dobc_design.simulation.signals import Periodic, Schedule

ROUTES = ("closed-form", "full-loop")
N = 12


def modes(order=range(N)) -> dict[str, list[list[int]]]:
    """Two digraphs on twelve agents, named by ``order``."""
    first = []
    for i in range(N):
        next_one = order[(i + 1) % N] + 1
        arc = [order[i] + 1, next_one, i % 3 + 1]
        first.append(arc)
    second = []
    for i in range(N):
        second.append([order[i] + 1, order[(i + 5) % N] + 1, 2])
    return {"a": first, "b": second}


def loop(order=range(N), *, target=1, **settings) -> dd.Problem:
    first = str(order[0] + 1)
    fifth = str(order[4] + 1)
    gains = {first: 5, fifth: 2}
    observer = settings.pop("observer", PRINTED)
    network = dd.Network.from_arcs(modes(order), arrow="listens_to", agents=N)
    return dd.Problem(
        network=network,
        coupling="exp(y) - 1 + y",
        target=target,
        gains=gains,
        exosystem=HARMONIC,
        observer=observer,
        **settings,
    )


def starts():
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 3, size=(N, 1))
    return x, rng.normal(size=(N, 2))


def error_system(problem: dd.Problem, mode: str):
    """The matrix of (22)."""
    A = np.array(problem.exosystem.A, float)
    C = np.array(problem.exosystem.C, float)
    W = np.array(problem.observer.W, float)
    own = np.eye(problem.n)
    coupled = consensus_jacobian(loop_of(problem), mode).toarray()
    pinned = pinning_matrix(problem).toarray()
    J = coupled - pinned
    to_errors = np.kron(own, C)
    error_block = np.kron(own, A - W @ C)
    lower = [0 * to_errors.T, error_block]
    arrays = [[J, to_errors], lower]
    return np.block(arrays)


def errors(trajectory, k: int):
    x = (trajectory.x[k] - trajectory.goal).ravel()
    eps = (trajectory.xi[k] - trajectory.xihat[k]).ravel()
    arrays = [x, eps]
    return np.concatenate(arrays)


@pytest.mark.parametrize("observer", ROUTES)
def test_a_switched_linear_loop_is_the_product_of_its_exponentials(observer: str):
    """Instants that no step of equal length would meet; a switch late by 1e-9 s would be seen."""
    problem = planar()
    instants = [0, 0.7390851, 1.6180339, 3.1415926]
    signal = Schedule(times=instants, modes=["one", "two", "one", "two"])
    run = simulate(problem, signal=signal, samples=5, observer=observer, tolerance=1e-12)
    stays = np.diff([*signal.times, 4.0])
    product = np.eye(15)
    for stay, mode in zip(stays, signal.modes, strict=True):
        product = expm(error_system(problem, mode) * stay) @ product
    last = errors(run, -1)
    wanted = product @ errors(run, 0)
    np.testing.assert_allclose(last, wanted, atol=1e-9)
    assert run.switches.times.tolist() == list(signal.times)
    difference = error_system(problem, "one") - error_system(problem, "two")
    late = np.linalg.norm(difference @ errors(run, 2))
    assert late > 0.1  # what a second of the wrong mode would change


def test_no_step_crosses_a_switch(monkeypatch):
    """Every step of the integrator lies between two neighbouring instants, and both ends are hit
    exactly."""
    steps = []
    original = integrate._stepped

    def spy(solver):
        steps.append([solver.t])
        done = original(solver)
        steps[-1].append(solver.t)
        return done

    monkeypatch.setattr(integrate, "_stepped", spy)
    run = simulate(dd.load_problem("paper-switching"), signal=Periodic(dwell=0.3), t_final=5.0)
    instants = [*run.switches.times.tolist(), 5.0]
    assert len(instants) == 18
    assert set(instants[1:]) <= {end for _, end in steps}
    assert not any(begin < instant < end for begin, end in steps for instant in instants)


def test_the_observer_error_in_closed_form_is_that_of_the_full_loop(
    monkeypatch: pytest.MonkeyPatch,
):
    """(17), in closed form or integrated beside e, and what follows from it for x, d, dhat and u,
    on Example 2."""
    problem = dd.load_problem("paper-switching")
    signal = Periodic(dwell=0.7)
    given = {"signal": signal, "tolerance": 1e-12, "t_final": 2, "samples": 41}
    fast = simulate(problem, **given)
    full = simulate(problem, observer="full-loop", **given)
    monkeypatch.setattr("dobc_design.simulation.closed_form.MOST_ANCHORS", 1)
    along = simulate(problem, **given)
    for name in ("x", "xi", "xihat", "d", "dhat", "u"):
        wanted = getattr(full, name)
        for run in (fast, along):
            found = getattr(run, name)
            np.testing.assert_allclose(found, wanted, atol=2e-10, err_msg=name)
    assert fast.method == full.method == along.method == "DOP853"
    assert "its error was integrated" in " ".join(along.notes)


def test_a_long_run_takes_few_steps_once_both_errors_have_died_out():
    """Horizon 10^4 s is beyond the closed form; the disturbance itself goes on, and cost 10^6
    evaluations."""
    run = simulate(dd.load_problem("paper-fixed"), t_final=1e4, samples=101, tolerance=1e-6)
    assert run.evaluations < 20_000
    assert run.final_error < 1e-12
    late = run.times > 50
    np.testing.assert_allclose(run.dhat[late], run.d[late], atol=1e-9)


def taylor(k1: float, start: tuple[float, float], t: float, *, steps: int = 150, order: int = 16):
    """Two agents that hear each other, agent 1 pinned with k1, by a Taylor series at 40 digits.

    e1' = h(e2 - e1) - k1 e1, e2' = h(e1 - e2); h(y) = exp(y) - 1 + y.
    """
    with mpmath.workdps(40):
        e = [mpmath.mpf(s) for s in start]
        dt = mpmath.mpf(t) / steps
        for _ in range(steps):
            a = [e[0]]
            b = [e[1]]
            forward = exponential_series()
            back = exponential_series()
            for k in range(order):
                y = b[k] - a[k]
                p = forward(y)
                q = back(-y)
                a.append((p - k1 * a[k]) / (k + 1))
                b.append(q / (k + 1))
            e = []
            for c in (a, b):
                e.append(mpmath.polyval(c[::-1], dt))
        return [float(v) for v in e]


def exponential_series():
    """exp(y) - 1 + y: the coefficients obey k p_k = sum_j j y_j p_{k-j}."""
    y = []
    p = []

    def next_coefficient(value):
        k = len(y)
        y.append(value)
        if k == 0:
            p.append(mpmath.exp(value))
            return p[0] + value - 1
        orders = range(1, k + 1)
        total = sum(j * y[j] * p[k - j] for j in orders)
        p.append(total / k)
        return p[k] + value

    return next_coefficient


def test_the_error_falls_with_the_tolerance_at_the_order_of_the_method():
    """DOP853 has order 8: halving the steps makes the error at the end about 256 times smaller."""
    arcs = [[1, 2], [2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    problem = dd.Problem(network=network, coupling="exp(y) - 1 + y", gains={"1": "1/2"})
    wanted = np.array(taylor(0.5, (0.5, -1.0), 4.0))
    work = []
    off = []
    for tolerance in 10.0 ** -np.arange(4, 13):
        start = [[0.5], [-1.0]]
        run = simulate(problem, start=start, t_final=4.0, tolerance=tolerance, samples=2)
        work.append(run.evaluations)
        gap = run.x[-1, :, 0] - wanted
        largest = np.abs(gap).max()
        off.append(largest)
    slope = np.polyfit(np.log(work), np.log(off), 1)
    order = -slope[0]
    assert 6.5 < order < 9.5
    assert off[-1] < 1e-11
    for a, b in zip(off, off[2:], strict=False):
        assert b < a


def test_example_2_with_switching_agrees_with_cvodes():
    """Integrated mode by mode by CasADi's CVODES from the symbolic closed loop."""
    problem = dd.load_problem("paper-switching")
    signal = Periodic(dwell=0.4)
    run = simulate(problem, signal=signal, t_final=2.0, samples=6)
    start = run.x[0].ravel()
    arrays = [start, run.xi[0].ravel(), -np.kron(start, [3.2, 2.4])]
    state = np.concatenate(arrays)
    x = ca.SX.sym("x", 10)
    xi = ca.SX.sym("xi", 20)
    z = ca.SX.sym("z", 20)
    exactly = {"abstol": 1e-12, "reltol": 1e-12}
    for k, mode in enumerate(["Ga", "Gb", "Gc", "Gd", "Ga"]):
        slope = dd.build_model(problem, mode=mode).closed_loop(x, xi, z)
        states = ca.vertcat(x, xi, z)
        slopes = ca.vertcat(*slope)
        loop = {"x": states, "ode": slopes}
        step = ca.integrator("loop", "cvodes", loop, 0, 0.4, exactly)
        state = step(x0=state)["xf"].full().ravel()
        actual = run.x[k + 1].ravel()
        np.testing.assert_allclose(actual, state[:10], atol=1e-8)
        actual = run.xi[k + 1].ravel()
        np.testing.assert_allclose(actual, state[10:30], atol=1e-8)


def test_example_1_tracks_within_a_percent_after_three_seconds_and_reaches_the_target():
    """Figs. 2 and 3: the printed W, at every start in [0, 5]."""
    problem = dd.load_problem("paper-fixed")
    for seed in range(2):
        rng = np.random.default_rng(seed)
        start = rng.uniform(0, 5, size=(10, 1))
        run = simulate(problem, start=start)
        late = run.times >= 3
        found = run.estimation_error()[late].max()
        assert found < 0.01 * np.abs(run.d).max()
        assert run.final_error < 1e-3
        np.testing.assert_allclose(run.x[-1], 1, atol=1e-3)


def test_example_1_without_its_observer_stays_away_from_the_target():
    """The residual: about 0.3 for ever, with the amplitude 0.5 of the disturbance; nothing
    decays."""
    run = simulate(dd.load_problem("paper-fixed"), observer="off", t_final=30, tolerance=1e-6)
    assert not run.dhat.any()
    residual = run.error()[run.times >= 15]
    assert 0.25 < residual.max() < 0.35
    peaks = []
    for begin in (15, 22):
        before_the_end = run.times < begin + 2 * np.pi
        round = (run.times >= begin) & before_the_end
        peaks.append(run.error()[round].max())
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-2)
    found = simulate(dd.load_problem("paper-fixed"), t_final=60).error()
    assert found[-1] < 1e-9


def test_starts_are_drawn_in_the_region_and_without_one_within_one_of_the_goal():
    """The verdict is then about the consensus, so the picture starts near it: [0, 2] for xbar =
    1."""
    problem = ring(target=1)
    x = np.array([simulate(problem, t_final=0.1, samples=2, seed=s).x[0] for s in range(40)])
    assert x.min() >= 0
    assert x.max() <= 2
    assert x.min() < 0.05
    assert x.max() > 1.95
    chain = [[i + 1, i] for i in range(1, 50)]
    network = dd.Network.from_arcs(chain, arrow="listens_to", agents=50)
    region = {"initial_states": [[10, 11], [-3, -2]]}
    problem = dd.Problem(network=network, coupling="y", target=[0, 0], region=region)
    x = simulate(problem, t_final=0.1, samples=2).x[0]
    low, high = np.transpose(region["initial_states"])
    assert np.all((low <= x) & (x <= high))


def test_the_seed_decides_the_start_and_the_problem_where_the_disturbance_begins():
    simulation = {"seed": 7, "t_final": 1}
    problem = ring(gains=1, simulation=simulation)
    first = simulate(problem, samples=3)
    again = simulate(problem, seed=7, samples=3)
    other = simulate(problem, seed=8)
    assert np.array_equal(first.x, again.x)
    assert not np.array_equal(first.x[0], other.x[0])
    assert first.seed == 7
    assert first.t_final == 1
    trajectory = simulate(planar(), samples=2)
    np.testing.assert_allclose(trajectory.xihat[0], 0, atol=1e-15)
    found = trajectory.xi[0].tolist()
    expected = [[1, 0, 2], [0, 1, -1], [3, 0, 0]]
    assert found == expected
    without = simulate(ring(exosystem=HARMONIC, observer=PRINTED, gains=1), samples=2, t_final=1)
    wanted = np.ones((10, 2))
    assert np.array_equal(without.xi[0], wanted)


def test_trial_steps_that_overflow_are_rejected_and_the_run_goes_on():
    """exp(50) at the start."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        region = {"initial_states": [0, 50]}
        problem = ring(gains={"1": 5}, region=region)
        trajectory = simulate(problem, t_final=2)
    assert not trajectory.diverged
    assert trajectory.final_error < trajectory.error()[0]


def test_the_implicit_method_agrees_with_the_matrix_exponential():
    problem = ring("y", gains={"1": 10**5})
    trajectory = simulate(problem, t_final=3, samples=31)
    assert trajectory.method == "Radau"
    assert "implicit" in trajectory.notes[-1]
    found = simulate(ring("y", gains={"1": 1}), t_final=2)
    assert found.method == "DOP853"
    coupled = consensus_jacobian(loop_of(problem), "G").toarray()
    pinned = pinning_matrix(problem).toarray()
    J = coupled - pinned
    for k in (1, 10, 30):
        flow = expm(J * trajectory.times[k])
        start = trajectory.x[0].ravel()
        wanted = flow @ start
        actual = trajectory.x[k].ravel()
        np.testing.assert_allclose(actual, wanted, atol=1e-6)


def test_runs_in_several_threads_do_not_disturb_each_other():
    problem = ring(gains={"1": 5})
    with ThreadPoolExecutor(4) as pool:
        seeds = [0, 1, 0, 1]
        answers = pool.map(lambda seed: simulate(problem, seed=seed, t_final=2), seeds)
        runs = list(answers)
    assert np.array_equal(runs[0].x, runs[2].x)
    assert np.array_equal(runs[1].x, runs[3].x)


def test_a_gain_can_be_handed_over_and_a_missing_one_is_refused():
    problem = ring(gains=1, exosystem=HARMONIC)
    gain = [["16/5"], ["12/5"]]
    found = simulate(problem, gain=gain, t_final=1).estimation_error()
    assert found[-1] < 1
    with pytest.raises(SpecError, match=r"observer\.W must be known to build the observer"):
        simulate(problem)
    with pytest.raises(ShapeError, match="gain must have shape"):
        simulate(problem, gain=[[1]])


@pytest.mark.parametrize("observer", ["closed-form", "full-loop"])
def test_a_fixed_point_stays_fixed_to_rounding(observer: str):
    """e = 0 and eps = 0: (3), with a disturbance that the observer knows from the start."""
    xi = starts()[1]
    x = np.ones((N, 1))
    start = {"x": x, "xi": xi, "xihat": xi}
    run = simulate(loop(), start=start, signal=Periodic(dwell=0.5), observer=observer)
    found = run.error().max()
    assert found < (1e-15 if observer == "closed-form" else 1e-9)
    assert np.abs(run.d).max() > 1


def test_permuting_the_agents_permutes_the_result():
    order = np.random.default_rng(0).permutation(N)
    x, xi = starts()
    given = {"signal": Periodic(dwell=0.5), "t_final": 4, "samples": 81}
    start = {"x": x, "xi": xi}
    one = simulate(loop(), start=start, **given)
    moved_x = np.empty_like(x)
    moved_xi = np.empty_like(xi)
    moved_x[order] = x
    moved_xi[order] = xi
    start = {"x": moved_x, "xi": moved_xi}
    other = simulate(loop(order.tolist()), start=start, **given)
    found_x = other.x[:, order]
    np.testing.assert_allclose(found_x, one.x, atol=1e-9)
    found_u = other.u[:, order]
    np.testing.assert_allclose(found_u, one.u, atol=1e-8)


def test_the_active_mode_stands_at_every_sample():
    samples = [0, 0.25, 0.5, 1.2, 1.75, 2]
    run = simulate(loop(), signal=Periodic(dwell=0.5), t_final=2, samples=samples)
    expected = [0, 0, 1, 0, 1, 1]
    assert run.mode_index.tolist() == expected
    found = [sample.mode for sample in run]
    expected = ["a", "a", "b", "a", "b", "b"]
    assert found == expected
    assert run.mode == "a, b (periodic, 0.5 s each)"
    found = [sample.time for sample in run]
    assert found == run.times.tolist()
    assert len(run) == 6
    first = next(iter(run)).x
    assert np.array_equal(first, run.x[0])


def test_a_run_that_blows_up_between_two_samples_keeps_its_rise():
    """x1' = (x1 - x2)^3 with x2 = 0: x1 = x0 / sqrt(1 - 2 x0^2 t), at every sample that is left."""
    start = [[1], [0]]
    run = simulate(pair("-y**3"), start=start, t_final=10, samples=11)
    assert run.diverged
    assert len(run) > 20
    assert (np.diff(run.times) > 0).all()
    early = run.times < 0.4999
    wanted = 1 / np.sqrt(1 - 2 * run.times[early])
    actual = run.x[early, 0, 0]
    np.testing.assert_allclose(actual, wanted, rtol=1e-4)
    assert early.sum() > 5


def test_a_loop_that_turns_stiff_is_taken_over_by_the_implicit_method():
    """Agent 1 settles between two that stay far away: there its rate is 2 + 6 * 100 * 35^2 = 735
    000 1/s.

    At rest it is in the middle, because h is odd.
    """
    arcs = [[1, 2], [1, 3]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=3)
    problem = dd.Problem(network=network, coupling="y + 100*y**3")
    start = [[1], [40], [-30]]
    run = simulate(problem, start=start, t_final=2.0)
    actual = run.x[-1, :, 0]
    np.testing.assert_allclose(actual, [5, 40, -30], rtol=1e-9)
    assert run.method == "DOP853, then Radau"
    assert "turned out to be stiff" in run.notes[0]


def test_an_observer_that_is_too_fast_for_the_closed_form_is_integrated_and_said():
    W = [[2 * 10**6], ["12/5"]]
    observer = dd.Observer(W=W)
    run = simulate(loop(observer=observer), mode="a", t_final=1.0)
    assert "its error was integrated" in " ".join(run.notes)
    assert not run.diverged


def test_large_networks_get_fewer_samples_unless_asked():
    times, notes = module._times(None, 1.0, 1 << 24)
    assert len(times) == 4
    assert "4 samples only" in notes[0]
    found = module._times(401, 1.0, 1 << 24)
    assert len(found[0]) == 401


DIVERGING = {}  # problem; why its run ends; s between which it does


def diverging(name: str, coupling: str, reason: str, begin: float, end: float, **settings) -> None:
    DIVERGING[name] = (ring(coupling, **settings), reason, begin, end)


ENORMOUS = {"initial_states": [0, "1e308"]}
WRONG_SIGN = {"exosystem": HARMONIC, "observer": dd.Observer(W=[[-6], [0]])}
USUAL = "exp(y) - 1 + y"
ESCAPES = "exceeded 1e+09 times its start at t ="
EITHER = "collapsed|exceeded"
OUTSIDE = "overflows or is undefined"
NEAR = {"initial_states": [0, 2]}
FAR = {"initial_states": [0, 9]}
DISTANT = {"initial_states": [0, 2000]}
diverging("linear", "-y", ESCAPES, 5, 20, gains={"1": 1})
diverging("cubic", "-y**3", EITHER, 0, 5, gains={"1": 1})
diverging("exponential", "1 - exp(y)", EITHER, 0, 5, gains={"1": 1})
diverging("domain, stiff", "log(1 + y)", "collapsed", -1, 5, gains={"1": 10**7}, region=NEAR)
diverging("observer", USUAL, "exceeded", 1, 20, gains=1, **WRONG_SIGN)
diverging("domain", "log(1 + y)", "undefined|collapsed", -1, 20, gains={"1": 1}, region=FAR)
diverging("start", USUAL, OUTSIDE, -1, 1, gains={"1": 1}, region=DISTANT)
diverging("far start", USUAL, OUTSIDE, -1, 1, gains={"1": 5}, region=ENORMOUS)


@pytest.mark.parametrize(
    ("problem", "reason", "earliest", "latest"), DIVERGING.values(), ids=DIVERGING
)
def test_a_run_that_diverges_keeps_what_is_valid_and_says_why(
    problem: dd.Problem, reason: str, earliest, latest
):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = simulate(problem)
    assert run.diverged
    assert earliest < run.times[-1] < latest
    assert np.isfinite(run.x).all()
    assert len(run.times) == len(run.x) == len(run.u) < 401
    assert len(run) == 1 or earliest < 0 or run.final_error > 5 * run.error()[0]
    assert "diverged at about" in str(run)
    assert re.search(reason.replace("+", r"\+"), run.reason)
    assert f"t = {run.times[-1]:.6g} s" in run.reason or "just after" in run.reason
    assert run.settling_time() is None


WRONG = {  # what is said -> arguments that cannot be
    "exclude each other": {"mode": "a", "signal": Periodic(dwell=1)},
    "mode must be one of": {"mode": "c"},
    "signal must be a switching signal; got periodic": {"signal": "periodic"},
    "stress must be a Stress; got noise": {"stress": "noise"},
    "observer must be one of": {"observer": "slow"},
    "tolerance must be": {"tolerance": 0},
    "samples must be a whole number >= 2": {"samples": 1},
    "increase from 0 to t_final": {"samples": [0, 1]},
    "samples must be finite": {"samples": [0, float("nan"), 20]},
    "t_final must be a time > 0": {"t_final": 0},
    "within the range of floats": {"t_final": float("inf")},
    "got soon": {"t_final": "soon"},
    "seed must be a whole number >= 0": {"seed": -1},
    "start.x must be finite": {"start": [[float("nan")]] * N},
}


@pytest.mark.parametrize(("message", "arguments"), WRONG.items())
def test_wrong_arguments_are_refused(arguments, message: str):
    with pytest.raises(SpecError, match=message):
        simulate(loop(), **arguments)
    with pytest.raises(SpecError, match="within the range of floats"):
        simulate(ring(simulation={"t_final": "1e400"}))


def test_a_horizon_that_no_integrator_reaches_is_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(SpecError, match=r"t_final must be at most 1e\+12 s"):
        dd.simulate("paper-fixed", t_final=1e300)
    monkeypatch.setattr("dobc_design.simulation.integrate.LOOK_AHEAD", 50)
    with pytest.raises(SpecError, match="more than 10000000 steps of the integrator; 50 of them"):
        dd.simulate("paper-fixed", t_final=1e11)
