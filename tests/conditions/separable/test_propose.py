"""Proposals for the max-separable certificate: v, P, beta, kappa; what they must reach."""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from random import Random

import numpy as np
import pytest
from certified import certified
from networks import (
    PAPER,
    cycle,
    listening,
    loop_by_hand,
    pair,
    random_network,
)

from dobc_design import Exosystem, Problem, Verdict, load_problem
from dobc_design.conditions.separable import propose
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import (
    composite_rate,
    covers,
    error_bound_obstacle,
    verify_composite,
)
from dobc_design.conditions.separable.propose import (
    Cover,
    SeparablePlan,
    field_of,
    first_certificate,
    propose_separable,
    rounded_vectors,
)
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.loop.make import loop_of

F = Fraction
SWITCHING = load_problem("paper-switching")
W = SWITCHING.observer.W


def proved_rate(problem: Problem, rho: str) -> float:
    """The rate of the first rounding that keeps nearly all of what floating point sees."""
    plan = propose_separable(loop_of(problem), rho=F(rho))
    return rate_of(problem, plan, rho)


def rate_of(problem: Problem, plan: SeparablePlan, rho: str) -> float:
    """The same for a plan at hand."""
    for v in rounded_vectors(plan):
        alpha = largest_rate(loop_of(problem), v, rho=F(rho))
        if alpha is not None and alpha >= 0.995 * plan.rate:
            return float(alpha)
    raise AssertionError("no rounding keeps the rate")


RATES = [(None, "1", 0.184), (None, "4", 0.108), (None, "10", 0.064), (5, "10", 5)]


@pytest.mark.parametrize(("gains", "rho", "rate"), RATES)
def test_the_ten_cycle_has_the_rates_of_the_theory(gains, rho: str, rate: float):
    """Theory, known answers: within 1 %, and proved; one pin, or all pinned with 5."""
    found = proved_rate(cycle(gains=gains), rho)
    assert found == pytest.approx(rate, rel=0.01)


MODES = [(["Ga"], 0.216), (["Gb"], 0.186), (["Gc"], 0.268), (["Gd"], 0.268), (["Ga", "Gb"], 0.054)]


@pytest.mark.parametrize(("modes", "rate"), MODES)
def test_the_modes_of_example_2_have_the_rates_of_the_theory(modes, rate: float):
    graphs = {name: SWITCHING.network.modes[name] for name in modes}
    network = replace(SWITCHING.network, modes=graphs)
    pinned = SWITCHING.pinning.gains.items()
    gains = {SWITCHING.network.labels[i]: k for i, k in pinned}
    problem = Problem(network=network, coupling=PAPER, gains=gains, target=0)
    assert proved_rate(problem, "4") == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (2, 3))]
)
def test_a_single_linear_mode_has_the_spectral_abscissa_as_rate(seed: int):
    """Perron and Frobenius: the largest alpha with M v <= -alpha v is -max Re of the spectrum of
    M."""
    r = Random(seed)
    n = r.randint(3, 9)
    weights = (1, "1/2", 3)
    network = random_network(r, n=n, modes=1, density=0.5, weights=weights)
    gains = {1: 5, 2: 1}
    problem = Problem(network=network, coupling="y", gains=gains, target=0)
    eigenvalues = np.linalg.eigvals(loop_by_hand(problem)).real
    truth = -float(np.max(eigenvalues))
    proposal = propose_separable(loop_of(problem), rho=1.0)
    if proposal is None:
        assert truth < 1e-5
        return
    # min v = 1 and v > 0 need no more than that the slowest agents count; a reducible M may have
    # v_i = 1 there.
    assert proposal.rate == pytest.approx(truth, rel=1e-4)
    assert rate_of(problem, proposal, "1") == pytest.approx(truth, rel=0.006)


def test_nothing_is_proposed_where_an_agent_is_not_held():
    unpinned = loop_of(cycle(gains={}))
    assert propose_separable(unpinned, rho=1.0) is None
    found = Cover(loop=unpinned, radius=F(1)).fastest()
    assert found is None
    loop = loop_of(pair("-y", k=5))
    found = propose_separable(loop, rho=1.0)
    assert found is None


def test_the_observers_part_is_that_of_the_theory_or_better():
    """Theory, known answers: kappa s sqrt(lambda_max(P)) = 0.406 for s = 1/2 with the paper's W."""
    bound = propose_error_bound(SWITCHING.exosystem, W)
    assert error_bound_obstacle(SWITCHING.exosystem, W, bound) is None
    needed = radius_needed(F(4), bound, F(1, 2))
    assert F("4.40") < needed < F("4.407")
    found = radius_needed(F(4), None, F(1, 2))
    assert found == 4


