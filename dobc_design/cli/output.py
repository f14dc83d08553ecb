"""What all commands share: options, standard output (results) and error (the rest), exit codes,
progress, files."""

from __future__ import annotations

import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, echo

from dobc_design._files import own_table
from dobc_design._show.progress import Bar
from dobc_design._signals import answer_begins
from dobc_design.errors import CertificateError, DobcError, SpecError, refused

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

    from dobc_design.certificate.claims import Claims
    from dobc_design.conditions.schedule.settling import Settling
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.problem.problem import Problem
    from dobc_design.report import document as doc

EXIT = {"proved": 0, "refuted": 1, "undecided": 3}
MISTAKE, MACHINE, INTERRUPTED = 2, 4, 130
NOT_READ = 141  # 128 + SIGPIPE, as of other programs
COLOURS = {"proved": "bold green", "refuted": "bold red", "undecided": "bold yellow"}
PIPED = 160  # columns of output that no terminal limits
# characters of a problem's name that go into its folder's; file systems take 255 bytes
LONGEST_FOLDER = 60


def problem_names(incomplete: str) -> list[str]:
    """What the shell offers for a problem: built-in ones, problem files, and folders on the way to
    them."""
    from dobc_design.problem.load import builtin_names

    found = sorted(name for name in builtin_names() if name.startswith(incomplete))
    folder, _, beginning = incomplete.rpartition("/")
    head = f"{folder}/" if "/" in incomplete else ""
    try:
        entries = sorted(os.scandir(head or "."), key=lambda entry: entry.name)
    except OSError:
        return found
    for entry in entries:
        # Hidden files are no problems that somebody looks for.
        if not entry.name.startswith(beginning) or entry.name.startswith("."):
            continue
        if entry.is_dir():
            found.append(f"{head}{entry.name}/")
        elif entry.name.endswith((".toml", ".json")):
            found.append(f"{head}{entry.name}")
    return found


def ids(incomplete: str) -> list[str]:
    """What the shell offers for the id of a condition."""
    from dobc_design.conditions.kinds import KINDS

    return [name for name in KINDS if name.startswith(incomplete)]


Stage = Callable[[str], None]  # told of every stage of long work
Document = dict[str, Any]  # what --json prints
#: What help says of every option, and what it is called.
_SAID: Document = own_table("cli/options.toml")
_COMPLETED = {"file": problem_names, "id": ids, "theorem": ids}


def described(command: Callable[..., None]) -> Callable[..., None]:
    """The command as typer reads it: with what ``options.toml`` says of its parameters, and in
    place of every parameter that is a frozen dataclass its fields.

    Only what such groups check by themselves can fail when they are made, and a SpecError is then
    told as one of the command.
    """
    groups: dict[str, Any] = {}
    options: list[Parameter] = []
    for name, parameter in signature(command, eval_str=True).parameters.items():
        noun: type[Any] = parameter.annotation
        if is_dataclass(noun):
            groups[name] = noun
            file = noun.__module__.rpartition(".")[2]
            for each in signature(noun, eval_str=True).parameters.values():
                options.append(_described(each, file))
        else:
            options.append(_described(parameter, command.__name__))

    def run(**given: Any) -> None:
        for name, noun in groups.items():
            own = {each.name: given.pop(each.name) for each in fields(noun)}
            given[name] = noun(**own)
        command(**given)

    run.__name__ = command.__name__
    run.__doc__ = command.__doc__
    run.__module__ = command.__module__
    run.__annotations__ = {each.name: each.annotation for each in options}
    # what inspect, and so typer, looks for
    run.__signature__ = Signature(options)  # type: ignore[attr-defined]
    return run


def _described(parameter: Parameter, owner: str) -> Parameter:
    """A parameter of a command, or of the file that has a group of them, with what help says."""
    name, own = parameter.name, parameter.annotation
    completed = None if own is bool else _COMPLETED.get(name)
    said = _said("options", owner, name)
    if said is None:
        info: Any = Argument(**_said("arguments", owner, name), autocompletion=completed)
    else:
        info = Option(*_flags(name), **said, autocompletion=completed)
    return parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=Annotated[own, info])


def _flags(name: str) -> list[str]:
    found: list[str] = _SAID["flags"].get(name, [f"--{name.replace('_', '-')}"])
    return found


