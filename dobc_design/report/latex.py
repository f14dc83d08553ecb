r"""The report as LaTeX fragments to be \input into a paper, with the BibTeX entries of what they
rest on.

Text of the user is escaped; letters that pdfLaTeX does not have are shown by XeLaTeX and LuaLaTeX,
and as their code point elsewhere.  Nothing is computed here, and no fragment needs more than the
packages named in its first line.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from typing import Final

from jinja2 import Template

from dobc_design._show.text import typeset
from dobc_design.report import document as doc
from dobc_design.report.pages import environment_of

MAIN, BIBLIOGRAPHY = "main.tex", "references.bib"
PACKAGES: Final = "amsmath,amssymb,array,booktabs,graphicx,longtable"
_SPECIAL: Final = {
    **{each: rf"\{each}" for each in "{}$&#%_"},
    **{
        "\\": r"\textbackslash{}",
        "^": r"\textasciicircum{}",
        "~": r"\textasciitilde{}",
        "|": r"\textbar{}",
    },
    **{
        '"': r"\textquotedbl{}",
        "’": "'",
        "‘": "`",
        "“": "``",
        "”": "''",
        "–": "--",
        "—": "---",
        "…": r"\dots{}",
    },
    **{"\u00a0": "~", "\u200b": ""},
}
_LETTERS: Final = "≤≥≈±·×⊗√→∞∈✓✗αβεκλμξρτΛΨΩΣ"
_COMMANDS: Final = (
    "le ge approx pm cdot times otimes surd to infty in checkmark times alpha beta "
    "varepsilon kappa lambda mu xi rho"
    " tau Lambda Psi Omega Sigma"
)
_SIGNS: Final = {
    **{"<": "<", ">": ">", "−": "-", "′": "'"},
    **{sign: rf"\{name}" for sign, name in zip(_LETTERS, _COMMANDS.split(), strict=True)},
    **{raised: f"^{{{plain}}}" for raised, plain in zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-", strict=True)},
    **{low: f"_{{{plain}}}" for low, plain in zip("₀₁₂₃₄₅₆₇₈₉ᵢⱼₑ", "0123456789ije", strict=True)},
}
_ACCENTS: Final = {"\u0302": "hat", "\u0304": "bar"}  # combining ones, as in an estimate
_ACCENTED = re.compile("[A-Za-zα-ωΑ-Ω][\u0302\u0304]|.", re.DOTALL)
AUTOMATIC: Final = 0.9  # what a column without a width of its own is compared as
FILLED: Final = 0.9  # of the line, by all columns of a table
_LATIN = 0x180  # letters below are set by every engine
_LONG_WORD = 14  # letters; longer ones may be broken, first of all after punctuation
_PIECES = re.compile(r"[^/_.,;:@-]{1,12}[/_.,;:@-]?|.")


def latex_fragments(document: doc.Document, version: str) -> dict[str, bytes]:
    r"""The fragments of a report by file name, with references.bib and a main.tex that inputs all
    of them.

    ``version``: that of the program that made the certificate.  The same document gives the same
    bytes.
    """
    report = doc.in_form(document, "latex")
    condition, kept = report.section("condition"), dict[str, str]()
    matrices = [block for block in condition if isinstance(block, doc.Matrices)]
    formulas = [block for block in condition if not isinstance(block, doc.Matrices)]
    problem, checks, region, trace = map(
        report.section, ("problem", "checks", "region", "traceability")
    )
    for name, what, blocks in (
        ("verdict", "The verdict and what it says.", report.section("meaning")),
        ("model", "The equations with the paper's numbers, couplings, target and pins.", problem),
        ("condition", "The condition that is decided.", formulas),
        ("matrices", "The matrices; entries with a decimal point are rounded.", matrices),
        ("checks", "Every condition that was decided; numbers hold as printed.", checks),
        ("regions", "From which starts consensus is proved.", region),
        ("traceability", "Where each condition stands and which module decided it.", trace),
    ):
        if blocks:
            given = {
                "report": report,
                "name": name,
                "what": what,
                "blocks": blocks,
                "filled": FILLED,
            }
            kept[f"{name}.tex"] = _template("fragment.tex.j2").render(given, packages=PACKAGES)
    safe = "".join(each for each in version if each.isalnum() or each in ".+-")
    given = {
        "name": document.name,
        "fragments": [name.removesuffix(".tex") for name in kept],
        "version": safe,
    }
    given |= {"packages": PACKAGES, "bibliography": BIBLIOGRAPHY.removesuffix(".bib")}
    kept |= {name: _template(f"{name}.j2").render(given) for name in (BIBLIOGRAPHY, MAIN)}
    return {name: text.encode("utf-8") for name, text in kept.items()}


@cache
def _template(name: str) -> Template:
    """With signs that mean nothing in LaTeX."""
    signs = {"block_start_string": "<%", "block_end_string": "%>", "comment_start_string": "<#"}
    signs |= {
        "variable_start_string": "<<",
        "variable_end_string": ">>",
        "comment_end_string": "#>",
    }
    filters = {"tex": tex, "plain": doc.plain, "cells": _cells, "widths": _widths}
    return environment_of(filters, **signs, keep_trailing_newline=True).get_template(name)


def tex(text: object) -> str:
    """Any text for LaTeX, on one line; long words may be broken."""
    return " ".join(
        r"\allowbreak{}".join(
            map(_escaped, _PIECES.findall(word) if len(word) > _LONG_WORD else [word])
        )
        for word in str(text).split()
    )


def _escaped(text: str) -> str:
    return "".join(
        rf"\ensuremath{{\{_ACCENTS[each[1]]}{{{_SIGNS.get(each[0], each[0])}}}}}"
        if len(each) == 2
        else _letter(each)
        for each in _ACCENTED.findall(text)
    )


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
    numbers = [column.style == "number" for column in table.columns]
    return [
        [typeset(str(x)) if number else str(x) for x, number in zip(row, numbers, strict=True)]
        for row in table.rows
    ]


def _widths(table: doc.Table) -> list[float]:
    return [each.width or AUTOMATIC for each in table.columns]
