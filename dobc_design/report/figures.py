"""Plots of eigenvalues and of simulations: functions that take data and axes, and return the axes.

They compute nothing but what a drawing needs: thinning of long data, limits, ticks.  Names given by users are never
read as mathematics by Matplotlib.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from dobc_design.plotting.axes import (
    MOST_AGENTS,
    MOST_POINTS,
    SMALLEST,
    axes_or_new,
    legend_above,
    power_of_ten,
    resolved,
    short,
    shown_agents,
    thinned_rows,
)
from dobc_design.plotting.look import BLUE, INK, MARKERS, MUTED, SERIES, VERMILLION

__all__ = [
    "MOST_AGENTS",
    "axes_or_new",
    "plot_disturbance",
    "plot_error",
    "plot_lambda",
    "plot_spectrum",
    "plot_states",
    "power_of_ten",
    "short",
    "shown_agents",
    "thinned_rows",
]

DASHES = {"dashed": (0, (4, 2)), "dotted": (0, (1, 1.4))}  # of bounds, in their order


def plot_spectrum(spectra: Mapping[str, ArrayLike], *, symbol: str = "λ", ax: Axes | None = None) -> Axes:
    """Eigenvalues in the complex plane, one marker per name; the half-plane that must stay empty is shaded.

    ``spectra``: name -> complex eigenvalues, in 1/s.
    """
    ax = axes_or_new(ax)
    everything = np.concatenate([np.atleast_1d(np.asarray(each, dtype=complex)) for each in spectra.values()])
    reach = max(float(np.abs(everything.real).max(initial=0.0)), 1e-3)
    left, right = min(float(everything.real.min(initial=0.0)), 0.0), max(float(everything.real.max(initial=0.0)), 0.0)
    ax.set_xlim(left - 0.12 * reach, right + 0.2 * reach)
    ax.axvspan(0, right + 10 * reach, color=VERMILLION, alpha=0.13, linewidth=0)
    ax.axvline(0, color=VERMILLION, linewidth=1.0)
    for place, (name, values) in enumerate(spectra.items()):
        points = _thinned_points(np.atleast_1d(np.asarray(values, dtype=complex)))
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
    if float(np.abs(everything.imag).max(initial=0.0)) < 1e-9:
        ax.set_ylim(-1, 1)
        ax.set_yticks([0])
    else:
        ax.margins(y=0.15)
    ax.set_xlabel(f"Re {symbol} in 1/s")
    ax.set_ylabel(f"Im {symbol} in 1/s")
    legend_above(ax, len(spectra))
    return ax


def plot_lambda(
    spectra: Mapping[str, ArrayLike], *, bounds: Mapping[str, float] | None = None, ax: Axes | None = None
) -> Axes:
    """Eigenvalues of Lambda(J), one row per mode, against 0 and against the ``bounds`` of given matrices P.

    ``spectra``: mode -> real eigenvalues, in 1/s.  ``bounds``: name -> number that the largest must stay below.
    """
    ax = axes_or_new(ax)
    names = list(spectra)
    everything = np.concatenate([np.asarray(each, dtype=float).ravel() for each in spectra.values()])
    marks = [0.0, *(bounds or {}).values()]
    low, high = min(everything.min(initial=0.0), *marks), max(everything.max(initial=0.0), *marks)
    reach = max(high - low, 1e-3)
    ax.set_xlim(low - 0.06 * reach, high + 0.14 * reach)
    ax.axvspan(0, high + 10 * reach, color=VERMILLION, alpha=0.13, linewidth=0)
    ax.axvline(0, color=VERMILLION, linewidth=1.0)
    for row, name in enumerate(names):
        values = _thinned(np.sort(np.asarray(spectra[name], dtype=float).ravel()), MOST_POINTS)
        ax.plot(values, np.full(len(values), row), linestyle="none", marker="|", markersize=9, color=BLUE)
        ax.plot(values[-1:], [row], linestyle="none", marker="D", markersize=4.5, color=BLUE)
    for bound, dashes in zip((bounds or {}).values(), itertools.cycle(DASHES.values()), strict=False):
        ax.axvline(bound, color=INK, linewidth=1.1, linestyle=dashes)
    ax.set_yticks(range(len(names)), [short(name) for name in names], parse_math=False)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("eigenvalues of Λ(J) in 1/s")
    return ax


def plot_states(
    times: ArrayLike,
    states: ArrayLike,
    *,
    goals: ArrayLike,
    pinned: Sequence[int] = (),
    symbol: str = "x",
    ax: Axes | None = None,
) -> Axes:
    """States of all agents over time, pinned agents in blue, and where they should go (dashed).

    Shapes: times (T,) in s, states (T, n), goals (n,).  At most 30 agents are drawn.
    """
    ax = axes_or_new(ax)
    t, x, goal = np.asarray(times, float), np.asarray(states, float), np.asarray(goals, float)
    rows = thinned_rows(len(t))
    held = set(pinned)
    chosen = shown_agents(x.shape[1], held)
    for is_pinned in (False, True):
        group = [agent for agent in chosen if (agent in held) is is_pinned]
        for rank, agent in enumerate(group):
            ax.plot(
                t[rows],
                x[rows, agent],
                color=BLUE if is_pinned else MUTED,
                linewidth=1.7 if is_pinned else 0.9,
                label=("pinned" if is_pinned else "not pinned") if rank == 0 else None,
            )
    for rank, value in enumerate(sorted({float(goal[agent]) for agent in chosen})[:12]):
        ax.axhline(value, color=VERMILLION, linewidth=1.1, linestyle=(0, (4, 2)), label="goal" if rank == 0 else None)
    ax.set_xlabel("time t in s")
    ax.set_ylabel(f"{symbol}, in its own unit")
    legend_above(ax, 3)
    return ax


def plot_disturbance(
    times: ArrayLike,
    disturbance: ArrayLike,
    estimate: ArrayLike,
    *,
    title: str = "",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Draw one component of one agent's disturbance (dotted, as in the paper's Fig. 3) and its estimate.

    Shapes: (T,) each; times in s, the others in units of x per s.
    """
    ax = axes_or_new(ax)
    t = np.asarray(times, float)
    rows = thinned_rows(len(t))
    ax.plot(t[rows], np.asarray(estimate, float)[rows], color=BLUE, label="estimate")
    ax.plot(
        t[rows],
        np.asarray(disturbance, float)[rows],
        color=VERMILLION,
        linestyle=(0, (1, 1.4)),
        linewidth=1.6,
        label="disturbance",
    )
    ax.set_title(title, parse_math=False)
    ax.set_xlabel("time t in s")
    ax.set_ylabel("d in units of x per s")
    ax.yaxis.set_major_locator(MaxNLocator(4))
    if legend:
        legend_above(ax, 2, right=True)
    return ax


