"""What a sweep found: the journal, in which every case is a line, and the result with its tables
and figures.

The folder of a journal holds sweep.json (what is swept) and results.jsonl, to which a line of JSON
is appended per finished case, on the disk before the next one is counted.  A torn last line is cut
off and its case is done again, as for lines that cannot be read or belong to no case.  One process
at a time works on a folder.  CSV and JSON lines need the standard library alone; Parquet and
``frame`` need pandas (dobc_design[store]).
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections import Counter
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from dobc_design._checks import noun
from dobc_design._show.cards import MOST_ROWS, Card, Headed
from dobc_design.certificate.files import make_folder, write_atomically
from dobc_design.errors import CertificateError, SpecError, refused
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Document, Texts, shown

from .axes import number_of
from .plan import Plan

if TYPE_CHECKING:
    import pandas as pd

    from dobc_design.plotting.sweeps import Places

Outcome = Document  # a line: what is kept of a case
HEAD, LINES = "sweep.json", "results.jsonl"
FIELDS = {"case", "id", "values", "result", "error", "seconds"}
ERROR = {"kind", "key", "message", "cure"}
_ID = re.compile("[0-9a-f]{64}")
TIME = "time"  # kind of error of a case that was given up
OUTCOMES = ("proved", "refuted", "undecided", "converged", "diverged", "failed")
LEAST, MOST = 1e-150, 1e150  # positive numbers along an axis of a figure
DRAWN = {"certify": "rate", "simulate": "settling_time"}  # the column of a figure, if none is named
TIMES = ("period", "delay", "own_delay", "dwell", "longest", "lag", "t_final")  # keys of times
DTYPES = {"text": "string", "number": "float64", "truth": "boolean", "count": "Int64"}  # of pandas


class Journal:
    """An open journal; ``done`` holds the lines of cases by number, those from earlier runs
    included.  Use it as a context: the folder is locked until it is left; without a folder nothing
    is written. Raises: SpecError for a folder of another sweep, or one at which another process is
    at work; CertificateError when the machine refuses."""

    def __init__(self, folder: Path | None, plan: Plan, *, anew: bool = False) -> None:
        self.folder, self.plan = folder, plan
        self.done: dict[int, Outcome] = {}
        self.stream: IO[bytes] | None = None
        if folder is None:
            return
        make_folder(folder)
        if not anew:
            _require_same(folder, plan)
        try:
            self.stream = open(folder / LINES, "ab+")  # noqa: SIM115 - closed by __exit__
            _lock(self.stream, folder)
            # Locked first: two processes that begin anew at once would wipe out each other.
            if anew:
                self.stream.truncate(0)
            head = json.dumps(plan.document | {"sha256": plan.sha256}, indent=2, ensure_ascii=False)
            write_atomically(folder / HEAD, f"{head}\n".encode())
            self.stream.seek(0)
            data = self.stream.read()
            # A line that was torn when the machine stopped has no end: its case is done again.
            whole = data.rfind(b"\n") + 1
            if whole < len(data):
                self.stream.truncate(whole)
            self._read(data[:whole])
        except OSError as error:
            self.__exit__()
            raise self._refused(error) from error
        except SpecError:
            self.__exit__()
            raise

    def _read(self, data: bytes) -> None:
        """Take the lines that belong to cases of the plan; of several for a case the first that was
        not given up."""
        for text in data.split(b"\n"):
            try:
                line = json.loads(text.decode("utf-8"))
            except (ValueError, RecursionError):
                continue
            # Somebody may have edited the file; what fits no case is left where it is.
            if not _is_line(line, self.plan):
                continue
            case = line["case"]
            if case not in self.done or to_be_done_again(self.done[case], None):
                self.done[case] = line

    @property
    def lines(self) -> tuple[Outcome, ...]:
        return tuple(self.done[case] for case in sorted(self.done))

    def append(self, line: Outcome) -> None:
        """Keep the line of one case, written down to the disk."""
        stream = self.stream
        if stream is not None:
            try:
                text = json.dumps(line, ensure_ascii=False, allow_nan=False)
                stream.write(f"{text}\n".encode())
                # A case counts only when it is on the disk.
                stream.flush()
                os.fsync(stream.fileno())
            except OSError as error:
                raise self._refused(error) from error
        self.done[line["case"]] = line

    def _refused(self, error: OSError) -> CertificateError:
        message = f"{LINES} cannot be written: {error.strerror or error}."
        cure = (
            "What is there is kept: make room, or check the permissions, and run the same command "
        )
        cure += "again."
        return CertificateError(message, key=f"{self.folder}/{LINES}", cure=cure)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *error: object) -> None:
        if self.stream is not None:
            self.stream.close()  # which also unlocks it


def _cell(value: Any) -> Any:
    """A cell of a CSV file; an apostrophe before text that a spreadsheet would take for a
    formula."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str) or number_of(value) is not None:
        return value
    return f"'{value}" if value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def _is_line(line: Any, plan: Plan) -> bool:
    """Whether this is the line of a case of the plan: every field of its type, numbers finite."""
    if not isinstance(line, dict) or set(line) != FIELDS or type(line["case"]) is not int:
        return False
    case, error = line["case"], line["error"]
    if not 0 <= case < len(plan) or line["values"] != list(plan.values(case)):
        return False
    if not _fits(line["seconds"], "number") or line["seconds"] < 0:
        return False
    if line["id"] is not None and not _ID.fullmatch(str(line["id"])):
        return False
    if error is not None:
        return line["result"] is None and _is_error(error)
    return line["id"] is not None and _is_result(line, plan)


