"""Which agents to pin: symmetric networks, closed groups, and every subset tried."""

from __future__ import annotations

from itertools import combinations
from random import Random

import numpy as np
import pytest
from exact_oracle import Oracle

from dobc_design.conditions.consensus.cures import best_single, groups_without_pin, small_set
from dobc_design.conditions.consensus.pinning import network_blocks, smallest_gains
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def problem_of(arcs, n=None, **changes):
    given = {"network": Network.from_arcs(arcs, arrow="listens_to", agents=n), "coupling": "y"}
    return Problem(**given | changes)


def test_on_a_cycle_every_agent_is_as_good(cycle):
    problem = cycle(6, pins={})
    found = best_single(network_blocks(problem), problem)
    assert (found.agent, found.rivals) == (0, (1, 2, 3, 4, 5))


def test_on_an_undirected_path_the_middle_holds_best():
    arcs = [[i, i + 1] for i in range(1, 7)] + [[i + 1, i] for i in range(1, 7)]
    problem = problem_of(arcs, 7)
    found = best_single(network_blocks(problem), problem)
    assert (found.agent, found.rivals) == (3, ())


def test_no_single_agent_serves_two_closed_groups():
    problem = problem_of([[1, 2], [2, 1], [3, 4], [4, 3]])
    assert best_single(network_blocks(problem), problem) is None
    assert groups_without_pin(problem) == [(0, 1), (2, 3)]
    added = small_set(network_blocks(problem), problem)
    assert len(added) == 2
    assert added[0] in (0, 1)
    assert added[1] in (2, 3)


@pytest.mark.parametrize("seed", range(20))
def test_the_best_single_agent_is_the_best_of_all_that_were_tried_by_hand(seed):
    r = Random(seed)
    n = r.randint(3, 7)
    arcs = [[i, j, r.randint(1, 4)] for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < 0.5]
    problem = problem_of(arcs, n)
    blocks = network_blocks(problem)
    totals = {a: smallest_gains(blocks, [a]) for a in range(n)}
    able = {a: float(sum(k)) for a, k in totals.items() if k is not None}
    found = best_single(blocks, problem)
    assert (found is None) is (not able)
    if found is not None:
        assert able[found.agent] == pytest.approx(min(able.values()), rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("seed", range(12))
def test_a_small_set_does_and_is_at_most_one_larger_than_the_smallest(seed):
    """Some gains can do iff S is positive on the others: every subset tried with NumPy."""
    r = Random(seed)
    n = r.randint(4, 7)
    arcs = [[i, j] for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < 0.3]
    problem = problem_of(arcs, n)
    S = -np.array(Oracle(problem).lambda_("G"), dtype=float)

    def does(chosen):
        rest = [i for i in range(n) if i not in chosen]
        return not rest or np.linalg.eigvalsh(S[np.ix_(rest, rest)])[0] > 1e-9

    added = small_set(network_blocks(problem), problem)
    assert does(added)
    least = next(size for size in range(1, n + 1) if any(map(does, combinations(range(n), size))))
    assert len(added) <= least + 1
    assert all(set(added) & set(group) for group in groups_without_pin(problem))
