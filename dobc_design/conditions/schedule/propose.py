"""Proposals for staging: quadratic certificates, and which certificates at which levels in which order (section 5).

A table of vectors v at falling levels makes a graph: from level L of one to the level at which the next can take over
costs ln(ratio)/rate.  The shortest way through it is the plan; where quadratic stages take over, ``stage`` tries out.

Quadratic stages have about the largest rate for a few radii; the stage before keeps the couplings within these.
Floating point; nothing here is a proof, but quadratic stages have been accepted by ``holds``, which decides exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import rounded_down
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.propose import fast_lures, linear_rate, raise_rate
from dobc_design.conditions.separable.propose import LARGE, field_of, propose_vectors
from dobc_design.exact.matrix import Matrix, Vector, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

# (agents, levels of the graph, levels at which v is sought, parts of the largest rate there)
SIZES: Final = ((60, 32, 8, (1.0, 0.97, 0.9, 0.75, 0.5)), (2000, 16, 4, (1.0, 0.9, 0.75)), (100_000, 8, 2, (1.0,)))
LOWEST: Final = 1 / 500  # of the first level; couplings are nearly linear long before
DECIMALS, BITS = 10**4, 2**20  # of v; binary for large networks
PENALTY: Final = 0.003  # of the time of the first stage alone, for every further one: short chains are worth that
ABOVE: Final = 1e-7  # of numbers that have to be above a matrix, for rounding
SHARE: Final = Fraction(9, 10)  # of the observer's rate that V = N + kappa E may use
#: Rows n m, and rows and channels of one mode, up to which quadratic stages are looked for: the programs are dense.
MOST_ROWS: Final = 24
MOST_BLOCK: Final = 90
OBSERVER: Final = 0.7  # of the decay rate of A - WC, for the observer's pair
_Steps = dict[tuple[int, int], tuple[int, int]]  # from where each (level, vector) is reached


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Levels (b,), vectors (a, n) as rationals and floats, and the rate (b, a) of each vector at each level."""

    levels: Array
    exact: tuple[Vector, ...]
    v: Array
    rates: Array


def plan_stages(
    problem: Problem, *, rho: Fraction, tolerance: Fraction, fastest: float = math.inf
) -> list[tuple[Vector, Fraction]]:
    """The quickest way from level ``rho`` down to |e|_inf <= tolerance: vectors v, and the level down from which each
    is to hold.  ``fastest``: no rate counts beyond it (1/s; the observer's).  Empty if no v has a rate at ``rho``."""
    table = _tabulate(problem, rho=rho, tolerance=float(tolerance), fastest=fastest)
    if table is None or not np.any(table.rates[0] > 0):
        return []
    last = _time(table.levels[:, None] * np.max(table.v, axis=1), float(tolerance), table.rates)
    reached, before = _shortest(table, PENALTY * float(np.min(last[0])))
    place: tuple[int, int] | None = divmod(int(np.argmin(reached + last)), last.shape[1])
    steps = []
    while place is not None:
        level, vector = place
        steps.append((table.exact[vector], rho if level == 0 else _short(float(table.levels[level]))))
        place = before.get(place)
    return steps[::-1]


def matching_diagonal(P_e: SparseSymmetric, half_widths: Vector) -> Vector:
    """The better of two D with P_e <= diag(D): a small sum of D_i half_widths_i^2 (n m,), rounded up."""
    floats, v = to_float(P_e.to_dense()), np.array([float(x) for x in half_widths])
    rows = np.abs(floats) @ v / v  # diagonal dominance after scaling with v
    even = np.full(len(v), float(np.linalg.eigvalsh(floats)[-1]))
    D = min((rows, even), key=lambda each: float(each @ v**2))
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


def _time(high: Array | float, low: Array | float, rate: Array | float) -> Array:
    """ln(high/low)/rate, 0 where there is nothing to wait for, inf without a rate."""
    ratio, speed = np.broadcast_arrays(np.maximum(np.log(np.asarray(high) / low), 0.0), np.asarray(rate, dtype=float))
    return np.where(speed > 0, ratio / np.where(speed > 0, speed, 1.0), np.inf)


def _short(value: float, *, digits: int = 6) -> Fraction:
    return Fraction(f"{value:.{digits}g}")


@np.errstate(all="ignore")  # near the ends of the floats
def propose_quadratic_stages(
    problem: Problem, *, W: Matrix | None, holds: Callable[[Lure], bool], radii: Sequence[float], slowest: float
) -> list[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s) exceeds ``slowest``.
    Linear couplings need no radius and have one.  Empty for networks beyond MOST_ROWS or MOST_BLOCK."""
    size, arcs = problem.n * problem.m, max(len(each) for each in problem.network.modes.values())
    if size > MOST_ROWS or size + arcs * problem.m > MOST_BLOCK:
        return []
    observer, fastest = Fraction(0), linear_rate(problem, W)
    if (exosystem := problem.joint_exosystem) is not None:
        observer = rounded_down(0.0 if W is None else max(0.0, OBSERVER * decay_rate(exosystem, W)), digits=6)
        fastest = min(fastest, float(observer))
    found: list[Lure] = []
    for radius in [None] if problem.is_linear else sorted(radii):
        lures = fast_lures(problem, radius=radius, W=W, observer=observer, rates=(slowest, fastest))
        lure = next(filter(holds, lures), None)
        if lure is None:
            break  # larger radii are harder
        found.append(raise_rate(problem, lure, holds=holds))
    return found
