"""Couplings on a region as bounded gains: h(e) = sum of g b c'e over channels, low <= g <= high
while |c'e| <= radius.

Theory, sections 1 and 4.  A coupling by component has the secant gain g(y) = h(y)/y, one channel
per component.  A coupling of vectors has Jbar(y) = int_0^1 J(s y) ds with h(y) = Jbar(y) y, one
channel per entry of Jbar, which lies in the hull of J over the box.  Both hold with Clarke's slopes
where h has a kink.  An arc that comes and goes has every gain from 0 to those.
"""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any, Final

from dobc_design.conditions.check import read_object
from dobc_design.conditions.numbers import read_rational
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
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.number import number_text
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop

Entries = tuple[tuple[Interval, ...], ...]  # m x m
Box = tuple[Interval, ...]

DIGITS: Final = 6
# gains are claimed this much wider, so that a second program can confirm them
ROOM: Final = Fraction(1, 10**5)
# A gain of a coupling of vectors may be this much too wide at each end; so many parts of the box
# are looked at.
_TOLERANCE: Final = Fraction(1, 1000)
_MOST_PIECES: Final = 100
_ANY: Final = Fraction(10**9)  # where a bound may be as wide as it is
_ZERO: Final = Interval.point(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class GainRange:
    """A claim about one coupling (its place in loop.functions): its gains on |y_c| <= radius lie
    in ``entries``. ``radius`` None: for every y.  The weight of an arc is not included."""

    coupling: int
    radius: Fraction | None
    entries: Entries


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Sectors:
    """The channels of every mode, for ``size`` = n m rows; the pins of ``problem`` complete the
    loop."""

    loop: Loop
    modes: Mapping[str, tuple[Channel, ...]]

    @property
    def size(self) -> int:
        return self.loop.n * self.loop.m


def gains_on(
    coupling: Coupling, radius: Fraction | Sequence[Fraction], *, tolerance: Fraction = TOLERANCE
) -> Entries:
    """Enclose the gains of a coupling on |y_c| <= radius, one for all components or one for each,
    (m, m); those of one variable about ``tolerance`` too wide at most.  Raises: UndefinedError
    naming h and the interval."""
    m = coupling.dimension
    box = tuple(Interval(-r, r) for r in (radius if isinstance(radius, Sequence) else [radius] * m))
    if coupling.by_component:
        curve, own = Curve(coupling.components[0]), dict[Interval, Interval]()
        for side in box:
            own[side] = own[side] if side in own else _secants(curve, side, tolerance)
        return tuple(
            tuple(own[side] if c == d else _ZERO for d in range(m)) for c, side in enumerate(box)
        )
    rows, found = [], None
    for c, component in enumerate(coupling.components):
        if is_sum_of_curves(component.node):
            rows.append(
                tuple(_secants_along(component, d, side, tolerance) for d, side in enumerate(box))
            )
        else:
            found = found or _jacobian_hull(coupling, box)
            rows.append(found[c])
    return tuple(rows)


def _secants(curve: Curve, side: Interval, tolerance: Fraction) -> Interval:
    gain = secant_range(curve, side, tolerance=tolerance)
    # sqrt has a secant gain as far as it is defined, but others may need its slope: some bound of
    # it
    slope_bound(curve, side, tolerance=_ANY)
    return gain


def _secants_along(component: Expression, d: int, side: Interval, tolerance: Fraction) -> Interval:
    """The secant gain in y_d of a sum of functions of one variable each: the others are 0 there."""
    return (
        _secants(_along(component, d), side, tolerance)
        if d in variables_used(component.node)
        else _ZERO
    )


@lru_cache(maxsize=256)
def _along(component: Expression, d: int) -> Curve:
    text = re.sub(
        r"\by([0-9]+)\b", lambda name: "y" if int(name[1]) == d + 1 else "0", str(component)
    )
    return Curve(parse_expression(text))


def is_sum_of_curves(node: Node) -> bool:
    """Whether an expression is, as it is written, a sum of functions of one variable each."""
    if len(variables_used(node)) < 2:
        return True
    linear = node.kind in ("add", "subtract", "negate") or (
        node.kind == "multiply" and any(not variables_used(each) for each in node.operands)
    )
    return linear and all(map(is_sum_of_curves, node.operands))


def gains_at(
    loop: Loop,
    place: int,
    radius: Fraction | Sequence[Fraction],
    *,
    tolerance: Fraction = TOLERANCE,
) -> Entries:
    """The same by the place of the coupling; that of the nodes for every state of a leader.
    Raises: UndefinedError."""
    if place == loop.drift_place and loop.goals.moves:
        radii = radius if isinstance(radius, Sequence) else [radius] * loop.m
        return slopes_of_node(loop, tuple(Interval(-r, r) for r in radii))
    return gains_on(loop.functions[place], radius, tolerance=tolerance)


def slopes_of_node(loop: Loop, errors: Box) -> Entries:
    """Enclose the slopes of f at s + e for all e in a box of errors, (m, m), and all s in the box
    that a leader never leaves: f(s + e) - f(s) = F e with F in their hull, where the errors hold
    0.  Raises: UndefinedError."""
    if loop.drift_place is None:
        A = loop.slopes
        return tuple(tuple(map(Interval.point, row)) for row in A)
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
        entries = widened_gains(loop, place, radius or Fraction(1))
        found.append(GainRange(coupling=place, radius=radius, entries=entries))
    return tuple(found)


def widened_gains(loop: Loop, place: int, radius: Fraction | Sequence[Fraction]) -> Entries:
    """The gains as they are claimed: widened by ROOM and to DIGITS digits where the coupling is not
    linear."""
    room, found = (
        0 if loop.functions[place].is_linear else ROOM,
        gains_at(loop, place, radius),
    )
    return tuple(tuple(_widened(gain, room * gain.magnitude) for gain in row) for row in found)


def left_open(
    loop: Loop, place: int, claimed: Entries, radius: Fraction | Sequence[Fraction]
) -> str | None:
    """Why the gains on |y_c| <= radius are not shown to lie in those that are claimed; None if they
    are."""
    try:
        found = gains_at(loop, place, radius)
    except UndefinedError as error:
        return f"the gains cannot be enclosed: {error}"
    pairs = zip(claimed, found, strict=True)
    if not all(
        mine.contains(gain) for row, own in pairs for mine, gain in zip(row, own, strict=True)
    ):
        return (
            f'the gains of h = "{loop.functions[place].texts[0]}" are not shown to lie in '
            "the range claimed."
        )
    return None


def ranges_to_json(ranges: Sequence[GainRange]) -> list[dict[str, Any]]:
    """The gains of every coupling as text."""
    texts = [
        [[[number_text(x.lo), number_text(x.hi)] for x in row] for row in each.entries]
        for each in ranges
    ]
    return [
        {"coupling": each.coupling, "gains": rows} for each, rows in zip(ranges, texts, strict=True)
    ]


def ranges_from_json(data: object, loop: Loop, radius: Fraction | None) -> tuple[GainRange, ...]:
    """Read them back.  Raises: KeyError, TypeError or ValueError for what are no ranges of this
    problem."""
    if not isinstance(data, list):
        raise TypeError("ranges must be a list")
    found = []
    for each in data:
        values = read_object(each, ("coupling", "gains"))
        if type(values["coupling"]) is not int:
            raise TypeError("coupling must be a whole number")
        rows = [[Interval(*map(read_rational, ends)) for ends in row] for row in values["gains"]]
        if [len(row) for row in rows] != [loop.m] * loop.m:
            raise ValueError("gains must have one row and one column per state component")
        found.append(
            GainRange(coupling=values["coupling"], radius=radius, entries=tuple(map(tuple, rows)))
        )
    if sorted(each.coupling for each in found) != sorted(used_couplings(loop)):
        raise ValueError("ranges must name every coupling that an arc has, once")
    return tuple(found)


def build_sectors(loop: Loop, ranges: Sequence[GainRange], *, radius: Fraction | None) -> Sectors:
    """Put claimed ranges at the arcs of every mode, weights multiplied in, exact zeros left out.
    Raises: SpecError."""
    m, size = loop.m, loop.n * loop.m
    table = {each.coupling: each.entries for each in ranges if each.radius == radius}
    nodes = () if loop.drift_place is None else table.get(loop.drift_place, ())
    if loop.drift_place is not None and not nodes:
        raise SpecError(
            f"f needs a range at the radius {radius}.",
            key="ranges",
            cure="Make them with enclose_ranges.",
        )
    A = loop.slopes  # which the gains of the problem hold already
    own = [
        Channel(
            target=i * m + c,
            plus=i * m + d,
            minus=size,
            low=gain.lo - A[c][d],
            high=gain.hi - A[c][d],
        )
        for i in range(loop.n)
        for c, row in enumerate(nodes)
        for d, gain in enumerate(row)
        if gain.lo != A[c][d] or gain.hi != A[c][d]
    ]
    modes: dict[str, tuple[Channel, ...]] = {}
    for name, arcs in loop.modes.items():
        channels: list[Channel] = []
        for (listener, speaker, weight), loose in zip(arcs, arcs.uncertain.tolist(), strict=True):
            entries = table.get(loop.place_of(listener, speaker))
            if entries is None or [len(row) for row in entries] != [m] * m:
                what = (
                    f"mode {name}: the coupling of arc {(listener, speaker)} needs a range of "
                    f"shape ({m}, {m})"
                )
                cure = "Make them with enclose_ranges, with the same radius."
                raise SpecError(f"{what} at the radius {radius}.", key="ranges", cure=cure)
            if loose:
                entries = tuple(tuple(gain.hull(_ZERO) for gain in row) for row in entries)
            first, other = listener * m, speaker * m
            channels += [
                Channel(
                    target=first + c,
                    plus=other + d,
                    minus=first + d,
                    low=weight * gain.lo,
                    high=weight * gain.hi,
                )
                for c, row in enumerate(entries)
                for d, gain in enumerate(row)
                if gain.lo or gain.hi
            ]
        modes[name] = (*channels, *own)
    return Sectors(loop=loop, modes=modes)


def relied_differences(loop: Loop) -> tuple[tuple[int, int], ...]:
    """The differences |e[a] - e[b]|, a < b, that ranges with a radius rely on.  Those of every arc
    whose coupling is not linear, also where its gain is one number as far as the radius goes: a
    kink may lie beyond.  For b = n m, the target, it is |e[a]|."""
    m = loop.m
    used = {coupling: _curved_variables(coupling) for coupling in loop.functions}
    found = {
        (min(listener, speaker) * m + d, max(listener, speaker) * m + d): None
        for arcs in loop.modes.values()
        for listener, speaker, _ in arcs
        for d in used[loop.function_of(listener, speaker)]
    }
    if loop.drift_place is not None:
        own = _curved_variables(loop.functions[loop.drift_place])
        found |= {(i * m + d, loop.n * m): None for i in range(loop.n) for d in own}
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
    return found if loop.drift_place is None else [*found, loop.drift_place]


def _jacobian_hull(coupling: Coupling, box: Box) -> Entries:
    """The hull of J over a box, entry by entry, by branch and bound on both ends."""
    algebra, cost = GradientAlgebra(len(box)), sum(map(len, coupling.texts))
    bending = _curved_variables(coupling) or range(len(box))

    @cache
    def jacobian(part: Box) -> Entries:
        variables = algebra.variables(part)
        return tuple(
            evaluate(each.node, variables, algebra).partials for each in coupling.components
        )

    def highest(c: int, d: int, sign: int) -> Fraction:
        def bounds(part: Box) -> Interval:
            return jacobian(part)[c][d] * sign

        ends = (
            tuple(side.lo for side in box),
            tuple(side.midpoint for side in box),
            tuple(side.hi for side in box),
        )
        attained = max(bounds(tuple(map(Interval.point, each))).lo for each in ends)
        heap = [(-bounds(box).hi, 0, box)]
        for count in range(1, _MOST_PIECES):
            top, _, part = heap[0]
            if -top - attained <= _TOLERANCE * max(Fraction(1), abs(top)):
                break
            heapq.heappop(heap)
            spend(2 * cost)
            side = max(bending, key=lambda k: part[k].width)
            for number, half in enumerate(part[side].halves()):
                piece = (*part[:side], half, *part[side + 1 :])
                attained = max(
                    attained, bounds(tuple(Interval.point(each.midpoint) for each in piece)).lo
                )
                heapq.heappush(heap, (-min(bounds(piece).hi, -top), 2 * count + number, piece))
        return -heap[0][0]

    m = range(len(box))
    return tuple(tuple(Interval(-highest(c, d, -1), highest(c, d, 1)) for d in m) for c in m)


def _widened(gain: Interval, room: Fraction) -> Interval:
    gain = Interval(gain.lo - room, gain.hi + room)
    if gain.is_point:
        return gain
    low, high = gain.floats()
    largest = max(abs(low), abs(high))
    if math.isinf(largest):
        return gain
    unit = Fraction(10) ** (DIGITS - 1 - math.floor(math.log10(largest)))
    return Interval(math.floor(gain.lo * unit) / unit, math.ceil(gain.hi * unit) / unit)
