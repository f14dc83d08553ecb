"""Rows of boxes that move: for -s lower <= e <= s upper, linear in time on a segment, in floats
with outward bounds.

Upper face, for every mode, every time of the segment and all s that are asked for (theory, section
11):

    sum_j w sup { h_ij(y) : -s (l_j + u_i) <= y <= s (u_j - u_i) } - k_i s u_i + load <= s u_i'

and the lower one with l and u exchanged and -h(-y) in place of h.  A segment is halved where its
ends do not show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.separable.claim import FACES, holding_gains
from dobc_design.conditions.separable.large import (
    ArcRows,
    Array,
    Kinds,
    Layout,
    Piece,
    arc_layout,
    down,
    float_kinds,
    open_within,
    up,
)
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import float_above, float_below
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop

HALVINGS: Final = 11  # of a segment
# Parts of each segment, and besides, that may be left to halve: more are left only where a claim is
# false.
PARTS: Final = 8
FEW: Final = 500
CELLS: Final = 2048  # of the tables: near the target rows have little room
MARGIN: Final = Fraction(1, 2**20)  # by which tables reach further than boxes
TOGETHER: Final = 2_000_000  # arcs that are looked at in one go


def _sum(a: Any, b: Any) -> Array:
    """a + b, rounded down; a sum of floats that is 0 is exact."""
    return np.where(a + b == 0, 0.0, down(a + b))


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Boxes -lower <= e <= upper, (count, 2 faces, n): lower and upper bounds of what is meant;
    faces as in FACES. Where ``same`` is alike and not 0 so are the numbers."""

    below: Array
    above: Array
    same: Array

    @classmethod
    def of(cls, upper: Sequence[Sequence[Fraction]], lower: Sequence[Sequence[Fraction]]) -> Box:
        """Exact boxes, one after the other."""
        both = [(u, low) for u, low in zip(upper, lower, strict=True)]
        below, above = (
            np.array([[[bound(x) for x in face] for face in box] for box in both])
            for bound in (float_below, float_above)
        )
        places: dict[Fraction, int] = {}
        same = [
            [[places.setdefault(x, len(places) + 1) for x in face] for face in box] for box in both
        ]
        return cls(below, above, np.array(same))

    @classmethod
    def floats(cls, values: Array) -> Box:
        """Boxes that are meant as the floats say."""
        return cls(values, values, np.zeros(values.shape, dtype=np.int64))

    def __getitem__(self, places: Any) -> Box:
        return Box(self.below[places], self.above[places], self.same[places])

    @staticmethod
    def differ(a: Array, b: Array) -> Any:
        """Which numbers may differ, of those that are the same as these."""
        return (a != b) | (a == 0)

    def between(self, other: Box, part: Array) -> Box:
        """Where it is after a ``part`` (count,) of the way to ``other``; parts are exact."""
        part = part[:, None, None]
        same = np.where(part == 0, self.same, np.where(part == 1, other.same, 0))
        below = np.where(
            part == 0, self.below, down(down(self.below * (1 - part)) + down(other.below * part))
        )
        above = np.where(
            part == 0, self.above, up(up(self.above * (1 - part)) + up(other.above * part))
        )
        return Box(
            np.where(part == 1, other.below, below), np.where(part == 1, other.above, above), same
        )


