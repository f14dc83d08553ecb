"""Delays and sampling: rates and periods that are proved, their twins, and simulations that obey
them."""

from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from networks import (
    MONOTONE,
    PAPER,
    TURNING,
    cycle,
    float_gains,
    fractions,
    listening,
    pair,
    random_problem,
)
from scipy.optimize import brentq

from dobc_design import Problem, Verdict
from dobc_design.conditions.separable.claim import DelayBound, ErrorBound, SamplingBound, Separable
from dobc_design.conditions.separable.propose import propose_separable, rounded_vectors
from dobc_design.conditions.separable.propose_limits import largest_rate, longest_delay
from dobc_design.conditions.separable.timing import (
    largest_period,
    verify_delay,
    verify_sampling,
)
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of

F = Fraction


def certified(problem: Problem, rho: Fraction) -> Separable:
    v = list(rounded_vectors(propose_separable(loop_of(problem), rho=float(rho))))[2]
    return Separable(v=v, alpha=largest_rate(loop_of(problem), v, rho=rho), rho=rho)


def test_the_delayed_rate_of_two_agents_is_halanays():
    """h = y, e_2' = v_1-bound - e_2: lambda = 1 - exp(lambda tau)/2 for v = (1, 2); at tau = 1 that
    is 0.31492."""
    claim = Separable(v=fractions(1, 2), alpha=F(1, 2), rho=None)
    truth = brentq(lambda rate: rate - 1 + np.exp(rate) / 2, 0, 0.5)
    for part, verdict in ((0.999999, Verdict.PROVED), (1.000001, Verdict.REFUTED)):
        bound = DelayBound(delay=F(1), rate=F(part * truth))
        assert verify_delay(loop_of(pair("y", k=9)), claim, bound).verdict is verdict
    found = longest_delay(loop_of(pair("y", k=9)), claim, rate=F("0.3"))
    assert 0.4 < float(found.delay) / (np.log(1.4) / 0.3) <= 1


def test_every_delay_leaves_a_positive_rate():
    claim = certified(cycle(4), F(1))
    delays = [
        longest_delay(loop_of(cycle(4)), claim, rate=claim.alpha * part).delay
        for part in (F("0.99"), F(1, 2), F(1, 20))
    ]
    assert 0 < delays[0] < delays[1] < delays[2]
    assert longest_delay(loop_of(cycle(4)), claim, rate=claim.alpha * F("1.01")) is None


def test_the_rate_with_delays_may_not_exceed_the_observers():
    error = ErrorBound(P=((F(1),),), beta=F(1, 10), kappa=F(11), size=F(1))
    claim = Separable(v=fractions(1, 2), alpha=F(1, 2), rho=None, error=error)
    answer = verify_delay(loop_of(pair("y", k=9)), claim, DelayBound(delay=F(0), rate=F(1, 9)))
    assert answer.verdict is Verdict.REFUTED
    assert "observer" in answer.reason


def test_negative_delays_are_refused():
    claim = Separable(v=fractions(1, 2), alpha=F(1, 2), rho=None)
    with pytest.raises(SpecError, match="delay must be >= 0"):
        verify_delay(loop_of(pair("y")), claim, DelayBound(delay=F(-1), rate=F(1)))


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))]
)
def test_delayed_simulations_obey_the_rate(seed: int):
    """Random constant delays per arc up to tau; explicit Euler in steps far below every time
    constant."""
    problem = random_problem(
        seed, couplings=("tanh(y)", "atan(2*y)", "y", "y + sin(y)/2"), modes=1, n=4, held=True
    )
    claim = certified(problem, F(1))
    bound = longest_delay(loop_of(problem), claim, rate=claim.alpha / 2)
    tau, dt, rate = float(bound.delay), 1e-3, float(bound.rate)
    r, v = Random(seed), np.array([float(x) for x in claim.v])
    gains, late = float_gains(problem), int(tau / dt)
    mode = next(iter(problem.network.modes.values()))
    arcs = [
        (i, j, float(w), problem.coupling_of(i, j).numpy_function(), r.randint(0, late))
        for i, j, w in mode
    ]
    history = [v * np.array([r.choice((-1, 1)) for _ in v])] * (late + 1)
    for step in range(2500):
        e = history[-1]
        slope = -gains * e
        for i, j, w, h, late in arcs:
            slope[i] += w * h([history[-1 - late][j] - e[i]])[0]
        history.append(e + dt * slope)
        assert np.max(np.abs(history[-1]) / v) <= 1.002 * np.exp(-rate * dt * (step + 1))


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))]
)
def test_sampled_simulations_obey_the_period(seed: int):
    """The held step is an exact map; from the boundary of every box it shrinks by the factor,
    monotone or not."""
    problem = random_problem(seed, couplings=MONOTONE + TURNING, modes=2, n=4, held=True)
    claim = certified(problem, F(1, 4))
    bound = largest_period(loop_of(problem), claim)
    factor, period = float(bound.factor), float(bound.period)
    assert 0 < factor < 1
    rng, v = np.random.default_rng(seed), np.array([float(x) for x in claim.v])
    gains = float_gains(problem)
    for arcs in problem.network.modes.values():
        for _ in range(30):
            level = float(claim.rho) * rng.uniform(0, 1)
            e = level * v * rng.choice((-1, 1, rng.uniform(-1, 1)), size=len(v))  # many on a face
            after = e * (1 - period * gains)
            for i, j, w in arcs:
                after[i] += (
                    period * float(w) * problem.coupling_of(i, j).numpy_function()([e[j] - e[i]])[0]
                )
            before = np.max(np.abs(e) / v)
            assert np.max(np.abs(after) / v) <= factor * before + 1e-12


