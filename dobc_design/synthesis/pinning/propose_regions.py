"""Proposals for gains over a region: the smallest ones with which a max-separable v exists (theory,
section 5).

A pinned agent needs k_i >= rate + (its largest row sum) / (s v_i); the other rows have a least v
for every v on the pins, which is improved by linear programs in log v with a trust region.  Which
rates gains can reach is found by bisection; one linear solve gives what a faster rate costs and
which other agent a gain would help most.
"""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import optimize
from scipy.sparse import csr_array, diags_array, eye_array, hstack, vstack

from dobc_design._checks import noun
from dobc_design.conditions.numbers import claimed, last_found, quickly_down
from dobc_design.conditions.observer.propose import decay_of_error
from dobc_design.conditions.separable.claim import EXACT, ErrorBound, stated_errors
from dobc_design.conditions.separable.propose import (
    LARGEST_RADIUS,
    Field,
    SeparablePlan,
    field_of,
    least_above,
    rounded_vectors,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.exact.matrix import Array, Matrix, Vector
from dobc_design.exact.number import ONE
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import factored

from .claim import AgentSet, Gains, PinningRequest

HELD = 1e9  # a gain, times the size of the rows, that holds an agent whatever the others do
FIRST_STEP, LAST_STEP = 0.3, 1e-5  # of log v: the trust region
WIDER, NARROWER = 2.0, 0.25
WORTH = 1e-7  # a relative gain in the cost that ends the search
# (agents, linear programs): what is worth the time
PROGRAMS = ((60, 60), (300, 40), (2000, 12))
KEPT = 1e-6  # gains below this part of the largest are tried to be left out
HARD = 1e7  # a gain that holds an agent as well as any, in units of the network's own gains
LARGEST_V = 1e4  # what a v may span: beyond, gains are of no use to anybody
CLOSE, ROUGH = 1e-3, 2e-2  # relative accuracy of the fastest rate, and where many sets are compared
BISECTIONS = 14
# of the observer's decay, for kappa
PARTS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
PER_TICK = 0.99  # of 1/T, above which no rate per tick lies
BELOW = 0.98  # of the slopes at which an agent may overshoot, for gains that are rounded up
# points of s while v is looked for and where many sets are compared; all of them for the gains
COARSE = 8


@noun(eq=False)
class Box:
    """All rows without gains, and who may have one: ``allowed`` (n,), ``costs`` (n,), ``caps`` (n,)
    in 1/s."""

    field: Field
    allowed: Any
    costs: Array
    caps: Array
    rate: float

    def follow(self, lower: Array) -> Array | None:
        """The least v at or above ``lower``; on pins without a cap it is ``lower``.  None if none
        is found."""
        largest = np.minimum(self.caps, HELD * max(1.0, self.rate))
        held = replace(self.field, gains=np.where(self.allowed, largest, 0.0))
        return least_above(held, alpha=self.rate, lower=lower)

    def gains(self, v: Array) -> Array:
        """What the rows of the allowed agents need, with this v."""
        rows = self.field.rows(v, alpha=self.rate)[0]
        return np.where(self.allowed, np.maximum(rows / v, 0.0), 0.0)

    def cost(self, v: Array) -> float:
        """The cost of the gains for this v."""
        return float(self.costs @ self.gains(v))


def propose_for_box(
    problem: Problem, request: PinningRequest, *, rho: Fraction | None, rate: float
) -> list[tuple[Vector | Doubles, Array]]:
    """v (n,), exact with min v = 1, and gains (n,) for it with which the rows hold with ``rate``
    for all s in (0, rho]. The cheapest v with more and more digits, if rounding makes the gains no
    dearer than their own digits do, and the last in any case.  ``problem``: without gains.  ``rho``
    None: couplings are linear."""
    far = ONE if rho is None else rho
    if far > LARGEST_RADIUS:
        return []
    try:
        with np.errstate(all="ignore"):
            field = field_of(loop_of(problem), rho=float(far))
            costs = np.array([float(c) for c in request.costs])
            best = cheapest(box_of(field, request.allowed, request.caps, rate=rate, costs=costs))
            if best is None:
                return []
            box, v = best
            plan = SeparablePlan(v=v, rate=rate, rho=far)
            found = []
            for typed in rounded_vectors(plan):
                found.append((typed, box.gains(np.array(typed, dtype=float))))
            most = box.cost(v) * (1 + 10.0 ** (-request.digits))
    except (ArithmeticError, ValueError):  # a coupling that is not defined so far out
        return []
    *short, last = found
    return [*(each for each in short if box.costs @ each[1] <= most), last]


def box_of(
    field: Field, agents: AgentSet, caps: Gains, *, rate: float, costs: Array | None = None
) -> Box:
    """The rows of ``field`` (whose gains are 0) with gains on these agents; every gain costs 1
    without ``costs``."""
    allowed = np.zeros(field.size, dtype=bool)
    allowed[list(agents)] = True
    if costs is None:
        costs = np.ones(field.size)
    limits = np.array([float(caps.get(i, np.inf)) for i in range(field.size)])
    return Box(field=field, allowed=allowed, costs=costs, caps=limits, rate=rate)


def cheapest(box: Box) -> tuple[Box, Array] | None:
    """The best v found, min v = 1, and the box with those agents allowed that need a gain for it;
    None without one."""
    field = box.field
    most = next((count for size, count in PROGRAMS if field.size <= size), 0)
    coarse = replace(box, field=_coarse(field))
    start = coarse.follow(np.ones(field.size))
    if start is None:
        return None
    rough = _improved(coarse, start / np.min(start), most)
    v = box.follow(np.where(box.allowed, rough, np.min(rough)))
    if v is None:
        return None
    gains = box.gains(v)
    kept = gains > KEPT * np.max(gains)
    fewer = replace(box, allowed=kept)
    # what the programs leave of gains that are not needed
    less = fewer.follow(np.where(kept, v, 1.0))
    if less is not None and fewer.cost(less) <= float(box.costs @ gains) * (1 + 10 * KEPT):
        return fewer, less / np.min(less)
    return box, v / np.min(v)


def _coarse(field: Field) -> Field:
    """The same rows at fewer points of s."""
    step = max(1, len(field.grid) // COARSE)
    return replace(field, grid=field.grid[::step])


def _improved(box: Box, v: Array, most: int) -> Array:
    """Linear programs in log v: steps are taken while they make the gains cheaper."""
    cost = box.cost(v)
    step = FIRST_STEP
    for _ in range(most):
        if step < LAST_STEP or not cost > 0:
            break
        change = _program(box, v, step)
        moved = None
        if change is not None:
            moved = box.follow(np.where(box.allowed, v * np.exp(change), 1.0))
        value = np.inf
        if moved is not None:
            moved = moved / np.min(moved)  # the box shrinks with v: only cheaper
            value = box.cost(moved)
        if moved is None or not value < cost * (1 - WORTH / 10):
            step *= NARROWER
            continue
        if value > cost * (1 - WORTH):
            return moved
        v = moved
        cost = value
        step = min(1.0, step * WIDER)
    return v


def _program(box: Box, v: Array, step: float) -> Array | None:
    """The change of log v, at most ``step``, that makes the gains cheapest to first order; None
    without an answer."""
    n = len(v)
    allowed = np.flatnonzero(box.allowed)
    rows = _rows_in_reach(box, v, step)
    gains = -eye_array(n, format="csc")[:, allowed].tocsr()[rows.agents]
    # log v stays at or above 0, gains between 0 and their caps
    lowest = np.maximum(-step, -np.log(np.maximum(v, 1.0)))
    low = np.concatenate([lowest, np.zeros(len(allowed))])
    high = np.concatenate([np.full(n, step), box.caps[allowed]])
    answer = optimize.linprog(
        np.concatenate([np.zeros(n), box.costs[allowed]]),
        A_ub=hstack([rows.slopes, gains], format="csr"),
        b_ub=-(rows.values + box.rate),
        bounds=np.column_stack([low, high]),
        method="highs",
    )
    if answer.x is None or not np.all(np.isfinite(answer.x)):
        return None
    return np.asarray(answer.x[:n])


@noun(eq=False)
class _LinearRows:
    """Rows divided by v: their ``agents`` (r,), ``slopes`` (r, n) in log v and ``values`` (r,)."""

    agents: Any
    slopes: Any
    values: Array


def _rows_in_reach(box: Box, v: Array, step: float) -> _LinearRows:
    """The rows that may be the largest of their agent within the step."""
    parts = list(_linear_rows(box.field, v))
    agents = np.tile(np.arange(len(v)), len(parts))
    values = np.concatenate([part.values for part in parts])
    sums = [np.asarray(abs(part.slopes).sum(axis=1)).ravel() for part in parts]
    moves = np.concatenate([step * each for each in sums])
    least = np.full(len(v), -np.inf)
    np.maximum.at(least, agents, values - moves)
    active = values + moves >= np.maximum(least[agents], -box.rate)
    slopes = vstack([part.slopes for part in parts], format="csr")
    return _LinearRows(agents=agents[active], slopes=slopes[active], values=values[active])


def _linear_rows(field: Field, v: Array) -> Iterator[_LinearRows]:
    """Of both faces in every mode the rows at the worst point of s, and at an end of the others."""
    agents = np.arange(len(v))
    for mode in range(len(field.modes)):
        for face in (1, -1):
            table = field.values(mode, face, v) / v
            last = len(table) - 1
            worst = np.argmax(table, axis=0)
            end = np.where(worst == last, 0, last)
            for places in (worst, end):
                values = table[places, agents]
                slopes = field.slopes(mode, face, places, v)
                in_logs = diags_array(1 / v) @ slopes @ diags_array(v)
                own = csr_array(in_logs - diags_array(values))
                yield _LinearRows(agents=agents, slopes=own, values=values)


@noun(eq=False)
class RegionGains:
    """Gains (1/s) by agent index that reach ``rate`` (1/s), about.  ``prices``: by agent, what the
    whole sum of gains would fall by for each 1/s of gain there (1 for pinned agents that are at
    their optimum).  ``rate_price``: what the sum rises by for each 1/s of rate."""

    gains: dict[int, float]
    rate: float
    prices: Array
    rate_price: float


@dataclass(kw_only=True, eq=False)
class RegionSearch:
    """One problem without its gains, one W (q, m), caps of the gains, one region: |e|_inf <=
    radius, |eps_i| <= disturbance."""

    problem: Problem
    W: Matrix | None
    caps: Gains
    radius: Fraction
    disturbance: Fraction
    _bounds: dict[float, ErrorBound | None] = field(default_factory=dict)
    _fields: dict[float, Field] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.exosystem = self.problem.joint_exosystem
        self.timing = loop_of(self.problem).timing or Timing()
        self.decay = math.inf
        if self.timing.period:
            self.decay = PER_TICK / float(self.timing.period)
        if self.exosystem is not None and self.W is not None:
            observer = decay_of_error(self.exosystem, self.W, self.timing)
            self.decay = min(self.decay, observer)
        rho = self.reach(0.0)
        if self.timing.steepest is not None and rho is not None:
            self.caps = late_caps(self._field(rho), self.timing, self.caps)

    def reach(self, rate: float) -> Fraction | None:
        """The rho that the region needs at a rate (1/s); None where the observer is too slow for
        it."""
        decay = self.decay
        if self.exosystem is None or self.W is None:
            return self.radius
        part = next((each for each in PARTS if each * decay >= rate), None)
        if part is None:
            return None
        if part not in self._bounds:
            self._bounds[part] = self._bound(self.exosystem, self.W, part * decay)
        bound = self._bounds[part]
        if bound is None:
            return None
        return radius_needed(self.radius, bound, self.disturbance)

    def _bound(self, exosystem: Exosystem, W: Matrix, pace: float) -> ErrorBound | None:
        """What the observer adds at a rate (1/s): more, the later agents know themselves."""
        timing = self.timing
        bound = propose_error_bound(exosystem, W, rate=pace, timing=timing)
        if bound is None or not (timing.period or timing.own_delay):
            return bound
        drag = (timing.steepest or 0) * (timing.lag(bound.beta) - 1)
        left = timing.decay(bound.beta) - claimed(pace) - drag
        return replace(bound, kappa=1 / left) if left > 0 else None

    def _field(self, rho: Fraction) -> Field:
        """All rows without gains."""
        loop = loop_of(self.problem)
        # What is stated beside readings is in one claim with them.
        errors = EXACT if loop.timing is None else stated_errors(loop)
        rows = field_of(loop, rho=float(rho), errors=errors)
        return replace(rows, gains=np.zeros(loop.n))

    def rows(self, rate: float, *, coarse: bool = False) -> Field | None:
        """All rows without gains, for the rho of a rate; fewer points of s with ``coarse``.  None
        as in ``reach``."""
        problem = self.problem
        rho = self.reach(rate)
        if rho is None or rate > self.decay:
            return None
        size = float(rho)
        if size not in self._fields:
            self._fields[size] = self._field(rho)
        stretch = float(self.timing.stretch(claimed(rate)))
        found = replace(self._fields[size], stretch=stretch)
        if problem.is_linear:  # all s say the same
            return replace(found, grid=found.grid[-1:])
        return _coarse(found) if coarse else found

    def holds(
        self,
        pinned: AgentSet,
        rate: float,
        *,
        coarse: bool = False,
        start: Array | None = None,
    ) -> Array | None:
        """The least v >= 1 with the largest gains allowed, or None; ``start``: the answer for a
        lower rate."""
        n = self.problem.n
        rows = self.rows(rate, coarse=coarse)
        if rows is None:
            return None
        limit = HARD * (1.0 + self._size(rows))
        gains = np.zeros(n)
        gains[list(pinned)] = [float(self.caps.get(i, limit)) for i in pinned]
        held = replace(rows, gains=gains)
        v = least_above(held, alpha=rate, lower=np.ones(n), start=start)
        if v is None or np.max(v) > LARGEST_V:
            return None
        return v

    def fastest(self, pinned: AgentSet, *, coarse: bool = False) -> float:
        """The largest rate (1/s), about, with gains on these agents; 0 if none is possible."""
        best = self.holds(pinned, 0.0, coarse=coarse) if pinned else None
        if best is None:
            return 0.0
        accuracy = ROUGH if coarse else CLOSE

        def find(rate: float, best: Array) -> Array | None:
            return self.holds(pinned, rate, coarse=coarse, start=best)

        rate, _ = last_found(
            find,
            best,
            0.0,
            min(self.decay, self._most(pinned)),
            steps=BISECTIONS,
            middle=quickly_down(4),
            close=lambda low, high: low > 0 and high - low <= accuracy * high,
        )
        return rate

    def cost(self, pinned: AgentSet, rate: float, *, programs: int) -> float:
        """About the smallest total gain (1/s) for a rate (1/s), after so many linear programs;
        infinite out of reach."""
        rows = self.rows(rate, coarse=True)
        if rows is None:
            return math.inf
        box = box_of(rows, pinned, self.caps, rate=rate)
        with np.errstate(all="ignore"):
            v = box.follow(np.ones(rows.size))
            if v is None:
                return math.inf
            return box.cost(_improved(box, v / np.min(v), programs))

    def _most(self, pinned: AgentSet) -> float:
        """No rate is larger: an agent with the least v has at most its gain, or it hears others."""
        if all(i in self.caps for i in pinned):
            return max(float(self.caps[i]) for i in pinned)
        return 4 * (1.0 + self._size(self.rows(0.0)))

    def smallest(self, pinned: AgentSet, rate: float) -> RegionGains | None:
        """The smallest gains found on these agents for a rate (1/s), about; None if the rate is out
        of reach."""
        rows = self.rows(rate)
        if rows is None:
            return None
        with np.errstate(all="ignore"):
            found = cheapest(box_of(rows, pinned, self.caps, rate=rate))
        if found is None:
            return None
        box, v = found
        gains = box.gains(v)
        agents = np.flatnonzero(gains)
        prices = _prices(rows, v, agents, rate)
        held = dict(zip(agents.tolist(), gains[agents].tolist(), strict=True))
        return RegionGains(gains=held, rate=rate, prices=prices, rate_price=float(np.sum(prices)))

    def _size(self, rows: Field | None) -> float:
        """About the largest sum of arc gains of an agent."""
        if rows is None:
            return 0.0
        most = 0.0
        for arcs in self.problem.network.modes.values():
            heard = np.bincount(arcs.listeners, minlength=1)
            most = max(most, float(np.max(heard)))
        scale = rows.rows(np.ones(self.problem.n), alpha=0.0)[2]
        return float(np.max(scale, initial=0.0)) + most


def late_caps(rows: Field, timing: Timing, caps: Gains) -> Gains:
    """Caps of gains (1/s) with which no agent overshoots, about, before it reads itself again; v =
    1."""
    y = 2 * float(rows.stretch) * np.concatenate([-rows.grid[::-1], rows.grid])
    slopes = np.zeros(rows.size)
    for groups in rows.modes:
        sums = np.zeros(rows.size)
        for group in groups:
            values = group.h(y)
            # Held from tick to tick the mean counts, of late own readings every slope.
            steep = np.diff(values) / np.diff(y) if timing.own_delay else values / y
            weights = group.weights * max(np.max(steep), 0.0)
            sums += np.bincount(group.listeners, weights, minlength=rows.size)
        slopes = np.maximum(slopes, sums)
    most = BELOW * float(timing.steepest or 0)
    left = {i: claimed(max(most - steep, 0.0)) for i, steep in enumerate(slopes.tolist())}
    return {i: min(caps.get(i, cap), cap) for i, cap in left.items()}


def _prices(field: Field, v: Array, agents: Any, rate: float) -> Array:
    """The multipliers l of the rows, times v: J'l = 0 on the free v, l_i v_i = 1 on pinned
    ``agents``, l_i = 0 on slack rows."""
    residual, jacobian, scale = field.rows(v, alpha=rate)
    prices = np.zeros(len(v))
    prices[agents] = 1 / v[agents]
    others = np.setdiff1d(np.arange(len(v)), agents)
    tight = np.abs(residual[others]) <= 1e-6 * np.maximum(scale[others], 1e-300)
    others = others[tight]
    if len(others):
        pull = csr_array(jacobian[agents][:, others]).T @ prices[agents]
        block = csr_array(jacobian[others][:, others]).T
        with suppress(RuntimeError):  # exactly singular: no price
            prices[others] = factored(block).solve(-pull)
    return np.maximum(prices * v, 0.0)
