"""The nouns and rows of the max-separable certificate."""

from __future__ import annotations

from fractions import Fraction

from separable_problems import fractions, listening

from dobc_design.conditions.separable.claim import Term, acts_by_component, holding_gains, largest_reach, rows
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

F = Fraction


def test_agents_in_the_same_situation_share_a_row():
    """The undirected cycle with v = 1: one row for the pinned agent, one for the nine others."""
    arcs = [[i, (i + d) % 10 + 1] for i in range(1, 11) for d in (0, -2) if i != (i + d) % 10 + 1]
    problem = listening(arcs, "y", n=10, gains={1: 5}, target=0)
    found = dict(rows(problem, (F(1),) * 10))
    assert sorted((row.gain, place.count) for row, place in found.items()) == [(0, 9), (5, 1)]
    assert all(row.terms == (Term(0, F(2), F(2), F(0)),) for row in found)


def test_terms_hold_weights_reach_and_step():
    """Agent 3 (v = 5) hears 1 (v = 2) with weight 1/2 and 2 (v = 3) with weight 4; stretched by 2."""
    problem = listening([[3, 1, "1/2"], [3, 2, 4]], "y", n=3, exceptions={(2, 1): "2*y"}, target=0)
    ((row, place),) = rows(problem, fractions(2, 3, 5), agents=[2])
    assert row.terms == (Term(0, F(1, 2), F(7), F(-3)), Term(1, F(4), F(8), F(-2)))
    assert (place.agent, place.mode, place.count) == (2, "G", 1)
    ((stretched, _),) = rows(problem, fractions(2, 3, 5), agents=[2], stretch=2)
    assert stretched.terms == (Term(0, F(1, 2), F(9), F(-1)), Term(1, F(4), F(11), F(1)))
    assert 7 <= largest_reach(problem, fractions(2, 3, 5))[0] < 7 + F(1, 10**12)
    assert 8 <= largest_reach(problem, fractions(2, 3, 5))[1] < 8 + F(1, 10**12)


def test_a_pin_is_worth_its_least_dominance():
    network = Network.from_arcs([], arrow="listens_to", agents=3)
    gains = {1: [[3, 1], [-1, 2]], 2: [[1, 2], [-2, 1]]}
    problem = Problem(network=network, coupling="y", gains=gains, target=[0, 0])
    assert holding_gains(problem) == (1, -1, 0)


def test_the_certificate_is_for_couplings_by_component():
    network = Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)
    assert acts_by_component(load_problem("uav-swarm"))
    assert not acts_by_component(Problem(network=network, coupling=["y1 + y2", "y2"], target=[0, 0]))
