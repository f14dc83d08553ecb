"""Proposals for staging: quadratic certificates, and which certificates at which levels in which order (section 5).

A table of vectors v at falling levels and the quadratic certificates there make a graph: from level L of one to the
level at which the next can take over costs ln(ratio)/rate.  The shortest way through it is the plan.

Quadratic stages have about the largest rate for a few radii; the stage before keeps the couplings within these.  For a
given rate the inequality of theory, section 4, is affine in P_e and theta = 2 tau d^2,

    [[P_e A0 + A0'P_e + 2 beta P_e + C'diag(theta) C,  P_e B diag(d)], [., -diag(theta)]] <= 0,    I <= P_e <= t I,

and the solver minimises t: a round P_e costs least when it takes over.  Floating point; nothing here is a proof, but
quadratic stages have been accepted by ``holds``, which decides exactly.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Final

import numpy as np

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.claim import Lure, linear_part
from dobc_design.conditions.quadratic.propose import raise_rate, roomy_gains, scaled_pair
from dobc_design.conditions.quadratic.sectors import GainRange, Sectors, build_sectors, enclose_ranges
from dobc_design.conditions.separable.propose import LARGE, field_of, propose_vectors
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import Cone, solve_cones, svec, symmetric_basis
from dobc_design.solvers.program import Array, round_matrix

# (agents, levels of the graph, levels at which v is sought, parts of the largest rate there)
SIZES: Final = ((60, 32, 8, (1.0, 0.97, 0.9, 0.75, 0.5)), (2000, 16, 4, (1.0, 0.9, 0.75)), (100_000, 8, 2, (1.0,)))
LOWEST: Final = 1 / 500  # of the first level; couplings are nearly linear long before
MOST_QUADRATICS: Final = 6
DECIMALS, BITS = 10**4, 2**20  # of v; binary for large networks
PENALTY: Final = 0.003  # of the time of the first stage alone, for every further one: short chains are worth that
ABOVE: Final = 1e-7  # of numbers that have to be above a matrix, for rounding
SHARE: Final = Fraction(9, 10)  # of the observer's rate that V = N + kappa E may use
#: Rows n m, and rows and channels of one mode, up to which quadratic stages are looked for: the programs are dense.
MOST_ROWS: Final = 24
MOST_BLOCK: Final = 90
BISECTIONS: Final = 5
PARTS: Final = (0.98, 0.93, 0.8)  # of the largest rate found, until a rounding is accepted
MARGIN: Final = 0.01  # of the rate, for rounding and for the observer
OBSERVER: Final = 0.7  # of the decay rate of A - WC, for the observer's pair
ROUNDEST: Final = 1e4  # the largest t that is worth a stage
DIGITS: Final = (6, 9)
ROOM: Final = Fraction(1, 10**4)  # of a gain
_Steps = dict[tuple[int, int], tuple[int, int]]  # from where each (level, vector) is reached


@dataclass(frozen=True, slots=True, kw_only=True)
class StagePlan:
    """Stages in order, max-separable then quadratic, and the settling time (s) that floating point sees.
    ``separable``: v and the level rho down from which it is to hold."""

    separable: tuple[tuple[Vector, Fraction], ...]
    quadratic: tuple[Lure, ...]
    time: float


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Levels (b,), vectors (a, n) as rationals and floats, and the rate (b, a) of each vector at each level."""

    levels: Array
    exact: tuple[Vector, ...]
    v: Array
    rates: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Quadratic:
    """A quadratic certificate in floats; ``reach`` (a,): sizes of N below which its guard holds, by vector.  ``entry``
    (a,): its size per N when it takes over."""

    lure: Lure
    P_e: Array
    height: float
    reach: Array
    entry: Array


