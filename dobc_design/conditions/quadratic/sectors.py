"""Couplings on a region as bounded gains: h(e) = sum of g b c'e over channels, low <= g <= high
while |c'e| <= radius.

Theory, sections 1 and 4.  A coupling by component has the secant gain g(y) = h(y)/y, one channel
per component.  A coupling of vectors has Jbar(y) = int_0^1 J(s y) ds with h(y) = Jbar(y) y, one
channel per entry of Jbar, which lies in the hull of J over the box.  Both hold with Clarke's slopes
where h has a kink.  An arc that comes and goes has every gain from 0 to those.
"""

import heapq
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

from dobc_design._checks import noun
from dobc_design.conditions.check import read_parts
from dobc_design.conditions.numbers import as_json, read_rational, whole_from_json
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.enclosures import TOLERANCE, Curve, secant_range, slope_bound
from dobc_design.coupling.expression import (
    Expression,
    parse_expression,
    polynomial_degree,
    variables_used,
)
from dobc_design.coupling.tree import GradientAlgebra, Node, evaluate
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.interval import Box, Interval, IntervalMatrix, UndefinedError
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop

DIGITS = 6
# gains are claimed this much wider, so that a second program can confirm them
ROOM = Fraction(1, 10**5)
# A gain of a coupling of vectors may be this much too wide at each end; so many parts of the box
# are looked at.
_TOLERANCE = Fraction(1, 1000)
_MOST_PIECES = 100
_ANY = Fraction(10**9)  # where a bound may be as wide as it is
_ZERO = Interval.point(0)


@noun
class GainRange:
    """A claim about one coupling (its place in loop.functions): its gains on |y_c| <= radius lie
    in ``entries``. ``radius`` None: for every y.  The weight of an arc is not included."""

    coupling: int
    radius: Fraction | None
    entries: IntervalMatrix

    def to_json(self) -> dict[str, Any]:
        """The gains as text, by the place of the coupling."""
        return {"coupling": self.coupling, "gains": as_json(self.entries)}


@noun
class Channel:
    """g (e[plus] - e[minus]) acts on row ``target`` of e', low <= g <= high, weight included;
    indices of stacked e, and after the last the target, whose error is 0."""

    target: int
    plus: int
    minus: int
    low: Fraction
    high: Fraction

    @property
    def centre(self) -> Fraction:
        return (self.low + self.high) / 2

    @property
    def spread(self) -> Fraction:
        """Half the width of the range; 0 for a linear channel, which needs no multiplier."""
        return (self.high - self.low) / 2


@noun
class Sectors:
    """The channels of every mode, for ``size`` = n m rows; the pins of ``problem`` complete the
    loop."""

    loop: Loop
    modes: Mapping[str, tuple[Channel, ...]]

    @property
    def size(self) -> int:
        return self.loop.size


def gains_on(
    coupling: Coupling, radius: Fraction | Sequence[Fraction], *, tolerance: Fraction = TOLERANCE
) -> IntervalMatrix:
    """Enclose the gains of a coupling on |y_c| <= radius, one for all components or one for each,
    (m, m); those of one variable about ``tolerance`` too wide at most.  Raises: UndefinedError
    naming h and the interval."""
    m = coupling.dimension
    radii = radius if isinstance(radius, Sequence) else [radius] * m
    box = tuple(Interval(-r, r) for r in radii)
    if coupling.by_component:
        curve = Curve(coupling.components[0])
        # Equal sides share their enclosure, which takes long.
        known: dict[Interval, Interval] = {}
        for side in box:
            if side not in known:
                known[side] = _secants(curve, side, tolerance)
        own = [known[side] for side in box]
        return tuple(tuple(own[c] if c == d else _ZERO for d in range(m)) for c in range(m))
    rows: list[Box] = []
    hull: IntervalMatrix | None = None
    for c, component in enumerate(coupling.components):
        if is_sum_of_curves(component.node):
            # One secant along each axis, where the others are 0, is sharper than slopes over the
            # whole box.
            row = [_ZERO] * m
            for d in variables_used(component.node):
                row[d] = _secants(_along(component, d), box[d], tolerance)
            rows.append(tuple(row))
        else:  # one hull for all such components
            hull = hull or _jacobian_hull(coupling, box)
            rows.append(hull[c])
    return tuple(rows)