def test_a_bound_of_several_outputs_and_of_unseen_states_holds():
    """m = 2, and a third state that C does not see."""
    C = [[1, 0, 0], [0, 2, 0]]
    A = [[0, 1, 0], [-1, 0, 0], [0, 0, -2]]
    exosystem = Exosystem(A=A, C=C)
    first_row = (F(2), F(0))
    second_row = (F(0), F(1))
    third_row = (F(0), F(0))
    W = (first_row, second_row, third_row)
    bound = propose_error_bound(exosystem, W)
    assert error_bound_obstacle(exosystem, W, bound) is None


def test_no_bound_is_proposed_for_an_observer_that_diverges_or_is_slower():
    exosystem = Exosystem(A=[[0]], C=[[1]])
    found = propose_error_bound(exosystem, ((F(-1),),))
    assert found is None
    found = propose_error_bound(exosystem, ((F(1),),), rate=1.5)
    assert found is None
    found = propose_error_bound(exosystem, ((F(1),),), rate=0.5)
    assert found is not None


@pytest.mark.parametrize("rate", [0.05, 0.0721])
def test_a_badly_conditioned_p_keeps_enough_room_for_its_rounding(rate):
    """Three poles next to each other: P has eigenvalues 0.003 and 5.7, and 1e-5 of room is too
    little."""
    C = [[1, 1, 0]]
    A = [[0, 0, 0], [0, 0, "0.24"], [0, "-0.24", 0]]
    exosystem = Exosystem(A=A, C=C)
    first_row = (F(53, 5),)
    third_row = (F(69, 10),)
    W = (first_row, (F(-9),), third_row)
    bound = propose_error_bound(exosystem, W, rate=rate)
    assert error_bound_obstacle(exosystem, W, bound) is None


def assert_holds_starts_of_the_paper(problem: Problem, claim: Separable) -> None:
    """[0, 5] about 1 and |eps| <= 1/2; the rate of V is alpha."""
    found = verify_composite(loop_of(problem), W, claim)
    assert found.verdict is Verdict.PROVED
    assert covers(claim, radius=F(4), disturbance=F(1, 2))
    assert composite_rate(claim) == claim.alpha


def test_example_2_is_proved_from_the_papers_own_starts():
    claim = certified("paper-switching").check("max-separable").claim
    assert_holds_starts_of_the_paper(SWITCHING, claim)
    assert float(claim.alpha) == pytest.approx(0.0301, rel=0.01)


def test_a_claim_has_the_rate_that_is_planned():
    """The whole way: P, beta, kappa, rho, v, alpha; for two agents that hear each other."""
    problem = cycle(2, exosystem=SWITCHING.exosystem)
    loop = loop_of(problem)
    cover = Cover(loop=loop, radius=F(4), disturbance=F(1, 2), W=W)
    plan = cover.fastest()
    claim = first_certificate(loop, W, plan)
    assert_holds_starts_of_the_paper(problem, claim)
    assert 0.997 * plan.rate <= claim.alpha <= plan.rate * 1.0001


def test_no_certificate_comes_out_of_vectors_that_do_not_hold():
    for v in (np.ones(10), np.arange(1.0, 11.0)):
        plan = SeparablePlan(v=v, rate=0.1, rho=F(4))
        assert first_certificate(loop_of(cycle()), None, plan) is None
    # An exosystem without a gain has no plan.
    cover = Cover(loop=loop_of(SWITCHING), radius=F(4), disturbance=F(1, 2))
    assert cover.fastest() is None


def grid_of_agents(h: str) -> Problem:
    """6 x 6 agents that hear their neighbours, every fifth pinned."""
    arcs = []
    for a, b in product(range(6), repeat=2):
        right = (a + 1, b)
        left = (a - 1, b)
        up = (a, b + 1)
        cases = (right, left, up, (a, b - 1))
        for c, d in cases:
            if c in range(6) and d in range(6):
                listener = 6 * a + b + 1
                speaker = 6 * c + d + 1
                arcs.append([listener, speaker])
    gains = dict.fromkeys(range(1, 37, 5), 3)
    return listening(arcs, h, n=36, gains=gains, target=0)


@pytest.mark.parametrize("h", [pytest.param(PAPER, marks=pytest.mark.slow), "sin(y)"])
def test_the_search_for_many_agents_comes_near_that_for_few(monkeypatch, h: str):
    """A grid of agents: the time to one percent is near."""
    loop = loop_of(grid_of_agents(h))
    few = propose_separable(loop, rho=1.2)
    exact = few.rate
    monkeypatch.setattr(propose, "FEW_AGENTS", 0)
    monkeypatch.setattr(propose, "FACTORED_AGENTS", 0)
    for near in (None, 1.3 * exact, 0.5 * exact):
        proposal = propose_separable(loop, rho=1.2, near=near)
        assert 0.8 * exact <= proposal.rate <= exact * 1.001
        assert proposal.time <= 1.1 * few.time
        field = field_of(loop, rho=1.2)
        v = proposal.v
        for face in (1, -1):
            rates = field.gains - field.values(0, face, v) / v
            assert np.min(rates) >= 0.99 * proposal.rate
