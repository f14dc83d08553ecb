"""The floors of docs/architecture.md, the third-party packages of every room, and a few forbidden words.

Everything is read from the syntax trees of the sources: nothing is imported, so an import inside a
function or under TYPE_CHECKING counts like any other. ``violations`` takes source text, so that the last
tests can show it a violating module and see it complain.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "dobc_design"
SOURCES = sorted((ROOT / PACKAGE).rglob("*.py"))

# Floor of every room: a module or package directly in dobc_design.
FLOORS = {
    "errors": 0, "verdict": 0, "_checks": 0, "_display": 0, "_render": 0, "_signals": 0,
    "exact": 1,
    "plotting": 1,
    "spec": 2, "problems": 2,
    "model": 3, "theorems": 3,
    "analysis": 4, "design": 4, "verify": 4, "simulate": 4,
    "certificate": 5, "covering": 5, "curing": 5, "deciding": 5, "designing": 5, "falsifying": 5, "settling": 5,
    "report": 6,
    "export": 6,
    "importing": 6,
    "searching": 6,
    "workflow": 7,
    "interchange": 7,
    "cli_parts": 7,
    "cli_output": 7,
    "cli_completion": 7,
    "cli_certify": 8,
    "cli_doctor": 8,
    "cli_guard": 8,
    "cli_explain": 8,
    "cli_new": 8,
    "cli_report": 8,
    "cli_design": 8,
    "cli_export": 8,
    "cli_region": 8,
    "cli_simulate": 8,
    "sweep": 8,
    "designer": 8,
    "cli_sweep": 9,
    "cli": 10,
    "__main__": 11,
    "__init__": 11,
}  # fmt: skip

# The single modules of floor 0 are one room: they may import each other.
GROUND = {"errors", "verdict", "_checks", "_display", "_render", "_signals"}

# Third-party packages (import names) of every room; a room that is not here may have none.
THIRD_PARTY = {
    "_render": {"latex2mathml"},
    "exact": {"numpy", "flint"},
    "plotting": {"matplotlib", "numpy", "PIL"},  # Pillow, which comes with Matplotlib, writes GIFs
    "spec": {"numpy", "pydantic", "tomlkit"},
    "model": {"casadi", "sympy", "numpy", "scipy"},
    "theorems": {"numpy"},
    "analysis": {"control", "networkx", "numpy", "scipy"},
    "design": {"cvxpy", "clarabel", "control", "numpy", "scipy"},
    "verify": {"numpy"},
    "designing": {"pandas"},
    "simulate": {"numpy", "scipy", "pandas", "pyarrow"},
    "falsifying": {"numpy"},
    "report": {"jinja2", "matplotlib", "networkx", "numpy", "typst"},
    "export": {"control", "numpy", "scipy", "sympy"},  # what is exported to
    "importing": {"numpy", "scipy"},
    "cli": {"typer", "rich"},
    "cli_certify": {"rich"},
    "cli_completion": {"typer"},
    "cli_guard": {"typer"},
    "cli_design": {"rich"},
    "cli_output": {"typer", "rich"},
    "cli_sweep": {"rich"},
    "designer": {"anywidget", "numpy", "traitlets"},
    "sweep": {"distributed", "duckdb", "joblib", "numpy", "pandas", "pyarrow"},
    "cli_region": {"rich"},
    "cli_parts": {"rich"},
}

# Packages that only some modules of their room may use.
ONLY_IN = {"pydantic": ("spec.file", "spec.schema"), "typst": ("report.pdf",)}

# What a proof rests on. These rooms import each other only, so that no solver and no CasADi gets in.
TRUSTED = GROUND | {"exact", "spec", "problems", "theorems", "verify", "certificate"}

# The checker that anyone can read in an evening: standard library only, nothing of the package.
CHECKER = "certificate.checker"
# Its other parts, each with those that it imports from; nothing else of the package.
CHECKER_PARTS = {
    "certificate.region_checker": (CHECKER,),
    "certificate.quadratic_checker": (CHECKER, "certificate.region_checker"),
    "certificate.groups_checker": (CHECKER,),
}
CHECKER_LINES = 800

BUILTINS = {"eval", "exec", "compile", "__import__", "print"}
# Functions that run text as code or import by name, wherever they come from.
FORBIDDEN_NAMES = {"sympify", "parse_expr", "import_module"}


def module_name(path: Path) -> str:
    """Dotted name without the package: "spec.file", "exact.__init__", "cli"."""
    return ".".join(path.relative_to(ROOT / PACKAGE).with_suffix("").parts)


def room_of(module: str) -> str:
    return module.partition(".")[0]


def imported_names(tree: ast.AST, module: str) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of everything imported; relative names are resolved.

    ``from a import b`` yields "a.b", since b may be a module.
    """
    package = [PACKAGE, *module.split(".")[:-1]]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level > len(package):
                yield node.lineno, f"{PACKAGE}.__init__"
                continue
            base = package[: len(package) - node.level + 1] if node.level else []
            prefix = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{prefix}.{alias.name}") for alias in node.names)


