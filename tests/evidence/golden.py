"""Record what the program gives for some 300 problem files, and compare two recordings.

    golden.py record OUT             a folder for each problem of ``golden_problems.py``, into OUT
    golden.py compare BASE NEW       name what differs, with its first lines; then exit code 1
    golden.py check BASE --every 5   record every fifth in a temporary folder and compare with BASE

It is for changes that must not change an answer, not one byte of it: record the last commit before
them, then check every step.  The program that is recorded is the one that ``PYTHONPATH`` finds, so
that this file can record older commits:

    git worktree add ../before COMMIT
    PYTHONPATH=../before python tests/evidence/golden.py record ../golden
    PYTHONPATH=. python tests/evidence/golden.py check ../golden --only 'dynamics-*'

Only the command line is asked.  What may differ between two runs of the same answer (the temporary
folder, the version of the program, and with it the fingerprint of a certificate) is replaced by a
word.  No command has a time limit, so that nothing depends on the clock.  A recording is about one
machine and one set of installed packages: solvers propose other numbers elsewhere.
"""

import argparse
import difflib
import fnmatch
import hashlib
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from evidence.golden_problems import Input, inputs, text_of

# Threads of linear algebra would wait for each other, and hashes of text order sets.
SETTINGS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
#: Files of results that are recorded; numbers and fingerprints in them are the program's.
TEXTS = {
    ".json",
    ".md",
    ".html",
    ".toml",
    ".c",
    ".h",
    ".py",
    ".v",
    ".dat-s",
    ".txt",
    ".tex",
    ".bib",
}
FOLDER, VERSION, FINGERPRINT = "<folder>", "<version>", "<sha256 of certificate.json>"
SHOWN_LINES, SHOWN_WIDTH, SHOWN_FILES = 8, 150, 40


# ---- Recording -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Command:
    """A command of the program, without ``dobc``; ``name`` is that of the files that hold what it
    says."""

    name: str
    arguments: tuple[str, ...]


def commands(each: Input) -> Iterator[Command]:
    """What is asked about a problem: all are checked and certified, their claims are verified; of
    the other commands each problem gets a share."""
    source, result = each.source, "certificate"
    yield Command("check", ("check", source))
    yield Command("check-json", ("check", source, "--json"))
    yield Command("certify", ("certify", source, "--out", result, "--json", *each.options))
    if each.kind == "malformed":
        return
    yield Command("verify", ("verify", result, "--problem", source))
    yield Command("verify-json", ("verify", result, "--problem", source, "--json"))
    if each.kind == "large" or each.long:
        return
    if each.kind == "thorough":
        yield from thorough(each)
        return
    small = each.kind != "builtin"
    k = each.number
    short = ("--t-final", "2", "--runs", "2")
    if not small or k % 3 == 0:
        yield Command("design", ("design", source, "--out", "designed.toml", "--json"))
    if not small or k % 3 == 1:
        yield Command(
            "certify-text", ("certify", source, "--out", "again", "--no-report", *each.options)
        )
        yield Command("export-c", ("export", source, "--c", "controller", "--period", "1/100"))
        yield Command("export-control", ("export", source, "--python-control", "loop.py"))
    if not small or k % 3 == 2:
        yield Command("simulate", ("simulate", source, *short, "--json"))
        yield Command("simulate-text", ("simulate", source, *short, "--certificate", result))
        yield Command(
            "simulate-full",
            ("simulate", source, "--t-final", "1", "--observer", "full-loop", "--json"),
        )
    if not small or k % 6 == 4:
        yield Command("stress", ("stress", source, "--worst", "--t-final", "2", "--json"))
        yield Command(
            "stress-held", ("stress", source, "--period", "0.01", "--t-final", "1", "--json")
        )
    if not small or k % 6 == 5:
        yield Command("region", ("region", source, "--out", "starts", "--json"))
        yield Command("export-sdpa", ("export", source, "--sdpa", "lmi.dat-s"))


