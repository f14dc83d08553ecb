"""One number over what was varied: sweeps as a heat map, lines or points; what breaks first;
trade-offs of a design.

Handed arrays; where several cases fall on one place their median is drawn, and ``spread`` from
least to most.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from dobc_design._checks import noun

from .look import (
    BLUE,
    DASHED,
    GREEN,
    INK,
    MARKERS,
    MUTED,
    PURPLE,
    SERIES,
    VERMILLION,
    Sheet,
    fit_heights,
    power_of_ten,
    sheet_or_axes,
    short,
    spans_decades,
    tick_numbers,
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


@noun(eq=False)
class Places:
    """Where cases stand along one axis: ``position`` of each case; ``ticks`` with ``names``, or
    none for numbers."""

    name: str
    position: Array  # (cases,)
    ticks: Array  # (places,), sorted
    names: tuple[str, ...] | None = None
    even_ratios: bool = False


@noun(eq=False)
class Cases:
    """One number of many cases: ``value`` and ``outcome`` (cases,), and what is said about it.

    ``series`` names the line of each case; where cases were ``drawn`` at random there is none, but
    a point for each case.
    """

    value: Array
    outcome: Sequence[str]
    label: str
    title: str
    note: str
    series: Sequence[str] = ()
    drawn: bool = False

    @property
    def lines(self) -> list[str]:
        """The names of the lines, at most six."""
        return list(dict.fromkeys(self.series))[:MOST_SERIES]

    def of(self, line: str) -> NDArray[np.bool_]:
        """The cases of a line."""
        return np.array([each == line for each in self.series])


def heat_map(x: Places, y: Places, cases: Cases, *, ax: Axes | None = None) -> Sheet | Axes:
    """The median at each place of a grid, and the worst outcome there as a sign."""
    grid, signs = _on_grid(x, y, cases)

    def draw(ax: Axes) -> Axes:
        ax.grid(visible=False)
        shown = np.ma.masked_invalid(grid)
        norm = "log" if spans_decades(grid) else "linear"
        mesh = ax.pcolormesh(_edges(x), _edges(y), shown, cmap="cividis", norm=norm)
        mesh.set(linewidth=0, rasterized=False)
        bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02)
        bar.outline.set_linewidth(0.5)
        bar.set_label(cases.label)
        _name_axis(ax, x, along="x")
        _name_axis(ax, y, along="y")
        if grid.size <= MOST_MARKS:
            _draw_signs(ax, x, y, grid, signs)
        notes = [cases.note, *_told(grid, signs)]
        return _title(ax, cases.title, "; ".join(filter(None, notes)))

    return sheet_or_axes(draw, ax, width=6.2, height=4.4)


def _draw_signs(ax: Axes, x: Places, y: Places, grid: Array, signs: list[list[str]]) -> None:
    """The sign of the worst outcome in every cell, so that it can be seen on the cell's colour."""
    bright = 0.0
    if np.isfinite(grid).any():
        # Half way between the darkest and the brightest colour that occurs.
        ends = np.array([np.nanmin(grid), np.nanmax(grid)])
        bright = np.sqrt(ends.prod()) if spans_decades(grid) else ends.mean()
    for row, column in np.ndindex(grid.shape):
        outcome = signs[row][column]
        sign = MARKS[outcome][0] if outcome else ""
        if sign:
            colour = "white" if grid[row, column] < bright else INK
            at = float(x.ticks[column]), float(y.ticks[row])
            ax.text(*at, sign, ha="center", va="center", color=colour, fontsize=8)


def _told(grid: Array, signs: list[list[str]]) -> tuple[str, str]:
    """What the signs mean, and what white cells do, for those that are there."""
    present = {each for row in signs for each in row}
    meanings = [f"{MARKS[name][0]} {name}" for name in MARKS if name in present and MARKS[name][0]]
    cells = np.argwhere(~np.isfinite(grid)).tolist()
    white = {signs[row][column] for row, column in cells}
    empty = "white: none" if white & {"proved", "undecided", "converged"} else ""
    return ", ".join(meanings), empty