def _said(kind: str, owner: str, name: str) -> Any:
    tables = _SAID[kind]
    return tables.get(owner, {}).get(name) or tables["every"].get(name)


class NoOutput(Exception):
    """Standard output cannot be written; the text says why."""


class NobodyReads(NoOutput):
    """Whoever read standard output has stopped, as in ``dobc problems | head -1``; there is nothing
    to be said."""


@contextmanager
def naming_options(owner: str) -> Iterator[None]:
    """Let errors about arguments name the options of a command, or of a file that has a group of
    them."""

    def named(error: SpecError) -> SpecError:
        key = error.key
        # Errors about keys of the problem file keep their names.
        if key is None or not (key in _SAID["flags"] or _said("options", owner, key)):
            return error
        return refused(_flags(key)[0], error.message.replace(key, _flags(key)[0], 1), error.cure)

    try:
        yield
    except SpecError as error:
        raise SpecError.several([named(each) for each in error.errors]) from error.__cause__


@contextmanager
def answering() -> Iterator[None]:
    """Wrap what writes to standard output."""
    # From here on an error must not put a second document on standard output.
    answer_begins()
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError as error:
        raise NobodyReads from error
    except OSError as error:
        raise NoOutput(error.strerror or str(error)) from error
    except SystemExit as error:  # rich's way of saying so
        raise NobodyReads from error


def say(text: str) -> None:
    """Write a line, or several, to standard output."""
    with answering():
        echo(text)


def print_json(document: Any) -> None:
    """The one document of --json, on standard output."""
    say(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))


def json_bytes(document: Any) -> bytes:
    """A document as a file."""
    return (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode("utf-8")


def complain(text: str) -> None:
    """Write to standard error; control characters become escapes."""
    from dobc_design._show.text import visible

    try:
        echo("\n".join(visible(line) for line in text.split("\n")), err=True)
    except (OSError, ValueError):  # full or closed: the exit code still says it
        return


def fail(error: DobcError, code: int, *, as_json: bool) -> int:
    """Say what went wrong, an error or all that it consists of, and return the exit code."""
    parts = error.errors if isinstance(error, SpecError) else (error,)
    if as_json:
        bodies = [
            {"kind": each.kind, "key": each.key, "message": each.message, "cure": each.cure}
            for each in parts
        ]
        more = {"all": bodies} if len(bodies) > 1 else {}
        # One object, as for a single error; all of them stand beside it.
        print_json({"error": bodies[0] | more})
        return code
    for each in parts:
        cure = f"\n       {each.cure}" if each.cure else ""
        complain(f"error: {each.message}{cure}")
    if len(parts) > 1:
        complain(f"{len(parts)} errors; nothing was written.")
    return code


def make_console() -> Console:
    """Standard output; as wide as the terminal, or wide enough for tables where there is none."""
    from rich.console import Console

    # In a pipe a line is a line, however long, so that grep and diff work.
    limited = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if limited else PIPED, highlight=False)


def show(parts: Iterable[RenderableType], *, wrapped: bool = False) -> None:
    """Write parts of an answer to standard output; a str as it is, the rest ``wrapped`` also where
    no terminal is."""
    from rich.text import Text

    console = make_console()
    with answering():
        for part in parts:
            if isinstance(part, str):
                console.print(Text(part), soft_wrap=True)
            else:
                console.print(part, soft_wrap=console.width == PIPED and not wrapped)


