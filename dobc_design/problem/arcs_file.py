"""Arcs from CSV, GraphML and edge-list files beside a problem file; ``network.arrow`` says which column listens."""

from __future__ import annotations

import csv
import io
import re
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dobc_design.errors import SpecError, about, reason_of, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import named, shown, shown_number
from dobc_design.problem.network import ONE, WANTED, Arcs, directed, is_label, one_form

MAX_BYTES = 1_000_000_000
EMPTY = "is empty: it holds no arcs", "Add arcs, one per line."
HEADS = (["from", "to"], ["source", "target"])  # of a CSV file; a third column is "weight"
READERS = (".csv", ".graphml", ".edges", ".edgelist", ".txt")


def read_arcs_file(name: str, *, folder: Path | None, index: Mapping[str, int], arrow: str, key: str) -> Arcs:
    """Read the arcs of one mode; ``index`` maps labels to indices.

    CSV: UTF-8, comma, from,to[,weight] or source,target[,weight], header optional.  Edge list (.edges, .edgelist,
    .txt): the same, separated by blanks, # starts a comment.  GraphML: edges with an optional numeric 'weight'; an
    undirected edge gives both arcs.
    Raises: SpecError with the line.
    """
    source, path, text = _opened(name, folder=folder, key=key)
    columns = array("q"), array("q"), array("q")
    known: dict[str, Fraction] = {}
    weights: list[Fraction] = []
    for row, cells in _rows(path, text, source, index):
        if len(cells) not in (2, 3):
            what = f"must have 2 or 3 columns, from,to[,weight]; got {len(cells)}"
            raise source.error(what, "Separate them by commas in CSV, else by blanks.", row=row)
        for label in cells[:2]:
            if label not in index:
                what = f"names {shown(label)}; there is no such agent in network.agents"
                raise source.error(what, "Correct the label, or add the agent.", row=row)
        if cells[0] == cells[1]:
            what = f"is a self-arc; agent {named(cells[0])} must not listen to itself"
            raise source.error(what, f"Remove that {source.unit}.", row=row)
        if len(cells) == 3 and cells[2] not in known:
            known[cells[2]] = _weight(cells[2], source, row=row)
        weights.append(known[cells[2]] if len(cells) == 3 else ONE)
        for column, value in zip(columns, (index[cells[0]], index[cells[1]], row), strict=True):
            column.append(value)
    a, b, places = (np.array(column, dtype=np.int64) for column in columns)
    if not weights:
        raise source.error(*EMPTY)
    codes = a * len(index) + b
    order = np.argsort(codes, kind="stable")
    again = order[1:][np.diff(codes[order]) == 0]
    if len(again):
        what, row = "repeats an arc; it is a duplicate", int(places[again.min()])
        raise source.error(what, f"Remove that {source.unit}.", row=row)
    return directed(a, b, tuple(weights), arrow=arrow)


def labels_in_file(name: str, *, folder: Path | None, key: str) -> tuple[str, ...]:
    """The labels in the order they appear, whole numbers sorted; GraphML also names agents without an arc."""
    source, path, text = _opened(name, folder=folder, key=key)
    ends: dict[str, None] = {}
    if path.suffix.lower() == ".graphml":
        _, graphs = _graphs(text, source)
        ends |= {node.get("id", ""): None for graph in graphs for node in graph if _tag(node) == "node"}
    for row, cells in _rows(path, text, source, {}):
        for label in cells[:2]:
            if not is_label(label):
                raise source.error(f"names {shown(label)}; a label must be {WANTED}", "Correct the label.", row=row)
            ends[label] = None
    if not ends:
        raise source.error(*EMPTY)
    return tuple(sorted(ends, key=int) if all(re.fullmatch("[0-9]{1,9}", label) for label in ends) else ends)


