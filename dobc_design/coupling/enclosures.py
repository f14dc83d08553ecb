"""Enclosures of a scalar coupling h on an interval: of h, of h' and of the secant gain g(y) =
h(y)/y.

Theory, sections 1 and 5: h(y) = g(y) y exactly, g(0) = h'(0).  Bounds are rounded outwards, and
tight by end points where h or g is monotone, else by subdivision.  At kinks slopes are Clarke's,
which bound g, too (mean value theorem).
"""

import heapq
from collections.abc import Callable
from dataclasses import field
from fractions import Fraction
from functools import lru_cache
from itertools import groupby, pairwise
from typing import NamedTuple

from dobc_design._checks import positional
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.number import height
from dobc_design.exact.work import spend

from .expression import Expression
from .tree import (
    ONE,
    ZERO,
    GradientAlgebra,
    IntervalAlgebra,
    Jet,
    Node,
    postorder,
    program,
    run,
)

#: How much wider than the truth a range may be at each end (relative to the value where that is
#: above 1).
TOLERANCE = Fraction(1, 10**6)
# Pieces looked at before a range is returned as tight as it is; halvings before "undefined" is
# believed.
_MOST_PIECES = 4000
_MOST_HALVINGS = 40
_NARROWEST = Fraction(1, 2**30)
# Enclosures that are remembered, since searches come back to the same intervals.
_REMEMBERED = 1 << 12

_LARGEST = Fraction(2**990)
_LONG = 9  # bits of the length of an end point from which on a step costs as many times more
_CALL = 8  # steps that a function takes, in units of a sum

# The narrowest cell, as a part of the radius, and the most cells looked at.
_NARROWEST_CELL = Fraction(1, 2**24)
_MOST_CELLS = 20_000
# as a part of its size, how close to one sign a slope is looked at exactly
_NEARLY = Fraction(1, 10**6)

_VALUES = IntervalAlgebra()
_JETS = GradientAlgebra(1, second=True)
_RESTRICTED = GradientAlgebra(1, second=True, restricted=True)
_UNIT = (ONE,)

Form = Callable[[Interval], Interval]
OfCurve = Callable[["Curve", Interval], Interval]
Place = tuple[Interval, int]  # an interval of y, and the sign of h' there
Pieces = list[tuple[Interval, Interval]]  # values of a form, and where it has them


class _Programs:
    """One coupling function as enclosures run it: its values, its jets, and these without what is
    outside."""

    def __init__(self, expression: Expression) -> None:
        self.values = program(expression.node, _VALUES)
        self.jets = program(expression.node, _JETS)
        self.restricted = program(expression.node, _RESTRICTED)
        #: Steps that one evaluation takes, about.
        self.cost = sum(map(_cost, postorder(expression.node)))


def _cost(part: Node) -> int:
    """About how many sums an operation costs."""
    if part.kind == "call":
        return _CALL
    if part.kind == "power":
        return abs(int(part.own)).bit_length()
    return 1


@lru_cache(maxsize=4096)
def _programs(expression: Expression) -> _Programs:
    return _Programs(expression)


@positional
class Curve:
    """One scalar coupling function h with h(0) = 0, in y alone, ready to be enclosed many times."""

    expression: Expression = field(compare=False)
    # One object for all curves of one function: comparing expressions walks through their trees.
    programs: _Programs = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.expression.dimension != 1:
            raise ValueError(
                f"a Curve is a function of y; got one of {self.expression.dimension} variables."
            )
        object.__setattr__(self, "programs", _programs(self.expression))


class Secant(NamedTuple):
    """Enclosures of the secant gain g and of its derivative on an interval; None where that may be
    unbounded."""

    value: Interval
    slope: Interval | None


@lru_cache(maxsize=_REMEMBERED)
def value(curve: Curve, Y: Interval) -> Interval:
    """Enclose h on Y by one evaluation.  Raises: UndefinedError naming the function and the
    interval."""
    return run(curve.programs.values, (Y,))


