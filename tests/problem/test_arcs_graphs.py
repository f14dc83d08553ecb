"""GraphML, GML, Pajek and Matrix Market, against what networkx and SciPy write and read."""

from fractions import Fraction
from typing import Any

import networkx as nx
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import dobc_design as dd
from dobc_design.errors import SpecError


def read(path, **options) -> dd.Network:
    return dd.problem_from_file(path, arrow="listens_to", **options).network


def as_networkx(network: dd.Network) -> nx.DiGraph:
    graph = nx.DiGraph()
    graph.add_nodes_from(network.labels)
    arcs = ((network.labels[i], network.labels[j], float(w)) for i, j, w in network.modes["G"])
    graph.add_weighted_edges_from(arcs)
    return graph


GRAPHS = {"directed": nx.DiGraph(), "undirected": nx.Graph()}
for each in GRAPHS.values():
    each.add_nodes_from(["north gate", "b", "c", "alone"])
    each.add_edge("north gate", "b", weight=0.25)
    each.add_edge("b", "c", weight=3.0)


@pytest.mark.parametrize("kind", GRAPHS)
@pytest.mark.parametrize("name", ["net.graphml", "net.gml", "net.net", "net.txt"])
def test_what_networkx_writes_is_read_as_networkx_reads_it(tmp_path, kind, name):
    graph = GRAPHS[kind]
    writers = {".graphml": nx.write_graphml, ".gml": nx.write_gml}
    writers.get(name[3:], nx.write_pajek)(graph, tmp_path / name)
    found = as_networkx(read(tmp_path / name))
    assert list(found) == list(graph)
    assert nx.utils.graphs_equal(found, nx.DiGraph(graph))


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("name", ["net.mtx", "net.txt"])
def test_a_matrix_is_read_as_from_sparse_reads_it(tmp_path, symmetry, name):
    rng = np.random.default_rng(3)
    drawn = rng.integers(0, 3, (6, 6))
    dense = np.triu(drawn * 0.5, 1)
    dense = dense + dense.T if symmetry == "symmetric" else dense
    matrix = sp.coo_array(dense)
    with open(tmp_path / name, "wb") as stream:
        scipy.io.mmwrite(stream, matrix, symmetry=symmetry)
    wanted = dd.Network.from_sparse(matrix, arrow="listens_to")
    found = read(tmp_path / name)
    assert found.labels == wanted.labels
    assert sorted(found.modes["G"]) == sorted(wanted.modes["G"])


def test_a_matrix_without_values_has_weights_1_and_zeros_are_no_arcs(tmp_path):
    path = tmp_path / "net.mtx"
    path.write_text(
        "%%MatrixMarket matrix coordinate pattern general\n% made by hand\n3 3 2\n1 2\n3 1\n"
    )
    found = sorted(read(path).modes["G"])
    expected = [(0, 1, 1), (2, 0, 1)]
    assert found == expected
    path.write_text(
        "%%MatrixMarket matrix coordinate real general\n3 3 3\n1 2 0.1\n2 3 0.0\n3 1 0e0\n"
    )
    assert list(read(path).modes["G"]) == [(0, 1, Fraction(1, 10))]


@pytest.mark.parametrize("name", ["weight", "w", "value"])
def test_graphml_and_gml_know_the_same_names_of_weights(tmp_path, name):
    graph = nx.DiGraph()
    graph.add_edge("a", "b", **{name: 2.5})
    nx.write_graphml(graph, tmp_path / "net.graphml")
    nx.write_gml(graph, tmp_path / "net.gml")
    for ending in ("graphml", "gml"):
        arcs = read(tmp_path / f"net.{ending}").modes["G"]
        weights = [weight for _, _, weight in arcs]
        assert weights == [Fraction(5, 2)]


PARALLEL = """<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key attr.name="LinkSpeedRaw" attr.type="double" for="edge" id="d36"/>
<graph edgedefault="undirected"><node id="0"/><node id="1"/><node id="2"/>
<edge source="0" target="1"><data key="d36">1e10</data></edge>
<edge id="e1" source="0" target="1"><data key="d36">1e9</data></edge>
<edge source="1" target="2"/><edge source="2" target="2"/></graph></graphml>
"""


def test_parallel_edges_and_loops_of_a_graph_are_refused_with_the_cure_that_works(tmp_path):
    path = tmp_path / "net.graphml"
    path.write_text(PARALLEL)
    with pytest.raises(SpecError, match=r"edge 4 is a self-arc.*--drop-loops"):
        read(path, merge="sum")
    with pytest.raises(SpecError, match=r"edge 2 repeats an arc.*--merge sum"):
        read(path, drop_loops=True)
    network = read(path, merge="sum", drop_loops=True)
    found = sorted(network.modes["G"])
    expected = [(0, 1, 2), (1, 0, 2), (1, 2, 1), (2, 1, 1)]
    assert found == expected


