"""The ordering criterion: does one v serve all modes?  HiGHS on the linear program is the oracle."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from scipy.optimize import linprog
from separable_problems import cycle, random_network

from dobc_design.conditions.separable.ordering import find_ordering, is_stuck
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def problem_of(seed: int) -> Problem:
    r = Random(seed)
    n = r.randint(2, 7)
    network = random_network(r, n=n, modes=r.randint(1, 3), density=r.choice((0.2, 0.35, 0.5)))
    return Problem(network=network, coupling="y", gains={i: 1 for i in range(1, n + 1) if r.random() < 0.3}, target=0)


def has_common_v(problem: Problem) -> bool:
    """Feasibility of  sum (v_j - v_i) - k_i v_i <= -1,  v >= 1  in every mode; linear h, so scale does not matter."""
    rows = []
    for arcs in problem.network.modes.values():
        matrix = np.zeros((problem.n, problem.n))
        for i, j, weight in arcs:
            matrix[i, j] += float(weight)
            matrix[i, i] -= float(weight)
        for i, k in problem.pinning.gains.items():
            matrix[i, i] -= float(k[0][0])
        rows.append(matrix)
    answer = linprog(
        np.ones(problem.n), A_ub=np.vstack(rows), b_ub=-np.ones(problem.n * len(rows)), bounds=(1, None), method="highs"
    )
    assert answer.status in (0, 2)
    return answer.status == 0


def test_the_criterion_agrees_with_the_linear_program_on_300_random_graphs():
    """Theory, section 5; both answers occur often."""
    found = []
    for seed in range(300):
        problem = problem_of(seed)
        ordering = find_ordering(problem)
        assert ordering.exists == has_common_v(problem), seed
        assert ordering.exists != is_stuck(problem, ordering.stuck), seed
        found.append(ordering.exists)
    assert 60 < sum(found) < 240


@pytest.mark.parametrize("seed", range(40))
def test_in_the_order_everyone_is_pinned_or_hears_an_earlier_one_in_every_mode(seed: int):
    problem = problem_of(seed)
    ordering = find_ordering(problem)
    for name, arcs in problem.network.modes.items():
        if ordering.exists:
            heard = {i for i, j, _ in arcs if ordering.ranks[j] < ordering.ranks[i]}
            assert heard | set(problem.pinning.agents) == set(range(problem.n))
        else:
            stuck = {agent for agent, mode in zip(ordering.stuck, ordering.blocking, strict=True) if mode == name}
            assert not stuck & set(problem.pinning.agents)
            assert not [(i, j) for i, j, _ in arcs if i in stuck and j not in ordering.stuck]


def of_modes(modes: dict[str, list[list[int]]]) -> Problem:
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    return Problem(network=network, coupling="y", gains={1: 1}, target=0)


def test_two_modes_that_alternate_have_no_common_v():
    """Theory, section 5: 3 hears 2 in mode A, 2 hears the pinned 1 in mode B."""
    modes = {"A": [[3, 2]], "B": [[2, 1]]}
    problem = of_modes(modes)
    ordering = find_ordering(problem)
    assert ordering.stuck == (1, 2)
    assert ordering.blocking == ("A", "A")
    assert is_stuck(problem, (1, 2))
    assert not is_stuck(problem, (0, 1, 2))


def test_the_same_modes_with_both_arcs_in_each_have_one():
    """The twin."""
    modes = {"A": [[3, 2], [2, 1]], "B": [[2, 1], [3, 1]]}
    problem = of_modes(modes)
    assert find_ordering(problem).ranks == (0, 1, 2)


def test_a_cycle_is_ordered_away_from_its_pin():
    assert find_ordering(cycle(5)).ranks == (0, 4, 3, 2, 1)
    assert find_ordering(cycle(5, gains={})).stuck == (0, 1, 2, 3, 4)


def test_a_matrix_gain_holds_only_if_it_is_diagonally_dominant():
    """Component c is worth k_cc - sum |k_cd|."""
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    for corner, stuck in ((1, ()), (2, (0, 1))):
        gain = [[2, corner], [-corner, 2]]
        problem = Problem(network=network, coupling="y", gains={1: gain}, target=[0, 0])
        assert find_ordering(problem).stuck == stuck
