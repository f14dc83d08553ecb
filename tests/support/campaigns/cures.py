"""Cures over many random problems: offered, confirmed by the oracle, and proved once they are
written and read."""

import json
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import networkx as nx
import numpy as np
import pytest
from certified import consensus_claims
from networks import linked
from oracles.theorems import Oracle, form

from campaigns.certificates import Tally, a_problem, closed_loop
from dobc_design import Certificate, Exosystem, Problem, Verdict, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification import certify as certification
from dobc_design.conditions.check import main_cure
from dobc_design.problem.changes import changed_file, problem_text
from dobc_design.problem.load import read_problem_text


def cured(problem: Problem, changes: Any) -> Problem:
    """The problem after its file was changed, written and read again."""
    text = changed_file(problem, changes, text=problem_text(problem), folder=Path())
    return read_problem_text(text.encode("utf-8"), folder=Path(), default_name=problem.name)


def with_cures(problem: Problem, *, progress: Any = None) -> Certificate:
    """What ``certify`` gives, but for the stages of the region."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certification, "region_checks", lambda *arguments, **options: [])
        return certify(problem, progress=progress)


def theorem_holds(problem: Problem) -> bool:
    """Theorem 1 or 2, with weights or without, or Lemma 1 without an exosystem, proved for the
    problem as it stands."""
    claims = consensus_claims(problem)
    if _by_weights(claims):
        return verify(claims, problem).holds
    ids = ("lemma1",) if problem.exosystem is None else ("theorem1", "theorem2")
    own = [check.verdict for check in claims.checks if check.id in ids]
    return (
        bool(own)
        and all(verdict is Verdict.PROVED for verdict in own)
        and verify(claims, problem).holds
    )


def _by_weights(certificate: Any) -> bool:
    return any(
        c.id.endswith("-weighted") and c.verdict is Verdict.PROVED for c in certificate.checks
    )


def cure_campaign(seeds: Iterable[int]) -> Tally:
    """For every refuted Lemma 1 or theorem: the witness is true, a cure is offered unless weights
    of V prove the theorem, and applied it proves."""
    tally = Tally()
    for seed in seeds:
        problem = a_problem(seed)
        certificate = certify(problem)
        tally.wrong += [f"{seed}: {failure}" for failure in verify(certificate, problem).failures]
        document = json.loads(certificate_bytes(certificate.claims))
        oracle = Oracle(problem)
        tally.wrong += [f"{seed}: not true: {what}" for what in oracle.false_claims(document)]
        main = [c for c in certificate.checks if c.id in ("lemma1", "theorem1", "theorem2")]
        refuted = [c for c in main if c.verdict is Verdict.REFUTED]
        for check in refuted:
            tally.counts[f"{check.id} refuted"] += 1
            missing = ["no cure"] if check.fix is None and not _by_weights(certificate) else []
            tally.wrong += [
                f"{seed}: {check.title}: {what}"
                for what in (*_false_witness(check, oracle), *missing)
            ]
        cure = main_cure(certificate.checks)
        fix = None if cure is None else cure.fix
        if refuted and fix is not None:
            tally.counts[f"cured by {fix.kind}"] += 1
            if not theorem_holds(cured(problem, fix.set)):
                tally.wrong.append(f"{seed}: the cure {dict(fix.set)} does not prove")
    return tally


def _false_witness(check: Any, oracle: Oracle) -> list[str]:
    """A vector has v' Lambda v >= 0 in its mode and moves the agents it names."""
    if check.witness is None or check.witness.kind != "vector":
        return []
    v = [Fraction(x) for x in check.witness.values]
    mode = check.mode or check.exact["mode"]
    moved = []
    for i in range(oracle.n):
        if any(v[i * oracle.m : (i + 1) * oracle.m]):
            moved.append(oracle.labels[i])
    wrong = []
    if form(oracle.lambda_(mode), v) < -oracle.slack() * sum(x * x for x in v):
        wrong.append("the vector does not refute")
    if list(check.witness.labels) != moved:
        wrong.append("the labels are not those of the vector")
    return wrong


