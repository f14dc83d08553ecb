"""Rows of the max-separable certificate for very many arcs: float arithmetic with outward bounds.

A row that is reported as proved is proved; what is left is for the exact rows of ``decide``, with
the same subdivision of s.  Gains come from tables whose cells hold exact enclosures (theory,
section 1); off the middle of a cell the mean value theorem bounds g.  No floating-point function is
trusted: only + - * and comparisons, rounded outwards.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from dobc_design._checks import noun, positional
from dobc_design.coupling.enclosures import Curve, Profile, secant, slope_bound
from dobc_design.coupling.expression import Expression
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ONE, ZERO, float_above, float_below
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.arcs import coupling_places
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import Arcs, BoolArray

from .claim import (
    EXACT,
    FACES,
    Errors,
    held_gains,
    holding_gains,
)

Ends = tuple[Array, Array]  # lower and upper ends of intervals

CELLS = 512  # of a table
_KEPT = 16  # tables
# by which cells overlap, far more than a float position can be wrong
_BEYOND = Fraction(1, 2**20)
_CLOSE = Fraction(1, 2**40)  # as a part of it, how far from g floats may be
# A result of one operation is within 2^-53 of itself of the truth (2^-1074 near 0).
_RELATIVE = 2.0**-51
_TINY = 2.0**-1060


def up(x: Array) -> Array:
    """A number above what x would be without its last rounding."""
    return x + (np.abs(x) * _RELATIVE + _TINY)


def down(x: Array) -> Array:
    """A number below what x would be without its last rounding."""
    return x - (np.abs(x) * _RELATIVE + _TINY)


class Ranges(NamedTuple):
    """Least g, most g, least g', most g'."""

    least: Array
    most: Array
    falls: Array
    rises: Array


@noun(eq=False)
class GainTable:
    """Bounds of g and g' on [-radius, radius] in cells of equal width.

    ``low`` and ``high`` bound g in the middle of each cell, slack for misplaced positions included;
    ``falls`` and ``rises`` bound g' on it (0 where g' is not bounded: low and high then hold on the
    whole cell).  ``ranges`` (4, levels, cells): the most of -g, g, -g', g' over 1, 2, 4, ... cells
    from each on.
    """

    radius: float
    width: float
    low: Array
    high: Array
    falls: Array
    rises: Array
    ranges: Array

    def cell(self, y: Array) -> Any:
        """The cell of each y, up to the overlap."""
        return np.clip(((y + self.radius) / self.width).astype(np.int64), 0, len(self.low) - 1)

    @property
    def limit(self) -> float:
        """How far out it says something."""
        return self.radius + self.width * float(_BEYOND / 2)

    def at(self, y: Array) -> Ends:
        """Lower and upper bounds of g at y, where y may be wrong in its last digits."""
        cell = self.cell(y)
        beyond = y - ((cell + 0.5) * self.width - self.radius)
        falls = self.falls[cell] * beyond
        rises = self.rises[cell] * beyond
        lower = down(self.low[cell] + down(np.minimum(falls, rises)))
        upper = up(self.high[cell] + up(np.maximum(falls, rises)))
        return lower, upper

    def over(self, y: Array, z: Array) -> Ranges:
        """Bounds of g and of g' between y and z."""
        first = self.cell(np.minimum(y, z))
        level, second = _span(first, self.cell(np.maximum(y, z)))
        ends = np.maximum(self.ranges[:, level, first], self.ranges[:, level, second])
        return Ranges(-ends[0], ends[1], -ends[2], ends[3])


