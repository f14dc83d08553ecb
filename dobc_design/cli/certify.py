"""``dobc certify``: certificate, problem and report in a folder, and the answer in words or as JSON."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dobc_design.cli.output import (
    COLOURS,
    EXIT,
    PIPED,
    CertificateFolder,
    File,
    Json,
    Manner,
    Progress,
    Quiet,
    Search,
    Tolerance,
    Verbose,
    answering,
    check_target,
    folder_name,
    ids,
    make_console,
    make_table,
    manner_of,
    print_json,
    refuse_option,
    require_toml,
    results_folder,
    say,
    search_parts,
    settling_parts,
    verdict_line,
    write_file,
)
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.check import Check
    from dobc_design.falsification.suspect import Falsification

WIDE = 120  # columns from which reasons stand beside the verdicts


def certify(
    file: File,
    out: CertificateFolder = None,
    everything: Annotated[bool, typer.Option("--all", help="Run every condition, also when one suffices.")] = False,
    theorem: Annotated[
        str | None, typer.Option(help="Show and judge only this condition, e.g. lemma1.", autocompletion=ids)
    ] = None,
    settling: Tolerance = None,
    search: Search = False,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and report.md.")] = True,
    apply_fix: Annotated[
        Path | None, typer.Option("--apply-fix", help="Write the cured problem here, a new .toml file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file of --apply-fix.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.certification import certify as certification
    from dobc_design.certification.search import search_certificate
    from dobc_design.conditions.kinds import KINDS
    from dobc_design.conditions.schedule.stage import read_tolerance
    from dobc_design.problem.load import load_problem
    from dobc_design.report.write import PAGE, render_report

    manner = manner_of(quiet=quiet, verbose=verbose)
    if theorem is not None and theorem not in KINDS:
        raise SpecError(f"{theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(KINDS)}.")
    refuse_option(out, key="--out")
    if apply_fix is not None:
        check_target(apply_fix, force=force, key="--apply-fix")
    tolerance = None if settling is None else read_tolerance(settling, key="--settling")
    problem = load_problem(file)
    folder = results_folder(out, problem.name)
    searches: tuple[Falsification, ...] = ()
    pages: dict[str, bytes] = {}
    with Progress(manner) as progress:
        certificate = certification.certify(problem, everything=everything, settling=tolerance, progress=progress)
        if search:
            found = search_certificate(certificate, progress=progress)
            certificate, searches = found.certificate, found.searches
        cured = None if apply_fix is None else _cured_file(certificate, file, apply_fix)
        if report:
            try:
                pages = render_report(certificate, searches=searches, progress=progress)
            except Exception:
                certificate.save(folder)  # the proof outlives its picture
                raise
        path, own, *_ = certificate.save(folder, beside=pages)
        if apply_fix is not None and cured is not None:
            write_file(apply_fix, cured, key="--apply-fix")
    page = folder / PAGE if pages else None
    if as_json:
        document = answer_head(certificate) | {
            "checks": [each.to_json() for each in certificate.checks],
            "notes": list(certificate.claims.notes),
            "certificate": str(path),
            "report": None if page is None else str(page),
        }
        if apply_fix is not None:
            document["applied"] = str(apply_fix)
        if search:
            document["searches"] = [each.to_json() for each in searches]
        print_json(document if theorem is None else document | _one_condition(certificate, theorem))
    elif manner is not Manner.QUIET:
        with answering():
            console = make_console()
            _show(console, certificate, theorem, file=None if apply_fix else file)
            for part in (*settling_parts(certificate.settling if theorem is None else None), *search_parts(searches)):
                console.print(part, soft_wrap=console.width == PIPED)
        say(f"\ncertificate  {path}\nproblem      {own}")
        if page is not None:
            say(f"report       {page}")
        say(f"re-check     {shlex.join(['dobc', 'verify', str(path), '--problem', file])}")
        if apply_fix is not None:
            say(f"cured        {apply_fix}\ncertify it   {shlex.join(['dobc', 'certify', str(apply_fix)])}")
            if problem.notes:
                say("look at      its notes: they are kept as they were and may speak of what has changed")
    verdict = certificate.verdict.value if theorem is None else _judge(_chosen(certificate, theorem))
    raise typer.Exit(EXIT[verdict])


def answer_head(certificate: Certificate) -> dict[str, Any]:
    """What the documents of certify and region begin with."""
    return {
        "verdict": certificate.verdict.value,
        "reason": certificate.reason,
        "rate": certificate.rate,
        "covered_by": certificate.covered_by,
        "problem": certificate.problem.name,
        "problem_sha256": certificate.claims.problem_sha256,
    }


def _cured_file(certificate: Certificate, source: str, target: Path) -> bytes:
    """The bytes of the cured problem.  Raises SpecError when there is nothing to cure, or no cure."""
    from dobc_design.conditions.check import main_fix
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

    fix = main_fix(certificate.checks)
    require_toml(target, key="--apply-fix")
    if fix is None:
        if certificate.verdict.value == "proved":
            message, cure = "there is nothing to cure: everything asked for is proved.", "Leave --apply-fix out."
        else:
            message, cure = "no cure is known for this problem.", "The reasons of the checks say what fails."
        raise SpecError(message, key="--apply-fix", cure=cure)
    text = changed_file(certificate.problem, fix.set, text=source_text(source), folder=target.resolve().parent)
    return text.encode("utf-8")


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
    values = {each.verdict.value for each in checks}
    return "proved" if values == {"proved"} else "refuted" if "refuted" in values else "undecided"


def _show(console: Console, certificate: Certificate, theorem: str | None, *, file: str | None) -> None:
    """The verdict, the checks with their reasons, and what would cure it.  Text of the user is shown as it is.

    ``file``: what the problem was read from, for the command that writes the cured one.
    """
    from rich.text import Text

    checks = _chosen(certificate, theorem)
    verdict = certificate.verdict.value if theorem is None else _judge(checks)
    reason = certificate.reason.removeprefix("Undecided: ")
    if theorem is not None:
        reason = _reason(certificate, checks, theorem)
    console.print(verdict_line(certificate.problem.name, verdict, reason), soft_wrap=console.width == PIPED)
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
    name = f"{folder_name(certificate.problem.name)}-cured.toml"
    for cure in _cures(checks, width=None if console.width == PIPED else console.width, file=file, name=name):
        console.print(Text(cure), soft_wrap=True)
    for place, note in enumerate(certificate.claims.notes):
        console.print(Text(f"{'' if place else chr(10)}Note: {note}"), soft_wrap=console.width == PIPED)


def _cures(checks: Sequence[Check], *, width: int | None, file: str | None, name: str) -> Iterator[str]:
    """What would cure what failed: in words, as lines of the problem file, and the command that writes them."""
    from dobc_design.conditions.check import main_cure, other_cures
    from dobc_design.problem.changes import change_lines

    main = main_cure(checks)
    for each in [*([] if main is None else [main]), *other_cures(checks)]:
        if each.fix is None:
            continue
        head = "What would cure it:" if each.kind.role == "paper" else f"What would cure {each.id}:"
        if each.verdict.value != "refuted" or each.id == "observability":
            head = f"What would help {each.id}:"
        words = f"{head} {each.fix.text}"
        lines = [words] if width is None else textwrap.wrap(words, width, subsequent_indent="  ")
        yield "\n".join(["", *lines, *(f"    {line}" for line in change_lines(each.fix.set))])
        if each is main and file is not None:
            command = shlex.join(["dobc", "certify", file, "--apply-fix", name])
            yield f"  To write the cured problem to a new file:\n    {command}"


def _table(checks: Sequence[Check], *, reasons: bool) -> Table:
    from rich.text import Text

    from dobc_design._show.text import significant_towards_zero

    table = make_table(["check"])
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
