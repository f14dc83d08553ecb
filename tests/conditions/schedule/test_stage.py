"""`settling` beside the other checks of a certificate: which starts, when it is left out, and what is made of it."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from equilibrium_cases import listening_pair

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.schedule.stage import asked_beside, settling_stage
from dobc_design.errors import CertificateError, SpecError
from dobc_design.verdict import Verdict

F = Fraction


@cache
def certified() -> dd.Certificate:
    """Two agents, sin, k = 1/10, starts in [-1, 1]."""
    return dd.certify(listening_pair(reach=1), settling="1/100")


def changed(certificate: dd.Certificate, **exact: object) -> bytes:
    """The text of the certificate with other exact values in `settling`."""
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "settling"]
    check["exact"] |= exact
    return json.dumps(data).encode()


def test_the_check_stands_in_the_certificate_and_both_programs_accept_it():
    check = certified().check("settling")
    assert check.verdict is Verdict.PROVED
    assert check.domain == {"kind": "box", "radius": 1.0, "disturbance": 0.0}
    assert check.rate is None
    found = dd.verify(certified(), certified().problem)
    assert found.holds
    assert "settling" in found.confirmed


@pytest.mark.parametrize("part", ["time", "tolerance"])
def test_a_certificate_that_claims_one_percent_more_is_refused_by_both_programs(part: str):
    """Twin: the last stage just reaches the tolerance at the time claimed."""
    own = certified().check("settling").exact[part]
    found = dd.verify(changed(certified(), **{part: str(F(own) * F(99, 100))}), certified().problem)
    assert not found.holds
    assert any("settling" in failure for failure in found.failures)
    assert "settling" in found.lone_checker


def test_a_settling_time_changes_no_verdict():
    without, beside = dd.certify(listening_pair(reach=1)), certified()
    assert "settling" not in {check.id for check in without.checks}
    assert without.settling is None
    for name in ("verdict", "rate", "covered_by"):
        assert getattr(without, name) == getattr(beside, name)


def test_the_envelope_comes_back_from_the_certificate_and_simulated_starts_stay_below_it():
    settling = certified().settling
    assert (settling.radius, settling.tolerance) == (F(1), F(1, 100))
    times = np.linspace(0, settling.time, 50)
    bounds = settling.envelope(times)
    assert bounds[0] >= 1 and bounds[-1] <= 0.01
    assert np.all(np.diff(bounds) <= 0)
    assert certified().regions.tolerance == 0.01
    for start in ([1, -1], [1, 1], [-1, 0.3]):
        run = dd.simulate(certified().problem, start={"x": [[x] for x in start]}, t_final=settling.time)
        assert np.all(run.error() <= settling.envelope(run.times) + 1e-7)


def test_a_claim_that_cannot_be_read_says_so():
    claims = certified().claims
    checks = tuple(replace(c, claim=Values({"time": "soon"})) if c.id == "settling" else c for c in claims.checks)
    broken = replace(certified(), claims=replace(claims, checks=checks))
    with pytest.raises(CertificateError, match="cannot be read"):
        _ = broken.settling


@pytest.mark.parametrize("value", ["0", "-1", "soon", float("nan")])
def test_a_tolerance_is_a_positive_number(value: object):
    with pytest.raises(SpecError, match="settling must be"):
        dd.certify(listening_pair(), settling=value)


def box(radius: float, verdict: Verdict = Verdict.PROVED, reason: str = "") -> Check:
    domain = {"kind": "box", "radius": radius, "disturbance": 0.0}
    return Check(id="max-separable", verdict=verdict, domain=domain, reason=reason)


def test_starts_are_the_region_or_as_much_of_it_as_is_proved():
    problem, none = listening_pair(reach=2), listening_pair(reach=None)
    assert asked_beside(problem, [box(2.0)], tolerance=F(1, 9)).radius == 2
    assert asked_beside(problem, [box(1.5)], tolerance=None).tolerance == F(3, 200)
    assert asked_beside(problem, [], tolerance=None).radius == 2
    assert asked_beside(none, [box(1.5)], tolerance=None).radius == F(3, 2)


def test_without_starts_or_without_a_certificate_it_is_left_out():
    none = listening_pair(reach=None)
    assert "nothing says where the agents start" in asked_beside(none, [], tolerance=None)
    open_one = box(1.0, Verdict.UNDECIDED)
    assert asked_beside(none, [open_one], tolerance=None).startswith("stages begin with")
    apart = replace(open_one, applies=False)
    assert asked_beside(none, [apart], tolerance=None).startswith("does not apply")
    assert "the target alone" in asked_beside(listening_pair(reach=[0, 0]), [], tolerance=None)


def line(coupling: str | list[str], **more: object) -> dd.Problem:
    """Agent 1 is pinned with 5, agent 2 hears it."""
    network = dd.Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    return dd.Problem(network=network, coupling=coupling, gains={1: 5}, region={"initial_states": [-1, 1]}, **more)


def test_couplings_that_do_not_act_by_component_leave_it_undecided():
    problem = line(["y1 + y2**3", "y2"], target=[0, 0])
    check = settling_stage(problem, None, [], tolerance=F(1), domain="consensus", report=lambda stage: None)
    assert check.verdict is Verdict.UNDECIDED
    assert check.reason.startswith("does not apply")


def test_agents_with_different_exosystems_settle_and_both_programs_accept_it():
    """e_i' = -2 e_i + eps_i, eps_i' = -b_i eps_i: the slower group's error decides; twin: one percent sooner."""
    groups = [
        dd.Group(agents=[agent], exosystem=dd.Exosystem(A=[[0]], C=[[1]]), observer=dd.Observer(W=[[b]]))
        for agent, b in ((1, 4), (2, 1))
    ]
    network, region = dd.Network.from_arcs([], arrow="listens_to", agents=2), {"initial_states": [-1, 1]}
    region["initial_disturbance"] = 1
    problem = dd.Problem(network=network, coupling="y", gains=2, groups=groups, region=region)
    certificate = dd.certify(problem, settling="1/100")
    found = dd.verify(certificate, problem)
    assert found.holds and "settling" in found.confirmed
    # With e(0) = eps(0) = 1 agent 2 has e = exp(-t) exactly: no time before ln 100 is true.
    assert np.log(100) <= certificate.settling.time <= 3 * np.log(100)
    own = certificate.check("settling").exact["time"]
    twin = dd.verify(changed(certificate, time=str(F(own) * F(99, 100))), problem)
    assert not twin.holds and "settling" in twin.lone_checker
    stages = [dict(stage) for stage in certificate.check("settling").exact["stages"]]
    stages[-1]["kind"] = "quadratic"
    assert not dd.verify(changed(certificate, stages=stages), problem).holds


def test_everything_with_a_region_includes_it_at_a_hundredth_of_the_radius():
    assert dd.certify(line("y"), everything=True).check("settling").exact["tolerance"] == "1/100"


@pytest.mark.slow
def test_example_1_holds_a_settling_time_that_the_lone_checker_decides():
    """R = 4, |eps_i| <= 1/2; Example 2 is among the evidence."""
    certificate = dd.certify("paper-fixed", settling="1/1000")
    assert dd.verify(certificate, "paper-fixed").holds
    stages = [dict(stage) for stage in certificate.check("settling").exact["stages"]]
    stages[1]["level"] = str(F(stages[1]["level"]) * F(99, 100))
    twin = dd.verify(changed(certificate, stages=stages), "paper-fixed")
    assert not twin.holds and "settling" in twin.lone_checker
