"""Loops under disturbance, drift and noise: the exact L-infinity gain of linear ones, and runs
driven bang-bang.

Nothing of the package decides here: closed loops are built from the arcs, impulse responses come
from SciPy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design import Exosystem, Network, Observer, Problem, certify
from dobc_design.exact.matrix import matrix, to_float
from dobc_design.problem.dynamics import Dynamics


def linear_problem(
    n: int,
    modes: Mapping[str, Sequence[tuple[int, int, str]]],
    gains: Mapping[str, Any],
    **more: Any,
) -> Problem:
    """Agents 1 to n; an arc (i, j, w), from 0: i listens to j."""
    arcs = {name: [[i + 1, j + 1, w] for i, j, w in each] for name, each in modes.items()}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(**{"network": network, "coupling": "y", "gains": gains} | more)


@dataclass(frozen=True)
class Loop:
    """x' = A x + B u, x = (e, eps), u = (w, g, nu) with |u| <= limits; linearised with the slopes
    at 0."""

    A: np.ndarray
    B: np.ndarray
    limits: np.ndarray
    n: int


def loop_of(problem: Problem) -> Loop:
    """One mode, m = 1, one exosystem or none; the plant's couplings act on the true states."""
    n, q = problem.n, problem.q
    (arcs,) = problem.network.modes.values()
    L, K = np.zeros((n, n)), np.zeros((n, n))
    for i, j, w in arcs:
        slope = float(w) * float(problem.coupling_of(i, j).jacobian_at_zero()[0][0].lo)
        L[i, i] += slope
        L[i, j] -= slope
    for i, k in problem.pinning.gains.items():
        K[i, i] = float(k[0][0])
    one = np.eye(n)
    A, B = -L - K, np.hstack([one, np.zeros((n, n * q)), -K])
    if q:
        exosystem = problem.joint_exosystem
        W = to_float(certify(problem.replace(uncertainty=None)).claims.W)
        C = to_float(exosystem.C)
        F = to_float(exosystem.A) - W @ C
        A = np.block([[A, np.kron(one, C)], [np.zeros((n * q, n)), np.kron(one, F)]])
        B[:, -n:] -= float((C @ W)[0, 0]) * one
        B = np.vstack(
            [B, np.hstack([-np.kron(one, W), np.eye(n * q), -np.kron(one, F @ W) - np.kron(L, W)])]
        )
    plant = problem.uncertainty
    counts = ((plant.disturbance, n), (plant.drift, n * q), (plant.measurement, n))
    limits = np.concatenate([np.full(count, float(limit)) for limit, count in counts])
    return Loop(A, B, limits, n)


def responses(loop: Loop, *, points: int = 6000) -> tuple[np.ndarray, float]:
    """What e gains from inputs that are 1 for one step and 0 afterwards, (points, n, inputs), and
    the step (s)."""
    slowest, size = float(-np.max(np.linalg.eigvals(loop.A).real)), len(loop.A)
    step, inputs = 16 / slowest / points, loop.B.shape[1]
    joint = linalg.expm(step * np.block([[loop.A, loop.B], [np.zeros((inputs, size + inputs))]]))
    phi, Z, found = joint[:size, :size], joint[:size, size:], []
    for _ in range(points):
        found.append(Z[: loop.n])
        Z = phi @ Z
    return np.array(found), step


def gain_of(problem: Problem) -> np.ndarray:
    """The largest |e_i| that inputs within the limits reach in a linear loop: those that are
    constant on each of many short steps, so that it is never above the L-infinity gain."""
    loop = loop_of(problem)
    return np.sum(np.abs(responses(loop)[0]) @ loop.limits, axis=0)