def import_violations(tree: ast.AST, module: str) -> Iterator[tuple[int, str]]:
    room = room_of(module)
    for line, name in imported_names(tree, module):
        top, _, rest = name.partition(".")
        if top == PACKAGE:
            complaint = own_violation(module, room, rest)
        elif top in sys.stdlib_module_names:
            complaint = None
        elif module in (CHECKER, *CHECKER_PARTS) or top not in THIRD_PARTY.get(room, set()):
            complaint = f"third-party package {top} is not allowed in {room}"
        elif top in ONLY_IN and not module.startswith(ONLY_IN[top]):
            complaint = f"third-party package {top} is allowed in {' and '.join(ONLY_IN[top])} only"
        else:
            complaint = None
        if complaint:
            yield line, complaint


def own_violation(module: str, room: str, target: str) -> str | None:
    """Why ``module`` may not import ``target`` (dotted, without the package), or None."""
    if target == "__version__":  # plain text that is there as soon as any module is
        return None
    goal = room_of(target) or "__init__"
    if goal not in FLOORS:
        goal = "__init__"  # a name of the facade, not a room
    if module == CHECKER:
        return f"the checker imports nothing of the package, yet it imports {goal}"
    others = tuple(f"{other}." for other in CHECKER_PARTS.get(module, ()))
    if others and not f"{target}.".startswith(others):
        return f"a part of the checker imports nothing of the package but the checker, yet it imports {target}"
    if goal == room or (goal in GROUND and room in GROUND):
        return None
    if room in TRUSTED and goal not in TRUSTED:
        return f"{room} is trusted and {goal} is not"
    if FLOORS[goal] >= FLOORS[room]:
        return f"{room} (floor {FLOORS[room]}) must not import {goal} (floor {FLOORS[goal]})"
    return None


def word_violations(tree: ast.AST, module: str) -> Iterator[tuple[int, str]]:
    """Asserts, bare excepts, star imports, print, and whatever runs text as code."""
    forbidden = FORBIDDEN_NAMES - ({"import_module"} if module == "__init__" else set())  # PEP 562
    words = BUILTINS | forbidden
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            yield node.lineno, "assert: raise an error instead, python -O removes asserts"
        elif isinstance(node, ast.ExceptHandler) and node.type is None:
            yield node.lineno, "bare except"
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in words:
            yield node.lineno, f"{node.id} is forbidden"
        elif isinstance(node, ast.Attribute) and node.attr in forbidden:
            yield node.lineno, f"{node.attr} is forbidden"
        elif isinstance(node, ast.Attribute) and node.attr in BUILTINS and is_named(node.value, "builtins"):
            yield node.lineno, f"builtins.{node.attr} is forbidden"
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if alias.name == "*":
                    yield node.lineno, "star import"
                elif alias.name in forbidden or (node.module == "builtins" and alias.name in BUILTINS):
                    yield node.lineno, f"{alias.name} is forbidden"


