"""Pages that the program itself writes, its commands and its conditions; and the notebooks, brought
into the handbook.

They are made anew at every build and are not committed.
"""

from __future__ import annotations

from pathlib import Path

import typer
from executed import NOTEBOOKS, kept, run_missing
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging
from widgets import stilled

from dobc_design.cli.main import app as command_line
from dobc_design.conditions.kinds import KINDS

DOCS = Path(__file__).resolve().parents[1]
LOG = logging.getLogger(__name__)


def cell(text: object) -> str:
    """The text inside a cell of a table."""
    return str(text or "").replace("|", "\\|").replace("\n", " ")


PREPARE = ("new", "problems", "check", "explain", "doctor", "schema")
PROVE = ("certify", "verify", "region", "report")
#: File -> title, the commands on it (None: all others), and the other two pages in a sentence.
COMMANDS: dict[str, tuple[str, tuple[str, ...] | None, str]] = {
    "command-line": (
        "Commands that prove",
        PROVE,
        "[](commands-prepare.md) and [](commands-design.md) have the others.",
    ),
    "commands-prepare": (
        "Commands that prepare and explain",
        PREPARE,
        "How options are read: [](command-line.md).",
    ),
    "commands-design": (
        "Commands that design, simulate, export",
        None,
        "How options are read: [](command-line.md).",
    ),
}


def commands(title: str, wanted: tuple[str, ...] | None, besides: str) -> str:
    """One page of the command line, in the order wanted."""
    everything = typer.main.get_command(command_line).commands
    names = wanted or sorted(set(everything) - set(PREPARE) - set(PROVE))
    lines = [f"# {title}", "", besides, ""]
    if wanted == PROVE:
        lines += [
            "Written from the program itself. FILE is the path of a problem file or the "
            "name of a built-in problem.",
            "`--json` puts one JSON document on standard output and nothing else there, "
            "with the keys of [](json.md);",
            "progress and messages go to standard error.",
            "",
        ]
    for name, command in ((name, everything[name]) for name in names):
        if command.hidden:
            continue
        arguments = [part for part in command.params if part.param_type_name == "argument"]
        usage = " ".join(
            ["dobc", name, *(argument.name.upper() for argument in arguments), "[OPTIONS]"]
        )
        lines += [f"## dobc {name}", "", command.help or "", "", f"    {usage}", ""]
        lines += ["| argument or option | what it is |", "|---|---|"]
        for part in command.params:
            if getattr(part, "hidden", False):
                continue
            is_argument = part.param_type_name == "argument"
            shown = part.name.upper() if is_argument else ", ".join(part.opts + part.secondary_opts)
            lines.append(f"| `{shown}` | {cell(part.help)} |")
        lines.append("")
    return "\n".join(lines)


def conditions() -> str:
    """The page of the conditions."""
    lines = [
        "# Conditions",
        "",
        "Every check of a certificate has one of these ids. `dobc explain ID` says the "
        "same on the command line.",
        "",
    ]
    for name, text in KINDS.items():
        lines += [
            f"## {name}",
            "",
            f"**{text.title}**",
            "",
            "```{math}",
            text.statement,
            "```",
            "",
            text.meaning,
            "",
        ]
        lines += [
            f"- *Proved:* {text.proved}",
            f"- *Refuted:* {text.refuted}",
            f"- *Source:* {text.source}",
            "",
        ]
    return "\n".join(lines)


def write(path: Path, text: str) -> None:
    """An unchanged page keeps its time, so that it is not built again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def notebooks(target: Path, *, with_outputs: bool) -> None:
    """Copy the notebooks, and forget those that are gone."""
    if with_outputs:
        try:
            for line in run_missing(NOTEBOOKS):
                LOG.info(line)
        except RuntimeError as error:
            raise ExtensionError(str(error)) from error
    for path in NOTEBOOKS:
        text = (kept(path) if with_outputs else path).read_text("utf-8")
        write(target / path.name, stilled(text.replace("](../docs/", "](../")))
    for path in target.glob("*.ipynb"):
        if path.name not in {notebook.name for notebook in NOTEBOOKS}:
            path.unlink()


def generate(app: Sphinx) -> None:
    """Write everything."""
    for name, page in COMMANDS.items():
        write(DOCS / "reference" / f"{name}.md", commands(*page))
    write(DOCS / "reference" / "conditions.md", conditions())
    notebooks(DOCS / "gallery", with_outputs=app.config.run_notebooks)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by sphinx."""
    app.add_config_value("run_notebooks", default=True, rebuild="env", types=bool)
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
