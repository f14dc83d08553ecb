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
from typing import Any, Final

import numpy as np
from scipy import sparse

from dobc_design.conditions.quadratic.claim import Lure, linear_part
from dobc_design.conditions.quadratic.propose import raise_rate
from dobc_design.conditions.quadratic.search import round_down, scaled_pair
from dobc_design.conditions.quadratic.sectors import Entries, Sectors, build_sectors, enclose_ranges, gains_on
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, multiply, scale, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array, is_solver_failure
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
ROOT2: Final = math.sqrt(2.0)


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
    import clarabel

    size = len(modes[0].A)
    places = [(i, j) for j in range(size) for i in range(j + 1)]
    starts = np.cumsum([len(places), *(mode.B.shape[1] for mode in modes)])
    total = int(starts[-1]) + 1  # P_e, theta of every mode, t
    columns, right, cones = [], [], []
    for block, constant in _blocks(modes, places, starts, total, rate * (1 + MARGIN)):
        columns.append(block)
        right.append(constant)
        cones.append(clarabel.PSDTriangleConeT(round((math.sqrt(8 * len(constant) + 1) - 1) / 2)))
    cost = np.zeros(total)
    cost[-1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    matrix = sparse.csc_matrix(sparse.vstack(columns))
    quadratic = sparse.csc_matrix((total, total))
    try:
        answer = clarabel.DefaultSolver(quadratic, cost, matrix, np.concatenate(right), cones, settings).solve()
    except BaseException as failure:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(failure):
            raise
        return None
    x = np.asarray(answer.x, dtype=float)
    if str(answer.status) not in {"Solved", "AlmostSolved"} or not np.all(np.isfinite(x)) or x[-1] > ROUNDEST:
        return None
    P_e = np.zeros((size, size))
    for (i, j), value in zip(places, x.tolist(), strict=False):
        P_e[i, j] = P_e[j, i] = value
    parts = np.split(x[: int(starts[-1])], starts[:-1])[1:]
    return _Found(P_e=P_e, theta={mode.name: part for mode, part in zip(modes, parts, strict=True)})


def _blocks(
    modes: Sequence[_Mode], places: Sequence[tuple[int, int]], starts: Array, total: int, rate: float
) -> Iterator[tuple[Any, Array]]:
    """The constraints right - columns x >= 0, as triangles: t I - P_e, P_e - I, minus the inequality of each mode."""
    size = len(modes[0].A)
    units = [_unit(size, i, j) for i, j in places]
    zero = np.zeros(size * (size + 1) // 2)
    eye = _svec(np.eye(size))
    P_e = np.stack([_svec(unit) for unit in units], axis=1)
    yield sparse.csc_matrix(np.column_stack([P_e, np.zeros((len(zero), total - len(places) - 1)), -eye])), zero
    yield sparse.csc_matrix(np.column_stack([-P_e, np.zeros((len(zero), total - len(places)))])), -eye
    for number, mode in enumerate(modes):
        k = mode.B.shape[1]
        columns = sparse.lil_matrix(((size + k) * (size + k + 1) // 2, total))
        for column, unit in enumerate(units):
            whole = np.zeros((size + k, size + k))
            product = unit @ mode.A
            whole[:size, :size] = product + product.T + 2 * rate * unit
            whole[:size, size:] = unit @ mode.B
            whole[size:, :size] = whole[:size, size:].T
            columns[:, column] = _svec(whole)[:, None]
        for channel in range(k):
            whole = np.zeros((size + k, size + k))
            whole[:size, :size] = np.outer(mode.C[channel], mode.C[channel])
            whole[size + channel, size + channel] = -1.0
            columns[:, int(starts[number]) + channel] = _svec(whole)[:, None]
        yield sparse.csc_matrix(columns), np.zeros(columns.shape[0])


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


def _unit(size: int, i: int, j: int) -> Array:
    M = np.zeros((size, size))
    M[i, j] = M[j, i] = 1.0
    return M


def _svec(M: Array) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    j, i = np.tril_indices(len(M))
    return np.where(i == j, 1.0, ROOT2) * M[i, j]
