"""The Markdown text: every check, formulas, and names that cannot break out of their place."""

import dataclasses
import re
from typing import Any

import pytest
from certified import certified
from reports import markdown_report

from dobc_design.conditions.check import Fix
from dobc_design.report.pages import escape
from dobc_design.report.write import render_report
from dobc_design.synthesis import block_lmi


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


@pytest.mark.slow
def test_on_request_a_solver_is_asked_for_the_inequality_as_printed(
    monkeypatch: pytest.MonkeyPatch,
):
    """paper-fixed: n = 10, m = 1, q = 2, so n (m + q) = 30 rows; P has 3 unknowns and Q has 2."""
    certificate = certified("paper-fixed")
    page = render_report(certificate, lmi=True)["report.md"].decode("utf-8")
    assert "1 block of 30 rows in 5 unknowns" in page
    assert "matrices of 10 rows (Λ + I ⊗ S) and 2 (Ω₀)" in page
    assert 'The solver says "optimal": Psi' in page
    monkeypatch.setattr(block_lmi, "MOST_ROWS", 29)
    page = render_report(certificate, lmi=True)["report.md"].decode("utf-8")
    assert "a block would have 30 rows, and solvers take 29" in page
