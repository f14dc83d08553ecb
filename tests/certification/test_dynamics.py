"""Agents with linear dynamics, certified: known answers, random ones against their eigenvalues, a
region."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from agents import DOUBLE, THRESHOLDS, judged, loop_matrix, riccati_agents, second_order
from certified import consensus_claims
from scipy.integrate import solve_ivp

from dobc_design import (
    Certificate,
    Dynamics,
    Exosystem,
    Group,
    Network,
    Observer,
    Problem,
    Verdict,
    certify,
    verify,
)
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.overall import decide_overall, with_verdict
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.margins.stage import margins_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
NAMES = ("max-separable", "delay", "sampling", "tolerance", "accuracy", "actuators")


def chain(n: int, **given) -> Problem:
    """2 hears 1, 3 hears 2, ...; agent 1 is pinned with 3."""
    arcs = []
    for i in range(2, n + 1):
        arcs.append([i, i - 1])
    own = {"network": Network.from_arcs(arcs, arrow="listens_to", agents=n)}
    own |= {"coupling": "y1 + 2*y2", "gains": {1: 3}, "dynamics": DOUBLE}
    return Problem(**own | given)


def verified(problem: Problem):
    """The certificate, which both programs accept."""
    return accepted(certify(problem))


def accepted(certificate: Certificate) -> Certificate:
    found = verify(certificate, certificate.problem)
    assert found.holds, found.failures
    assert found.lone_checker == "it accepts every claim"
    return certificate


def consensus(problem: Problem) -> Certificate:
    """The certificate of network, observer, theorems and linearisation alone, which both programs
    accept."""
    return accepted(Certificate(problem=problem, claims=consensus_claims(problem)))


@pytest.mark.parametrize(("pins", "gain", "ratio"), THRESHOLDS)
def test_second_order_agents_are_stable_above_the_known_threshold_and_unstable_below(
    pins, gain, ratio
):
    """p'' = -a M p - b M p' (theory, section 13)."""
    above = consensus(second_order(pins, gain, ratio * 1.01))
    assert above.verdict is Verdict.PROVED
    assert above.covered_by == "linearisation"
    below = consensus(second_order(pins, gain, ratio * 0.99))
    assert below.verdict is Verdict.REFUTED
    assert below.check("linearisation").verdict is Verdict.REFUTED


@pytest.mark.parametrize(("pins", "gain", "ratio"), THRESHOLDS)
def test_weights_prove_second_order_agents_from_one_over_the_rate_of_first_order_ones(
    pins, gain, ratio
):
    """R B = H' and A'R + R A - 2 c H'H < 0 have a solution iff c b^2 > a; the largest c is mu, the
    least real part of an eigenvalue of M: b^2/a > 1/mu, which is 3 to 5 times the true
    threshold."""
    held = []
    for i in range(1, 11):
        held.append(gain + pins.get(i, 0))
    shift = np.roll(np.eye(10), 1, axis=1)
    table = np.diag(held) - gain * shift
    least = 1 / np.linalg.eigvals(table).real.min()
    assert 3 * ratio < least < 5 * ratio
    above = consensus(second_order(pins, gain, 1.01 * least))
    assert above.check("theorem1-weighted").verdict is Verdict.PROVED
    below = consensus(second_order(pins, gain, 0.99 * least))
    assert below.check("theorem1-weighted").verdict is Verdict.UNDECIDED
    assert below.covered_by == "linearisation"


@pytest.mark.evidence
def test_random_agents_are_judged_as_their_eigenvalues_say():
    """2 to 12 agents, 2 to 4 states, 1 or 2 inputs; `make evidence` takes 300 of them."""
    tally = judged(range(20))
    assert tally.failures == []
    assert min(tally.verdicts["proved"], tally.verdicts["refuted"]) >= 5


def test_couplings_beyond_the_bound_are_proved_by_weights_for_agents_and_components():
    """2 kappa c > 1 for a solution R of the Riccati equation: V = e'(D (x) R)e."""
    sizes = []
    for problem in riccati_agents((2, 10, 15)):
        certificate = verified(problem)
        check = certificate.check("theorem1-weighted")
        assert certificate.verdict is check.verdict is Verdict.PROVED, problem.name
        assert set(check.exact) == {"D", "w", "c", "R"}
        assert check.rate > 0
        sizes.append((problem.n, problem.m))
    assert sizes == [(21, 2), (3, 4), (4, 2)]


@pytest.mark.parametrize(("part", "verdict"), [(1.01, Verdict.PROVED), (0.99, Verdict.REFUTED)])
def test_just_above_the_least_coupling_they_are_proved_and_just_below_refuted(part, verdict):
    sizes = (2, 4, 9)
    problems = riccati_agents(sizes, part=part)
    certificates = [verified(problem) for problem in problems]
    assert [each.verdict for each in certificates] == [verdict] * 3


