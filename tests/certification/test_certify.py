"""The stages together: verdicts against the truth seen from outside, and what the verbs accept."""

import math
from fractions import Fraction

import numpy as np
import pytest
from campaigns.certificates import outside_campaign
from certified import claimed_afresh, consensus_claims, without_region
from networks import linked
from oracles.theorems import Oracle

from dobc_design import Certificate, Exosystem, Observer, Verdict, certify, load_problem, verify
from dobc_design.conditions.consensus.claim import Pair, PairFacts
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.consensus.propose import Top
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.exact.matrix import matrix, multiply, scale
from dobc_design.exact.number import number_text
from dobc_design.loop.make import loop_of


@pytest.mark.slow
def test_linear_verdicts_agree_with_eigenvalues_and_exponentials():
    """Proved: all eigenvalues of (22) in the left half plane, V decays at least at the claimed rate
    whatever the switching; refuted: some mode has an eigenvalue that does not decay."""
    tally = outside_campaign(range(8))
    assert tally.wrong == []
    assert min(tally.counts[verdict.value] for verdict in Verdict) >= 2


def test_a_missing_gain_is_designed_and_is_the_one_that_everything_is_about():
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, gains=1, exosystem=HARMONIC)
    stages = []
    certificate = certify(problem, progress=stages.append)
    assert len(stages) >= 3
    assert certificate.claims.gain_source == "designed"
    assert observer_gain(loop_of(problem)) == certificate.claims.W
    assert certificate.verdict is Verdict.PROVED


def broken(statements):
    raise np.linalg.LinAlgError("no convergence")


def nonsense(statements):
    size = next(iter(statements.lambdas.values())).size
    found = {}
    for mode in statements.lambdas:
        found[mode] = Top(value=-7.0, vector=np.full(size, np.nan))
    return found


@pytest.mark.parametrize(
    ("estimates", "name"), [(broken, "paper-fixed"), (nonsense, "paper-switching")]
)
def test_no_and_wrong_estimates_change_numbers_and_never_verdicts(monkeypatch, estimates, name):
    """Everything from floating point is a proposal: nonsense in, the same verdicts out, and they
    are confirmed."""
    problem = without_region(name)
    before = []
    for check in consensus_claims(problem).checks:
        before.append((check.id, check.mode, check.verdict))
    monkeypatch.setattr("dobc_design.conditions.consensus.propose.lambda_tops", estimates)
    claims = claimed_afresh(problem)  # the others are remembered
    assert [(check.id, check.mode, check.verdict) for check in claims.checks] == before
    assert verify(claims, problem).holds


PRINTED_P = [["1/2", "-1/4"], ["-1/4", "1/3"]]
PRINTED_W = [["16/5"], ["12/5"]]
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


def cycle(gains, *, n=10, factor=1):
    """The paper's Example 1 on a directed cycle, with the printed W and a multiple of the printed
    P."""
    arcs = [[i, i % n + 1] for i in range(1, n + 1)] if n > 1 else []
    P = []
    for row in PRINTED_P:
        P.append([number_text(factor * Fraction(x)) for x in row])
    observer = Observer(W=PRINTED_W, P=P)
    return linked(
        arcs,
        n,
        coupling="exp(y) - 1 + y",
        target=1,
        gains=gains,
        exosystem=HARMONIC,
        observer=observer,
    )


def consensus(problem):
    """The certificate of network, observer, theorems and linearisation alone."""
    return Certificate(problem=problem, claims=consensus_claims(problem))


def lambda_max(problem, mode="G"):
    eigenvalues = np.linalg.eigvalsh(np.array(Oracle(problem).lambda_(mode), dtype=float))
    return float(eigenvalues[-1])


@pytest.mark.parametrize(
    ("gains", "top", "printed"),
    [
        ({1: 3}, -0.153544, False),
        ({1: 10**9}, 4 * (math.cos(math.pi / 10) - 1), False),  # however strong one pin is
        ({1: 10, 6: 10}, -0.6637, False),
        (dict.fromkeys(range(1, 11, 2), 5), -2.5969, True),
        (3, -6.0, True),
        ("1/2", -1.0, False),
    ],
)
def test_the_table_of_the_directed_ten_cycle(gains, top, printed):
    """lambda_max(Lambda) at e = 0, and whether the printed P proves it: iff lambda_max < -9/8."""
    problem = cycle(gains)
    certificate = consensus(problem)
    assert lambda_max(problem) == pytest.approx(top, abs=6e-5)
    lemma = certificate.check("lemma1")
    theorem = certificate.check("theorem1")
    assert lemma.verdict is theorem.verdict is certificate.verdict is Verdict.PROVED
    assert 0 <= -lambda_max(problem) - lemma.margin < 1e-6
    found = certificate.check("theorem1-printed")
    assert found.verdict is (Verdict.PROVED if printed else Verdict.REFUTED)
    assert found.exact["bound"] == "-9/8"
    assert found.exact["S"] == [["9/8"]]
    assert found.exact["Q"] == [["1"], ["0"]]
    assert verify(certificate, problem).holds
    twice = consensus(cycle(gains, factor=2)).check("theorem1-printed")  # its bound is -9/16
    assert twice.verdict is (Verdict.PROVED if top < -9 / 16 else Verdict.REFUTED)


