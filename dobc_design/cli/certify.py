"""``dobc certify`` and ``dobc region``: what is proved, in files, in words or as JSON; ``region``
with numbers and a picture of the starts in place of the report."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dobc_design.cli import output
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.check import Check
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.problem.problem import Problem

REASONS_BESIDE = 120  # columns from which reasons stand beside the verdicts
COLUMNS = (
    "Rate and factor: |e(t)| <= factor |e(0)| exp(-rate t) + what the estimation error adds. "
    "Margin: how far the largest eigenvalue stays below 0. "
    "`dobc explain CONDITION` says what a condition means."
)
WIDE = 110  # columns from which the table of regions has its last column
MOST_MODES = 4  # that are named in one row


def certify(
    file: output.File,
    out: output.CertificateFolder = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Run every condition, also when one suffices.")
    ] = False,
    theorem: Annotated[
        str | None,
        typer.Option(
            help="Show and judge only this condition, e.g. lemma1.", autocompletion=output.ids
        ),
    ] = None,
    settling: output.Tolerance = None,
    rate: Annotated[
        str | None,
        typer.Option(
            help="Look for proofs with at least this rate, 1/s; default: the least time to 1 %."
        ),
    ] = None,
    time_limit: output.TimeLimit = None,
    search: output.Search = False,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Write report.html and report.md.")
    ] = True,
    apply_fix: Annotated[
        Path | None,
        typer.Option("--apply-fix", help="Write the cured problem here, a new .toml file."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the cured file, or another problem's folder.")
    ] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.exact.work import read_time_limit, until

    seconds = None if time_limit is None else read_time_limit(time_limit, key="--time-limit")
    with until(None if seconds is None else float(seconds)):  # what is imported and read counts
        from dobc_design.certificate.files import require_own
        from dobc_design.conditions.kinds import KINDS
        from dobc_design.problem.load import load_problem
        from dobc_design.report.words import shown_notes
        from dobc_design.report.write import PAGE, render_report

        stages = output.Progress(quiet=quiet, verbose=verbose)
        if theorem is not None and theorem not in KINDS:
            raise SpecError(
                f"{theorem!r} is not known.", key="--theorem", cure=f"One of {', '.join(KINDS)}."
            )
        output.refuse_option(out, key="--out")
        if apply_fix is not None:
            output.check_target(apply_fix, force=force, key="--apply-fix")
        tolerance = _tolerance(settling)
        problem = load_problem(file)
        folder = require_own(output.results_folder(out, problem.name), problem.name, force=force)
        pages: dict[str, bytes] = {}
        with stages as progress:
            how: dict[str, Any] = {"everything": everything, "rate": rate, "time_limit": seconds}
            certificate, searches = _certified(problem, tolerance, progress, search=search, **how)
            cured = None if apply_fix is None else _cured_file(certificate, file, apply_fix)
            if report:
                try:
                    pages = render_report(certificate, searches=searches, progress=progress)
                except Exception:
                    certificate.save(folder, force=force)  # the proof outlives its picture
                    raise
            path, own, *_ = certificate.save(folder, beside=pages, force=force)
            if apply_fix is not None and cured is not None:
                output.write_file(apply_fix, cured, key="--apply-fix")
    page = folder / PAGE if pages else None
    checks = tuple(each for each in certificate.checks if theorem in (None, each.id))
    verdict, reason = certificate.verdict.value, certificate.reason
    if theorem is not None:
        values, reason = {each.verdict.value for each in checks}, f"This is about {theorem} alone."
        verdict = (
            "proved" if values == {"proved"} else "refuted" if "refuted" in values else "undecided"
        )
        if not checks:
            others = ", ".join(dict.fromkeys(each.id for each in certificate.checks))
            reason = (
                f"does not apply: {theorem} is not among the conditions of this problem ({others})."
            )
    if as_json:
        document = _head(certificate) | {
            "checks": [each.to_json() for each in checks],
            "notes": list(shown_notes(certificate)),
            "certificate": str(path),
            "report": None if page is None else str(page),
        }
        if apply_fix is not None:
            document["applied"] = str(apply_fix)
        if search:
            document["searches"] = [each.to_json() for each in searches]
        if theorem is not None:
            rates = [each.rate for each in checks if each.rate is not None]
            slowest = min(rates) if verdict == "proved" and len(rates) == len(checks) else None
            factors = [each.factor for each in checks if each.factor is not None]
            factor = max(factors) if slowest is not None and len(factors) == len(checks) else None
            document |= {"verdict": verdict, "reason": reason, "rate": slowest, "factor": factor}
            document |= {"covered_by": theorem if verdict == "proved" else None, "theorem": theorem}
        output.print_json(document)
    elif not quiet:
        head = output.verdict_line(problem.name, verdict, reason.removeprefix("Undecided: "))
        settled = certificate.settling if theorem is None else None
        output.show(output.remark_lines(problem))
        _show(head, certificate, checks, file=None if apply_fix else file)
        output.show([*output.settling_parts(settled), *output.search_parts(searches)])
        output.say(f"\ncertificate  {path}\nproblem      {own}")
        if page is not None:
            output.say(f"report       {page}")
        output.say(f"re-check     {shlex.join(['dobc', 'verify', str(path), '--problem', file])}")
        if apply_fix is not None:
            output.say(f"cured        {output.certify_it(str(apply_fix), problem.notes)}")
    raise typer.Exit(output.EXIT[verdict])


def region(
    file: output.File,
    out: output.CertificateFolder = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Try every method, even if one suffices.")
    ] = False,
    settling: output.Tolerance = None,
    search: output.Search = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files in the folder of another problem.")
    ] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Say from which starts consensus is proved: numbers and a picture, without a report."""
    from dobc_design.certificate.files import make_folder, require_own, write_together
    from dobc_design.problem.load import load_problem
    from dobc_design.report.pictures import search_sheet

    stages = output.Progress(quiet=quiet, verbose=verbose)
    output.refuse_option(out, key="--out")
    problem = load_problem(file)
    folder = require_own(output.results_folder(out, problem.name), problem.name, force=force)
    with stages as progress:
        largest = everything or problem.region is None
        how: dict[str, Any] = {"everything": largest, "time_limit": None}
        certificate, searches = _certified(
            problem, _tolerance(settling), progress, search=search, **how
        )
        document = _head(certificate) | certificate.regions.to_json()
        if search:
            document["searches"] = [each.to_json() for each in searches]
        progress("drawing")
        files = {folder / "region.json": output.json_bytes(document)}
        for name, picture in (("region", certificate.plot()), ("search", search_sheet(searches))):
            if picture is not None:
                files |= {folder / f"{name}.{kind}": picture.file(kind) for kind in ("svg", "png")}
        make_folder(folder)
        write_together(files)
    written = [str(path) for path in files]
    if as_json:
        output.print_json(document | {"files": written})
    elif not quiet:
        output.show(output.remark_lines(problem))
        output.show(_shown(certificate, searches, wide=output.make_console().width >= WIDE))
        output.say("\n" + "\n".join(f"wrote {path}" for path in written))
    raise typer.Exit(output.EXIT[certificate.verdict.value])


