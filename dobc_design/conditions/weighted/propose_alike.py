"""Proposals of V = e'(D (x) R)e: weights of the network alone, and R by a small semidefinite
program; no proofs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.propose import DENSE, decay_rate
from dobc_design.conditions.numbers import bisected, golden_section, shorten, time_to_one_percent
from dobc_design.conditions.weighted.network import Alike, Network, holds_of_agents
from dobc_design.conditions.weighted.propose import (
    GIVEN_UP,
    even_weights,
    proposals,
    stiffness,
    weights_claim,
)
from dobc_design.exact.matrix import (
    Matrix,
    add,
    multiply,
    nullspace,
    scale,
    subtract,
    to_float,
    transpose,
    zeros,
)
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.solvers import conic
from dobc_design.solvers.conic import Cone, affine_cone, solve_cones
from dobc_design.solvers.program import Array

MOST_STATES = 20  # m, up to which an R is looked for: it has m (m + 1)/2 unknowns
STRENGTHS = 4  # of the network, that are tried, the largest first
BISECTIONS = 20
# For the least time to one percent:
COARSE = 10  # bisections of one strength
SOONER = 8  # rates of one strength
TRIED = 2  # claims
SAFE = 0.9995  # the part of a rate that is kept
GRID = (0.3, 0.5, 0.7, 0.82, 0.92, 1.0)  # strengths, as parts of the largest one ...
CLOSER = 4  # ... and how many more around the best
PARTS = (0.9995, 0.99, 0.9, 0.5, 0.1, 0.01, 0.0)  # of the rate that is thought possible
DIGITS = 9


def alike_proposals(
    loop: Loop, network: Network, W: Matrix | None, *, least: float = 0.0
) -> Iterator[tuple[Alike, float]]:
    """Claims with their rates (1/s): of those with at least ``least`` the one with the least time
    to one percent, then the fastest first."""
    basis = symmetric_basis(network.G)
    if not basis:
        return
    # The errors of the observers die out by themselves, and nothing is faster.
    slowest = float("inf")
    exosystem = loop.joint_exosystem
    if exosystem is not None and W is not None:
        slowest = decay_rate(exosystem, W)
    yield from _soonest(basis, network, slowest, least)
    for weights, strength in islice(proposals(network.statements, None, sooner=False), STRENGTHS):
        if _found(basis, network, strength, 0.0) is None:
            continue
        best = _fastest(basis, network, strength, steps=BISECTIONS)
        for part in PARTS:
            rate = shorten(part * min(best, slowest), digits=6)
            R = _found(basis, network, strength, rate)
            c = Fraction(repr(strength))
            if R is not None and holds_of_agents(R, network, c, Fraction(repr(rate))):
                yield Alike(weights=weights, strength=c, R=R), rate


def _fastest(basis: tuple[Matrix, ...], network: Network, strength: float, *, steps: int) -> float:
    """The largest rate (1/s) for which there seems to be an R, about, by so many bisections."""
    A = float(np.abs(to_float(network.A)).sum())
    G = float(np.abs(to_float(network.G)).sum())
    top = 1.0 + A + strength * G  # no R does beyond
    rate, _ = bisected(partial(seems_to_do, basis, network, strength), 0.0, top, steps=steps)
    return rate


@dataclass(frozen=True, eq=False)
class _Plan:
    """Weights D of the network for a ``strength`` (1/s), R for a ``rate`` (1/s), and the time to
    one percent."""

    time: float
    strength: float
    D: Array
    rate: float
    R: Matrix


def _soonest(
    basis: tuple[Matrix, ...], network: Network, slowest: float, least: float
) -> Iterator[tuple[Alike, float]]:
    """The claim with a rate from ``least`` to ``slowest`` (1/s) and the least ln(100 factor) /
    rate.

    factor^2 = max D / min D times the condition of R: the weights are flatter for a smaller
    strength of the network, and R for a smaller rate."""
    alone = network.statements.loop
    tables = {mode: stiffness(alone, mode) for mode in alone.modes}
    if any(table is None or table.shape[0] > DENSE for table in tables.values()):
        return
    first = next(proposals(network.statements, None, sooner=False), None)
    strongest = 0.0 if first is None else first[1]
    search = _Search(
        basis=basis, network=network, tables=tables, slowest=slowest, least=least, plans=[]
    )
    if strongest > 0:  # the time may have several valleys
        times = [search.time_at(part * strongest) for part in GRID]
        place = times.index(min(times))
        low = GRID[max(0, place - 1)]
        high = GRID[min(len(GRID) - 1, place + 1)]
        golden_section(search.time_at, low * strongest, high * strongest, steps=CLOSER)
    for plan in sorted(search.plans, key=lambda each: each.time)[:TRIED]:
        strength = shorten(plan.strength, digits=6)
        rate = shorten(plan.rate * SAFE, digits=6)
        weights = weights_claim(alone, tables, strength, plan.D)
        c = Fraction(repr(strength))
        if weights is not None and holds_of_agents(plan.R, network, c, Fraction(repr(rate))):
            yield Alike(weights=weights, strength=c, R=plan.R), rate
            return


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    """Plans with rates between ``least`` and ``slowest`` (1/s); ``plans`` are those found so
    far."""

    basis: tuple[Matrix, ...]
    network: Network
    tables: Mapping[str, Any]
    slowest: float
    least: float
    plans: list[_Plan]

    def time_at(self, strength: float) -> float:
        """The least time to one percent with this strength of the network; inf without a plan."""
        with suppress(*GIVEN_UP):
            D = even_weights(self.tables, strength)
            if D is None or _found(self.basis, self.network, strength, 0.0) is None:
                return math.inf
            most = _fastest(self.basis, self.network, strength, steps=COARSE)
            most = min(most, SAFE * self.slowest)
            shortest = max(most / 4, self.least / SAFE)
            before = len(self.plans)
            if shortest < most:
                time = partial(self._time_with, strength, D)
                golden_section(time, shortest, most, steps=SOONER)
            return min((each.time for each in self.plans[before:]), default=math.inf)
        return math.inf

    def _time_with(self, strength: float, D: Array, rate: float) -> float:
        R = _found(self.basis, self.network, strength, rate, even=True)
        if R is None:
            return math.inf
        condition = np.linalg.cond(to_float(R)) * D.max() / D.min()
        time = time_to_one_percent(rate, math.sqrt(condition))
        self.plans.append(_Plan(time, strength, D, rate, R))
        return time


def symmetric_basis(G: Matrix) -> tuple[Matrix, ...]:
    """A basis of all symmetric R (m, m) for which R G is symmetric too."""
    m = len(G)
    units = [_exact(unit) for unit in conic.symmetric_basis(m)]
    skew = []
    for R in units:
        RG = multiply(R, G)
        skew.append(subtract(RG, transpose(RG)))
    conditions = tuple(tuple(each[i][j] for each in skew) for i in range(m) for j in range(i))
    every = nullspace(conditions) if conditions else ((Fraction(1),),)
    return tuple(_combined(part, units, m) for part in every)


def _exact(unit: Array) -> Matrix:
    return tuple(tuple(map(Fraction, row)) for row in unit.tolist())


def _combined(numbers: Iterable[Fraction], matrices: Iterable[Matrix], m: int) -> Matrix:
    """The sum of the matrices (m, m), each times its number."""
    total = zeros(m, m)
    for x, R in zip(numbers, matrices, strict=True):
        if x:
            total = add(total, scale(x, R))
    return total


def _found(
    basis: tuple[Matrix, ...], network: Network, strength: float, rate: float, *, even: bool = False
) -> Matrix | None:
    """The R >= I with the least trace that seems to do, in the basis; ``even``: with the least
    largest eigenvalue. None if none is seen."""
    A = to_float(network.A)
    G = to_float(network.G)
    units = [to_float(each) for each in basis]
    m = len(A)
    # beyond the range of G' nothing can be > 0
    _, _, directions = np.linalg.svd(G)
    seen = directions[: np.linalg.matrix_rank(G)].T

    def pulled(R: Array) -> Array:
        return np.asarray(R @ A + A.T @ R - 2 * strength * R @ G + 2 * rate * R)

    room = 1e-6 * (1 + float(np.abs(A).max()) + rate + strength * float(np.abs(G).max()))
    cones = [
        affine_cone(units, -np.eye(m)),
        affine_cone([-pulled(each) for each in units], -room * np.eye(m)),
        affine_cone([seen.T @ each @ G @ seen for each in units], -1e-9 * (G @ seen).T @ G @ seen),
    ]
    spend(len(units) ** 2 // 4)
    cost = [float(np.trace(each)) for each in units]
    if even:  # t I - R >= 0
        cones = [_with_column(each) for each in cones]
        cones.append(affine_cone([*(-each for each in units), np.eye(m)], np.zeros((m, m))))
        cost = [0.0] * len(units) + [1.0]
    with suppress(*GIVEN_UP):
        answer = solve_cones(np.array(cost), cones)
        if answer.found and answer.status in ("Solved", "AlmostSolved"):
            numbers = answer.x[: len(basis)].tolist()  # t comes last
            decimals = [Fraction(f"{x:.{DIGITS}g}") for x in numbers]
            return _combined(decimals, basis, m)
    return None


def _with_column(cone: Cone) -> Cone:
    """The same condition beside one more unknown, which does not occur in it."""
    return replace(cone, rows=np.column_stack([cone.rows, np.zeros(len(cone.right))]))


def seems_to_do(basis: tuple[Matrix, ...], network: Network, strength: float, rate: float) -> bool:
    """Whether there seems to be an R for a network of that strength and that rate (1/s)."""
    return _found(basis, network, strength, rate) is not None
