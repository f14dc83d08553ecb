"""Single changes to trusted code, chosen by a seed: does a fast test notice?

For each change only those fast tests run whose coverage touches its line.  What they cover is
collected once for the same sources and kept in a temporary folder.  Changes that nothing can or
need notice stand in ``harmless.txt`` with the reason; any other that stays unnoticed is a failure.
No maintained tool was found that draws a seeded sample, swaps ``any`` and ``all`` or ``lo`` and
``hi``, and goes by coverage (mutmut 3.8, cosmic-ray 8.7). As a script: ``mutation.py --count 300
--seed 7 --workers 1``.
"""

import argparse
import ast
import hashlib
import itertools
import logging
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from random import Random

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from certified import FRESH
from coverage import CoverageData
from evidence.row import Row

ROOT = Path(__file__).resolve().parents[2]
HARMLESS = Path(__file__).with_name("harmless.txt")
ROOMS = (
    "exact",
    "coupling",
    "problem",
    "loop",
    "certificate",
    "conditions",
    "certification",
    "checker",
)
TRUSTED = (
    *(
        f"{room}/*.py"
        for room in ("exact", "coupling", "problem", "loop", "certificate", "checker")
    ),
    *(
        f"conditions/*/{name}.py"
        for name in ("claim", "decide", "checks", "large", "network", "sectors", "timing", "rows")
    ),
    *(f"certification/{name}.py" for name in ("overall", "recheck")),
)
SECONDS = 30.0  # of tests for one change, as long as they took under coverage
HANGS = 120.0  # seconds
PYTEST = ("-m", "pytest", "-q", "--benchmark-disable", "-p", "no:cacheprovider")

LOCAL = ("i j", "lo hi", "lower upper")  # swapped if both names exist there
OTHERS = "any all|min max|floor ceil|round_up round_down|lower_bound upper_bound|PROVED UNDECIDED"
NAMES = {
    a: b for pair in (*LOCAL, *OTHERS.split("|")) for a, b in (pair.split(), pair.split()[::-1])
}
NAMES["REFUTED"] = "PROVED"
SIGNS = "< <=|> >=|== !=|+ -|and or|in not in|is is not"
SWAPPED = {
    a: b
    for pair in SIGNS.split("|")
    for a, b in (pair.split(maxsplit=1), pair.split(maxsplit=1)[::-1])
}
SIGN = re.compile(rb"not in|is not|[<>=!]=|[+-]|\b(?:and|or|in|is)\b|(?<![<>])[<>](?![<>])")
CONSTANTS = {0: ("1",), 1: ("0", "2"), 2: ("1",)}


@dataclass(frozen=True, order=True)
class Change:
    """``old`` becomes ``new`` at byte ``start``; ``lines`` are those of the smallest statement
    around it."""

    file: str
    start: int
    old: str
    new: str
    lines: tuple[int, ...] = field(compare=False)

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.new.encode() + source[self.start + len(self.old) :]

    @property
    def room(self) -> str:
        return str(Path(self.file).parent).replace("dobc_design", "tests", 1)

    def __str__(self) -> str:
        source = (ROOT / self.file).read_bytes()
        text = self.applied(source).decode().split("\n")[source.count(b"\n", 0, self.start)]
        return f"{self.file.removeprefix('dobc_design/')}: {text.strip()}"


def changes(file: str) -> Iterator[Change]:
    """Every change of one file, but for texts, annotations and what is raised."""
    source = (ROOT / file).read_bytes()
    starts = [0]
    for text in source.split(b"\n"):
        starts.append(starts[-1] + len(text) + 1)

    def span(node: ast.expr) -> tuple[int, int]:
        return starts[node.lineno - 1] + node.col_offset, starts[
            node.end_lineno - 1
        ] + node.end_col_offset

    def swaps(node: ast.AST, names: set[str]) -> Iterator[tuple[int, str, str]]:
        operands = {
            ast.BinOp: ("left", "right"),
            ast.Compare: ("left", "comparators"),
            ast.BoolOp: ("values",),
        }
        parts = [getattr(node, name) for name in operands.get(type(node), ())]
        row = [each for part in parts for each in (part if isinstance(part, list) else [part])]
        for left, right in itertools.pairwise(row):
            if found := SIGN.search(source, span(left)[1], span(right)[0]):
                yield found.start(), found[0].decode(), SWAPPED[found[0].decode()]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
            yield span(node)[0], "-" if isinstance(node.op, ast.USub) else "not ", ""
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in NAMES:
            if NAMES[node.id] in names or not any(node.id in pair.split() for pair in LOCAL):
                yield span(node)[0], node.id, NAMES[node.id]
        elif isinstance(node, ast.Attribute) and node.attr in NAMES:
            yield span(node)[1] - len(node.attr), node.attr, NAMES[node.attr]
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            for new in CONSTANTS.get(node.value, ()):
                yield span(node)[0], str(node.value), new

    def walk(node: ast.AST, lines: tuple[int, ...], names: set[str]) -> Iterator[Change]:
        if isinstance(node, (ast.JoinedStr, ast.Raise, ast.Import, ast.ImportFrom)):
            return
        if isinstance(node, ast.FunctionDef):
            names = {getattr(each, "id", getattr(each, "arg", None)) for each in ast.walk(node)}
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            lines = tuple(range(node.lineno, body[0].lineno if body else node.end_lineno + 1))
        yield from (Change(file, *swap, lines) for swap in swaps(node, names))
        for name, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and name not in ("annotation", "returns"):
                    yield from walk(child, lines, names)

    yield from walk(ast.parse(source), (), set())


