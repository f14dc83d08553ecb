"""Inputs that saturate at their limits (theory, section 14, "Saturation").

Oracles: closed forms, and an integrator of the plant as printed, with its observer, in NumPy.
"""

import json
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from networks import around, network_of
from oracles.late import sampled_error
from published import saturating
from scipy.linalg import expm

import dobc_design as dd
from dobc_design import Verdict
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.conditions.schedule.claim import Descent, Tube
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import verify_separable
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import rows_of
from dobc_design.loop.saturation import Rooms, rooms_of
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)
from dobc_design.report.plant import plant_numbers
from dobc_design.report.write import render_report

F = Fraction
PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED
PAPER = {"A": [[0, 2], [-2, 0]], "C": [[1, 0]], "W": [["16/5"], ["12/5"]]}


def ring(n: int = 4, *, limit: Any = "1/2", gain: Any = 5, **more: Any) -> dd.Problem:
    """A directed cycle of exp(y) - 1 + y (one agent: alone), all pinned, from |e| <= 4."""
    given = {
        "network": network_of(around(n) if n > 1 else [], n),
        "coupling": "exp(y) - 1 + y",
        "gains": dict.fromkeys(range(1, n + 1), gain),
        "actuators": {"limit": limit, "saturates": True},
        "region": {"initial_states": [-4, 4]},
    }
    return dd.Problem(**given | more)


def disturbed(limit: Any = 5, s: Any = "1/2", **more: Any) -> dd.Problem:
    """A cycle of three with one pin, and the disturbance and gain of the paper."""
    return ring(
        3,
        limit=limit,
        gains={1: 5},
        exosystem=dd.Exosystem(PAPER["A"], PAPER["C"]),
        observer=dd.Observer(W=PAPER["W"]),
        region={"initial_states": [-4, 4], "initial_disturbance": s},
        simulation={"xi0": ["3/10", "2/5"]},
        **more,
    )


def numbers_of_paper() -> list[Any]:
    """A, C and W in floats."""
    return [np.array([[float(F(x)) for x in row] for row in PAPER[k]]) for k in "ACW"]


@lru_cache(maxsize=1)
def certified() -> dd.Certificate:
    """That of the disturbed network."""
    return dd.certify(disturbed())


def refusals(certificate: Any, problem: dd.Problem) -> list[str]:
    """What the second checker refuses."""
    data = certificate if isinstance(certificate, bytes) else certificate_bytes(certificate)
    return [text for holds, text in examine(data, canonical_bytes(problem)) if not holds]


def forged(certificate: dd.Certificate, change: Any) -> bytes:
    """Its bytes, changed."""
    document = json.loads(certificate_bytes(certificate.claims))
    change({check["id"]: check for check in document["checks"]})
    return json.dumps(document).encode()


# --- Known answers
def test_all_pinned_have_the_rate_of_the_theory_in_every_box():
    """k = 5, ubar - dbar = 1/2, |e| <= 4: 1/8, and nothing above; |e| <= 1/10: k."""
    loop = rows_of(loop_of(ring()), None)
    v = (F(1),) * 4
    assert largest_rate(loop, v, rho=F(4)) == F(1, 8)
    assert verify_separable(loop, Separable(v=v, alpha=F(1, 8), rho=F(4))).verdict is PROVED
    faster = Separable(v=v, alpha=F(1, 8) + F(1, 10**30), rho=F(4))
    assert verify_separable(loop, faster).verdict is Verdict.REFUTED
    assert largest_rate(loop, v, rho=F(1, 10)) == pytest.approx(5, rel=1e-4)


def test_the_certificate_says_so_and_both_programs_accept_it():
    problem = ring()
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert 0.1249 < certificate.rate <= 0.125
    assert "with inputs that saturate at the limit of 0.5" in certificate.reason
    told = next(check for check in certificate.checks if check.id == "actuators")
    assert told.exact["rooms"] == {str(i): "1/2" for i in range(1, 5)}
    assert dd.verify(certificate, problem).holds
    # without saturation the same limit is left open
    plain = ring(actuators={"limit": "1/2"})
    assert dd.certify(plain).verdict is UNDECIDED


