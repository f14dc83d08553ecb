"""What agents hear of each other when packets are exchanged, lost, or no longer sent; and what they feel of it.

A packet holds the measured state less the formation offset and target, y_j.  Whoever got none feels nothing on that
arc.  The couplings are those of (9), evaluated arc by arc, because every arc may hold an older value.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dobc_design.problem.arrays import ArcGroup, gathering_matrix
from dobc_design.simulation.formula import compile_coupling
from dobc_design.simulation.switches import Array, IndexArray


class Links:
    """The arcs of one graph, ready for values that differ from arc to arc."""

    def __init__(self, groups: Sequence[ArcGroup], n: int, m: int) -> None:
        self.groups, self.n, self.m = groups, n, m
        self.parts = [
            (compile_coupling(group.coupling), group.coupling.by_component, gathering_matrix(group, n))
            for group in groups
        ]
        empty = [np.zeros(0, dtype=np.int64)]
        self.listeners = np.concatenate([*empty, *(group.listeners for group in groups)])
        self.speakers = np.concatenate([*empty, *(group.speakers for group in groups)])
        self.codes = self.listeners * n + self.speakers

    def felt(self, own: Array, heard: Array) -> Array:
        """Sum of h(heard - own) over the arcs of each listener; an arc that holds nan is silent.

        Shapes: own (n, m), heard (arcs, m); or (n, m, R) and (arcs, m, R) for R runs.  Returns: as ``own``.
        """
        difference = heard - own[self.listeners]
        silent: Any = np.isnan(heard).any(axis=1)
        total = np.zeros_like(own)
        begin = 0
        for h, by_component, gather in self.parts:
            end = begin + gather.shape[1]
            y = difference[begin:end]
            value = np.array(h(y) if by_component else h(np.ascontiguousarray(y)))
            np.moveaxis(value, 1, -1)[silent[begin:end]] = 0.0
            total += (gather @ value.reshape(len(value), -1)).reshape(own.shape)
            begin = end
        return total


class Air:
    """What every listener holds of every speaker: ``values`` (arcs, m) of the present links, nan where nothing came."""

    def __init__(self, m: int, loss: float, rng: np.random.Generator) -> None:
        self.m, self.loss, self.rng = m, loss, rng
        self.codes: IndexArray = np.zeros(0, dtype=np.int64)
        self.values: Array = np.zeros((0, m))

    def exchange(self, links: Links, spoken: Array) -> None:
        """Every speaker sends ``spoken`` (n, m), nan for silence; each packet arrives or is lost."""
        self.tune(links)
        arrived = self.rng.random(len(links.codes)) >= self.loss
        sent = spoken[links.speakers]
        arrived |= np.isnan(sent).any(axis=1)  # who is silent for ever is noticed
        self.values = np.where(arrived[:, None], sent, self.values)

    def tune(self, links: Links) -> None:
        """Take over what is held of links that stay; nothing is held of new ones."""
        if len(links.codes) == len(self.codes) and np.array_equal(links.codes, self.codes):
            return
        values = np.full((len(links.codes), self.m), np.nan)
        if len(self.codes):
            order = np.argsort(self.codes)
            place = np.minimum(np.searchsorted(self.codes[order], links.codes), len(order) - 1)
            known = self.codes[order][place] == links.codes
            values[known] = self.values[order[place[known]]]
        self.codes, self.values = links.codes, values