def _secants(curve: Curve, side: Interval, tolerance: Fraction) -> Interval:
    gain = secant_range(curve, side, tolerance=tolerance)
    # sqrt has a secant gain as far as it is defined, but others may need its slope: some bound of
    # it
    slope_bound(curve, side, tolerance=_ANY)
    return gain


@lru_cache(maxsize=256)
def _along(component: Expression, d: int) -> Curve:
    """The component as a function of y_d alone, the other variables 0."""

    def replaced(name: re.Match[str]) -> str:
        return "y" if int(name[1]) == d + 1 else "0"

    return Curve(parse_expression(re.sub(r"\by([0-9]+)\b", replaced, str(component))))


def is_sum_of_curves(node: Node) -> bool:
    """Whether an expression is, as it is written, a sum of functions of one variable each."""
    if len(variables_used(node)) < 2:
        return True
    if node.kind == "multiply":
        linear = any(not variables_used(each) for each in node.operands)
    else:
        linear = node.kind in ("add", "subtract", "negate")
    return linear and all(map(is_sum_of_curves, node.operands))


def gains_at(
    loop: Loop,
    place: int,
    radius: Fraction | Sequence[Fraction],
    *,
    tolerance: Fraction = TOLERANCE,
) -> IntervalMatrix:
    """The same by the place of the coupling; that of the nodes for every state of a leader.
    Raises: UndefinedError."""
    if place == loop.drift_place and loop.goals.moves:
        radii = radius if isinstance(radius, Sequence) else [radius] * loop.m
        return slopes_of_node(loop, tuple(Interval(-r, r) for r in radii))
    return gains_on(loop.functions[place], radius, tolerance=tolerance)


def slopes_of_node(loop: Loop, errors: Box) -> IntervalMatrix:
    """Enclose the slopes of f at s + e for all e in a box of errors, (m, m), and all s in the box
    that a leader never leaves: f(s + e) - f(s) = F e with F in their hull, where the errors hold
    0.  Raises: UndefinedError."""
    if loop.drift_place is None:
        A = loop.slopes
        return tuple(tuple(map(Interval.point, row)) for row in A)
    # Where the leader and the node are, and everything between them.
    box = tuple(s + e for s, e in zip(loop.goals.leaders_box(), errors, strict=True))
    return _jacobian_hull(loop.functions[loop.drift_place], box)


def enclose_ranges(loop: Loop, *, radius: Fraction | None) -> tuple[GainRange, ...]:
    """Enclose every coupling that arcs use, widened by ROOM and to DIGITS digits where it is not
    linear.  Raises: SpecError for a radius that is not > 0, or None for a coupling that is not
    linear; UndefinedError."""
    if radius is not None and radius <= 0:
        raise SpecError(
            f"radius must be > 0; got {radius}.", key="radius", cure="Give a length, or None."
        )
    found = []
    for place in used_couplings(loop):
        coupling = loop.functions[place]
        if radius is None and not coupling.is_linear:
            what = f'must be a number, because h = "{coupling.texts[0]}" is not linear; got None.'
            raise wrong("radius", what, "Give the largest |e_j - e_i| to be considered.")
        # Linear gains are the same on every radius.
        entries = widened_gains(loop, place, radius or Fraction(1))
        found.append(GainRange(coupling=place, radius=radius, entries=entries))
    return tuple(found)


def widened_gains(loop: Loop, place: int, radius: Fraction | Sequence[Fraction]) -> IntervalMatrix:
    """The gains as they are claimed: widened by ROOM and to DIGITS digits where the coupling is not
    linear."""
    room = 0 if loop.functions[place].is_linear else ROOM
    found = gains_at(loop, place, radius)
    return tuple(tuple(_widened(gain, room * gain.magnitude) for gain in row) for row in found)


def left_open(
    loop: Loop, place: int, claimed: IntervalMatrix, radius: Fraction | Sequence[Fraction]
) -> str | None:
    """Why the gains on |y_c| <= radius are not shown to lie in those that are claimed; None if they
    are."""
    try:
        found = gains_at(loop, place, radius)
    except UndefinedError as error:
        return f"the gains cannot be enclosed: {error}"
    for row, own in zip(claimed, found, strict=True):
        for mine, gain in zip(row, own, strict=True):
            if not mine.contains(gain):
                return (
                    f'the gains of h = "{loop.functions[place].texts[0]}" are not shown to lie in '
                    "the range claimed."
                )
    return None


