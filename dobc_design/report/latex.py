r"""The report as LaTeX fragments to be \input into a paper, with the BibTeX entries of what they rest on.

Text of the user is escaped; letters that pdfLaTeX does not have are shown by XeLaTeX and LuaLaTeX, and as their code
point elsewhere.  Nothing is computed here, and no fragment needs more than the packages named in its first line.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from itertools import chain, zip_longest
from typing import Final

from dobc_design._show.text import typeset
from dobc_design.report import document as doc
from dobc_design.report.words import capitalize_first

MAIN, BIBLIOGRAPHY = "main.tex", "references.bib"
PACKAGES: Final = ("amsmath", "amssymb", "array", "booktabs", "graphicx", "longtable")
_HEAD = r"""% Needs \usepackage{{{packages}}}. {what}
\providecommand{{\dobcfit}}[1]{{\sbox0{{$\displaystyle #1$}}\ifdim\wd0>\linewidth
  \resizebox{{\linewidth}}{{!}}{{\usebox0}}\else\usebox0\fi}}
\providecommand{{\dobcunicode}}[2]{{\ifdefined\Umathcode #2\else\texttt{{U+#1}}\fi}}
"""
_SPECIAL: Final = {
    **{each: rf"\{each}" for each in "{}$&#%_"},
    **{"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "|": r"\textbar{}"},
    **{'"': r"\textquotedbl{}", "’": "'", "‘": "`", "“": "``", "”": "''", "–": "--", "—": "---", "…": r"\dots{}"},
    **{"\u00a0": "~", "\u200b": ""},
}
_LETTERS: Final = "≤≥≈±·×⊗√→∞∈✓✗αβεκλμξρτΛΨΩΣ"
_COMMANDS: Final = (
    "le ge approx pm cdot times otimes surd to infty in checkmark times alpha beta varepsilon kappa lambda mu xi rho"
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
    r"""The fragments of a report by file name, with references.bib and a main.tex that inputs all of them.

    ``version``: that of the program that made the certificate.  The same document gives the same bytes.
    """
    report = doc.in_form(document, "latex")
    condition = report.section("condition")
    matrices = [block for block in condition if isinstance(block, doc.Matrices)]
    formulas = [block for block in condition if not isinstance(block, doc.Matrices)]
    width = (r"\setcounter{MaxMatrixCols}{12}",) if matrices else ()
    problem, checks, region, trace = map(report.section, ("problem", "checks", "region", "traceability"))
    parts: tuple[tuple[str, str, Iterable[str]], ...] = (
        ("verdict", "The verdict and what it says.", _verdict(report)),
        ("model", "The equations with the paper's numbers, couplings, target and pins.", _shown(problem)),
        ("condition", "The condition that is decided.", _shown(formulas)),
        ("matrices", "The matrices; entries with a decimal point are rounded.", (*width, *_shown(matrices))),
        ("checks", "Every condition that was decided; numbers hold as printed.", _shown(checks)),
        ("regions", "From which starts consensus is proved.", _shown(region)),
        ("traceability", "Where each condition stands and which module decided it.", _shown(trace)),
    )
    kept = {}
    for name, what, lines in parts:
        text = "\n".join(lines)
        if text:
            kept[f"{name}.tex"] = _HEAD.format(packages=",".join(PACKAGES), what=what) + text + "\n"
    entries = (files("dobc_design.report") / "templates" / BIBLIOGRAPHY).read_text("utf-8")
    safe = "".join(each for each in version if each.isalnum() or each in ".+-")
    inputs = [name.removesuffix(".tex") for name in kept]
    kept |= {BIBLIOGRAPHY: entries.replace("VERSION", safe), MAIN: _main(document.name, inputs)}
    return {name: text.encode("utf-8") for name, text in kept.items()}


def tex(text: object) -> str:
    """Any text for LaTeX, on one line; long words may be broken."""
    return " ".join(
        r"\allowbreak{}".join(map(_escaped, _PIECES.findall(word) if len(word) > _LONG_WORD else [word]))
        for word in str(text).split()
    )


def _escaped(text: str) -> str:
    return "".join(
        rf"\ensuremath{{\{_ACCENTS[each[1]]}{{{_SIGNS.get(each[0], each[0])}}}}}" if len(each) == 2 else _letter(each)
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


def _main(name: str, fragments: Sequence[str]) -> str:
    inputs = "\n".join(rf"\input{{{each}}}" for each in fragments)
    return (
        "\\documentclass[a4paper]{article}\n\\usepackage[T1]{fontenc}\n\\usepackage[margin=22mm]{geometry}\n"
        f"\\usepackage{{{','.join(PACKAGES)}}}\n\\usepackage{{textcomp}}\n\\title{{{tex(name)}}}\\author{{}}\\date{{}}\n"
        f"\\begin{{document}}\n\\maketitle\n{inputs}\n"
        f"\\nocite{{*}}\n\\bibliographystyle{{plain}}\n\\bibliography{{{BIBLIOGRAPHY.removesuffix('.bib')}}}\n"
        "\\end{document}\n"
    )


def _verdict(report: doc.Document) -> Iterator[str]:
    verdict = report.verdict
    yield rf"\paragraph{{{tex(report.name)}: {tex(verdict.mark.verdict)}.}} {tex(verdict.reason)}"
    yield ""
    yield from _table(("", ""), (*verdict.facts, *report.identity), (0.9, 2.4))
    yield from _shown(report.section("meaning"))


def _shown(blocks: Sequence[doc.Block]) -> Iterator[str]:
    for block, after in zip_longest(blocks, blocks[1:]):
        match block:
            case doc.Section(title=title, blocks=inner):
                yield f"{tex(title)}:"
                yield from _shown(inner)
            case doc.Text(words):
                yield tex(doc.plain(words))
                if isinstance(after, (doc.Text, doc.Table)):
                    yield ""
            case doc.List(items):
                yield r"\begin{itemize}"
                yield from (rf"  \item {tex(item)}" for item in items)
                yield r"\end{itemize}"
            case doc.Formula(latex=latex, number=number):
                yield rf"\[ {latex} \tag{{{number.strip('()')}}} \]" if number else _displayed(latex)
            case doc.Matrices(items):
                yield from chain.from_iterable(map(_matrix, items))
            case doc.Table(columns=columns, rows=rows):
                numbers = [column.style == "number" for column in columns]
                cells = [
                    [typeset(str(x)) if is_number else str(x) for x, is_number in zip(row, numbers, strict=True)]
                    for row in rows
                ]
                yield from _table([each.head for each in columns], cells, [each.width or AUTOMATIC for each in columns])


def _matrix(item: doc.ShownMatrix) -> Iterator[str]:
    what = tex(capitalize_first(item.what))
    if item.latex is None:
        yield rf"{what} (${item.name}$) is {tex(item.size)}; see certificate.json."
    else:
        yield f"{what}:"
        yield _displayed(item.latex)


def _displayed(latex: str) -> str:
    return rf"\[ \dobcfit{{{latex}}} \]"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[float]) -> Iterator[str]:
    """A table over several pages; ``widths`` are compared with each other."""
    parts = [round(FILLED * width / sum(widths), 3) for width in widths]
    columns = " ".join(rf">{{\raggedright\arraybackslash}}p{{{part}\linewidth}}" for part in parts)
    yield rf"{{\footnotesize\setlength{{\tabcolsep}}{{3pt}}\begin{{longtable}}{{@{{}}{columns}@{{}}}}"
    yield r"\toprule"
    if any(heads):
        yield rf"{' & '.join(map(tex, heads))} \\ \midrule\endhead"
    yield from (rf"{' & '.join(map(tex, row))} \\" for row in rows)
    yield r"\bottomrule\end{longtable}}"
