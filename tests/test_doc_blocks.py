"""Every code block of the README and the handbook runs, in the order of its page, in an empty
folder.

Python blocks of a page share one namespace. Of shell blocks the lines that begin with ``dobc`` or
``cd`` are run, and have to leave with 0, or with the N of a comment ``# exit code N``; other lines
(make, pip, ls) are skipped. They run in this process, since starting one takes longer than most
commands. A TOML block whose first line is ``# NAME.toml`` is saved under that name; other ones only
have to be TOML. What a ``text`` block shows has to have been said before it on its page, whatever
the line breaks.
"""

import contextlib
import importlib
import io
import os
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from certified import certify_once
from problem_texts import CHAIN

import dobc_design
from dobc_design.cli.main import main

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_MADE = ("command-line", "commands-design", "commands-prepare", "conditions")
WRITTEN_BY_PROGRAM = {f"docs/reference/{name}.md" for name in _MADE}
PAGES = [
    name
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if "_build" not in path.parts
    and (name := path.relative_to(ROOT).as_posix()) not in WRITTEN_BY_PROGRAM
]
RUNNABLE = ("python", "sh", "toml", "text")
#: "Your own problem" of a page that does not write one.
MINE = CHAIN.replace('"chain"', '"mine"').replace('"y"', '"tanh(y)"')


def blocks(page: str) -> list[tuple[str, str]]:
    return [
        found for found in BLOCK.findall((ROOT / page).read_text("utf-8")) if found[0] in RUNNABLE
    ]


def run_shell(line: str, folder: Path) -> tuple[Path, str]:
    """One line; returns the folder in which the next one runs, and what was said."""
    command, _, comment = line.partition("#")
    words = shlex.split(command)
    if words[:1] == ["cd"]:
        return (folder / words[1]).resolve(), ""
    if words[:1] != ["dobc"]:
        return folder, ""
    promised = re.search(r"exit code (\d+)", comment)
    target = None
    if ">" in words:
        target = words[words.index(">") + 1]
        words = words[: words.index(">")]
    out = io.StringIO()
    errors = io.StringIO()
    quiet = (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(errors),
    )
    with quiet[0], quiet[1], quiet[2], pytest.raises(SystemExit) as left:
        main(words[1:])
    assert left.value.code == int(promised[1] if promised else 0), (
        f"{line}\n{out.getvalue()}\n{errors.getvalue()}"
    )
    if target:
        (folder / target).write_text(out.getvalue(), "utf-8")
    return folder, out.getvalue() + errors.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)])
def test_the_code_blocks_of_a_page_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(os.environ, "MPLBACKEND", "Agg")
    monkeypatch.setattr("dobc_design.certification.certify.certify", certify_once)
    monkeypatch.setattr(dobc_design, "certify", certify_once)
    (tmp_path / "mine.toml").write_text(MINE, "utf-8")
    namespace: dict[str, object] = {}
    folder, said = tmp_path, ""
    for language, text in blocks(page):
        if language == "python":
            monkeypatch.chdir(folder)
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(text, page, "exec"), namespace)  # noqa: S102 - the handbook's own code
            said += printed.getvalue()
        elif language == "toml":
            named = re.match(r"# (\S+\.toml)$", text.splitlines()[0])
            tomllib.loads(text)
            if named:
                (folder / named[1]).write_text(text, "utf-8")
        elif language == "text":
            assert " ".join(text.split()) in " ".join(said.split())
        else:
            start = folder
            for line in text.splitlines():
                start, answer = run_shell(line, start)
                said += answer
    monkeypatch.chdir(ROOT)


def test_the_pages_have_blocks():
    assert sum(len(blocks(page)) for page in PAGES) > 20


@pytest.mark.slow
def test_the_picture_of_the_readme_is_the_one_of_its_problem_file(monkeypatch: pytest.MonkeyPatch):
    """Drawn anew from the mine.toml that the README shows, certified as it is; positions may differ
    by half a point."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "_ext")
    overview = importlib.import_module("overview")
    drawn = overview.overview().file("svg").decode()
    kept = overview.PICTURE.read_text("utf-8")
    number = re.compile(r"-?\d+(?:\.\d+)?")
    assert number.sub("", drawn) == number.sub("", kept)
    pairs = zip(number.findall(drawn), number.findall(kept), strict=True)
    for new, old in pairs:
        assert abs(float(new) - float(old)) <= 0.5
    assert "proved: decay rate" in kept


def test_a_line_that_fails_is_noticed(tmp_path: Path):
    with pytest.raises(AssertionError, match=r"dobc check nobody\.toml"):
        run_shell("dobc check nobody.toml", tmp_path)
    with pytest.raises(AssertionError, match="exit code 1"):
        run_shell("dobc check paper-fixed # exit code 1", tmp_path)