def decided_campaign(seeds: Iterable[int]) -> Tally:
    """Conditions with a truth known from outside and a margin of 1e-6 or more: decided or not, and
    never wrongly.

    Lemma 1: the eigenvalues of Lambda.  The theorem: these, and the singular values of [A - s I; C]
    (Decision theorem).  The overall verdict of linear problems of one mode: the eigenvalues of the
    closed loop.
    """
    tally = Tally()
    for seed in seeds:
        problem = a_problem(seed)
        certificate = certify(problem)
        oracle = Oracle(problem)
        if not oracle.smooth:
            continue
        tops = {
            mode: float(np.linalg.eigvalsh(np.array(oracle.lambda_(mode), dtype=float))[-1])
            for mode in oracle.modes
        }
        for mode, top in tops.items():
            _count(tally, "lemma1", certificate.check("lemma1", mode).verdict, -top, seed)
        own = [c for c in certificate.checks if c.id in ("theorem1", "theorem2")]
        W = certificate.claims.W
        if own and problem.observer.W is None:
            _count(
                tally,
                "theorem",
                own[0].verdict,
                min(-max(tops.values()), _detectable(problem)),
                seed,
            )
        if oracle.linear and len(oracle.modes) == 1 and problem.region is None:
            loop = closed_loop(
                oracle, next(iter(oracle.modes)), None if W is None else [list(row) for row in W]
            )
            if problem.exosystem is None or W is not None:
                slowest = -float(np.max(np.linalg.eigvals(loop).real))
                _count(tally, "linear loop", certificate.verdict, slowest, seed)
    return tally


def undirected_campaign(seeds: Iterable[int]) -> Tally:
    """Undirected graphs, one increasing odd h, gains that are numbers: consensus iff every
    component holds a pin.

    With an exosystem that is seen and a designed W (theory, section 2: V = e'e).
    """
    tally = Tally()
    for seed in seeds:
        r = Random(seed)
        n = r.randint(2, 9)
        pairs = [(i, j) for i in range(n) for j in range(i) if r.random() < 2.2 / n]
        weights = {pair: Fraction(r.randint(1, 9), r.randint(1, 4)) for pair in pairs}
        arcs = [
            [i + 1, j + 1, weights[max(i, j), min(i, j)]]
            for a, b in pairs
            for i, j in ((a, b), (b, a))
        ]
        gains = {i + 1: Fraction(r.randint(1, 9), 2) for i in range(n) if r.random() < 0.5}
        exosystem = r.choice((None, Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])))
        problem = linked(
            arcs,
            n,
            gains=gains,
            exosystem=exosystem,
            coupling=r.choice(("y", "tanh(y)", "y + y**3")),
        )
        graph = nx.empty_graph(n)
        graph.add_edges_from(pairs)
        held = all(any(i + 1 in gains for i in part) for part in nx.connected_components(graph))
        _count(tally, "undirected", certify(problem).verdict, 1.0 if held else -1.0, seed)
    return tally


def _detectable(problem: Problem) -> float:
    """> 0 iff every eigenvalue s of A with Re s >= 0 is seen: the least singular value of [A - s I;
    C]; near 0: 0."""
    A, C = (np.array(M, dtype=float) for M in (problem.exosystem.A, problem.exosystem.C))
    lasting = [s for s in np.linalg.eigvals(A) if s.real > -1e-6]
    least = [float(np.linalg.svd(np.vstack([A - s * np.eye(len(A)), C]))[1][-1]) for s in lasting]
    worst = min(least, default=1.0)
    if worst > 1e-5:
        return worst
    return -worst if worst < 1e-9 else 0.0


def _count(tally: Tally, what: str, verdict: Verdict, truth: float, seed: int) -> None:
    """``truth``: > 0 true, < 0 false; too near to 0 does not count."""
    if abs(truth) < 1e-6:
        return
    tally.counts[f"{what}: {'undecided' if verdict is Verdict.UNDECIDED else 'decided'}"] += 1
    if verdict is not Verdict.UNDECIDED and (verdict is Verdict.PROVED) is not (truth > 0):
        tally.wrong.append(f"{seed}: {what} is {verdict.value}, the truth is {truth}")


def share(tally: Tally, what: str) -> float:
    """The part of these that was decided."""
    yes = tally.counts[f"{what}: decided"]
    no = tally.counts[f"{what}: undecided"]
    return yes / max(1, yes + no)
