"""A document as a PDF on A4, set by Typst: tagged, with text alternatives, without a date, the same
bytes every time.

Optional: needs the package typst (extra `pdf`).  Nothing is read from the network.  The template
never reads text as markup: everything reaches it as strings in JSON, with places where long words
may be broken.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import matplotlib
from matplotlib.ft2font import FT2Font

from dobc_design._files import own_text
from dobc_design._show.text import capitalize_first, significant, typeset
from dobc_design.errors import refused

from .document import (
    PRINTED,
    Block,
    Box,
    Cell,
    Code,
    Column,
    Document,
    Facts,
    Formula,
    List,
    Mark,
    Matrices,
    Name,
    Picture,
    Pictures,
    Reason,
    Section,
    ShownMatrix,
    Signatures,
    Table,
    Terms,
    Text,
    Words,
    in_form,
    leads,
    plain,
)
from .pictures import svg_of

STANDARD: Literal["ua-1"] = "ua-1"  # PDF/UA-1: readable by assistive technology
#: Names of matrices in the template, by their LaTeX; the others have the same.
MATRIX_NAMES = {
    r"P_{\text{given}}": "P given",
    r"S_{\text{given}}": "S given",
    r"\Lambda": "Lambda",
    "A_x": "A x",
}
# digits of numerator and denominator that are still printed as a fraction
LONGEST_NUMBER = 12
LONGEST_WORD = 16  # in a cell; longer ones may be broken anywhere
Shown = dict[str, Any]  # a block as JSON; its "kind" is what the template calls it

_SOFT = "\u200b"  # a place where a line may break
_INVISIBLE = f"{_SOFT}\n"
_VARIABLE = re.compile(r"var\(--[\w-]+, *(#[0-9a-f]{6})\)")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_JOINT = re.compile(r"([/_.,;:@-])")


def pdf_page(document: Document, *, full: bool) -> bytes:
    """The bytes of the PDF; ``full``: with all details.  Raises: SpecError without the package
    typst."""
    require_typst()
    return compile_pdf(content(document, full=full))


def require_typst() -> None:
    """Raises: SpecError that names the extra, where typst is not installed."""
    try:
        import typst  # noqa: F401 - only whether it is there
    except ImportError as error:
        raise refused(
            "pdf",
            "a PDF needs the package typst, which is not installed.",
            "Install it (pip install dobc_design[pdf]), or print report.html from a browser.",
        ) from error


def content(document: Document, *, full: bool = False) -> Shown:
    """Everything that the template shows, as JSON: strings, lists and numbers' digits."""
    document, verdict = in_form(document, "pdf"), document.verdict
    blocks = list(document.blocks)
    for each in document.details:
        # Nothing can be opened on paper: without ``full`` it has what a reviewer needs.
        if full or (isinstance(each, Section) and each.name in PRINTED):
            blocks.append(each)
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
        "blocks": list(_blocks(blocks)),
    }


def compile_pdf(content: Mapping[str, Any]) -> bytes:
    """Set the document.  Fonts of the system are used only for letters that the shipped ones do not
    have."""
    import typst

    # As one string: Typst never reads it as markup.
    text = json.dumps(content, ensure_ascii=False)
    source = own_text("report/templates/report.typ").encode()
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    known = FT2Font(str(folder / "DejaVuSans.ttf")).get_charmap()
    shipped = all(ord(each) in known or each in _INVISIBLE for each in text)

    def made(standard: Literal["ua-1"] | None) -> bytes:
        page: bytes = typst.compile(
            source,
            sys_inputs={"data": text},
            font_paths=[str(folder)],
            ignore_system_fonts=shipped,
            pdf_standards=standard,
        )
        return page

    try:
        return made(STANDARD)
    # the standard forbids some letters that a label may have; the report is still wanted
    except typst.TypstError:
        return made(None)


def soft(text: object, longest: int = LONGEST_WORD) -> str:
    """The text on one line, where words longer than ``longest`` may be broken, first of all after
    punctuation."""
    return " ".join(_soft_word(word, longest) for word in _CONTROL.sub("\ufffd", str(text)).split())


def _soft_word(word: str, longest: int) -> str:
    if len(word) <= longest:
        return word
    short = longest // 2
    pieces: list[str] = []
    for part in _JOINT.sub(rf"\1{_SOFT}", word).split(_SOFT):
        if len(part) <= longest:
            pieces.append(part)
        else:
            pieces += [part[k : k + short] for k in range(0, len(part), short)]
    return _SOFT.join(pieces)


def _blocks(blocks: Iterable[Block], level: int = 1) -> Iterator[Shown]:
    found = list(blocks)
    for block, after in zip_longest(found, found[1:]):
        match block:
            case Section(title=title, blocks=inner):
                yield _heading(title, level)
                yield from _blocks(inner, level + 1)
            case Box():
                yield _heading(block.title, level)
                yield _text(f"{block.mark.symbol} {block.word}. {block.reason}")
                yield _text(block.note)
            case Text(words, style):
                yield _text(words, "lead" if leads(block, after) else style)
            case _:
                yield from _plain_block(block)


