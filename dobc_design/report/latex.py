r"""The report as LaTeX fragments to be \input into a paper, with the BibTeX entries of what they
rest on.

Text of the user is escaped; letters that pdfLaTeX does not have are shown by XeLaTeX and LuaLaTeX,
and as their code point elsewhere.  Nothing is computed here, and no fragment needs more than the
packages named in its first line.
"""

import re
import unicodedata
from collections.abc import Sequence
from functools import cache

from jinja2 import Template

from dobc_design._show.text import typeset
from dobc_design.report import document as doc

from .pages import environment_of
from .words import TEXTS

Files = dict[str, bytes]  # by name
MAIN, BIBLIOGRAPHY = "main.tex", "references.bib"
PACKAGES = "amsmath,amssymb,array,booktabs,graphicx,longtable"
_SPECIAL: dict[str, str] = TEXTS["latex"]["special"]
_SIGNS: dict[str, str] = TEXTS["latex"]["signs"]
_ACCENTS = {"\u0302": "hat", "\u0304": "bar"}  # combining ones, as in an estimate
_ACCENTED = re.compile("[A-Za-zα-ωΑ-Ω][\u0302\u0304]|.", re.DOTALL)
AUTOMATIC = 0.9  # what a column without a width of its own is compared as
FILLED = 0.9  # of the line, by all columns of a table
_LATIN = 0x180  # letters below are set by every engine
_LONG_WORD = 14  # letters; longer ones may be broken, first of all after punctuation
_PIECES = re.compile(r"[^/_.,;:@-]{1,12}[/_.,;:@-]?|.")


def latex_fragments(document: doc.Document, version: str) -> Files:
    r"""The fragments of a report by file name, with references.bib and a main.tex that inputs all
    of them.

    ``version``: that of the program that made the certificate.  The same document gives the same
    bytes.
    """
    report = doc.in_form(document, "latex")
    condition = report.section("condition")
    # A paper has its matrices in an appendix, the condition in its text.
    matrices = [block for block in condition if isinstance(block, doc.Matrices)]
    formulas = [block for block in condition if not isinstance(block, doc.Matrices)]
    kept: dict[str, str] = {}
    sections: dict[str, Sequence[doc.Block]] = {"condition": formulas, "matrices": matrices}
    for name, (section, what) in TEXTS["latex"]["fragments"].items():
        blocks = sections.get(section, report.section(section))
        if blocks:
            kept[f"{name}.tex"] = _template("fragment.tex.j2").render(
                report=report,
                name=name,
                what=what,
                blocks=blocks,
                filled=FILLED,
                packages=PACKAGES,
            )
    # main.tex inputs those that are there, before it is one of them itself.
    names = [name.removesuffix(".tex") for name in kept]
    for name in (BIBLIOGRAPHY, MAIN):
        kept[name] = _template(f"{name}.j2").render(
            name=document.name,
            fragments=names,
            # It comes from a file: only what a version number may have.
            version="".join(each for each in version if each.isalnum() or each in ".+-"),
            packages=PACKAGES,
            bibliography=BIBLIOGRAPHY.removesuffix(".bib"),
        )
    return {name: text.encode("utf-8") for name, text in kept.items()}


@cache
def _template(name: str) -> Template:
    """With signs that mean nothing in LaTeX."""
    filters = {"tex": tex, "plain": doc.plain, "cells": _cells, "widths": _widths}
    environment = environment_of(
        filters,
        keep_trailing_newline=True,
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
    )
    return environment.get_template(name)


def tex(text: object) -> str:
    """Any text for LaTeX, on one line; long words may be broken."""
    return " ".join(map(_word, str(text).split()))


def _word(word: str) -> str:
    # A path or a hash would run over the margin.
    pieces = _PIECES.findall(word) if len(word) > _LONG_WORD else [word]
    return r"\allowbreak{}".join(map(_escaped, pieces))


def _escaped(text: str) -> str:
    return "".join(map(_sign, _ACCENTED.findall(text)))


def _sign(sign: str) -> str:
    """A letter, or one with an accent as two code points."""
    if len(sign) == 1:
        return _letter(sign)
    letter, accent = _SIGNS.get(sign[0], sign[0]), _ACCENTS[sign[1]]
    return rf"\ensuremath{{\{accent}{{{letter}}}}}"


def _letter(letter: str) -> str:
    if letter in _SPECIAL:
        return _SPECIAL[letter]
    if letter in _SIGNS:
        return rf"\ensuremath{{{_SIGNS[letter]}}}"
    category = unicodedata.category(letter)
    if ord(letter) < 0x7F or (ord(letter) < _LATIN and category[0] == "L"):
        return letter
    if category[0] in "CZ":  # nothing that could be seen
        return rf"\texttt{{U+{ord(letter):04X}}}"
    return rf"\dobcunicode{{{ord(letter):04X}}}{{{letter}}}"


def _cells(table: doc.Table) -> list[list[str]]:
    """The texts of a table, numbers as people write them."""
    styles = [column.style for column in table.columns]
    rows = []
    for row in table.rows:
        texts = []
        for cell, style in zip(row, styles, strict=True):
            texts.append(typeset(str(cell)) if style == "number" else str(cell))
        rows.append(texts)
    return rows


def _widths(table: doc.Table) -> list[float]:
    return [each.width or AUTOMATIC for each in table.columns]
