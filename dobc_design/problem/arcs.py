"""The arcs of a mode in arrays (ends, number of the coupling, number of the weight), and which agents they reach."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dobc_design.problem.network import Arcs, IndexArray
from dobc_design.problem.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArcTable:
    """Arc a: ``listeners[a]`` hears ``speakers[a]`` by the coupling at place ``coupling[a]`` of problem.couplings.

    Its weight is ``weights[weight[a]]``; ``weights`` holds each different one once.  Arrays of one length.
    """

    listeners: IndexArray
    speakers: IndexArray
    coupling: IndexArray
    weight: IndexArray
    weights: tuple[Fraction, ...]


def arc_table(problem: Problem, mode: str) -> ArcTable:
    """Return the arcs of one mode."""
    arcs = problem.network.modes[mode]
    weight, weights = distinct_weights(arcs.weights)
    places = coupling_places(problem, arcs)
    return ArcTable(listeners=arcs.listeners, speakers=arcs.speakers, coupling=places, weight=weight, weights=weights)


def coupling_places(problem: Problem, arcs: Arcs) -> IndexArray:
    """For every arc the place of its coupling in problem.couplings."""
    return places_at(problem, arcs.listeners * problem.n + arcs.speakers)


def places_at(problem: Problem, codes: IndexArray) -> IndexArray:
    """The same for arcs given by listener * n + speaker."""
    places = problem.exception_places
    if not places:
        return np.zeros(len(codes), dtype=np.int64)
    special = np.array([i * problem.n + j for i, j in places], dtype=np.int64)
    order = np.argsort(special)
    at = order[np.minimum(np.searchsorted(special, codes, sorter=order), len(order) - 1)]
    return np.where(special[at] == codes, np.array(list(places.values()), dtype=np.int64)[at], 0)


def distinct_weights(weights: Sequence[Fraction]) -> tuple[IndexArray, tuple[Fraction, ...]]:
    """For every arc the place of its weight among the different ones, and these; arcs mostly share few objects."""
    objects = {id(weight): weight for weight in weights}
    table: dict[Fraction, int] = {}
    place = {key: table.setdefault(weight, len(table)) for key, weight in objects.items()}
    return np.fromiter(map(place.__getitem__, map(id, weights)), dtype=np.int64, count=len(weights)), tuple(table)


def split_by(kinds: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Every number that occurs, rising, with its positions in their order."""
    order = np.argsort(kinds, kind="stable")
    numbers, starts = np.unique(kinds[order], return_index=True)
    return zip(numbers.tolist(), np.split(order, starts[1:]), strict=True) if len(kinds) else iter(())


def unreached(problem: Problem, arcs: Iterable[Arcs]) -> tuple[int, ...]:
    """Agents that nothing from a pinned agent reaches along the arcs of all given modes; exact, in linear time."""
    listeners, speakers = _ends(arcs)
    order = np.argsort(speakers, kind="stable")
    heard_by = listeners[order].tolist()
    start = np.searchsorted(speakers[order], np.arange(problem.n + 1)).tolist()
    left = set(range(problem.n)) - set(problem.pinning.agents)
    waiting = list(problem.pinning.agents)
    while waiting:
        agent = waiting.pop()
        found = left.intersection(heard_by[start[agent] : start[agent + 1]])
        left -= found
        waiting += found
    return tuple(sorted(left))


def _ends(arcs: Iterable[Arcs]) -> tuple[IndexArray, IndexArray]:
    """Listeners and speakers of the arcs of several modes together."""
    chosen, none = list(arcs), np.zeros(0, dtype=np.int64)
    return np.concatenate([none, *(a.listeners for a in chosen)]), np.concatenate([none, *(a.speakers for a in chosen)])


def unreached_in_union(problem: Problem) -> tuple[int, ...]:
    """Agents that no pinned agent reaches even when the arcs of all modes are put together."""
    return unreached(problem, problem.network.modes.values())


def closed_groups(problem: Problem, arcs: Iterable[Arcs]) -> tuple[tuple[int, ...], ...]:
    """The smallest sets of agents that listen to nobody outside themselves, all given modes together.

    They are the strongly connected components without an arc to another one; every set that listens to nobody
    outside contains one.  Sets and their agents in rising order.
    """
    listeners, speakers = _ends(arcs)
    graph = coo_array((np.ones(len(listeners)), (listeners, speakers)), shape=(problem.n, problem.n))
    component = connected_components(graph, connection="strong")[1].astype(np.int64)
    listening = set(component[listeners[component[listeners] != component[speakers]]].tolist())
    closed = (members for number, members in split_by(component) if number not in listening)
    return tuple(sorted(tuple(members.tolist()) for members in closed))
