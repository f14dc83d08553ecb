"""The picture of a network: arrows from who is heard to who listens, pinned agents as squares.

Positions say nothing.  Names given by users are never read as mathematics.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from fractions import Fraction
from os.path import commonprefix
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from dobc_design._show.text import significant, typeset
from dobc_design.errors import about

from .look import BLUE, INK, MUTED, PAPER, VERMILLION, Sheet, short

Positions = NDArray[np.float64]
Points = NDArray[np.complex128]
Pair = tuple[int, int]
Weights = Mapping[Pair, Fraction | float]  # of arcs, by (listener, speaker)
LEGEND = "An arrow from j to i: i listens to j, so information runs along the arrow."
MOST_MODES = 6
MOST_AGENTS, MOST_ARCS = 300, 1500  # of a network that is drawn; beyond, it would be a grey ball
MOST_LABELLED = 60
LARGEST_BY_DISTANCE = 150  # Kamada and Kawai's method takes all pairs
MOST_WEIGHTED = 24  # arcs whose weights are written beside them
MOST_BIG = 30  # agents whose labels beside the nodes are not made smaller
MOST_IN_ROW = 20  # agents of a chain that stand on a line
_SIDES = ((0, -1), (0, 1), (1, 0), (-1, 0))
_INSIDE = 3  # letters that fit into a node
_ROOMY = 0.05  # radius from which a node has letters inside
_CORNERS = np.array([(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9), (-0.9, -0.9)])
_SQUARE = Path(_CORNERS, closed=True)
_CIRCLE = Path.unit_circle()
_BENDS = (0.0, 0.15, -0.15, 0.3, -0.3, 0.5, -0.5)  # of an arc aside, in its lengths
_APART = 0.3  # the same, of opposite arcs with different weights
_CLEAR = 1.5  # between an arc and the middle of any other node, in radii
_ALONG = np.linspace(0, 1, 21)[1:-1]  # of an arc
_PLANE = np.array([1, 1j])  # what turns (x, y) into x + iy: left is i times forward
GAP = 1.22  # between the tip of an arrow and the middle of its node, in radii
_SHORT_DASHES = (0, (2, 1.2))
_LABEL_BOX = {"facecolor": PAPER, "edgecolor": "none", "alpha": 0.85, "pad": 0.6}


def network_sheet(
    name: str,
    modes: Mapping[str, Weights],
    *,
    labels: Sequence[str],
    pinned: Mapping[str, Collection[int]],
    word: str = "pinned",
    ax: Axes | None = None,
) -> Sheet | Axes:
    """The first six ``modes`` side by side on the same places, below them what the signs mean; with
    ``ax`` these axes, with the first mode.  ``pinned``: the nodes that are in each mode, or that
    are what the ``word`` says.
    Raises: SpecError for a network that is too large to be drawn."""
    shown = dict(list(modes.items())[:MOST_MODES])
    pairs = {pair for each in shown.values() for pair in each}
    if len(labels) > MOST_AGENTS or len(pairs) > MOST_ARCS:
        raise about(
            "network",
            f"{len(labels)} agents and {len(pairs)} arcs are too many to be drawn (at most "
            f"{MOST_AGENTS} and {MOST_ARCS}).",
            "Take network.to_networkx(mode) to other programs.",
        )
    places = positions(pairs, len(labels))
    has_pins = any(pinned.values())
    lost = {mode: set[int]() for mode in shown}
    if has_pins:
        lost = {mode: _unreached(arcs, pinned[mode], len(labels)) for mode, arcs in shown.items()}

    def draw(axes: Axes, mode: str) -> Axes:
        draw_network(
            axes,
            labels=labels,
            arcs=shown[mode],
            places=places,
            pinned=pinned[mode],
            unreached=lost[mode],
        )
        axes.set_title(f"mode {short(mode)}", loc="left", parse_math=False)
        return axes

    if ax is not None:
        return draw(ax, next(iter(shown)))

    def draw_all(figure: Figure) -> None:
        for place, mode in enumerate(shown, 1):
            draw(figure.add_subplot(rows, columns, place), mode)
        signs = _signs(has_pins, word, any(lost.values()))
        figure.legend(handles=signs, loc="outside lower left", ncols=2, fontsize=8)

    rows = math.ceil(len(shown) / 3)
    columns = math.ceil(len(shown) / rows)
    height = rows * (3.4 * proportions(places) + 0.3) + 0.7
    return Sheet(draw_all, width=max(3.4 * columns, 4.6), height=height, title=name)


def _unreached(arcs: Iterable[Pair], pinned: Collection[int], n: int) -> set[int]:
    """The agents that no path of arcs joins to a pinned agent."""
    graph = nx.DiGraph([(speaker, listener) for listener, speaker in arcs])
    graph.add_nodes_from(range(n))
    reached = set(pinned).union(*(nx.descendants(graph, agent) for agent in pinned))
    return set(range(n)) - reached


def _signs(pinned: bool, word: str, lost: bool) -> list[Line2D]:
    """The entries of a legend, of what is drawn."""

    def sign(label: str, marker: str, edge: str, face: str) -> Line2D:
        entry = Line2D([], [], linestyle="none", marker=marker, label=label)
        entry.set(markeredgecolor=edge, markerfacecolor=face)
        return entry

    is_pin = word == "pinned"
    found = [sign("not pinned" if pinned and is_pin else "agent", "o", INK, PAPER)]
    if pinned:
        found.insert(0, sign(word, "s", BLUE, BLUE))
    if lost:
        source = "pinned agent" if is_pin else word
        found.append(sign(f"reached from no {source}", "o", VERMILLION, PAPER))
    found.append(sign("points to the agent that listens", "$\\rightarrow$", INK, INK))
    return found


def draw_network(
    ax: Axes,
    *,
    labels: Sequence[str],
    arcs: Weights,
    places: Positions,
    pinned: Collection[int] = (),
    unreached: Collection[int] = (),
) -> Axes:
    """Draw one mode, as a few compound paths in data coordinates, so that a large network stays a
    small file.  The arrow of an arc starts at the speaker and passes by other nodes; weights stand
    beside a few arcs, unless all are 1.  Pinned agents are filled blue squares, others circles,
    those that no pin reaches orange dashed circles.
    Shapes: places (n, 2), within [-1, 1]."""
    radius = _radius(places)
    draw_arcs(ax, arcs, places, radius)
    # Every kind of node is one patch, however many agents it has.
    free = set(range(len(labels))) - set(pinned)
    lost = {"edgecolor": VERMILLION, "linewidth": 1.6, "linestyle": _SHORT_DASHES}
    for agents, shape, style in (
        (free - set(unreached), _CIRCLE, {}),
        (free & set(unreached), _CIRCLE, lost),
        (set(pinned), _SQUARE, {"facecolor": BLUE, "edgecolor": BLUE}),
    ):
        if agents:
            patch = _nodes(shape, places[sorted(agents)], radius)
            patch.set(**style)
            ax.add_patch(patch)
    if len(labels) <= MOST_LABELLED:
        _draw_labels(ax, labels, places, radius, set(pinned), arcs)
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
    points = places @ _PLANE
    apart = np.abs(np.subtract.outer(points, points))
    # Nodes must not overlap: they shrink with the least distance.
    nearest = apart[~np.eye(len(places), dtype=bool)].min()
    return float(np.clip(0.3 * nearest, 0.012, 0.12))


def _bends(arcs: Weights, places: Points, clear: float) -> dict[Pair, float]:
    """How far every arc bends, see ``_bend_past``.  Opposite arcs share their way, unless weights
    are shown and theirs differ."""
    found: dict[Pair, float] = {}
    weighted = shows_weights(arcs)
    for (end, start), weight in arcs.items():
        if weighted and arcs.get((start, end), weight) != weight:
            found[end, start] = _APART
        elif (start, end) in found:
            found[end, start] = -found[start, end]
        else:
            others = np.delete(places, [end, start])
            found[end, start] = _bend_past(others, places[start], places[end], clear)
    return found


def _bend_past(others: Points, start: complex, end: complex, clear: float) -> float:
    """How far to the left an arc bends, in its lengths: the least that keeps it ``clear`` of all
    ``others``, or comes closest to that."""

    def room(bend: float) -> float:
        gaps = np.subtract.outer(_on_arc(start, end, bend, _ALONG), others)
        return float(np.abs(gaps).min(initial=clear))

    return max(_BENDS, key=room)


def _on_arc(start: complex, end: complex, bend: float, t: Any) -> Any:
    """Where the arc is at 0 <= t <= 1."""
    return start + (end - start) * (t + 2j * bend * t * (1 - t))


def draw_arcs(ax: Axes, arcs: Weights, positions: Positions, radius: float) -> None:
    """Arrows from whom is heard to who listens, past other nodes; two opposite ones share a shaft.
    Weights stand beside a few, unless all are 1."""
    places = positions @ _PLANE
    bends = _bends(arcs, places, _CLEAR * radius)
    shafts, heads = list[Path](), list[Path]()
    # Heads stay visible where nodes are tiny.
    size = max(0.75 * radius, 0.015 * np.ptp(positions, axis=0).max(initial=0.0))
    for (listener, speaker), bend in bends.items():
        start, end = places[speaker], places[listener]
        # Nodes that touch leave no room for an arrow.
        if abs(end - start) <= 2.3 * radius:
            continue
        # The directions at both ends meet there.
        control = start + (end - start) * (0.5 + 1j * bend)
        forward = (end - control) / abs(end - control)
        tip = end - forward * radius * GAP
        back = tip - forward * size
        both = bends.get((speaker, listener)) == -bend
        # one shaft for both directions, drawn by one of them
        if not both or listener < speaker:
            behind = radius * GAP + size * 0.9 if both else radius * 1.1
            tail = start + behind * (control - start) / abs(control - start)
            shaft = _corners(tail, control, back + forward * size * 0.1)
            shafts.append(Path(shaft, [Path.MOVETO, Path.CURVE3, Path.CURVE3]))
        aside = 0.45j * forward * size
        heads.append(Path(_corners(tip, back + aside, back - aside, tip), closed=True))
    if shafts:
        path = Path.make_compound_path(*shafts)
        ax.add_patch(PathPatch(path, facecolor="none", edgecolor=MUTED, linewidth=0.9, zorder=0.8))
    if heads:
        path = Path.make_compound_path(*heads)
        ax.add_patch(PathPatch(path, facecolor=INK, edgecolor="none"))
    if shows_weights(arcs):
        _draw_weights(ax, arcs, bends, places)


def _corners(*points: complex) -> Positions:
    return np.array([(point.real, point.imag) for point in points])


def shows_weights(arcs: Weights) -> bool:
    """Whether weights are written beside the arcs: where there are few, and not all are 1."""
    return len(arcs) <= MOST_WEIGHTED and any(weight != 1 for weight in arcs.values())


def _draw_weights(ax: Axes, arcs: Weights, bends: Mapping[Pair, float], places: Points) -> None:
    """Every weight on its arc, that of opposite arcs with the same weight once."""
    for (listener, speaker), weight in arcs.items():
        if arcs.get((speaker, listener)) == weight and listener > speaker:
            continue
        # Not half-way, where arcs cross.
        at = _on_arc(places[speaker], places[listener], bends[listener, speaker], 0.45)
        text = ax.text(at.real, at.imag, typeset(significant(weight)), fontsize=7)
        text.set(ha="center", va="center", parse_math=False, bbox=_LABEL_BOX, zorder=0.9)


def _draw_labels(
    ax: Axes,
    labels: Sequence[str],
    places: Positions,
    radius: float,
    pinned: set[int],
    arcs: Iterable[Pair],
) -> None:
    """Labels inside the nodes where all of them fit; else all on the side with the fewest
    arrows."""
    drawn, _ = drawn_labels(labels)
    fit = radius > _ROOMY and max(map(len, drawn)) <= _INSIDE
    sides = [(0, 0)] * len(drawn) if fit else _free_sides(places, arcs)
    size = 8.0 if len(drawn) <= MOST_BIG else 6.0
    if fit:
        size = float(np.clip(78 * radius, 5.5, 9.0))
    for agent, (place, side) in enumerate(zip(places, sides, strict=True)):
        right, up = side
        x, y = place + 1.35 * radius * np.array(side)
        text = ax.text(x, y, drawn[agent], fontsize=size, zorder=3, parse_math=False)
        text.set(
            ha=("right", "center", "left")[right + 1],
            va=("top", "center_baseline", "bottom")[up + 1],
            color=PAPER if fit and agent in pinned else INK,
            bbox=None if fit else _LABEL_BOX,
        )


def _free_sides(places: Positions, arcs: Iterable[Pair]) -> list[Pair]:
    """For every agent the side, below first, that is farthest from the directions of its arrows."""
    points = places @ _PLANE
    directions: list[list[complex]] = [[] for _ in places]
    for one, other in arcs:
        apart = points[other] - points[one]
        step = apart / max(abs(apart), 1e-9)
        directions[one].append(step)
        directions[other].append(-step)
    chosen = []
    for own in directions:
        # Rounded, so that the last bits of two directions do not decide.
        nearest = np.outer(_SIDES @ np.conj(_PLANE), own).real.max(axis=1, initial=-1).round(3)
        chosen.append(_SIDES[int(np.argmin(nearest))])
    return chosen


def positions(pairs: Iterable[Pair], n: int) -> Positions:
    """Places (n, 2) within [-1, 1] of agents joined by ``pairs``: circulants on a circle, chains in
    a row, others by their distances."""
    known = set(pairs)
    graph = nx.Graph()
    graph.add_nodes_from(range(n))
    graph.add_edges_from(known)
    components = [sorted(part) for part in nx.connected_components(graph)]
    if common_offsets(known, n) is not None:
        return _circle(range(n))
    if len(components) == 1 and n > 2 and all(degree == 2 for _, degree in graph.degree):
        return _circle([0, *(end for _, end in nx.dfs_edges(graph, 0))])
    row = _row(graph, n)
    if row is not None:
        return row
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


def _row(graph: Any, n: int) -> Positions | None:
    """A chain on a line, one with arcs to the next but one on two; None for other graphs."""
    if not 1 < n <= MOST_IN_ROW or not nx.is_connected(graph):
        return None
    ends = [agent for agent, degree in graph.degree if degree == 1]
    order, rise = list(range(n)), 0.0
    # A tree with two leaves is a path.
    if len(ends) == 2 and graph.number_of_edges() == n - 1:
        order = list(nx.dfs_preorder_nodes(graph, ends[0]))
    elif all(abs(one - other) <= 2 for one, other in graph.edges):
        rise = 0.7
    else:
        return None
    places = np.zeros((n, 2))
    places[order] = [(rank, rise * (rank % 2)) for rank in range(n)]
    return _fitted(places)


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
    size = (high - low).max() or 1.0
    return np.asarray(np.round((places - (low + high) / 2) * (2 / size), 3), dtype=np.float64)


def common_offsets(pairs: Iterable[tuple[int, int]], n: int) -> tuple[int, ...] | None:
    """The steps s with "every agent i listens to i + s (mod n)" when they are all there is, else
    None."""
    known = list(pairs)
    steps = {(speaker - listener) % n for listener, speaker in known}
    return tuple(sorted(steps)) if known and len(known) == n * len(steps) else None