class Progress:
    """Names the current stage on standard error: on a terminal as a line that changes, silent
    elsewhere. ``verbose``: every stage as a line of its own with the seconds so far, wherever
    standard error goes; ``quiet``: nothing.  Raises: SpecError for both."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        if quiet and verbose:
            raise refused(
                "--quiet", "--quiet and --verbose exclude each other.", "Leave one of them out."
            )
        self.quiet, self.verbose = quiet, verbose
        self.moving: Bar | None = None  # where standard error is a terminal
        self.said: object = ""
        self.began = time.monotonic()

    def __enter__(self) -> Callable[[Any], None]:
        if not (self.quiet or self.verbose) and sys.stderr is not None and sys.stderr.isatty():
            self.moving = Bar()
            self.moving.moving.start()
        return self.stage

    def stage(self, name: Any) -> None:
        """Show a stage."""
        if self.moving is not None:
            self.moving(name)
        elif self.verbose and name != self.said:
            self.said = name
            complain(f"{time.monotonic() - self.began:8.1f} s  {name}")

    def __exit__(self, *error: object) -> None:
        if self.moving is not None:
            self.moving.moving.stop()


def remark_lines(problem: Problem) -> Iterator[Text]:
    """What the problem means, and what looks like a slip in it, said before any verdict."""
    from rich.text import Text

    from dobc_design.description.words import meaning_lines

    for line in meaning_lines(problem):
        head, _, words = line.partition(": ")
        yield Text.assemble((f"{head}: ", "bold"), words)
    yield Text("")


def verdict_line(name: str, verdict: str, reason: str) -> Text:
    """The first line of an answer: the problem, the verdict, why."""
    from rich.text import Text

    head = Text(f"{name}: ", style="bold").append(verdict.upper(), style=COLOURS[verdict])
    return head.append(f". {reason[:1].upper()}{reason[1:]}", style="not bold")


def verdict_text(verdict: str) -> Text:
    """A verdict in a table, in its colour."""
    from rich.text import Text

    return Text(verdict, style=COLOURS[verdict])


def certify_it(path: str, notes: Sequence[str], *options: str) -> str:
    """What to do with a problem that was written to ``path``; with these ``options`` of certify."""
    command = shlex.join(["dobc", "certify", path, *" ".join(options).split()])
    lines = [path, f"certify it   {command}"]
    if notes:
        lines.append("look at      its notes: they are unchanged and may describe the old problem")
    return "\n".join(lines)


def make_table(heads: Iterable[str]) -> Table:
    """A table without a frame."""
    from rich.table import Table

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for head in heads:
        table.add_column(head, overflow="fold")  # a cut number would be another number
    return table


def document_table(table: doc.Table, leave_out: Collection[str] = ()) -> Table:
    """A table of a report as Markdown has it, without these columns and those in which nothing
    stands."""
    from rich.text import Text

    from dobc_design.report.document import Mark
    from dobc_design.report.region_words import NONE

    kept = []
    for k, column in enumerate(table.columns):
        wanted = "markdown" in column.only and column.head not in leave_out
        if wanted and any(row[k] != NONE for row in table.rows):
            kept.append(k)
    # Columns that are left out of the heads have to be left out of the rows, too.
    shown = make_table(table.columns[k].head for k in kept)
    for row in table.rows:
        cells = []
        for k in kept:
            cell = row[k]
            text = verdict_text(cell.verdict) if isinstance(cell, Mark) else Text(str(cell))
            cells.append(text)
        shown.add_row(*cells)
    return shown


def settling_parts(settling: Settling | None) -> Iterator[RenderableType]:
    """What proves the settling time, as a table; nothing without a proved one."""
    from rich.text import Text

    from dobc_design.report.region_words import settling_sentence, stages_table

    if settling is None or settling.time is None:
        return
    yield Text(f"\n{settling_sentence(settling)}\n")
    yield document_table(stages_table(settling))


def search_parts(searches: Sequence[Falsification]) -> Iterator[RenderableType]:
    """Every search: what was tried, what is suspect, what is proved."""
    from rich.text import Text

    from dobc_design.report.document import List, Table, plain
    from dobc_design.report.document import Text as Paragraph
    from dobc_design.report.region_words import search_sections

    for section in search_sections(searches):
        yield Text(f"\n{section.title}", style="bold")
        for place, block in enumerate(section.blocks):
            match block:
                case Paragraph(words) if place == 0:
                    yield Text(plain(words))
                case Paragraph(words):
                    yield Text(f"\n{plain(words)}", style="dim")
                case List(items):
                    yield from (Text(plain(item)) for item in items)
                case Table():
                    yield from (Text(""), document_table(block))


def folder_name(name: str) -> str:
    """A problem's name as one folder name: letters and digits, with dots, dashes and underscores
    between them."""
    # A dot or a dash in front would hide the folder, or make it an option.
    text = "".join(c if c.isalnum() or c in "._-" else "-" for c in name).lstrip("._-")
    return text[:LONGEST_FOLDER] or "problem"


def results_folder(out: Path | None, name: str, *, suffix: str = "certificate") -> Path:
    """The folder for what is found: ``out``, else ./NAME-SUFFIX.  Raises: SpecError."""
    return require_folder(out or Path(f"{folder_name(name)}-{suffix}"))


def certificate_folder(out: Path | None, problem: Problem, *, force: bool) -> Path:
    """The folder for a certificate; that of another problem only with ``force``."""
    from dobc_design.certificate.files import require_own

    name = problem.name
    return require_own(results_folder(out, name), name, force=force)


def require_folder(folder: Path, *, key: str = "--out") -> Path:
    """Refuse a folder that is something else already, or an option.  Raises: SpecError."""
    refuse_option(folder, key)
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nowhere counts
        raise refused(key, f"{str(folder)!r} is not a folder.", f"Choose another with {key}.")
    return folder


def require_free(
    folder: Path, names: Iterable[str], *, force: bool, key: str = "--out", other: str = ""
) -> None:
    """Refuse a folder that holds one of these files already, unless ``force``; ``other``: what else
    would help."""
    there = next((name for name in names if (folder / name).exists()), None)
    if there is not None and not force:
        raise refused(
            key, f"{str(folder / there)!r} exists already.", f"Add --force to replace it{other}."
        )


def refuse_option(path: Path | None, key: str) -> None:
    """Refuse an option that was taken for the value of another one, as in ``--out --json``."""
    if path is not None and str(path).startswith("--"):
        raise refused(
            key, f"{key} needs a value before {str(path)!r}.", f"A path of that name is ./{path}."
        )


def check_target(path: Path, *, force: bool, key: str) -> None:
    """Refuse a file that is there already, unless ``force``.  Raises: SpecError."""
    refuse_option(path, key)
    if path.is_dir():
        raise refused(key, f"{str(path)!r} is a folder.", "Name a file in it.")
    require_free(path.parent, [path.name], force=force, key=key)


def require_suffix(path: Path, suffix: str, *, key: str) -> None:
    """Refuse a file to be written that does not end in ``suffix``.  Raises: SpecError."""
    if path.suffix.lower() != suffix:
        raise refused(
            key,
            f"{key} must name a {suffix} file; got {str(path)!r}.",
            f"For example {path.with_suffix(suffix).name}.",
        )


def write_file(path: Path, data: bytes, *, key: str) -> None:
    """Write a file whole.  Raises: CertificateError that names the option ``key``."""
    from dobc_design.certificate.files import write_atomically

    try:
        write_atomically(path, data)
    except CertificateError as error:
        raise CertificateError(error.message, key=key, cure="Choose another place.") from error


def load_problem(file: str) -> Problem:
    """A problem file, or a built-in problem by its name; agents with measured outputs have an
    observer."""
    from dobc_design.problem.load import load_problem as load

    problem = load(file)
    if problem.outputs is None:
        return problem
    from dobc_design.conditions.observer.propose import with_observer

    return with_observer(problem)


def read_claims(certificate: Path, problem: Problem | None = None) -> Claims:
    """The claims of a certificate; with ``problem`` only if every one of them, decided again, holds
    for it.  Raises: SpecError also where it cannot be read: what was handed in is wrong."""
    from dobc_design.certificate import text
    from dobc_design.certification.certify import verify

    try:
        claims = text.read_claims(read_certificate(certificate))
    except CertificateError as error:
        raise refused(error.key, error.message, error.cure) from error
    if problem is not None and not verify(claims, problem).holds:
        raise refused(
            "--certificate",
            "--certificate must be a valid certificate of this problem; this one is not.",
            "`dobc verify` says why; `dobc certify` makes a new one.",
        )
    return claims


def read_certificate(certificate: Path) -> bytes:
    """The bytes of a certificate, given as the file or as its folder.  Raises: SpecError."""
    from dobc_design.certificate.text import MAX_BYTES
    from dobc_design.problem.load import read_bytes

    path = certificate / "certificate.json" if certificate.is_dir() else certificate
    try:
        return read_bytes(path, limit=MAX_BYTES, what="certificate")
    except SpecError as error:
        raise refused("certificate", error.message, error.cure) from error
