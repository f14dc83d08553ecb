"""Limits and errors that a file states: those that cannot be kept are never proved, those that can
are.

Why a limit cannot be kept is known in closed form: the disturbance alone needs more than the
actuator has, a pinned agent needs k R at its start, two agents that repel each other come apart, or
a coupling that saturates is weaker than what acts.  Runs of the whole loop (13), driven bang-bang
within the stated bounds, stay below what is proved.
"""

import json
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row
from stated_tables import RISING, R, broken, kept

from dobc_design import Certificate, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.exact.matrix import to_float
from dobc_design.problem.canonical import canonical_bytes

F = Fraction


def refusals(certificate: Certificate, **changes: Any) -> tuple[bool, bool]:
    """Whether the package and the second program refuse the certificate with these changes."""
    data = json.dumps(json.loads(certificate_bytes(certificate.claims)) | changes).encode()
    problem = certificate.problem
    second = examine(data, canonical_bytes(problem))
    return not recheck(data, problem).holds, not all(holds for holds, _ in second)


def edited(certificate: Certificate) -> dict[str, Any]:
    """The verdict changed to proved, by the proof that is best without the tables."""
    ids = ("max-separable", "lemma1", "theorem1-weighted", "linearisation")
    proofs = {check.id: check for check in certificate.checks if check.verdict is Verdict.PROVED}
    best = next((proofs[id] for id in ids if id in proofs), None)
    rate, factor = (None, None) if best is None else (best.rate, best.factor)
    return {
        "verdict": "proved",
        "covered_by": best.id if best else "accuracy",
        "rate": rate,
        "factor": factor,
    }


def not_kept(count: int, seed: int) -> Row:
    """None of them is proved; the true certificate is confirmed, one edited to proved is refused by
    both programs."""
    failures = list[str]()
    tables = dict[str, list[int]]()
    for number in range(seed, seed + count):
        stated = broken(number)
        certificate = certify(stated.problem)
        row = tables.setdefault(stated.tables, [0, 0, 0])
        row[["proved", "refuted", "undecided"].index(certificate.verdict.value)] += 1
        if certificate.verdict is Verdict.PROVED:
            failures.append(f"seed {number}: proved, but {stated.why}: {certificate.reason}")
        if refusals(certificate) != (False, False):
            failures.append(f"seed {number}: its own certificate is refused")
        if refusals(certificate, **edited(certificate)) != (True, True):
            failures.append(f"seed {number}: edited to proved it is accepted")
    return Row("stated tables that cannot be kept: none is proved", count, failures, _table(tables))


def kept_ones(count: int, seed: int) -> Row:
    """All of them are proved with their tables, confirmed by both programs; no driven run exceeds
    what is proved."""
    failures = list[str]()
    tables = dict[str, list[int]]()
    shares = list[float]()
    for number in range(seed, seed + count):
        stated = kept(number)
        certificate = certify(stated.problem)
        row = tables.setdefault(stated.tables, [0, 0, 0])
        row[["proved", "refuted", "undecided"].index(certificate.verdict.value)] += 1
        if certificate.verdict is not Verdict.PROVED:
            failures.append(f"seed {number}: {certificate.reason}")
            continue
        if refusals(certificate) != (False, False):
            failures.append(f"seed {number}: its own certificate is refused")
        share = exceeds(certificate, Random(f"runs {number}"))
        shares.append(share)
        if not share <= 1:
            failures.append(f"seed {number}: a run exceeds what is proved {share:.4f} times")
    notes = [*_table(tables)]
    if shares:
        notes.append(
            f"driven runs reach {min(shares):.3f} to {max(shares):.3f} of a bound, median "
            f"{np.median(shares):.3f}"
        )
    return Row("stated tables that can be kept: all are proved", count, failures, notes)


def _table(tables: dict[str, list[int]]) -> list[str]:
    return [
        f"{name}: {a} proved, {b} refuted, {c} undecided"
        for name, (a, b, c) in sorted(tables.items())
    ]


# s: of Runge and Kutta, of a run, and between changes of what acts, on average
STEP, LONG, TURN = 0.01, 12.0, 0.6


def exceeds(certificate: Certificate, r: Random, runs: int = 3) -> float:
    """The largest share of a proved bound that runs of the loop (13) reach: of inputs at any time,
    of final errors over the last fifth (by then the agents are there, about: what is left of the
    start is taken off)."""
    problem = certificate.problem
    checks = {check.id: check for check in certificate.checks}
    proofs = {id: check for id, check in checks.items() if check.verdict is Verdict.PROVED}
    worst = 0.0
    for _ in range(runs):
        inputs, errors, disturbance, left = _driven(problem, certificate.claims.W, r)
        if "actuators" in proofs:
            amplitude = float(problem.actuators.amplitude or 0)
            bounds = np.array([float(F(x)) for x in proofs["actuators"].exact["inputs"].values()])
            worst = max(
                worst, float(np.max(inputs / np.maximum(bounds - amplitude + disturbance, 1e-12)))
            )
        if "accuracy" in proofs:
            bounds = np.array([float(F(x)) for x in proofs["accuracy"].exact["bounds"].values()])
            worst = max(worst, float(np.max(errors / (bounds + left))))
    return worst


