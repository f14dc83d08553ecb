"""What the shell offers when somebody presses the tab key: built-in problems, files, ids of conditions."""

from __future__ import annotations

import os

ENDINGS = (".toml", ".json")


def problem_names(incomplete: str) -> list[str]:
    """Built-in problems, problem files, and folders on the way to them."""
    from dobc_design.spec.builtin import builtin_names

    return sorted(name for name in builtin_names() if name.startswith(incomplete)) + _files(incomplete)


def ids(incomplete: str) -> list[str]:
    """Ids of conditions."""
    from dobc_design.theorems.explanations import EXPLANATIONS

    return [name for name in EXPLANATIONS if name.startswith(incomplete)]


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
