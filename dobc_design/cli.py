"""dobc: the command line.  Results go to standard output, everything else to standard error.

Exit codes: 0 proved or done, 1 refuted, 3 undecided, 2 the caller's mistake, 4 the machine failed,
130 interrupted.  With --json standard output holds one JSON document and nothing else.
"""

from __future__ import annotations

import io
import json
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

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
        _write_canonical(canonical, canonical_bytes(problem))
    if as_json:
        written = None if canonical is None else str(canonical)
        sha256 = problem_sha256(problem)
        _print_json({"valid": True, **facts(problem), "problem_sha256": sha256, "canonical": written})
        return
    _say(describe(problem))


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


def _write_canonical(path: Path, data: bytes) -> None:
    from dobc_design.certificate.files import write_atomically

    try:
        write_atomically(path, data)
    except CertificateError as error:
        raise CertificateError(error.message, key="--canonical", cure="Choose another place.") from error


@app.command()
def certify(
    file: File,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; default ./NAME-certificate.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Run every condition, also when one suffices.")] = False,
    theorem: Annotated[str | None, typer.Option(help="Show and judge only this condition, e.g. lemma1.")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and report.md.")] = True,
    as_json: Json = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.spec.load import load_problem
    from dobc_design.verify.check import CHECK_IDS
    from dobc_design.workflow import certify as run
    from dobc_design.workflow import write_report

    if theorem is not None and theorem not in CHECK_IDS:
        raise SpecError(f"{theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(CHECK_IDS)}.")
    if out is not None:
        _refuse_option(out, key="--out")
    problem = load_problem(file)
    folder = out if out is not None else Path(f"{_folder_name(problem.name)}-certificate")
    if folder.exists() and not folder.is_dir():
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    with _Progress() as progress:
        certificate = run(problem, progress=progress)
        written = certificate.save(folder)
        page = None
        if report:
            page = write_report(certificate, folder, progress=progress)
    if as_json:
        document = _certificate_json(certificate, written[0], page)
        _print_json(document if theorem is None else document | _one_condition(certificate, theorem))
    else:
        console = _console()
        _show_certificate(console, certificate, theorem)
        _say(f"\ncertificate  {written[0]}\nproblem      {written[1]}" + (f"\nreport       {page}" if page else ""))
        _say(f"re-check     {shlex.join(['dobc', 'verify', str(written[0]), '--problem', file])}")
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
            }
        )  # fmt: skip
    else:
        _say(str(found))
    raise typer.Exit(0 if found.holds else 1)


@app.command()
def export(
    certificate: Annotated[Path, typer.Argument(help="certificate.json, or the folder it lies in.")],
    rocq: Annotated[Path, typer.Option(help="Write the proved theorem as a Rocq (Coq) file here.")],
    problem: Annotated[str | None, typer.Option(help="The problem; default problem.json beside it.")] = None,
    rate: Annotated[bool, typer.Option("--rate", help="Also state the certified rate.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    as_json: Json = False,
) -> None:
    """Write a certificate as a file for the proof assistant Rocq (Coq 8.16): coqc then checks it."""
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
    path = certificate / "certificate.json" if certificate.is_dir() else certificate
    try:
        return path.read_bytes()
    except OSError as error:
        raise SpecError(
            f"{str(path)!r} cannot be read: {error.strerror or error}.", key="certificate", cure="Check the path."
        ) from error


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
    as_json = "--json" in given
    try:
        code = _guarded(lambda: app(args=given, prog_name="dobc", standalone_mode=False), as_json=as_json)
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:  # nobody reads standard output, or there is no room for it
        _abandon_output()
        _complain(f"error: standard output cannot be written: {error.strerror or error}.")
        code = MACHINE
    sys.exit(code)


def _guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    from typer.exceptions import TyperException

    def fail(kind: str, message: str, cure: str | None, code: int) -> int:
        return _fail(kind, None, message, cure, code, as_json=as_json)

    interrupted = "Interrupted; no file was left half written."
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
        return fail("interrupted", interrupted, None, INTERRUPTED)
    except SystemExit as error:  # typer's way of saying that nobody reads standard output
        raise BrokenPipeError("nobody reads it") from error
    except MemoryError:
        return fail("memory", "The machine ran out of memory.", "Try a smaller problem.", MACHINE)
    except OSError as error:
        name = "" if error.filename is None else f" ({error.filename})"
        return fail("io", f"{error.strerror or error}{name}.", "Check disk, paths and permissions.", MACHINE)
    except Exception as error:  # noqa: BLE001 - the last line of defence: no traceback reaches a user
        if os.environ.get("DOBC_TRACEBACK"):
            import traceback

            traceback.print_exc()
        text = f"Internal error ({type(error).__name__}: {str(error)[:200]})."
        return fail("internal", text, "Set DOBC_TRACEBACK=1 to see where, and report it.", MACHINE)
    if code == INTERRUPTED:  # typer turns the interrupt into this
        return fail("interrupted", interrupted, None, INTERRUPTED)
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

    typer.echo("\n".join(visible(line) for line in text.split("\n")), err=True)


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


def _show_certificate(console: Console, certificate: Certificate, theorem: str | None) -> None:
    """The verdict, the checks with their reasons, and what would help.  Text of the user is shown as it is."""
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
    fixes = dict.fromkeys(_fix(each) for each in checks if each.fix is not None)
    remarks = [f"What would help: {fix}" for fix in fixes] + [f"Note: {note}" for note in certificate.claims.notes]
    if remarks:
        console.print(Text("\n" + "\n".join(remarks)), soft_wrap=console.width == PIPED)


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


def _fix(check: Check) -> str:
    """The remedy in a sentence, then the lines for the problem file."""
    if check.fix is None:
        return ""
    keys = ((key, value) for key, value in check.fix.set.items() if value is not None)
    return check.fix.text + "".join(f"\n    {key} = {json.dumps(value, ensure_ascii=False)}" for key, value in keys)


class _Progress:
    """Names the current stage on standard error when it is a terminal; silent otherwise."""

    def __init__(self) -> None:
        self.status: Any = None

    def __enter__(self) -> Callable[[str], None]:
        if sys.stderr.isatty():
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
    typer.echo(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))


def _say(text: str) -> None:
    typer.echo(text)


if __name__ == "__main__":
    main()
