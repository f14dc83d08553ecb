"""Proposals for the max-separable certificate: v for one radius, common to all modes (theory,
section 5); no proofs.

The rows bound each v_i from below by the others: whoever is listened to may only raise a row.  So
for a given alpha the solutions with v >= 1 have a least one, and Newton's method finds it (one
sparse solve per step); alpha by bisection. The rows are taken in floating point for all agents at
once: the largest over modes, faces and a grid of s.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any, Protocol

import numpy as np
from scipy import sparse

from dobc_design._checks import noun
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import (
    last_found,
    quickly_down,
    soonest,
    time_to_one_percent,
)
from dobc_design.coupling.expression import numpy_function
from dobc_design.exact.matrix import Array, Matrix, Vector
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places, split_by
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import are_pairs
from dobc_design.solvers.program import factored

from .claim import (
    EXACT,
    ErrorBound,
    Errors,
    Separable,
    holding_gains,
    stuck_agents,
)
from .decide import verify_composite
from .propose_limits import largest_rate
from .propose_observer import propose_error_bound, radius_needed

logger = logging.getLogger("dobc_design")
Rated = tuple[float, Array]  # a rate, and weights v that have it

SAMPLES = 4001  # points of a coupling's table
MOST_TURNS = 200  # of a coupling in it: sine as far as 300
WORK = 1_000_000  # evaluations of h per pass that are worth a finer grid of s
FINEST = 33
COARSEST = 5
AT_ONCE = 50_000  # evaluations of h in one call
NEAREST = 1e-5  # the smallest s, as a part of rho
STEP = 1e-6  # of central differences
VALUES = 8  # steps of work for one face of one mode


@noun(eq=False)
class Group:
    """The arcs of one mode with one coupling h, and places and values of its maxima and minima on
    the sampled range."""

    listeners: Any
    speakers: Any
    weights: Array
    h: Callable[[Array], Array]
    tops: tuple[Array, Array]
    bottoms: tuple[Array, Array]
    loose: bool = False  # they come and go
    off: Array | None = None  # relative errors of the weights, which take their worse ends


@noun(eq=False)
class Field:
    """All rows: ``modes`` holds the groups of every mode, ``grid`` the values of s."""

    size: int
    fixed: int  # nodes of weight 0 after them
    gains: Array
    modes: tuple[tuple[Group, ...], ...]
    grid: Array
    load: Array | float = 0.0  # what is added to every row
    extra: Any = None  # (n, n): what grows with v besides, and is added to every row
    stretch: float = 1.0  # what the v_j of those who are listened to are multiplied by

    def rows(self, v: Array, *, alpha: float) -> tuple[Array, Any, Array]:
        """The largest row of every agent, its Jacobian in v (n, n), and the size of its terms."""
        worst = np.full(self.size, -np.inf)
        scale = (np.abs(self.gains) + alpha) * v
        chosen = np.zeros(self.size, dtype=np.int64)
        choices: list[tuple[int, int, int]] = []
        for mode, face in product(range(len(self.modes)), (1, -1)):
            for place, row in enumerate(self.values(mode, face, v)):
                chosen[row > worst] = len(choices)
                choices.append((mode, face, place))
                worst = np.fmax(worst, row)  # a row that is no number is left out
                scale = np.maximum(scale, np.abs(row))
        residual = worst + self.load - (self.gains - alpha) * v
        jacobian = self._jacobian(chosen, choices, v, alpha)
        if self.extra is not None:
            residual = residual + self.extra @ v
            jacobian = jacobian + self.extra
        return residual, jacobian, scale

    def values(self, mode: int, face: int, v: Array) -> Array:
        """One face of one mode: the largest sum of every agent at each s of the grid, without its
        gain, (grid, n)."""
        spend(VALUES)
        total = np.zeros((len(self.grid), self.size))
        weights = self._with_fixed(v)
        for group in self.modes[mode]:
            own = v[group.listeners]
            other = weights[group.speakers]
            # Some s at a time, so that arrays stay small.
            together = max(1, AT_ONCE // max(1, len(own)))
            for first in range(0, len(self.grid), together):
                values, _ = _sup(group, face, self.grid[first : first + together, None], own, other)
                values = values * _worse(group.off, values)
                for k, value in enumerate(values, start=first):
                    total[k] += np.bincount(
                        group.listeners, weights=group.weights * value, minlength=self.size
                    )
        return total

    @property
    def limit(self) -> float:
        """A rate that no v exceeds, about: others do not pull the agent with the least v inward."""
        largest = self.gains
        if self.fixed:
            equal = np.ones(self.size)
            faces = product(range(len(self.modes)), (1, -1))
            pulls = [-self.values(mode, face, equal) for mode, face in faces]
            largest = self.gains + np.max(np.concatenate(pulls), axis=0)
        return float(np.max(largest, initial=0.0))

    def _with_fixed(self, v: Array) -> Array:
        """The weights of all nodes, as they are heard."""
        heard = v * self.stretch if self.stretch > 1 else v
        return np.append(heard, np.zeros(self.fixed)) if self.fixed else heard

    def slopes(self, mode: int, face: int, places: Any, v: Array) -> Any:
        """The derivatives in v, (n, n), of these sums, each agent at its own place (n,) of the
        grid."""
        choices = [(mode, face, k) for k in range(len(self.grid))]
        return self._jacobian(np.asarray(places), choices, v, 0.0) + sparse.diags_array(self.gains)

    def _jacobian(
        self, chosen: Any, choices: Sequence[tuple[int, int, int]], v: Array, alpha: float
    ) -> Any:
        """Each agent has the choice (mode, face, place in the grid) of its own number."""
        everyone = np.arange(self.size)
        weights = self._with_fixed(v)
        parts = [(everyone, everyone, alpha - self.gains)]
        for number in np.unique(chosen).tolist():
            mode, face, k = choices[number]
            s = float(self.grid[k])
            mine = chosen == number
            for group in self.modes[mode]:
                here = mine[group.listeners]
                i = group.listeners[here]
                j = group.speakers[here]
                w = group.weights[here]
                own, other = _derivatives(group, face, s, v[i], weights[j])
                if group.off is not None:
                    values, _ = _sup(group, face, s, v[i], weights[j])
                    w = w * _worse(group.off[here], values)
                free = j < self.size
                parts += [(i, i, w * own), (i[free], j[free], self.stretch * (w * other)[free])]
        i, j, entries = map(np.concatenate, zip(*parts, strict=True))
        return sparse.csr_array(sparse.coo_array((entries, (i, j)), shape=(self.size, self.size)))


def _worse(off: Array | None, values: Array) -> Array | float:
    """The ends of weights, as parts of them, at which these sums are largest."""
    return 1.0 if off is None else np.where(values > 0, 1 + off, 1 - off)


def field_of(loop: Loop, *, rho: float, errors: Errors = EXACT) -> Field:
    """Prepare the rows for s in (0, rho]; turning points of h are looked for on |y| <= 8 rho.
    ``errors``: weights and gains take their worse ends."""
    functions = [numpy_function(each.components[0]) for each in loop.functions]
    shapes = [(h, *_extremes(h, radius=8.0 * rho)) for h in functions]
    modes = []
    for arcs in loop.modes.values():
        weights = np.array(arcs.weights, dtype=float)
        off = np.full(len(arcs), float(errors.weights))
        off[arcs.speakers >= loop.n] = float(max(errors))  # a pin may be one of them
        groups = []
        # Arcs that come and go are groups of their own, which count where they pull outward.
        for kind, own in split_by(2 * coupling_places(loop, arcs) + arcs.uncertain):
            h, tops, bottoms = shapes[kind // 2]
            group = Group(
                listeners=arcs.listeners[own],
                speakers=arcs.speakers[own],
                weights=weights[own],
                h=h,
                tops=tops,
                bottoms=bottoms,
                loose=kind % 2 > 0,
                off=off[own] if any(errors) else None,
            )
            groups.append(group)
        modes.append(tuple(groups))
    total = 1 + loop.arc_count
    count = int(np.clip(WORK // total, COARSEST, FINEST))
    return Field(
        size=loop.n,
        fixed=len(loop.fixed),
        gains=np.array(holding_gains(loop, error=errors.gains), dtype=float),
        modes=tuple(modes),
        grid=rho * np.concatenate([[NEAREST], np.linspace(0, 1, count)[1:]]),
    )


def _extremes(
    h: Callable[[Array], Array], *, radius: float
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Places and values of the maxima of h on [-radius, radius], then of its minima;
    ArithmeticError for too many."""
    y = np.linspace(-radius, radius, SAMPLES)
    values = h(y)
    change = np.diff(np.where(np.isfinite(values), values, 0.0))
    places = []
    for sign in (1.0, -1.0):
        turns = (sign * change[:-1] > 0) & (sign * change[1:] < 0)
        places.append(np.flatnonzero(turns) + 1)
    if sum(map(len, places)) > MOST_TURNS:
        raise ArithmeticError(
            f"the coupling has more than {MOST_TURNS} turning points within {radius:g}"
        )
    extremes = []
    for sign, found in zip((1.0, -1.0), places, strict=True):
        pairs = np.zeros((len(found), 2))
        for number, place in enumerate(found.tolist()):  # by a finer sample around each
            near = np.linspace(y[place - 1], y[place + 1], 2001)
            heights = h(near)
            best = int(np.argmax(sign * heights))
            pairs[number] = near[best], heights[best]
        extremes.append((pairs[:, 0], pairs[:, 1]))
    return extremes[0], extremes[1]


