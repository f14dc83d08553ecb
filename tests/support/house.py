"""The package as its syntax trees show it: its modules, its rooms, and which of them import each
other.

Nothing is imported, so an import inside a function or under TYPE_CHECKING counts like any other.
The standard library is enough: ``tests/size.py`` runs without the packages of a set-up.
"""

from __future__ import annotations

import ast
import gc
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "dobc_design"


@dataclass(frozen=True)
class House:
    """The sources of the package by dotted name without the package: "problem.load",
    "exact.__init__", "errors"."""

    sources: Mapping[str, str]

    @cached_property
    def trees(self) -> dict[str, ast.Module]:
        gc.disable()  # the collector would go through the growing trees again and again
        try:
            return {name: ast.parse(text) for name, text in self.sources.items()}
        finally:
            gc.freeze()
            gc.enable()

    @cached_property
    def imports(self) -> dict[str, list[tuple[int, str]]]:
        """Line and absolute dotted name of everything that a module imports; relative names are
        resolved."""
        return {name: list(imported_names(tree, name)) for name, tree in self.trees.items()}

    @cached_property
    def uses(self) -> dict[str, set[str]]:
        """The modules of the package that each module imports."""
        found: dict[str, set[str]] = {}
        for name, targets in self.imports.items():
            modules = {self.module_of(target) for _, target in targets}
            found[name] = {each for each in modules if each not in (None, name)}
        return found

    def module_of(self, target: str) -> str | None:
        """The module that an imported dotted name lies in; None for other packages and for the
        version."""
        top, _, rest = target.partition(".")
        if top != PACKAGE or rest == "__version__":
            return None
        parts = rest.split(".") if rest else []
        for count in range(len(parts), 0, -1):
            name = ".".join(parts[:count])
            for found in (name, f"{name}.__init__"):
                if found in self.sources:
                    return found
        return "__init__"

    def closure(self, module: str) -> dict[str, str]:
        """Every module that this one rests on, each with the one that imports it."""
        found = {module: ""}
        waiting = [module]
        while waiting:
            user = waiting.pop()
            for other in sorted(self.uses[user] - found.keys()):
                found[other] = user
                waiting.append(other)
        return found


@cache
def house_on_disk() -> House:
    folder = ROOT / PACKAGE
    files = sorted(folder.rglob("*.py"))
    sources = {}
    for file in files:
        place = file.relative_to(folder).with_suffix("")
        sources[".".join(place.parts)] = file.read_text("utf-8")
    return House(sources)


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Every statement of a module, inside functions, classes and branches as well."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            inside = getattr(node, block, [])
            waiting += inside
            yield from inside


def imported_names(tree: ast.AST, module: str) -> Iterator[tuple[int, str]]:
    """``from a import b`` yields "a.b", since b may be a module."""
    package = [PACKAGE, *module.split(".")[:-1]]
    for node in statements(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = []
            if node.level:  # "from ..x": as many packages up as there are dots beyond the first
                base = package[: len(package) - node.level + 1]
            if node.module:
                base = [*base, node.module]
            prefix = ".".join(base)
            yield from ((node.lineno, f"{prefix}.{alias.name}") for alias in node.names)


def room_of(module: str) -> str:
    """ "exact", "conditions.observer" for a topic; "conditions" for what its topics share."""
    parts = module.split(".")
    if parts[0] in ("conditions", "synthesis") and len(parts) > 2:
        return ".".join(parts[:2])
    return parts[0]


def circles(house: House) -> Iterator[str]:
    """Rooms that import each other, directly or not; a topic is a room."""
    near: dict[str, dict[str, str]] = defaultdict(dict)
    for module, others in house.uses.items():
        for other in others:
            if "__init__" not in (module, other) and room_of(module) != room_of(other):
                near[room_of(module)][room_of(other)] = f"{module} imports {other}"
    yield from (f"circle: {near[room][other]}" for room, other in on_circles(near))


def inner_circles(house: House) -> Iterator[str]:
    """Modules of one room that import each other, directly or not, also inside functions."""
    near = {}
    for module, others in house.uses.items():
        room = room_of(module)
        near[module] = {other for other in others if room_of(other) == room}
    for module, other in on_circles(near):
        yield f"circle in {room_of(module)}: {module} imports {other}"


def on_circles(near: Mapping[str, Collection[str]]) -> Iterator[tuple[str, str]]:
    """The arcs of a graph among the nodes that are left when those without an arc to one that is
    left, or from one, have gone again and again."""
    left = {node: set(others) for node, others in near.items()}
    while True:
        heard = set().union(*left.values())
        outside = []
        for node, others in left.items():
            if not others & left.keys() or node not in heard:
                outside.append(node)
        if not outside:
            break
        for node in outside:
            del left[node]
    for node, others in sorted(left.items()):
        yield from ((node, other) for other in sorted(others & left.keys()))
