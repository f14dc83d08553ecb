"""Pinning gains decided: do they reach the rate, can no gains reach it, and what do gains that reach it cost at least.

With Lambda0 = J + J', any gains k with Lambda0 - 2 K < -2 rate I satisfy, for all v_r and y >= 0 with
sum_r |v_r,i|^2 <= c_i + y_i on allowed agents (y_i = 0 without a cap),

    sum c_i k_i >= 1/2 sum_r (v_r' Lambda0 v_r + 2 rate v_r' v_r) - sum y_i cap_i

(weak duality: the multiplier Z = sum_r v_r v_r'/2 is semidefinite by its form).  The vectors are proposals; the
inequality is multiplied out over the rationals.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.consensus.negative import TOPS, Enclosed, find_witness, is_negative, refutes
from dobc_design.exact.matrix import Vector
from dobc_design.exact.symmetric import SparseSymmetric, Symmetric
from dobc_design.exact.zmatrix import proves
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.request import PinningRequest

ZERO = Fraction(0)
BITS = 40  # of the largest entry of a rounded multiplier
HINT_BITS = 50  # of the largest entry of a vector that shows definiteness
LARGEST = 300  # rows that are eliminated in the search for a witness
Vectors = Sequence[tuple[str, Any]]  # a mode, and numbers (n m) in a list or an array


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A request and what decides it: J + J' of every mode (``lambdas``, without any gain), exactly enclosed."""

    problem: Problem
    request: PinningRequest
    lambdas: Mapping[str, Enclosed]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """A proved lower bound of the cost at a rate, and what shows it: exact, to be multiplied out by anybody.

    ``vectors``: mode and v (n m).  ``loads``: sum_r |v_r,i|^2 of every agent.  ``cap_prices``: y_i > 0 by agent.
    ``rate_price``: at any other rate b the cost is at least value + rate_price (b - rate), by the same vectors.
    """

    value: Fraction
    rate: Fraction
    vectors: tuple[tuple[str, Vector], ...]
    loads: tuple[Fraction, ...]
    cap_prices: Mapping[int, Fraction]
    rate_price: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacle:
    """A direction v (n m) of one mode, v'(Lambda0 - 2 K + 2 rate I) v >= 0 for all gains within the limits."""

    mode: str
    vector: Vector


def reaches(ground: Ground, gains: Mapping[int, Fraction], rate: Fraction, *, hints: Vectors = ()) -> bool:
    """Whether Lambda0 - 2 K < -2 rate I is proved in every mode.  ``hints``: v > 0 that may show it quickly."""
    m = ground.problem.m
    size = ground.problem.n * m
    held = SparseSymmetric(size, {(i * m + c, i * m + c): -2 * k for i, k in gains.items() for c in range(m)})
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + held, deviations=enclosed.deviations)
        upper = matrix.middle.shifted(matrix.radius + 2 * rate).negated()
        if not _shown(upper, [v for name, v in hints if name == mode]) and not is_negative(matrix, shift=2 * rate):
            return False
    return True


def cost_of(request: PinningRequest, gains: Mapping[int, Fraction]) -> Fraction:
    """sum c_i k_i."""
    return sum((request.costs[i] * k for i, k in gains.items()), ZERO)


def bound_from(ground: Ground, vectors: Vectors, allowed: Collection[int], rate: Fraction) -> Bound:
    """The lower bound that proposed vectors prove, for gains on the ``allowed`` agents; each made to fit first."""
    request, m = ground.request, ground.problem.m
    top = max((abs(x) for _, v in vectors for x in v), default=0.0)
    if not 0 < top < float("inf"):
        return Bound(
            value=ZERO, rate=rate, vectors=(), loads=(ZERO,) * ground.problem.n, cap_prices={}, rate_price=ZERO
        )
    unit = Fraction(2) ** _exponent(top)
    rows = [(mode, [round(Fraction(x) / unit) for x in v]) for mode, v in vectors]
    loads, prices = [ZERO] * ground.problem.n, {}
    free = set(allowed)
    for i in range(ground.problem.n):
        load = _load(rows, i, m) * unit * unit
        if i in free and load > request.costs[i]:
            if i in request.caps:
                prices[i] = load - request.costs[i]
            else:
                _shrink(rows, i, m, request.costs[i] / load)
                load = _load(rows, i, m) * unit * unit
        loads[i] = load
    exact = tuple((mode, tuple(x * unit for x in v)) for mode, v in rows)
    squares = sum(loads, ZERO)
    value = sum((ground.lambdas[mode].value(v).lo for mode, v in exact), ZERO) / 2 + rate * squares
    value -= sum((price * request.caps[i] for i, price in prices.items()), ZERO)
    return Bound(
        value=max(value, ZERO), rate=rate, vectors=exact, loads=tuple(loads), cap_prices=prices, rate_price=squares
    )


