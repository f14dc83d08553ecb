"""Tables of arcs in text (CSV, edge lists): which sign separates the columns, whether there is a
header, and which column is which.  What could be read in two ways is refused: a network that nobody
meant would pass unnoticed.
"""

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import chain

from dobc_design._checks import noun
from dobc_design._files import own_table
from dobc_design.exact.reading import Names, named, shown

from .network import Index

Row = tuple[int, list[str]]  # number of the line or edge, [a, b] or [a, b, weight]
Rows = Callable[[], Iterator[Row]]  # begins at the top of the file whenever it is called

_WORDS = own_table("problem/arcs.toml")
WEIGHTS: list[str] = _WORDS["weights"]
KNOWN = "from,to or source,target, then weight and type (Directed or Undirected)"

_QUOTED = re.compile(r'"[^"]*"')
_NUMBER = re.compile(r"[+-]?[0-9]+(?:[.,/][0-9]+)?(?:[eE][+-]?[0-9]+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+")
_BLANKS_AND_COMMA = re.compile(r"[^\s,;]+\s+[^\s,;]+\s+[+-]?[0-9]+,[0-9]+\s*")  # a b 0,5
# the first line of the networks of KONECT
_KONECT = re.compile(r"\s*%\s*(sym|asym|bip)\s+[a-z]+\s*$", re.MULTILINE)
_COMMENT = re.compile(r"[#%](?:\s|\Z)")
_ATTRIBUTE = re.compile(
    r"""\s*(?:'([^']*)'|"([^"]*)")\s*:\s*(?:'([^']*)'|"([^"]*)"|([^\s,'"{}\[\]]+))\s*(?:,|\Z)"""
)


class Unfit(Exception):
    """Unfit(row, what, cure): what is wrong with a line or edge of a file (None: with all of it).

    What reads texts does not know where they are from; ``arcs_file`` makes a SpecError of it.
    """


@noun
class Columns:
    """Which column is which, counted from 0; ``width``: how many the header names, None without a
    header."""

    width: int | None = None
    first: int = 0
    second: int = 1
    weight: int | None = None
    kind: int | None = None


PLAIN = Columns()  # a, b and perhaps a weight, without a header


@noun
class Table:
    """The rows of a text as they stand, the header among them.

    ``both``: every row is an undirected edge, as the first comment of the file says.
    """

    rows: Rows
    both: bool = False


def csv_table(text: str) -> Table:
    """A CSV file.  Raises: SpecError."""
    separator = csv_separator(text)
    return Table(rows=lambda: _csv(text, separator))


def edge_list_table(text: str) -> Table:
    """An edge list, separated by blanks, tabs, commas or semicolons.  Raises: SpecError."""
    konect = _KONECT.match(text)
    kind = None if konect is None else konect[1]
    if kind == "bip":
        raise Unfit(
            None,
            "is a network of two kinds of nodes (% bip), whose edges are no readings between "
            "agents",
            "Take a network of one kind of nodes.",
        )
    separator = _edge_list_separator(text)
    return Table(rows=lambda: _edge_list(text, separator), both=kind == "sym")


def csv_separator(text: str) -> str:
    """The sign between the columns: a comma, else a semicolon, else a tab.  Raises: SpecError where
    it is not clear."""
    for number, line in enumerate(io.StringIO(text), start=1):
        # The first line that holds anything decides; each further one is checked against it.
        if line.strip() and not _COMMENT.match(line):
            sign = _sign(line, number)
            if sign is None and "\t" in line:
                return "\t"
            return sign or ","
    return ","


def _edge_list_separator(text: str) -> str | None:
    """The sign between the columns, None for blanks; tabs count where every line has one (labels
    may hold blanks)."""
    numbered = enumerate(text.splitlines(), start=1)
    bare = ((number, _without_comment(line)) for number, line in numbered)
    lines = ((number, line) for number, line in bare if line.strip())
    number, first = next(lines, (1, ""))
    sign = _sign(first.partition("{")[0], number)
    if sign is None and "\t" in first.strip() and all("\t" in line.strip() for _, line in lines):
        return "\t"
    return sign


def _sign(line: str, row: int) -> str | None:
    """The comma or semicolon of a line, outside quotes; None if it has neither."""
    bare = _QUOTED.sub("", line)
    if _BLANKS_AND_COMMA.fullmatch(bare.strip()):
        raise _decimal_comma(bare.split()[2], row)
    found = [sign for sign in ",;" if sign in bare]
    if len(found) == 2:
        raise Unfit(
            row,
            "holds commas and semicolons, so it is not clear which of them separates the columns",
            "Write numbers with a decimal point (0.5), and labels that hold one of them in quotes.",
        )
    return found[0] if found else None