def test_printed_p_is_refuted_at_the_boundary_gain_and_proved_just_above_it():
    """All pinned: lambda_max = -2 k, so k = 9/16 makes Psi singular."""
    at = consensus(cycle("9/16"))
    small = Fraction(1, 10**12)
    just_above = Fraction(9, 16) + small
    above = consensus(cycle(just_above))
    assert at.check("theorem1-printed").verdict is Verdict.REFUTED
    assert at.check("theorem1-printed").margin == 0.0
    assert above.check("theorem1-printed").verdict is Verdict.PROVED
    assert at.verdict is above.verdict is Verdict.PROVED  # with another P
    assert verify(at, cycle("9/16")).holds


def test_nobody_pinned_is_refuted_by_the_vector_that_moves_everybody_alike():
    """Lambda 1 = 0: witness v = 1, lambda_max = 0 and consensus fails."""
    problem = cycle(None)
    certificate = consensus(problem)
    assert certificate.verdict is Verdict.REFUTED
    for id in ("lemma1", "theorem1"):
        check = certificate.check(id)
        assert check.verdict is Verdict.REFUTED
        assert len(set(check.witness.values)) == 1
        assert len(check.witness.labels) == 10
        assert check.margin == 0.0
    assert certificate.check("lemma1").exact == {"value": "0", "unstable_roots": "0"}


@pytest.mark.parametrize("factor", [Fraction(1, 3), 1, 2, 1000])
def test_a_scaled_pair_needs_less_of_the_network(factor):
    """(a P, a Q) has the bound -9/(8 a) and the same W."""
    P = matrix(PRINTED_P)
    Q = multiply(P, matrix(PRINTED_W))
    assert Q == ((1,), (0,))
    pair = Pair(P=scale(factor, P), Q=scale(factor, Q))
    facts = PairFacts(pair=pair, S=schur_block(pair, HARMONIC))
    expected = Fraction(-9, 8) / factor
    assert facts.bound == expected


def test_stand_in_modes_have_the_stated_eigenvalues_and_theorem_2_needs_a_scaled_p():
    """Example 2 with stand-ins: -0.582300, -0.924166, -1.055728, -1.055728, all above -9/8."""
    problem = load_problem("paper-switching")
    tops = [lambda_max(problem, mode) for mode in problem.network.modes]
    expected = [-0.582300, -0.924166, -1.055728, -1.055728]
    assert tops == pytest.approx(expected, abs=1e-6)
    certificate = consensus(without_region("paper-switching"))
    assert certificate.check("theorem2-printed").verdict is Verdict.REFUTED
    assert certificate.check("theorem2").verdict is certificate.verdict is Verdict.PROVED
    verdicts = [check.verdict for check in certificate.checks if check.id == "lemma1"]
    assert verdicts == [Verdict.PROVED] * 4
    # A - WC has the eigenvalues -8/5 +- (2/5) sqrt(39) i
    assert 1.599 < certificate.check("hurwitz").rate < 1.6


@pytest.mark.parametrize(
    ("A", "C", "polynomial"),
    [
        ([[0]], [[0]], "s"),
        ([[0, 1, 0, 0], [-4, 0, 0, 0], [0, 0, 0, 1], [0, 0, -4, 0]], [[1, 0, 1, 0]], "s^2 + 4"),
    ],
)
def test_undetectable_pairs_refute_the_theorem_and_leave_the_whole_undecided(A, C, polynomial):
    """A defect of the model, never of the network: the fix is the reduced exosystem."""
    arcs = [[1, 2]]
    gains = {1: 1, 2: 1}
    exosystem = Exosystem(A=A, C=C)
    problem = linked(arcs, gains=gains, exosystem=exosystem)
    certificate = certify(problem)
    detectability = certificate.check("detectability")
    theorem = certificate.check("theorem1")
    assert detectability.verdict is theorem.verdict is Verdict.REFUTED
    assert detectability.witness.values == (polynomial,)
    assert theorem.fix.kind == "exosystem"
    assert certificate.verdict is Verdict.UNDECIDED
    assert verify(certificate, problem).holds


def test_the_printed_pair_on_other_numbers_of_agents_has_the_same_bound():
    """The bound is a fact of (A, C, W, P): n does not enter it."""
    for n in (1, 2, 25):
        certificate = consensus(cycle(1, n=n))
        assert certificate.check("theorem1-printed").exact["bound"] == "-9/8"


def test_a_rate_that_was_asked_for_and_not_reached_is_named():
    """One agent with k = 1 and no disturbance decays at the rate 1, and at no larger one."""
    alone = linked([], 1, gains={1: 1})
    for note in certify(alone, rate="0.99").claims.notes:
        assert "asked for" not in note
    fast = certify(alone, rate="1.01")
    assert fast.verdict is Verdict.PROVED
    assert fast.claims.notes[-1].startswith(
        "A rate of at least 1.01 1/s was asked for and is not proved."
    )