def _sup(group: Group, face: int, s: float | Array, own: Array, other: Array) -> tuple[Array, Any]:
    """phi = sup { h(s t)/s : -(own + other) <= t <= other - own }; where: 0 right end, 1 left end,
    2 inside."""
    other = np.maximum(own, other) if group.loose else other
    high = s * (other - own)
    low = -s * (other + own)
    best = face * group.h(face * high) / s
    where = np.zeros(best.shape, dtype=np.int64)
    places, values = group.tops if face > 0 else group.bottoms
    if not len(places):
        return best, where
    left = face * group.h(face * low) / s
    where[left > best] = 1
    best = np.maximum(best, left)
    for place, top in zip((face * places).tolist(), (face * values).tolist(), strict=True):
        better = (low < place) & (place < high) & (top / s > best)
        best = np.where(better, top / s, best)
        where[better] = 2
    return best, where


def _derivatives(
    group: Group, face: int, s: float, own: Array, other: Array
) -> tuple[Array, Array]:
    """The derivatives of phi in own and other."""
    where = _sup(group, face, s, own, other)[1]
    if group.loose:
        where = np.where((where == 0) & (other < own), 2, where)
        other = np.maximum(own, other)
    at = face * s * np.where(where == 1, -(own + other), other - own)
    step = STEP * (1.0 + np.abs(at))
    slope = (group.h(at + step) - group.h(at - step)) / (2 * step)
    slope = np.where(where == 2, 0.0, np.where(where == 1, -slope, slope))
    return np.where(where == 1, slope, -slope), slope


