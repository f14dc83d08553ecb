"""The body of ``dobc region``: certified regions as a table, as a picture, and as the document that --json prints."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.files import make_folder, write_together
from dobc_design.spec.problem import Problem
from dobc_design.workflow import certify, plot_regions

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.regions import Regions

DOCUMENT = "region.json"
WIDE = 110  # columns from which the table has its last column and bars
BAR = 24  # columns of a bar


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """What was found and written; ``document`` is what --json prints."""

    certificate: Certificate
    regions: Regions
    document: dict[str, Any]


def run_region(problem: Problem, folder: Path, *, everything: bool, progress: Callable[[str], None]) -> Found:
    """Certify ``problem`` and write region.json and the picture (SVG, PNG) into ``folder``, replacing older ones.

    Where no region is asked for, the largest box is looked for.
    Raises: CertificateError when the machine refuses; nothing has changed then.
    """
    certificate = certify(problem, everything=everything or problem.region is None, progress=progress)
    regions = certificate.regions
    document: dict[str, Any] = {
        "verdict": certificate.verdict.value, "reason": certificate.reason, "rate": certificate.rate,
        "covered_by": certificate.covered_by, "problem": problem.name,
        "problem_sha256": certificate.claims.problem_sha256, **regions.to_json(),
    }  # fmt: skip
    progress("drawing")
    files = {DOCUMENT: (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode("utf-8")}
    picture = plot_regions(certificate)
    files |= {f"region.{kind}": picture.file(kind) for kind in ("svg", "png")}
    target = make_folder(folder)
    write_together({target / name: data for name, data in files.items()})
    written = [str(target / name) for name in files]
    return Found(certificate=certificate, regions=regions, document=document | {"files": written})


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
