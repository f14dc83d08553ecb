"""Limits of quadratic certificates: exact duals hold, those that claim a little more do not."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from lure_cases import is_proved
from scipy.optimize import brentq
from separable_problems import cycle

from dobc_design.conditions.quadratic.decide_duals import verify_dual
from dobc_design.conditions.quadratic.dual_search import dual_at, propose_dual
from dobc_design.conditions.quadratic.duals import QuadraticDual
from dobc_design.conditions.quadratic.propose import design_lure
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

F = Fraction


def holds(problem: Problem, dual: QuadraticDual) -> bool:
    return verify_dual(problem, dual).verdict is Verdict.PROVED


@cache
def two() -> Problem:
    """Two agents that listen to each other, k = 3 each, exp(y) - 1 + y."""
    return cycle(2, gains=3)


@cache
def limit_of(shape: str) -> QuadraticDual:
    return propose_dual(two(), shape, holds=lambda dual: holds(two(), dual), beyond=F(1), largest=F(20))


def top(low: float, high: float) -> float:
    """Closed form for two agents: largest eigenvalue of A + A' at gains (high, low); A = [[-3-a, a], [b, -3-b]]."""
    return -6 - (low + high) + np.hypot(high - low, high + low)


def test_the_limit_of_a_multiple_of_the_identity_is_that_of_two_agents_in_closed_form():
    """V = e'e stops at hypot(M - m, M + m) = 6 + m + M with m = g(-r), M = g(r)."""

    def excess(r: float) -> float:
        low, high = np.expm1(-r) / -r + 1, np.expm1(r) / r + 1
        return top(low, high)

    exact = brentq(excess, 1, 10)
    found = float(limit_of("identity").radius)
    assert exact <= found <= 1.005 * exact


def test_a_dual_a_little_nearer_is_not_found_and_its_own_numbers_do_not_do_there():
    """Twin of the radius that is proved."""
    dual = limit_of("identity")
    nearer = dual.radius * F(99, 100)
    assert dual_at(two(), "identity", nearer, []) is None
    assert verify_dual(two(), replace(dual, radius=nearer)).verdict is Verdict.UNDECIDED


def test_a_certificate_of_the_same_shape_ends_just_below_its_limit():
    """Lur'e's multipliers lose little for P_e = I."""
    dual = limit_of("identity")
    lure = design_lure(two(), holds=lambda each: is_proved(two(), each), shape="identity", objective="radius")
    assert 0.95 * dual.radius <= lure.radius < dual.radius


def test_gains_that_the_coupling_does_not_have_are_refused():
    dual = limit_of("identity")
    (place,) = dual.gains
    low, high = dual.gains[place]
    for wrong in ((low, high * F(1001, 1000)), (low * F(999, 1000), high), (high, low)):
        answer = verify_dual(two(), replace(dual, gains={place: wrong}))
        assert "not shown to be attained" in answer.reason
    assert verify_dual(two(), replace(dual, at={place: (F(0), dual.radius)})).verdict is Verdict.UNDECIDED
    beyond = {place: (-2 * dual.radius, dual.radius)}
    assert verify_dual(two(), replace(dual, at=beyond)).verdict is Verdict.UNDECIDED


def test_nothing_follows_from_nothing():
    dual = limit_of("identity")
    empty = tuple(replace(term, vectors=((F(0), F(0)),)) for term in dual.terms)
    assert verify_dual(two(), replace(dual, terms=empty)).reason == "all X are zero."
    assert verify_dual(two(), replace(dual, terms=())).verdict is Verdict.UNDECIDED


def test_one_vector_limits_a_multiple_of_the_identity_and_no_other_shape():
    dual = limit_of("identity")
    assert holds(two(), dual)
    assert not holds(two(), replace(dual, shape="full"))


def test_a_dual_for_every_shape_limits_the_smaller_ones_too():
    """S >= 0 has a diagonal >= 0, and that a sum >= 0."""
    problem = cycle(3, gains={1: 3})
    full = propose_dual(problem, "full", holds=lambda dual: holds(problem, dual), beyond=F(1), largest=F(30))
    assert full is not None
    assert all(holds(problem, replace(full, shape=shape)) for shape in ("diagonal", "identity", "full"))
    lure = design_lure(problem, holds=lambda each: is_proved(problem, each), shape="full", objective="radius")
    assert lure.radius < full.radius


def test_the_ball_is_the_radius_over_root_two_and_never_less():
    dual = limit_of("identity")
    assert 2 * dual.ball**2 >= dual.radius**2
    assert 2 * dual.ball**2 <= dual.radius**2 * F(1000001, 1000000)


@pytest.mark.parametrize("h", ["clip(y, -1, 1)", "abs(y)*y"])
def test_couplings_with_kinks_are_left_out(h: str):
    problem = cycle(2, gains=3, h=h)
    assert propose_dual(problem, "identity", holds=lambda dual: True, beyond=F(1), largest=F(2)) is None
    assert verify_dual(problem, limit_of("identity")).reason.startswith("does not apply")


def test_a_linear_loop_that_is_stable_has_no_limit():
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to", agents=2)
    problem = Problem(network=network, coupling="y", gains=1)
    found = propose_dual(problem, "identity", holds=lambda dual: holds(problem, dual), beyond=F(1), largest=F(50))
    assert found is None


@pytest.mark.slow
def test_the_known_answers_of_ten_agents_lie_between_certificate_and_limit():
    """Theory, section 9: all k = 3: 4.0889 (I), 4.179 (full); one k = 3: 0.7119 (I), 1.689 (full)."""
    for gains, shape, known in ((3, "identity", 4.0889), ({1: 3}, "identity", 0.7119), ({1: 3}, "full", 1.689)):
        problem = cycle(10, gains=gains)
        dual = propose_dual(
            problem, shape, holds=lambda each, own=problem: holds(own, each), beyond=F("0.5"), largest=F(20)
        )
        assert known < dual.radius
        assert shape == "full" or dual.radius < 1.002 * known
