"""Sweeps: one number of every case over what was varied, as a heat map, as lines, or as points.

Handed arrays; where several cases fall on one place their median is drawn, and ``spread`` from least to most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dobc_design.plotting.look import GREEN, INK, MARKERS, MUTED, PURPLE, SERIES, VERMILLION
from dobc_design.plotting.sheet import Sheet

Array = NDArray[np.float64]
MOST_SERIES = len(SERIES)
MOST_TICKS = 12  # names along an axis
MOST_MARKS = 900  # cells of a heat map that get a sign of their own
LONGEST = 18  # characters of a value at an axis

#: How an outcome is marked: a sign in a cell, a marker and a colour for points.
MARKS = {
    "proved": ("", "o", GREEN),
    "refuted": ("×", "X", VERMILLION),
    "undecided": ("?", "^", PURPLE),
    "converged": ("", "o", GREEN),
    "diverged": ("×", "X", VERMILLION),
    "failed": ("!", "v", MUTED),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Places:
    """Where cases stand along one axis: ``position`` of each case; ``ticks`` with ``names``, or none for numbers."""

    name: str
    position: Array  # (cases,)
    ticks: Array  # (places,), sorted
    names: tuple[str, ...] | None = None
    even_ratios: bool = False


def heat_map(x: Places, y: Places, value: Array, outcome: Sequence[str], *, label: str, title: str, note: str) -> Sheet:
    """The median of ``value`` at each place of a grid, and the worst outcome there as a sign."""
    grid, signs = _on_grid(x, y, value, outcome)

    def draw(figure: Figure) -> None:
        ax = figure.add_subplot()
        ax.grid(visible=False)
        shown = np.ma.masked_invalid(grid)
        mesh = ax.pcolormesh(_edges(x), _edges(y), shown, cmap="cividis", shading="flat", linewidth=0, rasterized=False)
        bar = figure.colorbar(mesh, ax=ax, pad=0.02)
        bar.outline.set_linewidth(0.5)
        bar.set_label(label)
        _name_axis(ax, x, along="x")
        _name_axis(ax, y, along="y")
        if grid.size <= MOST_MARKS:
            _sign(ax, x, y, grid, signs)
        empty = any(each in ("proved", "undecided", "converged") for each in _where_empty(grid, signs))
        _title(figure, title, "; ".join(filter(None, [_with_signs(note, signs), "white: none" if empty else ""])))

    return Sheet(draw, width=6.2, height=4.4)


def lines(
    x: Places,
    value: Array,
    outcome: Sequence[str],
    series: Sequence[str],
    *,
    label: str,
    title: str,
    note: str,
    drawn: bool,
) -> Sheet:
    """``value`` over ``x``: a line through the medians of each series; where x was ``drawn`` one point per case."""
    names = list(dict.fromkeys(series))[:MOST_SERIES]

    def draw(figure: Figure) -> None:
        ax = figure.add_subplot()
        if x.even_ratios:
            ax.set_xscale("log")
        if drawn:
            _points(ax, x.position, value, outcome, series)
        else:
            for place, name in enumerate(names):
                own = np.array([each == name for each in series])
                _line(ax, x, value, own, name=name, place=place)
        _name_axis(ax, x, along="x")
        ax.set_ylabel(label)
        if drawn or len(names) > 1:
            ax.legend(loc="best", handlelength=1.6)
        _title(figure, title, note)

    return Sheet(draw, width=6.2, height=3.8)


def _line(ax: Axes, x: Places, value: Array, own: NDArray[np.bool_], *, name: str, place: int) -> None:
    middle, low, high = (np.full(len(x.ticks), np.nan) for _ in range(3))
    for tick, where in enumerate(x.ticks):
        found = value[own & (x.position == where) & np.isfinite(value)]
        if len(found):
            middle[tick], low[tick], high[tick] = np.median(found), found.min(), found.max()
    colour = SERIES[place % len(SERIES)]
    ax.plot(x.ticks, middle, color=colour, marker=MARKERS[place % len(MARKERS)], label=_cut(name) or None)
    if np.nanmax(high - low, initial=0.0) > 0:
        ax.fill_between(x.ticks, low, high, color=colour, alpha=0.15, linewidth=0)


def _points(ax: Axes, position: Array, value: Array, outcome: Sequence[str], series: Sequence[str]) -> None:
    """One marker per case: its shape is the outcome; its colour, too, or the series where there are several."""
    names = list(dict.fromkeys(series))[:MOST_SERIES]
    for place, series_name in enumerate(names if len(names) > 1 else ()):
        ax.plot([], [], linestyle="none", marker="s", color=SERIES[place], label=_cut(series_name))
    for name, (_, marker, colour) in MARKS.items():
        own = np.array([each == name for each in outcome]) & np.isfinite(value)
        if own.any():
            ax.plot([], [], linestyle="none", marker=marker, color=MUTED if len(names) > 1 else colour, label=name)
        for place, series_name in enumerate(names):
            here = own & np.array([each == series_name for each in series])
            shade = SERIES[place] if len(names) > 1 else colour
            ax.plot(position[here], value[here], linestyle="none", marker=marker, color=shade, alpha=0.7)


def _on_grid(x: Places, y: Places, value: Array, outcome: Sequence[str]) -> tuple[Array, list[list[str]]]:
    """Medians by place, (y, x), nan where there is none; and the worst outcome of each place."""
    worst = list(MARKS)
    grid = np.full((len(y.ticks), len(x.ticks)), np.nan)
    signs = [["" for _ in x.ticks] for _ in y.ticks]
    columns, rows = np.searchsorted(x.ticks, x.position), np.searchsorted(y.ticks, y.position)
    for row in range(len(y.ticks)):
        for column in range(len(x.ticks)):
            own = np.flatnonzero((rows == row) & (columns == column)).tolist()
            found = value[own][np.isfinite(value[own])]
            if len(found):
                grid[row, column] = np.median(found)
            if len(own):
                signs[row][column] = max((outcome[k] for k in own), key=worst.index)
    return grid, signs


def _edges(axis: Places) -> Array:
    """Borders of the cells around the ticks."""
    ticks = np.log(axis.ticks) if axis.even_ratios else axis.ticks
    if len(ticks) == 1:
        borders = np.array([ticks[0] - 0.5, ticks[0] + 0.5])
    else:
        middle = (ticks[1:] + ticks[:-1]) / 2
        borders = np.concatenate([[2 * ticks[0] - middle[0]], middle, [2 * ticks[-1] - middle[-1]]])
    return np.exp(borders) if axis.even_ratios else borders


def _sign(ax: Axes, x: Places, y: Places, grid: Array, signs: Sequence[Sequence[str]]) -> None:
    bright = np.nanmean([np.nanmin(grid), np.nanmax(grid)]) if np.isfinite(grid).any() else 0.0
    for row, v in enumerate(y.ticks):
        for column, u in enumerate(x.ticks):
            sign = MARKS[signs[row][column]][0] if signs[row][column] else ""
            dark = np.isfinite(grid[row, column]) and grid[row, column] < bright
            if sign:
                ax.text(u, v, sign, ha="center", va="center", color="white" if dark else INK, fontsize=8)


def _where_empty(grid: Array, signs: Sequence[Sequence[str]]) -> list[str]:
    return [signs[row][column] for row, column in np.argwhere(~np.isfinite(grid)).tolist()]


def _with_signs(note: str, signs: Sequence[Sequence[str]]) -> str:
    present = {each for row in signs for each in row if each}
    told = [f"{MARKS[name][0]} {name}" for name in MARKS if name in present and MARKS[name][0]]
    return "; ".join(filter(None, [note, ", ".join(told)]))


def _name_axis(ax: Axes, axis: Places, *, along: str) -> None:
    own = ax.xaxis if along == "x" else ax.yaxis
    if axis.even_ratios:
        (ax.set_xscale if along == "x" else ax.set_yscale)("log")
    own.set_label_text(axis.name, parse_math=False)
    if axis.names is not None:
        step = -(-len(axis.names) // MOST_TICKS)
        own.set_ticks(axis.ticks[::step], [_cut(name) for name in axis.names[::step]], parse_math=False)
        own.set_tick_params(length=0)
        if along == "x" and max(map(len, axis.names)) > 8:
            own.set_tick_params(rotation=20)
    elif not axis.even_ratios and np.all(axis.ticks == np.round(axis.ticks)) and len(axis.ticks) <= MOST_TICKS:
        own.set_major_locator(MaxNLocator(integer=True))


def _title(figure: Figure, title: str, note: str) -> None:
    figure.suptitle(f"{title}\n{note}" if note else title, fontsize=9.5, x=0.01, ha="left", parse_math=False)


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
