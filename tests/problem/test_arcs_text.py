"""Edge lists and CSV files as other programs write them: read as they are meant, or refused with
the cure."""

from fractions import Fraction
from typing import Any

import networkx as nx
import pytest

import dobc_design as dd
from dobc_design.errors import SpecError


def read(tmp_path, name: str, text: str, **options):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return dd.problem_from_file(tmp_path / name, arrow="listens_to", **options).network


def triples(network: dd.Network) -> list[tuple[str, str, Fraction]]:
    labels = network.labels
    return sorted((labels[i], labels[j], w) for i, j, w in network.modes["G"])


def plain(*arcs: str) -> list[tuple[str, str, Fraction]]:
    """Arcs such as "ab", all with the weight 1."""
    return sorted((arc[0], arc[1], Fraction(1)) for arc in arcs)


CHAIN = plain("12", "23", "31")


WRITTEN: list[Any] = [
    ("comma.edgelist", "fromNodeId, toNodeId\n1, 2\n2, 3\n3, 1\n"),
    ("unknown.csv", "id_1,id_2\n1,2\n2,3\n3,1\n"),
    ("weights.csv", "edge1,edge2,weight\n1,2,1\n2,3,1\n3,1,1\n"),
    ("weights_w.csv", "W;Source;Target\n1;1;2\n1;2;3\n1;3;1\n"),
    ("blanks.txt", "% a comment\n# FromNodeId ToNodeId\nsource target\n1 2\n2\t3\n3 1 # last\n"),
    ("tabs.tsv", "src\tdst\n1\t2\n2\t3\n3\t1\n"),
    ("tabs.csv", "1\t2\n2\t3\n3\t1\n"),
    ("semicolons.csv", "from;to\n1;2\n2;3\n3;1\n"),
    ("semicolons.edges", "1;2\n2;3\n3;1\n"),
    ("comments.csv", "# made by hand\n1,2\n% more\n2,3\n3,1\n"),
    ("dicts.edgelist", "1 2 {}\n2 3 {'colour': '#ff0000', \"weight\": 1.0}\n3 1 {'weight': 1}\n"),
    ("dicts.csv.txt", "1,2,{'weight': 1.0}\n2,3,{}\n3,1,{}\n"),
    ("extra.csv", "Id,Label,Source,Target,Weight,Length\n7,x,1,2,1,9\n8,y,2,3,1,9\n9,z,3,1,1,9\n"),
]


@pytest.mark.parametrize(("name", "text"), WRITTEN)
def test_the_same_three_arcs_however_they_are_written(tmp_path, name, text):
    assert triples(read(tmp_path, name, text)) == CHAIN


def test_edge_lists_of_networkx_keep_their_weights(tmp_path):
    graph = nx.DiGraph()
    graph.add_edge("a", "b", weight=0.1)
    graph.add_edge("b", "c", weight=2.5, colour="red, or {so}"[:3])
    for delimiter in (" ", ",", "\t"):
        nx.write_edgelist(graph, tmp_path / "net.edgelist", delimiter=delimiter)
        network = dd.problem_from_file(tmp_path / "net.edgelist", arrow="listens_to").network
        first = ("a", "b", Fraction(1, 10))
        second = ("b", "c", Fraction(5, 2))
        assert triples(network) == [first, second]


def test_a_table_of_gephi_says_of_each_edge_whether_it_is_directed(tmp_path):
    text = "Source,Target,Type,Id,Label,Weight\nA,B,Undirected,0,,2\nB,C,Directed,1,,1\n"
    found = triples(read(tmp_path, "gephi.csv", text))
    assert found == [("A", "B", 2), ("B", "A", 2), ("B", "C", 1)]
    said = "line 3 must say Directed or Undirected in the column of types; got 'mutual'"
    with pytest.raises(SpecError, match=said):
        read(tmp_path, "gephi.csv", text.replace("Directed,1", "mutual,1"))


