"""Proposals for quadratic stages: for a few radii, a P_e with about the largest rate there.

Unlike in ``quadratic.propose`` the level does not matter: the stage before keeps the couplings within the radius.  For
a given rate the inequality of theory, section 4, is affine in P_e and theta = 2 tau d^2,

    [[P_e A0 + A0'P_e + 2 beta P_e + C'diag(theta) C,  P_e B diag(d)], [., -diag(theta)]] <= 0,    I <= P_e <= t I,

and Clarabel minimises t: a round P_e costs least when it takes over.  The rate is found by bisection.  What is
returned has been accepted by ``holds``, which decides exactly and is handed in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.quadratic.claim import Lure, linear_part
from dobc_design.conditions.quadratic.propose import raise_rate
from dobc_design.conditions.quadratic.search import round_down, scaled_pair
from dobc_design.conditions.quadratic.sectors import Entries, Sectors, build_sectors, enclose_ranges, gains_on
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.solvers.conic import Cone, solve_cones, svec, symmetric_basis
from dobc_design.solvers.program import Array
from dobc_design.solvers.rounding import round_matrix

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mode:
    """One mode in floats: A0 (N, N); of the k channels with a range B diag(d) (N, k) and C (k, N)."""

    name: str
    A: Array
    B: Array
    C: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """An answer of the program: P_e (N, N), theta by mode."""

    P_e: Array
    theta: dict[str, Array]


def propose_quadratic_stages(
    problem: Problem, *, W: Matrix | None, holds: Callable[[Lure], bool], radii: Sequence[float], slowest: float
) -> list[Lure]:
    """Certificates at the given radii, one each, smallest first; those only whose rate (1/s) exceeds ``slowest``.

    Linear couplings need no radius and have one.  Empty for networks beyond MOST_ROWS or MOST_BLOCK.
    """
    size, arcs = problem.n * problem.m, max(len(each) for each in problem.network.modes.values())
    if size > MOST_ROWS or size + arcs * problem.m > MOST_BLOCK:
        return []
    fastest = _observer_rate(problem, W) if problem.groups else math.inf
    found: list[Lure] = []
    for radius in [None] if problem.is_linear else [Fraction(f"{radius:.6g}") for radius in sorted(radii)]:
        lure = _at_radius(problem, W, radius, holds, slowest=slowest, fastest=fastest)
        if lure is None:
            break  # larger radii are harder
        found.append(lure)
        fastest = min(fastest, float(lure.rate) / PARTS[0])
    return found


def _roomy(coupling: Coupling, radius: Fraction) -> Entries:
    """``gains_on``, a little wider where h is not linear, for whoever encloses them in another way."""
    entries = gains_on(coupling, radius)
    if coupling.is_linear:
        return entries
    return tuple(tuple(map(_wider, row)) for row in entries)


def _wider(gain: Interval) -> Interval:
    room = ROOM * gain.magnitude
    return Interval(gain.lo - room, gain.hi + room)


def _observer_rate(problem: Problem, W: Matrix | None) -> float:
    """A rate at which the observer's pair can be had, 0 without one."""
    exosystem = problem.joint_exosystem
    if exosystem is None or W is None:
        return 0.0
    F = to_float(exosystem.A) - to_float(W) @ to_float(exosystem.C)
    return max(0.0, -OBSERVER * float(np.max(np.linalg.eigvals(F).real)))


def _at_radius(
    problem: Problem,
    W: Matrix | None,
    radius: Fraction | None,
    holds: Callable[[Lure], bool],
    *,
    slowest: float,
    fastest: float,
) -> Lure | None:
    try:
        sectors = build_sectors(problem, enclose_ranges(problem, radius=radius, enclose=_roomy), radius=radius)
    except UndefinedError:
        return None
    modes = [_floats(sectors, name) for name in sectors.modes]
    low = slowest
    high = min(fastest, *(-float(np.max(np.linalg.eigvals(mode.A).real)) for mode in modes))
    if high <= low or _solved(modes, low) is None:
        return None
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if _solved(modes, middle) is not None else (low, middle)
    for part in PARTS:
        if part * low <= slowest:
            break
        answer = _solved(modes, part * low)
        for lure in () if answer is None else _rounded(problem, W, sectors, answer, radius, part * low):
            if holds(lure):
                return raise_rate(problem, lure, holds=holds)
    return None