def _is_error(error: Any) -> bool:
    if not isinstance(error, dict) or set(error) != ERROR:
        return False
    if type(error["kind"]) is not str or type(error["message"]) is not str:
        return False
    return all(value is None or type(value) is str for value in error.values())


def _is_result(line: Outcome, plan: Plan) -> bool:
    result = line["result"]
    kinds = {column.name: column.kind for column in plan.task.columns}
    if not isinstance(result, dict) or set(result) != set(kinds):
        return False
    if not all(value is None or _fits(value, kinds[name]) for name, value in result.items()):
        return False
    # A result without an outcome could not be counted.
    return outcome_of(line) in OUTCOMES if "verdict" in kinds else result["diverged"] is not None


def _fits(value: Any, kind: str) -> bool:
    if kind == "number":
        return type(value) in (int, float) and math.isfinite(value)
    return type(value) is {"text": str, "truth": bool, "count": int}[kind]


def to_be_done_again(line: Outcome, limit: float | None) -> bool:
    """Whether a case was given up for its time, and would get more of it now."""
    given_up = line["error"] is not None and line["error"].get("kind") == TIME
    return given_up and (limit is None or limit > line["seconds"])


def _require_same(folder: Path, plan: Plan) -> None:
    """Refuse a folder that holds another sweep, or lines of which nobody knows what they are
    about."""
    document = plan.document
    head, lines = folder / HEAD, folder / LINES
    if not head.exists():
        if lines.exists() and lines.stat().st_size:
            message = f"{str(folder)!r} holds {LINES} without {HEAD}, which says what it is about."
            raise refused(
                "--out", message, "Choose another folder, or add --force to begin anew there."
            )
        return
    try:
        found = json.loads(head.read_bytes().decode("utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    # all of it, so that a change by hand is not overwritten
    if found == document | {"sha256": plan.sha256}:
        return
    words = {
        "problem": "problem",
        "problem_sha256": "problem",
        "axes": "choice of values",
        "samples": "number of samples",
        "seed": "seed",
        "task": "task",
        "made_by": "version of dobc_design",
    }
    known = found if isinstance(found, dict) else document
    changed = [word for name, word in words.items() if known.get(name) != document[name]]
    message = f"{str(folder)!r} was made for another sweep"
    if changed:
        first = [f" another {word}" for word in dict.fromkeys(changed)][:2]
        message += f", with{' and'.join(first)}"
    raise refused(
        "--out",
        f"{message}.",
        "Choose another folder with --out, or add --force to begin anew there.",
    )


def _lock(stream: IO[bytes], folder: Path) -> None:
    """Let one process at a time work here.  The system unlocks a file when its process ends,
    however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows: two drivers at once would do cases twice, and lose none
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise refused(
            "--out",
            f"another process is at work on the sweep in {str(folder)!r}.",
            "Wait for it, or choose another folder with --out.",
        ) from None


@noun(eq=False)
class SweepResult(Headed):
    """The cases of a sweep in their order.  ``lines`` are those of the journal; ``folder`` is where
    it is, or None.

    ``column("rate")`` gives one column, ``rows`` all of them by name; numbers of a column that has
    none are None.
    """

    plan: Plan
    lines: tuple[Outcome, ...]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def axes(self) -> Texts:
        """The names of the axes: what was varied."""
        return tuple(axis.name for axis in self.plan.axes)

    @property
    def columns(self) -> dict[str, str]:
        """Name -> type of every column: "text", "number", "truth" or "count"."""
        own = {column.name: column.kind for column in self.plan.task.columns}
        axes = {}
        for place, name in enumerate(self.axes):
            axes[name] = "number" if self._is_number(place) else "text"
        return {"case": "count", **axes, **own, "error": "text", "seconds": "number", "id": "text"}

    @property
    def rows(self) -> list[Document]:
        """Every case as a mapping column -> value."""
        columns = self.columns
        numeric = [columns[name] == "number" for name in self.axes]
        kept = [column.name for column in self.plan.task.columns]
        rows = []
        for line in self.lines:
            axes = zip(line["values"], numeric, strict=True)
            values = [number_of(text) if is_number else text for text, is_number in axes]
            result = line["result"] or {}
            found = [result.get(name) for name in kept]
            error = None if line["error"] is None else line["error"]["message"]
            cells = [line["case"], *values, *found, error, line["seconds"], line["id"]]
            rows.append(dict(zip(columns, cells, strict=True)))
        return rows

    def column(self, name: str) -> list[Any]:
        """One column, case by case.  Raises: SpecError for a name that is none."""
        if name not in self.columns:
            raise refused(
                "column",
                f"{shown(name)} is no column of this sweep.",
                f"One of {', '.join(self.columns)}.",
            )
        return [row[name] for row in self.rows]

    @property
    def failures(self) -> list[Outcome]:
        """The lines of cases that ended with an error."""
        return [line for line in self.lines if line["error"] is not None]

    @property
    def outcomes(self) -> dict[str, int]:
        """How many cases were proved, refuted, undecided; or converged and diverged; and how many
        failed."""
        found = Counter(outcome_of(line) for line in self.lines)
        return {name: found[name] for name in OUTCOMES if found[name]}

    def frame(self) -> pd.DataFrame:
        """The rows as a pandas table with the types of the columns.  Raises: SpecError without
        dobc_design[store]."""
        try:
            import pandas as pd
            import pyarrow  # noqa: F401 - which writes Parquet for pandas
        except ImportError:
            message = (
                "this needs the extra packages of dobc_design[store] (pandas, pyarrow), which "
                "are not installed."
            )
            raise refused(
                "frame",
                message,
                "`dobc doctor` says how to install them; .csv and .jsonl need none.",
            ) from None
        columns = self.columns
        # Types are said, so that a column of nothing but None stays a column of numbers.
        table = pd.DataFrame(self.rows, columns=list(columns))
        return table.astype({name: DTYPES[kind] for name, kind in columns.items()})

    def save(self, path: str | PathLike[str], *, force: bool = True) -> Path:
        """Write the rows to ``path``: .csv, .jsonl, or .parquet (needs dobc_design[store]).
        Raises: SpecError."""
        target = Path(path)
        suffix = target.suffix.lower()
        if suffix not in (".csv", ".jsonl", ".parquet"):
            raise refused(
                "path",
                f"a table is saved as .csv, .jsonl, .parquet; got {target.name[:40]!r}.",
                "Choose one of these.",
            )
        if target.exists() and not force:
            raise refused("path", f"{str(target)!r} exists already.", "Replace it with force=True.")
        if suffix == ".parquet":
            data: bytes = self.frame().to_parquet(compression="zstd", index=False)
        elif suffix == ".jsonl":
            data = "".join(f"{json.dumps(row, ensure_ascii=False)}\n" for row in self.rows).encode(
                "utf-8"
            )
        else:  # UTF-8 with a header; nothing stands for what is not there
            text = io.StringIO(newline="")
            writer = csv.writer(text)
            writer.writerow(map(_cell, self.columns))
            writer.writerows(map(_cell, row.values()) for row in self.rows)
            data = text.getvalue().encode("utf-8")
        write_atomically(target, data)
        return target

    def plot(
        self,
        value: str | None = None,
        *,
        x: str | None = None,
        y: str | None = None,
        ax: Any = None,
    ) -> Any:
        """A column against what was varied: a heat map over two listed axes, lines or points over
        one.

        ``value``: a numeric column, by default rate, or settling_time of simulations.  ``x``,
        ``y``: axes, by default the first ones.  Where several cases fall on one place (draws,
        further axes) the median is drawn, which the figure says.  Verdicts are marked besides.
        Returns: a Sheet; with Matplotlib's ``ax`` these axes.
        Raises: SpecError for a name that does not fit.
        """
        plan = self.plan
        from dobc_design.plotting.sweeps import Cases, heat_map, lines

        name = value or DRAWN[plan.task.kind]
        meaning = self._meaning_of(name)
        column = [math.nan if each is None else float(each) for each in self.column(name)]
        numbers = np.array(column)
        if not np.isfinite(numbers).any():
            raise refused(
                "value",
                f"no case has a {name}, so there is nothing to be drawn.",
                "Choose another column.",
            )
        # The first axes that are worth it, or those that were named.
        chosen = self._drawn_axes(x, y)
        places = [self._places(each) for each in chosen]
        cases = Cases(
            value=numbers,
            outcome=[outcome_of(line) for line in self.lines],
            label=meaning,
            title=f"{plan.name}: {meaning}",
            note=self._note(chosen),
        )
        if len(chosen) == 2:
            return heat_map(places[0], places[1], cases, ax=ax)
        series, used = self._series(chosen[0])
        axis = plan.axes[self.axes.index(chosen[0])]
        # Random numbers have no lines: each case is a point of its own, nothing is a median.
        if axis.draw is not None and places[0].names is None:
            cases = replace(cases, series=series, drawn=True, note="")
        else:
            cases = replace(cases, series=series, note=self._note([*chosen, *used]))
        return lines(places[0], cases, ax=ax)

    def _meaning_of(self, name: str) -> str:
        """What a numeric column holds.  Raises: SpecError for another one."""
        columns = self.plan.task.columns
        numeric = {each.name: each.meaning for each in columns if each.kind in ("number", "count")}
        if name not in numeric:
            raise refused(
                "value", f"{shown(name)} is no numeric column.", f"One of {', '.join(numeric)}."
            )
        return numeric[name]

    def _drawn_axes(self, x: str | None, y: str | None) -> list[str]:
        """One axis, or two for a heat map: those named, else the first two that are listed, else
        the first."""
        axes = self.axes
        for key, name in (("x", x), ("y", y)):
            if name is not None and name not in axes:
                raise refused(
                    key, f"{shown(name)} is no axis of this sweep.", f"One of {', '.join(axes)}."
                )
        if x is not None and x == y:
            raise refused("y", "x and y must be different axes.", "Leave y out for lines.")
        listed = {axis.name: len(axis.values) for axis in self.plan.axes if len(axis.values) > 1}
        numbers = [name for name in axes if self.columns[name] == "number"]
        # Numbers that are listed first, then those that are drawn, then words.
        preferred = [*(name for name in listed if name in numbers), *numbers, *listed, *axes]
        first = x or preferred[0]
        if y is not None:
            return [first, y]
        others = [name for name in listed if name != first]
        few = any(listed[name] <= 3 for name in others)  # rather lines side by side than a thin map
        if x is not None or first not in listed or not others or few:
            return [first]
        return [first, others[0]]

    def _places(self, name: str) -> Places:
        """Where the cases stand along an axis: at their numbers, or side by side in the order
        listed."""
        from dobc_design.plotting.sweeps import Places

        place = self.axes.index(name)
        axis = self.plan.axes[place]
        label = name
        if name.rpartition(".")[2] in TIMES:
            steps = self.plan.tables.get("dynamics", {}).get("time") == "discrete"
            label += " in steps" if steps else " in s"
        if self._is_number(place):
            # Numbers stand where they are, unless no axis of a drawing can hold them ...
            numbers = np.array(self.column(name), dtype=np.float64)
            if _can_be_drawn(numbers):
                ticks = np.unique(numbers)
                even_ratios = _has_even_ratios(ticks)
                if axis.draw is not None:
                    even_ratios = axis.draw.kind == "loguniform"
                return Places(name=label, position=numbers, ticks=ticks, even_ratios=even_ratios)
        # ... all else side by side.
        texts = [line["values"][place] for line in self.lines]
        names = axis.values
        if not names:  # drawn: in their order
            names = tuple(sorted(set(texts), key=lambda text: (number_of(text) or 0, text)))
        order = {text: k for k, text in enumerate(names)}
        position = np.array([order[text] for text in texts], dtype=np.float64)
        ticks = np.arange(len(names), dtype=np.float64)
        return Places(name=label, position=position, ticks=ticks, names=names)

    def _series(self, x: str) -> tuple[list[str], list[str]]:
        """The name of each case's line, and the axes that make the lines: listed ones, as long as
        lines are few."""
        from dobc_design.plotting.sweeps import MOST_SERIES

        used = []
        count = 1
        for place, axis in enumerate(self.plan.axes):
            several = axis.name != x and len(axis.values) > 1
            if several and count * len(axis.values) <= MOST_SERIES:
                used.append(place)
                count *= len(axis.values)
        axes = [self.axes[place] for place in used]
        # A single axis need not be named in each entry of the legend.
        heads = [f"{name}=" for name in axes] if len(axes) > 1 else [""] * len(axes)
        names = []
        for line in self.lines:
            values = [line["values"][place] for place in used]
            names.append(", ".join(map("".join, zip(heads, values, strict=True))))
        return names, axes

    def _note(self, shown_axes: list[str]) -> str:
        parts = []
        for axis in self.plan.axes:
            varied = axis.draw is not None or len(axis.values) > 1
            if varied and axis.name not in shown_axes:
                parts.append(axis.name)
        return f"median over {', '.join(parts)}" if parts else ""

    def _is_number(self, place: int) -> bool:
        texts = self.plan.axes[place].values or [line["values"][place] for line in self.lines]
        return all(number_of(text) is not None for text in texts)

    @property
    def _summary(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in self.outcomes.items())
        return f"{len(self)} cases of {', '.join(self.axes)}: {counts}"

    def __str__(self) -> str:
        plan = self.plan
        lines = [f"{plan.name}, {plan.task.kind}: {self._summary}"]
        for name, kind, meaning in plan.task.columns:
            values = [each for each in self.column(name) if each is not None]
            if kind == "number" and values:
                found = f"{min(values):.4g} to {max(values):.4g}, median {np.median(values):.4g}"
                lines.append(f"  {name:<18} {found} ({len(values)} cases): {meaning}")
        return "\n".join(lines)

    def _card(self) -> Card:
        left_out = ("id", "seconds", "reason", "error")
        names = [name for name in self.columns if name not in left_out]
        rows = [[_card_cell(row[name]) for name in names] for row in self.rows[:MOST_ROWS]]
        hidden = len(self) - len(rows)
        return Card(title=self.plan.name, text=self._summary, heads=names, rows=rows, hidden=hidden)


def _card_cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def outcome_of(line: Outcome) -> str:
    """In a word how a case ended: one of ``OUTCOMES``."""
    if line["result"] is None:
        return "failed"
    if "verdict" in line["result"]:
        return str(line["result"]["verdict"])
    return "diverged" if line["result"]["diverged"] else "converged"


def _can_be_drawn(numbers: Array) -> bool:
    """Whether Matplotlib's scales hold these numbers; others are put side by side, under their
    names."""
    if not np.isfinite(numbers).all():
        return False
    # 0 is fine; what is too near to it or too far away is not.
    size = np.abs(numbers[numbers != 0])
    return not len(size) or bool(size.min() >= LEAST and size.max() <= MOST)


def _has_even_ratios(ticks: Array) -> bool:
    """Whether a logarithmic axis spreads the values better than a linear one."""
    if len(ticks) < 3 or ticks[0] <= 0 or ticks[-1] / ticks[0] < 50:
        return False
    # Even ratios on a logarithmic axis are even steps: which of the two is more even?
    ratios, steps = np.diff(np.log(ticks)), np.diff(ticks)
    unevenness_of_ratios = np.ptp(ratios) / ratios.sum()
    return bool(unevenness_of_ratios < np.ptp(steps) / steps.sum())
