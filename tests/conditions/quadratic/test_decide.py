"""Regional certificates, decided exactly: known radii, what just fails, two agents in closed
form."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from networks import linked
from regional_problems import HARMONIC, PAPER_GAIN, cycle, identity, is_proved
from texts import exact_matrix

from dobc_design import Problem, Verdict
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import (
    LureDecision,
    certified_ball,
    covers,
    eigenvalue_bound,
    verify_lure,
)
from dobc_design.conditions.quadratic.sectors import GainRange, enclose_ranges, gains_on
from dobc_design.errors import ShapeError
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import multiply
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of


def certificate(problem: Problem, radius: Fraction, **changes) -> Lure:
    """P_e = I and the level that fits the radius exactly."""
    P_e = identity(problem.n * problem.m)
    ranges = enclose_ranges(loop_of(problem), radius=radius)
    values = {"P_e": P_e, "ranges": ranges, "radius": radius, "level": radius * radius / 2}
    return Lure(**values | changes)


def decided(problem: Problem, lure: Lure) -> LureDecision:
    """The decision about a certificate of this problem."""
    return verify_lure(loop_of(problem), lure)


def symmetric(*rows: list[int]) -> SparseSymmetric:
    """A matrix of whole numbers."""
    entries = tuple(tuple(map(Fraction, row)) for row in rows)
    return SparseSymmetric.from_dense(entries)


def with_tau(problem: Problem, radius: Fraction, tau: Fraction, **changes) -> Lure:
    taus = {mode: (tau,) * len(arcs) for mode, arcs in problem.network.modes.items()}
    return certificate(problem, radius, multipliers=taus, **changes)


@pytest.mark.parametrize("n", [3, 10, pytest.param(30, marks=pytest.mark.slow)])
def test_the_multipliers_reach_four_with_p_equal_to_i_and_fail_one_per_cent_further(n):
    """Theory, section 9: r = 4.0889, ball 2.891; by symmetry one tau for all arcs is the best
    choice."""
    problem = cycle(n, 3)
    taus = [Fraction(k, 1000) for k in range(20, 200, 4)]
    reached = (with_tau(problem, Fraction("4.08"), tau) for tau in taus)
    lure = next(each for each in reached if is_proved(problem, each))
    found = certified_ball(loop_of(problem), lure, disturbance=0.0)
    assert found == pytest.approx(4.08 / math.sqrt(2), rel=1e-5)
    beyond = (with_tau(problem, Fraction("4.135"), tau) for tau in taus)
    assert not any(is_proved(problem, each) for each in beyond)


def test_the_region_is_refuted_as_soon_as_the_level_is_too_large():
    """Level c'P_e^-1 c <= r^2, with equality for P_e = I and level r^2/2."""
    problem = cycle(3, 3)
    exact = with_tau(problem, Fraction(1), Fraction(1, 2))
    assert is_proved(problem, exact)
    level = Fraction(1, 2) + Fraction(1, 10**9)
    lure = replace(exact, level=level)
    above = decided(problem, lure)
    assert above.verdict is Verdict.REFUTED
    assert above.step == "region"
    found = decided(problem, replace(exact, level=None))
    assert found.step == "region"


def test_the_region_is_refuted_where_the_level_set_leaves_the_radius_of_one_arc_only():
    """P_e = diag(1, 100, 100), r = 1: c'P_e^-1 c is 1.01 for the first arc and 0.02 for the
    second."""
    arcs = [[1, 2], [2, 3]]
    problem = linked(arcs, coupling="tanh(y)", gains=9)
    first = [1, 0, 0]
    second = [0, 100, 0]
    metric = symmetric(first, second, [0, 0, 100])
    lure = with_tau(problem, Fraction(1), Fraction(9), P_e=metric)
    exact = replace(lure, level=Fraction(100, 101))
    assert is_proved(problem, exact)
    found = decided(problem, replace(exact, level=Fraction(1)))
    assert found.step == "region"


# gain 1 as far as |y| <= 1, negative beyond; gain 0 there: no channel at all
@pytest.mark.parametrize(
    "h", ["y - 10*max(y - 1, 0) + 10*max(-y - 1, 0)", "10*max(-y - 1, 0) - 10*max(y - 1, 0)"]
)
def test_a_kink_beyond_the_radius_limits_the_level_although_the_gain_is_one_number(h):
    """Two agents, k = 1: from e = (100, -100) the first one runs away at first."""
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling=h, gains=1)
    r = Fraction(1)
    entries = gains_on(problem.couplings[0], r)
    exact = GainRange(coupling=0, radius=r, entries=entries)
    channels = 2 if entries[0][0].lo else 0
    multipliers = {"G": (Fraction(0),) * channels}
    held = certificate(problem, r, ranges=(exact,), multipliers=multipliers)
    assert is_proved(problem, held)
    level = held.level + Fraction(1, 10**9)
    lure = replace(held, level=level)
    above = decided(problem, lure)
    assert above.verdict is Verdict.REFUTED
    assert above.step == "region"
    far = np.array([-200.0])
    value = problem.couplings[0].value(far)
    assert value[0] - 100 > 0


