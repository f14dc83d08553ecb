"""``verify`` accepts what is true and nothing else: random problems, random changes, an independent oracle.

The oracle (tests/support/exact_oracle.py) shares no code with theorems, verify and exact.
"""

from __future__ import annotations

from dataclasses import replace

from campaigns import a_problem, mutant_campaign

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify, verify
from dobc_design.problem.load import load_problem
from dobc_design.verdict import Verdict


def test_accepted_mutants_are_true():
    """300 changed certificates; the oracle reads every one that is accepted."""
    tally = mutant_campaign(range(15), each=20)
    assert tally.wrong == []
    assert tally.counts["refused"] + tally.counts["unreadable"] > 200
    assert tally.counts["accepted"] >= 5  # so that the oracle has something to read


def test_a_certificate_is_about_one_problem_only():
    """The same claims beside another problem are refused, even if only a note or the name differs."""
    first, second = load_problem("paper-fixed"), load_problem("paper-switching")
    outcome = verify(certify(first), second)
    assert not outcome.holds
    assert "another problem" in outcome.failures[0]
    assert outcome.confirmed == ()


def test_the_problem_inside_a_certificate_object_is_not_believed():
    """Only the problem that is handed to ``verify`` counts."""
    honest, other = a_problem(3), a_problem(4)
    forged = Certificate(problem=honest, claims=certify(other).claims)
    assert not verify(forged, honest).holds
    assert verify(forged, other).holds


def test_the_outcome_lists_what_is_confirmed_and_what_is_not():
    problem = load_problem("paper-fixed")
    certificate = certify(problem)
    good = verify(certificate, problem)
    assert good.holds
    assert str(good).startswith("every claim holds; verdict proved.")
    assert set(good.confirmed) == {check.title for check in certificate.checks}
    bad = verify(replace(certificate.claims, verdict=Verdict.REFUTED), problem)
    assert not bad.holds
    assert "NOT confirmed: verdict: refuted does not follow" in str(bad)


def test_rate_and_carrying_check_of_the_whole_have_to_match():
    problem = load_problem("paper-fixed")
    claims = certify(problem).claims
    for wrong in (replace(claims, rate=5.0), replace(claims, rate=None), replace(claims, covered_by="lemma1")):
        assert not verify(wrong, problem).holds


def test_bytes_claims_and_certificates_are_all_checked():
    problem = load_problem("paper-fixed")
    certificate = certify(problem)
    for form in (certificate, certificate.claims, certificate_bytes(certificate.claims)):
        assert verify(form, problem).holds
