"""Agents with linear dynamics: known answers, random ones, and the matrix of the whole loop written
out by hand."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are

import dobc_design as dd
from dobc_design import Dynamics, Exosystem, Network, Observer, Problem
from dobc_design.errors import SpecError

EDGE = 1e-6  # of the largest real part, within which a verdict may be undecided
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
#: p'' = -a M p - b M p' on the directed 10-cycle: pins, the gain of the arcs, and b^2/a at which
#: the loop is stable (Yu, Chen, Cao 2010; theory, section 13).
THRESHOLDS = (({1: 3}, 2, 1.399166), ({1: 5, 6: 5}, 2, 0.637488), ({1: 1}, 1, 3.148023))


def second_order(pins: dict[int, int], gain: int, ratio: float, n: int = 10) -> Problem:
    """a = 1, b^2 = ``ratio``."""
    arcs = [[i, i % n + 1, gain] for i in range(1, n + 1)]
    b = Fraction(round(ratio**0.5 * 10**6), 10**6)
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=f"y1 + {b}*y2", gains=pins, dynamics=DOUBLE)


def random_agents(r: Random) -> Problem:
    """2 to 12 agents with 2 to 4 states and 1 or 2 inputs, with or without a disturbance, one
    mode."""
    while True:
        n, m, p = r.randint(2, 12), r.randint(2, 4), r.randint(1, 2)

        def table(rows: int, columns: int, most: int = 4) -> list[list[Fraction]]:
            return [
                [Fraction(r.randint(-most, most), 2) for _ in range(columns)] for _ in range(rows)
            ]

        A, shift = table(m, m), Fraction(r.randint(0, 24), 2)
        A = [[x - shift * (i == j) for j, x in enumerate(row)] for i, row in enumerate(A)]
        texts = [" + ".join(f"({x})*y{c + 1}" for c, x in enumerate(row)) for row in table(p, m, 2)]
        arcs = [
            [i, j, r.randint(1, 3)]
            for i in range(1, n + 1)
            for j in range(1, n + 1)
            if i != j and r.random() < 0.3
        ]
        gains = {i: table(p, m) for i in range(1, n + 1) if r.random() < 0.4}
        more: dict[str, Any] = {}
        if r.random() < 0.5:
            more["exosystem"] = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0], [0, 1]][:p])
            if r.random() < 0.5:
                more["observer"] = Observer(W=table(2, r.choice((p, m)), 8))
        try:
            dynamics = Dynamics(A=A, B=table(m, p))
            network = Network.from_arcs(arcs or [[1, 2]], arrow="listens_to", agents=n)
            return Problem(network=network, coupling=texts, gains=gains, dynamics=dynamics, **more)
        except SpecError:  # B has dependent columns
            continue


def loop_matrix(problem: Problem, W: Any) -> np.ndarray:
    """The matrix of (e, eps) of one mode, from the equations of (x, xi, z) with the gain W (q, m),
    target 0.

    x_i' = A x_i + B (sum_j w H (x_j - x_i) - K_i x_i - C xihat_i + C xi_i), xi_i' = Ax xi_i,
    xihat_i = z_i + W x_i, z_i' = Ax xihat_i - W (A x_i + B (sum_j w H (x_j - x_i) - K_i x_i)): the
    observer knows all but d.
    """
    assert problem.dynamics is not None
    n, m, q = problem.n, problem.m, problem.q
    A, B = (np.array(X, dtype=float) for X in (problem.dynamics.A, problem.dynamics.B))
    H = np.array([[float(x.lo) for x in row] for row in problem.coupling.jacobian_at_zero()])
    L, (arcs,) = np.zeros((n, n)), problem.network.modes.values()
    for i, j, w in arcs:
        L[i, j] += float(w)
        L[i, i] -= float(w)
    known = np.kron(np.eye(n), A) + np.kron(L, B @ H)
    for i, K in problem.pinning.gains.items():
        known[i * m : i * m + m, i * m : i * m + m] -= B @ np.array(K, dtype=float)
    if not q:
        return known
    every, gain = np.eye(n), np.array(W, dtype=float)
    Ax, C = (np.array(X, dtype=float) for X in (problem.exosystem.A, problem.exosystem.C))
    BC, own = np.kron(every, B @ C), np.kron(every, gain)
    zeros = np.zeros((n * q, n * m))
    flow, eye, none = np.kron(every, Ax), np.eye(n * q), np.zeros((n * m, n * q))
    whole = np.block(
        [
            [known - BC @ own, BC, -BC],
            [zeros, flow, 0 * eye],
            [flow @ own - own @ known, 0 * eye, flow],
        ]
    )
    turn = np.block([[np.eye(n * m), none, none], [-own, eye, -eye], [zeros, eye, 0 * eye]])
    turned = turn @ whole @ np.linalg.inv(turn)  # of (e, eps, xi)
    size = n * (m + q)
    assert np.allclose(turned[:size, size:], 0)
    return turned[:size, :size]


@dataclass
class Tally:
    """What was found of random problems: the verdicts, and what is wrong."""

    verdicts: dict[str, int] = field(
        default_factory=lambda: {"proved": 0, "refuted": 0, "at the edge": 0}
    )
    failures: list[str] = field(default_factory=list)


def judged(seeds: range) -> Tally:
    """Certify random agents: proved iff the loop is stable, refuted iff it is unstable; both
    programs agree."""
    tally = Tally()
    for seed in seeds:
        problem = random_agents(Random(f"linear agents {seed}"))
        certificate = dd.certify(problem)
        worst = float(np.linalg.eigvals(loop_matrix(problem, certificate.claims.W)).real.max())
        wanted = "at the edge" if abs(worst) < EDGE else "proved" if worst < 0 else "refuted"
        found = certificate.verdict.value
        tally.verdicts[wanted] += 1
        if wanted not in ("at the edge", found):
            tally.failures.append(
                f"{seed}: {found}, largest real part {worst:.3g}: {certificate.reason[:80]}"
            )
        if (certificate.rate or 0) > max(0, -worst) * (1 + 1e-9):
            tally.failures.append(f"{seed}: rate {certificate.rate}, true {-worst:.6g}")
        again = dd.verify(certificate, problem)
        if not again.holds or "accepts" not in again.lone_checker:
            tally.failures.append(f"{seed}: {again.failures} {again.lone_checker}")
    return tally


def riccati_agents(seeds: Iterable[int], *, part: float | None = None) -> Iterator[Problem]:
    """Trees with couplings kappa B'R of unstable agents, from A'R + R A - R B B'R + I = 0.  The
    eigenvalues of M are whole numbers >= 1, so that the bound of theory, 2 kappa c > 1 for some c <
    1, holds for kappa = 11/20.  ``part``: of the least kappa for which every A - mu kappa B B'R is
    stable from there on."""
    for seed in seeds:
        r = Random(f"riccati {seed}")
        n, m = r.randint(3, 12 if part else 60), r.randint(2, 4)
        A = np.array([[r.randint(-2, 2) for _ in range(m)] for _ in range(m)], dtype=float)
        B = np.array([[r.randint(-2, 2)] for _ in range(m)], dtype=float)
        reach = np.linalg.matrix_rank(
            np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(m)])
        )
        if reach < m or np.linalg.eigvals(A).real.max() < EDGE:
            continue
        arcs = [[i, r.randint(1, i - 1)] for i in range(2, n + 1)]
        arcs += [each for each in ([n, 1], [n, 2]) if each not in arcs and n > 3]
        R = solve_continuous_are(A, B, np.eye(m), np.eye(1))
        rows = [Fraction(round(float(x) * 1000), 1000) for x in (B.T @ R)[0]]
        kappa, H = Fraction(11, 20), np.array([rows], dtype=float)
        if part:
            degrees = {max(1, sum(i == k for i, _ in arcs)) for k in range(1, n + 1)}
            low, high = 0.0, 0.55
            while high - low > 1e-9:
                middle = (low + high) / 2
                worst = max(np.linalg.eigvals(A - mu * middle * B @ H).real.max() for mu in degrees)
                low, high = (low, middle) if worst < 0 else (middle, high)
            kappa = Fraction(round(high * part * 10**6), 10**6)
        text = " + ".join(f"({kappa * x})*y{c + 1}" for c, x in enumerate(rows))
        dynamics = Dynamics(A=A.astype(int).tolist(), B=B.astype(int).tolist())
        network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
        yield Problem(
            network=network, coupling=text, gains={1: 1}, dynamics=dynamics, name=f"riccati-{seed}"
        )