def thorough(each: Input) -> Iterator[Command]:
    """What a share of the problems is not asked, because it takes long or says much."""
    source, result = each.source, "certificate"
    latex = ("--latex", "latex", "--full", "--json")
    yield Command("report", ("report", result, "--out", "pages", *latex))
    yield Command("certify-all", ("certify", source, "--out", "all", "--all", "--json"))
    yield Command("compare", ("report", result, "all", "--out", "two"))
    yield Command("region-text", ("region", source, "--out", "starts", "--all"))
    yield Command("design-text", ("design", source, "--out", "designed.toml"))
    yield Command("design-rate", ("design", source, "--out", "a.toml", "--rate", "1/10", "--json"))
    yield Command("design-coupling", ("design", source, "--out", "b.toml", "--coupling", "--json"))
    yield Command("simulate-out", ("simulate", source, "--t-final", "1", "--out", "runs"))
    noisy = ("--noise", "0.01", "--saturation", "2", "--loss", "0.1")
    yield Command("stress-noise", ("stress", source, *noisy, "--t-final", "1", "--json"))
    yield Command("export-fmu", ("export", source, "--fmu", "agent.fmu", "--period", "1/100"))
    yield Command("export-rocq", ("export", result, "--rocq", "motions.v"))
    yield Command("export-theorem", ("export", result, "--rocq", "theorem.v", "--theorem"))
    yield Command("canonical", ("check", source, "--canonical", "canonical.json"))


EXPLAINED = (
    "observability",
    "detectability",
    "hurwitz",
    "reachability",
    "lemma1",
    "theorem1",
    "theorem1-printed",
    "theorem1-weighted",
    "theorem2",
    "theorem2-printed",
    "theorem2-weighted",
    "linearisation",
    "max-separable",
    "delay",
    "sampling",
    "tolerance",
    "actuators",
    "lure",
    "equilibrium",
    "schedule",
    "markov",
    "safety",
    "settling",
    "accuracy",
    "nonsense",
)


def told() -> Iterator[Command]:
    """What the program says without a problem."""
    yield Command("help", ("--help",))
    yield Command("problems", ("problems",))
    yield Command("schema", ("schema",))
    yield Command("explain", ("explain",))
    for id in EXPLAINED:
        yield Command(f"explain-{id}", ("explain", id))
        yield Command(f"explain-{id}-json", ("explain", id, "--json"))


@dataclass
class Recording:
    """What commands said, and the exit code of each; everything as it is written into the folder of
    a problem."""

    folder: Path
    codes: list[str] = field(default_factory=list)

    def run(self, command: Command) -> None:
        out, error = (self.folder / f"{command.name}.{kind}" for kind in ("out", "err"))
        with (
            out.open("w", encoding="utf-8") as said,
            error.open("w", encoding="utf-8") as complained,
        ):
            code = exit_code(command.arguments, said, complained)
        self.codes.append(f"{code} {' '.join(command.arguments)}\n")
        if not error.stat().st_size:
            error.unlink()

    def finish(self) -> None:
        (self.folder / "exit-codes.txt").write_text("".join(self.codes), encoding="utf-8")


def exit_code(arguments: Iterable[str], said: object, complained: object) -> object:
    """Run ``dobc`` here with these streams."""
    from dobc_design.__main__ import main

    before = sys.argv, sys.stdout, sys.stderr
    sys.argv, sys.stdout, sys.stderr = ["dobc", *arguments], said, complained  # type: ignore[assignment]
    try:
        main()
    except SystemExit as ended:
        return ended.code
    finally:
        sys.argv, sys.stdout, sys.stderr = before
    return "none"


@dataclass(frozen=True)
class Task:
    """A problem to be recorded, below this folder."""

    each: Input | None  # None: what the program says without a problem
    out: Path
    version: str

    @property
    def name(self) -> str:
        return "told" if self.each is None else self.each.name


@dataclass(frozen=True)
class Recorded:
    """``seconds``: of processor time; ``outcome``: the verdict, or the exit code of ``certify``."""

    name: str
    kind: str
    seconds: float
    outcome: str


def record_one(task: Task) -> Recorded:
    started = time.process_time()
    with working_folder() as folder:
        recording = Recording(folder)
        if task.each is not None:
            write_input(task.each, folder)
        for command in told() if task.each is None else commands(task.each):
            recording.run(command)
        recording.finish()
        outcome = outcome_of(folder)
        keep(folder, task.out / task.name, version=task.version)
    kind = task.name if task.each is None else task.each.kind
    return Recorded(task.name, kind, time.process_time() - started, outcome)


def write_input(each: Input, folder: Path) -> None:
    if each.text:
        (folder / "problem.toml").write_text(each.text, encoding="utf-8")
    for name, written in each.files.items():
        (folder / name).write_text(written(), encoding="utf-8")


