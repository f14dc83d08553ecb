"""Trade-offs: one quantity of a design against another, with the chosen point."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, StrMethodFormatter

from dobc_design.plotting.axes import short
from dobc_design.plotting.look import BLUE, MUTED, VERMILLION
from dobc_design.plotting.sheet import Sheet

STEEP = 30  # times the least y from which the axis is logarithmic


def trade_off_sheet(
    points: Sequence[tuple[float, float]],
    *,
    x_name: str,
    y_name: str,
    chosen: tuple[float, float] | None,
    name: str,
    steps: bool,
) -> Sheet:
    """The points in order of x; ``steps``: x counts, so that nothing lies between two points."""

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        _curve(ax, points, steps=steps)
        if chosen is not None:
            ax.plot(*chosen, linestyle="none", marker="D", markersize=8, color=VERMILLION, zorder=3)
            ax.annotate("chosen", chosen, xytext=(8, -3), textcoords="offset points", color=VERMILLION, va="top")
        heights = [y for _, y in (*points, *([] if chosen is None else [chosen])) if y > 0]
        if heights and max(heights) > STEEP * min(heights):
            ax.set_yscale("log")
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            ax.minorticks_off()
        else:
            ax.set_ylim(bottom=0)
        ax.set_xlabel(x_name)
        ax.set_ylabel(y_name)
        ax.set_title(short(name, 60), parse_math=False)

    return Sheet(draw, width=5.2, height=3.4)


def _curve(ax: Axes, points: Sequence[tuple[float, float]], *, steps: bool) -> None:
    xs, ys = [x for x, _ in points], [y for _, y in points]
    if steps:
        ax.vlines(xs, 0, ys, color=MUTED, linewidth=0.8)
        ax.plot(xs, ys, linestyle="none", marker="o", color=BLUE)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_xlim(0, max(xs, default=1.0) + 1)
    else:
        ax.plot(xs, ys, marker="o", markersize=4, color=BLUE)
