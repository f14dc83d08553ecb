"""The smallest pinning gains against a semidefinite program in cvxpy, known answers, and every
agent tried."""

import math
import warnings
from dataclasses import dataclass
from random import Random

import clarabel
import cvxpy as cp
import numpy as np
import pytest
from networks import digraph, linked

from dobc_design import Problem
from dobc_design.conditions.consensus import pinning
from dobc_design.conditions.consensus.pinning import (
    Blocks,
    cheapest_gains,
    fastest_rate,
    for_rate,
    looseness,
    network_blocks,
    rough_rate,
    smallest_gains,
    solve_shared,
)
from dobc_design.loop.make import loop_of


def blocks_of(problem: Problem) -> Blocks:
    return network_blocks(loop_of(problem))


def reference(tables, allowed, costs, caps=None) -> float:
    """The optimum of the semidefinite program, by cvxpy and Clarabel, written out dense; nan if
    there is none."""
    gains = cp.Variable(len(allowed), nonneg=True)
    place = np.eye(len(costs))[:, allowed]
    limits = [table.toarray() + 2 * cp.diag(place @ gains) >> 0 for table in tables]
    if caps is not None:
        limits.append(gains <= caps[allowed])
    objective = cp.Minimize(costs[allowed] @ gains)
    program = cp.Problem(objective, limits)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate" at the tolerance asked for
        try:
            program.solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
        except cp.SolverError:
            return math.nan
    if program.value is None or not math.isfinite(program.value):
        return math.nan
    return float(program.value)


def compare_with_the_program(count: int, seed: int) -> int:
    """How many digraphs had an optimum; each is compared to 1e-6."""
    r = Random(seed)
    compared = 0
    for _ in range(count):
        problem = digraph(r, r.randint(3, 10))
        blocks = blocks_of(problem)
        allowed = sorted(r.sample(range(blocks.agents), r.randint(1, blocks.agents)))
        costs = np.array([r.uniform(0.5, 2) for _ in range(blocks.agents)])
        fastest = fastest_rate(blocks, allowed)
        if fastest <= 0.02 * blocks.scale and len(allowed) < blocks.agents:
            continue
        rate = r.choice((0, 0.3)) * min(fastest, blocks.scale / 8)
        blocks = for_rate(blocks, rate)
        chosen = np.isin(np.arange(blocks.agents), allowed)
        own = cheapest_gains(blocks, chosen, costs).gains
        optimum = reference(blocks.tables, allowed, costs)
        if not math.isnan(optimum):
            compared += 1
            assert costs @ own == pytest.approx(optimum, rel=1e-6, abs=1e-6 * blocks.scale)
            assert set(np.flatnonzero(own)) <= set(allowed)
    return compared


MANY = pytest.param(170, 100, marks=pytest.mark.slow)


@pytest.mark.parametrize(("count", "least"), [(15, 9), MANY])
def test_the_closed_form_is_the_optimum_of_the_semidefinite_program(count, least):
    """Theory, section 7: minimise sum c_i k_i subject to Lambda(K) <= -2 beta I."""
    assert compare_with_the_program(count, seed=1) >= least


def test_one_pin_on_the_directed_ten_cycle_reaches_every_rate_below_a_bound_and_none_above(cycle):
    """lambda_max(Lambda) > 4 (cos(pi/10) - 1) = -0.195774 however large the gain (theory, known
    answers)."""
    blocks = blocks_of(cycle(10, pins={}))
    bound = 2 * (1 - math.cos(math.pi / 10))
    assert fastest_rate(blocks, [0]) == pytest.approx(bound, rel=1e-9)
    gains = [smallest_gains(for_rate(blocks, part * bound), [0])[0] for part in (0.5, 0.9, 0.999)]
    assert gains == sorted(gains)
    found = smallest_gains(for_rate(blocks, 1.001 * bound), [0])
    assert found is None


@pytest.mark.parametrize("n", [2, 5, 10])
def test_the_gain_of_one_pin_on_a_cycle_is_that_of_the_recursion(cycle, n):
    """S v = 0 off the pin on a path of equal steps: v_j = cos((j - n/2) t) / cos(n t/2), 2 - 2 cos
    t = 2 beta/s."""
    s = 2.0  # h'(0); S is 2 s (I - half the adjacency): 4 on the diagonal, -2 beside it
    blocks = blocks_of(cycle(n, pins={}))
    beta = 0.4 * fastest_rate(blocks, [0])
    t = math.acos(1 - beta / s)
    v = []
    for j in range(n + 1):
        v.append(math.cos((j - n / 2) * t) / math.cos(n * t / 2))
    closed = -((2 * s - 2 * beta) - 2 * s * v[1]) / 2
    found = smallest_gains(for_rate(blocks, beta), [0])
    assert found[0] == pytest.approx(closed, rel=1e-9)


def test_an_agent_whose_gain_would_be_negative_is_set_free():
    """1 hears 2 alone, strongly: pinning both costs less with k_1 = 0 than the formula of the first
    round."""
    arcs = [[1, 2, 5], [2, 3], [3, 2]]
    problem = linked(arcs)
    blocks = blocks_of(problem)
    gains = smallest_gains(blocks, [0, 1, 2])
    assert gains.min() == 0
    assert sum(gains) == pytest.approx(reference(blocks.tables, [0, 1, 2], np.ones(3)), rel=1e-6)
    # no gains can do where a closed group has no allowed agent
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    problem = linked(arcs)
    blocks = blocks_of(problem)
    assert smallest_gains(blocks, [0]) is None
    assert looseness(blocks, [0]) == math.inf
    assert smallest_gains(blocks, [0, 2]) is not None
    assert math.isfinite(looseness(blocks, [0, 2]))


