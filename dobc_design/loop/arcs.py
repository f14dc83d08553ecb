"""The arcs of a loop in arrays: of one mode, and which nodes they reach; exact, in linear time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dobc_design.loop.loop import Arc, Loop, Pins
from dobc_design.problem.network import Arcs, IndexArray, distinct_weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArcTable:
    """Arc a: ``listeners[a]`` hears ``speakers[a]`` by the coupling at place ``coupling[a]`` of
    loop.functions.  Its weight is ``weights[weight[a]]``; ``weights`` holds each different one
    once.  Arrays of one length, optional arcs among them as if they were there."""

    listeners: IndexArray
    speakers: IndexArray
    coupling: IndexArray
    weight: IndexArray
    weights: tuple[Fraction, ...]


def arc_table(loop: Loop, mode: str) -> ArcTable:
    """Return the arcs of one mode."""
    arcs = loop.modes[mode]
    weight, weights = distinct_weights(arcs.weights)
    places = coupling_places(loop, arcs)
    return ArcTable(
        listeners=arcs.listeners,
        speakers=arcs.speakers,
        coupling=places,
        weight=weight,
        weights=weights,
    )


def coupling_places(loop: Loop, arcs: Arcs) -> IndexArray:
    """For every arc the place of its coupling in loop.functions."""
    return places_at(loop.exceptions, arcs.listeners * loop.n + arcs.speakers, size=loop.n)


def places_at(places: Mapping[Arc, int], codes: IndexArray, *, size: int) -> IndexArray:
    """The place of the coupling of arcs given by listener * size + speaker: that in ``places``, by
    (listener, speaker), else 0."""
    if not places:
        return np.zeros(len(codes), dtype=np.int64)
    special = np.array([i * size + j for i, j in places], dtype=np.int64)
    order = np.argsort(special)
    at = order[np.minimum(np.searchsorted(special, codes, sorter=order), len(order) - 1)]
    return np.where(special[at] == codes, np.array(list(places.values()), dtype=np.int64)[at], 0)


def split_by(kinds: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Every number that occurs, rising, with its positions in their order."""
    order = np.argsort(kinds, kind="stable")
    numbers, starts = np.unique(kinds[order], return_index=True)
    return (
        zip(numbers.tolist(), np.split(order, starts[1:]), strict=True) if len(kinds) else iter(())
    )


def unreached(loop: Loop, arcs: Iterable[Arcs], *, pins: Pins | None = None) -> tuple[int, ...]:
    """Nodes that nothing which hears the fixed node reaches along the arcs of all given modes,
    without those that come and go; ``pins``: by default what pulls in ``pulls``."""
    listeners, speakers = _ends(arcs)
    fixed = loop.n
    pinned = np.array((loop.pulls if pins is None else pins).nodes, dtype=np.int64)
    speakers = np.append(speakers, np.full(len(pinned), fixed))
    listeners = np.append(listeners, pinned)
    links = np.ones(len(speakers))
    graph = sp.csr_array((links, (speakers, listeners)), shape=(loop.n + 1, loop.n + 1))
    met = breadth_first_order(graph, fixed, return_predecessors=False)
    return tuple(np.setdiff1d(np.arange(loop.n), met).tolist())


def _ends(arcs: Iterable[Arcs]) -> tuple[IndexArray, IndexArray]:
    """Listeners and speakers of the arcs of several modes together, without those that come and
    go."""
    chosen = [each.always for each in arcs]
    none = np.zeros(0, dtype=np.int64)
    listeners = np.concatenate([none, *(each.listeners for each in chosen)])
    return listeners, np.concatenate([none, *(each.speakers for each in chosen)])


def closed_groups(loop: Loop, arcs: Iterable[Arcs]) -> tuple[tuple[int, ...], ...]:
    """The smallest sets of agents that listen to nobody outside, strong components that hear no
    other; rising."""
    listeners, speakers = _ends(arcs)
    graph = sp.coo_array((np.ones(len(listeners)), (listeners, speakers)), shape=(loop.n, loop.n))
    component = connected_components(graph, connection="strong")[1].astype(np.int64)
    listening = set(component[listeners[component[listeners] != component[speakers]]].tolist())
    closed = (members for number, members in split_by(component) if number not in listening)
    return tuple(sorted(tuple(members.tolist()) for members in closed))
