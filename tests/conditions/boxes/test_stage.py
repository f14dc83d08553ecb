"""The exhaustive proof of a region: small networks, on request."""

import json
import math
from fractions import Fraction
from typing import Any

import pytest
from lure_cases import PAPER

from dobc_design import Check, Network, Problem, Region, Verdict, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.conditions.boxes import stage as boxes
from dobc_design.conditions.boxes.stage import exhaustive_stage
from dobc_design.conditions.coverage import read_region


def ring(n: int, gains: Any, side: str, *, coupling: Any = PAPER) -> Problem:
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    m = len(coupling) if isinstance(coupling, list) else 1
    region = Region(initial_states=((-Fraction(side), Fraction(side)),) * m, initial_disturbance=None)
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=coupling, gains=gains, target=[0] * m, region=region)


def stage(problem: Problem, *, everything: bool = True) -> list[Check]:
    domain = "global" if problem.is_linear else "consensus"
    return exhaustive_stage(read_region(problem, None, domain=domain, everything=everything), lambda _: None)


@pytest.mark.slow
def test_a_set_that_is_reached_in_part_is_said_to_be():
    """Two agents, one pin k = 3: V = e'e ends at 3.78, a full P_e goes farther; sides 12 ask for 17."""
    (check,) = stage(ring(2, {1: 3}, "12"))
    assert check.verdict is Verdict.PROVED
    assert 3.75 < check.domain["radius"] < 12 * math.sqrt(2)
    assert "the region asks for 16.9706: beyond, this V rises somewhere" in check.reason
    assert check.rate is None


@pytest.mark.slow
def test_a_region_that_is_covered_gets_a_rate_though_other_boxes_were_counted_before():
    """One pin k = 5 in a ring of four: |e| <= 2 takes the second shape, at a tenth of the rate near the consensus."""
    arcs = [[1, 2], [2, 3, 2], [3, 4], [4, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=4)
    region = Region(initial_states=((Fraction(-3, 4), Fraction(1)),), initial_disturbance=None)
    coupling = "exp(1)*(exp(y) - 1)"
    (check,) = stage(Problem(network=network, coupling=coupling, gains={4: 5}, target=0, region=region))
    assert check.domain["radius"] >= 2
    assert 0.08 < check.rate < 0.1


@pytest.mark.parametrize(
    ("problem", "everything"),
    [(ring(5, 3, "1"), False), (ring(7, 3, "1"), True), (ring(2, 3, "1", coupling="2*y"), True)],
)
def test_it_is_left_out_where_the_network_is_not_small_or_linear(problem, everything):
    assert stage(problem, everything=everything) == []


@pytest.mark.slow
def test_small_networks_are_counted_out_unasked_where_that_may_cover_the_region():
    """Two agents: all k = 3 ends at 6, sides 4 ask for 5.66; one pin does not reach the 16.97 that sides 12 ask for."""
    (check,) = stage(ring(2, 3, "4"), everything=False)
    assert (check.id, check.verdict) == ("exhaustive", Verdict.PROVED)
    assert set(check.exact["tree"]) <= set("01.")
    assert check.domain["radius"] >= 4 * math.sqrt(2)
    (check,) = stage(ring(2, {1: 3}, "12"), everything=False)
    assert check.verdict is Verdict.UNDECIDED
    assert check.reason.startswith("no boxes are found that cover |e| <= 16.9706")


def test_couplings_of_vectors_are_not_counted_out():
    (check,) = stage(ring(2, 3, "1", coupling=["y1 + tanh(y2)/5", "y2"]))
    assert (check.verdict, check.reason[:15]) == (Verdict.UNDECIDED, "does not apply:")


def test_too_many_boxes_are_said_to_be_too_many(monkeypatch):
    monkeypatch.setattr(boxes, "MOST_BOXES", 3)
    (check,) = stage(ring(2, 3, "4"))
    assert check.verdict is Verdict.UNDECIDED
    assert "too many would be needed (at most 3)" in check.reason


@pytest.mark.slow
def test_a_certificate_with_boxes_is_confirmed_from_its_bytes_and_not_with_a_leaf_less():
    problem = ring(2, {1: 3}, "1", coupling="sin(y)")
    certificate = certify(problem, everything=True)
    assert next(check for check in certificate.checks if check.id == "exhaustive").verdict is Verdict.PROVED
    document = json.loads(certificate_bytes(certificate.claims))
    outcome = verify(certificate, problem)
    assert outcome.holds
    assert outcome.lone_checker == "it accepts every claim"
    (boxes_,) = (check for check in document["checks"] if check["id"] == "exhaustive")
    boxes_["exact"]["tree"] = boxes_["exact"]["tree"][:-1]
    (failure, *_) = recheck(json.dumps(document).encode(), problem).failures
    assert failure == "exhaustive: the tree does not describe boxes."
