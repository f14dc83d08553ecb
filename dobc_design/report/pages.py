"""A document as one HTML page, without script and network, for paper, phones and the dark, and as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined

from dobc_design._show.text import Fragment, mathml, typeset
from dobc_design.report import document as doc
from dobc_design.report.pictures import svg_of
from dobc_design.report.words import capitalize_first

_MATRIX = re.compile(r"<mo>&#x00028;</mo><mtable>(.*?)</mtable><mo>&#x00029;</mo>", re.DOTALL)
_SPECIAL = re.compile(r"[\\`*_\[\]|<>~$&#]")
_OPENING = re.compile(r"^(\d*)([-+=.)])(?=\s|$)")  # would begin a list or underline a heading


def html_page(document: doc.Document, *, full: bool = False) -> str:
    """The page; ``full``: with its details open, to be printed.  The same document gives the same text."""
    loader = PackageLoader("dobc_design.report")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "capitalize_first": capitalize_first,
        "kind": lambda value: type(value).__name__,
        "math": _math,
        "pieces": doc.pieces,
        "svg": svg_of,
        "typeset": typeset,
    }
    template = environment.get_template("document.html.j2")
    return template.render(document=doc.in_form(document, "html"), full=full, leads=doc.leads) + "\n"


def _math(latex: str, *, display: bool = False) -> Fragment:
    """MathML as a safe fragment; only for LaTeX made by this package, never for user text."""
    text = mathml(latex.replace("'", r"^{\top}"), display=display)
    # Parentheses grow with a matrix only in fonts made for mathematics; the page draws them as borders instead.
    return Fragment(_MATRIX.sub(r'<mtable class="matrix">\1</mtable>', text))


def markdown_page(document: doc.Document) -> str:
    """The document as Markdown."""
    verdict = document.verdict
    word = f"{verdict.mark.symbol} {verdict.word.upper()}." if verdict.mark.symbol else escape(verdict.word)
    lines = [f"# {escape(document.name)}\n", f"**{word}** {escape(verdict.reason)}\n"]
    shown = doc.in_form(document, "markdown")
    for block in (*shown.blocks, *shown.details):
        lines += _lines(block, top=True)
    return "\n".join(lines).rstrip() + "\n"


def escape(text: object) -> str:
    """Escape user text so that Markdown and HTML show it as it is, on one line."""
    return _OPENING.sub(r"\1\\\2", _SPECIAL.sub(r"\\\g<0>", " ".join(str(text).split())))


def _lines(block: doc.Block, *, top: bool = False) -> Iterator[str]:
    match block:
        case doc.Section(title=title, blocks=blocks):
            yield f"## {escape(title)}\n" if top else f"{escape(title)}:\n"
            for each in blocks:
                yield from _lines(each)
        case doc.Box():
            yield f"**{escape(f'{block.title}: {block.mark}')}.** {escape(block.reason)}\n\n{escape(block.note)}\n"
        case doc.Text(words):
            yield _words(words) + "\n"
        case doc.List(items):
            yield from (f"- {_words(item)}" for item in items)
            yield ""
        case doc.Terms(items):
            for word, meaning in items:
                yield f"- {escape(word.verdict if isinstance(word, doc.Mark) else word)}: {escape(meaning)}"
            yield ""
        case doc.Facts(rows):
            yield from _table(("", ""), (map(escape, row) for row in rows))
        case doc.Code(lines, command):
            yield f"```\n{lines[0]}\n```\n" if command else "\n".join(f"    {line}" for line in lines) + "\n"
        case doc.Formula():
            label = f"{capitalize_first(block.label)} {block.number}".strip()
            yield (f"{label}:\n\n" if block.label else "") + _formula(block.latex)
        case doc.Matrices(items):
            for item in items:
                yield f"{capitalize_first(escape(item.what))}:\n"
                yield _formula(item.latex) if item.latex else f"{item.size}, see certificate.json.\n"
        case doc.Table():
            yield from _table(
                [escape(column.head) for column in block.columns], (map(_cell, row) for row in block.rows)
            )
        case doc.Signatures(heads, roles):
            yield from _table(("", *heads), ((role, *("&nbsp;" * 24 for _ in heads)) for role in roles))


def _words(words: doc.Words) -> str:
    """Escaped as a whole, but for text of this package."""
    return str(words) if isinstance(words, doc.Own) else escape(doc.plain(words))


def _cell(cell: doc.Cell) -> str:
    if not isinstance(cell, doc.Reason):
        return escape(cell)
    parts = [escape(cell.text), *(f"{escape(name)}: {escape(value)}." for name, value in cell.details)]
    parts += [] if cell.cure is None else [f"**Cure:** {escape(cell.cure)}"]
    return "<br>".join([*parts, *(escape(line) + ";" for line in cell.lines)])


def _table(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def _formula(latex: str) -> str:
    return f"$$\n{latex}\n$$\n"
