"""Graph facts, on graphs small enough to be read by eye and against a transitive closure."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.analysis.analysis import graph_facts
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def listening(arcs, *, agents=None, gains=None) -> Problem:
    network = Network.from_arcs({"G": arcs}, arrow="listens_to", agents=agents)
    return Problem(network=network, coupling="y", gains=gains)


def test_a_listener_is_reached_by_whom_it_hears():
    """a hears b hears c: a pin at c reaches everybody, a pin at a only itself."""
    arcs = [["a", "b"], ["b", "c"]]
    assert graph_facts(listening(arcs, gains={"c": 1}), "G").unreached == ()
    assert graph_facts(listening(arcs, gains={"a": 1}), "G").unreached == ("b", "c")


def test_without_pins_nobody_is_reached():
    assert graph_facts(listening([[1, 2]]), "G").unreached == ("1", "2")


def test_components_and_those_that_hear_nobody_outside():
    """{1, 2} hear each other and 3; 3 and the lonely 4 hear nobody."""
    facts = graph_facts(listening([[1, 2], [2, 1], [2, 3]], agents=4, gains={"1": 1}), "G")
    assert facts.components == (("1", "2"), ("3",), ("4",))
    assert facts.sources == (("3",), ("4",))
    assert facts.unreached == ("3", "4")
    assert not facts.is_strongly_connected


def test_degrees_count_whom_an_agent_hears_and_who_hears_it():
    facts = graph_facts(listening([[1, 2], [1, 3], [2, 3]]), "G")
    assert facts.heard == (2, 1, 0)
    assert facts.hearing == (0, 1, 2)
    assert facts.arcs == 3


def test_balance_is_exact():
    """0.1 + 0.2 is 0.3 here."""
    assert graph_facts(listening([[1, 2, 0.1], [1, 3, 0.2], [2, 1, 0.1], [3, 1, "1/5"]]), "G").balanced
    assert graph_facts(listening([[1, 2, 0.3], [2, 3, 0.1], [2, 4, 0.2], [3, 1, 0.1], [4, 1, 0.2]]), "G").balanced
    assert not graph_facts(listening([[1, 2], [2, 1, 2]]), "G").balanced


def test_the_papers_cycle_is_balanced_and_strongly_connected():
    facts = graph_facts(load_problem("paper-fixed"), "Ga")
    assert facts.balanced
    assert facts.is_strongly_connected
    assert facts.unreached == ()
    assert facts.heard == (1,) * 10


def test_random_graphs_agree_with_the_transitive_closure():
    rng = np.random.default_rng(0)
    for _ in range(50):
        n = int(rng.integers(2, 8))
        hears = (rng.random((n, n)) < 0.25) & ~np.eye(n, dtype=bool)
        pinned = rng.random(n) < 0.3
        arcs = [[int(i), int(j)] for i, j in np.argwhere(hears)]
        problem = listening(arcs, agents=[*range(n)], gains={i: 1 for i in range(n) if pinned[i]})
        facts = graph_facts(problem, "G")
        # closure[i, j]: i is j, or hears it, if need be through others
        closure = np.linalg.matrix_power(np.eye(n, dtype=int) + hears, n) > 0
        assert facts.unreached == tuple(str(i) for i in range(n) if not closure[i][pinned].any())
        mutual = closure & closure.T
        assert set(facts.components) == {tuple(map(str, np.flatnonzero(row).tolist())) for row in mutual}
        closed = {
            tuple(map(str, np.flatnonzero(mutual[i]).tolist())) for i in range(n) if (closure[i] == mutual[i]).all()
        }
        assert set(facts.sources) == closed


def test_an_unknown_mode_is_a_key_error():
    with pytest.raises(KeyError, match="H"):
        graph_facts(listening([[1, 2]]), "H")


def test_many_unreached_agents_are_not_all_listed():
    text = str(graph_facts(listening([], agents=15), "G"))
    assert 'mode "G": 0 arcs, 15 strongly connected component(s), balanced, not reached: 1, 2,' in text
    assert text.endswith("10 and 5 more")
