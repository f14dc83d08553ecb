"""Counts over many random problems: the fast tests call these with few seeds, the evidence with
many.

Each function returns a Counter of outcomes; the key "wrong" (absent or 0) counts what must not
happen, and ``wrong`` lists what it was.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from broken_certificates import claim, mutate
from certified import certified, consensus_claims
from oracles.theorems import Oracle, eye, kron, negative_definite, positive_definite, times
from random_problems import badly_scaled_problem, random_linear_problem, random_problem
from scipy import linalg

from dobc_design import Problem, Verdict, certify, verify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.consensus.claim import Pair, state_theorems
from dobc_design.conditions.consensus.decide import psi_is_negative
from dobc_design.errors import CertificateError
from dobc_design.exact.matrix import multiply
from dobc_design.exact.observability import decide_detectable
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

Document = dict[str, Any]


@dataclass
class Tally:
    """What came out, and what was wrong."""

    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def a_problem(seed: int) -> Problem:
    """Every third one linear."""
    if seed % 3 == 0:
        return random_linear_problem(seed)
    return random_problem(seed)


def recheck_campaign(
    seeds: Iterable[int], *, make: Callable[[int], Problem] = a_problem, know: type[Oracle] = Oracle
) -> Tally:
    """Every certificate is accepted by ``verify``, and every claim in it is true for the oracle."""
    tally = Tally()
    for seed in seeds:
        problem = make(seed)
        certificate = certify(problem)
        data = certificate_bytes(certificate.claims)
        tally.counts[certificate.verdict.value] += 1
        outcome = verify(data, problem)
        oracle = know(problem)
        tally.wrong += [f"{seed}: {failure}" for failure in outcome.failures]
        tally.wrong += [
            f"{seed}: not true: {what}" for what in oracle.false_claims(json.loads(data))
        ]
        W = None if certificate.claims.W is None else [list(row) for row in certificate.claims.W]
        if certificate.verdict is Verdict.UNDECIDED and oracle.verdicts(W) != {"undecided"}:
            tally.wrong.append(f"{seed}: undecided, though {oracle.verdicts(W)}")
    return tally


def lone_checker(data: bytes, problem: Problem) -> tuple[bool, str]:
    """Whether the lone checker accepts, and why not."""
    try:
        refusals = [
            text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds
        ]
    except checker.Refused as error:
        refusals = [f"unreadable: {error}"]
    return not refusals, "; ".join(refusals)


def judge_mutant(
    tally: Tally,
    label: str,
    changed: Document,
    document: Document,
    problem: Problem,
    oracle: Oracle,
) -> None:
    """Both checkers agree about a changed certificate; what they accept is true."""
    data = json.dumps(changed).encode()
    alone, said = lone_checker(data, problem)
    try:
        accepted = recheck(data, problem).holds
    except CertificateError:
        tally.counts["unreadable"] += 1
        tally.wrong += [f"{label}: unreadable, but the lone checker accepts"] if alone else []
        return
    if alone is not accepted:
        tally.wrong.append(
            f"{label}: the package says {accepted}, the lone checker {alone}: {said}"
        )
    tally.counts["same" if changed == document else "accepted" if accepted else "refused"] += 1
    if accepted and changed != document:
        tally.wrong += [
            f"{label}: accepted, not true: {what}" for what in oracle.false_claims(changed)
        ]


def mutant_campaign(
    seeds: Iterable[int],
    *,
    each: int,
    make: Callable[[int], Problem] = a_problem,
    know: type[Oracle] = Oracle,
) -> Tally:
    """Changed certificates: refused, or unreadable, or everything in them is still true; two
    checkers always agree."""
    tally = Tally()
    other = json.loads(certificate_bytes(certified("paper-fixed").claims))
    for seed in seeds:
        problem = make(seed)
        document = json.loads(certificate_bytes(certified(problem).claims))
        oracle = know(problem)
        for k in range(each):
            number = seed * 100_000 + k
            if k % 3 == 0:
                changed = claim(document, number)
            else:
                changed = mutate(document, number, other=other)
            judge_mutant(tally, f"{seed}, {k}", changed, document, problem, oracle)
        other = document
    return tally


def reduction_campaign(seeds: Iterable[int]) -> Tally:
    """Psi < 0 through the Reduction and by elimination of the whole matrix (18): always the same
    answer."""
    tally = Tally()
    for seed in seeds:
        problem = _reducible(seed)
        oracle = Oracle(problem)
        statements = state_theorems(loop_of(problem))
        exosystem = problem.exosystem
        assert exosystem is not None
        pair = _near_boundary_pair(problem, Random(seed), oracle)
        P, Q = ([list(row) for row in M] for M in (pair.P, pair.Q))
        for rate in (Fraction(0), Fraction(1, 20)):
            whole = positive_definite(P) and all(
                negative_definite(oracle.psi(mode, P, Q, margin=Fraction(0), rate=rate))
                for mode in oracle.modes
            )
            reduced = psi_is_negative(statements, exosystem, pair, rate=rate)
            tally.counts["negative" if whole else "not negative"] += 1
            if whole is not reduced:
                tally.wrong.append(
                    f"{seed}, rate {rate}: the whole matrix says {whole}, the Reduction {reduced}"
                )
    return tally


def _reducible(seed: int) -> Problem:
    """The next random problem with an exosystem, rational slopes, no kinks, m <= 2 and n (m + q) <=
    20."""
    for k in range(1000):
        problem = a_problem(seed * 1000 + k)
        if problem.q and problem.m <= 2 and problem.n * (problem.m + problem.q) <= 20:
            oracle = Oracle(problem)
            if oracle.exact and (k > 30 or all(oracle.lemma(mode) for mode in oracle.modes)):
                return problem
    raise AssertionError("no problem found")


def _near_boundary_pair(problem: Problem, r: Random, oracle: Oracle) -> Pair:
    """A pair scaled to lie a little on this or that side of where Psi < 0 begins to hold; sometimes
    any pair."""
    own = consensus_claims(problem)
    if own.P is None or own.Q is None or r.random() < 0.15:
        q = problem.q
        m = problem.m
        P = [[Fraction(r.randint(-2, 4)) for _ in range(q)] for _ in range(q)]
        P = [[P[min(i, j)][max(i, j)] + (6 if i == j else 0) for j in range(q)] for i in range(q)]
        W = problem.observer.W or tuple(
            tuple(Fraction(r.randint(-2, 2)) for _ in range(m)) for _ in range(q)
        )
        return Pair(P=tuple(map(tuple, P)), Q=multiply(tuple(map(tuple, P)), W))
    P, Q = ([list(row) for row in M] for M in (own.P, own.Q))

    def holds(a: Fraction) -> bool:
        return all(
            negative_definite(
                oracle.psi(mode, times(a, P), times(a, Q), margin=Fraction(0), rate=Fraction(0))
            )
            for mode in oracle.modes
        )

    low, high = Fraction(0), Fraction(1)  # Psi(a P, a Q) < 0 for a = 1, and then for every larger a
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    a = r.choice((low, high, low, high, Fraction(1), 2 * high)) or Fraction(1, 10**6)
    return Pair(P=tuple(map(tuple, times(a, P))), Q=tuple(map(tuple, times(a, Q))))


def decision_campaign(seeds: Iterable[int]) -> Tally:
    """Where Lambda < 0 and (A, C) is detectable, the theorem is proved: the Decision theorem leaves
    no gap."""
    tally = Tally()
    for seed in seeds:
        problem = badly_scaled_problem(seed)
        assert problem.exosystem is not None
        certificate = certify(problem)
        theorem = certificate.check("theorem1")
        detectable = decide_detectable(problem.exosystem.A, problem.exosystem.C).verdict
        tally.counts[f"{detectable.value}: {theorem.verdict.value}"] += 1
        if theorem.verdict is not detectable:
            tally.wrong.append(
                f"{seed}: detectable {detectable.value}, theorem {theorem.verdict.value}"
            )
        tally.wrong += [f"{seed}: {failure}" for failure in verify(certificate, problem).failures]
    return tally


def outside_campaign(seeds: Iterable[int]) -> Tally:
    """Linear problems: verdicts and rates against eigenvalues and matrix exponentials of the closed
    loop."""
    tally = Tally()
    for seed in seeds:
        problem = random_linear_problem(seed)
        certificate = certify(problem)
        oracle = Oracle(problem)
        W = None if certificate.claims.W is None else [list(row) for row in certificate.claims.W]
        loops = {mode: closed_loop(oracle, mode, W) for mode in oracle.modes}
        tops = {mode: float(np.max(np.linalg.eigvals(loop).real)) for mode, loop in loops.items()}
        verdict = certificate.verdict
        tally.counts[verdict.value] += 1
        if verdict is Verdict.PROVED and max(tops.values()) >= 0:
            tally.wrong.append(f"{seed}: proved, largest real parts {tops}")
        if verdict is Verdict.REFUTED and max(tops.values()) < -1e-12 - 1e-9 * _size(loops):
            tally.wrong.append(f"{seed}: refuted, largest real parts {tops}")
        lyapunov = certificate.covered_by not in (
            "max-separable",
            "lure",
            "linearisation",
        )  # whose V is another one, or none
        if verdict is Verdict.PROVED and certificate.rate and lyapunov:
            weight = _weight(problem, certificate, oracle)
            tally.wrong += _slower_than(certificate.rate, loops, weight, seed=seed)
    return tally


def _size(loops: dict[str, np.ndarray]) -> float:
    return max(float(np.linalg.norm(loop)) for loop in loops.values())


def closed_loop(oracle: Oracle, mode: str, W: list[list[Fraction]] | None) -> np.ndarray:
    """(22): [[J - K, I (x) C], [0, I (x) (A - WC)]]; without an exosystem J - K."""
    network = np.array(oracle.loop(mode), dtype=float)
    if oracle.C is None or W is None:
        return network
    border = np.array(kron(eye(oracle.n), oracle.C), dtype=float)
    error = np.array(kron(eye(oracle.n), oracle.error(W)), dtype=float)
    return np.block([[network, border], [np.zeros((len(error), len(network))), error]])


def _weight(problem: Problem, certificate: object, oracle: Oracle) -> np.ndarray:
    """V = e'e + sum eps_i' P eps_i as a matrix, for the check that carries the verdict."""
    claims = certificate.claims  # type: ignore[attr-defined]
    P = problem.observer.P if str(claims.covered_by).endswith("printed") else claims.P
    network = np.eye(oracle.n * oracle.m)
    if str(claims.covered_by).endswith("weighted"):
        exact = certificate.check(claims.covered_by).exact  # type: ignore[attr-defined]
        network = np.diag([float(Fraction(x)) for x in exact["D"]])
        P = [[Fraction(x) for x in row] for row in exact["P"]] if "P" in exact else None
    if P is None:
        return network
    return linalg.block_diag(network, np.kron(np.eye(oracle.n), np.array(P, dtype=float)))


def _slower_than(
    rate: float, loops: dict[str, np.ndarray], weight: np.ndarray, *, seed: int
) -> list[str]:
    """Starts from which sqrt(V) falls more slowly than exp(-rate t), the modes switching at
    random."""
    rng = np.random.default_rng(seed)
    r = Random(seed)
    state = rng.standard_normal((len(weight), 20))
    wrong = []
    for _ in range(8):
        mode = r.choice(sorted(loops))
        time = r.choice((0.01, 0.1, 1.0, 3.0))
        later = linalg.expm(loops[mode] * time) @ state
        before, after = (np.sqrt(np.einsum("ij,ik,kj->j", x, weight, x)) for x in (state, later))
        if np.any(after > before * np.exp(-rate * time) * (1 + 1e-7) + 1e-12):
            wrong.append(f"{seed}: V falls more slowly than the rate {rate} in {mode}")
        state = later / np.linalg.norm(later, axis=0)
    return wrong
