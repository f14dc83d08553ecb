"""Proposals for the max-separable certificate: v, P, beta, kappa; what they must reach."""

from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from linked import loop_by_hand
from scipy.integrate import solve_ivp
from separable_problems import (
    PAPER,
    cycle,
    float_gains,
    listening,
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
    largest_rate,
    verify_composite,
)
from dobc_design.conditions.separable.propose import (
    SeparablePlan,
    design_separable,
    field_of,
    first_certificate,
    propose_separable,
    rounded_vectors,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.exact.matrix import to_float

F = Fraction
SWITCHING = load_problem("paper-switching")
W = SWITCHING.observer.W


def proved_rate(problem: Problem, rho: str, *, share: float = 0.995) -> float:
    """The rate of the first rounding that keeps ``share`` of what floating point sees."""
    plan = propose_separable(problem, rho=F(rho))
    rates = (largest_rate(problem, v, rho=F(rho)) for v in rounded_vectors(plan))
    return float(next(alpha for alpha in rates if alpha is not None and alpha >= share * plan.rate))


@pytest.mark.parametrize(
    ("gains", "rho", "rate"), [(None, "1", 0.184), (None, "4", 0.108), (None, "10", 0.064), (5, "10", 5)]
)
def test_the_ten_cycle_has_the_rates_of_the_theory(gains, rho: str, rate: float):
    """Theory, known answers: within 1 %, and proved; one pin, or all pinned with 5."""
    assert proved_rate(cycle(gains=gains), rho) == pytest.approx(rate, rel=0.01)


MODES = [(["Ga"], 0.216), (["Gb"], 0.186), (["Gc"], 0.268), (["Gd"], 0.268), (["Ga", "Gb"], 0.054)]


@pytest.mark.parametrize(("modes", "rate"), MODES)
def test_the_modes_of_example_2_have_the_rates_of_the_theory(modes, rate: float):
    network = replace(SWITCHING.network, modes={name: SWITCHING.network.modes[name] for name in modes})
    gains = {SWITCHING.network.labels[i]: k for i, k in SWITCHING.pinning.gains.items()}
    problem = Problem(network=network, coupling=PAPER, gains=gains, target=0)
    assert proved_rate(problem, "4") == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize("seed", range(12))
def test_a_single_linear_mode_has_the_spectral_abscissa_as_rate(seed: int):
    """Perron and Frobenius: the largest alpha with M v <= -alpha v is -max Re of the spectrum of M."""
    r = Random(seed)
    n = r.randint(3, 9)
    network = random_network(r, n=n, modes=1, density=0.5, weights=(1, "1/2", 3))
    problem = Problem(network=network, coupling="y", gains={1: 5, 2: 1}, target=0)
    truth = -float(np.max(np.linalg.eigvals(loop_by_hand(problem)).real))
    proposal = propose_separable(problem, rho=1.0)
    if proposal is None:
        assert truth < 1e-5
        return
    # min v = 1 and v > 0 need no more than that the slowest agents count; a reducible M may have v_i = 1 there.
    assert proposal.rate == pytest.approx(truth, rel=1e-4)
    assert proved_rate(problem, "1") == pytest.approx(truth, rel=0.006)


def test_sin_with_one_pin_is_certified_up_to_almost_half_pi():
    """The monotone rows stop at pi/4; at pi/2 the false equilibria begin to matter and nothing is proposed."""
    assert proved_rate(cycle(h="sin(y)"), "1.56", share=0.9) > 0
    assert propose_separable(cycle(h="sin(y)"), rho=1.58) is None


def test_nothing_is_proposed_where_an_agent_is_not_held():
    assert propose_separable(cycle(gains={}), rho=1.0) is None
    assert design_separable(cycle(gains={}), radius=F(1)) is None
    assert propose_separable(pair("-y", k=5), rho=1.0) is None


def test_built_in_problems_have_a_region():
    """microgrid-ieee14 (sin, matched weights) and uav-swarm (tanh, m = 3)."""
    assert proved_rate(load_problem("uav-swarm"), "4") > 0.39
    assert proved_rate(load_problem("microgrid-ieee14"), "1.5", share=0.8) > 0.15


def test_the_observers_part_is_that_of_the_theory_or_better():
    """Theory, known answers: kappa s sqrt(lambda_max(P)) = 0.406 for s = 1/2 with the paper's W."""
    bound = propose_error_bound(SWITCHING.exosystem, W)
    assert error_bound_obstacle(SWITCHING.exosystem, W, bound) is None
    needed = radius_needed(F(4), bound, F(1, 2))
    assert F("4.40") < needed < F("4.407")
    assert radius_needed(F(4), None, F(1, 2)) == 4


@pytest.mark.parametrize("rate", [0.0, 0.03, 1.0])
def test_proposed_bounds_hold_exactly_and_let_v_decay_at_the_rate_asked(rate: float):
    bound = propose_error_bound(SWITCHING.exosystem, W, rate=rate)
    assert error_bound_obstacle(SWITCHING.exosystem, W, bound) is None
    claim = Separable(v=(F(1),), alpha=F(9), rho=F(9), error=bound)
    assert composite_rate(claim) > rate


def test_a_bound_of_several_outputs_and_of_unseen_states_holds():
    """m = 2, and a third state that C does not see."""
    exosystem = Exosystem(A=[[0, 1, 0], [-1, 0, 0], [0, 0, -2]], C=[[1, 0, 0], [0, 2, 0]])
    W = ((F(2), F(0)), (F(0), F(1)), (F(0), F(0)))
    assert error_bound_obstacle(exosystem, W, propose_error_bound(exosystem, W)) is None


def test_no_bound_is_proposed_for_an_observer_that_diverges_or_is_slower():
    exosystem = Exosystem(A=[[0]], C=[[1]])
    found = [propose_error_bound(exosystem, ((F(w),),), rate=rate) for w, rate in ((-1, 0.0), (1, 1.5), (1, 0.5))]
    assert found[:2] == [None, None] and found[2] is not None


@pytest.mark.parametrize("rate", [0.05, 0.0721])
def test_a_badly_conditioned_p_keeps_enough_room_for_its_rounding(rate):
    """Three poles next to each other: P has eigenvalues 0.003 and 5.7, and 1e-5 of room is too little."""
    exosystem = Exosystem(A=[[0, 0, 0], [0, 0, "0.24"], [0, "-0.24", 0]], C=[[1, 1, 0]])
    W = ((F(53, 5),), (F(-9),), (F(69, 10),))
    assert error_bound_obstacle(exosystem, W, propose_error_bound(exosystem, W, rate=rate)) is None


@pytest.fixture(scope="module")
def example_2() -> tuple[Separable, float]:
    plan = design_separable(SWITCHING, radius=F(4), disturbance=F(1, 2), W=W)
    return first_certificate(SWITCHING, W, plan), plan.rate


def test_example_2_is_proved_from_the_papers_own_starts(example_2):
    """The whole way: P, beta, kappa, rho, v, alpha; [0, 5] about 1 and |eps| <= 1/2; the rate of V is alpha."""
    claim, rate = example_2
    assert verify_composite(SWITCHING, W, claim).verdict is Verdict.PROVED
    assert covers(claim, radius=F(4), disturbance=F(1, 2))
    assert composite_rate(claim) == claim.alpha
    assert float(claim.alpha) == pytest.approx(0.0301, rel=0.01)
    assert 0.997 * rate <= claim.alpha <= rate * 1.0001


def test_without_an_exosystem_the_radius_is_the_box():
    plan = design_separable(cycle(), radius=F(4))
    assert (plan.rho, plan.error) == (4, None)
    assert covers(first_certificate(cycle(), None, plan), radius=F(4), disturbance=F(0))


def test_no_certificate_comes_out_of_vectors_that_do_not_hold():
    for v in (np.ones(10), np.arange(1.0, 11.0)):
        assert first_certificate(cycle(), None, SeparablePlan(v=v, rate=0.1, rho=F(4))) is None
    # An exosystem without a gain has no plan.
    assert design_separable(SWITCHING, radius=F(4), disturbance=F(1, 2)) is None


def field(problem: Problem, mode: str):
    """e' of one mode without disturbance."""
    arcs = problem.network.modes[mode]
    i, j, w = arcs.listeners, arcs.speakers, np.array([float(x) for x in arcs.weights])
    kinds = [problem.coupling_of(*arc) for arc in zip(i.tolist(), j.tolist(), strict=True)]
    functions = [(h.numpy_function(), np.array([kind == h for kind in kinds])) for h in problem.couplings]
    gains = float_gains(problem)

    def slope(e: np.ndarray) -> np.ndarray:
        y = (e[j] - e[i])[:, None]
        pull = sum(np.where(mine, h(y)[:, 0], 0.0) for h, mine in functions)
        return np.bincount(i, weights=w * pull, minlength=problem.n) - gains * e

    return slope


def test_simulations_of_example_2_with_its_observer_stay_inside(example_2):
    """V = N + kappa E from 12 starts with |e| = 4, |eps| = 1/2; modes switch every 0.5 s."""
    claim, rate = example_2[0], float(composite_rate(example_2[0]))
    A, C = to_float(SWITCHING.exosystem.A), to_float(SWITCHING.exosystem.C)
    decay = A - to_float(W) @ C
    slopes = [field(SWITCHING, mode) for mode in SWITCHING.network.modes]
    height, P = np.array([float(x) for x in claim.v]), to_float(claim.error.P)
    rng = np.random.default_rng(0)

    def value(x: np.ndarray) -> float:
        eps = x[10:].reshape(10, 2)
        largest = np.sqrt(np.max(np.sum(eps @ P * eps, axis=1)))
        return float(np.max(np.abs(x[:10]) / height) + float(claim.error.kappa) * largest)

    for _ in range(12):
        direction = rng.normal(size=(10, 2))
        eps = 0.5 * direction / np.linalg.norm(direction, axis=1)[:, None]
        x = np.concatenate([4 * rng.choice((-1, 1, rng.uniform(-1, 1)), size=10), eps.ravel()])
        assert value(x) <= float(claim.rho)
        for _ in range(4):
            slope, before = slopes[rng.integers(4)], value(x)

            def loop(t: float, x: np.ndarray, slope=slope) -> np.ndarray:
                eps = x[10:].reshape(10, 2)
                return np.concatenate([slope(x[:10]) + eps @ C[0], (eps @ decay.T).ravel()])

            answer = solve_ivp(loop, (0, 0.5), x, rtol=1e-8, atol=1e-11, max_step=0.05)
            values = np.array([value(column) for column in answer.y.T])
            assert np.all(values <= before * np.exp(-rate * answer.t) * (1 + 1e-6))
            x = answer.y[:, -1]


@pytest.mark.parametrize("h", [pytest.param(PAPER, marks=pytest.mark.slow), "sin(y)"])
def test_the_search_for_many_agents_comes_near_the_rate_of_that_for_few(monkeypatch, h: str):
    """A grid of 9 x 9 agents that hear their neighbours, every fifth pinned, by both; near 5 %."""
    side = range(9)
    steps = [(a, b, *to) for a in side for b in side for to in ((a + 1, b), (a - 1, b), (a, b + 1), (a, b - 1))]
    arcs = [[9 * a + b + 1, 9 * c + d + 1] for a, b, c, d in steps if c in side and d in side]
    problem = listening(arcs, h, n=81, gains=dict.fromkeys(range(1, 82, 5), 3), target=0)
    exact = propose_separable(problem, rho=1.2).rate
    monkeypatch.setattr(propose, "FEW_AGENTS", 0)
    monkeypatch.setattr(propose, "FACTORED_AGENTS", 0)
    for near in (None, 1.3 * exact, 0.5 * exact):
        proposal = propose_separable(problem, rho=1.2, near=near)
        assert 0.9 * exact <= proposal.rate <= exact * 1.001
        field, v = field_of(problem, rho=1.2), proposal.v
        rates = [np.min(field.gains - field.values(0, face, v) / v) for face in (1, -1)]
        assert min(rates) >= 0.99 * proposal.rate
