"""Upper bounds of quadratic certificates, proposed: corners of the gains, and X_k that leave no P_e.

For P_e = c I one corner and one vector do, found by turns.  Otherwise a semidefinite program looks for the P_e that
decreases best at the corners found so far; the corner that is worst for it joins them, until what is left of the
program is its dual, which is rounded.  ``decide_duals`` decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np

from dobc_design.conditions.consensus.propose import nearest
from dobc_design.conditions.quadratic.claim import linear_part
from dobc_design.conditions.quadratic.corner_program import solve_corners
from dobc_design.conditions.quadratic.duals import DualTerm, Ends, QuadraticDual, Shape, attained_sectors
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.enclosures import Curve, secant_range
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

Corner = tuple[str, tuple[bool, ...]]
Holds = Callable[[QuadraticDual], bool]

DIGITS: Final = 6  # of gains, radii and vectors
POINTS: Final = 16  # on each side of 0, at which gains are looked at
TURNS: Final = 30
STARTS: Final = 12
MOST_CORNERS: Final = 80
FIRST: Final = 1.01  # times the radius to begin with, then ...
GROWTH: Final = 1.4  # ... times as large from try to try
STEPS: Final = 12  # of the bisection of a radius ...
CLOSE: Final = 0.001  # ... down to this relative width
SMALL: Final = 1e-7  # eigenvalues of X below this part of the largest are left out
FARTHER: Final = 1.0005  # a dual that rounding breaks is tried at a radius so much larger
TRIES: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mode:
    """A(g) = base + sum g b c' with low <= g <= high; b the unit vector of ``target``, c = plus - minus."""

    name: str
    base: Array
    target: Any
    plus: Any
    minus: Any
    low: Array
    high: Array

    def matrix(self, up: Sequence[bool]) -> Array:
        gains = np.where(up, self.high, self.low)
        A = self.base.copy()
        np.add.at(A, (self.target, self.plus), gains)
        np.add.at(A, (self.target, self.minus), -gains)
        return A

    def worst(self, P: Array, v: Array) -> tuple[bool, ...]:
        """The corner at which v'P A v is largest."""
        return tuple((((P @ v)[self.target] * (v[self.plus] - v[self.minus])) > 0).tolist())


def propose_dual(
    problem: Problem, shape: Shape, *, holds: Holds, beyond: Fraction, largest: Fraction
) -> QuadraticDual | None:
    """The dual with the smallest radius, about, that ``holds`` accepts; None if there is none up to ``largest``.

    ``beyond`` > 0: a radius from which on one is looked for, as where a certificate of that shape is known.  For smooth
    couplings that act by component.
    """
    if any(coupling.nonsmooth or not coupling.by_component for coupling in problem.couplings):
        return None
    corners: list[Corner] = []
    best, low, high = None, float(beyond), float(beyond) * FIRST
    while best is None:
        if high > float(largest):
            return None
        best = _accepted(problem, shape, high, corners, holds)
        if best is None:
            low, high = high, high * GROWTH
    high = float(best.radius)
    for _ in range(STEPS):
        if high <= low * (1 + CLOSE):
            break
        radius = math.sqrt(low * high)
        found = _accepted(problem, shape, radius, corners, holds)
        if found is None:
            low = radius
        else:
            best, high = found, float(found.radius)
    return best


def _accepted(
    problem: Problem, shape: Shape, radius: float, corners: list[Corner], holds: Holds
) -> QuadraticDual | None:
    for _ in range(TRIES):
        found = dual_at(problem, shape, rounded(radius), corners)
        if found is None:
            return None
        if holds(found):
            return found
        radius *= FARTHER
    return None


def dual_at(problem: Problem, shape: Shape, radius: Fraction, corners: list[Corner]) -> QuadraticDual | None:
    """What floating point sees at one radius; ``corners`` are tried first and grow."""
    ends = [_attained(coupling, radius) for coupling in problem.couplings]
    if None in ends:
        return None
    known = [end for end in ends if end is not None]
    empty = QuadraticDual(
        shape=shape,
        radius=radius,
        at={k: at for k, (at, _) in enumerate(known)},
        gains={k: gains for k, (_, gains) in enumerate(known)},
        terms=(),
    )
    modes = _modes(problem, empty)
    terms = _one_vector(modes) if shape == "identity" else _several(modes, shape, corners)
    if not terms:
        return None
    return QuadraticDual(shape=shape, radius=radius, at=empty.at, gains=empty.gains, terms=tuple(terms))


def rounded(value: float) -> Fraction:
    """DIGITS significant digits."""
    return Fraction(f"{value:.{DIGITS}g}")


