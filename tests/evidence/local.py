"""The local question: random networks are proved near the target iff they are stable, at the true
rate."""

from fractions import Fraction
from random import Random

import numpy as np
import sympy as sp
from agents import judged
from evidence.row import Row
from networks import network_of

import dobc_design as dd
from dobc_design import Problem

COUPLINGS = {"exp(y) - 1 + y": 2, "sin(y)": 1, "2*y": 2, "tanh(y)": 1}  # and their slopes at 0
ISOLATED, SMALL = 50, 8  # problems whose mu is isolated as a root, and their agents
EDGE = 1e-9
FASTEST = 10**9  # 1/s: no proof has it, so that the fastest one is looked for


def digraphs(count: int, seed: int) -> Row:
    """Rising couplings: proved iff every agent is reached, between 0.99 mu and mu, and refuted
    otherwise."""
    failures = []
    least = 1.0
    roots = 0
    verdicts = {"proved": 0, "refuted": 0}
    for number in range(count):
        r = Random(f"local {seed + number}")
        problem, M = _digraph(r, n=r.randint(2, SMALL if number < ISOLATED else 60))
        certificate = dd.certify(problem, rate=FASTEST)
        mu = float(np.linalg.eigvals(np.array(M, dtype=float)).real.min())
        if number < ISOLATED and mu > EDGE:
            mu = _least_root(M)
            roots = roots + 1
        wanted = "proved" if mu > EDGE else "refuted"
        if certificate.verdict.value != wanted:
            failures.append(f"{seed + number}: {certificate.verdict.value}, mu = {mu:.6g}")
            continue
        verdicts[wanted] += 1
        if wanted == "proved":
            rate = certificate.check("theorem1-weighted").rate or 0.0
            least = min(least, rate / mu)
            if not 0.99 * mu <= rate < mu * (1 + 1e-9):
                failures.append(f"{seed + number}: rate {rate:.9g}, mu = {mu:.9g}")
        if not dd.verify(certificate, problem).holds:
            failures.append(f"{seed + number}: verify refuses it")
    note = f"{verdicts}; rate at least {least:.5f} mu; mu isolated as a root in {roots}"
    return Row(
        "random digraphs: proved near the target iff reached, at the true rate",
        count,
        failures,
        [note],
    )


def _digraph(r: Random, *, n: int) -> tuple[Problem, list[list[Fraction]]]:
    """Weighted arcs at random, with a cycle through all or not, a few pins; and M = L(a) + K."""
    arcs = {
        (i, r.randint(1, n)): r.randint(10, 500)
        for i in range(1, n + 1)
        for _ in range(r.randint(0, 3))
    }
    if r.random() < 0.6:
        order = r.sample(range(1, n + 1), n)
        arcs |= {
            pair: r.randint(10, 500) for pair in zip(order, order[1:] + order[:1], strict=True)
        }
    arcs = {(i, j): w for (i, j), w in arcs.items() if i != j} or {(1, 2): 100}
    gains = {
        i: Fraction(r.randint(10, 1000), 100)
        for i in r.sample(range(1, n + 1), r.randint(1, max(1, n // 3)))
    }
    weights = {pair: Fraction(w, 100) for pair, w in arcs.items()}
    h, slope = r.choice(list(COUPLINGS.items()))
    network = network_of([[i, j, w] for (i, j), w in weights.items()], n)
    problem = Problem(network=network, coupling=h, gains=gains)
    return problem, _stiffness(n, {pair: slope * w for pair, w in weights.items()}, gains)


def _stiffness(
    n: int, slopes: dict[tuple[int, int], Fraction], gains: dict[int, Fraction]
) -> list[list[Fraction]]:
    M = [[Fraction(0)] * n for _ in range(n)]
    for (i, j), a in slopes.items():
        M[i - 1][i - 1] += a
        M[i - 1][j - 1] -= a
    for i, k in gains.items():
        M[i - 1][i - 1] += k
    return M


def _least_root(M: list[list[Fraction]]) -> float:
    """The least real root of the characteristic polynomial, isolated; mu of an M-matrix is one of
    them."""
    polynomial = sp.Matrix(M).charpoly(sp.Symbol("s"))
    intervals = sp.Poly(polynomial.as_expr(), sp.Symbol("s"), domain="QQ").intervals(
        eps=sp.Rational(1, 10**12)
    )
    return float(min(sum(ends) / 2 for ends, _ in intervals))


def linear_agents(count: int, seed: int) -> Row:
    """Agents with linear dynamics: proved or refuted as the eigenvalues of the whole loop say; both
    programs agree."""
    tally = judged(range(seed, seed + count))
    return Row(
        "agents with linear dynamics: verdicts as the eigenvalues say",
        count,
        tally.failures,
        [str(tally.verdicts)],
    )
