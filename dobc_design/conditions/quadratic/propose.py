"""Finds certificates of ``claim``: P_e, multipliers and the observer's pair for the largest radius or ball.

``lure_search`` proposes in floating point.  What it proposes is rounded to rationals and handed to ``holds``, which
decides exactly; only what that accepts is returned, with the very radius at which it was accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Final

import numpy as np
from scipy import linalg

from dobc_design.conditions.quadratic.claim import Lure, Method, lure_matrix
from dobc_design.conditions.quadratic.program import FloatLoop, float_loop, make_templates
from dobc_design.conditions.quadratic.sampled_gains import sample_gains
from dobc_design.conditions.quadratic.search import Point, Search, border, round_down, scaled_pair, widths
from dobc_design.conditions.quadratic.sectors import Enclose, Sectors, build_sectors, enclose_ranges, gains_on
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.solvers.barrier import make_basis
from dobc_design.solvers.program import Array
from dobc_design.solvers.rounding import round_matrix

Holds = Callable[[Lure], bool]

SHAPES: Final = ("identity", "diagonal", "full")
OBJECTIVES: Final = ("radius", "ball")
#: Rows n m up to which a full P_e is looked for: its n m (n m + 1)/2 unknowns make a dense Newton system.
LARGEST_FULL: Final = 80
DIGITS: Final = (5, 7, 9, 12)
RETREATS: Final = (0.0, 1e-4, 1e-3, 1e-2, 5e-2)
BALLS: Final = 4  # points tried, the largest ball first
HALVINGS: Final = 14
NEAR: Final = 1e-6  # |e_j - e_i| at which couplings are as good as linear
ZERO: Final = Fraction(0)
_SHORTFALL: Final = 1e-8  # of the level, for the rounding of its estimate
# Where no arc needs the radius every level will do: one that holds balls of a hundred times the radius, about.
_NOT_NEEDED: Final = 1e4


def design_lure(
    problem: Problem,
    *,
    holds: Holds,
    shape: str = "full",
    objective: str = "radius",
    W: Matrix | None = None,
    rate: Fraction = ZERO,
    disturbance: Fraction = ZERO,
    largest: Fraction = Fraction(1000),
    enclose: Enclose = gains_on,
) -> Lure | None:
    """Find a certificate that ``holds`` accepts; None if none was found, which proves nothing.

    ``shape``: "identity", "diagonal" or "full" P_e.  ``objective``: "radius" (largest |e_j - e_i| on which V decreases)
    or "ball" (largest covered |e| for |eps_i| <= disturbance).  ``W`` (q, m): the observer's gain; without it eps = 0
    is meant.  ``rate`` (1/s): asked of V' <= -2 rate V.  ``largest``: no radius beyond it is tried.
    Raises: SpecError for an unknown shape or objective, a full P_e of more than LARGEST_FULL rows, or a W without an
    exosystem.
    """
    size = problem.n * problem.m
    _check(shape, objective, size)
    pair = None if W is None else scaled_pair(problem, W, rate=rate, disturbance=disturbance)
    if W is not None and pair is None:
        return None
    templates, basis = make_templates(problem), make_basis(size, shape)
    for sampled in (True, False):  # enclosures in the search only where the samples have misled
        search = Search(
            problem=problem, templates=templates, enclose=enclose, basis=basis, pair=pair, rate=rate, sampled=sampled
        )
        tried = False
        for lure in _candidates(search, objective, float(largest)):
            tried = True
            if holds(lure):
                return lure
        if not tried:
            break
    return None


def bound_lure(
    problem: Problem,
    *,
    holds: Holds,
    method: Method,
    P_e: SparseSymmetric | None = None,
    P: Matrix | None = None,
    Q: Matrix | None = None,
    rate: Fraction = ZERO,
    largest: Fraction = Fraction(1000),
    enclose: Enclose = gains_on,
) -> Lure | None:
    """The largest radius that the method "interval" or "vertices" proves for a given P_e (I), by bisection.

    P, Q: the observer's pair as it is; without it eps = 0 is meant.  None if no radius down to 1e-6 is proved.
    Raises: SpecError for "vertices" with too many arcs.
    """
    size = problem.n * problem.m
    metric = SparseSymmetric(size, {(i, i): Fraction(1) for i in range(size)}) if P_e is None else P_e

    def at(radius: float) -> Lure | None:
        exact = round_down(radius)
        try:
            ranges = enclose_ranges(problem, radius=exact, enclose=enclose)
        except UndefinedError:
            return None
        lure = Lure(
            P_e=metric,
            ranges=ranges,
            radius=exact,
            level=_level(metric, problem, exact),
            rate=rate,
            P=P,
            Q=Q,
            method=method,
        )
        return lure if holds(lure) else None

    low, best = 1e-6, at(1e-6)
    if best is None:
        return None
    high = 1e-3
    while high < largest and (found := at(high)) is not None:
        low, best, high = high, found, 4 * high
    high = min(high, float(largest))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        found = at(middle)
        low, high, best = (middle, high, found) if found is not None else (low, middle, best)
    return best


def raise_rate(problem: Problem, lure: Lure, *, holds: Holds) -> Lure:
    """The same certificate with the largest rate that ``holds`` accepts, in steps below an estimate."""
    estimate = rate_estimate(problem, lure)
    for part in (1e-6, 1e-3, 0.01, 0.1, 0.5):
        rate = round_down(estimate * (1 - part)) if estimate > 0 else ZERO
        if rate > lure.rate:
            faster = replace(lure, rate=rate)
            if holds(faster):
                return faster
    return lure


def linear_rate(problem: Problem, W: Matrix | None) -> float:
    """What no certificate can exceed: the decay rate near the consensus, the slowest mode's or the observer's (1/s).

    About, in floats; 0 where that does not decay, or where a coupling is not defined.
    """
    gains = sample_gains(problem.couplings, NEAR)
    if gains is None:
        return 0.0
    loop = float_loop(make_templates(problem), gains, radius=None, S=None, rate=0.0)
    blocks = [mode.A for mode in loop.modes]
    exosystem = problem.joint_exosystem
    if exosystem is not None and W is not None:
        blocks.append(to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C))
    return max(0.0, -max(float(np.max(np.linalg.eigvals(A).real)) for A in blocks))


def rate_estimate(problem: Problem, lure: Lure) -> float:
    """The largest beta for which the Lur'e inequalities hold with these unknowns, about (1/s); 0 if there is none."""
    if lure.method != "lure":
        return 0.0
    sectors = build_sectors(problem, lure.ranges, radius=lure.radius)
    P_e = to_float(lure.P_e.to_dense())
    fixed = [
        to_float(lure_matrix(sectors, mode, lure.P_e, lure.multipliers[mode]).to_dense()) for mode in sectors.modes
    ]

    def decreases(beta: float) -> bool:
        observer = np.zeros_like(P_e)
        if lure.P is not None and lure.Q is not None:
            S = border(problem, lure.P, lure.Q, rate=beta)
            if S is None:
                return False
            observer = P_e @ S @ P_e
        return all(float(np.linalg.eigvalsh(X + 2 * beta * P_e + observer)[-1]) < 0 for X in fixed)

    low, high = 0.0, min(-float(linalg.eigh(X, P_e, eigvals_only=True)[-1]) for X in fixed) / 2
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if decreases(middle) else (low, middle)
    return low


