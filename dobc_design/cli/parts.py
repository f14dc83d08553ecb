"""Parts of what several commands print: the stages of a settling time, and what a search for counterexamples found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType

    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.conditions.schedule.settling import Settling
    from dobc_design.falsification.suspect import Falsification


def settling_parts(settling: Settling | None, timings: Sequence[StageTiming] = ()) -> Iterator[RenderableType]:
    """The stages as a table, with what they allow; nothing without a proved settling time."""
    from rich.text import Text

    from dobc_design.report.region_words import NONE, settling_view

    view = settling_view(settling, timings)
    if view is None:
        return
    yield Text(f"\n{view['sentence']}\n")
    cells = [row.cells for row in view["rows"]]
    columns = [k for k in range(len(view["heads"])) if any(row[k] != NONE for row in cells)]
    yield _table([view["heads"][k] for k in columns], [[row[k] for k in columns] for row in cells])
    if view["timing"]:
        yield Text(f"\n{view['timing']}", style="dim")


def search_parts(searches: Sequence[Falsification]) -> Iterator[RenderableType]:
    """Every search: what was tried, what is suspect, what is proved."""
    from rich.text import Text

    from dobc_design.report.search_words import search_view

    for view in search_view(searches):
        head = Text(f"\n{view['title']}", style="bold")
        yield head
        yield Text(f"{view['tried']} {view['found']}")
        yield from (Text(sentence) for sentence in view["proved"])
        if view["rows"]:
            yield Text("")
            yield _table(view["heads"], [row.cells for row in view["rows"]])
        yield from (Text(f"\n{sentence}", style="dim") for sentence in (view["warning"], *view["notes"]) if sentence)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for head in heads:
        table.add_column(head, overflow="fold")  # a cut number would be another number
    for row in rows:
        table.add_row(*map(Text, row))
    return table
