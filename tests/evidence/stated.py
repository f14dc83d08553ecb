"""Limits and errors that a file states: those that cannot be kept are never proved, those that can are.

Why a limit cannot be kept is known in closed form: the disturbance alone needs more than the actuator has, a pinned
agent needs k R at its start, two agents that repel each other come apart, or a coupling that saturates is weaker than
what acts.  Runs of the whole loop (13), driven bang-bang within the stated bounds, stay below what is proved.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from evidence.row import Row

from dobc_design import Certificate, Network, Observer, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.exact.matrix import to_float
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import constant, harmonics

F = Fraction
R = F(1)  # of every region
RISING = {"y": lambda y: y, "tanh(y)": np.tanh, "y + y**3/10": lambda y: y + y**3 / 10}


@dataclass(frozen=True)
class Stated:
    """A problem with tables; ``tables``: which, ``why`` they cannot be kept ("" if they can)."""

    problem: Problem
    tables: str
    why: str = ""


def network(r: Random, *, saturating: bool = False) -> dict[str, Any]:
    """Three to five agents in a tree, the first pinned, in every second case another one as well."""
    n = r.randint(3, 5)
    arcs = [[i, r.randint(1, i - 1), F(r.randint(2, 6), 2)] for i in range(2, n + 1)]
    gains = {1: F(r.randint(4, 8), 2)} | ({n: F(r.randint(4, 8), 2)} if r.random() < 0.5 else {})
    h = "tanh(y)" if saturating else r.choice(list(RISING))
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return {"network": network, "coupling": h, "gains": gains, "target": 0, "name": "stated"}


def seen(r: Random) -> dict[str, Any]:
    """A constant and a sine of 2 rad/s, or the sine alone, with an observer, and the region with its errors."""
    exosystem, W = (harmonics([2]), ["16/5", "12/5"]) if r.random() < 0.5 else (constant(), ["3"])
    errors = F(r.randint(1, 4), 20)
    region = {"initial_states": [-R, R], "initial_disturbance": errors}
    return {"exosystem": exosystem, "observer": Observer(W=[[w] for w in W]), "region": region}


BOX = {"region": {"initial_states": [-R, R]}}


def limit_below_the_disturbance(r: Random, more: dict[str, Any]) -> Stated:
    amplitude = F(r.randint(4, 20), 4)
    table = {"limit": amplitude * r.randint(20, 95) / 100, "amplitude": amplitude}
    problem = Problem(**network(r), **seen(r), actuators=table, **more)
    return Stated(problem, "limit", "the disturbance alone needs more")


def limit_below_the_start(r: Random, more: dict[str, Any]) -> Stated:
    parts = network(r) | BOX
    needed = parts["gains"][1] * R
    problem = Problem(**parts, actuators={"limit": {"1": needed * r.randint(50, 97) / 100}}, **more)
    return Stated(problem, "limit", "agent 1 needs k R at its start")


def limit_between(r: Random, more: dict[str, Any]) -> Stated:
    """Each of the two tables can be kept alone: k R fits into the limit, and any error of gains is tolerated."""
    parts = network(r) | BOX
    error = F(r.randint(10, 30), 100)
    limit = {"limit": {"1": parts["gains"][1] * R * (1 + error * r.randint(1, 19) / 20)}}
    table = more.pop("uncertainty", {}) | {"gains": error}
    problem = Problem(**parts, actuators=limit, uncertainty=table, **more)
    return Stated(problem, "limit, gains", "agent 1 needs k (1 + error) R at its start")


def repelling(r: Random, more: dict[str, Any]) -> Stated:
    """e_1 - e_2 grows where 2 w (1 + error) > k (1 - error); with noise, where the claim is about where agents end,
    without a bound only if the coupling has none."""
    k, w = F(r.randint(8, 16), 2), F(r.randint(2, 6), 4)
    largest = (k - 2 * w) / (k + 2 * w)
    error = largest + (1 - largest) * r.randint(2, 30) / 100
    pair = Network.from_arcs([[1, 2, w], [2, 1, w]], arrow="listens_to", agents=2)
    h = "-y" if more else r.choice(["-y", "-tanh(y)"])
    where = {} if r.random() < 0.5 else BOX
    table = more.pop("uncertainty", {}) | {"weights": error, "gains": error}
    problem = Problem(network=pair, coupling=h, gains=k, target=0, name="stated", uncertainty=table, **where, **more)
    return Stated(problem, "weights, gains", f"two agents come apart from {float(largest):.3g} on")


def entries_of_a_gain(r: Random, more: dict[str, Any]) -> Stated:
    """[[1, c], [c, 1]] is indefinite where 1 - d < c (1 + d)."""
    c = F(r.randint(3, 7), 10)
    largest = (1 - c) / (1 + c)
    table = more.pop("uncertainty", {}) | {"gains": largest + (1 - largest) * r.randint(2, 30) / 100}
    one = Network.from_arcs([], arrow="listens_to", agents=1)
    gains = {1: [[1, c], [c, 1]]}
    problem = Problem(network=one, coupling="y", gains=gains, target=[0, 0], name="stated", uncertainty=table, **more)
    return Stated(problem, "gains", f"the gain is indefinite from {float(largest):.3g} on")


def more_than_a_coupling(r: Random, more: dict[str, Any]) -> Stated:
    """An agent that is held by w tanh alone, against a constant push of more than w."""
    w = F(r.randint(2, 8), 4)
    chain = Network.from_arcs([[2, 1, w]], arrow="listens_to", agents=2)
    table = more.pop("uncertainty", {}) | {"disturbance": w * r.randint(101, 150) / 100}
    problem = Problem(
        network=chain, coupling="tanh(y)", gains={1: 20}, target=0, name="stated", uncertainty=table, **BOX, **more
    )
    return Stated(problem, "disturbance", "the coupling gives less than what acts")


def weaker_than_stated(r: Random, more: dict[str, Any]) -> Stated:
    """Each alone can be kept: w tanh holds against 3/4 w, and any error of its weight is tolerated."""
    w = F(r.randint(2, 8), 4)
    chain = Network.from_arcs([[2, 1, w]], arrow="listens_to", agents=2)
    table = more.pop("uncertainty", {}) | {"disturbance": w * 3 / 4, "weights": F(r.randint(26, 40), 100)}
    problem = Problem(
        network=chain, coupling="tanh(y)", gains={1: 20}, target=0, name="stated", uncertainty=table, **BOX, **more
    )
    return Stated(problem, "disturbance, weights", "the weakest coupling gives less than what acts")


ALONE = (limit_below_the_disturbance, limit_below_the_start, repelling, entries_of_a_gain, more_than_a_coupling)
TOGETHER = (limit_between, weaker_than_stated)


def broken(seed: int) -> Stated:
    """Tables that cannot be kept; in every third problem two or three, one of them or all together too much."""
    r = Random(f"stated tables {seed}")
    if seed % 3:
        return r.choice(ALONE)(r, {})
    maker: Callable[[Random, dict[str, Any]], Stated] = r.choice(TOGETHER + ALONE)
    small: dict[str, Any] = {"uncertainty": {"measurement": F(1, 1000)}}
    if maker in (limit_below_the_disturbance, limit_below_the_start, limit_between):
        small["uncertainty"] |= {"weights": F(1, 100), "disturbance": F(1, 1000)}
    elif maker is not entries_of_a_gain:
        small["actuators"] = {"limit": 1000}
    found = maker(r, small)
    return Stated(found.problem, f"{found.tables} and others", found.why)


def kept(seed: int) -> Stated:
    """Tables with room: limits of three times what starts and disturbance need, small errors, weak inputs."""
    r = Random(f"tables that are kept {seed}")
    parts, watched = network(r), r.random() < 0.5
    parts |= seen(r) if watched else BOX
    named, wanted = {}, {1: ["limit"], 2: ["relative"], 0: ["absolute"]}[seed % 3]
    if seed % 4 == 0:
        wanted = ["limit", "relative", "absolute"]
    if "relative" in wanted:
        named |= {"weights": F(r.randint(1, 4), 100), "gains": F(r.randint(1, 4), 100)}
    if "absolute" in wanted:
        named |= {"disturbance": F(r.randint(1, 4), 100), "measurement": F(r.randint(0, 2), 1000)}
        named |= {"drift": F(1, 100)} if watched else {}
    if "relative" in wanted and watched and seed % 5 == 0:
        named |= {"known_to_agents": False, "weights": F(1, 200)}
    if named:
        parts["uncertainty"] = named
    if "limit" in wanted:
        amplitude = F(r.randint(1, 4), 2) if watched else F(0)
        largest = max(parts["gains"].values()) * R
        parts["actuators"] = {"limit": 3 * (largest + amplitude + 1), "amplitude": amplitude}
    return Stated(Problem(**parts), " and ".join(wanted))


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
    return {"verdict": "proved", "covered_by": best.id if best else "accuracy", "rate": rate, "factor": factor}


def not_kept(count: int, seed: int) -> Row:
    """None of them is proved; the true certificate is confirmed, one edited to proved is refused by both programs."""
    failures, tables = list[str](), dict[str, list[int]]()
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
    """All of them are proved with their tables, confirmed by both programs; no driven run exceeds what is proved."""
    failures, tables, shares = list[str](), dict[str, list[int]](), list[float]()
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
            f"driven runs reach {min(shares):.3f} to {max(shares):.3f} of a bound, median {np.median(shares):.3f}"
        )
    return Row("stated tables that can be kept: all are proved", count, failures, notes)


def _table(tables: dict[str, list[int]]) -> list[str]:
    return [f"{name}: {a} proved, {b} refuted, {c} undecided" for name, (a, b, c) in sorted(tables.items())]


STEP, LONG, TURN = 0.01, 12.0, 0.6  # s: of Runge and Kutta, of a run, and between changes of what acts, on average


def exceeds(certificate: Certificate, r: Random, runs: int = 3) -> float:
    """The largest share of a proved bound that runs of the loop (13) reach: of inputs at any time, of final errors over
    the last fifth (by then the agents are there, about: what is left of the start is taken off)."""
    problem, checks = certificate.problem, {check.id: check for check in certificate.checks}
    proofs = {id: check for id, check in checks.items() if check.verdict is Verdict.PROVED}
    worst = 0.0
    for _ in range(runs):
        inputs, errors, disturbance, left = _driven(problem, certificate.claims.W, r)
        if "actuators" in proofs:
            amplitude = float(problem.actuators.amplitude or 0)
            bounds = np.array([float(F(x)) for x in proofs["actuators"].exact["inputs"].values()])
            worst = max(worst, float(np.max(inputs / np.maximum(bounds - amplitude + disturbance, 1e-12))))
        if "accuracy" in proofs:
            bounds = np.array([float(F(x)) for x in proofs["accuracy"].exact["bounds"].values()])
            worst = max(worst, float(np.max(errors / (bounds + left))))
    return worst


def _driven(problem: Problem, gain: Any, r: Random) -> tuple[Any, Any, Any, float]:
    """One run: largest |u_i|, largest final |e_i|, largest |d_i|, and what may be left of the start.  Everything that
    is uncertain jumps between its ends; couplings act on true or on measured states."""
    rng = np.random.default_rng(r.randrange(2**32))
    n, q, plant = problem.n, problem.q, problem.uncertainty
    (arcs,) = problem.network.modes.values()
    i, j, w = arcs.listeners, arcs.speakers, np.array([float(x) for x in arcs.weights])
    k = np.array([float(problem.pinning.gains[a][0][0]) if a in problem.pinning.gains else 0.0 for a in range(n)])
    h, bounds = RISING[problem.coupling.texts[0]], dict.fromkeys(PARTS, 0.0)
    if plant is not None:
        bounds = {name: float(getattr(plant, name)) for name in PARTS}
    measured = r.random() < 0.5
    A, C, W = np.zeros((0, 0)), np.zeros((1, 0)), np.zeros((0, 1))
    if q:
        A, C, W = to_float(problem.joint_exosystem.A), to_float(problem.joint_exosystem.C), to_float(gain)
    x = rng.choice((-1.0, 1.0), n) * float(R)
    xi = rng.normal(size=(n, q))
    size = float(problem.actuators.amplitude or 0) if problem.actuators is not None else 1.0
    xi *= size / np.maximum(np.linalg.norm(xi, axis=1, keepdims=True), 1e-9)
    s = float(problem.region.initial_disturbance or 0)
    zeta = rng.normal(size=(n, q))
    zeta *= s / np.maximum(np.linalg.norm(zeta, axis=1, keepdims=True), 1e-9)
    z = xi - zeta - x[:, None] * W[:, 0]
    most, final, disturbance = np.zeros(n), np.zeros(n), np.zeros(n)

    def drawn() -> dict[str, Any]:
        one = {name: bounds[name] * rng.choice((-1.0, 1.0), n) for name in ("disturbance", "measurement", "gains")}
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
        most, disturbance = np.maximum(most, np.abs(u)), np.maximum(disturbance, np.abs(xi @ C[0]))
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
