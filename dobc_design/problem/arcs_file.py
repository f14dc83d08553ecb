"""Arcs from files beside a problem file: CSV, edge lists, GraphML, GML, Pajek, Matrix Market.

``network.arrow`` says which column listens.  A file is read as it is meant, or refused with the
cure.
"""

import re
from array import array
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dobc_design._checks import noun
from dobc_design.errors import SpecError, about, wrong
from dobc_design.exact.number import ONE, parse_number
from dobc_design.exact.reading import Texts, named, shown

from .arcs_graphs import (
    MATRIX_MARKET,
    Graph,
    first_word,
    gml,
    graphml,
    matrix_market,
    pajek,
)
from .arcs_text import (
    KNOWN,
    Unfit,
    arcs_of,
    csv_table,
    edge_list_table,
)
from .network import (
    WANTED,
    Arcs,
    Index,
    check_repairs,
    directed,
    is_label,
    one_form,
    repeated,
    summed,
)

MAX_BYTES = 1_000_000_000
EMPTY = "is empty: it holds no arcs", "Add arcs, one per line."
TABLES = (".csv", ".tsv", ".edges", ".edgelist", ".txt")
EDGES = (".graphml", ".gml")  # whose edges have no line
_GRAPHS = {".graphml": graphml, ".gml": gml, ".net": pajek, ".mtx": matrix_market}
READERS = (*TABLES, *_GRAPHS)
_SUM = (
    'write merge = "sum" beside file = (dobc new: --merge sum; Python: merge="sum") to add the '
    "weights"
)
_DROP = "write drop_loops = true beside file = (dobc new: --drop-loops; Python: drop_loops=True)"


class FileArcs(NamedTuple):
    """The labels that a file names, and the arcs between them."""

    labels: Texts
    arcs: Arcs


@noun
class _File:
    """A file of arcs as text; ``unit``: what is counted in messages, lines or edges."""

    suffix: str
    text: str
    unit: str

    def graph(self, known: Index) -> Graph:
        """What the file holds.

        The suffix says in which format; .txt and edge lists may be Matrix Market or Pajek, which
        say so at the top.
        """
        if self.suffix in (".csv", ".tsv"):
            return Graph(labels=(), rows=arcs_of(csv_table(self.text), known))
        said = first_word(self.text)
        if self.suffix in _GRAPHS:
            return _GRAPHS[self.suffix](self.text)
        if said == MATRIX_MARKET:
            return matrix_market(self.text)
        if said in ("*vertices", "*network"):
            return pajek(self.text)
        return Graph(labels=(), rows=arcs_of(edge_list_table(self.text), known))


def read_arcs_file(
    name: str,
    *,
    folder: Path | None,
    arrow: str,
    key: str,
    index: Index | None = None,
    merge: str | None = None,
    drop_loops: bool = False,
) -> FileArcs:
    """Read the arcs of one mode; ``index`` maps labels to indices.  Without it agents are those
    that the file names, in its order, whole numbers sorted; of a graph also nodes without an arc.

    CSV and edge lists: two columns and perhaps a weight, header optional; a column Type may say
    Undirected. GraphML, GML, Pajek (.net), Matrix Market (.mtx): an undirected edge gives both
    arcs. ``merge`` "sum" adds parallel arcs, ``drop_loops`` leaves out arcs from an agent to
    itself.
    Raises: SpecError with the line.
    """
    check_repairs(merge, drop_loops, key=key)
    path = _resolve(name, folder=folder, key=key)
    suffix = path.suffix.lower()
    unit = "edge" if suffix in EDGES else "line"
    try:
        file = _File(suffix=suffix, text=_text(path), unit=unit)
        # Without agents a name at the top may be that of a column, as it was when labels were read.
        known = {} if index is None else index
        places = _places(file) if index is None else index
        repairs = _Repairs(merge=merge, drop_loops=drop_loops)
        arcs = _arcs(file, known, index=places, arrow=arrow, repairs=repairs)
    except Unfit as fault:
        row, what, cure = fault.args
        line = "" if row is None else f" {unit} {row}"
        raise about(key, f'"{named(name)}"{line} {what}.', cure) from None
    return FileArcs(labels=tuple(places), arcs=arcs)


