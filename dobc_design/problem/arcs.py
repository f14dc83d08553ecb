"""The arcs of a mode in arrays: both ends, the number of the coupling and the number of the weight.

Made in one pass over the arcs and the exceptions, however many couplings there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
