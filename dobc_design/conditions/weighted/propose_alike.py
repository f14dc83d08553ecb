"""Proposals of V = e'(D (x) R)e: weights of the network alone, and R by a small semidefinite program; no proofs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from functools import partial
from itertools import islice

import numpy as np

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.numbers import bisected, shorten
from dobc_design.conditions.weighted.network import Alike, Network, holds_of_agents
from dobc_design.conditions.weighted.propose import GIVEN_UP, proposals
from dobc_design.exact.matrix import Matrix, add, multiply, nullspace, scale, subtract, to_float, transpose, zeros
from dobc_design.exact.work import spend
from dobc_design.problem.problem import Problem
from dobc_design.solvers import conic
from dobc_design.solvers.conic import Cone, solve_cones, svec
from dobc_design.solvers.program import Array

MOST_STATES = 20  # m, up to which an R is looked for: it has m (m + 1)/2 unknowns
STRENGTHS = 4  # of the network, that are tried, the largest first
BISECTIONS = 20
PARTS = (0.9995, 0.99, 0.9, 0.5, 0.1, 0.01, 0.0)  # of the rate that is thought possible
DIGITS = 9


def alike_proposals(problem: Problem, network: Network, W: Matrix | None) -> Iterator[tuple[Alike, float]]:
    """Claims with their rates (1/s), the fastest first."""
    basis, slowest = symmetric_basis(network.G), float("inf")
    exosystem = problem.joint_exosystem
    if exosystem is not None and W is not None:
        slowest = decay_rate(exosystem, W)
    for weights, strength in islice(proposals(network.statements, None), STRENGTHS):
        top = 1.0 + float(np.abs(to_float(network.A)).sum()) + strength * float(np.abs(to_float(network.G)).sum())
        if not basis or _found(basis, network, strength, 0.0) is None:
            continue
        best = bisected(partial(seems_to_do, basis, network, strength), 0.0, top, steps=BISECTIONS)[0]
        for part in PARTS:
            rate = shorten(part * min(best, slowest), digits=6)
            R, c = _found(basis, network, strength, rate), Fraction(repr(strength))
            if R is not None and holds_of_agents(R, network, c, Fraction(repr(rate))):
                yield Alike(weights=weights, strength=c, R=R), rate


def symmetric_basis(G: Matrix) -> tuple[Matrix, ...]:
    """A basis of all symmetric R (m, m) for which R G is symmetric too."""
    m = len(G)
    units = [tuple(tuple(map(Fraction, row)) for row in unit.tolist()) for unit in conic.symmetric_basis(m)]
    skew = [subtract(multiply(R, G), transpose(multiply(R, G))) for R in units]
    conditions = tuple(tuple(each[i][j] for each in skew) for i in range(m) for j in range(i))
    every = nullspace(conditions) if conditions else ((Fraction(1),),)
    found = []
    for part in every:
        total = zeros(m, m)
        for x, R in zip(part, units, strict=True):
            total = add(total, scale(x, R)) if x else total
        found.append(total)
    return tuple(found)


def _found(basis: tuple[Matrix, ...], network: Network, strength: float, rate: float) -> Matrix | None:
    """The smallest R >= I that seems to do, in the basis; None if none is seen."""
    A, G, units = to_float(network.A), to_float(network.G), [to_float(each) for each in basis]
    m, seen = len(A), np.linalg.svd(G)[2][: np.linalg.matrix_rank(G)].T  # beyond the range of G' nothing can be > 0

    def pulled(R: Array) -> Array:
        return np.asarray(R @ A + A.T @ R - 2 * strength * R @ G + 2 * rate * R)

    room = 1e-6 * (1 + float(np.abs(A).max()) + rate + strength * float(np.abs(G).max()))
    cones = [
        affine_cone(units, -np.eye(m)),
        affine_cone([-pulled(each) for each in units], -room * np.eye(m)),
        affine_cone([seen.T @ each @ G @ seen for each in units], -1e-9 * (G @ seen).T @ G @ seen),
    ]
    spend(len(units) ** 2 // 4)
    with suppress(*GIVEN_UP):
        answer = solve_cones(np.array([float(np.trace(each)) for each in units]), cones)
        if answer.found and answer.status in ("Solved", "AlmostSolved"):
            total = zeros(m, m)
            for x, R in zip(answer.x.tolist(), basis, strict=True):
                total = add(total, scale(Fraction(f"{x:.{DIGITS}g}"), R))
            return total
    return None


def seems_to_do(basis: tuple[Matrix, ...], network: Network, strength: float, rate: float) -> bool:
    """Whether there seems to be an R for a network of that strength and that rate (1/s)."""
    return _found(basis, network, strength, rate) is not None


def affine_cone(units: list[Array], right: Array) -> Cone:
    """sum of x_k units_k + right >= 0."""
    even = [(each + each.T) / 2 for each in units]
    return Cone("semidefinite", np.column_stack([-svec(each) for each in even]), svec(right))
