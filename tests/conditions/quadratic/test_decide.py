"""Regional certificates, decided exactly: known radii, what just fails, two agents in closed
form."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from networks import linked
from regional_problems import HARMONIC, PAPER_GAIN, cycle, identity, is_proved

from dobc_design import Problem, Verdict
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import (
    covered_radius,
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

MORE = Fraction(101, 100)


def certificate(problem: Problem, radius: Fraction, **changes) -> Lure:
    """P_e = I and the level that fits the radius exactly."""
    size = problem.n * problem.m
    ranges = enclose_ranges(loop_of(problem), radius=radius)
    return Lure(
        **{"P_e": identity(size), "ranges": ranges, "radius": radius, "level": radius * radius / 2}
        | changes
    )


def with_tau(problem: Problem, radius: Fraction, tau: Fraction, **changes) -> Lure:
    taus = {mode: (tau,) * len(arcs) for mode, arcs in problem.network.modes.items()}
    return certificate(problem, radius, multipliers=taus, **changes)


@pytest.mark.parametrize(
    ("n", "gains", "radius", "ball"),
    [(10, 3, "2.102", 1.4863), (10, {1: 3}, "0.0767", 0.0542), (60, 3, "2.1", 1.484)],
)
def test_the_interval_bound_reaches_the_radius_of_the_theory_and_not_one_per_cent_more(
    n, gains, radius, ball
):
    """Theory, section 9: 2.1022 and 1.4865, 0.0768 and 0.0543."""
    problem, r = cycle(n, gains), Fraction(radius)
    lure = certificate(problem, r, method="interval")
    assert verify_lure(loop_of(problem), lure).verdict is Verdict.PROVED
    assert covered_radius(loop_of(problem), lure) == pytest.approx(ball, rel=1e-3)
    further = verify_lure(loop_of(problem), certificate(problem, r * MORE, method="interval"))
    assert (further.verdict, further.step, further.mode) == (Verdict.REFUTED, "inequality", "G")
    assert further.witness is not None


@pytest.mark.parametrize("n", [3, 10, pytest.param(60, marks=pytest.mark.slow)])
def test_the_multipliers_reach_four_with_p_equal_to_i_and_fail_one_per_cent_further(n):
    """Theory, section 9: r = 4.0889, ball 2.891; by symmetry one tau for all arcs is the best
    choice."""
    problem, r = cycle(n, 3), Fraction("4.08")
    taus = [Fraction(k, 1000) for k in range(20, 200, 4)]
    lure = next(each for tau in taus if is_proved(problem, each := with_tau(problem, r, tau)))
    assert covered_radius(loop_of(problem), lure) == pytest.approx(4.08 / math.sqrt(2), rel=1e-6)
    assert not any(is_proved(problem, with_tau(problem, Fraction("4.135"), tau)) for tau in taus)


def test_corners_prove_what_interval_bounds_do_not():
    """One pin, n = 4: middle gains and row sums end between 0.3 and 0.5, the corners do not."""
    problem, r = cycle(4, {1: 3}), Fraction(1, 2)
    assert is_proved(problem, certificate(problem, r, method="vertices"))
    assert not is_proved(problem, certificate(problem, r, method="interval"))
    assert not is_proved(problem, certificate(problem, Fraction(3), method="vertices"))


def test_the_region_is_refuted_as_soon_as_the_level_is_too_large():
    """Level c'P_e^-1 c <= r^2, with equality for P_e = I and level r^2/2."""
    problem, r = cycle(3, 3), Fraction(1)
    assert is_proved(problem, with_tau(problem, r, Fraction(1, 2)))
    above = with_tau(problem, r, Fraction(1, 2), level=Fraction(1, 2) + Fraction(1, 10**9))
    assert (
        verify_lure(loop_of(problem), above).verdict,
        verify_lure(loop_of(problem), above).step,
    ) == (
        Verdict.REFUTED,
        "region",
    )
    assert verify_lure(loop_of(problem), replace(above, level=None)).step == "region"


