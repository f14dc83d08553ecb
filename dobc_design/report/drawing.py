"""The network as a picture: arrows point the way information flows, pinned agents are squares.

Circulants and rings stand on a circle, everything else by its distances; positions say nothing, only who is joined to
whom does.  A drawing is a few compound paths in data coordinates, so that a large network stays a small file.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from dobc_design.plotting.look import BLUE, INK, MUTED, PAPER, VERMILLION, short
from dobc_design.report.words import common_offsets

Positions = NDArray[np.float64]
Pair = tuple[int, int]

LEGEND = "An arrow from j to i: i listens to j, so information runs along the arrow."
MOST_LABELLED = 60
MOST_AGENTS = 300
MOST_ARCS = 1500
_SIDES = ((0, -1), (0, 1), (1, 0), (-1, 0))
_INSIDE = 3  # letters that fit into a node


def draw_network(
    ax: Axes,
    *,
    labels: Sequence[str],
    arcs: Iterable[tuple[int, int]],
    places: Positions,
    pinned: Collection[int] = (),
    unreached: Collection[int] = (),
) -> Axes:
    """Draw one mode.

    ``arcs`` are (listener, speaker); the arrow starts at the speaker.  Pinned agents are filled blue squares, others
    circles, those that no pin reaches orange dashed circles.  Shapes: places (n, 2), within [-1, 1].
    """
    radius = _radius(places)
    known = list(arcs)
    _draw_arcs(ax, known, places, radius)
    groups = (
        [i for i in range(len(labels)) if i not in pinned and i not in unreached],
        [i for i in range(len(labels)) if i in unreached and i not in pinned],
        sorted(pinned),
    )
    round_shape = Path.unit_circle()
    square = Path(np.array([(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9), (-0.9, -0.9)]), closed=True)
    _draw_nodes(ax, round_shape, places[groups[0]], radius, face=PAPER, edge=INK)
    _draw_nodes(ax, round_shape, places[groups[1]], radius, face=PAPER, edge=VERMILLION, dashed=True)
    _draw_nodes(ax, square, places[groups[2]], radius, face=BLUE, edge=BLUE)
    if len(labels) <= MOST_LABELLED:
        _draw_labels(ax, labels, places, radius, set(pinned), known)
    ax.set_aspect("equal")
    ax.set_axis_off()
    low, high = places.min(axis=0) - 3 * radius, places.max(axis=0) + 3 * radius
    ax.set_xlim(float(low[0]), float(high[0]))
    ax.set_ylim(float(low[1]), float(high[1]))
    return ax


def drawn_labels(labels: Sequence[str]) -> tuple[list[str], str]:
    """Labels as they are drawn, and the beginning that was left out because all but a few letters are alike."""
    alike = _common_beginning(labels).rstrip("0123456789")
    rest = [label[len(alike) :] for label in labels]
    if alike and all(1 <= len(each) <= _INSIDE for each in rest):
        return rest, alike
    return [short(label, 14) for label in labels], ""


def _common_beginning(labels: Sequence[str]) -> str:
    """The beginning that all labels share: that of the first and the last of them in order."""
    first, last = min(labels), max(labels)
    same = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same] if first != last else ""


def proportions(places: Positions) -> float:
    """Height over width that suits the places."""
    width, height = np.ptp(places, axis=0) + 6 * _radius(places)
    return float(np.clip(height / width, 0.3, 1.1))


def too_large(n: int, arcs: int) -> bool:
    """Whether a drawing would be a grey ball."""
    return n > MOST_AGENTS or arcs > MOST_ARCS


def _radius(places: Positions) -> float:
    if len(places) == 1:
        return 0.14
    apart = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    nearest = float(apart[~np.eye(len(places), dtype=bool)].min())
    return float(np.clip(0.3 * nearest, 0.012, 0.12))


def _draw_arcs(ax: Axes, arcs: Sequence[tuple[int, int]], places: Positions, radius: float) -> None:
    known = set(arcs)
    shafts: list[Path] = []
    heads: list[Path] = []
    size = max(0.75 * radius, 0.03)
    for listener, speaker in arcs:
        start, end = places[speaker], places[listener]
        length = float(np.hypot(*(end - start)))
        if length <= 2.3 * radius:
            continue
        forward = (end - start) / length
        side = np.array([-forward[1], forward[0]])
        tip = end - forward * radius * 1.22
        back = tip - forward * size
        both = (speaker, listener) in known
        if not both or listener < speaker:
            tail = start + forward * (radius * 1.22 + size * 0.9 if both else radius * 1.1)
            shafts.append(Path(np.array([tail, back + forward * size * 0.1])))
        heads.append(Path(np.array([tip, back + side * size * 0.45, back - side * size * 0.45, tip]), closed=True))
    if shafts:
        shaft = Path.make_compound_path(*shafts)
        ax.add_patch(PathPatch(shaft, facecolor="none", edgecolor=MUTED, linewidth=0.9))
    if heads:
        ax.add_patch(PathPatch(Path.make_compound_path(*heads), facecolor=INK, edgecolor="none"))


def _draw_nodes(
    ax: Axes, shape: Path, centres: Positions, radius: float, *, face: str, edge: str, dashed: bool = False
) -> None:
    if not len(centres):
        return
    vertices = np.asarray(shape.vertices) * radius
    copies = [Path(vertices + centre, shape.codes) for centre in centres]
    ax.add_patch(
        PathPatch(
            Path.make_compound_path(*copies),
            facecolor=face,
            edgecolor=edge,
            linewidth=1.6 if dashed else 1.1,
            linestyle=(0, (2, 1.2)) if dashed else "solid",
            zorder=2,
        )
    )


def _draw_labels(
    ax: Axes, labels: Sequence[str], places: Positions, radius: float, pinned: set[int], arcs: Sequence[tuple[int, int]]
) -> None:
    """Short labels inside the nodes, where there is room; the others on the side with the fewest arrows."""
    drawn, _ = drawn_labels(labels)
    sides = _free_sides(places, arcs)
    for agent, (x, y) in enumerate(places):
        right, up = sides[agent]
        if len(drawn[agent]) <= _INSIDE and radius > 0.05:
            ax.text(
                x,
                y,
                drawn[agent],
                ha="center",
                va="center_baseline",
                zorder=3,
                parse_math=False,
                fontsize=float(np.clip(78 * radius, 5.5, 9.0)),
                color=PAPER if agent in pinned else INK,
            )
        else:
            ax.text(
                x + 1.35 * radius * right,
                y + 1.35 * radius * up,
                drawn[agent],
                ha=("right", "center", "left")[right + 1],
                va=("top", "center", "bottom")[up + 1],
                zorder=3,
                parse_math=False,
                fontsize=8.0 if len(drawn) <= 30 else 6.0,
                color=INK,
                bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.85, "pad": 0.6},
            )


def _free_sides(places: Positions, arcs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """For every agent the side, below first, that is farthest from the directions of its arrows."""
    directions: list[list[Positions]] = [[] for _ in places]
    for one, other in arcs:
        step = (places[other] - places[one]) / max(float(np.hypot(*(places[other] - places[one]))), 1e-9)
        directions[one].append(step)
        directions[other].append(-step)
    chosen = []
    for own in directions:
        nearest = [max((float(step @ side) for step in own), default=-1.0) for side in np.array(_SIDES)]
        chosen.append(_SIDES[int(np.argmin(np.round(nearest, 3)))])
    return chosen


LARGEST_BY_DISTANCE = 150  # Kamada and Kawai's method takes all pairs


def positions(pairs: Iterable[Pair], n: int) -> Positions:
    """Places (n, 2) within [-1, 1] of agents joined by ``pairs``."""
    known = set(pairs)
    if common_offsets(known, n) is not None:
        return _circle(range(n))
    graph = nx.Graph()
    graph.add_nodes_from(range(n))
    graph.add_edges_from(known)
    components = [sorted(part) for part in nx.connected_components(graph)]
    if len(components) == 1 and n > 2 and all(degree == 2 for _, degree in graph.degree):
        return _circle(_walk(graph))
    if n > LARGEST_BY_DISTANCE:
        return _scaled(nx.spring_layout(graph, seed=1, iterations=60), range(n))
    return _packed(graph, components, n)


def _circle(order: Iterable[int]) -> Positions:
    """Clockwise from the top."""
    agents = list(order)
    places = np.zeros((len(agents), 2))
    for rank, agent in enumerate(agents):
        angle = math.pi / 2 - 2 * math.pi * rank / len(agents)
        places[agent] = math.cos(angle), math.sin(angle)
    return places


def _walk(graph: Any) -> list[int]:
    return [0, *(end for _, end in nx.dfs_edges(graph, 0))]


def _packed(graph: Any, components: Sequence[Sequence[int]], n: int) -> Positions:
    """Every component by itself, larger ones first and drawn larger, side by side in rows."""
    places = np.zeros((n, 2))
    ordered = sorted(components, key=lambda part: (-len(part), part))
    sizes = [max(math.sqrt(len(part) / len(ordered[0])), 0.15) for part in ordered]
    widest = 2.5 * max(1.0, math.sqrt(sum(size**2 for size in sizes)))
    x = y = height = 0.0
    for part, size in zip(ordered, sizes, strict=True):
        if x > 0 and x + 2 * size > widest:
            x, y, height = 0.0, y - height - 0.4, 0.0
        own = np.zeros((1, 2))
        if len(part) > 1:
            start = nx.circular_layout(graph.subgraph(part))
            own = _scaled(nx.kamada_kawai_layout(graph.subgraph(part), pos=start), part)
        places[list(part)] = own * size + np.array([x + size, y - size])
        x, height = x + 2 * size + 0.4, max(height, 2 * size)
    return _fitted(places)


def _scaled(layout: Mapping[int, Any], agents: Iterable[int]) -> Positions:
    return _fitted(np.array([layout[agent] for agent in agents], dtype=np.float64))


def _fitted(places: Positions) -> Positions:
    low, high = places.min(axis=0), places.max(axis=0)
    size = float((high - low).max()) or 1.0
    fitted = (places - (low + high) / 2) * (2 / size)
    return np.asarray(np.round(fitted, 3), dtype=np.float64)
