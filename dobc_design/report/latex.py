r"""The report as LaTeX fragments to be \input into a paper, with the BibTeX entries of what they rest on.

Text of the user is escaped; letters that pdfLaTeX does not have are shown by XeLaTeX and LuaLaTeX, and as their code
point elsewhere.  Nothing is computed here, and no fragment needs more than the packages named in its first line.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from dobc_design._show.text import latex_number
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.report import formulas
from dobc_design.report.check_views import CheckRow
from dobc_design.report.references import bibliography
from dobc_design.report.view import common_view
from dobc_design.report.words import capitalize_first, typeset

MAIN, BIBLIOGRAPHY = "main.tex", "references.bib"
PACKAGES: Final = ("amsmath", "amssymb", "array", "booktabs", "graphicx", "longtable")
_HEAD = r"""% Needs \usepackage{{{packages}}}. {what}
\providecommand{{\dobcfit}}[1]{{\sbox0{{$\displaystyle #1$}}\ifdim\wd0>\linewidth
  \resizebox{{\linewidth}}{{!}}{{\usebox0}}\else\usebox0\fi}}
\providecommand{{\dobcunicode}}[2]{{\ifdefined\Umathcode #2\else\texttt{{U+#1}}\fi}}
"""
_SPECIAL: Final = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "’": "'",
    "‘": "`",
    "“": "``",
    "”": "''",
    "–": "--",
    "—": "---",
    "…": r"\dots{}",
    "\u00a0": "~",
    "\u200b": "",
}
_SIGNS: Final = {
    "<": "<",
    ">": ">",
    "≤": r"\le",
    "≥": r"\ge",
    "≈": r"\approx",
    "±": r"\pm",
    "−": "-",
    "·": r"\cdot",
    "×": r"\times",
    "⊗": r"\otimes",
    "√": r"\surd",
    "→": r"\to",
    "∞": r"\infty",
    "∈": r"\in",
    "′": "'",
    "✓": r"\checkmark",
    "✗": r"\times",
    "α": r"\alpha",
    "β": r"\beta",
    "ε": r"\varepsilon",
    "κ": r"\kappa",
    "λ": r"\lambda",
    "μ": r"\mu",
    "ξ": r"\xi",
    "ρ": r"\rho",
    "τ": r"\tau",
    "Λ": r"\Lambda",
    "Ψ": r"\Psi",
    "Ω": r"\Omega",
    "Σ": r"\Sigma",
    **{raised: f"^{{{plain}}}" for raised, plain in zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-", strict=True)},
    **{low: f"_{{{plain}}}" for low, plain in zip("₀₁₂₃₄₅₆₇₈₉ᵢⱼₑ", "0123456789ije", strict=True)},
}
_ACCENTS: Final = {"\u0302": "hat", "\u0304": "bar"}  # combining ones, as in an estimate
_ACCENTED = re.compile("[A-Za-zα-ωΑ-Ω][\u0302\u0304]|.", re.DOTALL)
_LATIN = 0x180  # letters below are set by every engine
_LONG_WORD = 14  # letters; longer ones may be broken, first of all after punctuation
_PIECES = re.compile(r"[^/_.,;:@-]{1,12}[/_.,;:@-]?|.")


def latex_fragments(certificate: Certificate, *, lambdas: Mapping[str, Matrix] | None = None) -> dict[str, bytes]:
    r"""The fragments by file name, with references.bib and a main.tex that inputs all of them.

    ``lambdas``: mode -> Lambda(J) at the target, printed up to 12 x 12.  The same arguments give the same bytes.
    """
    view = common_view(certificate, analysis=None, trajectory=None, lambdas=lambdas)
    parts: dict[str, tuple[str, Iterable[str]]] = {
        "verdict.tex": ("The verdict and what it says.", _verdict(view)),
        "model.tex": ("The equations with the paper's numbers, couplings, target and pins.", _model(view)),
        "condition.tex": ("The condition that is decided.", _condition(view)),
        "matrices.tex": ("The matrices; entries with a decimal point are rounded.", _matrices(view)),
        "checks.tex": ("Every condition that was decided; numbers hold as printed.", _checks(view)),
        "regions.tex": ("From which starts consensus is proved.", _regions(view)),
        "traceability.tex": ("Where each condition stands and which module decided it.", _traces(view)),
    }
    files = {name: _fragment(what, list(lines)) for name, (what, lines) in parts.items()}
    kept = {name: text for name, text in files.items() if text is not None}
    kept[BIBLIOGRAPHY] = bibliography(certificate.claims.version)
    kept[MAIN] = _main(view["problem"].name, [name for name in kept if name.endswith(".tex")])
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


def _fragment(what: str, lines: Sequence[str]) -> str | None:
    if not lines:
        return None
    return _HEAD.format(packages=",".join(PACKAGES), what=what) + "\n".join(lines) + "\n"


def _main(name: str, fragments: Sequence[str]) -> str:
    inputs = "\n".join(rf"\input{{{each.removesuffix('.tex')}}}" for each in fragments)
    return (
        "\\documentclass[a4paper]{article}\n\\usepackage[T1]{fontenc}\n\\usepackage[margin=22mm]{geometry}\n"
        f"\\usepackage{{{','.join(PACKAGES)}}}\n\\usepackage{{textcomp}}\n\\title{{{tex(name)}}}\\author{{}}\\date{{}}\n"
        f"\\begin{{document}}\n\\maketitle\n{inputs}\n"
        f"\\nocite{{*}}\n\\bibliographystyle{{plain}}\n\\bibliography{{{BIBLIOGRAPHY.removesuffix('.bib')}}}\n"
        "\\end{document}\n"
    )


def _verdict(view: Mapping[str, Any]) -> Iterator[str]:
    yield rf"\paragraph{{{tex(view['problem'].name)}: {tex(view['verdict'])}.}} {tex(view['claims'].reason)}"
    yield ""
    yield from _table(["", ""], [[name, value] for name, value in (*view["facts"], *view["title_block"])], [0.26, 0.68])
    for head, sentences in (("It says:", view["says"]), ("It does not say:", view["says_not"])):
        yield from _list(head, sentences)


def _model(view: Mapping[str, Any]) -> Iterator[str]:
    problem = view["problem"]
    yield tex(" ".join(filter(None, [view["size"], view["pins"], view["region"], view["switching"]])))
    for _, latex, number in view["loop"]:
        yield rf"\[ {latex} \tag{{{number.strip('()')}}} \]"
    yield _displayed(formulas.coupling_latex(problem.coupling))
    yield _displayed(formulas.target_latex(problem))
    yield tex(f"Here {view['letters']}")
    for head, sentences in (
        ("Each agent has the A, C and W of its group:", view["groups"]),
        ("Arcs with a coupling of their own:", view["exceptions"]),
    ):
        if sentences:
            yield from _list(head, sentences)


def _list(head: str, sentences: Iterable[str]) -> Iterator[str]:
    yield rf"{head}\begin{{itemize}}"
    yield from (rf"  \item {tex(each)}" for each in sentences)
    yield r"\end{itemize}"


def _condition(view: Mapping[str, Any]) -> Iterator[str]:
    if view["problem"].groups:
        yield rf"\[ {formulas.PSI} \tag{{18}} \]"
        yield from map(_displayed, (formulas.LAMBDA, formulas.OMEGA, formulas.REDUCED, formulas.BY_EXISTENCE))
        yield tex(view["by_group"])
    else:
        yield _displayed(formulas.LAMBDA + " < 0")
    for name, bound in view["bounds"].items():
        yield f"For {tex(name)}:"
        yield _displayed(rf"\lambda_{{\max}}(\Lambda) < {latex_number(bound)}")


def _matrices(view: Mapping[str, Any]) -> Iterator[str]:
    shown = [(capitalize_first(item.what), item) for item in view["matrices"]]
    shown += [(f"At the target, mode {item.what}", item) for item in view["lambdas"]]
    if shown:
        yield r"\setcounter{MaxMatrixCols}{12}"
    for what, item in shown:
        if item.latex is None:
            yield rf"{tex(what)} (${item.name}$) is {tex(item.size)}; see certificate.json."
        else:
            yield f"{tex(what)}:"
            yield _displayed(f"{item.name} = {item.latex}")


def _checks(view: Mapping[str, Any]) -> Iterator[str]:
    heads = ["verdict", "condition", "where", "margin", "rate", "reason"]
    yield from _table(heads, [_check_cells(row) for row in view["checks"]], [0.11, 0.16, 0.14, 0.08, 0.08, 0.33])
    if view["checks_hidden"]:
        yield tex(view["checks_hidden"])


def _check_cells(row: CheckRow) -> list[str]:
    name = row.name + ("" if row.mode is None else f", mode {row.mode}")
    name += "" if row.group is None else f", group of agent {row.group}"
    exact = " ".join(f"{key}: {value}." for key, value in row.exact)
    return [
        f"{row.symbol} {row.verdict}",
        name,
        row.domain,
        typeset(row.margin),
        typeset(row.rate),
        f"{row.reason} {exact}",
    ]


def _regions(view: Mapping[str, Any]) -> Iterator[str]:
    regions = view["regions"]
    if regions is None:
        return
    yield tex(regions["asked"])
    yield ""
    rows = [
        [row.name, f"{row.symbol} {row.verdict}", row.starts, row.rate, row.time, row.covers] for row in regions["rows"]
    ]
    heads = ["method", "verdict", "certified starts", "rate in 1/s", regions["time_head"], "covers it"]
    yield from _table(heads, rows, [0.17, 0.12, 0.26, 0.1, 0.13, 0.09])


def _traces(view: Mapping[str, Any]) -> Iterator[str]:
    yield from _table(view["trace_heads"], [row.cells for row in view["traces"]], [0.16, 0.24, 0.14, 0.16, 0.12, 0.08])


def _displayed(latex: str) -> str:
    return rf"\[ \dobcfit{{{latex}}} \]"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[float]) -> Iterator[str]:
    """A table over several pages; ``widths`` are parts of the line."""
    columns = " ".join(rf">{{\raggedright\arraybackslash}}p{{{width}\linewidth}}" for width in widths)
    yield rf"{{\footnotesize\setlength{{\tabcolsep}}{{3pt}}\begin{{longtable}}{{@{{}}{columns}@{{}}}}"
    if any(heads):
        yield r"\toprule"
        yield rf"{' & '.join(map(tex, heads))} \\ \midrule\endhead"
    else:
        yield r"\toprule"
    yield from (rf"{' & '.join(map(tex, row))} \\" for row in rows)
    yield r"\bottomrule\end{longtable}}"
