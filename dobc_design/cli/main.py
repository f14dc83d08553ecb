"""dobc: the command line.  Results go to standard output, everything else to standard error.

Exit codes: 0 proved or done, 1 refuted, 3 undecided, 2 the caller's mistake, 4 the machine failed,
130 interrupted.  With --json standard output holds one JSON document and nothing else.

Short commands stand here, the others in files of their names, which import what they need when they
are called.
"""

from __future__ import annotations

import errno
import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

from typer import CallbackParam, Context, Exit, Option, Typer
from typer.core import TyperCommand
from typer.main import get_command

from dobc_design._signals import SENTENCE
from dobc_design.cli import (
    certify,
    design,
    doctor,
    export,
    new,
    report,
    runs,
    stress,
    sweep,
)
from dobc_design.errors import CertificateError, DobcError, SpecError, refused
from dobc_design.exact.number import parse_number

from .output import (
    INTERRUPTED,
    MACHINE,
    MISTAKE,
    NOT_READ,
    Document,
    NobodyReads,
    NoOutput,
    Progress,
    check_target,
    complain,
    described,
    fail,
    load_problem,
    print_json,
    read_certificate,
    read_claims,
    say,
    write_file,
)

if TYPE_CHECKING:
    from typer.exceptions import TyperException

    from dobc_design.export.rocq.kernel import Judgement
    from dobc_design.problem.problem import Problem

COMPLETING = "_DOBC_COMPLETE"  # set by a shell that wants to know how a word may go on
TOLD = (
    "title",
    "means",
    "statement",
    "plain",
    "letters",
    "meaning",
    "proved",
    "refuted",
    "source",
)  # of a condition
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.EPIPE)


