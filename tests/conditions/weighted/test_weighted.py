"""Weighted Theorems 1 and 2: known rates, proofs and their twins that just fail, both programs,
both sizes."""

from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from certified import certified
from networks import loop_by_hand
from scipy import linalg

from dobc_design import Check, Network, Problem, Verdict, load_problem, verify
from dobc_design.certification.recheck import recheck
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.weighted import decide
from dobc_design.conditions.weighted.checks import confirm
from dobc_design.conditions.weighted.decide import Weighted, rows_hold
from dobc_design.conditions.weighted.propose import proposals
from dobc_design.conditions.weighted.stage import weighted_stage
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.make import loop_of
from dobc_design.problem.exosystems import harmonics
from dobc_design.problem.simulation import Simulation

PAPER = load_problem("paper-switching")
#: mu of theory, section 10: gains {label: k}, then by mode.
KNOWN = [
    ({"1": 3}, {"Ga": 0.185974, "Gb": 0.124698, "Gc": 0.193989, "Gd": 0.215505}),
    ({"1": 5, "6": 5}, {"Ga": 0.509870, "Gb": 0.462083, "Gc": 0.573223, "Gd": 0.573223}),
]


def row(problem: Problem) -> Check | None:
    """The check of a weighted theorem, if the certificate has one."""
    for check in certified(problem).checks:
        if check.id.endswith("weighted"):
            return check
    return None


def true_rate(problem: Problem) -> float:
    """Mu: the least real part of an eigenvalue of M, by NumPy; slopes at 0 are 2."""
    matrix = -loop_by_hand(problem, slope=2.0)
    eigenvalues = np.linalg.eigvals(matrix)
    return float(eigenvalues.real.min())


def fastest(problem: Problem) -> Check:
    """The check with the largest rate: no claim has the one that is wanted."""
    theorems = state_theorems(loop_of(problem))
    (check,) = weighted_stage(theorems, problem.joint_observer.W, rate=1e9)
    return check


def without_observer(problem: Problem, **changes: object) -> Problem:
    simulation = Simulation(t_final=1, seed=0, xi0=None)
    nothing = {"exosystem": None, "observer": None, "region": None, "simulation": simulation}
    return problem.replace(**nothing | changes)


