"""Agents whose outputs are measured: known answers, twins that just fail, and random problems
against eigenvalues of the whole loop (theory, section 18)."""

import json
from fractions import Fraction
from typing import Any

import pytest
import sympy as sp
from checker_files.files import accepted_by
from measured import mistaken, random_problems
from networks import network_of

from dobc_design import Exosystem, Observer, Problem, Verdict, certify, falsify, verify
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.equilibrium.decide import Equilibrium, lies_in_region
from dobc_design.exact.interval import Interval
from dobc_design.loop.make import loop_of

SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
CONSTANT = Exosystem(A=[[0]], C=[[1]])
CART: dict[str, Any] = {"A": [[0, 1], [0, 0]], "B": [[0], [1]]}
POSITION = CART | {"H": [[1, 0]]}
#: y = H x has the numerator s^2 + 4.
BLOCKED: dict[str, Any] = {
    "A": [[0, 1, 0], [0, 0, 1], [-1, -3, -3]],
    "B": [[0], [0], [1]],
    "H": [[4, 0, 1]],
}
#: Integrators with H = 1, whose gain 6, 5 places (s + 1)(s + 5).
POINT: dict[str, Any] = {
    "dynamics": {"A": [[0]], "B": [[1]], "H": [[1]]},
    "exosystem": CONSTANT,
    "observer": Observer(W=[[6], [5]]),
}


def carts(dynamics: dict[str, Any] = POSITION, **given: Any) -> Problem:
    """Agent 2 hears agent 1, which is pinned."""
    sound = {"coupling": "2*y1 + 3*y2", "gains": {1: [[4, 4]]}, "exosystem": SINE}
    return Problem(network=network_of([[2, 1]], 2), dynamics=dynamics, **sound | given)


def claim_of(certificate: Certificate, id: str) -> Any:
    return next(check for check in certificate.claims.checks if check.id == id)


def observed(last: Any) -> Certificate:
    return certify(carts(observer=Observer(W=[[8], [20], [0], [last]])))


def test_the_gain_of_the_theory_places_all_eigenvalues_at_minus_two():
    """(s + 2)^4: the rate of the estimates is 2, that of the agents 1."""
    certificate = observed(-32)
    F = sp.Matrix(certificate._loop.groups[0].exosystem.A)
    s = sp.Symbol("s")
    assert sp.factor(F.charpoly(s).as_expr()) == (s + 2) ** 4
    assert 1.99 < claim_of(certificate, "hurwitz").rate < 2
    assert certificate.verdict is Verdict.PROVED
    assert 0.99 < certificate.rate < 1
    assert verify(certificate, certificate.problem).holds


@pytest.mark.parametrize(
    ("last", "proved"),
    [
        ("-39.999", True),
        pytest.param(-40, False, marks=pytest.mark.slow),
        ("-0.001", True),
        pytest.param(0, False, marks=pytest.mark.slow),
    ],
)
def test_the_gain_is_proved_up_to_where_an_eigenvalue_reaches_the_imaginary_axis(last, proved):
    """s^4 + 8 s^3 + 24 s^2 + 32 s + 80 + 2 w is Hurwitz for -40 < w < 0."""
    certificate = observed(last)
    expected = Verdict.PROVED if proved else Verdict.UNDECIDED
    assert certificate.verdict is expected
    assert claim_of(certificate, "hurwitz").verdict is (
        Verdict.PROVED if proved else Verdict.REFUTED
    )
    assert verify(certificate, certificate.problem).holds


def test_a_position_does_not_show_in_the_speed():
    certificate = certify(carts(CART | {"H": [[0, 1]]}, exosystem=CONSTANT))
    check = claim_of(certificate, "detectability")
    assert check.verdict is Verdict.REFUTED
    assert check.exact["unobservable_polynomial"] == "s"
    assert "the state x1 does not show in y = H x" in check.reason
    assert certificate.verdict is Verdict.REFUTED
    assert "two starts of agent 1 give the same y = H x" in certificate.reason
    assert verify(certificate, certificate.problem).holds