LARGEST_V = 1e6
STEPS = 60
FEW_AGENTS = 2000  # networks of more are large: less accuracy is worth the time
FEW_PAIRS = 400  # the same of pairs of agents, each of which hears as much as both of them
# A factorisation is cheap for few agents, and where the network is little more than lines and
# rings.
FACTORED_AGENTS = 500
FEW_ENTRIES = 4
# Accuracy and steps of the iteration elsewhere.  It converges slowly only at rates next to one that
# is out of reach.
ACCURACY = 1e-4
VERY_ROUGH = 0.1
MOST_ITERATIONS = 150
# Newton's residual as a part of the terms, and how far a step may fall where it has to rise, by
# rounding.
TIGHT = (1e-12, 1e-9)
LOOSE = (1e-6, 1e-2)
INVERSE_STEPS = 2  # for the rate of linear couplings
FIRST = 8.0  # how much less than that rate is tried first
# Of large networks: the part of the rate that a row may miss, on the way and in the end.
MISSED = 0.1
MISSED_AT_LAST = 0.01
FALLEN = 0.05  # how far a step may fall where it has to rise
STEP_ACCURACY = 0.03
MOST_STEPS = 15


def is_large(loop: Loop) -> bool:
    """Whether less accuracy is worth the time."""
    return loop.n > (FEW_PAIRS if are_pairs(loop) else FEW_AGENTS)


