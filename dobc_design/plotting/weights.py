"""Weights that move under a guarantee, over one round of its phases, and the band of modes beneath
a picture."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dobc_design._checks import noun

from .look import DOTTED, MUTED, SERIES, fit_heights, legend_above, short, thinned_rows
from .runs import MOST_NAMED_MODES, Switches, plot_modes

Phase = Any  # loop.guarantee.Phase: a mode that is on for at least ``shortest`` s
Weights = Any  # weights ``v`` of all agents at ``times`` in s, from the beginning of a phase


@noun
class _Round:
    """Which mode is on when, as ``plot_modes`` takes it."""

    times: Sequence[float]
    modes: Sequence[int]
    names: Sequence[str]


def plot_weights(
    ax: Axes, weights: Sequence[tuple[Phase, Weights]], *, labels: Sequence[str]
) -> Axes:
    """Weights of the agents with the largest, the least and two in between, phase after phase, at
    most six: solid until the mode may change, dotted as long as it may last.  ``weights``: as
    ``Certificate.weights``."""
    shown = weights[:MOST_NAMED_MODES]
    chosen = _drawn_agents([each for _, each in weights])
    begins = [0.0]
    for phase, each in shown:
        times = np.array(each.times, dtype=float)
        v = np.array(each.v, dtype=float)
        # Both parts have the point between them, so that no gap is seen.
        held = times <= float(phase.shortest)
        left = times >= float(phase.shortest)
        after = begins[-1] + times
        for agent, colour in zip(chosen, SERIES, strict=False):
            label = f"agent {short(labels[agent])}"
            ax.plot(after[held], v[held, agent], color=colour, linestyle="solid", label=label)
            ax.plot(after[left], v[left, agent], color=colour, linestyle=DOTTED)
        begins.append(begins[-1] + float(times[-1]))
    # The last phase ends where the picture does.
    end = begins.pop()
    across = ax.get_xaxis_transform()
    ax.vlines(begins[1:], 0, 1, transform=across, color=MUTED, linewidth=0.7)
    ax.set(xlim=(0, end), xlabel="time t in s, one phase after another", ylabel="weight vᵢ(t)")
    fit_heights(ax)
    names = list(dict.fromkeys(phase.mode for phase, _ in shown))
    modes = [names.index(phase.mode) for phase, _ in shown]
    legend_above(ax, widest=4)
    return draw_band(ax, _Round(times=begins, modes=modes, names=names), end)


def _drawn_agents(weights: Sequence[Weights]) -> list[int]:
    """At most four, from the one with the largest weight to the one with the least."""
    tallest = [np.array(each.v, dtype=float).max(axis=0) for each in weights]
    heights = np.max(tallest, axis=0)
    descending = np.argsort(-heights, kind="stable")
    # Evenly among the ranks: a few agents stand for all.
    chosen: list[int] = descending[thinned_rows(len(heights), 4)].tolist()
    return chosen


def draw_band(ax: Axes, switches: Switches, end: float) -> Axes:
    """The axes, beneath them the band of active modes, if there are several and the axes stand in a
    grid."""
    place = ax.get_subplotspec()
    if place is None or np.size(switches.times) < 2:
        return ax
    # The axes give up a strip of their own place, so that a report needs no other layout.
    grid = place.subgridspec(2, 1, height_ratios=[13, 1])
    ax.set_subplotspec(grid[0])
    band = ax.figure.add_subplot(grid[1], sharex=ax)
    plot_modes(band, switches, end)
    band.set_xlabel(ax.get_xlabel())
    ax.label_outer()
    return ax
