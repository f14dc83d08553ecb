"""A document as one HTML page, without script and network, for paper, phones and the dark, and as
Markdown."""

import re
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from dobc_design._show.text import Fragment, capitalize_first, mathml, typeset
from dobc_design.report import document as doc

from .pictures import svg_of

_MATRIX = re.compile(r"<mo>&#x00028;</mo><mtable>(.*?)</mtable><mo>&#x00029;</mo>", re.DOTALL)
_SPECIAL = re.compile(r"[\\`*_\[\]|<>~$&#]")
_OPENING = re.compile(r"^(\d*)([-+=.)])(?=\s|$)")  # would begin a list or underline a heading


def html_page(document: doc.Document, *, full: bool = False) -> str:
    """The page; ``full``: with its details open, to be printed.  The same document gives the same
    text."""
    shown = doc.in_form(document, "html")
    return (
        _html_template().render(document=shown, full=full, leads=doc.leads, printed=doc.PRINTED)
        + "\n"
    )


def markdown_page(document: doc.Document) -> str:
    """The document as Markdown."""
    text = _markdown_template().render(document=doc.in_form(document, "markdown"))
    return text.rstrip() + "\n"


@cache
def _html_template() -> Template:
    filters = {"math": _math, "pieces": doc.pieces, "svg": svg_of, "typeset": typeset}
    return environment_of(filters, autoescape=True).get_template("document.html.j2")


@cache
def _markdown_template() -> Template:
    return environment_of({"md": escape, "words": _words}).get_template("document.md.j2")


def environment_of(filters: dict[str, Any], **options: Any) -> Environment:
    """The templates of this room with these filters; without ``autoescape`` every template escapes
    by its own."""
    environment = Environment(
        loader=PackageLoader("dobc_design.report"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        **options,
    )
    environment.filters["capitalize_first"] = capitalize_first
    environment.filters["kind"] = lambda it: type(it).__name__
    environment.filters |= filters
    return environment


def _math(latex: str, *, display: bool = False) -> Fragment:
    """MathML as a safe fragment; only for LaTeX made by this package, never for user text."""
    text = mathml(latex.replace("'", r"^{\top}"), display=display)
    # Parentheses grow with a matrix only in fonts made for mathematics; the page draws them as
    # borders instead.
    return Fragment(_MATRIX.sub(r'<mtable class="matrix">\1</mtable>', text))


def escape(text: object) -> str:
    """Escape user text so that Markdown and HTML show it as it is, on one line."""
    line = " ".join(str(text).split())
    safe = _SPECIAL.sub(r"\\\g<0>", line)
    return _OPENING.sub(r"\1\\\2", safe)


def _words(words: doc.Words) -> str:
    """Escaped as a whole, but for text of this package."""
    return str(words) if isinstance(words, doc.Own) else escape(doc.plain(words))
