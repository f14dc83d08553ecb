r"""LaTeX fragments: user text stays text, every brace and environment closes, numbers are those of
the certificate."""

import re
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from reports import HOSTILE, latex_report, pdf_content

from dobc_design import Exosystem, Group, Network
from dobc_design.conditions.reason import Reason
from dobc_design.report.latex import MAIN, PACKAGES, tex

PDFLATEX = shutil.which("pdflatex")


def tokens(text: str) -> list[str]:
    """Control sequences and single letters, without comments."""
    bare = re.sub(r"(?<!\\)%.*", "", text)
    return re.findall(r"\\[A-Za-z]+|\\.|[^\\]", bare, re.DOTALL)


def check_balance(text: str) -> None:
    """Braces, environments and mathematics close in their order; rows of a table have its number of
    columns."""
    open_: list[str] = []
    found = tokens(text)
    following = [*found[1:], ""]
    for token, after in zip(found, following, strict=True):
        if token in ("{", r"\["):
            open_.append(token)
        elif token == "}":
            assert open_.pop() == "{"
        elif token == r"\]":
            assert open_.pop() == r"\["
        elif token == "$" and open_ and open_[-1] == "$":
            open_.pop()
        elif token == "$":
            open_.append("$")
        assert token not in ("#", "&", "^", "_") or open_ or after, token
    assert open_ == []
    begun = [name for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", text)]
    assert len(begun) % 2 == 0
    for body, columns in (
        (part[1], part[0].count("p{"))
        for part in re.findall(
            r"\\begin\{longtable\}\{@\{\}(.*?)@\{\}\}\n(.*?)\\end\{longtable\}", text, re.DOTALL
        )
    ):
        rows = []
        for line in body.splitlines():
            if line.rstrip().endswith((r"\\", r"\endhead")):
                rows.append(line)
        assert rows
        for row in rows:
            assert len(re.findall(r"(?<!\\)&", row)) == columns - 1


@pytest.fixture(scope="module")
def files(everything: dict[str, Any]) -> dict[str, str]:
    return latex_report(everything["certificate"], lambdas=everything["lambdas"])


@pytest.fixture(scope="module")
def hostile_files(problem_with, certificate_of) -> dict[str, str]:
    labels = [f"{text[:40]}{i}".replace("\n", " ") for i, text in enumerate(HOSTILE)]
    agents = range(len(labels))
    arcs = [(labels[i], labels[i - 1]) for i in agents]
    clean = []
    for i, label in enumerate(labels):
        clean.append(label if label.isprintable() else f"agent {i}")
    names = dict(zip(labels, clean, strict=True))
    network = Network.from_arcs(
        {"mode_1 & {2}": [(names[a], names[b]) for a, b in arcs]}, arrow="listens_to"
    )
    gains = {clean[0]: 1}
    problem = problem_with(name=r"\input{x} 100% & _", network=network, gains=gains)
    why = Reason(head=" ".join(HOSTILE))
    changes = {"gain_source": "\\input{x} {", "version": "9}%"}
    return latex_report(certificate_of(problem, why=why, **changes))


def test_every_brace_environment_and_table_row_closes(
    files: dict[str, str], hostile_files: dict[str, str]
):
    for found in (files, hostile_files):
        assert {
            "verdict.tex",
            "model.tex",
            "condition.tex",
            "matrices.tex",
            "checks.tex",
            "main.tex",
        } <= set(found)
        for name, text in found.items():
            if name.endswith(".tex"):
                check_balance(text)


def test_no_command_comes_from_what_a_user_wrote(
    files: dict[str, str], hostile_files: dict[str, str]
):
    own = set()
    for text in files.values():
        for word in re.findall(r"\\[A-Za-z]+", text):
            own.add(word)
    escaped = (
        r"\textbackslash \textasciicircum \textasciitilde \textbar \textquotedbl \allowbreak "
        r"\dobcunicode"
    )
    escapes = {
        *escaped.split(),
        r"\ensuremath",
        r"\texttt",
        r"\infty",
        r"\lambda",
        r"\checkmark",
        r"\le",
    }
    for name, text in hostile_files.items():
        assert set(re.findall(r"\\[A-Za-z]+", text)) <= own | escapes, name
        inputs = re.findall(r"\\input\{[^}]*\}", text)
        assert inputs == ([] if name != MAIN else re.findall(r"\\input\{\w+\}", text))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("50 % of $x_1$", r"50 \% of \$x\_1\$"),
        (r"\end{document}", r"\textbackslash{}end\{document\}"),
        (
            "λ ≤ −1·10⁻⁸",
            r"\ensuremath{\lambda} \ensuremath{\le} "
            r"\ensuremath{-}1\ensuremath{\cdot}10\ensuremath{^{-}}\ensuremath{^{8}}",
        ),
        ("é\u202e\n\tb", r"é\texttt{U+202E} b"),
        ("時", r"\dobcunicode{6642}{時}"),
        ("ξ\u0302ᵢ e\u0302", r"\ensuremath{\hat{\xi}}\ensuremath{_{i}} \ensuremath{\hat{e}}"),
        ("verify/observer.py", r"verify/\allowbreak{}observer.\allowbreak{}py"),
        ("", ""),
    ],
)
def test_text_is_escaped_letter_by_letter(text: str, shown: str):
    assert tex(text) == shown