def _tolerance(settling: str | None) -> Any:
    from dobc_design.conditions.schedule.stage import read_tolerance

    return None if settling is None else read_tolerance(settling, key="--settling")


def _certified(
    problem: Problem, tolerance: Any, progress: Callable[[str], None], *, search: bool, **how: Any
) -> tuple[Certificate, tuple[Falsification, ...]]:
    """The certificate, and with ``search`` what a search for starts that do not converge found."""
    from dobc_design.certification import certify as certification
    from dobc_design.falsification import falsify as falsification

    certificate = certification.certify(problem, settling=tolerance, progress=progress, **how)
    if not search:
        return certificate, ()
    found = falsification.falsify(certificate, progress=progress)
    return found.certificate, found.searches


def _head(certificate: Certificate) -> dict[str, Any]:
    """What both documents begin with."""
    from dobc_design.problem.contradictions import warnings
    from dobc_design.problem.meaning import remarks

    return {
        "verdict": certificate.verdict.value,
        "reason": certificate.reason,
        "rate": certificate.rate,
        "factor": certificate.factor,
        "covered_by": certificate.covered_by,
        "warnings": list(warnings(certificate.problem)),
        "remarks": list(remarks(certificate.problem)),
        "problem": certificate.problem.name,
        "problem_sha256": certificate.claims.problem_sha256,
    }


def _cured_file(certificate: Certificate, source: str, target: Path) -> bytes:
    """The bytes of the cured problem.  Raises SpecError when there is nothing to cure, or no
    cure."""
    from dobc_design.conditions.check import main_cure
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

    check = main_cure(certificate.checks)
    fix = None if check is None else check.fix
    output.require_toml(target, key="--apply-fix")
    if fix is None:
        message, cure = (
            "no cure is known for this problem.",
            "The reasons of the checks say what fails.",
        )
        if certificate.verdict.value == "proved":
            message, cure = (
                "there is nothing to cure: everything asked for is proved.",
                "Leave --apply-fix out.",
            )
        raise SpecError(message, key="--apply-fix", cure=cure)
    text = changed_file(
        certificate.problem, fix.set, text=source_text(source), folder=target.resolve().parent
    )
    return text.encode("utf-8")