def test_weights_of_gml_may_be_called_value_and_labels_may_be_missing(tmp_path):
    path = tmp_path / "net.gml"
    path.write_text(
        "graph [ node [ id 3 ] node [ id 1 ] edge [ source 3 target 1 value 2 graphics [ w 9 ] ] ]"
    )
    network = read(path)
    assert network.labels == ("1", "3")
    found = sorted(network.modes["G"])
    expected = [(0, 1, 2), (1, 0, 2)]
    assert found == expected


def test_lists_of_pajek_name_all_that_a_vertex_leads_to(tmp_path):
    path = tmp_path / "net.net"
    path.write_text(
        '*Network x\n*Vertices 3\n1 "a" 0.1 0.2\n2 b\n*Arcslist\n1 2 3\n*Edges\n2 3 0.5\n'
    )
    network = read(path)
    assert network.labels == ("a", "b", "3")
    expected = [(0, 1, 1), (0, 2, 1), (1, 2, Fraction(1, 2)), (2, 1, Fraction(1, 2))]
    assert sorted(network.modes["G"]) == expected


MM = "%%MatrixMarket matrix coordinate real general\n"


REFUSED: list[Any] = [
    ("net.graphml", "<graphml><graph><hyperedge/></graph></graphml>", "holds hyperedges"),
    ("net.gml", "graph [ node [ id 1", "a bracket is not closed"),
    ("net.gml", "graph [ ] ] x", "not valid GML near"),
    ("net.gml", "graph [ ] graph [ ]", "must hold one graph; it holds 2"),
    (
        "net.gml",
        'graph [ node [ id 1 label "a" ] node [ id 2 label "a" ] ]',
        "two nodes called 'a'",
    ),
    ("net.gml", "graph [ node [ id 1 ] edge [ source 1 target 2 ] ]", "edge 1 has the target '2'"),
    (
        "net.gml",
        "graph [ node [ id 1 ] node [ id 2 ] edge [ source 1 target 2 weight -1 ] ]",
        "network.negative must say",
    ),
    (
        "net.net",
        "*Vertices 2\n*Arcs\n1 3\n",
        "line 3 names vertex '3'; vertices are numbered 1 to 2",
    ),
    ("net.net", "*Vertices 2 1\n*Edges\n1 2\n", "two kinds of vertices"),
    ("net.net", "*Vertices 2\n*Matrix\n0 1\n1 0\n", r"has the part '\*Matrix', which is not read"),
    ("net.net", "*Vertices 2\n*Arcs\n1 2\n*Vertices 2\n", "begins a second network"),
    ("net.net", "*Vertices 99999999999\n", "must say how many nodes there are"),
    ("net.net", '*Vertices 2\n1 "a"\n2 "a"\n', "two nodes called 'a'"),
    ("net.mtx", "1 2 0.5\n", "must begin with %%MatrixMarket"),
    (
        "net.mtx",
        MM.replace("real", "complex") + "2 2 1\n1 2 1 1\n",
        "must begin with %%MatrixMarket",
    ),
    ("net.mtx", MM + "2 3 1\n1 2 1\n", "must be square"),
    ("net.mtx", MM + "2 2 2\n1 2 1\n", "announces 2 entries and holds 1"),
    ("net.mtx", MM + "2 2 1\n1 3 1\n", "leaves the matrix, which is 2 x 2"),
    ("net.mtx", MM + "2 2 1\n1 2\n", "line 3 must be i j value; got '1 2'"),
    ("net.mtx", MM + "2 2 1\n1 2 nan\n", "weight must be a number"),
    ("net.mtx", MM + "2 2 1\n1 1 4\n", "is a self-arc"),
]


@pytest.mark.parametrize(("name", "text", "match"), REFUSED)
def test_a_graph_that_cannot_be_meant_is_refused(tmp_path, name, text, match):
    (tmp_path / name).write_text(text)
    with pytest.raises(SpecError, match=match):
        read(tmp_path / name)


def test_brackets_without_end_are_refused_in_linear_time(tmp_path):
    (tmp_path / "net.gml").write_text("graph [ " * 100_000)
    with pytest.raises(SpecError, match="a bracket is not closed"):
        read(tmp_path / "net.gml")
