"""Proposals of coordinates z = T x and weights v (theory, section 13); floating point.

T: the identity, real modal forms of an agent with mean gains, or rows c (I + A/lambda)^k for
outputs c of the agents. For fixed gains the rows are the largest of linear functions of v with
Metzler matrices; inverse iteration on the matrix that is largest at the last v finds the v with the
best rate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, product
from typing import Any

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import (
    golden_section,
    rounded_down,
    rounded_up,
    time_to_one_percent,
)
from dobc_design.conditions.quadratic.sectors import GainRange, gains_at
from dobc_design.conditions.separable.claim import MOST_COMPONENTS, ErrorBound, Separable
from dobc_design.conditions.separable.coordinates import (
    MOST_FREE,
    enclosed_ranges,
    seen_through,
    slowest_row,
)
from dobc_design.conditions.separable.decide import composite_rate, error_bound_obstacle
from dobc_design.conditions.separable.propose import (
    EARLIER,
    KEPT,
    LARGE,
    SeparablePlan,
    least_solution,
    rounded_vectors,
    solved,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, rank, to_float
from dobc_design.exact.number import root_above
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import coupling_places, split_by
from dobc_design.loop.loop import Loop
from dobc_design.solvers.program import Array

Gains = Mapping[int, Array]  # by the place of a coupling: the ends, (2, m, m)

DIGITS = 3  # of T
# of the size of an agent's eigenvalues: lambda
PARTS = tuple(2.0 ** (k / 4) for k in range(-16, 6))
STEPS, ROUNDS = 6, 4  # of inverse iteration; of v and gains in turn
# coordinates whose weights are rounded: the fastest ones, and before these the soonest
BEST, SOONEST = 3, 2
PATIENCE = (1.0, 0.5, 0.0)  # of the best rate, which a flatter v is to keep
CLOSE, LARGEST = 1e-3, 1e6  # of v, when it is kept; condition of a modal form
SHARES = (0.9, 0.5, 0.0)  # of the rate of the rows, which V is to keep
PROMISED = 0.7  # of the largest rate, at which coordinates are compared
SOONER = 8  # rates that are tried for the least time to one percent
ROUGHLY = Fraction(1, 1000)  # how far gains are enclosed in the search


@dataclass(frozen=True, eq=False)
class Agents:
    """The rows of ``size`` agents in floats: their gains (size, m, m), the slopes that nodes have
    in them (m, m), arcs by mode and coupling: listeners, speakers, weights, and which are always
    there.  The speaker number ``size`` is at the target: of large networks a part is enough to
    choose T."""

    loop: Loop
    size: int
    gains: Array
    slopes: Array
    modes: tuple[tuple[tuple[int, Any, Any, Array, Any], ...], ...]

    @classmethod
    def of(cls, loop: Loop, *, most: int) -> Agents:
        size, m = min(loop.n, most), loop.m
        gains, known = np.zeros((size, m, m)), dict[int, Array]()
        for i, k in loop.pulls.gains.items():
            if i < size:
                gains[i] = known[id(k)] if id(k) in known else known.setdefault(id(k), to_float(k))
        modes = []
        for arcs in loop.modes.values():
            w, places = np.array([float(x) for x in arcs.weights]), coupling_places(loop, arcs)
            here = np.flatnonzero(arcs.listeners < size)
            parts = [(place, here[own]) for place, own in split_by(places[here])]
            hears, heard, sure = arcs.listeners, np.minimum(arcs.speakers, size), ~arcs.uncertain
            modes.append(
                tuple((place, hears[own], heard[own], w[own], sure[own]) for place, own in parts)
            )
        slopes = loop.slopes
        return cls(
            loop, size, gains, to_float(slopes) if slopes else np.zeros((m, m)), tuple(modes)
        )

    def rows(self, T: Array, gains: Gains, v: Array) -> tuple[Array, Any]:
        """The largest row of every component at v (n, m), and the sparse matrix whose product with
        v it is."""
        (n, m), S, agents = v.shape, np.asarray(np.linalg.inv(T), dtype=float), np.arange(self.size)
        node, everybody, best, chosen = (
            self.loop.drift_place,
            np.vstack([v, np.zeros((1, m))]),
            [],
            [],
        )
        H, corners = (
            T @ self.gains @ S,
            {k: _corners(T, S, ends) for k, ends in gains.items() if k != node},
        )

        def row(groups: Any, c: int, sign: Array) -> Any:
            own, x = -H[:, c, :], v * sign
            if node is not None:
                low, high = gains[node] - self.slopes
                own = (
                    own + T[c] @ np.where(T[c][:, None] * (x @ S.T)[:, None, :] >= 0, high, low) @ S
                )
            parts = [(agents, agents, own * sign)]
            for place, i, j, w, sure in groups:
                G = corners[place][:, c, :]
                value = everybody[j] @ np.abs(G).T - x[i] @ G.T
                g = (w * (sure | (np.max(value, axis=1) > 0)))[:, None] * G[
                    np.argmax(value, axis=1)
                ]
                parts += [(i, j, np.abs(g)), (i, i, -g * sign)]
            i, j, entries = map(np.concatenate, zip(*parts, strict=True))
            places = np.repeat(i, m), (j[:, None] * m + np.arange(m)).ravel()
            return sparse.csr_array((entries.ravel(), places), shape=(n, n * m + m))

        for c in range(m):
            signs = [np.array(sign) for sign in product((1.0, -1.0), repeat=m) if sign[c] > 0]
            M = sparse.vstack(
                [row(groups, c, sign) for groups in self.modes for sign in signs], format="csr"
            )
            values = (M @ everybody.ravel()).reshape(-1, n)
            best.append(values.max(axis=0))
            chosen.append(M[values.argmax(axis=0) * n + agents])
        by_agent = np.arange(n * m).reshape(m, n).T.ravel()
        return np.array(best).T, sparse.vstack(chosen, format="csr")[by_agent][:, : n * m]

    def largest(self, T: Array, gains: Gains, v: Array) -> Array:
        """The largest row of every component at many v (count, n, m), as in ``rows``."""
        spend(8 + v.size // 20)
        S, found, node, m = (
            np.asarray(np.linalg.inv(T), dtype=float),
            np.empty_like(v),
            self.loop.drift_place,
            len(T),
        )
        H, corners = (
            T @ self.gains @ S,
            {k: _corners(T, S, ends) for k, ends in gains.items() if k != node},
        )
        everybody, all_signs = (
            np.pad(v, ((0, 0), (0, 1), (0, 0))),
            np.array(list(product((1.0, -1.0), repeat=m))),
        )
        for c in range(m):
            x = v * all_signs[all_signs[:, c] > 0][:, None, None, :]  # (signs, count, n, m)
            alone, best = -np.sum(H[:, c, :] * x, axis=-1), -np.inf
            if node is not None:
                pulled = T[c][:, None] * (x @ S.T)[..., None, :]
                alone += np.max([pulled * ends for ends in gains[node] - self.slopes], axis=0).sum(
                    axis=(-2, -1)
                )
            for groups in self.modes:
                total = alone
                for place, i, j, w, sure in groups:
                    G = corners[place][:, c, :]
                    value = np.max(everybody[:, j] @ np.abs(G).T - x[..., i, :] @ G.T, axis=-1)
                    total = (
                        total
                        + np.where(sure, value, np.maximum(value, 0.0)) * w @ np.eye(self.size)[i]
                    )
                best = np.maximum(best, total.max(axis=0))
            found[..., c] = best
        return found

    def vectors(self, T: Array, gains: Gains) -> list[tuple[float, Array]]:
        """Rates > 0 with their v (n, m), min v = 1: the flattest v first, the fastest last."""
        v, found = np.ones((self.size, self.loop.m)), list[tuple[float, Array]]()
        best, M = self.rows(T, gains, v)
        for _ in range(STEPS):
            if (rate := float(np.min(-best / v))) > 0 and (not found or rate > found[-1][0]):
                found.append((rate, v))
            u = solved(M, v.ravel(), np.ones(v.size, dtype=bool))
            if u is None or not np.all(u > 0):
                break
            v = (u / u.min()).reshape(v.shape)
            best, M = self.rows(T, gains, v)
        return found

    def gains_at(self, T: Array, v: Array, rho: float) -> Gains | None:
        """The gains where N <= rho, three digits further; None where a coupling is not defined, or
        has too many."""
        sizes = rho * np.vstack([v, 0 * v[:1]]) @ np.abs(np.linalg.inv(T)).T
        far, found = dict[int, Array](), list[GainRange]()
        for place, i, j, _, _ in (group for groups in self.modes for group in groups):
            far[place] = np.maximum(far.get(place, 0.0), np.max(sizes[i] + sizes[j], axis=0))
        if self.loop.drift_place is not None:
            far[self.loop.drift_place] = np.max(sizes, axis=0)
        for place, radii in far.items():
            try:
                sides = [rounded_up(Fraction(x), digits=3) for x in radii.tolist()]
                entries = gains_at(self.loop, place, sides, tolerance=ROUGHLY)
            except UndefinedError:
                return None
            if (
                place != self.loop.drift_place
                and sum(not x.is_point for row in entries for x in row) > MOST_FREE
            ):
                return None
            found.append(GainRange(coupling=place, radius=None, entries=entries))
        return in_floats(found)


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of all components for fixed gains, as ``least_solution`` takes them."""

    agents: Agents
    T: Array
    gains: Gains

    @property
    def size(self) -> int:
        return self.agents.size * len(self.T)

    def rows(self, v: Array, *, alpha: float) -> tuple[Array, Any, Array]:
        """The largest row of every component at v (n m,) with the rate alpha, its Jacobian, the
        size of its terms."""
        best, M = self.agents.rows(self.T, self.gains, v.reshape(-1, len(self.T)))
        jacobian = sparse.csr_array(M + alpha * sparse.eye_array(self.size))
        return best.ravel() + alpha * v, jacobian, abs(M) @ v + alpha * v


