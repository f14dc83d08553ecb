"""Where a coupling h rises and where it falls on [-r, r]: what the rows of the max-separable certificate need.

The largest value of h on an interval is at an end point, or where h turns from rising to falling.  Those places
are enclosed in narrow cells, with the values that h takes there.  Theory, section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Final

from dobc_design.coupling.enclosures import Curve, jet, value_form
from dobc_design.exact.interval import Interval, UndefinedError

# The narrowest cell, as a part of the radius, and the most cells looked at.
_NARROWEST: Final = Fraction(1, 2**24)
_MOST_CELLS: Final = 20_000


@dataclass(frozen=True, slots=True)
class Cell:
    """h on an interval of y: ``direction`` +1 nondecreasing, -1 nonincreasing, 0 not known; ``values`` there."""

    place: Interval
    direction: int
    values: Interval


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A coupling with its cells on [-radius, radius], from left to right.

    ``tops`` and ``bottoms``: where h may have a local maximum or minimum inside (h turns, or is not known).
    """

    curve: Curve
    radius: Fraction
    cells: tuple[Cell, ...]
    tops: tuple[Cell, ...]
    bottoms: tuple[Cell, ...]

    @property
    def is_nondecreasing(self) -> bool:
        """Whether h is proved nondecreasing on the whole of [-radius, radius]."""
        return all(cell.direction > 0 for cell in self.cells)


def profile(curve: Curve, radius: Fraction) -> Profile:
    """Split [-radius, radius] into cells where the sign of h' is proved, as far as that is possible.

    Raises: UndefinedError naming h and the interval where h is not defined or has no bounded slope.
    """
    whole = Interval(-radius, radius)
    try:
        cells = _merged(curve, _split(curve, whole))
    except UndefinedError as error:
        raise UndefinedError(
            f'h = "{curve.expression}" cannot be enclosed on [-{float(radius):.6g}, {float(radius):.6g}]: {error}'
        ) from error
    return Profile(curve, radius, cells, _turns(curve, cells, +1), _turns(curve, cells, -1))


def _split(curve: Curve, whole: Interval) -> list[tuple[Interval, int]]:
    """Cells from left to right with the sign of h'."""
    found: list[tuple[Interval, int]] = []
    waiting = [whole] if whole.is_point else [*reversed(whole.halves())]
    narrow = whole.width * _NARROWEST
    count = 0
    while waiting:
        place = waiting.pop()
        count += 1
        try:
            slope = jet(curve, place, restricted=True).slope
        except UndefinedError:
            if place.width <= narrow or count > _MOST_CELLS:
                raise
            waiting += [*reversed(place.halves())]
            continue
        direction = 1 if slope.lo >= 0 else -1 if slope.hi <= 0 else 0
        if direction or place.width <= narrow or count > _MOST_CELLS:
            found.append((place, direction))
        else:
            waiting += [*reversed(place.halves())]
    return found


def _merged(curve: Curve, pieces: list[tuple[Interval, int]]) -> tuple[Cell, ...]:
    """Neighbours of one direction as one cell; cells of unknown direction stay narrow."""
    joined: list[tuple[Interval, int]] = []
    for place, direction in pieces:
        if joined and direction and joined[-1][1] == direction:
            joined[-1] = (joined[-1][0].hull(place), direction)
        else:
            joined.append((place, direction))
    return tuple(Cell(place, direction, value_form(curve, place)) for place, direction in joined)


def _turns(curve: Curve, cells: tuple[Cell, ...], rising: int) -> tuple[Cell, ...]:
    """Cells of unknown direction, and the points between a rising and a falling cell (for -1: falling and rising)."""
    found = [cell for cell in cells if not cell.direction]
    for left, right in pairwise(cells):
        if left.direction == rising and right.direction == -rising:
            point = Interval.point(left.place.hi)
            found.append(Cell(point, 0, value_form(curve, point)))
    return tuple(found)
