"""The exported loop, integrated by python-control, is the simulated one."""

import importlib.util
import inspect
import subprocess
import sys
import warnings
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest
from c_code import planar
from known_functions import SOFTSIGN
from networks import linked
from simulated_runs import simulate

import dobc_design as dd
from dobc_design import Network, Problem, load_problem
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.errors import SpecError
from dobc_design.export import python_script, to_control
from dobc_design.model.model import build_model

TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}


def response(system, trajectory, w=0.0):
    return control.input_output_response(
        system, trajectory.times, w, system.start_of(trajectory), solve_ivp_kwargs=TIGHT
    )


@pytest.mark.parametrize("name", ["paper-fixed", "planar"])
def test_python_control_reproduces_the_trajectory(name: str):
    problem = planar() if name == "planar" else load_problem(name)
    system = to_control(problem)
    run = simulate(problem, t_final=1, samples=21)
    found = response(system, run)
    size = problem.n * problem.m
    for part, rows in (
        ("x", slice(0, size)),
        ("dhat", slice(size, 2 * size)),
        ("u", slice(2 * size, 3 * size)),
    ):
        found_part = found.outputs[rows].T
        wanted = getattr(run, part).reshape(21, size)
        np.testing.assert_allclose(found_part, wanted, atol=1e-6)
    assert isinstance(system, control.NonlinearIOSystem)
    assert system.nstates == problem.n * (problem.m + 2 * problem.q)


def test_a_switched_loop_follows_the_same_switches():
    """python-control steps across the switches, hence the tolerance."""
    problem = load_problem("paper-switching")
    run = dd.simulate(problem, t_final=1.75, samples=176)
    active = run.switches.at(run.times)
    modes = {run.switches.names[i] for i in active}
    assert len(modes) > 1
    found = response(to_control(problem), run)
    found_states = found.outputs[:10].T
    states = run.x[:, :, 0]
    np.testing.assert_allclose(found_states, states, atol=1e-4)
    found_response = response(to_control(problem, seed=1), run).outputs
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(found_response[:10].T, run.x[:, :, 0], atol=1e-2)


