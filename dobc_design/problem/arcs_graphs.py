"""Graphs in the files of other programs: GraphML, GML, Pajek, Matrix Market.

Weights stay the decimal text that they are in the file.  An undirected edge gives both arcs.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from html import unescape
from itertools import chain
from xml.etree import ElementTree

from dobc_design._checks import noun
from dobc_design.errors import reason_of
from dobc_design.exact.reading import Names, Texts, named, repeated_name, shown

from .arcs_text import WEIGHTS, Row, Unfit
from .network import MOST_AGENTS


@noun
class Graph:
    """What a file says: its nodes in their order, also those without an arc, and its arcs."""

    labels: Texts
    rows: Iterator[Row]


def graphml(text: str) -> Graph:
    """Read GraphML; the weights are those of the edge attribute 'weight' ('w', 'value').  Raises:
    SpecError."""
    root, found = _graphml_graph(text)
    if found is None:
        return Graph(labels=(), rows=iter(()))
    labels = tuple(node.get("id", "") for node in found if _tag(node) == "node")
    return Graph(labels=labels, rows=_graphml_rows(root, found))


def _graphml_graph(text: str) -> tuple[ElementTree.Element, ElementTree.Element | None]:
    """The root of a GraphML file and its one graph, if it has any."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise Unfit(None, "must not hold a DOCTYPE or entities", "Save plain GraphML.")
    try:
        root = ElementTree.fromstring(text)  # expat expands nothing: entities are refused above
    except (ElementTree.ParseError, RecursionError) as error:
        raise Unfit(
            None, f"is not valid GraphML ({reason_of(error)})", "Export it again."
        ) from None
    # Namespaces differ from program to program; tags without them do not.
    tags = [(_tag(node), node) for node in root.iter()]
    graphs = [node for tag, node in tags if tag == "graph"]
    if len(graphs) > 1:
        raise _several_graphs(len(graphs))
    if any(tag == "hyperedge" for tag, _ in tags):
        raise Unfit(
            None, "holds hyperedges, which are no arcs", "Replace each by edges between two nodes."
        )
    return root, graphs[0] if graphs else None


def _several_graphs(count: int) -> Unfit:
    return Unfit(
        None, f"must hold one graph; it holds {count}", "Save each mode in a file of its own."
    )


def _graphml_rows(root: ElementTree.Element, graph: ElementTree.Element) -> Iterator[Row]:
    """The edges of a GraphML graph, each with the weight it has, or the default one."""
    weights = _weight_keys(root)
    default = [text for text in weights.values() if text is not None][:1]
    undirected = graph.get("edgedefault") == "undirected"
    edges = (node for node in graph if _tag(node) == "edge")
    for number, edge in enumerate(edges, start=1):
        both = {"true": False, "false": True}.get(edge.get("directed", ""), undirected)
        own = []
        for node in edge:
            if _tag(node) == "data" and node.get("key") in weights:
                own.append(node.text or "")
        a, b = edge.get("source", ""), edge.get("target", "")
        yield from _edge(number, a, b, (own or default)[:1], both=both)


def _weight_keys(root: ElementTree.Element) -> dict[str | None, str | None]:
    """The ids under which edges carry a weight, with its default."""
    keys = [node for node in root.iter() if _tag(node) == "key"]
    keys = [node for node in keys if node.get("for") in ("edge", "all")]
    for name in WEIGHTS:
        own = [node for node in keys if node.get("attr.name", "").lower() == name]
        if own:
            return {node.get("id"): _default(node) for node in own}
    return {}


def _default(key: ElementTree.Element) -> str | None:
    """What a GraphML key says of edges that do not have it."""
    for part in key:
        if _tag(part) == "default":
            return part.text or ""
    return None


def _tag(node: ElementTree.Element) -> str:
    """The name of an XML element without its namespace."""
    return str(node.tag).rsplit("}", 1)[-1]


def _edge(number: int, a: str, b: str, weight: Names, *, both: bool) -> Iterator[Row]:
    """One edge as one arc, or as both."""
    yield number, [a, b, *weight]
    if both:
        yield number, [b, a, *weight]


_TOKEN = re.compile(r'"[^"]*"|\[|\]|[^\s\[\]"]+')
# keys of GML and their values, in the order of the file
Entries = list[tuple[str, "str | Entries"]]


def gml(text: str) -> Graph:
    """Read GML; labels are those of the nodes, or their ids where some have none.  Raises:
    SpecError."""
    top = _gml_entries(text)
    graphs = [value for key, value in top if key == "graph" and isinstance(value, list)]
    if len(graphs) != 1:
        raise _several_graphs(len(graphs))
    nodes = [_plain_entries(value) for key, value in graphs[0] if key == "node"]
    edges = [_plain_entries(value) for key, value in graphs[0] if key == "edge"]
    if not all("id" in node for node in nodes):
        raise Unfit(None, "has a node without an id", "Export it again.")
    # Edges name ids, people name labels.
    ids = [node["id"] for node in nodes]
    labels = ids
    if all("label" in node for node in nodes):
        labels = [node["label"] for node in nodes]
    _different(labels)
    _different(ids)
    label_of = dict(zip(ids, labels, strict=True))
    both = _plain_entries(graphs[0]).get("directed", "0") == "0"
    return Graph(labels=tuple(labels), rows=_gml_rows(edges, label_of, both=both))


