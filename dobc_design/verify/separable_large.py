"""Rows of the max-separable certificate for very many arcs: float arithmetic with outward bounds.

For couplings that are nondecreasing as far as the rows look.  A row that is reported as proved is proved; what is left
is for ``separable_rows``.  The subdivision of s and its bounds are the same as there, for all rows at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np

from dobc_design.exact.number import float_above, float_below
from dobc_design.spec.problem import Problem
from dobc_design.theorems.separable import FACES, holding_gains
from dobc_design.verify.separable_table import Array, GainTable, down, up

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

    ``steps`` are at least v_j - v_i; ``weights`` and ``own`` (v) are lower and upper bounds.
    """

    start: Any
    steps: Array
    weights: tuple[Array, Array]
    kinds: Any
    own: tuple[Array, Array]
    gains: tuple[Fraction, ...]


def arc_rows(problem: Problem, v: Sequence[Fraction], mode: str, *, stretch: Fraction | int = 1) -> ArcRows:
    """Bring one mode into arrays, rounded so that rows only become harder to satisfy."""
    arcs = problem.network.modes[mode]
    order = np.argsort(arcs.listeners, kind="stable")
    listeners, speakers = arcs.listeners[order], arcs.speakers[order]
    low, high = _floats(v)
    heard = high if stretch == 1 else _floats([stretch * x for x in v])[1]
    steps = heard[speakers] - low[listeners]
    # The difference of two floats within a factor of two of each other has no rounding.
    near = (heard[speakers] <= 2 * low[listeners]) & (low[listeners] <= 2 * heard[speakers])
    weights = _floats(arcs.weights)
    place = {coupling: number for number, coupling in enumerate(problem.couplings)}
    kinds = np.zeros(len(arcs), dtype=np.int64)
    codes = arcs.listeners * problem.n + arcs.speakers
    for (i, j), coupling in problem.exceptions.items():
        kinds[codes == i * problem.n + j] = place[coupling]
    return ArcRows(
        start=np.searchsorted(listeners, np.arange(problem.n + 1)),
        steps=np.where(near, steps, up(steps)),
        weights=(weights[0][order], weights[1][order]),
        kinds=kinds[order],
        own=(low, high),
        gains=holding_gains(problem),
    )


def open_rows(arcs: ArcRows, tables: Sequence[GainTable], *, alpha: Fraction, rho: Fraction) -> list[tuple[int, int]]:
    """The (agent, face) whose row is not proved for all s in (0, rho]; ``tables`` reach to rho max |steps|."""
    rates = _floats(arcs.gains, less=alpha)[0]
    limits = np.where(rates >= 0, rates * arcs.own[0], rates * arcs.own[1])
    limits = np.where(rates == 0, 0.0, down(limits))
    with np.errstate(invalid="ignore", over="ignore"):  # cells beyond the table are infinite and prove nothing
        return [
            (agent, face) for face in FACES for agent in _open(arcs, limits, face, tables, float_above(rho)).tolist()
        ]


def estimated_rate(arcs: ArcRows, tables: Sequence[GainTable], *, rho: Fraction) -> float:
    """The least rate that a few values of s show: an estimate of the largest that can be proved."""
    gains = np.array([float(k) for k in arcs.gains])
    agents = np.arange(len(gains))
    least = np.inf
    with np.errstate(invalid="ignore", over="ignore"):
        for face in FACES:
            piece = _Piece(arcs, face, tables, agents)
            for part in _SAMPLES:
                least = min(least, float(np.min(gains - piece.at(part * float(rho)) / arcs.own[1])))
    return least


def _open(arcs: ArcRows, limits: Array, face: int, tables: Sequence[GainTable], rho: float) -> Any:
    """Rows that are not proved after the subdivision of s."""
    failed: list[Any] = []
    waiting = [(0.0, rho, np.arange(len(limits)))]
    count = 0
    while waiting:
        s, t, agents = waiting.pop()
        count += 1
        agents = agents[~_Piece(arcs, face, tables, agents).proves(s, t, limits[agents])]
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

    def __init__(self, arcs: ArcRows, face: int, tables: Sequence[GainTable], agents: Any) -> None:
        self.counts = arcs.start[agents + 1] - arcs.start[agents]
        ends = np.cumsum(self.counts)
        self.rows = np.repeat(np.arange(len(agents)), self.counts)
        picked = np.arange(len(self.rows)) + np.repeat(arcs.start[agents] - ends + self.counts, self.counts)
        self.steps, self.kinds = arcs.steps[picked], arcs.kinds[picked]
        self.weights = (arcs.weights[0][picked], arcs.weights[1][picked])
        self.face, self.tables = face, tables

    def proves(self, s: float, t: float, limits: Array) -> Any:
        """Which rows are at most their limits on [s, t]: by the whole piece, by one end, or by its middle."""
        low, high, falls, rises = self._bounds(lambda table, b: table.over(self.face * s * b, self.face * t * b), 4)
        proved = self._total(self._largest(low, high)) <= limits
        if np.all(proved):
            return proved
        square = self.steps * self.steps
        below, above = (falls, rises) if self.face > 0 else (-rises, -falls)
        least = -self._total(self._weighted(up(-below * square)))
        most = self._total(self._weighted(up(above * square)))
        proved |= (least >= 0) & (self.at(t) <= limits)
        proved |= (most <= 0) & (self.at(s) <= limits)
        half = (t - s) / 2 + t * 4 * _UNIT
        swing = up(np.maximum(np.maximum(most, -least), 0.0) * half)
        return proved | (up(self.at((s + t) / 2) + swing) <= limits)

    def at(self, s: float) -> Array:
        """Upper bounds at one s."""
        low, high = self._bounds(lambda table, b: table.at(self.face * s * b), 2)
        return self._total(self._largest(low, high))

    def _bounds(self, look: Callable[[GainTable, Array], Any], width: int) -> Any:
        """Bounds from the table of each arc's coupling."""
        if len(self.tables) == 1:
            return look(self.tables[0], self.steps)
        result = np.zeros((width, len(self.steps)))
        for kind, table in enumerate(self.tables):
            mine = self.kinds == kind
            result[:, mine] = look(table, self.steps[mine])
        return tuple(result)

    def _largest(self, low: Array, high: Array) -> Array:
        """The largest w step g for g in [low, high]."""
        largest = up(self.steps * np.where(self.steps >= 0, high, low))
        return self._weighted(np.where(self.steps == 0, 0.0, largest))

    def _weighted(self, value: Array) -> Array:
        product = up(value * np.where(value >= 0, self.weights[1], self.weights[0]))
        return np.where(value == 0, 0.0, product)

    def _total(self, terms: Array) -> Array:
        """Sums by row, rounded up: as many additions as terms, each within 2^-53 of the sum of sizes."""
        size = len(self.counts)
        total = np.bincount(self.rows, weights=terms, minlength=size)
        sizes = np.bincount(self.rows, weights=np.abs(terms), minlength=size)
        return np.where(sizes == 0, 0.0, up(total + up(sizes * (2 * (self.counts + 2) * _UNIT))))


def _floats(values: Sequence[Fraction], *, less: Fraction | None = None) -> tuple[Array, Array]:
    """Floats below and above the numbers, or these ``less`` something, equal where the number is a float.

    Equal objects are converted once.
    """
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
