"""Finding a problem by path or by built-in name."""

from __future__ import annotations

import os
from difflib import get_close_matches
from importlib.resources import files
from os import PathLike
from pathlib import Path

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.file import read_problem_file, read_problem_text
from dobc_design.problem.problem import Problem
from dobc_design.problem.toml_text import read_bytes

SUFFIX = ".toml"


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in problems, in the order they are best read."""
    folder = files("dobc_design.problems")
    names = sorted(item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX))
    first = [name for name in ("paper-fixed", "paper-switching") if name in names]
    return (*first, *(name for name in names if name not in first))


def builtin_text(name: str) -> str:
    """The problem file of that name, as text."""
    return (files("dobc_design.problems") / f"{name}{SUFFIX}").read_text(encoding="utf-8")


def builtin_summary(name: str) -> str:
    """The first sentence of the comment a built-in problem opens with."""
    lines = []
    for line in builtin_text(name).splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").strip())
    text = " ".join(lines)
    return text.split(". ", 1)[0].rstrip(".") + "."


def load_problem(source: str | PathLike[str]) -> Problem:
    """Read a problem file (TOML, or a canonical problem.json), or a built-in problem by its name.

    A file of that name in the current folder wins over a built-in problem.
    Returns: a Problem.  Raises: SpecError that names every wrong key and its cure.
    Example:
        >>> dd.load_problem("paper-fixed").n
        10
    """
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source):  # unlike Path, it takes any text
        if source in builtin_names():
            return read_problem_text(builtin_text(source).encode("utf-8"), folder=None, default_name=source)
        near = get_close_matches(source[:100], builtin_names(), n=1)
        if near and not os.path.exists(source):
            what = f"there is no file {shown(source)} and no built-in problem of that name."
            raise SpecError(what, key=path.name, cure=f"did you mean {near[0]}?")
    return read_problem_file(path)


def source_text(source: str | PathLike[str]) -> str | None:
    """The TOML that ``load_problem`` reads for this source; None for a problem.json.

    Raises: SpecError if there is no such file.
    """
    path = Path(source)
    if isinstance(source, str) and not os.path.isfile(source) and source in builtin_names():
        return builtin_text(source)
    return None if path.suffix.lower() == ".json" else read_bytes(path).decode("utf-8-sig")
