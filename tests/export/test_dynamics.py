"""Exports of agents with [dynamics]: python-control gives the simulated loop, the others are refused before writing."""

import importlib.util

import control
import numpy as np
import pytest
from dynamic_agents import double_integrators, pendulums, three_states
from typer.testing import CliRunner

import dobc_design as dd
from dobc_design.cli.main import app
from dobc_design.errors import SpecError
from dobc_design.export import python_script, to_control
from dobc_design.problem.changes import problem_text
from dobc_design.problem.integrators import as_integrators

PROBLEMS = {each.name: each for each in (double_integrators(), three_states(), pendulums())}
TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}


@pytest.mark.parametrize("name", PROBLEMS)
def test_python_control_reproduces_the_trajectory(name, tmp_path):
    """Outputs x (n m), dhat and u (n p); the Python file that stands alone has the same derivatives."""
    problem = PROBLEMS[name]
    system, run = to_control(problem), dd.simulate(problem, t_final=2, samples=21)
    found = control.input_output_response(system, run.times, 0, system.start_of(run), solve_ivp_kwargs=TIGHT)
    size, inputs = problem.n * problem.m, problem.n * problem.inputs
    for part, rows in (("x", slice(0, size)), ("dhat", slice(size, size + inputs)), ("u", slice(size + inputs, None))):
        np.testing.assert_allclose(found.outputs[rows].T, getattr(run, part).reshape(21, -1), atol=1e-6)
    assert system.ninputs == inputs
    (tmp_path / "loop.py").write_text(python_script(problem), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("loop", tmp_path / "loop.py")
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    rng = np.random.default_rng(1)
    state, w = rng.standard_normal(system.nstates), rng.standard_normal(inputs)
    other = alone.make_system(next(iter(problem.network.modes)))
    np.testing.assert_allclose(other.dynamics(0, state, w), system.dynamics(0, state, w), atol=1e-10)
    np.testing.assert_allclose(other.output(0, state, w), system.output(0, state, w), atol=1e-10)


@pytest.mark.parametrize("name", ["carts", "plants"])
def test_observer_of_one_agent_is_a_linear_system(name):
    """(13): z' for x_i and v_i = couplings + u_i, p of them, against the model's."""
    problem = PROBLEMS[name]
    model, observer = dd.build_model(problem), to_control(problem).observer
    rng = np.random.default_rng(2)
    goal = np.array([[float(x) for x in problem.goal_of(i)] for i in range(problem.n)])
    z, u = rng.standard_normal((problem.n, model.q)), rng.standard_normal((problem.n, problem.inputs))
    z_dot, _, dhat = (
        np.asarray(each).reshape(problem.n, -1) for each in model.observer(z.ravel(), goal.ravel(), u.ravel())
    )
    for i in range(problem.n):  # at the goal no agent feels a coupling
        both = np.concatenate([goal[i], u[i]])
        np.testing.assert_allclose(observer.A @ z[i] + observer.B @ both, z_dot[i], atol=1e-10)
        np.testing.assert_allclose(observer.C @ z[i] + observer.D @ both, dhat[i], atol=1e-10)
    assert to_control(PROBLEMS["pendulums"]).observer is None


@pytest.mark.parametrize("options", [["--c", "--period", "0.01"], ["--fmu", "--period", "0.01"], ["--sdpa"]])
def test_sampled_code_and_inequalities_are_refused_before_anything_is_written(options, tmp_path):
    """One error that names [dynamics]."""
    (tmp_path / "carts.toml").write_text(problem_text(PROBLEMS["carts"]), encoding="utf-8")
    target = tmp_path / "target"
    result = CliRunner().invoke(app, ["export", str(tmp_path / "carts.toml"), options[0], str(target), *options[1:]])
    assert isinstance(result.exception, SpecError) and result.exception.key == "dynamics"
    assert not target.exists()


def test_what_is_not_known_for_dynamics_is_refused(tmp_path):
    """Designs, the list of matrices, MATLAB, Rocq."""
    problem = PROBLEMS["carts"]
    refused = [
        lambda: dd.design(problem),
        lambda: dd.design_observer(problem),
        lambda: dd.design_pinning(problem, rate=1),
        lambda: dd.trade_off(problem),
        lambda: dd.export.to_numpy(problem),
        lambda: dd.export.to_latex(dd.certify(problem)),
        lambda: dd.export.to_mat(problem, tmp_path / "x.mat"),
    ]
    for call in refused:
        with pytest.raises(SpecError, match="not available yet for agents with dynamics"):
            call()
    assert not list(tmp_path.iterdir())


def test_diagnostics_and_searches_are_those_of_the_integrators():
    """Eigenvalues of the linearised loop; the graph is that of the pins that are given."""
    problem = PROBLEMS["plants"]
    own, other = dd.analyse(problem), dd.analyse(as_integrators(problem))
    assert own.modes == other.modes and own.spectrum == other.spectrum
    lonely = problem.replace(network=dd.Network.from_arcs([], arrow="listens_to", agents=["a", "b", "c"]))
    assert dd.analyse(lonely).graphs[0].unreached == ("b", "c")
    assert not dd.falsify(PROBLEMS["pendulums"], runs=10).suspects