def test_one_agent_alone_settles_when_the_theory_says():
    """|e| <= 0.01 after 7.8 + ln(10)/5 = 8.260517 s, a straight line and then the pin; 8.36 s are
    proved, where the line ends a little above the kink."""
    problem = ring(1)
    certificate = dd.certify(problem)
    end = F("0.11")
    boxes = ((F(4),), (end,))
    tube = Tube(times=(F(0), F("7.83")), upper=boxes, lower=boxes)
    last = Separable(v=(F(1),), alpha=F("4.545"), rho=end)
    common = {"radius": F(4), "disturbance": F(0), "tolerance": F(1, 100)}
    for time, holds in (("8.36", True), ("8.26", False)):
        claim = Descent(tube=tube, certificate=last, level=end, height=F(1), time=F(time), **common)
        found = next(check for check in certificate.checks if check.id == "actuators")
        settling = replace(found, id="settling", claim=claim, reason="a tube.")
        checks = (*certificate.claims.checks, settling)
        claims = replace(certificate.claims, checks=checks)
        assert recheck(claims, problem).holds is holds
        assert (not refusals(claims, problem)) is holds


def test_a_run_of_one_agent_falls_in_a_straight_line():
    """simulate saturates as the proof does: 4 - t/2 down to 1/10, then exp(-5 t)."""
    run = dd.simulate(ring(1), start=[[4]], t_final=9, samples=[0, 4, 7.8, 8.260517, 9])
    expected = [4, 2, 0.1, 0.01, 0.1 * np.exp(-6)]
    assert run.x[:, 0, 0] == pytest.approx(expected, rel=1e-5)
    assert np.abs(run.u).max() == 0.5
    assert "Inputs saturate at the limits of [actuators]." in run.notes


def test_where_no_input_saturates_in_the_box_the_rate_is_that_of_the_model():
    """A limit that is never reached changes no certified rate."""
    with_limit = dd.certify(ring(gains={1: 5}, limit=100))
    without = dd.certify(ring(gains={1: 5}, actuators=None))
    assert with_limit.verdict is without.verdict is PROVED
    assert with_limit.rate == pytest.approx(without.rate, rel=1e-6)


# --- Readings and processors
NEAR = {"initial_states": [-1, 1]}


@pytest.mark.parametrize(
    ("stated", "longest", "longer"),
    [
        (lambda time: {"readings": {"own_delay": time}}, "0.0613", "0.0614"),
        (lambda time: {"readings": {"period": time}}, "1/6", "0.1667"),
        (lambda time: {"processor": {"period": time}}, "1/6", "0.1667"),
    ],
    ids=["own_delay", "period", "processor"],
)
def test_late_and_held_pins_cost_nothing_until_slopes_and_gain_overshoot(
    stated: Any, longest: str, longer: str
):
    """k = 5 and a slope of 1: 1/(6 e) = 0.06131 s and 1/6 s, although the pin is cut to 1/2."""
    problem = ring(coupling="y", region=NEAR, **stated(longest))
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert 0.45 < certificate.rate <= 0.5
    assert "saturate at the limit of 0.5" in certificate.reason
    assert dd.verify(certificate, problem).holds
    late = dd.certify(ring(coupling="y", region=NEAR, **stated(longer)))
    assert late.verdict is UNDECIDED
    assert "slopes and gains of an agent add up to 6 1/s" in late.reason


@pytest.mark.slow
def test_on_a_processor_the_room_is_the_limit_less_the_largest_error_at_the_samples():
    """sup |C_d F_d^k| by powers in NumPy; with |d| = 1/2 half of that takes all of a limit."""
    period = 0.1
    problem = disturbed(processor={"period": "1/10"})
    loop = loop_of(problem)
    F_d, added = sampled_error(*numbers_of_paper(), period)
    powers = [np.linalg.matrix_power(F_d, k) for k in range(200)]
    peak = max(np.linalg.norm(added @ power) for power in powers) / period
    found = rooms_of(loop, loop.observer.W)
    assert isinstance(found, Rooms)
    assert list(found.room.values()) == pytest.approx([5 - 0.5 - 0.5 * peak] * 3, rel=1e-5)
    near = {"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/2"}
    problem = problem.replace(region=near)
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert dd.verify(certificate, problem).holds
    tight = dd.certify(problem.replace(actuators={"limit": 0.5 + 0.5 * peak, "saturates": True}))
    assert tight.verdict is UNDECIDED
    assert "nothing is left for its pin" in tight.check("actuators").reason


