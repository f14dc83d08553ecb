"""Random networks whose inputs saturate: no run leaves the box that is certified, nor is later.

The plant (1), (12), (13), (19) is integrated here, as printed, by a fixed-step method of Runge and
Kutta: inputs cut at the limit, observers fed with what is applied, modes that switch at random.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row
from networks import floats, network_of, random_arcs

from dobc_design import Certificate, Exosystem, Observer, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.examine import examine
from dobc_design.conditions.separable.claim import Separable
from dobc_design.problem.canonical import canonical_bytes

F = Fraction
RISING: dict[str, Callable[[Any], Any]] = {
    "exp(y) - 1 + y": lambda y: np.expm1(y) + y,
    "tanh(y)": np.tanh,
    "y": lambda y: y,
    "y + y**3/10": lambda y: y + y**3 / 10,
}
RUNS = 167  # of each network: 60 networks, 10,000 runs
STEP = 1 / 400  # s
SHARE = 1 - 1e-9  # of a bound that rounding may take


def saturating(number: int) -> Problem:
    """A network with few or many pins, one or two modes, limits of its own for every agent or one
    for all, and with or without a disturbance."""
    r = Random(f"saturation {number}")
    n = r.randint(1, 6)
    modes = {}
    for name in ("G", "H")[: r.randint(1, 2)]:
        arcs = [[i, i + 1] for i in range(1, n)]
        modes[name] = arcs + [arc for arc in random_arcs(r, n, 0.2) if arc not in arcs]
    pinned = [n, *(i for i in range(1, n) if r.random() < 0.6)]
    s = F(r.randint(1, 4), 8)
    limits = {str(i): F(r.randint(9, 24), 8) for i in range(1, n + 1)}
    given: dict[str, Any] = {
        "network": network_of(modes, n),
        "coupling": r.choice(list(RISING)),
        "gains": {i: F(r.randint(2, 12), 2) for i in pinned},
        "actuators": {
            "limit": limits if r.random() < 0.5 else min(limits.values()),
            "saturates": True,
        },
        "region": {"initial_states": [-r.randint(1, 3), r.randint(1, 3)]},
    }
    if r.random() < 0.7:
        w = F(r.randint(2, 8), 2)
        given["exosystem"] = Exosystem([[0, w], [-w, 0]], [[1, 0]])
        given["observer"] = Observer(W=[[F(r.randint(4, 12), 2)], [F(r.randint(0, 4), 2)]])
        given["region"]["initial_disturbance"] = s
        given["simulation"] = {"xi0": [F(r.randint(-3, 3), 10), F(r.randint(-3, 3), 10)]}
    return Problem(**given)


class Plant:
    """The loop of a problem in floats, many runs at once; states (n, runs), xi and z (n, q,
    runs)."""

    def __init__(self, problem: Problem, W: Any) -> None:
        self.n = problem.n
        self.h = RISING[problem.coupling.texts[0]]
        self.modes = []
        for arcs in problem.network.modes.values():
            every = np.arange(len(arcs.weights))
            apart = np.zeros((len(every), self.n))  # what an arc compares: speaker less listener
            apart[every, arcs.speakers] = 1
            apart[every, arcs.listeners] -= 1
            moved = np.zeros((self.n, len(every)))
            moved[arcs.listeners, every] = [float(w) for w in arcs.weights]
            self.modes.append((apart, moved))
        self.k = np.zeros((self.n, 1))
        for i, gain in problem.pinning.gains.items():
            self.k[i] = float(gain[0][0])
        limits = [problem.actuators.limit_of(label) for label in problem.network.labels]
        self.limit = np.array([[float(limit)] for limit in limits])
        self.q = problem.q
        if self.q:
            self.A = floats(problem.exosystem.A)
            self.C = floats(problem.exosystem.C)
            self.W = floats(W)
            self.F = self.A - self.W @ self.C

    def slope(self, state: Any, mode: int) -> Any:
        """x', xi', z' of (1), (12), (13) with the target 0."""
        x, xi, z = state
        apart, moved = self.modes[mode]
        couplings = moved @ self.h(apart @ x)
        if not self.q:
            return couplings + np.clip(-self.k * x, -self.limit, self.limit), xi, z
        believed = z + self.W[None] * x[:, None]
        dhat = self.C[0] @ believed
        u = np.clip(-self.k * x - dhat, -self.limit, self.limit)
        d = self.C[0] @ xi
        turned = self.F @ believed
        return couplings + u + d, self.A @ xi, turned - self.W[None] * (couplings + u)[:, None]

    def step(self, state: Any, mode: int) -> Any:
        """One step of the classical method of order 4."""

        def moved(part: float, slope: Any) -> Any:
            return tuple(a + part * STEP * b for a, b in zip(state, slope, strict=True))

        first = self.slope(state, mode)
        second = self.slope(moved(0.5, first), mode)
        third = self.slope(moved(0.5, second), mode)
        last = self.slope(moved(1, third), mode)
        rows = zip(state, first, second, third, last, strict=True)
        return tuple(x + STEP / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in rows)


