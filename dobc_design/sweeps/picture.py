"""Which figure a sweep gets: what is drawn over what, and what the figure has to say about it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.plotting.sheet import Sheet
from dobc_design.plotting.sweeps import MOST_SERIES, Places, heat_map, lines

if TYPE_CHECKING:
    from dobc_design.sweeps.result import SweepResult

DEFAULT = {"certify": "rate", "simulate": "settling_time"}


def sweep_picture(result: SweepResult, *, value: str | None, x: str | None, y: str | None) -> Sheet:
    """See ``SweepResult.plot``.  Raises: SpecError for names that do not fit, or when there is nothing to be drawn."""
    name = value or DEFAULT[result.plan.task.kind]
    numbers = _column(result, name)
    if not np.isfinite(numbers).any():
        raise SpecError(
            f"no case has a {name}, so there is nothing to be drawn.", key="value", cure="Choose another column."
        )
    chosen = _axes(result, x, y)
    outcome = [_told(line) for line in result.lines]
    meaning = next(text for column, _, text in result.plan.task.columns if column == name)
    first = _places(result, chosen[0])
    title = f"{result.plan.base.name}: {meaning}"
    drawn = result.plan.axes[result.axes.index(chosen[0])].draw is not None and first.names is None
    if len(chosen) == 2:
        second = _places(result, chosen[1])
        note = _note(result, chosen)
        return heat_map(first, second, numbers, outcome, label=meaning, title=title, note=note)
    series, used = _series(result, chosen[0])
    note = "" if drawn else _note(result, [chosen[0], *used])
    return lines(first, numbers, outcome, series, label=meaning, title=title, note=note, drawn=drawn)


def _column(result: SweepResult, name: str) -> NDArray[np.float64]:
    kinds = result.columns
    if kinds.get(name) not in ("number", "count") or name in (*result.axes, "case"):
        known = [each for each, kind, _ in result.plan.task.columns if kind in ("number", "count")]
        raise SpecError(f"{shown(name)} is no numeric column.", key="value", cure=f"One of {', '.join(known)}.")
    return np.array([math.nan if each is None else float(each) for each in result.column(name)])


def _axes(result: SweepResult, x: str | None, y: str | None) -> list[str]:
    """One axis, or two for a heat map: those named, else the first two that are listed, else the first."""
    for key, name in (("x", x), ("y", y)):
        if name is not None and name not in result.axes:
            raise SpecError(
                f"{shown(name)} is no axis of this sweep.", key=key, cure=f"One of {', '.join(result.axes)}."
            )
    if x is not None and x == y:
        raise SpecError("x and y must be different axes.", key="y", cure="Leave y out for lines.")
    listed = [axis.name for axis in result.plan.axes if axis.draw is None and len(axis.values) > 1]
    numbers = [name for name in result.axes if result.columns[name] == "number"]
    first = x or next(iter([*(name for name in listed if name in numbers), *numbers, *listed, *result.axes]))
    if y is not None:
        return [first, y]
    if x is not None:
        return [first]
    if first not in listed:
        return [first]
    others = [name for name in listed if name != first]
    few = [name for name in others if _count(result, name) <= 3]  # rather lines side by side than a thin map
    return [first] if not others or few else [first, others[0]]


def _count(result: SweepResult, name: str) -> int:
    return len(result.plan.axes[result.axes.index(name)].values)


def _places(result: SweepResult, name: str) -> Places:
    """Where the cases stand along an axis: at their numbers, or side by side in the order listed."""
    place = result.axes.index(name)
    axis = result.plan.axes[place]
    if result.columns[name] == "number":
        position = np.array(result.column(name), dtype=np.float64)
        ticks = np.unique(position)
        even_ratios = _has_even_ratios(ticks) if axis.draw is None else axis.draw.kind == "loguniform"
        return Places(name=name, position=position, ticks=ticks, even_ratios=even_ratios)
    names = axis.values if axis.draw is None else tuple(sorted({line["values"][place] for line in result.lines}))
    order = {text: k for k, text in enumerate(names)}
    position = np.array([order[line["values"][place]] for line in result.lines], dtype=np.float64)
    return Places(name=name, position=position, ticks=np.arange(len(names), dtype=np.float64), names=names)


def _has_even_ratios(ticks: NDArray[np.float64]) -> bool:
    """Whether a logarithmic axis spreads the values better than a linear one."""
    if len(ticks) < 3 or ticks[0] <= 0 or ticks[-1] / ticks[0] < 50:
        return False
    return bool(
        np.ptp(np.diff(np.log(ticks))) < np.ptp(np.diff(ticks)) / (ticks[-1] - ticks[0]) * np.ptp(np.log(ticks))
    )


def _series(result: SweepResult, x: str) -> tuple[list[str], list[str]]:
    """The name of each case's line, and the axes that make the lines: listed ones, as long as there are few lines."""
    used: list[str] = []
    count = 1
    for axis in result.plan.axes:
        if axis.name != x and axis.draw is None and len(axis.values) > 1 and count * len(axis.values) <= MOST_SERIES:
            used.append(axis.name)
            count *= len(axis.values)
    places = [result.axes.index(name) for name in used]
    short = len(used) == 1
    return [
        ", ".join(line["values"][k] if short else f"{result.axes[k]}={line['values'][k]}" for k in places)
        for line in result.lines
    ], used


def _note(result: SweepResult, shown_axes: list[str]) -> str:
    others = [axis for axis in result.plan.axes if axis.name not in shown_axes]
    parts = [axis.name for axis in others if axis.draw is not None or len(axis.values) > 1]
    return f"median over {', '.join(parts)}" if parts else ""


def _told(line: dict[str, Any]) -> str:
    from dobc_design.sweeps.result import outcome_of

    return outcome_of(line)
