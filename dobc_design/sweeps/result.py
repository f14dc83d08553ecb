"""What a sweep found: one row per case, with what the task gave or the error it ended with; its tables and figures.

CSV and JSON lines need the standard library alone; Parquet and ``frame`` need pandas (dobc_design[store]).
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import MOST_ROWS, Card, Shown
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.sweeps.axes import number_of
from dobc_design.sweeps.journal import Outcome
from dobc_design.sweeps.plan import Plan

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.look import Sheet
    from dobc_design.plotting.sweeps import Places

OUTCOMES = ("proved", "refuted", "undecided", "converged", "diverged", "failed")
DRAWN = {"certify": "rate", "simulate": "settling_time"}  # the column of a figure, if none is named
DTYPES = {"text": "string", "number": "float64", "truth": "boolean", "count": "Int64"}  # of pandas


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
        axes = {name: "number" if self._is_number(place) else "text" for place, name in enumerate(self.axes)}
        return {"case": "count", **axes, **own, "error": "text", "seconds": "number", "id": "text"}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Every case as a mapping column -> value."""
        numeric = [self._is_number(place) for place in range(len(self.plan.axes))]
        rows = []
        for line in self.lines:
            values = [number_of(text) if yes else text for text, yes in zip(line["values"], numeric, strict=True)]
            found = line["result"] or {}
            rows.append(
                {
                    "case": line["case"],
                    **dict(zip(self.axes, values, strict=True)),
                    **{name: found.get(name) for name, _, _ in self.plan.task.columns},
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
        """The rows as a pandas table with the types of the columns.  Raises: SpecError without dobc_design[store]."""
        try:
            import pandas as pd
            import pyarrow  # noqa: F401 - which writes Parquet for pandas
        except ImportError:
            raise SpecError(
                "the extra packages of dobc_design[store] (pandas, pyarrow) are needed for this, and are not"
                " installed.",
                key="frame",
                cure="`dobc doctor` says how to install them; .csv and .jsonl need none.",
            ) from None
        columns = self.columns
        table = pd.DataFrame(self.rows, columns=list(columns))
        return table.astype({name: DTYPES[kind] for name, kind in columns.items()})

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the rows to ``path``: .csv, .jsonl, or .parquet (needs dobc_design[store]).  Raises: SpecError."""
        target = Path(path)
        make = {".csv": self._csv, ".jsonl": self._jsonl, ".parquet": self._parquet}.get(target.suffix.lower())
        if make is None:
            raise SpecError(
                f"a table is saved as .csv, .jsonl, .parquet; got {target.name[:40]!r}.",
                key="path",
                cure="Choose one of these.",
            )
        if target.exists() and not force:
            raise SpecError(f"{str(target)!r} exists already.", key="path", cure="Replace it with force=True.")
        write_atomically(target, make())
        return target

    def _csv(self) -> bytes:
        """UTF-8 with a header; nothing stands for what is not there."""
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.columns)
        for row in self.rows:
            writer.writerow([str(value).lower() if isinstance(value, bool) else value for value in row.values()])
        return text.getvalue().encode("utf-8")

    def _jsonl(self) -> bytes:
        return "".join(f"{json.dumps(row, ensure_ascii=False)}\n" for row in self.rows).encode("utf-8")

    def _parquet(self) -> bytes:
        data: bytes = self.frame().to_parquet(compression="zstd", index=False)
        return data

    def plot(self, value: str | None = None, *, x: str | None = None, y: str | None = None) -> Sheet:
        """A column against what was varied: a heat map over two listed axes, lines or points over one.

        ``value``: a numeric column, by default rate, or settling_time of simulations.  ``x``, ``y``: axes, by default
        the first ones.  Where several cases fall on one place (draws, further axes) the median is drawn, which the
        figure says.  Verdicts are marked besides.  Raises: SpecError for a name that does not fit.
        """
        from dobc_design.plotting.sweeps import heat_map, lines

        name = value or DRAWN[self.plan.task.kind]
        meanings = {column: text for column, kind, text in self.plan.task.columns if kind in ("number", "count")}
        if name not in meanings:
            raise SpecError(f"{shown(name)} is no numeric column.", key="value", cure=f"One of {', '.join(meanings)}.")
        numbers = np.array([math.nan if each is None else float(each) for each in self.column(name)])
        if not np.isfinite(numbers).any():
            raise SpecError(
                f"no case has a {name}, so there is nothing to be drawn.", key="value", cure="Choose another column."
            )
        chosen = self._drawn_axes(x, y)
        outcome = [outcome_of(line) for line in self.lines]
        title, label = f"{self.plan.name}: {meanings[name]}", meanings[name]
        first = self._places(chosen[0])
        if len(chosen) == 2:
            note = self._note(chosen)
            return heat_map(first, self._places(chosen[1]), numbers, outcome, label=label, title=title, note=note)
        drawn = self.plan.axes[self.axes.index(chosen[0])].draw is not None and first.names is None
        series, used = self._series(chosen[0])
        note = "" if drawn else self._note([chosen[0], *used])
        return lines(first, numbers, outcome, series, label=label, title=title, note=note, drawn=drawn)

    def _drawn_axes(self, x: str | None, y: str | None) -> list[str]:
        """One axis, or two for a heat map: those named, else the first two that are listed, else the first."""
        for key, name in (("x", x), ("y", y)):
            if name is not None and name not in self.axes:
                raise SpecError(
                    f"{shown(name)} is no axis of this sweep.", key=key, cure=f"One of {', '.join(self.axes)}."
                )
        if x is not None and x == y:
            raise SpecError("x and y must be different axes.", key="y", cure="Leave y out for lines.")
        listed = {axis.name: len(axis.values) for axis in self.plan.axes if len(axis.values) > 1}
        numbers = [name for name in self.axes if self.columns[name] == "number"]
        first = x or next(iter([*(name for name in listed if name in numbers), *numbers, *listed, *self.axes]))
        if y is not None:
            return [first, y]
        others = [name for name in listed if name != first]
        few = any(listed[name] <= 3 for name in others)  # rather lines side by side than a thin map
        return [first] if x is not None or first not in listed or not others or few else [first, others[0]]

    def _places(self, name: str) -> Places:
        """Where the cases stand along an axis: at their numbers, or side by side in the order listed."""
        from dobc_design.plotting.sweeps import Places

        place = self.axes.index(name)
        axis = self.plan.axes[place]
        if self._is_number(place):
            position = np.array(self.column(name), dtype=np.float64)
            ticks = np.unique(position)
            even_ratios = _has_even_ratios(ticks) if axis.draw is None else axis.draw.kind == "loguniform"
            return Places(name=name, position=position, ticks=ticks, even_ratios=even_ratios)
        texts = [line["values"][place] for line in self.lines]
        names = axis.values or tuple(sorted(set(texts)))
        order = {text: k for k, text in enumerate(names)}
        position = np.array([order[text] for text in texts], dtype=np.float64)
        return Places(name=name, position=position, ticks=np.arange(len(names), dtype=np.float64), names=names)

    def _series(self, x: str) -> tuple[list[str], list[str]]:
        """The name of each case's line, and the axes that make the lines: listed ones, as long as lines are few."""
        from dobc_design.plotting.sweeps import MOST_SERIES

        used: list[int] = []
        count = 1
        for place, axis in enumerate(self.plan.axes):
            if axis.name != x and len(axis.values) > 1 and count * len(axis.values) <= MOST_SERIES:
                used.append(place)
                count *= len(axis.values)
        heads = [""] if len(used) == 1 else [f"{self.axes[place]}=" for place in used]
        names = [
            ", ".join(head + line["values"][place] for head, place in zip(heads, used, strict=True))
            for line in self.lines
        ]
        return names, [self.axes[place] for place in used]

    def _note(self, shown_axes: list[str]) -> str:
        others = [axis for axis in self.plan.axes if axis.name not in shown_axes]
        parts = [axis.name for axis in others if axis.draw is not None or len(axis.values) > 1]
        return f"median over {', '.join(parts)}" if parts else ""

    def _is_number(self, place: int) -> bool:
        texts = self.plan.axes[place].values or [line["values"][place] for line in self.lines]
        return all(number_of(text) is not None for text in texts)

    @property
    def _summary(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in self.outcomes.items())
        return f"{len(self)} cases of {', '.join(self.axes)}: {counts}"

    def __str__(self) -> str:
        lines = [f"{self.plan.name}, {self.plan.task.kind}: {self._summary}"]
        for name, kind, meaning in self.plan.task.columns:
            values = [each for each in self.column(name) if each is not None] if kind == "number" else []
            if values:
                found = f"{min(values):.4g} to {max(values):.4g}, median {np.median(values):.4g} ({len(values)} cases)"
                lines.append(f"  {name:<18} {found}: {meaning}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<SweepResult of {self.plan.name}: {self._summary}>"

    def _card(self) -> Card:
        names = [name for name in self.columns if name not in ("id", "seconds", "reason", "error")]
        rows = [[_cell(row[name]) for name in names] for row in self.rows[:MOST_ROWS]]
        return Card(title=self.plan.name, text=self._summary, heads=names, rows=rows, hidden=len(self) - len(rows))


def outcome_of(line: Outcome) -> str:
    """In a word how a case ended: one of ``OUTCOMES``."""
    if line["result"] is None:
        return "failed"
    if "verdict" in line["result"]:
        return str(line["result"]["verdict"])
    return "diverged" if line["result"]["diverged"] else "converged"


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _has_even_ratios(ticks: NDArray[np.float64]) -> bool:
    """Whether a logarithmic axis spreads the values better than a linear one."""
    if len(ticks) < 3 or ticks[0] <= 0 or ticks[-1] / ticks[0] < 50:
        return False
    ratios, steps = np.diff(np.log(ticks)), np.diff(ticks)
    return bool(np.ptp(ratios) / ratios.sum() < np.ptp(steps) / steps.sum())
