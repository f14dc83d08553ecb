"""Weights that move under a guarantee, over one round of its phases, and the band of modes beneath
a picture."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dobc_design.plotting import look
from dobc_design.plotting.look import DOTTED, SERIES, short
from dobc_design.plotting.runs import MOST_NAMED_MODES, plot_modes, tick_decades


def plot_weights(ax: Axes, weights: Sequence[tuple[Any, Any]], *, labels: Sequence[str]) -> Axes:
    """Weights of the agents with the largest, the least and two in between, phase after phase, at
    most six: solid until the mode may change, dotted as long as it may last.  ``weights``: as
    ``Certificate.weights``."""
    shown, ends = weights[:MOST_NAMED_MODES], [0.0]
    heights = np.max([np.array(each.v, dtype=float).max(axis=0) for _, each in weights], axis=0)
    ranks = np.linspace(0, len(heights) - 1, min(4, len(heights))).round().astype(int)
    chosen = np.argsort(-heights, kind="stable")[ranks].tolist()
    for phase, each in shown:
        times, v, first = (
            np.array(each.times, dtype=float),
            np.array(each.v, dtype=float),
            float(phase.shortest),
        )
        for agent, colour in zip(chosen, SERIES, strict=False):
            for part, line in ((times <= first, "solid"), (times >= first, DOTTED)):
                label = f"agent {short(labels[agent])}" if line == "solid" else None
                ax.plot(
                    ends[-1] + times[part],
                    v[part, agent],
                    color=colour,
                    linestyle=line,
                    label=label,
                )
        ends.append(ends[-1] + float(times[-1]))
    ax.vlines(ends[1:-1], 0, 1, transform=ax.get_xaxis_transform(), color=look.MUTED, linewidth=0.7)
    ax.set(
        yscale="log",
        xlim=(0, ends[-1]),
        xlabel="time t in s, one phase after another",
        ylabel="weight vᵢ(t)",
    )
    tick_decades(ax)
    names = tuple(dict.fromkeys(phase.mode for phase, _ in shown))
    modes = [names.index(phase.mode) for phase, _ in shown]
    look.legend_above(ax, widest=4)
    return draw_band(ax, SimpleNamespace(times=ends[:-1], modes=modes, names=names), ends[-1])


def draw_band(ax: Axes, switches: Any, end: float) -> Axes:
    """The axes, beneath them the band of active modes, if there are several and the axes stand in a
    grid."""
    if (place := ax.get_subplotspec()) is None or len(switches.times) < 2:
        return ax
    grid = place.subgridspec(2, 1, height_ratios=[13, 1])
    ax.set_subplotspec(grid[0])
    band = ax.figure.add_subplot(grid[1], sharex=ax)
    plot_modes(band, switches, end)
    band.set_xlabel(ax.get_xlabel())
    ax.label_outer()
    return ax
