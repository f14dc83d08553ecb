"""A problem in words: who listens to whom, who is pinned, who is not reached."""

from html import unescape
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import linked, network_of

from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.conditions.consensus.network import cure_in_words
from dobc_design.description.words import describe, facts
from dobc_design.loop.arcs import closed_groups, unreached
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import load_problem

CHAIN = network_of([("a", "b"), ("b", "c", "1/2")], ["a", "b", "c", "d"])


IN_WORDS = """\
chain: 4 agents, 2 arcs, labels a, b, c, d.
1 state component each, no disturbance.
Target: 0. Coupling: h = tanh(y).
Mode "G": 2 arcs.
  a listens to b
  b listens to c (weight 0.5)
  NOT REACHED from a pinned agent: d.
Pinned: c (k = 0.5625).
Simulations: 20 s, seed 0.
Look at this: Agents without any arc: d. Is an arc missing?"""


def chain(coupling: str = "y", **given: Any) -> Problem:
    return Problem(network=CHAIN, coupling=coupling, **given)


def test_words_say_who_listens_to_whom_and_who_is_not_reached():
    problem = chain("tanh(y)", name="chain", gains={"c": "9/16"})
    assert describe(problem) == IN_WORDS


RICH_IN_WORDS = """\
rich: 2 agents, 2 modes (1 arc, 1 arc), labels 1 to 2.
2 state components each, disturbance of order 2.
Target: (1, 0.5). Coupling: h = y (1 arc with another).
Mode "A": 1 arc.
  1 listens to 2
  NOT REACHED from a pinned agent: 2.
Mode "B": 1 arc.
  2 listens to 1
  Every agent is reached from a pinned agent.
Pinned: 1 (k = matrix).
Other couplings: h = 2*y where 1 listens to 2.
Formation offsets: 2: (1.5, 1.5).
Observer gain W: given. P: given, will be tested.
Region asked for: initial states in [0, 5], [0, 5], estimation error at most 0.5.
Proofs may assume: nothing of the signal (any mode, for any time).
Simulations: 20 s, seed 0.
Note: Invented.
Disturbance: sine of 2 rad/s (0.3183 Hz, period 3.142 s).
Time scales near the target: fastest 0.316 s (network), slowest 1 s (observer); \
sample and integrate with steps of at most 0.03 s."""


def test_words_say_what_else_is_asked():
    one = [[1, 0], [0, 1]]
    rich: dict[str, Any] = {"name": "rich", "notes": ["Invented."]}
    rich["network"] = network_of({"A": [(1, 2)], "B": [(2, 1)]})
    rich["coupling"] = "y"
    rich["exceptions"] = {(0, 1): "2*y"}
    rich["exosystem"] = Exosystem(A=[[0, 2], [-2, 0]], C=one)
    rich["observer"] = Observer(W=one, P=one)
    rich["target"] = [1, "1/2"]
    rich["offsets"] = {2: 1.5}
    rich["gains"] = {1: [[1, 1], [-1, 1]]}
    rich["region"] = {"initial_states": [0, 5], "initial_disturbance": 0.5}
    assert describe(Problem(**rich)) == RICH_IN_WORDS


TABLES: list[Any] = []


def table(words: str, /, **tables: Any) -> None:
    """What is said of the tables of a file; the first one names the case."""
    first_key = next(iter(tables))
    TABLES.append(pytest.param(tables, words, id=first_key))


SOME = (
    "Actuators: |u_i| by component is at most a: 0.5, b: 2; the inputs of the other "
    "agents have no limit; |d_i| is at most 3 by component."
)
table(SOME, actuators={"limit": {"a": "1/2", "b": 2}, "amplitude": 3})
EVERY = "Actuators: |u_i| is at most 4 by component, for every agent; how large |d_i| may be "
table(EVERY, actuators={"limit": 4})
STARTED = {"xi0": [1]}
NO_LIMIT = "Actuators: inputs have no limit; |d_i| is at most 3 by component."
table(NO_LIMIT, actuators={"amplitude": 3}, simulation=STARTED)
FROM_RUNS = "; |d_i| is as large as from simulation.xi0."
table(FROM_RUNS, actuators={"limit": 4}, simulation=STARTED)
ALL_UNCERTAIN = (
    "Uncertainty: every arc weight may be 5 % off; every gain may be 2 % off; a "
    "disturbance that no exosystem generates, |w_i|, is at most 0.1; |xi' - A xi| is at "
    "most 0.01; the noise of every measured state is at most 1."
)
NOISE: dict[str, Any] = {"disturbance": "0.1", "drift": "0.01", "measurement": 1}
table(ALL_UNCERTAIN, uncertainty=NOISE | {"weights": "0.05", "gains": "0.02"})
UNKNOWN = (
    "Uncertainty: every arc weight may be 5 % off; the observers do not know the true weights."
)
table(UNKNOWN, uncertainty={"weights": "0.05", "known_to_agents": False})
DESIGNED = "Observer gain W: to be designed for a decay rate of 3 1/s."
table(DESIGNED, observer=Observer(rate=3))
RUNS = (
    "Simulations: 7 s, seed 3; they start at x0, all agents at 2; the exosystem starts "
    "at xi0, 1 for all agents."
)
table(RUNS, simulation={"t_final": 7, "seed": 3, "x0": [2], "xi0": [1]})
OTHERS = "Other couplings: h = 2*y where a listens to b; h = tanh(y) where b listens to c."
table(OTHERS, exceptions={(0, 1): "2*y", (1, 2): "tanh(y)"})
table("Formation offsets: a: 1.", offsets={"a": 1})
BOX = {"initial_states": [0, 1], "initial_disturbance": 1}
table("Region asked for: initial states in [0, 1]", region=BOX)


