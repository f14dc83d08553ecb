"""One number over what was varied: sweeps as a heat map, lines or points; what breaks first;
trade-offs of a design.

Handed arrays; where several cases fall on one place their median is drawn, and ``spread`` from
least to most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from numpy.typing import NDArray

from dobc_design.plotting import look
from dobc_design.plotting.look import (
    BLUE,
    DASHED,
    GREEN,
    INK,
    MUTED,
    PURPLE,
    SERIES,
    VERMILLION,
    Sheet,
    short,
)

Array = NDArray[np.float64]
MOST_SERIES = len(SERIES)
MOST_TICKS = 12  # names along an axis
MOST_MARKS = 900  # cells of a heat map that get a sign of their own

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
    """Where cases stand along one axis: ``position`` of each case; ``ticks`` with ``names``, or
    none for numbers."""

    name: str
    position: Array  # (cases,)
    ticks: Array  # (places,), sorted
    names: tuple[str, ...] | None = None
    even_ratios: bool = False


def heat_map(
    x: Places,
    y: Places,
    value: Array,
    outcome: Sequence[str],
    *,
    label: str,
    title: str,
    note: str,
    ax: Axes | None = None,
) -> Sheet | Axes:
    """The median of ``value`` at each place of a grid, and the worst outcome there as a sign."""
    grid, signs = _on_grid(x, y, value, outcome)

    def draw(ax: Axes) -> Axes:
        ax.grid(visible=False)
        shown = np.ma.masked_invalid(grid)
        mesh = ax.pcolormesh(
            _edges(x),
            _edges(y),
            shown,
            cmap="cividis",
            shading="flat",
            linewidth=0,
            rasterized=False,
        )
        bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02)
        bar.outline.set_linewidth(0.5)
        bar.set_label(label)
        _name_axis(ax, x, along="x")
        _name_axis(ax, y, along="y")
        bright = np.nanmean([np.nanmin(grid), np.nanmax(grid)]) if np.isfinite(grid).any() else 0.0
        for row, column in np.ndindex(grid.shape) if grid.size <= MOST_MARKS else ():
            sign, colour = (
                MARKS.get(signs[row][column], ("",))[0],
                "white" if grid[row, column] < bright else INK,
            )
            if sign:
                at = float(x.ticks[column]), float(y.ticks[row])
                ax.text(*at, sign, ha="center", va="center", color=colour, fontsize=8)
        present = {each for row in signs for each in row}
        told = ", ".join(
            f"{sign} {name}" for name, (sign, _, _) in MARKS.items() if sign and name in present
        )
        white = {signs[row][column] for row, column in np.argwhere(~np.isfinite(grid)).tolist()}
        empty = "white: none" if white & {"proved", "undecided", "converged"} else ""
        return _title(ax, title, "; ".join(filter(None, [note, told, empty])))

    return look.sheet_or_axes(draw, ax, width=6.2, height=4.4)


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
    ax: Axes | None = None,
) -> Sheet | Axes:
    """``value`` over ``x``: a line through the medians of each series; where x was ``drawn`` one
    point per case."""
    names = list(dict.fromkeys(series))[:MOST_SERIES]

    def draw(ax: Axes) -> Axes:
        if x.even_ratios:
            ax.set_xscale("log")
        if drawn:
            _points(ax, x.position, value, outcome, series)
        for place, name in enumerate(() if drawn else names):
            _line(ax, x, value, np.array([each == name for each in series]), name=name, place=place)
        _name_axis(ax, x, along="x")
        ax.set_ylabel(label)
        if drawn or len(names) > 1:
            ax.legend(loc="best", handlelength=1.6)
        return _title(ax, title, note)

    return look.sheet_or_axes(draw, ax, width=6.2, height=3.8)


def _line(
    ax: Axes, x: Places, value: Array, own: NDArray[np.bool_], *, name: str, place: int
) -> None:
    middle, low, high = (np.full(len(x.ticks), np.nan) for _ in range(3))
    for tick, where in enumerate(x.ticks):
        found = value[own & (x.position == where) & np.isfinite(value)]
        if len(found):
            middle[tick], low[tick], high[tick] = np.median(found), found.min(), found.max()
    colour = SERIES[place % len(SERIES)]
    ax.plot(
        x.ticks,
        middle,
        color=colour,
        marker=look.MARKERS[place % len(look.MARKERS)],
        label=short(name) or None,
    )
    if np.nanmax(high - low, initial=0.0) > 0:
        ax.fill_between(x.ticks, low, high, color=colour, alpha=0.15, linewidth=0)


def _points(
    ax: Axes, position: Array, value: Array, outcome: Sequence[str], series: Sequence[str]
) -> None:
    """One marker per case: its shape is the outcome; its colour, too, or the series where there are
    several."""
    names = list(dict.fromkeys(series))[:MOST_SERIES]
    for place, series_name in enumerate(names if len(names) > 1 else ()):
        ax.plot([], [], linestyle="none", marker="s", color=SERIES[place], label=short(series_name))
    for name, (_, marker, colour) in MARKS.items():
        own = np.array([each == name for each in outcome]) & np.isfinite(value)
        if own.any():
            ax.plot(
                [],
                [],
                linestyle="none",
                marker=marker,
                color=MUTED if len(names) > 1 else colour,
                label=name,
            )
        for place, series_name in enumerate(names):
            here = own & np.array([each == series_name for each in series])
            shade = SERIES[place] if len(names) > 1 else colour
            ax.plot(
                position[here], value[here], linestyle="none", marker=marker, color=shade, alpha=0.7
            )


def _on_grid(
    x: Places, y: Places, value: Array, outcome: Sequence[str]
) -> tuple[Array, list[list[str]]]:
    """Medians by place, (y, x), nan where there is none; and the worst outcome of each place."""
    grid = np.full((len(y.ticks), len(x.ticks)), np.nan)
    signs = [["" for _ in x.ticks] for _ in y.ticks]
    columns, rows = np.searchsorted(x.ticks, x.position), np.searchsorted(y.ticks, y.position)
    for row, column in np.ndindex(grid.shape):
        own = np.flatnonzero((rows == row) & (columns == column)).tolist()
        found = value[own][np.isfinite(value[own])]
        if len(found):
            grid[row, column] = np.median(found)
        signs[row][column] = max((outcome[k] for k in own), key=list(MARKS).index, default="")
    return grid, signs


def _edges(axis: Places) -> Array:
    ticks = np.log(axis.ticks) if axis.even_ratios else axis.ticks
    middle = (ticks[1:] + ticks[:-1]) / 2
    first, last = (middle[0], middle[-1]) if len(ticks) > 1 else (ticks[0] + 0.5, ticks[0] - 0.5)
    borders = np.concatenate([[2 * ticks[0] - first], middle, [2 * ticks[-1] - last]])
    return np.exp(borders) if axis.even_ratios else borders


def _name_axis(ax: Axes, axis: Places, *, along: str) -> None:
    own = ax.xaxis if along == "x" else ax.yaxis
    if axis.even_ratios:
        (ax.set_xscale if along == "x" else ax.set_yscale)("log")
    own.set_label_text(axis.name, parse_math=False)
    if axis.names is not None:
        step = -(-len(axis.names) // MOST_TICKS)
        own.set_ticks(
            axis.ticks[::step], [short(name) for name in axis.names[::step]], parse_math=False
        )
        own.set_tick_params(length=0)
        if along == "x" and max(map(len, axis.names)) > 8:
            own.set_tick_params(rotation=20)
    elif (
        not axis.even_ratios
        and np.all(axis.ticks == np.round(axis.ticks))
        and len(axis.ticks) <= MOST_TICKS
    ):
        own.set_major_locator(MaxNLocator(integer=True))


def _title(ax: Axes, title: str, note: str = "") -> Axes:
    ax.set_title(f"{title}\n{note}" if note else title, loc="left", parse_math=False)
    return ax


COLUMNS = 3  # of panels
MOST_FINE_TICKS = 200  # end over begin of an axis up to which 1, 2 and 5 of every decade are marked
UNITS = {
    "unit of x": "in the unit of x",
    "unit of x per s": "in units of x per s",
    "unit of u": "in units of u",
    "agents": "count",
    "probability": "probability",
}
LINEAR = ("loss", "failures")  # severities that are counts or probabilities
TITLES = {
    "noise": "measurement noise",
    "disturbance": "unmodelled disturbance",
    "saturation": "bound on |u|",
    "period": "sampling period",
    "loss": "packets lost",
    "failures": "agents that fail",
}


def breaking_sheet(
    sweeps: Sequence[Any],
    *,
    tolerance: float,
    period: float | None,
    certified: float | None,
    name: str,
) -> Sheet:
    """A panel for each ``simulation.breaking.Sweep``; ``period``, ``certified``: the longest
    sampling periods, in s."""
    rows = -(-len(sweeps) // COLUMNS)

    def draw(figure: Figure) -> None:
        grid = np.atleast_1d(
            figure.subplots(rows, min(COLUMNS, len(sweeps)), sharey=True, squeeze=False)
        ).ravel()
        shown = [each.late[np.isfinite(each.late)] for each in sweeps]
        top = max(
            10 * tolerance, 2 * max((float(each.max()) for each in shown if len(each)), default=1.0)
        )
        bottom = max(
            min([tolerance / 3, *(float(each.min()) for each in shown if len(each))]) / 2, 1e-12
        )
        for place, (ax, sweep) in enumerate(zip(grid, sweeps, strict=False)):
            _panel(ax, sweep, tolerance=tolerance, bottom=bottom, top=top)
            if sweep.option == "period":
                _periods(ax, period, certified)
            if place % COLUMNS == 0:
                ax.set_ylabel("late error / start")
        for ax in grid[len(sweeps) :]:
            ax.set_axis_off()
        figure.suptitle(
            f"{name}: what breaks first", fontsize=10, x=0.01, ha="left", parse_math=False
        )

    return Sheet(draw, width=7.4, height=0.5 + 2.1 * rows)


def plot_breaking(ax: Axes, sweeps: Sequence[Any], *, tolerance: float, name: str) -> Axes:
    """All stresses in one picture: the late error over the severity in natural units, 0 to about
    1."""
    for place, each in enumerate(sweeps):
        late = np.where(np.isfinite(each.late), each.late, np.nan)
        colour, marker = SERIES[place % len(SERIES)], look.MARKERS[place % len(look.MARKERS)]
        ax.plot(
            each.relative,
            late,
            color=colour,
            marker=marker,
            label=TITLES.get(each.option, each.option),
        )
    ax.axhline(tolerance, color=VERMILLION, linewidth=1.0, linestyle=DASHED, label="breaks above")
    ax.set(yscale="log", xlabel="severity in natural units", ylabel="late error / start")
    ax.legend(loc="best", handlelength=1.4)
    return _title(ax, f"{short(name, 60)}: what breaks first")


def _panel(ax: Axes, sweep: Any, *, tolerance: float, bottom: float, top: float) -> None:
    late = np.where(np.isfinite(sweep.late), sweep.late, top)
    good = late <= tolerance
    ax.set_yscale("log")
    if sweep.option not in LINEAR:
        ax.set_xscale("log")
    ax.axhspan(tolerance, 1e6 * top, color=VERMILLION, alpha=0.1, linewidth=0)
    ax.axhline(tolerance, color=VERMILLION, linewidth=1.0)
    ax.plot(sweep.severity, late, color=INK, linewidth=0.9)
    ax.plot(sweep.severity[good], late[good], linestyle="none", marker="o", color=BLUE)
    ax.plot(
        sweep.severity[~good],
        late[~good],
        linestyle="none",
        marker="X",
        markersize=7,
        color=VERMILLION,
    )
    ax.set_ylim(bottom, 1.5 * top)
    if sweep.option == "saturation":
        ax.invert_xaxis()  # severe is to the right, as everywhere
    ax.set_title(TITLES.get(sweep.option, sweep.option))
    ax.set_xlabel(
        ("never breaks; " if sweep.breaks is None else "")
        + UNITS.get(sweep.unit, f"in {sweep.unit}")
    )
    ax.yaxis.set_major_formatter(FuncFormatter(look.power_of_ten))
    if sweep.option not in LINEAR:
        look.tick_numbers(ax.xaxis)
    elif sweep.option == "failures":
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_xlim(0, float(sweep.severity[-1]) + 1)
    ax.minorticks_off()


def _periods(ax: Axes, period: float | None, certified: float | None) -> None:
    if period is not None:
        ax.axvline(period, color=BLUE, linewidth=1.0, linestyle=DASHED, label="longest that works")
    if certified is not None:
        ax.axvline(certified, color=GREEN, linewidth=1.2, label="certified")
        low, high = sorted(ax.get_xlim())
        if high > MOST_FINE_TICKS * low:
            ax.xaxis.set_major_locator(LogLocator(numticks=5))
            ax.xaxis.set_major_formatter(FuncFormatter(look.power_of_ten))
            ax.minorticks_off()
    if period is not None or certified is not None:
        ax.legend(
            loc="center left",
            bbox_to_anchor=(0.06, 0.45),
            handlelength=1.4,
            frameon=True,
            edgecolor="none",
        )


STEEP = 30  # times the least y from which the axis is logarithmic


def trade_off_plot(
    points: Sequence[tuple[float, float]],
    *,
    x_name: str,
    y_name: str,
    chosen: tuple[float, float] | None,
    name: str,
    steps: bool,
    ax: Axes | None = None,
) -> Sheet | Axes:
    """The points in order of x; ``steps``: x counts, so that nothing lies between two points."""

    def draw(ax: Axes) -> Axes:
        xs, ys = [x for x, _ in points], [y for _, y in points]
        if steps:
            ax.vlines(xs, 0, ys, color=MUTED, linewidth=0.8)
            ax.plot(xs, ys, linestyle="none", marker="o", color=BLUE)
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
            ax.set_xlim(0, max(xs, default=1.0) + 1)
        else:
            ax.plot(xs, ys, marker="o", markersize=4, color=BLUE)
        if chosen is not None:
            ax.plot(*chosen, linestyle="none", marker="D", markersize=8, color=VERMILLION, zorder=3)
            ax.annotate(
                "chosen",
                chosen,
                xytext=(8, -3),
                textcoords="offset points",
                color=VERMILLION,
                va="top",
            )
        heights = [y for y in (*ys, *([] if chosen is None else chosen[1:])) if y > 0]
        if heights and max(heights) > STEEP * min(heights):
            ax.set_yscale("log")
            look.tick_numbers(ax.yaxis)
            ax.minorticks_off()
        else:
            ax.set_ylim(bottom=0)
        ax.set(xlabel=x_name, ylabel=y_name)
        return _title(ax, short(name, 60))

    return look.sheet_or_axes(draw, ax, width=5.2, height=3.4)
