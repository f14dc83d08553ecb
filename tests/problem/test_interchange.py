"""What comes from python-control, NumPy and networkx and goes back to them."""

from fractions import Fraction

import control
import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dobc_design as dd
from dobc_design import Exosystem, Network, Region
from dobc_design.errors import SpecError

WEIGHTS = st.sampled_from([1, "1/3", 0.1, 2.5, "1e-7"])
ARCS = st.dictionaries(
    st.tuples(st.integers(1, 6), st.integers(1, 6)).filter(lambda arc: arc[0] != arc[1]),
    WEIGHTS,
    min_size=1,
)


def arcs_of(network):
    """The arcs of every mode, in no order: a matrix has its own."""
    return {mode: set(arcs) for mode, arcs in network.modes.items()}


def test_an_exosystem_is_given_by_position_or_as_a_state_space():
    A = [[0, 2], [-2, 0]]
    C = [[1, 0]]
    named = Exosystem(A=A, C=C)
    assert Exosystem(A, C) == named
    B = [[0], [0]]
    system = control.ss(A, B, C, [[0]])
    assert Exosystem(system) == named
    with pytest.raises(SpecError, match="must be A and C, or a state-space system"):
        Exosystem(A)


@given(ARCS)
def test_a_network_comes_back_from_networkx_with_its_exact_weights(arcs):
    listed = [[a, b, w] for (a, b), w in arcs.items()]
    network = Network.from_arcs(listed, arrow="listens_to", agents=6)
    again = Network.from_networkx(network.to_networkx(), arrow="listens_to")
    assert again.labels == network.labels
    assert arcs_of(again) == arcs_of(network)


def test_a_mode_of_networkx_is_chosen_by_name():
    network = dd.load_problem("paper-switching").network
    assert network.to_networkx("Gb").number_of_edges() == len(network.modes["Gb"])
    with pytest.raises(SpecError, match="mode must be one of Ga, Gb, Gc, Gd; got 'Gx'"):
        network.to_networkx("Gx")


def test_the_adjacency_matrix_is_read_back_dense_and_sparse():
    """Entry (i, j): agent i listens to agent j; networkx has the same for the same edges."""
    network = dd.load_problem("paper-switching").network
    dense = {mode: matrix.toarray() for mode, matrix in network.adjacency.items()}
    for given_matrices in (network.adjacency, dense):
        again = Network.from_sparse(given_matrices, arrow="listens_to")
        assert arcs_of(again) == arcs_of(network)
    graph = network.to_networkx("Gc")
    assert np.array_equal(nx.to_numpy_array(graph, nodelist=network.labels), dense["Gc"])
    with pytest.raises(SpecError, match="SciPy sparse matrix or a NumPy array"):
        Network.from_sparse([[0, 1], [1, 0]], arrow="listens_to")


def test_fixed_nodes_come_back_from_networkx_and_from_an_adjacency_matrix():
    arcs = [[1, "a"], [2, 1], [2, "b", 3]]
    network = Network.from_arcs(arcs, arrow="listens_to", fixed=["a", "b"])
    graph = network.to_networkx()
    again = Network.from_networkx(graph, arrow="listens_to", fixed=["a", "b"])
    assert (again.labels, arcs_of(again)) == (network.labels, arcs_of(network))
    order = [2, 0, 3, 1]  # fixed nodes may stand anywhere
    labels = [network.names[place] for place in order]
    matrix = network.adjacency["G"].toarray()[np.ix_(order, order)]
    again = Network.from_sparse(matrix, arrow="listens_to", labels=labels, fixed=["a", "b"])
    assert again.labels == ("1", "2")
    assert arcs_of(again) == arcs_of(network)
    with pytest.raises(SpecError, match="fixed names 'c', which is no node"):
        Network.from_networkx(graph, arrow="listens_to", fixed=["c"])


@pytest.mark.parametrize("arrow", ["listens_to", "sends_to"])
def test_of_an_edge_without_direction_a_fixed_node_does_not_listen(arrow):
    network = Network.from_networkx(nx.path_graph(3), arrow=arrow, fixed=[0])
    assert network.names == ("1", "2", "0")
    assert arcs_of(network) == {"G": {(0, 2, 1), (0, 1, 1), (1, 0, 1)}}


def test_gains_are_given_by_label():
    problem = dd.load_problem("paper-fixed")
    assert problem.gains == {"1": Fraction(5), "6": Fraction(5)}
    assert problem.replace(gains=problem.gains) == problem


def test_a_region_needs_no_disturbance_where_there_is_no_exosystem():
    states = ((Fraction(0), Fraction(1)),)
    assert Region(initial_states=states).initial_disturbance is None


def test_what_other_packages_call_it_leads_to_the_name_here():
    with pytest.raises(
        TypeError, match=r"simulate\(\) has no argument 'x0'\. Did you mean start\?"
    ):
        dd.simulate("paper-fixed", x0=[0] * 10)
    with pytest.raises(TypeError, match=r"has no argument 'T'\. Did you mean t_final\?"):
        dd.simulate("paper-fixed", T=3)
    with pytest.raises(
        TypeError, match=r"certify\(\) has no argument 'raet'\. Did you mean rate\?"
    ):
        dd.certify("paper-fixed", raet=3)
    with pytest.raises(TypeError, match=r"has no argument 'colour'\. Its arguments are problem"):
        dd.certify("paper-fixed", colour=3)


@pytest.mark.parametrize("value", [3, None, ["paper-fixed"]])
def test_what_is_no_problem_is_said_to_be_none(value):
    with pytest.raises(TypeError, match=f"a problem is a Problem.*got {type(value).__name__}"):
        dd.certify(value)
    with pytest.raises(TypeError, match=r"From a dict: Problem\(\*\*arguments\)"):
        dd.certify({"network": 1})