def test_the_region_is_refuted_where_the_level_set_leaves_the_radius_of_one_arc_only():
    """P_e = diag(1, 100, 100), r = 1: c'P_e^-1 c is 1.01 for the first arc and 0.02 for the
    second."""
    problem = linked([[1, 2], [2, 3]], coupling="tanh(y)", gains=9)
    metric = SparseSymmetric(3, {(k, k): Fraction(1 if k == 0 else 100) for k in range(3)})
    exact = certificate(
        problem, Fraction(1), P_e=metric, method="vertices", level=Fraction(100, 101)
    )
    assert is_proved(problem, exact)
    assert verify_lure(loop_of(problem), replace(exact, level=Fraction(1))).step == "region"


# gain 1 as far as |y| <= 1, negative beyond; gain 0 there: no channel at all
@pytest.mark.parametrize(
    "h", ["y - 10*max(y - 1, 0) + 10*max(-y - 1, 0)", "10*max(-y - 1, 0) - 10*max(y - 1, 0)"]
)
def test_a_kink_beyond_the_radius_limits_the_level_although_the_gain_is_one_number(h):
    """Two agents, k = 1: from e = (100, -100) the first one runs away at first."""
    problem = linked([[1, 2], [2, 1]], coupling=h, gains=1)
    exact = GainRange(
        coupling=0, radius=Fraction(1), entries=gains_on(problem.couplings[0], Fraction(1))
    )
    taus = (Fraction(0),) * (2 if exact.entries[0][0].lo else 0)
    held = certificate(problem, Fraction(1), ranges=(exact,), multipliers={"G": taus})
    assert is_proved(problem, held)
    above = replace(held, level=held.level + Fraction(1, 10**9))
    assert (
        verify_lure(loop_of(problem), above).verdict,
        verify_lure(loop_of(problem), above).step,
    ) == (
        Verdict.REFUTED,
        "region",
    )
    assert problem.couplings[0].value(np.array([-200.0]))[0] - 100 > 0


def test_the_region_of_a_full_p_is_decided_with_its_inverse():
    """P_e = [[2, 1], [1, 2]], two agents: c'P_e^-1 c = 2 exactly."""
    problem = linked([[1, 2]], coupling="tanh(y)", gains=9)
    metric = SparseSymmetric(2, {(0, 0): Fraction(2), (0, 1): Fraction(1), (1, 1): Fraction(2)})
    exact = with_tau(problem, Fraction(1), Fraction(3), P_e=metric, level=Fraction(1, 2))
    assert is_proved(problem, exact)
    assert (
        verify_lure(loop_of(problem), replace(exact, level=Fraction(500001, 10**6))).step
        == "region"
    )

    # All gains 3, couplings near linear: (e'e)' <= -6 e'e on balanced graphs, so beta is just below
    # 3.
    problem, r = cycle(4, 3, coupling="y + y**3"), Fraction(1, 100)
    assert is_proved(problem, with_tau(problem, r, Fraction(1000), rate=Fraction("2.99")))
    faster = verify_lure(
        loop_of(problem), with_tau(problem, r, Fraction(1000), rate=Fraction("3.02"))
    )
    assert (faster.verdict, faster.step) == (Verdict.REFUTED, "inequality")


def test_gains_that_are_claimed_narrower_than_they_are_leave_the_certificate_undecided():
    problem = cycle(3, 3)
    lure = with_tau(problem, Fraction(1), Fraction(1, 2))
    ((gain,),) = lure.ranges[0].entries
    narrow = Interval(gain.lo, gain.hi - Fraction(1, 10**4))
    for entries in (((narrow,),), ((Interval.point(gain.midpoint),),)):
        claim = replace(lure, ranges=(GainRange(coupling=0, radius=Fraction(1), entries=entries),))
        decision = verify_lure(loop_of(problem), claim)
        assert (decision.verdict, decision.step) == (Verdict.UNDECIDED, "gains")
    wide = Interval(gain.lo - Fraction(1, 100), gain.hi + Fraction(1, 100))
    assert is_proved(
        problem,
        replace(lure, ranges=(GainRange(coupling=0, radius=Fraction(1), entries=((wide,),)),)),
    )


