"""Lemma 1 and the theorems decided: the Reduction against the whole matrix, claims at their edge,
no gaps."""

import math
from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from campaigns.certificates import a_problem, reduction_campaign
from certified import consensus_claims
from networks import linked
from oracles.theorems import Oracle, eye, negative_definite, plus, times
from random_problems import WEIGHTS
from texts import exact_matrix, exosystem_of

from dobc_design import Observer, Verdict, certify, verify
from dobc_design.certification.recheck import recheck
from dobc_design.conditions.consensus.claim import Pair, state_theorems
from dobc_design.conditions.consensus.decide import (
    LARGEST_EXAMINED,
    Proposal,
    lemma1_check,
    psi_is_negative,
    theorem_check,
    unstable_roots,
)
from dobc_design.loop.make import loop_of


def test_the_reduction_agrees_with_the_whole_matrix():
    """Psi < 0 <=> Lambda + I (x) S < 0, given Omega0 < 0 (theory, section 2); feasible, infeasible,
    near the edge."""
    tally = reduction_campaign(range(3))
    assert tally.wrong == []
    assert min(tally.counts["negative"], tally.counts["not negative"]) >= 2


def claimed(problem, id):
    """The check of that name, of one mode."""
    (check,) = [each for each in consensus_claims(problem).checks if each.id == id]
    return check


def path(n, gains, h="y", **more):
    arcs = [[i + 1, i] for i in range(1, n)]
    return linked(arcs, n, coupling=h, gains=gains, **more)


def proved_problems(seeds):
    """Problems without kinks whose Lemma 1 holds in all modes."""
    for seed in seeds:
        problem = a_problem(seed)
        oracle = Oracle(problem)
        if oracle.smooth and all(oracle.lemma(mode) for mode in oracle.modes):
            yield problem, oracle


def test_lemma_1_margins_are_true_and_nearly_the_largest_possible():
    """Lambda + margin I < 0 at the claimed margin; at 1.001 times the true value not."""
    count = 0
    for problem, oracle in proved_problems(range(15)):
        for check in consensus_claims(problem).checks:
            if check.id != "lemma1":
                continue
            count += 1
            Lambda = oracle.lambda_(check.mode)
            size = eye(problem.n * problem.m)
            factor = Fraction(repr(check.margin))
            assert negative_definite(plus(Lambda, times(factor, size)))
            true = -float(np.linalg.eigvalsh(np.array(Lambda, dtype=float))[-1])
            assert not negative_definite(plus(Lambda, times(Fraction(true * 1.001), size)))
            assert check.margin == pytest.approx(true, rel=1e-6, abs=1e-12)
            assert check.rate is None or 2 * Fraction(repr(check.rate)) <= Fraction(
                repr(check.margin)
            )
    assert count >= 5


@pytest.mark.slow
def test_theorem_margins_and_rates_are_true_and_fail_a_little_higher():
    """Psi < 0 with margin and rate as written (oracle: the whole matrix); 1.001 times the true
    value fails."""
    count = 0
    for problem, oracle in proved_problems(range(30)):
        claims = consensus_claims(problem)
        if problem.exosystem is None or claims.P is None:
            continue
        check = next(each for each in claims.checks if each.id in ("theorem1", "theorem2"))
        P, Q = ([list(row) for row in M] for M in (claims.P, claims.Q))
        margin = Fraction(repr(check.margin))
        rate = Fraction(repr(check.rate or 0.0))

        def holds(margin, rate, P=P, Q=Q, oracle=oracle):
            return all(
                negative_definite(oracle.psi(mode, P, Q, margin=margin, rate=rate))
                for mode in oracle.modes
            )

        assert holds(margin, Fraction(0))
        assert holds(Fraction(0), rate)
        if check.margin > 1e-6 and check.rate:
            count += 1
            most = edge(lambda x, holds=holds: holds(x, Fraction(0)), margin)
            fastest = edge(lambda x, holds=holds: holds(Fraction(0), x), rate)
            assert not holds(most * Fraction(1001, 1000), Fraction(0))
            assert not holds(Fraction(0), fastest * Fraction(1001, 1000))
            assert margin >= most * Fraction(99, 100)
            assert rate >= fastest * Fraction(99, 100)
    assert count >= 5


