"""What gains of a max-separable certificate cost at least, and why none may do: rows near the consensus, exactly.

With s -> 0 every row says, for some v > 0 and whatever the radius,

    k_i >= rate - sum_j a_ij + sum_j a_ij v_j / v_i          a_ij = w h_ij'(0) >= 0, in every mode.

Weights q >= 0 of the rows, sum over modes <= c_i + y_i on allowed agents, and flows 0 <= f_ij <= q_i a_ij v_j / v_i
that are balanced (as much out of every agent as into it) then prove, for every other v' as well,

    sum c_i k_i >= sum q_i (rate - sum_j a_ij) + sum f_ij - sum y_i cap_i

because the mean of the logarithms of (v'_j/v_j)/(v'_i/v_i), weighted by f, is 0.  Nothing here is rounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.exact.matrix import Vector
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.pinning.request import PinningRequest

ZERO = Fraction(0)
Pair = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class NearRows:
    """The rows near the consensus of one mode: a_ij from below by (listener, speaker), their sums from above (n,)."""

    arcs: Mapping[Pair, Fraction]
    sums: tuple[Fraction, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxBound:
    """A proposed lower bound of the cost: weights by mode (n,), v (n,), flows by arc; see the module's text."""

    weights: Mapping[str, Vector]
    v: Vector
    flows: Mapping[Pair, Fraction]


def near_rows(problem: Problem) -> dict[str, NearRows] | None:
    """The rows of every mode; None where a slope at 0 is missing or may be negative."""
    slopes = {}
    for coupling in problem.couplings:
        try:
            slope = coupling.jacobian_at_zero()[0][0]
        except (ArithmeticError, ValueError):
            return None
        if slope.lo < 0:
            return None
        slopes[coupling] = slope
    found = {}
    for mode, arcs in problem.network.modes.items():
        below: dict[Pair, Fraction] = {}
        above = [ZERO] * problem.n
        for i, j, weight in arcs:
            slope = slopes[problem.coupling_of(i, j)]
            below[i, j] = below.get((i, j), ZERO) + weight * slope.lo
            above[i] += weight * slope.hi
        found[mode] = NearRows(arcs=below, sums=tuple(above))
    return found


def bound_value(rows: Mapping[str, NearRows], request: PinningRequest, bound: BoxBound) -> Fraction | None:
    """What the bound proves of sum c_i k_i, at least 0; None if it does not fit.  Exact."""
    n = len(request.costs)
    if not set(bound.weights) <= set(rows) or len(bound.v) != n or min(bound.v) <= 0:
        return None
    if any(len(q) != n or min(q) < 0 for q in bound.weights.values()):
        return None
    if not _flows_fit(rows, bound) or not is_balanced(bound.flows, n):
        return None
    value = sum(bound.flows.values(), ZERO)
    for mode, q in bound.weights.items():
        value += sum((x * (request.rate - total) for x, total in zip(q, rows[mode].sums, strict=True)), ZERO)
    for i in request.allowed:
        price = sum((q[i] for q in bound.weights.values()), ZERO) - request.costs[i]
        if price > 0:
            if i not in request.caps:
                return None
            value -= price * request.caps[i]
    return max(value, ZERO)


def holds_nobody(rows: Mapping[str, NearRows], request: PinningRequest, weights: Mapping[str, Vector]) -> bool:
    """Whether weights p >= 0 of rows of agents without an uncapped gain show that no v > 0 satisfies all rows.  Exact.

    sum p_i ( (rate - sum_j a_ij - cap_i) v_i + sum_j a_ij v_j ) is then >= 0 in every v_j and > 0 in one of them.
    """
    n = len(request.costs)
    column = [ZERO] * n
    free = set(request.allowed) - set(request.caps)
    capped = set(request.allowed) & set(request.caps)
    for mode, p in weights.items():
        if mode not in rows or len(p) != n or min(p) < 0 or any(p[i] for i in free):
            return False
        for i, x in enumerate(p):
            column[i] += x * (request.rate - rows[mode].sums[i] - (request.caps[i] if i in capped else ZERO))
        for (i, j), a in rows[mode].arcs.items():
            column[j] += p[i] * a
    return min(column) >= 0 and max(column) > 0


def is_balanced(flows: Mapping[Pair, Fraction], n: int) -> bool:
    """Whether all flows are >= 0 and as much goes out of every agent as into it."""
    balance = [ZERO] * n
    for (i, j), flow in flows.items():
        if flow < 0:
            return False
        balance[i] += flow
        balance[j] -= flow
    return not any(balance)


def _flows_fit(rows: Mapping[str, NearRows], bound: BoxBound) -> bool:
    """f_ij <= sum over modes of q_i a_ij v_j / v_i."""
    room: dict[Pair, Fraction] = {}
    for mode, q in bound.weights.items():
        for (i, j), a in rows[mode].arcs.items():
            if q[i] and (i, j) in bound.flows:
                room[i, j] = room.get((i, j), ZERO) + q[i] * a
    v: Sequence[Fraction] = bound.v
    return all(flow * v[i] <= room.get((i, j), ZERO) * v[j] for (i, j), flow in bound.flows.items())
