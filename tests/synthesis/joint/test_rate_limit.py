"""Rates out of reach: the limit that a direction proves is above the true one, and rejects what shows nothing."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np
import pytest
from small_designs import ring, star

from dobc_design.conditions.consensus.claim import jacobians_at_consensus
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.decide import limit_of, slow_direction, too_fast
from dobc_design.synthesis.pinning.propose import slow_directions


def random_network(r: Random, n: int) -> Problem:
    arcs = [
        [i, j, round(r.uniform(0.1, 3), 2)]
        for i in range(1, n + 1)
        for j in range(1, n + 1)
        if i != j and r.random() < 0.4
    ]
    return Problem(network=Network.from_arcs(arcs, arrow="listens_to", agents=n), coupling="sin(y)")


def true_rate(problem: Problem, gains: dict[int, float]) -> float:
    M = np.zeros((problem.n, problem.n))
    for i, j, weight in problem.network.modes["G"]:
        M[i, j] += float(weight)
        M[i, i] -= float(weight)
    for i, k in gains.items():
        M[i, i] -= k
    return -float(np.max(np.linalg.eigvals(M).real))


@pytest.mark.parametrize("seed", range(20))
def test_no_gains_beat_the_limit_and_large_ones_come_close(seed: int):
    """Against the eigenvalues of random loops with random gains, caps included."""
    r = Random(seed)
    problem = random_network(r, 6)
    pinned = r.sample(range(6), 3)
    caps = {pinned[0]: Fraction(1, 2)}
    found = slow_direction(jacobians_at_consensus(problem), pinned, caps, slow_directions)
    assert found is not None
    for _ in range(20):
        gains = {i: r.uniform(0, 0.5) if i in caps else 10 ** r.uniform(-2, 6) for i in pinned}
        assert true_rate(problem, gains) <= float(found.limit) + 1e-9
    largest = {i: 0.5 if i in caps else 1e9 for i in pinned}
    assert true_rate(problem, largest) == pytest.approx(float(found.limit), abs=1e-6)


def test_a_direction_that_moves_a_free_agent_or_has_a_negative_entry_shows_nothing():
    mode = jacobians_at_consensus(ring(3)).modes[0]
    assert limit_of(mode, 0, (1, 0, 0), pinned=(0,), caps={}) is None
    assert limit_of(mode, 0, (-1, 0, 2), pinned=(1,), caps={}) is None
    assert limit_of(mode, 0, (0, 0, 0), pinned=(), caps={}) is None
    assert limit_of(mode, 0, (0, 0, 1), pinned=(0,), caps={}) == 1


def test_a_coupling_that_falls_at_the_target_has_no_limit():
    assert slow_direction(jacobians_at_consensus(ring(3, coupling="-y")), (0,), {}, slow_directions) is None


def test_two_pins_of_a_star_are_excluded_above_1_and_not_below():
    """Four leaves return at 1 unless held: six sets, all too slow for 1.01; none of them for 1."""

    def ask(rate: str):
        return too_fast(star(4), Fraction(rate), allowed=range(4), caps={}, pins=2, propose=slow_directions)

    refuted = ask("1.01")
    assert refuted is not None
    assert refuted.exact["sets"] == "6"
    assert ask("1") is None
