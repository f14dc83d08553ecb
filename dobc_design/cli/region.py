"""``dobc region``: certified regions as a table, as a picture, and as the document that --json prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from dobc_design.cli.certify import answer_head
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
    json_bytes,
    make_console,
    make_table,
    manner_of,
    print_json,
    refuse_option,
    results_folder,
    say,
    search_parts,
    settling_parts,
    verdict_line,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.regions import Regions
    from dobc_design.falsification.suspect import Falsification

WIDE = 110  # columns from which the table has its last column and bars
BAR = 24  # columns of a bar


def region(
    file: File,
    out: CertificateFolder = None,
    everything: Annotated[bool, typer.Option("--all", help="Try every method, also when one covers.")] = False,
    settling: Tolerance = None,
    search: Search = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Say from which starts consensus is proved: numbers and a picture, without a report."""
    from dobc_design.certificate.files import make_folder, write_together
    from dobc_design.certification import certify as certification
    from dobc_design.certification import search as searching
    from dobc_design.conditions.schedule.stage import read_tolerance
    from dobc_design.problem.load import load_problem
    from dobc_design.report.write import plot_regions, search_sheet

    manner = manner_of(quiet=quiet, verbose=verbose)
    refuse_option(out, key="--out")
    problem = load_problem(file)
    folder = results_folder(out, problem.name)
    searches: tuple[Falsification, ...] = ()
    with Progress(manner) as progress:
        largest = everything or problem.region is None
        tolerance = None if settling is None else read_tolerance(settling, key="--settling")
        certificate = certification.certify(problem, everything=largest, settling=tolerance, progress=progress)
        if search:
            found = searching.search_certificate(certificate, progress=progress)
            certificate, searches = found.certificate, found.searches
        document = answer_head(certificate) | certificate.regions.to_json()
        if search:
            document["searches"] = [each.to_json() for each in searches]
        progress("drawing")
        files = {folder / "region.json": json_bytes(document)}
        for name, picture in (("region", plot_regions(certificate)), ("search", search_sheet(searches))):
            if picture is not None:
                files |= {folder / f"{name}.{kind}": picture.file(kind) for kind in ("svg", "png")}
        make_folder(folder)
        write_together(files)
    written = [str(path) for path in files]
    if as_json:
        print_json(document | {"files": written})
    elif manner is not Manner.QUIET:
        console = make_console()
        with answering():
            for part in _shown(certificate, searches, wide=console.width >= WIDE):
                console.print(part, soft_wrap=console.width == PIPED)
        say("\n" + "\n".join(f"wrote {path}" for path in written))
    raise typer.Exit(EXIT[certificate.verdict.value])


def _shown(certificate: Certificate, searches: Sequence[Falsification], *, wide: bool) -> Iterator[RenderableType]:
    """What a terminal shows: the verdict, one row per method, delays and sampling."""
    from rich.padding import Padding
    from rich.text import Text

    from dobc_design.conditions.schedule.checks import stage_timings
    from dobc_design.report.region_words import asked_sentence, region_rows, rest_sentence, timing_sentences
    from dobc_design.report.words import capitalize_first

    regions, settling = certificate.regions, certificate.settling
    reason = capitalize_first(certificate.reason.removeprefix("Undecided: "))
    yield verdict_line(certificate.problem.name, certificate.verdict.value, reason)
    yield Text("")
    if not regions.claims:
        yield Text("Nothing is said about starts: no condition applies.")
        return
    yield Text(asked_sentence(regions))
    yield Text("")
    yield _table(regions, wide=wide)
    for row in () if wide else region_rows(regions):  # the last column stands below the table
        yield Text(f"\n{row.name}", style="bold")
        yield Padding(Text(row.limit), (0, 0, 0, 2))
    sentences = [*filter(None, [rest_sentence(regions)]), *timing_sentences(regions)]
    yield from (Text(f"\n{sentence}") for sentence in sentences)
    yield from settling_parts(settling, () if settling is None else stage_timings(certificate.problem, settling))
    yield from search_parts(searches)


def _table(regions: Regions, *, wide: bool) -> RenderableType:
    from rich.text import Text

    from dobc_design.report.region_words import region_rows, time_head

    sizes = ["|e|∞ ≤", "|e|₂ ≤"] if wide else ["|e|∞ ≤"]
    table = make_table(["method", "verdict", *sizes, "rate 1/s", time_head(regions), "covers"])
    if wide:
        table.add_column("all at once" + ("" if regions.asked is None else ", ┊ asked for"), no_wrap=True)
        table.add_column("why not further", overflow="fold")
    for claim, row, bar in zip(regions.claims, region_rows(regions), _bars(regions), strict=True):
        size = "local" if claim.kind == "near" else row.box
        cells = [size, *([row.ball] if wide else []), row.rate, row.time, row.covers]
        last = [Text(bar, style="blue"), Text(row.limit)] if wide else []
        table.add_row(Text(row.name), Text(row.verdict, style=COLOURS[row.verdict]), *map(Text, cells), *last)
    return table


def _bars(regions: Regions) -> list[str]:
    """|e|_inf of every method as a bar of text; the dotted line is what was asked for."""
    asked = 0.0 if regions.asked is None else regions.asked.box
    full = max([asked, *(claim.box or 0.0 for claim in regions.claims)]) or 1.0
    marked = None if not asked else min(BAR - 1, round(asked / full * BAR) - 1)
    bars = []
    for claim in regions.claims:
        part = 1.0 if claim.kind == "everywhere" else (claim.box or 0.0) / full
        cells = ["█" if place < int(part * BAR) else " " for place in range(BAR)]
        if 0 < part * BAR < 1:
            cells[0] = "▏"
        if marked is not None:
            cells = [*cells[: marked + 1], "┊", *cells[marked + 1 :]]
        bars.append("".join(cells).rstrip())
    return bars