def is_named(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def violations(source: str, module: str) -> list[str]:
    """Everything wrong with the source of a module of the package, as "module:line: what"."""
    if room_of(module) not in FLOORS:
        return [f"{module}: {room_of(module)} has no floor; add it here and in docs/architecture.md"]
    tree = ast.parse(source)
    found = [*import_violations(tree, module), *word_violations(tree, module)]
    return [f"{module}:{line}: {what}" for line, what in sorted(found)]


def test_every_module_keeps_to_its_floor_its_packages_and_the_house_rules():
    found = [line for path in SOURCES for line in violations(path.read_text("utf-8"), module_name(path))]
    assert not found, "\n".join(found)


def test_there_are_sources_to_look_at():
    assert len(SOURCES) > 20


def test_the_checker_is_short_enough_to_be_read():
    for name in ("checker.py", "region_checker.py", "quadratic_checker.py", "groups_checker.py"):
        lines = (ROOT / PACKAGE / "certificate" / name).read_text("utf-8").splitlines()
        assert len(lines) < CHECKER_LINES
        assert max(len(line) for line in lines) <= 120


def test_no_room_is_named_after_a_standard_module():
    names = {room_of(module_name(path)) for path in SOURCES}
    assert not names & sys.stdlib_module_names


def test_the_floors_are_those_of_the_architecture_page():
    """The table in docs/architecture.md, read by its first two columns."""
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \| ([^|]*) \|", page, flags=re.MULTILINE)
    floors = {
        name.removesuffix("/").removesuffix(".py"): int(floor)
        for floor, rooms in rows
        for name in re.findall(r"`([^`]+)`", rooms)
    }
    assert floors == {room: floor for room, floor in FLOORS.items() if room != "__init__"}


def test_the_packages_named_in_pyproject_are_those_on_disk():
    """A package that is not named would be missing from the wheel without a word."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    folders = {path.parent.relative_to(ROOT) for path in SOURCES}
    assert set(project["tool"]["setuptools"]["packages"]) == {".".join(folder.parts) for folder in folders}


@pytest.mark.parametrize(
    ("module", "source", "complaint"),
    [
        ("exact.matrix", "from dobc_design.spec.problem import Problem", "must not import spec|spec is"),
        ("design.observer", "import dobc_design.verify.check", "must not import verify"),
        ("model.model", "from dobc_design import theorems", "must not import theorems"),
        ("spec.file", "def f():\n    from dobc_design.model import model", "spec is trusted and model"),
        ("verify.check", "from dobc_design.model.model import build_model", "verify is trusted and model"),
        ("verify.check", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import cvxpy", "cvxpy"),
        ("exact.__init__", "from ..spec import problem", "must not import spec|spec is"),
        ("analysis.graph", "from ..design.dense import solve", "must not import design"),
        ("report.html", "from ... import anything", "must not import __init__"),
        ("report.html", "import dobc_design as dd", "must not import __init__"),
        ("workflow", "from dobc_design import certify", "must not import __init__"),
        ("verdict", "import latex2mathml", "latex2mathml is not allowed in verdict"),
        ("workflow", "import numpy.linalg", "numpy is not allowed in workflow"),
        ("spec.problem", "import pydantic", "allowed in spec.file and spec.schema only"),
        ("certificate.checker", "from dobc_design.exact import matrix", "imports nothing of the package"),
        ("certificate.checker", "import numpy", "numpy is not allowed"),
        ("certificate.region_checker", "import flint", "flint is not allowed"),
        ("certificate.region_checker", "from dobc_design.theorems.lure import Lure", "but the checker"),
        ("certificate.region_checker", "from dobc_design.certificate.checkers import need", "but the checker"),
        ("certificate.region_checker", "from .quadratic_checker import inside", "but the checker"),
        ("certificate.quadratic_checker", "from dobc_design.theorems.staging import Stage", "but the checker"),
        ("certificate.quadratic_checker", "import numpy", "numpy is not allowed"),
        ("cellar", "import math", "cellar has no floor"),
        ("cli", "def f(x):\n    assert x", "cli:2: assert"),
        ("cli", "print('hello')", "print is forbidden"),
        ("cli", "show = print", "print is forbidden"),
        ("cli", "try:\n    pass\nexcept:\n    pass", "bare except"),
        ("cli", "from math import *", "star import"),
        ("model.symbolic", "from sympy import sympify", "sympify is forbidden"),
        ("model.symbolic", "import sympy\nsympy.sympify('x')", "sympify is forbidden"),
        ("spec.parser", "eval('1')", "eval is forbidden"),
        ("spec.parser", "import builtins\nbuiltins.exec('1')", "builtins.exec is forbidden"),
        ("spec.parser", "from builtins import exec as run", "exec is forbidden"),
        ("workflow", "import importlib\nimportlib.import_module('x')", "import_module is forbidden"),
    ],
)
def test_a_violating_module_is_found_out(module: str, source: str, complaint: str):
    found = violations(source, module)
    assert len(found) >= 1
    assert re.search(complaint, "\n".join(found))


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("_checks", "from dobc_design.errors import ShapeError"),
        ("_render", "def f():\n    from latex2mathml.converter import convert"),
        ("exact.matrix", "from . import number\nfrom .number import zero\nfrom ..errors import ShapeError"),
        ("exact.__init__", "from .matrix import matrix"),
        ("spec.schema", "import pydantic, re\nre.compile('x')"),
        ("certificate.certificate", "from dobc_design.verify.check import Check"),
        ("certificate.region_checker", "import math\nfrom .checker import need"),
        ("certificate.quadratic_checker", "from .checker import need\nfrom .region_checker import times"),
        ("cli", "from dobc_design import __version__, workflow\nimport typer\ntyper.echo('x')"),
        ("__init__", "from importlib import import_module\nimport_module('dobc_design.workflow')"),
    ],
)
def test_a_proper_module_is_left_in_peace(module: str, source: str):
    assert violations(source, module) == []
