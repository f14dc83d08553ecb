"""docs/contributing.md: the tables of "how to add" name files that are there, with what they say is
in them, and the settings of pre-commit run programs of the set-up."""

import re
import tomllib
from pathlib import Path

import pytest

import dobc_design

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "contributing.md").read_text("utf-8")
ROW = re.compile(r"^\| `([^`]+)` \| [^|]+ \| `([^`]+)` \|$", re.MULTILINE)
# How many files such a change may touch.
MOST_FILES = {
    "A function of couplings": 4,
    "A kind of claim": 6,
    "A key of the problem file": 4,
    "A block of the report": 2,
}


def files_of(page: str) -> dict[str, list[tuple[str, str]]]:
    """Below each heading, the rows of its table: a file, and a text that stands in it."""
    sections = re.split(r"^## ", page, flags=re.MULTILINE)[1:]
    return {section.partition("\n")[0]: ROW.findall(section) for section in sections}


@pytest.mark.parametrize("change", MOST_FILES)
def test_a_change_touches_files_that_are_there_and_no_more_than_it_may(change: str):
    rows = files_of(PAGE)[change]
    assert 2 <= len(rows) <= MOST_FILES[change]
    absent = [
        f"{name}: {text}"
        for name, text in rows
        if not (ROOT / name).is_file() or text not in (ROOT / name).read_text("utf-8")
    ]
    assert not absent


def test_the_version_is_one_in_all_files_that_a_release_changes():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    logged = re.search(r"^## \[(\d.+?)\]", (ROOT / "docs/changelog.md").read_text("utf-8"), re.M)
    assert {dobc_design.__version__, cited[1], logged[1]} == {project["version"]}


def test_pre_commit_runs_what_make_lint_and_make_types_run():
    hooks = (ROOT / ".pre-commit-config.yaml").read_text("utf-8")
    makefile = (ROOT / "Makefile").read_text("utf-8")
    wanted = re.findall(r"^\t(\.venv/bin/(?:ruff|mypy).*?)(?: \.)?$", makefile, re.MULTILINE)
    assert len(wanted) == 3
    assert re.findall(r"^ +entry: (.+)$", hooks, re.MULTILINE) == wanted
