"""A document as a PDF on A4, set by Typst: tagged, with text alternatives, without a date, the same
bytes every time.

Optional: needs the package typst (extra `pdf`).  Nothing is read from the network.  The template
never reads text as markup: everything reaches it as strings in JSON, with places where long words
may be broken.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from importlib.resources import files
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final, Literal
from xml.etree import ElementTree

import matplotlib
from matplotlib.ft2font import FT2Font

from dobc_design._show.text import significant, typeset
from dobc_design.errors import SpecError
from dobc_design.report import document as doc
from dobc_design.report.pictures import svg_of
from dobc_design.report.words import capitalize_first

STANDARD: Final[Literal["ua-1"]] = "ua-1"  # PDF/UA-1: readable by assistive technology
#: Names of matrices in the template, by their LaTeX; the others have the same.
MATRIX_NAMES: Final = {
    r"P_{\text{given}}": "P given",
    r"S_{\text{given}}": "S given",
    r"\Lambda": "Lambda",
    "A_x": "A x",
}
PRINTED: Final = ("recheck", "signatures")  # the details that belong to every printed report
# digits of numerator and denominator that are still printed as a fraction
LONGEST_NUMBER: Final = 12
LONGEST_WORD: Final = 16  # in a cell; longer ones may be broken anywhere
_SOFT = "\u200b"  # a place where a line may break
_INVISIBLE: Final = f"{_SOFT}\n"
_VARIABLE = re.compile(r"var\(--[\w-]+, *(#[0-9a-f]{6})\)")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_JOINT = re.compile(r"([/_.,;:@-])")


def pdf_page(document: doc.Document, *, full: bool = False) -> bytes:
    """The bytes of the PDF; ``full``: with all details.  Raises: SpecError without the package
    typst."""
    require_typst()
    return compile_pdf(content(document, full=full))


def require_typst() -> None:
    """Raises: SpecError that names the extra, where typst is not installed."""
    try:
        import typst  # noqa: F401 - only whether it is there
    except ImportError as error:
        cure = "Install it (pip install dobc_design[pdf]), or print report.html from a browser."
        raise SpecError(
            "a PDF needs the package typst, which is not installed.", key="pdf", cure=cure
        ) from error


def content(document: doc.Document, *, full: bool = False) -> dict[str, Any]:
    """Everything that the template shows, as JSON: strings, lists and numbers' digits."""
    document, verdict = doc.in_form(document, "pdf"), document.verdict
    more = [
        each
        for each in document.details
        if full or (isinstance(each, doc.Section) and each.name in PRINTED)
    ]
    return {
        "kind": document.kind,
        "title": soft(document.title, 24),
        "name": soft(document.name, 24),
        "footer": soft(document.footer, 24),
        "verdict": verdict.mark.verdict,
        "word": soft(f"{verdict.mark.symbol} {verdict.word}", 40),
        "reason": soft(verdict.reason, 40),
        "identity": [[name, soft(value, 70)] for name, value in document.identity],
        "facts": [[name, soft(value)] for name, value in verdict.facts],
        "blocks": list(_blocks((*document.blocks, *more))),
    }


def compile_pdf(content: Mapping[str, Any]) -> bytes:
    """Set the document.  Fonts of the system are used only for letters that the shipped ones do not
    have."""
    import typst

    text = json.dumps(content, ensure_ascii=False)
    source = (files("dobc_design.report") / "templates" / "report.typ").read_bytes()
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    known = FT2Font(str(folder / "DejaVuSans.ttf")).get_charmap()
    shipped = all(ord(each) in known or each in _INVISIBLE for each in text)

    settings: dict[str, Any] = {
        "sys_inputs": {"data": text},
        "font_paths": [str(folder)],
        "ignore_system_fonts": shipped,
    }
    try:
        made: bytes = typst.compile(source, pdf_standards=STANDARD, **settings)
    # the standard forbids some letters that a label may have; the report is still wanted
    except typst.TypstError:
        made = typst.compile(source, pdf_standards=None, **settings)
    return made


def soft(text: object, longest: int = LONGEST_WORD) -> str:
    """The text on one line, where words longer than ``longest`` may be broken, first of all after
    punctuation."""
    return " ".join(_soft_word(word, longest) for word in _CONTROL.sub("\ufffd", str(text)).split())


def _soft_word(word: str, longest: int) -> str:
    if len(word) <= longest:
        return word
    parts = _JOINT.sub(rf"\1{_SOFT}", word).split(_SOFT)
    short = longest // 2
    pieces = [
        [part[k : k + short] for k in range(0, len(part), short)] if len(part) > longest else [part]
        for part in parts
    ]
    return _SOFT.join(chain.from_iterable(pieces))


