"""Ways that fall as fast as rows ask, in chords: for proposals of boxes and of weights that move.

On each chord the slopes are those that the rows ask for at its slower end.  Floating point; nothing
here is a proof.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from dobc_design.exact.matrix import Array
from dobc_design.exact.work import spend

ACCURACY = 1e-7  # of a point, as a part of what it falls by
CLOSE = 0.999  # of a goal, which a chord does not miss by more
MOST_HALVINGS = 40
MOST_NEWTON = 12
NUDGE = 1e-6  # of an entry, for the change of the slopes with it
CHORD = 40  # steps of work for an attempt at a chord


#: The slopes that are asked for at points (count, size), at one time (s).
Asked = Callable[[Array, Fraction], Array]


class _End(NamedTuple):
    """Where a chord ends, and the slopes that are asked for there."""

    point: Array
    slopes: Array


@dataclass(slots=True, kw_only=True, eq=False)
class Chords:
    """``bend``: by how much the slopes at both ends of a chord may differ, times its length, as a
    part of the entry, or the ``floor`` if it is less; without one of the largest entry.  ``pace``
    (1/s): the rate that measures accuracy.  ``step`` (s): how long the next chord is at first."""

    bend: float
    pace: float
    step: float
    floor: float | None = None
    longest: float = math.inf  # s, of a chord: windows of late readings begin where one does
    change: Array | None = None  # of the slopes with the point, as it was last computed

    def next(
        self,
        point: Array,
        now: Fraction,
        until: Fraction | None,
        asked: Asked,
        *,
        lands: float | None = None,
    ) -> tuple[Fraction, Array] | None:
        """The end of the next chord, at most ``until``, and where its largest entry falls just
        below ``lands``."""
        before = asked(point[None], now)[0]
        top = float(point.max())
        for _ in range(MOST_HALVINGS):
            spend(CHORD)
            after = self._ends(now, until)
            length = float(after - now)
            found = self._end(point, before, now, after, asked)
            bent = math.inf if found is None else self._bent(before, found) * length
            if found is None or not bent <= 2 * self.bend:
                self.step = length / 2
                continue
            left = float(found.point.max())
            if lands is None or left >= lands * CLOSE or top <= lands:
                # The bend grows with the square of the length.
                longer = math.sqrt(self.bend / max(bent, self.bend / 4))
                self.step = length * min(2.0, longer)
                return after, found.point
            self.step = length * (top - lands) / (top - left)
        return None

    def _ends(self, now: Fraction, until: Fraction | None) -> Fraction:
        """When the next chord is to end, if it is as long as a step."""
        after = now + Fraction(f"{min(self.step, self.longest):.4g}")
        if until is None or after + (after - now) <= until:
            return after
        # no sliver is left over
        return until if after >= until else now + (until - now) / 2

    def _bent(self, before: Array, found: _End) -> float:
        """How much the slopes change along a chord, as a part of the entry."""
        scale = found.point.max()
        if self.floor is not None:
            scale = np.maximum(found.point, self.floor)
        return float(np.max(np.abs(found.slopes - before) / scale))

    def _end(
        self, point: Array, before: Array, now: Fraction, after: Fraction, asked: Asked
    ) -> _End | None:
        """The end of a chord and the slopes asked for there, by Newton's method; None if it does
        not settle."""
        length = float(after - now)
        found = point.copy()
        last = math.inf
        for _ in range(MOST_NEWTON):
            there = asked(found[None], after)[0]
            missed = point + length * np.maximum(before, there) - found
            left = float(np.max(np.abs(missed) / found))
            if left <= ACCURACY * length * self.pace:
                return _End(found, there)
            # The change of the slopes is kept as long as it serves: it takes a row for each entry.
            if self.change is None or not left <= last / 4:
                widths = NUDGE * found
                nudged = asked(found + np.diag(widths), after)
                self.change = (nudged - there).T / widths
            last = left
            J = np.where((there >= before)[:, None], self.change, 0.0)
            step = np.linalg.solve(np.eye(len(point)) - length * J, missed)
            found = np.maximum(found + step, found / 4)
        return None
