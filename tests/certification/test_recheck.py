"""Claims that are not true are not confirmed, whatever else in the certificate is right.

Each test bends one claim of a true certificate; the campaigns do the same at random.
"""

from dataclasses import replace
from fractions import Fraction

import pytest
from campaigns.certificates import a_problem, mutant_campaign
from certified import consensus_claims, without_region
from networks import linked

from dobc_design import Certificate, Exosystem, Verdict, certify, load_problem, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certificate.topics import Trusted
from dobc_design.certification.recheck import confirm, expected_checks, recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.reason import Reason
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
INTEGRATOR = Exosystem(A=[[0]], C=[[1]])


def pair(**given):
    return linked([[1, 2], [2, 1]], **given)


def bent(certificate, which, *, overall=None, **changes):
    """The claims with one check (and perhaps the verdict) changed."""
    old = certificate.check(which)
    checks = tuple(
        replace(old, **changes) if check is old else check for check in certificate.checks
    )
    whole = {} if overall is None else {"verdict": overall, "rate": None, "covered_by": None}
    return replace(certificate.claims, checks=checks, **whole)


def failures(claims, problem):
    return " | ".join(recheck(claims, problem).failures)


@pytest.fixture(scope="module")
def paper():
    problem = without_region("paper-fixed")
    return problem, certify(problem)


@pytest.mark.parametrize("verdict", [PROVED, UNDECIDED])
def test_unstable_roots_cannot_be_slipped_into_another_check(verdict):
    """A proved or undecided Lemma 1 with "unstable_roots" must not make the whole refuted."""
    region = {"initial_states": [-1, 1]}
    problem = pair(coupling="tanh(y)", gains={1: 1}, region=region)
    certificate = Certificate(problem=problem, claims=consensus_claims(problem))
    numbers = {} if verdict is PROVED else {"margin": None, "rate": None}
    unstable = {"verdict": verdict, "claim": Values({"unstable_roots": "1"})} | numbers
    claims = bent(certificate, "lemma1", overall=REFUTED, **unstable)
    assert "lemma1 (G)" in failures(claims, problem)
    assert "refuted does not follow" in failures(claims, problem)


def test_a_bad_gain_of_the_certificate_cannot_refute_the_problem():
    """W is designed: the certificate may not bring a worse one and call consensus impossible."""
    problem = pair(coupling="abs(y)", gains={1: 1}, exosystem=INTEGRATOR)
    certificate = certify(problem)
    claims = bent(certificate, "hurwitz", overall=REFUTED, verdict=UNDECIDED, claim=None, rate=None)
    claims = replace(claims, W=((Fraction(-1),),))
    assert "refuted does not follow" in failures(claims, problem)


def test_less_than_is_true_may_be_claimed(paper):
    """Smaller numbers, and "undecided" where the whole does not rest on it."""
    problem, certificate = paper
    changed = bent(certificate, "lemma1", margin=0.1, rate=0.01)
    assert failures(changed, problem) == ""
    nothing = {"verdict": UNDECIDED, "margin": None, "rate": None, "claim": None, "witness": None}
    assert failures(bent(certificate, "theorem1-printed", **nothing), problem) == ""
    held_by = {"theorem1", "theorem1-weighted"}
    checks = tuple(replace(c, **nothing) if c.id in held_by else c for c in certificate.checks)
    claims = replace(certificate.claims, checks=checks, P=None, Q=None)
    assert "proved does not follow" in failures(claims, problem)


def test_sentences_and_advice_are_not_checked_but_the_notes_of_the_problem_have_to_stand_there(
    paper,
):
    """The documented limit: texts are free.  What stands in must be labelled wherever a result is
    shown."""
    problem, certificate = paper
    claims = bent(certificate, "theorem1", reason="")
    free = (*problem.notes, "anything")
    rewritten = replace(claims, why=Reason(head=""), notes=free, version="?")
    assert recheck(rewritten, problem).holds
    assert not recheck(replace(claims, notes=("anything",)), problem).holds


def test_a_margin_of_a_refutation_must_follow_from_its_vector():
    """h = -y: lambda_max = 4 - 2 k = 3 along (1, -1); agent 1 alone shows 2 - 2 k = 1."""
    problem = pair(coupling="-y", gains={1: "1/2", 2: "1/2"})
    certificate = certify(problem)
    check = certificate.check("lemma1")
    assert check.margin == -1.0
    assert check.witness.labels == ("1",)
    assert failures(bent(certificate, "lemma1", margin=-0.5), problem) == ""
    assert "the margin" in failures(bent(certificate, "lemma1", margin=-1.001), problem)
    for name in ("unstable_roots", "value"):
        values = Values({**check.exact, name: "2"})
        changed = bent(certificate, "lemma1", claim=values)
        assert "exact" in failures(changed, problem)


