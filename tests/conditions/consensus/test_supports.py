"""Directions of few agents: against every support tried with NumPy."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from campaigns import a_problem
from exact_oracle import Oracle

from dobc_design.conditions.consensus import propose
from dobc_design.conditions.consensus.propose import witness_directions
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def moved(vector, m):
    return {place // m for place, x in enumerate(vector) if x}


def test_a_leader_without_a_pin_is_a_direction_of_its_own():
    network = Network.from_arcs([[1, 2], [2, 3]], arrow="listens_to")
    directions = witness_directions(Problem(network=network, coupling="y", gains={1: 5}), "G")
    assert moved(directions[0], 1) == {2}


def test_a_cycle_without_a_pin_moves_as_a_whole(cycle):
    directions = witness_directions(cycle(8, pins={}), "G")
    assert [moved(each, 1) for each in directions] == [set(range(8))]
    assert np.ptp(directions[0]) < 1e-9


def test_a_network_that_is_held_has_no_such_direction(cycle):
    assert witness_directions(cycle(5), "G") == []


def test_a_network_too_large_to_look_at_has_none(cycle, monkeypatch):
    monkeypatch.setattr(propose, "LARGEST_SEARCHED", 3)
    assert witness_directions(cycle(5, pins={}), "G") == []


def test_supports_are_nearly_always_the_smallest_there_are():
    """Random problems of all kinds, every support tried in order of size."""
    equal = total = 0
    for seed in range(3000, 3060):
        problem = a_problem(seed)
        oracle = Oracle(problem)
        if not oracle.smooth:
            continue
        for mode in oracle.modes:
            matrix = np.array(oracle.lambda_(mode), dtype=float)
            directions = witness_directions(problem, mode)
            if not directions:
                assert np.linalg.eigvalsh(matrix)[-1] < 1e-9
                continue
            total += 1
            equal += len(moved(directions[0], problem.m)) == smallest_support(matrix, problem.n, problem.m)
    assert total >= 30
    assert equal >= 0.9 * total


def smallest_support(matrix, n, m):
    for size in range(1, n + 1):
        for agents in combinations(range(n), size):
            rows = [agent * m + c for agent in agents for c in range(m)]
            if np.linalg.eigvalsh(matrix[np.ix_(rows, rows)])[-1] >= -1e-9:
                return size
    return n + 1


@pytest.mark.parametrize("budget", [0, 10**6])
def test_a_search_that_runs_out_of_time_still_has_a_direction(cycle, monkeypatch, budget):
    monkeypatch.setattr(propose, "BUDGET", budget)
    network = Network.from_arcs([[i, 1, 5] for i in range(2, 9)] + [[1, 2]], arrow="listens_to", agents=8)
    problem = Problem(network=network, coupling="y", gains={1: "1/9"})
    directions = witness_directions(problem, "G")
    matrix = np.array(Oracle(problem).lambda_("G"), dtype=float)
    assert directions
    assert all(np.array(v) @ matrix @ np.array(v) >= -1e-9 for v in directions)