def test_couplings_that_are_no_z_matrix_go_to_the_program_and_a_panic_costs_the_optimum_only(
    monkeypatch,
):
    """h = -y on a pair: Lambda = [[2, -2], [-2, 2]] - 2 K needs k = 2 on both agents."""
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling="-y")
    blocks = blocks_of(problem)
    assert not blocks.z
    found = smallest_gains(blocks, [0, 1])
    assert found == pytest.approx([2, 2], rel=1e-6)
    assert smallest_gains(blocks, [0]) is None

    def panic(*args, **kwargs):
        raise RuntimeError("panic")

    # gains that suffice are returned in its place
    monkeypatch.setattr(clarabel, "DefaultSolver", panic)
    found = smallest_gains(blocks, [0, 1])
    assert found == pytest.approx([2, 2], rel=1e-4)


def digraphs(r: Random, n: int, modes: int) -> Problem:
    """Weighted digraphs that hold a directed cycle."""
    found = {}
    for k in range(modes):
        pairs = {(i, i % n + 1) for i in range(1, n + 1)}
        pairs |= {(i, r.randint(1, n)) for i in range(1, n + 1) for _ in range(2)}
        found[f"G{k}"] = [[i, j, round(r.uniform(0.1, 5), 2)] for i, j in sorted(pairs) if i != j]
    return linked(found, n)


@dataclass(frozen=True)
class Shared:
    """Blocks at a rate that the chosen agents reach, who they are, and costs."""

    blocks: Blocks
    chosen: np.ndarray
    costs: np.ndarray

    def solved(self, caps=None) -> np.ndarray:
        return solve_shared(self.blocks.tables, self.chosen, self.costs, caps)

    def optimum(self, caps=None) -> float:
        return reference(self.blocks.tables, np.flatnonzero(self.chosen), self.costs, caps)


def case(seed: int, n: int, modes: int) -> Shared:
    r = Random(seed)
    blocks = blocks_of(digraphs(r, n, modes))
    allowed = r.sample(range(n), n // 2)
    while fastest_rate(blocks, allowed) <= 0.15:
        allowed.append(r.choice(sorted(set(range(n)) - set(allowed))))
    costs = np.array([r.uniform(0.5, 2) for _ in range(n)])
    chosen = np.isin(range(n), allowed)
    return Shared(for_rate(blocks, 0.1), chosen, costs)


@pytest.mark.parametrize(("n", "modes"), [(6, 2), (9, 3)])
def test_shared_gains_are_those_of_the_semidefinite_program_and_their_bound_is_below(n, modes):
    """Theory, section 7: a geometric program, solved through its dual."""
    given = case(n, n, modes)
    found = given.solved()
    optimal = given.optimum()
    cost = given.costs @ found.gains
    assert cost == pytest.approx(optimal, rel=1e-6)
    assert cost * (1 - 1e-6) <= found.bound <= optimal * (1 + 1e-7)
    assert not np.any(found.gains[~given.chosen])
    loads = np.sum([v**2 for (v,) in found.vectors], axis=0)
    assert np.all((loads <= given.costs * (1 + 1e-12))[given.chosen])


def test_shared_gains_with_caps_are_those_of_the_semidefinite_program():
    given = case(3, 8, 2)
    free = given.solved()
    cap = 0.9 * free.gains.max()
    caps = np.full(8, cap)
    held = given.solved(caps)
    assert np.all(held.gains <= caps * (1 + 1e-9))
    cost = given.costs @ held.gains
    assert cost > given.costs @ free.gains
    assert cost == pytest.approx(given.optimum(caps), rel=1e-6)
    # Agents that cannot hold all modes share none: in the second nobody is heard by 2 and 3 but
    # each other.
    arcs = {"A": [[2, 1], [3, 2]], "B": [[2, 3], [3, 2]]}
    problem = linked(arcs, 3)
    blocks = for_rate(blocks_of(problem), 0.01)
    chosen = np.array([True, False, False])
    found = solve_shared(blocks.tables, chosen, np.ones(3))
    assert found is None


def test_the_rate_of_a_large_network_is_estimated_from_below_and_closely(monkeypatch):
    """Both ways along a line of 30 agents and some chords, four of them pinned: against all
    eigenvalues."""
    pairs = [(i, i + 1) for i in range(1, 30)] + [(3, 20), (7, 25), (11, 16)]
    arcs = [arc for i, j in pairs for arc in ([i, j], [j, i])]
    problem = linked(arcs, 30, coupling="y")
    blocks = blocks_of(problem)
    pins = (0, 9, 17, 28)
    exact = fastest_rate(blocks, pins)
    monkeypatch.setattr(pinning, "LARGE", 0)
    assert 0.95 * exact <= rough_rate(blocks, pins) <= exact * (1 + 1e-9)
    assert rough_rate(blocks, ()) == pytest.approx(0, abs=1e-9)
