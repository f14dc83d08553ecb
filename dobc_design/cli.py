"""dobc: the command line.  Results go to standard output, everything else to standard error.

Exit codes: 0 proved or done, 1 refuted, 3 undecided, 2 the caller's mistake, 4 the machine failed,
130 interrupted.  With --json standard output holds one JSON document and nothing else.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from dobc_design.errors import CertificateError, DobcError, SpecError

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate

app = typer.Typer(
    add_completion=False, no_args_is_help=False, pretty_exceptions_enable=False,
    help="Certify disturbance-observer-based consensus control: from a problem file to a proof.",
)  # fmt: skip

EXIT = {"proved": 0, "refuted": 1, "undecided": 3}
MISTAKE, MACHINE, INTERRUPTED = 2, 4, 130

Json = Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")]
File = Annotated[str, typer.Argument(help="A problem file, or the name of a built-in problem.")]


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

    problem = load_problem(file)
    if canonical is not None:
        from dobc_design.certificate.files import write_atomically

        if canonical.exists() and not force:
            raise SpecError(f"{canonical} exists already.", key="--canonical", cure="Add --force to replace it.")
        write_atomically(canonical, canonical_bytes(problem))
    if as_json:
        _print_json({"valid": True, **facts(problem), "problem_sha256": problem_sha256(problem)})
        return
    _say(describe(problem))


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
        raise SpecError(f"--theorem {theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(CHECK_IDS)}.")
    problem = load_problem(file)
    folder = out if out is not None else Path(f"{_folder_name(problem.name)}-certificate")
    with _Progress() as progress:
        certificate = run(problem, progress=progress)
        written = certificate.save(folder)
        page = None
        if report:
            page = write_report(certificate, folder, progress=progress)
    verdict, chosen = certificate.verdict.value, certificate.checks
    if theorem is not None:
        chosen = tuple(each for each in certificate.checks if each.id == theorem)
        verdict = _judge(chosen)
    if as_json:
        document = _certificate_json(certificate, written[0], page)
        if theorem is not None:
            document |= {"verdict": verdict, "theorem": theorem, "checks": [each.to_json() for each in chosen]}
        _print_json(document)
    else:
        _show_certificate(certificate, chosen, verdict, theorem)
        _say(f"\ncertificate  {written[0]}\nproblem      {written[1]}" + (f"\nreport       {page}" if page else ""))
        _say(f"re-check     dobc verify {written[0]} --problem {file}")
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

    path = certificate / "certificate.json" if certificate.is_dir() else certificate
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SpecError(
            f"{path} cannot be read: {error.strerror or error}.", key="certificate", cure="Check the path."
        ) from error
    trusted = load_problem(problem)
    try:
        found = run(data, trusted)
    except CertificateError as error:
        raise SpecError(error.message, key="certificate", cure=error.cure) from error
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
def explain(id: Annotated[str, typer.Argument(help="A check id, e.g. theorem1.")], as_json: Json = False) -> None:
    """Say what a condition means."""
    from dataclasses import asdict

    from dobc_design.theorems.explanations import EXPLANATIONS

    text = EXPLANATIONS.get(id)
    if text is None:
        raise SpecError(f"{id!r} is not known.", key="id", cure=f"One of {', '.join(EXPLANATIONS)}.")
    if as_json:
        _print_json({"id": id, **asdict(text)})
        return
    _say(f"{text.title}\n\n  {text.statement}\n\n{text.meaning}")
    _say(f"Proved:  {text.proved}\nRefuted: {text.refuted}\nSource:  {text.source}")


@app.command()
def schema() -> None:
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


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line and leave with its exit code.  No exception gets out of here."""
    given = sys.argv[1:] if arguments is None else arguments
    sys.exit(_guarded(lambda: app(args=given, prog_name="dobc", standalone_mode=False), as_json="--json" in given))


def _guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    from typer.exceptions import TyperException

    try:
        code = run()
        return code if isinstance(code, int) else 0
    except TyperException as error:  # a wrong option or a missing argument
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        return _fail("usage", None, message, "See `dobc --help`.", MISTAKE, as_json=as_json)
    except SpecError as error:
        return _fail_with(error, MISTAKE, as_json=as_json)
    except DobcError as error:
        return _fail_with(error, MACHINE, as_json=as_json)
    except KeyboardInterrupt:
        return _fail("interrupted", None, "Interrupted; nothing was left half written.", None, INTERRUPTED, as_json=as_json)
    except BrokenPipeError:
        sys.stderr.close()
        return MACHINE
    except MemoryError:
        return _fail("memory", None, "The machine ran out of memory.", "Try a smaller problem.", MACHINE, as_json=as_json)
    except Exception as error:  # the last line of defence: no traceback reaches a user
        if os.environ.get("DOBC_TRACEBACK"):
            raise
        text = f"Internal error ({type(error).__name__}: {str(error)[:200]})."
        return _fail("internal", None, text, "Set DOBC_TRACEBACK=1 for details and report it.", MACHINE, as_json=as_json)


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
    for each in parts[:20]:
        typer.echo(f"error: {each.message}", err=True)
        if each.cure:
            typer.echo(f"       {each.cure}", err=True)
    if len(parts) > 1:
        typer.echo(f"{len(parts)} errors; nothing was written.", err=True)
    return code


def _fail(kind: str, key: str | None, message: str, cure: str | None, code: int, *, as_json: bool) -> int:
    if as_json:
        _print_json({"error": {"kind": kind, "key": key, "message": message, "cure": cure}})
    else:
        typer.echo(f"error: {message}" + (f"\n       {cure}" if cure else ""), err=True)
    return code


def _judge(checks: tuple[Any, ...]) -> str:
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
        "certificate": str(path),
        "report": None if page is None else str(page),
    }


def _show_certificate(certificate: Certificate, checks: tuple[Any, ...], verdict: str, theorem: str | None) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    colours = {"proved": "bold green", "refuted": "bold red", "undecided": "bold yellow"}
    console = Console()
    head = Text(f"{certificate.problem.name}: ", style="bold")
    head.append(verdict.upper(), style=colours[verdict])
    console.print(head, Text(certificate.reason if theorem is None else f"(condition {theorem})"))
    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for name in ("check", "verdict", "margin", "rate 1/s", "reason"):
        table.add_column(name, no_wrap=name in ("verdict", "margin", "rate 1/s"), overflow="fold")
    for each in checks:
        table.add_row(
            Text(each.title),
            Text(each.verdict.value, style=colours[each.verdict.value]),
            Text("" if each.margin is None else f"{each.margin:.6g}"),
            Text("" if each.rate is None else f"{each.rate:.4g}"),
            Text(each.reason),
        )
    console.print(table)


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
    """A problem's name as one folder name: letters, digits, dot, dash and underscore, no leading dot."""
    text = "".join(c if c.isalnum() or c in "._-" else "-" for c in name).lstrip(".")
    return text or "problem"


def _print_json(document: Any) -> None:
    typer.echo(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))


def _say(text: str) -> None:
    typer.echo(text)


if __name__ == "__main__":
    main()
