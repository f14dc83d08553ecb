"""Command lines that nobody should write: every command and option, with values and files that do
not fit.

Each must end with an exit code of the contract; a mistake is said in errors, or as one JSON
document, and leaves nothing behind.  Every command runs in a folder of its own, in this process,
through the entry of the command line.
"""

import contextlib
import io
import json
import shlex
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from bad_files import listing
from evidence.row import Row
from typer.main import get_command

from dobc_design.cli.main import app, main

PROBLEM = """name = "two"
target = {}
[network]
agents = 2
arrow = "listens_to"
modes = {{ Ga = [[1, 2], [2, 1]] }}
[coupling]
h = "2*y"
[pinning]
gains = {{ 1 = {} }}
[exosystem]
A = [[0, 1], [-1, 0]]
C = [[1, 0]]
[simulation]
t_final = 0.5
"""
VALUES = (
    ("good", "1.0", 2),
    ("huge", "1e400", 2),
    ("big", "1e300", "1e300"),
    ("nan", "nan", "-0.0"),
    ("ü ☃", "-0", 2e-300),
)
FILES = {f"{name}.toml": PROBLEM.format(target, gain).encode() for name, target, gain in VALUES} | {
    "empty.toml": b"",
    "binary.toml": bytes(range(256)),
    "deep.json": b"[" * 100_000,
    "start.csv": b"1,2\n3,inf\n",
    "binary.npz": b"PK\x03\x04" + bytes(range(256)),
    "case.m": b"mpc.bus = [1 2",
}
GOOD = ["good.toml", "big.toml", "ü ☃.toml", "cert/problem.json"]
MADE = ["cert", "cert/certificate.json"]
PATHS = [
    *FILES,
    "missing.toml",
    ".",
    "/dev/null",
    "a\x1b[31m\nb.toml",
    "x" * 300 + ".toml",
    "",
    "--json",
    "-",
]
NEW = [
    "new.toml",
    "new",
    "new.fmu",
    "new.dat-s",
    "new.py",
    "new.v",
    "nowhere/new.toml",
    "good.toml/new",
    "new.pdf",
]
NUMBERS = [
    "3",
    "0.5",
    "1",
    "2",
    "0",
    "-1",
    "-0",
    "1e400",
    "1e300",
    "1e-300",
    "nan",
    "-inf",
    "1000000000",
    "1/3",
    "1/0",
]
HOSTILE = [
    "9" * 5000,
    "٣",
    "0x10",
    "1e",
    "[bold]",
    "",
    "\u202e\x07",
    "😀" * 50,
    "{0}%s",
    *PATHS,
    *NUMBERS,
]
AXES = [
    "target=1:2:2",
    "pinning.gains.1=~uniform(0,1)",
    "target=1:1e400:3",
    "target=1:2:1000000000",
    "coupling.h=y,exp(y",
]
AXES += ["target=nan,1", "nobody=1", "simulation.seed=1:3:3", "simulation.t_final=1,1e300"]
FITS = {
    "axes": AXES,
    "certificate": MADE,
    "certificates": MADE,
    "problem": GOOD,
    "file": GOOD,
    "start": ["start.csv"],
}
FITS |= {
    "mode": ["Ga"],
    "fail": ["2@0.1", "1@nan:freeze"],
    "theorem": ["lemma1"],
    "task": ["simulate", "certify"],
}
FITS |= {
    "id": ["theorem1"],
    "name": ["two"],
    "observer": ["off", "full-loop"],
    "source": ["case.m", "start.csv"],
}
FITS |= {
    "arrow": ["listens_to"],
    "allowed": ["1,2"],
    "precision": ["float"],
    "agent": ["1"],
    "cluster": ["nowhere:1"],
}
FITS |= dict.fromkeys(
    ("out", "canonical", "apply_fix", "c", "fmu", "sdpa", "python_control", "rocq", "pdf", "latex"),
    NEW,
)
SECONDS = 60
# kinds of errors with exit code 4: a place that cannot be written
WRITTEN = ("io", "certificate", "export")


class TooLongError(BaseException):
    """Nothing that the program may catch."""


def lines(count: int, seed: int) -> Iterator[list[str]]:
    """Command after command, each with some of its options, at times twice; one value in four is
    hostile."""
    commands: dict[str, Any] = get_command(app).commands  # type: ignore[attr-defined]
    names = [name for name in commands for _ in range(min(5, len(commands[name].params)))]
    for random, name in (
        (Random(seed * 100_000 + place), names[place % len(names)]) for place in range(count)
    ):
        options = [
            each
            for each in commands[name].params
            if each.param_type_name == "option" and each.name != "help"
        ]
        chosen = [
            each for each in commands[name].params if each.required and random.random() < 0.97
        ]
        words = [name]
        for each in [*chosen, *random.choices(options, k=random.choice([0, 1, 2, 2, 3, 5]))]:
            words += [random.choice([*each.opts, *each.secondary_opts])] if each in options else []
            if each not in options or not each.is_flag:
                fits = FITS.get(each.name, NUMBERS)
                words.append(random.choice(random.choice([fits, fits, fits, HOSTILE])))
        yield words + (["--json"] if random.random() < 0.3 else [])


def run(count: int, seed: int) -> Row:
    """So many command lines."""
    codes = Counter[int]()
    failures = list[str]()
    with tempfile.TemporaryDirectory() as name:
        made = Path(name, "made")
        made.mkdir()
        for path, data in FILES.items():
            (made / path).write_bytes(data)
        answer(["certify", "good.toml", "--out", "cert"], made)
        for place, words in enumerate(lines(count, seed)):
            folder = shutil.copytree(made, Path(name, str(place)))
            code, wrong = examined(words, folder)
            codes[code] += 1
            failures += [f"{shlex.join(words)}: {wrong}"] if wrong else []
    what = "hostile command lines: exit codes of the contract, clear errors, nothing half written"
    return Row(
        what, count, failures, [f"exit code {code}: {codes[code]}" for code in sorted(codes)]
    )


def answer(words: list[str], folder: Path) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command, -1 where it takes too long."""

    def stop(number: int, frame: object) -> None:
        raise TooLongError

    out = io.StringIO()
    errors = io.StringIO()
    code = -1
    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SECONDS)
    try:
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(errors),
        ):
            main(words)
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else -1
    except TooLongError:
        errors.write(f"not done in {SECONDS} s")
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return code, out.getvalue(), errors.getvalue()


def examined(words: list[str], folder: Path) -> tuple[int, str]:
    """The exit code, and what is wrong with the answer, "" if nothing."""
    before = listing(folder)
    code, out, errors = answer(words, folder)
    failed = code in (2, 4)
    said = f"exit code {code}, {out[-300:]!r}, {errors[-600:]!r}"
    if (
        code not in (0, 1, 2, 3, 4)
        or "Traceback" in out + errors
        or "Internal error" in out + errors
    ):
        return code, said
    if "--json" in words and (out or failed):  # it may have been taken for a value
        try:
            document = json.loads(out)
        except ValueError:
            return code, f"no single JSON document: {said}"
        if failed != ("error" in document) or (
            code == 4 and document["error"]["kind"] not in WRITTEN
        ):
            return code, said
    elif failed and (out or "error: " not in errors or (code == 4 and "written" not in errors)):
        return code, said
    changed = set(listing(folder)) ^ set(before) if failed else ()
    return code, f"changed: {changed}, {said}" if changed else ""