def _floats(sectors: Sectors, name: str) -> _Mode:
    channels = sectors.modes[name]
    A = np.zeros((sectors.size, sectors.size))
    for i, row in linear_part(sectors, name, [channel.centre for channel in channels]).items():
        for j, value in row.items():
            A[i, j] = float(value)
    curved = [channel for channel in channels if channel.spread]
    B, C = np.zeros((sectors.size, len(curved))), np.zeros((len(curved), sectors.size))
    for k, channel in enumerate(curved):
        B[channel.target, k] = float(channel.spread)
        C[k, channel.plus] += 1.0
        C[k, channel.minus] -= 1.0
    return _Mode(name=name, A=A, B=B, C=C)


def _solved(modes: Sequence[_Mode], rate: float) -> _Found | None:
    """The roundest P_e with this rate and a little more; None if the solver finds none."""
    units = symmetric_basis(len(modes[0].A))
    starts = np.cumsum([len(units), *(mode.B.shape[1] for mode in modes)])
    cost = np.zeros(int(starts[-1]) + 1)  # P_e, theta of every mode, t
    cost[-1] = 1.0
    answer = solve_cones(cost, list(_cones(modes, units, starts, rate * (1 + MARGIN))))
    if answer.status not in {"Solved", "AlmostSolved"} or not answer.found or answer.x[-1] > ROUNDEST:
        return None
    P_e = np.sum([value * unit for value, unit in zip(answer.x.tolist(), units, strict=False)], axis=0)
    parts = np.split(answer.x[: int(starts[-1])], starts[:-1])[1:]
    return _Found(P_e=P_e, theta={mode.name: part for mode, part in zip(modes, parts, strict=True)})


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


def _rounded(
    problem: Problem, W: Matrix | None, sectors: Sectors, found: _Found, radius: Fraction | None, rate: float
) -> Iterator[Lure]:
    """Certificates with few digits first, and the observer's pair scaled so that its border is small."""
    ranges = enclose_ranges(problem, radius=radius, enclose=_roomy)
    beta = round_down(rate)
    for digits in DIGITS:
        P_e = round_matrix(found.P_e, digits)
        values = np.linalg.eigvalsh(to_float(P_e))
        if not values[0] > 0:
            continue
        P = Q = None
        if problem.groups and W is not None:
            pair = scaled_pair(problem, W, rate=round_down(_observer_rate(problem, W)), disturbance=Fraction(0))
            if pair is None:
                return
            border = float(np.linalg.norm(pair.S, 2)) * float(values[-1])
            P = scale(round_down(max(border / (MARGIN * rate), 1e-6), 3), pair.P)
            Q = multiply(P, W)
        yield Lure(
            P_e=SparseSymmetric.from_dense(P_e),
            ranges=ranges,
            radius=radius,
            level=_level(P_e, radius),
            rate=beta,
            multipliers={name: _multipliers(sectors, name, theta, digits) for name, theta in found.theta.items()},
            P=P,
            Q=Q,
        )


def _level(P_e: Matrix, radius: Fraction | None) -> Fraction | None:
    """A level whose region is certain to lie within the radius: |e_i - e_j|^2 <= 4 V/lambda_min(P_e)."""
    if radius is None:
        return None
    return round_down(float(radius) ** 2 * float(np.linalg.eigvalsh(to_float(P_e))[0]) / 4, 6)


def _multipliers(sectors: Sectors, name: str, theta: Array, digits: int) -> tuple[Fraction, ...]:
    """Tau = theta / (2 d^2) of every channel with a range, 0 elsewhere."""
    values = iter(theta.tolist())
    return tuple(
        round_down(max(next(values) / (2 * float(channel.spread) ** 2), 1e-12), digits)
        if channel.spread
        else Fraction(0)
        for channel in sectors.modes[name]
    )