def test_the_period_of_a_linear_pair_is_the_textbooks():
    """e_2+ = e_2 + T w (e_1 - e_2) with w = 3: T <= 1/3; agent 1: T <= 1/5, which is the
    smaller."""
    claim = Separable(v=fractions(1, 2), alpha=F(1), rho=None)
    bound = largest_period(loop_of(pair("y", weight=3)), claim)
    assert bound == SamplingBound(period=F(1, 5), factor=F(4, 5))


def test_the_period_of_a_convex_coupling_is_that_of_the_whole_way():
    """h = exp(y) - 1 + y, v = (1, 2), rho = 1: on the way from -1 to 3 the mean slope is (h(3) -
    h(-1))/4.

    A longer period lets agent 2 jump from the lower face beyond the upper one.
    """
    h = pair(PAPER).coupling.numpy_function()
    mean = float((h([3.0]) - h([-1.0]))[0]) / 4
    claim = Separable(v=fractions(1, 2), alpha=F(1, 10), rho=F(1))
    bound = largest_period(loop_of(pair(PAPER)), claim)
    assert 0.75 / mean < bound.period < 1 / mean
    assert -2 + float(h([3.0])[0]) * 1.5 / mean > 2


def test_a_coupling_that_no_arc_has_does_not_limit_the_period(monkeypatch):
    monkeypatch.setattr("dobc_design.conditions.separable.timing._MANY_ARCS", 0)
    claim, exceptions = Separable(v=fractions(1, 2), alpha=F(1, 100), rho=F(1)), {(1, 0): "tanh(y)"}
    with_unused = listening(
        [[2, 1]], "exp(9*y) - 1", n=2, gains={1: 5}, target=0, exceptions=exceptions
    )
    assert largest_period(loop_of(with_unused), claim) == largest_period(
        loop_of(pair("tanh(y)")), claim
    )


# arcs from which on slopes are bounded on equal parts of the box
@pytest.mark.parametrize("many", [100, 0])
def test_the_period_sees_a_slope_that_is_steep_at_the_start_of_the_way_only(monkeypatch, many: int):
    """Slope 41/10 on -1 < y < -1/2 and 1/10 elsewhere; agent 2 starts at y = -1, so T <= 10/41."""
    monkeypatch.setattr("dobc_design.conditions.separable.timing._MANY_ARCS", many)
    problem = pair("y/10 + clip(4*(y + 1/2), -2, 0)", k=1)
    claim = Separable(v=fractions(1, 2), alpha=F(1, 100), rho=F(1))
    assert largest_period(loop_of(problem), claim).period == F("0.243902439")


@pytest.mark.parametrize("longer", [False, True])
def test_a_period_that_holds_with_equality_is_proved_and_none_just_above_it(longer: bool):
    """h' = 1 + 3 y^2, v = (1, 1), rho = 1/2: the mean slope over eight slices is 281/128, and with
    k = 231/128 that is 4, which floats miss by 1e-15."""
    problem = listening([[2, 1]], "y + y**3", n=2, gains={1: F(231, 128), 2: F(231, 128)}, target=0)
    claim = Separable(v=fractions(1, 1), alpha=F(1), rho=F(1, 2))
    bound = SamplingBound(period=F(1, 4) + (F(1, 10**12) if longer else 0), factor=F(3, 4))
    assert verify_sampling(loop_of(problem), claim, bound).verdict is (
        Verdict.UNDECIDED if longer else Verdict.PROVED
    )
    assert (
        verify_sampling(loop_of(problem), claim, replace(bound, factor=F(1, 2))).verdict
        is Verdict.REFUTED
    )
    assert largest_period(loop_of(problem), claim).period == F(1, 4)


def test_a_matrix_gain_limits_the_period_by_its_diagonal():
    """T max k_cc <= 1: rows of the gain are worth 3 - 1 and 2 - 1, but a step overshoots by 3 T."""
    problem = listening([], "y", n=1, gains={1: [[3, 1], [-1, 2]]}, target=[0, 0])
    claim = Separable(v=fractions(1), alpha=F(1), rho=None)
    assert largest_period(loop_of(problem), claim) == SamplingBound(
        period=F("0.333333333"), factor=1 - F("0.333333333")
    )
    longer = SamplingBound(period=F("0.334"), factor=F("0.9"))
    assert verify_sampling(loop_of(problem), claim, longer).verdict is Verdict.UNDECIDED


def test_matrix_gains_and_couplings_that_do_not_apply_have_no_period():
    vector = listening([[2, 1]], ["y1 + y2", "y2"], n=2, gains=1, target=[0, 0])
    claim = Separable(v=fractions(1, 1), alpha=F(1), rho=F(1))
    assert largest_period(loop_of(vector), claim) is None
    assert (
        largest_period(loop_of(pair("tanh(y)")), Separable(v=fractions(1, 1), alpha=F(1), rho=None))
        is None
    )