@lru_cache(maxsize=_KEPT)
def gain_table(expression: Expression, radius: Fraction, *, cells: int = CELLS) -> GainTable:
    """Enclose g on [-radius, radius] in at most ``cells`` cells, whose nodes are floats; the last
    ones reach further. Tables are kept, since one claim asks for the same several times, and cells,
    which tables of several radii share; arrays cannot be written to. Raises:
    exact.interval.UndefinedError where g cannot be enclosed."""
    curve = Curve(expression)
    # 3 or 4 times a power of two: nodes are floats, and tables of many radii share their cells
    part, exponent = math.frexp(float_above(radius) or 2.0**-20)
    quarters = 3 if part < 0.75 else 4
    width = Fraction(quarters) * Fraction(2) ** (exponent - 1) / cells
    most = max(1, math.ceil(radius / width))
    found = [_cell(curve, k, width) for k in range(-most, most)]
    low, high, least, highest, falls, rises = (
        np.array(column) for column in zip(*found, strict=True)
    )
    ranges = _spans(np.stack([-least, highest, -falls, rises]))
    bounded = np.isfinite(falls) & np.isfinite(rises)
    falls = np.where(bounded, falls, 0.0)
    rises = np.where(bounded, rises, 0.0)
    for array in (low, high, falls, rises, ranges):
        array.setflags(write=False)
    return GainTable(
        radius=float(most * width),
        width=float(width),
        low=low,
        high=high,
        falls=falls,
        rises=rises,
        ranges=ranges,
    )


def _spans(values: Array) -> Array:
    """The most over 1, 2, 4, ... cells from each on, near the right end over those that are left;
    by level, in the last axis but one."""
    levels = [values]
    span = 1
    while 2 * span <= values.shape[-1]:
        last = levels[-1]
        beside = np.concatenate([last[..., span:], np.repeat(last[..., -1:], span, -1)], axis=-1)
        levels.append(np.maximum(last, beside))
        span *= 2
    return np.stack(levels, axis=-2)


def _span(first: Any, last: Any) -> tuple[Any, Any]:
    """The level of ``_spans`` of which two entries cover the cells first, ..., last, and where the
    second begins."""
    level = np.frexp((last - first + 1).astype(float))[1] - 1
    return level, last - (1 << level) + 1


@lru_cache(maxsize=_KEPT * CELLS)
def _cell(curve: Curve, k: int, width: Fraction) -> tuple[float, ...]:
    """(low, high) of g in the middle of [k, k + 1] width, then bounds of g and of g' on it."""
    overlap = width * _BEYOND
    place = Interval(k * width - overlap, (k + 1) * width + overlap)
    middle = Interval.point((k + Fraction(1, 2)) * width)
    try:  # in floats, if they tell g: next to 0 differences as in exp(y) - 1 leave few digits
        around = secant(curve, Floats.around(place))
        node = secant(curve, Floats.around(middle))
        is_close = node.value.width <= _CLOSE * node.value.magnitude
    except UndefinedError:
        is_close = False
    if not is_close:
        around = secant(curve, place)
        node = secant(curve, middle)
    values = around.value.floats()
    if around.slope is None:
        return (*values, *values, -math.inf, math.inf)
    slack = 4 * overlap * around.slope.magnitude
    low = float_below(node.value.lo - slack)
    high = float_above(node.value.hi + slack)
    return (low, high, *values, *around.slope.floats())


#: A coupling that turns more often is left to the exact rows.
MOST_TURNS = 40


class Top(NamedTuple):
    """Where a coupling may have a maximum, from ``low`` to ``high``, and an upper bound of what it
    takes there."""

    low: float
    high: float
    value: float


