"""Plots of the report: functions that take data and axes, and return the axes.

They compute nothing but what a drawing needs.  What is drawn solid about a region is proved.  Names
given by users are never read as mathematics.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike, NDArray

from dobc_design._checks import positional
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.falsification.suspect import RESTS, Falsification
from dobc_design.plotting.look import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MARKERS,
    PURPLE,
    SERIES,
    SMALLEST,
    VERMILLION,
    in_units,
    legend_above,
    power_of_ten,
    short,
    thinned_rows,
    tick_numbers,
)
from dobc_design.plotting.regions import name_rows

from .region_words import MOST_SUSPECTS


@positional
class Taken:
    """What an arc takes from who hears and from who is heard, at most (< 0: it gives), and what it
    leaves of that, about; in 1/s."""

    name: str
    _: KW_ONLY
    own: float
    other: float
    room: float


DASHES = {"dashed": DASHED, "dotted": DOTTED}  # of bounds, in their order
ENVELOPE_SAMPLES = 201
BELOW = 0.5  # of the least bound, at the foot of its picture


def plot_spectrum(ax: Axes, spectra: Mapping[str, NDArray[Any]]) -> Axes:
    """Eigenvalues in the complex plane, one marker per name; the half-plane that must stay empty is
    shaded. ``spectra``: name -> complex eigenvalues, in 1/s.  At most 400 of each are drawn,
    rightmost and leftmost included."""
    everything = np.concatenate(list(spectra.values()))
    left = everything.real.min(initial=0.0)
    right = everything.real.max(initial=0.0)
    reach = max(-left, right, 1e-3)
    ax.set_xlim(left - 0.12 * reach, right + 0.2 * reach)
    _shade(ax, right + 10 * reach)
    for place, (name, values) in enumerate(spectra.items()):
        # Sorted, so that thinning keeps the rightmost, which decides.
        order = np.argsort(values.real, kind="stable")
        points = values[order][thinned_rows(len(values))]
        ax.plot(
            points.real,
            points.imag,
            linestyle="none",
            marker=MARKERS[place % len(MARKERS)],
            color=SERIES[place % len(SERIES)],
            markerfacecolor="none",
            markeredgewidth=1.3,
            label=short(name),
        )
    # Real eigenvalues only: the vertical axis has nothing to say.
    if abs(everything.imag).max(initial=0.0) < 1e-9:
        ax.set_ylim(-1, 1)
        ax.set_yticks([0])
    else:
        ax.margins(y=0.15)
    ax.set(xlabel="Re λ in 1/s", ylabel="Im λ in 1/s")
    return legend_above(ax)


def plot_lambda(
    ax: Axes, spectra: Mapping[str, ArrayLike], *, bounds: Mapping[str, float] | None = None
) -> Axes:
    """Eigenvalues of Lambda(J), one row per mode, against 0 and against the ``bounds`` of given
    matrices P. ``spectra``: mode -> real eigenvalues, in 1/s.  ``bounds``: name -> number that the
    largest must stay below."""
    known = {name: np.sort(each) for name, each in spectra.items()}
    limits = list((bounds or {}).values())
    # The bounds belong to the range, so that none of them lies outside the picture.
    everything = np.concatenate([*known.values(), limits])
    low, high = everything.min(initial=0.0), everything.max(initial=0.0)
    reach = max(high - low, 1e-3)
    ax.set_xlim(low - 0.06 * reach, high + 0.14 * reach)
    _shade(ax, high + 10 * reach)
    for row, values in enumerate(known.values()):
        shown = values[thinned_rows(len(values))]
        level = np.full(len(shown), row)
        ax.plot(shown, level, linestyle="none", marker="|", markersize=9, color=BLUE)
        ax.plot(shown[-1:], [row], linestyle="none", marker="D", markersize=4.5, color=BLUE)
    for limit, dashes in zip(limits, itertools.cycle(DASHES.values()), strict=False):
        ax.axvline(limit, color=INK, linewidth=1.1, linestyle=dashes)
    name_rows(ax, [short(name) for name in known])
    ax.set_xlabel("eigenvalues of Λ(J) in 1/s")
    return ax


def _shade(ax: Axes, end: float) -> None:
    """What must stay empty, right of 0."""
    ax.axvspan(0, end, color=VERMILLION, alpha=0.13, linewidth=0)
    ax.axvline(0, color=VERMILLION, linewidth=1.0)


def plot_envelope(ax: Axes, settling: Settling) -> Axes:
    """The certified bound of |e|_inf over time, on a logarithmic axis; a tick wherever another
    certificate takes over. Solid: no start of the box leaves it.  Dashed: the tolerance."""
    times, bounds = settling.curve(samples=ENVELOPE_SAMPLES)
    # Room below the least bound, on an axis that has no 0.
    foot, top = bounds.min() * BELOW, bounds.max() * 1.6
    ax.set_yscale("log")
    ax.plot(times, bounds, color=BLUE, linewidth=1.6, zorder=3, label="certified bound")
    ax.fill_between(times, bounds, foot, color=BLUE, alpha=0.10, linewidth=0)
    for stage in settling.stages[1:]:
        when = float(stage.start)
        marker, colour = "o", BLUE
        if stage.kind == "quadratic":
            marker, colour = "s", PURPLE
        (taken,) = ax.plot([when], [settling.envelope(when)], color=colour)
        taken.set(label=f"next {stage.kind}", marker=marker, markersize=4.5, linestyle="", zorder=4)
    tolerance = ax.axhline(float(settling.tolerance), color=VERMILLION, label="tolerance")
    tolerance.set(linewidth=1.2, linestyle=DASHED, zorder=2)
    ax.set(ylim=(foot, top), xlim=(0, times[-1]))
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.minorticks_off()
    ax.set_xlabel("time t in s")
    ax.set_ylabel(f"|e|∞, {in_units(settling.unit)}", parse_math=False)
    return legend_above(ax, widest=2)


def plot_shares(ax: Axes, arcs: Sequence[Taken]) -> Axes:
    """What arcs take from their two agents: a row and two bars each."""
    rows = np.arange(len(arcs))
    for aside, colour, label in (
        (-0.19, BLUE, "from who hears"),
        (0.19, VERMILLION, "from who is heard"),
    ):
        sizes = [arc.own if aside < 0 else arc.other for arc in arcs]
        ax.barh(rows + aside, sizes, height=0.36, color=colour, label=label)
    ax.axvline(0, color=INK, linewidth=0.9)
    name_rows(ax, [short(arc.name, 30) for arc in arcs])
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("taken at most, in 1/s")
    return legend_above(ax)


def plot_rates(ax: Axes, rates: Mapping[float, float], *, stated: float) -> Axes:
    """Proved rates over a time (s), on a logarithmic axis; crosses where nothing is proved."""
    proved = {time: rate for time, rate in rates.items() if rate > 0}
    open_times = [time for time, rate in rates.items() if rate <= 0]
    ax.set_xscale("log")
    ax.plot(list(proved), list(proved.values()), "o-", color=BLUE, markersize=3.5, label="proved")
    if open_times:
        nothing = [0.0] * len(open_times)
        ax.plot(open_times, nothing, "x", color=VERMILLION, label="nothing proved")
    ax.axvline(stated, color=INK, linewidth=0.9, linestyle=DASHED, label="stated")
    top = max(rates.values(), default=1.0) or 1.0
    ax.set_ylim(-0.05 * top, 1.08 * top)
    tick_numbers(ax.xaxis)
    ax.minorticks_off()
    ax.set_xlabel("time in s")
    ax.set_ylabel("rate in 1/s")
    return legend_above(ax)


def plot_search(ax: Axes, search: Falsification, *, unit: str = "") -> Axes:
    """|e|_inf of the worst suspects over time, at most eight; solid where an equilibrium is
    proved."""
    shown = search.suspects[:MOST_SUSPECTS]
    for rank, suspect in enumerate(each for each in shown if each.kind != RESTS):
        # Below that a curve would show rounding.
        error = np.where(suspect.error > SMALLEST, suspect.error, np.nan)
        label = None if rank else "suspect, simulated"
        colour = SERIES[rank % len(SERIES)]
        ax.plot(suspect.times, error, color=colour, linestyle=DASHED, linewidth=1.1, label=label)
    for rank, suspect in enumerate(each for each in shown if each.kind == RESTS):
        label = None if rank else "another equilibrium, proved"
        ax.axhline(suspect.error[0], color=INK, linewidth=1.8, label=label)
    end = max((suspect.times[-1] for suspect in shown), default=search.horizon)
    ax.set(xlim=(0, end or 1.0), ylim=(0, None))
    ax.set_xlabel("time t in s")
    ax.set_ylabel(f"|e|∞, {in_units(unit)}", parse_math=False)
    title = short(f"from {search.target}", 44).replace("|e|_inf <=", "|e|∞ ≤")
    ax.set_title(title, parse_math=False)
    if shown:
        ax.legend(loc="best")
    return ax
