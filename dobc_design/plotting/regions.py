"""Certified regions as figures: how far each method reaches, and from where each agent may start.

What is drawn solid is proved.  Names given by users are never read as mathematics.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dobc_design._show.text import lower
from dobc_design.plotting import look
from dobc_design.plotting.look import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MUTED,
    PAPER,
    VERMILLION,
    Sheet,
    short,
)
from dobc_design.plotting.weights import plot_weights

ALONE: Final = 5.2  # inches, of one drawing in a file
MOST_STARTS: Final = 24  # agents
_LONGEST: Final = 18  # letters of a line of a method's name


def name_rows(ax: Axes, names: Sequence[str]) -> None:
    """Names of rows, the first at the top."""
    ax.set_yticks(range(len(names)), names, parse_math=False)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(visible=False, axis="y")


def plot_regions(ax: Axes, regions: Any) -> Axes:
    """One row per method: the |e|_inf that it proves for all agents at once, and for one agent
    alone.

    The dashed line is what was asked for.  Sizes in the unit of the states.
    """
    claims = regions.claims
    asked = None if regions.asked is None else regions.asked.box
    # Room for every bar with its numbers, two for a ball, and for the lines.
    ends = [
        claim.ball * (1.45 if claim.kind == "ball" else 1.2)
        for claim in claims
        if claim.ball is not None
    ]
    farthest = max((line for line in (asked, regions.rest) if line is not None), default=0.0)
    reach = max([*ends, 1.15 * farthest]) or 1.0
    for row, claim in enumerate(claims):
        _draw_reach(ax, row, claim, reach)
    if asked is not None:
        ax.axvline(
            asked, color=VERMILLION, linewidth=1.3, linestyle=DASHED, zorder=3, label="asked for"
        )
    if regions.rest is not None:
        ax.axvline(
            regions.rest,
            color=INK,
            linewidth=1.4,
            linestyle=DOTTED,
            zorder=3,
            label="other equilibrium",
        )
    ax.set_xlim(0, reach)
    # The method above its variant, so that names leave room for bars.
    names = (claim.method.partition(", ") for claim in claims)
    parts = [
        [fill(short(part, 2 * _LONGEST), _LONGEST) for part in each[::2] if part] for each in names
    ]
    name_rows(ax, ["\n".join(each) for each in parts])
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("distance from the goals at the start, in the unit of x")
    return look.legend_above(ax, least=1)


def _draw_reach(ax: Axes, row: int, claim: Any, reach: float) -> None:
    """The bar of one method; where there is no radius, words in its place."""
    begin, colour, ground = reach * 0.02, MUTED, PAPER
    note = "nothing proved" if claim.kind == "none" else claim.starts
    if claim.kind == "everywhere":
        ax.barh(row, reach, height=0.52, color=BLUE)
        colour, ground = PAPER, ""
    elif claim.box is not None and claim.ball is not None:
        ax.barh(row, claim.box, height=0.52, color=BLUE, zorder=2, label="all at once")
        if claim.ball > claim.box:
            ends = [claim.box, claim.ball]
            (end,) = ax.plot(
                ends, [row, row], color=BLUE, linewidth=1.3, zorder=2, label="one alone"
            )
            end.set(marker="|", markersize=9, markeredgewidth=1.6, markevery=[1])
        begin, colour = claim.ball + reach * 0.02, INK
        note = lower(claim.box) + ("" if claim.box == claim.ball else f" … {lower(claim.ball)}")
    # readable where a line runs behind it
    box = {"facecolor": ground, "edgecolor": "none", "alpha": 0.85, "pad": 0.8} if ground else None
    text = ax.text(
        begin,
        row,
        note,
        va="center_baseline",
        fontsize=8.5,
        color=colour,
        parse_math=False,
        bbox=box,
    )
    text.set_zorder(4)


def drawn_agents(regions: Any) -> list[Any]:
    """The agents whose starts are drawn."""
    pinned = {place for place, agent in enumerate(regions.agents) if agent.pinned}
    return [
        regions.agents[place]
        for place in look.shown_agents(len(regions.agents), pinned, MOST_STARTS)
    ]


def plot_starts(ax: Axes, regions: Any) -> Axes:
    """From where each agent may start, all at once: a bar around its goal, pinned agents in blue.
    Bars are in the unit of x, around the goals; with several state components they show the error,
    around 0.  The band is what was asked for.  At most 24 agents are drawn."""
    agents, asked = regions.agents, regions.asked
    chosen = drawn_agents(regions)
    for column, agent in enumerate(chosen):
        goal = agent.goal or 0.0
        fill, outline, label = (
            (BLUE, BLUE, "pinned") if agent.pinned else ("none", MUTED, "not pinned")
        )
        low, size = goal - agent.bound, 2 * agent.bound
        bar = ax.bar(
            column,
            size,
            bottom=low,
            width=0.56,
            zorder=2,
            linewidth=1.2,
            color=fill,
            edgecolor=outline,
        )
        bar.set_label(label)
        ax.plot(
            [column - 0.36, column + 0.36],
            [goal, goal],
            color=INK,
            linewidth=1.3,
            zorder=3,
            label="goal",
        )
    if asked is not None:
        band = asked.interval or (-asked.box, asked.box)
        ax.axhspan(*band, facecolor=VERMILLION, alpha=0.16, linewidth=0, zorder=1)
        for edge in band:
            ax.axhline(
                edge, color=VERMILLION, linewidth=1.2, linestyle=DASHED, zorder=4, label="asked for"
            )
    names = [short(agent.label, 10) for agent in chosen]
    ax.set_xticks(range(len(names)), names, parse_math=False)
    if max(map(len, names), default=0) > 3:
        ax.tick_params(axis="x", labelrotation=90)
    ax.tick_params(axis="x", length=0)
    ax.grid(visible=False, axis="x")
    ax.set_xlim(-0.7, len(names) - 0.3)
    ax.use_sticky_edges = False  # room below the longest bar
    ax.margins(y=0.06)
    ax.set_xlabel("agent")
    in_states = all(agent.goal is not None for agent in agents)
    ax.set_ylabel("xᵢ(0), in its own unit" if in_states else "error at the start")
    return look.legend_above(ax, widest=4, least=1)


def height_of(regions: Any) -> float:
    """Inches; every method has its row."""
    return max(2.9, 1.1 + 0.42 * len(regions.claims))


def region_sheet(regions: Any, *, weights: Sequence[Any] = (), labels: Sequence[str] = ()) -> Sheet:
    """The pictures side by side, with ``weights`` their own, to be shown in a notebook or saved."""
    plots: list[Callable[[Axes], object]] = [partial(plot_regions, regions=regions)]
    plots += [partial(plot_starts, regions=regions)] if regions.agents else []
    plots += [partial(plot_weights, weights=weights, labels=labels)] if weights else []
    return side_by_side(regions.name, plots, height_of(regions) + 0.3)


def side_by_side(name: str, drawn: Sequence[Callable[[Axes], object]], height: float) -> Sheet:
    """Drawings beside each other under a name."""

    def draw(figure: Figure) -> None:
        figure.suptitle(name, x=0.01, ha="left", fontsize=10, parse_math=False)
        for space, each in zip(
            figure.subplots(1, len(drawn), squeeze=False)[0], drawn, strict=True
        ):
            each(space)

    return Sheet(draw, width=ALONE * len(drawn), height=height)