def test_an_observer_that_is_fed_the_applied_input_is_not_disturbed_by_saturation():
    """eps+ = F_d eps at every sample, although inputs stay at their limit at first."""
    problem = disturbed(processor={"period": "1/10"})
    times = [0.1 * k for k in range(101)]
    run = dd.simulate(problem, start=[[4]] * 3, t_final=times[-1], samples=times)
    assert np.abs(run.u[:5]).max() == 5
    F_d, _ = sampled_error(*numbers_of_paper(), 0.1)
    eps = run.xi - run.xihat
    assert np.allclose(eps[1:], eps[:-1] @ F_d.T, atol=1e-12)


@pytest.mark.parametrize("stress", [None, "worst"])
def test_runs_with_late_readings_and_cut_inputs_stay_below_the_certified_bound(stress: Any):
    problem = ring(region=NEAR, readings={"own_delay": "0.02", "delay": "0.1", "event": "0.05"})
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    times = np.linspace(0, 4, 21)
    starts = [[1], [-1], [1], [1]]
    run = dd.simulate(problem, start=starts, t_final=4, samples=times, stress=stress)
    assert np.abs(run.u).max() == 0.5
    assert np.all(np.abs(run.x).max(axis=(1, 2)) <= np.exp(-certificate.rate * times) + 1e-6)


# --- Rooms
def test_a_room_is_the_limit_less_the_amplitude_and_the_largest_estimation_error():
    """|xi0| = 1/2, so |d| <= 1/2; sup |C exp((A - WC) t)| = 1 at t = 0, found by expm."""
    loop = loop_of(disturbed())
    found = rooms_of(loop, loop.observer.W)
    assert isinstance(found, Rooms)
    A, C, W = numbers_of_paper()
    peak = max(np.linalg.norm(C @ expm((A - W @ C) * t)) for t in np.linspace(0, 10, 2001))
    assert peak == pytest.approx(1)
    for room in found.room.values():
        assert 5 - 0.5 - 1.01 * 0.5 * peak < room <= 5 - 0.5 - 0.5 * peak


def test_a_disturbed_network_is_proved_and_its_runs_stay_below_the_bound():
    problem = disturbed()
    certificate = certified()
    assert certificate.verdict is PROVED
    assert dd.verify(certificate, problem).holds
    runs = dd.simulate(problem, runs=10, t_final=10)
    assert not runs.diverged.any()
    assert runs.error[:, -1].max() < 0.2


def test_no_room_is_undecided_and_says_what_takes_it():
    """dbar = 1/2 + 1/2 and more: a limit of 1 leaves nothing; 1.01 leaves a little."""
    certificate = dd.certify(disturbed(limit=1))
    assert certificate.verdict is UNDECIDED
    assert "of the limit 1 of agent 1: nothing is left for its pin" in certificate.reason
    assert "What would help: a larger limit" in certificate.reason
    assert not refusals(certificate.claims, disturbed(limit=1))
    found = rooms_of(loop_of(disturbed(limit="1.01")), loop_of(disturbed()).observer.W)
    assert isinstance(found, Rooms)
    assert min(found.room.values()) > 0


def test_the_report_says_what_the_compensation_takes_of_the_limit():
    """|d| <= 1/2 and |C eps| <= 1/2, and a little more for the bound by P."""
    certificate = certified()
    assert plant_numbers(certificate) == ["largest |d̂| ≤ 1.001 (agent 1)"]
    text = render_report(certificate)["report.html"].decode("utf-8")
    assert "the compensation of the disturbance never takes more of a limit than this" in text


def test_both_programs_agree_where_all_roots_are_exact():
    """|d| = 1/2 and |C eps| = 1/2 exactly: one program rounds roots up, the other leaves them."""
    problem = saturating()
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert 0.23 < certificate.rate < 0.25
    assert not refusals(certificate.claims, problem)


def test_what_is_left_of_a_limit_does_not_depend_on_couplings():
    """The couplings mix components; both programs leave all of the limit to the pin."""
    problem = dd.Problem(
        network=network_of([], 1),
        target=[0, 0],
        coupling=["2*y1 - y2", "y2"],
        gains={1: 2},
        actuators={"limit": 2, "saturates": True},
        region={"initial_states": [[-1, 1], [-1, 1]]},
    )
    check = dd.certify(problem).check("actuators")
    assert check.exact == {"rooms": {"1": "2"}}


