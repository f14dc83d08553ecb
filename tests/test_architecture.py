"""The rules of docs/architecture.md: no circles, what a proof may rest on, the packages of every
room, a few words.

Everything is read from the syntax trees of the sources (``tests/support/house.py``).  Every rule is
a function of a ``House``, so that the last tests can show it a house that breaks the rule.  How
large the house is, ``python tests/size.py`` prints.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator

import pytest
from house import PACKAGE, ROOT, House, circles, house_on_disk, inner_circles, room_of

# Third-party packages (import names) of every room; a room that is not here may have none.
NUMBERS, PLOTS = {"numpy", "scipy"}, {"matplotlib", "numpy"}
THIRD_PARTY = {
    "_show": {"latex2mathml", "rich"},
    "analysis": {"control", *NUMBERS},
    "certificate": {"numpy"},
    "certification": {"numpy"},
    "cli": {"packaging", "rich", "typer"},
    "conditions": NUMBERS,
    "coupling": {"numpy"},
    "description": NUMBERS,
    "designer": {"anywidget", "numpy", "traitlets"},
    "exact": {"flint", *NUMBERS},
    "export": {"control", "jinja2", "sympy", *NUMBERS},  # what is exported to
    "falsification": NUMBERS,
    "importing": NUMBERS,
    "loop": NUMBERS,
    "model": {"casadi", "sympy", *NUMBERS},
    "plotting": {"networkx", *PLOTS},
    "problem": {"networkx", "tomlkit", *NUMBERS},
    "report": {"jinja2", "typst", *PLOTS},
    "simulation": {"pandas", *NUMBERS},
    "solvers": {"clarabel", *NUMBERS},
    "sweeps": {"distributed", "joblib", "numpy", "pandas", "pyarrow"},
    "synthesis": {"cvxpy", "pandas", *NUMBERS},
}
# Packages that only some modules of their room may use.
ONLY_IN = {"typst": ("report.pdf",)}

# What a proof rests on, by name: these rooms, and in every topic these files.
TRUSTED_ROOMS = ("exact", "coupling", "problem", "loop", "certificate")
TRUSTED_FILES = (
    "claim",
    "coordinates",
    "decide",
    "checks",
    "large",
    "network",
    "sectors",
    "timing",
)
# Optional parts, and the modules that may import them, there where they are used and not before.
OPTIONAL = {
    "export.rocq": ("cli.",),
    "export.fmu": ("cli.", "export.__init__"),
    "designer": ("cli.",),
    "report.pdf": ("cli.", "report.write"),
}

# What no proof may rest on, however indirectly.
UNTRUSTED_ROOMS = ("solvers", "model", "simulation", "falsification", "synthesis")
UNTRUSTED_PACKAGES = ("casadi", "clarabel", "control", "cvxpy")

BUILTINS = {"eval", "exec", "compile", "__import__", "print"}
# Functions that run text as code or import by name, wherever they come from.
FORBIDDEN_NAMES = {"sympify", "parse_expr", "import_module"}

MOST_LOOSE = 10


def is_trusted(module: str) -> bool:
    parts = module.split(".")
    if module in ("certification.overall", "certification.recheck"):
        return True
    if parts[0] in ("conditions", "synthesis") and parts[-1] in TRUSTED_FILES:
        return True
    return parts[0] in TRUSTED_ROOMS


def untrusted(module: str) -> bool:
    parts = module.split(".")
    proposes = parts[-1] == "stage" or parts[-1].startswith("propose")
    if parts[0] == "synthesis":
        return not is_trusted(module)
    return parts[0] in UNTRUSTED_ROOMS or proposes


def trust_violations(house: House) -> Iterator[str]:
    """What a trusted module rests on and must not."""
    for module in filter(is_trusted, house.sources):
        closure = house.closure(module)
        for other in closure:
            imported = {name.partition(".")[0] for _, name in house.imports[other]}
            packages = sorted(imported & set(UNTRUSTED_PACKAGES))
            if untrusted(other) or packages:
                chain = [other]
                while closure[chain[-1]]:
                    chain.append(closure[chain[-1]])
                yield f"{module} is trusted and rests on {' <- '.join([*packages, *chain])}"


def package_violations(house: House) -> Iterator[str]:
    for module, targets in house.imports.items():
        room = module.partition(".")[0]
        for line, name in targets:
            at = f"{module}:{line}"
            top = name.partition(".")[0]
            own = top == PACKAGE
            if room == "checker" and own and not name.startswith(f"{PACKAGE}.checker."):
                yield f"{at}: the checker imports nothing of the package, yet it imports {name}"
            elif own or top in sys.stdlib_module_names:
                if house.module_of(name) == "__init__" and module != "__main__":
                    yield f"{at}: import from the room, not from the facade: {name}"
            elif top not in THIRD_PARTY.get(room, set()):
                yield f"{at}: third-party package {top} is not allowed in {room}"
            elif top in ONLY_IN and not module.startswith(ONLY_IN[top]):
                rooms = " and ".join(ONLY_IN[top])
                yield f"{at}: third-party package {top} is allowed in {rooms} only"


def optional_part(module: str | None) -> str | None:
    """The optional part that a module belongs to; None for the others."""
    for part in OPTIONAL:
        if module is not None and f"{module}.".startswith(f"{part}."):
            return part
    return None


def optional_violations(house: House) -> Iterator[str]:
    """Optional parts say what they need, and nothing else rests on them."""
    for part in OPTIONAL:
        for module in (part, f"{part}.__init__"):
            if module in house.trees:
                said = ast.get_docstring(house.trees[module]) or ""
                if "Optional: needs " not in said:
                    yield f"{module}: its docstring must say what it needs (Optional: needs ...)"
    for module, targets in house.imports.items():
        at_once = {node.lineno for node in house.trees[module].body}
        for line, name in targets:
            part = optional_part(house.module_of(name))
            if part is None or part == optional_part(module):
                continue
            if not module.startswith(OPTIONAL[part]):
                yield f"{module}:{line}: {part} is optional, and only {OPTIONAL[part]} may use it"
            elif line in at_once:
                yield f"{module}:{line}: {part} is optional: import it where it is used"


def word_violations(house: House) -> Iterator[str]:
    """Asserts, bare excepts, star imports, print, and whatever runs text as code."""
    for module, tree in house.trees.items():
        # PEP 562
        forbidden = FORBIDDEN_NAMES - ({"import_module"} if module == "__init__" else set())
        for node in ast.walk(tree):
            for what in forbidden_words(node, forbidden) if isinstance(node, JUDGED) else ():
                yield f"{module}:{getattr(node, 'lineno', 0)}: {what}"


#: The only kinds of nodes that can be forbidden.
JUDGED = (ast.Assert, ast.ExceptHandler, ast.Name, ast.Attribute, ast.ImportFrom)


def forbidden_words(node: ast.AST, forbidden: set[str]) -> Iterator[str]:
    if isinstance(node, ast.Assert):
        yield "assert: raise an error instead, python -O removes asserts"
    elif isinstance(node, ast.ExceptHandler) and node.type is None:
        yield "bare except"
    elif (
        isinstance(node, ast.Name)
        and isinstance(node.ctx, ast.Load)
        and node.id in BUILTINS | forbidden
    ):
        yield f"{node.id} is forbidden"
    elif isinstance(node, ast.Attribute) and node.attr in forbidden:
        yield f"{node.attr} is forbidden"
    elif (
        isinstance(node, ast.Attribute)
        and node.attr in BUILTINS
        and is_named(node.value, "builtins")
    ):
        yield f"builtins.{node.attr} is forbidden"
    elif isinstance(node, ast.ImportFrom):
        for alias in node.names:
            if alias.name == "*":
                yield "star import"
            elif alias.name in forbidden or (node.module == "builtins" and alias.name in BUILTINS):
                yield f"{alias.name} is forbidden"


def is_named(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


RULES = (
    circles,
    inner_circles,
    trust_violations,
    package_violations,
    optional_violations,
    word_violations,
)


@pytest.mark.parametrize("rule", RULES)
def test_the_house_keeps_the_rule(rule):
    found = list(rule(house_on_disk()))
    assert not found, "\n".join(found)


def test_few_modules_lie_loose_at_the_top_and_none_hides_a_standard_module_or_a_public_function():
    import dobc_design

    tops = {name.partition(".")[0] for name in house_on_disk().sources}
    loose = [name for name in house_on_disk().sources if "." not in name]
    assert len(loose) <= MOST_LOOSE
    assert not tops & sys.stdlib_module_names
    functions = {name for name in dobc_design.__all__ if name.islower()} - {"exact", "export"}
    assert not tops & functions


def test_every_optional_part_is_there():
    """Or the rule about it would hold of nothing."""
    sources = house_on_disk().sources
    for part in OPTIONAL:
        assert part in sources or f"{part}.__init__" in sources


def test_every_room_is_on_the_page():
    """docs/architecture.md names every room and every topic."""
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    rooms = {room_of(name).replace(".", "/") for name in house_on_disk().sources if "." in name}
    missing = [room for room in sorted(rooms) if f"`{room}/`" not in page]
    assert not missing


# A small house of one topic in which nothing is wrong; each case puts one file in, or another in
# its place.
SOUND = {
    "errors": "",
    "exact.matrix": "import flint\nfrom ..errors import ShapeError",
    "problem.problem": "from dobc_design.exact.matrix import Matrix",
    "problem.load": "import tomlkit\nfrom dobc_design.problem.problem import Problem",
    "solvers.conic": "import clarabel",
    "conditions.check": "",
    "conditions.lure.claim": "from dobc_design.problem.problem import Problem",
    "conditions.lure.decide": "from dobc_design.conditions.lure.claim import Lure\nimport numpy",
    "conditions.lure.propose": "from dobc_design.solvers.conic import solve",
    "conditions.lure.stage": "from .propose import find\nfrom .decide import decide",
    "certificate.text": "from dobc_design.conditions.check import Check",
    "certification.overall": "from dobc_design.conditions.check import Check",
    "certification.certify": "from dobc_design.conditions.lure.stage import run",
    "checker.main": "import math\nfrom dobc_design.checker.rows import row",
    "checker.rows": "",
    "cli.main": "import typer\ntyper.echo('x')\nfrom dobc_design import __version__",
    "designer.__init__": "'''A widget.  Optional: needs anywidget.'''",
    "cli.widget": "def show():\n    from dobc_design.designer import widget",
    "__init__": "from importlib import import_module\nimport_module('dobc_design.errors')",
}


def complaints(name: str, source: str) -> str:
    house = House({**SOUND, name: source})
    return "\n".join(line for rule in RULES for line in rule(house))


def test_a_sound_house_is_left_in_peace():
    assert complaints("errors", "") == ""


@pytest.mark.parametrize(
    ("module", "source", "complaint"),
    [
        (
            "conditions.lure.decide",
            "from dobc_design.conditions.lure.propose import find",
            "decide is trusted and rests",
        ),
        (
            "conditions.lure.decide",
            "def f():\n    from .propose import find",
            "decide is trusted and rests",
        ),
        ("conditions.lure.claim", "import cvxpy", "claim is trusted and rests on cvxpy"),
        (
            "conditions.check",
            "import casadi",
            "certificate.text is trusted and rests on casadi <- conditions.check",
        ),
        ("exact.matrix", "from dobc_design.solvers.conic import solve", "exact.matrix is trusted"),
        (
            "certification.overall",
            "from dobc_design.conditions.lure.stage import run",
            "overall is trusted",
        ),
        (
            "problem.problem",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import control",
            "rests on control",
        ),
        ("errors", "from dobc_design.exact.matrix import Matrix", "circle: "),
        (
            "exact.matrix",
            "from ..problem import problem",
            "circle: exact.matrix imports problem.problem",
        ),
        (
            "problem.problem",
            "def f():\n    from dobc_design.problem import load",
            "circle in problem: problem.load imports problem.problem",
        ),
        (
            "problem.problem",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .load import Problem",
            "circle in problem: problem.problem imports problem.load",
        ),
        (
            "conditions.check",
            "from dobc_design.conditions.lure.claim import Lure\nimport x",
            "third-party package x",
        ),
        ("report.pages", "import typst", "allowed in report.pdf only"),
        ("problem.problem", "import dobc_design as dd", "not from the facade"),
        ("cli.main", "from dobc_design import certify", "not from the facade"),
        ("checker.main", "from dobc_design.exact import matrix", "imports nothing of the package"),
        ("checker.rows", "import numpy", "numpy is not allowed in checker"),
        ("cli.main", "def f(x):\n    assert x", "cli.main:2: assert"),
        ("designer.__init__", "'A widget.'", "must say what it needs"),
        ("solvers.conic", "def f():\n    import dobc_design.designer", "designer is optional, and"),
        ("cli.widget", "from dobc_design.designer import x", "import it where it is used"),
        ("cli.main", "print('hello')", "print is forbidden"),
        ("cli.main", "show = print", "print is forbidden"),
        ("cli.main", "try:\n    pass\nexcept:\n    pass", "bare except"),
        ("cli.main", "from math import *", "star import"),
        ("cli.main", "import sympy\nsympy.sympify('x')", "sympify is forbidden"),
        ("problem.problem", "eval('1')", "eval is forbidden"),
        ("problem.problem", "import builtins\nbuiltins.exec('1')", "builtins.exec is forbidden"),
        ("problem.problem", "from builtins import exec as run", "exec is forbidden"),
        (
            "cli.main",
            "import importlib\nimportlib.import_module('x')",
            "import_module is forbidden",
        ),
    ],
)
def test_a_house_that_breaks_a_rule_is_found_out(module: str, source: str, complaint: str):
    assert re.search(complaint, complaints(module, source))
