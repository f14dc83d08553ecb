"""Where agents stand in a drawing: circulants and rings on a circle, everything else by its distances.

Positions say nothing; only who is joined to whom does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray

Positions = NDArray[np.float64]
Pair = tuple[int, int]

LARGEST_BY_DISTANCE = 150  # Kamada and Kawai's method takes all pairs


def common_offsets(pairs: Iterable[Pair], n: int) -> tuple[int, ...] | None:
    """The steps s with "every agent i listens to i + s (mod n)" when they are all there is, else None.

    ``pairs`` are (listener, speaker), each once.
    """
    known = list(pairs)
    steps = {(speaker - listener) % n for listener, speaker in known}
    return tuple(sorted(steps)) if known and len(known) == n * len(steps) else None


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
