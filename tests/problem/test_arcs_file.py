"""Arcs from files: CSV, edge lists and GraphML mean what the same arcs in the problem file mean."""

from fractions import Fraction
from itertools import permutations
from pathlib import Path
from typing import Any

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design.errors import SpecError
from dobc_design.problem import arcs_file
from dobc_design.problem.arcs_file import read_arcs_file
from dobc_design.problem.network import Arcs

LABELS = ("a", "b", "c", "d")
ONE = Fraction(1)


def read(
    folder: Path,
    content: str | bytes,
    *,
    name: str = "arcs.csv",
    arrow: str = "listens_to",
    labels=LABELS,
):
    data = content.encode("utf-8") if isinstance(content, str) else content
    (folder / name).write_bytes(data)
    index = {label: i for i, label in enumerate(labels)}
    key = "network.modes.G.file"
    return read_arcs_file(name, folder=folder, index=index, arrow=arrow, key=key).arcs


def triples(arcs: Arcs, labels=LABELS) -> list[tuple[str, str, Fraction]]:
    return [(labels[i], labels[j], w) for i, j, w in arcs]


@pytest.mark.parametrize(
    "content",
    [
        "a,b\nb,c\n",
        "from,to\na,b\nb,c\n",
        "FROM,To,Weight\na,b,1\nb,c,1.0\n",
        "\n\nfrom,to\na,b\nb,c",
        "\ufefffrom,to\r\na,b\r\nb,c\r\n",
        ' a , b \n"b","c"\n',
        "a,b,1\nb,c\n",
    ],
)
def test_csv_may_have_a_header_a_byte_order_mark_blanks_and_quotes(tmp_path, content):
    found = triples(read(tmp_path, content))
    assert found == [("a", "b", ONE), ("b", "c", ONE)]


def test_agents_called_from_and_to_are_agents_and_no_header(tmp_path):
    labels = ("from", "to")
    arcs = read(tmp_path, "from,to\n", labels=labels)
    assert triples(arcs, labels) == [("from", "to", ONE)]
    labels = ("from", "x")  # there is no agent "to", so this is a header
    arcs = read(tmp_path, "from,to\nx,from\n", labels=labels)
    assert triples(arcs, labels) == [("x", "from", ONE)]


@pytest.mark.parametrize("name", ["arcs.edges", "arcs.edgelist", "arcs.txt", "ARCS.TXT"])
def test_edge_lists_are_separated_by_blanks_and_may_have_comments(tmp_path, name):
    arcs = read(tmp_path, "# agents\na b\n\n  b\tc  2.5 # strong\n", name=name)
    second = ("b", "c", Fraction(5, 2))
    assert triples(arcs) == [("a", "b", ONE), second]


def graphml(folder: Path, graph: nx.Graph) -> bytes:
    nx.write_graphml(graph, folder / "written.graphml")
    return (folder / "written.graphml").read_bytes()


def test_graphml_of_a_directed_graph_is_read(tmp_path):
    graph = nx.DiGraph()
    graph.add_nodes_from(LABELS)
    graph.add_edge("a", "b", weight=0.1, colour="red")
    graph.add_edge("c", "d")
    arcs = read(tmp_path, graphml(tmp_path, graph), name="g.graphml")
    first = ("a", "b", Fraction(1, 10))
    assert triples(arcs) == [first, ("c", "d", ONE)]


HEAD = '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">'


COUNTED = [("", "", 1), ("directed", "", 1), ("undirected", "", 2)]
COUNTED += [("directed", "false", 2), ("undirected", "true", 1)]


@pytest.mark.parametrize(("edgedefault", "directed", "count"), COUNTED)
def test_one_edge_may_say_otherwise_than_its_graph(tmp_path, edgedefault, directed, count):
    default = f'edgedefault="{edgedefault}"' if edgedefault else ""
    own = f'directed="{directed}"' if directed else ""
    text = f'{HEAD}<graph {default}><edge source="a" target="b" {own}/></graph></graphml>'
    assert len(read(tmp_path, text, name="g.graphml")) == count


def test_graphml_weights_have_the_default_of_their_key_and_other_data_is_ignored(tmp_path):
    text = (
        f'<?xml version="1.0" encoding="utf-8"?>{HEAD}'
        '<key id="d0" for="edge" attr.name="weight" attr.type="double"><default>2.5</default></key>'
        '<key id="d1" for="node" attr.name="weight" attr.type="double"/>'
        '<key id="d2" for="edge" attr.name="length" attr.type="double"/>'
        '<graph edgedefault="directed"><node id="a"><data key="d1">9</data></node>'
        '<edge source="a" target="b"><data key="d2">7</data></edge>'
        '<edge source="b" target="c"><data key="d0">0.3</data></edge></graph></graphml>'
    )
    arcs = read(tmp_path, text, name="g.graphml")
    first = ("a", "b", Fraction(5, 2))
    second = ("b", "c", Fraction(3, 10))
    assert triples(arcs) == [first, second]


