"""What the shell offers when somebody presses the tab key, built-in problems, files, ids; and how it is told to ask."""

from __future__ import annotations

import os

import typer

from dobc_design.errors import SpecError

COMPLETING = "_DOBC_COMPLETE"  # set by a shell that wants to know how a word may go on
ENDINGS = (".toml", ".json")


def problem_names(incomplete: str) -> list[str]:
    """Built-in problems, problem files, and folders on the way to them."""
    from dobc_design.problem.load import builtin_names

    return sorted(name for name in builtin_names() if name.startswith(incomplete)) + _files(incomplete)


def ids(incomplete: str) -> list[str]:
    """Ids of conditions."""
    from dobc_design.conditions.kinds import KINDS

    return [name for name in KINDS if name.startswith(incomplete)]


def _files(incomplete: str) -> list[str]:
    folder, _, beginning = incomplete.rpartition("/")
    head = f"{folder}/" if "/" in incomplete else ""
    try:
        entries = sorted(os.scandir(head or "."), key=lambda entry: entry.name)
    except OSError:
        return []
    found = []
    for entry in entries:
        if entry.name.startswith(beginning) and not entry.name.startswith("."):
            if entry.is_dir():
                found.append(f"{head}{entry.name}/")
            elif entry.name.endswith(ENDINGS):
                found.append(f"{head}{entry.name}")
    return found


def completion(context: typer.Context, parameter: typer.CallbackParam, wanted: bool) -> None:
    """Print or install the completion for the shell that is running."""
    if wanted and not context.resilient_parsing:
        from typer import completion as shells

        action = shells.install_callback if parameter.name == "install_completion" else shells.show_callback
        shells.get_completion_inspect_parameters()  # prepares the shells' scripts
        try:
            action(context, parameter, wanted)
        except SystemExit as error:
            if error.code in (0, None):
                raise typer.Exit(0) from error
            raise SpecError(
                "the shell that is running is none that can be completed.",
                key="--show-completion",
                cure="Run this in bash, zsh, fish or PowerShell.",
            ) from error
