"""Arcs from CSV, GraphML and edge-list files named by ``{ file = "..." }`` in a problem file.

The file must lie inside the problem file's folder.  Which column listens is said by ``network.arrow``,
never by the format.  At most 1 GB is read.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.spec.network import Arcs, arcs_from_pairs
from dobc_design.spec.reading import shown

MAX_BYTES = 1_000_000_000
READERS = (".csv", ".graphml", ".edges", ".edgelist", ".txt")


def read_arcs_file(name: str, *, folder: Path | None, index: Mapping[str, int], arrow: str, key: str) -> Arcs:
    """Read the arcs of one mode; ``index`` maps labels to indices.

    CSV: UTF-8, comma, from,to[,weight], header optional.  Edge list (.edges, .edgelist, .txt): the same,
    separated by blanks, # starts a comment.  GraphML: edges with an optional numeric 'weight'; an
    undirected edge gives both arcs.
    Raises: SpecError with the line.
    """
    path = _resolve(name, folder=folder, key=key)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SpecError(
            f"{key}: {name!r} must be UTF-8 text; byte {error.start} is not.", key=key, cure="Save it as UTF-8."
        ) from None
    except OSError as error:
        raise SpecError(
            f"{key}: {name!r} cannot be read: {error.strerror or error}.", key=key, cure="Check the path."
        ) from None
    suffix = path.suffix.lower()
    if suffix == ".graphml":
        rows = list(_graphml(text, name=name, key=key))
    elif suffix == ".csv":
        rows = list(_csv(text, name=name, key=key, index=index))
    else:
        rows = list(_edge_list(text))
    if not rows:
        raise SpecError(f"{key}: {name!r} is empty: it holds no arcs.", key=key, cure="Add arcs, one per line.")
    return _arcs(rows, name=name, key=key, index=index, arrow=arrow)


def _resolve(name: str, *, folder: Path | None, key: str) -> Path:
    if folder is None:
        raise SpecError(
            f"{key}: {name!r} cannot be found, the problem has no folder.", key=key, cure="List the arcs instead."
        )
    root = folder.resolve()
    try:
        path = (root / name).resolve()
        inside = path.is_relative_to(root) and "\0" not in name
        kind = "folder" if inside and path.is_dir() else "file" if inside and path.is_file() else "nothing"
        size = path.stat().st_size if kind == "file" else 0
    except (OSError, ValueError, RuntimeError):  # RuntimeError: a link to itself
        inside, kind, size = True, "nothing", 0
    if not inside:
        raise SpecError(
            f"{key} must lie inside the problem file's folder; {shown(name)} leads outside.", key=key,
            cure="Copy the file beside the problem file.",
        )  # fmt: skip
    if kind != "file":
        found = "is a folder" if kind == "folder" else "does not exist"
        raise SpecError(f"{key}: {shown(name)} {found}, not a file.", key=key, cure="Name an existing file.")
    if size > MAX_BYTES:
        raise SpecError(
            f"{key}: {name!r} is too large ({size} bytes, at most {MAX_BYTES}).", key=key, cure="Split it."
        )
    if path.suffix.lower() not in READERS:
        raise SpecError(
            f"{key}: {name!r} must end in one of {', '.join(READERS)}.", key=key, cure="Rename or convert it."
        )
    return path


Row = tuple[int, list[Any]]  # line number, [a, b] or [a, b, weight]


def _csv(text: str, *, name: str, key: str, index: Mapping[str, int]) -> Iterator[Row]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        for number, row in enumerate(reader, start=1):
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            header = ["from", "to", "weight"][: len(cells)]
            if number == 1 and [cell.lower() for cell in cells] == header and cells[0] not in index:
                continue
            yield reader.line_num, cells
    except csv.Error as error:
        raise SpecError(
            f"{key}: {name!r} line {reader.line_num} is not valid CSV ({error}).", key=key, cure="Check the quotes."
        ) from None


def _edge_list(text: str) -> Iterator[Row]:
    for number, line in enumerate(text.splitlines(), start=1):
        cells = line.split("#", 1)[0].split()
        if cells:
            yield number, cells


def _graphml(text: str, *, name: str, key: str) -> Iterator[Row]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise SpecError(
            f"{key}: {name!r} must not hold a DOCTYPE or entities.", key=key, cure="Save plain GraphML."
        )
    try:
        root = ElementTree.fromstring(text)  # expat expands nothing: entities are refused above
    except (ElementTree.ParseError, RecursionError) as error:
        raise SpecError(f"{key}: {name!r} is not valid GraphML ({error}).", key=key, cure="Export it again.") from None
    weights = {
        node.get("id")
        for node in root.iter()
        if _tag(node) == "key" and node.get("for") in ("edge", "all") and node.get("attr.name") == "weight"
    }
    for graph in (node for node in root.iter() if _tag(node) == "graph"):
        default = graph.get("edgedefault") != "undirected"
        for position, edge in enumerate(node for node in graph if _tag(node) == "edge"):
            directed = default if edge.get("directed") is None else edge.get("directed") == "true"
            weight = [d.text or "" for d in edge if _tag(d) == "data" and d.get("key") in weights]
            a, b = edge.get("source", ""), edge.get("target", "")
            yield position + 1, [a, b, *weight[:1]]
            if not directed:
                yield position + 1, [b, a, *weight[:1]]


def _tag(node: ElementTree.Element) -> str:
    return node.tag.rsplit("}", 1)[-1] if isinstance(node.tag, str) else ""


def _weight(text: str, *, place: str, key: str) -> Fraction:
    try:
        weight = parse_number(text, key=place)
    except SpecError as error:
        raise SpecError(error.message, key=key, cure=error.cure) from None
    if weight <= 0:
        raise SpecError(
            f"{place}: a weight must be > 0, because it multiplies h; got {text[:60]}.", key=key,
            cure="Leave the arc out, or put the sign into h.",
        )  # fmt: skip
    return weight


def _arcs(rows: list[Row], *, name: str, key: str, index: Mapping[str, int], arrow: str) -> Arcs:
    known: dict[str, Any] = {}
    seen: set[tuple[str, str]] = set()
    for line, cells in rows:
        place = f"{key} ({name}, line {line})"
        if len(cells) not in (2, 3):
            raise SpecError(
                f"{place}: an arc has 2 or 3 columns, from,to[,weight]; got {len(cells)}.", key=key,
                cure="Correct that line.",
            )  # fmt: skip
        for label in cells[:2]:
            if label not in index:
                raise SpecError(
                    f"{place}: there is no agent {label[:60]!r} in network.agents.", key=key,
                    cure="Correct the label, or add the agent.",
                )  # fmt: skip
        pair = (cells[0], cells[1])
        if pair in seen or cells[0] == cells[1]:
            what = "this arc stands there twice" if pair in seen else f"agent {cells[0][:60]} must not listen to itself"
            raise SpecError(f"{place}: {what}.", key=key, cure="Remove that line.")
        seen.add(pair)
        if len(cells) == 3 and cells[2] not in known:
            known[cells[2]] = _weight(cells[2], place=place, key=key)
    pairs = [[*cells[:2], known[cells[2]]] if len(cells) == 3 else cells for _, cells in rows]
    return arcs_from_pairs(pairs, index=index, arrow=arrow, key=key)