def _spread(T: Array, v: Array) -> float:
    """The largest N of errors with |e|_inf <= 1."""
    return float(np.max(np.abs(T).sum(axis=1) / v))


def _factor(T: Array, v: Array) -> float:
    """The largest |e|_inf where N <= 1, times the largest N where |e|_inf <= 1."""
    return _spread(T, v) * float(np.max(v @ np.abs(np.linalg.inv(T)).T))


def in_floats(ranges: Sequence[GainRange]) -> Gains:
    """Gains that a claim states."""
    ends = {
        x.coupling: np.array([[[float(y.lo), float(y.hi)] for y in row] for row in x.entries])
        for x in ranges
    }
    return {place: each.transpose(2, 0, 1) for place, each in ends.items()}


def _corners(T: Array, S: Array, ends: Array) -> Array:
    """T J S for every corner J of the gains, (corners, m, m)."""
    free = np.argwhere(ends[0] != ends[1])
    found = np.repeat(ends[:1], 2 ** len(free), axis=0)
    for number, choice in enumerate(product((0, 1), repeat=len(free))):
        for (a, b), end in zip(free, choice, strict=True):
            found[number, a, b] = ends[end, a, b]
    return np.asarray(T @ found @ S)


def candidates(agents: Agents, gains: Gains) -> Iterator[Matrix | None]:
    """T worth trying; None where rows are dependent."""
    m, A, pull = agents.loop.m, -agents.gains.mean(axis=0), np.zeros((agents.loop.m,) * 2)
    for place, _, _, w, _ in agents.modes[0]:
        pull = pull + w.sum() / agents.size * gains[place].mean(axis=0)
    yield _rounded(np.eye(m))
    for own in (A, A - pull):
        values, vectors = np.linalg.eig(own)
        modal = np.array(
            [x.imag if z.imag < 0 else x.real for z, x in zip(values, vectors.T, strict=True)]
        ).T
        yield _rounded(np.linalg.inv(modal)) if np.linalg.cond(modal) < LARGEST else None
    seen = [each.mean(axis=0) for place, each in gains.items() if place != agents.loop.drift_place]
    outputs = linalg.orth(np.vstack(seen).T).T if seen else np.eye(m)
    first, size = (
        np.eye(m)[: max(1, len(outputs))],
        float(np.max(np.abs(np.linalg.eigvals(A - pull)))) or 1.0,
    )
    for c, part in product((first, outputs), PARTS):
        rows = np.vstack(
            [c @ np.linalg.matrix_power(np.eye(m) + A / (size * part), k) for k in range(m)]
        )
        chosen: list[Array] = []
        for row in rows:
            if len(chosen) < np.linalg.matrix_rank(np.array([*chosen, row]), tol=1e-9):
                chosen.append(row)
        yield _rounded(np.array(chosen))


