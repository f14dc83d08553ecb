"""Finding a problem by path or by built-in name."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from dobc_design.spec.builtin import builtin_names, builtin_text
from dobc_design.spec.file import read_problem_file, read_problem_text
from dobc_design.spec.problem import Problem


def load_problem(source: str | PathLike[str]) -> Problem:
    """Read a problem file (TOML, or a canonical problem.json), or a built-in problem by its name.

    A file of that name in the current folder wins over a built-in problem.
    Raises: SpecError that names every wrong key and its cure.
    Example: ``load_problem("paper-fixed")``.
    """
    path = Path(source)
    if isinstance(source, str) and source in builtin_names() and not path.is_file():
        return read_problem_text(builtin_text(source).encode("utf-8"), folder=None, default_name=source)
    return read_problem_file(path)