def _check(shape: str, objective: str, size: int) -> None:
    if shape not in SHAPES:
        raise SpecError(f"shape must be one of {', '.join(SHAPES)}; got {shape!r}.", key="shape")
    if objective not in OBJECTIVES:
        raise SpecError(f"objective must be one of {', '.join(OBJECTIVES)}; got {objective!r}.", key="objective")
    if shape == "full" and size > LARGEST_FULL:
        raise SpecError(
            f"a full P_e has {size * (size + 1) // 2} unknowns here, which is too many: it is looked for up to n m ="
            f" {LARGEST_FULL} rows; got {size}.",
            key="shape",
            cure='Use "diagonal".',
        )


def _candidates(search: Search, objective: str, largest: float) -> Iterator[Lure]:
    """Certificates worth trying, the best first."""
    if search.problem.is_linear:
        point = search.centred(None, None)
        if point is not None:
            yield from _roundings(search, point)
        return
    path = search.path(largest)
    if not path:
        return
    if objective == "ball":
        for point in search.largest_balls(path)[:BALLS]:
            yield from _roundings(search, point)
        return
    for retreat in RETREATS:
        point = search.centred((path[-1].radius or 0.0) * (1 - retreat), path[-1])
        if point is not None:
            yield from _roundings(search, point)


