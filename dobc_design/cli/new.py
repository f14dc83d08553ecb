"""``dobc new``: a folder with a problem file, a notebook and a test, to start a project from.

What is written works as it stands: the problem is certified, the notebook runs, the test passes.
"""

from __future__ import annotations

import json
import re
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from dobc_design.cli.output import Json, print_json, refuse_option, require_folder, say
from dobc_design.errors import SpecError

LONGEST = 60  # characters of a name
SCHEMA = "problem.schema.json"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the problem, of its files and of the folder.")],
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Make the problem from a MATPOWER case (.m), a pandapower network (.json) or arcs"
            " (.csv, .graphml, .edges; needs --arrow).",
        ),
    ] = None,
    arrow: Annotated[
        str | None, typer.Option(help="With --from: what an arc [a, b] means, listens_to or sends_to.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME.")] = None,
    as_json: Json = False,
) -> None:
    """Start a project: write a problem file to edit, a notebook and a test. All three work without changes."""
    from dobc_design.certificate.files import make_folder, write_together

    if _NAME.fullmatch(name) is None or len(name) > LONGEST:
        rule = f"at most {LONGEST} letters, digits, dashes and underscores, and begin with a letter"
        message = f"NAME must be {rule}, because files are named after it; got {name[:70]!r}."
        raise SpecError(message, key="NAME", cure="For example my-swarm.")
    refuse_option(out, key="--out")
    if source is None and arrow is not None:
        cure = "Leave it out."
        raise SpecError("--arrow says what the arcs of --from mean; there is no --from.", key="--arrow", cure=cure)
    files = scaffold(name, source=source, arrow=arrow)
    folder = require_folder(Path(name) if out is None else out)
    there = next((each for each in files if (folder / each).exists()), None)
    if there is not None:
        cure = "Choose another name, or another folder with --out."
        raise SpecError(f"{str(folder / there)!r} exists already; nothing is overwritten.", key="NAME", cure=cure)
    make_folder(folder)
    write_together({folder / each: data for each, data in files.items()})
    written = [str(folder / each) for each in files]
    if as_json:
        print_json({"name": name, "folder": str(folder), "files": written})
    else:
        say("\n".join(f"wrote {path}" for path in written))
        file = shlex.quote(f"{name}.toml")
        say(f"\nnext:  cd {shlex.quote(str(folder))}\n       dobc check {file}\n       dobc certify {file}")


def scaffold(name: str, *, source: Path | None = None, arrow: str | None = None) -> dict[str, bytes]:
    """The files of a new project by name.  ``source``: a file of another program that the problem is made from."""
    from dobc_design.problem.schema import json_schema

    identifier = re.sub(r"\W", "_", name).lower()
    problem, verdict = _template("problem.toml", name), "PROVED"
    if source is not None:
        problem, verdict = _converted(name, source, arrow)
    test = _template("test.py.txt", name).replace("@IDENTIFIER@", identifier).replace("@VERDICT@", verdict)
    texts = {
        f"{name}.toml": problem,
        f"{name}.ipynb": _template("notebook.ipynb.txt", name),
        f"test_{identifier}.py": test,
        SCHEMA: json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n",
    }
    return {file: text.encode("utf-8") for file, text in texts.items()}


def _template(file: str, name: str) -> str:
    return (files("dobc_design.cli") / "templates" / file).read_text("utf-8").replace("@NAME@", name)


def _converted(name: str, source: Path, arrow: str | None) -> tuple[str, str]:
    """The text of the problem that a file of another program means, and the verdict that it gets today."""
    from dobc_design._show.text import visible
    from dobc_design.certification.certify import certify
    from dobc_design.importing.files import problem_from_file
    from dobc_design.problem.changes import changed_text, problem_text

    problem = problem_from_file(source, arrow=arrow)
    whole = problem_text(problem)
    text = changed_text(whole, {"name": name}) or whole
    text = re.sub(r"^(name = .*?)[ \t]*#.*$", r"\1", text, count=1, flags=re.MULTILINE)
    verdict = certify(problem).verdict.name
    return f"#:schema ./{SCHEMA}\n# Made by dobc new from {visible(source.name)}.\n\n{text}", verdict
