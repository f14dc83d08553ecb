"""The notebooks run from a clean kernel, use public names only, and are stored without outputs, as
jupytext likes."""

import json
import re
from pathlib import Path

import pytest
from notebook_runs import LONG, NOTEBOOKS, failure_of

each_quickly = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])


def cells(path: Path) -> list[dict[str, object]]:
    return json.loads(path.read_text("utf-8"))["cells"]


def test_there_are_ten_notebooks_in_order():
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{number:02}" for number in range(1, 11)]


@each_quickly
def test_a_notebook_is_stored_without_outputs(path: Path):
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells(path))


@each_quickly
def test_a_notebook_uses_public_names_only(path: Path):
    code = "\n".join("".join(cell["source"]) for cell in cells(path) if cell["cell_type"] == "code")
    assert not re.search(r"dobc_design\.\w", code.replace("import dobc_design as dd", ""))
    assert not re.search(r"from dobc_design|\bdd\._|\.__\w", code)


@each_quickly
def test_a_notebook_opens_with_what_one_learns_and_ends_with_what_to_do_next(path: Path):
    first, *_, last = ("".join(cell["source"]) for cell in cells(path))
    assert first.startswith(f"# {path.stem[:2]} · ") and "\n\nWhat you learn here: " in first
    assert last.startswith("## What to do next\n\n- ")


@pytest.mark.slow
@each_quickly
def test_a_notebook_and_its_script_are_one(path: Path):
    """`jupytext --sync` pairs the two; no cell is lost or joined on the way to a script and
    back."""
    jupytext = pytest.importorskip("jupytext")
    notebook = jupytext.reads(path.read_text("utf-8"), fmt="ipynb")
    assert notebook.metadata["jupytext"]["formats"] == "ipynb,py:percent"
    again = jupytext.reads(jupytext.writes(notebook, fmt="py:percent"), fmt="py:percent")
    parts = [[(cell.cell_type, cell.source) for cell in each.cells] for each in (notebook, again)]
    assert parts[0] == parts[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in NOTEBOOKS if path.stem[:2] not in LONG], ids=lambda path: path.stem
)
def test_a_notebook_runs_from_a_clean_kernel(path: Path):
    """`make evidence` runs the long ones too."""
    assert failure_of(path) == ""
