"""The nouns of a report: a tree of titled blocks, built once and shown by four renderers.

``content`` and ``comparison`` build documents; ``html``, ``markdown``, ``pdf`` and ``latex`` show them.  All text is
plain text: a renderer escapes it.  What not every form shows says so with ``Only`` or with a column's ``only``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Final, Literal, TypeVar

from dobc_design._show.text import latex_matrix
from dobc_design.exact.matrix import Matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Form = Literal["html", "markdown", "pdf", "latex"]
PAGES: Final[tuple[Form, ...]] = ("html", "pdf")  # with pictures, and room for explanations
TEXTS: Final[tuple[Form, ...]] = ("markdown", "latex")
READ: Final[tuple[Form, ...]] = ("html", "markdown", "pdf")  # whole documents; LaTeX fragments are parts of a paper
EVERY: Final[tuple[Form, ...]] = ("html", "markdown", "pdf", "latex")

Row = TypeVar("Row")


class Own(str):
    """Text of this package that Markdown shows as it stands, with its line breaks and back quotes."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Math:
    """A few letters of mathematics inside a sentence: as plain text, and as LaTeX for the page."""

    plain: str
    latex: str

    def __str__(self) -> str:
        return self.plain


@dataclass(frozen=True, slots=True)
class Strong:
    """Words inside a sentence that stand out."""

    text: str

    def __str__(self) -> str:
        return self.text


Words = str | tuple[str | Math | Strong, ...]


def pieces(words: Words) -> tuple[str | Math | Strong, ...]:
    """The words as pieces, also where they are a single text."""
    return (words,) if isinstance(words, str) else words


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    words: Words
    style: Literal["plain", "caption", "warning"] = "plain"


@dataclass(frozen=True, slots=True)
class List:
    """A list of sentences."""

    items: tuple[Words, ...]


@dataclass(frozen=True, slots=True)
class Facts:
    """Names and values side by side."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Terms:
    """Words and what they mean: (word, id that stands behind it, meaning)."""

    items: tuple[tuple[str | Mark, str, str], ...]


@dataclass(frozen=True, slots=True)
class Code:
    """Lines of a file, or with ``command`` one line to be typed."""

    lines: tuple[str, ...]
    command: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """A displayed formula.

    ``label`` says what it is, ``number`` is that of the paper.  ``typst``: its name in the template of the PDF, which
    does not read LaTeX, or the exact number below which the largest eigenvalue of Lambda stays.
    """

    latex: str
    label: str = ""
    number: str = ""
    typst: str | Fraction = ""


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True)
class Matrices:
    """Matrices beside each other."""

    items: tuple[ShownMatrix, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure that is still to be drawn, with its caption and its text alternative; sizes in inches.

    ``name`` begins the identifiers of its SVG, so that several figures can share a page.
    """

    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[Axes], object]
    width: float = 4.6
    height: float = 2.9


@dataclass(frozen=True, slots=True)
class Pictures:
    """Figures beside each other; ``small`` ones need less room."""

    items: tuple[Picture, ...]
    small: bool = False


@dataclass(frozen=True, slots=True)
class Mark:
    """A verdict as a sign and a word."""

    symbol: str
    verdict: str

    def __str__(self) -> str:
        return f"{self.symbol} {self.verdict}"


@dataclass(frozen=True, slots=True)
class Name:
    """What a row is about, in a few parts; ``id`` and ``code`` lines stand below it on a page only."""

    parts: tuple[str, ...]
    id: str = ""

    def __str__(self) -> str:
        return ", ".join(self.parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Why a verdict was reached: a sentence, values with their names, and a cure with its lines of the problem file."""

    text: str
    details: tuple[tuple[str, str], ...] = ()
    cure: str | None = None
    lines: tuple[str, ...] = ()


Cell = str | Mark | Name | Reason


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its head, its part of the width of a printed page (0: what it needs), and the forms that show it.

    ``unit`` is named where the head stands alone, on a phone.  ``style``: "number" for numbers in columns, "why" for
    sentences, "code" for names of files, "plain" for the rest.
    """

    head: str
    width: float = 1.0
    unit: str = ""
    style: Literal["plain", "number", "why", "code"] = "plain"
    only: tuple[Form, ...] = EVERY


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table; ``cards``: on a phone every row is a card.  ``marked`` rows stand out."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    cards: bool = False
    marked: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A verdict in a frame: its word and reason, facts, and for one of several its title and a note."""

    mark: Mark
    word: str
    reason: str
    facts: tuple[tuple[str, str], ...] = ()
    title: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class Signatures:
    """Lines to be signed on paper: one for each role."""

    heads: tuple[str, ...]
    roles: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A titled part; ``name`` is its anchor, ``short`` its words in the list of sections."""

    title: str
    blocks: tuple[Block, ...]
    name: str = ""
    short: str = ""


@dataclass(frozen=True, slots=True)
class Beside:
    """Parts beside each other where there is room, as equals or the second one wider."""

    parts: tuple[tuple[Block, ...], ...]
    second_wider: bool = False


@dataclass(frozen=True, slots=True)
class Only:
    """Blocks that only some forms show."""

    forms: tuple[Form, ...]
    blocks: tuple[Block, ...]


Block = (
    Text
    | List
    | Facts
    | Terms
    | Code
    | Formula
    | Matrices
    | Pictures
    | Table
    | Box
    | Signatures
    | Section
    | Beside
    | Only
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A whole document: what it is and about whom, its verdict, what identifies it, and its blocks."""

    kind: str
    name: str
    title: str
    verdict: Box
    identity: tuple[tuple[str, str], ...]
    footer: str
    blocks: tuple[Block, ...]

    def section(self, name: str) -> tuple[Block, ...]:
        """The blocks of the section of this name; empty where there is none."""
        return next((each.blocks for each in self.blocks if isinstance(each, Section) and each.name == name), ())


def table_of(
    caption: str,
    rows: Iterable[Row],
    *columns: tuple[Column, Callable[[Row], Cell]],
    cards: bool = False,
    marked: frozenset[int] = frozenset(),
) -> Table:
    """A table from its rows, each column with what it shows of a row."""
    cells = tuple(tuple(shown(row) for _, shown in columns) for row in rows)
    return Table(caption=caption, columns=tuple(each for each, _ in columns), rows=cells, cards=cards, marked=marked)


def in_form(document: Document, form: Form) -> Document:
    """The document as one form shows it: ``Only``, its columns and sections that are left empty are resolved."""
    return replace(document, blocks=tuple(_chosen(document.blocks, form)))


def _chosen(blocks: Sequence[Block], form: Form) -> Iterator[Block]:
    for block in blocks:
        match block:
            case Only(forms, inner):
                yield from _chosen(inner, form) if form in forms else ()
            case Section():
                inner = tuple(_chosen(block.blocks, form))
                if inner:
                    yield replace(block, blocks=inner)
            case Beside():
                yield replace(block, parts=tuple(tuple(_chosen(part, form)) for part in block.parts))
            case Table():
                kept = [place for place, column in enumerate(block.columns) if form in column.only]
                columns = tuple(block.columns[place] for place in kept)
                yield replace(block, columns=columns, rows=tuple(tuple(row[k] for k in kept) for row in block.rows))
            case _:
                yield block


def leads(block: Block, after: Block | None) -> bool:
    """Whether a paragraph introduces what comes after it and should stay on its page."""
    plain = isinstance(block, Text) and block.style == "plain"
    return plain and after is not None and not isinstance(after, (Section, Text))
