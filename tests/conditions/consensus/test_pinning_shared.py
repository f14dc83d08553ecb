"""Gains shared by several modes, and greedy sets of pins in large networks: against a conic program, and by trying."""

from __future__ import annotations

import warnings
from random import Random

import cvxpy as cp
import numpy as np
import pytest

import dobc_design as dd
from dobc_design.conditions.consensus.pinning import (
    fastest_rate,
    for_rate,
    network_blocks,
    smallest_gains,
    solve_shared,
)
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.propose import greedy_set
from dobc_design.verdict import Verdict


def digraphs(r: Random, n: int, modes: int, *, degree: float = 3) -> Problem:
    """Weighted digraphs that hold a directed cycle."""
    found = {}
    for k in range(modes):
        pairs = {(i, i % n + 1) for i in range(1, n + 1)}
        pairs |= {(i, r.randint(1, n)) for i in range(1, n + 1) for _ in range(int(degree) - 1)}
        found[f"G{k}"] = [[i, j, round(r.uniform(0.1, 5), 2)] for i, j in sorted(pairs) if i != j]
    return Problem(network=Network.from_arcs(found, arrow="listens_to", agents=n), coupling="y")


def reference(tables, allowed, costs, caps=None) -> float:
    """The optimum of the semidefinite program by cvxpy and Clarabel, written out dense."""
    n = len(costs)
    gains = cp.Variable(len(allowed), nonneg=True)
    place = np.zeros((n, len(allowed)))
    place[allowed, np.arange(len(allowed))] = 1
    limits = [table.toarray() + 2 * cp.diag(place @ gains) >> 0 for table in tables]
    limits += [] if caps is None else [gains <= caps[allowed]]
    program = cp.Problem(cp.Minimize(costs[allowed] @ gains), limits)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate" at the tolerance asked for
        program.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return float(program.value)


def case(seed: int, n: int, modes: int):
    """Blocks at a rate that the chosen agents reach, who they are, and costs."""
    r = Random(seed)
    blocks = network_blocks(digraphs(r, n, modes))
    allowed = r.sample(range(n), n // 2)
    while fastest_rate(blocks, allowed) <= 0.15:
        allowed.append(r.choice(sorted(set(range(n)) - set(allowed))))
    chosen = np.zeros(n, dtype=bool)
    chosen[allowed] = True
    return for_rate(blocks, 0.1), chosen, np.array([r.uniform(0.5, 2) for _ in range(n)])


@pytest.mark.parametrize(("n", "modes"), [(6, 2), (14, 3)])
def test_shared_gains_are_those_of_the_semidefinite_program_and_their_bound_is_below(n, modes):
    """Theory, section 7: a geometric program, solved through its dual."""
    blocks, chosen, costs = case(n, n, modes)
    found = solve_shared(blocks.tables, chosen, costs)
    optimal = reference(blocks.tables, np.flatnonzero(chosen), costs)
    assert costs @ found.gains == pytest.approx(optimal, rel=1e-6)
    assert costs @ found.gains * (1 - 1e-6) <= found.bound <= optimal * (1 + 1e-7)
    assert not np.any(found.gains[~chosen])
    loads = np.sum([v**2 for v in found.vectors], axis=0)
    assert np.all(loads[chosen] <= costs[chosen] * (1 + 1e-12))


def test_shared_gains_with_caps_are_those_of_the_semidefinite_program():
    blocks, chosen, costs = case(3, 8, 2)
    free = solve_shared(blocks.tables, chosen, costs)
    caps = np.full(8, 0.9 * free.gains.max())
    held = solve_shared(blocks.tables, chosen, costs, caps)
    assert np.all(held.gains <= caps * (1 + 1e-9))
    assert costs @ held.gains > costs @ free.gains
    assert costs @ held.gains == pytest.approx(reference(blocks.tables, np.flatnonzero(chosen), costs, caps), rel=1e-6)


def test_agents_that_cannot_hold_all_modes_share_no_gains():
    """In the second mode nobody is heard by 2 and 3 but each other."""
    modes = {"A": [[2, 1], [3, 2]], "B": [[2, 3], [3, 2]]}
    problem = Problem(network=Network.from_arcs(modes, arrow="listens_to", agents=3), coupling="y")
    blocks = for_rate(network_blocks(problem), 0.01)
    assert solve_shared(blocks.tables, np.array([True, False, False]), np.ones(3)) is None


def test_thirty_agents_in_four_modes_are_designed_and_proved():
    """120 rows: the dual gives the gains and the vectors that bound them; the proof is exact."""
    problem = digraphs(Random(60), 30, 4)
    design = dd.design_pinning(problem, rate="1/10", allowed=list(range(1, 21)), digits=7)
    assert design.verdict is Verdict.PROVED
    assert design.gap < 1e-5


@pytest.mark.parametrize("seed", range(6))
def test_one_more_pin_is_the_cheapest_of_all(seed):
    """The saving by a rank-one formula against the closed form for every agent; no gain falls to 0 here."""
    r = Random(seed)
    problem = digraphs(r, 9, 1)
    blocks = for_rate(network_blocks(problem), 0.01)
    first = r.randrange(9)
    if fastest_rate(blocks, [first]) <= 0:
        first = max(range(9), key=lambda agent: fastest_rate(blocks, [agent]))
    costs = {agent: smallest_gains(blocks, [first, agent]) for agent in range(9) if agent != first}
    found = greedy_set(blocks, [first], range(9), np.ones(9), 2)
    best = min((gains.sum() for gains in costs.values() if gains is not None), default=None)
    if best is None:
        assert found is None
    else:
        (other,) = set(found) - {first}
        assert costs[other].sum() == pytest.approx(best, rel=1e-9)


def test_pins_are_added_until_the_rate_is_reached_and_no_longer():
    problem = digraphs(Random(5), 300, 1)
    blocks = for_rate(network_blocks(problem), 0.1)
    found = greedy_set(blocks, [], range(300), np.ones(300), None)
    assert fastest_rate(blocks, found) > 0
    assert greedy_set(blocks, [], range(300), np.ones(300), 2) is None
    more = greedy_set(blocks, found, range(300), np.ones(300), len(found) + 5)
    assert len(more) == len(found) + 5
    assert smallest_gains(blocks, more).sum() < smallest_gains(blocks, found).sum()
