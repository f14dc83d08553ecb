"""The verdict is about the plant that the file states: limits, errors of weights and gains, disturbances and noise.

Format page, the overall verdict, tables.  Every table has a proved problem and a twin that just fails, and both
programs refuse a verdict that was edited.
"""

import json
from typing import Any

import pytest
from certified import certified
from separable_problems import listening

from dobc_design import Certificate, Observer, Problem, Verdict, load_problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import harmonics

#: Six agents, saturating couplings, a disturbance of amplitude 2 and actuators that give 1/2.
LIMIT_BELOW_DISTURBANCE = """
name = "limit-below-disturbance"
target = 20
[network]
agents = 6
arrow = "listens_to"
[network.modes]
normal = [[3, 1], [4, 1], [4, 2], [5, 2], [6, 3], [6, 5]]
[coupling]
h = "2*tanh(y)"
[pinning]
gains = { 1 = 2, 2 = 2 }
[exosystem]
constant = true
hz = 0.5
[observer]
rate = 2
[region]
initial_states = [18, 22]
initial_disturbance = 0.5
[actuators]
limit = 0.5
amplitude = 2
"""
#: Five tanks in a row; the input of the first may reach 1.6 of 1.
TANKS = """
name = "tanks"
target = "3/2"
[network]
agents = ["T1", "T2", "T3", "T4", "T5"]
arrow = "sends_to"
[network.modes]
pipes = [["T1", "T2"], ["T2", "T1"], ["T2", "T3"], ["T3", "T2"], ["T3", "T4"], ["T4", "T3"], ["T4", "T5"], ["T5", "T4"]]
[coupling]
h = "y/sqrt(1+y**2)"
[pinning]
gains = { T1 = "1/2" }
[exosystem]
constant = true
hz = 0.01
[observer]
rate = 0.1
[region]
initial_states = [0.5, 2.5]
initial_disturbance = 0.05
[actuators]
limit = 1
amplitude = 0.1
"""
BOX = {"initial_states": [-1, 1]}
SEEN = {"exosystem": harmonics([2]), "observer": Observer(W=[["16/5"], ["12/5"]])}
SEEN_BOX = BOX | {"initial_disturbance": "1/10"}


def read(text: str, tmp_path: Any) -> Problem:
    (tmp_path / "problem.toml").write_text(text)
    return load_problem(tmp_path / "problem.toml")


def pair(h: str = "y + y**3/9", **more: Any) -> Problem:
    """2 hears 1, which is pinned with k = 3 and hears 2."""
    return listening([[2, 1], [1, 2]], h, n=2, gains={1: 3}, target=0, **more)


def both_accept(certificate: Certificate, **changes: Any) -> tuple[bool, bool]:
    """Whether the package and the second program accept the certificate with another verdict."""
    document = json.loads(certificate_bytes(certificate.claims)) | changes
    data = json.dumps(document).encode()
    problem = certificate.problem
    return recheck(data, problem).holds, all(holds for holds, _ in examine(data, canonical_bytes(problem)))


def require_undecided(certificate: Certificate, *words: str, proof: str = "max-separable") -> None:
    """Undecided in both programs, with these words; neither accepts it edited to proved by ``proof``."""
    assert certificate.verdict is Verdict.UNDECIDED
    assert (certificate.rate, certificate.covered_by) == (None, None)
    assert certificate.reason.startswith("Undecided: without ")
    assert "What would help: " in certificate.reason
    for word in words:
        assert word in certificate.reason
    assert both_accept(certificate) == (True, True)
    rate = certificate.check(proof).rate
    assert both_accept(certificate, verdict="proved", covered_by=proof, rate=rate) == (False, False)


def test_a_limit_below_the_disturbance_makes_the_verdict_undecided(tmp_path: Any):
    certificate = certify(read(LIMIT_BELOW_DISTURBANCE, tmp_path))
    require_undecided(
        certificate,
        "without the actuator limit all agents reach the target from every start in the region",
        "with the limit of 0.5 it is not proved",
        "The disturbance alone may need 2",
    )