def ranges_from_json(data: object, loop: Loop, radius: Fraction | None) -> tuple[GainRange, ...]:
    """Read them back.  Raises: KeyError, TypeError or ValueError for what are no ranges of this
    problem."""
    gains = (((read_rational,) * 2,) * loop.m,) * loop.m
    found = []
    for each in read_parts(data, [{"coupling": whole_from_json, "gains": gains}]):
        entries = tuple(tuple(Interval(*ends) for ends in row) for row in each["gains"])
        found.append(GainRange(coupling=each["coupling"], radius=radius, entries=entries))
    if sorted(each.coupling for each in found) != sorted(used_couplings(loop)):
        raise ValueError("ranges must name every coupling that an arc has, once")
    return tuple(found)


def build_sectors(loop: Loop, ranges: Sequence[GainRange], *, radius: Fraction | None) -> Sectors:
    """Put claimed ranges at the arcs of every mode, weights multiplied in, exact zeros left out.
    Raises: SpecError."""
    table = {each.coupling: each.entries for each in ranges if each.radius == radius}
    own: list[Channel] = []
    if loop.drift_place is not None:
        slopes = table.get(loop.drift_place)
        if slopes is None:
            raise SpecError(
                f"f needs a range at the radius {radius}.",
                key="ranges",
                cure="Make them with enclose_ranges.",
            )
        for i in range(loop.n):
            own += _channels(loop, slopes, i, i)
    modes: dict[str, tuple[Channel, ...]] = {}
    for name, arcs in loop.modes.items():
        channels: list[Channel] = []
        for (listener, speaker, weight), loose in zip(arcs, arcs.uncertain.tolist(), strict=True):
            entries = table.get(loop.place_of(listener, speaker))
            if entries is None or [len(row) for row in entries] != [loop.m] * loop.m:
                what = (
                    f"mode {name}: the coupling of arc {(listener, speaker)} needs a range of "
                    f"shape ({loop.m}, {loop.m})"
                )
                cure = "Make them with enclose_ranges, with the same radius."
                raise SpecError(f"{what} at the radius {radius}.", key="ranges", cure=cure)
            channels += _channels(loop, entries, listener, speaker, weight, loose=loose)
        modes[name] = (*channels, *own)
    return Sectors(loop=loop, modes=modes)


def _channels(
    loop: Loop,
    entries: IntervalMatrix,
    listener: int,
    speaker: int,
    weight: Fraction | int = 1,
    *,
    loose: bool = False,
) -> Iterator[Channel]:
    """The channels of one arc; ``loose``: it may be away, so that a gain may also be 0.  A node
    that listens to itself: what it does alone, beyond the constant slopes that count as pulls."""
    m = loop.m
    alone = listener == speaker
    for c, row in enumerate(entries):
        for d, gain in enumerate(row):
            ends = gain.hull(_ZERO) if loose else gain
            known = loop.slopes[c][d] if alone else 0
            low = weight * ends.lo - known
            high = weight * ends.hi - known
            if low or high:
                yield Channel(
                    target=listener * m + c,
                    # Fixed nodes are the target, the row after the last.
                    plus=min(speaker * m + d, loop.size),
                    # What a node does alone is about its difference to the target.
                    minus=loop.size if alone else listener * m + d,
                    low=low,
                    high=high,
                )


def relied_differences(loop: Loop) -> tuple[tuple[int, int], ...]:
    """The differences |e[a] - e[b]|, a < b, that ranges with a radius rely on.  Those of every arc
    whose coupling is not linear, also where its gain is one number as far as the radius goes: a
    kink may lie beyond.  For b = n m, the target, it is |e[a]|."""
    m = loop.m
    used = {coupling: _curved_variables(coupling) for coupling in loop.functions}
    found: dict[tuple[int, int], None] = {}
    for arcs in loop.modes.values():
        for listener, speaker, _ in arcs:
            first, last = sorted((listener, speaker))
            for d in used[loop.function_of(listener, speaker)]:
                found[first * m + d, min(last * m + d, loop.size)] = None
    if loop.drift_place is not None:
        own = used[loop.functions[loop.drift_place]]
        for i in range(loop.n):
            for d in own:
                found[i * m + d, loop.n * m] = None
    return tuple(found)


