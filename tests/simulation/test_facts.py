"""What must hold for every loop: symmetries, equilibria, averages; and what is said when a run goes wrong."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.errors import SpecError
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation.run import simulate
from dobc_design.simulation.signals import Periodic, RandomDwell

N = 12


def modes(order=range(N)) -> dict[str, list[list[int]]]:
    """Two digraphs on twelve agents, named by ``order``."""
    first = [[order[i] + 1, order[(i + 1) % N] + 1, i % 3 + 1] for i in range(N)]
    second = [[order[i] + 1, order[(i + 5) % N] + 1, 2] for i in range(N)]
    return {"a": first, "b": second}


def loop(order=range(N), *, target=1, **settings) -> Problem:
    defaults = {
        "coupling": "exp(y) - 1 + y",
        "target": target,
        "gains": {str(order[0] + 1): 5, str(order[4] + 1): 2},
        "exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        "observer": Observer(W=[["16/5"], ["12/5"]]),
    }
    network = Network.from_arcs(modes(order), arrow="listens_to", agents=N)
    return Problem(network=network, **(defaults | settings))


def starts():
    rng = np.random.default_rng(3)
    return rng.uniform(0, 3, size=(N, 1)), rng.normal(size=(N, 2))


@pytest.mark.parametrize("observer", ["closed-form", "full-loop"])
def test_a_fixed_point_stays_fixed_to_rounding(observer: str):
    """e = 0 and eps = 0: (3), with a disturbance that the observer knows from the start."""
    xi = starts()[1]
    run = simulate(
        loop(), start={"x": np.ones((N, 1)), "xi": xi, "xihat": xi}, signal=Periodic(dwell=0.5), observer=observer
    )
    assert run.error().max() < (1e-15 if observer == "closed-form" else 1e-9)
    assert np.abs(run.d).max() > 1


def test_permuting_the_agents_permutes_the_result():
    order = np.random.default_rng(0).permutation(N)
    x, xi = starts()
    one = simulate(loop(), start={"x": x, "xi": xi}, signal=Periodic(dwell=0.5))
    moved_x, moved_xi = np.empty_like(x), np.empty_like(xi)
    moved_x[order], moved_xi[order] = x, xi
    other = simulate(loop(order.tolist()), start={"x": moved_x, "xi": moved_xi}, signal=Periodic(dwell=0.5))
    np.testing.assert_allclose(other.x[:, order], one.x, atol=1e-9)
    np.testing.assert_allclose(other.u[:, order], one.u, atol=1e-8)


def test_shifting_the_target_shifts_the_states():
    """Only differences and x - xbar enter; the shift is a power of two, so that nothing rounds at the start."""
    x, xi = starts()
    one = simulate(loop(), start={"x": x, "xi": xi}, signal=Periodic(dwell=0.5))
    other = simulate(loop(target=65), start={"x": x + 64, "xi": xi}, signal=Periodic(dwell=0.5))
    np.testing.assert_allclose(other.x - 64, one.x, atol=1e-9)
    np.testing.assert_allclose(other.dhat, one.dhat, atol=1e-12)


def test_an_unpinned_undisturbed_balanced_linear_network_keeps_its_average():
    """1' L = 0 in both modes, whose weights differ; unbalanced ones lose it."""
    balanced = {name: [[*arc[:2], k + 1] for arc in arcs] for k, (name, arcs) in enumerate(modes().items())}
    network = Network.from_arcs(balanced, arrow="listens_to", agents=N)
    problem = Problem(network=network, coupling="y")
    run = simulate(problem, signal=RandomDwell(dwell=0.3), start=starts()[0])
    assert np.ptp(run.x[:, :, 0].mean(axis=1)) < 1e-12
    assert np.ptp(run.x[-1]) < 1e-3
    lost = simulate(loop(coupling="y", gains={}, exosystem=None, observer=None), start=starts()[0])
    assert np.ptp(lost.x[:, :, 0].mean(axis=1)) > 1e-3


def test_the_seed_gives_the_same_run_again():
    problem, signal = load_problem("paper-switching"), RandomDwell(dwell=0.2)
    first, again = (simulate(problem, signal=signal, seed=11, t_final=3) for _ in range(2))
    assert np.array_equal(first.x, again.x)
    assert first.switches == again.switches
    assert simulate(problem, signal=signal, seed=12, t_final=3).switches != first.switches


def test_the_active_mode_stands_at_every_sample():
    run = simulate(loop(), signal=Periodic(dwell=0.5), t_final=2, samples=[0, 0.25, 0.5, 1.2, 1.75, 2])
    assert run.mode_index.tolist() == [0, 0, 1, 0, 1, 1]
    assert [sample.mode for sample in run] == ["a", "a", "b", "a", "b", "b"]
    assert run.mode == "a, b (periodic, 0.5 s each)"
    assert [sample.time for sample in run] == run.times.tolist()
    assert len(run) == 6
    assert np.array_equal(next(iter(run)).x, run.x[0])