def test_one_pinned_agent_of_five_that_all_hear_each_other_holds_them():
    """Limit 5, of which the compensation takes 2: from |e| <= 70 five agents share the pull of one,
    so that no rate is above 3/(5 70) = 0.00857 while they move together."""
    arcs = [(1, 2), (1, 3), (1, 4), (2, 1), (2, 4), (2, 5), (3, 1), (3, 5), (4, 1), (4, 2)]
    arcs += [(4, 5), (5, 2), (5, 3), (5, 4)]
    problem = dd.Problem(
        network=network_of(arcs, 5),
        target=10,
        coupling="20*y",
        gains={1: 1},
        exosystem=dd.Exosystem([[0]], [[1]]),
        actuators={"limit": 5, "amplitude": 1, "saturates": True},
        region={"initial_states": [-60, 40], "initial_disturbance": 1},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    assert 0.008 < certificate.rate < 3 / 350
    assert not refusals(certificate.claims, problem)


def test_limits_of_agents_with_dynamics_name_the_run_that_shows_them():
    with pytest.raises(SpecError, match="dobc stress FILE --saturation"):
        ring(1, dynamics=dd.Dynamics(A=[[-1]], B=[[1]]))


# --- Forgeries
def test_larger_rooms_and_wider_starts_are_refused_by_both_programs():
    problem = disturbed()
    certificate = certified()

    def more_room(checks: Any) -> None:
        checks["actuators"]["exact"]["rooms"]["1"] = "4.01"

    def wider(checks: Any) -> None:
        checks["max-separable"]["domain"]["disturbance"] = 0.5001

    def sampled(checks: Any) -> None:
        values = {"period": "1", "factor": "0.99"}
        checks["sampling"] |= {"verdict": "proved", "exact": values}
        checks["sampling"]["domain"] = checks["max-separable"]["domain"]

    assert not refusals(forged(certificate, lambda checks: None), problem)
    for change in (more_room, wider, sampled):
        data = forged(certificate, change)
        assert not recheck(data, problem).holds
        assert refusals(data, problem)


def test_a_certificate_of_saturation_is_refused_for_the_problem_without():
    """The loop is another one: rows with pins that are cut prove nothing about a verdict that no
    input exceeds its limit."""
    claims = dd.certify(ring()).claims
    plain = ring(actuators={"limit": "1/2"})
    assert not recheck(claims, plain).holds


# --- What is not known
@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"actuators": {"saturates": True}}, "actuators.saturates needs a limit"),
        ({"region": None}, "actuators.saturates needs a \\[region\\]"),
        ({"uncertainty": {"disturbance": 1}}, "uncertainty.disturbance"),
        ({"uncertainty": {"weights": "0.1", "known_to_agents": False}}, "known_to_agents"),
        ({"actuators": {"limit": 1, "saturates": "yes"}}, "must be true or false"),
        ({"goal": "agreement", "gains": None}, "goal is not known together"),
    ],
)
def test_what_saturation_does_not_know_is_refused_by_name(changes: Any, key: str):
    with pytest.raises(SpecError, match=key):
        ring(**changes)


def test_pins_of_modes_and_matrix_gains_are_refused_by_name():
    with pytest.raises(SpecError, match=r"pinning\.modes is not known together"):
        ring(gains={2: 1}, mode_gains={"G": {1: 1}})
    vector = {"target": [0, 0], "coupling": "y", "gains": {1: [[1, 1], [0, 1]]}}
    with pytest.raises(SpecError, match=r"pinning\.gains is not known together"):
        ring(**vector, region={"initial_states": [[-1, 1], [-1, 1]]})


@pytest.mark.parametrize(
    "ask",
    [
        dd.falsify,
        dd.build_model,
        dd.export.python_script,
        lambda problem: dd.design_pinning(problem, rate="1/10", region=4),
    ],
    ids=["falsify", "build_model", "python", "design_pinning"],
)
def test_what_does_not_cut_inputs_refuses_them_by_name(ask: Any):
    with pytest.raises(SpecError, match=r"actuators\.saturates"):
        ask(ring())


def test_a_design_is_proved_with_its_inputs_cut():
    """Pins and gains are found for the plant that saturates, and certify says so of the file."""
    problem = ring(3, limit=1, gains=None, coupling="2*y", region={"initial_states": [-1, 1]})
    found = dd.design(problem)
    assert found.verdict is PROVED
    assert "with inputs that saturate at the limit of 1" in found.certificate.reason
    assert dd.verify(found.certificate, found.certificate.problem).holds


def test_the_key_is_written_where_it_is_true_and_needs_version_four():
    problem = ring()
    document = canonical_document(problem)
    assert document["version"] == 4
    assert document["actuators"]["saturates"] is True
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    plain = canonical_document(ring(actuators={"limit": "1/2", "saturates": False}))
    assert plain["version"] == 1
    assert "saturates" not in plain["actuators"]
