"""Arcs from files beside a problem file: CSV, edge lists, GraphML, GML, Pajek, Matrix Market.

``network.arrow`` says which column listens.  A file is read as it is meant, or refused with the
cure.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from dobc_design.errors import SpecError, about, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import named, shown
from dobc_design.problem.arcs_graphs import (
    MATRIX_MARKET,
    Graph,
    first_word,
    gml,
    graphml,
    matrix_market,
    pajek,
)
from dobc_design.problem.arcs_plain import PlainColumns, plain_columns
from dobc_design.problem.arcs_text import (
    KNOWN,
    Row,
    Source,
    Table,
    arcs_of,
    csv_table,
    edge_list_table,
    find_columns,
)
from dobc_design.problem.network import (
    ONE,
    WANTED,
    Arcs,
    check_repairs,
    directed,
    is_label,
    one_form,
    repeated,
    summed,
)

MAX_BYTES = 1_000_000_000
EMPTY = "is empty: it holds no arcs", "Add arcs, one per line."
READERS = (".csv", ".tsv", ".edges", ".edgelist", ".txt", ".graphml", ".gml", ".net", ".mtx")
_GRAPHS = {".graphml": graphml, ".gml": gml, ".net": pajek, ".mtx": matrix_market}
_SUM = (
    'write merge = "sum" beside file = (dobc new: --merge sum; Python: merge="sum") to add the '
    "weights"
)
_DROP = "write drop_loops = true beside file = (dobc new: --drop-loops; Python: drop_loops=True)"


def read_arcs_file(
    name: str,
    *,
    folder: Path | None,
    index: Mapping[str, int],
    arrow: str,
    key: str,
    merge: str | None = None,
    drop_loops: bool = False,
) -> Arcs:
    """Read the arcs of one mode; ``index`` maps labels to indices.

    CSV and edge lists: two columns and perhaps a weight, header optional; a column Type may say
    Undirected. GraphML, GML, Pajek (.net), Matrix Market (.mtx): an undirected edge gives both
    arcs. ``merge`` "sum" adds parallel arcs, ``drop_loops`` leaves out arcs from an agent to
    itself.
    Raises: SpecError with the line.
    """
    check_repairs(merge, drop_loops, key=key)
    source, path, text = _opened(name, folder=folder, key=key)
    # Plain tables are read many lines at a time; all others, and all mistakes, line by line.
    table = _table(path, text, source)
    plain = None if table is None else plain_columns(text, table, source, index)
    quick = None if plain is None else _plain_arcs(plain, source, arrow=arrow)
    if quick is not None:
        return quick
    rows = _graph(path, text, source, index).rows
    return _arcs(rows, source, index=index, arrow=arrow, merge=merge, drop_loops=drop_loops)


def _plain_arcs(plain: PlainColumns, source: Source, *, arrow: str) -> Arcs | None:
    """The arcs of plain columns; None where one is to be refused or repaired, which ``_arcs`` does
    line by line."""
    a, b = plain.first, plain.second
    if np.any(a == b) or len(repeated(a, b)):
        return None
    texts = plain.weights
    if texts is None:
        return directed(a, b, (ONE,) * len(a), arrow=arrow)
    try:
        known = {text: _weight(text, source, row=plain.line) for text in dict.fromkeys(texts)}
    except SpecError:
        return None
    return directed(a, b, tuple(map(known.__getitem__, texts)), arrow=arrow)


def read_network_file(
    name: str,
    *,
    folder: Path | None,
    arrow: str,
    key: str,
    merge: str | None = None,
    drop_loops: bool = False,
) -> tuple[tuple[str, ...], Arcs]:
    """The labels that a file names, and its arcs as ``read_arcs_file`` reads them.

    Labels stand in the order of the file, whole numbers sorted; the nodes of a graph are agents
    also without an arc.
    """
    check_repairs(merge, drop_loops, key=key)
    source, path, text = _opened(name, folder=folder, key=key)
    graph = _graph(path, text, source, {})
    ends: dict[str, None] = dict.fromkeys(graph.labels)
    for row, cells in graph.rows:
        for label in cells[:2]:
            if label in ends:
                continue
            if not is_label(label):
                what = f"names {shown(label)}; a label must be {WANTED}"
                raise source.error(what, "Correct the label.", row=row)
            ends[label] = None
    if not ends:
        raise source.error(*EMPTY)
    labels = tuple(ends)
    if all(re.fullmatch("[0-9]{1,9}", label) for label in labels):
        labels = tuple(sorted(labels, key=int))
    index = {label: place for place, label in enumerate(labels)}
    table = _table(path, text, source)
    if table is not None and _has_the_same_header(table, source, index):
        plain = plain_columns(text, table, source, index)
        quick = None if plain is None else _plain_arcs(plain, source, arrow=arrow)
        if quick is not None:
            return labels, quick
    # not with the index: what was a header above is one here
    rows = _graph(path, text, source, {}).rows
    return labels, _arcs(rows, source, index=index, arrow=arrow, merge=merge, drop_loops=drop_loops)


def _has_the_same_header(table: Table, source: Source, index: Mapping[str, int]) -> bool:
    """Whether the first line means the same with and without the agents: they may be called from
    and to."""
    first = next(table.rows(), None)
    if first is None:
        return False
    found = find_columns(first, table.rows, source, index)
    return found == find_columns(first, table.rows, source, {})


def _arcs(
    rows: Iterator[Row],
    source: Source,
    *,
    index: Mapping[str, int],
    arrow: str,
    merge: str | None,
    drop_loops: bool,
) -> Arcs:
    """The arcs of rows of any kind, one after the other.  Raises: SpecError with the line."""
    # Arrays of machine numbers: lists of tuples would take many times the memory.
    first, second, places = array("q"), array("q"), array("q")
    known: dict[str, Fraction] = {}
    weights: list[Fraction] = []
    for row, cells in rows:
        if len(cells) not in (2, 3):
            what = f"must have 2 or 3 columns, from,to[,weight]; got {len(cells)}"
            cure = "Separate them by commas in CSV, else by blanks; more columns need a header:"
            raise source.error(what, f"{cure} {KNOWN}.", row=row)
        for label in cells[:2]:
            if label not in index:
                what = f"names {shown(label)}; there is no such agent in network.agents"
                cure = "Correct the label, or add the agent. A header is known by its names:"
                raise source.error(what, f"{cure} {KNOWN}.", row=row)
        if cells[0] == cells[1] and not drop_loops:
            what = f"is a self-arc; agent {named(cells[0])} must not listen to itself"
            raise source.error(what, f"Remove that {source.unit}, or {_DROP}.", row=row)
        if len(cells) == 3 and cells[2] not in known:
            known[cells[2]] = _weight(cells[2], source, row=row)
        if cells[0] == cells[1]:
            continue
        weights.append(known[cells[2]] if len(cells) == 3 else ONE)
        first.append(index[cells[0]])
        second.append(index[cells[1]])
        places.append(row)
    if not weights:
        raise source.error(*EMPTY)
    a, b = np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)
    arcs = directed(a, b, tuple(weights), arrow=arrow)
    again = repeated(a, b)
    if len(again) and merge is None:
        what = "repeats an arc; it is a duplicate"
        cure = f"Remove that {source.unit}, or {_SUM}."
        raise source.error(what, cure, row=places[again[0]])
    return summed(arcs) if len(again) else arcs


def _opened(name: str, *, folder: Path | None, key: str) -> tuple[Source, Path, str]:
    """The file as text, and what it is called in messages.  Raises: SpecError."""
    path = _resolve(name, folder=folder, key=key)
    unit = "edge" if path.suffix.lower() in (".graphml", ".gml") else "line"
    source = Source(name=named(name), key=key, unit=unit)
    try:
        return source, path, one_form(path.read_bytes().decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        what = f"must be UTF-8 text; byte {error.start} is not"
        raise source.error(what, "Save it as UTF-8.") from None
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise source.error(what, "Check the path.") from None


def _graph(path: Path, text: str, source: Source, index: Mapping[str, int]) -> Graph:
    """What a file holds."""
    table = _table(path, text, source)
    if table is not None:
        return Graph(labels=(), rows=arcs_of(table, source, index))
    suffix = path.suffix.lower()
    if suffix in _GRAPHS:
        return _GRAPHS[suffix](text, source)
    return matrix_market(text, source) if first_word(text) == MATRIX_MARKET else pajek(text, source)


def _table(path: Path, text: str, source: Source) -> Table | None:
    """A CSV file or an edge list; None for other formats.

    The suffix says which; .txt and edge lists may be Matrix Market or Pajek, which say so at the
    top.
    """
    suffix = path.suffix.lower()
    if suffix in (".csv", ".tsv"):
        return csv_table(text, source)
    if suffix in _GRAPHS or first_word(text) in (MATRIX_MARKET, "*vertices", "*network"):
        return None
    return edge_list_table(text, source)


def _resolve(name: str, *, folder: Path | None, key: str) -> Path:
    """The path of a file that lies in the problem's folder, or below.  Raises: SpecError."""
    if folder is None:
        what = f"{shown(name)} cannot be found, the problem has no folder."
        raise about(key, what, "List the arcs instead.")
    root = folder.resolve()
    found, size = "does not exist", 0
    try:
        # Links are followed before it is asked whether the file lies in the folder.
        path = (root / name).resolve()
        inside = path.is_relative_to(root) and "\0" not in name
        if inside and path.is_dir():
            found = "is a folder"
        elif inside and path.is_file():
            found = "file"
            size = path.stat().st_size
    except (OSError, ValueError, RuntimeError):  # RuntimeError: a link to itself
        inside, found = True, "does not exist"
    if not inside:
        what = f"must lie inside the problem file's folder; {shown(name)} leads outside."
        raise wrong(key, what, "Copy the file beside the problem file.")
    if found != "file":
        what = f"must name a file in the problem file's folder; {shown(name)} {found}."
        raise wrong(key, what, "Name an existing file.")
    if size > MAX_BYTES:
        what = f"{shown(name)} is too large: {size} bytes, at most {MAX_BYTES} are read."
        raise about(key, what, "Leave out what is not needed.")
    if path.suffix.lower() not in READERS:
        what = f"{shown(name)} must end in one of {', '.join(READERS)}."
        raise about(key, what, "Rename or convert it.")
    return path


def _weight(text: str, source: Source, *, row: int) -> Fraction:
    """A weight, exact.  Raises: SpecError for 0 and for what is no number."""
    try:
        weight = parse_number(text, key="weight")
    except SpecError as error:
        raise source.error(error.message.rstrip("."), "Correct that weight.", row=row) from None
    if weight == 0:  # what a negative one may mean depends on all arcs: the network says it
        what = "weight must be > 0, because it multiplies h; got 0"
        raise source.error(what, "Leave the arc out.", row=row)
    return weight
