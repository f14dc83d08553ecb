"""The notebooks run from a clean kernel, use public names only, and are stored without outputs, as
jupytext likes."""

import json
import re
from pathlib import Path

import pytest
from executed import NOTEBOOKS, failure_of, kept, run_missing
from widgets import STATE, VIEW, stilled

each_quickly = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem[:2])


def cells(path: Path) -> list[dict[str, object]]:
    return json.loads(path.read_text("utf-8"))["cells"]


def test_there_are_fourteen_notebooks_in_order():
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{number:02}" for number in range(1, 15)]


@each_quickly
def test_a_notebook_is_stored_without_outputs(path: Path):
    for cell in cells(path):
        assert not cell.get("outputs")
        assert not cell.get("execution_count")


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
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_a_clean_kernel(path: Path):
    """`make docs` takes what is kept here and does not run it again."""
    if "dd.Designer" in path.read_text("utf-8"):
        pytest.importorskip("anywidget", reason="needs the extra `notebook`")
    assert failure_of(path) == ""
    assert kept(path).is_file()


def written(folder: Path, name: str, code: str) -> Path:
    """A notebook of one cell."""
    cell = {"cell_type": "code", "execution_count": None, "id": "one", "metadata": {}}
    cell |= {"outputs": [], "source": code}
    path = folder / f"{name}.ipynb"
    document = {"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    path.write_text(json.dumps(document), "utf-8")
    return path


def test_a_run_is_kept_for_one_text_of_a_notebook(tmp_path: Path):
    before = kept(written(tmp_path, "sum", "1 + 1"))
    assert kept(written(tmp_path, "sum", "1 + 1")) == before
    assert kept(written(tmp_path, "sum", "1 + 2")) != before


@pytest.mark.slow
def test_what_is_kept_is_not_run_again_and_a_failure_is_told_and_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("executed.KEPT", tmp_path / "kept")
    good = written(tmp_path, "good", "print(6 * 7)")
    began, line = run_missing([good])
    assert began.startswith("notebooks: 1 to run")
    assert line.startswith("notebooks: 1 of 1, good.ipynb ran")
    assert cells(kept(good))[0]["outputs"][0]["text"] == ["42\n"]
    assert list(run_missing([good])) == []
    bad = written(tmp_path, "bad", "1 / 0")
    with pytest.raises(RuntimeError, match=r"bad\.ipynb: [\s\S]*ZeroDivisionError"):
        list(run_missing([good, bad]))
    assert not kept(bad).exists()


def test_a_widget_becomes_a_drawing_that_loads_nothing():
    state = {"_esm": "export default { render };", "_css": ".a {}", "text": "</script>"}
    shown = {"output_type": "display_data", "metadata": {}, "data": {VIEW: {"model_id": "m"}}}
    notebook = {
        "cells": [{"cell_type": "code", "source": "designer", "outputs": [shown]}],
        "metadata": {"widgets": {STATE: {"state": {"m": {"state": state}}}}},
    }
    document = json.loads(stilled(json.dumps(notebook)))
    assert document["metadata"] == {}
    (output,) = document["cells"][0]["outputs"]
    html = output["data"].pop("text/html")
    assert output["data"] == {}
    assert html.count("</script>") == 1
    assert "http" not in html
