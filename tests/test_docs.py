"""The notes of record name things that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def named_paths() -> list[tuple[str, str]]:
    """(column, path) of every path that stands in a row of the paper map."""
    found = []
    for line in (ROOT / "docs/paper-map.md").read_text("utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) < 6 or cells[1] in ("equation", "") or set(cells[1]) <= {"-"}:
            continue
        for column, cell in (("dobc_design", cells[3]), ("tests", cells[4])):
            found += [(column, path) for path in re.findall(r"`([^`]+)`", cell)]
    return found


@pytest.mark.parametrize(("column", "path"), named_paths())
def test_a_module_or_test_of_the_paper_map_exists(column: str, path: str):
    assert (ROOT / column / path).exists()


def test_the_paper_map_has_rows():
    assert len(named_paths()) > 60


@pytest.mark.parametrize("name", ["README.md", *(f"docs/{p.name}" for p in sorted((ROOT / "docs").glob("*.md")))])
def test_links_inside_the_project_lead_somewhere(name: str):
    page = ROOT / name
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_every_module_of_a_room_is_named_in_the_architecture():
    text = (ROOT / "docs/architecture.md").read_text("utf-8")
    modules = [path for path in (ROOT / "dobc_design").rglob("*.py") if path.name != "__init__.py"]
    assert [path.name for path in modules if f"`{path.name}`" not in text and f"`{path.stem}`" not in text] == []