def _rounded(T: Array) -> Matrix | None:
    """Rows with the largest entry 1 (v makes up for it) and few digits; None if that is
    singular."""
    if (
        T.shape != (len(T),) * 2
        or not np.all(np.isfinite(T))
        or not np.all(np.abs(T).max(axis=1) > 0)
    ):
        return None
    T = T / np.abs(T).max(axis=1, keepdims=True)
    T = np.where(np.abs(T) > 1e-9, T, 0.0)
    rational = tuple(tuple(Fraction(f"{x:.{DIGITS}g}") for x in row) for row in T.tolist())
    return rational if rank(rational) == len(rational) else None


def propose_coordinates(
    loop: Loop,
    W: Matrix | None,
    radius: Fraction,
    disturbance: Fraction,
    *,
    everywhere: bool = False,
    least: float = 0.0,
) -> Separable | None:
    """A claim of every start with |e|_inf <= radius and |eps_i| <= disturbance, or ``everywhere``,
    whose rows hold; or None.  ``least``: the rate (1/s) that it should have."""
    if loop.m > MOST_COMPONENTS:
        return None
    agents, part = Agents.of(loop, most=loop.n), Agents.of(loop, most=LARGE)
    gains = part.gains_at(np.eye(loop.m), np.ones((part.size, loop.m)), float(radius))
    found = dict[Matrix, tuple[float, float]]()  # time to one percent and rate
    for T in candidates(part, gains) if gains is not None else ():
        if T is not None and T not in found:
            found[T] = Search(part, W, T, radius, disturbance, everywhere).promise()
    able = [T for T in found if found[T][1] > 0]
    soonest, fastest = (
        sorted(able, key=lambda T: found[T])[:SOONEST],
        sorted(able, key=lambda T: -found[T][1])[:BEST],
    )
    best = dict.fromkeys([*soonest, *fastest])  # the fastest reach farthest
    searches = (Search(agents, W, T, radius, disturbance, everywhere, least) for T in best)
    return next((claim for search in searches for claim in search.claims(found[search.T][1])), None)