def test_the_first_comment_of_konect_says_whether_edges_are_directed(tmp_path):
    assert triples(read(tmp_path, "out.txt", "% sym unweighted\n% 2 3 3\n1 2\n2 3\n")) == plain(
        "12", "21", "23", "32"
    )
    assert triples(read(tmp_path, "out.txt", "% asym unweighted\n1 2\n2 3\n")) == plain("12", "23")
    assert triples(read(tmp_path, "out.txt", "% symmetric things\n1 2\n2 3\n")) == plain("12", "23")
    with pytest.raises(SpecError, match="line 2 must have 2 or 3 columns"):
        read(tmp_path, "out.txt", "% sym unweighted\n1\n2 3\n")
    with pytest.raises(SpecError, match="two kinds of nodes"):
        read(tmp_path, "out.txt", "% bip unweighted\n1 2\n2 3\n")


def test_labels_with_blanks_are_separated_by_tabs_or_commas(tmp_path):
    wanted = [("New York", "Room 5", 1), ("Room 5", "Room 6", 1)]
    assert triples(read(tmp_path, "rooms.txt", "New York\tRoom 5\nRoom 5\tRoom 6\n")) == wanted
    assert triples(read(tmp_path, "rooms.csv", "New York,Room 5\nRoom 5,Room 6\n")) == wanted
    assert (
        triples(read(tmp_path, "quoted.txt", '"New York","Room 5"\n"Room 5","Room 6"\n')) == wanted
    )


def test_a_first_line_of_which_a_name_occurs_again_is_an_arc(tmp_path):
    lead = ("lead", "wing", 1)
    names = read(tmp_path, "names.csv", "lead,wing\nwing,tail\n")
    assert triples(names) == [lead, ("wing", "tail", 1)]
    assert triples(read(tmp_path, "one.csv", "lead,wing\n")) == [lead]
    mixed = read(tmp_path, "mixed.csv", "base,1\n1,2\n")
    assert triples(mixed) == [("1", "2", 1), ("base", "1", 1)]


def test_a_header_stays_a_header_when_agents_have_its_names(tmp_path):
    """Labels and arcs of an import come from the same rows."""
    network = read(tmp_path, "net.csv", "from,to\nfrom,x\nx,to\n")
    assert triples(network) == [("from", "x", 1), ("x", "to", 1)]


REFUSED: list[Any] = [
    (
        "net.csv",
        "alpha,beta\na,b\nb,c\n",
        r"line 1 \(alpha, beta\) may be a header or an arc.*Begin the file with",
    ),
    (
        "net.csv",
        "id_1,id_2,distance\n1,2,7\n",
        r"columns \(id_1, id_2, distance\) are not known.*from,to or source",
    ),
    (
        "net.csv",
        "from,to,distance\n1,2,7\n",
        "names a column 'distance', which is not known.*Call it weight",
    ),
    ("net.csv", "from,to,weight,w\n1,2,7,1\n", "names columns of the same meaning: weight, w"),
    ("net.csv", "from,to,weight\n1,2,0,5\n", "line 2 has 4 columns; the header names 3"),
    (
        "net.csv",
        "from;to;weight\n1;2;0,5\n",
        "line 2 has the number '0,5' with a decimal comma.*0.5",
    ),
    ("net.csv", "1;2;0,5\n", "line 1 holds commas and semicolons"),
    ("net.csv", "1 2 0,5\n", "line 1 has the number '0,5' with a decimal comma"),
    ("net.edges", "1 2 0,5\n", "line 1 has the number '0,5' with a decimal comma"),
    ("net.edges", "1 2 1\n2 3 0,5\n", "line 2 has the number '0,5' with a decimal comma"),
    ("net.edges", "1, 2\n3 4 0,5\n", "line 2 holds both commas and blanks"),
    ("net.txt", "1 -> 2\n2 -> 3\n", "line 1 holds '->': it is no list of arcs.*Write a b"),
    ("net.txt", "1: 2 3\n2: 3\n", "line 1 holds '1:': it is no list of arcs"),
    ("net.edges", "1 2 3 4\n", "line 1 must have 2 or 3 columns"),
    (
        "net.edges",
        "1 2 {'weight': [1]}\n",
        r"has attributes that cannot be read.*nx.write_weighted_edgelist",
    ),
    ("net.edges", "1 2 {'weight': 1\n", r"has attributes that cannot be read"),
    ("net.csv", "a,b\na,b\n", 'line 2 repeats an arc.*merge = "sum" beside file.*--merge sum'),
    ("net.csv", "a,b\nb,b\n", "line 2 is a self-arc.*drop_loops = true beside file.*--drop-loops"),
]


