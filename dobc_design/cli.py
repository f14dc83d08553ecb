"""dobc: the command line.  Results go to standard output, everything else to standard error.

Exit codes: 0 proved or done, 1 refuted, 3 undecided, 2 the caller's mistake, 4 the machine failed,
130 interrupted.  With --json standard output holds one JSON document and nothing else.
"""

from __future__ import annotations

import errno
import io
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from dobc_design._signals import SENTENCE, answer_begins
from dobc_design.errors import CertificateError, DobcError, SpecError

if TYPE_CHECKING:
    from rich.console import Console

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.verify.check import Check

app = typer.Typer(
    add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False,
    help="Certify disturbance-observer-based consensus control: from a problem file to a proof.",
)  # fmt: skip

EXIT = {"proved": 0, "refuted": 1, "undecided": 3}
MISTAKE, MACHINE, INTERRUPTED = 2, 4, 130
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.EPIPE)
COLOURS = {"proved": "bold green", "refuted": "bold red", "undecided": "bold yellow"}
WIDE = 120  # columns from which reasons stand beside the verdicts
PIPED = 160  # columns of output that no terminal limits
LONGEST_FOLDER = 60  # characters of a problem's name that go into its folder's; file systems take 255 bytes

Json = Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")]
File = Annotated[str, typer.Argument(help="A problem file, or the name of a built-in problem.")]


def _show_version(wanted: bool) -> None:
    if wanted:
        from dobc_design import __version__

        _say(f"dobc {__version__}")
        raise typer.Exit(0)


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Print the version.")
    ] = False,
) -> None:
    """Certify disturbance-observer-based consensus control: from a problem file to a proof."""


@app.command()
def problems(as_json: Json = False) -> None:
    """List the built-in problems."""
    from dobc_design.spec.builtin import builtin_names, builtin_summary

    rows = [{"name": name, "summary": builtin_summary(name)} for name in builtin_names()]
    if as_json:
        _print_json({"problems": rows})
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        _say(f"{row['name']:<{width}}  {row['summary']}")


@app.command()
def check(
    file: File,
    canonical: Annotated[Path | None, typer.Option(help="Write the canonical problem.json here.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite --canonical.")] = False,
    as_json: Json = False,
) -> None:
    """Validate a problem and say in words what it means."""
    from dobc_design.spec.canonical import canonical_bytes, problem_sha256
    from dobc_design.spec.load import load_problem
    from dobc_design.spec.words import describe, facts

    if canonical is not None:
        _check_target(canonical, force=force, key="--canonical")
    problem = load_problem(file)
    if canonical is not None:
        _write_file(canonical, canonical_bytes(problem), key="--canonical")
    if as_json:
        written = None if canonical is None else str(canonical)
        sha256 = problem_sha256(problem)
        _print_json({"valid": True, **facts(problem), "problem_sha256": sha256, "canonical": written})
        return
    _say(describe(problem))


def _cured_file(certificate: Certificate, source: str, target: Path) -> bytes:
    """The bytes of the cured problem.  Raises SpecError when there is nothing to cure, or no cure."""
    from dobc_design.spec.load import source_text
    from dobc_design.spec.toml_writing import changed_file
    from dobc_design.verify.check import main_fix

    fix = main_fix(certificate.checks)
    if target.suffix.lower() != ".toml":
        raise SpecError(
            f"--apply-fix must name a .toml file; got {str(target)!r}.",
            key="--apply-fix",
            cure=f"For example {target.with_suffix('.toml').name}.",
        )
    if fix is None:
        if certificate.verdict.value == "proved":
            message, cure = "there is nothing to cure: everything asked for is proved.", "Leave --apply-fix out."
        else:
            message, cure = "no cure is known for this problem.", "The reasons of the checks say what fails."
        raise SpecError(message, key="--apply-fix", cure=cure)
    text = changed_file(certificate.problem, fix.set, text=source_text(source), folder=target.resolve().parent)
    return text.encode("utf-8")


def _check_target(path: Path, *, force: bool, key: str) -> None:
    _refuse_option(path, key=key)
    if path.is_dir():
        raise SpecError(f"{str(path)!r} is a folder.", key=key, cure="Name a file in it.")
    if path.exists() and not force:
        raise SpecError(f"{str(path)!r} exists already.", key=key, cure="Add --force to replace it.")


def _refuse_option(path: Path, *, key: str) -> None:
    """Refuse an option that was taken for the value of another one, as in ``--out --json``."""
    if str(path).startswith("--"):
        raise SpecError(f"{key} needs a value before {str(path)!r}.", key=key, cure=f"A path of that name is ./{path}.")


