"""The arcs of a mode in arrays (ends, number of the coupling, number of the weight), and which agents they reach."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

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

    def by_coupling(self) -> Iterator[tuple[int, IndexArray]]:
        """Every coupling that occurs, by its place, with its arcs in their order."""
        return split_by(self.coupling)


def arc_table(problem: Problem, mode: str) -> ArcTable:
    """Return the arcs of one mode."""
    arcs = problem.network.modes[mode]
    weight, weights = distinct_weights(arcs.weights)
    return ArcTable(
        listeners=arcs.listeners,
        speakers=arcs.speakers,
        coupling=coupling_places(problem, arcs),
        weight=weight,
        weights=weights,
    )


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
    """Agents to which no information flows from a pinned agent along the arcs of all given modes together."""
    chosen = list(arcs)
    speakers = np.concatenate([a.speakers for a in chosen]) if chosen else np.zeros(0, dtype=np.int64)
    listeners = np.concatenate([a.listeners for a in chosen]) if chosen else np.zeros(0, dtype=np.int64)
    order = np.argsort(speakers, kind="stable")
    heard_by = listeners[order].tolist()
    start = np.searchsorted(speakers[order], np.arange(problem.n + 1)).tolist()
    reached = [False] * problem.n
    stack = list(problem.pinning.agents)
    for agent in stack:
        reached[agent] = True
    while stack:
        agent = stack.pop()
        for listener in heard_by[start[agent] : start[agent + 1]]:
            if not reached[listener]:
                reached[listener] = True
                stack.append(listener)
    return tuple(i for i, yes in enumerate(reached) if not yes)


def unreached_in_union(problem: Problem) -> tuple[int, ...]:
    """Agents that no pinned agent reaches even when the arcs of all modes are put together."""
    return unreached(problem, problem.network.modes.values())


def closed_groups(problem: Problem, arcs: Iterable[Arcs]) -> tuple[tuple[int, ...], ...]:
    """The smallest sets of agents that listen to nobody outside themselves, all given modes together.

    They are the strongly connected components without an arc to another one (Tarjan's algorithm, without
    recursion); every set that listens to nobody outside contains one.
    """
    hears: list[list[int]] = [[] for _ in range(problem.n)]
    for each in arcs:
        for listener, speaker in zip(each.listeners.tolist(), each.speakers.tolist(), strict=True):
            hears[listener].append(speaker)
    number, low = [-1] * problem.n, [0] * problem.n
    group = [-1] * problem.n
    found: list[list[int]] = []
    path: list[int] = []
    count = 0
    for root in range(problem.n):
        work = [(root, 0)] if number[root] < 0 else []
        while work:
            agent, place = work.pop()
            if place == 0:
                number[agent] = low[agent] = count
                count += 1
                path.append(agent)
            for position in range(place, len(hears[agent])):
                other = hears[agent][position]
                if number[other] < 0:
                    work += [(agent, position + 1), (other, 0)]
                    break
                if group[other] < 0:
                    low[agent] = min(low[agent], number[other])
            else:
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[agent])
                if low[agent] == number[agent]:
                    members: list[int] = []
                    while not members or members[-1] != agent:
                        members.append(path.pop())
                        group[members[-1]] = len(found)
                    found.append(members)
    return tuple(
        tuple(sorted(members))
        for place, members in enumerate(found)
        if all(group[other] == place for agent in members for other in hears[agent])
    )