def _gml_entries(text: str) -> Entries:
    """The keys and values of a file; a list is a value in brackets."""
    # Lines stay where they are, comments become empty.
    bare = "\n".join("" if line.lstrip().startswith("#") else line for line in text.splitlines())
    tokens = iter(_TOKEN.findall(bare))
    open_lists: list[Entries] = [[]]
    for key in tokens:
        if key == "]" and len(open_lists) > 1:
            open_lists.pop()
            continue
        value = next(tokens, None)
        if value is None or value == "]" or key in "[]" or key.startswith('"'):
            raise Unfit(None, f"is not valid GML near {shown(key)}", "Export it again.")
        if value == "[":
            inner: Entries = []
            open_lists[-1].append((key, inner))
            open_lists.append(inner)
        else:
            open_lists[-1].append((key, unescape(value.strip('"'))))
    if len(open_lists) > 1:
        raise Unfit(None, "is not valid GML: a bracket is not closed", "Export it again.")
    return open_lists[0]


def _plain_entries(value: str | Entries) -> dict[str, str]:
    """The keys of a GML list whose values are texts."""
    if isinstance(value, str):
        return {}
    return {key: text for key, text in value if isinstance(text, str)}


def _gml_rows(
    edges: Sequence[Mapping[str, str]], labels: Mapping[str, str], *, both: bool
) -> Iterator[Row]:
    """The edges of a GML graph, by the labels of their nodes."""
    for number, edge in enumerate(edges, start=1):
        for end in ("source", "target"):
            own = edge.get(end, "")
            if own not in labels:
                raise Unfit(
                    number,
                    f"has the {end} {shown(own)}; there is no node with that id",
                    "Add the node, or correct the id.",
                )
        weight = [edge[name] for name in WEIGHTS if name in edge][:1]
        yield from _edge(number, labels[edge["source"]], labels[edge["target"]], weight, both=both)


def _different(labels: Names) -> None:
    """Refuse two nodes of one name.  Raises: SpecError."""
    twice = repeated_name(labels)
    if twice is not None:
        raise Unfit(
            None, f"has two nodes called {shown(twice)}", "Give every node a label of its own."
        )


_VERTEX = re.compile(r'\s*([0-9]+)(?:\s+(?:"([^"]*)"|(\S+)))?')


def pajek(text: str) -> Graph:
    """Read a Pajek network: *Vertices, *Arcs, *Edges, *Arcslist, *Edgeslist.  Raises: SpecError."""
    labels: dict[str, str] = {}
    rows: list[Row] = []
    part = ""
    for number, line in enumerate(text.splitlines(), start=1):
        cells = line.split()
        if not cells or cells[0].startswith("%"):
            continue
        if cells[0].startswith("*"):
            part = cells[0].lower()
            if part == "*vertices":
                _no_more_vertices(labels, cells, number)
                names = map(str, range(1, _count(cells[1:2], number) + 1))
                labels = {name: name for name in names}
            elif part not in ("*network", "*arcs", "*edges", "*arcslist", "*edgeslist"):
                raise Unfit(
                    number,
                    f"has the part {shown(cells[0])}, which is not read",
                    "Save the network with *Vertices and *Arcs or *Edges.",
                )
        elif part == "*vertices":
            found = _VERTEX.match(line)
            if found is None or found[1] not in labels:
                raise Unfit(
                    number,
                    f"must begin with the number of a vertex, 1 to {len(labels)}",
                    "Correct the number.",
                )
            labels[found[1]] = found[2] or found[3] or found[1]
        else:
            rows += _pajek_rows(cells, part, labels, number)
    _different(list(labels.values()))
    return Graph(labels=tuple(labels.values()), rows=iter(rows))


def _no_more_vertices(labels: Mapping[str, str], cells: Names, row: int) -> None:
    """Refuse a second *Vertices, and two kinds of vertices.  Raises: SpecError."""
    if labels:
        raise Unfit(row, "begins a second network", "Save each mode in a file of its own.")
    if len(cells) > 2:
        raise Unfit(
            row,
            "is a network of two kinds of vertices, whose arcs are no readings between agents",
            "Save a network of one kind of vertices.",
        )


