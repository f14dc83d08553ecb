"""A region with a second equilibrium, from the problem to a certificate that both programs accept."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

import pytest
from equilibrium_cases import half_difference, listening_pair
from lure_cases import HARMONIC

import dobc_design as dd
from dobc_design import Problem, Verdict
from dobc_design.certification.overall import decide_overall
from dobc_design.conditions.check import Check
from dobc_design.conditions.equilibrium.decide import Equilibrium, refuting_check
from dobc_design.exact.interval import Interval


@cache
def refuted() -> dd.Certificate:
    """Of the pair with starts in [-5, 5]."""
    return dd.certify(listening_pair())


def equilibrium_of(certificate: dd.Certificate) -> Check:
    (check,) = [each for each in certificate.checks if each.id == "equilibrium"]
    return check


def without(certificate: dd.Certificate, id: str) -> dd.Certificate:
    checks = tuple(check for check in certificate.checks if check.id != id)
    return replace(certificate, claims=replace(certificate.claims, checks=checks))


def disturbed(**given) -> Problem:
    """The pair with a disturbance."""
    region = {"initial_states": [-5, 5], "initial_disturbance": 1}
    return Problem(network=listening_pair().network, coupling="sin(y)", gains="1/10", region=region, **given)


@pytest.mark.slow
def test_far_starts_of_two_agents_are_refuted_and_both_programs_agree():
    """sin, k = 1/10, starts in [-5, 5]: y = 3.3077 (theory: the contract's cause (d))."""
    problem, certificate = listening_pair(), refuted()
    assert certificate.verdict is Verdict.REFUTED
    check = equilibrium_of(certificate)
    e = [Fraction(value) for value in check.witness.values]
    assert abs(abs(e[1] - e[0]) - 2 * half_difference(3.3)) < Fraction(1, 10**5)
    assert certificate.claims.reason == check.reason
    assert dd.verify(certificate, problem).holds
    assert not dd.verify(without(certificate, "equilibrium"), problem).holds


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


def test_the_box_that_refutes_a_region_does_not_refute_a_smaller_one():
    """It lies in [-1.66, 1.66] and not in [-1.65, 1.65]."""
    claim = claim_of(equilibrium_of(refuted()))
    assert refuting_check(listening_pair(reach=1.66), claim) is not None
    assert refuting_check(listening_pair(reach=1.65), claim) is None


def claim_of(check: Check) -> Equilibrium:
    box = tuple(Interval(Fraction(lo), Fraction(hi)) for lo, hi in check.exact["box"])
    return Equilibrium(mode=check.exact["mode"], box=box)