@pytest.mark.parametrize(("name", "text", "match"), REFUSED)
def test_what_could_mean_two_things_is_refused_with_the_cure(tmp_path, name, text, match):
    with pytest.raises(SpecError, match=match):
        read(tmp_path, name, text)


def test_parallel_arcs_are_added_and_loops_left_out_where_that_is_asked_for(tmp_path):
    text = "a,b,0.1\nb,b,7\nb,a,1\na,b,0.2\n"
    network = read(tmp_path, "net.csv", text, merge="sum", drop_loops=True)
    there = (0, 1, Fraction(3, 10))
    back = (1, 0, Fraction(1))
    assert list(network.modes["G"]) == [there, back]
    with pytest.raises(SpecError, match="self-arc"):
        read(tmp_path, "net.csv", text, merge="sum")
    with pytest.raises(SpecError, match="repeats an arc"):
        read(tmp_path, "net.csv", text, drop_loops=True)
    with pytest.raises(SpecError, match=r"merge must be \"sum\".*got 'max'"):
        read(tmp_path, "net.csv", text, merge="max")


def test_a_problem_file_says_the_same_beside_file(tmp_path):
    (tmp_path / "arcs.csv").write_text("a,b,0.1\nb,b,7\nb,a,1\na,b,0.2\n")
    text = """
[network]
agents = ["a", "b"]
arrow = "listens_to"
[network.modes]
G = { file = "arcs.csv", merge = "sum", drop_loops = true }
[coupling]
h = "y"
"""
    (tmp_path / "p.toml").write_text(text)
    arcs = dd.load_problem(tmp_path / "p.toml").network.modes["G"]
    there = (0, 1, Fraction(3, 10))
    back = (1, 0, Fraction(1))
    assert list(arcs) == [there, back]
    without_merge = (', merge = "sum"', "", "repeats an arc")
    not_a_truth = ("true }", '"yes" }', "drop_loops must be true or false")
    for old, new, match in (
        without_merge,
        not_a_truth,
        ("merge", "marge", 'beside file may stand merge = "sum" and drop_loops = true'),
    ):
        (tmp_path / "p.toml").write_text(text.replace(old, new))
        with pytest.raises(SpecError, match=match):
            dd.load_problem(tmp_path / "p.toml")


def test_readers_in_python_know_both(tmp_path):
    repeated = [("a", "b"), ("a", "b"), ("b", "b")]
    graph = nx.MultiDiGraph(repeated)
    network = dd.Network.from_networkx(graph, arrow="listens_to", merge="sum", drop_loops=True)
    assert list(network.modes["G"]) == [(0, 1, Fraction(2))]
    pairs = list(graph.edges())
    again = dd.Network.from_arcs(pairs, arrow="listens_to", merge="sum", drop_loops=True)
    assert again == network
    with pytest.raises(SpecError, match='with merge="sum"'):
        dd.Network.from_networkx(graph, arrow="listens_to", drop_loops=True)
    with pytest.raises(SpecError, match="with drop_loops=True"):
        dd.Network.from_networkx(graph, arrow="listens_to", merge="sum")
    matrix = nx.to_scipy_sparse_array(graph)
    given: Any = {"labels": ["a", "b"], "drop_loops": True}
    assert dd.Network.from_sparse(matrix, arrow="listens_to", **given) == network
