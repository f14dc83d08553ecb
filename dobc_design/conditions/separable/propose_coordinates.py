"""Proposals of coordinates z = T x and weights v (theory, section 13); floating point.

T: the identity, real modal forms of an agent with mean gains, or rows c (I + A/lambda)^k for
outputs c of the agents. For fixed gains the rows are the largest of linear functions of v with
Metzler matrices; inverse iteration on the matrix that is largest at the last v finds the v with the
best rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice, product
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse

from dobc_design._checks import positional
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import (
    rounded_down,
    rounded_up,
    soonest,
    time_to_one_percent,
)
from dobc_design.conditions.quadratic.sectors import GainRange, gains_at
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array, Matrix, largest_entry, rank, to_float
from dobc_design.exact.number import root_above
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places, split_by
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import Arcs

from .claim import MOST_COMPONENTS, ErrorBound, Separable, spread
from .coordinates import (
    MOST_FREE,
    enclosed_ranges,
    faces,
    seen_through,
    slowest_row,
    varying,
)
from .decide import composite_rate, error_bound_obstacle
from .propose import (
    EARLIER,
    KEPT,
    LARGE,
    Cover,
    Rated,
    SeparablePlan,
    least_solution,
    rounded_vectors,
    solved,
)
from .propose_observer import propose_error_bound

Gains = Mapping[int, Array]  # by the place of a coupling: the ends, (2, m, m)

DIGITS = 3  # of T
# of the size of an agent's eigenvalues: lambda
PARTS = tuple(2.0 ** (k / 4) for k in range(-16, 6))
STEPS = 6  # of inverse iteration
ROUNDS = 4  # of v and gains in turn
# coordinates whose weights are rounded: the fastest ones, and before these the soonest
BEST = 3
SOONEST = 2
PATIENCE = (1.0, 0.5, 0.0)  # of the best rate, which a flatter v is to keep
CLOSE = 1e-3  # of v, when it is kept
LARGEST = 1e6  # condition of a modal form
SHARES = (0.9, 0.5, 0.0)  # of the rate of the rows, which V is to keep
PROMISED = 0.7  # of the largest rate, at which coordinates are compared
SOONER = 8  # rates that are tried for the least time to one percent
ROUGHLY = Fraction(1, 1000)  # how far gains are enclosed in the search


class Group(NamedTuple):
    """The arcs of one mode with the coupling at one place; ``sure``: which are always there."""

    place: int
    listeners: Any
    speakers: Any
    weights: Array
    sure: Any


@dataclass(frozen=True, eq=False)
class Agents:
    """The rows of ``size`` agents in floats: their gains (size, m, m), the slopes that nodes have
    in them (m, m), arcs by mode and coupling.  The speaker number ``size`` is at the target: of
    large networks a part is enough to choose T."""

    loop: Loop
    size: int
    gains: Array
    slopes: Array
    modes: tuple[tuple[Group, ...], ...]

    @classmethod
    def of(cls, loop: Loop, *, most: int) -> Agents:
        """The first ``most`` agents of a loop."""
        size = min(loop.n, most)
        m = loop.m
        gains = np.zeros((size, m, m))
        for i, k in loop.pulls.each(to_float).items():
            if i < size:
                gains[i] = k
        slopes = to_float(loop.slopes) if loop.slopes else np.zeros((m, m))
        modes = tuple(tuple(_groups(loop, arcs, size)) for arcs in loop.modes.values())
        return cls(loop, size, gains, slopes, modes)

    @property
    def ones(self) -> Array:
        """The weights 1, (n, m)."""
        return np.ones((self.size, self.loop.m))

    def gains_at(self, T: Array, v: Array, rho: float) -> Gains | None:
        """The gains where N <= rho, three digits further; None where a coupling is not defined, or
        has too many."""
        node = self.loop.drift_place
        sizes = rho * np.vstack([v, 0 * v[:1]]) @ np.abs(np.linalg.inv(T)).T
        far: dict[int, Array] = {}
        # The last row is the target, whose error is 0.
        for groups in self.modes:
            for group in groups:
                apart = np.max(sizes[group.listeners] + sizes[group.speakers], axis=0)
                far[group.place] = np.maximum(far.get(group.place, 0.0), apart)
        if node is not None:
            far[node] = np.max(sizes, axis=0)
        found: list[GainRange] = []
        for place, radii in far.items():
            try:
                sides = [rounded_up(Fraction(x), digits=3) for x in radii.tolist()]
                entries = gains_at(self.loop, place, sides, tolerance=ROUGHLY)
            except UndefinedError:
                return None
            if place != node and varying(entries) > MOST_FREE:
                return None
            found.append(GainRange(coupling=place, radius=None, entries=entries))
        return in_floats(found)

    def gains_near(self, reach: float) -> Gains | None:
        """The gains where |e|_inf <= reach."""
        return self.gains_at(np.eye(self.loop.m), self.ones, reach)


def _groups(loop: Loop, arcs: Arcs, size: int) -> Iterator[Group]:
    """The arcs of a mode that the first ``size`` agents listen to, by coupling."""
    weights = np.array(arcs.weights, dtype=float)
    places = coupling_places(loop, arcs)
    here = np.flatnonzero(arcs.listeners < size)
    # who is left out is at the target
    speakers = np.minimum(arcs.speakers, size)
    sure = ~arcs.uncertain
    for place, part in split_by(places[here]):
        own = here[part]
        yield Group(place, arcs.listeners[own], speakers[own], weights[own], sure[own])


@positional(eq=False)
class Rows:
    """The rows of all components in coordinates z = T e, for fixed gains: S = T^-1, T K S of every
    agent (n, m, m), T J S at the corners J of each coupling (corners, m, m), and the ends of what
    the drift of a node adds to the slopes in its gain (2, m, m), None without."""

    agents: Agents
    T: Array
    S: Array
    pulls: Array
    corners: Mapping[int, Array]
    drift: Array | None

    @classmethod
    def of(cls, agents: Agents, T: Array, gains: Gains) -> Rows:
        """What coordinates make of gains."""
        S = np.asarray(np.linalg.inv(T), dtype=float)
        node = agents.loop.drift_place
        corners = {k: _corners(T, S, ends) for k, ends in gains.items() if k != node}
        drift = None if node is None else gains[node] - agents.slopes
        return cls(agents, T, S, T @ agents.gains @ S, corners, drift)

    @property
    def size(self) -> int:
        return self.agents.size * len(self.T)

    def rows(self, v: Array, *, alpha: float) -> tuple[Array, Any, Array]:
        """The largest row of every component at v (n m,) with the rate alpha, its Jacobian, the
        size of its terms."""
        best, M = self.chosen(v.reshape(-1, len(self.T)))
        jacobian = sparse.csr_array(M + alpha * sparse.eye_array(self.size))
        return best.ravel() + alpha * v, jacobian, abs(M) @ v + alpha * v

    def chosen(self, v: Array) -> tuple[Array, Any]:
        """The largest row of every component at v (n, m), and the sparse matrix whose product with
        v it is."""
        n, m = v.shape
        agents = np.arange(n)
        everybody = np.vstack([v, np.zeros((1, m))])  # and the target
        best = []
        chosen = []
        for c, signs in enumerate(faces(m)):
            listed = []
            for groups in self.agents.modes:
                listed += [self._row(groups, c, np.array(sign), everybody) for sign in signs]
            M = sparse.vstack(listed, format="csr")
            values = (M @ everybody.ravel()).reshape(-1, n)
            best.append(values.max(axis=0))
            chosen.append(M[values.argmax(axis=0) * n + agents])
        # chosen is by component, then agent
        by_agent = np.arange(n * m).reshape(m, n).T.ravel()
        return np.array(best).T, sparse.vstack(chosen, format="csr")[by_agent][:, : n * m]

    def _row(self, groups: Sequence[Group], c: int, sign: Array, everybody: Array) -> Any:
        """Component c of every agent in one mode, where x has these signs, as a matrix that acts on
        ``everybody``."""
        v = everybody[:-1]
        n, m = v.shape
        agents = np.arange(n)
        x = v * sign
        own = -self.pulls[:, c, :]
        if self.drift is not None:
            low, high = self.drift
            is_outward = self.T[c][:, None] * (x @ self.S.T)[:, None, :] >= 0
            own = own + self.T[c] @ np.where(is_outward, high, low) @ self.S
        parts = [(agents, agents, own * sign)]
        for place, i, j, w, sure in groups:
            G = self.corners[place][:, c, :]
            value = everybody[j] @ np.abs(G).T - x[i] @ G.T
            worst = G[np.argmax(value, axis=1)]
            # an arc that comes and goes counts where it pulls outwards
            there = sure | (np.max(value, axis=1) > 0)
            g = (w * there)[:, None] * worst
            parts += [(i, j, np.abs(g)), (i, i, -g * sign)]
        i, j, entries = map(np.concatenate, zip(*parts, strict=True))
        places = np.repeat(i, m), (j[:, None] * m + np.arange(m)).ravel()
        return sparse.csr_array((entries.ravel(), places), shape=(n, n * m + m))

    def largest(self, v: Array) -> Array:
        """The largest row of every component at many v (count, n, m), as in ``chosen``."""
        spend(8 + v.size // 20)
        found = np.empty_like(v)
        everybody = np.pad(v, ((0, 0), (0, 1), (0, 0)))  # and the target
        for c, signs in enumerate(faces(len(self.T))):
            x = v * np.array(signs)[:, None, None, :]  # (signs, count, n, m)
            alone = -np.sum(self.pulls[:, c, :] * x, axis=-1)
            if self.drift is not None:
                pulled = self.T[c][:, None] * (x @ self.S.T)[..., None, :]
                outward = np.max([pulled * ends for ends in self.drift], axis=0)
                alone += outward.sum(axis=(-2, -1))
            best: Any = -np.inf
            for groups in self.agents.modes:
                total = alone
                for place, i, j, w, sure in groups:
                    G = self.corners[place][:, c, :]
                    value = np.max(everybody[:, j] @ np.abs(G).T - x[..., i, :] @ G.T, axis=-1)
                    value = np.where(sure, value, np.maximum(value, 0.0))
                    total = total + value * w @ np.eye(self.agents.size)[i]
                best = np.maximum(best, total.max(axis=0))
            found[..., c] = best
        return found

    def vectors(self) -> list[Rated]:
        """Rates > 0 with their v (n, m), min v = 1: the flattest v first, the fastest last."""
        v = self.agents.ones
        found: list[Rated] = []
        best, M = self.chosen(v)
        for _ in range(STEPS):
            rate = float(np.min(-best / v))
            if rate > 0 and (not found or rate > found[-1][0]):
                found.append((rate, v))
            # Inverse iteration, on the rows that are the largest at v.
            u = solved_whole(M, v)
            if u is None:
                break
            v = u / u.min()
            best, M = self.chosen(v)
        return found

    def least(self, alpha: float) -> Array | None:
        """The least v >= 1 (n, m) with the rate alpha, about; None if none is found."""
        with np.errstate(all="ignore"):
            v = least_solution(self, alpha=alpha, start=np.ones(self.size))
        return None if v is None else v.reshape(-1, len(self.T))


def solved_whole(M: Any, acts: Array) -> Array | None:
    """The v > 0 (n, m) with M v = -acts (n, m), or None."""
    v = solved(M, acts.ravel(), np.ones(acts.size, dtype=bool))
    if v is None or not np.all(v > 0):
        return None
    return v.reshape(acts.shape)


def _spread(T: Array, v: Array) -> float:
    """The largest N of errors with |e|_inf <= 1."""
    return float(np.max(np.abs(T).sum(axis=1) / v))


def _factor(T: Array, v: Array) -> float:
    """The largest |e|_inf where N <= 1, times the largest N where |e|_inf <= 1."""
    return _spread(T, v) * float(np.max(v @ np.abs(np.linalg.inv(T)).T))


def in_floats(ranges: Sequence[GainRange]) -> Gains:
    """Gains that a claim states."""
    found = {}
    for each in ranges:
        ends = [[(float(x.lo), float(x.hi)) for x in row] for row in each.entries]
        found[each.coupling] = np.array(ends).transpose(2, 0, 1)
    return found


def _corners(T: Array, S: Array, ends: Array) -> Array:
    """T J S for every corner J of the gains, (corners, m, m)."""
    free = np.argwhere(ends[0] != ends[1])
    found = np.repeat(ends[:1], 2 ** len(free), axis=0)
    for number, choice in enumerate(product((0, 1), repeat=len(free))):
        for (a, b), end in zip(free, choice, strict=True):
            found[number, a, b] = ends[end, a, b]
    return np.asarray(T @ found @ S)


def candidates(agents: Agents, gains: Gains) -> list[Matrix]:
    """T worth trying, each once."""
    return list(dict.fromkeys(filter(None, _candidates(agents, gains))))


def _candidates(agents: Agents, gains: Gains) -> Iterator[Matrix | None]:
    """The same; None where rows are dependent."""
    m = agents.loop.m
    A = -agents.gains.mean(axis=0)
    pull = np.zeros((m, m))
    for group in agents.modes[0]:
        pull = pull + group.weights.sum() / agents.size * gains[group.place].mean(axis=0)
    yield _rounded(np.eye(m))
    for own in (A, A - pull):
        values, vectors = np.linalg.eig(own)
        # of a pair of complex eigenvectors the real and the imaginary part
        parts = [x.imag if z.imag < 0 else x.real for z, x in zip(values, vectors.T, strict=True)]
        modal = np.array(parts).T
        yield _rounded(np.linalg.inv(modal)) if np.linalg.cond(modal) < LARGEST else None
    seen = [each.mean(axis=0) for place, each in gains.items() if place != agents.loop.drift_place]
    outputs = linalg.orth(np.vstack(seen).T).T if seen else np.eye(m)
    first = np.eye(m)[: max(1, len(outputs))]
    size = largest_entry(np.linalg.eigvals(A - pull)) or 1.0
    for c, part in product((first, outputs), PARTS):
        step = np.eye(m) + A / (size * part)
        rows = np.vstack([c @ np.linalg.matrix_power(step, k) for k in range(m)])
        yield _rounded(np.array(_independent(rows)))


def _independent(rows: Array) -> list[Array]:
    """The first rows that do not depend on those before them."""
    chosen: list[Array] = []
    for row in rows:
        if len(chosen) < np.linalg.matrix_rank(np.array([*chosen, row]), tol=1e-9):
            chosen.append(row)
    return chosen


def _rounded(T: Array) -> Matrix | None:
    """Rows with the largest entry 1 (v makes up for it) and few digits; None if that is
    singular."""
    is_square = T.shape == (len(T), len(T))
    if not is_square or not np.all(np.isfinite(T)) or not np.all(np.abs(T).max(axis=1) > 0):
        return None
    T = T / np.abs(T).max(axis=1, keepdims=True)
    T = np.where(np.abs(T) > 1e-9, T, 0.0)
    rational = tuple(tuple(Fraction(f"{x:.{DIGITS}g}") for x in row) for row in T.tolist())
    return rational if rank(rational) == len(rational) else None


def propose_coordinates(cover: Cover, *, everywhere: bool, least: float) -> Separable | None:
    """A claim of the starts that are to be covered, or of all (``everywhere``), whose rows hold; or
    None.  ``least``: the rate (1/s) that it should have."""
    loop = cover.loop
    if loop.m > MOST_COMPONENTS:
        return None
    # Of a large network a part is enough to choose T.
    part = Agents.of(loop, most=LARGE)
    gains = part.gains_near(float(cover.radius))
    if gains is None:
        return None
    found: dict[Matrix, Promise] = {}
    for T in candidates(part, gains):
        promise = Search(part, cover, T).promise()
        if promise.rate > 0:
            found[T] = promise
    soonest = sorted(found, key=lambda T: found[T])[:SOONEST]
    fastest = sorted(found, key=lambda T: -found[T].rate)[:BEST]
    agents = Agents.of(loop, most=loop.n)
    for T in dict.fromkeys([*soonest, *fastest]):  # the fastest reach farthest
        search = Search(agents, cover, T, everywhere, least)
        claim = next(search.claims(found[T].rate), None)
        if claim is not None:
            return claim
    return None


class Promise(NamedTuple):
    """The time to one percent (s), about, and the largest rate (1/s) of the network alone; infinite
    and 0 without a v."""

    time: float
    rate: float


@dataclass(frozen=True, eq=False)
class Search:
    """Weights for these coordinates, beside the observer's part ``error``."""

    agents: Agents
    cover: Cover
    T: Matrix
    everywhere: bool = False
    least: float = 0.0
    error: ErrorBound | None = None

    def claims(self, rate: float) -> Iterator[Separable]:
        """Claims whose rows hold, the fastest first; ``rate``: what is expected."""
        for error in self.errors(rate):
            search = replace(self, error=error)
            for enough in (1.0,) if self.agents.loop.is_linear else PATIENCE:
                seen, v = search.weights(enough)
                if v is None:
                    continue
                claim = None
                soonest = search.sooner(v, seen)
                if soonest is not None:
                    claim = search.fastest_claim(soonest, seen)
                if claim is None:
                    claim = search.fastest_claim(v, seen)
                if claim is not None:
                    yield claim

    def errors(self, rate: float) -> Iterator[ErrorBound | None]:
        """Observer's parts whose V keeps a share of ``rate``, large shares first; None without an
        exosystem."""
        exosystem, gain = seen_through(self.agents.loop, self.T, self.cover.W)
        if exosystem is None or gain is None:
            yield None
            return
        for share in SHARES:
            slower = share * min(rate, decay_rate(exosystem, gain))
            error = propose_error_bound(exosystem, gain, rate=slower)
            if error is not None and error_bound_obstacle(exosystem, gain, error) is None:
                yield error

    def promise(self) -> Promise:
        """What these coordinates promise."""
        rate, v = self.weights(1.0)
        if v is None:
            return Promise(math.inf, 0.0)
        T = to_float(self.T)
        time = time_to_one_percent(rate, _factor(T, v))
        rows = self.rows(v)
        flat = None if rows is None else rows.least(PROMISED * rate)
        if flat is not None:
            time = min(time, time_to_one_percent(PROMISED * rate, _factor(T, flat)))
        return Promise(time, rate)

    def rows(self, v: Array) -> Rows | None:
        """The rows for the gains that go with v (n, m); None where these are not known."""
        T = to_float(self.T)
        rho = float(self.cover.radius) * _spread(T, v) + float(self.offset)
        gains = self.agents.gains_at(T, v, rho)
        return None if gains is None else Rows.of(self.agents, T, gains)

    def fastest_claim(self, v: Array, rate: float) -> Separable | None:
        """The claim with one of the roundings of v (n, m) that has the largest rate; None if none
        holds."""
        plan = SeparablePlan(v=v.ravel(), rate=rate, rho=self.cover.radius)
        tried = 1 if self.agents.loop.n > LARGE else 3
        claims = map(self.claim, islice(rounded_vectors(plan), tried))
        held = [claim for claim in claims if claim is not None]
        return max(held, key=lambda claim: claim.alpha, default=None)

    def sooner(self, v: Array, rate: float) -> Array | None:
        """The v (n, m) of a smaller rate that promises the least time to one percent, for the gains
        that go with ``v``, whose rate is given; None if none is earlier."""
        T = to_float(self.T)
        # V is no faster than that, whatever the rows allow
        error = self.error
        limit = math.inf if error is None else float(error.beta - 1 / error.kappa)
        longest = min(rate, limit)
        first = time_to_one_percent(longest, _factor(T, v))
        if not 0 < first * longest < math.inf or self.agents.size > LARGE:
            return None
        rows = self.rows(v)
        if rows is None:
            return None

        def at(alpha: float) -> Rated | None:
            flat = rows.least(alpha)
            if flat is None:
                return None
            return time_to_one_percent(min(alpha, limit), _factor(T, flat)), flat

        least = self.least * (1 + KEPT)
        found = soonest(at, first=first, longest=longest, least=least, steps=SOONER)
        return next((flat for time, flat in found if time < EARLIER * first), None)

    def weights(self, enough: float) -> tuple[float, Array | None]:
        """v (n, m) with min v = 1 that goes with the gains where it is used, and its rate; the
        flattest v that keeps ``enough`` of the best rate."""
        v = self.agents.ones
        rate = 0.0
        best = None
        # Weights belong to gains, and gains to how far the weights reach: one after the other.
        for _ in range(1 if self.agents.loop.is_linear else ROUNDS):
            rows = self.rows(v)
            found = [] if rows is None else rows.vectors()
            if not found:
                break
            rate, best = next(each for each in found if each[0] >= enough * found[-1][0])
            if np.allclose(best, v, rtol=CLOSE):
                break
            v = best
        return rate, best

    @property
    def offset(self) -> Fraction:
        """What the estimation error adds to rho."""
        error = self.error
        if error is None:
            return Fraction(0)
        return error.kappa * self.cover.disturbance * root_above(error.size, unit=10**6)

    def claim(self, v: Any) -> Separable | None:
        """The claim with these weights at the largest rate; None if its rows do not hold, or V does
        not fall."""
        loop = self.agents.loop
        T = self.T
        rho = None
        if not self.everywhere:
            rho = rounded_up(self.cover.radius * spread(T, v) + self.offset, digits=6)
        try:
            ranges = enclosed_ranges(loop, T, v, rho)
        except (UndefinedError, SpecError):
            return None
        alpha = rounded_down(slowest_row(loop, T, v, ranges).rate)
        if not alpha:
            return None
        claim = Separable(T=T, v=v, alpha=alpha, rho=rho, ranges=ranges, error=self.error)
        return claim if composite_rate(claim) > 0 else None
