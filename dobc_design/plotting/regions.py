"""Certified regions as figures: how far each method reaches, and from where each agent may start.

What is drawn solid is proved.  Names given by users are never read as mathematics.
"""

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dobc_design._show.text import lower

from .look import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MUTED,
    PAPER,
    VERMILLION,
    Sheet,
    in_units,
    legend_above,
    short,
    shown_agents,
)
from .weights import Phase, Weights, plot_weights

ALONE = 5.2  # inches, of one drawing in a file
MOST_STARTS = 24  # agents
_LONGEST = 18  # letters of a line of a method's name


#: Nouns of ``certificate.regions``, a room that rests on this one.
Regions = Any
Claim = Any  # a RegionClaim
Agent = Any  # one whose starts have a bound


def name_rows(ax: Axes, names: Sequence[str]) -> None:
    """Names of rows, the first at the top."""
    ax.set_yticks(range(len(names)), names, parse_math=False)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(visible=False, axis="y")


def plot_regions(ax: Axes, regions: Regions) -> Axes:
    """One row per method: the |e|_inf that it proves for all agents at once, and for one agent
    alone.

    The dashed line is what was asked for.  Sizes in the unit of the states.
    """
    asked = None if regions.asked is None else regions.asked.box
    reach = _drawn_reach(regions.claims, (asked, regions.rest))
    for row, claim in enumerate(regions.claims):
        _draw_reach(ax, row, claim, reach)
    if asked is not None:
        line = ax.axvline(asked, color=VERMILLION, linewidth=1.3, linestyle=DASHED, zorder=3)
        line.set_label("asked for")
    if regions.rest is not None:
        line = ax.axvline(regions.rest, color=INK, linewidth=1.4, linestyle=DOTTED, zorder=3)
        line.set_label("other equilibrium")
    ax.set_xlim(0, reach)
    name_rows(ax, [_in_lines(claim.method) for claim in regions.claims])
    ax.tick_params(axis="y", length=0)
    what = "distance from the goals"
    if regions.agree:
        what = "difference of two agents"
    if regions.goal == "containment":
        what = "distance from the fixed nodes"
    ax.set_xlabel(f"{what} at the start, {in_units(regions.unit)}", parse_math=False)
    return legend_above(ax, least=1)


def _drawn_reach(claims: Sequence[Claim], lines: Sequence[float | None]) -> float:
    """Where the axis ends: room for every bar with its numbers, two for a ball, and for lines."""
    ends = []
    for claim in claims:
        if claim.ball is not None:
            room = 1.45 if claim.kind == "ball" else 1.2
            ends.append(claim.ball * room)
    farthest = max((line for line in lines if line is not None), default=0.0)
    return max([*ends, 1.15 * farthest]) or 1.0


def _in_lines(method: str) -> str:
    """The method above its variant, so that names leave room for bars."""
    name, _, variant = method.partition(", ")
    parts = [fill(short(part, 2 * _LONGEST), _LONGEST) for part in (name, variant) if part]
    return "\n".join(parts)


def _draw_reach(ax: Axes, row: int, claim: Claim, reach: float) -> None:
    """The bar of one method; where there is no radius, words in its place."""
    margin = reach * 0.02
    begin, colour, ground = margin, MUTED, PAPER
    note = "nothing proved" if claim.kind == "none" else claim.starts
    # Words stand on the bar where it fills the row, else beside it.
    if claim.kind == "everywhere":
        ax.barh(row, reach, height=0.52, color=BLUE)
        colour, ground = PAPER, ""
    elif claim.box is not None and claim.ball is not None:
        ax.barh(row, claim.box, height=0.52, color=BLUE, zorder=2, label="all at once")
        if claim.ball > claim.box:
            _draw_end(ax, row, claim.box, claim.ball)
        begin, colour = claim.ball + margin, INK
        note = lower(claim.box)
        if claim.box != claim.ball:
            note += f" … {lower(claim.ball)}"
    text = ax.text(begin, row, note, va="center_baseline", color=colour, parse_math=False)
    text.set_fontsize(8.5)
    text.set_zorder(4)
    if ground:  # readable where a line runs behind it
        text.set_bbox({"facecolor": ground, "edgecolor": "none", "alpha": 0.85, "pad": 0.8})