def test_matrices_are_those_of_the_certificate(certificate, files: dict[str, str]):
    entries = re.search(r"\{W = \\begin\{pmatrix\} (.*?) \\end\{pmatrix\}", files["matrices.tex"])[
        1
    ]
    numbers = [Fraction(row) for row in entries.split(r" \\ ")]
    W = [row[0] for row in certificate.claims.W]
    assert numbers == W == [Fraction(16, 5), Fraction(12, 5)]
    assert r"\setcounter{MaxMatrixCols}{12}" in files["matrices.tex"]
    assert r"\tag{18}" in files["condition.tex"]
    assert r"\lambda_{\max}(\Lambda) < -1.125" in files["condition.tex"]


def test_groups_of_agents_are_told_in_latex_and_in_the_pdf(problem_with, certificate_of):
    exosystem = Exosystem(A=[[0]], C=[[1]])
    groups = [Group(agents=[1, 2], exosystem=exosystem)]
    certificate = certificate_of(problem_with(groups=groups, observer=None), checks=())
    for text in (latex_report(certificate)["model.tex"], str(pdf_content(certificate))):
        assert "Each agent has the A, C and W of its group:" in text
        assert "group of agent 3" in text


def test_the_bibliography_guesses_nothing_about_the_paper(
    files: dict[str, str], hostile_files: dict[str, str]
):
    entries = re.split(r"\n(?=@)", files["references.bib"])
    paper = next(each for each in entries if each.startswith("@misc{consensus-dobc"))
    assert "author" not in re.findall(r"^  (\w+) *=", paper, re.MULTILINE)
    assert not re.search(r"^  (year|journal) ", paper, re.MULTILINE)
    for text in (files["references.bib"], hostile_files["references.bib"]):
        assert text.count("{") == text.count("}")
        assert len(re.findall(r"^@", text, re.MULTILINE)) == 3
    assert "Version 9.9.9" in files["references.bib"]
    assert "Version 9\n" in hostile_files["references.bib"].replace("}", "\n")


def test_the_same_certificate_gives_the_same_bytes_and_main_names_every_fragment(
    certificate, files: dict[str, str]
):
    assert latex_report(certificate) == latex_report(certificate)
    wanted = set()
    for name in files:
        if name.endswith(".tex") and name != MAIN:
            wanted.add(name.removesuffix(".tex"))
    assert set(re.findall(r"\\input\{(\w+)\}", files[MAIN])) == wanted
    assert f"\\usepackage{{{PACKAGES}}}" in files[MAIN]


@pytest.mark.slow
@pytest.mark.skipif(PDFLATEX is None, reason="needs pdflatex (texlive-latex-recommended)")
@pytest.mark.parametrize("which", ["files", "hostile_files"])
def test_pdflatex_compiles_all_fragments(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
):
    for name, text in request.getfixturevalue(which).items():
        (tmp_path / name).write_text(text, "utf-8")
    command = [
        str(PDFLATEX),
        "-interaction=nonstopmode",
        "-halt-on-error",
        "-no-shell-escape",
        MAIN,
    ]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "main.pdf").read_bytes().startswith(b"%PDF")
    log = (tmp_path / "main.log").read_text("utf-8", errors="replace")
    # no margin holds everything one can type
    assert which == "hostile_files" or "Overfull \\hbox" not in log
