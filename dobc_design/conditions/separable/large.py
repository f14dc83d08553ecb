"""Rows of the max-separable certificate for very many arcs: float arithmetic with outward bounds.

A row that is reported as proved is proved; what is left is for ``separable_rows``.  The subdivision of s and its bounds
are the same as there, for all rows at once; where a coupling falls, ``separable_turns`` says what counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np

from dobc_design.conditions.separable.claim import FACES, holding_gains
from dobc_design.conditions.separable.table import CELLS, Array, GainTable, down, gain_table, up
from dobc_design.conditions.separable.turns import Turning, turning
from dobc_design.coupling.enclosures import Profile
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import float_above, float_below
from dobc_design.exact.symmetric import Doubles
from dobc_design.problem.arcs import coupling_places
from dobc_design.problem.network import ONE
from dobc_design.problem.problem import Problem

# Pieces of (0, rho] looked at before the remaining rows are given back, and the narrowest as a part of rho.
_MOST_PIECES: Final = 600
_NARROWEST: Final = 2.0**-30
_UNIT: Final = 2.0**-52
_FLOAT_BITS: Final = 53  # integers up to that long are floats, and so are they over a power of two as long
# Where an estimate of the rate looks, as parts of rho.
_SAMPLES: Final = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ArcRows:
    """The arcs of one mode by listener: those of agent i are start[i]:start[i + 1].

    ``steps`` are at least v_j - v_i, ``reaches`` at least v_i + v_j; ``weights`` and ``own`` (v) are lower and upper
    bounds, None for weights that are all 1.
    """

    start: Any
    steps: Array
    reaches: Array
    weights: tuple[Array, Array] | None
    kinds: Any
    own: tuple[Array, Array]
    gains: tuple[Fraction, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Kinds:
    """The couplings in floats: a table for the right ends of each, and how it turns on each face, if it does."""

    tables: tuple[GainTable, ...]
    turning: Mapping[tuple[int, int], Turning]


def arc_rows(problem: Problem, v: Sequence[Fraction], mode: str, *, stretch: Fraction | int = 1) -> ArcRows:
    """Bring one mode into arrays, rounded so that rows only become harder to satisfy."""
    arcs = problem.network.modes[mode]
    in_order = bool(np.all(np.diff(arcs.listeners) >= 0))
    order = slice(None) if in_order else np.argsort(arcs.listeners, kind="stable")
    listeners, speakers = arcs.listeners[order], arcs.speakers[order]
    low, high = _floats(v)
    heard = high if stretch == 1 else _floats([stretch * x for x in v])[1]
    own, other = low[listeners], heard[speakers]
    steps = other - own
    # The difference of two floats within a factor of two of each other has no rounding.
    near = (other <= 2 * own) & (own <= 2 * other)
    weights = None if all(w is ONE for w in arcs.weights) else _floats(arcs.weights)
    return ArcRows(
        start=np.searchsorted(listeners, np.arange(problem.n + 1)),
        steps=np.where(near, steps, up(steps)),
        reaches=up(other + high[listeners]),
        weights=None if weights is None else (weights[0][order], weights[1][order]),
        kinds=coupling_places(problem, arcs)[order],
        own=(low, high),
        gains=holding_gains(problem),
    )


def float_kinds(
    profiles: Sequence[Profile], modes: Sequence[ArcRows], *, rho: Fraction, cells: int = CELLS
) -> Kinds | None:
    """Bring the couplings into floats, as far out as these rows look; None if one of them turns too often.

    ``cells``: of a table; half as many where it reaches to the left ends, which seldom decide.

    Raises: exact.interval.UndefinedError where a gain cannot be enclosed.
    """
    tables, turns = [], {}
    steps = _largest(len(profiles), [(each.kinds, each.steps) for each in modes])
    reaches = _largest(len(profiles), [(each.kinds, each.reaches) for each in modes])
    for number, kind in enumerate(profiles):
        tables.append(_shared_table(kind, rho * steps[number], cells))
        if kind.is_nondecreasing:
            continue
        whole = _shared_table(kind, rho * reaches[number], cells // 2)
        for face in FACES:
            found = turning(kind, whole, face)
            if found is None:
                return None
            turns[number, face] = found
    return Kinds(tuple(tables), turns)


def _shared_table(kind: Profile, radius: Fraction, cells: int) -> GainTable:
    """A table that reaches a little further if it can, so that vectors that differ in a few digits share it."""
    unit = Fraction(2) ** (math.frexp(float_above(radius))[1] - 6) if radius else Fraction(1)
    try:
        return gain_table(kind.curve, math.ceil(radius / unit) * unit, cells=cells)
    except UndefinedError:
        return gain_table(kind.curve, radius, cells=cells)


def _largest(count: int, parts: Sequence[tuple[Any, Array]]) -> list[Fraction]:
    """The largest size of the values of each of ``count`` kinds, 0 where there are none; parts: (kinds, values)."""
    found = np.zeros(count)
    for kinds, values in parts:
        np.maximum.at(found, kinds, np.abs(values))
    return [Fraction(x) for x in found.tolist()]


def open_rows(arcs: ArcRows, kinds: Kinds, *, alpha: Fraction, rho: Fraction) -> list[tuple[int, int]]:
    """The (agent, face) whose row is not proved for all s in (0, rho]; the tables reach that far."""
    rates = _floats(arcs.gains, less=alpha)[0]
    limits = np.where(rates >= 0, rates * arcs.own[0], rates * arcs.own[1])
    limits = np.where(rates == 0, 0.0, down(limits))
    with np.errstate(invalid="ignore", over="ignore"):  # cells beyond the table are infinite and prove nothing
        return [
            (agent, face) for face in FACES for agent in _open(arcs, limits, face, kinds, float_above(rho)).tolist()
        ]


def estimated_rate(arcs: ArcRows, kinds: Kinds, *, rho: Fraction) -> float:
    """The least rate that a few values of s show: an estimate of the largest that can be proved."""
    gains = np.array([float(k) for k in arcs.gains])
    agents = np.arange(len(gains))
    least = np.inf
    with np.errstate(invalid="ignore", over="ignore"):
        for face in FACES:
            piece = _Piece(arcs, face, kinds, agents)
            for part in _SAMPLES:
                least = min(least, float(np.min(gains - piece.at(part * float(rho)) / arcs.own[1])))
    return least


def _open(arcs: ArcRows, limits: Array, face: int, kinds: Kinds, rho: float) -> Any:
    """Rows that are not proved after the subdivision of s."""
    failed: list[Any] = []
    waiting = [(0.0, rho, np.arange(len(limits)))]
    count = 0
    while waiting:
        s, t, agents = waiting.pop()
        count += 1
        agents = agents[~_Piece(arcs, face, kinds, agents).proves(s, t, limits[agents])]
        if not len(agents):
            continue
        middle = (s + t) / 2
        if count >= _MOST_PIECES or t - s <= rho * _NARROWEST:
            failed.append(agents)
        else:
            waiting += [(s, middle, agents), (middle, t, agents)]
    return np.unique(np.concatenate(failed)) if failed else np.zeros(0, dtype=np.int64)


class _Piece:
    """Upper bounds of sum w phi(s) for some agents."""

    def __init__(self, arcs: ArcRows, face: int, kinds: Kinds, agents: Any) -> None:
        self.counts = arcs.start[agents + 1] - arcs.start[agents]
        self.rows = np.repeat(np.arange(len(agents)), self.counts)
        picked: Any = slice(None)
        if len(agents) < len(arcs.gains):
            ends = np.cumsum(self.counts)
            picked = np.arange(len(self.rows)) + np.repeat(arcs.start[agents] - ends + self.counts, self.counts)
        self.steps, self.reaches, self.kinds = arcs.steps[picked], arcs.reaches[picked], arcs.kinds[picked]
        self.weights = None if arcs.weights is None else (arcs.weights[0][picked], arcs.weights[1][picked])
        self.face, self.tables, self.turning = face, kinds.tables, kinds.turning

    def proves(self, s: float, t: float, limits: Array) -> Any:
        """Which rows are at most their limits on [s, t]: by the whole piece, by one end, or by its middle."""
        low, high, falls, rises = self._bounds(lambda table, b: table.over(self.face * s * b, self.face * t * b), 4)
        most, smooth = self._largest(low, high, s, t)
        proved = self._total(most) <= limits
        square = self.steps * self.steps if smooth is None else np.where(smooth, self.steps * self.steps, 0.0)
        below, above = (falls, rises) if self.face > 0 else (-rises, -falls)
        least = -self._total(np.where(square == 0, 0.0, up(-below * square)))
        if np.any(rising := ~proved & (least >= 0)):
            proved |= rising & (self._at(t, most, smooth) <= limits)
        if np.all(proved):
            return proved
        highest = self._total(np.where(square == 0, 0.0, up(above * square)))
        if np.any(falling := ~proved & (highest <= 0)):
            proved |= falling & (self._at(s, most, smooth) <= limits)
        if np.all(proved):
            return proved
        half = (t - s) / 2 + t * 4 * _UNIT
        swing = up(np.maximum(np.maximum(highest, -least), 0.0) * half)
        return proved | (up(self._at((s + t) / 2, most, smooth) + swing) <= limits)

    def at(self, s: float) -> Array:
        """Upper bounds at one s."""
        low, high = self._bounds(lambda table, b: table.at(self.face * s * b), 2)
        return self._total(self._largest(low, high, s, s)[0])

    def _at(self, s: float, most: Array, smooth: Any) -> Array:
        """Upper bounds at one s where phi is the right end; elsewhere ``most``, which holds on a piece."""
        low, high = self._bounds(lambda table, b: table.at(self.face * s * b), 2)
        right = self._right(low, high)[1]
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

    def _right(self, low: Array, high: Array) -> tuple[Array, Array]:
        """The least and the largest step g for g in [low, high]."""
        rising, still = self.steps >= 0, self.steps == 0
        least = np.where(still, 0.0, down(self.steps * np.where(rising, low, high))) if self.turning else low
        return least, np.where(still, 0.0, up(self.steps * np.where(rising, high, low)))

    def _largest(self, low: Array, high: Array, s: float, t: float) -> tuple[Array, Any]:
        """Upper bounds of phi on [s, t] for g in [low, high] at right ends; where phi is the right end (None: all)."""
        least, most = self._right(low, high)
        if not self.turning:
            return most, None
        smooth = np.ones(len(most), dtype=bool)
        for (kind, face), each in self.turning.items():
            if face == self.face:
                mine = self.kinds == kind
                right = (least[mine], most[mine])
                most[mine], smooth[mine] = each.largest(self.steps[mine], self.reaches[mine], right, s, t)
        return most, smooth

    def _total(self, values: Array) -> Array:
        """Sums of w times values by row, rounded up: one addition per term, each within 2^-53 of the sum of sizes."""
        size = len(self.counts)
        if self.weights is not None:
            product = up(values * np.where(values >= 0, self.weights[1], self.weights[0]))
            values = np.where(values == 0, 0.0, product)
        total = np.bincount(self.rows, weights=values, minlength=size)
        sizes = np.bincount(self.rows, weights=np.abs(values), minlength=size)
        return np.where(sizes == 0, 0.0, up(total + up(sizes * (2 * (self.counts + 2) * _UNIT))))


def _floats(values: Sequence[Fraction], *, less: Fraction | None = None) -> tuple[Array, Array]:
    """Floats below and above the numbers, or these ``less`` something, equal where the number is a float.

    Equal objects are converted once.
    """
    if isinstance(values, Doubles) and less is None:
        return values.array, values.array
    places = np.fromiter(map(id, values), dtype=np.int64, count=len(values))
    _, first, inverse = np.unique(places, return_index=True, return_inverse=True)
    low, high = np.empty(len(first)), np.empty(len(first))
    for k, place in enumerate(first.tolist()):
        value = values[place] if less is None else values[place] - less
        exact = _float_or_none(value)
        low[k], high[k] = (float_below(value), float_above(value)) if exact is None else (exact, exact)
    return low[inverse], high[inverse]


def _float_or_none(value: Fraction) -> float | None:
    """The same number as a float where that is seen at once: few bits over a power of two, as v has them."""
    top, bottom = value.numerator, value.denominator
    if bottom & (bottom - 1) or bottom.bit_length() > _FLOAT_BITS or top.bit_length() > _FLOAT_BITS:
        return None
    return top / bottom
