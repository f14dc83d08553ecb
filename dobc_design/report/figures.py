"""Plots of the report: functions that take data and axes, and return the axes.

They compute nothing but what a drawing needs.  What is drawn solid about a region is proved.  In
networks arrows point the way information flows, and positions say nothing.  Names given by users
are never read as mathematics.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from os.path import commonprefix
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike, NDArray

from dobc_design.conditions.schedule.settling import Settling
from dobc_design.falsification.suspect import RESTS, Falsification
from dobc_design.plotting import look
from dobc_design.plotting.look import (
    BLUE,
    DASHED,
    DOTTED,
    INK,
    MUTED,
    PAPER,
    PURPLE,
    SERIES,
    VERMILLION,
    short,
)
from dobc_design.plotting.regions import name_rows
from dobc_design.report.region_words import MOST_SUSPECTS
from dobc_design.report.words import common_offsets

Positions = NDArray[np.float64]
Pair = tuple[int, int]
DASHES = {"dashed": DASHED, "dotted": DOTTED}  # of bounds, in their order
ENVELOPE_SAMPLES = 201
BELOW = 0.5  # of the least bound, at the foot of its picture
LEGEND = "An arrow from j to i: i listens to j, so information runs along the arrow."
MOST_LABELLED = 60
LARGEST_BY_DISTANCE = 150  # Kamada and Kawai's method takes all pairs
MOST_BIG = 30  # agents whose labels beside the nodes are not made smaller
_SIDES = ((0, -1), (0, 1), (1, 0), (-1, 0))
_INSIDE = 3  # letters that fit into a node
_ROOMY = 0.05  # radius from which a node has letters inside
_CORNERS = np.array([(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9), (-0.9, -0.9)])
_SQUARE = Path(_CORNERS, closed=True)
_CIRCLE = Path.unit_circle()
GAP = 1.22  # between the tip of an arrow and the middle of its node, in radii
_SHORT_DASHES = (0, (2, 1.2))
_LABEL_BOX = {"facecolor": PAPER, "edgecolor": "none", "alpha": 0.85, "pad": 0.6}


def plot_spectrum(ax: Axes, spectra: Mapping[str, ArrayLike]) -> Axes:
    """Eigenvalues in the complex plane, one marker per name; the half-plane that must stay empty is
    shaded. ``spectra``: name -> complex eigenvalues, in 1/s.  At most 400 of each are drawn,
    rightmost and leftmost included."""
    known = {name: np.atleast_1d(np.asarray(each, dtype=complex)) for name, each in spectra.items()}
    everything = np.concatenate(list(known.values()))
    real = everything.real
    reach = max(float(abs(real).max(initial=0.0)), 1e-3)
    left = min(float(real.min(initial=0.0)), 0.0)
    right = max(float(real.max(initial=0.0)), 0.0)
    ax.set_xlim(left - 0.12 * reach, right + 0.2 * reach)
    _shade(ax, right + 10 * reach)
    for place, (name, values) in enumerate(known.items()):
        # Sorted, so that thinning keeps the rightmost, which decides.
        order = np.argsort(values.real, kind="stable")
        points = values[order][look.thinned_rows(len(values))]
        ax.plot(
            points.real,
            points.imag,
            linestyle="none",
            marker=look.MARKERS[place % len(look.MARKERS)],
            color=SERIES[place % len(SERIES)],
            markerfacecolor="none",
            markeredgewidth=1.3,
            label=short(name),
        )
    # Real eigenvalues only: the vertical axis has nothing to say.
    if float(abs(everything.imag).max(initial=0.0)) < 1e-9:
        ax.set_ylim(-1, 1)
        ax.set_yticks([0])
    else:
        ax.margins(y=0.15)
    ax.set(xlabel="Re λ in 1/s", ylabel="Im λ in 1/s")
    return look.legend_above(ax)


def plot_lambda(
    ax: Axes, spectra: Mapping[str, ArrayLike], *, bounds: Mapping[str, float] | None = None
) -> Axes:
    """Eigenvalues of Lambda(J), one row per mode, against 0 and against the ``bounds`` of given
    matrices P. ``spectra``: mode -> real eigenvalues, in 1/s.  ``bounds``: name -> number that the
    largest must stay below."""
    known = {name: np.sort(np.asarray(each, dtype=float).ravel()) for name, each in spectra.items()}
    everything = np.concatenate(list(known.values()))
    # The bounds belong to the range, so that none of them lies outside the picture.
    limits = list((bounds or {}).values())
    low = min(everything.min(initial=0.0), 0.0, *limits)
    high = max(everything.max(initial=0.0), 0.0, *limits)
    reach = max(high - low, 1e-3)
    ax.set_xlim(low - 0.06 * reach, high + 0.14 * reach)
    _shade(ax, high + 10 * reach)
    for row, values in enumerate(known.values()):
        shown = values[look.thinned_rows(len(values))]
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
    foot, top = float(bounds.min()) * BELOW, float(bounds.max()) * 1.6
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
    ax.set(ylim=(foot, top), xlim=(0, float(times[-1])))
    ax.yaxis.set_major_formatter(FuncFormatter(look.power_of_ten))
    ax.minorticks_off()
    ax.set(xlabel="time t in s", ylabel="|e|∞, in the unit of x")
    return look.legend_above(ax, widest=2)


def plot_search(ax: Axes, search: Falsification) -> Axes:
    """|e|_inf of the worst suspects over time, at most eight; solid where an equilibrium is
    proved."""
    shown = search.suspects[:MOST_SUSPECTS]
    for rank, suspect in enumerate(each for each in shown if each.kind != RESTS):
        # Below that a curve would show rounding.
        error = np.where(suspect.error > look.SMALLEST, suspect.error, np.nan)
        label = None if rank else "suspect, simulated"
        colour = SERIES[rank % len(SERIES)]
        ax.plot(suspect.times, error, color=colour, linestyle=DASHED, linewidth=1.1, label=label)
    for rank, suspect in enumerate(each for each in shown if each.kind == RESTS):
        label = None if rank else "another equilibrium, proved"
        ax.axhline(float(suspect.error[0]), color=INK, linewidth=1.8, label=label)
    end = max((float(suspect.times[-1]) for suspect in shown), default=search.horizon)
    ax.set(xlim=(0, end or 1.0), ylim=(0, None))
    ax.set(xlabel="time t in s", ylabel="|e|∞, in the unit of x")
    title = short(f"from {search.target}", 44).replace("|e|_inf <=", "|e|∞ ≤")
    ax.set_title(title, parse_math=False)
    if shown:
        ax.legend(loc="best")
    return ax


def draw_network(
    ax: Axes,
    *,
    labels: Sequence[str],
    arcs: Iterable[Pair],
    places: Positions,
    pinned: Collection[int] = (),
    unreached: Collection[int] = (),
) -> Axes:
    """Draw one mode, as a few compound paths in data coordinates, so that a large network stays a
    small file.  ``arcs`` are (listener, speaker); the arrow starts at the speaker.  Pinned agents
    are filled blue squares, others circles, those that no pin reaches orange dashed circles.
    Shapes: places (n, 2), within [-1, 1]."""
    radius, known = _radius(places), list(arcs)
    _draw_arcs(ax, known, places, radius)
    # Every kind of node is one patch, however many agents it has.
    free = [i for i in range(len(labels)) if i not in pinned]
    reached = [i for i in free if i not in unreached]
    lost = [i for i in free if i in unreached]
    if reached:
        ax.add_patch(_nodes(_CIRCLE, places[reached], radius))
    if lost:
        patch = _nodes(_CIRCLE, places[lost], radius)
        patch.set(edgecolor=VERMILLION, linewidth=1.6, linestyle=_SHORT_DASHES)
        ax.add_patch(patch)
    if pinned:
        patch = _nodes(_SQUARE, places[sorted(pinned)], radius)
        patch.set(facecolor=BLUE, edgecolor=BLUE)
        ax.add_patch(patch)
    if len(labels) <= MOST_LABELLED:
        _draw_labels(ax, labels, places, radius, set(pinned), known)
    ax.set_aspect("equal")
    ax.set_axis_off()
    margin = 3 * radius
    left, low = (places.min(axis=0) - margin).tolist()
    right, high = (places.max(axis=0) + margin).tolist()
    ax.set(xlim=(left, right), ylim=(low, high))
    return ax


def _nodes(shape: Path, places: Positions, radius: float) -> PathPatch:
    """The same shape at all these places, as one patch."""
    corners = np.asarray(shape.vertices) * radius
    path = Path.make_compound_path(*(Path(corners + place, shape.codes) for place in places))
    return PathPatch(path, facecolor=PAPER, edgecolor=INK, linewidth=1.1, zorder=2)


def drawn_labels(labels: Sequence[str]) -> tuple[list[str], str]:
    """Labels as they are drawn, and the beginning that was left out because all but a few letters
    are alike."""
    if all(len(label) <= _INSIDE for label in labels):
        return list(labels), ""
    # Digits belong to the number of an agent, even where all numbers begin with the same one.
    alike = ""
    if len(labels) > 1:
        alike = commonprefix(list(labels)).rstrip("0123456789")  # noqa: RUF071 - no paths
    rest = [label.removeprefix(alike) for label in labels]
    if alike and all(1 <= len(each) <= _INSIDE for each in rest):
        return rest, alike
    return [short(label, 14) for label in labels], ""


def proportions(places: Positions) -> float:
    """Height over width that suits the places."""
    width, height = np.ptp(places, axis=0) + 6 * _radius(places)
    return float(np.clip(height / width, 0.3, 1.1))


def _radius(places: Positions) -> float:
    if len(places) == 1:
        return 0.14
    apart = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    # Nodes must not overlap: they shrink with the least distance.
    nearest = float(apart[~np.eye(len(places), dtype=bool)].min())
    return float(np.clip(0.3 * nearest, 0.012, 0.12))


def _draw_arcs(ax: Axes, arcs: Sequence[Pair], places: Positions, radius: float) -> None:
    """Arrows from whom is heard to who listens; two opposite ones share a shaft."""
    known, shafts, heads = set(arcs), list[Path](), list[Path]()
    # Heads stay visible where nodes are tiny.
    size = max(0.75 * radius, 0.03)
    for listener, speaker in arcs:
        start, end = places[speaker], places[listener]
        length = float(np.hypot(*(end - start)))
        # Nodes that touch leave no room for an arrow.
        if length <= 2.3 * radius:
            continue
        forward = (end - start) / length
        tip = end - forward * radius * GAP
        back = tip - forward * size
        both = (speaker, listener) in known
        # one shaft for both directions, drawn by one of them
        if not both or listener < speaker:
            behind = radius * GAP + size * 0.9 if both else radius * 1.1
            tail = start + forward * behind
            shafts.append(Path(np.array([tail, back + forward * size * 0.1])))
        aside = np.array([-forward[1], forward[0]]) * size * 0.45
        heads.append(Path(np.array([tip, back + aside, back - aside, tip]), closed=True))
    if shafts:
        path = Path.make_compound_path(*shafts)
        ax.add_patch(PathPatch(path, facecolor="none", edgecolor=MUTED, linewidth=0.9))
    if heads:
        path = Path.make_compound_path(*heads)
        ax.add_patch(PathPatch(path, facecolor=INK, edgecolor="none"))


def _draw_labels(
    ax: Axes,
    labels: Sequence[str],
    places: Positions,
    radius: float,
    pinned: set[int],
    arcs: Sequence[Pair],
) -> None:
    """Short labels inside the nodes, where there is room; the others on the side with the fewest
    arrows."""
    drawn, _ = drawn_labels(labels)
    sides = _free_sides(places, arcs)
    inside = float(np.clip(78 * radius, 5.5, 9.0))
    beside = 8.0 if len(drawn) <= MOST_BIG else 6.0
    for agent, ((x, y), (right, up)) in enumerate(zip(places, sides, strict=True)):
        if len(drawn[agent]) <= _INSIDE and radius > _ROOMY:
            text = ax.text(x, y, drawn[agent], ha="center", va="center_baseline", fontsize=inside)
            text.set(parse_math=False, color=PAPER if agent in pinned else INK)
        else:
            away = 1.35 * radius
            text = ax.text(x + away * right, y + away * up, drawn[agent], fontsize=beside)
            across = ("right", "center", "left")[right + 1]
            upright = ("top", "center", "bottom")[up + 1]
            text.set(ha=across, va=upright, parse_math=False, color=INK, bbox=_LABEL_BOX)
        text.set_zorder(3)


def _free_sides(places: Positions, arcs: Sequence[Pair]) -> list[Pair]:
    """For every agent the side, below first, that is farthest from the directions of its arrows."""
    directions: list[list[Positions]] = [[] for _ in places]
    for one, other in arcs:
        apart = places[other] - places[one]
        step = apart / max(float(np.hypot(*apart)), 1e-9)
        directions[one].append(step)
        directions[other].append(-step)
    chosen = []
    for own in directions:
        nearest = []
        for side in np.array(_SIDES):
            nearest.append(max((float(step @ side) for step in own), default=-1.0))
        # Rounded, so that the last bits of two directions do not decide.
        chosen.append(_SIDES[int(np.argmin(np.round(nearest, 3)))])
    return chosen


def positions(pairs: Iterable[Pair], n: int) -> Positions:
    """Places (n, 2) within [-1, 1] of agents joined by ``pairs``: circulants on a circle, others by
    their distances."""
    known = set(pairs)
    graph = nx.Graph()
    graph.add_nodes_from(range(n))
    graph.add_edges_from(known)
    components = [sorted(part) for part in nx.connected_components(graph)]
    if common_offsets(known, n) is not None:
        return _circle(range(n))
    if len(components) == 1 and n > 2 and all(degree == 2 for _, degree in graph.degree):
        return _circle([0, *(end for _, end in nx.dfs_edges(graph, 0))])
    if n > LARGEST_BY_DISTANCE:
        return _scaled(nx.spring_layout(graph, seed=1, iterations=60), range(n))
    return _packed(graph, components, n)


def _circle(order: Sequence[int]) -> Positions:
    """Clockwise from the top."""
    places = np.zeros((len(order), 2))
    for rank, agent in enumerate(order):
        angle = math.pi / 2 - 2 * math.pi * rank / len(order)
        places[agent] = math.cos(angle), math.sin(angle)
    return places


def _packed(graph: Any, components: Sequence[Sequence[int]], n: int) -> Positions:
    """Every component by itself, larger ones first and drawn larger, side by side in rows."""
    places = np.zeros((n, 2))
    # Equal ones by their first agent, so that a drawing never depends on the order of arcs.
    ordered = sorted(components, key=lambda part: (-len(part), part))
    sizes = [max(math.sqrt(len(part) / len(ordered[0])), 0.15) for part in ordered]
    widest = 2.5 * max(1.0, math.sqrt(sum(size**2 for size in sizes)))
    x = y = height = 0.0
    for part, size in zip(ordered, sizes, strict=True):
        # the next row
        if x > 0 and x + 2 * size > widest:
            y -= height + 0.4
            x = height = 0.0
        own = np.zeros((1, 2))
        if len(part) > 1:
            # A start of its own makes the layout the same every time.
            start = nx.circular_layout(graph.subgraph(part))
            own = _scaled(nx.kamada_kawai_layout(graph.subgraph(part), pos=start), part)
        places[list(part)] = own * size + np.array([x + size, y - size])
        x += 2 * size + 0.4
        height = max(height, 2 * size)
    return _fitted(places)


def _scaled(layout: Mapping[int, Any], agents: Iterable[int]) -> Positions:
    return _fitted(np.array([layout[agent] for agent in agents], dtype=np.float64))


def _fitted(places: Positions) -> Positions:
    low, high = places.min(axis=0), places.max(axis=0)
    size = float((high - low).max()) or 1.0
    return np.asarray(np.round((places - (low + high) / 2) * (2 / size), 3), dtype=np.float64)