def test_gains_without_a_radius_are_believed_for_linear_couplings_only():
    everywhere = {"radius": None, "level": None}
    linear = cycle(3, 3, coupling="2*y")
    lure = Lure(
        P_e=identity(3),
        ranges=enclose_ranges(loop_of(linear), radius=None),
        multipliers={"G": (0,) * 3},
        **everywhere,
    )
    assert is_proved(linear, lure)
    assert covered_radius(loop_of(linear), lure) == math.inf
    curved = cycle(3, 3, coupling="tanh(y)")
    assert verify_lure(loop_of(curved), lure).verdict is Verdict.UNDECIDED
    undefined = cycle(3, 3, coupling="log(1 + y)")
    claim = GainRange(coupling=0, radius=Fraction(2), entries=((Interval.point(Fraction(2)),),))
    inside = {"radius": Fraction(2), "level": Fraction(1, 100), "ranges": (claim,)}
    decision = verify_lure(loop_of(undefined), replace(lure, **inside))
    assert (decision.verdict, "cannot be enclosed" in decision.reason) == (Verdict.UNDECIDED, True)


def test_a_p_that_is_not_positive_definite_is_refuted_and_one_of_another_size_refused():
    problem = cycle(2, 3)
    metric = SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(1), (1, 1): Fraction(1)})
    decision = verify_lure(
        loop_of(problem), with_tau(problem, Fraction(1), Fraction(1), P_e=metric)
    )
    assert (decision.verdict, decision.step) == (Verdict.REFUTED, "P_e")
    assert decision.witness is not None
    assert metric.quadratic_form(decision.witness) <= 0

    with pytest.raises(ShapeError, match="P_e must have 3 rows, one per component of e; got 4"):
        verify_lure(
            loop_of(cycle(3, 3)),
            replace(with_tau(cycle(3, 3), Fraction(1), Fraction(1)), P_e=identity(4)),
        )


def test_every_mode_has_to_hold():
    """Pinned everywhere; in mode B the agents listen to one leader, which e'e pays for."""
    ring = [[i, i % 6 + 1] for i in range(1, 7)]
    star = [[i, 1] for i in range(2, 7)]
    problem = linked({"A": ring, "B": star}, coupling="tanh(y)", gains="1/10")
    decision = verify_lure(loop_of(problem), with_tau(problem, Fraction(1, 10), Fraction(50)))
    assert (decision.verdict, decision.mode) == (Verdict.REFUTED, "B")
    better = linked({"A": ring, "B": star}, coupling="tanh(y)", gains=2)
    assert is_proved(better, with_tau(better, Fraction(1, 10), Fraction(50)))


PAIR = ((Fraction(1, 2), Fraction(-1, 4)), (Fraction(-1, 4), Fraction(1, 3)))


def observed(scale: Fraction, tau: Fraction = Fraction("0.12")) -> tuple[Problem, Lure]:
    """All k = 3, r = 3, the printed pair times ``scale``."""
    problem = cycle(10, 3, exosystem=HARMONIC)
    P = tuple(tuple(scale * x for x in row) for row in PAIR)
    return problem, with_tau(problem, Fraction(3), tau, P=P, Q=multiply(P, PAPER_GAIN))


def test_with_the_observer_the_pair_has_to_be_scaled_up():
    """S = 9/(8 a) for the printed pair times a (theory, section 9)."""
    problem, small = observed(Fraction(1, 4))
    assert verify_lure(loop_of(problem), small).step == "inequality"
    problem, large = observed(Fraction(2))
    assert is_proved(problem, large)
    assert verify_lure(loop_of(problem), replace(large, rate=Fraction(1))).step == "observer"
    assert (
        verify_lure(loop_of(problem), replace(large, Q=((Fraction(-1),), (Fraction(0),)))).step
        == "observer"
    )