def _draw_end(ax: Axes, row: int, box: float, ball: float) -> None:
    """A thin line from the bar on, as far as one agent alone may be off."""
    (line,) = ax.plot([box, ball], [row, row], color=BLUE, linewidth=1.3, zorder=2)
    line.set_label("one alone")
    line.set(marker="|", markersize=9, markeredgewidth=1.6, markevery=[1])


def drawn_agents(regions: Regions) -> list[Agent]:
    """The agents whose starts are drawn."""
    agents = regions.agents
    pinned = {place for place, agent in enumerate(agents) if agent.pinned}
    return [agents[place] for place in shown_agents(len(agents), pinned, MOST_STARTS)]


def plot_starts(ax: Axes, regions: Regions) -> Axes:
    """From where each agent may start, all at once: a bar around its goal, pinned agents in blue.
    Bars are in units of x, around the goals; with several state components they show the error,
    around 0.  The band is what was asked for.  At most 24 agents are drawn."""
    chosen = drawn_agents(regions)
    words = ("pinned", "not pinned", "goal")
    if regions.goal == "containment":
        words = ("hears one", "hears none", "fixed nodes")
    for column, agent in enumerate(chosen):
        _draw_start(ax, column, agent, words)
    asked = regions.asked
    if asked is not None:
        # Around the goals, unless states themselves were asked for.
        band = asked.interval or (-asked.box, asked.box)
        ax.axhspan(*band, facecolor=VERMILLION, alpha=0.16, linewidth=0, zorder=1)
        for edge in band:
            line = ax.axhline(edge, color=VERMILLION, linewidth=1.2, linestyle=DASHED, zorder=4)
            line.set_label("asked for")
    names = [short(agent.label, 10) for agent in chosen]
    ax.set_xticks(range(len(names)), names, parse_math=False)
    # Longer names stand upright, so that they do not run into each other.
    if max(map(len, names), default=0) > 3:
        ax.tick_params(axis="x", labelrotation=90)
    ax.tick_params(axis="x", length=0)
    ax.grid(visible=False, axis="x")
    ax.set_xlim(-0.7, len(names) - 0.3)
    ax.use_sticky_edges = False  # room below the longest bar
    ax.margins(y=0.06)
    ax.set_xlabel("agent")
    in_states = all(agent.goal is not None for agent in regions.agents)
    what = "xᵢ(0)" if in_states else "error at the start"
    ax.set_ylabel(f"{what}, {in_units(regions.unit)}", parse_math=False)
    return legend_above(ax, widest=4, least=1)


def _draw_start(ax: Axes, column: int, agent: Agent, words: Sequence[str]) -> None:
    pinned, other, at = words
    goal = agent.goal or 0.0
    low, size = goal - agent.bound, 2 * agent.bound
    bar = ax.bar(column, size, bottom=low, width=0.56, zorder=2, linewidth=1.2)
    (patch,) = bar
    if agent.pinned:
        patch.set(facecolor=BLUE, edgecolor=BLUE)
        bar.set_label(pinned)
    else:
        patch.set(facecolor="none", edgecolor=MUTED)
        bar.set_label(other)
    mark = [column - 0.36, column + 0.36]
    ax.plot(mark, [goal, goal], color=INK, linewidth=1.3, zorder=3, label=at)


def height_of(regions: Regions) -> float:
    """Inches; every method has its row."""
    return max(2.9, 1.1 + 0.42 * len(regions.claims))


def region_sheet(
    regions: Regions,
    *,
    weights: Sequence[tuple[Phase, Weights]] = (),
    labels: Sequence[str] = (),
) -> Sheet:
    """The pictures side by side, with ``weights`` their own, to be shown in a notebook or saved."""
    plots: list[Callable[[Axes], object]] = [partial(plot_regions, regions=regions)]
    if regions.agents:
        plots.append(partial(plot_starts, regions=regions))
    if weights:
        plots.append(partial(plot_weights, weights=weights, labels=labels))
    return side_by_side(regions.name, plots, height_of(regions) + 0.3)


def side_by_side(name: str, drawn: Sequence[Callable[[Axes], object]], height: float) -> Sheet:
    """Drawings beside each other under a name."""

    def draw(figure: Figure) -> None:
        spaces = figure.subplots(1, len(drawn), squeeze=False)[0]
        for space, each in zip(spaces, drawn, strict=True):
            each(space)

    return Sheet(draw, width=ALONE * len(drawn), height=height, title=name)