def test_one_failing_pair_refutes_the_printed_check_only_and_a_designed_gain_rules_out_none(paper):
    """Theorem 1 asks for any P: the printed vector says nothing about the others."""
    problem, certificate = paper
    printed = certificate.check("theorem1-printed")
    refuted = {"verdict": REFUTED, "margin": None, "rate": None}
    claims = bent(
        certificate, "theorem1", claim=Values(printed.exact), witness=printed.witness, **refuted
    )
    assert "theorem1: one pair failing" in failures(claims, problem)
    for block in ("hurwitz", "detectability"):
        values = Values({"block": block})
        claims = bent(certificate, "theorem1", claim=values, **refuted)
        assert f"{block} is proved" in failures(claims, problem)
    problem = pair(gains=1, exosystem=INTEGRATOR)
    bad = ((Fraction(-1),),)
    statements = state_theorems(loop_of(problem))
    trusted = Trusted(
        loop=statements.loop, W=bad, domain=statements.domain, statements=statements, pair=None
    )
    claim = Values({"block": "hurwitz"})
    check = Check(id="theorem1", verdict=REFUTED, domain=EVERYWHERE, reason="", claim=claim)
    assert confirm(check, trusted) == "another W can be designed, so no pair is ruled out"


def test_every_check_that_a_problem_calls_for_has_to_be_there(paper):
    problem, certificate = paper
    for left_out in (check for check in certificate.checks if check.id != "tolerance"):
        others = tuple(c for c in certificate.checks if c is not left_out)
        claims = replace(certificate.claims, checks=others)
        lacking = (
            "covered_by: not what"
            if left_out.id == "theorem1-weighted"
            else f"lacks {left_out.title}"
        )
        assert lacking in failures(claims, problem)
    checks = (*certificate.checks, certificate.checks[0])
    doubled = replace(certificate.claims, checks=checks)
    found = recheck(doubled, problem)
    # nothing is evaluated
    assert found.confirmed == ()
    assert found.failures == ("checks: a check stands there twice",)
    second = checker.examine(certificate_bytes(doubled), canonical_bytes(problem))
    assert [title for _, title in second] == [
        "its problem",
        "its list of checks: a check stands there twice",
    ]
    # several modes: theorem2; without an exosystem Lemma 1 alone; a P given: the printed check as
    # well
    switching = [id for id, *_ in expected_checks(loop_of(load_problem("paper-switching")))]
    assert switching.count("lemma1") == 4
    assert {"theorem2", "theorem2-printed"} <= set(switching)
    assert "theorem1" not in switching
    expected = (("reachability", "G", None), ("lemma1", "G", None))
    assert expected_checks(loop_of(pair())) == expected


@pytest.mark.slow
def test_accepted_mutants_are_true():
    """56 changed certificates; the oracle reads every one that is accepted."""
    tally = mutant_campaign(range(4), each=14)
    assert tally.wrong == []
    assert tally.counts["refused"] + tally.counts["unreadable"] > 36
    assert tally.counts["accepted"] >= 2  # so that the oracle has something to read


def test_a_certificate_is_about_one_problem_only(paper):
    """The same claims beside another problem are refused, even if only a note or the name
    differs."""
    outcome = verify(paper[1], load_problem("paper-switching"))
    assert not outcome.holds
    assert "another problem" in outcome.failures[0]
    assert outcome.confirmed == ()
    # the problem inside a certificate object is not believed: only the one that is handed to
    # ``verify`` counts
    honest, other = a_problem(3), a_problem(4)
    forged = Certificate(problem=honest, claims=certify(other).claims)
    assert not verify(forged, honest).holds
    assert verify(forged, other).holds


def test_the_outcome_lists_what_is_confirmed_and_what_is_not_in_bytes_claims_and_certificates(
    paper,
):
    problem, certificate = paper
    claims = certificate.claims
    for form in (certificate, claims, certificate_bytes(claims)):
        good = verify(form, problem)
        assert good.holds
        assert str(good).startswith("every claim holds; verdict proved.")
        assert set(good.confirmed) == {check.title for check in certificate.checks}
    assert "NOT confirmed: verdict: refuted does not follow" in str(
        verify(replace(claims, verdict=REFUTED), problem)
    )
    for wrong in ({"verdict": REFUTED}, {"rate": 5.0}, {"rate": None}, {"covered_by": "lemma1"}):
        assert not verify(replace(claims, **wrong), problem).holds
