"""The composite V = N + kappa E: the observer's part, the starts that are covered, the rate of V."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from separable_problems import cycle, fractions

from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.decide import (
    composite_rate,
    covers,
    error_bound_obstacle,
    verify_composite,
)
from dobc_design.errors import SpecError
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import load_problem
from dobc_design.verdict import Verdict

F = Fraction
SWITCHING = load_problem("paper-switching")
W = SWITCHING.observer.W
# Found by the design for the paper's W; five digits.
V = fractions(1, 1.52644, 1.50285, 1.45348, 1.33998, 1, 1.52644, 1.50285, 1.45348, 1.33998)
BOUND = ErrorBound(
    P=((F("1.4005"), F("-0.5035")), (F("-0.5035"), F("0.6347"))), beta=F("1.58"), kappa=F("0.6333"), size=F("1.651")
)
CLAIM = Separable(v=V, alpha=F("0.0301"), rho=F("4.41"), error=BOUND)


def test_the_papers_own_starts_are_covered_for_arbitrary_switching():
    """Theory, known answers: rho = 4.41, alpha = 0.0301 for all four modes, [0, 5] about 1, |eps| <= 1/2."""
    assert verify_composite(SWITCHING, W, CLAIM).verdict is Verdict.PROVED
    assert covers(CLAIM, radius=F(4), disturbance=F(1, 2))
    assert float(BOUND.kappa) * 0.5 * np.sqrt(float(BOUND.size)) == pytest.approx(0.406, rel=0.01)


def test_a_little_more_of_anything_is_refuted():
    """The twins: alpha 1 % larger, rho 1 % larger, v changed by 1 %."""
    changes = {"alpha": CLAIM.alpha * F(101, 100)}, {"rho": F("4.4541")}, {"v": (*V[:2], V[2] * F(99, 100), *V[3:])}
    for change in changes:
        assert verify_composite(SWITCHING, W, replace(CLAIM, **change)).verdict is Verdict.REFUTED
    assert not covers(CLAIM, radius=F("4.01"), disturbance=F(1, 2))
    assert not covers(CLAIM, radius=F(4), disturbance=F("0.52"))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"beta": F("1.61")}, "does not decay at the rate beta = 1.61"),
        ({"size": F("1.6")}, "P exceeds 1.6 times the identity"),
        ({"P": ((F("1.399"), F("-0.5035")), (F("-0.5035"), F("0.6347"))), "beta": F("1.5")}, "row 1 of C"),
        ({"P": ((F(1), F(2)), (F(2), F(1)))}, "not positive definite"),
        ({"P": ((F(1), F(0)), (F(1), F(1)))}, "symmetric 2x2"),
        ({"P": ((F(1),),)}, "symmetric 2x2"),
    ],
)
def test_every_condition_on_the_observers_part_is_checked(change, why: str):
    worse = replace(CLAIM, error=replace(BOUND, **change))
    answer = verify_composite(SWITCHING, W, worse)
    assert answer.verdict is Verdict.REFUTED
    assert re.search(why, answer.reason)


def test_the_row_bound_is_sharp():
    """c'c <= P for c = (1, 0) iff the Schur complement p11 - p12^2/p22 >= 1; beta = 0.1 leaves room elsewhere."""
    exosystem = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]])
    gain = ((F(0),), (F(0),))
    for p11, holds in ((F(2), True), (F(2) - F(1, 10**30), False)):
        bound = ErrorBound(P=((p11, F(1)), (F(1), F(1))), beta=F(1, 10), kappa=F(11), size=F(3))
        assert (error_bound_obstacle(exosystem, gain, bound) is None) is holds


def test_each_row_of_c_is_bounded_by_itself():
    """C = I and P = I; with the smaller P only the second row fails."""
    exosystem = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0], [0, 1]])
    gain = ((F(0), F(0)), (F(0), F(0)))
    unit = ((F(1), F(0)), (F(0), F(1)))
    bound = ErrorBound(P=unit, beta=F(1), kappa=F(2), size=F(1))
    assert error_bound_obstacle(exosystem, gain, bound) is None
    small = replace(bound, P=((F(1), F(0)), (F(0), F("0.99"))))
    assert error_bound_obstacle(exosystem, gain, small) == "P does not bound row 2 of C: c'c <= P fails."


def test_kappa_has_to_exceed_one_over_beta_min_v():
    edge = 1 / (BOUND.beta * CLAIM.least)
    for kappa, verdict in ((edge, Verdict.REFUTED), (edge * F(1001, 1000), Verdict.PROVED)):
        claim = replace(CLAIM, error=replace(BOUND, kappa=kappa))
        assert verify_composite(SWITCHING, W, claim).verdict is verdict
    assert composite_rate(replace(CLAIM, error=replace(BOUND, kappa=2 * edge))) == CLAIM.alpha
    assert 0 < composite_rate(replace(CLAIM, error=replace(BOUND, kappa=edge * F(1001, 1000)))) < F("0.0016")


def test_without_an_exosystem_v_is_n():
    claim = Separable(v=(F(1),) * 10, alpha=F(5), rho=F(4))
    assert verify_composite(cycle(gains=5), None, claim).verdict is Verdict.PROVED
    assert composite_rate(claim) == 5
    assert covers(claim, radius=F(4), disturbance=F(0))
    assert not covers(claim, radius=F(4) + F(1, 10**20), disturbance=F(0))


def test_without_a_radius_everything_is_covered():
    claim = Separable(v=(F(1),) * 10, alpha=F(5), rho=None)
    assert verify_composite(cycle(gains=5, h="2*y"), None, claim).verdict is Verdict.PROVED
    assert covers(claim, radius=F(10**9), disturbance=F(0))


def test_with_an_exosystem_the_observers_part_is_required():
    for gain, claim in ((None, CLAIM), (W, replace(CLAIM, error=None))):
        assert verify_composite(SWITCHING, gain, claim).verdict is Verdict.UNDECIDED
    with pytest.raises(SpecError, match="must be >= 0"):
        covers(CLAIM, radius=F(-1), disturbance=F(0))


def test_an_observer_that_diverges_is_refuted():
    problem = cycle(exosystem=Exosystem(A=[[0]], C=[[1]]), observer=Observer(W=[[-1]]), gains=5)
    bound = ErrorBound(P=((F(1),),), beta=F(1, 10), kappa=F(11), size=F(1))
    claim = Separable(v=(F(1),) * 10, alpha=F(1), rho=F(1), error=bound)
    assert verify_composite(problem, problem.observer.W, claim).verdict is Verdict.REFUTED
    assert verify_composite(problem, ((F(1),),), claim).verdict is Verdict.PROVED