def linear_rate(field: Field) -> float:
    """A rough estimate of the largest rate that the couplings would have if they were linear, with
    their slopes at 0 (1/s).  No v has more for any s: next to 0 the rows are those of these
    slopes."""
    v = np.ones(field.size)
    _, jacobian, _ = field.rows(v, alpha=0.0)
    everybody = np.ones(field.size, dtype=bool)
    found = field.limit
    for _ in range(INVERSE_STEPS):
        step = solved(jacobian, v, everybody, accuracy=VERY_ROUGH)
        if step is None or not np.all(step > 0):
            break
        v = step / np.max(step)
        found = min(found, float(-(v @ (jacobian @ v)) / (v @ v)))
    return found


class RowsOf(Protocol):
    """See ``Field`` and ``propose_coordinates.Rows``."""

    @property
    def size(self) -> int: ...
    def rows(self, v: Array, *, alpha: float) -> tuple[Array, Any, Array]: ...


def least_solution(
    field: RowsOf,
    *,
    alpha: float,
    start: Array,
    lower: Array | float = 1.0,
    accuracy: tuple[float, float] | None = None,
) -> Array | None:
    """The least v >= ``lower`` whose rows hold with rate alpha, about; None if Newton from
    ``start`` finds none."""
    v = start.copy()
    close, drop = accuracy or (TIGHT if field.size <= FACTORED_AGENTS else LOOSE)
    for _ in range(STEPS):
        residual, jacobian, scale = field.rows(v, alpha=alpha)
        if np.all(residual <= close * scale):
            return v
        raised = residual > 0
        step = solved(jacobian, residual, raised | (v > lower))
        if step is None:
            return None
        proposed = np.maximum(lower, v + step)
        if _falls(proposed, v, raised, drop) and np.any(step[~raised] < 0):
            # Curved rows overshoot: a neighbour that falls back takes a row down with it. That it
            # stays will do.
            step = solved(jacobian, residual, raised)
            if step is None:
                return None
            proposed = np.maximum(lower, v + step)
        # A solution lies above: where a row fails, v has to rise; a step down there means there is
        # none.
        if _falls(proposed, v, raised, drop) or not np.all(np.isfinite(proposed)):
            return None
        proposed = np.minimum(proposed, 2 * v)
        if np.max(proposed) > LARGEST_V:
            return None
        if np.allclose(proposed, v, rtol=1e-15, atol=0.0):
            return v if np.all(residual <= 1e3 * close * scale) else None
        v = proposed
    return None


def _falls(proposed: Array, v: Array, raised: Any, drop: float) -> bool:
    """Whether a row that fails would get a smaller v."""
    return bool(np.any(proposed[raised] < v[raised] * (1 - drop)))


def rough_solution(
    field: Field, *, alpha: float, start: Array, part: float = MISSED
) -> Rated | None:
    """Nearly the least v >= 1 with the rate alpha, and the rate that it has, which is a little
    less; None if Newton from ``start`` finds none.  ``part``: of the rate, that may be missing.
    For large networks, where every step takes many products and few digits of v matter."""
    v = start.copy()
    for _ in range(MOST_STEPS):
        residual, jacobian, _ = field.rows(v, alpha=alpha)
        missed = float(np.max(residual / v, initial=0.0))
        if missed <= part * alpha:
            return alpha - missed, v
        raised = residual > 0
        step = solved(jacobian, residual, raised | (v > 1.0), accuracy=STEP_ACCURACY)
        if step is None:
            return None
        proposed = np.maximum(1.0, v + step)
        if _falls(proposed, v, raised, FALLEN) or not np.all(np.isfinite(proposed)):
            return None
        v = np.minimum(proposed, 2 * v)
        if np.max(v) > LARGEST_V:
            return None
    return None


