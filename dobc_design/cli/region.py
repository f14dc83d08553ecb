"""The body of ``dobc region``: certified regions as a table, as a picture, and as the document that --json prints."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.files import make_folder, write_together
from dobc_design.certification.certify import certify
from dobc_design.certification.search import search_certificate
from dobc_design.cli.output import (
    COLOURS,
    EXIT,
    PIPED,
    Manner,
    Progress,
    answering,
    make_console,
    print_json,
    refuse_option,
    results_folder,
    say,
)
from dobc_design.cli.parts import search_parts, settling_parts
from dobc_design.conditions.schedule.asked import read_tolerance
from dobc_design.conditions.schedule.checks import stage_timings
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem
from dobc_design.report.write import plot_regions, search_sheet

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.regions import Regions
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.conditions.schedule.settling import Settling
    from dobc_design.falsification.suspect import Falsification

DOCUMENT = "region.json"
WIDE = 110  # columns from which the table has its last column and bars
BAR = 24  # columns of a bar


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What was found and written; ``document`` is what --json prints."""

    certificate: Certificate
    regions: Regions
    document: dict[str, Any]
    searches: tuple[Falsification, ...] = ()
    settling: Settling | None = None
    timings: tuple[StageTiming, ...] = ()


def run_region(
    file: str, *, out: Path | None, everything: bool, settling: str | None, search: bool, manner: Manner, as_json: bool
) -> int:
    """Certify a problem file's regions, write and say what is found, and return the exit code.  Raises: SpecError."""
    if out is not None:
        refuse_option(out, key="--out")
    problem = load_problem(file)
    folder = results_folder(out, problem.name)
    with Progress(manner) as progress:
        found = certified_regions(
            problem, folder, everything=everything, settling=settling, search=search, progress=progress
        )
    if as_json:
        print_json(found.document)
    elif manner is not Manner.QUIET:
        console = make_console()
        with answering():
            for part in shown(found, console, colours=COLOURS):
                console.print(part, soft_wrap=console.width == PIPED)
        say("\n" + "\n".join(f"wrote {path}" for path in found.document["files"]))
    return EXIT[found.certificate.verdict.value]


def certified_regions(
    problem: Problem,
    folder: Path,
    *,
    everything: bool,
    progress: Callable[[str], None],
    settling: str | None = None,
    search: bool = False,
) -> Found:
    """Certify ``problem`` and write region.json and the pictures (SVG, PNG) into ``folder``, replacing older ones.

    Where no region is asked for, the largest box is looked for.  ``settling``: a tolerance whose settling time is
    proved as well.  ``search``: starts that contradict are looked for; a proved equilibrium may refute the region.
    Raises: CertificateError when the machine refuses; nothing has changed then.
    """
    largest = everything or problem.region is None
    tolerance = None if settling is None else read_tolerance(settling, key="--settling")
    certificate = certify(problem, everything=largest, settling=tolerance, progress=progress)
    searches: tuple[Falsification, ...] = ()
    if search:
        done = search_certificate(certificate, progress=progress)
        certificate, searches = done.certificate, done.searches
    regions, staged = certificate.regions, certificate.settling
    timings = () if staged is None else stage_timings(problem, staged)
    document: dict[str, Any] = {
        "verdict": certificate.verdict.value,
        "reason": certificate.reason,
        "rate": certificate.rate,
        "covered_by": certificate.covered_by,
        "problem": problem.name,
        "problem_sha256": certificate.claims.problem_sha256,
        **regions.to_json(),
    }
    if search:
        document["searches"] = [each.to_json() for each in searches]
    progress("drawing")
    files = {DOCUMENT: (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode("utf-8")}
    pictures = {"region": plot_regions(certificate), "search": search_sheet(searches)}
    files |= {
        f"{name}.{kind}": picture.file(kind)
        for name, picture in pictures.items()
        if picture is not None
        for kind in ("svg", "png")
    }
    target = make_folder(folder)
    write_together({target / name: data for name, data in files.items()})
    written = [str(target / name) for name in files]
    return Found(
        certificate=certificate,
        regions=regions,
        document=document | {"files": written},
        searches=searches,
        settling=staged,
        timings=timings,
    )


def shown(found: Found, console: Console, *, colours: dict[str, str]) -> Iterator[RenderableType]:
    """What a terminal shows: the verdict, one row per method, delays and sampling."""
    from rich.text import Text

    from dobc_design.report.region_words import asked_sentence, rest_sentence, timing_sentences
    from dobc_design.report.words import capitalize_first

    certificate, regions = found.certificate, found.regions
    head = Text(f"{certificate.problem.name}: ", style="bold")
    head.append(certificate.verdict.value.upper(), style=colours[certificate.verdict.value])
    reason = capitalize_first(certificate.reason.removeprefix("Undecided: "))
    head.append(f". {reason}", style="not bold")
    yield head
    yield Text("")
    if not regions.claims:
        yield Text("Nothing is said about starts: no condition applies.")
        return
    yield Text(asked_sentence(regions))
    yield Text("")
    wide = console.width >= WIDE
    yield _table(regions, colours=colours, wide=wide)
    if not wide:
        yield from _limits(regions)
    sentences = [*filter(None, [rest_sentence(regions)]), *timing_sentences(regions)]
    yield from (Text(f"\n{sentence}") for sentence in sentences)
    yield from settling_parts(found.settling, found.timings)
    yield from search_parts(found.searches)


def _table(regions: Regions, *, colours: dict[str, str], wide: bool) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    from dobc_design.report.region_words import region_rows, time_head

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for name in (
        "method",
        "verdict",
        "|e|∞ ≤",
        *(("|e|₂ ≤",) if wide else ()),
        "rate 1/s",
        time_head(regions),
        "covers",
    ):
        table.add_column(name, overflow="fold")  # a cut number would be another number
    if wide:
        table.add_column("all at once" + ("" if regions.asked is None else ", ┊ asked for"), no_wrap=True)
        table.add_column("why not further", overflow="fold")
    for claim, row, bar in zip(regions.claims, region_rows(regions), _bars(regions), strict=True):
        size = "local" if claim.kind == "near" else row.box
        cells = [size, *([row.ball] if wide else []), row.rate, row.time, row.covers]
        last = [Text(bar, style="blue"), Text(row.limit)] if wide else []
        table.add_row(Text(row.name), Text(row.verdict, style=colours[row.verdict]), *map(Text, cells), *last)
    return table


def _limits(regions: Regions) -> Iterator[RenderableType]:
    """On a narrow terminal the last column stands below the table."""
    from rich.padding import Padding
    from rich.text import Text

    from dobc_design.report.region_words import region_rows

    for row in region_rows(regions):
        yield Text(f"\n{row.name}", style="bold")
        yield Padding(Text(row.limit), (0, 0, 0, 2))


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
