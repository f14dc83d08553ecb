"""The body of ``dobc certify``: certificate, problem and report in a folder, and the answer in words or as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.cli.output import (
    COLOURS,
    EXIT,
    PIPED,
    WIDE,
    Manner,
    Progress,
    answering,
    check_target,
    folder_name,
    make_console,
    print_json,
    refuse_option,
    results_folder,
    say,
    write_file,
)
from dobc_design.cli.parts import search_parts, settling_parts
from dobc_design.conditions.schedule.asked import read_tolerance
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    from fractions import Fraction

    from rich.console import Console

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.check import Check
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True)
class _Done:
    """What was decided, and the files that say so; ``cured``: that of the cured problem, where it was asked for."""

    certificate: Certificate
    searches: tuple[Falsification, ...]
    path: Path
    problem: Path
    page: Path | None
    cured: Path | None


def run_certify(
    file: str,
    *,
    out: Path | None,
    everything: bool,
    theorem: str | None,
    report: bool,
    apply_fix: Path | None,
    force: bool,
    manner: Manner,
    as_json: bool,
    settling: str | None = None,
    search: bool = False,
) -> int:
    """Certify a problem file, write what is found, and return the exit code.  Raises: SpecError."""
    from dobc_design.conditions.kinds import KINDS
    from dobc_design.problem.load import load_problem

    if theorem is not None and theorem not in KINDS:
        raise SpecError(f"{theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(KINDS)}.")
    if out is not None:
        refuse_option(out, key="--out")
    if apply_fix is not None:
        check_target(apply_fix, force=force, key="--apply-fix")
    tolerance = None if settling is None else read_tolerance(settling, key="--settling")
    problem = load_problem(file)
    folder = results_folder(out, problem.name)
    with Progress(manner) as progress:
        done = _decide_and_write(
            file,
            problem,
            folder,
            everything=everything,
            tolerance=tolerance,
            search=search,
            report=report,
            cured=apply_fix,
            progress=progress,
        )
    if as_json:
        _print_document(done, theorem, searched=search)
    elif manner is not Manner.QUIET:
        _tell(done, file, theorem)
    verdict = done.certificate.verdict.value if theorem is None else _judge(_chosen(done.certificate, theorem))
    return EXIT[verdict]


def _decide_and_write(
    file: str,
    problem: Problem,
    folder: Path,
    *,
    everything: bool,
    tolerance: Fraction | None,
    search: bool,
    report: bool,
    cured: Path | None,
    progress: Callable[[str], None],
) -> _Done:
    """Everything that is asked for, decided, and then written: nothing is written of what fails, but for proofs."""
    from dobc_design.certification.certify import certify
    from dobc_design.certification.search import search_certificate
    from dobc_design.report.write import PAGE, render_report

    certificate = certify(problem, everything=everything, settling=tolerance, progress=progress)
    searches: tuple[Falsification, ...] = ()
    if search:
        found = search_certificate(certificate, progress=progress)
        certificate, searches = found.certificate, found.searches
    cure = None if cured is None else _cured_file(certificate, file, cured)
    pages: dict[str, bytes] = {}
    if report:
        try:
            pages = render_report(certificate, searches=searches, progress=progress)
        except Exception:
            certificate.save(folder)  # the proof outlives its picture
            raise
    written = certificate.save(folder, beside=pages)
    if cured is not None and cure is not None:
        write_file(cured, cure, key="--apply-fix")
    return _Done(
        certificate=certificate,
        searches=searches,
        path=written[0],
        problem=written[1],
        page=folder / PAGE if pages else None,
        cured=cured,
    )


def _print_document(done: _Done, theorem: str | None, *, searched: bool) -> None:
    """The document of --json."""
    document = _certificate_json(done.certificate, done.path, done.page)
    if done.cured is not None:
        document["applied"] = str(done.cured)
    if searched:
        document["searches"] = [each.to_json() for each in done.searches]
    print_json(document if theorem is None else document | _one_condition(done.certificate, theorem))


def _tell(done: _Done, file: str, theorem: str | None) -> None:
    """The answer in words: verdict, checks, cures, settling time, searches, files, and what to do with them."""
    certificate = done.certificate
    with answering():
        console = make_console()
        _show_certificate(console, certificate, theorem, file=None if done.cured else file)
        settling = certificate.settling if theorem is None else None
        for part in (*settling_parts(settling), *search_parts(done.searches)):
            console.print(part, soft_wrap=console.width == PIPED)
    say(f"\ncertificate  {done.path}\nproblem      {done.problem}")
    if done.page is not None:
        say(f"report       {done.page}")
    say(f"re-check     {shlex.join(['dobc', 'verify', str(done.path), '--problem', file])}")
    if done.cured is not None:
        say(f"cured        {done.cured}\ncertify it   {shlex.join(['dobc', 'certify', str(done.cured)])}")
        if certificate.problem.notes:
            say("look at      its notes: they are kept as they were and may speak of what has changed")


def _cured_file(certificate: Certificate, source: str, target: Path) -> bytes:
    """The bytes of the cured problem.  Raises SpecError when there is nothing to cure, or no cure."""
    from dobc_design.conditions.check import main_fix
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

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

    from dobc_design.conditions.check import main_cure, other_cures
    from dobc_design.problem.changes import change_lines

    main = main_cure(checks)
    for each in [*([] if main is None else [main]), *other_cures(checks)]:
        if each.fix is None:
            continue
        whole = each.kind.role == "paper"
        head = "What would cure it:" if whole else f"What would cure {each.id}:"
        if each.verdict.value != "refuted" or each.id == "observability":
            head = f"What would help {each.id}:"
        lines = [f"{head} {each.fix.text}"]
        if console.width != PIPED:
            lines = textwrap.wrap(lines[0], console.width, subsequent_indent="  ")
        console.print()
        console.print(Text("\n".join(lines + [f"    {line}" for line in change_lines(each.fix.set)])), soft_wrap=True)
        if each is main and file is not None:
            command = shlex.join(["dobc", "certify", file, "--apply-fix", f"{folder_name(name)}-cured.toml"])
            console.print(Text(f"  To write the cured problem to a new file:\n    {command}"), soft_wrap=True)


def _table(checks: Sequence[Check], *, reasons: bool) -> Any:
    from rich.table import Table
    from rich.text import Text

    from dobc_design._show.text import significant_towards_zero

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
