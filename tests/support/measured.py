"""Agents that measure y = H x: random problems, and their whole loop, of states and estimates as
they stand, beside the errors that the package works with."""

from collections.abc import Iterable, Iterator
from random import Random
from typing import Any

import numpy as np
from networks import network_of
from numpy.typing import NDArray
from scipy import linalg

from dobc_design import (
    Exosystem,
    Group,
    Network,
    Observer,
    Problem,
    Verdict,
    verify,
)
from dobc_design.certificate.certificate import Certificate
from dobc_design.errors import SpecError
from dobc_design.loop.make import errors_of
from dobc_design.problem.dynamics import Dynamics
from dobc_design.simulation.setting import make_setting

Floats = NDArray[np.float64]


def floats(M: Any) -> Floats:
    return np.array([[float(x) for x in row] for row in M])


def by_agent(problem: Problem) -> list[tuple[Floats, Floats, Floats]]:
    """A, C and W of every agent."""
    found = {}
    for group in problem.groups:
        own = (floats(group.exosystem.A), floats(group.exosystem.C), floats(group.observer.W))
        found |= dict.fromkeys(group.agents, own)
    return [found[label] for label in problem.network.labels]


def whole_loop(problem: Problem, mode: str) -> Floats:
    """The matrix of x, xhat and xi - xihat of all agents about the target, couplings linear; what
    agents that agree have in common is left out."""
    own = problem.dynamics
    assert own is not None and own.A is not None and own.H is not None
    A, B, H = floats(own.A), floats(own.B), floats(own.H)
    n, m = problem.n, problem.m
    systems = by_agent(problem)
    sizes = [len(each[0]) for each in systems]
    first = 2 * n * m + np.cumsum([0, *sizes])
    M = np.zeros((first[-1], first[-1]))

    def x(i: int) -> slice:
        return slice(i * m, (i + 1) * m)

    def xhat(i: int) -> slice:
        return slice((n + i) * m, (n + i + 1) * m)

    felt = H if own.acts_on else np.eye(m)
    used = x if own.acts_on else xhat
    pins = dict(problem.pinning.gains) | dict(problem.pinning.modes.get(mode, {}))
    for i, (A_xi, C, W) in enumerate(systems):
        xi = slice(first[i], first[i + 1])
        for rows in (x(i), xhat(i)):
            M[rows, rows] += A
            if i in pins:
                M[rows, used(i)] -= B @ floats(pins[i]) @ felt
            for listener, speaker, w in problem.network.modes[mode]:
                if listener != i:
                    continue
                h = problem.exceptions.get((i, speaker), problem.coupling)
                G = float(w) * floats([[g.midpoint for g in row] for row in h.jacobian_at_zero()])
                M[rows, used(speaker)] += B @ G @ felt
                M[rows, used(i)] -= B @ G @ felt
        # The disturbance acts on x, and its estimate takes it away from both.
        M[x(i), xi] += B @ C
        M[xhat(i), x(i)] += W[:m] @ H
        M[xhat(i), xhat(i)] -= W[:m] @ H
        M[xi, xi] += A_xi
        M[xi, x(i)] -= W[m:] @ H
        M[xi, xhat(i)] += W[m:] @ H
    if problem.goal == "agreement":
        return _without_common(M, n, m)
    return M


def _without_common(M: Floats, n: int, m: int) -> Floats:
    """What is left of M where all x and xhat may be moved by the same."""
    common = np.zeros((len(M), m))
    common[: 2 * n * m] = np.tile(np.eye(m), (2 * n, 1))
    others = linalg.null_space(common.T)
    return others.T @ M @ others


def growth(problem: Problem) -> dict[str, float]:
    """The largest real part of an eigenvalue of the whole loop, by mode."""
    found = {}
    for mode in problem.network.modes:
        M = whole_loop(problem, mode)
        found[mode] = float(np.max(np.linalg.eigvals(M).real)) if len(M) else -np.inf
    return found


def mistaken(certificate: Certificate, problem: Problem) -> str | None:
    """What a certificate says although the eigenvalues of the whole loop do not; None if
    nothing."""
    by_mode = growth(certificate.problem)
    fastest = max(by_mode.values())
    if not verify(certificate, problem).holds:
        return "a claim is not confirmed"
    if certificate.verdict is Verdict.PROVED:
        if fastest >= 0:
            return f"proved, and a mode grows like exp({fastest} t)"
        if certificate.rate and certificate.rate > -fastest + 1e-7:
            return f"a rate of {certificate.rate} in place of {-fastest}"
    if certificate.verdict is Verdict.REFUTED and len(by_mode) == 1 and fastest < -1e-9:
        return f"refuted, and everything decays like exp({fastest} t)"
    return None


def _matrix(random: Random, rows: int, columns: int, low: int, high: int) -> list[list[int]]:
    return [[random.randint(low, high) for _ in range(columns)] for _ in range(rows)]


def _rows(gain: Any) -> list[str]:
    """The coupling y -> gain y."""
    texts = []
    for row in gain:
        names = ["y"] if len(row) == 1 else [f"y{k + 1}" for k in range(len(row))]
        texts.append(" + ".join(f"({x})*{name}" for x, name in zip(row, names, strict=True)))
    return texts