def _decimal_comma(text: str, row: int) -> Unfit:
    return Unfit(
        row,
        f"has the number {shown(text)} with a decimal comma",
        f"Write the decimal point: {text.replace(',', '.')}.",
    )


def _csv(text: str, separator: str) -> Iterator[Row]:
    """The rows of a CSV file that are no comments."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not (cells[0][:1] in ("#", "%") and _COMMENT.match(cells[0])):
                yield reader.line_num, cells
    except csv.Error as error:
        raise Unfit(reader.line_num, f"is not valid CSV ({error})", "Check the quotes.") from None


def _edge_list(text: str, separator: str | None) -> Iterator[Row]:
    """The rows of an edge list; of attributes in {...} the weight."""
    for number, line in enumerate(text.splitlines(), start=1):
        head, brace, attributes = _without_comment(line).partition("{")
        if not head.strip():
            continue
        cells = _split(head, separator, number)
        if brace:
            if not cells[-1]:
                cells.pop()  # a,b,{...}
            cells += _weight_of(attributes, number)
        yield number, cells


def _split(line: str, separator: str | None, row: int) -> list[str]:
    """The cells of one line of an edge list.  Raises: SpecError where they are not clear."""
    if separator is None:
        cells = line.split()
        found = next((cell for cell in cells if cell in _WORDS["arrows"]), None)
        if found is None and cells[0].endswith(":"):
            found = cells[0]
        if found is not None:
            raise Unfit(
                row,
                f"holds {shown(found)}: it is no list of arcs, two labels and perhaps a weight in "
                "each line",
                "Write a b, or a b weight; `arrow` says which of the two listens.",
            )
        return cells
    try:
        parts = next(csv.reader([line.strip(" ")], delimiter=separator, strict=True))
    except csv.Error as error:
        raise Unfit(row, f"cannot be read ({error})", "Check the quotes.") from None
    cells = [cell.strip() for cell in parts]
    # "a, b 0.5" could be two columns or three.
    if separator != "\t" and any(len(cell.split()) > 1 for cell in cells) and '"' not in line:
        what = "holds both ; and blanks"
        if separator == ",":
            what = "holds both commas and blanks between words"
        raise Unfit(
            row,
            what,
            "Separate columns by one of them, write 0.5 and not 0,5, and labels that hold blanks "
            "in quotes.",
        )
    return cells


def _without_comment(line: str) -> str:
    """The line up to a comment; a % begins one only at the start, and a # inside {...} is a
    value."""
    if line.lstrip().startswith("%"):
        return ""
    head, brace, rest = line.partition("{")
    if "#" in head or not brace:
        return head.split("#", 1)[0]
    inside, closing, _ = rest.rpartition("}")
    return head + brace + inside + closing


def _weight_of(text: str, row: int) -> list[str]:
    """The weight among attributes as networkx writes them, {'weight': 2.0, ...}, or nothing."""
    inside, closing, _ = text.rpartition("}")
    found = {}
    at = 0
    each = _ATTRIBUTE.match(inside) if closing else None
    while each is not None and at < len(inside):
        name, value = (part for part in each.groups() if part is not None)
        found[name] = value
        at = each.end()
        each = _ATTRIBUTE.match(inside, at)
    if not closing or inside[at:].strip():
        raise Unfit(
            row,
            "has attributes that cannot be read; they must look like {'weight': 2.0}",
            "Write them without: nx.write_weighted_edgelist(graph, file).",
        )
    return [found["weight"]] if "weight" in found else []


def arcs_of(table: Table, index: Index) -> Iterator[Row]:
    """The arcs of a table, whichever columns it has.  ``index``: the agents, where they are known.

    Raises: SpecError.
    """
    rows = table.rows()
    first = next(rows, None)
    if first is None:
        return
    columns = find_columns(first, table.rows, index)
    body = rows if columns.width is not None else chain([first], rows)
    for number, cells in body:
        for row, arc in _in_order(number, cells, columns):
            yield row, arc
            if table.both and len(arc) > 1:
                yield row, [arc[1], arc[0], *arc[2:]]


def _in_order(number: int, cells: list[str], columns: Columns) -> Iterator[Row]:
    """One row as [a, b] or [a, b, weight], and turned round where it is undirected."""
    if columns.width is None:
        if len(cells) == 3 and _DECIMAL_COMMA.fullmatch(cells[2]):
            raise _decimal_comma(cells[2], number)
        yield number, cells
        return
    if not max(columns.first, columns.second) < len(cells) <= columns.width:
        raise Unfit(
            number,
            f"has {len(cells)} columns; the header names {columns.width}",
            "Fill the row; numbers have a decimal point (0.5 and not 0,5).",
        )
    a, b = cells[columns.first], cells[columns.second]
    weight = [] if columns.weight is None else cells[columns.weight : columns.weight + 1]
    if weight and _DECIMAL_COMMA.fullmatch(weight[0]):
        raise _decimal_comma(weight[0], number)
    yield number, [a, b, *weight]
    if columns.kind is not None and _is_undirected(cells, columns.kind, number):
        yield number, [b, a, *weight]


def _is_undirected(cells: Names, place: int, row: int) -> bool:
    """What the column of types says of a row."""
    text = cells[place].lower() if place < len(cells) else ""
    if text not in _WORDS["both"] + _WORDS["one_way"]:
        raise Unfit(
            row,
            f"must say Directed or Undirected in the column of types; got {shown(text)}",
            "Correct the type of that edge.",
        )
    return text in _WORDS["both"]


def find_columns(first: Row, rows: Rows, index: Index) -> Columns:
    """Which columns a table has, by its first row: a header, if that is clear.  Raises: SpecError
    where it is not."""
    number, cells = first
    if len(cells) < 2 or (cells[0] in index and cells[1] in index):
        return PLAIN  # agents may be called from and to
    # From_Node, "from node" and fromNode are one name.
    names = [re.sub("[^a-z0-9]", "", cell.lower()) for cell in cells]
    third = cells[2] if len(cells) > 2 else ""
    third_is_number = _NUMBER.fullmatch(third) is not None
    ends = next((pair for pair in _WORDS["ends"] if set(pair) <= set(names)), None)
    # A number in the third place is a weight: then the two names are agents.
    if ends is not None and not (len(cells) == 3 and third_is_number):
        places = (names.index(ends[0]), names.index(ends[1]))
        return _named_columns(names, cells, places, number)
    if third_is_number or any(_NUMBER.fullmatch(cell) for cell in cells[:2]):
        return PLAIN
    if not third:
        return _two_names(first, rows, index)
    if len(cells) == 3 and names[2] in WEIGHTS:
        return Columns(width=3, weight=2)
    raise Unfit(
        number,
        f"looks like a header, but its columns ({', '.join(map(named, cells[:6]))}) are not known",
        f"Name the columns {KNOWN}.",
    )


def _named_columns(names: Names, cells: Names, ends: tuple[int, int], row: int) -> Columns:
    """The columns of a header that names both ends."""
    weights = [place for place, name in enumerate(names) if name in WEIGHTS]
    kinds = [place for place, name in enumerate(names) if name in _WORDS["kinds"]]
    for alike in (weights, kinds):
        if len(alike) > 1:
            both = ", ".join(named(cells[place]) for place in alike)
            raise Unfit(row, f"names columns of the same meaning: {both}", "Leave one of them.")
    known = {*ends, *weights, *kinds}
    for place, name in enumerate(names):
        if not weights and place not in known and name not in _WORDS["beside"]:
            cure = "Call it weight if it holds the weights, or remove it (without weights all are"
            raise Unfit(
                row, f"names a column {shown(cells[place])}, which is not known", f"{cure} 1)."
            )
    return Columns(
        width=len(names),
        first=ends[0],
        second=ends[1],
        weight=weights[0] if weights else None,
        kind=kinds[0] if kinds else None,
    )


def _two_names(first: Row, rows: Rows, index: Index) -> Columns:
    """Two words at the top are a header if all labels below are numbers, and an arc if one of them
    occurs again."""
    number, (a, b, *_) = first
    # The whole file is asked: only a name that never occurs again can be a header.
    others = {label for place, cells in rows() if place != number for label in cells[:2]}
    if not others or a in others or b in others or a in index or b in index:
        return PLAIN
    if _all_numbers(others):
        return Columns(width=2)
    if index:
        return PLAIN  # whatever is no agent is refused there
    raise Unfit(
        number,
        f"({named(a)}, {named(b)}) may be a header or an arc: neither name occurs again",
        f"Begin the file with a header that is known: {KNOWN}.",
    )


def _all_numbers(labels: Iterable[str]) -> bool:
    return all(map(_NUMBER.fullmatch, labels))