def solved(
    jacobian: Any, residual: Array, active: Any, *, accuracy: float = ACCURACY
) -> Array | None:
    """One Newton step on the active agents; None if their matrix is singular."""
    places = np.flatnonzero(active)
    block = sparse.csr_array(jacobian[places][:, places])
    right = -residual[places]
    step = np.zeros(len(residual))
    with np.errstate(all="ignore"):
        if len(places) <= FACTORED_AGENTS or block.nnz <= FEW_ENTRIES * len(places):
            try:
                step[places] = factored(block).solve(right)
            except RuntimeError:  # exactly singular
                return None
            return step
        # BiCGSTAB with Jacobi scaling: factors of scale-free networks would fill in.
        diagonal = block.diagonal()
        if np.any(diagonal >= 0):
            return None
        scaled = sparse.csr_array(sparse.diags_array(1 / diagonal) @ block)
        solution, status = sparse.linalg.bicgstab(
            scaled, right / diagonal, rtol=accuracy, maxiter=MOST_ITERATIONS
        )
    step[places] = solution
    return step if status == 0 and np.all(np.isfinite(solution)) else None


NEARLY = 0.997  # of a planned rate, which is enough
DIGITS = (3, 4, 5, 6, 8, 11)
BITS = (12, 20, 30)  # of large networks, whose arithmetic is binary
LARGE = 400
LARGEST_RADIUS = 1e150
# (agents, relative accuracy of alpha that is still worth the time); for more agents.
CLOSE = ((300, 1e-5), (2000, 1e-3))
# Of large networks: how close to a rate that is out of reach nothing more is tried, after a success
# and after a failure.
CLOSE_LARGE = 0.1
NEAR_ENOUGH = 1.2
FALL = 2.5  # how much less is tried where no rate is found yet,
GROWTH = 1.3  # how much more at least where one is,
LEAP = 4.0  # and at most
GOAL = 0.65  # the part of the rate of linear couplings that is aimed at
# kappa is chosen for the rate that v has, or where the observer is slower for one that suits both.
ROUNDS = 6
ABOVE = 1.005  # how much faster than N the observer's part is to be
SHARE = 0.05  # of the observer's decay rate: the first guess for many agents
ENOUGH = 0.5  # of that rate, where N loses some because kappa needs room
COARSE = 8  # points of s where many v are looked for,
CLOSE_ENOUGH = 0.01  # and accuracy of a rate
SLOWEST = 1e-6  # rates below this part of the largest gain are not looked for
STEEP = 100.0  # weights above which v is steep,
FLATTER = (0.9, 0.7, 0.4, 0.1, 0.02)  # and the parts of the rate that are tried in its place
ROUNDING = 1e-15  # of h, absolutely
FLAT = 1.05  # v of a smaller factor are flat
SOONER = 8  # rates that are tried for the least time to one percent of few agents
WORTH_IT = 0.995  # the part of the time from which on a slower rate is not worth it
# A slower proof has to be earlier by this: delays and errors of weights take of the rate.
EARLIER = 0.95
KEPT = 0.005  # how much faster than wanted a plan is to be, of which rounding may take some


@noun(eq=False)
class SeparablePlan:
    """v (n,), min v = 1, the rate (1/s) that floating point sees for s in (0, rho], and the
    observer's part."""

    v: Array
    rate: float
    rho: Fraction
    error: ErrorBound | None = None
    # smaller rates that were found on the way, with their v
    slower: tuple[Rated, ...] = ()

    @property
    def whole_rate(self) -> float:
        """The rate of V = N + kappa E (1/s)."""
        if self.error is None:
            return self.rate
        return min(self.rate, float(self.error.beta - 1 / self.error.kappa))

    @property
    def factor(self) -> float:
        """Max v / min v."""
        return float(self.v.max() / self.v.min())

    @property
    def time(self) -> float:
        """The time to one percent that it promises (s)."""
        return time_to_one_percent(self.whole_rate, self.factor)


