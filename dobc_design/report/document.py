"""The nouns of a report: a tree of titled blocks, built once and shown by four renderers.

``content`` and ``comparison`` build documents; ``pages``, ``pdf`` and ``latex`` show them.  All
text is plain text: a renderer escapes it.  What not every form shows says so with ``Only`` or with
a column's ``only``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, fields, is_dataclass, replace
from fractions import Fraction
from functools import wraps
from itertools import chain, compress
from typing import TYPE_CHECKING, Any, Literal, ParamSpec

from dobc_design._checks import noun, positional
from dobc_design._show.text import RAISED, latex_matrix
from dobc_design.exact.matrix import Matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes

P = ParamSpec("P")
Form = Literal["html", "markdown", "pdf", "latex"]
Forms = tuple[Form, ...]
EVERY: Forms = ("html", "markdown", "pdf", "latex")
PAGES: Forms = ("html", "pdf")  # with pictures, and room for explanations
IN_TEXT: Forms = ("markdown", "latex")
# whole documents; LaTeX fragments are parts of a paper
READ: Forms = ("html", "markdown", "pdf")
#: The details that every printed report has: what is signed is on paper.
PRINTED = ("region", "cure", "checks", "condition", "recheck", "signatures")


class Own(str):
    """Text of this package that Markdown shows as it stands, with its line breaks and back
    quotes."""

    __slots__ = ()


@positional
class Math:
    """A few letters of mathematics inside a sentence: as plain text, and as LaTeX for the page."""

    plain: str
    latex: str

    def __str__(self) -> str:
        return self.plain


Words = str | tuple[str | Math, ...]


def worded(text: str) -> Words:
    """A sentence in which mathematics stands as LaTeX between dollars."""
    parts = text.split("$")
    return tuple(_math(part) if place % 2 else part for place, part in enumerate(parts))


def _math(latex: str) -> Math:
    raised = re.sub(r"\^{?(-?\d+)}?", lambda found: found[1].translate(RAISED), latex)
    return Math(raised.replace("{", "").replace("}", ""), latex)


def pieces(words: Words) -> tuple[str | Math, ...]:
    """The words as pieces, also where they are a single text."""
    return (words,) if isinstance(words, str) else words


def plain(words: Words) -> str:
    """The words as one text."""
    return "".join(map(str, pieces(words)))


class Block:
    """Whatever a document shows, one below the other."""

    __slots__ = ()


Blocks = Iterator[Block]
Fact = tuple[str, str]  # a name and its value


@positional
class Text(Block):
    """A paragraph."""

    words: Words
    style: Literal["plain", "caption", "warning"] = "plain"


@positional
class List(Block):
    """A list of sentences."""

    items: Sequence[Words]


@positional
class Facts(Block):
    """Names and values side by side."""

    rows: Sequence[Fact]


@positional
class Terms(Block):
    """Words and what they mean."""

    items: Sequence[tuple[str | Mark, str]]


@positional
class Code(Block):
    """Lines of a file, or with ``command`` one line to be typed."""

    lines: Sequence[str]
    command: bool = False


@positional
class Formula(Block):
    """A displayed formula.  ``label`` says what it is, ``number`` is that of the paper.  ``typst``:
    its name in the template of the PDF, which does not read LaTeX, or the exact number below which
    the largest eigenvalue of Lambda stays."""

    latex: str
    label: str = ""
    number: str = ""
    typst: str | Fraction = ""


@positional
class ShownMatrix:
    """A matrix with its name (LaTeX) and what it is."""

    name: str
    what: str
    matrix: Matrix

    @property
    def latex(self) -> str | None:
        """LaTeX of "name = entries"; None where it is too large to be printed."""
        entries = latex_matrix(self.matrix)
        return None if entries is None else f"{self.name} = {entries}"

    @property
    def size(self) -> str:
        """Rows and columns."""
        return f"{len(self.matrix)} × {len(self.matrix[0]) if self.matrix else 0}"


@positional
class Matrices(Block):
    """Matrices beside each other."""

    items: Sequence[ShownMatrix]


@positional
class Picture:
    """A figure still to be drawn, with caption and text alternative; inches.  ``name`` begins the
    SVG identifiers."""

    name: str
    title: str
    _: KW_ONLY
    caption: str = ""
    alt: str
    draw: Callable[[Axes], object]
    width: float = 4.6
    height: float = 2.9


@positional
class Pictures(Block):
    """Figures beside each other; ``small`` ones need less room."""

    items: Sequence[Picture]
    small: bool = False


@positional
class Mark:
    """A verdict as a sign and a word."""

    symbol: str
    verdict: str

    def __str__(self) -> str:
        return f"{self.symbol} {self.verdict}"


@positional
class Name:
    """What a row is about, in a few parts; ``id`` stands below it on a page only."""

    parts: tuple[str, ...]
    id: str = ""

    def __str__(self) -> str:
        return ", ".join(self.parts)


@noun
class Reason:
    """Why a verdict was reached: a sentence, values with their names, and a cure with its lines of
    the problem file."""

    text: str
    details: Sequence[Fact] = ()
    cure: str | None = None
    lines: Sequence[str] = ()


Cell = str | Mark | Name | Reason


@positional
class Column:
    """One column: its head, what ``table_of`` shows of a row, and its part of a page's width (0:
    what it needs). ``unit`` is named where the head stands alone, on a phone.  ``style``: "number"
    for numbers in columns, "why" for sentences, "code" for names of files, "plain" for the rest.
    ``only``: the forms that have it."""

    head: str
    shown: Callable[[Any], Cell] = str
    width: float = 1.0
    _: KW_ONLY
    unit: str = ""
    style: Literal["plain", "number", "why", "code"] = "plain"
    only: Sequence[Form] = EVERY


@noun
class Table(Block):
    """A table; ``cards``: on a phone every row is a card.  ``marked`` rows stand out."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    cards: bool = False
    marked: frozenset[int] = frozenset()


