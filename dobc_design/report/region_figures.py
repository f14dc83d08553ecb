"""Plots of certified regions: how far each method reaches, and how far each agent may start from its goal.

Functions that take data and axes and return the axes.  What is drawn solid is proved; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from dobc_design.certificate.regions import AgentBound, RegionClaim, Regions
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.plotting.axes import axes_or_new, power_of_ten, short, shown_agents
from dobc_design.plotting.look import BLUE, INK, MUTED, PAPER, PURPLE, VERMILLION
from dobc_design.report.region_words import lower, method_name

_DASHED: Final = (0, (4, 2))
_DOTTED: Final = (0, (1, 1.4))
MOST_AGENTS: Final = 24
ENVELOPE_SAMPLES: Final = 201
BELOW: Final = 0.5  # of the least bound, at the foot of its picture
_LONGEST: Final = 18  # letters of a line of a method's name
_NOTES: Final = {"everywhere": "every start", "near": "near the target, no radius", "none": "nothing proved"}


def plot_regions(regions: Regions, *, ax: Axes | None = None) -> Axes:
    """One row per method: the |e|_inf that it proves for all agents at once, and for one agent alone.

    The dashed line is what was asked for.  Sizes in the unit of the states.
    """
    ax = axes_or_new(ax)
    claims = regions.claims
    asked = None if regions.asked is None else regions.asked.box
    reach = _axis_end(claims, asked, regions.rest)
    for row, claim in enumerate(claims):
        _draw_reach(ax, row, claim, reach)
    if asked is not None:
        ax.axvline(asked, color=VERMILLION, linewidth=1.3, linestyle=_DASHED, zorder=3)
    if regions.rest is not None:
        ax.axvline(regions.rest, color=INK, linewidth=1.4, linestyle=_DOTTED, zorder=3)
    ax.set_xlim(0, reach)
    ax.set_ylim(len(claims) - 0.4, -0.6)
    names = [_two_lines(method_name(claim)) for claim in claims]
    ax.set_yticks(range(len(claims)), names, parse_math=False)
    ax.tick_params(axis="y", length=0)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("distance from the goals at the start, in the unit of x")
    _legend_of_methods(ax, regions)
    return ax


def _draw_reach(ax: Axes, row: int, claim: RegionClaim, reach: float) -> None:
    """The bar of one method; where there is no radius, words in its place."""
    note = _NOTES.get(claim.kind, "")
    if claim.kind == "everywhere":
        ax.barh(row, reach, height=0.52, color=BLUE)
        _write(ax, reach * 0.02, row, note, colour=PAPER)
    elif claim.box is None or claim.ball is None:
        _write(ax, reach * 0.02, row, note, colour=MUTED, ground=PAPER)
    else:
        ax.barh(row, claim.box, height=0.52, color=BLUE, zorder=2)
        if claim.ball > claim.box:
            ax.plot([claim.box, claim.ball], [row, row], color=BLUE, linewidth=1.3, zorder=2)
            ax.plot([claim.ball], [row], marker="|", markersize=9, color=BLUE, markeredgewidth=1.6, zorder=2)
        _write(ax, claim.ball + reach * 0.02, row, _sizes(claim), colour=INK, ground=PAPER)


def _write(ax: Axes, x: float, y: float, text: str, *, colour: str, ground: str = "none") -> None:
    """Text that begins at x, readable where a line runs behind it."""
    box = {"facecolor": ground, "edgecolor": "none", "alpha": 0.85, "pad": 0.8}
    ax.text(
        x,
        y,
        text,
        va="center_baseline",
        fontsize=8.5,
        color=colour,
        parse_math=False,
        zorder=4,
        bbox=None if ground == "none" else box,
    )


def _two_lines(name: str) -> str:
    """The method above its variant, so that names leave room for bars."""
    first, _, rest = name.partition(", ")
    return short(first, _LONGEST) + (f"\n{short(rest, _LONGEST)}" if rest else "")


def _sizes(claim: RegionClaim) -> str:
    if claim.box == claim.ball:
        return lower(claim.box)
    return f"{lower(claim.box)} … {lower(claim.ball)}"


def _legend_of_methods(ax: Axes, regions: Regions) -> None:
    handles: list[Patch | Line2D] = []
    if any(claim.box for claim in regions.claims):
        handles.append(Patch(color=BLUE, label="all at once"))
    if any(claim.kind == "ball" for claim in regions.claims):
        handles.append(Line2D([], [], color=BLUE, marker="|", markersize=9, label="one alone"))
    if regions.asked is not None:
        handles.append(Line2D([], [], color=VERMILLION, linestyle=_DASHED, label="asked for"))
    if regions.rest is not None:
        handles.append(Line2D([], [], color=INK, linestyle=_DOTTED, label="other equilibrium"))
    _legend(ax, handles, columns=3)  # the names of the methods leave less room


def plot_starts(regions: Regions, *, ax: Axes | None = None) -> Axes:
    """From where each agent may start, all at once: a bar around its goal, pinned agents in blue.

    Bars are in the unit of x, around the goals; with several state components they show the error, around 0.  The
    band is what was asked for.  At most 24 agents are drawn.
    """
    ax = axes_or_new(ax)
    agents, asked = regions.agents, _band(regions)
    pinned = {place for place, agent in enumerate(agents) if agent.pinned}
    chosen = shown_agents(len(agents), pinned, MOST_AGENTS)
    for column, place in enumerate(chosen):
        agent, goal = agents[place], agents[place].goal or 0.0
        ax.bar(
            column,
            2 * agent.bound,
            bottom=goal - agent.bound,
            width=0.56,
            zorder=2,
            linewidth=1.2,
            color=BLUE if agent.pinned else "none",
            edgecolor=BLUE if agent.pinned else MUTED,
        )
        ax.plot([column - 0.36, column + 0.36], [goal, goal], color=INK, linewidth=1.3, zorder=3)
    if asked is not None:
        ax.axhspan(*asked, facecolor=VERMILLION, alpha=0.16, linewidth=0, zorder=1)
        for edge in asked:
            ax.axhline(edge, color=VERMILLION, linewidth=1.2, linestyle=_DASHED, zorder=4)
    _name_agents(ax, [short(agents[place].label, 10) for place in chosen])
    in_states = all(agent.goal is not None for agent in agents)
    ax.set_ylabel("xᵢ(0), in its own unit" if in_states else "error at the start")
    _legend_of_starts(ax, agents, asked=asked is not None)
    return ax


def _band(regions: Regions) -> tuple[float, float] | None:
    if regions.asked is None:
        return None
    return regions.asked.interval or (-regions.asked.box, regions.asked.box)


def _name_agents(ax: Axes, names: Sequence[str]) -> None:
    ax.set_xticks(range(len(names)), names, parse_math=False)
    if max(map(len, names), default=0) > 3:
        ax.tick_params(axis="x", labelrotation=90)
    ax.tick_params(axis="x", length=0)
    ax.grid(visible=False, axis="x")
    ax.set_xlim(-0.7, len(names) - 0.3)
    ax.use_sticky_edges = False  # room below the longest bar
    ax.margins(y=0.06)
    ax.set_xlabel("agent")


def _legend_of_starts(ax: Axes, agents: Sequence[AgentBound], *, asked: bool) -> None:
    handles: list[Patch | Line2D] = []
    if any(agent.pinned for agent in agents):
        handles.append(Patch(color=BLUE, label="pinned"))
    if not all(agent.pinned for agent in agents):
        handles.append(Patch(facecolor="none", edgecolor=MUTED, label="not pinned"))
    handles.append(Line2D([], [], color=INK, label="goal"))
    if asked:
        handles.append(Line2D([], [], color=VERMILLION, linestyle=_DASHED, label="asked for"))
    _legend(ax, handles)


def plot_envelope(settling: Settling, *, ax: Axes | None = None) -> Axes:
    """The certified bound of |e|_inf over time, on a logarithmic axis; a tick wherever another certificate takes over.

    Solid: no start of the box leaves it.  Dashed: the tolerance.
    """
    ax = axes_or_new(ax)
    times, bounds = settling.curve(samples=ENVELOPE_SAMPLES)
    ax.set_yscale("log")
    ax.plot(times, bounds, color=BLUE, linewidth=1.6, zorder=3)
    ax.fill_between(times, bounds, float(bounds.min()) * BELOW, color=BLUE, alpha=0.10, linewidth=0)
    for stage in settling.stages[1:]:
        when = float(stage.start)
        ax.plot(
            [when],
            [settling.envelope(when)],
            zorder=4,
            markersize=4.5,
            marker="s" if stage.is_quadratic else "o",
            color=PURPLE if stage.is_quadratic else BLUE,
        )
    ax.axhline(float(settling.tolerance), color=VERMILLION, linewidth=1.2, linestyle=_DASHED, zorder=2)
    ax.set_ylim(float(bounds.min()) * BELOW, float(bounds.max()) * 1.6)
    ax.set_xlim(0, float(times[-1]))
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.minorticks_off()
    ax.set_xlabel("time t in s")
    ax.set_ylabel("|e|∞, in the unit of x")
    _legend(ax, _stage_handles(settling), columns=2)
    return ax


def _stage_handles(settling: Settling) -> list[Patch | Line2D]:
    kinds = {stage.is_quadratic for stage in settling.stages[1:]}
    handles: list[Patch | Line2D] = [Line2D([], [], color=BLUE, linewidth=1.6, label="certified bound")]
    if False in kinds:
        handles.append(Line2D([], [], color=BLUE, marker="o", linestyle="", label="next max-separable"))
    if True in kinds:
        handles.append(Line2D([], [], color=PURPLE, marker="s", linestyle="", label="next quadratic"))
    return [*handles, Line2D([], [], color=VERMILLION, linestyle=_DASHED, label="tolerance")]


def _legend(ax: Axes, handles: list[Patch | Line2D], *, columns: int = 4) -> None:
    """Above the axes; in two rows where one would be wider than they are."""
    if handles:
        ax.legend(
            handles=handles,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.2,
            handlelength=1.4,
            ncols=len(handles) if len(handles) <= columns else 2,
            columnspacing=1.0,
        )


def _axis_end(claims: Sequence[RegionClaim], *lines: float | None) -> float:
    """Room for every bar with its numbers, two for a ball, and for the lines."""
    ends = (claim.ball * (1.45 if claim.kind == "ball" else 1.2) for claim in claims if claim.ball is not None)
    farthest = max((line for line in lines if line is not None), default=0.0)
    return max([*ends, 1.15 * farthest]) or 1.0
