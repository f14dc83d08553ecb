"""The Markdown text: every check, formulas, and names that cannot break out of their place."""

import dataclasses
import re
from typing import Any

import pytest
from reports import markdown_report

from dobc_design.conditions.check import Fix
from dobc_design.report.pages import escape


def test_rows_of_a_table_have_as_many_cells_as_its_head(everything: dict[str, Any]):
    width = None
    for line in markdown_report(**everything).splitlines():
        if not line.startswith("|"):
            width = None
            continue
        cells = len(re.findall(r"(?<!\\)\|", line)) - 1
        assert width in (None, cells), line
        width = cells


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("- x", "\\- x"),
        ("12. x", "12\\. x"),
        ("-9/8", "-9/8"),
        ("0.5 s", "0.5 s"),
        ("a\nb", "a b"),
        ("\\|", "\\\\\\|"),
    ],
)
def test_escape(text: str, escaped: str):
    assert escape(text) == escaped


def test_the_main_cure_stands_above_the_table_and_cannot_break_out_of_its_place(
    certificate_of, certificate
):
    fix = Fix(
        kind="x", set={"pinning.gains": {"a\nb": 1}, "<b>\n# x": None}, text="Pin <b>agent</b> 3."
    )
    checks = tuple(dataclasses.replace(check, fix=fix) for check in certificate.checks)
    text = markdown_report(certificate_of(checks=checks))
    section = text[text.index("## Optional") : text.index("## Checks")]
    assert "Pin \\<b\\>agent\\</b\\> 3." in section
    lines = section.splitlines()
    assert '    gains = { "a\\nb" = 1 }' in lines
    assert "    # remove <b> # x" in lines
    assert not any(line.startswith("# ") for line in lines)
