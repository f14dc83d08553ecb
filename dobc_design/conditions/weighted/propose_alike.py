"""Proposals of V = e'(D (x) R)e: weights of the network alone, and R by a small semidefinite
program; no proofs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import islice

import numpy as np

from dobc_design._checks import noun, positional
from dobc_design.conditions.consensus.propose import DENSE, decay_rate
from dobc_design.conditions.numbers import bisected, golden_section, shorten, time_to_one_percent
from dobc_design.exact.matrix import (
    Array,
    Matrix,
    add,
    from_float,
    largest_entry,
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

from .decide import Weighted
from .network import Alike, Network, holds_of_agents
from .propose import (
    GIVEN_UP,
    Tables,
    even_weights,
    proposals,
    stiffnesses,
    weights_claim,
)

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


@positional(eq=False)
class Forms:
    """The R that may do for a network: symmetric ones with R G symmetric, by a ``basis`` of
    them."""

    network: Network
    basis: tuple[Matrix, ...]

    @classmethod
    def of(cls, network: Network) -> Forms:
        return cls(network, symmetric_basis(network.G))

    def found(self, strength: float, rate: float, *, even: bool = False) -> Matrix | None:
        """The R >= I with the least trace that seems to do for a network of that strength (1/s) and
        that rate (1/s); ``even``: with the least largest eigenvalue.  None if none is seen."""
        A = to_float(self.network.A)
        G = to_float(self.network.G)
        units = [to_float(each) for each in self.basis]
        m = len(A)
        # beyond the range of G' nothing can be > 0
        _, _, directions = np.linalg.svd(G)
        seen = directions[: np.linalg.matrix_rank(G)].T

        def pulled(R: Array) -> Array:
            return np.asarray(R @ A + A.T @ R - 2 * strength * R @ G + 2 * rate * R)

        size = 1 + largest_entry(A) + rate + strength * largest_entry(G)
        least = -1e-9 * (G @ seen).T @ G @ seen
        cones = [
            affine_cone(units, -np.eye(m)),
            affine_cone([-pulled(each) for each in units], -1e-6 * size * np.eye(m)),
            affine_cone([seen.T @ each @ G @ seen for each in units], least),
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
                numbers = answer.x[: len(units)].tolist()  # t comes last
                decimals = [Fraction(f"{x:.{DIGITS}g}") for x in numbers]
                return _combined(decimals, self.basis, m)
        return None

    def seems_to_do(self, strength: float, rate: float) -> bool:
        """Whether there seems to be an R."""
        return self.found(strength, rate) is not None

    def fastest(self, strength: float, *, steps: int) -> float:
        """The largest rate (1/s) for which there seems to be an R, about, by so many
        bisections."""
        A = float(np.abs(to_float(self.network.A)).sum())
        G = float(np.abs(to_float(self.network.G)).sum())
        top = 1.0 + A + strength * G  # no R does beyond
        rate, _ = bisected(partial(self.seems_to_do, strength), 0.0, top, steps=steps)
        return rate

    def claim(
        self, weights: Weighted | None, strength: float, R: Matrix | None, rate: float
    ) -> Alike | None:
        """The claim with this R, if its conditions hold."""
        c = Fraction(repr(strength))
        if R is None or not holds_of_agents(R, self.network, c, Fraction(repr(rate))):
            return None
        return Alike(weights=weights, strength=c, R=R)


def alike_proposals(
    loop: Loop, network: Network, W: Matrix | None, *, least: float
) -> Iterator[tuple[Alike, float]]:
    """Claims with their rates (1/s): of those with at least ``least`` the one with the least time
    to one percent, then the fastest first."""
    forms = Forms.of(network)
    if not forms.basis:
        return
    # The errors of the observers die out by themselves, and nothing is faster.
    slowest = math.inf
    exosystem = loop.joint_exosystem
    if exosystem is not None and W is not None:
        slowest = decay_rate(exosystem, W)
    strengths: Iterable[tuple[Weighted | None, float]]
    if network.apart:
        strengths = [(None, shorten(SAFE * network.apart.strongest(), digits=6))]
    else:
        yield from _soonest(forms, slowest, least)
        strengths = proposals(network.statements, None, sooner=False)
    for weights, strength in islice(strengths, STRENGTHS):
        if not forms.seems_to_do(strength, 0.0):
            continue
        best = forms.fastest(strength, steps=BISECTIONS)
        for part in PARTS:
            rate = shorten(part * min(best, slowest), digits=6)
            claim = forms.claim(weights, strength, forms.found(strength, rate), rate)
            if claim is not None:
                yield claim, rate


@dataclass(frozen=True, eq=False)
class _Plan:
    """Weights D of the network for a ``strength`` (1/s), R for a ``rate`` (1/s), and the time to
    one percent."""

    time: float
    strength: float
    D: Array
    rate: float
    R: Matrix


def _soonest(forms: Forms, slowest: float, least: float) -> Iterator[tuple[Alike, float]]:
    """The claim with a rate from ``least`` to ``slowest`` (1/s) and the least ln(100 factor) /
    rate.

    factor^2 = max D / min D times the condition of R: the weights are flatter for a smaller
    strength of the network, and R for a smaller rate."""
    statements = forms.network.statements
    tables = stiffnesses(statements.loop)
    if tables is None or any(table.shape[0] > DENSE for table in tables.values()):
        return
    first = next(proposals(statements, None, sooner=False), None)
    strongest = 0.0 if first is None else first[1]
    search = _Search(forms=forms, tables=tables, slowest=slowest, least=least, plans=[])
    if strongest > 0:  # the time may have several valleys
        times = [search.time_at(part * strongest) for part in GRID]
        place = times.index(min(times))
        low = GRID[max(0, place - 1)]
        high = GRID[min(len(GRID) - 1, place + 1)]
        golden_section(search.time_at, low * strongest, high * strongest, steps=CLOSER)
    for plan in sorted(search.plans, key=lambda each: each.time)[:TRIED]:
        strength = shorten(plan.strength, digits=6)
        rate = shorten(plan.rate * SAFE, digits=6)
        weights = weights_claim(statements.loop, tables, strength, plan.D)
        claim = None if weights is None else forms.claim(weights, strength, plan.R, rate)
        if claim is not None:
            yield claim, rate
            return


@noun(eq=False)
class _Search:
    """Plans with rates between ``least`` and ``slowest`` (1/s); ``plans`` are those found so
    far."""

    forms: Forms
    tables: Tables
    slowest: float
    least: float
    plans: list[_Plan]

    def time_at(self, strength: float) -> float:
        """The least time to one percent with this strength of the network; inf without a plan."""
        with suppress(*GIVEN_UP):
            D = even_weights(self.tables, strength)
            if D is None or not self.forms.seems_to_do(strength, 0.0):
                return math.inf
            most = min(self.forms.fastest(strength, steps=COARSE), SAFE * self.slowest)
            shortest = max(most / 4, self.least / SAFE)
            before = len(self.plans)
            if shortest < most:
                time = partial(self._time_with, strength, D)
                golden_section(time, shortest, most, steps=SOONER)
            return min((each.time for each in self.plans[before:]), default=math.inf)
        return math.inf

    def _time_with(self, strength: float, D: Array, rate: float) -> float:
        R = self.forms.found(strength, rate, even=True)
        if R is None:
            return math.inf
        condition = np.linalg.cond(to_float(R)) * D.max() / D.min()
        time = time_to_one_percent(rate, math.sqrt(condition))
        self.plans.append(_Plan(time, strength, D, rate, R))
        return time


def symmetric_basis(G: Matrix) -> tuple[Matrix, ...]:
    """A basis of all symmetric R (m, m) for which R G is symmetric too."""
    m = len(G)
    units = [from_float(unit, None) for unit in conic.symmetric_basis(m)]
    skew = []
    for R in units:
        RG = multiply(R, G)
        skew.append(subtract(RG, transpose(RG)))
    conditions = tuple(tuple(each[i][j] for each in skew) for i in range(m) for j in range(i))
    every = nullspace(conditions) if conditions else ((Fraction(1),),)
    return tuple(_combined(part, units, m) for part in every)


def _combined(numbers: Iterable[Fraction], matrices: Iterable[Matrix], m: int) -> Matrix:
    """The sum of the matrices (m, m), each times its number."""
    total = zeros(m, m)
    for x, R in zip(numbers, matrices, strict=True):
        if x:
            total = add(total, scale(x, R))
    return total


def _with_column(cone: Cone) -> Cone:
    """The same condition beside one more unknown, which does not occur in it."""
    return replace(cone, rows=np.column_stack([cone.rows, np.zeros(len(cone.right))]))