def edge(holds, low):
    """Where a claim stops to hold, from above, within one part in 2^20."""
    high = 2 * low
    while holds(high):
        low, high = high, 2 * high
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return high


def test_a_margin_and_a_rate_a_little_above_the_truth_are_not_confirmed():
    """n = 1, k = 2: Lambda = -4, so margin 4 and rate 2 are false (strict), and anything below is
    true."""
    problem = path(1, 2)
    certificate = certify(problem)

    def with_numbers(margin, rate):
        lemma = replace(certificate.check("lemma1"), margin=margin, rate=rate)
        checks = tuple(
            lemma if c.id == "lemma1" else c
            for c in certificate.checks
            if c.id != "theorem1-weighted"
        )
        return recheck(
            replace(certificate.claims, checks=checks, rate=rate, covered_by="lemma1"), problem
        ).holds

    assert with_numbers(3.999, 1.999)
    assert with_numbers(0.0, 1.0)
    cases = (
        (4.0, 1.999),
        (3.999, 2.0),
        (-0.5, 1.999),
        (3.999, 0.0),
        (math.nan, 1.999),
        (math.inf, 1.999),
    )
    for wrong in cases:
        assert not with_numbers(*wrong)


@pytest.mark.parametrize("k", ["1e-9", "1e-300", "1e-323", "1.5e-323", "1e-380"])
def test_tiny_margins_are_proved_and_numbers_below_the_floats_are_claimed_as_less(k):
    """lambda_max = -2 k < 0, however small."""
    problem = path(1, k)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert 0 <= Fraction(repr(certificate.check("lemma1").margin)) <= 2 * Fraction(k)
    assert recheck(certificate.claims, problem).holds


def test_a_margin_of_zero_is_refuted():
    found = claimed(path(1, 0), "lemma1")
    assert found.verdict is Verdict.REFUTED


def test_a_lost_estimate_never_turns_a_proof_into_a_refutation():
    """Proposals of nonsense: the exact test decides, with margin 0."""
    loop = loop_of(path(3, {1: 1}))
    statements = state_theorems(loop)
    cases = (float("nan"), float("inf"), -float("inf"), -1.0, 1e300)
    for bad in cases:
        vectors = [[float("nan")] * 3, [0.0] * 3]
        proposal = Proposal(margin=bad, vectors=vectors)
        check = lemma1_check(statements, "G", proposal)
        assert check.verdict is Verdict.PROVED
        assert check.margin == 0.0
    # A refutation needs no proposal: the elimination finds a witness of its own.
    problem = path(3, {3: 1})
    check = lemma1_check(state_theorems(loop_of(problem)), "G", Proposal())
    assert check.verdict is Verdict.REFUTED
    values = [Fraction(x) for x in check.witness.values]
    Lambda = Oracle(problem).lambda_("G")
    assert sum(Lambda[i][j] * values[i] * values[j] for i in range(3) for j in range(3)) >= 0


def test_irrational_slopes_refute_where_the_network_alone_decides():
    """v' Lambda v = 0 for every slope when nobody is pinned: no rounding can hide it."""
    arcs = [[1, 2], [2, 1], [2, 3], [3, 2]]
    for gains, verdict in ((None, Verdict.REFUTED), ({1: 1}, Verdict.PROVED)):
        problem = linked(arcs, coupling="sin(pi*y)", gains=gains)
        certificate = certify(problem)
        assert certificate.check("lemma1").verdict is certificate.verdict is verdict
        assert recheck(certificate.claims, problem).holds
    # Exact values are not claimed where one enters: v' Lambda v is not rational.
    arcs = [[1, 2], [2, 1], [3, 1]]
    problem = linked(arcs, coupling="sin(pi*y)", gains={1: "1/10", 2: "1/10"})
    check = certify(problem).check("lemma1")
    assert check.verdict is Verdict.REFUTED
    assert set(check.exact) == {"unstable_roots"}
    assert check.margin < 0
    assert recheck(certify(problem).claims, problem).holds