def plot_error(
    times: ArrayLike,
    error: ArrayLike,
    *,
    rate: float | None = None,
    bound: ArrayLike | None = None,
    ax: Axes | None = None,
) -> Axes:
    """|e|_inf over time on a logarithmic axis, with a certified ``bound`` of it at the same times.

    Without one ``rate`` (1/s) adds a line that falls like exp(-rate t), a slope and no bound.
    """
    ax = axes_or_new(ax)
    t, size = np.asarray(times, float), np.asarray(error, float)
    rows = thinned_rows(len(t))
    shown = np.where(size[rows] > SMALLEST, size[rows], np.nan)
    ax.set_yscale("log")
    ax.plot(t[rows], shown, color=BLUE, label="simulated")
    if bound is not None:
        ax.plot(
            t[rows],
            resolved(np.asarray(bound, float))[rows],
            color=INK,
            linestyle=(0, (4, 2)),
            linewidth=1.2,
            label="certified bound",
        )
    elif rate is not None and len(t) and size[0] > SMALLEST:
        guide = size[0] * np.exp(np.clip(-rate * (t[rows] - t[0]), -700, 0))
        visible = guide > max(float(np.nanmin(shown)) * 0.5, SMALLEST)
        ax.plot(
            t[rows][visible],
            guide[visible],
            color=INK,
            linestyle=(0, (4, 2)),
            linewidth=1.0,
            label="slope of the certified rate",
        )
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.minorticks_off()
    ax.set_xlabel("time t in s")
    ax.set_ylabel("|e|∞, in the unit of x")
    legend_above(ax, 2)
    return ax


def _thinned(values: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    return values[thinned_rows(len(values), most)] if len(values) else values


def _thinned_points(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """At most 400 points, the rightmost and leftmost among them."""
    ordered = values[np.argsort(values.real, kind="stable")]
    return ordered[thinned_rows(len(ordered))] if len(ordered) else ordered