def propose_separable(
    loop: Loop, *, rho: Fraction | float, near: float | None = None, errors: Errors = EXACT
) -> SeparablePlan | None:
    """v with min v = 1 and the largest rate for all s in (0, rho], about; None if none > 0.
    ``near``: a rate expected (1/s).  ``errors``: weights and gains take their worse ends."""
    spend(0)  # what follows takes long for many nodes
    if stuck_agents(loop) or not 0 < rho <= LARGEST_RADIUS:
        return None
    # far out couplings overflow or end; what is not finite is no proposal
    with np.errstate(all="ignore"):
        try:
            field = field_of(loop, rho=float(rho), errors=errors)
        except ArithmeticError as error:
            logger.info("no proposal for rho = %g: %s", rho, error)
            return None
        best = least_solution(field, alpha=0.0, start=np.ones(loop.n))
        high = field.limit
        if best is None or high <= 0:
            return None
        if is_large(loop):
            first = linear_rate(field) / FIRST if near is None else near * (1 - CLOSE_LARGE)
            found = rough_rates(field, first=first)
            if not found:
                return None
            *slower, (rate, best) = found
            return SeparablePlan(v=best, rate=rate, rho=Fraction(rho), slower=tuple(slower))
        rate = high
        whole = least_solution(field, alpha=high, start=best)
        if whole is None:
            close = next(part for size, part in CLOSE if loop.n <= size)
            rate, whole = _fastest(field, best, close=close)
    return SeparablePlan(v=whole, rate=rate, rho=Fraction(rho)) if rate else None


def rough_rates(field: Field, *, first: float) -> list[Rated]:
    """Rates that are found for a large network, rising, with their v; the last is about the largest
    that is worth its v.  Few trials, each from the v before it, the first at the rate ``first``."""
    found = list[Rated]()
    high = field.limit
    slowest = SLOWEST * high
    low, alpha = 0.0, min(first, high * (1 - CLOSE_LARGE))  # low: the last one with a v
    start = np.ones(field.size)
    while high > slowest and alpha > 0:
        each = rough_solution(field, alpha=alpha, start=start)
        if each is None:
            high = alpha
            if low and high <= low * NEAR_ENOUGH:
                break
            alpha = (low + high) / 2 if low else high / FALL
            continue
        if found and _later(each, found[-1]):
            break
        found.append(each)
        low = alpha
        start = each[1]
        # Of linear couplings the largest v is 1 / (1 - rate/mu), where mu is the largest rate.
        used = 1 - 1 / float(np.max(start))
        alpha = low * max(GOAL / max(used, GOAL / LEAP), GROWTH)
        if alpha > high * (1 - CLOSE_LARGE):
            alpha = (low + high) / 2
        if alpha <= low * (1 + CLOSE_LARGE):
            break
    last = rough_solution(field, alpha=low, start=start, part=MISSED_AT_LAST) if found else None
    return found if last is None else [*found[:-1], last]


def _later(each: Rated, before: Rated) -> bool:
    """Whether a rate is hardly worth its v: one percent is not reached much earlier than with the
    one before."""
    now, then = (time_to_one_percent(rate, float(np.max(v))) for rate, v in (each, before))
    return now > then * WORTH_IT


def _fastest(field: Field, best: Array, *, close: float) -> Rated:
    """The largest rate, up to ``close``, and its v; 0 and ``best``, the v for 0, if there is none.
    The rate may be many powers of ten below the gains: divide by 8 first, then evenly."""
    top = field.limit

    def enough(low: float, high: float) -> bool:
        return not high > SLOWEST * top or (low > 0 and high - low <= close * low)

    def find(rate: float, best: Array) -> Array | None:
        return least_solution(field, alpha=rate, start=best)

    return last_found(find, best, 0.0, top, middle=quickly_down(8), close=enough)


