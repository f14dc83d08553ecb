"""``dobc certify`` and ``dobc region``: what is proved, in files, in words or as JSON; ``region``
with numbers and a picture of the starts in place of the report."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Exit

from dobc_design.errors import refused, wrong

from .output import (
    EXIT,
    PIPED,
    Document,
    Progress,
    Stage,
    certificate_folder,
    certify_it,
    check_target,
    document_table,
    folder_name,
    json_bytes,
    load_problem,
    make_console,
    make_table,
    naming_options,
    print_json,
    remark_lines,
    require_suffix,
    say,
    search_parts,
    settling_parts,
    show,
    verdict_line,
    verdict_text,
    write_file,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.conditions.check import Check
    from dobc_design.conditions.reason import Reason
    from dobc_design.falsification.falsify import Searched
    from dobc_design.problem.problem import Problem

REASONS_BESIDE = 120  # columns from which reasons stand beside the verdicts
COLUMNS = (
    "Rate and factor: |e(t)| <= factor |e(0)| exp(-rate t) + what the estimation error adds. "
    "Margin: how far the largest eigenvalue stays below 0. "
    "`dobc explain CONDITION` says what a condition means."
)
NO_CURE = "cured        nothing was written: no check here has a known cure"
WIDE = 110  # columns from which the table of regions has its last column
MOST_MODES = 4  # that are named in one row


def certify(
    file: str,
    out: Path | None = None,
    everything: bool = False,
    theorem: str | None = None,
    settling: str | None = None,
    settling_radius: str | None = None,
    settling_disturbance: str | None = None,
    rate: str | None = None,
    time_limit: str | None = None,
    search: bool = False,
    report: bool = True,
    apply_fix: Path | None = None,
    force: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Decide every condition exactly; write certificate.json, problem.json and the report."""
    from dobc_design.exact.work import read_time_limit, until

    seconds = None if time_limit is None else read_time_limit(time_limit, key="--time-limit")
    with until(None if seconds is None else float(seconds)):  # what is imported and read counts
        from dobc_design.certificate.files import replaced_words
        from dobc_design.certification import certify as certification

        stages = Progress(quiet=quiet, verbose=verbose)
        _require_known(theorem)
        if apply_fix is not None:
            check_target(apply_fix, force=force, key="--apply-fix")
            require_suffix(apply_fix, ".toml", key="--apply-fix")
        for key, start in (
            ("--settling-radius", settling_radius),
            ("--settling-disturbance", settling_disturbance),
        ):
            if start is not None and settling is None:
                raise wrong(key, "has no meaning without --settling.", "Give the tolerance, too.")
        problem = load_problem(file)
        folder = certificate_folder(out, problem, force=force)
        with stages as progress, naming_options("certify"):
            certificate = certification.certify(
                problem,
                everything=everything,
                settling=settling,
                settling_radius=settling_radius,
                settling_disturbance=settling_disturbance,
                rate=rate,
                time_limit=seconds,
                progress=progress,
            )
            found = _searched(certificate, progress, wanted=search)
            certificate = found.certificate  # its options name the search
            cured = None
            if apply_fix is not None:
                cured = _cured_file(certificate, file, apply_fix)
            pages: dict[str, bytes] = {}
            if report:
                pages = _pages(found, folder, progress, force=force)
            replaced = replaced_words(folder, problem.name, certificate.claims.problem_sha256)
            # Certificate, problem and pages change together, or none of them does.
            path, own, *_ = certificate.save(folder, beside=pages, force=force)
            if apply_fix is not None and cured is not None:
                write_file(apply_fix, cured, key="--apply-fix")
    # Only what was wanted has a place that can be told.
    written = _Written(
        certificate=path,
        problem=own,
        report=folder / next(iter(pages)) if pages else None,
        cured=None if cured is None else apply_fix,
        replaced=replaced,
    )
    # The certificate holds every condition; --theorem chooses what is shown and returned.
    judged = _judged(certificate, theorem)
    if as_json:
        document = _document(found, judged, written)
        if apply_fix is not None:
            document["applied"] = None if written.cured is None else str(apply_fix)
        if search:
            document["searches"] = [each.to_json() for each in found.searches]
        if theorem is not None:
            document |= _about_one(judged, theorem)
        print_json(document)
    elif not quiet:
        show(remark_lines(problem))
        _show(judged, certificate, file=None if apply_fix else file)
        # A settling time belongs to the whole certificate, not to one of its conditions.
        settled = certificate.settling if theorem is None else None
        show([*settling_parts(settled), *search_parts(found.searches)])
        say("\n" + "\n".join(_places(written, file, problem)))
        if apply_fix is not None and cured is None:
            say(NO_CURE)
    raise Exit(EXIT[judged.verdict])


