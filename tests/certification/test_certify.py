"""The stages together: verdicts against the truth seen from outside, and what the verbs accept."""

from __future__ import annotations

import numpy as np
from campaigns import outside_campaign
from certified import certified

from dobc_design.certification.certify import certify, verify
from dobc_design.conditions.observer.gain import observer_gain
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


def test_linear_verdicts_agree_with_eigenvalues_and_exponentials():
    """Proved: all eigenvalues of (22) in the left half plane, V decays at least at the claimed rate whatever the
    switching; refuted: some mode has an eigenvalue that does not decay."""
    tally = outside_campaign(range(80))
    assert tally.wrong == []
    assert min(tally.counts[verdict.value] for verdict in Verdict) >= 15


def test_progress_names_the_stages():
    stages = []
    certify("paper-fixed", progress=stages.append)
    assert len(stages) >= 3
    assert all(isinstance(stage, str) for stage in stages)


def test_a_missing_gain_is_designed_and_is_the_one_that_everything_is_about():
    problem = Problem(
        network=Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y",
        gains=1,
        exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
    )
    certificate = certify(problem)
    assert certificate.claims.gain_source == "designed"
    assert observer_gain(problem) == certificate.claims.W
    assert certificate.verdict is Verdict.PROVED


def test_an_eigenvalue_solver_that_breaks_down_changes_no_verdict(monkeypatch):
    """The exact side does without estimates: shorter claims, the same verdicts, and they are confirmed."""
    before = [(check.id, check.mode, check.verdict) for check in certified("paper-fixed").checks]

    def broken(*args, **kwargs):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr("dobc_design.certification.consensus.lambda_tops", broken)
    certificate = certify("paper-fixed")
    assert [(check.id, check.mode, check.verdict) for check in certificate.checks] == before
    assert verify(certificate, "paper-fixed").holds


def test_wrong_estimates_change_numbers_and_never_verdicts(monkeypatch):
    """Everything from floating point is a proposal: nonsense in, the same verdicts out."""
    from dobc_design.conditions.consensus.estimates import Top

    true = [(check.id, check.mode, check.verdict) for check in certified("paper-switching").checks]

    def nonsense(statements):
        size = next(iter(statements.lambdas.values())).size
        return {mode: Top(value=-7.0, vector=np.full(size, np.nan)) for mode in statements.lambdas}

    monkeypatch.setattr("dobc_design.certification.consensus.lambda_tops", nonsense)
    certificate = certify("paper-switching")
    assert [(c.id, c.mode, c.verdict) for c in certificate.checks] == true
    assert verify(certificate, "paper-switching").holds