REFUSED: list[Any] = []


def refused(message: str, text: str) -> None:
    REFUSED.append((text, message))


refused("must hold one graph; it holds 2", f"{HEAD}<graph/><graph/></graphml>")
refused("edge 1 names 'z'", f'{HEAD}<graph><edge source="a" target="z"/></graph></graphml>')
refused("edge 1 names ''", f'{HEAD}<graph><edge source="a"/></graph></graphml>')
refused(
    "edge 1 is a self-arc",
    f'{HEAD}<graph><edge directed="false" source="a" target="a"/></graph></graphml>',
)
refused("not valid GraphML", "<graphml>" * 100_000)
refused("DOCTYPE", '<!DOCTYPE g [<!ENTITY a SYSTEM "file:///etc/passwd">]><graphml>&a;</graphml>')
refused("not valid GraphML", "")


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_graphml_that_cannot_be_meant_is_refused(tmp_path, text, message):
    with pytest.raises(SpecError, match=message) as caught:
        read(tmp_path, text, name="g.graphml")
    assert caught.value.key == "network.modes.G.file"


pairs = st.sampled_from([*permutations(LABELS, 2)])
fractions = st.fractions(min_value="1/1000", max_value=1000)
arrows = st.sampled_from(["listens_to", "sends_to"])


@given(st.dictionaries(pairs, fractions, min_size=1), arrows)
@settings(max_examples=15)
def test_all_formats_mean_the_same(tmp_path_factory, weights, arrow):
    folder = tmp_path_factory.mktemp("arcs")
    expected = []
    table = blanks = edges = ""
    for (a, b), w in weights.items():
        expected.append((a, b, w) if arrow == "listens_to" else (b, a, w))
        table += f"{a},{b},{w}\n"
        blanks += f"{a} {b} {w}\n"
        edges += f'<edge source="{a}" target="{b}"><data key="w">{w}</data></edge>'
    xml = (
        f'{HEAD}<key id="w" for="edge" attr.name="weight" attr.type="string"/>'
        f'<graph edgedefault="directed">{edges}</graph></graphml>'
    )
    # the last line of a file may have no end
    written = {"arcs.csv": table.rstrip(), "arcs.txt": blanks.rstrip(), "arcs.graphml": xml}
    for name, text in written.items():
        found = read(folder, text, name=name, arrow=arrow)
        assert triples(found) == expected


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(arcs_file, "MAX_BYTES", 10)
    with pytest.raises(SpecError, match="too large: 12 bytes, at most 10 are read"):
        read(tmp_path, "a,b\nb,c\nc,d\n")


def test_a_problem_without_a_folder_has_no_files():
    key = "network.modes.G.file"
    with pytest.raises(SpecError, match="the problem has no folder"):
        read_arcs_file("arcs.csv", folder=None, index={}, arrow="listens_to", key=key)


WRONG = {
    "an unknown label": ("arcs.csv", "1,2\n2,77\n", "line 2"),
    "a duplicate": ("arcs.csv", "from,to\n1,2\n2,3\n1,2\n", "line 4"),
    "a self-arc": ("arcs.csv", "1,2\n3,3\n", "line 2"),
    "a weight of 0": ("arcs.csv", "1,2,1\n2,3,0\n", "line 2"),
    "a decimal comma": ("arcs.csv", "1;2;0.5\n2;3;0,5\n", "line 2"),
    "an empty weight": ("arcs.csv", "1,2,1\n2,3,\n", "line 2"),
    "no weight": ("arcs.edgelist", "1 2 1\n2 3 \n3 4 1\n4 4\n", "line 4"),
    "only a header": ("arcs.csv", "from,to\n", "empty"),
}


@pytest.mark.parametrize(("name", "text", "said"), WRONG.values(), ids=WRONG)
def test_a_wrong_line_is_named(name, text, said, tmp_path):
    tmp_path.joinpath(name).write_text(text)
    index = {str(place + 1): place for place in range(9)}
    with pytest.raises(SpecError, match=said):
        read_arcs_file(name, folder=tmp_path, index=index, arrow="listens_to", key="G")


def test_equal_texts_of_weights_are_one_exact_number(tmp_path):
    tmp_path.joinpath("arcs.csv").write_text("1,2,0.1\n2,3,0.1\n3,1,0.10\n")
    arcs = read_arcs_file("arcs.csv", folder=tmp_path, arrow="listens_to", key="G").arcs
    assert arcs.weights == (Fraction(1, 10),) * 3
    assert arcs.weights[0] is arcs.weights[1]