class _Command(TyperCommand):
    """One of the commands; its line in the list of them is never cut off, and its help does not
    speak of the types of Python."""

    def get_short_help_str(self, limit: int = 45) -> str:
        return (self.help or "").partition("\n\n")[0]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        # typer writes {FILE} and {KEY=VALUES...}...
        return [piece.partition("}")[0].lstrip("{") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        write = formatter.write_dl
        # an argument is named by its word already
        formatter.write_dl = lambda rows: write(
            [(it.partition(" <")[0], text) for it, text in rows]
        )
        super().format_options(ctx, formatter)


app = Typer(
    # typer's own options for it cost a tenth of the time of --help; those of ``options`` load
    # them when they are used.
    add_completion=COMPLETING in os.environ,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
    # rich takes as long to import as all the rest of --help, and reads [words] as markup
    rich_markup_mode=None,
    help="Certify disturbance-observer-based consensus control: from a problem file to a proof.",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from dobc_design import __version__

        say(f"dobc {__version__}")
        raise Exit(0)


def _completion(context: Context, parameter: CallbackParam, wanted: bool) -> None:
    """Print or install the completion for the shell that is running."""
    if not wanted or context.resilient_parsing:
        return
    from typer import completion as shells

    action = shells.show_callback
    if parameter.name == "install_completion":
        action = shells.install_callback
    shells.get_completion_inspect_parameters()  # prepares the shells' scripts
    try:
        action(context, parameter, wanted)
    except SystemExit as error:
        if error.code in (0, None):
            raise Exit(0) from error
        raise refused(
            "--show-completion",
            "completion does not support the shell that is running.",
            "Run this in bash, zsh, fish or PowerShell.",
        ) from error


@app.callback()
def options(
    version: Annotated[
        bool,
        Option("--version", is_eager=True, callback=_show_version, help="Print the version."),
    ] = False,
    install_completion: Annotated[
        bool,
        Option(
            "--install-completion", callback=_completion, help="Let your shell complete with tab."
        ),
    ] = False,
    show_completion: Annotated[
        bool,
        Option(
            "--show-completion", callback=_completion, help="Print what --install-completion adds."
        ),
    ] = False,
) -> None:
    """Certify disturbance-observer-based consensus control: from a problem file to a proof."""


def problems(as_json: bool = False) -> None:
    """List the built-in problems."""
    from dobc_design.problem.load import builtin_names, builtin_summary

    rows = [{"name": name, "summary": builtin_summary(name)} for name in builtin_names()]
    if as_json:
        print_json({"problems": rows})
        return
    width = max(len(row["name"]) for row in rows)
    say("\n".join(f"{row['name']:<{width}}  {row['summary']}" for row in rows))


def check(
    file: str,
    canonical: Path | None = None,
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Validate a problem and say in words what it means."""
    from dobc_design.description.words import describe, facts
    from dobc_design.problem.canonical import canonical_bytes, problem_sha256

    if canonical is not None:
        check_target(canonical, force=force, key="--canonical")
    problem = load_problem(file)
    if canonical is not None:
        write_file(canonical, canonical_bytes(problem), key="--canonical")
    if as_json:
        document = {"valid": True, **facts(problem), "problem_sha256": problem_sha256(problem)}
        document["canonical"] = None if canonical is None else str(canonical)
        print_json(document)
        return
    say(describe(problem))


def verify(
    certificate: Path,
    problem: str,
    rocq: bool = False,
    as_json: bool = False,
) -> None:
    """Check every claim of a certificate against the trusted problem, exactly."""
    from dobc_design.certification.certify import verify as run

    data = read_certificate(certificate)
    trusted = load_problem(problem)
    try:
        found = run(data, trusted)
    except CertificateError as error:
        # Unreadable: what was handed in is wrong, not the machine.
        raise Exit(fail(error, MISTAKE, as_json=as_json)) from error
    # Coq takes minutes: it is not asked about claims that do not hold.
    kernel = _let_coq_check(certificate, trusted) if rocq and found.holds else None
    if as_json:
        document: Document = {
            "holds": found.holds,
            "verdict": found.verdict.value if found.holds else None,
            "confirmed": list(found.confirmed),
            "failures": list(found.failures),
            "lone_checker": found.lone_checker,
        }
        if kernel is not None:
            document["rocq"] = kernel.to_json()
        print_json(document)
    else:
        say(str(found) if kernel is None else f"{found}\n{kernel}")
    accepted = kernel is None or kernel.accepted
    raise Exit(0 if found.holds and accepted else 1)


def _let_coq_check(path: Path, problem: Problem) -> Judgement:
    """What the kernel says of the motions; if it accepts them, proof.v and the report are beside
    the certificate."""
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.files import write_folder
    from dobc_design.export.rocq.kernel import FILE, judged
    from dobc_design.export.rocq.motions import motions_proof
    from dobc_design.report.write import render_report

    folder = path if path.is_dir() else path.parent
    certificate = Certificate(problem=problem, claims=read_claims(path))
    with Progress() as progress:
        progress("looking at the rows piece by piece")
        text = motions_proof(certificate)
        progress("waiting for coqc")
        found = judged(text)
        if found.accepted:
            files = render_report(certificate, kernel=str(found), progress=progress)
            files[FILE] = text.encode("ascii")
            write_folder(folder, files)
    return found


def explain(
    id: str | None = None,
    as_json: bool = False,
) -> None:
    """Say what a condition means: the theorem in words."""
    from difflib import get_close_matches

    from dobc_design.conditions.kinds import KINDS

    if id is None:
        titles = {each: text.title for each, text in KINDS.items()}
        if as_json:
            listed = [{"id": each, "title": title} for each, title in titles.items()]
            print_json({"conditions": listed})
            return
        width = max(map(len, titles))
        say("\n".join(f"{each:<{width}}  {title}" for each, title in titles.items()))
        return
    text = KINDS.get(id)
    if text is None:
        # A text of any length may be typed; only its beginning is compared.
        near = get_close_matches(id[:40], KINDS, n=1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise refused("id", f"{id[:40]!r} is not known.", f"{hint}One of {', '.join(KINDS)}.")
    if as_json:
        print_json({"id": id, **{name: getattr(text, name) for name in TOLD}})
        return
    letters = text.letters
    width = max(map(len, letters), default=0)
    where = [f"  {letter:<{width}}  {stands_for}" for letter, stands_for in letters.items()]
    say(f"{text.title}\n\n{text.means}\n")
    say(f"Proved:  {text.proved}\nRefuted: {text.refuted}\n")
    say("\n".join(["The condition", f"  {text.plain}", *(["where", *where] if where else [])]))
    say(f"\n{text.meaning}\nSource: {text.source}")


def schema(as_json: bool = True) -> None:
    """Print the JSON Schema of the problem file."""
    from dobc_design.problem.schema import json_schema

    print_json(json_schema())


# In the order in which --help lists them.
for _command in (
    problems,
    new.new,
    check,
    certify.certify,
    verify,
    certify.region,
    design.design,
    runs.simulate,
    stress.stress,
    report.report,
    sweep.sweep,
    export.export,
    explain,
    schema,
    doctor.doctor,
):
    app.command(cls=_Command)(described(_command))


def _guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    """Run it and return the exit code, having said what went wrong.  Raises: NoOutput when that
    cannot be said.  No traceback reaches a user, and an uncaught exception is never 1, which means
    refuted."""
    from typer.exceptions import TyperException

    try:
        code = run()
    except SystemExit as error:  # help, too, goes to standard output
        # typer's way to end after completion
        if error.code in (0, None) or COMPLETING in os.environ:
            return error.code if isinstance(error.code, int) else 0
        raise NobodyReads from error
    except NoOutput:
        raise
    except DobcError as error:
        status = MISTAKE if isinstance(error, SpecError) else MACHINE
        return fail(error, status, as_json=as_json)
    except TyperException as error:  # a wrong option or a missing argument
        failure = _wrong_usage(error)
    except KeyboardInterrupt:
        failure = _INTERRUPTED
    except MemoryError:
        failure = _Failure("memory", "The machine ran out of memory.", "Try a smaller problem.")
    except OSError as error:
        failure = _failed_file(error)
    except Exception as error:  # noqa: BLE001 - the last line of defence: no traceback reaches a user
        failure = _internal(error)
    else:
        if code != INTERRUPTED:  # typer turns the interrupt into this
            return code if isinstance(code, int) else 0
        failure = _INTERRUPTED
    return fail(failure, failure.code, as_json=as_json)


class _Failure(DobcError):
    """What went wrong beside the toolbox, with its exit code."""

    def __init__(
        self,
        kind: str,
        message: str,
        cure: str | None = None,
        *,
        key: str | None = None,
        code: int = MACHINE,
    ) -> None:
        super().__init__(message, key=key, cure=cure)
        self.kind = kind
        self.code = code


_INTERRUPTED = _Failure("interrupted", SENTENCE, code=INTERRUPTED)


def _wrong_usage(error: TyperException) -> _Failure:
    context = getattr(error, "ctx", None)
    command = "dobc" if context is None else context.command_path
    option = getattr(error, "option_name", None)
    message, cure = error.format_message(), f"See `{command} --help`."
    key = None
    unread: Any = error.__cause__
    parameter: Any = getattr(error, "param", None)
    if hasattr(unread, "errors") and parameter is not None:  # pydantic met what is no number
        try:
            parse_number(unread.errors()[0]["input"], parameter.opts[0])
        except SpecError as refusal:
            message, key = refusal.message, refusal.key
            cure = refusal.cure or cure
    if command == "dobc simulate" and option in stress.MOVED:
        message = (
            f"{option} is no option of simulate: what a loop withstands is a command of "
            "its own, stress."
        )
        cure = f"Write `{stress.MOVED[option]}`."
        key = option
    return _Failure("usage", message, cure, key=key, code=MISTAKE)


def _failed_file(error: OSError) -> _Failure:
    """A file that failed us.  Raises: NoOutput where it is standard output."""
    # typer's own output; our files are named
    if error.filename is None and error.errno in _NO_ROOM:
        kind = NobodyReads if error.errno == errno.EPIPE else NoOutput
        raise kind(error.strerror) from error
    message, place = str(error.strerror or error), None
    if error.filename is not None:
        place = str(error.filename)
        message = f"{message} ({place})"
    return _Failure(
        "io",
        f"{message}.",
        "Check disk, paths and permissions.",
        key=place,
        code=MISTAKE if error.errno == errno.ENAMETOOLONG else MACHINE,
    )


def _internal(error: Exception) -> _Failure:
    if os.environ.get("DOBC_TRACEBACK"):
        import traceback

        traceback.print_exception(error)
    return _Failure(
        "internal",
        f"Internal error ({type(error).__name__}: {str(error)[:200]}).",
        "Set DOBC_TRACEBACK=1 to see where, and report it.",
    )


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave with its exit code.  No exception gets out of here."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    # What libraries warn of is decided here, exactly; and a home that cannot be written is no
    # concern of the reader.
    if not sys.warnoptions:
        os.environ.setdefault("PYTHONWARNINGS", "ignore")  # of processes that are started
        warnings.simplefilter("ignore")
    logging.getLogger("matplotlib").addHandler(logging.NullHandler())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    try:
        if sys.stdout is None:
            raise NoOutput("it is closed")
        run = partial(get_command(app), args=given, prog_name="dobc", standalone_mode=False)
        code = _guarded(run, as_json="--json" in given)
        sys.stdout.flush()
    # nobody reads standard output, or there is no room for it
    except (NoOutput, OSError) as error:
        with suppress(OSError, ValueError, AttributeError):  # Python is not to complain at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = NOT_READ
        if not isinstance(error, (NobodyReads, BrokenPipeError)):
            why = getattr(error, "strerror", None) or error
            complain(
                f"error: standard output cannot be written: {why}.\n"
                "       Send it to a file on a disk with free space, or to /dev/null. This "
                "exit code is not a verdict."
            )
            code = MACHINE
    sys.exit(code)


if __name__ == "__main__":
    main()