@pytest.mark.slow
def test_tanks_whose_pump_may_saturate_are_undecided(tmp_path: Any):
    certificate = certify(read(TANKS, tmp_path))
    require_undecided(certificate, "with the limit of 1 it is not proved", "T1 may reach 1.59936, more than its limit")


@pytest.mark.parametrize(("limit", "proved"), [("3.0001", True), ("2.9999", False)])
def test_a_limit_counts_where_it_is_the_largest_input(limit: str, proved: bool):
    """k = 3, |e| <= 1, no disturbance: 3 is needed, and a certificate with v = 1 at agent 1 shows it."""
    problem = listening([[2, 1]], "y", n=2, gains={1: 3}, target=0, region=BOX, actuators={"limit": {"1": limit}})
    certificate = certified(problem)
    if proved:
        assert certificate.verdict is Verdict.PROVED
        assert "no input exceeds the limit of 3.0001" in certificate.reason
        assert certificate.rate is not None
        assert both_accept(certificate) == (True, True)
    else:
        require_undecided(certificate, f"the limit of {limit}")


@pytest.mark.parametrize(("error", "proved"), [("0.33", True), ("0.34", False)])
def test_errors_of_gains_count(error: str, proved: bool):
    """K = [[1, 1/2], [1/2, 1]] holds its agent while 1 - d > (1 + d)/2, d < 1/3."""
    K = [[1, "1/2"], ["1/2", 1]]
    problem = listening([], "y", n=1, gains={1: K}, target=[0, 0], uncertainty={"gains": error})
    certificate = certified(problem)
    if proved:
        assert (certificate.verdict, certificate.covered_by) == (Verdict.PROVED, "tolerance")
        assert certificate.rate == certificate.check("tolerance").rate
        assert "gains off by up to 33 %" in certificate.reason
        assert both_accept(certificate) == (True, True)
        rate = certificate.check("lemma1").rate
        assert both_accept(certificate, covered_by="lemma1", rate=rate) == (False, False)
    else:
        require_undecided(certificate, "gains off by up to 34 % it is not proved", proof="lemma1")


@pytest.mark.parametrize(("omega", "proved"), [("0.5", True), ("1.01", False)])
def test_a_disturbance_counts_and_the_agents_end_near_the_target(omega: str, proved: bool):
    """2 hears 1 by tanh, which gives less than 1 however far it is."""
    problem = listening([[2, 1]], "tanh(y)", n=2, gains={1: 30}, target=0, uncertainty={"disturbance": omega})
    problem = problem.replace(region={"initial_states": [-1, 1]})
    certificate = certified(problem)
    if proved:
        assert (certificate.verdict, certificate.covered_by, certificate.rate) == (Verdict.PROVED, "accuracy", None)
        assert "All agents end within 0.5" in certificate.reason
        assert "reach the target" not in certificate.reason
        assert both_accept(certificate) == (True, True)
        rate = certificate.check("max-separable").rate
        assert both_accept(certificate, covered_by="max-separable", rate=rate) == (False, False)
    else:
        require_undecided(certificate, "with a disturbance of up to 1.01 it is not proved")


def test_what_no_table_states_is_not_asked_for():
    """A drift without an exosystem is none, an amplitude is no limit, and zeros are no errors."""
    nothing = pair(region=BOX, uncertainty={"drift": 1}, actuators={"amplitude": 1})
    certificate = certified(nothing)
    assert (certificate.verdict, certificate.covered_by) == (Verdict.PROVED, "max-separable")


def test_a_refuted_problem_stays_refuted_whatever_its_tables_say():
    problem = listening([[2, 1]], "y", n=2, gains={2: 1}, target=0, actuators={"limit": 1})
    assert certified(problem).verdict is Verdict.REFUTED