def _show(
    head: RenderableType, certificate: Certificate, checks: Sequence[Check], *, file: str | None
) -> None:
    """The verdict, the checks with their reasons, and what would cure it.  Text of the user is
    shown as it is. ``file``: what the problem was read from, for the command that writes the cured
    one."""
    from rich.text import Text

    from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
    from dobc_design.report.words import capitalize_first, shown_notes

    output.show([head])
    width = output.make_console().width
    beside = width >= REASONS_BESIDE
    table = output.make_table(["condition"])
    for name in ("result", "rate (1/s)", "factor", "margin"):
        table.add_column(name, no_wrap=True)
    if beside:
        table.add_column("what it says", overflow="fold")
    rows = _rows(checks)
    for title, each in rows:
        rate, margin = (
            "" if x is None else significant_towards_zero(x) for x in (each.rate, each.margin)
        )
        texts = [
            rate,
            "" if each.factor is None else significant_away_from_zero(each.factor),
            margin,
        ]
        texts += [capitalize_first(each.reason)] if beside else []
        table.add_row(Text(title), output.verdict_text(each.verdict.value), *map(Text, texts))
    parts: list[RenderableType] = [Text(""), table] if checks else []
    for title, each in () if beside else rows:
        lines = textwrap.wrap(
            capitalize_first(each.reason), width, initial_indent="  ", subsequent_indent="  "
        )
        parts += [Text.assemble("\n", (title, "bold")), Text("\n".join(lines))]
    output.show(parts, wrapped=True)
    if checks:
        output.show([Text(f"\n{COLUMNS}", style="dim")])
    regional = any(
        check.id == certificate.covered_by and check.kind.role == "region" for check in checks
    )
    if not regional or certificate.problem.region is not None:  # else nothing is to be cured
        unproved = certificate.verdict.value != "proved"
        output.show(
            _cures(checks, width=width, file=file, name=certificate.problem.name, unproved=unproved)
        )
    notes = shown_notes(certificate)
    output.show(Text(f"{'' if place else chr(10)}Note: {note}") for place, note in enumerate(notes))


def _rows(checks: Sequence[Check]) -> list[tuple[str, Check]]:
    """Row heads and checks; modes of which the same is said share a row."""
    same: dict[tuple[object, ...], list[Check]] = {}
    for each in checks:
        said = (each.id, each.group, each.verdict, each.rate, each.factor, each.margin, each.reason)
        same.setdefault(said, []).append(each)
    rows = []
    for alike in same.values():
        modes = ", ".join(str(each.mode) for each in alike[:MOST_MODES])
        more = f" and {len(alike) - MOST_MODES} more" if len(alike) > MOST_MODES else ""
        rows.append(
            (f"{alike[0].id} ({modes}{more})" if len(alike) > 1 else alike[0].title, alike[0])
        )
    return rows


def _cures(
    checks: Sequence[Check], *, width: int, file: str | None, name: str, unproved: bool
) -> Iterator[str]:
    """What would cure what failed: in words, as lines of the problem file, and the command that
    writes them."""
    from dobc_design.conditions.check import main_cure, other_cures
    from dobc_design.problem.changes import change_lines

    main = main_cure(checks)
    for each in [*([] if main is None else [main]), *other_cures(checks)]:
        if each.fix is None:
            continue
        head = f"What would cure {'it' if unproved and each.kind.role == 'paper' else each.id}:"
        if each.verdict.value != "refuted" or each.id == "observability":
            head = f"What would help {each.id}:"
        words = f"{head} {each.fix.text}"
        lines = (
            [words]
            if width == output.PIPED
            else textwrap.wrap(words, width, subsequent_indent="  ")
        )
        yield "\n".join(["", *lines, *(f"    {line}" for line in change_lines(each.fix.set))])
        if each is main and file is not None:
            command = shlex.join(
                ["dobc", "certify", file, "--apply-fix", f"{output.folder_name(name)}-cured.toml"]
            )
            yield f"  To write the cured problem to a new file:\n    {command}"


def _shown(
    certificate: Certificate, searches: Sequence[Falsification], *, wide: bool
) -> Iterator[RenderableType]:
    """The regions on a terminal: the verdict, one row per method, delays and sampling."""
    from rich.padding import Padding
    from rich.text import Text

    from dobc_design.report import region_words as told

    regions, settling = certificate.regions, certificate.settling
    reason = certificate.reason.removeprefix("Undecided: ")
    yield output.verdict_line(certificate.problem.name, certificate.verdict.value, reason)
    yield Text("")
    if not regions.claims:
        yield Text("Nothing is said about starts: no condition applies.")
        return
    norms = "|e|∞ is the largest error of any agent, |e|₂ the Euclidean norm of all errors."
    yield Text(f"{told.asked_sentence(regions)} {norms}\n")
    table = told.regions_table(regions, disturbed=False)
    yield output.document_table(
        table, leave_out=["certified", *([] if wide else ["|e|₂ ≤", "why not further"])]
    )
    for claim in () if wide else regions.claims:  # the last column stands below the table
        yield Text(f"\n{claim.method}", style="bold")
        yield Padding(Text(told.limit_words(claim)), (0, 0, 0, 2))
    sentences = [*filter(None, [told.rest_sentence(regions)]), *told.timing_sentences(regions)]
    yield from (Text(f"\n{sentence}") for sentence in sentences)
    yield from output.settling_parts(settling)
    yield from output.search_parts(searches)