def test_the_region_of_a_full_p_is_decided_with_its_inverse():
    """P_e = [[2, 1], [1, 2]], two agents: c'P_e^-1 c = 2 exactly."""
    problem = linked([[1, 2]], coupling="tanh(y)", gains=9)
    P_e = symmetric([2, 1], [1, 2])
    lure = with_tau(problem, Fraction(1), Fraction(3), P_e=P_e)
    exact = replace(lure, level=Fraction(1, 2))
    assert is_proved(problem, exact)
    above = replace(exact, level=Fraction(500001, 10**6))
    assert decided(problem, above).step == "region"


def test_the_rate_of_nearly_linear_couplings_is_that_of_the_pins():
    """All gains 3, couplings near linear: (e'e)' <= -6 e'e on balanced graphs, so that beta is just
    below 3."""
    problem = cycle(4, 3, coupling="y + y**3")
    lure = with_tau(problem, Fraction(1, 100), Fraction(1000))
    assert is_proved(problem, replace(lure, rate=Fraction("2.99")))
    faster = decided(problem, replace(lure, rate=Fraction("3.02")))
    assert faster.verdict is Verdict.REFUTED
    assert faster.step == "inequality"


def test_gains_that_are_claimed_narrower_than_they_are_leave_the_certificate_undecided():
    problem = cycle(3, 3)
    lure = with_tau(problem, Fraction(1), Fraction(1, 2))
    ((gain,),) = lure.ranges[0].entries

    def claiming(gain: Interval) -> Lure:
        entries = ((gain,),)
        claimed = GainRange(coupling=0, radius=Fraction(1), entries=entries)
        return replace(lure, ranges=(claimed,))

    narrow = Interval(gain.lo, gain.hi - Fraction(1, 10**4))
    for each in (narrow, Interval.point(gain.midpoint)):
        decision = decided(problem, claiming(each))
        assert decision.verdict is Verdict.UNDECIDED
        assert decision.step == "gains"
    below = gain.lo - Fraction(1, 100)
    above = gain.hi + Fraction(1, 100)
    wide = Interval(below, above)
    assert is_proved(problem, claiming(wide))


def test_gains_without_a_radius_are_believed_for_linear_couplings_only():
    linear = cycle(3, 3, coupling="2*y")
    ranges = enclose_ranges(loop_of(linear), radius=None)
    multipliers = {"G": (0,) * 3}
    lure = Lure(
        P_e=identity(3),
        ranges=ranges,
        multipliers=multipliers,
        radius=None,
        level=None,
    )
    assert is_proved(linear, lure)
    assert certified_ball(loop_of(linear), lure, disturbance=0.0) == math.inf
    curved = cycle(3, 3, coupling="tanh(y)")
    assert decided(curved, lure).verdict is Verdict.UNDECIDED
    undefined = cycle(3, 3, coupling="log(1 + y)")
    two = Fraction(2)
    entries = ((Interval.point(two),),)
    claim = GainRange(coupling=0, radius=two, entries=entries)
    inside = replace(lure, radius=two, level=Fraction(1, 100), ranges=(claim,))
    decision = decided(undefined, inside)
    assert decision.verdict is Verdict.UNDECIDED
    assert "cannot be enclosed" in decision.reason


def test_a_p_that_is_not_positive_definite_is_refuted_and_one_of_another_size_refused():
    problem = cycle(2, 3)
    metric = symmetric([1, 1], [1, 1])
    lure = with_tau(problem, Fraction(1), Fraction(1), P_e=metric)
    decision = decided(problem, lure)
    assert decision.verdict is Verdict.REFUTED
    assert decision.step == "P_e"
    assert decision.witness is not None
    assert metric.quadratic_form(decision.witness) <= 0
    three = cycle(3, 3)
    larger = with_tau(three, Fraction(1), Fraction(1), P_e=identity(4))
    with pytest.raises(ShapeError, match="P_e must have 3 rows, one per component of e; got 4"):
        decided(three, larger)


def test_every_mode_has_to_hold():
    """Pinned everywhere; in mode B the agents listen to one leader, which e'e pays for."""
    ring = [[i, i % 6 + 1] for i in range(1, 7)]
    star = [[i, 1] for i in range(2, 7)]
    arcs = {"A": ring, "B": star}
    problem = linked(arcs, coupling="tanh(y)", gains="1/10")
    lure = with_tau(problem, Fraction(1, 10), Fraction(50))
    decision = decided(problem, lure)
    assert decision.verdict is Verdict.REFUTED
    assert decision.mode == "B"
    arcs = {"A": ring, "B": star}
    better = linked(arcs, coupling="tanh(y)", gains=2)
    lure = with_tau(better, Fraction(1, 10), Fraction(50))
    assert is_proved(better, lure)


PAIR = exact_matrix("1/2 -1/4; -1/4 1/3")