class Tests:
    """Which fast tests touch a line, and how long each takes."""

    def __init__(self, folder: Path) -> None:
        self.data = CoverageData(str(folder / "coverage"))
        self.data.read()
        self.seconds: dict[str, float] = {}
        for text in (folder / "log").read_text("utf-8").splitlines():
            if found := re.match(r"([\d.]+)s (?:call|setup|teardown) +(.+)", text):
                self.seconds[found[2]] = self.seconds.get(found[2], 0) + float(found[1])

    def of(self, change: Change) -> list[str]:
        """Those of the same room first, short ones first, within SECONDS."""
        every = self.data.contexts_by_lineno(change.file)
        touched = {name for line in change.lines for name in every.get(line, ()) if name}
        # it runs at import
        touched = touched or {name for names in every.values() for name in names}
        names = {name.rpartition("|")[0] for name in touched} & self.seconds.keys()
        left, chosen = SECONDS, []
        for name in sorted(
            names, key=lambda each: (not each.startswith(change.room), self.seconds[each], each)
        ):
            left -= self.seconds[name]
            if left > 0:
                chosen.append(name)
        return chosen


def copied(folder: Path) -> Path:
    """The sources, compiled so that a changed file is noticed by its content: its time and size may
    stay the same."""
    ignored = shutil.ignore_patterns(".git", ".venv", "__pycache__", "_build", ".*_cache")
    shutil.copytree(ROOT, folder, ignore=ignored)
    command = (
        "-m",
        "compileall",
        "-q",
        "--invalidation-mode",
        "checked-hash",
        "dobc_design",
        "tests",
    )
    subprocess.run((sys.executable, *command), cwd=folder, check=False)
    return folder


def pytest(
    copy: Path, *arguments: str, timeout: float | None = None, **more: str
) -> subprocess.CompletedProcess[str]:
    environment = (
        os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1", "CI": "1"} | more
    )
    command = (sys.executable, *PYTEST, *arguments)
    output = {"capture_output": True, "text": True}
    return subprocess.run(
        command, cwd=copy, env=environment, timeout=timeout, check=False, **output
    )


def collected() -> Tests:
    """What the fast tests of the trusted rooms cover: kept for as long as the sources are the
    same."""
    folders = ("dobc_design", "tests/support", *(f"tests/{each}" for each in ROOMS))
    digest = hashlib.sha256()
    for path in sorted(path for each in folders for path in (ROOT / each).rglob("*.py")):
        digest.update(path.read_bytes())
    folder = Path(tempfile.gettempdir()) / f"dobc-mutation-{digest.hexdigest()[:16]}"
    if not (folder / "log").exists():
        shutil.rmtree(folder, ignore_errors=True)
        copy = copied(folder / "copy")
        rc = folder / "rc"
        rc.write_text(
            "[run]\nsource = dobc_design\nrelative_files = true\ndata_file = "
            f"{folder / 'coverage'}\n",
            "utf-8",
        )
        options = (
            "--cov",
            f"--cov-config={rc}",
            "--cov-context=test",
            "--cov-report=",
            "-vv",
            "--durations=0",
        )
        tests = [f"tests/{each}" for each in ROOMS]
        ran = pytest(copy, *options, "--durations-min=0", *tests, **{FRESH: "1"})
        if ran.returncode:
            raise RuntimeError(f"the unchanged sources fail:\n{ran.stdout[-3000:]}")
        shutil.rmtree(copy)
        (folder / "log").write_text(ran.stdout, "utf-8")
    return Tests(folder)


def notices(copy: Path, change: Change, tests: list[str]) -> bool:
    """Do the tests that cover it fail?  One that hangs has noticed too."""
    path = copy / change.file
    wanted = copy / "wanted"
    before = path.read_bytes()
    wanted.write_text("\n".join(tests), "utf-8")
    path.write_bytes(change.applied(before))
    try:
        return bool(tests) and pytest(copy, "-x", f"@{wanted}", timeout=HANGS).returncode != 0
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_bytes(before)


def run(count: int, seed: int, workers: int | None = None) -> Row:
    """``count`` changes, each as likely as any other in the trusted files."""
    files = sorted(
        {
            str(path.relative_to(ROOT))
            for each in TRUSTED
            for path in (ROOT / "dobc_design").glob(each)
        }
    )
    every = sorted({change for file in files for change in changes(file)})
    known = {
        text for text in HARMLESS.read_text("utf-8").splitlines() if not text.startswith((" ", "#"))
    }
    fresh = [change for change in Random(seed).sample(every, count) if str(change) not in known]
    tests = collected()
    copies = SimpleQueue()
    chosen = {change: tests.of(change) for change in fresh}
    workers = workers or os.cpu_count() or 1

    def survives(change: Change) -> bool:
        copy = copies.get()
        noticed = notices(copy, change, chosen[change])
        copies.put(copy)
        logging.info("%s  %s", "noticed " if noticed else "SURVIVES", change)
        return not noticed

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        for number in range(workers):
            copies.put(copied(Path(folder) / str(number)))
        failures = [
            str(change)
            for change, alive in zip(fresh, pool.map(survives, fresh), strict=True)
            if alive
        ]
    gone = len(known - set(map(str, every)))  # their lines read differently now
    notes = [
        f"{len(every)} changes in {len(files)} files; {count - len(fresh)} of those drawn "
        "are listed as harmless"
    ]
    notes += [f"{gone} listed changes no longer exist: bring harmless.txt up to date"] * (gone > 0)
    return Row("single changes of trusted code: a fast test notices", count, failures, notes)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Seeded single changes to trusted code.")
    for name in ("count", "seed", "workers"):
        parser.add_argument(f"--{name}", type=int, required=name != "workers")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    row = run(**vars(parser.parse_args()))
    logging.info("%d changes, %d survive; %s", row.count, len(row.failures), row.notes[0])
