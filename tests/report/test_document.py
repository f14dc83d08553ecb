"""A block is stated once: every form shows it, but for those that it leaves out."""

import re
from fractions import Fraction

import pytest
from reports import Page

from dobc_design.exact.matrix import matrix
from dobc_design.report.document import (
    Beside,
    Block,
    Box,
    Cell,
    Column,
    Document,
    Facts,
    List,
    Mark,
    Math,
    Matrices,
    Name,
    Only,
    Reason,
    Section,
    ShownMatrix,
    Table,
    Terms,
    Text,
    table_of,
)
from dobc_design.report.latex import latex_fragments
from dobc_design.report.pages import html_page, markdown_page
from dobc_design.report.pdf import content

BLOCKS = {
    "text": Text(("kept ", Math("word", r"\text{word}"))),
    "list": List(("kept word",)),
    "matrix": Matrices((ShownMatrix("A", "kept word", matrix([[Fraction(1, 2)]])),)),
    "section": Section("kept word", (List(("x",)),)),
    "beside": Beside(((Text("kept"),), (Text("word"),))),
}


def forms(*blocks: Block) -> dict[str, str]:
    """The blocks in a section that has a LaTeX fragment of its own, in every form."""
    made = Document(
        kind="k",
        name="n",
        title="t",
        verdict=Box(mark=Mark("✓", "proved"), word="Proved", reason="r"),
        identity=(),
        footer="f",
        blocks=(Section("Checks", blocks, "checks"),),
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
        return table_of("c", ["a"], Column("head"), *more)

    assert all("added" not in text for text in forms(table()).values())
    everywhere = forms(table(Column("added", lambda row: f"cell {row}")))
    assert all("added" in text and "cell a" in text for text in everywhere.values())
    printed = forms(table(Column("added", lambda row: f"cell {row}", only=("pdf",))))
    assert {form for form, text in printed.items() if "added" in text or "cell" in text} == {"pdf"}


@pytest.mark.parametrize("name", ["text", "list", "section", "beside"])
def test_every_form_shows_every_block_and_only_says_which_do(name: str):
    for text in forms(BLOCKS[name]).values():
        assert "kept" in text and "word" in text
    hidden = forms(Text("other"), Only(("markdown", "latex"), (BLOCKS[name],)))
    assert {form for form, text in hidden.items() if "kept" in text} == {"markdown", "latex"}


def test_a_section_that_a_form_leaves_empty_is_not_there():
    found = forms(Section("nested", (Only(("html",), (Text("inside"),)),)))
    assert {form for form, text in found.items() if "nested" in text} == {"html"}


@pytest.mark.parametrize("text", ["<b>", "a|b", "#x", "$1$", "a_b", "\\end{document}"])
def test_text_is_escaped_in_every_place_of_every_form(text: str):
    cells: list[Cell] = [text, Name((text, text), id=text), Mark("?", "undecided")]
    reason = Reason(text=text, details=((text, text),), cure=text, lines=(text,))
    columns = tuple(Column(text) for _ in range(4))
    table = Table(caption=text, columns=columns, rows=((*cells, reason),))
    blocks = (
        Text(text),
        List((text,)),
        Terms(((text, text),)),
        Facts(((text, text),)),
        table,
    )
    found = forms(*blocks, Section(text, blocks))
    assert found["html"].count(text) >= 20
    assert "\\end{document}" not in found["latex"]
    assert not re.search(r"(?<!\\)" + re.escape(text.lstrip("ab")), found["markdown"])