@lru_cache(maxsize=_REMEMBERED)
def jet(curve: Curve, Y: Interval, *, restricted: bool = False) -> Jet:
    """Enclose h, h' and h'' on Y by one evaluation; ``restricted`` as in GradientAlgebra."""
    steps = curve.programs.restricted if restricted and not Y.is_point else curve.programs.jets
    return run(steps, (Jet(Y, _UNIT, ZERO),))


@lru_cache(maxsize=_REMEMBERED)
def secant(curve: Curve, Y: Interval) -> Secant:
    """Enclose g and g' on Y by a few evaluations; end points where g is shown to be monotone.  g' =
    (h' - g)/y away from 0, and g'(y) = int_0^1 s h''(s y) ds lies in half the hull of h'' between 0
    and y. Raises: UndefinedError where h has no value on Y, or no bounded slope on a Y that
    contains 0."""
    if Y.is_narrow:  # a quotient of differences over it would be nothing but rounding
        return Secant(_secant_at(curve, Y), None)
    known, slope = _from_zero(curve, Y) if Y.contains(0) else _from_both(curve, Y)
    if slope is None:
        return Secant(known, None)
    if slope.sign:
        return Secant(known.meet(_at_ends(_secant_at, curve, Y)), slope)
    # Mean value theorem: g on Y differs from g in the middle by at most g' times the distance.
    middle = Y.middle()
    return Secant(known.meet(_secant_at(curve, middle) + slope * (Y - middle)), slope)


def _from_zero(curve: Curve, Y: Interval) -> tuple[Interval, Interval | None]:
    """g and g' on Y with 0 in Y, from h' and h'': the mean value theorem, and its next term."""
    found = jet(curve, Y, restricted=True)
    return found.slope, None if found.curvature is None else found.curvature * Fraction(1, 2)


def _from_both(curve: Curve, Y: Interval) -> tuple[Interval, Interval | None]:
    """g and g' on Y without 0, from h on Y itself and from h' and h'' between 0 and Y where these
    are bounded."""
    known = value(curve, Y) / Y
    slope = None
    try:
        mean, slope = _from_zero(curve, Y.hull(ZERO))
        known = mean.meet(known)
    except UndefinedError:  # the bounds from Y itself remain
        pass
    try:
        own = jet(curve, Y, restricted=True).slope
    except UndefinedError:
        return known, slope
    rough = (own - known) / Y
    rough = rough if slope is None else slope.meet(rough)
    if rough.sign:  # the ends are tighter bounds of g, and with them of g'
        known = known.meet(_at_ends(_secant_at, curve, Y))
        rough = rough.meet((own - known) / Y)
    return known, rough


def slope_bound(curve: Curve, Y: Interval, *, tolerance: Fraction = TOLERANCE) -> Fraction:
    """A number that no h'(y), y in Y, exceeds.  Raises: UndefinedError where h' is not bounded on
    Y."""
    return tight_range(curve, slope_form, Y, tolerance=tolerance, what="h'", lower=False).hi


def secant_range(curve: Curve, Y: Interval, *, tolerance: Fraction = TOLERANCE) -> Interval:
    """Enclose {g(y) : y in Y}, g(y) = h(y)/y and g(0) = h'(0), at most about ``tolerance`` too wide
    at each end.
    Raises: UndefinedError naming h and the interval where h is not defined between 0 and Y."""
    return tight_range(curve, _gains, Y, tolerance=tolerance, what="h(y)/y")


def _gains(curve: Curve, Y: Interval) -> Interval:
    return secant(curve, Y).value


def value_form(curve: Curve, Y: Interval) -> Interval:
    """Enclose h on Y by one or two evaluations: end points where h is monotone, else the mean value
    form."""
    natural = value(curve, Y)
    if Y.is_point:
        return natural
    try:
        slope = jet(curve, Y, restricted=True).slope
    except UndefinedError:  # h may be defined where h' is not bounded, as sqrt is at 0
        return natural
    if slope.sign:  # monotone
        return natural.meet(_at_ends(value, curve, Y))
    middle = Y.middle()
    return natural.meet(value(curve, middle) + slope * (Y - middle))