def ring(coupling: str, **settings) -> Problem:
    network = Network.from_arcs([[i + 1, (i + 1) % 10 + 1] for i in range(10)], arrow="listens_to", agents=10)
    return Problem(network=network, coupling=coupling, **settings)


@pytest.mark.parametrize(
    ("problem", "reason"),
    [
        (ring("-y", gains={"1": 1}), "exceeded 1e+09 times its start at t ="),
        (ring("-y**3", gains={"1": 1}), "collapsed|exceeded"),
        (ring("exp(y) - 1 + y", gains={"1": 1}, region={"initial_states": [0, 2000]}), "overflows or is undefined"),
        (ring("log(1 + y)", gains={"1": 1}, region={"initial_states": [0, 9]}), "undefined|collapsed"),
    ],
    ids=["linear", "cubic", "start", "domain"],
)
def test_a_run_that_ends_early_says_why_and_when(problem: Problem, reason: str):
    import re

    run = simulate(problem)
    assert run.diverged
    assert re.search(reason.replace("+", r"\+"), run.reason)
    assert f"t = {run.times[-1]:.6g} s" in run.reason or "just after" in run.reason
    assert np.isfinite(run.x).all()
    assert run.settling_time() is None


def test_a_run_that_blows_up_between_two_samples_keeps_its_rise():
    """x1' = (x1 - x2)^3 with x2 = 0: x1 = x0 / sqrt(1 - 2 x0^2 t), at every sample that is left."""
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=2)
    run = simulate(Problem(network=network, coupling="-y**3"), start=[[1], [0]], t_final=10, samples=11)
    assert run.diverged
    assert len(run) > 20
    assert (np.diff(run.times) > 0).all()
    early = run.times < 0.4999
    np.testing.assert_allclose(run.x[early, 0, 0], 1 / np.sqrt(1 - 2 * run.times[early]), rtol=1e-4)
    assert early.sum() > 5


def test_switches_after_the_end_of_a_run_are_left_out():
    problem = loop(coupling="-y", exosystem=None, observer=None)
    run = simulate(problem, signal=Periodic(dwell=0.5), t_final=60)
    assert run.diverged
    assert run.switches.times[-1] <= run.times[-1] < 59


def test_stiffness_at_the_consensus_is_seen_beforehand_and_said():
    before = simulate(ring("y", gains={"1": 10**6}), t_final=2)
    assert before.method == "Radau"
    assert "implicit" in before.notes[-1]
    calm = simulate(ring("y", gains={"1": 1}), t_final=2)
    assert calm.method == "DOP853"
    assert calm.notes == ()


def test_a_loop_that_turns_stiff_is_taken_over_by_the_implicit_method():
    """Agent 1 settles between two that stay far away: there its rate is 2 + 6 * 100 * 35^2 = 735 000 1/s.

    At rest it is in the middle, because h is odd.
    """
    network = Network.from_arcs([[1, 2], [1, 3]], arrow="listens_to", agents=3)
    problem = Problem(network=network, coupling="y + 100*y**3")
    run = simulate(problem, start=[[1], [40], [-30]], t_final=2.0)
    np.testing.assert_allclose(run.x[-1, :, 0], [5, 40, -30], rtol=1e-9)
    assert run.method == "DOP853, then Radau"
    assert "turned out to be stiff" in run.notes[0]


def test_an_observer_that_is_too_fast_for_the_closed_form_is_integrated_and_said():
    observer = Observer(W=[[2 * 10**6], ["12/5"]])
    run = simulate(loop(observer=observer), mode="a", t_final=1.0)
    assert "full loop was integrated" in " ".join(run.notes)
    assert not run.diverged


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mode": "a", "signal": Periodic(dwell=1)}, "exclude each other"),
        ({"mode": "c"}, "mode must be one of"),
        ({"signal": "periodic"}, "signal must be a switching signal; got periodic"),
        ({"stress": "noise"}, "stress must be a Stress; got noise"),
        ({"observer": "slow"}, "observer must be one of"),
        ({"tolerance": 0}, "tolerance must be"),
        ({"samples": [0, 1]}, "increase from 0 to t_final"),
        ({"samples": [0, float("nan"), 20]}, "must be finite"),
        ({"t_final": float("inf")}, "within the range of floats"),
        ({"start": [[float("nan")]] * N}, "must be finite"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message: str):
    with pytest.raises(SpecError, match=message):
        simulate(loop(), **arguments)


def test_large_networks_get_fewer_samples_unless_asked():
    from dobc_design.simulation import setting as module

    times, notes = module._times(None, 1.0, 1 << 24)
    assert len(times) == 4
    assert "4 samples only" in notes[0]
    assert len(module._times(401, 1.0, 1 << 24)[0]) == 401
