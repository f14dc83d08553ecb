"""One request, decided: refute what is impossible, else propose W, pins and gains until one proposal is proved.

The order is that of the cost: facts of exosystem and graph, rates that no gains reach, the observer, then pins and
gains for the region asked for, or near the consensus where none is.  Whatever is proposed is rounded and certified.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from dobc_design.conditions.numbers import claimed
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import changed_problem, gain_changes, typed_number
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.designed import Design, Proof, impossible, undecided
from dobc_design.synthesis.joint.ground import Ground, Proposal, Tools
from dobc_design.synthesis.joint.proposing import HALF, of_consensus, of_region
from dobc_design.synthesis.joint.refuting import network_obstacle, reduced_exosystem, too_fast
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.synthesis.pinning.structure import structure_of
from dobc_design.verdict import Verdict

NEARLY = 0.98  # of the rate that is aimed at: a proof with less is looked for again
MOST_TRIES = 4  # proposals that are certified


def attempt(problem: Problem, request: DesignRequest, tools: Tools, *, part: Fraction = HALF) -> Design:
    """Decide one request: PROVED with a certificate, REFUTED with a statement, or UNDECIDED with the reason."""
    labels = problem.network.labels
    tools.progress("looking for what is impossible")
    changes, decisions, obstacle = reduced_exosystem(problem, request)
    if obstacle is not None and obstacle.verdict is not Verdict.REFUTED:
        return undecided(request, labels, obstacle.text)
    if obstacle is not None:
        return impossible(request, labels, obstacle)
    bare = changed_problem(problem, {"pinning.gains": None, **changes})
    if bare.groups:
        bare = changed_problem(bare, gain_changes(bare, None))
    structure = structure_of(bare, request.allowed)
    ground = Ground(
        problem=bare,
        request=request,
        tools=tools,
        changes=changes,
        decisions=decisions,
        structure=structure,
        part=part,
        observers=[],
    )
    obstacle = network_obstacle(ground) or too_fast(ground)
    if obstacle is not None:
        return impossible(request, labels, obstacle)
    observer = ground.observer(0) if bare.groups else None
    if observer is not None and observer.verdict is Verdict.REFUTED:
        return impossible(request, labels, observer.statements[0], observer=observer)
    if observer is not None and observer.W is None:
        return undecided(
            request, labels, "no observer gain was found that does what was asked, and no proof that there is none."
        )
    return _searched(ground, of_region(ground) if bare.region is not None else of_consensus(ground))


def _searched(ground: Ground, proposals: Iterator[Proposal]) -> Design:
    """The first proposal that is certified for what the problem asks; else how far the best of them came."""
    request, labels = ground.request, ground.problem.network.labels
    best: str | None = None
    tries = 0
    for proposal in proposals:
        tries += 1
        design = _certified(ground, proposal)
        if design.verdict is Verdict.PROVED:
            return design
        best = design.reason
        if tries >= MOST_TRIES:
            break
    if best is None:
        asked = "" if request.rate is None else f" at {typed_number(request.rate)} 1/s"
        what = "the region asked for" if ground.problem.region is not None else "the consensus"
        return undecided(
            request,
            labels,
            f"no gains on the allowed agents were found that a proof of {what} reaches"
            f"{asked}, and no proof that there are none.",
        )
    return undecided(request, labels, f"{counted(tries, 'design')} were tried, none was proved to do; the last: {best}")


def _certified(ground: Ground, proposal: Proposal) -> Design:
    problem, request = ground.problem, ground.request
    labels = problem.network.labels
    gains = {labels[i]: k for i, k in sorted(proposal.gains.items())}
    W: Matrix | None = None if proposal.observer is None else proposal.observer.W
    wanted: dict[str, Any] = {"pinning.gains": {label: typed_number(k) for label, k in gains.items()}}
    if W is not None:
        wanted |= gain_changes(problem, W)
    changes, designed = {**ground.changes, **wanted}, changed_problem(problem, wanted)
    ground.tools.progress("certifying the design")
    proof, whole = ground.tools.certify(designed), ""
    hoped = proposal.aim * NEARLY if request.rate is not None or ground.part > HALF else 0.0
    if proof.verdict is Verdict.PROVED and (proof.rate or 0.0) < hoped and designed.is_linear and designed.region:
        proof = ground.tools.certify(designed, everything=True)  # a proof of every start came first, with a lower rate
        whole = " That rate is proved when every condition is run (dobc certify --all)."
    slow = _is_slow(proof, request)
    verdict = Verdict.PROVED if proof.verdict is Verdict.PROVED and not slow else Verdict.UNDECIDED
    reason = proof.reason
    if proof.verdict is Verdict.PROVED and slow and request.rate is not None:
        reason = f"the rate proved is {proof.rate or 0:.4g} 1/s, {typed_number(request.rate)} was asked for."
    decisions = (*proposal.decisions, _proof_words(proof) + whole)
    return Design(
        verdict=verdict,
        reason=reason,
        request=request,
        labels=labels,
        W=W,
        P=proof.claims.P,
        gains=gains,
        rate=proof.rate,
        cost=sum(gains.values(), Fraction(0)),
        decisions=decisions,
        prices=proposal.prices,
        changes=changes,
        problem=designed,
        certificate=proof,
        observer=proposal.observer,
    )


def _is_slow(proof: Proof, request: DesignRequest) -> bool:
    return request.rate is not None and (proof.rate is None or claimed(proof.rate) < request.rate)


def _proof_words(proof: Proof) -> str:
    return f"Proved by: {proof.covered_by}." if proof.covered_by else "Proved by: nothing yet."
