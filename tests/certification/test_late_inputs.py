"""Inputs that act a known time after what they were computed from was measured (theory, section 15:
a known constant delay of actuator or sensor).

Oracle: agents, controllers and observers in NumPy that pass commands through a buffer.
"""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from certified import only
from networks import around, network_of
from scipy.linalg import expm

import dobc_design as dd
from dobc_design import Verdict
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)
from dobc_design.report.write import render_report

PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED
A = np.array([[0.0, 2.0], [-2.0, 0.0]])
C = np.array([[1.0, 0.0]])
W = np.array([[3.2], [2.4]])
F = A - W @ C
LATE = 0.04


def ring(delay: Any, **more: Any) -> dd.Problem:
    """A directed cycle of three agents, all pinned with 5, from |e| <= 1/2."""
    given = {
        "network": network_of(around(3), 3),
        "coupling": "tanh(y)",
        "gains": dict.fromkeys(range(1, 4), 5),
        "actuators": {"delay": delay},
        "region": {"initial_states": ["-1/2", "1/2"]},
    }
    return dd.Problem(**given | more)


def watched(delay: str = "0.04", **more: Any) -> dd.Problem:
    """The same with the disturbance and the gain of the paper."""
    return ring(
        delay,
        exosystem=dd.Exosystem([[0, 2], [-2, 0]], [[1, 0]]),
        observer=dd.Observer(W=[["16/5"], ["12/5"]]),
        region={"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/10"},
        simulation={"xi0": ["3/10", "2/5"]},
        **more,
    )


def buffered(x: Any, xi: Any, xihat: Any, *, time: float, step: float = 1e-3) -> list[Any]:
    """States, disturbances, estimates and what is applied in every step (n, ...), by Heun's method
    where it is not exact: a controller computes at once, and what it commands waits in a buffer."""
    waiting = [np.zeros(len(x))] * round(LATE / step)
    z = xihat - x[:, None] * W[:, 0]
    turn = expm(A * step)
    mean = np.linalg.solve(A, turn - np.eye(2))
    seen = []
    for _ in range(round(time / step) + 1):
        xihat = z + x[:, None] * W[:, 0]
        predicted = xihat @ expm(A * LATE).T @ C.T
        waiting.append(np.tanh(np.roll(x, -1) - x) - 5 * x - predicted[:, 0])
        applied = waiting.pop(0)
        seen.append((x, xi, xihat, applied))
        after = x + step * applied + (xi @ mean.T @ C.T)[:, 0]
        fed = applied[:, None] * W[:, 0]
        first = xihat @ F.T - fed
        last = (z + step * first + after[:, None] * W[:, 0]) @ F.T - fed
        z = z + step * (first + last) / 2
        x = after
        xi = xi @ turn.T
    return [np.array(each) for each in zip(*seen, strict=True)]


def test_the_residual_is_the_error_of_then_carried_on_and_runs_are_those_of_a_buffer():
    """d(t) - dhat(t) = C exp(A delay) eps(t - delay), exactly; runs differ by the steps in which
    readings are held, an eighth of the delay."""
    times = np.linspace(0, 2, 41)
    run = dd.simulate(watched(), start=[[0.5], [-0.5], [0.4]], t_final=2, samples=times)
    x, xi, xihat, _ = buffered(run.x[0, :, 0], run.xi[0], run.xihat[0], time=2)
    late = round(LATE / 1e-3)
    eps = xi - xihat
    residual = (xi[late:] - xihat[:-late] @ expm(A * LATE).T) @ C.T
    assert np.allclose(residual, eps[:-late] @ expm(A * LATE).T @ C.T, atol=1e-12)
    assert np.allclose(eps[-1], eps[0] @ expm(2 * F).T, atol=1e-5)
    assert np.allclose(run.xihat[-1], xihat[-1], atol=1e-2)
    assert np.abs(run.x[:, :, 0] - x[::50]).max() < 0.006
    # what acts is the prediction, and nothing before
    assert np.allclose(run.d[1:] - run.dhat[1:], residual[50 - late :: 50], atol=1e-2)
    assert not run.u[0].any()


def ticked(x: Any, xi: Any, xihat: Any, *, steps: int, period: float = LATE / 2) -> list[Any]:
    """The same on a processor, where commands wait for two ticks."""
    waiting = [np.zeros(len(x))] * 2
    turn = expm(A * period)
    mean = C @ np.linalg.solve(A, turn - np.eye(2))
    seen = []
    for _ in range(steps):
        predicted = xihat @ expm(A * LATE).T @ mean.T / period
        waiting.append(np.tanh(np.roll(x, -1) - x) - 5 * x - predicted[:, 0])
        moved = period * waiting.pop(0)
        seen.append((x, xihat))
        after = x + moved + (xi @ mean.T)[:, 0]
        surprise = after - x - moved - (xihat @ mean.T)[:, 0]
        xihat = xihat @ turn.T + surprise[:, None] * W[:, 0]
        x, xi = after, xi @ turn.T
    return [np.array(each) for each in zip(*seen, strict=True)]


def test_on_a_processor_runs_are_the_recursion_with_a_buffer():
    on_ticks = watched(processor={"period": "0.02"})
    run = dd.simulate(on_ticks, start=[[0.5], [-0.5], [0.4]], t_final=2, samples=101)
    x, xihat = ticked(run.x[0, :, 0], run.xi[0], run.xihat[0], steps=101)
    assert np.allclose(run.x[..., 0], x, atol=1e-13)
    assert np.allclose(run.xihat, xihat, atol=1e-13)


