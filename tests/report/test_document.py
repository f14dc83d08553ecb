"""A block is stated once: every form shows it, but for those that it leaves out."""

import re
from fractions import Fraction

import pytest
from reports import Page

from dobc_design.exact.matrix import matrix
from dobc_design.report import document as doc
from dobc_design.report.latex import latex_fragments
from dobc_design.report.pages import html_page, markdown_page
from dobc_design.report.pdf import content

BLOCKS = {
    "text": doc.Text(("kept ", doc.Math("word", r"\text{word}"))),
    "list": doc.List(("kept word",)),
    "matrix": doc.Matrices((doc.ShownMatrix("A", "kept word", matrix([[Fraction(1, 2)]])),)),
    "section": doc.Section("kept word", (doc.List(("x",)),)),
    "beside": doc.Beside(((doc.Text("kept"),), (doc.Text("word"),))),
}


def forms(*blocks: doc.Block) -> dict[str, str]:
    """The blocks in a section that has a LaTeX fragment of its own, in every form."""
    made = doc.Document(
        kind="k",
        name="n",
        title="t",
        verdict=doc.Box(mark=doc.Mark("✓", "proved"), word="Proved", reason="r"),
        identity=(),
        footer="f",
        blocks=(doc.Section("Checks", blocks, "checks"),),
    )
    page = Page(html_page(made))
    assert page.wrong == []
    latex = latex_fragments(made, "1").get("checks.tex", b"").decode()
    return {
        "html": page.text,
        "markdown": markdown_page(made),
        "pdf": str(content(made)),
        "latex": latex,
    }


def test_a_new_column_is_one_line_and_stands_in_every_form_that_shows_it():
    def table(*more):
        return doc.table_of("c", ["a"], doc.Column("head"), *more)

    assert all("added" not in text for text in forms(table()).values())
    everywhere = forms(table(doc.Column("added", lambda row: f"cell {row}")))
    assert all("added" in text and "cell a" in text for text in everywhere.values())
    printed = forms(table(doc.Column("added", lambda row: f"cell {row}", only=("pdf",))))
    assert {form for form, text in printed.items() if "added" in text or "cell" in text} == {"pdf"}


@pytest.mark.parametrize("name", ["text", "list", "section", "beside"])
def test_every_form_shows_every_block_and_only_says_which_do(name: str):
    for text in forms(BLOCKS[name]).values():
        assert "kept" in text and "word" in text
    hidden = forms(doc.Text("other"), doc.Only(("markdown", "latex"), (BLOCKS[name],)))
    assert {form for form, text in hidden.items() if "kept" in text} == {"markdown", "latex"}


def test_a_section_that_a_form_leaves_empty_is_not_there():
    found = forms(doc.Section("nested", (doc.Only(("html",), (doc.Text("inside"),)),)))
    assert {form for form, text in found.items() if "nested" in text} == {"html"}


@pytest.mark.parametrize("text", ["<b>", "a|b", "#x", "$1$", "a_b", "\\end{document}"])
def test_text_is_escaped_in_every_place_of_every_form(text: str):
    cells: list[doc.Cell] = [text, doc.Name((text, text), id=text), doc.Mark("?", "undecided")]
    reason = doc.Reason(text=text, details=((text, text),), cure=text, lines=(text,))
    columns = tuple(doc.Column(text) for _ in range(4))
    table = doc.Table(caption=text, columns=columns, rows=((*cells, reason),))
    blocks = (
        doc.Text(text),
        doc.List((text,)),
        doc.Terms(((text, text),)),
        doc.Facts(((text, text),)),
        table,
    )
    found = forms(*blocks, doc.Section(text, blocks))
    assert found["html"].count(text) >= 20
    assert "\\end{document}" not in found["latex"]
    assert not re.search(r"(?<!\\)" + re.escape(text.lstrip("ab")), found["markdown"])