def _places(file: _File) -> dict[str, int]:
    """The labels that a file names, with their places."""
    graph = file.graph({})
    ends = dict.fromkeys(graph.labels)
    for row, cells in graph.rows:
        for label in cells[:2]:
            if label in ends:
                continue
            if not is_label(label):
                raise Unfit(
                    row, f"names {shown(label)}; a label must be {WANTED}", "Correct the label."
                )
            ends[label] = None
    if not ends:
        raise Unfit(None, *EMPTY)
    labels = list(ends)
    if all(re.fullmatch("[0-9]{1,9}", label) for label in labels):
        labels.sort(key=int)
    return {label: place for place, label in enumerate(labels)}


@noun
class _Repairs:
    """Whether parallel arcs are added up, and arcs from an agent to itself left out."""

    merge: str | None
    drop_loops: bool


def _arcs(
    file: _File,
    known: Index,
    *,
    index: Index,
    arrow: str,
    repairs: _Repairs,
) -> Arcs:
    """The arcs of a file of any kind, one after the other.  Raises: Unfit with the line."""
    # Arrays of machine numbers: lists of tuples would take many times the memory.
    first, second, places = array("q"), array("q"), array("q")
    weight_of = {}
    weights = []
    for row, cells in file.graph(known).rows:
        if len(cells) not in (2, 3):
            cure = "Separate them by commas in CSV, else by blanks; more columns need a header:"
            raise Unfit(
                row,
                f"must have 2 or 3 columns, from,to[,weight]; got {len(cells)}",
                f"{cure} {KNOWN}.",
            )
        for label in cells[:2]:
            if label not in index:
                cure = "Correct the label, or add the agent. A header is known by its names:"
                raise Unfit(
                    row,
                    f"names {shown(label)}; there is no such agent in network.agents",
                    f"{cure} {KNOWN}.",
                )
        if cells[0] == cells[1] and not repairs.drop_loops:
            raise Unfit(
                row,
                f"is a self-arc; agent {named(cells[0])} must not listen to itself",
                f"Remove that {file.unit}, or {_DROP}.",
            )
        if len(cells) == 3 and cells[2] not in weight_of:
            weight_of[cells[2]] = _weight(cells[2], row)
        if cells[0] == cells[1]:
            continue
        weights.append(weight_of[cells[2]] if len(cells) == 3 else ONE)
        first.append(index[cells[0]])
        second.append(index[cells[1]])
        places.append(row)
    if not weights:
        raise Unfit(None, *EMPTY)
    a, b = np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)
    arcs = directed(a, b, tuple(weights), arrow=arrow)
    again = repeated(a, b)
    if len(again) and repairs.merge is None:
        raise Unfit(
            places[again[0]],
            "repeats an arc; it is a duplicate",
            f"Remove that {file.unit}, or {_SUM}.",
        )
    return summed(arcs) if len(again) else arcs


def _text(path: Path) -> str:
    """The file as text.  Raises: Unfit."""
    try:
        return one_form(path.read_bytes().decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise Unfit(
            None, f"must be UTF-8 text; byte {error.start} is not", "Save it as UTF-8."
        ) from None
    except OSError as error:
        raise Unfit(None, f"cannot be read: {error.strerror or error}", "Check the path.") from None


def _resolve(name: str, *, folder: Path | None, key: str) -> Path:
    """The path of a file that lies in the problem's folder, or below.  Raises: SpecError."""
    if folder is None:
        raise about(
            key,
            f"{shown(name)} cannot be found, the problem has no folder.",
            "List the arcs instead.",
        )
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
        raise wrong(
            key,
            f"must lie inside the problem file's folder; {shown(name)} leads outside.",
            "Copy the file beside the problem file.",
        )
    if found != "file":
        raise wrong(
            key,
            f"must name a file in the problem file's folder; {shown(name)} {found}.",
            "Name an existing file.",
        )
    if size > MAX_BYTES:
        raise about(
            key,
            f"{shown(name)} is too large: {size} bytes, at most {MAX_BYTES} are read.",
            "Leave out what is not needed.",
        )
    if path.suffix.lower() not in READERS:
        raise about(
            key, f"{shown(name)} must end in one of {', '.join(READERS)}.", "Rename or convert it."
        )
    return path


def _weight(text: str, row: int) -> Fraction:
    """A weight, exact.  Raises: Unfit for 0 and for what is no number."""
    try:
        weight = parse_number(text, "weight")
    except SpecError as error:
        raise Unfit(row, error.message.rstrip("."), "Correct that weight.") from None
    if weight == 0:  # what a negative one may mean depends on all arcs: the network says it
        raise Unfit(row, "weight must be > 0, because it multiplies h; got 0", "Leave the arc out.")
    return weight
