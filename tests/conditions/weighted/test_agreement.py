"""Linear agents with dynamics that agree, by V = e'((D - pi pi') (x) R)e (theory, section 16):
answers in closed form, by certificates that both programs accept, twins that just fail, and claims
that both refuse.

A directed ring of n agents has c = 1 - cos(2 pi/n); double integrators with the coupling alpha y1 +
beta y2 have an R iff beta^2 / alpha > 1 / c.
"""

import json
import math
import random
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from certified import consensus_claims
from checker_files.files import accepted_by
from networks import around, linked

from dobc_design import Certificate, Exosystem, Network, Problem, Verdict, certify, verify
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.weighted.stage import weighted_stage
from dobc_design.loop.make import loop_of
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.uncertainty import Uncertainty

PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
#: Harmonic oscillators that feel each other's place and speed: they agree at the rate c.
OSCILLATORS = Dynamics(A=[[0, 1], [-1, 0]], B=[[1, 0], [0, 1]])
MANY = 70


def agreeing(arcs: Any, n: int, dynamics: Dynamics = OSCILLATORS, **more: Any) -> Problem:
    return linked(arcs, n, goal="agreement", dynamics=dynamics, **more)


def double_integrators(beta: float, n: int) -> Problem:
    return agreeing(around(n), n, DOUBLE, coupling=[f"y1 + {beta}*y2"])


def backwards(n: int) -> list[Any]:
    return [[j, i] for i, j in around(n)]


def following(n: int) -> list[Any]:
    """A ring of n agents, which agent 1 is none of."""
    return [[i + 1, j + 1] for i, j in around(n)]


def weighed(n: int) -> list[Any]:
    """A ring with three further arcs for each agent, of different weights."""
    choose = random.Random(n)
    arcs = []
    for i in range(1, n + 1):
        heard = {i % n + 1, *(choose.randrange(1, n + 1) for _ in range(3))} - {i}
        arcs += [[i, j, choose.randrange(1, 30) / 10] for j in sorted(heard)]
    return arcs


def strength(n: int) -> float:
    return 1 - math.cos(2 * math.pi / n)


def found_by_stage(problem: Problem) -> Any:
    (check,) = weighted_stage(state_theorems(loop_of(problem)), None)
    return check


def confirmed(problem: Problem) -> Certificate:
    certificate = certify(problem)
    report = verify(certificate, problem)
    assert report.holds
    assert "second checker: it accepts every claim" in str(report)
    return certificate


def weighted_of(certificate: Certificate) -> Any:
    (check,) = [check for check in certificate.checks if check.id.endswith("-weighted")]
    return check


def document_of(certificate: Certificate | Claims) -> dict[str, Any]:
    claims = certificate if isinstance(certificate, Claims) else certificate.claims
    document: dict[str, Any] = json.loads(certificate_bytes(claims))
    return document


def claim_in(document: dict[str, Any]) -> dict[str, Any]:
    (check,) = [each for each in document["checks"] if each["id"].endswith("-weighted")]
    return check


@pytest.fixture(scope="module")
def ring() -> tuple[Problem, Certificate]:
    problem = agreeing(around(MANY), MANY)
    return problem, certify(problem)


@pytest.mark.parametrize("n", [4, 30])
def test_double_integrators_on_a_ring_agree_where_beta_squared_is_above_one_over_c(n: int):
    least = math.sqrt(1 / strength(n))
    check = found_by_stage(double_integrators(round(1.002 * least, 6), n))
    assert check.verdict is PROVED
    assert float(check.claim.strength) == pytest.approx(strength(n), rel=1e-3)
    assert check.claim.strength <= strength(n)
    assert found_by_stage(double_integrators(round(0.999 * least, 6), n)).verdict is UNDECIDED


def test_both_programs_accept_double_integrators_beyond_60_rows_and_the_twin_stays_open():
    least = math.sqrt(1 / strength(31))
    certificate = confirmed(double_integrators(round(1.01 * least, 6), 31))
    assert certificate.verdict is PROVED
    assert certificate.covered_by == "theorem1-weighted"
    certificate = confirmed(double_integrators(round(0.999 * least, 6), 31))
    assert certificate.verdict is UNDECIDED
    assert "no form R was found" in str(certificate.claims.why)


def test_seventy_oscillators_agree_at_the_rate_c(ring: tuple[Problem, Certificate]):
    problem, certificate = ring
    assert accepted_by(document_of(certificate), problem) == (True, True)
    check = weighted_of(certificate)
    assert certificate.verdict is PROVED
    assert certificate.rate == check.rate
    assert check.rate == pytest.approx(strength(MANY), rel=2e-3)
    assert check.rate <= strength(MANY)
    assert check.factor is None


def test_the_rate_of_a_weighted_digraph_is_below_that_of_its_eigenvalues():
    """pi has long fractions here; the oracle is numpy's eigenvalues of x_i - x_n."""
    arcs = weighed(40)
    certificate = confirmed(agreeing(arcs, 40, DOUBLE, coupling=["y1 + 6*y2"]))
    L = np.zeros((40, 40))
    for i, j, weight in arcs:
        L[i - 1, i - 1] += weight
        L[i - 1, j - 1] -= weight
    A, G = np.array([[0, 1], [0, 0]]), np.array([[0, 0], [1, 6]])
    slowest = sorted(np.linalg.eigvals(L), key=abs)[1:]
    rate = -max(np.linalg.eigvals(A - mu * G).real.max() for mu in slowest)
    assert 0.9 * rate < weighted_of(certificate).rate <= rate


