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
PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
MANY_ARCS = "dobc_design.conditions.separable.timing._MANY_ARCS"
#: Two agents with v = (1, 2) and linear couplings.
LINEAR = Separable(v=fractions(1, 2), alpha=F(1, 2), rho=None)
HELD = loop_of(pair("y", k=9))


def certified(problem: Problem, rho: Fraction) -> Separable:
    loop = loop_of(problem)
    plan = propose_separable(loop, rho=float(rho))
    v = list(rounded_vectors(plan))[2]
    alpha = largest_rate(loop, v, rho=rho)
    return Separable(v=v, alpha=alpha, rho=rho)


def test_the_delayed_rate_of_two_agents_is_halanays():
    """h = y, e_2' = v_1-bound - e_2: lambda = 1 - exp(lambda tau)/2 for v = (1, 2); at tau = 1 that
    is 0.31492."""
    truth = brentq(lambda rate: rate - 1 + np.exp(rate) / 2, 0, 0.5)
    for part, verdict in ((0.999999, PROVED), (1.000001, REFUTED)):
        bound = DelayBound(delay=F(1), rate=F(part * truth))
        assert verify_delay(HELD, LINEAR, bound).verdict is verdict
    found = longest_delay(HELD, LINEAR, rate=F("0.3"))
    expected = np.log(1.4) / 0.3
    share = float(found.delay) / expected
    assert 0.4 < share <= 1


def test_every_delay_leaves_a_positive_rate():
    loop = loop_of(cycle(4))
    claim = certified(cycle(4), F(1))
    delays = []
    for part in (F("0.99"), F(1, 2), F(1, 20)):
        bound = longest_delay(loop, claim, rate=claim.alpha * part)
        delays.append(bound.delay)
    assert 0 < delays[0] < delays[1] < delays[2]
    found = longest_delay(loop, claim, rate=claim.alpha * F("1.01"))
    assert found is None


def test_the_rate_with_delays_may_not_exceed_the_observers():
    P = ((F(1),),)
    error = ErrorBound(P=P, beta=F(1, 10), kappa=F(11), size=F(1))
    claim = replace(LINEAR, error=error)
    bound = DelayBound(delay=F(0), rate=F(1, 9))
    answer = verify_delay(HELD, claim, bound)
    assert answer.verdict is REFUTED
    assert "observer" in answer.reason


def test_negative_delays_are_refused():
    bound = DelayBound(delay=F(-1), rate=F(1))
    with pytest.raises(SpecError, match="delay must be >= 0"):
        verify_delay(loop_of(pair("y")), LINEAR, bound)


def first_of(count: int) -> list[object]:
    """Seeds, of which only the first one is quick."""
    slow = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, count)]
    return [0, *slow]


@pytest.mark.parametrize("seed", first_of(4))
def test_delayed_simulations_obey_the_rate(seed: int):
    """Random constant delays per arc up to tau; explicit Euler in steps far below every time
    constant."""
    couplings = ("tanh(y)", "atan(2*y)", "y", "y + sin(y)/2")
    problem = random_problem(seed, couplings=couplings, modes=1, n=4, held=True)
    claim = certified(problem, F(1))
    bound = longest_delay(loop_of(problem), claim, rate=claim.alpha / 2)
    rate = float(bound.rate)
    dt = 1e-3
    latest = int(float(bound.delay) / dt)
    r = Random(seed)
    v = np.array(claim.v, dtype=float)
    gains = float_gains(problem)
    (mode,) = problem.network.modes.values()
    arcs = []
    for i, j, w in mode:
        h = problem.coupling_of(i, j).numpy_function()
        delay = r.randint(0, latest)
        arc = (i, j, float(w), h, delay)
        arcs.append(arc)
    signs = [r.choice((-1, 1)) for _ in v]
    start = v * np.array(signs)
    history = [start] * (latest + 1)
    for step in range(2500):
        e = history[-1]
        slope = -gains * e
        for i, j, w, h, late in arcs:
            difference = history[-1 - late][j] - e[i]
            felt = h([difference])[0]
            slope[i] += w * felt
        history.append(e + dt * slope)
        largest = np.max(np.abs(history[-1]) / v)
        assert largest <= 1.002 * np.exp(-rate * dt * (step + 1))


@pytest.mark.parametrize("seed", first_of(6))
def test_sampled_simulations_obey_the_period(seed: int):
    """The held step is an exact map; from the boundary of every box it shrinks by the factor,
    monotone or not."""
    problem = random_problem(seed, couplings=MONOTONE + TURNING, modes=2, n=4, held=True)
    claim = certified(problem, F(1, 4))
    bound = largest_period(loop_of(problem), claim)
    factor = float(bound.factor)
    period = float(bound.period)
    assert 0 < factor < 1
    rng = np.random.default_rng(seed)
    v = np.array(claim.v, dtype=float)
    gains = float_gains(problem)
    for arcs in problem.network.modes.values():
        for _ in range(30):
            level = float(claim.rho) * rng.uniform(0, 1)
            signs = rng.choice((-1, 1, rng.uniform(-1, 1)), size=len(v))
            e = level * v * signs  # many on a face
            after = e * (1 - period * gains)
            for i, j, w in arcs:
                h = problem.coupling_of(i, j).numpy_function()
                felt = h([e[j] - e[i]])
                after[i] += period * float(w) * felt[0]
            before = np.max(np.abs(e) / v)
            found = np.max(np.abs(after) / v)
            assert found <= factor * before + 1e-12


