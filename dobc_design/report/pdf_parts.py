"""Plain blocks for the Typst template: texts whose long words may break, exact numbers, figures with fixed colours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any, Final
from xml.etree import ElementTree

from dobc_design._show.text import significant
from dobc_design.report.formulas import ShownMatrix
from dobc_design.report.pictures import Picture

Block = dict[str, Any]
#: Names of matrices in the template, by their LaTeX.
MATRIX_NAMES: Final = {
    "A": "A",
    "C": "C",
    "W": "W",
    "P": "P",
    "Q": "Q",
    "S": "S",
    r"P_{\text{given}}": "P given",
    r"S_{\text{given}}": "S given",
    r"\Lambda": "Lambda",
}
LONGEST_NUMBER: Final = 12  # digits of numerator and denominator that are still printed as a fraction
LONGEST_WORD: Final = 16  # in a cell; longer ones may be broken anywhere
_VARIABLE = re.compile(r"var\(--[\w-]+, *(#[0-9a-f]{6})\)")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_JOINT = re.compile(r"([/_.,;:@-])")
_SOFT = "\u200b"  # a place where a line may break


def soft(text: object, longest: int = LONGEST_WORD) -> str:
    """The text on one line, where words longer than ``longest`` may be broken, first of all after punctuation."""
    return " ".join(_soft_word(word, longest) for word in _CONTROL.sub("\ufffd", str(text)).split())


def number_parts(value: Fraction) -> dict[str, Any]:
    """A rational for the template: sign and digits, a fraction, or a rounded decimal with its power of ten."""
    sign, size = value < 0, abs(value)
    small = max(size.numerator.bit_length(), size.denominator.bit_length()) <= 4 * LONGEST_NUMBER
    if small and len(str(size.numerator)) + len(str(size.denominator)) <= LONGEST_NUMBER + 1:
        over = None if size.denominator == 1 else str(size.denominator)
        return {"negative": sign, "digits": str(size.numerator), "over": over, "power": None}
    mantissa, _, power = significant(size).partition("e")
    return {"negative": sign, "digits": mantissa, "over": None, "power": str(int(power)) if power else None}


def picture_parts(picture: Picture) -> dict[str, str]:
    """A figure for the template: its SVG with fixed colours and font, its text alternative, title and caption."""
    svg = _VARIABLE.sub(r"\1", str(picture.svg)).replace("font-family: inherit", "font-family: 'DejaVu Sans'")
    alt = ElementTree.fromstring(svg).get("aria-label") or picture.title
    width = Decimal((ElementTree.fromstring(svg).get("viewBox") or "0 0 330 0").split()[2])
    return {
        "svg": svg,
        "alt": soft(alt, 60),
        "title": soft(picture.title),
        "caption": soft(picture.caption, 40),
        "width": f"{width:.1f}",
    }


def _soft_word(word: str, longest: int) -> str:
    if len(word) <= longest:
        return word
    pieces = _JOINT.sub(rf"\1{_SOFT}", word).split(_SOFT)
    short = longest // 2
    return _SOFT.join(
        _SOFT.join(piece[k : k + short] for k in range(0, len(piece), short)) if len(piece) > longest else piece
        for piece in pieces
    )


def heading_block(text: str, *, level: int = 1) -> Block:
    """A heading of level 1 (a section) or 2."""
    return {"kind": "heading", "level": level, "text": soft(text)}


def text_block(text: object, *, style: str = "plain") -> Block:
    """A paragraph; ``style`` is "plain" or "caption"."""
    return {"kind": "text", "text": soft(text, 40), "style": style}


def list_block(items: Iterable[object]) -> Block:
    """A list of sentences."""
    return {"kind": "list", "items": [soft(item, 40) for item in items]}


def code_block(*lines: object) -> Block:
    """Lines to be typed."""
    return {"kind": "code", "lines": [soft(line, 60) for line in lines]}


def formula_block(name: str, *, label: str = "", number: str = "") -> Block:
    """A formula that the template knows by ``name``, with its number in the paper."""
    return {"kind": "formula", "name": name, "label": label, "number": number}


def table_block(heads: Sequence[str], rows: Iterable[Sequence[Any]], widths: Sequence[float] | None = None) -> Block:
    """``widths``: parts of the page's width; 0 for as much as is needed.  A cell: text, a list of texts, or a mark."""
    shown = [[_cell(cell) for cell in row] for row in rows]
    return {
        "kind": "table",
        "heads": [soft(head) for head in heads],
        "rows": shown,
        "widths": list(widths or [0.0] + [1.0] * (len(heads) - 1)),
    }


def _cell(cell: Any) -> Any:
    if isinstance(cell, Mapping):
        return cell
    return [soft(cell)] if isinstance(cell, str) else [soft(part) for part in cell]


def verdict_mark(symbol: str, verdict: str) -> Block:
    """A verdict in a cell, coloured."""
    return {"mark": verdict, "text": f"{symbol} {verdict}"}


def gallery_blocks(pictures: Iterable[Picture | None]) -> Iterator[Block]:
    """Figures side by side; nothing where there is none."""
    items = [picture_parts(picture) for picture in pictures if picture is not None]
    if items:
        yield {"kind": "pictures", "items": items}


def matrix_block(shown: ShownMatrix, label: str) -> Block:
    """A matrix from its exact entries, or a sentence where it is too large."""
    if shown.entries is None:
        text = f"{label} ({MATRIX_NAMES[shown.name]}) is {shown.size}, too large to be printed; see certificate.json."
        return text_block(text)
    return {
        "kind": "matrix",
        "name": MATRIX_NAMES[shown.name],
        "label": soft(label),
        "rows": [[number_parts(entry) for entry in row] for row in shown.entries],
    }
