"""The journal of a sweep: one line of JSON per finished case, on the disk before the next one is counted.

A folder holds sweep.json, which says what is swept, and results.jsonl, to which lines are appended.  A kill at any
moment loses at most the line that was being written: a torn last line is cut off, and its case is done again.  Lines
that cannot be read, or that belong to no case, count as not done.  One process at a time works on a folder.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.errors import CertificateError, SpecError
from dobc_design.sweeps.case import Outcome, to_be_done_again
from dobc_design.sweeps.plan import Plan

HEAD, LINES = "sweep.json", "results.jsonl"
FIELDS = ("case", "id", "values", "result", "error", "seconds")


class Journal:
    """An open journal; ``done`` holds the lines of cases by number, those from earlier runs included.

    Use it as a context: it is locked until it is left.  Raises: SpecError for a folder of another sweep, or one at
    which another process is at work; CertificateError when the machine refuses.
    """

    def __init__(self, folder: Path, plan: Plan, *, anew: bool = False) -> None:
        self.folder, self.plan = folder, plan
        self.done: dict[int, Outcome] = {}
        self._stream: IO[bytes] | None = None
        self._open(anew=anew)

    def _open(self, *, anew: bool) -> None:
        make_folder(self.folder)
        head, lines = self.folder / HEAD, self.folder / LINES
        if not anew:
            _check_head(head, lines, self.plan)
        try:
            self._stream = open(lines, "ab+")  # noqa: SIM115 - closed by __exit__
            _lock(self._stream, self.folder)
            if anew:
                self._stream.truncate(0)
            text = json.dumps(self.plan.document | {"sha256": self.plan.sha256}, indent=2, ensure_ascii=False)
            write_atomically(head, f"{text}\n".encode())
            self._read()
        except OSError as error:
            self.close()
            raise _refused(lines, error) from error
        except SpecError:
            self.close()
            raise

    def _read(self) -> None:
        stream = self._opened
        stream.seek(0)
        data = stream.read()
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            stream.truncate(whole)
        self.done = read_lines(data[:whole], self.plan)

    def append(self, line: Outcome) -> None:
        """Write the line of one case down to the disk.  A second line of a case is dropped."""
        if line["case"] in self.done:
            return
        try:
            self._opened.write(json.dumps(line, ensure_ascii=False, allow_nan=False).encode("utf-8") + b"\n")
            self._opened.flush()
            os.fsync(self._opened.fileno())
        except OSError as error:
            raise _refused(self.folder / LINES, error) from error
        self.done[line["case"]] = line

    @property
    def _opened(self) -> IO[bytes]:
        if self._stream is None:
            raise CertificateError("the journal is closed.", key=str(self.folder))
        return self._stream

    def close(self) -> None:
        """Close the file, which also unlocks it."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_lines(data: bytes, plan: Plan) -> dict[int, Outcome]:
    """The lines of a journal that belong to cases of the plan, by number; of several for a case the first.

    A line that says a case was given up for its time yields to a later one.
    """
    done: dict[int, Outcome] = {}
    for text in data.split(b"\n"):
        try:
            line = json.loads(text.decode("utf-8"))
        except (UnicodeDecodeError, ValueError, RecursionError):
            continue
        if not isinstance(line, dict) or set(line) != set(FIELDS):
            continue
        number = line["case"]
        if type(number) is not int or not 0 <= number < len(plan) or line["values"] != list(plan.case(number).values):
            continue
        if number not in done or to_be_done_again(done[number], None):
            done[number] = line
    return done


def _check_head(head: Path, lines: Path, plan: Plan) -> None:
    """Refuse a folder that holds another sweep, or lines of which nobody knows what they are about."""
    if not head.exists():
        if lines.exists() and lines.stat().st_size:
            raise SpecError(
                f"{str(head.parent)!r} holds {LINES} without {HEAD}, which says what it is about.",
                key="--out",
                cure="Choose another folder, or add --force to begin anew there.",
            )
        return
    try:
        found: Any = json.loads(head.read_bytes().decode("utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError):
        found = None
    wanted = {**plan.document, "sha256": plan.sha256}
    if isinstance(found, Mapping) and {**found} == wanted:  # all of it, so that a change by hand is not overwritten
        return
    raise SpecError(
        f"{str(head.parent)!r} was made for another sweep{_difference(found, plan)}.",
        key="--out",
        cure="Choose another folder with --out, or add --force to begin anew there.",
    )


def _difference(found: Any, plan: Plan) -> str:
    """What is not the same, in a few words."""
    if not isinstance(found, Mapping):
        return ""
    names = [name for name, value in plan.document.items() if found.get(name) != value]
    words = {
        "problem": "problem",
        "problem_sha256": "problem",
        "axes": "choice of values",
        "samples": "number of samples",
        "seed": "seed",
        "task": "task",
        "made_by": "version of dobc_design",
    }
    differing = list(dict.fromkeys(words[name] for name in names if name in words))
    return f", with another {' and another '.join(differing[:2])}" if differing else ""


def _lock(stream: IO[bytes], folder: Path) -> None:
    """Let one process at a time work here.  The system unlocks a file when its process ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows: two drivers at once would do cases twice, and lose none
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise SpecError(
            f"another process is at work on the sweep in {str(folder)!r}.",
            key="--out",
            cure="Wait for it, or choose another folder with --out.",
        ) from None


def _refused(path: Path, error: OSError) -> CertificateError:
    return CertificateError(
        f"{path.name} cannot be written: {error.strerror or error}.",
        key=str(path),
        cure="What is there is kept: make room, or check the permissions, and run the same command again.",
    )
