"""Exports of agents that measure y = H x, against the whole loop as ``support/measured.py`` writes
it out, and runs (theory, section 18)."""

import control
import numpy as np
import pytest
from measured import CARTS, by_agent, estimates_at_start, whole_loop

import dobc_design as dd
from dobc_design.conditions.observer.propose import with_observer
from dobc_design.errors import SpecError
from dobc_design.export import to_control

TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}


@pytest.mark.parametrize("name", ["estimates", "outputs"])
def test_python_control_has_the_spectrum_of_the_whole_loop(name):
    """Of x, xhat and xi - xihat; the disturbances beside it are free."""
    problem = with_observer(CARTS[name])
    system = to_control(problem)
    found = np.poly(system.linearize(np.zeros(system.nstates), np.zeros(3)).poles())
    free = [np.linalg.eigvals(A) for A, _, _ in by_agent(problem)]
    wanted = np.concatenate([np.linalg.eigvals(whole_loop(problem, "G")), *free])
    np.testing.assert_allclose(found, np.poly(wanted), rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", ["outputs", "curved", "leader"])
def test_python_control_reproduces_the_trajectory_from_its_estimates(name):
    problem = CARTS[name]
    system = to_control(problem)
    run = dd.simulate(problem, t_final=2, samples=21)
    xhat = run.x[0] - estimates_at_start(with_observer(problem), 2)
    start = system.start_of(run, xhat)
    found = control.input_output_response(system, run.times, 0, start, solve_ivp_kwargs=TIGHT)
    wanted = np.hstack([part.reshape(21, -1) for part in (run.x, run.dhat, run.u)])
    np.testing.assert_allclose(found.outputs.T, wanted, atol=1e-6)
    # By default the estimates of states are right.
    assert np.array_equal(system.start_of(run), system.start_of(run, run.x[0]))
    assert not np.array_equal(system.start_of(run), start)


def test_a_disturbance_beside_the_model_moves_the_states_and_not_the_estimates():
    """w acts on the speed of one cart, as an input does."""
    system = to_control(CARTS["estimates"])
    state = np.linspace(0, 1, system.nstates)
    moved = system.dynamics(0.0, state, [0, 0.7, 0]) - system.dynamics(0.0, state, np.zeros(3))
    assert moved[3] == pytest.approx(0.7)
    assert not np.delete(moved, 3).any()


def test_the_observer_of_one_agent_has_the_outputs_and_the_input_alone():
    """Poles: those of A - W H; driven by y and v of a run it finds the disturbance."""
    problem = with_observer(CARTS["outputs"])
    system = to_control(problem)
    assert system.observer.input_labels == ["y[1]", "v[1]"]
    np.testing.assert_allclose(np.sort_complex(system.exosystem.poles()), [-2j, 2j], atol=1e-12)
    run = dd.simulate(problem, t_final=20, samples=20_001)
    last = run.x[:, 2]
    v = run.u[:, 2, 0] + 2 * (run.x[:, 1, 0] - last[:, 0])
    both = np.stack([last[:, 0], v])
    found = control.forced_response(system.observer, run.times, both, np.zeros(4))
    assert np.abs(found.outputs[0] - run.d[:, 2, 0])[-1000:].max() < 1e-4
    assert np.abs(run.d[:, 2, 0])[-1000:].max() > 0.1


def test_the_python_file_is_refused_by_name():
    with pytest.raises(SpecError, match=r"^dynamics\.H: the Python file does not know outputs"):
        dd.export.python_script(CARTS["outputs"])