def _driven(problem: Problem, gain: Any, r: Random) -> tuple[Any, Any, Any, float]:
    """One run: largest |u_i|, largest final |e_i|, largest |d_i|, and what may be left of the
    start.  Everything that is uncertain jumps between its ends; couplings act on true or on
    measured states."""
    rng = np.random.default_rng(r.randrange(2**32))
    n = problem.n
    q = problem.q
    plant = problem.uncertainty
    (arcs,) = problem.network.modes.values()
    i = arcs.listeners
    j = arcs.speakers
    w = np.array([float(x) for x in arcs.weights])
    k = np.array(
        [
            float(problem.pinning.gains[a][0][0]) if a in problem.pinning.gains else 0.0
            for a in range(n)
        ]
    )
    h = RISING[problem.coupling.texts[0]]
    bounds = dict.fromkeys(PARTS, 0.0)
    if plant is not None:
        bounds = {name: float(getattr(plant, name)) for name in PARTS}
    measured = r.random() < 0.5
    A = np.zeros((0, 0))
    C = np.zeros((1, 0))
    W = np.zeros((0, 1))
    if q:
        A = to_float(problem.joint_exosystem.A)
        C = to_float(problem.joint_exosystem.C)
        W = to_float(gain)
    x = rng.choice((-1.0, 1.0), n) * float(R)
    xi = rng.normal(size=(n, q))
    size = float(problem.actuators.amplitude or 0) if problem.actuators is not None else 1.0
    xi *= size / np.maximum(np.linalg.norm(xi, axis=1, keepdims=True), 1e-9)
    s = float(problem.region.initial_disturbance or 0)
    zeta = rng.normal(size=(n, q))
    zeta *= s / np.maximum(np.linalg.norm(zeta, axis=1, keepdims=True), 1e-9)
    z = xi - zeta - x[:, None] * W[:, 0]
    most = np.zeros(n)
    final = np.zeros(n)
    disturbance = np.zeros(n)

    def drawn() -> dict[str, Any]:
        one = {
            name: bounds[name] * rng.choice((-1.0, 1.0), n)
            for name in ("disturbance", "measurement", "gains")
        }
        return one | {
            "weights": bounds["weights"] * rng.choice((-1.0, 1.0), len(w)),
            "drift": bounds["drift"] * rng.choice((-1.0, 1.0), (n, q)),
        }

    def field(state: Any, now: dict[str, Any]) -> tuple[Any, ...]:
        x, xi, z = state
        y = x + now["measurement"]
        told = np.bincount(i, w * (1 + now["weights"]) * h(y[j] - y[i]), n)
        acts = told if measured else np.bincount(i, w * (1 + now["weights"]) * h(x[j] - x[i]), n)
        estimate = z + y[:, None] * W[:, 0]
        u = -k * (1 + now["gains"]) * y - estimate @ C[0]
        dx = acts + u + xi @ C[0] + now["disturbance"]
        dz = estimate @ (A - W @ C).T - (told + u)[:, None] * W[:, 0]
        return dx, xi @ A.T + now["drift"], dz, u

    now, t = drawn(), 0.0
    while t < LONG:
        if rng.random() < STEP / TURN:
            now = drawn()
        state = (x, xi, z)
        *a, u = field(state, now)
        most = np.maximum(most, np.abs(u))
        disturbance = np.maximum(disturbance, np.abs(xi @ C[0]))
        *b, _ = field([p + STEP / 2 * d for p, d in zip(state, a, strict=True)], now)
        *c, _ = field([p + STEP / 2 * d for p, d in zip(state, b, strict=True)], now)
        *e, _ = field([p + STEP * d for p, d in zip(state, c, strict=True)], now)
        steps = zip(state, a, b, c, e, strict=True)
        x, xi, z = (p + STEP / 6 * (d1 + 2 * d2 + 2 * d3 + d4) for p, d1, d2, d3, d4 in steps)
        t += STEP
        if t > 0.8 * LONG:
            final = np.maximum(final, np.abs(x))
    return most, final, disturbance, 2e-2


PARTS = ("weights", "gains", "disturbance", "drift", "measurement")