def lines(x: Places, cases: Cases, *, ax: Axes | None = None) -> Sheet | Axes:
    """The number over ``x``: a line through the medians of each series, or a point per case."""

    def draw(ax: Axes) -> Axes:
        if cases.drawn:
            _points(ax, x.position, cases)
        else:
            for place, name in enumerate(cases.lines):
                _line(ax, x, cases, name=name, place=place)
        _name_axis(ax, x, along="x")
        if spans_decades(cases.value):
            fit_heights(ax, cases.value)
        ax.set_ylabel(cases.label)
        empty = _without_number(ax, x, cases)
        if cases.drawn or empty or len(cases.lines) > 1:
            ax.legend(loc="best", handlelength=1.6)
        return _title(ax, cases.title, cases.note)

    return sheet_or_axes(draw, ax, width=6.2, height=3.8)


def _without_number(ax: Axes, x: Places, cases: Cases) -> bool:
    """Mark cases without a number on the axis, where there are any: an open one is an answer,
    too."""
    empty = ~np.isfinite(cases.value)
    for outcome, (_, marker, colour) in MARKS.items():
        own = empty & (np.array(cases.outcome) == outcome)
        if own.any():
            ax.plot(
                x.position[own],
                np.zeros(np.count_nonzero(own)),
                linestyle="none",
                marker=marker,
                color=colour,
                label=f"{outcome}, no number",
                transform=ax.get_xaxis_transform(),
                clip_on=False,
            )
    return bool(empty.any())


def _line(ax: Axes, x: Places, cases: Cases, *, name: str, place: int) -> None:
    own = cases.of(name) & np.isfinite(cases.value)
    middle = np.full(len(x.ticks), np.nan)
    low, high = middle.copy(), middle.copy()
    for tick, where in enumerate(x.ticks):
        found = cases.value[own & (x.position == where)]
        if len(found):
            middle[tick] = np.median(found)
            low[tick] = found.min()
            high[tick] = found.max()
    colour = SERIES[place % len(SERIES)]
    marker = MARKERS[place % len(MARKERS)]
    (line,) = ax.plot(x.ticks, middle, color=colour, marker=marker)
    if name:
        line.set_label(short(name))
    # A band only where several cases fall on one place.
    if np.nanmax(high - low, initial=0.0) > 0:
        ax.fill_between(x.ticks, low, high, color=colour, alpha=0.15, linewidth=0)


def _points(ax: Axes, position: Array, cases: Cases) -> None:
    """One marker per case: its shape is the outcome; its colour, too, or the series where there are
    several."""
    names = cases.lines
    several = len(names) > 1
    # Colours are the series where there are several; then outcomes are told by shapes alone.
    if several:
        for name, shade in zip(names, SERIES, strict=False):
            _marks(ax, (), (), marker="s", color=shade).set_label(short(name))
    for outcome, (_, marker, colour) in MARKS.items():
        own = np.array([each == outcome for each in cases.outcome]) & np.isfinite(cases.value)
        if own.any():
            entry = _marks(ax, (), (), marker=marker, color=MUTED if several else colour)
            entry.set_label(outcome)
        for name, shade in zip(names, SERIES, strict=False):
            here = own & cases.of(name)
            points = _marks(ax, position[here], cases.value[here], marker=marker, color=colour)
            points.set_alpha(0.7)
            if several:
                points.set_color(shade)


def _marks(ax: Axes, x: ArrayLike, y: ArrayLike, *, marker: str, color: str) -> Line2D:
    """Markers without a line."""
    (made,) = ax.plot(x, y, linestyle="none", marker=marker, color=color)
    return made


def _on_grid(x: Places, y: Places, cases: Cases) -> tuple[Array, list[list[str]]]:
    """Medians by place, (y, x), nan where there is none; and the worst outcome of each place."""
    size = len(y.ticks), len(x.ticks)
    grid = np.full(size, np.nan)
    signs = [["" for _ in x.ticks] for _ in y.ticks]
    columns = np.searchsorted(x.ticks, x.position)
    rows = np.searchsorted(y.ticks, y.position)
    # MARKS lists outcomes from the best to the worst of their task.
    worst = list(MARKS).index
    for row, column in np.ndindex(grid.shape):
        own = np.flatnonzero((rows == row) & (columns == column)).tolist()
        found = cases.value[own]
        found = found[np.isfinite(found)]
        if len(found):
            grid[row, column] = np.median(found)
        outcomes = [cases.outcome[k] for k in own]
        signs[row][column] = max(outcomes, key=worst, default="")
    return grid, signs


