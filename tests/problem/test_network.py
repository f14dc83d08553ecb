"""Networks from pairs, networkx graphs and sparse matrices: what an arc means is said by ``arrow``
alone."""

from fractions import Fraction
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import network_of
from scipy import sparse

from dobc_design.errors import SpecError
from dobc_design.problem.network import Arcs, Network, labels_of

CHAIN = [("a", "b"), ("b", "c", 2.5)]


def arcs_of(network: Network, mode: str = "G") -> set[tuple[str, str, Fraction]]:
    names = network.labels
    return {(names[i], names[j], w) for i, j, w in network.modes[mode]}


def indices(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def test_listens_to_makes_the_first_of_a_pair_the_listener_and_sends_to_mirrors_every_arc():
    network = Network.from_arcs(CHAIN, arrow="listens_to")
    assert network.labels == ("a", "b", "c")
    first = ("a", "b", Fraction(1))
    second = ("b", "c", Fraction(5, 2))
    assert arcs_of(network) == {first, second}
    sends = Network.from_arcs(CHAIN, arrow="sends_to")
    turned = {(j, i, w) for i, j, w in arcs_of(network)}
    assert arcs_of(sends) == turned


@pytest.mark.parametrize("arrow", ["", "to", "Listens_to", None, True, ["listens_to"], 3])
def test_any_other_arrow_is_refused(arrow):
    """There is no default: mixed-up directions are the commonest silent error."""
    said = r'network\.arrow must be "listens_to" or "sends_to"'
    with pytest.raises(SpecError, match=said) as caught:
        Network.from_arcs(CHAIN, arrow=arrow)
    assert caught.value.key == "network.arrow"


def test_the_label_1_and_the_label_quoted_1_are_one_label():
    mixed_labels = [(1, "2"), ("1", 3)]
    network = Network.from_arcs(mixed_labels, arrow="listens_to")
    assert network.labels == ("1", "2", "3")
    arcs = [(1, 2)]
    labels = [1, 2, "1"]
    with pytest.raises(SpecError, match=r"'1' appears twice"):
        Network.from_arcs(arcs, arrow="listens_to", agents=labels)


def test_a_count_gives_labels_from_one_and_a_mapping_one_mode_each_in_its_order():
    network = network_of([(1, 2)], 4)
    assert network.labels == ("1", "2", "3", "4")
    assert network.size == 4
    assert network.index == {"1": 0, "2": 1, "3": 2, "4": 3}
    modes = {"B": [(1, 2)], "A": [(2, 1)]}
    network = network_of(modes, 2)
    assert list(network.modes) == ["B", "A"]


TWICE = "1 listens to 2 already; this arc is a duplicate"
NO_WEIGHT = "must be > 0, because it multiplies h; 1 listens to 2 with 0"
WRONG_ARCS: list[Any] = [
    ([(1, 2), (1, 2)], "network.modes.G[1]", TWICE),
    ([(1, 2), (3, 3)], "network.modes.G[1]", "agent 3 must not listen to itself"),
    ([(1, 2, 0)], "network.modes.G[0]", NO_WEIGHT),
    ([(1, 2, float("nan"))], "network.modes.G[0][2]", "must be a number"),
    ([(1, 4)], "network.modes.G[0]", r"there is no agent '4' \(agents: 1, 2, 3\)"),
    ([(1, 2.0)], "network.modes.G[0][1]", "must be text or a whole number; got 2.0"),
    ([(1, 10**5000)], "network.modes.G[0][1]", "thousands of digits"),
    ([(1,)], "network.modes.G[0]", r"must be an arc \[a, b\] or \[a, b, weight\]"),
]


@pytest.mark.parametrize(("arcs", "key", "message"), WRONG_ARCS)
def test_a_wrong_arc_is_named(arcs, key, message):
    with pytest.raises(SpecError, match=message) as caught:
        Network.from_arcs(arcs, arrow="listens_to", agents=3)
    assert caught.value.key == key


NO_AGENTS: list[Any] = [0, -1, 10**8, True, 2.0, "abc", None, {}, []]
NO_AGENTS += [[""], [" "], ["x" * 201], ["\x1b[31m"], [None]]


@pytest.mark.parametrize("agents", NO_AGENTS)
def test_wrong_agents_are_refused(agents):
    with pytest.raises(SpecError) as caught:
        labels_of(agents)
    assert caught.value.key == "network.agents"


def test_a_network_needs_a_mode_and_modes_need_names():
    with pytest.raises(SpecError, match="at least one mode"):
        Network.from_arcs({}, arrow="listens_to", agents=2)
    said = "the name of a mode must be text of 1 to 200 printable"
    for name in ("", "  ", "\x1b[31mred", "x" * 201):
        with pytest.raises(SpecError, match=said):
            Network.from_arcs({name: [(1, 2)]}, arrow="listens_to")


def test_networks_are_equal_when_labels_modes_and_arcs_are_in_the_same_order():
    arcs = {"A": [(1, 2)], "B": [(2, 1)]}
    first = network_of(arcs, 2)
    again = network_of(dict(arcs), 2)
    turned = network_of(dict(reversed(arcs.items())), 2)
    assert first == again
    assert hash(first) == hash(again)
    assert first != turned, "the first mode is where simulations start"
    assert first != "network"
    assert first.modes["A"] != "arcs"


def by_hand(listener: int, speaker: int, second: str = "b") -> Network:
    arcs = Arcs(indices(listener), indices(speaker), (Fraction(1),))
    return Network(labels=("a", second), modes={"G": arcs})


def test_a_misspelled_label_of_an_arc_is_answered_by_the_label_that_was_meant():
    arcs = [["west", "eats"]]
    with pytest.raises(SpecError, match=r"'eats'.*Did you mean \"east\"\?"):
        Network.from_arcs(arcs, arrow="listens_to", agents=["west", "east"])
    with pytest.raises(SpecError, match=r"no agent '11'.*Use the label of an agent"):
        Network.from_arcs([[1, 11]], arrow="listens_to", agents=2)


def test_a_network_made_by_hand_is_checked_too():
    network = by_hand(0, 1)
    assert list(network.modes["G"]) == [(0, 1, 1)]
    for label in ("b\n", ""):
        with pytest.raises(SpecError, match="a label must be text of 1 to 200"):
            by_hand(0, 1, second=label)
    for listener, speaker in ((0, 2), (-1, 0), (2, 1)):
        with pytest.raises(SpecError, match="leaves the graph; agents are numbered 0 to 1"):
            by_hand(listener, speaker)


def test_an_undirected_edge_gives_both_arcs_with_its_weight():
    graph = nx.Graph()
    graph.add_edge(1, 2, weight=0.1)
    graph.add_node(3)
    for arrow in ("listens_to", "sends_to"):
        network = Network.from_networkx(graph, arrow=arrow)
        assert network.labels == ("1", "2", "3")
        there = ("1", "2", Fraction(1, 10))
        back = ("2", "1", Fraction(1, 10))
        assert arcs_of(network) == {there, back}


def test_several_graphs_are_modes_over_the_nodes_of_the_first():
    first = nx.DiGraph([(1, 2), (2, 3)])
    second = nx.DiGraph([("3", "1")])
    second.add_nodes_from(["2"])
    network = Network.from_networkx({"A": first, "B": second}, arrow="listens_to")
    assert network.labels == ("1", "2", "3")
    assert arcs_of(network, "B") == {("3", "1", Fraction(1))}
    second.add_node(4)
    said = r"network\.modes\.B must have the same nodes as the first mode"
    with pytest.raises(SpecError, match=said):
        Network.from_networkx({"A": first, "B": second}, arrow="listens_to")


NO_GRAPHS: list[Any] = [
    (nx.DiGraph([(1, 1)]), "must not listen to itself"),
    (nx.grid_2d_graph(2, 2), r"must be text or a whole number; got \(0, 0\)"),
    (nx.Graph([(1, "1")]), "'1' appears twice"),
    ([(1, 2)], "must be a networkx graph; got list"),
    ({"A": 5}, r"network\.modes\.A must be a networkx graph; got int"),
]


@pytest.mark.parametrize(("graph", "message"), NO_GRAPHS)
def test_a_graph_that_is_no_network_is_refused(graph, message):
    with pytest.raises(SpecError, match=message):
        Network.from_networkx(graph, arrow="listens_to")


def matrix_of(n: int, entries: Any, rows: list[int], columns: list[int]) -> sparse.coo_array:
    return sparse.coo_array((entries, (rows, columns)), shape=(n, n))


def test_entry_i_j_is_the_arc_i_j_under_arrow():
    matrix = matrix_of(3, [2, 3], [0, 1], [1, 2])
    network = Network.from_sparse(matrix, arrow="listens_to")
    assert arcs_of(network) == {("1", "2", 2), ("2", "3", 3)}
    named = Network.from_sparse(matrix, arrow="sends_to", labels=["a", "b", "c"])
    assert arcs_of(named) == {("b", "a", 2), ("c", "b", 3)}


KINDS = [np.int8, np.uint64, np.int64, np.float32, np.float64, np.longdouble]


@pytest.mark.parametrize("kind", KINDS)
def test_a_weight_is_the_decimal_text_of_its_own_type(kind):
    """0.5 and 0.1 as somebody typed them, not the nearest binary fraction."""
    one, other = Fraction(1), Fraction(3)
    if kind in (np.float32, np.float64):
        one, other = Fraction("0.1"), Fraction("0.5")
    entries = np.array([float(one), float(other)], dtype=kind)
    matrix = matrix_of(2, entries, [0, 1], [1, 0])
    network = Network.from_sparse(matrix, arrow="listens_to")
    assert arcs_of(network) == {("1", "2", one), ("2", "1", other)}


@pytest.mark.parametrize("form", ["csr", "csc", "coo", "lil", "dok", "bsr", "dia"])
def test_every_sparse_format_reads_alike_and_is_left_as_it_was(form):
    entries = matrix_of(3, [1.5, 2.0], [0, 2], [1, 0])
    matrix = entries.asformat(form)
    before = matrix.toarray()
    network = Network.from_sparse(matrix, arrow="listens_to")
    first = ("1", "2", Fraction(3, 2))
    assert arcs_of(network) == {first, ("3", "1", 2)}
    np.testing.assert_array_equal(matrix.toarray(), before)


def test_entries_stored_twice_are_added_and_stored_zeros_are_no_arcs():
    weights = [1, 2, 0]
    rows = [0, 0, 1]
    matrix = matrix_of(2, weights, rows, [1, 1, 0])
    network = Network.from_sparse(matrix, arrow="listens_to")
    assert arcs_of(network) == {("1", "2", Fraction(3))}
    assert matrix.nnz == 3


NO_MATRICES: list[Any] = []


def no_matrix(message: str, matrix: Any, labels: Any = None) -> None:
    NO_MATRICES.append((matrix, labels, message))


EMPTY = sparse.csr_array((2, 2))
no_matrix(r"must be square.*got shape \(2, 3\)", sparse.csr_array((2, 3)))
ONE_LABEL = r"one row and column per agent \(1 x 1\); got shape \(2, 2\)"
no_matrix(ONE_LABEL, EMPTY, ["a"])
TWO_SIZES = {"A": EMPTY, "B": sparse.csr_array((3, 3))}
no_matrix(r"modes\.B.*\(2 x 2\); got shape \(3", TWO_SIZES)
no_matrix(r"must be a SciPy sparse matrix or a NumPy array \(n, n\); got list", [[0, 1]])
no_matrix("network.negative must say", sparse.csr_array([[0, -1], [0, 0]]))
TRUE = np.array([[False, True], [False, False]])
no_matrix("not a boolean", sparse.csr_array(TRUE))


@pytest.mark.parametrize(("matrix", "labels", "message"), NO_MATRICES)
def test_a_matrix_that_is_no_network_is_refused(matrix, labels, message):
    with pytest.raises(SpecError, match=message):
        Network.from_sparse(matrix, arrow="listens_to", labels=labels)


@st.composite
def weighted_arcs(draw):
    n = draw(st.integers(2, 8))
    agent = st.integers(0, n - 1)
    pairs = st.tuples(agent, agent).filter(lambda pair: pair[0] != pair[1])
    whole = st.integers(1, 10**12)
    floats = st.floats(1e-300, 1e300, allow_subnormal=False)
    decimals = st.sampled_from([0.1, 1 / 3, 2.5])
    weight = st.one_of(whole, floats, decimals)
    return n, draw(st.dictionaries(pairs, weight, max_size=20))


def as_sets(arcs: dict, arrow: str) -> set[tuple[int, int, Fraction]]:
    exact = {(i, j, Fraction(repr(w))) for (i, j), w in arcs.items()}
    if arrow == "listens_to":
        return exact
    return {(j, i, w) for i, j, w in exact}


ARROWS = st.sampled_from(["listens_to", "sends_to"])


@settings(max_examples=20)
@given(weighted_arcs(), ARROWS)
def test_networkx_and_back_keeps_every_arc_and_weight(case, arrow):
    n, arcs = case
    graph = nx.DiGraph()
    graph.add_nodes_from(range(n))
    graph.add_weighted_edges_from((i, j, w) for (i, j), w in arcs.items())
    network = Network.from_networkx(graph, arrow=arrow)
    assert network.labels == tuple(map(str, range(n)))
    assert set(network.modes["G"]) == as_sets(arcs, arrow)


@settings(max_examples=20)
@given(weighted_arcs(), ARROWS)
def test_sparse_and_back_keeps_every_arc_and_weight(case, arrow):
    n, arcs = case
    floats = {pair: float(w) for pair, w in arcs.items()}
    matrix = sparse.dok_array((n, n))
    for pair, weight in floats.items():
        matrix[pair] = weight
    network = Network.from_sparse(matrix.tocsr(), arrow=arrow)
    assert set(network.modes["G"]) == as_sets(floats, arrow)
