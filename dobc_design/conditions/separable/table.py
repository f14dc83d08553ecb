"""A table of outward float bounds of a secant gain g and of g', for rows with very many arcs.

Each cell holds bounds from exact enclosures (theory, section 1); off its middle the mean value theorem bounds g by two
multiplications.  No floating-point function is trusted: only + - * and comparisons, whose results are rounded outwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.coupling.enclosures import Curve, secant
from dobc_design.coupling.expression import Expression
from dobc_design.exact.interval import Interval
from dobc_design.exact.number import float_above, float_below

Array = NDArray[np.float64]

CELLS: Final = 512
_KEPT: Final = 16  # tables
# Cells overlap by this part of their width, far more than a float position can be wrong.
_OVERLAP: Final = Fraction(1, 2**20)
# A result of one operation is within 2^-53 of itself of the truth (2^-1074 near 0).
_RELATIVE: Final = 2.0**-51
_TINY: Final = 2.0**-1060


def up(x: Array) -> Array:
    """A number above what x would be without its last rounding."""
    return x + (np.abs(x) * _RELATIVE + _TINY)


def down(x: Array) -> Array:
    """A number below what x would be without its last rounding."""
    return x - (np.abs(x) * _RELATIVE + _TINY)


@dataclass(frozen=True, slots=True, eq=False)
class GainTable:
    """Bounds of g and g' on [-radius, radius] in cells of equal width.

    ``low`` and ``high`` bound g in the middle of each cell, slack for misplaced positions included; ``falls`` and
    ``rises`` bound g' on it (0 where g' is not bounded: low and high then hold on the whole cell).
    ``ranges``: least g, most g, least g', most g' over 1, 2, 4, ... cells from each on; shape (levels, cells) each.
    """

    radius: float
    width: float
    low: Array
    high: Array
    falls: Array
    rises: Array
    ranges: tuple[Array, Array, Array, Array]

    def cell(self, y: Array) -> Any:
        """The cell of each y, up to the overlap."""
        return np.clip(((y + self.radius) / self.width).astype(np.int64), 0, len(self.low) - 1)

    def at(self, y: Array) -> tuple[Array, Array]:
        """Lower and upper bounds of g at y, where y may be wrong in its last digits."""
        cell = self.cell(y)
        beyond = y - ((cell + 0.5) * self.width - self.radius)
        falls, rises = self.falls[cell] * beyond, self.rises[cell] * beyond
        lower = down(self.low[cell] + down(np.minimum(falls, rises)))
        return lower, up(self.high[cell] + up(np.maximum(falls, rises)))

    def over(self, y: Array, z: Array) -> tuple[Array, Array, Array, Array]:
        """Lower and upper bounds of g, then of g', between y and z."""
        first, last = self.cell(np.minimum(y, z)), self.cell(np.maximum(y, z))
        level = np.frexp((last - first + 1).astype(float))[1] - 1
        second = last - (1 << level) + 1
        least, most, falls, rises = self.ranges
        return (
            np.minimum(least[level, first], least[level, second]),
            np.maximum(most[level, first], most[level, second]),
            np.minimum(falls[level, first], falls[level, second]),
            np.maximum(rises[level, first], rises[level, second]),
        )


def gain_table(curve: Curve, radius: Fraction, *, cells: int = CELLS) -> GainTable:
    """Enclose g on [-radius, radius]; the table reaches a little further, so that its nodes are floats.

    A few tables are kept, since one claim asks for the same several times; their arrays cannot be written to.
    Raises: exact.interval.UndefinedError where g cannot be enclosed.
    """
    return _table(curve.expression, radius, cells)


@lru_cache(maxsize=_KEPT)
def _table(expression: Expression, radius: Fraction, cells: int) -> GainTable:
    curve = Curve(expression)
    unit = Fraction(2) ** (math.frexp(float_above(radius))[1] - 5 if radius > 0 else -20)
    reach = unit * (radius // unit + 1)
    width = 2 * reach / cells
    cell = [_cell(curve, -reach + k * width, width, limit=radius) for k in range(cells)]
    low, high, least, most, falls, rises = (np.array(column) for column in zip(*cell, strict=True))
    bounded = np.isfinite(falls) & np.isfinite(rises)
    ranges = (
        _running(least, np.minimum),
        _running(most, np.maximum),
        _running(falls, np.minimum),
        _running(rises, np.maximum),
    )
    falls, rises = np.where(bounded, falls, 0.0), np.where(bounded, rises, 0.0)
    for array in (low, high, falls, rises, *ranges):
        array.setflags(write=False)
    return GainTable(
        radius=float(reach), width=float(width), low=low, high=high, falls=falls, rises=rises, ranges=ranges
    )


def _cell(curve: Curve, start: Fraction, width: Fraction, *, limit: Fraction) -> tuple[float, ...]:
    """(low, high) of g in the middle, then bounds of g and of g' on the cell; infinite beyond the limit."""
    overlap = width * _OVERLAP
    nothing = (-math.inf, math.inf)
    if start > limit + 2 * overlap or start + width < -limit - 2 * overlap:
        return nothing * 3
    place = Interval(start - overlap, start + width + overlap)
    around = secant(curve, place)
    values = around.value.floats()
    if around.slope is None:
        return values + values + nothing
    node = secant(curve, Interval.point(start + width / 2)).value
    slack = 4 * overlap * around.slope.magnitude
    return float_below(node.lo - slack), float_above(node.hi + slack), *values, *around.slope.floats()


def _running(values: Array, choose: Any) -> Array:
    """Minima or maxima over 2^k cells from each place on; near the right end over those that are left."""
    levels = [values]
    span = 1
    while 2 * span <= len(values):
        shifted = np.concatenate([levels[-1][span:], np.repeat(levels[-1][-1:], span)])
        levels.append(choose(levels[-1], shifted))
        span *= 2
    return np.stack(levels)