@lru_cache(maxsize=_REMEMBERED)
def slope_form(curve: Curve, Y: Interval) -> Interval:
    """Enclose h' on Y, kinks at the ends included; end points where h' is monotone, else the mean
    value form."""
    found = jet(curve, Y)
    if Y.is_point or found.curvature is None:
        return found.slope
    if found.curvature.sign:
        return found.slope.meet(_at_ends(slope_form, curve, Y))
    middle = Y.middle()
    return found.slope.meet(slope_form(curve, middle) + found.curvature * (Y - middle))


def _secant_at(curve: Curve, y: Interval) -> Interval:
    """g at a point, or on what rounding makes of one."""
    return jet(curve, y).slope if y.is_zero else value(curve, y) / y


def _at_ends(form: OfCurve, curve: Curve, Y: Interval) -> Interval:
    """The hull of what a form encloses at both ends."""
    low, high = Y.ends()
    return form(curve, low).hull(form(curve, high))


def tight_range(
    curve: Curve,
    enclosed: OfCurve,
    Y: Interval,
    *,
    tolerance: Fraction = TOLERANCE,
    what: str = "h",
    lower: bool = True,
) -> Interval:
    """The range of what a form encloses, at most about ``tolerance`` too wide at each end; or its
    upper end only."""

    def form(piece: Interval) -> Interval:
        spend(curve.programs.cost)
        found = enclosed(curve, piece)
        spend(curve.programs.cost * _length(found))
        return found

    try:
        pieces = _defined(form, Y)
        highest = _supremum(form, pieces, tolerance)
        if not lower:
            return Interval.point(highest)
        mirrored = [(-values, piece) for values, piece in pieces]
        lowest = -_supremum(lambda piece: -form(piece), mirrored, tolerance)
    except UndefinedError as error:
        place = f"[{_shown(Y.lo)}, {_shown(Y.hi)}]"
        raise UndefinedError(
            f'{what} of h = "{curve.expression}" cannot be enclosed on {place}: {error}'
        ) from error
    return Interval(lowest, highest)


def _length(found: Interval) -> int:
    """How many times more a step costs than one with short ends."""
    return 0 if isinstance(found.top, float) else height(found.top) >> _LONG


def _defined(form: Form, Y: Interval) -> Pieces:
    """Split Y into pieces on which the form has values.  Raises UndefinedError if one of 2^-40 of Y
    has none."""
    found = []
    open_pieces = [(Y, 0)]
    while open_pieces:
        piece, depth = open_pieces.pop()
        try:
            found.append((form(piece), piece))
        except UndefinedError as error:
            # A form may be undefined by its width alone, as 1/(y - y + 1) is.
            if piece.is_point or depth >= _MOST_HALVINGS or len(found) >= _MOST_PIECES:
                raise UndefinedError(f"near y = {float(piece.midpoint):.6g}, {error}") from error
            open_pieces += [(half, depth + 1) for half in piece.halves()]
    return found


def _supremum(form: Form, pieces: Pieces, tolerance: Fraction) -> Fraction:
    """An upper bound of the form's values on the pieces: branch and bound, the highest piece
    first."""
    attained = max(form(end).bottom for _, piece in pieces for end in piece.ends())
    narrow = max(piece.width for _, piece in pieces) * _NARROWEST
    # The heap keeps the least first, so upper bounds stand in it with the other sign.
    heap = [(-values.top, number, piece) for number, (values, piece) in enumerate(pieces)]
    heapq.heapify(heap)
    count = len(pieces)
    while True:
        highest, _, piece = heap[0]
        slack = float(tolerance) * max(1.0, abs(float(highest)))
        # At a kink slopes of both sides are enclosed, and no smaller piece around it will be
        # tighter.
        if -highest - attained <= slack or count >= _MOST_PIECES or piece.width <= narrow:
            return -Fraction(highest)
        heapq.heappop(heap)
        attained = max(attained, form(piece.middle()).bottom)
        for half in piece.halves():
            count += 1
            bound = min(form(half).top, -highest)  # a part is nowhere above the whole
            heapq.heappush(heap, (-bound, count, half))


