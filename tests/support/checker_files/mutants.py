"""The lone checker with one of its checks taken away: every condition is forced to the accepting
value.

A check is the condition of ``need``, each part of it that ``and`` joins, the condition of an ``if``
that returns False, and each part of a returned conjunction.  The parts of a condition that has a
name are those of the ``and`` that the name was given.
"""

import ast
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from operator import setitem
from pathlib import Path
from types import CodeType, ModuleType
from typing import TypeGuard

from dobc_design.checker import examine

FOLDER = Path(examine.__file__).parent
#: Each imports from those before it.
FILES = (
    "reading",
    "intervals",
    "expressions",
    "matrices",
    "sampled",
    "signs",
    "outputs",
    "files",
    "guarantee",
    "loop",
    "claims",
    "pairs",
    "saturation",
    "consensus",
    "curves",
    "separable",
    "arcs",
    "quadratic",
    "coordinates",
    "cycles",
    "schedule",
    "graphs",
    "channels",
    "bands",
    "accuracy",
    "value",
    "factors",
    "margins",
    "verdict",
    "examine",
)
SOURCES = {file: (FOLDER / f"{file}.py").read_text("utf-8") for file in FILES}
#: A condition, the value with which it accepts, and what puts another expression in its place.
Condition = tuple[ast.expr, bool, Callable[[ast.expr], None]]


@dataclass(frozen=True)
class Removal:
    """``line`` and ``text`` of the condition in ``file``; ``place`` is its number in
    ``_conditions``."""

    file: str
    place: int
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}.py, line {self.line}: {self.text}"


def removals(file: str) -> list[Removal]:
    """Every check of one of the files."""
    conditions = enumerate(_conditions(ast.parse(SOURCES[file])))
    found = []
    for place, (node, *_) in conditions:
        found.append(Removal(file, place, node.lineno, ast.unparse(node)))
    return found


def without(removal: Removal) -> ModuleType:
    """The module that examines, in a package of its own, with that check taken away."""
    tree = ast.parse(SOURCES[removal.file])
    _, accepting, replace = list(_conditions(tree))[removal.place]
    replace(ast.Constant(accepting))
    changed = compile(ast.fix_missing_locations(tree), removal.file, "exec")
    return _examiner(f"{removal.file}_without_{removal.place}", {removal.file: changed})


def with_slip(file: str, text: str, slip: str) -> ModuleType:
    """The module that examines, in a package of its own, with a text that stands once in a file
    replaced."""
    source = SOURCES[file]
    if source.count(text) != 1:
        raise ValueError(f"{text!r} stands {source.count(text)} times in {file}.py")
    changed = compile(source.replace(text, slip), file, "exec")
    return _examiner(f"{file}_with_{len(slip)}_{source.index(text)}", {file: changed})


class Watched:
    """The module that examines, and which of its checks have not passed: not true, or ended by an
    exception."""

    def __init__(self) -> None:
        changed = {}
        for file in FILES:
            tree = ast.parse(SOURCES[file])
            for place, (node, accepting, replace) in enumerate(list(_conditions(tree))):
                here = f"({file!r}, {place})"
                watched = ast.parse(
                    f"_seen({here}, {accepting}, _asked({here}), 0)", mode="eval"
                ).body
                watched.args[-1] = node  # type: ignore[attr-defined]
                replace(watched)
            changed[file] = compile(
                ast.fix_missing_locations(tree), str(FOLDER / f"{file}.py"), "exec"
            )
        self._open: Counter[tuple[str, int]] = Counter()
        self._rejected: set[tuple[str, int]] = set()
        self.module = _examiner("watched", changed, _asked=self._asked, _seen=self._seen)

    def _asked(self, place: tuple[str, int]) -> None:
        self._open[place] += 1

    def _seen(self, place: tuple[str, int], accepting: bool, asked: None, value: object) -> object:
        self._open[place] -= 1
        if bool(value) is not accepting:
            self._rejected.add(place)
        return value

    def failed(self) -> set[tuple[str, int]]:
        """File and place of the checks that have not passed since this was asked last."""
        still_open = self._open.items()
        open_places = {place for place, times in still_open if times}
        failed = self._rejected | open_places
        self._open.clear()
        self._rejected.clear()
        return failed


@cache
def _compiled(file: str) -> CodeType:
    return compile(SOURCES[file], file, "exec")


@cache
def _unchanged() -> ModuleType:
    """The package as it is, by another name: files before a changed one are taken from here."""
    _examiner("unchanged", {})
    return sys.modules["unchanged"]


def _examiner(package: str, changed: dict[str, CodeType], **names: object) -> ModuleType:
    """The module that examines, in a package of this name with some files changed and some names in
    each."""
    modules = {"": ModuleType(package)}
    modules[""].__path__ = []
    sys.modules[package] = modules[""]
    first = min(map(FILES.index, changed), default=0)
    for place, file in enumerate(FILES):
        name = f"{package}.{file}"
        if place < first:
            modules[file] = sys.modules[name] = getattr(_unchanged(), file)
        else:
            # where dataclasses and relative imports look them up
            modules[file] = sys.modules[name] = ModuleType(name)
            modules[file].__dict__.update(
                __package__=package, __file__=str(FOLDER / f"{file}.py"), **names
            )
            exec(changed.get(file) or _compiled(file), modules[file].__dict__)  # noqa: S102 - our own source
        setattr(modules[""], file, modules[file])
    return modules["examine"]


def _conditions(tree: ast.Module) -> Iterator[Condition]:
    for node in ast.walk(tree):
        if _is_need(node):
            yield node.args[0], True, partial(setitem, node.args, 0)
            yield from _parts(node.args[0])
        elif isinstance(node, ast.If) and _returns_false(node.body):
            yield node.test, False, partial(setattr, node, "test")
        elif isinstance(node, ast.Return) and isinstance(node.value, ast.BoolOp):
            yield from _parts(node.value)
        elif isinstance(node, ast.FunctionDef):
            yield from _named_parts(node)


def _named_parts(function: ast.FunctionDef) -> Iterator[Condition]:
    """Of the conjunctions with a name that the function needs."""
    needed = {
        name.id
        for node in ast.walk(function)
        if _is_need(node)
        for name in ast.walk(node.args[0])
        if isinstance(name, ast.Name)
    }
    for node in ast.walk(function):
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(target, ast.Name) and target.id in needed:
            yield from _parts(node.value)


def _is_need(node: ast.AST) -> TypeGuard[ast.Call]:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "need"


def _parts(condition: ast.expr) -> Iterator[Condition]:
    if isinstance(condition, ast.BoolOp) and isinstance(condition.op, ast.And):
        for k, part in enumerate(condition.values):
            yield part, True, partial(setitem, condition.values, k)
            yield from _parts(part)
    elif isinstance(condition, ast.BoolOp):
        for part in condition.values:
            yield from _parts(part)


def _returns_false(body: list[ast.stmt]) -> bool:
    only = body[0] if len(body) == 1 else None
    returns = isinstance(only, ast.Return)
    return returns and isinstance(only.value, ast.Constant) and only.value.value is False
