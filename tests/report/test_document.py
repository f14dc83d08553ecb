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

half = ShownMatrix("A", "kept word", matrix([[Fraction(1, 2)]]))
matrices = Matrices((half,))
beside = Beside(((Text("kept"),), (Text("word"),)))
BLOCKS = {
    "text": Text(("kept ", Math("word", r"\text{word}"))),
    "list": List(("kept word",)),
    "matrix": matrices,
    "section": Section("kept word", (List(("x",)),)),
    "beside": beside,
}


def forms(*blocks: Block) -> dict[str, str]:
    """The blocks in a section that has a LaTeX fragment of its own, in every form."""
    verdict = Box(mark=Mark("✓", "proved"), word="Proved", reason="r")
    sections = (Section("Checks", blocks, "checks"),)
    made = Document(
        kind="k",
        name="n",
        title="t",
        verdict=verdict,
        identity=(),
        footer="f",
        blocks=sections,
    )
    page = Page(html_page(made))
    assert page.wrong == []
    latex = latex_fragments(made, "1").get("checks.tex", b"").decode()
    pdf = str(content(made))
    return {"html": page.text, "markdown": markdown_page(made), "pdf": pdf, "latex": latex}


def test_a_new_column_is_one_line_and_stands_in_every_form_that_shows_it():
    def table(*more):
        return table_of("c", ["a"], Column("head"), *more)

    for text in forms(table()).values():
        assert "added" not in text
    everywhere = forms(table(Column("added", lambda row: f"cell {row}")))
    assert all("added" in text and "cell a" in text for text in everywhere.values())
    column = Column("added", lambda row: f"cell {row}", only=("pdf",))
    printed = forms(table(column))
    told = {form for form, text in printed.items() if "added" in text or "cell" in text}
    assert told == {"pdf"}


@pytest.mark.parametrize("name", ["text", "list", "section", "beside"])
def test_every_form_shows_every_block_and_only_says_which_do(name: str):
    for text in forms(BLOCKS[name]).values():
        assert "kept" in text and "word" in text
    only = Only(("markdown", "latex"), (BLOCKS[name],))
    hidden = forms(Text("other"), only)
    told_in = {form for form, text in hidden.items() if "kept" in text}
    assert told_in == {"markdown", "latex"}


def test_a_section_that_a_form_leaves_empty_is_not_there():
    inner = Only(("html",), (Text("inside"),))
    found = forms(Section("nested", (inner,)))
    nested = {form for form, text in found.items() if "nested" in text}
    assert nested == {"html"}


@pytest.mark.parametrize("text", ["<b>", "a|b", "#x", "$1$", "a_b", "\\end{document}"])
def test_text_is_escaped_in_every_place_of_every_form(text: str):
    name = Name((text, text), id=text)
    cells: list[Cell] = [text, name, Mark("?", "undecided")]
    details = ((text, text),)
    reason = Reason(text=text, details=details, cure=text, lines=(text,))
    columns = tuple(Column(text) for _ in range(4))
    rows = ((*cells, reason),)
    table = Table(caption=text, columns=columns, rows=rows)
    items = List((text,))
    terms = Terms(((text, text),))
    facts = Facts(((text, text),))
    blocks = (Text(text), items, terms, facts, table)
    found = forms(*blocks, Section(text, blocks))
    assert found["html"].count(text) >= 20
    assert "\\end{document}" not in found["latex"]
    unescaped = r"(?<!\\)" + re.escape(text.lstrip("ab"))
    assert not re.search(unescaped, found["markdown"])