def test_states_that_an_integrator_tries_far_away_overflow_without_a_warning(tmp_path):
    """Which states are tried depends on the processor."""
    problem = load_problem("paper-switching")
    (tmp_path / "loop.py").write_text(python_script(problem), encoding="utf-8")
    mode = list(problem.network.modes)[1]
    system = to_control(problem, mode=mode)
    loop = module_of(tmp_path / "loop.py")
    w = np.zeros(system.ninputs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for far in (1e3, 1e200, 1e308):
            odd = np.arange(system.nstates) % 2
            state = far * np.where(odd, 1.0, -1.0)
            for found in (system.dynamics(0.0, state, w), loop.derivative(mode, state, w)):
                assert not np.isfinite(found).all()
            outputs = system.output(0.0, state, w), loop.outputs(state)
    assert not np.isfinite(outputs).all(axis=1).any()


def test_a_function_that_numpy_lacks_is_defined_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(FUNCTIONS, "softsign", SOFTSIGN)
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    problem = Problem(network=network, coupling="softsign(y)", gains={2: 1})
    (tmp_path / "loop.py").write_text(python_script(problem), encoding="utf-8")
    loop = module_of(tmp_path / "loop.py")
    start = np.array([1.0, 4.0])
    found = loop.derivative("G", start, np.zeros(2))
    assert found == pytest.approx([3 / 4, -4.0])


def test_the_input_is_a_disturbance_besides_the_modelled_one():
    """A step w at one agent moves the derivative of its x and nothing else."""
    system = to_control(load_problem("paper-fixed"))
    state = np.linspace(0, 1, 50)
    w = np.zeros(10)
    w[3] = 0.7
    disturbed = system.dynamics(0.0, state, w)
    undisturbed = system.dynamics(0.0, state, np.zeros(10))
    difference = disturbed - undisturbed
    assert difference[3] == pytest.approx(0.7)
    assert not np.delete(difference, 3).any()


def test_observer_and_exosystem_are_state_spaces_of_one_agent():
    """The observer driven by a trajectory's x and x' - d gives its dhat; poles are those of A and A
    - W C."""
    problem = load_problem("paper-fixed")
    system = to_control(problem)
    assert isinstance(system.observer, control.StateSpace)
    exosystem_poles = np.sort_complex(system.exosystem.poles())
    np.testing.assert_allclose(exosystem_poles, [-2j, 2j], atol=1e-12)
    poles = np.sort_complex(system.observer.poles())
    lower = -1.6 - 0.4j * np.sqrt(39)
    upper = -1.6 + 0.4j * np.sqrt(39)
    np.testing.assert_allclose(poles, [lower, upper], atol=1e-12)
    run = simulate(problem, t_final=0.5, samples=2001)
    h = build_model(problem).h
    felt_rows = [h(x.ravel() - 1).full().ravel() for x in run.x]
    felt = np.stack(felt_rows)
    v = felt[:, 3] + run.u[:, 3, 0]
    W = np.array([3.2, 2.4])
    start = run.xihat[0, 3] - W * run.x[0, 3, 0]
    own_state = run.x[:, 3, 0]
    both = np.stack([own_state, v])
    found = control.forced_response(system.observer, run.times, both, start)
    # Inputs are taken as linear between the samples.
    dhat = run.dhat[:, 3, 0]
    np.testing.assert_allclose(found.outputs[0], dhat, atol=1e-4)
    free = control.initial_response(system.exosystem, run.times, run.xi[0, 3])
    found_outputs = free.outputs.ravel()
    d = run.d[:, 3, 0]
    np.testing.assert_allclose(found_outputs, d, atol=1e-8)


def test_without_an_exosystem_there_is_no_observer():
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    problem = Problem(network=network, coupling="y", gains={"2": 1})
    system = to_control(problem)
    assert system.observer is None
    assert system.exosystem is None
    start = [[3], [1]]
    run = simulate(problem, start=start, t_final=2, samples=21)
    found_response = response(system, run).outputs
    states = run.x[:, :, 0]
    np.testing.assert_allclose(found_response[:2].T, states, atol=1e-7)


def test_the_facade_designs_a_missing_gain_and_refuses_moving_graphs():
    system = to_control("uav-swarm")
    assert system.observer.nstates == 6
    with pytest.raises(SpecError, match="must not depend on the states"):
        to_control("paper-fixed", signal=dd.signals.Mobile(radius=1.0))


def answers(loop, mode: str, state: np.ndarray, w: np.ndarray) -> dict[str, np.ndarray]:
    """What the module of an exported file says in one mode."""
    system = loop.make_system(mode)
    derivative = system.dynamics(0, state, w)
    outputs = system.output(0, state, w)
    start = loop.start(loop.GOALS, None, 1.0)
    return {
        "derivative": derivative,
        "outputs": outputs,
        "start": start,
        "poles": loop.make_observer().poles(),
        "exosystem": loop.make_exosystem().A,
    }


def in_a_process(file: Path, mode: str, state: np.ndarray, w: np.ndarray) -> dict[str, np.ndarray]:
    """The same, of the file in a process of its own where this package cannot be imported."""
    np.savez(file.with_name("given.npz"), state=state, w=w, mode=np.array(mode))
    script = "import sys\nsys.modules['dobc_design'] = None\nimport numpy as np\nimport loop\n"
    script += inspect.getsource(answers)
    script += "given = np.load('given.npz')\n"
    script += (
        "np.savez('found.npz', **answers(loop, str(given['mode']), given['state'], given['w']))\n"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=file.parent, capture_output=True, check=False, text=True)
    assert done.returncode == 0, done.stderr
    return dict(np.load(file.with_name("found.npz")))


def in_this_process(
    file: Path, mode: str, state: np.ndarray, w: np.ndarray
) -> dict[str, np.ndarray]:
    """The same, while this package cannot be imported."""
    with pytest.MonkeyPatch.context() as without:
        without.setitem(sys.modules, "dobc_design", None)
        return answers(module_of(file), mode, state, w)


def module_of(file: Path):
    spec = importlib.util.spec_from_file_location("loop", file)
    loop = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loop)
    return loop


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("planar", in_this_process),
        pytest.param("planar", in_a_process, marks=pytest.mark.slow),
        pytest.param("paper-switching", in_a_process, marks=pytest.mark.slow),
    ],
)
def test_the_file_alone_gives_the_same_derivatives_and_outputs(name: str, asked, tmp_path: Path):
    problem = planar() if name == "planar" else load_problem(name)
    (tmp_path / "loop.py").write_text(python_script(problem), encoding="utf-8")
    mode = list(problem.network.modes)[1]
    system = to_control(problem, mode=mode)
    rng = np.random.default_rng(0)
    state_drawn = rng.normal(size=system.nstates)
    state = state_drawn
    w = rng.normal(size=system.ninputs)
    found = asked(tmp_path / "loop.py", mode, state, w)
    derivative = system.dynamics(0.0, state, w)
    np.testing.assert_allclose(found["derivative"], derivative, rtol=1e-12, atol=1e-12)
    outputs = system.output(0.0, state, w)
    np.testing.assert_allclose(found["outputs"], outputs, rtol=1e-12, atol=1e-12)
    found_poles = np.sort_complex(found["poles"])
    wanted_poles = np.sort_complex(system.observer.poles())
    np.testing.assert_allclose(found_poles, wanted_poles, atol=1e-9)
    assert found["start"].shape == state.shape