def test_the_edge_of_irrational_slopes_is_undecided_and_both_sides_are_decided():
    """Two agents, h = -y pi/2 one way: Lambda < 0 turns where k meets an irrational number."""

    def verdict(k):
        arcs = [[1, 2], [2, 1]]
        problem = linked(arcs, coupling="-y*pi/2", gains=k)
        return claimed(problem, "lemma1").verdict

    # Lambda = pi [[1, -1], [-1, 1]] - 2 k I: the largest eigenvalue is 2 pi - 2 k.
    near = Fraction("3.14159265358979323846264338327950288419716939937510")
    found = verdict(near + Fraction(1, 10**30))
    assert found is Verdict.PROVED
    found = verdict(near - Fraction(1, 10**30))
    assert found is Verdict.REFUTED
    assert verdict(near) is Verdict.UNDECIDED


def test_psi_is_refuted_by_a_p_that_is_not_positive_definite_and_by_omega():
    """Printed pairs that fail before the network is looked at; each names the block."""
    exosystem = exosystem_of("0", "1")
    cases = ((1, -1, "P"), (1, 0, "P"), (-1, 1, "Omega0"))
    for W, P, block in cases:
        observer = Observer(W=[[W]], P=[[P]])
        problem = path(1, 1, exosystem=exosystem, observer=observer)
        check = claimed(problem, "theorem1-printed")
        assert check.verdict == Verdict.REFUTED
        assert check.exact == {"block": block}
        assert recheck(consensus_claims(problem), problem).holds
    observer = Observer(W=[[1]], P=[[1]])
    twin = path(1, 1, exosystem=exosystem, observer=observer)
    assert claimed(twin, "theorem1-printed").verdict is Verdict.PROVED


def test_a_pair_with_an_indefinite_p_proves_nothing_though_psi_is_negative():
    """A stable, W = 0, C = 0, P = -1 with A = +1: Omega0 < 0 and Psi < 0, but V is no Lyapunov
    function."""
    observer = Observer(W=[[0]], P=[[-1]])
    problem = path(1, 1, exosystem=exosystem_of("1", "0"), observer=observer)
    statements = state_theorems(loop_of(problem))
    pair = Pair(P=exact_matrix("-1"), Q=exact_matrix("0"))
    whole = Oracle(problem).psi(
        "G", [[Fraction(-1)]], [[Fraction(0)]], margin=Fraction(0), rate=Fraction(0)
    )
    assert negative_definite(whole)
    assert not psi_is_negative(statements, problem.exosystem, pair)
    assert claimed(problem, "theorem1-printed").verdict is Verdict.REFUTED
    # Without a pair and without an obstacle the theorem is undecided.
    problem = path(1, 1, exosystem=exosystem_of("0", "1"))
    statements = state_theorems(loop_of(problem))
    lemmas = [lemma1_check(statements, "G", Proposal(margin=2.0))]
    check = theorem_check("theorem1", statements, None, Proposal(), lemmas=lemmas, obstacle=None)
    assert check.verdict is Verdict.UNDECIDED
    assert check.exact is check.witness is check.margin is None


def test_reasons_never_name_a_better_number_than_is_proved():
    """Shortened numbers in sentences are rounded towards the weaker claim."""
    slow = exosystem_of("-0.123456789", "1")
    observer = Observer(W=[[0]])
    problem = path(1, "1.234567", exosystem=slow, observer=observer)
    certificate = certify(problem)
    assert "lambda_max <= -2.46913:" in certificate.check("lemma1").reason
    assert "exp(-0.1234 t)" in certificate.check("hurwitz").reason


