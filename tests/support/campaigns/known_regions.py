"""Regions of problems whose truth is known from outside: two agents with a second equilibrium,
linear networks.

Two agents: the equilibria are roots of one equation in one unknown, found here by SciPy; no
certified ball or box may hold one, and how near it comes is the gap.  Linear: no rate may be above
that of the slowest eigenvalue.
"""

import math
from collections import defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from networks import loop_by_hand, network_of
from scipy import optimize

from campaigns.certificates import Tally
from dobc_design import Problem, Verdict, certify

REGIONAL = ("max-separable", "lure")
FAR = 40.0
# text and function for a length c: each has other zeros than 0, or falls so far that two pinned
# agents find a balance
SHAPES = (
    ("sin(y/c)*c", lambda y, c: math.sin(y / c) * c),
    ("y - y**3/(c*c)", lambda y, c: y - y**3 / c**2),
    ("y*(1 - y/c)", lambda y, c: y * (1 - y / c)),
    ("y*(1 - (y/c)**2)/(1 + (y/c)**2)", lambda y, c: y * (1 - (y / c) ** 2) / (1 + (y / c) ** 2)),
)


@dataclass
class Known(Tally):
    """``ratios``: certified radius over the bound, by kind of check; certified rate over the true
    one."""

    ratios: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))


@dataclass(frozen=True, kw_only=True)
class TwoAgents:
    """Agent 1 pinned with k, agent 2 hears it; ``back``: both hear each other, both pinned."""

    problem: Problem
    equilibria: tuple[tuple[float, float], ...]  # all but 0 with |e_2 - e_1| <= FAR
    asked: float

    def least(self, norm: float) -> float:
        return min(float(np.linalg.norm(e, norm)) for e in self.equilibria)


def two_agents(seed: int) -> TwoAgents:
    """The next one that has a second equilibrium."""
    r = Random(f"two agents {seed}")
    while True:
        text, h = r.choice(SHAPES)
        c = r.choice((0.5, 1, 1.5, 3))
        k = r.choice((0.1, 0.5, 1, 3))
        back = r.random() < 0.5
        found = equilibria(lambda y, h=h, c=c: h(y, c), k, back=back)
        if found:
            break
    nearest = min(max(map(abs, e)) for e in found)
    asked = round(nearest * r.choice((0.2, 0.4, 0.7, 0.95, 1.2)), 3)
    network = network_of([[2, 1], [1, 2]] if back else [[2, 1]], 2)
    h = text.replace("c", f"({Fraction(c)})")
    region = {"initial_states": [str(-asked), str(asked)]}
    problem = Problem(
        network=network, coupling=h, gains=str(k) if back else {1: str(k)}, target=0, region=region
    )
    return TwoAgents(problem=problem, equilibria=tuple(found), asked=asked)


def equilibria(h: Any, k: float, *, back: bool) -> list[tuple[float, float]]:
    """One way: e_1 = 0 and h(-e_2) = 0.  Both: e = (h(d), h(-d)) / k with k d = h(-d) - h(d), d =
    e_2 - e_1."""
    equation = (lambda d: h(-d) - h(d) - k * d) if back else lambda d: h(-d)
    grid = np.concatenate([-np.geomspace(FAR, 1e-3, 4000), np.geomspace(1e-3, FAR, 4000)])
    values = [equation(float(d)) for d in grid]
    roots = []
    for a, b, x, y in zip(grid, grid[1:], values, values[1:], strict=False):
        if x * y < 0 and a * b > 0:
            roots.append(optimize.brentq(equation, a, b, xtol=1e-14))
    return [(h(d) / k, h(-d) / k) if back else (0.0, d) for d in roots]


def equilibrium_campaign(seeds: Any) -> Known:
    """No certified region holds an equilibrium; a region that holds one is never proved."""
    tally = Known()
    for seed in seeds:
        case = two_agents(seed)
        certificate = certify(case.problem)
        holds_one = case.least(np.inf) <= case.asked
        tally.counts[
            f"{'one inside' if holds_one else 'none inside'}: {certificate.verdict.value}"
        ] += 1
        if certificate.verdict is (Verdict.PROVED if holds_one else Verdict.REFUTED):
            tally.wrong.append(
                f"{seed}: {certificate.verdict.value}, nearest equilibrium at {case.least(np.inf)}"
            )
        for check in certificate.checks:
            if check.id not in REGIONAL or check.verdict is not Verdict.PROVED:
                continue
            if isinstance(check.domain, str):
                tally.wrong.append(
                    f"{seed}: {check.id} is {check.domain}, with another equilibrium"
                )
                continue
            ratio = check.domain.radius / case.least(np.inf if check.domain.kind == "box" else 2)
            tally.ratios[check.id].append(float(ratio))
            if ratio >= 1:
                tally.wrong.append(
                    f"{seed}: {check.id} reaches {ratio} of the way to an equilibrium"
                )
    return tally


def linear_problem(seed: int) -> tuple[Problem, np.ndarray]:
    """Weights >= 0, one mode, h = y; and the matrix of e' = M e, written out here."""
    r = Random(f"known linear {seed}")
    n = r.randint(2, 7)
    arcs = [
        (i, j, Fraction(r.randint(1, 6), 2))
        for i in range(n)
        for j in range(n)
        if i != j and r.random() < 0.4
    ]
    gains = {i: Fraction(r.randint(1, 8), 2) for i in range(n) if r.random() < 0.4}
    network = network_of([[i + 1, j + 1, w] for i, j, w in arcs], n)
    gains = {i + 1: k for i, k in gains.items()}
    problem = Problem(
        network=network, coupling="y", gains=gains, target=0, region={"initial_states": [-1, 1]}
    )
    return problem, loop_by_hand(problem)


def linear_campaign(seeds: Any) -> Known:
    """Proved only where every eigenvalue is stable, everywhere there, and at most at the rate of
    the slowest."""
    tally = Known()
    for seed in seeds:
        problem, M = linear_problem(seed)
        certificate = certify(problem)
        slowest = -float(np.max(np.linalg.eigvals(M).real))
        tally.counts[
            f"linear {'stable' if slowest > 1e-9 else 'not stable'}: {certificate.verdict.value}"
        ] += 1
        if (certificate.verdict is Verdict.PROVED) is not (slowest > 1e-9):
            tally.wrong.append(f"linear {seed}: {certificate.verdict.value}, slowest {slowest}")
        for check in certificate.checks:
            if (
                check.verdict is Verdict.PROVED
                and check.kind.is_consensus
                and check.rate is not None
            ):
                tally.ratios[f"rate of {check.id}"].append(check.rate / slowest)
                if check.rate > slowest * (1 + 1e-9):
                    tally.wrong.append(
                        f"linear {seed}: {check.id} claims {check.rate}, true is {slowest}"
                    )
    return tally