def second_order(seed: int) -> tuple[Problem, Loop]:
    """Two to five double integrators with drag, p'' = sum of w (p_j - p_i) - c p' - k p + d + w, in
    a tree: the problem and the loop of (p, p', eps), written out from theory, section 13."""
    r = Random(f"accuracy of second order {seed}")
    n, drag, k = r.randint(2, 5), r.randint(8, 12), r.randint(1, 2)
    arcs = [(i, r.randrange(i), f"{r.randint(2, 4)}/2") for i in range(1, n)]
    L, one = np.zeros((n, n)), np.eye(n)
    for i, j, w in arcs:
        L[i, i] += float(Fraction(w))
        L[i, j] -= float(Fraction(w))
    L[0, 0] += k
    A, B = np.block([[0 * one, one], [-L, -drag * one]]), np.vstack([0 * one, one])
    more: dict[str, Any] = {}
    plant = {"disturbance": f"{r.randint(1, 9)}/10"}
    if seed % 2:
        plant["drift"], a, b = "1/20", r.randint(20, 40) / 10, r.randint(10, 30) / 10
        F = np.array([[-a, 1], [-1 - b, 0]])
        more = {
            "exosystem": Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]]),
            "observer": Observer(W=[[f"{a}"], [f"{b}"]]),
        }
        C, W = np.array([[1.0, 0.0]]), np.array([[a], [b]])
        A = np.block(
            [
                [A, np.vstack([np.zeros((n, 2 * n)), np.kron(one, C)])],
                [np.zeros((2 * n,) * 2), np.kron(one, F)],
            ]
        )
        B = np.block([[B, np.zeros((2 * n, 2 * n))], [-np.kron(one, W), np.eye(2 * n)]])
    limits = [float(Fraction(plant["disturbance"]))] * n + [0.05] * (2 * n * (seed % 2))
    problem = linear_problem(
        n,
        {"a": arcs},
        {"1": [[k, 0]]},
        coupling="y1",
        uncertainty=plant,
        dynamics=Dynamics(A=[[0, 1], [0, -drag]], B=[[0], [1]]),
        **more,
    )
    return problem, Loop(A, B, np.array(limits), 2 * n)


def random_linear(seed: int) -> Problem:
    """Two to twelve agents, all reached, random weights and pins, with the paper's observer in
    every second one."""
    r = Random(f"accuracy {seed}")
    n = r.randint(2, 12)
    arcs = {(i, r.randrange(i)): r.randint(1, 30) for i in range(1, n)}
    for _ in range(r.randint(0, 2 * n)):
        i, j = r.sample(range(n), 2)
        arcs[i, j] = r.randint(1, 30)
    gains = {"1": f"{r.randint(2, 40)}/4"} | {
        str(r.randint(1, n)): f"{r.randint(1, 40)}/4" for _ in range(n // 3)
    }
    more: dict[str, Any] = {}
    if seed % 2:
        f, g = r.randint(5, 40), r.randint(5, 60)
        more = {
            "exosystem": Exosystem(A=matrix([[0, f"{f}/10"], [f"-{f}/10", 0]]), C=matrix([[1, 0]]))
        }
        more["observer"] = Observer(W=matrix([[f"{g}/10"], [f"{r.randint(0, g)}/10"]]))
    plant = {
        "disturbance": f"{r.randint(1, 20)}/10",
        "measurement": f"{r.choice((0, 0, 1))}/50",
        "drift": "1/20",
    }
    listed = [(i, j, f"{w}/8") for (i, j), w in sorted(arcs.items())]
    return linear_problem(n, {"a": listed}, gains, uncertainty=plant, **more)


def exact_gain(seed: int) -> tuple[Problem, np.ndarray]:
    """A random linear problem and its exact L-infinity gain."""
    problem = random_linear(seed)
    return problem, gain_of(problem)


def final_errors(problem: Problem, *, seed: int, runs: int = 3) -> np.ndarray:
    """The largest |e_i| at the end of runs of the loop as it is, with its own couplings, whose
    inputs are bang-bang along the impulse responses of the linearised loop for a few agents."""
    loop = loop_of(problem)
    n, q = problem.n, problem.q
    H, step = responses(loop, points=3000)
    (arcs,) = problem.network.modes.values()
    i, j, weights = arcs.listeners, arcs.speakers, np.array([float(w) for w in arcs.weights])
    h = problem.coupling.numpy_function()
    A, B = loop.A, loop.B
    slope = float(problem.coupling.jacobian_at_zero()[0][0].lo)
    W = np.zeros((q, 1)) if not q else -B[n : n + q, :1]

    def rest(y: np.ndarray) -> np.ndarray:
        """What the couplings add to their linear part, by arc."""
        return weights * (h(y[:, None])[:, 0] - slope * y)

    def field(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        y, noise = x[j] - x[i], u[n + n * q :]
        acts, seen = rest(y), rest(y + noise[j] - noise[i])
        change = A @ x + B @ u
        change[:n] += np.bincount(i, weights=acts, minlength=n)
        if q:
            off = np.bincount(i, weights=acts - seen, minlength=n)
            change[n:] -= np.kron(off, W[:, 0])
        return change

    worst = np.zeros(n)
    r = Random(f"bang-bang {seed}")
    for agent in r.sample(range(n), min(runs, n)):
        x = np.zeros(len(A))
        for signs in np.sign(H[::-1, agent]):
            u = loop.limits * signs
            x = x + step * field(x + step / 2 * field(x, u), u)
        worst[agent] = max(worst[agent], abs(x[agent]))
    return worst
