"""Plots of a search for counterexamples: how far from the target suspects stay, and where agents rest for good.

Simulated runs are drawn thin and dashed, proved equilibria as solid lines; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dobc_design._show.text import Fragment
from dobc_design.falsification.suspect import RESTS, Falsification
from dobc_design.plotting.axes import SMALLEST, axes_or_new, short
from dobc_design.plotting.look import INK, SERIES
from dobc_design.plotting.sheet import Sheet
from dobc_design.report.pictures import Picture
from dobc_design.report.search_words import MOST_ROWS, search_alt
from dobc_design.report.svg import svg_text

WIDTH, HEIGHT, ALONE = 4.6, 2.9, 5.2  # inches
_DASHED: Final = (0, (4, 2))


def plot_search(search: Falsification, *, ax: Axes | None = None) -> Axes:
    """|e|_inf of the worst suspects over time, at most eight; solid where an equilibrium is proved."""
    ax = axes_or_new(ax)
    shown = search.suspects[:MOST_ROWS]
    runs = [suspect for suspect in shown if suspect.kind != RESTS]
    for rank, suspect in enumerate(runs):
        error = np.where(suspect.error > SMALLEST, suspect.error, np.nan)
        ax.plot(suspect.times, error, color=SERIES[rank % len(SERIES)], linestyle=_DASHED, linewidth=1.1)
    resting = [suspect for suspect in shown if suspect.kind == RESTS]
    for suspect in resting:
        ax.axhline(float(suspect.error[0]), color=INK, linewidth=1.8)
    end = max((float(suspect.times[-1]) for suspect in shown), default=search.horizon)
    ax.set_xlim(0, end or 1.0)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time t in s")
    ax.set_ylabel("|e|∞, in the unit of x")
    ax.set_title(short(f"from {search.target}", 44).replace("|e|_inf <=", "|e|∞ ≤"), parse_math=False)
    handles = [Line2D([], [], color=INK, linewidth=1.8, label="another equilibrium, proved")] if resting else []
    handles += [Line2D([], [], color=SERIES[0], linestyle=_DASHED, label="suspect, simulated")] if runs else []
    if handles:
        ax.legend(handles=handles, loc="best")
    return ax


def search_pictures(searches: Sequence[Falsification]) -> list[Picture | None]:
    """One picture per search that found anything, None for the others."""
    return [_picture(search, place) if search.suspects else None for place, search in enumerate(searches)]


def _picture(search: Falsification, place: int) -> Picture:
    svg = svg_text(
        lambda figure: plot_search(search, ax=figure.add_subplot()),
        name=f"search-{place + 1}",
        alt=search_alt(search),
        width=WIDTH,
        height=HEIGHT,
    )
    caption = "Solid: the agents rest there, which is proved. Dashed: simulated runs, which refute nothing."
    return Picture(svg=Fragment(svg), title="What the search found", caption=caption)


def search_sheet(searches: Sequence[Falsification]) -> Sheet | None:
    """The searches that found anything side by side, to be shown or saved; None where nothing was found."""
    found = [search for search in searches if search.suspects]
    if not found:
        return None

    def draw(figure: Figure) -> None:
        figure.suptitle(found[0].name, x=0.01, ha="left", fontsize=10, parse_math=False)
        for space, search in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
            plot_search(search, ax=space)

    return Sheet(draw, width=ALONE * len(found), height=HEIGHT + 0.4)
