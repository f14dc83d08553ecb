"""A region with a second equilibrium, from the problem to a certificate that both programs accept."""

from dataclasses import replace
from functools import cache

import pytest
from equilibrium_cases import listening_pair
from lure_cases import HARMONIC

import dobc_design as dd
from dobc_design import Problem, Verdict
from dobc_design.certification.overall import decide_overall
from dobc_design.conditions.check import Check


@cache
def refuted() -> dd.Certificate:
    """Of the pair with starts in [-5, 5]."""
    return dd.certify(listening_pair())


def equilibrium_of(certificate: dd.Certificate) -> Check:
    (check,) = [each for each in certificate.checks if each.id == "equilibrium"]
    return check


def disturbed(**given) -> Problem:
    """The pair with a disturbance."""
    region = {"initial_states": [-5, 5], "initial_disturbance": 1}
    return Problem(network=listening_pair().network, coupling="sin(y)", gains="1/10", region=region, **given)


def test_a_region_below_it_is_proved():
    """Twin: 1.65 is below 1.65387."""
    problem = listening_pair(reach=1.65)
    certificate = dd.certify(problem)
    assert (certificate.verdict, certificate.claims.covered_by) == (Verdict.PROVED, "max-separable")
    assert "equilibrium" not in {check.id for check in certificate.checks}
    assert dd.verify(certificate, problem).holds


@pytest.mark.slow
def test_without_a_region_the_far_equilibrium_does_not_count():
    """The question is then about every neighbourhood of the target, and so it stays where the check is smuggled in."""
    problem = listening_pair(reach=None)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    check = equilibrium_of(refuted())
    lemma = [each for each in certificate.checks if each.id == "lemma1"]
    undecided = [replace(each, verdict=Verdict.UNDECIDED, rate=None, margin=None) for each in lemma]
    assert decide_overall(problem, [*undecided, check], None).verdict is Verdict.UNDECIDED
    assert decide_overall(listening_pair(), [*undecided, check], None).verdict is Verdict.REFUTED


def test_where_no_gain_of_the_observer_is_known_nothing_is_searched():
    """An undetectable pair: there is no W, so there is no loop to speak of."""
    certificate = dd.certify(disturbed(exosystem=dd.Exosystem(A=[[0]], C=[[0]])))
    assert "equilibrium" not in {check.id for check in certificate.checks}
    assert certificate.verdict is Verdict.UNDECIDED


GROUPS = [dd.Group(agents=[1], exosystem=HARMONIC), dd.Group(agents=[2], exosystem=dd.exosystems.ramp())]


@pytest.mark.parametrize("given", [{"exosystem": HARMONIC}, pytest.param({"groups": GROUPS}, marks=pytest.mark.slow)])
def test_with_observers_it_is_refuted_all_the_same(given):
    problem = disturbed(**given)
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert dd.verify(certificate, problem).holds