def _blocks(blocks: Iterable[doc.Block], level: int = 1) -> Iterator[dict[str, Any]]:
    found = list(blocks)
    for block, after in zip_longest(found, found[1:]):
        match block:
            case doc.Section(title=title, blocks=inner):
                yield {"kind": "heading", "level": level, "text": soft(title)}
                yield from _blocks(inner, level + 1)
            case doc.Box():
                yield {"kind": "heading", "level": level, "text": soft(block.title)}
                yield _text(f"{block.mark.symbol} {block.word}. {block.reason}")
                yield _text(block.note)
            case doc.Text(words, style):
                yield _text(words, "lead" if doc.leads(block, after) else style)
            case doc.List(items) if items:
                yield {"kind": "list", "items": [soft(doc.plain(item), 40) for item in items]}
            case doc.Code(lines):
                yield {"kind": "code", "lines": [soft(line, 60) for line in lines]}
            case doc.Formula(typst=Fraction() as bound):
                yield {
                    "kind": "bound",
                    "label": f"{capitalize_first(block.label)} is",
                    "number": number_parts(bound),
                }
            case doc.Formula():
                yield {
                    "kind": "formula",
                    "name": block.typst,
                    "label": block.label,
                    "number": block.number,
                }
            case doc.Matrices(items):
                yield from map(_matrix, items)
            case doc.Pictures(items) if items:
                yield {"kind": "pictures", "items": [picture_parts(item) for item in items]}
            case doc.Facts(rows):
                yield _table(("", ""), rows)
            case doc.Terms(items):
                yield _table(
                    ("word", "meaning"),
                    [(word, capitalize_first(meaning)) for word, meaning in items],
                )
            case doc.Table(columns=columns, rows=rows):
                yield _table([each.head for each in columns], rows, columns)
            case doc.Signatures(heads, roles):
                yield {"kind": "signatures", "heads": ["role", *heads], "roles": list(roles)}


def _text(words: doc.Words, style: str = "plain") -> dict[str, Any]:
    return {"kind": "text", "text": soft(doc.plain(words), 40), "style": style}


def _table(
    heads: Iterable[str], rows: Iterable[Sequence[doc.Cell]], columns: Sequence[doc.Column] = ()
) -> dict[str, Any]:
    """A table; without ``columns`` of names and what stands beside them."""
    styles = [each.style for each in columns] or ["plain", "plain"]
    return {
        "kind": "table",
        "heads": [soft(head) for head in heads],
        "rows": [
            [_cell(cell, style) for cell, style in zip(row, styles, strict=True)] for row in rows
        ],
        "widths": [each.width for each in columns] or [0, 1],
    }


def _cell(cell: doc.Cell, style: str = "plain") -> Any:
    """A list of lines, or a coloured verdict."""
    match cell:
        case str() if style == "code":
            return [soft(part) for part in cell.split(", ") if part]
        case str() if style == "number":
            return [soft(typeset(cell))]
        case doc.Mark(_, verdict):
            return {"mark": verdict, "text": str(cell)}
        case doc.Name(parts, id):
            return [soft(part) for part in (*parts, id) if part]
        case doc.Reason():
            details = [f"{name}: {value}" for name, value in cell.details]
            cure = [] if cell.cure is None else [f"Cure: {cell.cure}", *cell.lines]
            return [soft(line) for line in (cell.text, *details, *cure)]
        case _:
            return [soft(cell)]


def _matrix(shown: doc.ShownMatrix) -> dict[str, Any]:
    """A matrix from its exact entries, or a sentence where it is too large."""
    name, label = MATRIX_NAMES.get(shown.name, shown.name), capitalize_first(shown.what)
    if shown.latex is None:
        return _text(
            f"{label} ({name}) is {shown.size}, too large to be printed; see certificate.json."
        )
    rows = [[number_parts(entry, exact=False) for entry in row] for row in shown.matrix]
    return {"kind": "matrix", "name": name, "label": soft(label), "rows": rows}


def number_parts(value: Fraction, *, exact: bool = True) -> dict[str, Any]:
    """A rational for the template: sign and digits, a decimal with its power of ten, or an
    ``exact`` fraction."""
    sign, size = value < 0, abs(value)
    small = max(size.numerator.bit_length(), size.denominator.bit_length()) <= 4 * LONGEST_NUMBER
    if exact and small and Fraction(significant(size, 6)) != size:
        return {
            "negative": sign,
            "digits": str(size.numerator),
            "over": str(size.denominator),
            "power": None,
        }
    mantissa, _, power = significant(size, 6 if exact else 5).partition("e")
    return {
        "negative": sign,
        "digits": mantissa,
        "over": None,
        "power": str(int(power)) if power else None,
    }


def picture_parts(picture: doc.Picture) -> dict[str, str]:
    """A figure for the template: its SVG with fixed colours and font, its text alternative, title
    and caption."""
    svg = _VARIABLE.sub(r"\1", svg_of(picture)).replace(
        "font-family: inherit", "font-family: 'DejaVu Sans'"
    )
    width = Decimal((ElementTree.fromstring(svg).get("viewBox") or "0 0 330 0").split()[2])
    return {
        "svg": svg,
        "alt": soft(picture.alt, 60),
        "title": soft(picture.title),
        "caption": soft(picture.caption, 40),
        "width": f"{width:.1f}",
    }
