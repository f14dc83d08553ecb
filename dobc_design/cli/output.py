"""What all commands share: standard output and error, exit codes, progress, and files that are not overwritten.

Results go to standard output, everything else to standard error.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dobc_design._signals import answer_begins
from dobc_design.errors import CertificateError, DobcError, SpecError

if TYPE_CHECKING:
    from rich.console import Console

EXIT = {"proved": 0, "refuted": 1, "undecided": 3}
MISTAKE, MACHINE, INTERRUPTED = 2, 4, 130
COLOURS = {"proved": "bold green", "refuted": "bold red", "undecided": "bold yellow"}
WIDE = 120  # columns from which reasons stand beside the verdicts
PIPED = 160  # columns of output that no terminal limits
LONGEST_FOLDER = 60  # characters of a problem's name that go into its folder's; file systems take 255 bytes


class Manner(Enum):
    """How much a command says: --quiet, nothing, --verbose."""

    QUIET, NORMAL, VERBOSE = "quiet", "normal", "verbose"


def manner_of(*, quiet: bool, verbose: bool) -> Manner:
    """The manner that the two options ask for.  Raises: SpecError for both of them."""
    if quiet and verbose:
        raise SpecError("--quiet and --verbose exclude each other.", key="--quiet", cure="Leave one of them out.")
    return Manner.QUIET if quiet else Manner.VERBOSE if verbose else Manner.NORMAL


class NoOutput(Exception):
    """Standard output cannot be written; the text says why."""


@contextmanager
def answering() -> Iterator[None]:
    """Wrap what writes to standard output."""
    answer_begins()
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise NoOutput(error.strerror or str(error)) from error
    except SystemExit as error:  # rich's way of saying that nobody reads it
        raise NoOutput("nobody reads it") from error


def say(text: str) -> None:
    """Write a line, or several, to standard output."""
    with answering():
        typer.echo(text)


def print_json(document: Any) -> None:
    """The one document of --json, on standard output."""
    say(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))


def complain(text: str) -> None:
    """Write to standard error; control characters become escapes."""
    from dobc_design._show.text import visible

    try:
        typer.echo("\n".join(visible(line) for line in text.split("\n")), err=True)
    except (OSError, ValueError):  # full or closed: the exit code still says it
        return


def fail_with(error: DobcError, code: int, *, as_json: bool) -> int:
    """Say an error of the toolbox, or all that it consists of, and return the exit code."""
    parts = error.errors if isinstance(error, SpecError) else (error,)
    first = parts[0]
    if as_json:
        body: dict[str, Any] = {"kind": first.kind, "key": first.key, "message": first.message, "cure": first.cure}
        if len(parts) > 1:
            body["all"] = [
                {"kind": each.kind, "key": each.key, "message": each.message, "cure": each.cure} for each in parts
            ]
        print_json({"error": body})
        return code
    for each in parts:
        complain(f"error: {each.message}" + (f"\n       {each.cure}" if each.cure else ""))
    if len(parts) > 1:
        complain(f"{len(parts)} errors; nothing was written.")
    return code


def fail_as(kind: str, key: str | None, message: str, cure: str | None, code: int, *, as_json: bool) -> int:
    """Say what went wrong and return the exit code."""
    if as_json:
        print_json({"error": {"kind": kind, "key": key, "message": message, "cure": cure}})
    else:
        complain(f"error: {message}" + (f"\n       {cure}" if cure else ""))
    return code


def make_console() -> Console:
    """Standard output; as wide as the terminal, or wide enough for tables where there is none."""
    from rich.console import Console

    limited = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if limited else PIPED, highlight=False)


def folder_name(name: str) -> str:
    """A problem's name as one folder name: letters and digits, with dots, dashes and underscores between them."""
    text = "".join(c if c.isalnum() or c in "._-" else "-" for c in name).lstrip("._-")
    return text[:LONGEST_FOLDER] or "problem"


def results_folder(out: Path | None, name: str) -> Path:
    """The folder for certificate, problem and report: ``out``, else ./NAME-certificate.  Raises: SpecError."""
    folder = out if out is not None else Path(f"{folder_name(name)}-certificate")
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nowhere counts
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    return folder


def refuse_option(path: Path, *, key: str) -> None:
    """Refuse an option that was taken for the value of another one, as in ``--out --json``."""
    if str(path).startswith("--"):
        raise SpecError(f"{key} needs a value before {str(path)!r}.", key=key, cure=f"A path of that name is ./{path}.")


def check_target(path: Path, *, force: bool, key: str) -> None:
    """Refuse a file that is there already, unless ``force``.  Raises: SpecError."""
    refuse_option(path, key=key)
    if path.is_dir():
        raise SpecError(f"{str(path)!r} is a folder.", key=key, cure="Name a file in it.")
    if path.exists() and not force:
        raise SpecError(f"{str(path)!r} exists already.", key=key, cure="Add --force to replace it.")


def write_file(path: Path, data: bytes, *, key: str) -> None:
    """Write a file whole.  Raises: CertificateError that names the option ``key``."""
    from dobc_design.certificate.files import write_atomically

    try:
        write_atomically(path, data)
    except CertificateError as error:
        raise CertificateError(error.message, key=key, cure="Choose another place.") from error


def read_certificate(certificate: Path) -> bytes:
    """The bytes of a certificate, given as the file or as its folder.  Raises: SpecError."""
    from dobc_design.certificate.text import MAX_BYTES
    from dobc_design.problem.toml_text import read_bytes

    path = certificate / "certificate.json" if certificate.is_dir() else certificate
    try:
        return read_bytes(path, limit=MAX_BYTES, what="certificate")
    except SpecError as error:
        raise SpecError(error.message, key="certificate", cure=error.cure) from error


class Progress:
    """Names the current stage on standard error: on a terminal as a line that changes, silent elsewhere.

    ``Manner.VERBOSE``: every stage as a line of its own with the seconds so far, wherever standard error goes;
    ``Manner.QUIET``: nothing.
    """

    def __init__(self, manner: Manner = Manner.NORMAL) -> None:
        self.manner = manner
        self.status: Any = None
        self.said = ""
        self.began = time.monotonic()

    def __enter__(self) -> Callable[[str], None]:
        if self.manner is Manner.NORMAL and sys.stderr is not None and sys.stderr.isatty():
            from rich.console import Console

            self.status = Console(stderr=True).status("starting")
            self.status.start()
        return self.stage

    def stage(self, name: str) -> None:
        """Show a stage."""
        if self.status is not None:
            self.status.update(name)
        elif self.manner is Manner.VERBOSE and name != self.said:
            self.said = name
            complain(f"{time.monotonic() - self.began:8.1f} s  {name}")

    def __exit__(self, *error: object) -> None:
        if self.status is not None:
            self.status.stop()
