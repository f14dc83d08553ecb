"""The lone checker with one of its checks taken away: every condition is forced to the accepting value.

A check is the condition of ``need``, each part of it that ``and`` joins, the condition of an ``if`` that returns
False, and each part of a returned conjunction.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from dobc_design.checker import examine

FOLDER = Path(examine.__file__).parent
#: Each imports from those before it.
FILES = (
    "reading",
    "intervals",
    "expressions",
    "matrices",
    "files",
    "consensus",
    "separable",
    "accuracy",
    "margins",
    "quadratic",
    "moving",
    "cycles",
    "schedule",
    "examine",
)
SOURCES = {file: (FOLDER / f"{file}.py").read_text("utf-8") for file in FILES}


@dataclass(frozen=True)
class Removal:
    """``line`` and ``text`` of the condition in ``file``; ``place`` is its number in ``_conditions``."""

    file: str
    place: int
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}.py, line {self.line}: {self.text}"


def removals(file: str) -> list[Removal]:
    """Every check of one of the files."""
    conditions = enumerate(_conditions(ast.parse(SOURCES[file])))
    return [Removal(file, place, node.lineno, ast.unparse(node)) for place, (node, _) in conditions]


def without(removal: Removal) -> ModuleType:
    """The module that examines, in a package of its own, with that check taken away."""
    trees = {file: ast.parse(SOURCES[file]) for file in FILES}
    _, replace = list(_conditions(trees[removal.file]))[removal.place]
    replace()
    package = f"{removal.file}_without_{removal.place}"
    modules = {"": ModuleType(package)}
    modules[""].__path__, sys.modules[package] = [], modules[""]
    for file in FILES:
        name = f"{package}.{file}"
        modules[file] = sys.modules[name] = ModuleType(name)  # where dataclasses and relative imports look them up
        modules[file].__dict__.update(__package__=package, __file__=str(FOLDER / f"{file}.py"))
        code = compile(ast.fix_missing_locations(trees[file]), name, "exec")
        exec(code, modules[file].__dict__)  # noqa: S102 - our own source
        setattr(modules[""], file, modules[file])
    return modules["examine"]


def _conditions(tree: ast.Module) -> Iterator[tuple[ast.expr, object]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "need":
            yield node.args[0], _setter(node.args, 0, True)
            yield from _parts(node.args[0])
        elif isinstance(node, ast.If) and _returns_false(node.body):
            yield node.test, _setter(node, "test", False)
        elif isinstance(node, ast.Return) and isinstance(node.value, ast.BoolOp):
            yield from _parts(node.value)


def _parts(condition: ast.expr) -> Iterator[tuple[ast.expr, object]]:
    if isinstance(condition, ast.BoolOp) and isinstance(condition.op, ast.And):
        for k, part in enumerate(condition.values):
            yield part, _setter(condition.values, k, True)
            yield from _parts(part)
    elif isinstance(condition, ast.BoolOp):
        for part in condition.values:
            yield from _parts(part)


def _returns_false(body: list[ast.stmt]) -> bool:
    only = body[0] if len(body) == 1 else None
    return isinstance(only, ast.Return) and isinstance(only.value, ast.Constant) and only.value.value is False


def _setter(holder: object, place: object, value: bool) -> object:
    def replace() -> None:
        if isinstance(holder, list):
            holder[place] = ast.Constant(value)
        else:
            setattr(holder, str(place), ast.Constant(value))

    return replace