@pytest.mark.parametrize(
    ("exosystem", "region"),
    [
        # A force that does not act is hidden, and moves nothing.
        (Exosystem(A=[[0]], C=[[0]]), None),
        # Positions that start alike, or estimates that are right, do not differ.
        (CONSTANT, {"initial_states": [[1, 1], [-1, 1]], "initial_disturbance": 1}),
        (CONSTANT, {"initial_states": [[-1, 1], [-1, 1]], "initial_disturbance": 0}),
    ],
)
def test_what_is_hidden_refutes_only_where_states_can_differ(exosystem, region):
    given = carts(POSITION if region is None else CART | {"H": [[0, 1]]}, exosystem=exosystem)
    certificate = certify(given.replace(region=region))
    assert claim_of(certificate, "detectability").verdict is Verdict.REFUTED
    assert certificate.verdict is Verdict.UNDECIDED
    document = json.loads(certificate_bytes(certificate.claims)) | {"verdict": "refuted"}
    assert accepted_by(document, certificate.problem) == (False, False)


def test_a_sine_that_the_plant_blocks_does_not_show():
    """Theory, section 18: the numerator s^2 + 4 hides a disturbance of 2 rad/s, and no other."""
    more = {"coupling": "y1", "gains": {1: [[1, 0, 0]]}}
    blocked = certify(carts(BLOCKED, **more))
    assert blocked.verdict is Verdict.REFUTED
    hidden = claim_of(blocked, "detectability")
    assert hidden.verdict is Verdict.REFUTED
    assert hidden.exact["unobservable_polynomial"] == "s^2 + 4"
    other = Exosystem(A=[[0, 3], [-3, 0]], C=[[1, 0]])
    seen = claim_of(certify(carts(BLOCKED, exosystem=other, **more)), "detectability")
    assert seen.verdict is Verdict.PROVED


def test_some_random_problems_agree_with_the_eigenvalues_of_their_whole_loops():
    """The evidence looks at 200 of them."""
    seen = set()
    for seed, problem in random_problems((2, 6, 7, 15, 16)):
        certificate = certify(problem)
        seen.add(certificate.verdict.value)
        assert mistaken(certificate, problem) is None, seed
    assert seen == {"proved", "refuted", "undecided"}


def in_region(width: Any, off: Any, **more: Any) -> Problem:
    """Integrators with h = y - y^3, which holds where errors stay below 1/2."""
    region = {"initial_states": [f"-{width}", width], "initial_disturbance": off}
    given = POINT | {"target": [0], "coupling": "y", "gains": {1: 3, 2: 3}, "region": region}
    return Problem(network=network_of([[2, 1]], 2), **given | more)


def test_estimates_start_off_the_states_of_the_region():
    loop = loop_of(in_region("0.5", "0.25"))
    assert loop.starts.states == ((Fraction(-3, 4), Fraction(3, 4)),)
    assert loop.starts.exact == ((Fraction(-1, 2), Fraction(1, 2)),)
    outputs = POINT["dynamics"] | {"acts_on": "outputs"}
    loop = loop_of(in_region("0.5", "0.25", dynamics=outputs))
    assert loop.starts.states == loop.starts.exact == ((Fraction(-1, 2), Fraction(1, 2)),)


def test_only_states_that_the_region_has_refute():
    """An equilibrium at 6/10 lies where estimates may start, not in the region."""
    rest = Interval.point(Fraction(3, 5))
    claim = Equilibrium(mode="G", box=(Interval.point(Fraction(0)), rest))
    assert not lies_in_region(loop_of(in_region("0.5", "0.25")), claim)
    assert lies_in_region(loop_of(in_region("0.7", "0.25")), claim)


def test_no_search_contradicts_a_proof_and_starts_are_states_of_the_region():
    """Estimates start elsewhere; with h = sin agents that are not pinned may rest at pi."""
    proved = certify(in_region("0.5", "0.25"))
    assert proved.verdict is Verdict.PROVED
    assert all(not search.suspects for search in falsify(proved, runs=20).searches)
    loose = in_region(4, "0.25", coupling="sin(y)", gains={1: 1})
    found = falsify(loose, runs=40)
    assert found.check is not None
    for suspect in found.suspects:
        assert abs(suspect.start).max() <= 4
