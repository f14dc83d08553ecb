"""The loop of pairs: what rows are about where agents agree on a value that nobody prescribes.

Its nodes are the ordered pairs (i, j) of agents, with the error x_i - x_j (theory, section 16):

    (x_i - x_j)' = sum_l w_il h_il(x_l - x_i) - sum_l w_jl h_jl(x_l - x_j) + C eps_i - C eps_j

Pair (i, j) hears (l, j) by h_il where i hears l, and (i, l) by h*(y) = -h_jl(-y) where j hears l.
A pair (j, j) is a fixed node: its error is 0.  The upper row of (i, j) bounds x_i - x_j; its lower
row is the upper one of (j, i).

C eps_i - C eps_j is at most twice the largest |C eps_i|, so that an exosystem has the output 2 C
here, and a gain W counts as W/2: A - W C is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import LONGEST_MADE
from dobc_design.exact.matrix import Matrix, scale
from dobc_design.exact.number import common_denominator
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer
from dobc_design.problem.network import Arc, Arcs, IndexArray

from .arcs import coupling_places
from .loop import Loop, Starts, pins_of, zero_goals

#: What the rows of a pair may hold of C eps, in parts of the largest |C eps_i|.
RESIDUALS = Fraction(2)
#: Two fixed nodes: of who is heard by the first of a pair, and of who is heard by its second.
FIXED = ("same", "same 2")


def pairs_of(loop: Loop) -> Loop:
    """The loop of pairs of this one, which has no pins and no drift."""
    functions, mirrored = _functions(loop)
    modes = dict[str, Arcs]()
    exceptions = dict[Arc, int]()
    for name, arcs in loop.modes.items():
        heard = _Heard(loop, arcs)
        modes[name] = heard.arcs()
        exceptions |= heard.exceptions(mirrored)
    n = loop.n
    labels = tuple(f"{a} - {b}" for i, a in enumerate(loop.labels) for b in _others(loop.labels, i))
    none = pins_of({})
    starts = loop.starts
    if starts is not None:
        apart = tuple((lo - hi, hi - lo) for lo, hi in starts.states)
        starts = Starts(states=apart, disturbance=starts.disturbance)
    return replace(
        loop,
        labels=labels,
        fixed=FIXED,
        modes=modes,
        functions=functions,
        exceptions=MappingProxyType(exceptions),
        pins=none,
        pulls=none,
        groups=tuple(map(_doubled, loop.groups)),
        goals=zero_goals(loop.m),
        starts=starts,
        xi0=None,
    )


def _others(labels: Sequence[str], i: int) -> tuple[str, ...]:
    return (*labels[:i], *labels[i + 1 :])


def _doubled(group: Group) -> Group:
    """The same estimation error, seen through 2 C."""
    exosystem = Exosystem(A=group.exosystem.A, C=scale(RESIDUALS, group.exosystem.C))
    observer = replace(group.observer, W=gain_of_pairs(group.observer.W))
    return Group(agents=group.agents, exosystem=exosystem, observer=observer)


def gain_of_pairs(W: Matrix | None) -> Matrix | None:
    """The gain for the output 2 C with which A - W C is the same."""
    return None if W is None else scale(1 / RESIDUALS, W)


def _functions(loop: Loop) -> tuple[tuple[Coupling, ...], dict[int, int]]:
    """The functions h and h*(y) = -h(-y), each different one once, and the place of each h*."""
    functions = list(loop.functions)
    places = dict[int, int]()
    for place, h in enumerate(loop.functions):
        if h.is_linear:
            places[place] = place
            continue
        mirrored = make_coupling(
            [f"-({_negated(text)})" for text in h.texts] if len(h.texts) > 1 else f"-({_negated(h.texts[0])})",
            dimension=loop.m,
            longest=LONGEST_MADE,
        )
        places[place] = len(functions)
        functions.append(mirrored)
    return tuple(functions), places


def _negated(text: str) -> str:
    import re

    return re.sub(r"\by\b", "(-y)", text)


class _Heard:
    """Which pairs each pair hears in one mode, in arrays."""

    def __init__(self, loop: Loop, arcs: Arcs) -> None:
        self.loop = loop
        n = loop.n
        count = len(arcs)
        places = coupling_places(loop, arcs)
        shared = _Shared.of(loop, arcs)
        # arc a, by which i hears l, for every j != i
        a = np.repeat(np.arange(count), n)
        j = np.tile(np.arange(n), count)
        i, l = arcs.listeners[a], arcs.speakers[a]
        kept = j != i
        a, i, j, l = a[kept], i[kept], j[kept], l[kept]
        weights = shared.left(a, j)
        kept = weights != 0
        a, i, j, l, weights = a[kept], i[kept], j[kept], l[kept], weights[kept]
        first = self.pair(i, j)
        second = self.pair(j, i)
        meets = l == j
        m = n * (n - 1)
        to_first = np.where(meets, m, self.pair(l, np.where(meets, (l + 1) % n, j)))
        to_second = np.where(meets, m + 1, self.pair(np.where(meets, (l + 1) % n, j), l))
        self.a = np.concatenate([a, a])
        self.listeners = np.concatenate([first, second])
        self.speakers = np.concatenate([to_first, to_second])
        self.numbers = np.concatenate([weights, weights])
        self.places = np.concatenate([places[a], places[a]])
        self.mirrored = np.repeat([False, True], len(a))
        self.loose = arcs.uncertain[self.a]
        self.bottom = shared.bottom
        self.together = shared.together()

    def pair(self, i: Any, j: Any) -> Any:
        """The number of the pair (i, j)."""
        return i * (self.loop.n - 1) + j - (j > i)

    def arcs(self) -> Arcs:
        """The arcs of pairs, optional ones last."""
        order = np.argsort(self.loose, kind="stable")
        own, numbers = self.together
        listeners = np.concatenate([own, self.listeners[order]])
        fixed = np.full(len(own), self.loop.n * (self.loop.n - 1))
        speakers = np.concatenate([fixed, self.speakers[order]])
        values = np.concatenate([numbers, self.numbers[order]])
        known = {x: Fraction(x, self.bottom) for x in set(values.tolist())}
        weights = tuple(known[x] for x in values.tolist())
        return Arcs(listeners, speakers, weights, int(np.count_nonzero(self.loose)))

    def exceptions(self, mirrored: dict[int, int]) -> dict[Arc, int]:
        """The places of functions other than the first."""
        table = np.array([mirrored[p] for p in range(len(self.loop.functions))])
        places = np.where(self.mirrored, table[self.places], self.places)
        other = np.flatnonzero(places)
        ends = zip(self.listeners[other].tolist(), self.speakers[other].tolist(), strict=True)
        return dict(zip(ends, places[other].tolist(), strict=True))


class _Shared:
    """What both of a pair hear of one agent: a w (x_l - x_i) - a w (x_l - x_j) = - w (x_i - x_j),
    where the function is linear; the lesser weight of the two counts as one arc to a fixed node."""

    def __init__(self, loop: Loop, arcs: Arcs, numbers: Any, bottom: int, matched: bool) -> None:
        self.n = loop.n
        self.arcs = arcs
        self.numbers = numbers
        self.bottom = bottom
        self.matched = matched

    @classmethod
    def of(cls, loop: Loop, arcs: Arcs) -> _Shared:
        bottom = common_denominator(arcs.weights, bits=4000)
        assert bottom is not None
        numbers = np.array([int(w * bottom) for w in arcs.weights], dtype=object)
        if all(x < 2**60 for x in numbers.tolist()):
            numbers = numbers.astype(np.int64)
        return cls(loop, arcs, numbers, bottom, loop.is_linear and len(loop.functions) == 1)

    def left(self, a: IndexArray, j: IndexArray) -> Any:
        """What is left of the weight of arc a for the pair with j."""
        w = self.numbers[a]
        if not self.matched:
            return w
        table = {}
        sure = len(self.arcs) - self.arcs.optional
        for k, (i, l, _) in enumerate(self.arcs.always):
            table[i, l] = self.numbers[k]
        other = np.array(
            [
                table.get((jj, ll), 0) if aa < sure else 0
                for aa, jj, ll in zip(a.tolist(), j.tolist(), self.arcs.speakers[a].tolist())
            ],
            dtype=self.numbers.dtype,
        )
        return w - np.minimum(w, other)

    def together(self) -> tuple[Any, Any]:
        if not self.matched:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=self.numbers.dtype)
        n = self.n
        total = np.zeros((n, n), dtype=self.numbers.dtype)
        always = self.arcs.always
        for l in np.unique(always.speakers).tolist():
            here = np.flatnonzero(always.speakers == l)
            i = always.listeners[here]
            w = self.numbers[here]
            total[np.ix_(i, i)] += np.minimum.outer(w, w)
        i, j = np.nonzero(total * (1 - np.eye(n, dtype=np.int64)))
        return i * (n - 1) + j - (j > i), total[i, j]
