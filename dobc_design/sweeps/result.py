"""What a sweep found: one row per case, its values, what the task gave, or the error it ended with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design._show.cards import MOST_ROWS, Card, Shown
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.sweeps.axes import Axis
from dobc_design.sweeps.case import Outcome
from dobc_design.sweeps.plan import Plan
from dobc_design.sweeps.values import number_of

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.sheet import Sheet

SHOWN = 20  # rows of a table in a notebook
OUTCOMES = ("proved", "refuted", "undecided", "converged", "diverged", "failed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SweepResult(Shown):
    """The cases of a sweep in their order.  ``lines`` are those of the journal; ``folder`` is where it is, or None.

    ``column("rate")`` gives one column, ``rows`` all of them by name; numbers of a column that has none are None.
    """

    plan: Plan
    lines: tuple[Outcome, ...]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes: what was varied."""
        return tuple(axis.name for axis in self.plan.axes)

    @property
    def columns(self) -> dict[str, str]:
        """Name -> type of every column: "text", "number", "truth" or "count"."""
        own = {name: kind for name, kind, _ in self.plan.task.columns}
        axes = {axis.name: "number" if self._is_number(place) else "text" for place, axis in enumerate(self.plan.axes)}
        return {"case": "count", **axes, **own, "error": "text", "seconds": "number", "id": "text"}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Every case as a mapping column -> value."""
        numeric = [self._is_number(place) for place in range(len(self.plan.axes))]
        own = [name for name, _, _ in self.plan.task.columns]
        rows = []
        for line in self.lines:
            values = [number_of(text) if yes else text for text, yes in zip(line["values"], numeric, strict=True)]
            found = line["result"] or {}
            rows.append(
                {
                    "case": line["case"],
                    **dict(zip(self.axes, values, strict=True)),
                    **{name: found.get(name) for name in own},
                    "error": None if line["error"] is None else line["error"]["message"],
                    "seconds": line["seconds"],
                    "id": line["id"],
                }
            )
        return rows

    def column(self, name: str) -> list[Any]:
        """One column, case by case.  Raises: SpecError for a name that is none."""
        if name not in self.columns:
            raise SpecError(
                f"{shown(name)} is no column of this sweep.", key="column", cure=f"One of {', '.join(self.columns)}."
            )
        return [row[name] for row in self.rows]

    @property
    def failures(self) -> list[Outcome]:
        """The lines of cases that ended with an error."""
        return [line for line in self.lines if line["error"] is not None]

    @property
    def outcomes(self) -> dict[str, int]:
        """How many cases were proved, refuted, undecided; or converged and diverged; and how many failed."""
        found = Counter(outcome_of(line) for line in self.lines)
        return {name: found[name] for name in OUTCOMES if found[name]}

    def frame(self) -> pd.DataFrame:
        """The rows as a pandas table.  Raises: SpecError without pandas (dobc_design[store])."""
        from dobc_design.sweeps.storage import make_frame

        return make_frame(self.rows, self.columns)

    def query(self, sql: str) -> pd.DataFrame:
        """The answer of DuckDB to a question in SQL about the table "sweep"; names with dots stand in quotes.

        For example ``SELECT verdict, count(*) FROM sweep GROUP BY verdict``.  The file system is out of its reach.
        Raises: SpecError without DuckDB (dobc_design[store]), or for SQL that it refuses.
        """
        from dobc_design.sweeps.storage import ask

        return ask(self.rows, self.columns, sql)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the rows to ``path``: .csv, .jsonl, or .parquet (needs dobc_design[store]).  Raises: SpecError."""
        from dobc_design.sweeps.storage import write_table

        return write_table(Path(path), self.rows, self.columns, force=force)

    def plot(self, value: str | None = None, *, x: str | None = None, y: str | None = None) -> Sheet:
        """A column against what was varied: a heat map over two listed axes, lines or points over one.

        ``value``: a numeric column, by default rate, or settling_time of simulations.  ``x``, ``y``: axes, by default
        the first ones.  Where several cases fall on one place (draws, further axes) the median is drawn, which the
        figure says.  Verdicts are marked besides.  Raises: SpecError for a name that does not fit.
        """
        from dobc_design.sweeps.picture import sweep_picture

        return sweep_picture(self, value=value, x=x, y=y)

    def _is_number(self, place: int) -> bool:
        axis = self.plan.axes[place]
        return all(number_of(text) is not None for text in _texts(axis, self.lines, place))

    @property
    def _summary(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in self.outcomes.items())
        return f"{len(self)} cases of {', '.join(self.axes)}: {counts}"

    def __str__(self) -> str:
        lines = [f"{self.plan.base.name}, {self.plan.task.kind}: {self._summary}"]
        for name, kind, meaning in self.plan.task.columns:
            values = sorted(each for each in self.column(name) if each is not None) if kind == "number" else []
            if values:
                middle = (values[(len(values) - 1) // 2] + values[len(values) // 2]) / 2
                found = f"{values[0]:.4g} to {values[-1]:.4g}, median {middle:.4g} ({len(values)} cases)"
                lines.append(f"  {name:<18} {found}: {meaning}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<SweepResult of {self.plan.base.name}: {self._summary}>"

    def _card(self) -> Card:
        names = [name for name in self.columns if name not in ("id", "seconds", "reason", "error")]
        rows = [[_cell(row[name]) for name in names] for row in self.rows[:MOST_ROWS]]
        return Card(title=self.plan.base.name, text=self._summary, heads=names, rows=rows, hidden=len(self) - len(rows))


def _texts(axis: Axis, lines: Sequence[Outcome], place: int) -> Sequence[str]:
    return axis.values if axis.draw is None else [line["values"][place] for line in lines]


def outcome_of(line: Outcome) -> str:
    """In a word how a case ended: one of ``OUTCOMES``."""
    if line["result"] is None:
        return "failed"
    if "verdict" in line["result"]:
        return str(line["result"]["verdict"])
    return "diverged" if line["result"]["diverged"] else "converged"


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