def _plain_block(block: Block) -> Iterator[Shown]:
    """A block that is shown by itself, wherever it stands."""
    match block:
        case List(items) if items:
            yield {"kind": "list", "items": [soft(plain(item), 40) for item in items]}
        case Code(lines):
            yield {"kind": "code", "lines": [soft(line, 60) for line in lines]}
        case Formula(label=label, typst=Fraction() as bound):
            label = f"{capitalize_first(label)} is"
            yield {"kind": "bound", "label": label, "number": number_parts(bound)}
        case Formula(label=label, number=number, typst=name):
            yield {"kind": "formula", "name": name, "label": label, "number": number}
        case Matrices(items):
            yield from map(_matrix, items)
        case Pictures(items) if items:
            yield {"kind": "pictures", "items": [picture_parts(item) for item in items]}
        case Facts(rows):
            yield _pairs(("", ""), rows)
        case Terms(items):
            meanings = [(word, capitalize_first(meaning)) for word, meaning in items]
            yield _pairs(("word", "meaning"), meanings)
        case Table():
            yield _table(block)
        case Signatures(heads, roles):
            yield {"kind": "signatures", "heads": ["role", *heads], "roles": list(roles)}


def _heading(title: str, level: int) -> Shown:
    return {"kind": "heading", "level": level, "text": soft(title)}


def _text(words: Words, style: str = "plain") -> Shown:
    return {"kind": "text", "text": soft(plain(words), 40), "style": style}


def _pairs(heads: Sequence[str], rows: Iterable[Sequence[Cell]]) -> Shown:
    """Names and what stands beside them, which has the room that is left."""
    name, beside = heads
    columns = (Column(name, width=0), Column(beside, width=1))
    return _table(Table(caption="", columns=columns, rows=list(rows)))


def _table(table: Table) -> Shown:
    styles = [column.style for column in table.columns]
    rows = [[_cell(*each) for each in zip(row, styles, strict=True)] for row in table.rows]
    return {
        "kind": "table",
        "heads": [soft(column.head) for column in table.columns],
        "rows": rows,
        "widths": [column.width for column in table.columns],
    }


def _cell(cell: Cell, style: str = "plain") -> Any:
    """A list of lines, or a coloured verdict."""
    match cell:
        case str() if style == "code":
            return [soft(part) for part in cell.split(", ") if part]
        case str() if style == "number":
            return [soft(typeset(cell))]
        case Mark(_, verdict):
            return {"mark": verdict, "text": str(cell)}
        case Name(parts, id):
            return [soft(part) for part in (*parts, id) if part]
        case Reason():
            details = [f"{name}: {value}" for name, value in cell.details]
            cure = [] if cell.cure is None else [f"Cure: {cell.cure}", *cell.lines]
            return [soft(line) for line in (cell.text, *details, *cure)]
        case _:
            return [soft(cell)]


def _matrix(shown: ShownMatrix) -> Shown:
    """A matrix from its exact entries, or a sentence where it is too large."""
    name, label = MATRIX_NAMES.get(shown.name, shown.name), capitalize_first(shown.what)
    if shown.latex is None:
        size = f"{shown.size}, too large to be printed; see certificate.json."
        return _text(f"{label} ({name}) is {size}")
    rows = [[number_parts(entry, exact=False) for entry in row] for row in shown.matrix]
    return {"kind": "matrix", "name": name, "label": soft(label), "rows": rows}


def number_parts(value: Fraction, *, exact: bool = True) -> Shown:
    """A rational for the template: sign and digits, a decimal with its power of ten, or an
    ``exact`` fraction."""
    size = abs(value)
    parts: Shown = {"negative": value < 0, "digits": "", "over": None, "power": None}
    # A fraction of hundreds of digits would not fit on the page.
    small = max(size.numerator.bit_length(), size.denominator.bit_length()) <= 4 * LONGEST_NUMBER
    if exact and small and Fraction(significant(size, 6)) != size:
        return parts | {"digits": str(size.numerator), "over": str(size.denominator)}
    mantissa, _, power = significant(size, 6 if exact else 5).partition("e")
    return parts | {"digits": mantissa, "power": str(int(power)) if power else None}


def picture_parts(picture: Picture) -> dict[str, str]:
    """A figure for the template: its SVG with fixed colours and font, its text alternative, title
    and caption."""
    # Paper has no dark mode: variables become the colours that they stand for.
    svg = _VARIABLE.sub(r"\1", svg_of(picture))
    # There is no page from which a font could be inherited.
    svg = svg.replace("font-family: inherit", "font-family: 'DejaVu Sans'")
    box = ElementTree.fromstring(svg).get("viewBox") or "0 0 330 0"
    return {
        "svg": svg,
        "alt": soft(picture.alt, 60),
        "title": soft(picture.title),
        "caption": soft(picture.caption, 40),
        "width": f"{Decimal(box.split()[2]):.1f}",
    }