def _edges(axis: Places) -> Array:
    ticks = np.log(axis.ticks) if axis.even_ratios else axis.ticks
    middle = (ticks[1:] + ticks[:-1]) / 2
    # The first and the last place are as wide as their neighbours, a single one as 1.
    if len(ticks) > 1:
        first, last = middle[0], middle[-1]
    else:
        first, last = ticks[0] + 0.5, ticks[0] - 0.5
    begin = 2 * ticks[0] - first
    end = 2 * ticks[-1] - last
    borders = np.concatenate([[begin], middle, [end]])
    return np.exp(borders) if axis.even_ratios else borders


def _name_axis(ax: Axes, axis: Places, *, along: str) -> None:
    own = ax.xaxis if along == "x" else ax.yaxis
    if axis.even_ratios:
        ax.set(**{f"{along}scale": "log"})
    own.set_label_text(axis.name, parse_math=False)
    if axis.names is not None:
        # Every second name, or third, so that at most twelve stand there.
        step = -(-len(axis.names) // MOST_TICKS)
        names = [short(name) for name in axis.names[::step]]
        own.set_ticks(axis.ticks[::step], names, parse_math=False)
        own.set_tick_params(length=0)
        if along == "x" and max(map(len, axis.names)) > 8:
            own.set_tick_params(rotation=20)
        return
    are_whole = np.all(axis.ticks == np.round(axis.ticks))
    if not axis.even_ratios and are_whole and len(axis.ticks) <= MOST_TICKS:
        own.set_major_locator(MaxNLocator(integer=True))


def _title(ax: Axes, title: str, note: str = "") -> Axes:
    ax.set_title(f"{title}\n{note}" if note else title, loc="left", parse_math=False)
    return ax


COLUMNS = 3  # of panels
MOST_FINE_TICKS = 200  # end over begin of an axis up to which 1, 2 and 5 of every decade are marked
UNITS = {
    "unit of x": "in units of x",
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
    "delay": "age of all readings",
    "loss": "packets lost",
    "failures": "agents that fail",
}


Sweep = Any  # of one stress: simulation.breaking.Sweep, whose room rests on this one


def breaking_sheet(
    sweeps: Sequence[Sweep],
    *,
    tolerance: float,
    period: float | None,
    certified: float | None,
    name: str,
) -> Sheet:
    """A panel for each stress; ``period``, ``certified``: the longest sampling periods, in s."""
    rows = -(-len(sweeps) // COLUMNS)
    columns = min(COLUMNS, len(sweeps))
    limits = _limits(sweeps, tolerance)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
        grid = np.atleast_1d(panels).ravel()
        for place, (ax, sweep) in enumerate(zip(grid, sweeps, strict=False)):
            _panel(ax, sweep, tolerance=tolerance, limits=limits)
            if sweep.option == "period":
                _periods(ax, period, certified)
            if place % COLUMNS == 0:
                ax.set_ylabel("late error / start")
        for ax in grid[len(sweeps) :]:
            ax.set_axis_off()

    title = f"{name}: what breaks first"
    return Sheet(draw, width=7.4, height=0.5 + 2.1 * rows, title=title)


def _limits(sweeps: Sequence[Sweep], tolerance: float) -> tuple[float, float]:
    """Where the axis of late errors, which all panels share, begins, and half way of its end."""
    finite = [each.late[np.isfinite(each.late)] for each in sweeps]
    shown = [each for each in finite if len(each)]
    largest = max((each.max() for each in shown), default=1.0)
    smallest = [each.min() for each in shown]
    least = min([tolerance / 3, *smallest])
    begin = max(least / 2, 1e-12)
    return begin, max(10 * tolerance, 2 * largest)


def plot_breaking(ax: Axes, sweeps: Sequence[Sweep], *, tolerance: float, name: str) -> Axes:
    """All stresses in one picture: the late error over the severity in natural units, 0 to about
    1."""
    for place, each in enumerate(sweeps):
        late = np.where(np.isfinite(each.late), each.late, np.nan)
        label = TITLES.get(each.option, each.option)
        (line,) = ax.plot(each.relative, late, label=label)
        line.set_color(SERIES[place % len(SERIES)])
        line.set_marker(MARKERS[place % len(MARKERS)])
    ax.axhline(tolerance, color=VERMILLION, linewidth=1.0, linestyle=DASHED, label="breaks above")
    ax.set(yscale="log", xlabel="severity in natural units", ylabel="late error / start")
    ax.legend(loc="best", handlelength=1.4)
    return _title(ax, f"{short(name, 60)}: what breaks first")


def _panel(ax: Axes, sweep: Sweep, *, tolerance: float, limits: tuple[float, float]) -> None:
    bottom, top = limits
    # A run that diverged stands at the top.
    late = np.where(np.isfinite(sweep.late), sweep.late, top)
    good = late <= tolerance
    linear = sweep.option in LINEAR
    ax.set_yscale("log")
    if not linear:
        ax.set_xscale("log")
    # All above the tolerance is broken, however far the axis goes.
    ax.axhspan(tolerance, 1e6 * top, color=VERMILLION, alpha=0.1, linewidth=0)
    ax.axhline(tolerance, color=VERMILLION, linewidth=1.0)
    ax.plot(sweep.severity, late, color=INK, linewidth=0.9)
    _marks(ax, sweep.severity[good], late[good], marker="o", color=BLUE)
    crosses = _marks(ax, sweep.severity[~good], late[~good], marker="X", color=VERMILLION)
    crosses.set_markersize(7)
    ax.set_ylim(bottom, 1.5 * top)
    if sweep.option == "saturation":
        ax.invert_xaxis()  # severe is to the right, as everywhere
    ax.set_title(TITLES.get(sweep.option, sweep.option))
    said = "never breaks; " if sweep.breaks is None else ""
    ax.set_xlabel(said + UNITS.get(sweep.unit, f"in {sweep.unit}"))
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    if not linear:
        tick_numbers(ax.xaxis)
    elif sweep.option == "failures":
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_xlim(0, sweep.severity[-1] + 1)
    ax.minorticks_off()


def _periods(ax: Axes, period: float | None, certified: float | None) -> None:
    if period is not None:
        ax.axvline(period, color=BLUE, linewidth=1.0, linestyle=DASHED, label="longest that works")
    if certified is not None:
        ax.axvline(certified, color=GREEN, linewidth=1.2, label="certified")
        # Over many decades 1, 2 and 5 of each would run into each other.
        low, high = sorted(ax.get_xlim())
        if high > MOST_FINE_TICKS * low:
            ax.xaxis.set_major_locator(LogLocator(numticks=5))
            ax.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
            ax.minorticks_off()
    if period is not None or certified is not None:
        legend = ax.legend(loc="center left", bbox_to_anchor=(0.06, 0.45), handlelength=1.4)
        legend.set_frame_on(True)
        legend.get_frame().set_edgecolor("none")


TradeOff = Any  # synthesis.joint.claim.TradeOff, whose room rests on this one


def trade_off_plot(found: TradeOff, *, steps: bool, ax: Axes | None = None) -> Sheet | Axes:
    """The designs as points; ``steps``: x counts, so that nothing lies between two points."""

    def draw(ax: Axes) -> Axes:
        xs = [point.x for point in found.points]
        ys = [point.y for point in found.points]
        if steps:
            ax.vlines(xs, 0, ys, color=MUTED, linewidth=0.8)
            _marks(ax, xs, ys, marker="o", color=BLUE)
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
            ax.set_xlim(0, max(xs, default=1.0) + 1)
        else:
            ax.plot(xs, ys, marker="o", markersize=4, color=BLUE)
        if found.chosen is not None:
            _draw_chosen(ax, found.chosen)
            ys = [*ys, found.chosen.y]
        # One far point must not press all others to the ground.
        fit_heights(ax, np.array([y for y in ys if y > 0]))
        ax.set(xlabel=found.x_name, ylabel=found.y_name)
        return _title(ax, short(found.name, 60))

    return sheet_or_axes(draw, ax, width=5.2, height=3.4)


def _draw_chosen(ax: Axes, point: Any) -> None:
    at = point.x, point.y
    mark = _marks(ax, [point.x], [point.y], marker="D", color=VERMILLION)
    mark.set(markersize=8, zorder=3)
    note = ax.annotate("chosen", at, xytext=(8, -3), textcoords="offset points", va="top")
    note.set_color(VERMILLION)
