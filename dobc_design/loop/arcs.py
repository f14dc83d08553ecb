"""The arcs of a loop in arrays: of one mode, and which nodes they reach; exact, in linear time."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.matrix import Vector
from dobc_design.problem.network import Arcs, IndexArray, Places, distinct_weights

from .loop import Loop, Pins


@noun(eq=False)
class ArcTable:
    """Arc a: ``listeners[a]`` hears ``speakers[a]`` by the coupling at place ``coupling[a]`` of
    loop.functions.  Its weight is ``weights[weight[a]]``; ``weights`` holds each different one
    once.  Arrays of one length, optional arcs among them as if they were there."""

    listeners: IndexArray
    speakers: IndexArray
    coupling: IndexArray
    weight: IndexArray
    weights: Vector


def arc_table(loop: Loop, mode: str) -> ArcTable:
    """Return the arcs of one mode."""
    arcs = loop.modes[mode]
    weight, weights = distinct_weights(arcs.weights)
    return ArcTable(
        listeners=arcs.listeners,
        speakers=arcs.speakers,
        coupling=coupling_places(loop, arcs),
        weight=weight,
        weights=weights,
    )


def coupling_places(loop: Loop, arcs: Arcs) -> IndexArray:
    """For every arc the place of its coupling in loop.functions."""
    codes = arcs.listeners * loop.nodes + arcs.speakers
    return places_at(loop.exceptions, codes, size=loop.nodes)


def places_at(places: Places, codes: IndexArray, *, size: int) -> IndexArray:
    """The place of the coupling of arcs given by listener * size + speaker: that in ``places``, by
    (listener, speaker), else 0."""
    # Most problems have one coupling, and then nothing has to be searched.
    if not places:
        return np.zeros(len(codes), dtype=np.int64)
    special = np.array([i * size + j for i, j in places], dtype=np.int64)
    found = np.array(list(places.values()), dtype=np.int64)
    order = np.argsort(special)
    # Where a code would stand among the special ones; it is one of them if it stands there.
    rank = np.searchsorted(special, codes, sorter=order)
    at = order[np.minimum(rank, len(order) - 1)]
    return np.where(special[at] == codes, found[at], 0)


def split_by(kinds: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Every number that occurs, rising, with its positions in their order."""
    if not len(kinds):
        return
    # Stable, so that arcs of one kind keep their order.
    order = np.argsort(kinds, kind="stable")
    numbers, starts = np.unique(kinds[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(order, starts[1:]), strict=True)


def unreached(loop: Loop, arcs: Iterable[Arcs], *, pins: Pins | None = None) -> tuple[int, ...]:
    """Nodes that nothing which hears the fixed node reaches along the arcs of all given modes,
    without those that come and go; ``pins``: by default what pulls in ``pulls``.  Of nodes that are
    to agree: those of two or more groups that hear nobody outside.  With signs: those that hear
    nobody outside either, and whose signs balance."""
    if loop.has_roots:
        groups = closed_groups(loop, arcs)
        return tuple(sorted(chain(*groups))) if len(groups) > 1 else ()
    pulled = loop.pulls if pins is None else pins
    if loop.signed:
        groups = closed_groups(loop, arcs)
        free = (group for group in groups if not set(pulled.nodes) & set(group))
        return tuple(sorted(chain(*free)))
    pinned = np.array(pulled.nodes, dtype=np.int64)
    # All fixed nodes are one, which those with a pin listen to.
    fixed = loop.n
    ends = _ends(arcs)
    speakers = np.append(np.minimum(ends.speakers, fixed), np.full(len(pinned), fixed))
    listeners = np.append(ends.listeners, pinned)
    # Along the direction of influence: from who is heard to who hears.
    links = np.ones(len(speakers))
    graph = sp.csr_array((links, (speakers, listeners)), shape=(fixed + 1, fixed + 1))
    met = breadth_first_order(graph, fixed, return_predecessors=False)
    return tuple(np.setdiff1d(np.arange(loop.n), met).tolist())


def tied(loop: Loop) -> set[int]:
    """The nodes that hear a fixed one in some mode."""
    found = set[int]()
    for arcs in loop.modes.values() if loop.fixed else ():
        found |= set(arcs.listeners[arcs.speakers >= loop.n].tolist())
    return found


class Pin(NamedTuple):
    """An arc from a node to one whose error is 0."""

    node: int
    function: Coupling
    weight: Fraction


def with_pins(loop: Loop, pins: Mapping[str, Iterable[Pin]], name: str) -> Loop:
    """The loop with these arcs, by mode, to fixed nodes of this name."""
    functions = list(loop.functions)
    places = {function: place for place, function in enumerate(functions)}
    exceptions = dict(loop.exceptions)
    modes = dict(loop.modes)
    own: dict[int, list[int]] = {}  # the places of a node's pins, each in some mode
    for mode, each in pins.items():
        ends, weights = list[tuple[int, int]](), list[Fraction]()
        for node, function, weight in each:
            place = places.setdefault(function, len(functions))
            if place == len(functions):
                functions.append(function)
            # An arc has one function: pins of a node that differ are to different nodes.
            known = own.setdefault(node, [])
            if place not in known:
                known.append(place)
            end = (node, loop.nodes + known.index(place))
            exceptions[end] = place
            ends.append(end)
            weights.append(weight)
        arcs = modes[mode]
        # Optional arcs are the last ones.
        listeners, speakers = np.array(ends).T
        modes[mode] = Arcs(
            listeners=np.append(listeners, arcs.listeners),
            speakers=np.append(speakers, arcs.speakers),
            weights=(*weights, *arcs.weights),
            optional=arcs.optional,
        )
    numbers = range(max(map(len, own.values())))
    return replace(
        loop,
        fixed=(*loop.fixed, *(f"{name} {k + 1}" if k else name for k in numbers)),
        modes=modes,
        functions=tuple(functions),
        exceptions=MappingProxyType(exceptions),
    )


class _Ends(NamedTuple):
    listeners: IndexArray
    speakers: IndexArray


def _ends(arcs: Iterable[Arcs]) -> _Ends:
    """Listeners and speakers of the arcs of several modes together, without those that come and
    go."""
    none = np.zeros(0, dtype=np.int64)
    listeners = [none]
    speakers = [none]
    for each in arcs:
        always = each.always
        listeners.append(always.listeners)
        speakers.append(always.speakers)
    return _Ends(np.concatenate(listeners), np.concatenate(speakers))


def closed_groups(loop: Loop, arcs: Iterable[Arcs]) -> tuple[tuple[int, ...], ...]:
    """The smallest sets of agents that listen to nobody outside, strong components that hear no
    other and no fixed node; rising.  With signs: of these, the sets whose signs balance."""
    arcs = tuple(arcs)
    listeners, speakers = _ends(arcs)
    count = loop.nodes
    if loop.signed:
        # The double cover: node i + count carries -x_i.
        listeners = np.concatenate([listeners, listeners + count])
        opposes = np.concatenate([each.always.opposes for each in arcs])
        crossed = np.where(opposes, speakers + count, speakers)
        speakers = np.concatenate([crossed, (crossed + count) % (2 * count)])
        count *= 2
    links = np.ones(len(listeners))
    graph = sp.coo_array((links, (listeners, speakers)), shape=(count, count))
    _, labels = connected_components(graph, connection="strong")
    component = labels.astype(np.int64)
    # A component is open if one of its agents hears another component.
    hearer = component[listeners]
    listening = set(hearer[hearer != component[speakers]].tolist())
    closed = set()
    for number, members in split_by(component):
        if number in listening or members[0] % loop.nodes >= loop.n:
            continue
        agents = sorted((members % loop.nodes).tolist())
        # A set that holds an agent together with its opposite can only rest at 0.
        if not loop.signed or len(set(agents)) == len(agents):
            closed.add(tuple(agents))
    return tuple(sorted(closed))
