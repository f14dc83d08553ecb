"""The Markdown text: every check, formulas, and names that cannot break out of their place."""

import dataclasses
import re
from typing import Any

import pytest
from shown import markdown_report

from dobc_design.conditions.check import Fix
from dobc_design.problem.network import Network
from dobc_design.report.pages import escape


def test_every_check_stands_in_the_table(everything: dict[str, Any]):
    text = markdown_report(**everything)
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    for check in everything["certificate"].checks:
        assert any(f"| {check.id} |" in row for row in rows)
    assert r"\begin{pmatrix} 0 & 2 \\ -2 & 0 \end{pmatrix}" in text
    assert "dobc verify certificate.json --problem problem.json" in text
    assert "# ring" in text


def test_rows_of_a_table_have_as_many_cells_as_its_head(everything: dict[str, Any]):
    width = None
    for line in markdown_report(**everything).splitlines():
        if not line.startswith("|"):
            width = None
            continue
        cells = len(re.findall(r"(?<!\\)\|", line)) - 1
        assert width in (None, cells), line
        width = cells


def test_hostile_names_are_escaped(problem_with, certificate_of):
    labels = ["<script>", "a|b", "[x](y)", "$1$", "`c`"]
    network = Network.from_arcs([(labels[0], labels[1])], arrow="listens_to", agents=labels)
    problem = problem_with(network=network, gains={labels[2]: 1}, name="# <b>x</b>")
    text = markdown_report(certificate_of(problem))
    assert not re.search(r"(?<!\\)<(?!br>)(?=\w|/)", text)
    for label in ("\\<script\\>", "a\\|b", "\\[x\\](y)", "\\$1\\$", "\\`c\\`"):
        assert label in text


@pytest.mark.parametrize(
    ("text", "escaped"),
    [("- x", "\\- x"), ("12. x", "12\\. x"), ("-9/8", "-9/8"), ("0.5 s", "0.5 s"), ("a\nb", "a b"), ("\\|", "\\\\\\|")],
)
def test_escape(text: str, escaped: str):
    assert escape(text) == escaped


def test_the_main_cure_stands_above_the_table_and_cannot_break_out_of_its_place(certificate_of, certificate):
    fix = Fix(kind="x", set={"pinning.gains": {"a\nb": 1}, "<b>\n# x": None}, text="Pin <b>agent</b> 3.")
    checks = tuple(dataclasses.replace(check, fix=fix) for check in certificate.checks)
    text = markdown_report(certificate_of(checks=checks))
    section = text[text.index("## Optional") : text.index("## Checks")]
    assert "Pin \\<b\\>agent\\</b\\> 3." in section
    lines = section.splitlines()
    assert '    gains = { "a\\nb" = 1 }' in lines
    assert "    # remove <b> # x" in lines
    assert not any(line.startswith("# ") for line in lines)
