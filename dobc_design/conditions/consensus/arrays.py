"""Lambda(J) of a large network in arrays of integers: the matrix of ``conditions.lemma1``, fifty times smaller.

Slopes are exact where a common denominator of 512 bits holds them all; irrational ones, and rational ones without such
a denominator, become the nearest float with a deviation that reaches over their whole enclosure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, overload

import numpy as np

from dobc_design.conditions.consensus.jacobians import ModeJacobian
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.pencil import Deviation, Pencil
from dobc_design.exact.symmetric import DENOMINATOR_BITS, Integers, IntegerSymmetric, Places, as_integers
from dobc_design.problem.pinning import Pinning

#: Rows n m, and arcs times m^2, beyond which Lambda is stated in arrays.
LARGE_ROWS: Final = 2000
LARGE_ENTRIES: Final = 20_000
Triplets = tuple[Places, Places, Integers]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations(Sequence[Deviation]):
    """Deviations of very many arcs: number a stands at rows[a], speakers[a], listeners[a] and has sizes[kinds[a]]."""

    rows: Places
    speakers: Places
    listeners: Places
    kinds: Places
    sizes: tuple[Fraction, ...]

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, place: int) -> Deviation: ...

    @overload
    def __getitem__(self, place: slice) -> list[Deviation]: ...

    def __getitem__(self, place: int | slice) -> Deviation | list[Deviation]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        row, speaker, listener = (int(each[place]) for each in (self.rows, self.speakers, self.listeners))
        return Deviation(row, speaker, listener, self.sizes[int(self.kinds[place])])


def is_large(jacobian: ModeJacobian, *, size: int, dimension: int) -> bool:
    """Whether this mode is to be stated in arrays."""
    return size * dimension > LARGE_ROWS or len(jacobian.arcs) * dimension**2 > LARGE_ENTRIES


def lemma1_in_arrays(jacobian: ModeJacobian, pinning: Pinning, *, size: int, dimension: int) -> Pencil | None:
    """``conditions.lemma1`` with an IntegerSymmetric; None if the gains have no common denominator of 512 bits.

    Both forms enclose the same matrices; middles and deviations of inexact slopes may differ.
    """
    held = {id(k): _symmetric(k) for k in pinning.gains.values()}  # agents often share one matrix
    below = _common((x for rows in held.values() for row in rows for x in row), 1)
    if below is None:
        return None
    middles, spreads = _slopes(jacobian, below)
    common = math.lcm(below, *{x.denominator for each in middles for row in each for x in row})
    parts = [*_pins(pinning, held, common, dimension), *_arcs(jacobian, middles, common, dimension)]
    rows, columns, values = (np.concatenate([part[k] for part in parts] or [_NOTHING]) for k in range(3))
    return Pencil(
        name=f"lemma1 ({jacobian.name})",
        constant=IntegerSymmetric(size=size * dimension, rows=rows, columns=columns, values=values, denominator=common),
        unknowns=(),
        coefficients={},
        deviations=_deviations(jacobian, spreads, dimension),
    )


_NOTHING: Final = np.zeros(0, dtype=np.int64)


def _common(numbers: Iterable[Fraction], start: int) -> int | None:
    """The least common denominator of these and of ``start``; None beyond 512 bits."""
    common = start
    for denominator in {x.denominator for x in numbers}:
        common = math.lcm(common, denominator)
        if common.bit_length() > DENOMINATOR_BITS:
            return None
    return common


def _symmetric(k: Matrix) -> Matrix:
    return tuple(tuple(x + k[d][c] for d, x in enumerate(row)) for c, row in enumerate(k))


def _slopes(jacobian: ModeJacobian, below: int) -> tuple[list[Matrix], list[Matrix]]:
    """Middle and half width of every gain; exact ones are kept if that costs no long denominator."""
    entries = [entry for gain in jacobian.gains for row in gain for entry in row]
    exact = _common((entry.lo for entry in entries if entry.is_point), below) is not None
    middles = [tuple(tuple(_middle(entry, exact) for entry in row) for row in gain) for gain in jacobian.gains]
    spreads = [
        tuple(
            tuple(max(entry.hi - x, x - entry.lo) for entry, x in zip(row, own, strict=True))
            for row, own in zip(gain, middle, strict=True)
        )
        for gain, middle in zip(jacobian.gains, middles, strict=True)
    ]
    return middles, spreads


def _middle(entry: Interval, exact: bool) -> Fraction:
    middle = entry.midpoint
    try:
        return middle if exact and entry.is_point else Fraction(float(middle))
    except OverflowError:  # beyond the floats
        return middle


def _pins(pinning: Pinning, held: dict[int, Matrix], common: int, dimension: int) -> Iterable[Triplets]:
    """-(K + K'), on and above the diagonal."""
    agents = np.fromiter(pinning.gains, dtype=np.int64, count=len(pinning.gains)) * dimension
    kinds = {key: kind for kind, key in enumerate(held)}
    kind = np.fromiter((kinds[id(k)] for k in pinning.gains.values()), dtype=np.int64, count=len(agents))
    for c in range(dimension):
        for d in range(c, dimension):
            table = as_integers([int(-common * rows[c][d]) for rows in held.values()])
            if table.any():
                yield agents + c, agents + d, table[kind]


def _arcs(jacobian: ModeJacobian, middles: Sequence[Matrix], common: int, dimension: int) -> Iterable[Triplets]:
    """J + J' of every arc, on and above the diagonal: the slope at (row, speaker), minus it at (row, listener)."""
    listeners, speakers = jacobian.arcs.listeners * dimension, jacobian.arcs.speakers * dimension
    for c in range(dimension):
        for d in range(dimension):
            whole = [int(common * each[c][d]) for each in middles]
            if any(whole):
                row, off, own = listeners + c, speakers + d, listeners + d
                yield np.minimum(row, off), np.maximum(row, off), as_integers(whole)[jacobian.kind]
                twice = as_integers([-2 * x if c == d else -x for x in whole])
                yield np.minimum(row, own), np.maximum(row, own), twice[jacobian.kind]


def _deviations(jacobian: ModeJacobian, spreads: Sequence[Matrix], dimension: int) -> Sequence[Deviation]:
    columns: list[tuple[Any, Any, Any, Any]] = []
    for c in range(dimension):
        for d in range(dimension):
            chosen = np.array([bool(each[c][d]) for each in spreads], dtype=bool)[jacobian.kind]
            listeners, speakers = jacobian.arcs.listeners[chosen], jacobian.arcs.speakers[chosen]
            kinds = (jacobian.kind[chosen] * dimension + c) * dimension + d
            columns.append((listeners * dimension + c, speakers * dimension + d, listeners * dimension + d, kinds))
    rows, speakers, listeners, kinds = (np.concatenate(column) for column in zip(*columns, strict=True))
    if not len(rows):
        return ()
    return Deviations(
        rows=rows,
        speakers=speakers,
        listeners=listeners,
        kinds=kinds,
        sizes=tuple(x for each in spreads for row in each for x in row),
    )
