"""``dobc new``: a folder with a problem file, a notebook and a test, to start a project from.

What is written works as it stands: the problem is certified, the notebook runs, the test passes.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from dobc_design.cli.output import Json, print_json, refuse_option, require_folder, say
from dobc_design.errors import SpecError

LONGEST = 60  # characters of a name
SCHEMA = "problem.schema.json"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")

PROBLEM = """\
#:schema ./problem.schema.json
# {name}: four agents agree on a value that only agent 1 knows, against a constant disturbance.
#
# Change it to your own problem. Every key is explained by `dobc schema`; `dobc check {file}` says in words what the
# file means, and `dobc certify {file}` whether the agents will agree.

schema = 1
name = "{name}"
target = 1.0                          # where all agents are to go

[network]
agents = 4                            # labels 1 to 4; or a list of names
arrow = "listens_to"                  # [2, 1] means: agent 2 listens to agent 1

[network.modes]                       # several modes mean that the topology switches between them
G = [[2, 1], [3, 2], [4, 3], [1, 4]]

[coupling]
h = "tanh(y)"                         # agent i moves by h(x_j - x_i) for every j it listens to

[pinning]
gains = {{ 1 = 2.0 }}                   # agent 1 is pulled to the target, in 1/s

[exosystem]                           # the disturbance d = C xi of every agent, xi' = A xi; here a constant
A = [[0]]
C = [[1]]

[observer]
rate = 2.0                            # 1/s; W is designed. Or give W = [[...]] yourself

[region]                              # the certificate has to cover all these starts
initial_states = [0, 2]
initial_disturbance = 0.1             # of the estimation error

[simulation]                          # enters no proof
t_final = 40
seed = 0
xi0 = [0.3]
"""

TEST = '''\
"""The certificate of {name}: proved, and confirmed by the independent checker."""

from pathlib import Path

import dobc_design as dd

PROBLEM = Path(__file__).with_name("{file}")


def test_{identifier}_is_certified_and_the_certificate_holds():
    certificate = dd.certify(PROBLEM)
    assert certificate.verdict is dd.Verdict.{verdict}, certificate.reason
    assert dd.verify(certificate, PROBLEM).holds
'''


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the problem, of its files and of the folder.")],
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Make the problem from a MATPOWER case (.m), a pandapower network (.json), a MATLAB file (.mat) or"
            " arcs (.csv, .graphml, .edges; needs --arrow).",
        ),
    ] = None,
    arrow: Annotated[
        str | None, typer.Option(help="With --from: what an arc [a, b] means, listens_to or sends_to.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME.")] = None,
    as_json: Json = False,
) -> None:
    """Begin a project: a problem file to be changed, a notebook and a test, all of which work as they stand."""
    from dobc_design.certificate.files import make_folder, write_together

    if _NAME.fullmatch(name) is None or len(name) > LONGEST:
        raise SpecError(
            f"NAME must be at most {LONGEST} letters, digits, dashes and underscores, and begin with a letter, because"
            f" files are named after it; got {name[:70]!r}.",
            key="NAME",
            cure="For example my-swarm.",
        )
    refuse_option(out, key="--out")
    if source is None and arrow is not None:
        raise SpecError(
            "--arrow says what the arcs of --from mean; there is no --from.", key="--arrow", cure="Leave it out."
        )
    files = scaffold(name, source=source, arrow=arrow)
    folder = require_folder(Path(name) if out is None else out)
    there = next((each for each in files if (folder / each).exists()), None)
    if there is not None:
        raise SpecError(
            f"{str(folder / there)!r} exists already; nothing is overwritten.",
            key="NAME",
            cure="Choose another name, or another folder with --out.",
        )
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

    file, identifier = f"{name}.toml", re.sub(r"\W", "_", name).lower()
    verdict = "PROVED"
    if source is None:
        problem = PROBLEM.format(name=name, file=file)
    else:
        problem, verdict = _converted(name, source, arrow)
    return {
        file: problem.encode("utf-8"),
        f"{name}.ipynb": _notebook(name, file).encode("utf-8"),
        f"test_{identifier}.py": TEST.format(name=name, file=file, identifier=identifier, verdict=verdict).encode(
            "utf-8"
        ),
        SCHEMA: (json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n").encode("utf-8"),
    }


def _converted(name: str, source: Path, arrow: str | None) -> tuple[str, str]:
    """The text of the problem that a file of another program means, and the verdict that it gets today."""
    from dobc_design._show.text import visible
    from dobc_design.certification.certify import certify
    from dobc_design.export.interchange import problem_from_file
    from dobc_design.problem.changes import changed_text, problem_text

    problem = problem_from_file(source, arrow=arrow)
    whole = problem_text(problem)
    text = changed_text(whole, {"name": name}) or whole
    text = re.sub(r"^(name = .*?)[ \t]*#.*$", r"\1", text, count=1, flags=re.MULTILINE)
    verdict = certify(problem).verdict.name
    return f"#:schema ./{SCHEMA}\n# Made by dobc new from {visible(source.name)}.\n\n{text}", verdict


def _notebook(name: str, file: str) -> str:
    """A notebook without outputs: what the problem says, its certificate, its regions, a run, a cure."""
    cells = [
        _text(f"# {name}\n\nWhat the problem file says, what is proved about it, and how a run looks."),
        _code(f'import dobc_design as dd\n\nproblem = dd.load_problem("{file}")\nproblem'),
        _text("Every condition is decided exactly. The verdict comes first, then check by check, with the reasons."),
        _code("certificate = dd.certify(problem)\ncertificate"),
        _text("From which starts it is proved, method by method:"),
        _code("certificate.regions"),
        _text("One simulated run. It illustrates; nothing is proved by it."),
        _code("dd.simulate(problem).plot()"),
        _text("What to do next: keep the certificate, and let the independent checker decide every claim again."),
        _code(f'certificate.save("{name}-certificate")\nprint(dd.verify(certificate, problem))'),
    ]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    document = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _text(source: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": source.splitlines(keepends=True)}


def _code(source: str) -> dict[str, Any]:
    return {
        "cell_type": "code",
        "execution_count": None,
        "metadata": {},
        "outputs": [],
        "source": source.splitlines(keepends=True),
    }