@pytest.mark.slow
def test_a_processor_whose_commands_wait_keeps_its_bound_at_the_ticks():
    """6 T <= 4/27 for two ticks: T <= 0.02469; from corners and several phases of the disturbance
    with the observer."""
    alone = {"coupling": "y", "processor": {"period": "0.0246"}}
    assert dd.certify(ring("0.0492", **alone)).verdict is PROVED
    longer = alone | {"processor": {"period": "0.0248"}}
    assert dd.certify(ring("0.0496", **longer)).verdict is UNDECIDED
    problem = watched(processor={"period": "0.02"})
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert dd.verify(certificate, problem).holds
    assert "at the samples, t from 0.04 s on" in certificate.check("readings").reason
    claim = certificate.check("readings").claim.rows
    v = np.array([float(each) for each in claim.v])
    kept = float(claim.rho) * (1 - float(claim.alpha) / 50) ** np.maximum(np.arange(150) - 2, 0)
    for phase in np.linspace(0, 6, 5):
        xi = np.tile([np.cos(phase) / 2, np.sin(phase) / 2], (3, 1))
        x, _ = ticked(np.full(3, 0.5), xi, xi - [[0.1, 0]], steps=150)
        assert np.all(np.abs(x) / v <= kept[:, None])


@pytest.mark.slow
def test_slopes_and_gain_may_add_up_to_one_over_e_delay():
    """6 delay <= 1/e: 0.06131 s; nothing decays before the first input acts, so that the factor is
    at least exp(rate delay)."""
    certificate = dd.certify(ring("0.0613", coupling="y"))
    assert certificate.verdict is PROVED
    assert dd.verify(certificate, ring("0.0613", coupling="y")).holds
    assert "acting 0.0613 s late" in certificate.reason
    assert certificate.factor >= np.exp(0.0613 * certificate.rate)
    told = render_report(certificate)["report.html"].decode("utf-8")
    assert "delay of what acts" in told
    assert "age of own readings" not in told
    later = dd.certify(ring("0.0614", coupling="y"))
    assert later.verdict is UNDECIDED
    assert "slopes and gains of an agent add up to 6 1/s" in later.reason


@pytest.mark.slow
def test_a_disturbed_network_is_proved_and_keeps_its_bound():
    """From corners of the region, with the largest error and several phases of the disturbance."""
    certificate = dd.certify(watched())
    assert certificate.verdict is PROVED
    assert dd.verify(certificate, watched()).holds
    claim = certificate.check("readings").claim.rows
    v = np.array([float(each) for each in claim.v])
    for phase in np.linspace(0, 6, 5):
        xi = np.tile([np.cos(phase) / 2, np.sin(phase) / 2], (3, 1))
        x, *_ = buffered(np.full(3, 0.5), xi, xi - [[0.1, 0]], time=3)
        times = 1e-3 * np.arange(len(x))
        kept = float(claim.rho) * np.exp(-float(claim.alpha) * np.maximum(times - LATE, 0))
        assert np.all(np.abs(x) / v <= kept[:, None])


def test_how_far_agents_drift_before_the_first_input_acts_has_to_be_known():
    """A larger amplitude leaves less of the region; without any there is no proof."""
    reached = []
    for amplitude in ("1/10", 4):
        actuators = {"delay": "0.01", "amplitude": amplitude}
        problem = watched(coupling="exp(y) - 1 + y", actuators=actuators)
        with only():
            check = dd.certify(problem).check("readings")
        reached.append(check.domain.radius if check.verdict is PROVED else 0)
    assert reached[0] == 0.5 > reached[1] + 0.1
    unknown = watched().replace(simulation={"xi0": None})
    with only():
        assert "give actuators.amplitude" in dd.certify(unknown).check("readings").reason


def test_without_a_disturbance_a_run_stays_below_its_certified_bound():
    problem = ring("0.05")
    certificate = dd.certify(problem)
    times = np.linspace(0, 3, 61)
    run = dd.simulate(problem, start=[[0.5]] * 3, t_final=3, samples=times)
    assert np.all(run.x[times < 0.05] == 0.5)
    allowed = certificate.factor * 0.5 * np.exp(-certificate.rate * times)
    assert np.all(np.abs(run.x).max(axis=(1, 2)) <= allowed + 1e-9)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"processor": {"period": "0.03"}}, r"must be a part of actuators\.delay = 0\.1 s"),
        ({"readings": {"period": 1}}, r"readings\.period is not known together"),
        ({"actuators": {"delay": 1, "limit": 9, "saturates": True}}, r"actuators\.saturates is"),
        ({"goal": "agreement", "gains": None}, "goal is not known together"),
        ({"actuators": {"delay": -1}}, r"actuators\.delay must be >= 0"),
    ],
)
def test_what_does_not_go_with_a_delay_is_refused_by_name(changes: Any, match: str):
    with pytest.raises(SpecError, match=match):
        ring("0.1", **changes)


@pytest.mark.parametrize(
    "ask",
    [
        dd.falsify,
        dd.build_model,
        dd.export.python_script,
        lambda problem: dd.simulate(problem, stress=dd.Stress(noise=0.1)),
        lambda problem: dd.simulate(problem, stress=dd.Stress(period=0.03)),
        lambda problem: dd.export.to_c(problem, period="0.03"),
    ],
    ids=["falsify", "build_model", "python", "noise", "ticks", "c"],
)
def test_what_does_not_know_late_inputs_refuses_them_by_name(ask: Any):
    with pytest.raises(SpecError, match=r"actuators\.delay"):
        ask(ring("0.1"))


def test_the_key_needs_version_four_and_zero_is_none():
    document = canonical_document(ring("0.1"))
    assert (document["version"], document["actuators"]["delay"]) == (4, "1/10")
    assert problem_from_canonical(canonical_bytes(ring("0.1"))) == ring("0.1")
    assert canonical_document(ring(0))["version"] == 1
    assert ring(Fraction(1, 10)).actuators.delay == Fraction(1, 10)
