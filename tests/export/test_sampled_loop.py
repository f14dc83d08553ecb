"""Sampled observers and networks, decided exactly; the oracle is NumPy's spectrum away from the
border."""

from fractions import Fraction

import numpy as np
import pytest

from dobc_design import Network, Problem, Verdict
from dobc_design.exact.matrix import matrix
from dobc_design.export.c_controller import (
    longest_period,
    sampled_network_statement,
    sampled_observer_statement,
)


def decided(F: list[list[object]]) -> Verdict:
    """Ad = F, Cd = 0."""
    size = len(F)
    Cd = matrix([[0] * size])
    L = matrix([[0]] * size)
    found = sampled_observer_statement(matrix(F), Cd, L, period=Fraction(1))
    return found.verdict


def test_an_eigenvalue_inside_on_and_outside_the_unit_circle():
    assert decided([["999999999999/1000000000000"]]) is Verdict.PROVED
    assert decided([[1]]) is Verdict.UNDECIDED
    assert decided([[-1]]) is Verdict.UNDECIDED
    assert decided([["-1000000000001/1000000000000"]]) is Verdict.REFUTED
    on_the_circle = [["3/5", "4/5"], ["-4/5", "3/5"]]
    assert decided(on_the_circle) is Verdict.UNDECIDED  # 0.6 +- 0.8 i
    just_inside = [["3/5", "4/5"], ["-4/5", "599/1000"]]
    assert decided(just_inside) is Verdict.PROVED
    just_outside = [["3/5", "4/5"], ["-4/5", "601/1000"]]
    assert decided(just_outside) is Verdict.REFUTED


def ring(n: int, *, both: bool, k: int = 1) -> Problem:
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    if both:
        arcs += [[b, a] for a, b in arcs]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling="y", gains={"1": k})


@pytest.mark.parametrize(("n", "both"), [(6, True), (6, False), (60, True)])
def test_a_ring_is_decided_as_numpy_estimates_it_on_both_sides_of_its_limit(n: int, both: bool):
    """Symmetric rings by definiteness, directed ones by the polynomial."""
    problem = ring(n, both=both)
    forward = np.roll(np.eye(n), 1, axis=1)
    J = forward - np.eye(n)
    if both:
        backward = np.roll(np.eye(n), -1, axis=1)
        J = J + backward - np.eye(n)
    gains = [1.0] + [0.0] * (n - 1)
    poles = np.linalg.eigvals(J - np.diag(gains))
    limit = min(-2 * pole.real / abs(pole) ** 2 for pole in poles)
    factors = (1 - 1e-6, 1 + 1e-6)
    below, above = (Fraction(limit * factor) for factor in factors)
    assert sampled_network_statement(problem, below).verdict is Verdict.PROVED
    assert sampled_network_statement(problem, above).verdict is Verdict.REFUTED


def test_a_ring_that_agrees_is_decided_without_the_motion_of_all_agents_alike():
    """Eigenvalues 1 - z of -J, z^6 = 1: |1 - T (1 - z)| < 1 but for z = 1 iff T < 1."""
    one_way = ring(6, both=False, k=0).replace(gains={}, goal="agreement")
    for period, verdict in ((Fraction(99, 100), Verdict.PROVED), (Fraction(101, 100), "refuted")):
        found = sampled_network_statement(one_way, period)
        assert found.verdict is Verdict(verdict)


def test_what_nothing_pins_or_is_too_large_stays_open():
    both_ways = ring(4, both=True, k=0)
    one_way = ring(4, both=False, k=0)
    unpinned = (both_ways, one_way)
    one_way_ring = ring(41, both=False)
    both_ways_ring = ring(201, both=True)
    too_large = (one_way_ring, both_ways_ring)
    for problem in (*unpinned, *too_large):
        found = sampled_network_statement(problem, Fraction(1, 10))
        assert found.verdict is Verdict.UNDECIDED


def test_matrix_gains_and_couplings_between_components_enter():
    """One agent, k = [[0, 4], [-4, 8]]: I - T k has the double eigenvalue 1 - 4 T."""
    k = [[0, 4], [-4, 8]]
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    gains = {"1": k, "2": k}
    problem = Problem(network=network, coupling=["y1 + y2", "y2"], target=[0, 0], gains=gains)
    slow = sampled_network_statement(problem, Fraction(1, 3))
    assert slow.verdict is Verdict.PROVED
    fast = sampled_network_statement(problem, Fraction(2, 3))
    assert fast.verdict is Verdict.REFUTED


def test_the_longest_period_is_found_where_long_ones_fail_and_where_none_works():
    limit = Fraction(237, 1000)
    found = longest_period(lambda period: period <= limit, Fraction(1))
    assert limit * Fraction(99, 100) <= found <= limit
    tiny = longest_period(lambda period: period <= Fraction(1, 10**6), Fraction(1))
    lower = Fraction(1, 2 * 10**6)
    assert lower <= tiny <= Fraction(1, 10**6)
    assert longest_period(lambda period: False, Fraction(1)) is None
    gap = longest_period(lambda period: period < 0.5 or 0.7 < period < 0.8, Fraction(1))
    assert 0.7 < gap < 0.8
