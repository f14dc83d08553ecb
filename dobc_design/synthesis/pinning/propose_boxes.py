"""Proposals for the smallest gains with which the max-separable certificate of a box holds (theory, section 5).

Given v, a pinned agent needs k_i >= rate + (its largest row sum) / (s v_i), and the rows of the others have to hold as
they are.  The other rows have a least v for every choice of v on the pins; that choice is improved by linear programs
in log v with a trust region.  Floating point: a proposal.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import optimize, sparse

from dobc_design.conditions.separable.propose import LARGEST_RADIUS, Field, field_of, least_above
from dobc_design.exact.matrix import Vector
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array
from dobc_design.synthesis.pinning.request import PinningRequest

HELD = 1e9  # a gain, times the size of the rows, that holds an agent whatever the others do
FIRST_STEP, LAST_STEP = 0.3, 1e-5  # of log v: the trust region
WIDER, NARROWER = 2.0, 0.25
WORTH = 1e-7  # a relative gain in the cost that ends the search
# (agents, linear programs): what is worth the time
PROGRAMS = ((60, 60), (300, 40), (2000, 12))
COARSE = 8  # points of s while v is looked for; all of them for the gains
KEPT = 1e-6  # gains below this part of the largest are tried to be left out
DIGITS = (4, 6, 9, 12)  # of v
BITS = (20, 30)  # of v in large networks, whose arithmetic is binary
LARGE = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxProposal:
    """v (n,) exactly, min v = 1, and the gains (n,) that floating point finds enough for it (1/s)."""

    v: Vector
    gains: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """All rows without gains, and who may have one: ``allowed`` (n,), ``costs`` (n,), ``caps`` (n,) in 1/s."""

    field: Field
    allowed: Any
    costs: Array
    caps: Array
    rate: float

    def follow(self, lower: Array) -> Array | None:
        """The least v at or above ``lower``; on pins without a cap it is ``lower``.  None if none is found."""
        top = HELD * max(1.0, self.rate)
        gains = np.where(self.allowed, np.minimum(self.caps, top), 0.0)
        return least_above(replace(self.field, gains=gains), alpha=self.rate, lower=lower)

    def needs(self, v: Array) -> Array:
        """What every agent needs of a gain (1/s); negative where it needs none."""
        values: Array = self.field.rows(v, alpha=self.rate)[0] / v
        return values

    def gains(self, v: Array) -> Array:
        return np.where(self.allowed, np.maximum(self.needs(v), 0.0), 0.0)

    def cost(self, v: Array) -> float:
        return float(self.costs @ self.gains(v))


def propose_for_box(
    problem: Problem, request: PinningRequest, *, rho: Fraction | None, rate: float, near: Array | None = None
) -> Iterator[BoxProposal]:
    """Gains on the allowed agents with which the rows hold with ``rate`` for all s in (0, rho], the cheapest found.

    ``problem``: without gains.  ``rho`` None: couplings are linear.  ``near``: v (n,) > 0 to begin with, such as the
    best one near the consensus.  The same v is proposed with more and more digits.
    """
    if rho is not None and rho > LARGEST_RADIUS:
        return
    try:
        with np.errstate(all="ignore"):
            field = field_of(problem, rho=1.0 if rho is None else float(rho))
            costs = np.array([float(c) for c in request.costs])
            best = cheapest(box_of(field, request.allowed, request.caps, rate=rate, costs=costs), near)
            found = [] if best is None else _worth(*best, request.digits)
    except (ArithmeticError, ValueError):  # a coupling that is not defined so far out
        return
    for each, gains in found:
        yield BoxProposal(v=each, gains=tuple(gains.tolist()))


def box_of(
    field: Field, agents: Collection[int], caps: Mapping[int, Fraction], *, rate: float, costs: Array | None = None
) -> Box:
    """The rows of ``field`` (whose gains are 0) with gains on these agents; every gain costs 1 without ``costs``."""
    allowed = np.zeros(field.size, dtype=bool)
    allowed[list(agents)] = True
    return Box(
        field=field,
        allowed=allowed,
        costs=np.ones(field.size) if costs is None else costs,
        caps=np.array([float(caps.get(i, np.inf)) for i in range(field.size)]),
        rate=rate,
    )


def cheapest(box: Box, near: Array | None = None) -> tuple[Box, Array] | None:
    """The best v found, min v = 1, and the box with those agents allowed that need a gain for it; None without one.

    ``near``: v (n,) > 0 to begin with, besides v = 1.
    """
    starts = [np.ones(box.field.size), *([] if near is None else [np.where(box.allowed, near, np.min(near))])]
    most = next((count for size, count in PROGRAMS if box.field.size <= size), 0)
    coarse = replace(box, field=replace(box.field, grid=box.field.grid[:: max(1, len(box.field.grid) // COARSE)]))
    found = [v / np.min(v) for start in starts if (v := coarse.follow(start)) is not None]
    if not found:
        return None
    rough = _improved(coarse, min(found, key=coarse.cost), most)
    v = box.follow(np.where(box.allowed, rough, np.min(rough)))
    if v is None:
        return None
    gains = box.gains(v)
    kept = gains > KEPT * np.max(gains)
    fewer = replace(box, allowed=kept)
    less = fewer.follow(np.where(kept, v, 1.0))  # what the programs leave of gains that are not needed
    if less is not None and fewer.cost(less) <= float(box.costs @ gains) * (1 + 10 * KEPT):
        return fewer, less / np.min(less)
    return box, v / np.min(v)


def _improved(box: Box, v: Array, most: int) -> Array:
    """Linear programs in log v: steps are taken while they make the gains cheaper."""
    cost, step = box.cost(v), FIRST_STEP
    for _ in range(most):
        if step < LAST_STEP or not cost > 0:
            break
        change = _program(box, v, step)
        if change is None:
            step *= NARROWER
            continue
        moved = box.follow(np.where(box.allowed, v * np.exp(change), 1.0))
        if moved is not None:
            moved = moved / np.min(moved)  # the box shrinks with v: only cheaper
        value = np.inf if moved is None else box.cost(moved)
        if moved is None or not value < cost * (1 - WORTH / 10):
            step *= NARROWER
            continue
        if value > cost * (1 - WORTH):
            return moved
        step = min(1.0, step * WIDER)
        v, cost = moved, value
    return v


def _program(box: Box, v: Array, step: float) -> Array | None:
    """The change of log v, at most ``step``, that makes the gains cheapest to first order; None without an answer."""
    n = len(v)
    agents, slopes, values = _linear_rows(box, v, step)
    allowed = np.flatnonzero(box.allowed)
    column = np.full(n, -1)
    column[allowed] = np.arange(len(allowed))
    own = column[agents]
    mine = np.flatnonzero(own >= 0)
    part = sparse.csr_array((np.full(len(mine), -1.0), (mine, own[mine])), shape=(len(agents), len(allowed)))
    matrix = sparse.hstack([slopes, part], format="csr")
    low = np.maximum(-step, -np.log(np.maximum(v, 1.0)))
    bounds = np.concatenate(
        [np.column_stack([low, np.full(n, step)]), np.column_stack([np.zeros(len(allowed)), box.caps[allowed]])]
    )
    linear = np.concatenate([np.zeros(n), box.costs[allowed]])
    answer = optimize.linprog(linear, A_ub=matrix, b_ub=-(values + box.rate), bounds=bounds, method="highs")
    return None if answer.x is None or not np.all(np.isfinite(answer.x)) else np.asarray(answer.x[:n])


def _linear_rows(box: Box, v: Array, step: float) -> tuple[Any, Any, Array]:
    """The rows divided by v that may matter within the step: their agents, slopes in log v, and values."""
    field, n = box.field, len(v)
    agents, slopes, values, reach = [], [], [], []
    for mode in range(len(field.modes)):
        for face in (1, -1):
            table = field.values(mode, face, v) / v
            best = np.argmax(table, axis=0)
            other = np.where(best == len(table) - 1, 0, len(table) - 1)
            for places in (best, other):
                value = table[places, np.arange(n)]
                slope = sparse.diags_array(1 / v) @ field.slopes(mode, face, places, v) @ sparse.diags_array(v)
                slope = sparse.csr_array(slope - sparse.diags_array(value))
                agents.append(np.arange(n))
                slopes.append(slope)
                values.append(value)
                reach.append(step * np.asarray(abs(slope).sum(axis=1)).ravel())
    who, value, move = np.concatenate(agents), np.concatenate(values), np.concatenate(reach)
    least = np.full(n, -np.inf)
    np.maximum.at(least, who, value - move)
    active = value + move >= np.maximum(least[who], -box.rate)
    return who[active], sparse.vstack(slopes, format="csr")[active], value[active]


def _worth(box: Box, v: Array, digits: int) -> list[tuple[Vector, Array]]:
    """Roundings of v, each with its gains, that cost no more than the digits of the gains do; the last in any case."""
    found = [(each, box.gains(_floats(each))) for each in _rounded(v)]
    most = box.cost(v) * (1 + 10.0 ** (-digits))
    return [(each, gains) for each, gains in found[:-1] if box.costs @ gains <= most] + found[-1:]


def _rounded(v: Array) -> Iterator[Vector]:
    units = [2**bits for bits in BITS] if len(v) > LARGE else [10**digits for digits in DIGITS]
    for unit in units:
        yield tuple(Fraction(max(unit, round(float(x) * unit)), unit) for x in v)


def _floats(v: Vector) -> Array:
    return np.array([float(x) for x in v])