def test_several_modes_share_the_weights():
    modes = {"A": [[2, 1], [3, 2]], "B": [[3, 1], [2, 3]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    certificate = consensus(chain(3, network=network, coupling="y1 + 3*y2"))
    check = certificate.check("theorem2-weighted")
    assert certificate.covered_by == "theorem2-weighted"
    assert set(check.exact["w"]) == set(modes)
    repelling = chain(3, network=network, coupling="y1 - y2/100", gains={1: 1})
    worse = consensus(repelling)
    assert worse.verdict is not Verdict.PROVED


@pytest.mark.parametrize("W", [None, [[3], [1]], [["1/2", 3], [0, 1]]])
def test_agents_with_a_disturbance_are_proved_as_fast_as_the_loop(W):
    """Without W, with one for the input, and with one for both components."""
    problem = chain(4, exosystem=HARMONIC, observer=W and Observer(W=W))
    certificate = verified(problem)
    matrix = loop_matrix(problem, certificate.claims.W)
    eigenvalues = np.linalg.eigvals(matrix)
    true = -eigenvalues.real.max()
    assert certificate.verdict is Verdict.PROVED
    assert 0 < certificate.rate <= true


def test_an_observer_that_does_not_converge_is_refuted():
    growing = Observer(W=[[-3], [1]])
    problem = chain(2, exosystem=HARMONIC, observer=growing)
    certificate = verified(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert "estimation error does not decay" in certificate.reason


def test_groups_with_different_exosystems():
    constant = Exosystem(A=[[0]], C=[[2]])
    observer = Observer(W=[[1]])
    group = Group(agents=[2, 3], exosystem=constant, observer=observer)
    others = Observer(W=[[3], [1]])
    mixed = chain(4, exosystem=HARMONIC, observer=others, groups=[group])
    certificate = verified(mixed)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.claims.W == ((0, 3, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1))


def test_a_formation_has_the_errors_of_its_centre():
    offsets = {2: [2, 0], 3: [-1, 0]}
    formed = chain(3, target=[1, 0], offsets=offsets)
    assert verified(chain(3)).rate == verified(formed).rate


HELD = {"-1": "proved", "1/2": "proved", "99/100": "proved", "1": "undecided", "101/100": "refuted"}


@pytest.mark.parametrize(("a", "verdict"), HELD.items())
def test_agents_that_flee_are_held_until_they_are_as_fast_as_their_couplings(a, verdict):
    """x_2' = a x_2 + (x_1 - x_2): stable iff a < 1; agent 1 has the gain 3."""
    one_state = Dynamics(A=[[a]])
    first_order = chain(2, dynamics=one_state, coupling="y")
    assert verified(first_order).verdict.value == verdict


def test_reachability_is_about_the_gains_that_are_given():
    """Without a pin agents may still settle by themselves."""
    decaying = Dynamics(A=[[-1]])
    first_order = chain(2, dynamics=decaying, coupling="y", gains=None)
    certificate = verified(first_order)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.check("reachability").verdict is Verdict.REFUTED


def test_double_integrators_without_a_pin_drift():
    certificate = verified(chain(2, gains=None))
    assert certificate.verdict is Verdict.REFUTED
    assert "(1, 0)" in certificate.reason


@cache
def unheld() -> tuple[Problem, Claims]:
    """Max-separable: every row holds; 1 is pinned with 4.  With what is claimed of the region by
    rows and margins."""
    region = {"initial_states": [-1, 1]}
    dynamics = Dynamics(A=[["1/2"]])
    problem = chain(3, dynamics=dynamics, coupling="y", gains={1: 4}, region=region)
    claims = consensus_claims(problem)
    asked = read_region(loop_of(problem), claims.W, domain=EVERYWHERE, everything=True)
    found = separable_stage(asked, lambda stage: None)
    found += margins_stage(asked, found, lambda stage: None)
    checks = (*claims.checks, *found)
    overall = decide_overall(loop_of(problem), checks, claims.W)
    return problem, with_verdict(replace(claims, checks=checks), overall)


SWINGING = Dynamics(A=[[0, 1], [-1, 0]], B=[[0], [1]])
DAMPED = Dynamics(A=[[0, 1], [-1, "-1/100"]], B=[[0], [1]])
# x'' = -x: agent 3, which hears nobody, swings for ever
UNREACHED = [({}, Verdict.REFUTED)]
UNREACHED.append(({"gains": {1: 1, 3: 1}}, Verdict.PROVED))
# it comes to rest by itself
UNREACHED.append(({"dynamics": DAMPED}, Verdict.PROVED))
# of other starts nothing is asked
UNREACHED.append(({"region": {"initial_states": [1, 2]}}, Verdict.UNDECIDED))


@pytest.mark.parametrize(("given", "verdict"), UNREACHED)
def test_oscillators_that_no_pin_reaches_come_to_rest_only_if_they_are_damped(given, verdict):
    parts = {"coupling": "y2", "gains": {1: 1}, "dynamics": SWINGING}
    arcs = [[2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    certificate = consensus(Problem(network=network, **parts | given))
    assert certificate.verdict is verdict
    assert ("A is not Hurwitz. Pin agent 3." in certificate.reason) is (verdict is Verdict.REFUTED)


def test_delays_are_examined_but_no_sampling_and_no_errors_of_gains():
    """A x is not held by a sampler, and a part of B K - A is no part of K."""
    problem, claims = unheld()
    assert verify(claims, problem).holds
    proved = [check.id for check in claims.checks if check.verdict is Verdict.PROVED]
    assert [id for id in proved if id in NAMES] == ["max-separable", "delay"]


SAMPLED = {"period": "1/100", "factor": "199/200"}
HALVED = {"weights": "1/2", "gains": "1/2", "alpha": "1/1000"}
FORGED = [("sampling", SAMPLED, None), ("tolerance", HALVED, 0.001)]


@pytest.mark.parametrize(("id", "exact", "rate"), FORGED)
def test_both_programs_refuse_such_claims(id, exact, rate):
    """With all gains halved agent 1 still has 2, but A = 1/2 is not halved; what is held is not A
    x."""
    problem, honest = unheld()
    forged = Check(
        id=id, verdict=Verdict.PROVED, domain=EVERYWHERE, rate=rate, claim=Values(exact), reason=""
    )
    claims = replace(honest, checks=(*honest.checks, forged))
    assert any(id in each for each in recheck(claims, problem).failures)
    said = checker.examine(certificate_bytes(claims), canonical_bytes(problem))
    refused = [title for holds, title in said if not holds]
    assert refused[0].startswith(id)


@pytest.mark.slow
def test_pendulums_stay_in_their_region():
    """x'' = -x - x'/2 + sum sin(p_j - p_i) + u: 50 starts on the boundary of the level set, on the
    whole loop."""
    n = 3
    both_ways = [[1, 2], [2, 1], [2, 3], [3, 2]]
    network = Network.from_arcs(both_ways, arrow="listens_to", agents=n)
    A = [[0, 1], [-1, "-1/2"]]
    B = [[0], [1]]
    spring = Dynamics(A=A, B=B)
    gains = {1: [[1, 1]]}
    region = {"initial_states": [["9/10", "11/10"], [0, 0]]}
    problem = Problem(
        network=network,
        dynamics=spring,
        coupling="sin(y1)",
        gains=gains,
        target=[1, 0],
        region=region,
    )
    certificate = verified(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "lure"
    claim = certificate.check("lure").claim
    level = float(claim.level)
    P = np.zeros((2 * n, 2 * n))
    for (i, j), value in claim.P_e.entries.items():
        P[i, j] = P[j, i] = float(value)
    goal = np.array([1.0, 0.0])
    (u0,) = spring.feedforward((Fraction(1), Fraction(0)))

    runs = 50
    rng = np.random.default_rng(0)
    e = rng.normal(size=(runs, 2 * n))
    scale = level / np.einsum("ti,ij,tj->t", e, P, e)
    e *= np.sqrt(scale)[:, None]

    def loop(_, state):
        x = state.reshape(runs, n, 2)
        u = np.full((runs, n), float(u0))
        errors_of_all = x[:, 0] - goal
        u[:, 0] -= errors_of_all.sum(axis=1)
        for i, j in both_ways:
            own_angle = x[:, j - 1, 0]
            angle = x[:, i - 1, 0]
            difference = own_angle - angle
            u[:, i - 1] += np.sin(difference)
        speeds = x[:, :, 1]
        forces = u - x[:, :, 0] - speeds / 2
        return np.stack([speeds, forces], axis=2).ravel()

    goals = np.tile(goal, n)
    first = (e + goals).ravel()
    run = solve_ivp(loop, (0, 40), first, method="DOP853", rtol=1e-8, atol=1e-10)
    errors = run.y.T.reshape(-1, runs, 2 * n) - goals
    found_level = np.einsum("tki,ij,tkj->tk", errors, P, errors)
    allowed_level = level * (1 + 1e-7)
    assert found_level.max() <= allowed_level
    last = np.abs(errors[-1]).max()
    allowed = 0.01 * np.abs(e).max()
    assert last < allowed


def test_a_stronger_nonlinear_coupling_of_vectors_is_read_near_the_target():
    gains = {1: [[3, 6]]}
    problem = chain(3, coupling="sin(y1) + 2*y2", gains=gains)
    certificate = verified(problem)
    check = certificate.check("theorem1-weighted")
    assert certificate.verdict is check.verdict is Verdict.PROVED
    assert check.domain == NEAR_TARGET


def test_certificates_are_about_the_problem_that_is_given():
    problem = chain(3)
    certificate = certify(problem)
    assert certificate.problem == problem
    assert certificate.problem.dynamics == DOUBLE
    A = [[0, 1], [0, -1]]
    B = [[0], [1]]
    other = Dynamics(A=A, B=B)
    assert not verify(certificate, chain(3, dynamics=other)).holds