@contextmanager
def working_folder() -> Iterator[Path]:
    """A temporary folder, in which the program runs."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="golden-") as name:
        os.chdir(name)
        try:
            yield Path(name).resolve()
        finally:
            os.chdir(before)


def outcome_of(folder: Path) -> str:
    """The verdict in certificate.json, else the exit code of ``certify``."""
    path = folder / "certificate" / "certificate.json"
    if path.exists():
        found = re.search(
            r'"verdict": "(\w+)"\s*}?\s*$|^  ?"verdict": "(\w+)"',
            path.read_text("utf-8"),
            re.MULTILINE,
        )
        if found:
            return found.group(1) or found.group(2)
    codes = (folder / "exit-codes.txt").read_text("utf-8").splitlines()
    return next((f"exit {line.split()[0]}" for line in codes if " certify " in line), "-")


def keep(folder: Path, target: Path, *, version: str) -> None:
    """Copy what was written, in words that do not vary; of pictures and archives only what they are
    called."""
    named = re.compile(rf'(dobc\\?_design |"version": "|Version ){re.escape(version)}')
    certificates = folder.rglob("certificate.json")
    fingerprints = [hashlib.sha256(path.read_bytes()).hexdigest() for path in certificates]

    def steady(text: str) -> str:
        text = named.sub(rf"\1{VERSION}", text.replace(str(folder), FOLDER))
        for fingerprint in fingerprints:
            text = text.replace(fingerprint, FINGERPRINT)
        return text

    if target.exists():
        shutil.rmtree(target)
    target.mkdir(parents=True)
    names = []
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if path.is_dir() or relative.name == "arcs.csv":
            continue
        names.append(f"{relative}\n")
        if path.suffix in TEXTS or path.suffix in (".out", ".err"):
            place = target / relative
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(steady(path.read_text("utf-8")), encoding="utf-8")
    (target / "files.txt").write_text("".join(names), encoding="utf-8")


def record(out: Path, *, chosen: "Choice", jobs: int) -> list[str]:
    """Record the chosen problems and return their names.

    Each has a process of its own, forked from one that has imported the program, so that none knows
    what another has left behind.
    """
    version = warmed_up()
    tasks = [Task(each, out, version) for each in chosen.inputs()]
    out.mkdir(parents=True, exist_ok=True)
    counts: dict[str, Counter[str]] = {}
    total = 0.0
    done = 0
    began = time.monotonic()
    context = multiprocessing.get_context("fork")
    with context.Pool(jobs, maxtasksperchild=1) as pool:
        for found in pool.imap_unordered(record_one, tasks, chunksize=1):
            done += 1
            total += found.seconds
            counts.setdefault(found.kind, Counter())[found.outcome] += 1
            place = f"{done:>4} of {len(tasks)}  {found.seconds:6.1f} s"
            print(f"{place}  {found.outcome:<10} {found.name}", file=sys.stderr, flush=True)
    print_table(counts)
    print(
        f"{len(tasks)} recorded, {total:.0f} s of processor time, {time.monotonic() - began:.0f} s",
        flush=True,
    )
    return [task.name for task in tasks]


def warmed_up() -> str:
    """The version, after everything has been imported that a process needs."""
    with working_folder() as folder:
        (folder / "small.toml").write_text(text_of("one-agent", 1), encoding="utf-8")
        recording = Recording(folder)
        recording.run(Command("version", ("--version",)))
        recording.run(Command("certify", ("certify", "small.toml", "--out", "a")))
        recording.run(Command("verify", ("verify", "a", "--problem", "small.toml")))
        return (folder / "version.out").read_text("utf-8").split()[-1]


def print_table(kinds: dict[str, Counter[str]]) -> None:
    """How often each kind is proved, refuted, left open or refused."""
    columns = sorted({outcome for counts in kinds.values() for outcome in counts})
    whole: Counter[str] = Counter()
    print(f"{'kind':<26}{'count':>6}" + "".join(f"{each:>11}" for each in columns))
    for kind, counts in sorted(kinds.items()):
        whole.update(counts)
        print(
            f"{kind:<26}{counts.total():>6}"
            + "".join(f"{counts[each] or '':>11}" for each in columns)
        )
    print(f"{'all':<26}{whole.total():>6}" + "".join(f"{whole[each]:>11}" for each in columns))


# ---- Comparing -----------------------------------------------------------------------------------


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def differences(base: Path, new: Path, names: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    """Every file of these problems that differs, with the first lines in which it does."""
    for name in names:
        old = files_of(base / name)
        now = files_of(new / name)
        if not old:
            yield name, ["is not recorded in BASE"]
            continue
        for each in sorted(old - now):
            yield f"{name}/{each}", ["is in BASE only"]
        for each in sorted(now - old):
            yield f"{name}/{each}", ["is in NEW only"]
        for each in sorted(old & now):
            before, after = (folder / name / each for folder in (base, new))
            if before.read_bytes() != after.read_bytes():
                yield (
                    f"{name}/{each}",
                    changed_lines(before.read_text("utf-8"), after.read_text("utf-8")),
                )


def changed_lines(before: str, after: str) -> list[str]:
    """The first lines of a diff; of long lines, the place at which they part."""
    first = before.splitlines()
    second = after.splitlines()
    found = [
        line
        for line in difflib.unified_diff(first, second, lineterm="", n=0)
        if line[:3] not in ("---", "+++")
    ]
    shown = []
    for place, line in enumerate(found[:SHOWN_LINES]):
        start = 0
        follower = found[place + 1] if place + 1 < len(found) else ""
        partner = found[place - 1] if line.startswith("+") else follower
        if len(line) > SHOWN_WIDTH and partner[:1] in ("-", "+"):
            start = max(0, same_start(line[1:], partner[1:]) - SHOWN_WIDTH // 3)
        cut = line[1:][start : start + SHOWN_WIDTH]
        shown.append(line[0] + ("..." if start else "") + cut)
    if len(found) > SHOWN_LINES:
        shown.append(f"and {len(found) - SHOWN_LINES} lines more")
    return shown


def same_start(first: str, second: str) -> int:
    """How many characters they begin with in common."""
    length = min(len(first), len(second))
    return next((k for k in range(length) if first[k] != second[k]), length)


def compare(base: Path, new: Path, names: Iterable[str]) -> int:
    """Print what differs.  The exit code: 1 where anything does."""
    listed = list(names)
    count = 0
    for where, lines in differences(base, new, listed):
        count += 1
        if count <= SHOWN_FILES:
            print(where)
            print("".join(f"    {line}\n" for line in lines), end="")
    if count > SHOWN_FILES:
        print(f"and {count - SHOWN_FILES} files more")
    print(f"{len(listed)} problems compared, {count} files differ")
    return 1 if count or not listed else 0


# ---- Command line --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Choice:
    """``only``: patterns of names, any of which may match; ``every``: each K-th of those that
    match."""

    only: tuple[str, ...]
    every: int

    def inputs(self) -> list[Input | None]:
        """Those to be recorded; None stands for what is told without a problem.

        A slice has none of the long ones that it does not name.
        """
        candidates: list[Input | None] = [None, *inputs()]
        if self.only:
            candidates = [
                each for each in candidates if self._matches("told" if each is None else each.name)
            ]
        elif self.every > 1:
            candidates = [each for each in candidates if each is None or not each.long]
        return candidates[:: self.every]

    def _matches(self, name: str) -> bool:
        return any(fnmatch.fnmatchcase(name, pattern) for pattern in self.only)

    def of(self, folder: Path) -> list[str]:
        """Those recorded in a folder."""
        wanted = {"told" if each is None else each.name for each in self.inputs()}
        everything = not self.only and self.every == 1
        return sorted(path.name for path in folder.iterdir() if everything or path.name in wanted)


def check(base: Path, *, chosen: Choice, jobs: int) -> int:
    with tempfile.TemporaryDirectory(prefix="golden-new-") as name:
        names = record(Path(name), chosen=chosen, jobs=jobs)
        return compare(base, Path(name), names)


def repeated(options: argparse.Namespace) -> Callable[[], int]:
    chosen = Choice(tuple(options.only or ()), options.every)
    if options.task == "record":
        return lambda: 0 if record(options.out.resolve(), chosen=chosen, jobs=options.jobs) else 1
    if options.task == "check":
        return lambda: check(options.base.resolve(), chosen=chosen, jobs=options.jobs)
    base = options.base.resolve()
    new = options.new.resolve()
    return lambda: compare(base, new, sorted({*chosen.of(base), *chosen.of(new)}))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tasks = parser.add_subparsers(dest="task", required=True)
    for task, folders in (("record", ("out",)), ("compare", ("base", "new")), ("check", ("base",))):
        own = tasks.add_parser(task)
        for folder in folders:
            own.add_argument(folder, type=Path, metavar=folder.upper())
        own.add_argument(
            "--only",
            action="append",
            metavar="GLOB",
            help="names such as 'dynamics-*'; may be repeated",
        )
        own.add_argument(
            "--every", type=int, default=1, metavar="K", help="each K-th of these only"
        )
        if task != "compare":
            own.add_argument(
                "--jobs", type=int, default=1, metavar="N", help="processes at once; default 1"
            )
    return parser.parse_args()


def main() -> int:
    if any(os.environ.get(name) is None for name in SETTINGS):
        os.execve(sys.executable, [sys.executable, *sys.argv], {**SETTINGS, **os.environ})
    for name in ("COLUMNS", "DOBC_TRACEBACK", "FORCE_COLOR"):
        os.environ.pop(name, None)
    return repeated(arguments())()


if __name__ == "__main__":
    sys.exit(main())