def test_covered_starts_pay_for_the_observer_errors():
    """lambda_max(P_e) R^2 + n lambda_max(P) s^2 <= level: P_e = I, level 9/2, lambda_max(2 P) = (5
    + sqrt 10)/6."""
    problem, lure = observed(Fraction(2))
    largest = (5 + math.sqrt(10)) / 6
    for s in (Fraction(0), Fraction(1, 10), Fraction(1, 2)):
        R = covered_radius(loop_of(problem), lure, disturbance=s)
        truth = (
            math.sqrt(4.5 - 10 * largest * float(s) ** 2)
            if 10 * largest * float(s) ** 2 < 4.5
            else 0.0
        )
        assert truth * (1 - 1e-6) <= R <= truth
        if R:
            assert covers(loop_of(problem), lure, radius=Fraction(str(R)), disturbance=s)
            assert not covers(
                loop_of(problem),
                lure,
                radius=Fraction(str(R)) * (1 + Fraction(1, 10**6)),
                disturbance=s,
            )
    # without a pair nothing is covered but eps = 0
    problem = cycle(10, 3, exosystem=HARMONIC)
    lure = with_tau(problem, Fraction("4.08"), Fraction("0.084"))
    assert is_proved(problem, lure)
    assert covers(loop_of(problem), lure, radius=Fraction("2.88"))
    assert not covers(
        loop_of(problem), lure, radius=Fraction("2.88"), disturbance=Fraction(1, 10**6)
    )
    assert covered_radius(loop_of(problem), lure, disturbance=Fraction(50)) == 0.0


@pytest.mark.parametrize("k", [Fraction(1, 10), Fraction(1), Fraction(3)])
def test_two_agents_are_never_certified_beyond_their_other_equilibrium(k):
    """h = y - y^3 both ways, k: z = e1 - e2 obeys z' = -(k + 2) z + 2 z^3, so z^2 = (k + 2)/2 stays
    where it is."""
    problem = linked([[1, 2], [2, 1]], coupling="y - y**3", gains=str(k))
    truth = math.sqrt((float(k) + 2) / 2)
    for method, part in (("interval", 1.001), ("vertices", 1.001), ("vertices", 1.5)):
        r = Fraction(truth * part).limit_denominator(10**6)
        assert not is_proved(problem, certificate(problem, r, method=method))
    assert is_proved(problem, certificate(problem, Fraction(3, 10), method="vertices"))


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_on_the_largest_eigenvalue_lies_just_above_it(seed):
    rng = np.random.default_rng(seed)
    rows = rng.integers(-9, 9, (6, 6))
    M = SparseSymmetric.from_dense(
        tuple(tuple(Fraction(int(x), 7) for x in row) for row in rows + rows.T)
    )
    truth = float(np.linalg.eigvalsh((rows + rows.T) / 7)[-1])
    assert truth - 1e-12 <= float(eigenvalue_bound(M)) <= truth + 1e-6
    # of a diagonal matrix it is the largest entry
    assert eigenvalue_bound(
        SparseSymmetric(3, {(0, 0): Fraction(1, 3), (2, 2): Fraction(2, 7)})
    ) == Fraction(1, 3)
    assert eigenvalue_bound(SparseSymmetric(2, {(0, 0): Fraction(-1), (1, 1): Fraction(-2)})) == -1
    repeated = SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(1), (1, 1): Fraction(1)})
    assert eigenvalue_bound(repeated) >= 2


def test_where_no_estimate_can_be_shown_the_bound_is_the_largest_row_sum(monkeypatch):
    """Gershgorin: eigenvalues 3 +- sqrt(5) of [[1, 1], [1, 5]], row sums 2 and 6."""
    monkeypatch.setattr("dobc_design.conditions.quadratic.decide.RISE", ())
    assert (
        eigenvalue_bound(
            SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(1), (1, 1): Fraction(5)})
        )
        == 6
    )


def test_without_a_pair_not_even_a_point_is_covered_with_a_disturbance():
    lure = with_tau(cycle(3, 3), Fraction(1), Fraction(1, 2))
    assert covers(loop_of(cycle(3, 3)), lure, radius=Fraction(0))
    assert not covers(loop_of(cycle(3, 3)), lure, radius=Fraction(0), disturbance=Fraction(1))