def plan_stages(
    problem: Problem, *, rho: Fraction, tolerance: Fraction, fastest: float = math.inf, quadratics: Sequence[Lure] = ()
) -> list[StagePlan]:
    """Plan the stages from level ``rho`` down to |e|_inf <= tolerance: the quickest plan, and that without quadratics.

    ``fastest``: no max-separable rate counts beyond it (1/s; the observer's).  ``quadratics``: certificates with a
    rate and a radius, from which those that pay are chosen; at most MOST_QUADRATICS are looked at.
    Empty if no vector has a rate at ``rho``.
    """
    table = _tabulate(problem, rho=rho, tolerance=float(tolerance), fastest=fastest)
    if table is None or not np.any(table.rates[0] > 0):
        return []
    last = _time(table.levels[:, None] * np.max(table.v, axis=1), float(tolerance), table.rates)
    penalty = PENALTY * float(np.min(last[0]))
    reached, before = _shortest(table, penalty)
    plans = [_plan(table, reached + last, before, (), rho)]
    chosen = sorted(quadratics, key=lambda lure: -float(lure.radius or 0))[:MOST_QUADRATICS]
    widest = np.zeros(len(table.v))
    for arcs in problem.network.modes.values():
        sums = table.v[:, arcs.listeners] + table.v[:, arcs.speakers]
        widest = np.maximum(widest, np.max(sums, axis=1, initial=0.0))
    measured = []
    for lure in chosen:
        P_e, radius = to_float(lure.P_e.to_dense()), math.inf if lure.radius is None else float(lure.radius)
        height = math.sqrt(float(np.max(np.diag(np.linalg.inv(P_e)))))
        entry = np.array([math.sqrt(box_bound(P_e, np.repeat(v, problem.m))[0]) for v in table.v])
        measured.append(_Quadratic(lure, P_e, height, radius / np.maximum(widest, 1e-300), entry))
    chains = (itertools.combinations(measured, count + 1) for count in range(len(measured)))
    for chain in itertools.chain.from_iterable(chains):
        times = reached + _chain_times(table, chain, float(tolerance)) + penalty * len(chain)
        if float(np.min(times)) < plans[0].time:
            plans = [_plan(table, times, before, chain, rho), plans[-1]]
    return plans


def _plan(table: _Table, times: Array, before: _Steps, chain: Sequence[_Quadratic], rho: Fraction) -> StagePlan:
    """The way to the least of ``times`` (level, vector), which include those of ``chain``."""
    place: tuple[int, int] | None = divmod(int(np.argmin(times)), times.shape[1])
    steps = []
    while place is not None:
        level, vector = place
        steps.append((table.exact[vector], rho if level == 0 else _short(float(table.levels[level]))))
        place = before.get(place)
    lures = tuple(each.lure for each in chain)
    return StagePlan(separable=tuple(reversed(steps)), quadratic=lures, time=float(np.min(times)))


def box_bound(P_e: Array, v: Array) -> tuple[float, Array]:
    """The better of two D with P_e <= diag(D): (sum D_i v_i^2, D), for a box with half-widths v (n m,)."""
    rows = np.abs(P_e) @ v / v  # diagonal dominance after scaling with v
    even = np.full(len(v), float(np.linalg.eigvalsh(P_e)[-1]))
    return min(((float(D @ v**2), D) for D in (rows, even)), key=lambda pair: pair[0])


def matching_diagonal(P_e: SparseSymmetric, half_widths: Vector) -> Vector:
    """D with P_e <= diag(D) and a small sum of D_i half_widths_i^2, rounded up."""
    D = box_bound(to_float(P_e.to_dense()), np.array([float(x) for x in half_widths]))[1]
    return tuple(_short(float(x) * (1 + ABOVE), digits=9) for x in D)


def relative_bound(new: SparseSymmetric, old: SparseSymmetric) -> Fraction:
    """A number f with new <= f old, rounded up; old > 0."""
    quotient = np.linalg.solve(to_float(old.to_dense()), to_float(new.to_dense()))
    return _short(float(np.max(np.linalg.eigvals(quotient).real)) * (1 + ABOVE), digits=9)


