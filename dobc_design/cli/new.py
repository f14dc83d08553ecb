"""``dobc new``: a folder with a problem file, a notebook and a test, to start a project from.

What is written works as it stands: the problem is certified, the notebook runs, the test passes.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from dobc_design._files import own_text
from dobc_design.errors import refused

from .output import print_json, require_folder, say

if TYPE_CHECKING:
    from dobc_design.problem.problem import Problem

LONGEST = 60  # characters of a name
SCHEMA = "problem.schema.json"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def new(
    name: str,
    source: Path | None = None,
    arrow: str | None = None,
    merge: str | None = None,
    drop_loops: bool = False,
    negative: str | None = None,
    out: Path | None = None,
    as_json: bool = False,
) -> None:
    """Start a project: write a problem file to edit, a notebook and a test. All three work without
    changes."""
    from dobc_design.certificate.files import write_folder

    _require_name(name)
    given = {
        "--arrow": arrow,
        "--merge": merge,
        "--drop-loops": drop_loops,
        "--negative": negative,
    }
    for option, value in given.items():
        if value and source is None:
            raise refused(
                option,
                f"{option} says how the arcs of --from are read; there is no --from.",
                "Leave it out.",
            )
    problem, read = None, ""
    if source is not None:
        from dobc_design.description.words import size_words
        from dobc_design.importing.files import problem_from_file

        problem = problem_from_file(
            source, arrow=arrow, merge=merge, drop_loops=drop_loops, negative=negative
        )
        read = f"read {source.name}: {size_words(problem.network)}\n"
    files = scaffold(name, problem, "" if source is None else source.name)
    folder = require_folder(Path(name) if out is None else out)
    _require_none(folder, files)
    written = [str(path) for path in write_folder(folder, files)]
    if as_json:
        print_json({"name": name, "folder": str(folder), "files": written})
        return
    say(read + "\n".join(f"wrote {path}" for path in written))
    file = shlex.quote(f"{name}.toml")
    say(f"\nnext:  cd {shlex.quote(str(folder))}")
    say(f"       dobc check {file}\n       dobc certify {file}")


def _require_name(name: str) -> None:
    """Refuse a name that cannot be one of files and of a Python function."""
    if _NAME.fullmatch(name) is None or len(name) > LONGEST:
        rule = f"at most {LONGEST} letters, digits, dashes and underscores, and begin with a letter"
        raise refused(
            "NAME",
            f"NAME must be {rule}, because files are named after it; got {name[:70]!r}.",
            "For example my-swarm.",
        )


def _require_none(folder: Path, files: Iterable[str]) -> None:
    """Refuse a folder that has one of the files already."""
    for each in files:
        if (folder / each).exists():
            raise refused(
                "NAME",
                f"{str(folder / each)!r} exists already; nothing is overwritten.",
                "Choose another name, or another folder with --out.",
            )


def scaffold(name: str, problem: Problem | None, source: str) -> dict[str, bytes]:
    """The files of a new project by name.  ``problem``: what was read of ``source``, a file of
    another program."""
    from dobc_design.problem.schema import json_schema

    # A test is a function of Python, whose name has no dashes.
    identifier = re.sub(r"\W", "_", name).lower()
    text, verdict = _template("problem.toml", name), "proved"
    if problem is not None:
        text, verdict = _converted(name, problem, source)
    test = _template("test.py.txt", name)
    assertion = f"testing.assert_{verdict}(PROBLEM)"
    if verdict == "undecided":
        assertion = "assert dd.certify(PROBLEM).verdict is dd.Verdict.UNDECIDED"
    test = test.replace("@IDENTIFIER@", identifier).replace("@VERDICT@", verdict)
    test = test.replace("@ASSERTION@", assertion)
    texts = {
        f"{name}.toml": text,
        f"{name}.ipynb": _template("notebook.ipynb.txt", name),
        f"test_{identifier}.py": test,
        SCHEMA: json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n",
    }
    return {file: text.encode("utf-8") for file, text in texts.items()}


def _template(file: str, name: str) -> str:
    text = own_text(f"cli/templates/{file}")
    return text.replace("@NAME@", name)


def _converted(name: str, problem: Problem, source: str) -> tuple[str, str]:
    """The text of the problem that a file of another program means, and the verdict that it gets
    today."""
    from dobc_design._show.text import visible
    from dobc_design.certification.certify import certify
    from dobc_design.problem.changes import changed_text, problem_text

    whole = problem_text(problem)
    text = changed_text(whole, {"name": name}) or whole
    text = re.sub(r"^(name = .*?)[ \t]*#.*$", r"\1", text, count=1, flags=re.MULTILINE)
    verdict = certify(problem).verdict.value
    return f"#:schema ./{SCHEMA}\n# Made by dobc new from {visible(source)}.\n\n{text}", verdict