def bound_holds(ground: Ground, bound: Bound, allowed: Collection[int]) -> bool:
    """Whether a bound is one: its vectors fit the costs, and multiplied out they give at least its value.  Exact."""
    request, m = ground.request, ground.problem.m
    loads = [
        sum((x * x for _, v in bound.vectors for x in v[i * m : (i + 1) * m]), ZERO) for i in range(ground.problem.n)
    ]
    if any(price < 0 or i not in request.caps for i, price in bound.cap_prices.items()):
        return False
    if any(loads[i] > request.costs[i] + bound.cap_prices.get(i, ZERO) for i in allowed):
        return False
    value = sum((ground.lambdas[mode].value(v).lo for mode, v in bound.vectors), ZERO) / 2 + bound.rate * sum(loads)
    value -= sum((price * request.caps[i] for i, price in bound.cap_prices.items()), ZERO)
    return max(value, ZERO) >= bound.value


def obstacle_to(ground: Ground, allowed: Collection[int], rate: Fraction, candidates: Vectors = ()) -> Obstacle | None:
    """A direction that no gains on the ``allowed`` agents hold at this rate, or None if none was found.

    Gains with a cap stand at it, which is best; the direction is 0 on agents whose gain has no cap.
    """
    request, m = ground.request, ground.problem.m
    size = ground.problem.n * m
    free = set(allowed) - set(request.caps)
    rows = [row for row in range(size) if row // m not in free]
    held = {(i * m + c, i * m + c): -2 * request.caps[i] for i in set(allowed) & set(request.caps) for c in range(m)}
    added = SparseSymmetric(size, held).shifted(2 * rate)
    for mode, enclosed in ground.lambdas.items():
        matrix = Enclosed(middle=enclosed.middle + added, deviations=enclosed.deviations)
        own = [v for name, v in candidates if name == mode and len(v) == size]
        fitting = [[x if row // m not in free else 0.0 for row, x in enumerate(v)] for v in own]
        vector = _rounded(matrix, fitting)
        if vector is None and len(rows) <= LARGEST:
            vector = find_witness(matrix, fitting, rows=rows)
        if vector is not None:
            return Obstacle(mode=mode, vector=vector)
    return None


def obstacle_holds(ground: Ground, obstacle: Obstacle, allowed: Collection[int], rate: Fraction) -> bool:
    """Whether an obstacle is one.  Exact."""
    request, m, v = ground.request, ground.problem.m, obstacle.vector
    free = set(allowed) - set(request.caps)
    if not any(v) or any(x for row, x in enumerate(v) if row // m in free):
        return False
    value = ground.lambdas[obstacle.mode].value(v).lo + 2 * rate * sum((x * x for x in v), ZERO)
    capped = set(allowed) & set(request.caps)
    return value >= 2 * sum((request.caps[row // m] * x * x for row, x in enumerate(v) if row // m in capped), ZERO)


def _rounded(matrix: Enclosed, candidates: Iterable[Sequence[float]]) -> Vector | None:
    for candidate in candidates:
        largest = max((abs(x) for x in candidate), default=0.0)
        for top in (*TOPS, 10**9) if 0 < largest < float("inf") else ():
            vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
            if refutes(matrix, vector):
                return vector
    return None


def _shown(upper: Symmetric, hints: Sequence[Sequence[float]]) -> bool:
    if not hints or any(len(each) != upper.size for each in hints):
        return False
    total = [sum(column) for column in zip(*hints, strict=True)]
    top = max(total, default=0.0)
    if not 0 < top < float("inf"):
        return False
    return proves(upper, [round(x / top * 2**HINT_BITS) for x in total])


def _load(rows: Sequence[tuple[str, Sequence[int]]], agent: int, m: int) -> int:
    return sum(x * x for _, v in rows for x in v[agent * m : (agent + 1) * m])


def _shrink(rows: Sequence[tuple[str, list[int]]], agent: int, m: int, part: Fraction) -> None:
    """Multiply the rows of one agent by ``part`` < 1, towards 0: part <= sqrt(part), so that squares fit."""
    for _, v in rows:
        for row in range(agent * m, (agent + 1) * m):
            size = abs(v[row]) * part.numerator // part.denominator
            v[row] = size if v[row] > 0 else -size


def _exponent(top: float) -> int:
    fraction = Fraction(top)
    return fraction.numerator.bit_length() - fraction.denominator.bit_length() - BITS