def _regulator(A: Any, B: Any, seen: Floats) -> Any:
    """A gain of seen x that holds one agent, if all states are seen; a guess otherwise."""
    X = linalg.solve_continuous_are(floats(A), floats(B), np.eye(len(A)), np.eye(len(B[0])))
    gain = floats(B).T @ X @ np.linalg.pinv(seen)
    return np.round(1.5 * gain, 2).tolist()


def _exosystem(random: Random, inputs: int) -> Exosystem:
    w = random.randint(1, 3)
    A = random.choice([[[0]], [[0, w], [-w, 0]], [[-1]]])
    return Exosystem(A=A, C=_matrix(random, inputs, len(A), -1, 1))


def random_problem(seed: int) -> Problem | None:
    """A problem with linear couplings; None where its matrices make none."""
    random = Random(seed)
    n, m = random.randint(2, 4), random.randint(1, 3)
    inputs, outputs = random.randint(1, m), random.randint(1, m)
    A = _matrix(random, m, m, -2, 1)
    B = _matrix(random, m, inputs, -1, 1)
    H = _matrix(random, outputs, m, -1, 1)
    acts_on = random.choice(["states", "outputs"])
    felt = floats(H) if acts_on == "outputs" else np.eye(m)
    labels = range(1, n + 1)
    pairs = [[i, j] for i in labels for j in labels if i != j]
    modes = {}
    for name in "AB"[: random.randint(1, 2)]:
        modes[name] = [each for each in pairs if random.random() < 0.6]
    more: dict[str, Any] = {}
    try:
        gain = _regulator(A, B, felt)
        if random.random() < 0.2:
            gain = _matrix(random, inputs, len(felt), -1, 2)
        if random.random() < 0.3:
            more["goal"] = "agreement"
        else:
            more["gains"] = {i: gain for i in labels if random.random() < 0.7} or {1: gain}
        if random.random() < 0.3:
            special = [[round(2 * x, 3) for x in row] for row in gain]
            more["exceptions"] = {tuple(modes["A"][0]): _one(_rows(special))}
        if random.random() < 0.3:
            one, two = _exosystem(random, inputs), _exosystem(random, inputs)
            more["groups"] = [
                Group(agents=[1], exosystem=one),
                Group(agents=list(labels)[1:], exosystem=two),
            ]
        else:
            more["exosystem"] = _exosystem(random, inputs)
            if random.random() < 0.3:
                q = more["exosystem"].order
                more["observer"] = Observer(W=_matrix(random, m + q, outputs, -3, 6))
        return Problem(
            network=Network.from_arcs(modes, arrow="listens_to", agents=n),
            coupling=_one(_rows(gain)),
            dynamics=Dynamics(A=A, B=B, H=H, acts_on=acts_on),
            **more,
        )
    except (SpecError, ValueError, IndexError, np.linalg.LinAlgError):
        return None


def _one(texts: list[str]) -> Any:
    return texts[0] if len(texts) == 1 else texts


def random_problems(seeds: Iterable[int]) -> Iterator[tuple[int, Problem]]:
    for seed in seeds:
        problem = random_problem(seed)
        if problem is not None:
            yield seed, problem


_DAMPED = {"A": [[0, 1], [0, -3]], "B": [[0], [1]], "H": [[1, 0]]}
_SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
_CONSTANT = Exosystem(A=[[0]], C=[[1]])


def carts(**given: Any) -> Problem:
    """Three carts in a row, of which the first is pinned."""
    sound: dict[str, Any] = {
        "name": "carts",
        "simulation": {"xi0": _START},
        "dynamics": _DAMPED,
        "coupling": "2*y1 + 3*y2",
        "gains": {1: [[4, 4]]},
        "target": [1, 0],
        "observer": Observer(rate=1),
    }
    if "groups" not in given:
        sound["exosystem"] = _SINE
    return Problem(network=network_of([[2, 1], [3, 2]], 3), **sound | given)


_START = [[0.5, -0.25], [1, 0], [-0.5, 0.75]]
_OUTPUTS = {"dynamics": _DAMPED | {"acts_on": "outputs"}, "gains": {1: 4}}
_GROUPS = [
    Group(agents=[1, 3], exosystem=_SINE),
    Group(agents=[2], exosystem=_CONSTANT),
]
CARTS = {
    "estimates": carts(),
    "outputs": carts(coupling="2*y", **_OUTPUTS),
    "curved": carts(coupling="tanh(2*y1 + 3*y2)"),
    "curved outputs": carts(coupling="tanh(y)", **_OUTPUTS),
    "leader": carts(target=[0, 0], leader={"initial": [[0, 1], [1, 1]]}, dynamics=_DAMPED),
    "groups": carts(groups=_GROUPS, simulation={"xi0": [_START[0], [1], _START[2]]}),
}


def estimates_at_start(problem: Problem, horizon: float) -> Floats:
    """x - xhat (n, m) as it is drawn; a run does not say it."""
    setting = make_setting(
        problem,
        gain=errors_of(problem).joint_observer.W,
        mode=None,
        signal=None,
        start=None,
        t_final=horizon,
        seed=None,
        samples=None,
        observer="closed-form",
        tolerance=1e-9,
        stress=None,
    )
    eps = setting.starts.draw(setting.seed).eps
    off = []
    first = 0
    for group in problem.groups:
        off.append(eps[:, first : first + problem.m])
        first += problem.m + group.exosystem.order
    total: Floats = np.sum(off, axis=0)
    return total