def _count(cells: Names, row: int) -> int:
    """How many nodes a file announces.  Raises: SpecError."""
    text = cells[0] if cells else ""
    if not re.fullmatch("[0-9]{1,8}", text) or not 1 <= int(text) <= MOST_AGENTS:
        raise Unfit(
            row,
            f"must say how many nodes there are, 1 to {MOST_AGENTS}; got {shown(text)}",
            "Correct the number.",
        )
    return int(text)


def _pajek_rows(cells: Names, part: str, labels: Mapping[str, str], row: int) -> Iterator[Row]:
    """The arcs of one line: i j and perhaps a weight, or i and all that it leads to."""
    lists = part.endswith("list")
    ends = cells if lists else cells[:2]
    if part in ("", "*network") or len(ends) < 2:
        raise Unfit(row, "is no arc of a Pajek network", "Save the network again.")
    unknown = next((end for end in ends if end not in labels), None)
    if unknown is not None:
        raise Unfit(
            row,
            f"names vertex {shown(unknown)}; vertices are numbered 1 to {len(labels)}",
            "Correct the number.",
        )
    # In a list every further cell is another agent, so there is no room for weights.
    weight = [] if lists else cells[2:3]
    for end in ends[1:]:
        yield from _edge(row, labels[ends[0]], labels[end], weight, both=part.startswith("*edges"))


MATRIX_MARKET = "%%matrixmarket"
_ZERO = re.compile(r"[+-]?0+(?:\.0*)?(?:[eE][+-]?[0-9]+)?")


def matrix_market(text: str) -> Graph:
    """Read a sparse matrix: entry (i, j) is the arc [i, j] and its value the weight, zeros are no
    arcs.

    Agents are called 1 to n.  Raises: SpecError.
    """
    lines = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
    _, head = next(lines, (1, []))
    values, symmetry = _matrix_kind(head)
    entries = ((number, cells) for number, cells in lines if cells and not cells[0].startswith("%"))
    row, sizes = next(entries, (1, []))
    n = _count(sizes[:1], row)
    if len(sizes) != 3 or sizes[1] != sizes[0]:
        raise Unfit(
            row, f"must be square; got {shown(' x '.join(sizes[:2]))}", "Save an n x n matrix."
        )
    rows = _matrix_rows(entries, n, with_values=values != "pattern", both=symmetry == "symmetric")
    return Graph(labels=tuple(map(str, range(1, n + 1))), rows=_all_there(rows, sizes[2]))


def _matrix_kind(head: Names) -> tuple[str, str]:
    """What the first line says of the values, and whether the matrix is symmetric.  Raises:
    SpecError."""
    kinds = [cell.lower() for cell in head]
    if kinds[:3] == [MATRIX_MARKET, "matrix", "coordinate"] and len(kinds) == 5:
        values, symmetry = kinds[3:]
        if values in ("real", "integer", "pattern") and symmetry in ("general", "symmetric"):
            return values, symmetry
    raise Unfit(
        1,
        "must begin with %%MatrixMarket matrix coordinate, then real, integer or pattern, then "
        f"general or symmetric; got {shown(' '.join(head))}",
        "Write it with scipy.io.mmwrite(file, scipy.sparse.coo_array(matrix)).",
    )


def _matrix_rows(
    entries: Iterator[tuple[int, list[str]]],
    n: int,
    *,
    with_values: bool,
    both: bool,
) -> Iterator[Row]:
    """The entries of a matrix; of a symmetric one the other half, too.  A zero comes as a row
    without labels."""
    for number, cells in entries:
        indices = all(re.fullmatch("[0-9]{1,8}", cell) for cell in cells[:2])
        if len(cells) != 2 + with_values or not indices:
            wanted = "i j value" if with_values else "i j"
            raise Unfit(number, f"must be {wanted}; got {shown(' '.join(cells))}", "Save it again.")
        i, j = int(cells[0]), int(cells[1])
        if not 1 <= min(i, j) <= max(i, j) <= n:
            raise Unfit(number, f"leaves the matrix, which is {n} x {n}", "Correct the indices.")
        # A stored zero is no arc, but it counts among the entries that the file announces.
        if with_values and _ZERO.fullmatch(cells[2]):
            yield number, []
            continue
        yield from _edge(number, str(i), str(j), cells[2:3], both=both and i != j)


def _all_there(rows: Iterator[Row], count: str) -> Iterator[Row]:
    """The arcs, once as many entries as the file announces have been read."""
    read = 0
    last = 0
    for number, cells in rows:
        if number != last:
            read += 1  # a symmetric entry is two arcs
            last = number
        if cells:
            yield number, cells
    if str(read) != count:
        raise Unfit(
            None, f"announces {named(count)} entries and holds {read}", "Save it again: it was cut."
        )


def first_word(text: str) -> str:
    """The first word of a file in lower case, which tells Matrix Market and Pajek from an edge
    list."""
    lines = (line.split() for line in text[:10_000].splitlines())
    return next(chain.from_iterable(lines), "").lower()