def test_irrational_slopes_and_large_networks_are_not_examined():
    """0 is "not examined": h = -y e with a weak pin is unstable, and nothing is claimed."""
    for h, roots in (("-3*y", 1), ("-y*exp(1)", 0)):
        arcs = [[1, 2], [2, 1]]
        problem = linked(arcs, coupling=h, gains={1: "1/100"})
        loop = loop_of(problem)
        statements = state_theorems(loop)
        assert unstable_roots(statements, "G") == roots
    n = LARGEST_EXAMINED + 1
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    large = linked(arcs, coupling="-y", gains="1/10")
    assert unstable_roots(state_theorems(loop_of(large)), "G") == 0


@pytest.mark.parametrize(("slope", "verdict"), [("-1.01", "refuted"), ("-0.99", "proved")])
def test_one_unstable_root_of_a_large_symmetric_network_is_shown_by_a_vector(slope, verdict):
    """62 pairs, k = 1 each, and h = s y both ways in one of them: its eigenvalues are -1 and -1 - 2
    s."""
    pairs = [(2 * i + 1, 2 * i + 2) for i in range(62)]
    arcs = [arc for a, b in pairs for arc in ([a, b], [b, a])]
    half = {(0, 1): f"{slope}/2*y", (1, 0): f"{slope}/2*y"}
    problem = linked(arcs, coupling="y", exceptions=half, gains="1")
    certificate = certify(problem)
    assert certificate.verdict.value == verdict
    assert verify(certificate, problem).lone_checker == "it accepts every claim"
    if verdict == "refuted":
        assert "1 eigenvalue(s) with positive real part" in certificate.reason
        # the same value of the form, and a loop that is not symmetric: nothing is counted
        one_way = linked([*arcs, [3, 1]], coupling="y", exceptions=half, gains="1")
        assert certify(one_way).verdict is Verdict.UNDECIDED


def test_diagonal_slopes_that_are_not_negative_with_scalar_gains_are_never_unstable():
    """The shortcut. Gershgorin: row i c has the diagonal -(sum g + k) <= 0 and the off-diagonal sum
    g, so every disc lies in Re <= 0. Weights, several slopes per component and isolated agents
    included."""
    for seed in range(30):
        r = Random(seed)
        n = r.randint(1, 5)
        m = r.choice((1, 2, 3))
        arcs = [
            [i + 1, j + 1, r.choice(WEIGHTS)]
            for i in range(n)
            for j in range(n)
            if i != j and r.random() < 0.4
        ]
        slopes = [
            f"{r.randint(0, 3)}*y{c + 1}" if m > 1 else f"{r.randint(0, 3)}*y" for c in range(m)
        ]
        gains = {i + 1: r.choice((0, 1, 3)) for i in range(n)}
        problem = linked(arcs, n, coupling=slopes, target=[0] * m, gains=gains)
        statements = state_theorems(loop_of(problem))
        assert statements.jacobians.modes[0].is_nonnegative_diagonal
        assert problem.pinning.is_scalar
        assert unstable_roots(statements, "G") == 0
        eigenvalues = np.linalg.eigvals(np.array(Oracle(problem).loop("G"), dtype=float))
        assert eigenvalues.real.max() < 1e-6


def test_the_shortcut_needs_scalar_gains():
    """Slopes diag(9, 0) one way and diag(0, 9) the other, skew gains: diagonal slopes >= 0, and yet
    unstable."""

    def roots(k1, k2):
        special = {(0, 1): ["0*y1", "9*y2"]}
        arcs = [[2, 1], [1, 2]]
        gains = {1: k1, 2: k2}
        problem = linked(arcs, coupling=["9*y1", "0*y2"], exceptions=special, gains=gains)
        statements = state_theorems(loop_of(problem))
        assert statements.jacobians.modes[0].is_nonnegative_diagonal
        eigenvalues = np.linalg.eigvals(np.array(Oracle(problem).loop("G"), dtype=float))
        assert unstable_roots(statements, "G") == np.sum(eigenvalues.real > 1e-9)
        return unstable_roots(statements, "G")

    found = roots([[0, -4], [4, 0]], [[0, 4], [-4, 0]])
    assert found == 1
    assert roots(4, 4) == 0