def _tabulate(problem: Problem, *, rho: Fraction, tolerance: float, fastest: float) -> _Table | None:
    sizes = next((size for size in SIZES if problem.n <= size[0]), None)
    if sizes is None:
        return None
    _, count, sought, parts = sizes
    top = float(rho)
    low = max(min(tolerance, top), top * LOWEST)
    levels = np.geomspace(top, low, count) if low < top else np.array([top])
    exact: dict[Vector, None] = {}
    for level in levels[np.unique(np.linspace(0, len(levels) - 1, sought).round().astype(int))].tolist():
        for v in propose_vectors(problem, rho=level, parts=parts):
            unit = DECIMALS if problem.n <= LARGE else BITS
            exact[tuple(Fraction(round(x * unit), unit) for x in v.tolist())] = None
    if not exact:
        return None
    v = np.array([[float(x) for x in each] for each in exact])
    field = replace(field_of(problem, rho=top), grid=np.sort(np.concatenate([levels, 0.8 * levels])))
    rates = np.empty((len(levels), len(v)))
    for a, each in enumerate(v):
        falling = np.minimum.accumulate(field.rates(each))  # for all smaller s as well
        rates[:, a] = falling[np.searchsorted(field.grid, levels * (1 - 1e-12))]
    return _Table(levels, tuple(exact), v, np.minimum(rates, fastest))


def _shortest(table: _Table, penalty: float) -> tuple[Array, _Steps]:
    """The least time to reach each level of each vector, and from where; every hand-over costs ``penalty``."""
    levels, rates = table.levels, table.rates
    reached = np.full(rates.shape, np.inf)
    reached[0] = np.where(rates[0] > 0, 0.0, np.inf)
    before: _Steps = {}
    ratio = np.array([np.max(one / table.v, axis=1) for one in table.v])  # [from, to]
    for b in range(len(levels)):
        for later in range(b + 1, len(levels)):
            times = _time(levels[b], levels[later] / ratio, rates[b][:, None]) + reached[b][:, None] + penalty
            source = np.argmin(times, axis=0)
            least = times[source, np.arange(len(source))]
            for a in np.flatnonzero((least < reached[later]) & (rates[later] > 0)).tolist():
                reached[later, a] = least[a]
                before[later, a] = (b, int(source[a]))
    return reached, before


def _chain_times(table: _Table, chain: Sequence[_Quadratic], tolerance: float) -> Array:
    """The time from each level of each vector to the tolerance through the quadratic certificates, (b, a)."""
    first = chain[0]
    levels = np.broadcast_to(table.levels[:, None], table.rates.shape)
    below = np.minimum(levels, first.reach)
    times = _time(levels, below, table.rates)
    size = below * first.entry
    for old, new in itertools.pairwise(chain):
        below = size
        if new.lure.radius is not None:  # of ``old``, below which every |e_i - e_j| is within that radius, or less
            Y = np.linalg.inv(old.P_e)
            widths = np.diag(Y)[:, None] + np.diag(Y)[None, :] - 2 * Y
            below = np.minimum(size, float(new.lure.radius) / math.sqrt(float(np.max(widths))))
        times = times + _time(size, below, float(old.lure.rate))
        size = below * math.sqrt(float(np.max(np.linalg.eigvals(np.linalg.solve(old.P_e, new.P_e)).real)))
    top = size * chain[-1].height
    return times + _time(top, np.minimum(top, tolerance), float(chain[-1].lure.rate))


def _time(high: Array | float, low: Array | float, rate: Array | float) -> Array:
    """ln(high/low)/rate, 0 where there is nothing to wait for, inf without a rate."""
    ratio, speed = np.broadcast_arrays(np.maximum(np.log(np.asarray(high) / low), 0.0), np.asarray(rate, dtype=float))
    return np.where(speed > 0, ratio / np.where(speed > 0, speed, 1.0), np.inf)