def test_the_period_of_a_linear_pair_is_the_textbooks():
    """e_2+ = e_2 + T w (e_1 - e_2) with w = 3: T <= 1/3; agent 1: T <= 1/5, which is the
    smaller."""
    loop = loop_of(pair("y", weight=3))
    claim = replace(LINEAR, alpha=F(1))
    bound = largest_period(loop, claim)
    assert bound == SamplingBound(period=F(1, 5), factor=F(4, 5))


def test_the_period_of_a_convex_coupling_is_that_of_the_whole_way():
    """h = exp(y) - 1 + y, v = (1, 2), rho = 1: on the way from -1 to 3 the mean slope is (h(3) -
    h(-1))/4.

    A longer period lets agent 2 jump from the lower face beyond the upper one.
    """
    problem = pair(PAPER)
    h = problem.coupling.numpy_function()
    there = float(h([3.0])[0])
    back = float(h([-1.0])[0])
    mean = (there - back) / 4
    claim = Separable(v=fractions(1, 2), alpha=F(1, 10), rho=F(1))
    bound = largest_period(loop_of(problem), claim)
    assert 0.75 / mean < bound.period < 1 / mean
    assert -2 + there * 1.5 / mean > 2


def test_a_coupling_that_no_arc_has_does_not_limit_the_period(monkeypatch):
    monkeypatch.setattr(MANY_ARCS, 0)
    claim = Separable(v=fractions(1, 2), alpha=F(1, 100), rho=F(1))
    exceptions = {(1, 0): "tanh(y)"}
    parts = {"gains": {1: 5}, "target": 0, "exceptions": exceptions}
    with_unused = listening([[2, 1]], "exp(9*y) - 1", n=2, **parts)
    found = largest_period(loop_of(with_unused), claim)
    assert found == largest_period(loop_of(pair("tanh(y)")), claim)


# arcs from which on slopes are bounded on equal parts of the box
@pytest.mark.parametrize("many", [100, 0])
def test_the_period_sees_a_slope_that_is_steep_at_the_start_of_the_way_only(monkeypatch, many: int):
    """Slope 41/10 on -1 < y < -1/2 and 1/10 elsewhere; agent 2 starts at y = -1, so T <= 10/41."""
    monkeypatch.setattr(MANY_ARCS, many)
    problem = pair("y/10 + clip(4*(y + 1/2), -2, 0)", k=1)
    claim = Separable(v=fractions(1, 2), alpha=F(1, 100), rho=F(1))
    assert largest_period(loop_of(problem), claim).period == F("0.243902439")


def test_a_period_that_holds_with_equality_is_proved_and_none_just_above_it():
    """h' = 1 + 3 y^2, v = (1, 1), rho = 1/2: the mean slope over eight slices is 281/128, and with
    k = 231/128 that is 4, which floats miss by 1e-15."""
    gain = F(231, 128)
    gains = {1: gain, 2: gain}
    arcs = [[2, 1]]
    problem = listening(arcs, "y + y**3", n=2, gains=gains, target=0)
    loop = loop_of(problem)
    claim = Separable(v=fractions(1, 1), alpha=F(1), rho=F(1, 2))
    bound = SamplingBound(period=F(1, 4), factor=F(3, 4))
    assert verify_sampling(loop, claim, bound).verdict is PROVED
    longer = replace(bound, period=bound.period + F(1, 10**12))
    assert verify_sampling(loop, claim, longer).verdict is UNDECIDED
    for period in (bound, longer):
        smaller = replace(period, factor=F(1, 2))
        assert verify_sampling(loop, claim, smaller).verdict is REFUTED
    assert largest_period(loop, claim).period == F(1, 4)


def test_a_matrix_gain_limits_the_period_by_its_diagonal():
    """T max k_cc <= 1: rows of the gain are worth 3 - 1 and 2 - 1, but a step overshoots by 3 T."""
    gains = {1: [[3, 1], [-1, 2]]}
    problem = listening([], "y", n=1, gains=gains, target=[0, 0])
    claim = Separable(v=fractions(1), alpha=F(1), rho=None)
    third = F("0.333333333")
    bound = largest_period(loop_of(problem), claim)
    assert bound == SamplingBound(period=third, factor=1 - third)
    longer = SamplingBound(period=F("0.334"), factor=F("0.9"))
    assert verify_sampling(loop_of(problem), claim, longer).verdict is UNDECIDED


def test_matrix_gains_and_couplings_that_do_not_apply_have_no_period():
    arcs = [[2, 1]]
    vector = listening(arcs, ["y1 + y2", "y2"], n=2, gains=1, target=[0, 0])
    claim = Separable(v=fractions(1, 1), alpha=F(1), rho=F(1))
    assert largest_period(loop_of(vector), claim) is None
    everywhere = replace(claim, rho=None)
    assert largest_period(loop_of(pair("tanh(y)")), everywhere) is None
