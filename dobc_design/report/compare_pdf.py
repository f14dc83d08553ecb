"""Two certificates side by side as a PDF: the comparison's view in the blocks of the Typst template."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.report.compare import ABSENT, comparison_pictures, comparison_view
from dobc_design.report.pdf import compile_pdf, require_typst
from dobc_design.report.pdf_parts import (
    Block,
    gallery_blocks,
    heading_block,
    list_block,
    soft,
    table_block,
    text_block,
    verdict_mark,
)
from dobc_design.report.words import capitalize_first

_LONGEST_NAME = 30


def compare_pdf(first: Certificate, second: Certificate) -> bytes:
    """Return the bytes of the PDF.  Raises: SpecError without the package typst."""
    require_typst()
    view = comparison_view(first, second)
    pictures = comparison_pictures(first, second)
    names = [soft(side["name"], 24) for side in view["sides"]]
    short = [name if len(name) <= _LONGEST_NAME else name[: _LONGEST_NAME - 1] + "…" for name in names]
    return compile_pdf(
        {
            "kind": "Two certificates, compared",
            "title": f"{names[0]} and {names[1]}, compared",
            "name": f"{names[0]} and {names[1]}",
            "footer": f"A: {short[0]} · B: {short[1]}, compared",
            "verdict": "compared",
            "word": soft(view["conclusion"], 40),
            "reason": soft(view["difference_sentence"], 40),
            "identity": [row for side in view["sides"] for row in _identity(side)],
            "facts": [],
            "blocks": list(_blocks(view, pictures)),
        }
    )


def _identity(side: Mapping[str, Any]) -> Iterator[list[str]]:
    letter = side["letter"]
    yield [f"{letter}", soft(f"{side['name']}, decided by dobc_design {side['version']}", 70)]
    yield [f"SHA-256 of problem {letter}", soft(side["sha256"], 70)]


def _blocks(view: Mapping[str, Any], pictures: list[list[Any]]) -> Iterator[Block]:
    yield heading_block("The two certificates")
    for side in view["sides"]:
        yield heading_block(f"{side['letter']}: {side['name']}", level=2)
        yield text_block(f"{side['symbol']} {capitalize_first(side['verdict'])}. {side['reason']}")
        yield text_block(side["problem"])
        if side["notes"]:
            yield list_block(side["notes"])
    yield table_block(["", "A", "B"], [[name, *values] for name, values in view["facts"]], [1, 1, 1])
    yield heading_block("What differs between the problems")
    yield text_block(view["difference_sentence"])
    if view["differences"]:
        rows = [[each.key, each.first, each.second] for each in view["differences"]]
        yield table_block(["key", "A", "B"], rows, [1.2, 1, 1])
    if pictures:
        yield heading_block("Who listens to whom")
        yield from gallery_blocks(picture for side in pictures for picture in side)
    yield heading_block("What was checked")
    yield text_block("Margins and rates are in 1/s and cut towards zero, so that they hold as printed.")
    heads = ["condition", "A", "B", "margin A", "margin B", "rate A", "rate B"]
    yield table_block(heads, [_row(row) for row in view["rows"]], [2.2, 0, 0, 1, 1, 1, 1])
    if view["rows_hidden"]:
        yield text_block(f"{view['rows_hidden']} more conditions are in the certificates only.")
    if view["regions"]:
        yield heading_block("From which starts")
        yield table_block(["method", "A", "B"], [[name, *starts] for name, starts in view["regions"]], [1, 1.3, 1.3])


def _row(row: Any) -> list[Any]:
    name = row.name if row.mode is None else f"{row.name}, mode {row.mode}"
    marks = [ABSENT if cell.verdict == ABSENT else verdict_mark(cell.symbol, cell.verdict) for cell in row.cells]
    return [name, *marks, *(cell.margin for cell in row.cells), *(cell.rate for cell in row.cells)]