def _write_file(path: Path, data: bytes, *, key: str) -> None:
    from dobc_design.certificate.files import write_atomically

    try:
        write_atomically(path, data)
    except CertificateError as error:
        raise CertificateError(error.message, key=key, cure="Choose another place.") from error


@app.command()
def certify(
    file: File,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME-certificate.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Run every condition, also when one suffices.")] = False,
    theorem: Annotated[str | None, typer.Option(help="Show and judge only this condition, e.g. lemma1.")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and report.md.")] = True,
    apply_fix: Annotated[
        Path | None, typer.Option("--apply-fix", help="Write the cured problem here, a new .toml file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --apply-fix.")] = False,
    as_json: Json = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.spec.load import load_problem
    from dobc_design.verify.check import CHECK_IDS
    from dobc_design.workflow import PAGE, render_report
    from dobc_design.workflow import certify as run

    if theorem is not None and theorem not in CHECK_IDS:
        raise SpecError(f"{theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(CHECK_IDS)}.")
    if out is not None:
        _refuse_option(out, key="--out")
    if apply_fix is not None:
        _check_target(apply_fix, force=force, key="--apply-fix")
    problem = load_problem(file)
    folder = out if out is not None else Path(f"{_folder_name(problem.name)}-certificate")
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nowhere counts
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    with _Progress() as progress:
        certificate = run(problem, everything=everything, progress=progress)
        cured = None if apply_fix is None else _cured_file(certificate, file, apply_fix)
        try:
            pages = render_report(certificate, progress=progress) if report else {}
        except Exception:
            certificate.save(folder)  # the proof outlives its picture
            raise
        written = certificate.save(folder, beside=pages)
    page = folder / PAGE if pages else None
    if apply_fix is not None and cured is not None:
        _write_file(apply_fix, cured, key="--apply-fix")
    if as_json:
        document = _certificate_json(certificate, written[0], page)
        if apply_fix is not None:
            document["applied"] = str(apply_fix)
        _print_json(document if theorem is None else document | _one_condition(certificate, theorem))
    else:
        with _answering():
            _show_certificate(_console(), certificate, theorem, file=None if apply_fix else file)
        _say(f"\ncertificate  {written[0]}\nproblem      {written[1]}" + (f"\nreport       {page}" if page else ""))
        _say(f"re-check     {shlex.join(['dobc', 'verify', str(written[0]), '--problem', file])}")
        if apply_fix is not None:
            _say(f"cured        {apply_fix}\ncertify it   {shlex.join(['dobc', 'certify', str(apply_fix)])}")
            if problem.notes:
                _say("look at      its notes: they are kept as they were and may speak of what has changed")
    verdict = certificate.verdict.value if theorem is None else _one_condition(certificate, theorem)["verdict"]
    raise typer.Exit(EXIT[verdict])


@app.command()
def verify(
    certificate: Annotated[Path, typer.Argument(help="certificate.json, or the folder it lies in.")],
    problem: Annotated[str, typer.Option(help="The trusted problem: TOML, problem.json or a built-in name.")],
    as_json: Json = False,
) -> None:
    """Check every claim of a certificate against the trusted problem, exactly."""
    from dobc_design.spec.load import load_problem
    from dobc_design.workflow import verify as run

    data = _read_certificate(certificate)
    trusted = load_problem(problem)
    try:
        found = run(data, trusted)
    except CertificateError as error:
        # Unreadable: what was handed in is wrong, not the machine.
        raise typer.Exit(_fail_with(error, MISTAKE, as_json=as_json)) from error
    if as_json:
        _print_json(
            {
                "holds": found.holds, "verdict": found.verdict.value,
                "confirmed": list(found.confirmed), "failures": list(found.failures),
                "lone_checker": found.lone_checker,
            }
        )  # fmt: skip
    else:
        _say(str(found))
    raise typer.Exit(0 if found.holds else 1)


@app.command()
def region(
    file: File,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME-certificate.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Try every method, also when one covers.")] = False,
    as_json: Json = False,
) -> None:
    """Say from which starts consensus is proved: numbers and a picture, without a report."""
    from dobc_design.cli_region import run_region, shown
    from dobc_design.spec.load import load_problem

    if out is not None:
        _refuse_option(out, key="--out")
    problem = load_problem(file)
    folder = out if out is not None else Path(f"{_folder_name(problem.name)}-certificate")
    if os.path.lexists(folder) and not folder.is_dir():  # a link to nowhere counts
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    with _Progress() as progress:
        found = run_region(problem, folder, everything=everything, progress=progress)
    if as_json:
        _print_json(found.document)
    else:
        console = _console()
        with _answering():
            for part in shown(found, console, colours=COLOURS):
                console.print(part, soft_wrap=console.width == PIPED)
        _say("\n" + "\n".join(f"wrote {path}" for path in found.document["files"]))
    raise typer.Exit(EXIT[found.certificate.verdict.value])


@app.command()
def simulate(
    file: File,
    runs: Annotated[int | None, typer.Option(help="How many runs, with the seeds S, S + 1, ...")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of starts and switches; default the problem's.")] = None,
    t_final: Annotated[float | None, typer.Option("--t-final", help="Horizon in s; default the problem's.")] = None,
    mode: Annotated[str | None, typer.Option(help="Stay in this mode, whatever [switching] says.")] = None,
    start: Annotated[str | None, typer.Option(help="Start from a CSV or .npz file.")] = None,
    noise: Annotated[float, typer.Option(help="Stress: standard deviation of measured states.")] = 0.0,
    disturbance: Annotated[float, typer.Option(help="Stress: amplitude of a sine that no exosystem knows.")] = 0.0,
    saturation: Annotated[float | None, typer.Option(help="Stress: bound on every component of u.")] = None,
    period: Annotated[float | None, typer.Option(help="Stress: sample and hold, every so many s.")] = None,
    loss: Annotated[float, typer.Option(help="Stress: probability that a packet is lost.")] = 0.0,
    fail: Annotated[
        list[str] | None, typer.Option(help="Stress: LABEL@TIME or LABEL@TIME:freeze; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for arrays (.npz), figures and summary.json.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files in --out.")] = False,
    as_json: Json = False,
) -> None:
    """Simulate runs of the closed loop; a run that diverges is an answer and leaves with 0, too."""
    from dobc_design.cli_simulate import read_stress, run_simulation

    if out is not None:
        _refuse_option(out, key="--out")
    stress = read_stress(
        noise=noise, disturbance=disturbance, saturation=saturation, period=period, loss=loss, fail=fail or []
    )
    with _Progress() as progress:
        answer = run_simulation(
            file, runs=runs, seed=seed, t_final=t_final, mode=mode, start=start, stress=stress, out=out, force=force,
            progress=progress,
        )  # fmt: skip
    if as_json:
        _print_json(answer.document)
    else:
        _say(answer.text)


@app.command()
def export(
    file: Annotated[str, typer.Argument(help="For --rocq a certificate.json or its folder, else a problem.")],
    rocq: Annotated[Path | None, typer.Option(help="Write the proved theorem as a Rocq (Coq) file here.")] = None,
    python_control: Annotated[
        Path | None, typer.Option("--python-control", help="Write the loop as a Python file for python-control.")
    ] = None,
    problem: Annotated[str | None, typer.Option(help="With --rocq: default problem.json beside it.")] = None,
    rate: Annotated[bool, typer.Option("--rate", help="Also state the certified rate.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    as_json: Json = False,
) -> None:
    """Write a certificate for the proof assistant Rocq (Coq 8.16), or a problem's loop for python-control."""
    if (rocq is None) == (python_control is None):
        raise SpecError("exactly one target must be named.", key="export", cure="--rocq FILE or --python-control FILE.")
    if python_control is not None:
        _export_python(file, python_control, force=force, as_json=as_json)
    elif rocq is not None:
        _export_rocq(Path(file), rocq, problem, rate=rate, force=force, as_json=as_json)


def _export_python(file: str, target: Path, *, force: bool, as_json: bool) -> None:
    from dobc_design.workflow import python_script

    _check_target(target, force=force, key="--python-control")
    _write_file(target, python_script(file).encode("utf-8"), key="--python-control")
    if as_json:
        _print_json({"python_control": str(target)})
    else:
        _say(f"wrote {target}")


def _export_rocq(certificate: Path, rocq: Path, problem: str | None, *, rate: bool, force: bool, as_json: bool) -> None:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.files import write_atomically
    from dobc_design.certificate.text import read_claims
    from dobc_design.export.rocq import rocq_proof
    from dobc_design.spec.load import load_problem

    _check_target(rocq, force=force, key="--rocq")
    folder = certificate if certificate.is_dir() else certificate.parent
    try:
        claims = read_claims(_read_certificate(certificate))
    except CertificateError as error:
        raise typer.Exit(_fail_with(error, MISTAKE, as_json=as_json)) from error
    trusted = load_problem(str(folder / "problem.json") if problem is None else problem)
    text = rocq_proof(Certificate(problem=trusted, claims=claims), rate=rate)
    write_atomically(rocq, text.encode("ascii"))
    if as_json:
        _print_json({"rocq": str(rocq)})
    else:
        _say(f"wrote {rocq}\ncheck it with: {shlex.join(['coqc', str(rocq)])}")


def _read_certificate(certificate: Path) -> bytes:
    from dobc_design.certificate.text import MAX_BYTES
    from dobc_design.spec.toml_text import read_bytes

    path = certificate / "certificate.json" if certificate.is_dir() else certificate
    try:
        return read_bytes(path, limit=MAX_BYTES, what="certificate")
    except SpecError as error:
        raise SpecError(error.message, key="certificate", cure=error.cure) from error


@app.command()
def explain(
    id: Annotated[str, typer.Argument(help="The id of a check, e.g. theorem1.")], as_json: Json = False
) -> None:
    """Say what a condition means."""
    from dataclasses import asdict

    from dobc_design.theorems.explanations import EXPLANATIONS

    text = EXPLANATIONS.get(id)
    if text is None:
        raise SpecError(f"{id!r} is not known.", key="id", cure=f"One of {', '.join(EXPLANATIONS)}.")
    if as_json:
        _print_json({"id": id, **asdict(text)})
        return
    _say(f"{text.title}\n\n  {text.plain}\n\n{text.meaning}")
    _say(f"Proved:  {text.proved}\nRefuted: {text.refuted}\nSource:  {text.source}")


@app.command()
def schema(as_json: Json = True) -> None:
    """Print the JSON Schema of the problem file."""
    from dobc_design.spec.schema import json_schema

    _print_json(json_schema())


@app.command()
def doctor(as_json: Json = False) -> None:
    """Say what is installed and whether the main path works."""
    from dobc_design.workflow import diagnose

    rows = diagnose()
    if as_json:
        _print_json({"ok": all(row["ok"] for row in rows), "items": rows})
    else:
        for row in rows:
            _say(f"{'ok     ' if row['ok'] else 'MISSING'}  {row['item']:<16} {row['detail']}")
    raise typer.Exit(0 if all(row["ok"] for row in rows) else MACHINE)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave with its exit code.  No exception gets out of here."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    try:
        if sys.stdout is None:
            raise _NoOutput("it is closed")
        code = _guarded(lambda: app(args=given, prog_name="dobc", standalone_mode=False), as_json="--json" in given)
        sys.stdout.flush()
    except (_NoOutput, OSError) as error:  # nobody reads standard output, or there is no room for it
        _abandon_output()
        _complain(
            f"error: standard output cannot be written: {getattr(error, 'strerror', None) or error}.\n"
            "       Send it to a file that has room, or to /dev/null; the exit code alone is no answer now."
        )
        code = MACHINE
    sys.exit(code)


class _NoOutput(Exception):
    """Standard output cannot be written; the text says why."""


@contextmanager
def _answering() -> Iterator[None]:
    """Wrap what writes to standard output."""
    answer_begins()
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise _NoOutput(error.strerror or str(error)) from error
    except SystemExit as error:  # rich's way of saying that nobody reads it
        raise _NoOutput("nobody reads it") from error


def _guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    from typer.exceptions import TyperException

    def fail(kind: str, message: str, cure: str | None, code: int) -> int:
        return _fail(kind, None, message, cure, code, as_json=as_json)

    try:
        code = run()
    except TyperException as error:  # a wrong option or a missing argument
        context = getattr(error, "ctx", None)
        command = "dobc" if context is None else context.command_path
        return fail("usage", error.format_message(), f"See `{command} --help`.", MISTAKE)
    except SpecError as error:
        return _fail_with(error, MISTAKE, as_json=as_json)
    except DobcError as error:
        return _fail_with(error, MACHINE, as_json=as_json)
    except KeyboardInterrupt:
        return fail("interrupted", SENTENCE, None, INTERRUPTED)
    except SystemExit as error:  # help, too, goes to standard output
        raise _NoOutput("nobody reads it") from error
    except _NoOutput:
        raise
    except MemoryError:
        return fail("memory", "The machine ran out of memory.", "Try a smaller problem.", MACHINE)
    except OSError as error:
        if error.filename is None and error.errno in _NO_ROOM:  # typer's own output; our files are named
            raise _NoOutput(error.strerror) from error
        place = None if error.filename is None else str(error.filename)
        message = f"{error.strerror or error}{'' if place is None else f' ({place})'}."
        return _fail("io", place, message, "Check disk, paths and permissions.", MACHINE, as_json=as_json)
    except Exception as error:  # noqa: BLE001 - the last line of defence: no traceback reaches a user
        if os.environ.get("DOBC_TRACEBACK"):
            import traceback

            traceback.print_exc()
        text = f"Internal error ({type(error).__name__}: {str(error)[:200]})."
        return fail("internal", text, "Set DOBC_TRACEBACK=1 to see where, and report it.", MACHINE)
    if code == INTERRUPTED:  # typer turns the interrupt into this
        return fail("interrupted", SENTENCE, None, INTERRUPTED)
    return code if isinstance(code, int) else 0


def _abandon_output() -> None:
    """Keep Python from complaining at exit about what can no longer be written."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError, AttributeError):
        return


def _fail_with(error: DobcError, code: int, *, as_json: bool) -> int:
    parts = error.errors if isinstance(error, SpecError) else (error,)
    first = parts[0]
    if as_json:
        body: dict[str, Any] = {"kind": first.kind, "key": first.key, "message": first.message, "cure": first.cure}
        if len(parts) > 1:
            body["all"] = [
                {"kind": each.kind, "key": each.key, "message": each.message, "cure": each.cure} for each in parts
            ]
        _print_json({"error": body})
        return code
    for each in parts:
        _complain(f"error: {each.message}" + (f"\n       {each.cure}" if each.cure else ""))
    if len(parts) > 1:
        _complain(f"{len(parts)} errors; nothing was written.")
    return code


def _fail(kind: str, key: str | None, message: str, cure: str | None, code: int, *, as_json: bool) -> int:
    if as_json:
        _print_json({"error": {"kind": kind, "key": key, "message": message, "cure": cure}})
    else:
        _complain(f"error: {message}" + (f"\n       {cure}" if cure else ""))
    return code


def _complain(text: str) -> None:
    """Write to standard error; control characters become escapes."""
    from dobc_design.spec.tokens import visible

    try:
        typer.echo("\n".join(visible(line) for line in text.split("\n")), err=True)
    except (OSError, ValueError):  # full or closed: the exit code still says it
        return


def _one_condition(certificate: Certificate, theorem: str) -> dict[str, Any]:
    """What ``--theorem`` changes in the document: the verdict is that of one condition, in all modes."""
    chosen = _chosen(certificate, theorem)
    rates = [each.rate for each in chosen]
    verdict = _judge(chosen)
    return {
        "verdict": verdict,
        "reason": _reason(certificate, chosen, theorem),
        "rate": None if verdict != "proved" or None in rates else min(rate for rate in rates if rate is not None),
        "covered_by": theorem if verdict == "proved" else None,
        "theorem": theorem,
        "checks": [each.to_json() for each in chosen],
    }


def _chosen(certificate: Certificate, theorem: str | None) -> tuple[Check, ...]:
    return tuple(each for each in certificate.checks if theorem in (None, each.id))


def _reason(certificate: Certificate, chosen: Sequence[Check], theorem: str) -> str:
    if chosen:
        return f"This is about {theorem} alone."
    others = ", ".join(dict.fromkeys(each.id for each in certificate.checks))
    return f"does not apply: {theorem} is not among the conditions of this problem ({others})."


def _judge(checks: Sequence[Check]) -> str:
    values = [each.verdict.value for each in checks]
    if values and all(value == "proved" for value in values):
        return "proved"
    return "refuted" if "refuted" in values else "undecided"


def _certificate_json(certificate: Certificate, path: Path, page: Path | None) -> dict[str, Any]:
    return {
        "verdict": certificate.verdict.value,
        "reason": certificate.reason,
        "rate": certificate.rate,
        "covered_by": certificate.covered_by,
        "problem": certificate.problem.name,
        "problem_sha256": certificate.claims.problem_sha256,
        "checks": [each.to_json() for each in certificate.checks],
        "notes": list(certificate.claims.notes),
        "certificate": str(path),
        "report": None if page is None else str(page),
    }


def _console() -> Console:
    """Standard output; as wide as the terminal, or wide enough for tables where there is none."""
    from rich.console import Console

    limited = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(width=None if limited else PIPED, highlight=False)


def _show_certificate(
    console: Console, certificate: Certificate, theorem: str | None, *, file: str | None = None
) -> None:
    """The verdict, the checks with their reasons, and what would cure it.  Text of the user is shown as it is.

    ``file``: what the problem was read from, for the command that writes the cured one.
    """
    import textwrap

    from rich.text import Text

    checks = _chosen(certificate, theorem)
    verdict = certificate.verdict.value if theorem is None else _judge(checks)
    reason = certificate.reason if theorem is None else _reason(certificate, checks, theorem)
    head = Text(f"{certificate.problem.name}: ", style="bold")
    head.append(verdict.upper(), style=COLOURS[verdict])
    head.append(f". {reason.removeprefix('Undecided: ')}", style="not bold")
    console.print(head, soft_wrap=console.width == PIPED)
    beside = console.width >= WIDE
    if checks:
        console.print()
        console.print(_table(checks, reasons=beside))
    if not beside:
        for each in checks:
            console.print()
            console.print(Text(each.title, style="bold"))
            lines = textwrap.wrap(each.reason, console.width, initial_indent="  ", subsequent_indent="  ")
            console.print(Text("\n".join(lines)))
    _show_cures(console, checks, file=file, name=certificate.problem.name)
    for place, note in enumerate(certificate.claims.notes):
        console.print(Text(f"{'' if place else chr(10)}Note: {note}"), soft_wrap=console.width == PIPED)


def _show_cures(console: Console, checks: Sequence[Check], *, file: str | None, name: str) -> None:
    """What would cure what failed: in words, as lines of the problem file, and the command that writes them."""
    import textwrap

    from rich.text import Text

    from dobc_design.spec.typed import change_lines
    from dobc_design.verify.check import main_cure, other_cures

    main = main_cure(checks)
    for each in [*([] if main is None else [main]), *other_cures(checks)]:
        if each.fix is None:
            continue
        whole = each.id in ("theorem1", "theorem2", "lemma1")
        head = "What would cure it:" if whole else f"What would cure {each.id}:"
        if each.verdict.value != "refuted" or each.id == "observability":
            head = f"What would help {each.id}:"
        lines = [f"{head} {each.fix.text}"]
        if console.width != PIPED:
            lines = textwrap.wrap(lines[0], console.width, subsequent_indent="  ")
        console.print()
        console.print(Text("\n".join(lines + [f"    {line}" for line in change_lines(each.fix.set)])), soft_wrap=True)
        if each is main and file is not None:
            command = shlex.join(["dobc", "certify", file, "--apply-fix", f"{_folder_name(name)}-cured.toml"])
            console.print(Text(f"  To write the cured problem to a new file:\n    {command}"), soft_wrap=True)


def _table(checks: Sequence[Check], *, reasons: bool) -> Any:
    from rich.table import Table
    from rich.text import Text

    from dobc_design._render import significant_towards_zero

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    table.add_column("check", overflow="fold")
    for name in ("verdict", "margin", "rate 1/s"):
        table.add_column(name, no_wrap=True)
    if reasons:
        table.add_column("reason", overflow="fold")
    for each in checks:
        row = [
            Text(each.title),
            Text(each.verdict.value, style=COLOURS[each.verdict.value]),
            Text("" if each.margin is None else significant_towards_zero(each.margin, 6)),
            Text("" if each.rate is None else significant_towards_zero(each.rate, 4)),
        ]
        table.add_row(*row, *([Text(each.reason)] if reasons else []))
    return table


class _Progress:
    """Names the current stage on standard error when it is a terminal; silent otherwise."""

    def __init__(self) -> None:
        self.status: Any = None

    def __enter__(self) -> Callable[[str], None]:
        if sys.stderr is not None and sys.stderr.isatty():
            from rich.console import Console

            self.status = Console(stderr=True).status("starting")
            self.status.start()
        return self.stage

    def stage(self, name: str) -> None:
        """Show a stage."""
        if self.status is not None:
            self.status.update(name)

    def __exit__(self, *error: object) -> None:
        if self.status is not None:
            self.status.stop()


def _folder_name(name: str) -> str:
    """A problem's name as one folder name: letters and digits, with dots, dashes and underscores between them."""
    text = "".join(c if c.isalnum() or c in "._-" else "-" for c in name).lstrip("._-")
    return text[:LONGEST_FOLDER] or "problem"


def _print_json(document: Any) -> None:
    _say(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))


def _say(text: str) -> None:
    with _answering():
        typer.echo(text)


if __name__ == "__main__":
    main()
