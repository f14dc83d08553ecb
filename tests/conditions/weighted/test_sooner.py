"""Weights D, and R of agents with dynamics, with the least certified time to one percent."""

import math

import numpy as np
from certified import certified

from dobc_design import Dynamics, Network, Problem
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.numbers import time_to_one_percent
from dobc_design.conditions.weighted.propose import (
    even_weights,
    proposals,
    soonest_weights,
    stiffness,
)
from dobc_design.loop.make import loop_of

CHAIN = Network.from_arcs([[2, 1], [3, 2], [4, 3], [5, 4], [6, 5]], arrow="listens_to", agents=6)
SLOW = Problem(network=CHAIN, coupling="2*y", gains={1: 3})
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])


def test_the_first_claim_settles_earlier_than_the_fastest():
    first, second, *_ = proposals(state_theorems(loop_of(SLOW)), None)
    times = []
    for claim, rate in (first, second):
        factor = math.sqrt(max(claim.D) / min(claim.D))
        times.append(time_to_one_percent(rate, factor))
    assert first[1] < second[1]
    assert times[0] < 0.7 * times[1]


def test_the_weights_do_for_their_rate():
    """D (M - rate I) + (M - rate I)'D > 0 by eigenvalues, and no more than the fastest weights are
    apart."""
    mode = next(iter(SLOW.network.modes))
    M = stiffness(loop_of(SLOW), mode)
    found = soonest_weights({"G": M}, 1.99, None)
    assert found is not None
    rate, D = found
    shifted = M.toarray() - rate * np.eye(6)
    X = np.diag(D) @ shifted
    answer = np.linalg.eigvalsh(X + X.T)
    assert answer[0] > 0
    fastest = even_weights({"G": M}, 1.99)
    assert fastest is not None
    times = [(rate, D), (1.99, fastest)]
    now, then = (time_to_one_percent(r, math.sqrt(d.max() / d.min())) for r, d in times)
    assert now < then


def test_an_undirected_network_needs_no_weights():
    arcs = [[1, 2], [2, 1], [2, 3], [3, 2]]
    both = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    problem = Problem(network=both, coupling="y", gains={1: 1})
    loop = loop_of(problem)
    M = stiffness(loop, "G")
    found = soonest_weights({"G": M}, 0.19, np.ones(3))
    assert found is None


def test_the_largest_rate_is_stated_beside_the_one_that_settles_first():
    check = certified(SLOW).check("theorem1-weighted")
    assert "The largest rate is about 1.99" in check.reason
    assert check.time_to_one_percent < 6.8


def test_a_line_of_double_integrators_settles_earlier_than_by_its_fastest_weights():
    """The fastest weights of a line lie apart by powers of ten for each hop."""
    gains = {1: [[1, 2]]}
    line = Problem(network=CHAIN, coupling="y1 + 2*y2", gains=gains, dynamics=DOUBLE, target=[0, 0])
    check = certified(line).check("theorem1-weighted")
    assert "The largest rate is about" in check.reason
    assert (check.factor or math.inf) < 100
