"""Closed groups: the smallest sets of agents that listen to nobody outside; networkx's components are the oracle."""

from __future__ import annotations

import networkx as nx
from hypothesis import given
from hypothesis import strategies as st

from dobc_design.conditions.consensus.network import cure_in_words
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.problem.reaching import closed_groups, unreached_in_union


def build(arcs: list[tuple[int, int]], n: int, gains: dict[int, int] | None = None) -> Problem:
    network = Network.from_arcs([list(arc) for arc in arcs], arrow="listens_to", agents=n)
    return Problem(network=network, coupling="y", gains=gains)


@given(
    st.integers(1, 7).flatmap(
        lambda n: st.tuples(
            st.just(n),
            st.sets(st.tuples(st.integers(1, n), st.integers(1, n)).filter(lambda a: a[0] != a[1]), max_size=14),
        )
    )
)
def test_closed_groups_are_the_components_that_hear_nobody_else(drawn):
    n, arcs = drawn
    graph = nx.DiGraph(list(arcs))
    graph.add_nodes_from(range(1, n + 1))
    inner = nx.condensation(graph)
    expected = {frozenset(i - 1 for i in inner.nodes[c]["members"]) for c in inner if inner.out_degree(c) == 0}
    problem = build(sorted(arcs), n)
    assert {frozenset(group) for group in closed_groups(problem, problem.network.modes.values())} == expected


def test_a_chain_of_a_hundred_thousand_agents_needs_no_recursion():
    n = 100_000
    problem = build([(i, i + 1) for i in range(1, n)], n)
    assert closed_groups(problem, problem.network.modes.values()) == ((n - 1,),)


def test_the_cure_names_one_agent_of_every_group_and_works():
    """Agents 1 and 2 hear each other, 4 hears 3, 5 is alone: three groups have to be pinned, not one agent."""
    arcs = [(1, 2), (2, 1), (4, 3)]
    problem = build(arcs, 5)
    text = cure_in_words(problem, list(problem.network.modes.values()))
    assert text == "Pin agent 1 or 2, and agent 3, and agent 5."
    assert unreached_in_union(build(arcs, 5, {1: 1, 3: 1, 5: 1})) == ()
    assert unreached_in_union(build(arcs, 5, {1: 1, 3: 1})) == (4,)