def _curved_variables(coupling: Coupling) -> tuple[int, ...]:
    """The components of y on which h depends otherwise than linearly, or together with such."""
    if coupling.by_component:
        return () if coupling.is_linear else tuple(range(coupling.dimension))
    found = set[int]()
    for component in coupling.components:
        degree = polynomial_degree(component.node)
        if degree is None or degree > 1:
            found.update(variables_used(component.node))
    return tuple(sorted(found))


def used_couplings(loop: Loop) -> list[int]:
    """The couplings that arcs use, by their places, each once, in order; then that of the nodes."""
    modes = loop.modes.values()
    found = list(dict.fromkeys(loop.place_of(i, j) for arcs in modes for i, j, _ in arcs))
    if loop.drift_place is not None:
        found.append(loop.drift_place)
    return found


def _jacobian_hull(coupling: Coupling, box: Box) -> IntervalMatrix:
    """The hull of J over a box, entry by entry, by branch and bound on both ends."""
    hull = _Hull(coupling, box)
    m = range(len(box))
    return tuple(
        tuple(Interval(-hull.highest(c, d, -1), hull.highest(c, d, 1)) for d in m) for c in m
    )


class _Hull:
    """Bounds of the entries of J over a box; what is known of its parts serves all entries."""

    def __init__(self, coupling: Coupling, box: Box) -> None:
        self.coupling = coupling
        self.box = box
        self.algebra = GradientAlgebra(len(box))
        self.cost = sum(map(len, coupling.texts))
        # Halving the other sides would not narrow the bounds.
        self.bending = _curved_variables(coupling) or range(len(box))
        self.known: dict[Box, IntervalMatrix] = {}

    def jacobian(self, part: Box) -> IntervalMatrix:
        """An enclosure of J on a part of the box."""
        found = self.known.get(part)
        if found is None:
            variables = self.algebra.variables(part)
            found = tuple(
                evaluate(each.node, variables, self.algebra).partials
                for each in self.coupling.components
            )
            self.known[part] = found
        return found

    def highest(self, c: int, d: int, sign: int) -> Fraction:
        """An upper bound of ``sign`` times the entry (c, d), close to the highest value."""

        def bounds(part: Box) -> Interval:
            return self.jacobian(part)[c][d] * sign

        box = self.box
        ends = (
            tuple(side.lo for side in box),
            tuple(side.midpoint for side in box),
            tuple(side.hi for side in box),
        )
        # A value at a point is a lower bound of the highest one.
        attained = max(bounds(tuple(map(Interval.point, each))).lo for each in ends)
        # The part with the highest bound comes first; numbers tell parts apart.
        heap = [(-bounds(box).hi, 0, box)]
        for count in range(1, _MOST_PIECES):
            top, _, part = heap[0]
            if -top - attained <= _TOLERANCE * max(Fraction(1), abs(top)):
                break
            heapq.heappop(heap)
            spend(2 * self.cost)
            longest = max(self.bending, key=lambda k: part[k].width)
            for number, half in enumerate(part[longest].halves()):
                piece = (*part[:longest], half, *part[longest + 1 :])
                middle = tuple(Interval.point(each.midpoint) for each in piece)
                attained = max(attained, bounds(middle).lo)
                # No part can go higher than the whole that it was cut from.
                bound = min(bounds(piece).hi, -top)
                heapq.heappush(heap, (-bound, 2 * count + number, piece))
        return -heap[0][0]


def _widened(gain: Interval, room: Fraction) -> Interval:
    gain = Interval(gain.lo - room, gain.hi + room)
    if gain.is_point:
        return gain
    low, high = gain.floats()
    largest = max(abs(low), abs(high))
    if math.isinf(largest):
        return gain
    # Rounded outwards at the digits that count for the larger end.
    unit = Fraction(10) ** (DIGITS - 1 - math.floor(math.log10(largest)))
    return Interval(math.floor(gain.lo * unit) / unit, math.ceil(gain.hi * unit) / unit)
