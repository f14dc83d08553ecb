"""Curves that fall as fast as rows allow, as chords: on each the slope is the one asked for at its slower end.

Proposals in floating point for boxes and for weights that move; no proofs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.solvers.program import Array

ACCURACY: Final = 1e-7  # of a point, as a part of what it falls by
CLOSE: Final = 0.999  # of a goal, which a chord does not miss by more
MOST_HALVINGS: Final = 40
MOST_NEWTON: Final = 12

#: The slopes that are asked for at points (count, size), at one time (s).
Asked = Callable[[Array, Fraction], Array]


@dataclass(slots=True, kw_only=True, eq=False)
class Chords:
    """``bend``: by how much the slopes at both ends of a chord may differ, times its length, as a part of the entry, or
    the ``floor`` if it is less; without one of the largest entry.  ``pace`` (1/s): the rate that measures accuracy."""

    bend: float
    pace: float
    step: float
    floor: float | None = None
    change: Array | None = None  # of the slopes with the point

    def next(
        self, point: Array, now: Fraction, until: Fraction | None, asked: Asked, *, lands: float | None = None
    ) -> tuple[Fraction, Array] | None:
        """The end of the next chord, not later than ``until``, and where its largest entry falls below ``lands`` not
        far below it; None if there is none."""
        before = asked(point[None], now)[0]
        for _ in range(MOST_HALVINGS):
            after = now + Fraction(f"{self.step:.4g}")
            after = after if until is None or after < until else until
            length, found = float(after - now), self._end(point, before, now, after, asked)
            bent = math.inf
            if found is not None:
                scale = found[0].max() if self.floor is None else np.maximum(found[0], self.floor)
                bent = float(np.max(np.abs(found[1] - before) / scale)) * length
            if found is None or not bent <= 2 * self.bend:
                self.step = length / 2
                continue
            top, left = float(point.max()), float(found[0].max())
            if lands is None or left >= lands * CLOSE or top <= lands:
                self.step = length * min(2.0, math.sqrt(self.bend / max(bent, self.bend / 4)))
                return after, found[0]
            self.step = length * (top - lands) / (top - left)
        return None

    def _end(
        self, point: Array, before: Array, now: Fraction, after: Fraction, asked: Asked
    ) -> tuple[Array, Array] | None:
        """The end of a chord and the slopes asked for there, by Newton's method; None if it does not settle."""
        length, found, last = float(after - now), point.copy(), math.inf
        for _ in range(MOST_NEWTON):
            there = asked(found[None], after)[0]
            missed = point + length * np.maximum(before, there) - found
            left = float(np.max(np.abs(missed) / found))
            if left <= ACCURACY * length * self.pace:
                return found, there
            if self.change is None or not left <= last / 4:
                widths = 1e-6 * found
                self.change = (asked(found + np.diag(widths), after) - there).T / widths
            last = left
            J = np.where((there >= before)[:, None], self.change, 0.0)
            found = np.maximum(found + np.linalg.solve(np.eye(len(point)) - length * J, missed), found / 4)
        return None
