"""Plots of eigenvalues, runs, certified regions and searches: functions that take data and axes, and return the axes.

They compute nothing but what a drawing needs: thinning of long data, limits, ticks.  What is drawn solid about a region
is proved.  Names given by users are never read as mathematics by Matplotlib.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike, NDArray

from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.falsification.suspect import RESTS, Falsification
from dobc_design.plotting.look import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MARKERS,
    MUTED,
    PAPER,
    PURPLE,
    SERIES,
    SMALLEST,
    VERMILLION,
    legend_above,
    power_of_ten,
    short,
    shown_agents,
    thinned_rows,
)
from dobc_design.report.region_words import lower, method_name
from dobc_design.report.search_words import MOST_ROWS

DASHES = {"dashed": DASHED, "dotted": DOTTED}  # of bounds, in their order


def plot_spectrum(ax: Axes, spectra: Mapping[str, ArrayLike], *, symbol: str = "λ") -> Axes:
    """Eigenvalues in the complex plane, one marker per name; the half-plane that must stay empty is shaded.

    ``spectra``: name -> complex eigenvalues, in 1/s.
    """
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
    legend_above(ax)
    return ax


def plot_lambda(ax: Axes, spectra: Mapping[str, ArrayLike], *, bounds: Mapping[str, float] | None = None) -> Axes:
    """Eigenvalues of Lambda(J), one row per mode, against 0 and against the ``bounds`` of given matrices P.

    ``spectra``: mode -> real eigenvalues, in 1/s.  ``bounds``: name -> number that the largest must stay below.
    """
    names = list(spectra)
    everything = np.concatenate([np.asarray(each, dtype=float).ravel() for each in spectra.values()])
    marks = [0.0, *(bounds or {}).values()]
    low, high = min(everything.min(initial=0.0), *marks), max(everything.max(initial=0.0), *marks)
    reach = max(high - low, 1e-3)
    ax.set_xlim(low - 0.06 * reach, high + 0.14 * reach)
    ax.axvspan(0, high + 10 * reach, color=VERMILLION, alpha=0.13, linewidth=0)
    ax.axvline(0, color=VERMILLION, linewidth=1.0)
    for row, name in enumerate(names):
        values = np.sort(np.asarray(spectra[name], dtype=float).ravel())
        values = values[thinned_rows(len(values))]
        ax.plot(values, np.full(len(values), row), linestyle="none", marker="|", markersize=9, color=BLUE)
        ax.plot(values[-1:], [row], linestyle="none", marker="D", markersize=4.5, color=BLUE)
    for bound, dashes in zip((bounds or {}).values(), itertools.cycle(DASHES.values()), strict=False):
        ax.axvline(bound, color=INK, linewidth=1.1, linestyle=dashes)
    ax.set_yticks(range(len(names)), [short(name) for name in names], parse_math=False)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("eigenvalues of Λ(J) in 1/s")
    return ax


def _thinned_points(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """At most 400 points, the rightmost and leftmost among them."""
    ordered = values[np.argsort(values.real, kind="stable")]
    return ordered[thinned_rows(len(ordered))]


MOST_STARTS: Final = 24  # agents
ENVELOPE_SAMPLES: Final = 201
BELOW: Final = 0.5  # of the least bound, at the foot of its picture
_LONGEST: Final = 18  # letters of a line of a method's name
_NOTES: Final = {"everywhere": "every start", "near": "near the target, no radius", "none": "nothing proved"}


def plot_regions(ax: Axes, regions: Regions) -> Axes:
    """One row per method: the |e|_inf that it proves for all agents at once, and for one agent alone.

    The dashed line is what was asked for.  Sizes in the unit of the states.
    """
    claims = regions.claims
    asked = None if regions.asked is None else regions.asked.box
    reach = _axis_end(claims, asked, regions.rest)
    for row, claim in enumerate(claims):
        _draw_reach(ax, row, claim, reach)
    if asked is not None:
        ax.axvline(asked, color=VERMILLION, linewidth=1.3, linestyle=DASHED, zorder=3, label="asked for")
    if regions.rest is not None:
        ax.axvline(regions.rest, color=INK, linewidth=1.4, linestyle=DOTTED, zorder=3, label="other equilibrium")
    ax.set_xlim(0, reach)
    ax.set_ylim(len(claims) - 0.4, -0.6)
    names = [_two_lines(method_name(claim)) for claim in claims]
    ax.set_yticks(range(len(claims)), names, parse_math=False)
    ax.tick_params(axis="y", length=0)
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("distance from the goals at the start, in the unit of x")
    legend_above(ax, least=1)
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
        ax.barh(row, claim.box, height=0.52, color=BLUE, zorder=2, label="all at once")
        if claim.ball > claim.box:
            (end,) = ax.plot(
                [claim.box, claim.ball], [row, row], color=BLUE, linewidth=1.3, zorder=2, label="one alone"
            )
            end.set(marker="|", markersize=9, markeredgewidth=1.6, markevery=[1])
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


def plot_starts(ax: Axes, regions: Regions) -> Axes:
    """From where each agent may start, all at once: a bar around its goal, pinned agents in blue.

    Bars are in the unit of x, around the goals; with several state components they show the error, around 0.  The
    band is what was asked for.  At most 24 agents are drawn.
    """
    agents, asked = regions.agents, _band(regions)
    pinned = {place for place, agent in enumerate(agents) if agent.pinned}
    chosen = shown_agents(len(agents), pinned, MOST_STARTS)
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
            label="pinned" if agent.pinned else "not pinned",
        )
        ax.plot([column - 0.36, column + 0.36], [goal, goal], color=INK, linewidth=1.3, zorder=3, label="goal")
    if asked is not None:
        ax.axhspan(*asked, facecolor=VERMILLION, alpha=0.16, linewidth=0, zorder=1)
        for edge in asked:
            ax.axhline(edge, color=VERMILLION, linewidth=1.2, linestyle=DASHED, zorder=4, label="asked for")
    _name_agents(ax, [short(agents[place].label, 10) for place in chosen])
    in_states = all(agent.goal is not None for agent in agents)
    ax.set_ylabel("xᵢ(0), in its own unit" if in_states else "error at the start")
    legend_above(ax, widest=4, least=1)
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


def plot_envelope(ax: Axes, settling: Settling) -> Axes:
    """The certified bound of |e|_inf over time, on a logarithmic axis; a tick wherever another certificate takes over.

    Solid: no start of the box leaves it.  Dashed: the tolerance.
    """
    times, bounds = settling.curve(samples=ENVELOPE_SAMPLES)
    ax.set_yscale("log")
    ax.plot(times, bounds, color=BLUE, linewidth=1.6, zorder=3, label="certified bound")
    ax.fill_between(times, bounds, float(bounds.min()) * BELOW, color=BLUE, alpha=0.10, linewidth=0)
    for stage in settling.stages[1:]:
        when = float(stage.start)
        marker, colour, kind = ("s", PURPLE, "quadratic") if stage.is_quadratic else ("o", BLUE, "max-separable")
        at, told = [settling.envelope(when)], f"next {kind}"
        ax.plot([when], at, zorder=4, markersize=4.5, linestyle="", marker=marker, color=colour, label=told)
    ax.axhline(
        float(settling.tolerance), color=VERMILLION, linewidth=1.2, linestyle=DASHED, zorder=2, label="tolerance"
    )
    ax.set_ylim(float(bounds.min()) * BELOW, float(bounds.max()) * 1.6)
    ax.set_xlim(0, float(times[-1]))
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.minorticks_off()
    ax.set_xlabel("time t in s")
    ax.set_ylabel("|e|∞, in the unit of x")
    legend_above(ax, widest=2)
    return ax


def _axis_end(claims: Sequence[RegionClaim], *lines: float | None) -> float:
    """Room for every bar with its numbers, two for a ball, and for the lines."""
    ends = (claim.ball * (1.45 if claim.kind == "ball" else 1.2) for claim in claims if claim.ball is not None)
    farthest = max((line for line in lines if line is not None), default=0.0)
    return max([*ends, 1.15 * farthest]) or 1.0


def plot_search(ax: Axes, search: Falsification) -> Axes:
    """|e|_inf of the worst suspects over time, at most eight; solid where an equilibrium is proved."""
    shown = search.suspects[:MOST_ROWS]
    runs = [suspect for suspect in shown if suspect.kind != RESTS]
    for rank, suspect in enumerate(runs):
        error = np.where(suspect.error > SMALLEST, suspect.error, np.nan)
        label = None if rank else "suspect, simulated"
        colour = SERIES[rank % len(SERIES)]
        ax.plot(suspect.times, error, color=colour, linestyle=DASHED, linewidth=1.1, label=label)
    for rank, suspect in enumerate(each for each in shown if each.kind == RESTS):
        label = None if rank else "another equilibrium, proved"
        ax.axhline(float(suspect.error[0]), color=INK, linewidth=1.8, label=label)
    end = max((float(suspect.times[-1]) for suspect in shown), default=search.horizon)
    ax.set_xlim(0, end or 1.0)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time t in s")
    ax.set_ylabel("|e|∞, in the unit of x")
    ax.set_title(short(f"from {search.target}", 44).replace("|e|_inf <=", "|e|∞ ≤"), parse_math=False)
    if shown:
        ax.legend(loc="best")
    return ax