def starts(problem: Problem, plant: Plant, rng: Any) -> Any:
    """States anywhere in the region, half of them at its corners; errors of the estimates as large
    as they may be; xi from xi0, turned by any time."""
    region = problem.region
    (low, high), *_ = [tuple(map(float, pair)) for pair in region.initial_states]
    n = plant.n
    x = rng.uniform(low, high, (n, RUNS))
    corner = rng.random(RUNS) < 0.5
    x[:, corner] = rng.choice([low, high], (n, int(corner.sum())))
    if not plant.q:
        none = np.zeros((n, 0, RUNS))
        return x, none, none
    xi0 = np.array([float(value) for value in problem.simulation.xi0[0]])
    angle = rng.uniform(0, 2 * np.pi, (n, RUNS))
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xi = np.einsum("pqnr,q->npr", turned, xi0)
    eps = rng.standard_normal((n, 2, RUNS))
    eps *= float(region.initial_disturbance) / np.linalg.norm(eps, axis=1, keepdims=True)
    return x, xi, xi - eps - plant.W[None] * x[:, None]


def worst_share(certificate: Certificate, rng: Any) -> float:
    """The largest V(t) of the max-separable certificate as a part of V(0) exp(-rate t), over all
    runs."""
    problem = certificate.problem
    check = next(each for each in certificate.checks if each.id == "max-separable")
    claim = check.claim
    assert isinstance(claim, Separable)
    v = np.array([[float(each)] for each in claim.v])
    W = certificate.claims.W
    plant = Plant(problem, W)

    def size(state: Any) -> Any:
        x, xi, z = state
        found = np.max(np.abs(x) / v, axis=0)
        if plant.q and claim.error is not None:
            eps = xi - z - plant.W[None] * x[:, None]
            P = floats(claim.error.P)
            squares = np.einsum("npr,pq,nqr->nr", eps, P, eps)
            found = found + float(claim.error.kappa) * np.sqrt(np.max(squares, axis=0))
        return found

    state = starts(problem, plant, rng)
    first = size(state)
    worst = 0.0
    mode = 0
    for k in range(int(8 / STEP)):
        if k % 40 == 0:
            mode = int(rng.integers(len(plant.modes)))
        state = plant.step(state, mode)
        bound = first * np.exp(-check.rate * (k + 1) * STEP)
        worst = max(worst, float(np.max(size(state) / bound)))
    return worst


def saturated_loops(count: int, seed: int) -> Row:
    """None of the runs is outside its box, or later than certified."""
    failures = list[str]()
    proved = 0
    runs = 0
    worst = 0.0
    for number in range(seed, seed + count):
        problem = saturating(number)
        certificate = certify(problem)
        data = certificate_bytes(certificate.claims)
        refused = [text for holds, text in examine(data, canonical_bytes(problem)) if not holds]
        if refused:
            failures.append(f"seed {number}: the second program refuses {refused[0]}")
        if certificate.verdict is not Verdict.PROVED:
            continue
        proved += 1
        share = worst_share(certificate, np.random.default_rng(number))
        runs += RUNS
        worst = max(worst, share)
        if share > 1 + 1e-6:
            failures.append(f"seed {number}: a run reaches {share:.6g} of its bound")
    told = f"{proved} are proved; {runs} runs reach at most {worst:.6f} of what is certified."
    what = "saturated loops: no run outside its box or late"
    return Row(what, count, failures, (told,))