def _short(value: float, *, digits: int = 6) -> Fraction:
    return Fraction(f"{value:.{digits}g}")


def propose_quadratic_stages(
    problem: Problem, *, W: Matrix | None, holds: Callable[[Lure], bool], radii: Sequence[float], slowest: float
) -> list[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s) exceeds ``slowest``.
    Linear couplings need no radius and have one.  Empty for networks beyond MOST_ROWS or MOST_BLOCK."""
    size, arcs = problem.n * problem.m, max(len(each) for each in problem.network.modes.values())
    if size > MOST_ROWS or size + arcs * problem.m > MOST_BLOCK:
        return []
    fastest = _observer_rate(problem, W) if problem.groups else math.inf
    found: list[Lure] = []
    for radius in [None] if problem.is_linear else [Fraction(f"{radius:.6g}") for radius in sorted(radii)]:
        try:
            ranges = enclose_ranges(problem, radius=radius, enclose=partial(roomy_gains, room=ROOM))
        except UndefinedError:
            break  # larger radii are harder
        loop = _Loop(problem, W, ranges, build_sectors(problem, ranges, radius=radius), radius)
        lure = next(filter(holds, loop.certificates(slowest=slowest, fastest=fastest)), None)
        if lure is None:
            break
        found.append(raise_rate(problem, lure, holds=holds))
        fastest = min(fastest, float(found[-1].rate) / PARTS[0])
    return found


def _observer_rate(problem: Problem, W: Matrix | None) -> float:
    """A rate at which the observer's pair can be had, 0 without one."""
    exosystem = problem.joint_exosystem
    if exosystem is None or W is None:
        return 0.0
    return max(0.0, OBSERVER * decay_rate(exosystem, W))


@dataclass(frozen=True, slots=True, eq=False)
class _Mode:
    """One mode in floats: A0 (N, N); of the k channels with a range B diag(d) (N, k) and C (k, N)."""

    name: str
    A: Array
    B: Array
    C: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Loop:
    """The loop with the gains that it has within a radius."""

    problem: Problem
    W: Matrix | None
    ranges: tuple[GainRange, ...]
    sectors: Sectors
    radius: Fraction | None

    def certificates(self, *, slowest: float, fastest: float) -> Iterator[Lure]:
        """Certificates with rates between these two, the fastest first."""
        modes, low = [self._floats(name) for name in self.sectors.modes], slowest
        high = min(fastest, *(-float(np.max(np.linalg.eigvals(mode.A).real)) for mode in modes))
        if high <= low or _solved(modes, low) is None:
            return
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (middle, high) if _solved(modes, middle) is not None else (low, middle)
        for part in PARTS:
            if part * low <= slowest:
                break
            answer = _solved(modes, part * low)
            if answer is not None:
                yield from self._rounded(*answer, rate=part * low)

    def _floats(self, name: str) -> _Mode:
        channels, size = self.sectors.modes[name], self.sectors.size
        A = np.zeros((size, size))
        for i, row in linear_part(self.sectors, name, [channel.centre for channel in channels]).items():
            for j, value in row.items():
                A[i, j] = float(value)
        curved = [channel for channel in channels if channel.spread]
        B, C = np.zeros((size, len(curved))), np.zeros((len(curved), size))
        for k, channel in enumerate(curved):
            B[channel.target, k] = float(channel.spread)
            C[k, channel.plus] += 1.0
            C[k, channel.minus] -= 1.0
        return _Mode(name, A, B, C)

    def _rounded(self, metric: Array, thetas: Mapping[str, Array], *, rate: float) -> Iterator[Lure]:
        """Certificates with few digits first, and the observer's pair scaled so that its border is small."""
        problem, W, pair = self.problem, self.W, None
        if problem.groups and W is not None:
            slow = rounded_down(_observer_rate(problem, W), digits=6)
            pair = scaled_pair(problem, W, rate=slow, disturbance=Fraction(0))
            if pair is None:
                return
        for digits in DIGITS:
            P_e = round_matrix(metric, digits)
            values = np.linalg.eigvalsh(to_float(P_e))
            if not values[0] > 0:
                continue
            P = level = None
            if pair is not None:
                border = float(np.linalg.norm(pair.S, 2)) * float(values[-1])
                P = scale(rounded_down(max(border / (MARGIN * rate), 1e-6), digits=3), pair.P)
            if self.radius is not None:  # |e_i - e_j|^2 <= 4 V/lambda_min(P_e)
                level = rounded_down(float(self.radius) ** 2 * float(values[0]) / 4, digits=6)
            yield Lure(
                P_e=SparseSymmetric.from_dense(P_e),
                ranges=self.ranges,
                radius=self.radius,
                level=level,
                rate=rounded_down(rate, digits=6),
                multipliers={name: self._multipliers(name, theta, digits) for name, theta in thetas.items()},
                P=P,
                Q=None if P is None or W is None else multiply(P, W),
            )

    def _multipliers(self, name: str, theta: Array, digits: int) -> Vector:
        """Tau = theta / (2 d^2) of every channel with a range, 0 elsewhere."""
        values, spreads = iter(theta.tolist()), [float(channel.spread) for channel in self.sectors.modes[name]]
        taus = (max(next(values) / (2 * spread**2), 1e-12) if spread else 0.0 for spread in spreads)
        return tuple(rounded_down(tau, digits=digits) for tau in taus)