def _shown(number: Fraction) -> str:
    return str(number) if number.denominator == 1 else f"{float(number):.6g}"


class Cell(NamedTuple):
    """h on an interval of y: ``direction`` +1 nondecreasing, -1 nonincreasing, 0 not known;
    ``values`` there."""

    place: Interval
    direction: int
    values: Interval


Cells = tuple[Cell, ...]


@positional(eq=False)
class Profile:
    """A coupling with its cells from left to right; ``tops``, ``bottoms``: where h may have an
    inner extremum."""

    curve: Curve
    radius: Fraction
    cells: Cells
    tops: Cells
    bottoms: Cells

    @property
    def is_nondecreasing(self) -> bool:
        """Whether h is proved nondecreasing on the whole of [-radius, radius]."""
        return all(cell.direction > 0 for cell in self.cells)


@lru_cache(maxsize=_REMEMBERED)
def profile(curve: Curve, radius: Fraction) -> Profile:
    """Split [-radius, radius] into cells where the sign of h' is proved where possible.  Raises:
    UndefinedError."""
    whole = Interval(-radius, radius)
    try:
        cells = _merged(curve, _split(curve, whole))
        if any(cell.values.magnitude > _LARGEST for cell in cells):
            raise UndefinedError(
                "its values are beyond what a second program can follow in floating point."
            )
    except UndefinedError as error:
        place = f"[-{float(radius):.6g}, {float(radius):.6g}]"
        raise UndefinedError(
            f'h = "{curve.expression}" cannot be enclosed on {place}: {error}'
        ) from error
    tops = _turns(curve, cells, +1)
    bottoms = _turns(curve, cells, -1)
    return Profile(curve, radius, cells, tops, bottoms)


def _split(curve: Curve, whole: Interval) -> list[Place]:
    """Cells from left to right with the sign of h'."""
    found = []
    waiting = [whole] if whole.is_point else [*reversed(whole.halves())]
    narrow = whole.width * _NARROWEST_CELL
    count = 0
    while waiting:
        place = waiting.pop()
        count += 1
        spend(curve.programs.cost)
        last = place.width <= narrow or count > _MOST_CELLS  # cells may stay without a direction
        try:
            direction = _direction(curve, place)
        except UndefinedError:
            if last:
                raise
            direction = 0
        if direction or last:
            found.append((place, direction))
        else:
            waiting += [*reversed(place.halves())]
    return found


def _direction(curve: Curve, place: Interval) -> int:
    """The sign of h' on a place, 0 where it is not known; exactly where floats nearly tell."""
    try:
        slope = _tight_slope(curve, Floats.around(place))
        if slope.sign or min(-slope.bottom, slope.top) > _NEARLY * slope.magnitude:
            return slope.sign
    except UndefinedError:
        pass
    return _tight_slope(curve, place).sign


def _tight_slope(curve: Curve, place: Interval) -> Interval:
    """Enclose h' on a place, kinks at its ends left out; where h' only touches 0, the mean value
    form tells."""
    slope = jet(curve, place, restricted=True).slope
    spend(curve.programs.cost * _length(slope))  # of powers of powers
    return slope if slope.sign or place.is_point else slope.meet(slope_form(curve, place))


def _merged(curve: Curve, pieces: list[Place]) -> Cells:
    """Neighbours of one direction as one cell; cells of unknown direction stay narrow."""
    cells = []
    for direction, group in groupby(pieces, key=lambda piece: piece[1]):
        places = [place for place, _ in group]
        if direction:
            places = [places[0].hull(places[-1])]
        cells += [Cell(place, direction, value_form(curve, place)) for place in places]
    return tuple(cells)


def _turns(curve: Curve, cells: Cells, rising: int) -> Cells:
    """Cells of unknown direction, and the points between a rising and a falling cell (for -1:
    falling and rising)."""
    found = [cell for cell in cells if not cell.direction]
    for left, right in pairwise(cells):
        if left.direction == rising and right.direction == -rising:
            point = Interval.point(left.place.hi)
            found.append(Cell(point, 0, value_form(curve, point)))
    return tuple(found)