def _opened(name: str, *, folder: Path | None, key: str) -> tuple[_Source, Path, str]:
    path = _resolve(name, folder=folder, key=key)
    source = _Source(name=named(name), key=key, unit="edge" if path.suffix.lower() == ".graphml" else "line")
    try:
        return source, path, one_form(path.read_bytes().decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise source.error(f"must be UTF-8 text; byte {error.start} is not", "Save it as UTF-8.") from None
    except OSError as error:
        raise source.error(f"cannot be read: {error.strerror or error}", "Check the path.") from None


def _rows(path: Path, text: str, source: _Source, index: Mapping[str, int]) -> Iterator[Row]:
    suffix = path.suffix.lower()
    if suffix == ".graphml":
        return _graphml(text, source)
    return _csv(text, source, index=index) if suffix == ".csv" else _edge_list(text)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """Where arcs come from, for messages; ``unit``: what is counted, lines or edges."""

    name: str
    key: str
    unit: str

    def error(self, what: str, cure: str, *, row: int | None = None) -> SpecError:
        place = f'"{self.name}"' if row is None else f'"{self.name}" {self.unit} {row}'
        return SpecError(f"{self.key}: {place} {what}.", key=self.key, cure=cure)


def _resolve(name: str, *, folder: Path | None, key: str) -> Path:
    if folder is None:
        raise about(key, f"{shown(name)} cannot be found, the problem has no folder.", "List the arcs instead.")
    root = folder.resolve()
    try:
        path = (root / name).resolve()
        inside = path.is_relative_to(root) and "\0" not in name
        kind = "folder" if inside and path.is_dir() else "file" if inside and path.is_file() else "nothing"
        size = path.stat().st_size if kind == "file" else 0
    except (OSError, ValueError, RuntimeError):  # RuntimeError: a link to itself
        inside, kind, size = True, "nothing", 0
    if not inside:
        what = f"must lie inside the problem file's folder; {shown(name)} leads outside."
        raise wrong(key, what, "Copy the file beside the problem file.")
    if kind != "file":
        found = "is a folder" if kind == "folder" else "does not exist"
        what = f"must name a file in the problem file's folder; {shown(name)} {found}."
        raise wrong(key, what, "Name an existing file.")
    if size > MAX_BYTES:
        what = f"{shown(name)} is too large: {size} bytes, at most {MAX_BYTES} are read."
        raise about(key, what, "Leave out what is not needed.")
    if path.suffix.lower() not in READERS:
        raise about(key, f"{shown(name)} must end in one of {', '.join(READERS)}.", "Rename or convert it.")
    return path


Row = tuple[int, list[str]]  # number of the line or edge, [a, b] or [a, b, weight]


def _csv(text: str, source: _Source, *, index: Mapping[str, int]) -> Iterator[Row]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    first = True
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            names = [cell.lower() for cell in cells]
            named_columns = names[:2] in HEADS and names[2:] in ([], ["weight"])
            header = first and named_columns and not (cells[0] in index and cells[1] in index)
            first = False
            if not header:
                yield reader.line_num, cells
    except csv.Error as error:
        raise source.error(f"is not valid CSV ({error})", "Check the quotes.", row=reader.line_num) from None


def _edge_list(text: str) -> Iterator[Row]:
    for number, line in enumerate(text.splitlines(), start=1):
        cells = line.split("#", 1)[0].split()
        if cells:
            yield number, cells


def _graphs(text: str, source: _Source) -> tuple[ElementTree.Element, list[ElementTree.Element]]:
    """The root of a GraphML file and its one graph, if it has any."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise source.error("must not hold a DOCTYPE or entities", "Save plain GraphML.")
    try:
        root = ElementTree.fromstring(text)  # expat expands nothing: entities are refused above
    except (ElementTree.ParseError, RecursionError) as error:
        raise source.error(f"is not valid GraphML ({reason_of(error)})", "Export it again.") from None
    graphs = [node for node in root.iter() if _tag(node) == "graph"]
    if len(graphs) > 1:
        raise source.error(f"must hold one graph; it holds {len(graphs)}", "Save each mode in a file of its own.")
    return root, graphs


def _graphml(text: str, source: _Source) -> Iterator[Row]:
    root, graphs = _graphs(text, source)
    weights = _weight_keys(root)
    default = [text for text in weights.values() if text is not None][:1]
    for graph in graphs:
        undirected = graph.get("edgedefault") == "undirected"
        edges = (node for node in graph if _tag(node) == "edge")
        for number, edge in enumerate(edges, start=1):
            both = {"true": False, "false": True}.get(edge.get("directed", ""), undirected)
            own = [node.text or "" for node in edge if _tag(node) == "data" and node.get("key") in weights]
            a, b = edge.get("source", ""), edge.get("target", "")
            yield number, [a, b, *(own or default)[:1]]
            if both:
                yield number, [b, a, *(own or default)[:1]]


def _weight_keys(root: ElementTree.Element) -> dict[str | None, str | None]:
    """The ids under which edges carry a weight, with its default."""
    keys = (node for node in root.iter() if _tag(node) == "key" and node.get("attr.name") == "weight")
    return {
        node.get("id"): next((part.text or "" for part in node if _tag(part) == "default"), None)
        for node in keys
        if node.get("for") in ("edge", "all")
    }


def _tag(node: ElementTree.Element) -> str:
    return str(node.tag).rsplit("}", 1)[-1]


def _weight(text: str, source: _Source, *, row: int) -> Fraction:
    try:
        weight = parse_number(text, key="weight")
    except SpecError as error:
        raise source.error(error.message.rstrip("."), "Correct that weight.", row=row) from None
    if weight <= 0:
        raise source.error(
            f"weight must be > 0, because it multiplies h; got {shown_number(weight)}",
            "Leave the arc out, or put the sign into h.",
            row=row,
        )
    return weight
