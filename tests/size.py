"""How large the package and its tests are, room by room; ``python tests/size.py`` prints the table.

A token is what Python's tokenizer gives, without comments, line ends, indentation and docstrings.
A statement is a statement of the syntax tree, docstrings not counted.  Comments are the lines with
a comment for every hundred lines with code.  Wide functions have eight or more parameters.  After
the table stand the circles of imports, and the files that should know a problem only through its
Loop but name what the loop is made of.  The standard library is enough.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from house import PACKAGE, House, circles, house_on_disk, inner_circles, room_of  # noqa: E402

WIDE = 8
NOT_COUNTED = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
DOCUMENTED = (ast.Module, ast.ClassDef, *FUNCTION)

#: These rooms see what a proof is about, not the kind of network that it was made of.
PROOF_ROOMS = ("conditions", "certification", "certificate")
KINDS_OF_NETWORK = {"dynamics", "leader"}


@dataclass(frozen=True)
class Size:
    """What is counted in one module, or in all modules of a room."""

    tokens: int = 0
    statements: int = 0
    code_lines: int = 0
    comment_lines: int = 0
    wide_functions: int = 0
    modules: int = 0

    def __add__(self, other: Size) -> Size:
        return Size(
            self.tokens + other.tokens,
            self.statements + other.statements,
            self.code_lines + other.code_lines,
            self.comment_lines + other.comment_lines,
            self.wide_functions + other.wide_functions,
            self.modules + other.modules,
        )

    def row(self, name: str) -> str:
        density = self.tokens / max(self.statements, 1)
        comments = 100 * self.comment_lines / max(self.code_lines, 1)
        return (
            f"{name:32} {self.tokens:7} {density:10.1f} {comments:10.1f}"
            f" {self.modules:7} {self.wide_functions:6}"
        )


HEADER = (
    f"{'room':32} {'tokens':>7} {'/statement':>10} {'comments %':>10} {'modules':>7} {'wide':>6}"
)


def size_of(text: str) -> Size:
    """The size of one module, given as its source."""
    docstring_starts = set()
    statements = wide = 0
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt):
            statements += 1
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            docstring = node.body[0]
            docstring_starts.add((docstring.lineno, docstring.col_offset))
        if isinstance(node, FUNCTION) and parameters_of(node) >= WIDE:
            wide += 1

    tokens = 0
    code_lines: set[int] = set()
    comment_lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            comment_lines.add(token.start[0])
        if token.type in NOT_COUNTED or token.start in docstring_starts:
            continue
        tokens += 1
        code_lines.update(range(token.start[0], token.end[0] + 1))
    return Size(
        tokens=tokens,
        statements=statements - len(docstring_starts),
        code_lines=len(code_lines),
        comment_lines=len(comment_lines),
        wide_functions=wide,
        modules=1,
    )


def parameters_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    arguments = function.args
    return len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)


def rooms_of_package(house: House) -> dict[str, Size]:
    rooms: dict[str, Size] = {}
    for module, text in house.sources.items():
        room = room_of(module).replace(".", "/") if "." in module else "(top)"
        rooms[room] = rooms.get(room, Size()) + size_of(text)
    return rooms


def folders_of_tests() -> dict[str, Size]:
    tests = ROOT / "tests"
    folders: dict[str, Size] = {}
    for path in sorted(tests.rglob("*.py")):
        folder = path.parent.relative_to(ROOT).as_posix()
        folders[folder] = folders.get(folder, Size()) + size_of(path.read_text("utf-8"))
    return folders


def knows_kinds_of_network(house: House) -> Iterator[str]:
    """The modules of the proofs that name [dynamics] or a leader, with the names."""
    for module, tree in house.trees.items():
        if module.partition(".")[0] not in PROOF_ROOMS:
            continue
        names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr in KINDS_OF_NETWORK:
                names.add(f".{node.attr}")
        if names:
            yield f"{module}: {', '.join(sorted(names))}"


def table(title: str, rooms: dict[str, Size]) -> Iterator[str]:
    for name, size in sorted(rooms.items()):
        yield size.row(name)
    yield sum(rooms.values(), Size()).row(title)
    yield ""


def counted_list(title: str, found: list[str]) -> Iterator[str]:
    yield f"{title}: {len(found)}"
    for line in found:
        yield f"  {line}"


def size_of_the_house() -> Iterator[str]:
    house = house_on_disk()
    yield HEADER
    yield from table(f"ALL OF {PACKAGE}", rooms_of_package(house))
    yield from table("ALL TESTS", folders_of_tests())
    yield from counted_list("circles of rooms", list(circles(house)))
    yield from counted_list("circles of modules inside a room", list(inner_circles(house)))
    yield from counted_list(
        "files of the proofs that know [dynamics] or a leader",
        list(knows_kinds_of_network(house)),
    )


if __name__ == "__main__":
    for line in size_of_the_house():
        sys.stdout.write(line + "\n")