@dataclass(frozen=True, kw_only=True)
class _Written:
    """The files of a certificate; what was not wanted is None."""

    certificate: Path
    problem: Path
    report: Path | None
    cured: Path | None
    replaced: str | None  # whose certificate stood there, if it was of another problem


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """What is shown of a certificate: all of it, or one condition alone."""

    checks: Sequence[Check]
    verdict: str
    why: Reason


def _require_known(theorem: str | None) -> None:
    from dobc_design.conditions.kinds import KINDS

    if theorem is not None and theorem not in KINDS:
        raise refused("--theorem", f"{theorem!r} is not known.", f"One of {', '.join(KINDS)}.")


def _pages(found: Searched, folder: Path, progress: Stage, *, force: bool) -> dict[str, bytes]:
    from dobc_design.report.write import render_report

    certificate = found.certificate
    try:
        return render_report(certificate, searches=found.searches, progress=progress)
    except Exception:
        certificate.save(folder, force=force)  # the proof outlives its picture
        raise


def _judged(certificate: Certificate, theorem: str | None) -> _Judged:
    """The verdict of a certificate, or with ``theorem`` that of one of its conditions."""
    from dobc_design.conditions.reason import Reason
    from dobc_design.verdict import Verdict

    if theorem is None:
        verdict = certificate.verdict.value
        return _Judged(checks=certificate.checks, verdict=verdict, why=certificate.claims.why)
    checks = [each for each in certificate.checks if each.id == theorem]
    # A condition has one check for each mode: it is proved where all of them are.
    verdict = Verdict.all_of(each.verdict for each in checks).value
    reason = f"This is about {theorem} alone."
    if not checks:
        verdict = Verdict.UNDECIDED.value
        others = ", ".join(dict.fromkeys(each.id for each in certificate.checks))
        reason = (
            f"does not apply: {theorem} is not among the conditions of this problem ({others})."
        )
    return _Judged(checks=checks, verdict=verdict, why=Reason(head=reason))


def _document(found: Searched, judged: _Judged, written: _Written) -> Document:
    """What --json prints of a certificate."""
    from dobc_design.report.words import shown_notes

    certificate = found.certificate
    document = _head(certificate)
    document["checks"] = [each.to_json() for each in judged.checks]
    # The notes of the report, so that JSON leaves out nothing that people are told.
    document["notes"] = list(shown_notes(certificate))
    if certificate.value is not None:
        document["value"] = certificate.value.to_json()
    document["certificate"] = str(written.certificate)
    document["report"] = None if written.report is None else str(written.report)
    document["replaced"] = written.replaced
    return document


def _about_one(judged: _Judged, theorem: str) -> Document:
    """What --json says of one condition: of its modes the slowest rate, with the largest
    factor."""
    rates = [each.rate for each in judged.checks if each.rate is not None]
    factors = [each.factor for each in judged.checks if each.factor is not None]
    # A rate of some modes only is none of the condition.
    proved, rate, factor = judged.verdict == "proved", None, None
    if proved and len(rates) == len(judged.checks):
        rate = min(rates)
        if len(factors) == len(judged.checks):
            factor = max(factors)
    return {
        "verdict": judged.verdict,
        "reason": str(judged.why),
        "rate": rate,
        "factor": factor,
        "covered_by": theorem if proved else None,
        "theorem": theorem,
    }


def _places(written: _Written, file: str, problem: Problem) -> Iterator[str]:
    """Where everything is, and how it is checked."""
    path = str(written.certificate)
    yield f"certificate  {path}"
    yield f"problem      {written.problem}"
    if written.report is not None:
        yield f"report       {written.report}"
    if written.replaced is not None:
        yield f"replaced     {written.replaced}"
    yield f"re-check     {shlex.join(['dobc', 'verify', path, '--problem', file])}"
    if written.cured is not None:
        yield f"cured        {certify_it(str(written.cured), problem.notes)}"