@noun
class Cover:
    """What a plan has to cover: every start with |e|_inf <= ``radius`` and |eps_i| <=
    ``disturbance``, by the loop with the gain W (q, m).  ``errors``: as in ``propose_separable``.
    """

    loop: Loop
    radius: Fraction
    disturbance: Fraction = Fraction(0)
    W: Matrix | None = None
    errors: Errors = EXACT

    def fastest(self) -> SeparablePlan | None:
        """The plan with the largest rate; None if none is found.  With an exosystem the observer's
        part is chosen so that V = N + kappa E is about as fast as N."""
        exosystem = self.loop.joint_exosystem
        if exosystem is None:
            return propose_separable(self.loop, rho=self.radius, errors=self.errors)
        if self.W is None:
            return None
        first = 0.0
        rounds = ROUNDS
        if is_large(self.loop):
            # One v takes long, so that the first one is for a kappa that is seldom too small.
            first = SHARE * decay_rate(exosystem, self.W)
            rounds = 1
        best = self._beside(first)
        if best is None or best.rate <= first:
            return best
        # A faster observer's part wants a larger kappa and rho, with which N is slower: V is as
        # fast as the slower of the two.
        gained = first
        low = 0.0
        high = 2 * best.rate * ABOVE
        for _ in range(rounds):
            rate = (low + high) / 2
            plan = self._beside(rate, near=best.rate)
            reached = 0.0 if plan is None else min(rate, plan.rate)
            if plan is not None and reached > gained:
                best = plan
                gained = reached
            if reached > rate * ENOUGH and not low:
                break
            if reached == rate:
                low = rate
            else:
                high = rate
        return best

    def sooner(self, plan: SeparablePlan, *, least: float = 0.0) -> SeparablePlan:
        """The plan with a rate of at least ``least`` (1/s) that promises the least time to one
        percent, ln(100 max v / min v) / rate; ``plan`` itself, which has the largest rate, where
        none is earlier.

        The least v >= 1 of a rate has the least max v as well, so that one search over the rate
        does."""
        least *= 1 + KEPT
        if plan.factor < FLAT:
            return plan
        if is_large(self.loop):  # another v takes long
            met = (replace(plan, v=v, rate=rate) for rate, v in plan.slower if rate >= least)
            best = min(met, key=lambda each: each.time, default=plan)
            return best if best.time <= plan.time * EARLIER else plan
        field = self._field(plan.rho)

        def at(rate: float) -> tuple[float, SeparablePlan] | None:
            v = _flattest(field, rate)
            if v is None:
                return None
            found = replace(plan, v=v, rate=rate)
            return found.time, found

        longest = plan.whole_rate
        found = soonest(at, first=plan.time, longest=longest, least=least, steps=SOONER)
        if not found or found[0][0] > plan.time * EARLIER:
            return plan
        best = found[0][1]
        # A slower V leaves kappa less to do, and then rho is smaller.
        nearer = None if best.error is None else self.flat(best.whole_rate)
        if nearer is None:
            return best
        return min(best, nearer, key=lambda each: each.time)

    def flat(self, rate: float) -> SeparablePlan | None:
        """The plan with the flattest v for about this rate (1/s); None if there is none."""
        error = self._observer(rate)
        if error is None and self.loop.groups:
            return None
        rho = radius_needed(self.radius, error, self.disturbance)
        v = _flattest(self._field(rho), rate)
        return None if v is None else SeparablePlan(v=v, rate=rate, rho=rho, error=error)

    def _field(self, rho: Fraction) -> Field:
        with np.errstate(all="ignore"):  # as in propose_separable
            return field_of(self.loop, rho=float(rho), errors=self.errors)

    def _observer(self, rate: float) -> ErrorBound | None:
        """The observer's part of a V with this rate; None where none is as fast."""
        exosystem = self.loop.joint_exosystem
        if exosystem is None or self.W is None:
            return None
        return propose_error_bound(exosystem, self.W, rate=rate)

    def _beside(self, rate: float, near: float | None = None) -> SeparablePlan | None:
        """A plan whose observer part decays with ``rate``; None if it is slower, or leaves no room
        for a v."""
        error = self._observer(rate)
        if error is None:
            return None
        rho = radius_needed(self.radius, error, self.disturbance)
        proposal = propose_separable(self.loop, rho=rho, near=near, errors=self.errors)
        return None if proposal is None else replace(proposal, error=error)


