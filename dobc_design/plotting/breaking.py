"""What breaks first: one panel per stress, the late error against its severity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, StrMethodFormatter
from numpy.typing import NDArray

from dobc_design.plotting.axes import power_of_ten
from dobc_design.plotting.look import BLUE, GREEN, INK, VERMILLION
from dobc_design.plotting.sheet import Sheet

COLUMNS = 3
MOST_FINE_TICKS = 200  # end over begin of an axis up to which 1, 2 and 5 of every decade are marked
AXES = {
    "unit of x": "in the unit of x",
    "unit of x per s": "in units of x per s",
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


class SweepLike(Protocol):
    """See ``simulation.breaking.Sweep``."""

    @property
    def option(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def severity(self) -> NDArray[np.float64]: ...
    @property
    def late(self) -> NDArray[np.float64]: ...
    @property
    def breaks(self) -> float | None: ...


def breaking_sheet(
    sweeps: Sequence[SweepLike], *, tolerance: float, period: float | None, certified: float | None, name: str
) -> Sheet:
    """The panels in the order given; ``period`` and ``certified`` are the longest sampling periods, in s."""
    rows = -(-len(sweeps) // COLUMNS)

    def draw(figure: Figure) -> None:
        grid = np.atleast_1d(figure.subplots(rows, min(COLUMNS, len(sweeps)), sharey=True, squeeze=False)).ravel()
        shown = [each.late[np.isfinite(each.late)] for each in sweeps]
        top = max(10 * tolerance, 2 * max((float(each.max()) for each in shown if len(each)), default=1.0))
        bottom = max(min([tolerance / 3, *(float(each.min()) for each in shown if len(each))]) / 2, 1e-12)
        for place, (ax, sweep) in enumerate(zip(grid, sweeps, strict=False)):
            _panel(ax, sweep, tolerance=tolerance, bottom=bottom, top=top)
            if sweep.option == "period":
                _periods(ax, period, certified)
            if place % COLUMNS == 0:
                ax.set_ylabel("late error / start")
        for ax in grid[len(sweeps) :]:
            ax.set_axis_off()
        figure.suptitle(f"{name}: what breaks first", fontsize=10, x=0.01, ha="left", parse_math=False)

    return Sheet(draw, width=7.4, height=0.5 + 2.1 * rows)


def _panel(ax: Axes, sweep: SweepLike, *, tolerance: float, bottom: float, top: float) -> None:
    late = np.where(np.isfinite(sweep.late), sweep.late, top)
    good = late <= tolerance
    ax.set_yscale("log")
    if sweep.option not in LINEAR:
        ax.set_xscale("log")
    ax.axhspan(tolerance, 1e6 * top, color=VERMILLION, alpha=0.1, linewidth=0)
    ax.axhline(tolerance, color=VERMILLION, linewidth=1.0)
    ax.plot(sweep.severity, late, color=INK, linewidth=0.9)
    ax.plot(sweep.severity[good], late[good], linestyle="none", marker="o", color=BLUE)
    ax.plot(sweep.severity[~good], late[~good], linestyle="none", marker="X", markersize=7, color=VERMILLION)
    ax.set_ylim(bottom, 1.5 * top)
    if sweep.option == "saturation":
        ax.invert_xaxis()  # severe is to the right, as everywhere
    ax.set_title(TITLES.get(sweep.option, sweep.option))
    ax.set_xlabel(("never breaks; " if sweep.breaks is None else "") + AXES.get(sweep.unit, f"in {sweep.unit}"))
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    if sweep.option not in LINEAR:
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    elif sweep.option == "failures":
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_xlim(0, float(sweep.severity[-1]) + 1)
    ax.minorticks_off()


def _periods(ax: Axes, period: float | None, certified: float | None) -> None:
    if period is not None:
        ax.axvline(period, color=BLUE, linewidth=1.0, linestyle=(0, (4, 2)), label="longest that works")
    if certified is not None:
        ax.axvline(certified, color=GREEN, linewidth=1.2, label="certified")
        low, high = sorted(ax.get_xlim())
        if high > MOST_FINE_TICKS * low:
            ax.xaxis.set_major_locator(LogLocator(numticks=5))
            ax.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
            ax.minorticks_off()
    if period is not None or certified is not None:
        ax.legend(loc="center left", bbox_to_anchor=(0.06, 0.45), handlelength=1.4, frameon=True, edgecolor="none")
