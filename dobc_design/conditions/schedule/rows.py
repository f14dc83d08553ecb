"""Rows of boxes that move: for -s lower <= e <= s upper, linear in time on a segment, in floats
with outward bounds.

Upper face, for every mode, every time of the segment and all s that are asked for (theory, section
11):

    sum_j w sup { h_ij(y) : -s (l_j + u_i) <= y <= s (u_j - u_i) } - k_i s u_i + load <= s u_i'

and the lower one with l and u exchanged and -h(-y) in place of h.  A segment is halved where its
ends do not show it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun, positional
from dobc_design.conditions.separable.claim import FACES, holding_gains
from dobc_design.conditions.separable.large import (
    ArcRows,
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
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ZERO, float_above, float_below
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import Timing
from dobc_design.problem.network import BoolArray

HALVINGS = 11  # of a segment
# Parts of each segment, and besides, that may be left to halve: more are left only where a claim is
# false.
PARTS = 8
FEW = 500
CELLS = 2048  # of the tables: near the target rows have little room
MARGIN = Fraction(1, 2**20)  # by which tables reach further than boxes
FINEST = 16  # tables, each a quarter as wide as the one before
TOGETHER = 2_000_000  # arcs that are looked at in one go
A_STEP = 10  # arcs, for one step of work

Faces = Sequence[Sequence[Fraction]]
Places = NDArray[np.int64]


def _sum(a: Array, b: Array) -> Array:
    """a + b, rounded down; a sum of floats that is 0 is exact."""
    return np.where(a + b == 0, 0.0, down(a + b))


@noun(eq=False)
class Box:
    """Boxes -lower <= e <= upper, (count, 2 faces, n): lower and upper bounds of what is meant;
    faces as in FACES. Where ``same`` is alike and not 0 so are the numbers."""

    below: Array
    above: Array
    same: NDArray[Any]

    @classmethod
    def of(cls, upper: Faces, lower: Faces) -> Box:
        """Exact boxes, one after the other."""
        both = list(zip(upper, lower, strict=True))
        places: dict[Fraction, int] = {}

        def place(x: Fraction) -> int:
            return places.setdefault(x, len(places) + 1)

        below = _each_number(float_below, both)
        above = _each_number(float_above, both)
        return cls(below=below, above=above, same=_each_number(place, both))

    @classmethod
    def floats(cls, values: Array) -> Box:
        """Boxes that are meant as the floats say."""
        unknown = np.zeros(values.shape, dtype=np.int64)
        return cls(below=values, above=values, same=unknown)

    def __getitem__(self, places: Any) -> Box:
        return Box(below=self.below[places], above=self.above[places], same=self.same[places])

    @staticmethod
    def differ(a: Array, b: Array) -> Any:
        """Which numbers may differ, of those that are the same as these."""
        return (a != b) | (a == 0)

    def between(self, other: Box, part: Array) -> Box:
        """Where it is after a ``part`` (count,) of the way to ``other``; parts are exact."""
        part = part[:, None, None]
        left = 1 - part
        below = down(down(self.below * left) + down(other.below * part))
        above = up(up(self.above * left) + up(other.above * part))
        return Box(
            below=_exact_at_ends(part, self.below, below, other.below),
            above=_exact_at_ends(part, self.above, above, other.above),
            same=_exact_at_ends(part, self.same, 0, other.same),
        )


def _each_number(bound: Callable[[Fraction], float], boxes: Sequence[Faces]) -> Array:
    """The bound of every number of some boxes, (count, 2 faces, n)."""
    found = list[list[list[float]]]()
    for box in boxes:
        found.append([list(map(bound, face)) for face in box])
    return np.array(found)


def _exact_at_ends(part: Array, start: Array, between: Array | int, end: Array) -> Array:
    """What is not on the way, but at one of its ends, is not rounded."""
    return np.where(part == 0, start, np.where(part == 1, end, between))


@noun(eq=False)
class Motion:
    """What rows are asked about: ``boxes``, one after the other, and between each and the next, a
    segment, the ``slopes`` (segments, 2, n) of its faces, rounded down.

    ``load``: an upper bound at each box, and on each segment of its chord.  Rows have to hold for s
    times the boxes, all s in [low, high]; with a load for s = 1 only.  ``heard``: on each segment
    the box that late readings of neighbours lie in; None where none are late.
    """

    boxes: Box
    slopes: Array
    load: Array
    low: float = 1.0
    high: float = 1.0
    heard: Box | None = None


@noun(eq=False)
class _Parts:
    """Parts of segments: of which, where it begins, and how wide all are, as parts of the length of
    a segment."""

    segments: Places
    first: Array
    width: float = 1.0

    def __len__(self) -> int:
        return len(self.segments)

    def __getitem__(self, places: slice | Places) -> _Parts:
        return replace(self, segments=self.segments[places], first=self.first[places])

    @property
    def halves(self) -> _Parts:
        """Both halves of each, one after the other."""
        width = self.width / 2
        shift = np.tile([0.0, width], len(self))
        first = np.repeat(self.first, 2) + shift
        return _Parts(segments=np.repeat(self.segments, 2), first=first, width=width)

    @property
    def numbers(self) -> list[int]:
        """The segments of which these are parts, rising."""
        return sorted(set(self.segments.tolist()))


@noun(eq=False)
class MovingRows:
    """The rows of all modes of a problem, for boxes whose numbers are bounded by ``most``."""

    most: Fraction
    layout: Layout
    kinds: Kinds
    size: int  # n, of agents
    fixed: int  # nodes after them, whose error is 0
    modes: int
    holds: Array  # what the pin of each agent is worth, rounded down

    def _arcs(self, boxes: Sequence[Box], face: int, heard: Box | None) -> ArcRows:
        """Steps and reaches that hold from the first to the last of ``boxes``, place after place;
        without pulls.  ``heard`` as in ``Motion``."""
        layout = self.layout
        arcs = len(layout.rows)
        count = len(boxes[0].below)
        # Steps and reaches are linear between two boxes: what holds at both ends holds on the way.
        far = np.maximum.reduce([self._steps_and_reaches(box, heard or box, face) for box in boxes])
        steps = np.maximum(far[0].ravel(), np.tile(layout.floor, count))
        first = layout.start[None, :-1] + arcs * np.arange(count)[:, None]
        weights = None
        if layout.weights is not None:
            below, above = layout.weights
            weights = (np.tile(below, count), np.tile(above, count))
        return ArcRows(
            start=np.append(first.ravel(), count * arcs),
            steps=steps,
            reaches=np.maximum(far[1].ravel(), -steps),
            weights=weights,
            kinds=np.tile(layout.kinds, count),
            own=(np.zeros(0), np.zeros(0)),
            pulls=(Fraction(0),) * (count * self.size * self.modes),
        )

    def _steps_and_reaches(self, box: Box, heard: Box, face: int) -> Array:
        """For every arc how far the speaker's face may be ahead of the listener's, and how far its
        other face is behind it, at most: (2, count, arcs)."""
        own = list(FACES).index(face)
        other = list(FACES).index(-face)
        owners = self.layout.rows % self.size
        same = box.same[:, own]
        ahead = up(self._heard(heard.above[:, own]) - box.below[:, own][:, owners])
        differ = Box.differ(self._heard(heard.same[:, own]), same[:, owners])
        ahead = np.where(differ, ahead, 0.0)
        behind = up(self._heard(heard.above[:, other]) + box.above[:, own][:, owners])
        return np.array([ahead, behind])

    def _heard(self, faces: NDArray[Any]) -> NDArray[Any]:
        """What faces (count, n) are at the speaker of every arc: 0 at fixed nodes."""
        if self.fixed:
            faces = np.hstack([faces, np.zeros((len(faces), self.fixed), dtype=faces.dtype)])
        return faces[:, self.layout.speakers]

    def needed(self, box: Box, load: Array, heard: Box | None = None) -> Array:
        """The slopes (count, 2, n) that the rows ask of boxes where they stand, ``load`` (count,)
        added, ``heard`` as in ``Motion``; about."""
        found = np.empty(box.below.shape)
        for place, face in enumerate(FACES):
            arcs = self._arcs([box], face, heard)
            rows = np.arange(len(arcs.pulls))
            sums = Piece(arcs, face, self.kinds, rows).at(1.0)
            # Any of the modes may be on.
            worst = sums.reshape(len(box.below), self.modes, self.size).max(axis=1)
            found[:, place] = worst + load[:, None] - self.holds * box.below[:, place]
        return found

    def pull(self, v: Array, sizes: Sequence[float], heard: Array) -> Array:
        """The slopes (count, n) that the rows ask of weights v (count, n) at rest, on both faces,
        at the largest of ``sizes`` times v, about; weights ``heard`` are those of neighbours."""
        s = np.repeat(np.array(sizes), len(v))[:, None, None]
        boxes = [
            Box.floats(s * np.tile(np.stack([x, x], axis=1), (len(sizes), 1, 1)))
            for x in (v, heard)
        ]
        asked = self.needed(boxes[0], np.zeros(len(s)), boxes[1]) / s
        worst = asked.max(axis=1).reshape(len(sizes), *v.shape)
        return np.asarray(worst.max(axis=0))

    def open_segments(
        self,
        boxes: Box,
        times: Sequence[Fraction],
        load: Array,
        *,
        low: float = 1.0,
        high: float = 1.0,
        only: Sequence[int] | None = None,
        heard: Box | None = None,
    ) -> list[int]:
        """The segments (default: all) from each box to the next that are not proved, as in
        ``Motion``."""
        slopes = _slopes(boxes, times)
        motion = Motion(boxes=boxes, slopes=slopes, load=load, low=low, high=high, heard=heard)
        return self.open_for(motion, only=only)

    def open_for(self, motion: Motion, *, only: Sequence[int] | None = None) -> list[int]:
        """The segments (default: all) of a motion that are not proved."""
        segments: Places = np.arange(len(motion.slopes))
        if only is not None:
            segments = np.array(only, dtype=np.int64)
        parts = _Parts(segments=segments, first=np.zeros(len(segments)))
        for _ in range(HALVINGS + 1):
            left = parts[self._open_parts(motion, parts)]
            if not len(left):
                return []
            # a row that fails all along, not in one place
            if len(left) > PARTS * len(segments) + FEW:
                return left.numbers
            parts = left.halves
        return parts.numbers

    def _open_parts(self, motion: Motion, parts: _Parts) -> Places:
        """The parts (places) that are not proved as they are."""
        # In pieces that fit into memory.
        chunk = max(1, TOGETHER // max(1, len(self.layout.rows)))
        failed = list[Places]()
        for k in range(0, len(parts), chunk):
            bad = self._fail(motion, parts[k : k + chunk])
            failed.append(k + np.flatnonzero(bad))
        return np.concatenate(failed)

    def _fail(self, motion: Motion, parts: _Parts) -> BoolArray:
        """Whether a row of each part is not proved."""
        spend(1 + len(parts) * len(self.layout.rows) // A_STEP)
        start = motion.boxes[parts.segments]
        end = motion.boxes[parts.segments + 1]
        cuts = (parts.first, parts.first + parts.width)
        ends = [start.between(end, cut) for cut in cuts]
        load = _largest_load(motion.load, parts.segments, cuts)
        heard = None if motion.heard is None else motion.heard[parts.segments]
        bad = np.zeros(len(parts), dtype=bool)
        for place, face in enumerate(FACES):
            slopes = motion.slopes[parts.segments, place]
            limits = _sum(_sum(self._held(ends, place), slopes), -load[:, None])
            limits = np.repeat(limits[:, None], self.modes, axis=1).ravel()
            arcs = self._arcs(ends, face, heard)
            # what is infinite proves nothing
            with np.errstate(invalid="ignore", over="ignore"):
                rows = open_within(arcs, limits, face, self.kinds, motion.high, motion.low)
            bad[np.unique(rows // (self.size * self.modes))] = True
        return bad

    def _held(self, ends: Sequence[Box], place: int) -> Array:
        """What the pins hold at least between two boxes, which may be less than 0; rounded down."""
        worth = list[Array]()
        for box in ends:
            worth += [self.holds * box.below[:, place], self.holds * box.above[:, place]]
        return np.where(self.holds == 0, 0.0, down(np.minimum.reduce(worth)))


def _slopes(boxes: Box, times: Sequence[Fraction]) -> Array:
    """The slopes (segments, 2, n) of the faces from each box to the next, rounded down."""
    lengths = [after - before for before, after in pairwise(times)]
    shortest = np.array([float_below(x) for x in lengths])[:, None, None]
    longest = np.array([float_above(x) for x in lengths])[:, None, None]
    rise = down(boxes.below[1:] - boxes.above[:-1])
    rise = np.where(Box.differ(boxes.same[1:], boxes.same[:-1]), rise, 0.0)
    # A lower bound of rise / length: the length is known between two floats.
    slopes = np.where(rise >= 0, rise / longest, rise / shortest)
    return np.where(rise == 0, 0.0, down(slopes))


def _largest_load(load: Array, segments: Places, cuts: Sequence[Array]) -> Array:
    """The largest load on each part of a segment, rounded up: linear, so at one of its ends."""
    before = load[segments]
    after = load[segments + 1]
    at_ends = [up(up(before * (1 - cut)) + up(after * cut)) for cut in cuts]
    is_loaded = np.maximum(before, after) > 0
    return np.where(is_loaded, np.maximum.reduce(at_ends), 0.0)


def heard_from(times: Sequence[Fraction], time: Fraction, timing: Timing | None) -> int:
    """The place of the last of the times that is not after any reading used from ``time`` on; the
    first one where there is none."""
    age = ZERO if timing is None else timing.delay
    return max(0, bisect_right(times, time - age) - 1)


def heard_boxes(boxes: Box, times: Sequence[Fraction], timing: Timing) -> Box:
    """The box that readings of neighbours lie in on each segment, and from the last time on while
    boxes rest."""
    found = [
        boxes.above[heard_from(times, time, timing) : k + 2].max(axis=0)
        for k, time in enumerate(times)
    ]
    return Box.floats(up(np.array(found) * float_above(1 + timing.event)))


def heard_last(path: Sequence[Array], times: Sequence[Fraction], timing: Timing | None) -> Any:
    """What readings may be at the end of a path, in floats; 0 where none are late."""
    if timing is None:
        return 0.0
    first = heard_from(times, times[-1], timing)
    return np.max(path[first:], axis=0) * float(1 + timing.event)


def moving_rows(loop: Loop, most: Fraction, modes: Sequence[str] | None) -> MovingRows | None:
    """Rows for boxes with no number beyond ``most``; None where a coupling is not defined or turns
    too often."""
    layout = arc_layout(loop, modes=modes)
    # A difference of two errors is at most twice the largest.
    radius = 2 * most * (1 + MARGIN)
    far = np.full(len(layout.rows), float_above(2 * most))
    none = far[:0]
    widest = ArcRows(
        start=layout.start,
        steps=far,
        reaches=far,
        weights=layout.weights,
        kinds=layout.kinds,
        own=(none, none),
        pulls=(),
    )
    # The table of a line is exact with any number of cells.
    cells = 2 if loop.is_linear else CELLS
    try:
        profiles = tuple(profile(Curve(each.components[0]), radius) for each in loop.functions)
        kinds = float_kinds(profiles, widest, rho=1 + MARGIN / 2, cells=cells)
    except UndefinedError:
        return None
    if kinds is None:
        return None
    return MovingRows(
        most=most,
        layout=layout,
        kinds=kinds,
        size=loop.n,
        fixed=len(loop.fixed),
        modes=(len(layout.start) - 1) // loop.n,
        holds=np.array([float_below(x) for x in holding_gains(loop)]),
    )


def rows_of_phases(loop: Loop, most: Fraction) -> dict[str, MovingRows | None]:
    """The rows of every mode that a phase of the guarantee has, each mode by itself."""
    modes = dict.fromkeys(phase.mode for phase in loop.guarantee.phases)
    return {mode: moving_rows(loop, most, [mode]) for mode in modes}


@positional
class RowsBySize:
    """Moving rows of a mode, or under "" of all modes, for boxes up to ``most``, in tables as wide
    as boxes need: small boxes would see few cells of a wide one."""

    loop: Loop
    most: Fraction
    known: dict[tuple[str, int], MovingRows | None] = field(default_factory=dict)

    def level(self, size: float) -> int:
        """The finest tables that reach as far as a box of this size."""
        return max((k for k in range(FINEST) if self._reach(k) >= size), default=0)

    def get(self, mode: str, level: int = 0) -> MovingRows | None:
        """As ``moving_rows``."""
        key = (mode, level)
        if key not in self.known:
            modes = [mode] if mode else None
            self.known[key] = moving_rows(self.loop, self._reach(level), modes)
        return self.known[key]

    def _reach(self, level: int) -> Fraction:
        return self.most / Fraction(4) ** level