def _solved(modes: Sequence[_Mode], rate: float) -> tuple[Array, dict[str, Array]] | None:
    """The roundest P_e with this rate and a little more, and theta by mode; None if the solver finds none."""
    units = symmetric_basis(len(modes[0].A))
    starts = np.cumsum([len(units), *(mode.B.shape[1] for mode in modes)])
    cost = np.zeros(int(starts[-1]) + 1)  # P_e, theta of every mode, t
    cost[-1] = 1.0
    answer = solve_cones(cost, list(_cones(modes, units, starts, rate * (1 + MARGIN))))
    if answer.status not in {"Solved", "AlmostSolved"} or not answer.found or answer.x[-1] > ROUNDEST:
        return None
    P_e = np.sum([value * unit for value, unit in zip(answer.x.tolist(), units, strict=False)], axis=0)
    parts = np.split(answer.x[: int(starts[-1])], starts[:-1])[1:]
    return P_e, {mode.name: part for mode, part in zip(modes, parts, strict=True)}


def _cones(modes: Sequence[_Mode], units: Sequence[Array], starts: Array, rate: float) -> Iterator[Cone]:
    """T I - P_e >= 0, P_e - I >= 0, and minus the inequality of each mode."""
    size, total = len(modes[0].A), int(starts[-1]) + 1
    eye = svec(np.eye(size))
    P_e = np.stack([svec(unit) for unit in units], axis=1)
    thetas = np.zeros((len(eye), total - len(units) - 1))
    yield Cone("semidefinite", np.column_stack([P_e, thetas, -eye]), 0 * eye)
    yield Cone("semidefinite", np.column_stack([-P_e, thetas, 0 * eye]), -eye)
    for start, mode in zip(starts.tolist(), modes, strict=False):
        k = mode.B.shape[1]
        rows = np.zeros(((size + k) * (size + k + 1) // 2, total))
        for column, unit in enumerate(units):
            product = unit @ mode.A
            corner, side = product + product.T + 2 * rate * unit, unit @ mode.B
            rows[:, column] = svec(np.block([[corner, side], [side.T, np.zeros((k, k))]]))
        for channel in range(k):
            whole = np.zeros((size + k, size + k))
            whole[:size, :size] = np.outer(mode.C[channel], mode.C[channel])
            whole[size + channel, size + channel] = -1.0
            rows[:, start + channel] = svec(whole)
        yield Cone("semidefinite", rows, np.zeros(len(rows)))
