"""The journal of a sweep: one line of JSON per finished case, on the disk before the next one is counted.

A folder holds sweep.json, which says what is swept, and results.jsonl, to which lines are appended.  A kill at any
moment loses at most the line that was being written: a torn last line is cut off, and its case is done again.  Lines
that cannot be read, or that belong to no case, count as not done.  One process at a time works on a folder.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import IO, Any

from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.errors import CertificateError, SpecError
from dobc_design.sweeps.plan import Plan

Outcome = dict[str, Any]  # a line: what is kept of a case
HEAD, LINES = "sweep.json", "results.jsonl"
FIELDS = {"case", "id", "values", "result", "error", "seconds"}
TIME = "time"  # kind of error of a case that was given up


class Journal:
    """An open journal; ``done`` holds the lines of cases by number, those from earlier runs included.

    Use it as a context: the folder is locked until it is left; without a folder nothing is written.
    Raises: SpecError for a folder of another sweep, or one at which another process is at work; CertificateError when
    the machine refuses.
    """

    def __init__(self, folder: Path | None, plan: Plan, *, anew: bool = False) -> None:
        self.folder, self.plan = folder, plan
        self.done: dict[int, Outcome] = {}
        self.stream: IO[bytes] | None = None
        if folder is None:
            return
        make_folder(folder)
        if not anew:
            _require_same(folder, plan)
        try:
            self.stream = open(folder / LINES, "ab+")  # noqa: SIM115 - closed by __exit__
            _lock(self.stream, folder)
            if anew:
                self.stream.truncate(0)
            head = json.dumps(plan.document | {"sha256": plan.sha256}, indent=2, ensure_ascii=False)
            write_atomically(folder / HEAD, f"{head}\n".encode())
            self.stream.seek(0)
            data = self.stream.read()
            whole = data.rfind(b"\n") + 1
            if whole < len(data):
                self.stream.truncate(whole)
            self._read(data[:whole])
        except OSError as error:
            self.__exit__()
            raise self._refused(error) from error
        except SpecError:
            self.__exit__()
            raise

    def _read(self, data: bytes) -> None:
        """Take the lines that belong to cases of the plan; of several for a case the first that was not given up."""
        for text in data.split(b"\n"):
            try:
                line = json.loads(text.decode("utf-8"))
            except (ValueError, RecursionError):
                continue
            if not isinstance(line, dict) or set(line) != FIELDS or type(line["case"]) is not int:
                continue
            case = line["case"]
            if not 0 <= case < len(self.plan) or line["values"] != list(self.plan.values(case)):
                continue
            if case not in self.done or to_be_done_again(self.done[case], None):
                self.done[case] = line

    @property
    def lines(self) -> tuple[Outcome, ...]:
        """The lines in the order of the cases."""
        return tuple(self.done[case] for case in sorted(self.done))

    def append(self, line: Outcome) -> None:
        """Keep the line of one case, written down to the disk."""
        if self.stream is not None:
            try:
                self.stream.write(json.dumps(line, ensure_ascii=False, allow_nan=False).encode("utf-8") + b"\n")
                self.stream.flush()
                os.fsync(self.stream.fileno())
            except OSError as error:
                raise self._refused(error) from error
        self.done[line["case"]] = line

    def _refused(self, error: OSError) -> CertificateError:
        message = f"{LINES} cannot be written: {error.strerror or error}."
        cure = "What is there is kept: make room, or check the permissions, and run the same command again."
        return CertificateError(message, key=f"{self.folder}/{LINES}", cure=cure)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *error: object) -> None:
        if self.stream is not None:
            self.stream.close()  # which also unlocks it


def to_be_done_again(line: Outcome, limit: float | None) -> bool:
    """Whether a case was given up for its time, and would get more of it now."""
    given_up = line["error"] is not None and line["error"].get("kind") == TIME
    return given_up and (limit is None or limit > line["seconds"])


def _require_same(folder: Path, plan: Plan) -> None:
    """Refuse a folder that holds another sweep, or lines of which nobody knows what they are about."""
    head, lines = folder / HEAD, folder / LINES
    if not head.exists():
        if lines.exists() and lines.stat().st_size:
            message = f"{str(folder)!r} holds {LINES} without {HEAD}, which says what it is about."
            raise SpecError(message, key="--out", cure="Choose another folder, or add --force to begin anew there.")
        return
    try:
        found: Any = json.loads(head.read_bytes().decode("utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if found == plan.document | {"sha256": plan.sha256}:  # all of it, so that a change by hand is not overwritten
        return
    words = {
        "problem": "problem",
        "problem_sha256": "problem",
        "axes": "choice of values",
        "samples": "number of samples",
        "seed": "seed",
        "task": "task",
        "made_by": "version of dobc_design",
    }
    known = found if isinstance(found, dict) else plan.document
    other = dict.fromkeys(f" another {word}" for name, word in words.items() if known.get(name) != plan.document[name])
    message = f"{str(folder)!r} was made for another sweep{', with' if other else ''}{' and'.join([*other][:2])}."
    raise SpecError(message, key="--out", cure="Choose another folder with --out, or add --force to begin anew there.")


def _lock(stream: IO[bytes], folder: Path) -> None:
    """Let one process at a time work here.  The system unlocks a file when its process ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows: two drivers at once would do cases twice, and lose none
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        message = f"another process is at work on the sweep in {str(folder)!r}."
        raise SpecError(message, key="--out", cure="Wait for it, or choose another folder with --out.") from None