NEAR = dd.Region(initial_states=["9/10", "11/10"], initial_disturbance="1/100")


@pytest.mark.parametrize(
    ("period", "radius"), [("1/20", 0.919925), ("1/10", 0.840267), ("1/5", 0.686773)]
)
def test_the_sampled_observer_has_the_known_spectral_radius(period, radius):
    """Theory, section 17."""
    system = to_control(load_problem("paper-fixed").replace(processor={"period": period}))
    assert system.dt == system.observer.dt == system.exosystem.dt == float(Fraction(period))
    assert np.abs(system.observer.poles()).max() == pytest.approx(radius, abs=1e-6)
    assert np.abs(system.exosystem.poles()) == pytest.approx([1, 1])


def test_the_loop_of_a_processor_is_a_discrete_system_that_reproduces_the_run():
    problem = load_problem("paper-fixed").replace(processor={"period": "1/50"}, region=NEAR)
    system = to_control(problem)
    times = [0.02 * k for k in range(101)]
    run = simulate(problem, t_final=times[-1], samples=times)
    found = control.input_output_response(system, run.times, 0.0, system.start_of(run))
    np.testing.assert_allclose(found.outputs[:10].T, run.x[..., 0], atol=1e-11)
    np.testing.assert_allclose(found.outputs[10:20].T, run.dhat[..., 0], atol=1e-11)
    np.testing.assert_allclose(found.outputs[20:].T, run.u[..., 0], atol=1e-11)
    assert to_control(problem, sampled=False).dt == 0


def test_agents_in_steps_are_a_system_in_steps():
    problem = linked([[1, 2, "1/4"], [2, 1, "1/8"]], gains={1: "1/2"}, time="discrete")
    system = to_control(problem)
    run = simulate(problem, t_final=20)
    assert system.dt == 1
    found = control.input_output_response(system, run.times, 0.0, system.start_of(run))
    np.testing.assert_allclose(found.outputs[:2].T, run.x[..., 0], atol=1e-12)
    with pytest.raises(SpecError, match="sampled cannot be False: agents move in steps"):
        to_control(problem, sampled=False)


def test_a_sampled_model_needs_a_processor_and_prompt_readings():
    problem = load_problem("paper-fixed")
    with pytest.raises(SpecError, match=r"sampled needs a \[processor\]"):
        to_control(problem, sampled=True)
    with pytest.raises(SpecError, match="python-control does not know readings that are late"):
        to_control(problem.replace(readings={"delay": 1}))