@noun
class Box(Block):
    """A verdict in a frame: its word and reason, facts, and for one of several its title and a
    note."""

    mark: Mark
    word: str
    reason: str
    facts: Sequence[Fact] = ()
    title: str = ""
    note: str = ""


@positional
class Signatures(Block):
    """Lines to be signed on paper: one for each role."""

    heads: Sequence[str]
    roles: Sequence[str]


@positional
class Section(Block):
    """A titled part; ``name`` is its anchor, ``short`` its words in the list of sections where the
    title is long."""

    title: str
    blocks: Sequence[Block]
    name: str = ""
    short: str = ""


@positional
class Beside(Block):
    """Parts beside each other where there is room, as equals or the second one wider; on a page of
    HTML only."""

    parts: Sequence[Sequence[Block]]
    second_wider: bool = False


@positional
class Only(Block):
    """Blocks that only some forms show."""

    forms: Sequence[Form]
    blocks: Sequence[Block]


@noun
class Document:
    """A whole document; ``details`` are closed on a page, and printed only where the whole report
    is asked for."""

    kind: str
    name: str
    title: str
    verdict: Box
    identity: Sequence[Fact]
    footer: str
    blocks: Sequence[Block]
    details: Sequence[Block] = ()

    def section(self, name: str) -> Sequence[Block]:
        """The blocks of the section of this name; empty where there is none."""
        sections = (each for each in (*self.blocks, *self.details) if isinstance(each, Section))
        return next((each.blocks for each in sections if each.name == name), ())


def section(
    title: str, name: str, short: str = ""
) -> Callable[[Callable[P, Blocks]], Callable[P, Iterator[Section]]]:
    """Make the blocks that a function yields a section; none where it yields none."""

    def of(blocks: Callable[P, Blocks]) -> Callable[P, Iterator[Section]]:
        @wraps(blocks)
        def titled(*args: P.args, **named: P.kwargs) -> Iterator[Section]:
            found = tuple(blocks(*args, **named))
            if found:
                yield Section(title, found, name, short)

        return titled

    return of


def on_pages(*blocks: Block) -> Only:
    """Blocks for HTML and PDF."""
    return Only(PAGES, blocks)


def in_markdown(*blocks: Block) -> Only:
    """Blocks for Markdown."""
    return Only(("markdown",), blocks)


def to_read(*blocks: Block) -> Only:
    """Blocks for whole documents."""
    return Only(READ, blocks)


def command(*lines: str) -> Code:
    """A command to be typed, or one for each of several."""
    return Code(lines, command=True)


def table_of(caption: str, rows: Iterable[Any], *columns: Column, cards: bool = False) -> Table:
    """A table from its rows, each column with what it shows of a row."""
    cells = tuple(tuple(column.shown(row) for column in columns) for row in rows)
    return Table(caption=caption, columns=columns, rows=cells, cards=cards)


def in_form(document: Document, form: Form) -> Document:
    """The document as one form shows it: ``Only``, ``Beside``, its columns and sections left empty
    are resolved."""
    shown, more = (tuple(_chosen(blocks, form)) for blocks in (document.blocks, document.details))
    return replace(document, blocks=shown, details=more)


#: What readers do not read, or what is no sentence.
_AS_IS = ("name", "style", "only", "forms", "latex", "typst", "id", "symbol", "footer")


def turned(part: Any, said: Callable[[str], str]) -> Any:
    """A document, or a part of it, with its sentences turned by ``said``; commands, lines of files
    and formulas stay."""
    if isinstance(part, str):
        return type(part)(said(part))
    if isinstance(part, (tuple, list)):
        return tuple(turned(each, said) for each in part)
    if not is_dataclass(part) or isinstance(part, (type, Code, Math, ShownMatrix)):
        return part
    names = [each.name for each in fields(part) if each.name not in _AS_IS]
    return replace(part, **{name: turned(getattr(part, name), said) for name in names})


def _chosen(blocks: Sequence[Block], form: Form) -> Blocks:
    for block in blocks:
        match block:
            case Only(forms, inner):
                yield from _chosen(inner, form) if form in forms else ()
            case Section():
                inner = tuple(_chosen(block.blocks, form))
                # a heading with nothing below it would look like something missing
                if inner:
                    yield replace(block, blocks=inner)
            case Beside(parts) if form == "html":
                yield replace(block, parts=tuple(tuple(_chosen(part, form)) for part in parts))
            # one below the other where there is no room for two
            case Beside(parts):
                yield from _chosen(list(chain.from_iterable(parts)), form)
            case Table():
                # A column that a form does not have takes its cells along.
                kept = [form in column.only for column in block.columns]
                rows = tuple(tuple(compress(row, kept)) for row in block.rows)
                yield replace(block, columns=tuple(compress(block.columns, kept)), rows=rows)
            case _:
                yield block


def leads(block: Block, after: Block | None) -> bool:
    """Whether a paragraph introduces what comes after it and should stay on its page."""
    paragraph = isinstance(block, Text) and block.style == "plain"
    return paragraph and after is not None and not isinstance(after, (Section, Text))