def digraph(
    seed: int, *, n: int | None = None, h: str = "exp(y) - 1 + y", **more: object
) -> Problem:
    """Weighted arcs at random, reducible or strongly connected, a few pins, some agents perhaps not
    reached."""
    r = Random(f"weighted {seed}")
    n = n or r.randint(2, 25)
    arcs = {}
    for i in range(n):
        for _ in range(r.randint(0, 3)):
            arcs[i, r.randrange(n)] = r.randint(1, 40)
    if seed % 2:
        arcs |= {(i, (i + 1) % n): r.randint(1, 40) for i in range(n)}
    sorted_arcs = sorted(arcs.items())
    listed = [[i + 1, j + 1, Fraction(w, 8)] for (i, j), w in sorted_arcs if i != j]
    pins = r.randint(1, max(1, n // 4))
    gains = {}
    for _ in range(pins):
        gains[r.randint(1, n)] = Fraction(r.randint(1, 40), 4)
    network = Network.from_arcs(listed, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, gains=gains, **more)


@pytest.mark.parametrize(("gains", "rates"), KNOWN)
def test_the_rates_of_the_theory(gains, rates):
    for mode, mu in rates.items():
        mode_arcs = PAPER.network.modes[mode]
        arcs = [[i + 1, j + 1, w] for i, j, w in mode_arcs]
        network = Network.from_arcs(arcs, arrow="listens_to", agents=10)
        check = fastest(without_observer(PAPER, network=network, gains=gains, switching=None))
        assert 0.9998 * mu < check.rate < 1.00001 * mu


def test_paper_fixed_gains_half_of_its_rate():
    assert fastest(load_problem("paper-fixed")).rate >= 0.5098


def fan(second, third):
    """Agent ``second`` hears 1 faintly, and ``third`` hears it loudly."""
    return [[second, 1, "1/10"], [third, second, 9]]


@pytest.mark.parametrize(
    ("m0", "m1", "gain", "verdict", "said"),
    [
        (
            [[1, 2, 6], [2, 3, "1/5"], [3, 1, 28]],
            [[1, 3, 2], [2, 1, "1/3"], [3, 1, 3]],
            "1/10",
            Verdict.PROVED,
            "with |e_i| <= 0.001 for every agent (max-separable)",
        ),
        # D = diag(., 1, d) would need 4 * 0.1 > 9 d and 4 * 0.1 d > 9; a common v: v_3 > v_2 > v_3
        (fan(2, 3), fan(3, 2), 1, Verdict.UNDECIDED, "serve the modes m0 and m1 together"),
    ],
)
def test_modes_without_common_weights_are_proved_by_a_common_v_or_named(
    m0, m1, gain, verdict, said
):
    modes = {"m0": m0, "m1": m1}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    problem = Problem(network=network, coupling="tanh(y)", gains={1: gain})
    certificate = certified(problem)
    assert certificate.check("theorem2-weighted").verdict is Verdict.UNDECIDED
    assert (certificate.verdict, said in certificate.reason) == (verdict, True)
    assert verify(certificate, problem).holds


def test_a_chain_of_ten_has_the_rate_of_one_agent():
    """Chain, gain 2, head pinned k = 3: mu = 2, although V = e'e shows 0.0888."""
    arcs = [[i + 1, i] for i in range(1, 10)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=10)
    chain = Problem(network=network, coupling="2*y", gains={1: 3})
    assert 1.98 <= fastest(chain).rate < 2


@pytest.mark.parametrize("ends", [False, True])
def test_a_long_way_from_the_pin_is_proved_though_no_doubles_hold_the_fastest_weights(ends):
    """Chain and ring that hear one way: near the true rate, weights grow by a factor from agent to
    agent."""
    n = 1200
    arcs = [[i + 1, i] for i in range(1, n)]
    if ends:
        arcs.append([1, n])
    network = Network.from_arcs({"G": arcs}, arrow="listens_to", agents=n)
    problem = Problem(network=network, coupling="y", gains={1: 2})
    loop = loop_of(problem)
    statements = state_theorems(loop)
    (check,) = weighted_stage(statements, None)
    assert check.verdict is Verdict.PROVED
    assert check.rate > 0
    assert confirm(check, loop, None, statements=statements) is None
    too_fast = replace(check, rate=2.0)
    assert confirm(too_fast, loop, None, statements=statements) is not None


@pytest.mark.parametrize("seed", range(8))
def test_random_digraphs_are_proved_iff_reached_and_at_the_true_rate(seed):
    problem = digraph(seed)
    mu = true_rate(problem)
    certificate = certified(problem)
    if mu > 1e-9:
        assert certificate.verdict is Verdict.PROVED
        assert 0.99 * mu < fastest(problem).rate < mu * (1 + 1e-9)
        assert recheck(certificate.claims, problem).holds
    else:
        assert certificate.verdict is Verdict.REFUTED


def proposal(problem, W=None):
    statements = state_theorems(loop_of(problem))
    claim, rate = next(iter(proposals(statements, W)))
    return statements, claim, Fraction(repr(rate))


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_a_claim_fails_above_the_true_rate_and_with_a_wrong_number(seed):
    problem = digraph(seed)
    statements, claim, rate = proposal(problem)
    mu = Fraction(true_rate(problem))
    assert claim.holds(statements, None, rate=rate)
    slightly_more = Fraction(1, 10**6)
    assert not claim.holds(statements, None, rate=mu * (1 + slightly_more))
    (mode,) = claim.w
    w = list(claim.w[mode])
    w[0] *= 100
    wrong = replace(claim, w={mode: tuple(w)})
    assert not wrong.holds(statements, None, rate=rate)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_accepted_is_definite_for_an_eigenvalue_solver(seed):
    """D around the proposed ones, and other rates; w from a linear solve."""
    r = Random(seed)
    problem = digraph(2 * seed + 1, n=6)
    M = -loop_by_hand(problem, slope=2.0)
    statements, start, best = proposal(problem)
    (mode,) = problem.network.modes
    tally = []
    for _ in range(40):
        D = []
        for x in start.D:
            D.append(x * Fraction(r.randint(97, 103), 100))
        rate = best * Fraction(r.randint(5, 100), 100)
        root = np.diag(np.array(D, float))
        shifted = M - float(rate) * np.eye(6)
        half = root @ shifted
        N = half + half.T
        solution = np.linalg.lstsq(N, np.ones(6), rcond=None)
        w = solution[0]
        least = float(np.linalg.eigvalsh(N).min())
        if min(w) > 0 and abs(least) > 1e-9:
            exact = tuple(Fraction(float(x)) for x in w)
            claim = Weighted(D=tuple(D), w={mode: exact})
            accepted = claim.holds(statements, None, rate=rate)
            assert accepted is (least > 0)
            tally.append(accepted)
    assert any(tally)


def test_the_block_condition_of_the_observer_holds():
    """[[-(DM + M'D) + 2 beta D, D (x) C], [., I (x) (Omega0 + 2 beta P)]] < 0 by an eigenvalue
    solver."""
    certificate = certified("paper-fixed")
    problem = certificate.problem
    check = certificate.check("theorem1-weighted")
    D = np.diag(np.array(check.claim.D, float))
    P = np.array(check.claim.P, float)
    A = np.array(problem.exosystem.A, float)
    C = np.array(problem.exosystem.C, float)
    W = np.array(certificate.claims.W, float)
    M = -loop_by_hand(problem, slope=2.0)
    F = A - W @ C
    beta = check.rate
    corner = -(D @ M + M.T @ D) + 2 * beta * D
    omega = P @ F + F.T @ P + 2 * beta * P
    border = np.kron(D, C)
    errors = np.kron(np.eye(10), omega)
    lower = [border.T, errors]
    block = np.block([[corner, border], lower])
    # In coordinates in which V is the square of the length, so that entries are of one size.
    factor = linalg.cholesky(P).T
    inverse = np.linalg.inv(factor)
    observers = np.kron(np.eye(10), inverse.T)
    scaling = np.diag(np.diag(D) ** -0.5)
    unit = linalg.block_diag(scaling, observers)
    assert np.linalg.eigvalsh(unit.T @ block @ unit).max() < 0


@pytest.mark.parametrize("seed", [1, 3, 4, 7])
def test_rounded_rows_of_large_networks_agree_with_exact_ones(seed, monkeypatch):
    problem = digraph(seed, n=40, h="sin(y)")
    if seed % 2 == 0:
        problem = problem.replace(gains=1)
    statements, claim, rate = proposal(problem)
    (mode,) = statements.jacobians.modes
    numbers = [float(x) for x in claim.D]
    D = Doubles(np.array(numbers))
    weights_of_mode = claim.w[mode.name]
    numbers_of_w = [float(x) for x in weights_of_mode]
    w = Doubles(np.array(numbers_of_w))

    def hold(weights: Doubles, rate: Fraction) -> bool:
        sigma = (Fraction(0),)
        return rows_hold(mode, statements.loop, weights, w, rate=rate, sigma=sigma)

    assert hold(D, rate)
    monkeypatch.setattr(decide, "MANY_AGENTS", 0)
    assert hold(D, rate)
    assert not hold(D, rate * 2)
    # products below the smallest float
    assert not hold(Doubles(D.array * 1e-150), rate)


@pytest.mark.parametrize("h", ["-y", "y**3 - y"])
def test_couplings_that_repel_have_no_such_check(h):
    problem = digraph(1, n=4, h=h)
    assert row(problem) is None


def test_a_problem_with_an_observer_that_is_slower_takes_its_rate():
    problem = digraph(3, n=5, exosystem=harmonics(2))
    check = row(problem)
    hurwitz = next(each for each in certified(problem).checks if each.id == "hurwitz")
    assert check.rate < hurwitz.rate