def _attained(coupling: Coupling, radius: Fraction) -> tuple[Ends, Ends] | None:
    """Two places and the gains that are surely passed between them, about the largest such range."""
    if coupling.is_linear:
        slope = coupling.jacobian_at_zero()[0][0]
        return ((radius, radius), (slope.lo, slope.lo)) if slope.is_point else None
    curve = Curve(coupling.components[0])
    steps = [radius * Fraction(k, POINTS) for k in range(-POINTS, POINTS + 1) if k]
    places = sorted([*steps, radius / 10**4, -radius / 10**4])
    try:
        found = [(secant_range(curve, Interval.point(y)), y) for y in places]
    except UndefinedError:
        return None
    least, at_least = min(found, key=lambda pair: pair[0].hi)
    most, at_most = max(found, key=lambda pair: pair[0].lo)
    unit = Fraction(10) ** DIGITS
    low, high = Fraction(math.ceil(least.hi * unit)) / unit, Fraction(math.floor(most.lo * unit)) / unit
    return ((at_least, at_most), (low, high)) if low <= high else None


def _modes(problem: Problem, dual: QuadraticDual) -> list[_Mode]:
    sectors = attained_sectors(problem, dual)
    found = []
    for name, channels in sectors.modes.items():
        base = np.zeros((sectors.size, sectors.size))
        for i, row in linear_part(sectors, name, [Fraction(0)] * len(channels)).items():
            for j, value in row.items():
                base[i, j] = nearest(value)
        target, plus, minus = (
            np.array([getattr(each, side) for each in channels], dtype=np.int64) for side in ("target", "plus", "minus")
        )
        low, high = (np.array([nearest(getattr(each, side)) for each in channels]) for side in ("low", "high"))
        found.append(_Mode(name=name, base=base, target=target, plus=plus, minus=minus, low=low, high=high))
    return found


def _one_vector(modes: Sequence[_Mode]) -> list[DualTerm]:
    """For P_e = c I: a corner and v with v'(A + A')v >= 0, by turns."""
    size = len(modes[0].base)
    value, mode, up, v = max((_ascent(mode, np.eye(size)) for mode in modes), key=lambda each: each[0])
    return [DualTerm(mode=mode, high=up, vectors=(_rational(v),))] if value >= 0 else []


def _ascent(mode: _Mode, P: Array) -> tuple[float, str, tuple[bool, ...], Array]:
    """A corner at which lambda_max(A'P + P A) is large, by turns from several vectors."""
    size = len(P)
    middle = mode.base.copy()
    np.add.at(middle, (mode.target, mode.plus), (mode.low + mode.high) / 2)
    np.add.at(middle, (mode.target, mode.minus), -(mode.low + mode.high) / 2)
    rng = np.random.default_rng(0)
    first = np.linalg.eigh(P @ middle + middle.T @ P)[1].T[-STARTS:]
    best: tuple[float, str, tuple[bool, ...], Array] = (-math.inf, mode.name, (), np.zeros(size))
    for start in [*first, *rng.standard_normal((STARTS, size))]:
        trial, up = start, tuple[bool, ...]()
        for _ in range(TURNS):
            chosen = mode.worst(P, trial)
            if chosen == up:
                break
            up = chosen
            A = mode.matrix(up)
            values, vectors = np.linalg.eigh(P @ A + A.T @ P)
            trial = vectors[:, -1]
            if values[-1] > best[0]:
                best = (float(values[-1]), mode.name, up, trial)
    return best


def _several(modes: Sequence[_Mode], shape: Shape, corners: list[Corner]) -> list[DualTerm]:
    """Corners and X_k by growing semidefinite programs; empty where a P_e is found that no corner found defeats."""
    by_name = {mode.name: mode for mode in modes}
    if not corners:
        size = len(modes[0].base)
        corners += [(mode.name, _ascent(mode, np.eye(size))[2]) for mode in modes]
    while len(corners) <= MOST_CORNERS:
        matrices = [by_name[name].matrix(up) for name, up in corners]
        answer = solve_corners(matrices, diagonal=shape == "diagonal")
        if answer is None:
            return []
        if answer.value >= 0:
            return _terms(corners, answer.X)
        fresh = []
        for mode in modes:
            value, _, up, _ = _ascent(mode, answer.P)
            if value > answer.value * 1e-3 and (mode.name, up) not in corners:
                fresh.append((mode.name, up))
        if not fresh:
            return []
        corners += fresh
    return []


def _terms(corners: Sequence[Corner], X: Sequence[Array]) -> list[DualTerm]:
    """X_k as sums of squares of rational vectors."""
    largest = max(float(np.linalg.eigvalsh(each)[-1]) for each in X)
    terms = []
    for (mode, up), each in zip(corners, X, strict=True):
        values, vectors = np.linalg.eigh(each / largest)
        kept = [_rational(math.sqrt(value) * v) for value, v in zip(values, vectors.T, strict=True) if value > SMALL]
        if kept:
            terms.append(DualTerm(mode=mode, high=up, vectors=tuple(kept)))
    return terms


def _rational(v: Array) -> tuple[Fraction, ...]:
    return tuple(Fraction(round(float(x) * 10**DIGITS), 10**DIGITS) for x in v)