@dataclass(frozen=True, eq=False)
class Search:
    """Weights for these coordinates."""

    agents: Agents
    W: Matrix | None
    T: Matrix
    radius: Fraction
    disturbance: Fraction
    everywhere: bool
    least: float = 0.0

    def claims(self, rate: float) -> Iterator[Separable]:
        """Claims whose rows hold, the fastest first; ``rate``: what is expected."""
        loop = self.agents.loop
        exosystem, gain = seen_through(loop, self.T, self.W)
        for share in SHARES if exosystem is not None else (0.0,):
            error = None
            if exosystem is not None and gain is not None:
                error = propose_error_bound(
                    exosystem, gain, rate=share * min(rate, decay_rate(exosystem, gain))
                )
                if error is None or error_bound_obstacle(exosystem, gain, error) is not None:
                    continue
            for enough in (1.0,) if loop.is_linear else PATIENCE:
                seen, v = self.weights(error, enough)
                if v is not None:
                    planned = (self.sooner(v, seen, error), v)
                    found = (
                        self.fastest_claim(each, seen, error)
                        for each in planned
                        if each is not None
                    )
                    yield from islice((claim for claim in found if claim is not None), 1)

    def promise(self) -> tuple[float, float]:
        """The time to one percent, about, and the largest rate of the network alone; infinite and 0
        without a v."""
        rate, v = self.weights(None, 1.0)
        if v is None:
            return math.inf, 0.0
        T, time = to_float(self.T), time_to_one_percent(rate, _factor(to_float(self.T), v))
        gains = self.agents.gains_at(T, v, float(self.radius) * _spread(T, v))
        if gains is None:
            return time, rate
        with np.errstate(all="ignore"):
            w = least_solution(
                Rows(self.agents, T, gains), alpha=PROMISED * rate, start=np.ones(v.size)
            )
        if w is not None:
            time = min(time, time_to_one_percent(PROMISED * rate, _factor(T, w.reshape(v.shape))))
        return time, rate

    def fastest_claim(self, v: Array, rate: float, error: ErrorBound | None) -> Separable | None:
        """The claim with one of the roundings of v (n, m) that has the largest rate; None if none
        holds."""
        vectors = rounded_vectors(SeparablePlan(v=v.ravel(), rate=rate, rho=self.radius))
        claims = (self.claim(each, error) for each in vectors)
        some = islice(claims, 1 if self.agents.loop.n > LARGE else 3)
        return max(
            (claim for claim in some if claim is not None),
            key=lambda claim: claim.alpha,
            default=None,
        )

    def sooner(self, v: Array, rate: float, error: ErrorBound | None) -> Array | None:
        """The v (n, m) of a smaller rate that promises the least time to one percent, for the gains
        that go with ``v``, whose rate is given; None if none is earlier."""
        agents, T = self.agents, to_float(self.T)
        limit = math.inf if error is None else float(error.beta - 1 / error.kappa)
        gains = agents.gains_at(
            T, v, float(self.radius) * _spread(T, v) + float(self.offset(error))
        )
        longest = min(rate, limit)
        first = time_to_one_percent(longest, _factor(T, v))
        if gains is None or not 0 < first * longest < math.inf or agents.size > LARGE:
            return None
        shortest = max(math.log(100) / first, self.least * (1 + KEPT))
        if longest <= shortest:
            return None
        rows, found = Rows(agents, T, gains), list[tuple[float, Array]]()

        def at(alpha: float) -> float:
            with np.errstate(all="ignore"):
                w = least_solution(rows, alpha=alpha, start=np.ones(v.size))
            if w is None:
                return math.inf
            found.append(
                (
                    time_to_one_percent(min(alpha, limit), _factor(T, w.reshape(v.shape))),
                    w.reshape(v.shape),
                )
            )
            return found[-1][0]

        golden_section(at, shortest, longest, steps=SOONER)
        time, best = min(found, key=lambda each: each[0], default=(math.inf, None))
        return best if time < EARLIER * first else None

    def weights(self, error: ErrorBound | None, enough: float) -> tuple[float, Array | None]:
        """v (n, m) with min v = 1 that goes with the gains where it is used, and its rate; the
        flattest v that keeps ``enough`` of the best rate."""
        agents, T, rate, best = self.agents, to_float(self.T), 0.0, None
        v: Array = np.ones((agents.size, agents.loop.m))
        for _ in range(1 if agents.loop.is_linear else ROUNDS):
            rho = float(self.radius) * float(np.max(np.abs(T).sum(axis=1) / v)) + float(
                self.offset(error)
            )
            gains = agents.gains_at(T, v, rho)
            found = [] if gains is None else agents.vectors(T, gains)
            if not found:
                break
            rate, best = next(each for each in found if each[0] >= enough * found[-1][0])
            if np.allclose(best, v, rtol=CLOSE):
                break
            v = best
        return rate, best

    def offset(self, error: ErrorBound | None) -> Fraction:
        """What the estimation error adds to rho."""
        return (
            Fraction(0)
            if error is None
            else error.kappa * self.disturbance * root_above(error.size, unit=10**6)
        )

    def claim(self, v: Any, error: ErrorBound | None) -> Separable | None:
        """The claim with these weights at the largest rate; None if its rows do not hold, or V does
        not fall."""
        plain, loop = (
            Separable(T=self.T, v=v, alpha=Fraction(1), rho=None, error=error),
            self.agents.loop,
        )
        rho = (
            None
            if self.everywhere
            else rounded_up(self.radius * plain.spread + self.offset(error), digits=6)
        )
        try:
            ranges = enclosed_ranges(loop, self.T, v, rho)
        except (UndefinedError, SpecError):
            return None
        alpha = rounded_down(slowest_row(loop, self.T, v, ranges).rate)
        claim = alpha and Separable(T=self.T, v=v, alpha=alpha, rho=rho, ranges=ranges, error=error)
        return claim if claim and composite_rate(claim) > 0 else None
