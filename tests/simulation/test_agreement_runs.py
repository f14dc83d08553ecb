"""Runs of agents that agree on a value: errors are their largest disagreement.

Oracles: maxima and means by NumPy, python-control's integrator.
"""

from __future__ import annotations

import control
import numpy as np
import pytest

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.report.pictures import error_picture
from dobc_design.simulation.breaking import what_breaks_first

RING = [[i + 1, (i + step) % 4 + 1] for i in range(4) for step in (1, 3)]


def agreeing(arcs=RING, **more) -> dd.Problem:
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=4)
    given = {
        "coupling": "y",
        "exosystem": dd.exosystems.constant(),
        "observer": dd.Observer(W=[[5]]),
    }
    given["region"] = {"initial_states": [15, 25], "initial_disturbance": "1/5"}
    return dd.Problem(**(given | {"network": network, "goal": "agreement"} | more))


def test_the_error_is_the_largest_disagreement_and_is_kept_in_files(tmp_path):
    """And an ensemble has that of each of its runs."""
    problem = agreeing()
    run = dd.simulate(problem, t_final=10, samples=21, seed=3)
    x = run.x[..., 0]
    np.testing.assert_allclose(run.error(), x.max(axis=1) - x.min(axis=1), atol=1e-12)
    assert run.final_error < 1e-6 * run.error()[0]
    assert run.settling_time() is not None
    again = dd.load_trajectory(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.error(), run.error())
    both = dd.simulate(problem, runs=2, t_final=10, samples=21, seed=3)
    np.testing.assert_allclose(both.error[0], run.error(), rtol=1e-4, atol=1e-5)


def test_no_run_is_above_the_certified_disagreement_and_the_value_is_that_of_the_formula():
    problem = agreeing()
    certificate = dd.certify(problem, everything=True)
    value = certificate.value
    for seed in range(3):
        run = dd.simulate(problem, t_final=12, samples=41, seed=seed)
        bound = certificate.envelope(run)
        assert bound.sources == ("max-separable", "settling")
        assert np.all(run.error() <= bound(run.times) * (1 + 1e-9) + 1e-7)
        eps = run.xi[0] - run.xihat[0]
        mean = run.x[0].mean() + eps.mean() / 5
        np.testing.assert_allclose(run.x[-1], mean, atol=1e-5)
        np.testing.assert_allclose(run.ends(certificate), [[mean], [mean]], atol=1e-9)
        assert value.lo[0] <= mean <= value.hi[0]


def test_a_figure_of_agents_that_agree_draws_no_goal():
    run = dd.simulate(agreeing(), t_final=1, samples=5)
    labels = {line.get_label() for ax in run.plot().figure.axes for line in ax.lines}
    assert not labels & {"goal", "|e|∞"}
    assert "max |xᵢ − xⱼ|" in labels


def test_a_run_from_the_region_ends_between_the_lines_of_its_figure():
    problem = agreeing(coupling="tanh(y)")
    certificate = dd.certify(problem)
    run = dd.simulate(problem, t_final=40, samples=5)
    low, high = run.ends(certificate)[:, 0]
    c = abs(run.xi[0] - run.xihat[0]).max() / 5
    assert low == pytest.approx(run.x[0].min() - c, rel=1e-4)
    assert low < run.x[-1].min() < run.x[-1].max() < high
    drawn = run.plot(certificate=certificate).figure.axes[0].lines
    proved = [line.get_ydata()[0] for line in drawn if line.get_label() == "value, proved"]
    assert proved == [low, high]
    picture = error_picture(certificate, run)
    assert picture.title == "Largest disagreement over time"
    assert "goal" not in picture.caption


def test_of_starts_farther_apart_than_the_region_no_end_is_known():
    problem = agreeing(coupling="tanh(y)")
    run = dd.simulate(problem, t_final=1, samples=5, start={"x": [[0], [1], [2], [12]]})
    assert run.ends(dd.certify(problem)) is None


def test_differences_with_one_agent_bound_no_disagreement_of_others():
    """With a root that hears nobody the proof is about x_i - x_root: others differ by up to twice
    that."""
    problem = agreeing([[2, 1], [3, 1], [4, 1]])
    run = dd.simulate(problem, t_final=5, samples=5)
    bound = dd.certify(problem).envelope(run)
    assert not bound.sources
    assert "all pairs" in bound.reason


def foes() -> dd.Problem:
    """x1' = x2' = -x1 - x2."""
    arcs = [[1, 2, -1], [2, 1, -1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2, negative="opposes")
    return dd.Problem(network=network, coupling="y", goal="agreement")


def test_agents_on_two_sides_agree_up_to_signs():
    run = dd.simulate(foes(), start=[[1], [2]], t_final=8, samples=9)
    x = run.x[..., 0]
    np.testing.assert_allclose(run.error(), np.abs(x[:, 0] + x[:, 1]), atol=1e-9)


def test_python_control_has_the_loop_that_is_simulated():
    problem = agreeing()
    run = dd.simulate(problem, t_final=2, samples=9)
    model = dd.export.to_control(problem)
    found = control.input_output_response(
        model, run.times, 0.0, model.start_of(run), solve_ivp_kwargs={"rtol": 1e-9}
    )
    np.testing.assert_allclose(found.outputs[:4].T, run.x[..., 0], atol=1e-4)


def test_casadi_has_the_couplings_of_agents_that_agree_and_of_signs():
    L = 2 * np.eye(4) - np.roll(np.eye(4), 1, axis=0) - np.roll(np.eye(4), -1, axis=0)
    x = np.array([[1.0, 3, -2, 5]])
    plain = dd.export.to_casadi(
        agreeing(exosystem=None, observer=None, region=None), "error_dynamics"
    )
    np.testing.assert_allclose(np.ravel(plain(x, [])[0]), -L @ x[0], atol=1e-12)
    apart = dd.export.to_casadi(foes())
    np.testing.assert_allclose(np.ravel(apart([1, 2], [], [])[0]), [-3, -3], atol=1e-12)


@pytest.mark.slow
def test_stress_breaks_the_disagreement_of_agents_that_work():
    found = what_breaks_first(agreeing(), options=("noise",), t_final=10)
    assert found.sweeps[0].survives is not None


@pytest.mark.parametrize("act", [dd.falsify, dd.trade_off, dd.export.to_sdpa])
def test_what_needs_a_target_says_so(act):
    with pytest.raises(SpecError, match="needs a target; these agents agree"):
        act(agreeing())


def test_several_runs_from_the_starts_of_the_file_are_said_to_be_alike():
    given = agreeing(region=None, simulation={"x0": [[1], [2], [3], [4]], "xi0": [1]})
    alike = "All runs are alike: nothing in them is drawn at random."
    assert alike in dd.simulate(given, runs=2, t_final=1).notes[-1]
    assert not any(alike in note for note in dd.simulate(agreeing(), runs=2, t_final=1).notes)
