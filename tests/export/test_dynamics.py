"""Exports of agents with [dynamics]: python-control and C give the simulated loop; the others
refuse first."""

import importlib.util
from functools import partial

import control
import numpy as np
import pytest
from agents import (
    double_integrators,
    drift,
    felt,
    matrices,
    pendulums,
    resonators,
    three_states,
)
from c_code import CompiledAgents, compile_and_test, needs_gcc, write_all
from certified import consensus_claims
from loaded_fmu import LoadedFmu
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm
from scipy.optimize import brentq
from typer.testing import CliRunner

import dobc_design as dd
from dobc_design.cli.main import app
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.export import python_script, to_control
from dobc_design.export.c_controller import make_controller
from dobc_design.problem.changes import problem_text

examples = (double_integrators(), three_states(), pendulums(), resonators())
PROBLEMS = {each.name: each for each in examples}
TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
SLOW = pytest.mark.slow

pytestmark = pytest.mark.usefixtures("recorded_briefly")


@pytest.mark.parametrize("name", PROBLEMS)
def test_python_control_reproduces_the_trajectory(name, tmp_path):
    """Outputs x (n m), dhat and u (n p); the Python file that stands alone has the same
    derivatives."""
    problem = PROBLEMS[name]
    system = to_control(problem)
    run = dd.simulate(problem, t_final=2, samples=21)
    start = system.start_of(run)
    found = control.input_output_response(system, run.times, 0, start, solve_ivp_kwargs=TIGHT)
    inputs = problem.n * problem.inputs
    wanted = [part.reshape(21, -1) for part in (run.x, run.dhat, run.u)]
    np.testing.assert_allclose(found.outputs.T, np.hstack(wanted), atol=1e-6)
    assert system.ninputs == inputs
    (tmp_path / "loop.py").write_text(python_script(problem), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("loop", tmp_path / "loop.py")
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    rng = np.random.default_rng(1)
    state = rng.standard_normal(system.nstates)
    at = (0, state, rng.standard_normal(inputs))
    other = alone.make_system(next(iter(problem.network.modes)))
    np.testing.assert_allclose(other.dynamics(*at), system.dynamics(*at), atol=1e-10)
    found_output = other.output(*at)
    wanted_output = system.output(*at)
    np.testing.assert_allclose(found_output, wanted_output, atol=1e-10)


@pytest.mark.parametrize("name", ["carts", "plants"])
def test_observer_of_one_agent_is_a_linear_system(name):
    """(13): z' for x_i and v_i = couplings + u_i, p of them, against the model's."""
    problem = PROBLEMS[name]
    model = dd.build_model(problem)
    observer = to_control(problem).observer
    rng = np.random.default_rng(2)
    n = problem.n
    goal = to_float([problem.goal_of(i) for i in range(n)])
    z = rng.standard_normal((n, model.q))
    u = rng.standard_normal((n, problem.inputs))
    found = model.observer(z.ravel(), goal.ravel(), u.ravel())
    z_dot, _, dhat = (np.asarray(each).reshape(n, -1) for each in found)
    for i in range(n):  # at the goal no agent feels a coupling
        both = np.concatenate([goal[i], u[i]])
        moved = observer.A @ z[i]
        np.testing.assert_allclose(moved + observer.B @ both, z_dot[i], atol=1e-10)
        seen = observer.C @ z[i]
        np.testing.assert_allclose(seen + observer.D @ both, dhat[i], atol=1e-10)
    assert to_control(PROBLEMS["pendulums"]).observer is None


@pytest.mark.parametrize(
    "options", [["--c", "--period", "0.01"], ["--fmu", "--period", "0.01"], ["--sdpa"]]
)
def test_leaders_and_inequalities_are_refused_before_anything_is_written(options, tmp_path):
    """One error that names [leader], with f as with A, or [dynamics]."""
    leader = {"initial": [1, 0]}
    problem = PROBLEMS["pendulums"].replace(target=[0, 0], leader=leader)
    (tmp_path / "own.toml").write_text(problem_text(problem), encoding="utf-8")
    target = tmp_path / "target"
    first, *others = options
    call = ["export", str(tmp_path / "own.toml"), first, str(target), *others]
    result = CliRunner().invoke(app, call)
    assert isinstance(result.exception, SpecError)
    assert result.exception.key == ("dynamics" if options == ["--sdpa"] else "leader")
    assert not target.exists()


def test_what_is_not_known_for_dynamics_is_refused():
    """Curves of designs."""
    with pytest.raises(SpecError, match="not available yet for agents with dynamics"):
        dd.trade_off(PROBLEMS["carts"])


def pulls(problem: dd.Problem, data):
    """h'(0) - K by central differences, (n p, n m)."""
    units_of_all = np.eye(problem.n * problem.m)
    units = units_of_all.reshape(-1, problem.n, problem.m)
    e = 1e-6
    felt_by = []
    for x in units:
        felt_by.append((felt(problem, e * x) - felt(problem, -e * x)).ravel() / (2 * e))
    return np.array(felt_by).T - block_diag(*data["K"])


@pytest.mark.parametrize("name", PROBLEMS)
def test_matrices_are_those_of_theory(name):
    """Lambda = J + J' of e' = (I (x) A_x) e + (I (x) B) (h(e) - K e), K (n p, n m)."""
    problem = PROBLEMS[name]
    found = dd.export.to_numpy(problem)
    data = matrices(problem)
    n = problem.n
    np.testing.assert_allclose(found["Ax"], data["A"], atol=1e-12)
    np.testing.assert_array_equal(found["B"], data["B"])
    np.testing.assert_array_equal(found["K"], block_diag(*data["K"]))
    one = np.eye(n)
    alone = np.kron(one, data["A"])
    pulled_by_all = np.kron(one, data["B"]) @ pulls(problem, data)
    J = alone + pulled_by_all
    np.testing.assert_allclose(found["Lambda"], J + J.T, atol=1e-6)
    certificate = dd.Certificate(problem=problem, claims=consensus_claims(problem))
    assert "A_x" in dd.export.to_latex(certificate)
    assert "Ax" in dd.export.to_sympy(problem)


def test_diagnostics_and_searches_are_those_of_the_errors():
    """Eigenvalues of the linearised loop; the graph is that of the pins that are given."""
    problem = PROBLEMS["plants"]
    own = dd.analyse(problem)
    data = matrices(problem)
    pulled = [-data["B"] @ K for K in data["K"]]
    steps = 1e-6 * np.eye(9)
    columns = []
    for step in steps:
        columns.append(felt(problem, (step.reshape(3, 3))).ravel() / 1e-6)
    free = np.kron(np.eye(3), data["A"])
    loop = free + block_diag(*pulled)
    input_matrix = np.kron(np.eye(3), data["B"])
    felt_columns = np.array(columns).T
    loop += input_matrix @ felt_columns
    found = np.poly(own.modes[0].loop_eigenvalues)
    wanted = np.poly(np.linalg.eigvals(loop))
    assert found == pytest.approx(wanted, rel=1e-5)
    injection = data["W"] @ data["B"]
    F = data["S"] - injection @ data["C"]
    coefficients = np.poly(own.spectrum.eigenvalues)
    assert coefficients == pytest.approx(np.poly(F))
    labels = ["a", "b", "c"]
    nothing = dd.Network.from_arcs([], arrow="listens_to", agents=labels)
    lonely = problem.replace(network=nothing)
    assert dd.analyse(lonely).graphs[0].unreached == ("b", "c")
    arcs = [["b", "a"]]
    pair = dd.Network.from_arcs(arcs, arrow="listens_to", agents=["a", "b"])
    cubic = dd.Dynamics(f=["-x**3 - x/2"])
    bent = dd.Problem(network=pair, dynamics=cubic, coupling="y", gains={"a": 3})
    assert not dd.falsify(bent, runs=3).suspects


def compiled(problem: dd.Problem, folder, period) -> CompiledAgents:
    files = dd.export.to_c(problem, period=period).files
    own = folder / str(period).replace("/", "_")
    return CompiledAgents(files, own, n=problem.n, m=problem.m, p=problem.inputs)


def in_c(problem: dd.Problem, run, agents: CompiledAgents, period: float):
    """x, u, dhat at the multiples of the period, from the start of ``run``: C agents, held inputs,
    and agents with wind integrated by expm of (x, v, xi), with f by SciPy."""
    data, own = matrices(problem), drift(problem)
    A, B, C, S = (data[name] for name in ("A", "B", "C", "S"))
    m, p = B.shape
    size = m + p + len(S)
    block = np.zeros((size, size))
    upper = np.hstack([A, B, B @ C])
    block[:m], block[m + p :, m + p :] = upper, S
    flow = expm(block * period)
    x = run.x[0]
    xi = run.xi[0]
    found = []
    for _ in run.times:
        u, v, dhat = agents(0, x)
        found.append((x, u, dhat))
        state = np.hstack([x, v, xi]) @ flow.T
        before = (x, xi)
        x = state[:, :m]
        xi = state[:, m + p :]
        if problem.dynamics.f:

            def slope(time: float, x, v=v, xi=before[1]):
                x = x.reshape(-1, m)
                acts = v + xi @ expm(S * time).T @ C.T
                return (own(x) + acts @ B.T).ravel()

            flowed = solve_ivp(slope, (0, period), before[0].ravel(), **TIGHT)
            solution = flowed.y[:, -1]
            x = solution.reshape(-1, m)
    arrays = []
    for part in zip(*found, strict=True):
        arrays.append(np.array(part))
    return arrays


@SLOW
@needs_gcc
@pytest.mark.parametrize("name", PROBLEMS)
def test_agents_in_c_are_the_sampled_loop_and_that_is_the_loop_but_for_its_period(name, tmp_path):
    """Double integrators, agents with three states and two inputs, and with f, with wind: to
    rounding at every period, with f to the tolerance of the integrators, and to rounding where both
    are given the same states; of first order in the period to the loop in continuous time."""
    problem, apart = PROBLEMS[name], []
    for period in (1 / 10, 1 / 20, 1 / 40, 1 / 80):
        times = [k * period for k in range(round(4 / period) + 1)]
        run = partial(dd.simulate, problem, t_final=times[-1], samples=times, seed=2)
        sampled = run(stress=dd.Stress(period=period))
        free = run()
        agents = compiled(problem, tmp_path, period)
        found = in_c(problem, sampled, agents, period)
        wanted_parts = (sampled.x, sampled.u, sampled.dhat)
        for part, wanted in zip(found, wanted_parts, strict=True):
            allowed = 1e-7 if problem.dynamics.f else 1e-12
            difference = np.abs(part - wanted).max()
            tolerance = allowed * max(1.0, np.abs(wanted).max())
            assert difference <= tolerance
        agents.library.start()
        largest = np.abs(sampled.u).max()
        rounding = 1e-12 * max(1.0, largest)
        for x, u, dhat in zip(sampled.x, sampled.u, sampled.dhat, strict=True):
            np.testing.assert_allclose(agents(0, x)[::2], [u, dhat], atol=rounding)
        apart.append(np.abs(found[0] - free.x).max())
    ratios = np.array(apart[:-1]) / apart[1:]
    assert apart[0] > 1e-3
    assert 1.7 < ratios[-1] < 2.3, (apart, ratios)


@needs_gcc
@pytest.mark.parametrize(
    ("name", "precision"),
    [
        ("carts", "double"),
        ("plants", "float"),
        ("pendulums", "double"),
        ("resonators", "float"),
        ("alone", "double"),
        pytest.param("carts", "float", marks=SLOW),
        pytest.param("plants", "double", marks=SLOW),
        pytest.param("pendulums", "float", marks=SLOW),
        pytest.param("resonators", "double", marks=SLOW),
        pytest.param("alone", "float", marks=SLOW),
    ],
)
def test_code_passes_its_own_vectors_and_claims_what_is_proved(name, precision, tmp_path):
    """The sampled observer's error is that of theory, exactly; the network is decided near the
    consensus."""
    problem = PROBLEMS.get(name)
    wanted = {"sampled-network": "proved", "sampled": "proved"}
    if problem is None:
        problem = PROBLEMS["carts"].replace(exosystem=None, observer=None, simulation=None)
        del wanted["sampled"]
    code = dd.export.to_c(problem, period="1/20", precision=precision)
    done = compile_and_test(write_all(code.files, tmp_path))
    assert done.returncode == 0, done.stdout
    assert code.tolerance <= (1e-9 if precision == "double" else 1e-1)
    kinds = {each.kind: each.verdict.value for each in code.statements}
    assert kinds == wanted
    readme = code.files["README.txt"].decode()
    told = " ".join(readme.split())
    bends = problem.dynamics.f is not None
    assert ("is held, an error of second order in the period" in told) is bends
    assert "no check `sampling` is for agents with dynamics" in told
    assert "`sampling` covers" not in told
    header = code.files["dobc_agent.h"]
    assert b"rest[DOBC_INPUTS]" in header
    assert b"DOBC_INPUTS %d" % problem.inputs in header


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_longest_period_is_that_of_the_eigenvalues(name):
    """e_(k+1) = Phi e_k + G (h'(0) e_k - K e_k): proved just below the limit, refused just above;
    another is named."""
    problem = PROBLEMS[name]
    data = matrices(problem)
    one = np.eye(problem.n)
    m, p = data["B"].shape
    pull = pulls(problem, data)
    block = np.zeros((m + p, m + p))
    top = [data["A"], data["B"]]
    block[:m] = np.hstack(top)

    def radius(period: float) -> float:
        flow = expm(block * period)[:m]
        alone = np.kron(one, flow[:, :m])
        fed_back = np.kron(one, flow[:, m:]) @ pull
        whole = alone + fed_back
        return np.abs(np.linalg.eigvals(whole)).max()

    limit = brentq(lambda period: radius(period) - 1, 0.05, 2.0)
    bare = problem.replace(exosystem=None, observer=None, simulation=None)
    held = make_controller(bare, period=f"{0.999 * limit:.6f}").statements
    (network,) = held
    assert network.verdict is dd.Verdict.PROVED
    assert "without a disturbance" in network.text
    with pytest.raises(SpecError, match="outside the unit disk") as caught:
        make_controller(bare, period=f"{1.001 * limit:.6f}")
    proposed = caught.value.cure.split("--period ")[1]
    named = float(proposed.rstrip("."))
    assert 0.9 * limit < named <= limit


def error_matrix(code):
    """Ad - L Cd of the numbers in the code."""
    injection = to_float(code.L) @ to_float(code.Cd)
    return to_float(code.Ad) - injection


def test_the_error_of_the_sampled_observer_obeys_its_matrix():
    """eps_(k+1) = (Ad - L Cd) eps_k at any states, couplings and inputs."""
    for name in ("carts", "plants"):
        problem = PROBLEMS[name]
        code = dd.export.to_c(problem, period="1/4").controller
        times = [k / 4 for k in range(12)]
        stress = dd.Stress(period=1 / 4, saturation=0.3)
        run = dd.simulate(problem, t_final=times[-1], samples=times, stress=stress)
        eps = run.xi - run.xihat
        following = eps[:-1] @ error_matrix(code).T
        np.testing.assert_allclose(eps[1:], following, atol=1e-12)
        assert np.abs(eps[0]).max() > 0.1


def test_what_the_observer_leaves_out_of_f_is_of_second_order_in_the_period_and_in_the_distance():
    """eps_1 - (Ad - L Cd) eps_0 in one period, from a start and from half of it, over a period and
    half of it."""
    problem = PROBLEMS["resonators"]

    def left_out(period: float, part: float) -> float:
        code = make_controller(problem, period=str(period))
        states = [part, -part / 2]
        start = {"x": states, "xi": [part, 0]}
        stress = dd.Stress(period=period)
        run = dd.simulate(
            problem, t_final=period, samples=2, start=start, stress=stress, tolerance=1e-12
        )
        eps = run.xi - run.xihat
        missed = eps[1] - eps[0] @ error_matrix(code).T
        return np.abs(missed).max()

    whole = left_out(0.02, 0.002)
    assert 3.7 < whole / left_out(0.01, 0.002) < 4.3
    assert 3.7 < whole / left_out(0.02, 0.001) < 4.3


def test_a_loop_that_leaves_in_continuous_time_too_is_refused_at_once():
    """x' = x^3 - x/2 + u from 3, without a pin: at infinity after 0.03 s, whatever the period
    is."""
    alone = dd.Network.from_arcs([], arrow="listens_to", agents=["a"])
    cubic = dd.Dynamics(f=["x**3 - x/2"])
    simulation = {"x0": [3]}
    problem = dd.Problem(network=alone, dynamics=cubic, coupling="y", simulation=simulation)
    with pytest.raises(SpecError, match="although nothing is sampled: no period helps") as caught:
        dd.export.to_c(problem, period="1/20")
    assert caught.value.key == "simulation"


@needs_gcc
def test_where_f_is_undefined_the_estimate_stays(tmp_path):
    """x' = -log(1 + x) + u + d, measured at -2 once: the sample after it tells nothing, the next
    one does."""
    dynamics = dd.Dynamics(f=["-log(1 + x)"])
    exosystem = dd.Exosystem(A=[[0]], C=[[1]])
    observer = dd.Observer(W=[[2]])
    problem = PROBLEMS["carts"].replace(
        dynamics=dynamics,
        coupling="y",
        gains={"a": 2},
        exosystem=exosystem,
        observer=observer,
        target=0,
        simulation=None,
    )
    agents = compiled(problem, tmp_path, "1/20")
    measured = (0.5, -2.0, 0.4, 0.3)
    first, before, stays, after = (agents(0, np.full((3, 1), x))[2] for x in measured)
    assert not first.any()
    np.testing.assert_array_equal(stays, before)
    assert np.isfinite(after).all()
    assert (after != before).all()


@needs_gcc
@pytest.mark.parametrize(("name", "m", "p"), [("plants", 3, 2), ("resonators", 2, 1)])
def test_an_fmu_answers_like_the_loop(name, m, p, tmp_path):
    """u, v and dhat have p components, x and packets m; called as the standard says."""
    problem, period = PROBLEMS[name], 0.05
    times = [k * period for k in range(21)]
    stress = dd.Stress(period=period)
    run = dd.simulate(problem, t_final=times[-1], samples=times, stress=stress, seed=2)
    agent = LoadedFmu(dd.export.to_fmu(problem, period="1/20", agent="a"), tmp_path)
    inputs = [f"{name}[{c + 1}]" for name in ("x", "heard[b]") for c in range(m)]
    outputs = [f"{name}[{c + 1}]" if p > 1 else name for name in ("u", "dhat") for c in range(p)]
    outputs += [f"y[{c + 1}]" for c in range(m)]
    for k, time in enumerate(times):
        y = run.x[k] - run.goal
        given = dict(zip(inputs, [*run.x[k, 0], *y[1]], strict=True))
        found = agent(time, period, given, outputs)
        np.testing.assert_allclose(found, [*run.u[k, 0], *run.dhat[k, 0], *y[0]], atol=1e-11)
    agent.close()
    assert np.abs(run.dhat).max() > 0.1