def region(
    file: str,
    out: Path | None = None,
    everything: bool = False,
    settling: str | None = None,
    search: bool = False,
    force: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Say from which starts consensus is proved: numbers and a picture, without a report."""
    from dobc_design.certificate.files import write_folder
    from dobc_design.certification import certify as certification

    stages = Progress(quiet=quiet, verbose=verbose)
    problem = load_problem(file)
    folder = certificate_folder(out, problem, force=force)
    with stages as progress, naming_options("region"):
        # Where no region is asked for, every method says how far it reaches by itself.
        everything = everything or problem.region is None
        certificate = certification.certify(
            problem, everything=everything, settling=settling, progress=progress
        )
        found = _searched(certificate, progress, wanted=search)
        certificate = found.certificate
        document = _head(certificate) | certificate.regions.to_json()
        if search:
            document["searches"] = [each.to_json() for each in found.searches]
        # The figures are made before a file is written: a failure leaves an earlier run as it was.
        progress("drawing")
        files = write_folder(folder, _drawn(found, document))
    written = [str(path) for path in files]
    if as_json:
        print_json(document | {"files": written})
    elif not quiet:
        show(remark_lines(problem))
        show(_shown(found, wide=make_console().width >= WIDE))
        say("\n" + "\n".join(f"wrote {path}" for path in written))
    raise Exit(EXIT[certificate.verdict.value])


def _drawn(found: Searched, document: Document) -> dict[str, bytes]:
    """The files of ``dobc region`` by name: its document and its pictures."""
    from dobc_design.report.pictures import search_sheet

    files = {"region.json": json_bytes(document)}
    pictures = (("region", found.certificate.plot()), ("search", search_sheet(found.searches)))
    for name, picture in pictures:
        if picture is not None:
            for kind in ("svg", "png"):
                files[f"{name}.{kind}"] = picture.file(kind)
    return files


def _searched(certificate: Certificate, progress: Stage, *, wanted: bool) -> Searched:
    """The certificate, and where it is wanted what a search for starts that do not converge
    found."""
    from dobc_design.falsification import falsify as falsification
    from dobc_design.falsification.falsify import Searched

    if not wanted:
        return Searched(certificate=certificate, searches=())
    return falsification.falsify(certificate, progress=progress)


def _head(certificate: Certificate) -> Document:
    """What both documents begin with."""
    from dobc_design.description.contradictions import warnings
    from dobc_design.description.meaning import remarks

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


def _cured_file(certificate: Certificate, source: str, target: Path) -> bytes | None:
    """The bytes of the cured problem; None where there is nothing to cure, or no cure."""
    from dobc_design.conditions.check import main_cure
    from dobc_design.problem.changes import changed_file
    from dobc_design.problem.load import source_text

    check = main_cure(certificate.checks)
    if check is None or check.fix is None:
        return None
    text, folder = source_text(source), target.resolve().parent
    # What the user typed stays, comments included; only the keys of the cure change.
    cured = changed_file(certificate.problem, check.fix.set, text=text, folder=folder)
    return cured.encode("utf-8")


def _show(judged: _Judged, certificate: Certificate, *, file: str | None) -> None:
    """The verdict, the checks with their reasons, and what would cure it.  Text of the user is
    shown as it is. ``file``: what the problem was read from, for the command that writes the cured
    one."""
    from rich.text import Text

    from dobc_design.loop.make import loop_of
    from dobc_design.loop.words import said_of
    from dobc_design.report.words import shown_notes

    problem, checks = certificate.problem, judged.checks
    show([verdict_line(problem.name, judged.verdict, judged.why.told)])
    if certificate.value is not None:
        show([Text(certificate.value.in_words(problem.unit))])
    if checks:
        width = make_console().width
        show([Text(""), *_check_parts(_rows(checks), width)], wrapped=True)
        show([Text(f"\n{said_of(loop_of(problem))(COLUMNS)}", style="dim")])
    # A local statement beside a proof for a region needs no cure where no region is asked for.
    covering = [check for check in checks if check.id == certificate.covered_by]
    regional = any(check.kind.role == "region" for check in covering)
    if not regional or problem.region is not None:
        show(_cures(checks, certificate, file=file))
    notes = [f"Note: {note}" for note in shown_notes(certificate)]
    if notes:
        show(map(Text, [f"\n{notes[0]}", *notes[1:]]))


def _check_parts(rows: Sequence[tuple[str, Check]], width: int) -> Iterator[RenderableType]:
    """Checks with their numbers as a table; their reasons beside these, or below on a narrow
    terminal."""
    from rich.text import Text

    from dobc_design._show.text import (
        capitalize_first,
        rate_text,
        significant_away_from_zero,
        significant_towards_zero,
    )

    beside = width >= REASONS_BESIDE
    table = make_table(["condition"])
    for name in ("result", "rate (1/s)", "factor", "margin"):
        table.add_column(name, no_wrap=True)
    if beside:
        # Sentences may be folded, numbers not.
        table.add_column("what it says", overflow="fold")
    for title, check in rows:
        numbers = (
            rate_text(check.rate),
            significant_away_from_zero(check.factor),
            significant_towards_zero(check.margin),
        )
        texts = [number.strip("–") for number in numbers]  # nothing where there is none
        if beside:
            texts.append(capitalize_first(check.reason))
        verdict = verdict_text(check.verdict.value)
        table.add_row(Text(title), verdict, *map(Text, texts))
    yield table
    if beside:
        return
    for title, check in rows:
        reason = capitalize_first(check.reason)
        lines = textwrap.wrap(reason, width, initial_indent="  ", subsequent_indent="  ")
        yield Text.assemble("\n", (title, "bold"))
        yield Text("\n".join(lines))


def _rows(checks: Sequence[Check]) -> list[tuple[str, Check]]:
    """Checks with their heads in the table; modes of which the same is said share a row."""
    from dobc_design.exact.reading import some

    # Twenty modes of which the same is said are one row, not twenty.
    same: dict[tuple[object, ...], list[Check]] = {}
    for each in checks:
        said = (each.id, each.group, each.verdict, each.rate, each.factor, each.margin, each.reason)
        same.setdefault(said, []).append(each)
    rows = []
    for alike in same.values():
        first = alike[0]
        title = first.title
        if len(alike) > 1:
            title = f"{first.id} ({some([str(each.mode) for each in alike], MOST_MODES)})"
        rows.append((title, first))
    return rows


def _cures(checks: Sequence[Check], certificate: Certificate, *, file: str | None) -> Iterator[str]:
    """What would cure what failed: in words, as lines of the problem file, and the command that
    writes them."""
    from dobc_design.conditions.check import main_cure, other_cures
    from dobc_design.problem.changes import change_lines

    proved = certificate.verdict.value == "proved"
    main = main_cure(checks)
    # The cure that everything else waits for comes first.
    for check in (main, *other_cures(checks)):
        if check is None or check.fix is None:
            continue
        head = f"What would cure {check.id}:"
        if check.verdict.value != "refuted" or check.id == "observability":
            head = f"What would help {check.id}:"
        elif check.kind.role == "paper" and not proved:
            head = "What would cure it:"
        words = f"{head} {check.fix.text}"
        lines = [f"    {line}" for line in change_lines(check.fix.set)]
        yield "\n".join(["", *_wrapped(words), *lines])
        if check is main and file is not None:
            cured = f"{folder_name(certificate.problem.name)}-cured.toml"
            command = shlex.join(["dobc", "certify", file, "--apply-fix", cured])
            yield f"  To write the cured problem to a new file:\n    {command}"


def _wrapped(text: str) -> list[str]:
    """As wide as the terminal; one line where there is none."""
    width = make_console().width
    return [text] if width == PIPED else textwrap.wrap(text, width, subsequent_indent="  ")


def _shown(found: Searched, *, wide: bool) -> Iterator[RenderableType]:
    """The regions on a terminal: the verdict, one row per method, delays and sampling."""
    from rich.padding import Padding
    from rich.text import Text

    from dobc_design.report import region_words as told
    from dobc_design.report.document import turned
    from dobc_design.report.words import said_here

    certificate = found.certificate
    regions = certificate.regions
    reason = certificate.claims.why.told
    yield verdict_line(certificate.problem.name, certificate.verdict.value, reason)
    yield Text("")
    if not regions.claims:
        yield Text("Nothing is said about starts: no condition applies.")
        return
    said = said_here(certificate.problem)
    norms = "|e|∞ is the largest error of any agent, |e|₂ the Euclidean norm of all errors."
    yield Text(said(f"{told.asked_sentence(regions)} {norms}\n"))
    table = turned(told.regions_table(regions, disturbed=False), said)
    if wide:
        yield document_table(table, leave_out=["certified"])
    else:
        yield document_table(table, leave_out=["certified", "|e|₂ ≤", "why not further"])
        for claim in regions.claims:  # the last column stands below the table
            yield Text(f"\n{claim.method}", style="bold")
            yield Padding(Text(said(told.limit_words(claim))), (0, 0, 0, 2))
    rest = told.rest_sentence(regions)
    if rest is not None:
        yield Text(f"\n{rest}")
    for sentence in told.timing_sentences(regions):
        yield Text(f"\n{said(sentence)}")
    yield from settling_parts(certificate.settling)
    yield from search_parts(found.searches)