@dataclass(frozen=True, slots=True, eq=False)
class MovingRows:
    """The rows of all modes of a problem, for boxes whose numbers are bounded."""

    most: Fraction  # what no number of a box may exceed
    layout: Layout
    kinds: Kinds
    size: int
    modes: int
    holds: Array  # what the pin of each agent is worth, rounded down

    def _arcs(self, start: Box, end: Box, face: int) -> ArcRows:
        """Steps and reaches that hold from one box to the other, box after box; without pulls."""
        own, other = (0, 1) if face > 0 else (1, 0)
        owners, speakers = self.layout.rows % self.size, self.layout.speakers
        count, rows = len(start.below), self.size * self.modes
        boxes = (start,) if start is end else (start, end)
        apart = [
            Box.differ(box.same[:, own][:, speakers], box.same[:, own][:, owners]) for box in boxes
        ]
        wide = [up(box.above[:, own][:, speakers] - box.below[:, own][:, owners]) for box in boxes]
        steps = np.maximum.reduce(
            [np.where(a, b, 0.0) for a, b in zip(apart, wide, strict=True)]
        ).ravel()
        steps = np.maximum(steps, np.tile(self.layout.floor, count))
        reaches = [
            up(box.above[:, other][:, speakers] + box.above[:, own][:, owners]) for box in boxes
        ]
        reaches = np.maximum.reduce(reaches).ravel()
        first = (self.layout.start[None, :-1] + len(owners) * np.arange(count)[:, None]).ravel()
        weights = self.layout.weights
        return ArcRows(
            start=np.append(first, count * len(owners)),
            steps=steps,
            reaches=np.maximum(reaches, -steps),
            weights=None
            if weights is None
            else (np.tile(weights[0], count), np.tile(weights[1], count)),
            kinds=np.tile(self.layout.kinds, count),
            own=(np.zeros(0), np.zeros(0)),
            pulls=(Fraction(0),) * (count * rows),
        )

    def needed(self, box: Box, load: Array) -> Array:
        """The slopes (count, 2, n) that the rows ask of boxes where they stand, ``load`` (count,)
        added; about."""
        found = np.empty(box.below.shape)
        for place, face in enumerate(FACES):
            arcs = self._arcs(box, box, face)
            sums = Piece(arcs, face, self.kinds, np.arange(len(arcs.pulls))).at(1.0)
            worst = sums.reshape(len(box.below), self.modes, self.size).max(axis=1)
            found[:, place] = worst + load[:, None] - self.holds * box.below[:, place]
        return found

    def pull(self, v: Array, sizes: Sequence[float]) -> Array:
        """The slopes (count, n) that the rows ask of weights v (count, n) at rest, on both faces,
        about."""
        s = np.repeat(np.array(sizes), len(v))[:, None, None]
        boxes = np.tile(np.stack([v, v], axis=1), (len(sizes), 1, 1))
        asked = self.needed(Box.floats(s * boxes), np.zeros(len(boxes))) / s
        return np.asarray(asked.max(axis=1).reshape(len(sizes), *v.shape).max(axis=0))

    def open_segments(
        self,
        boxes: Box,
        times: Sequence[Fraction],
        load: Array,
        *,
        low: float = 1.0,
        high: float = 1.0,
        only: Sequence[int] | None = None,
    ) -> list[int]:
        """The segments (default: all) from each box to the next that are not proved for all s in
        [low, high]. ``load``: an upper bound at each time, and on each segment of its chord; with
        low = high = 1 only."""
        lengths = [after - before for before, after in pairwise(times)]
        short, long = (
            np.array([bound(x) for x in lengths]) for bound in (float_below, float_above)
        )
        rise = down(boxes.below[1:] - boxes.above[:-1])
        rise = np.where(Box.differ(boxes.same[1:], boxes.same[:-1]), rise, 0.0)
        slopes = np.where(rise >= 0, rise / long[:, None, None], rise / short[:, None, None])
        slopes = np.where(rise == 0, 0.0, down(slopes))
        return self.open_for(boxes, slopes, load, low=low, high=high, only=only)

    def open_for(
        self,
        boxes: Box,
        slopes: Array,
        load: Array,
        *,
        low: float,
        high: float,
        only: Sequence[int] | None = None,
    ) -> list[int]:
        """The same for given slopes (segments, 2, n) of the faces."""
        places: Any = np.arange(len(slopes)) if only is None else np.array(only, dtype=np.int64)
        parts: tuple[Any, Array, Array] = places, np.zeros(len(places)), np.ones(len(places))
        for _ in range(HALVINGS + 1):
            left = self._open_parts(boxes, slopes, load, parts, low, high)
            if not len(left):
                return []
            # a row that fails all along, not in one place
            if len(left) > PARTS * len(places) + FEW:
                return sorted(set(parts[0][left].tolist()))
            segments, first, width = (np.repeat(each[left], 2) for each in parts)
            parts = segments, first + np.tile([0.0, 0.5], len(left)) * width, width / 2
        return sorted(set(parts[0].tolist()))

    def _open_parts(
        self,
        boxes: Box,
        slopes: Array,
        load: Array,
        parts: tuple[Any, Array, Array],
        low: float,
        high: float,
    ) -> NDArray[np.int64]:
        """The parts (segment, where it begins, how wide) that are not proved as they are."""
        chunk, failed = max(1, TOGETHER // max(1, len(self.layout.rows))), list[Any]()
        for k in range(0, len(parts[0]), chunk):
            segments, first, width = (each[k : k + chunk] for each in parts)
            spend(1 + len(segments) * len(self.layout.rows) // 10)
            cuts = (first, first + width)
            ends = [boxes[segments].between(boxes[segments + 1], part) for part in cuts]
            loads = [
                up(up(load[segments] * (1 - part)) + up(load[segments + 1] * part)) for part in cuts
            ]
            loaded = np.maximum(load[segments], load[segments + 1]) > 0
            most = np.where(loaded, np.maximum(*loads), 0.0)[:, None]
            bad = np.zeros(len(segments), dtype=bool)
            for place, face in enumerate(FACES):
                sides = [(box.below[:, place], box.above[:, place]) for box in ends]
                held = np.minimum(*(np.minimum(self.holds * a, self.holds * b) for a, b in sides))
                held = np.where(self.holds == 0, 0.0, down(held))
                limits = _sum(_sum(held, slopes[segments, place]), -most)
                limits = np.repeat(limits[:, None], self.modes, axis=1).ravel()
                # what is infinite proves nothing
                with np.errstate(invalid="ignore", over="ignore"):
                    rows = open_within(
                        self._arcs(ends[0], ends[1], face), limits, face, self.kinds, high, low
                    )
                bad[np.unique(rows // (self.size * self.modes))] = True
            failed.append(k + np.flatnonzero(bad))
        return np.concatenate(failed)


def moving_rows(
    loop: Loop, most: Fraction, modes: Sequence[str] | None = None
) -> MovingRows | None:
    """Rows for boxes with no number beyond ``most``; None where a coupling is not defined or turns
    too often."""
    layout, radius = arc_layout(loop, modes=modes), 2 * most * (1 + MARGIN)
    try:
        profiles = tuple(profile(Curve(each.components[0]), radius) for each in loop.functions)
        far = np.full(len(layout.rows), float_above(2 * most))
        arcs = ArcRows(layout.start, far, far, layout.weights, layout.kinds, (far[:0], far[:0]), ())
        kinds = float_kinds(
            profiles, arcs, rho=1 + MARGIN / 2, cells=2 if loop.is_linear else CELLS
        )
    except UndefinedError:
        return None
    if kinds is None:
        return None
    holds = np.array([float_below(x) for x in holding_gains(loop)])
    return MovingRows(most, layout, kinds, loop.n, (len(layout.start) - 1) // loop.n, holds)