@noun(eq=False)
class Turning:
    """One coupling that is not nondecreasing, for one face (the lower one has -h(-y) in place of
    h).  ``table`` reaches to the left ends.  ``falls``: where h is not shown to rise."""

    table: GainTable
    face: int
    falls: tuple[tuple[float, float], ...]
    tops: tuple[Top, ...]

    def largest(
        self, steps: Array, reaches: Array, right: Ends, s: float, t: float
    ) -> tuple[Array, Any]:
        """An upper bound of phi on [s, t] for every arc, and whether phi is the right end on all of
        it.  ``right``: lower and upper bounds of what the right end gives, step g(s step), on [s,
        t]."""
        most = right[1].copy()
        smooth = np.ones(len(steps), dtype=bool)
        asked = np.flatnonzero(self._may_fall(-up(t * reaches), _right_end(steps, s, t)))
        if len(asked):
            others = self._others(steps[asked], reaches[asked], s, t)
            smooth[asked] = others <= right[0][asked]
            at_right = np.minimum(most[asked], self._end(steps[asked], s, t))
            most[asked] = np.maximum(at_right, others)
        return most, smooth

    def _end(self, x: Array, s: float, t: float) -> Array:
        """The largest x g(s x) on [s, t]: from the range of g, or from the middle and the range of
        g'."""
        least, most, falls, rises = self.table.over(self.face * s * x, self.face * t * x)
        low, high = self.table.at(self.face * (s + t) / 2 * x)
        there = up(np.where(x >= 0, x * high, x * low))
        half = (t - s) / 2 + t * 2.0**-50
        swing = up(up(np.maximum(-falls, rises) * half) * up(x * x))
        by_range = up(np.where(x >= 0, x * most, x * least))
        by_middle = up(there + np.maximum(swing, 0.0))
        return np.where(x == 0, 0.0, np.minimum(by_range, by_middle))

    def _may_fall(self, low: Array, high: Array) -> Any:
        """Whether h may fall somewhere on [low, high]."""
        found = np.zeros(len(low), dtype=bool)
        for start, end in self.falls:
            found |= (start <= high) & (low <= end)
        return found

    def _others(self, steps: Array, reaches: Array, s: float, t: float) -> Array:
        """What the left end and the maxima inside give at most; everything where s is 0 and h turns
        there."""
        there = self._may_fall(-up(t * reaches), -down(s * reaches))
        found = np.where(there, self._end(-reaches, s, t), -np.inf)
        for low, high, value in self.tops:
            begin, end = _when(low, high, steps, reaches, s, t)
            # h/s is largest at the smallest s if h > 0 there, else at the largest
            with np.errstate(divide="ignore"):
                here = up(value / begin) if value > 0 else up(value / end)
            found = np.where(begin <= end, np.maximum(found, here), found)
        if s:
            return found
        # The largest x g(s x), -reach <= x <= step, s in [0, t], from the range of g.
        end = np.maximum(_right_end(steps, 0.0, t), 0.0)
        ranges = self.table.over(-self.face * up(t * reaches), self.face * end)
        left = np.maximum(-reaches * ranges.least, -reaches * ranges.most)
        right = np.maximum(steps * ranges.least, steps * ranges.most)
        return np.minimum(found, up(np.maximum(left, right)))


def turning(kind: Profile, table: GainTable, face: int) -> Turning | None:
    """Bring a coupling into floats; None if it turns too often."""
    tops = kind.tops if face > 0 else kind.bottoms
    falling = ((cell.place * face).floats() for cell in kind.cells if cell.direction <= 0)
    falls = tuple(_joined(falling))
    if len(tops) > MOST_TURNS or len(falls) > MOST_TURNS:
        return None
    places = []
    for cell in tops:
        low, high = (cell.place * face).floats()
        value = cell.values.hi if face > 0 else -cell.values.lo
        places.append(Top(low, high, float_above(value)))
    return Turning(table=table, face=face, falls=falls, tops=tuple(places))


def _when(low: float, high: float, steps: Array, reaches: Array, s: float, t: float) -> Ends:
    """The s of [s, t] for which [low, high] may meet [-s reach, s step]; from above to nothing
    where there are none."""
    begin = np.full(len(steps), s)
    end = np.full(len(steps), t)
    with np.errstate(divide="ignore", invalid="ignore"):
        if low > 0:
            begin = np.where(steps > 0, np.maximum(begin, down(low / steps)), np.inf)
        elif high < 0:
            begin = np.maximum(begin, down(-high / reaches))
            end = np.where(steps < 0, np.minimum(end, up(low / steps)), end)
    return begin, end