@pytest.mark.parametrize(("tables", "words"), TABLES)
def test_every_table_of_the_file_is_repeated_in_words(tables: dict[str, Any], words: str):
    """In the text of `check`, of print(problem), and in the HTML view."""
    constant = Exosystem(A=[[0]], C=[[1]])
    problem = chain(gains={"c": 1}, exosystem=constant, **tables)
    assert words in describe(problem)
    name, _, sentence = words.rstrip(".").partition(": ")
    page = unescape(problem._repr_html_())
    for shown in (str(problem), page):
        if not sentence:
            assert name in shown
            continue
        assert sentence in shown
        assert name.lower() in shown.lower()


def test_a_problem_shows_itself_without_computing(monkeypatch: pytest.MonkeyPatch):
    """What needs an eigenvalue is said by `check`; a view asks for none."""
    problem = load_problem("paper-fixed")
    assert "sine of 2 rad/s" in describe(problem)
    for name in ("eig", "eigvals"):
        monkeypatch.setattr(np.linalg, name, None)
    for shown in (str(problem), problem._repr_html_()):
        assert "sine of" not in shown
        assert "time scales" not in shown.lower()
    with pytest.raises(TypeError, match="NoneType"):
        describe(problem)


def test_long_lists_are_cut():
    arcs = [(1, i) for i in range(2, 2000)]
    star = Network.from_arcs(arcs, arrow="sends_to", agents=2000)
    assert "Pinned: nobody." in describe(Problem(network=star, coupling="y"))
    text = describe(Problem(network=star, coupling="y", gains=1))
    assert len(text) < 3000
    assert "and 1970 more" in text
    assert "\n  ...\n" in text


FACTS: dict[str, Any] = {"name": "chain", "notes": ["Invented."]}
FACTS |= {"agents": 4, "dimension": 1, "exosystem_order": 0}
FACTS["modes"] = {"G": {"arcs": 2, "unreached": ["d"]}}
FACTS |= {"pinned": ["c"], "switching": None, "warnings": []}
FACTS["remarks"] = ["Agents without any arc: d. Is an arc missing?"]


def test_facts_are_the_same_for_a_program():
    problem = chain(name="chain", gains={"c": 1}, notes=["Invented."])
    assert facts(problem) == FACTS


def groups_of(problem: Problem) -> tuple[tuple[int, ...], ...]:
    return closed_groups(loop_of(problem), problem.network.modes.values())


@settings(max_examples=20)
@given(st.integers(1, 7), st.data())
def test_closed_groups_are_the_components_that_hear_nobody_else(n, data):
    agent = st.integers(1, n)
    pairs = st.tuples(agent, agent).filter(lambda arc: arc[0] != arc[1])
    arcs = data.draw(st.sets(pairs, max_size=14))
    graph = nx.DiGraph(list(arcs))
    graph.add_nodes_from(range(1, n + 1))
    inner = nx.condensation(graph)
    expected = set()
    for component, members in inner.nodes(data="members"):
        if inner.out_degree(component) == 0:
            expected.add(frozenset(i - 1 for i in members))
    found = groups_of(linked(sorted(arcs), n))
    assert set(map(frozenset, found)) == expected


def test_a_chain_of_twenty_thousand_agents_needs_no_recursion():
    n = 20_000
    arcs = [(i, i + 1) for i in range(1, n)]
    assert groups_of(linked(arcs, n)) == ((n - 1,),)


def test_the_cure_names_one_agent_of_every_group_and_works():
    """Agents 1 and 2 hear each other, 4 hears 3, 5 is alone: three groups have to be pinned, not
    one agent."""
    arcs = [(1, 2), (2, 1), (4, 3)]
    problem = linked(arcs, 5)
    text = cure_in_words(loop_of(problem), list(problem.network.modes.values()))
    assert text == "Pin agent 1 or 2, and agent 3, and agent 5."
    two_pins = {1: 1, 3: 1}
    for pins, left in ((two_pins | {5: 1}, ()), (two_pins, (4,))):
        pinned = linked(arcs, 5, gains=pins)
        assert unreached(loop_of(pinned), pinned.network.modes.values()) == left
