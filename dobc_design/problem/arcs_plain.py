"""Columns of plain tables of arcs, read many lines at a time.

Plain: ASCII, no quotes, comments, attributes or blank lines, the same columns in every line, one
arc per line. Whatever is not plain, or wrong, is left to ``arcs_text``, which reads line by line
and names the line that it refuses. Nothing is rounded here: labels and weights stay texts.
"""

import re
from collections.abc import Iterator

import numpy as np

from dobc_design._checks import noun

from .arcs_text import Table, find_columns
from .network import Index, IndexArray

PIECE = 1 << 20  # characters that are split at once: a list of all cells would take too much memory
_UNUSUAL = re.compile(r'[\x00-\x09\x0b-\x20"#%{]')


@noun(eq=False)
class PlainColumns:
    """The two agents of every arc, by place, and the text of its weight (None: the table has no
    weights).

    ``line`` is that of the first arc.
    """

    first: IndexArray
    second: IndexArray
    weights: list[str] | None
    line: int


def plain_columns(text: str, table: Table, index: Index, known: Index) -> PlainColumns | None:
    """The arcs of a plain table; None if it is not one.  ``index``: label to place; ``known``:
    those that were there before the file was read, and are no header."""
    sign = table.separator or " "
    text = text.replace("\r\n", "\n")
    top = next(table.rows(), None) if _is_plain(text, sign) else None
    if top is None:
        return None
    columns = find_columns(top, table.rows, known)
    has_header = columns.width is not None
    width = len(top[1])
    weight = columns.weight if has_header else (2 if width == 3 else None)
    if columns.kind is not None or width < 2 or (width > 3 and not has_header):
        return None
    first, second, weights = list[IndexArray](), list[IndexArray](), list[str]()
    for cells in _pieces(text, text.find("\n") + 1 if has_header else 0, sign, width):
        if cells is None:
            return None
        try:
            ends = [
                [index[label] for label in cells[place::width]]
                for place in (columns.first, columns.second)
            ]
        except KeyError:  # an unknown label
            return None
        first.append(np.array(ends[0], dtype=np.int64))
        second.append(np.array(ends[1], dtype=np.int64))
        weights += [] if weight is None else cells[weight::width]
    if not first:
        return None
    return PlainColumns(
        first=np.concatenate(first),
        second=np.concatenate(second),
        weights=None if weight is None else weights,
        line=2 if has_header else 1,
    )


def _is_plain(text: str, sign: str) -> bool:
    """Whether every cell is what stands between two signs."""
    return text.isascii() and not _UNUSUAL.search(text.replace(sign, "") if sign in " \t" else text)


def _pieces(text: str, start: int, sign: str, width: int) -> Iterator[list[str] | None]:
    """The cells of some lines after others; None where a line has more or fewer than ``width``."""
    text = text.removesuffix("\n")
    while start < len(text):
        end = text.find("\n", start + PIECE)
        end = len(text) if end < 0 else end
        piece = text[start:end]
        if {line.count(sign) for line in piece.split("\n")} != {width - 1}:
            yield None
            return
        yield piece.replace("\n", sign).split(sign)
        start = end + 1