def _right_end(steps: Array, s: float, t: float) -> Array:
    """How far right an arc looks on [s, t], from above."""
    return np.maximum(up(s * steps), up(t * steps))


def _joined(places: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Neighbours that touch as one."""
    joined: list[tuple[float, float]] = []
    for low, high in sorted(places):
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return joined


_MOST_PIECES = 600  # of (0, rho], looked at before the remaining rows are given back
_NARROWEST = 2.0**-30  # piece, as a part of rho
_SURE = 1e-6  # as a part of its limit, by how much a row fails for certain
_UNIT = 2.0**-52
# integers up to that long are floats, and so are they over a power of two as long
_FLOAT_BITS = 53
SLICES = 8  # of the way of a held step
SLOPES = 256  # parts of [0, radius] on which slopes are bounded, and how close
_STEEP = Fraction(1, 1000)


@noun(eq=False)
class ArcRows:
    """The arcs by row, mode after mode: those of row i are start[i]:start[i + 1].  ``steps`` are at
    least v_j - v_i, ``reaches`` at least v_i + v_j; ``kinds`` are the places of couplings;
    ``weights`` and ``own`` (v) are lower and upper bounds, None for weights that are all 1.
    ``pulls``: as in ``claim.Row``."""

    start: Any
    steps: Array
    reaches: Array
    weights: Ends | None
    kinds: Any
    own: Ends
    pulls: tuple[Fraction, ...]


@positional(eq=False)
class Kinds:
    """The couplings in floats: a table for the right ends of each, and how it turns on each face,
    if it does."""

    tables: tuple[GainTable, ...]
    turning: Mapping[tuple[int, int], Turning]


@noun(eq=False)
class Layout:
    """All arcs by rows; agent i of the k-th mode has row k n + i.  ``start`` and ``weights`` as in
    ArcRows.  ``floor``: the least step of each arc: 0 of those that come and go (``claim.rows``),
    -inf of others."""

    rows: Any
    speakers: Any
    start: Any
    kinds: Any
    weights: Ends | None
    floor: Array


def arc_layout(loop: Loop, *, modes: Sequence[str] | None = None, errors: Errors = EXACT) -> Layout:
    """Order the arcs of the given modes (default: all) by row."""
    chosen = loop.modes if modes is None else modes
    graphs = tuple(loop.modes[mode] for mode in chosen)
    listeners = _stacked(
        # no copy of the first mode, which is the only one of most large networks
        [arcs.listeners + k * loop.n if k else arcs.listeners for k, arcs in enumerate(graphs)]
    )
    in_order = bool(np.all(np.diff(listeners) >= 0))
    order = slice(None) if in_order else np.argsort(listeners, kind="stable")
    listeners = listeners[order]
    optional = _stacked([arcs.uncertain for arcs in graphs])
    speakers = _stacked([arcs.speakers for arcs in graphs])[order]
    return Layout(
        rows=listeners,
        speakers=speakers,
        start=np.searchsorted(listeners, np.arange(loop.n * len(graphs) + 1)),
        kinds=_stacked([coupling_places(loop, arcs) for arcs in graphs])[order],
        weights=_weights(graphs, order, errors, to_fixed=speakers >= loop.n),
        floor=np.where(optional, 0.0, -np.inf)[order],
    )


def _weights(
    graphs: Sequence[Arcs], order: Any, errors: Errors, *, to_fixed: BoolArray
) -> Ends | None:
    """Lower and upper bounds of the weights of arcs in this order, each off by its relative error;
    None if all are 1."""
    # An arc to a fixed node may be a pin, and its weight a gain.
    each = (errors.weights, max(errors))
    if not any(each) and all(w is ONE for arcs in graphs for w in arcs.weights):
        return None
    bounds = [floats_around(arcs.weights) for arcs in graphs]
    below = _stacked([low for low, _ in bounds])[order]
    above = _stacked([high for _, high in bounds])[order]
    if not any(each):
        return below, above
    kind = to_fixed.astype(np.int64)
    least = np.array([float_below(1 - error) for error in each])[kind]
    most = np.array([float_above(1 + error) for error in each])[kind]
    return np.maximum(down(below * least), 0.0), up(above * most)


def arc_rows(
    loop: Loop,
    v: Sequence[Fraction],
    *,
    stretch: Fraction | int = 1,
    errors: Errors = EXACT,
    held: bool = False,
) -> ArcRows:
    """Bring all modes into arrays, rounded so that rows only become harder to satisfy.  ``held`` as
    in ``rows``."""
    modes = len(loop.modes)
    layout = arc_layout(loop, errors=errors)
    low, high = floats_around(v)
    stretched = high if stretch == 1 else floats_around([stretch * x for x in v])[1]
    low = _stacked([low] * modes)
    high = _stacked([high] * modes)
    own = low[layout.rows]
    # Fixed nodes have the weight 0.
    other = np.append(stretched, np.zeros(len(loop.fixed)))[layout.speakers]
    steps = other - own
    # The difference of two floats within a factor of two of each other has no rounding.
    is_exact = (other <= 2 * own) & (own <= 2 * other)
    steps = np.where(is_exact, steps, up(steps))
    if not held:
        steps = np.maximum(steps, layout.floor)
    pulls = held_gains(loop) if held else holding_gains(loop, error=errors.gains)
    return ArcRows(
        start=layout.start,
        steps=steps,
        reaches=up(other + high[layout.rows]),
        weights=layout.weights,
        kinds=layout.kinds,
        own=(low, high),
        pulls=pulls * modes,
    )


def _stacked(arrays: Sequence[Any]) -> Any:
    """One below the other; no copy of a single one."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def float_kinds(
    profiles: Sequence[Profile], arcs: ArcRows, *, rho: Fraction, cells: int = CELLS
) -> Kinds | None:
    """Bring the couplings into floats, as far out as these rows look; None if one of them turns too
    often.  ``cells``: of a table; half as many where it reaches to the left ends, which seldom
    decide. Raises: exact.interval.UndefinedError where a gain cannot be enclosed."""
    tables = []
    turns = {}
    steps = np.zeros(len(profiles))
    reaches = np.zeros(len(profiles))
    np.maximum.at(steps, arcs.kinds, np.abs(arcs.steps))
    np.maximum.at(reaches, arcs.kinds, np.abs(arcs.reaches))
    for number, kind in enumerate(profiles):
        tables.append(_shared_table(kind, rho * Fraction(float(steps[number])), cells))
        if kind.is_nondecreasing:
            continue
        whole = _shared_table(kind, rho * Fraction(float(reaches[number])), cells // 2)
        for face in FACES:
            found = turning(kind, whole, face)
            if found is None:
                return None
            turns[number, face] = found
    return Kinds(tuple(tables), turns)


def _shared_table(kind: Profile, radius: Fraction, cells: int) -> GainTable:
    """A table that reaches a little further if it can, so that vectors that differ in a few digits
    share it."""
    if not radius:
        unit = ONE
    else:
        exponent = math.frexp(float_above(radius))[1]
        unit = Fraction(2) ** (exponent - 6)
    try:
        return gain_table(kind.curve.expression, math.ceil(radius / unit) * unit, cells=cells)
    except UndefinedError:
        return gain_table(kind.curve.expression, radius, cells=cells)


def open_rows(
    arcs: ArcRows, kinds: Kinds, *, alpha: Fraction, rho: Fraction
) -> list[tuple[int, int]]:
    """The (row, face) that is not proved for all s in (0, rho]; the tables reach that far."""
    rates = floats_around(arcs.pulls, less=alpha)[0]
    limits = np.where(rates >= 0, rates * arcs.own[0], rates * arcs.own[1])
    limits = np.where(rates == 0, 0.0, down(limits))
    above = float_above(rho)
    found: list[tuple[int, int]] = []
    # cells beyond the table are infinite and prove nothing
    with np.errstate(invalid="ignore", over="ignore"):
        for face in FACES:
            agents = open_within(arcs, limits, face, kinds, above)
            found += [(agent, face) for agent in agents.tolist()]
    return found


def stiffest_row(arcs: ArcRows, profiles: Sequence[Profile], *, rho: Fraction) -> Fraction:
    """An upper bound of the largest sum_j w L_ij + k over rows and faces, of arcs that are held.
    Raises: UndefinedError."""
    counts = np.diff(arcs.start)
    rows = np.repeat(np.arange(len(counts)), counts)
    pulls = floats_around(arcs.pulls)[1]
    own = arcs.own[1][rows]
    mean = np.zeros(len(rows))
    largest = ZERO
    for face in FACES:
        for number, kind in enumerate(profiles):
            mine = arcs.kinds == number
            if np.any(mine):
                ends = HeldArcs(arcs.steps[mine], arcs.reaches[mine], own[mine])
                mean[mine] = _mean_slopes(kind, face, rho, ends)
        values = mean if arcs.weights is None else up(mean * arcs.weights[1])
        highest = np.max(up(_sums(values, rows, counts) + pulls))
        largest = max(largest, Fraction(float(highest)))
    return largest


class HeldArcs(NamedTuple):
    """Where arcs look that are held: v_j - v_i, v_i + v_j and v_i."""

    steps: Array
    reaches: Array
    own: Array


def _mean_slopes(kind: Profile, face: int, rho: Fraction, arcs: HeldArcs) -> Array:
    """Upper bounds of the mean slopes, slice by slice, of each arc."""
    scale = float(rho / kind.radius * SLOPES)
    highest = _slopes(kind.curve, kind.radius)
    # where h rises, the worst e_j is s v_j
    start = np.minimum(arcs.steps, 0.0) if kind.is_nondecreasing else -arcs.reaches
    # Positions are wrong by far less than half the overlap.
    overlap = float(_BEYOND / 2)
    last_part = 2 * SLOPES - 1
    total = np.zeros(len(arcs.steps))
    for k in range(SLICES):
        end = np.maximum(arcs.steps + 2 * (k + 1) / SLICES * arcs.own, 0.0)
        low, high = (start, end) if face > 0 else (-end, -start)
        first = np.floor(low * scale + overlap).astype(np.int64) + SLOPES
        first = np.clip(first, 0, last_part)
        last = np.floor(high * scale - overlap).astype(np.int64) + SLOPES
        level, second = _span(first, np.clip(last, first, last_part))
        total = up(total + np.maximum(highest[level, first], highest[level, second]))
    return total / SLICES


@lru_cache(maxsize=_KEPT)
def _slopes(curve: Curve, radius: Fraction) -> Array:
    """Upper bounds of h', at least 0, over 1, 2, 4, ... of the 2 SLOPES parts of [-radius, radius]
    from each on."""
    width = radius / SLOPES
    whole = Interval(-radius, radius)
    found: list[float] = []
    for k in range(-SLOPES, SLOPES):
        place = whole.meet(Interval((k - _BEYOND) * width, (k + 1 + _BEYOND) * width))
        try:
            slope = slope_bound(curve, Floats.around(place), tolerance=_STEEP)
        except UndefinedError:
            slope = slope_bound(curve, place, tolerance=_STEEP)
        found.append(max(float_above(slope), 0.0))
    return _spans(np.array(found))


def open_within(
    arcs: ArcRows, limits: Array, face: int, kinds: Kinds, rho: float, start: float = 0.0
) -> Any:
    """Rows that are not proved to be at most their limits for s in [start, rho], after a
    subdivision of s."""
    failed: list[Any] = [_rows_beyond(arcs, face, kinds, rho)]
    waiting = [(start, rho, np.arange(len(limits)))]
    count = 0
    while waiting:
        s, t, agents = waiting.pop()
        count += 1
        middle = (s + t) / 2
        piece = Piece(arcs, face, kinds, agents)
        most = limits[agents]
        left = ~piece.proves(s, t, most)
        agents = agents[left]
        if not len(agents):
            continue
        # No smaller piece proves what fails at one s.
        hopeless = (piece.at(middle) > most + np.abs(most) * _SURE)[left]
        if count >= _MOST_PIECES or t - s <= rho * _NARROWEST:
            hopeless[:] = True
        failed.append(agents[hopeless])
        agents = agents[~hopeless]
        if len(agents):
            waiting += [(s, middle, agents), (middle, t, agents)]
    return np.unique(np.concatenate(failed))


def _rows_beyond(arcs: ArcRows, face: int, kinds: Kinds, rho: float) -> Any:
    """The rows that look farther than their tables reach, which say nothing there."""
    far = np.zeros(len(arcs.steps), dtype=bool)
    for number, table in enumerate(kinds.tables):
        mine = arcs.kinds == number
        far[mine] = ~(rho * np.abs(arcs.steps[mine]) <= table.limit)
        turns = kinds.turning.get((number, face))
        if turns is not None:
            far[mine] |= ~(rho * np.abs(arcs.reaches[mine]) <= turns.table.limit)
    return np.unique(np.searchsorted(arcs.start, np.flatnonzero(far), side="right") - 1)


class Piece:
    """Upper bounds of sum w phi(s) for some agents."""

    def __init__(self, arcs: ArcRows, face: int, kinds: Kinds, agents: Any) -> None:
        self.counts = arcs.start[agents + 1] - arcs.start[agents]
        self.rows = np.repeat(np.arange(len(agents)), self.counts)
        picked: Any = slice(None)
        if len(agents) < len(arcs.pulls):
            ends = np.cumsum(self.counts)
            # from places among the picked arcs to places among all
            shift = arcs.start[agents] - ends + self.counts
            picked = np.arange(len(self.rows)) + np.repeat(shift, self.counts)
        self.steps = arcs.steps[picked]
        self.reaches = arcs.reaches[picked]
        self.kinds = arcs.kinds[picked]
        self.weights = None
        if arcs.weights is not None:
            low, high = arcs.weights
            self.weights = (low[picked], high[picked])
        self.face = face
        self.tables = kinds.tables
        self.turning = kinds.turning

    def proves(self, s: float, t: float, limits: Array) -> Any:
        """Which rows are at most their limits on [s, t]: by the whole piece, by one end, or by its
        middle."""
        low, high, falls, rises = self._bounds(
            lambda table, b: table.over(self.face * s * b, self.face * t * b), 4
        )
        most, smooth = self._largest(low, high, s, t)
        proved = self._total(most) <= limits
        square = self.steps * self.steps
        if smooth is not None:
            square = np.where(smooth, square, 0.0)
        below, above = (falls, rises) if self.face > 0 else (-rises, -falls)
        # Bounds of the slope of the sum: rows that only rise are largest at t, others at s.
        least = -self._total(np.where(square == 0, 0.0, up(-below * square)))
        rising = ~proved & (least >= 0)
        if np.any(rising):
            proved |= rising & (self._at(t, most, smooth) <= limits)
        if np.all(proved):
            return proved
        highest = self._total(np.where(square == 0, 0.0, up(above * square)))
        falling = ~proved & (highest <= 0)
        if np.any(falling):
            proved |= falling & (self._at(s, most, smooth) <= limits)
        if np.all(proved):
            return proved
        half = (t - s) / 2 + t * 4 * _UNIT
        swing = up(np.maximum(np.maximum(highest, -least), 0.0) * half)
        at_middle = self._at((s + t) / 2, most, smooth)
        return proved | (up(at_middle + swing) <= limits)

    def at(self, s: float) -> Array:
        """Upper bounds at one s."""
        low, high = self._gains_at(s)
        return self._total(self._largest(low, high, s, s)[0])

    def _gains_at(self, s: float) -> Ends:
        """Bounds of g at the right ends, at one s."""
        low, high = self._bounds(lambda table, b: table.at(self.face * s * b), 2)
        return low, high

    def _at(self, s: float, most: Array, smooth: Any) -> Array:
        """Upper bounds at one s where phi is the right end; elsewhere ``most``, which holds on a
        piece."""
        right = self._right(*self._gains_at(s))[1]
        return self._total(right if smooth is None else np.where(smooth, right, most))

    def _bounds(self, look: Callable[[GainTable, Array], Any], width: int) -> Any:
        """Bounds from the table of each arc's coupling."""
        if len(self.tables) == 1:
            return look(self.tables[0], self.steps)
        result = np.zeros((width, len(self.steps)))
        for kind, table in enumerate(self.tables):
            mine = self.kinds == kind
            result[:, mine] = look(table, self.steps[mine])
        return tuple(result)

    def _right(self, low: Array, high: Array) -> Ends:
        """The least and the largest step g for g in [low, high]."""
        rising = self.steps >= 0
        still = self.steps == 0
        most = np.where(still, 0.0, up(self.steps * np.where(rising, high, low)))
        # the least is asked for where couplings turn only
        if not self.turning:
            return low, most
        least = np.where(still, 0.0, down(self.steps * np.where(rising, low, high)))
        return least, most

    def _largest(self, low: Array, high: Array, s: float, t: float) -> tuple[Array, Any]:
        """Upper bounds of phi on [s, t] for g in [low, high] at right ends; where phi is the right
        end (None: all)."""
        least, most = self._right(low, high)
        if not self.turning:
            return most, None
        smooth = np.ones(len(most), dtype=bool)
        for (kind, face), each in self.turning.items():
            if face == self.face:
                mine = self.kinds == kind
                right = (least[mine], most[mine])
                most[mine], smooth[mine] = each.largest(
                    self.steps[mine], self.reaches[mine], right, s, t
                )
        return most, smooth

    def _total(self, values: Array) -> Array:
        """Sums of w times values by row, rounded up."""
        if self.weights is not None:
            product = up(values * np.where(values >= 0, self.weights[1], self.weights[0]))
            values = np.where(values == 0, 0.0, product)
        return _sums(values, self.rows, self.counts)


def _sums(values: Array, rows: Any, counts: Any) -> Array:
    """Sums of values by row, rounded up: one addition per term, each within 2^-53 of the sum of
    sizes."""
    total = np.bincount(rows, weights=values, minlength=len(counts))
    sizes = np.bincount(rows, weights=np.abs(values), minlength=len(counts))
    return np.where(sizes == 0, 0.0, up(total + up(sizes * (2 * (counts + 2) * _UNIT))))


def floats_around(values: Sequence[Fraction], *, less: Fraction | None = None) -> Ends:
    """Floats below and above the numbers, or these ``less`` something; equal objects are converted
    once."""
    if isinstance(values, Doubles) and less is None:
        return values.array, values.array
    places = np.fromiter(map(id, values), dtype=np.int64, count=len(values))
    _, first, inverse = np.unique(places, return_index=True, return_inverse=True)
    low = np.empty(len(first))
    high = np.empty(len(first))
    for k, place in enumerate(first.tolist()):
        value = values[place] if less is None else values[place] - less
        top = value.numerator
        bottom = value.denominator
        # The same number as a float where that is seen at once: few bits over a power of two, as v
        # has them.
        bits = max(top.bit_length(), bottom.bit_length())
        if not bottom & (bottom - 1) and bits <= _FLOAT_BITS:
            low[k] = high[k] = top / bottom
        else:
            low[k], high[k] = float_below(value), float_above(value)
    return low[inverse], high[inverse]
