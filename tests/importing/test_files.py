"""Files of arcs, and what decides how a file is read."""

import random

import pytest
from broken_input import mutate
from networks import tables

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.changes import problem_text


def written(tmp_path, name: str, text: str):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path / name


def test_a_csv_file_of_arcs_becomes_a_problem_once_the_arrow_is_said(tmp_path):
    path = written(tmp_path, "net.csv", "from,to,weight\n10,2,0.5\n2,3,1\n")
    problem = dd.problem_from_file(path, arrow="listens_to")
    assert problem.network.labels == ("2", "3", "10")
    found = sorted(problem.network.modes["G"])
    expected = [(0, 1, 1), (2, 0, 0.5)]
    assert found == expected
    other = written(tmp_path, "other.csv", "Source,Target,Weight\n10,2,0.5\n2,3,1\n")
    assert dd.problem_from_file(other, arrow="listens_to").network == problem.network
    turned = dd.problem_from_file(path, arrow="sends_to")
    found_turned = sorted(turned.network.modes["G"])
    expected_turned = [(0, 2, 0.5), (1, 0, 1)]
    assert found_turned == expected_turned
    with pytest.raises(SpecError, match="there is no default"):
        dd.problem_from_file(path)
    with pytest.raises(SpecError, match="listens_to"):
        dd.problem_from_file(path, arrow="hears")


@pytest.mark.parametrize(("attribute", "told"), [("weight", False), ("strength", True)])
def test_a_graph_whose_weights_have_another_name_says_that_its_arcs_weigh_one(
    tmp_path, attribute: str, told: bool
):
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph()
    graph.add_edge("a", "b", **{attribute: 2.5})
    networkx.write_graphml(graph, tmp_path / "net.graphml")
    problem = dd.problem_from_file(tmp_path / "net.graphml", arrow="listens_to")
    arcs = problem.network.modes["G"]
    weights = [w for _, _, w in arcs]
    assert weights == [1 if told else 2.5]
    assert any("call it weight" in note for note in problem.notes) is told


def test_graphml_and_edge_lists_keep_the_order_of_their_labels(tmp_path):
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph([("b", "a"), ("a", "c")])
    graph.add_node("alone")
    networkx.write_graphml(graph, tmp_path / "net.graphml")
    problem = dd.problem_from_file(tmp_path / "net.graphml", arrow="listens_to")
    assert problem.network.labels == ("b", "a", "c", "alone")
    graph.remove_node("alone")
    networkx.write_graphml(graph, tmp_path / "net.graphml")
    problem = dd.problem_from_file(tmp_path / "net.graphml", arrow="listens_to")
    edges = dd.problem_from_file(
        written(tmp_path, "net.edges", "b a\na c # last\n"), arrow="listens_to"
    )
    assert edges.network == problem.network


def test_a_list_in_which_no_two_agents_hear_each_other_says_so(tmp_path):
    """networkx writes undirected graphs as such lists; nothing in the file tells which was
    meant."""
    one_way = dd.problem_from_file(written(tmp_path, "net.edges", "a b\nb c\n"), arrow="listens_to")
    assert any(
        "no two agents hear each other" in note and "Undirected" in note for note in one_way.notes
    )
    both = dd.problem_from_file(
        written(tmp_path, "net.edges", "a b\nb c\nc b\n"), arrow="listens_to"
    )
    assert len(both.notes) == len(one_way.notes) - 1


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("net.xlsx", "", r"must end in one of \.m, \.json, "),
        ("net.csv", "", "is empty"),
        ("net.csv", "1,2,3,4\n", "2 or 3 columns"),
        ("net.csv", "1,1\n", "self-arc"),
        ("net.csv", "1,2\n1,\n", r"line 2 names \'\'; a label must be text"),
    ],
)
def test_a_wrong_file_is_named(name: str, text: str, match: str, tmp_path):
    with pytest.raises(SpecError, match=match):
        dd.problem_from_file(written(tmp_path, name, text), arrow="listens_to")


def test_a_file_that_is_not_there_and_an_arrow_that_is_not_needed_are_refused(tmp_path):
    with pytest.raises(SpecError, match="no file"):
        dd.problem_from_file(tmp_path / "net.m")
    with pytest.raises(SpecError, match="arrow is for files of arcs"):
        dd.problem_from_file(tmp_path / "case.m", arrow="listens_to")


def test_an_imported_problem_can_be_written_as_a_problem_file_and_read_back(tmp_path):
    problem = dd.problem_from_file(
        written(tmp_path, "net.csv", "a,b\nb,a,2.5\n"), arrow="listens_to"
    )
    back = dd.problem_from_file(written(tmp_path, "net.toml", problem_text(problem)))
    assert canonical_bytes(back) == canonical_bytes(problem)


CASE = """mpc.bus = [ 1 3 0; 2 1 0; ];
mpc.gen = [ 1 0 0 9 -9 1 100 1 ];
mpc.branch = [ 1 2 0 0.1 0 0 0 0 0.98 0 1; ];
"""


def healthy(kind: str) -> bytes:
    return CASE.encode() if kind == "m" else tables()


@pytest.mark.parametrize("kind", ["m", "json"])
def test_a_damaged_file_is_read_or_refused_and_never_a_crash(kind: str, tmp_path):
    """50 mutants of each; a SpecError is the only way out."""
    data = healthy(kind)
    rng = random.Random(5)
    path, refused = tmp_path / f"damaged.{kind}", 0
    path.write_bytes(data)
    assert dd.problem_from_file(path).n > 1
    for _ in range(50):
        path.write_bytes(mutate(data, rng))
        try:
            dd.problem_from_file(path)
        except SpecError as error:
            refused += 1
            assert str(error).strip()
    assert refused > 25
