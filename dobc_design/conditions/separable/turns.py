"""Couplings that fall somewhere, in rows with very many arcs: float arithmetic with outward bounds.

Divided by s an arc adds phi(s) = sup { h(s t)/s : -reach <= t <= step }.  Where h rises on the whole interval that is
what it takes at the right end.  Else the left end counts where h may fall there, and so does every place where h may
have a maximum: the bounds of ``separable_rows``, for all arcs at once.  Theory, section 5.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from dobc_design.conditions.separable.table import Array, GainTable, down, up
from dobc_design.coupling.enclosures import Profile
from dobc_design.exact.interval import Interval
from dobc_design.exact.number import float_above, float_below

#: A coupling that turns more often is left to the exact rows.
MOST_TURNS: Final = 40


@dataclass(frozen=True, slots=True, eq=False)
class Turning:
    """One coupling that is not nondecreasing, for one face (the lower one has -h(-y) in place of h).

    ``table`` reaches to the left ends.  ``falls``: where h is not shown to rise.  ``tops``: where it may have a
    maximum, with an upper bound of what it takes there.
    """

    table: GainTable
    face: int
    falls: tuple[tuple[float, float], ...]
    tops: tuple[tuple[float, float, float], ...]

    def largest(
        self, steps: Array, reaches: Array, right: tuple[Array, Array], s: float, t: float
    ) -> tuple[Array, Any]:
        """An upper bound of phi on [s, t] for every arc, and whether phi is the right end on all of it.

        ``right``: lower and upper bounds of what the right end gives, step g(s step), on [s, t].
        """
        most, smooth = right[1].copy(), np.ones(len(steps), dtype=bool)
        asked = np.flatnonzero(self._may_fall(-up(t * reaches), _right_end(steps, s, t)))
        if len(asked):
            others = self._others(steps[asked], reaches[asked], s, t)
            smooth[asked] = others <= right[0][asked]
            most[asked] = np.maximum(np.minimum(most[asked], self._end(steps[asked], s, t)), others)
        return most, smooth

    def _end(self, x: Array, s: float, t: float) -> Array:
        """The largest x g(s x) on [s, t]: from the range of g, or from the middle and the range of g'."""
        least, most, falls, rises = self.table.over(self.face * s * x, self.face * t * x)
        middle = self.table.at(self.face * (s + t) / 2 * x)
        there = up(np.where(x >= 0, x * middle[1], x * middle[0]))
        half = (t - s) / 2 + t * 2.0**-50
        swing = up(up(np.maximum(-falls, rises) * half) * up(x * x))
        found = np.minimum(up(np.where(x >= 0, x * most, x * least)), up(there + np.maximum(swing, 0.0)))
        return np.where(x == 0, 0.0, found)

    def _may_fall(self, low: Array, high: Array) -> Any:
        """Whether h may fall somewhere on [low, high]."""
        found = np.zeros(len(low), dtype=bool)
        for start, end in self.falls:
            found |= (start <= high) & (low <= end)
        return found

    def _others(self, steps: Array, reaches: Array, s: float, t: float) -> Array:
        """What the left end and the maxima inside give at most; everything where s is 0 and h turns there."""
        there = self._may_fall(-up(t * reaches), -down(s * reaches))
        found = np.where(there, self._end(-reaches, s, t), -np.inf)
        for low, high, value in self.tops:
            begin, end = _within(low, high, steps, reaches, s, t)
            with np.errstate(divide="ignore"):
                here = up(value / begin) if value > 0 else up(value / end)
            found = np.where(begin <= end, np.maximum(found, here), found)
        return found if s else np.minimum(found, self._whole(steps, reaches, t))

    def _whole(self, steps: Array, reaches: Array, t: float) -> Array:
        """The largest x g(s x), -reach <= x <= step, s in [0, t], from the range of g."""
        end = np.maximum(_right_end(steps, 0.0, t), 0.0)
        least, most, _, _ = self.table.over(-self.face * up(t * reaches), self.face * end)
        left, right = np.maximum(-reaches * least, -reaches * most), np.maximum(steps * least, steps * most)
        return up(np.maximum(left, right))


def turning(kind: Profile, table: GainTable, face: int) -> Turning | None:
    """Bring a coupling into floats; None if it turns too often."""
    tops = kind.tops if face > 0 else kind.bottoms
    falls = tuple(_joined(_outward(cell.place, face) for cell in kind.cells if cell.direction <= 0))
    if len(tops) > MOST_TURNS or len(falls) > MOST_TURNS:
        return None
    values = [float_above(cell.values.hi if face > 0 else -cell.values.lo) for cell in tops]
    places = [_outward(cell.place, face) for cell in tops]
    return Turning(
        table=table,
        face=face,
        falls=falls,
        tops=tuple((low, high, value) for (low, high), value in zip(places, values, strict=True)),
    )


def _within(low: float, high: float, steps: Array, reaches: Array, s: float, t: float) -> tuple[Array, Array]:
    """The s of [s, t] for which [low, high] may meet [-s reach, s step]; from above to nothing where there are none."""
    begin, end = np.full(len(steps), s), np.full(len(steps), t)
    with np.errstate(divide="ignore", invalid="ignore"):
        if low > 0:
            begin = np.where(steps > 0, np.maximum(begin, down(low / steps)), np.inf)
        elif high < 0:
            begin = np.maximum(begin, down(-high / reaches))
            end = np.where(steps < 0, np.minimum(end, up(low / steps)), end)
    return begin, end


def _right_end(steps: Array, s: float, t: float) -> Array:
    return np.maximum(up(s * steps), up(t * steps))


def _outward(place: Interval, face: int) -> tuple[float, float]:
    mirrored = place if face > 0 else -place
    return float_below(mirrored.lo), float_above(mirrored.hi)


def _joined(places: Iterable[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Neighbours that touch as one."""
    current: tuple[float, float] | None = None
    for low, high in sorted(places):
        if current is not None and low <= current[1]:
            current = (current[0], max(current[1], high))
        else:
            if current is not None:
                yield current
            current = (low, high)
    if current is not None:
        yield current
