"""The PDF: user text stays text, numbers stay exact, nothing leaves the page, the same input gives
the same bytes."""

import json
import re
import sys
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from reports import HOSTILE, POPPLER, pdf_content, texts

from dobc_design import Certificate, Exosystem, Group, Network, Observer, Problem, certify
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, matrix
from dobc_design.report import content as of_report
from dobc_design.report.content import report_document
from dobc_design.report.document import Picture
from dobc_design.report.findings import Findings
from dobc_design.report.pdf import compile_pdf, number_parts, pdf_page, picture_parts, soft

needs_typst = pytest.mark.skipif(
    find_spec("typst") is None, reason="needs the extra `pdf`: pip install 'dobc_design[pdf]'"
)
needs_poppler = pytest.mark.skipif(POPPLER is None, reason="needs pdftotext (poppler-utils)")
SAID = ("Traceability", "Signatures", "Approved by", "0.2618 1/s", "0.5822", "9.9.9", "dobc verify")
MARGIN = 14 * 72 / 25.4  # pt; the page has 18 mm


def squeezed(text: str) -> str:
    """Without white space and places to break."""
    return re.sub(r"[\s\u200b]", "", text)


def content(*blocks: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """What reaches the template of a document with these blocks."""
    whole: dict[str, Any] = {"title": "t", "name": "n", "footer": "f"}
    whole |= {"verdict": "proved", "word": "Proved", "reason": "r"}
    identity = [["Problem", "n"]]
    facts = [["Agents", "1"]]
    whole |= {"identity": identity, "facts": facts, "blocks": list(blocks)}
    return whole | changes


def printed(shown: dict[str, Any], *, full: bool = False) -> bytes:
    """The PDF of a report."""
    return pdf_page(report_document(Findings(**shown)), full=full)


@needs_typst
@needs_poppler
def test_text_of_the_user_is_shown_as_it_is_and_never_read_as_markup(tmp_path: Path):
    items = list(HOSTILE[:5])
    rows = [[[each], [each]] for each in items]
    listed = {"kind": "list", "items": items}
    code = {"kind": "code", "lines": items}
    table = {"kind": "table", "heads": items[:2], "rows": rows, "widths": [0, 1]}
    blocks: list[dict[str, Any]] = [listed, code, table]
    blocks += [{"kind": "heading", "level": 1, "text": each} for each in items]
    whole = " ".join(items)
    document = content(*blocks, name=whole, reason=whole, footer=whole[:60])
    page = compile_pdf(document)
    text = squeezed(texts(page, tmp_path))
    for each in items:
        assert text.count(squeezed(each)) >= 6, each


@needs_typst
@pytest.mark.parametrize(
    "text", ["時計 🕰 \ufffd", "private \ue000 \U0010fffd", "\u202eright to left", "\ufffe"]
)
def test_letters_that_fonts_or_the_standard_do_not_have_do_not_stop_it(text: str):
    paragraph = {"kind": "text", "text": text, "style": "plain"}
    made = compile_pdf(content(paragraph, name=text, title=text))
    assert made.startswith(b"%PDF")


@needs_typst
def test_it_is_tagged_for_assistive_technology():
    """PDF/UA-1 (ISO 14289): tags, language and a title; Typst refuses a figure or formula without
    words."""
    formula = {"kind": "formula", "name": "psi", "label": "", "number": "(18)"}
    made = compile_pdf(content(formula))
    assert b"/MarkInfo" in made
    assert b"pdfuaid:part>1<" in made


@needs_typst
def test_the_same_content_gives_the_same_bytes_without_a_date():
    one = content({"kind": "text", "text": "hello", "style": "plain"})
    assert compile_pdf(one) == compile_pdf(one)
    assert b"CreationDate" not in compile_pdf(one)


@pytest.mark.parametrize(
    ("value", "negative", "digits", "over", "power"),
    [
        (Fraction(16, 5), False, "3.2", None, None),
        (Fraction(16, 7), False, "16", "7", None),
        (Fraction(-2), True, "2", None, None),
        (Fraction(0), False, "0", None, None),
        (Fraction(-1, 10**8), True, "1", None, "-8"),
        (Fraction(1, 3 * 10**20), False, "3.33333", None, "-21"),
        (Fraction(-(10**30) - 1, 7), True, "1.42857", None, "29"),
    ],
)
def test_numbers(value: Fraction, negative: bool, digits: str, over: str | None, power: str | None):
    expected = {"negative": negative, "digits": digits, "over": over, "power": power}
    assert number_parts(value) == expected


def test_long_words_may_be_broken_and_lose_no_letter():
    word = "verify/separable_observer.py" + "x" * 70
    broken = soft(f"short words stay\n{word}\x00")
    assert broken.startswith("short words stay ")
    assert max(map(len, re.split("[\u200b ]", broken))) <= 16
    assert broken.replace("\u200b", "") == f"short words stay {word}\ufffd"


def test_a_figure_keeps_its_colours_and_gets_its_alternative():
    draw = lambda ax: ax.plot([1, 2], color="#0072b2")  # noqa: E731
    picture = Picture(name="one", title="t", caption="", alt="A <b>", draw=draw)
    parts = picture_parts(picture)
    assert "#0072b2" in parts["svg"]
    assert "var(" not in parts["svg"]
    assert parts["alt"] == "A <b>"
    assert parts["width"] == "331.2"


def test_every_equation_of_the_loop_has_its_formula():
    template = (Path(of_report.__file__).parent / "templates" / "report.typ").read_text("utf-8")
    loops = of_report.words.TEXTS["loop"]
    for name, _, _ in loops["plain"]:
        assert f'"{name}": (' in template
    for name, _, _ in loops["disturbed"]:
        assert f'"{name}, disturbed": (' in template


def test_without_typst_the_message_names_the_extra(certificate, monkeypatch):
    monkeypatch.setitem(sys.modules, "typst", None)
    with pytest.raises(SpecError, match=r"dobc_design\[pdf\]"):
        printed({"certificate": certificate})


@needs_typst
@needs_poppler
@pytest.mark.slow
@pytest.mark.parametrize("which", ["everything", "wide", "asked_for"])
def test_pages_are_a4_and_nothing_is_cut_off(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
):
    boxes = texts(printed(request.getfixturevalue(which)), tmp_path, "-bbox")
    pages = re.findall(r'<page width="([\d.]+)" height="([\d.]+)">', boxes)
    assert len(pages) >= 3
    for width, height in pages:
        rounded_width = round(float(width))
        size = (rounded_width, round(float(height)))
        assert size == (595, 842)
    words = re.findall(r'<word xMin="(-?[\d.]+)" .*?xMax="([\d.]+)" .*?>(.*?)</word>', boxes)
    assert len(words) > 500
    for left, right, word in words:
        assert float(left) >= MARGIN, word
        assert float(right) <= 595.3 - MARGIN, word


@needs_typst
@needs_poppler
@pytest.mark.slow
def test_the_full_pdf_says_what_the_page_says(everything: dict[str, Any], tmp_path: Path):
    text = squeezed(texts(printed(everything, full=True), tmp_path))
    for check in everything["certificate"].checks:
        assert squeezed(of_report.words.sentence(check.reason)) in text
    for words in SAID:
        assert squeezed(words) in text
    assert "0.5823" not in text  # cut towards the weaker claim


def blocks_of(certificate: Certificate) -> list[dict[str, Any]]:
    """The blocks of a report as they reach the template, in JSON."""
    shown = json.loads(json.dumps(pdf_content(certificate)))
    blocks: list[dict[str, Any]] = shown["blocks"]
    return blocks


def matrix_of(blocks: list[dict[str, Any]], name: str) -> Matrix:
    """A matrix as the template gets it."""
    rows = next(block["rows"] for block in blocks if block.get("name") == name)
    return matrix([[("-" if x["negative"] else "") + x["digits"] for x in row] for row in rows])


def test_matrices_reach_the_template(certificate):
    blocks = blocks_of(certificate)
    P = [[3, "-1/4"], ["-1/4", 2]]
    assert matrix_of(blocks, "P") == matrix(P)
    assert matrix_of(blocks, "W") == matrix([["16/5"], ["12/5"]])
    off_diagonal_row = matrix_of(blocks, "P given")[1]
    assert off_diagonal_row == (Fraction(-1, 4), Fraction("0.33333"))


def test_agents_with_different_exosystems_get_the_condition_with_a_disturbance():
    groups = []
    for i in (1, 2):
        exosystem = Exosystem(A=[[-i]], C=[[1]])
        observer = Observer(W=[[1]])
        group = Group(agents=[i], exosystem=exosystem, observer=observer)
        groups.append(group)
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    problem = Problem(network=network, coupling="y", gains=1, groups=groups)
    certificate = certify(problem)
    assert "psi" in [block.get("name") for block in blocks_of(certificate)]