def test_modes_with_one_pi_have_one_v():
    """A ring and the same ring backwards both keep the average."""
    problem = agreeing({"A": around(31), "B": backwards(31)}, 31)
    certificate = confirmed(problem)
    assert certificate.covered_by == "theorem2-weighted"
    assert certificate.rate == pytest.approx(strength(31), rel=2e-3)


def test_a_function_of_one_arc_counts_as_its_weight():
    own = confirmed(agreeing(around(31), 31, exceptions={(1, 2): "y/3"}))
    heavier = confirmed(agreeing([[1, 2, Fraction(1, 3)], *around(31)[1:]], 31))
    assert own.rate == heavier.rate
    assert own.rate != certify(agreeing(around(31), 31)).rate


def test_an_observer_is_no_faster_than_its_own_error():
    exosystem = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]])
    problem = agreeing(around(31), 31, DOUBLE, coupling=["y1 + 10*y2"], exosystem=exosystem)
    certificate = confirmed(problem)
    assert certificate.covered_by == "theorem1-weighted"
    document = document_of(certificate)
    claim_in(document)["rate"] = document["rate"] = 0.53  # of A - W C: 0.52
    assert accepted_by(document, problem) == (False, False)


@pytest.mark.parametrize(
    ("arcs", "n", "coupling", "why"),
    [
        ([*around(31), [32, 1]], 32, "y", "agent 32 cannot be heard by all"),
        ({"A": around(31), "B": weighed(31)}, 31, "y", "keep different weighted means"),
        (around(31), 31, "sin(y)", "linear couplings and agents"),
        (around(201), 201, "y", "up to 200 agents"),
        (around(31), 31, ["y1", "2*y2 + y1"], "no form R"),
    ],
)
def test_what_this_v_does_not_know_is_named(arcs: Any, n: int, coupling: Any, why: str):
    check = found_by_stage(agreeing(arcs, n, coupling=coupling))
    assert check.verdict is UNDECIDED
    assert why in check.reason


@pytest.mark.parametrize(
    "change",
    [
        {"c": str(1.0001 * strength(MANY))},
        {"c": "1"},
        {"R": [["1", "0"], ["0", "-1"]]},
        {"R": [["1", "1"], ["0", "1"]]},
        {"R": [["1", "0"], ["0", "2"]]},
        {"D": ["1"] * MANY},
    ],
)
def test_both_programs_refuse_a_claim_that_does_not_hold(
    ring: tuple[Problem, Certificate], change: dict[str, Any]
):
    problem, certificate = ring
    document = document_of(certificate)
    claim_in(document)["exact"] |= change
    assert accepted_by(document, problem) == (False, False)


@pytest.mark.parametrize("change", [{"rate": 0.00403}, {"factor": 1000.0}, {"rate": -0.001}])
def test_both_programs_refuse_a_rate_above_c_and_every_factor(
    ring: tuple[Problem, Certificate], change: dict[str, Any]
):
    problem, certificate = ring
    document = document_of(certificate)
    claim_in(document).update(change)
    document.update(change)
    assert accepted_by(document, problem) == (False, False)


def forged(document: dict[str, Any]) -> dict[str, Any]:
    """With a modest claim in place of what stands there."""
    exact = {"c": "1/1000", "R": [["1", "0"], ["0", "1"]]}
    claim_in(document).update(exact=exact, verdict="proved", rate=None)
    document.update(verdict="proved", covered_by=claim_in(document)["id"], rate=None)
    return document


def test_both_programs_accept_a_claim_that_is_more_modest(ring: tuple[Problem, Certificate]):
    problem, certificate = ring
    assert accepted_by(forged(document_of(certificate)), problem) == (True, True)


@pytest.mark.parametrize(
    ("arcs", "n", "coupling"),
    [
        ([*around(31), [32, 1]], 32, "y"),
        ([[1, 2], *following(31)], 32, "y"),
        ([*around(31)[:-1], [31, 32], [32, 31]], 32, "y"),
        pytest.param(
            {"A": around(31), "B": weighed(31)}, 31, "y", marks=pytest.mark.slow
        ),  # weights for both modes are looked for
        (around(31), 31, "sin(y)"),
        (around(31), 31, "-y"),
    ],
)
def test_both_programs_refuse_it_of_graphs_and_couplings_that_it_is_not_about(
    arcs: Any, n: int, coupling: str
):
    problem = agreeing(arcs, n, coupling=coupling)
    document = document_of(consensus_claims(problem))
    assert document["verdict"] != "proved"
    assert accepted_by(document, problem) == (True, True)
    assert accepted_by(forged(document), problem) == (False, False)


def test_both_programs_refuse_it_where_an_arc_comes_and_goes():
    network = Network.from_arcs(around(31), optional=[[1, 3]], arrow="listens_to", agents=31)
    problem = agreeing([], 31, network=network)
    assert "always there" in found_by_stage(problem).reason
    document = forged(document_of(consensus_claims(problem)))
    assert accepted_by(document, problem) == (False, False)


def test_the_tables_that_rest_on_pairs_say_that_there_are_too_many():
    plant = {"uncertainty": Uncertainty(disturbance=0.1), "region": {"initial_states": [-1, 1]}}
    certificate = certify(agreeing(around(31), 31, **plant))
    assert certificate.verdict is UNDECIDED
    assert "final bounds are decided for at most 500 pairs" in str(certificate.claims.why)