def _flattest(field: Field, rate: float) -> Array | None:
    """The least v >= 1 for a rate, whatever overflows on the way."""
    with np.errstate(all="ignore"):
        return least_solution(field, alpha=rate, start=np.ones(field.size))


def flatter_plans(loop: Loop, plan: SeparablePlan) -> Iterator[SeparablePlan]:
    """Flatter v with smaller rates for a plan too steep to be proved (chains of agents have such);
    none for a flat one."""
    far = 2 * float(plan.rho) * float(plan.v.max())
    with np.errstate(all="ignore"):
        ends = [
            each.numpy_function()([[y] * loop.m for y in (-far, far)]) for each in loop.functions
        ]
    if (float(plan.v.max()) <= STEEP and np.isfinite(ends).all()) or is_large(loop):
        return
    field = field_of(loop, rho=float(plan.rho))
    field = replace(field, grid=field.grid[:: max(1, len(field.grid) // COARSE)])
    ones = np.ones(loop.n)
    best = least_solution(field, alpha=0.0, start=ones)
    if best is None or field.limit <= 0:
        return
    rate, _ = _fastest(field, best, close=CLOSE_ENOUGH)
    for part in FLATTER if rate else ():
        v = least_solution(field, alpha=part * rate, start=ones)
        if v is not None:
            yield replace(plan, v=v, rate=part * plan.rate)


def rounded_vectors(plan: SeparablePlan) -> Iterator[Vector | Doubles]:
    """v as rationals, few digits first; binary fractions for large networks, which floats hold
    exactly."""
    if len(plan.v) > LARGE:
        for bits in BITS:
            yield Doubles(np.ldexp(np.rint(np.ldexp(plan.v, bits)), -bits))
        return
    for digits in DIGITS:
        unit = 10**digits
        yield tuple(Fraction(round(float(x) * unit), unit) for x in plan.v)


def first_certificate(
    loop: Loop, W: Matrix | None, plan: SeparablePlan, *, everywhere: bool = False
) -> Separable | None:
    """The first rounding of v proved at nearly the planned rate, else the best.  ``everywhere``:
    for all radii."""
    best: Separable | None = None
    rho = None if everywhere else plan.rho
    for v in rounded_vectors(plan):
        alpha = largest_rate(loop, v, rho=rho)
        if alpha is None or (best is not None and alpha <= best.alpha):
            continue
        claim = Separable(v=v, alpha=alpha, rho=rho, error=plan.error)
        if verify_composite(loop, W, claim).wrong is None:
            best = claim
            if alpha >= plan.rate * NEARLY:
                break
    return best


def least_above(
    field: Field, *, alpha: float, lower: Array, start: Array | None = None
) -> Array | None:
    """The least v >= ``lower`` (n,) whose rows hold with rate alpha, about; None if none is found.
    ``start`` (n,), where it is given, lies between the two.  Newton's method ends where h(s y)/s
    loses its digits: at the smallest s of the grid."""
    close, drop = TIGHT if field.size <= FEW_AGENTS else LOOSE
    noise = ROUNDING / float(field.grid[0])
    accuracy = (max(close, noise), max(drop, 100 * noise))
    start = lower if start is None else start
    with np.errstate(all="ignore"):
        return least_solution(field, alpha=alpha, start=start, lower=lower, accuracy=accuracy)