def observed(scale: Fraction, tau: Fraction = Fraction("0.12")) -> tuple[Problem, Lure]:
    """All k = 3, r = 3, the printed pair times ``scale``."""
    problem = cycle(10, 3, exosystem=HARMONIC)
    P = tuple(tuple(scale * x for x in row) for row in PAIR)
    return problem, with_tau(problem, Fraction(3), tau, P=P, Q=multiply(P, PAPER_GAIN))


def test_with_the_observer_the_pair_has_to_be_scaled_up():
    """S = 9/(8 a) for the printed pair times a (theory, section 9)."""
    problem, small = observed(Fraction(1, 4))
    assert decided(problem, small).step == "inequality"
    problem, large = observed(Fraction(2))
    assert is_proved(problem, large)
    too_fast = replace(large, rate=Fraction(1))
    assert decided(problem, too_fast).step == "observer"
    other_gain = replace(large, Q=exact_matrix("-1; 0"))
    assert decided(problem, other_gain).step == "observer"


@pytest.mark.parametrize("disturbance", [Fraction(0), Fraction(1, 10), Fraction(1, 2)])
def test_covered_starts_pay_for_the_observer_errors(disturbance):
    """lambda_max(P_e) R^2 + n lambda_max(P) s^2 <= level: P_e = I, level 9/2, lambda_max(2 P) = (5
    + sqrt 10)/6."""
    problem, lure = observed(Fraction(2))
    loop = loop_of(problem)
    largest = (5 + math.sqrt(10)) / 6
    room = 4.5 - 10 * largest * float(disturbance) ** 2
    truth = math.sqrt(max(room, 0.0))
    R = certified_ball(loop, lure, disturbance=float(disturbance))
    assert truth * (1 - 1e-5) <= R <= truth
    if R:
        exact = Fraction(str(R))
        further = exact * (1 + Fraction(1, 10**5))
        assert covers(loop, lure, radius=exact, disturbance=disturbance)
        assert not covers(loop, lure, radius=further, disturbance=disturbance)


def test_without_a_pair_nothing_is_covered_but_exact_estimates():
    problem = cycle(10, 3, exosystem=HARMONIC)
    loop = loop_of(problem)
    lure = with_tau(problem, Fraction("4.08"), Fraction("0.084"))
    radius = Fraction("2.88")
    assert is_proved(problem, lure)
    assert covers(loop, lure, radius=radius)
    tiny = Fraction(1, 10**6)
    assert not covers(loop, lure, radius=radius, disturbance=tiny)
    assert certified_ball(loop, lure, disturbance=50.0) == 0.0


@pytest.mark.parametrize("k", [Fraction(1, 10), Fraction(1), Fraction(3)])
def test_two_agents_are_never_certified_beyond_their_other_equilibrium(k):
    """h = y - y^3 both ways, k: z = e1 - e2 obeys z' = -(k + 2) z + 2 z^3, so z^2 = (k + 2)/2 stays
    where it is."""
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling="y - y**3", gains=str(k))
    truth = math.sqrt((float(k) + 2) / 2)
    taus = [Fraction(2) ** power for power in range(-6, 7)]
    for part in (1.001, 1.5):
        r = Fraction(truth * part).limit_denominator(10**6)
        assert not any(is_proved(problem, with_tau(problem, r, tau)) for tau in taus)
    near = Fraction(3, 10)
    assert any(is_proved(problem, with_tau(problem, near, tau)) for tau in taus)


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_on_the_largest_eigenvalue_lies_just_above_it(seed):
    rng = np.random.default_rng(seed)
    rows = rng.integers(-9, 9, (6, 6))
    both = rows + rows.T
    M = symmetric(*both.tolist()).scaled(Fraction(1, 7))
    truth = float(np.linalg.eigvalsh(both / 7)[-1])
    assert truth - 1e-12 <= float(eigenvalue_bound(M)) <= truth + 1e-6


def test_the_bound_of_a_diagonal_matrix_is_its_largest_entry():
    entries = {(0, 0): Fraction(1, 3), (2, 2): Fraction(2, 7)}
    assert eigenvalue_bound(SparseSymmetric(3, entries)) == Fraction(1, 3)
    found = eigenvalue_bound(symmetric([-1, 0], [0, -2]))
    assert found == -1


def test_the_bound_of_a_singular_matrix_is_no_smaller_than_its_eigenvalue():
    found = eigenvalue_bound(symmetric([1, 1], [1, 1]))
    assert found >= 2


def test_where_no_estimate_can_be_shown_the_bound_is_the_largest_row_sum(monkeypatch):
    """Gershgorin: eigenvalues 3 +- sqrt(5) of [[1, 1], [1, 5]], row sums 2 and 6."""
    monkeypatch.setattr("dobc_design.conditions.quadratic.decide.RISE", ())
    found = eigenvalue_bound(symmetric([1, 1], [1, 5]))
    assert found == 6


def test_without_a_pair_not_even_a_point_is_covered_with_a_disturbance():
    problem = cycle(3, 3)
    lure = with_tau(problem, Fraction(1), Fraction(1, 2))
    assert covers(loop_of(problem), lure, radius=Fraction(0))
    assert not covers(loop_of(problem), lure, radius=Fraction(0), disturbance=Fraction(1))