def _roundings(search: Search, point: Point) -> Iterator[Lure]:
    """Certificates near a point, the shortest numbers first, with lambda_max(P_e) about 1."""
    problem, loop = search.problem, search.loop(point.radius)
    if loop is None:
        return
    radius = None if point.radius is None else round_down(point.radius)
    try:
        ranges = enclose_ranges(problem, radius=radius, enclose=search.enclose)
    except UndefinedError:  # the samples have not met the place where it is not defined
        return
    sectors = build_sectors(problem, ranges, radius=radius)
    unit = float(np.linalg.eigvalsh(point.Y)[0])
    inverse = np.linalg.inv(point.Y)
    for digits in DIGITS:
        P_e = round_matrix(unit * (inverse + inverse.T) / 2, digits)
        reach = _reach(to_float(P_e), loop)
        if not reach > 0:
            continue
        if radius is not None:  # a level and a radius belong together
            reach = min(reach, _NOT_NEEDED * float(radius) ** 2)
        a = Fraction(1) if search.pair is None or not point.kappa else round_down(unit / point.kappa, digits)
        P = None if search.pair is None else scale(a, search.pair.P)
        yield Lure(
            P_e=SparseSymmetric.from_dense(P_e),
            ranges=ranges,
            radius=radius,
            level=None if math.isinf(reach) else round_down(reach * (1 - _SHORTFALL), 10),
            multipliers=_multipliers(sectors, loop, point, unit, digits),
            rate=search.rate,
            P=P,
            Q=None if P is None or search.pair is None else multiply(P, search.pair.W),
        )


def _reach(P_e: Array, loop: FloatLoop) -> float:
    """The largest level within the radii, about; inf without radii, 0 if P_e is not positive definite."""
    if not float(np.linalg.eigvalsh(P_e)[0]) > 0:
        return 0.0
    Y = np.asarray(np.linalg.inv(P_e), dtype=np.float64)
    return float(np.min(loop.reach**2 / np.maximum(widths(Y, loop), 1e-300), initial=math.inf))


def _level(P_e: SparseSymmetric, problem: Problem, radius: Fraction) -> Fraction:
    """The largest level within the radius, about, from below; exact for P_e = I."""
    if all(i == j and value == 1 for (i, j), value in P_e.entries.items()):
        return radius * radius / 2
    m, Y = problem.m, np.linalg.inv(to_float(P_e.to_dense()))
    largest = max(
        Y[i, i] + Y[j, j] - 2 * Y[i, j]
        for arcs in problem.network.modes.values()
        for listener, speaker, _ in arcs
        for i, j in zip(range(listener * m, listener * m + m), range(speaker * m, speaker * m + m), strict=True)
    )
    return round_down(float(radius) ** 2 / float(largest) * (1 - _SHORTFALL), 10)


def _multipliers(sectors: Sectors, loop: FloatLoop, point: Point, unit: float, digits: int) -> dict[str, Vector]:
    """Tau = unit / (2 d t) of every channel with a range, 0 elsewhere."""
    result, start = {}, 0
    for mode in loop.modes:
        values = unit / (2 * mode.d * point.t[start : start + len(mode.d)])
        places = zip(mode.target.tolist(), mode.plus.tolist(), mode.minus.tolist(), strict=True)
        taus = dict(zip(places, values.tolist(), strict=True))
        result[mode.name] = tuple(
            round_down(taus[channel.target, channel.plus, channel.minus], digits) if channel.spread else ZERO
            for channel in sectors.modes[mode.name]
        )
        start += len(mode.d)
    return result
