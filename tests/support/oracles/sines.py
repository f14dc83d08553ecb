"""Loops under sines of unknown frequencies in floats, for one component each: the plain equations
(1), (12), (13) and (19), which share no code with the package."""

from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np

from dobc_design import Exosystem, Network, Observer, Problem

STEP = 0.02  # s of the integrator
SETTLED = 60.0  # s
PERIODS = 6.0  # of the slowest sine, in which the largest error is looked for


def left_of(A: Any, C: Any, W: Any, w: np.ndarray) -> np.ndarray:
    """|I - C (jw - A + W C)^-1 W|, (frequencies, m, m)."""
    A, C, W = (np.array(x, dtype=float) for x in (A, C, W))
    inner = 1j * w[:, None, None] * np.eye(len(A)) - (A - W @ C)
    return np.abs(
        np.eye(len(C)) - C @ np.linalg.solve(inner, np.broadcast_to(W, (len(w), *W.shape)))
    )


def drawn_observer(r: Random) -> tuple[Exosystem, list[list[Fraction]]]:
    """A and C of one or two components, and a W for which A - W C is diagonally dominant."""
    m = r.choice((1, 1, 2))
    q = r.randint(m, 4)
    C = np.array([[r.randint(-3, 3) for _ in range(q)] for _ in range(m)])
    W = np.array([[r.randint(-3, 3) for _ in range(m)] for _ in range(q)])
    F = np.array([[r.randint(-3, 3) for _ in range(q)] for _ in range(q)])
    F -= (1 + max(np.abs(F).sum(axis=1))) * np.eye(q, dtype=int)
    gain = [[Fraction(int(x)) for x in row] for row in W]
    return Exosystem(A=(F + W @ C).tolist(), C=C.tolist()), gain


@dataclass(frozen=True)
class SineLoop:
    """A network of single integrators with one band, and its numbers in floats."""

    problem: Problem
    pull: np.ndarray  # K, (n,)
    weights: np.ndarray  # (n, n), of listener and speaker
    A: np.ndarray
    C: np.ndarray
    W: np.ndarray
    band: tuple[float, float, float]

    @property
    def n(self) -> int:
        return len(self.pull)


def drawn_network(seed: int, coupling: str) -> SineLoop:
    """Two to six agents in a chain with further arcs, the first one pinned; poles near the band."""
    r = Random(f"sines {seed}")
    n = r.randint(2, 6)
    arcs = {(i, i - 1): Fraction(r.randint(5, 20), 10) for i in range(1, n)}
    for _ in range(r.randint(0, n)):
        i, j = r.sample(range(n), 2)
        arcs.setdefault((i, j), Fraction(r.randint(1, 20), 10))
    pull = {i: Fraction(r.randint(20, 60), 10) for i in range(n) if i == 0 or r.random() < 0.3}
    low = Fraction(r.randint(5, 40), 10)
    high = low * Fraction(r.randint(102, 160), 100)
    amplitude = Fraction(r.randint(1, 5), 10)
    pole = round((float(low) + float(high)) / 2, 3)
    fast = r.randint(2, 8)
    A = [["0", str(pole)], [str(-pole), "0"]]
    w = Fraction(str(pole))
    # chi_F = (s + fast)^2
    W = [[Fraction(2 * fast)], [(Fraction(fast**2) - w**2) / w]]
    problem = Problem(
        network=Network.from_arcs(
            [[i + 1, j + 1, str(x)] for (i, j), x in arcs.items()], agents=n, arrow="listens_to"
        ),
        coupling=coupling,
        gains={str(i + 1): str(k) for i, k in pull.items()},
        exosystem=Exosystem(A=A, C=[[1, 0]]),
        observer=Observer(W=W),
        region=None if coupling == "y" else {"initial_states": [-1, 1], "initial_disturbance": 0},
        uncertainty={"bands": [[low, high, amplitude]]},
    )
    weights = np.zeros((n, n))
    for (i, j), x in arcs.items():
        weights[i, j] = float(x)
    return SineLoop(
        problem=problem,
        pull=np.array([float(pull.get(i, 0)) for i in range(n)]),
        weights=weights,
        A=np.array(A, dtype=float),
        C=np.array([[1.0, 0.0]]),
        W=np.array([[float(x) for x in row] for row in W]),
        band=(float(low), float(high), float(amplitude)),
    )


def responses(network: SineLoop, w: np.ndarray) -> np.ndarray:
    """From d_j to e_i in the loop linearised at the target, (frequencies, n, n)."""
    low = np.diag(network.weights.sum(axis=1) + network.pull) - network.weights
    inner = 1j * w[:, None, None] * np.eye(network.n) + low
    A, C, W = network.A, network.C, network.W
    F = 1j * w[:, None, None] * np.eye(len(A)) - (A - W @ C)
    left = 1 - (C @ np.linalg.solve(F, np.broadcast_to(W, (len(w), *W.shape))))[:, 0, 0]
    return np.linalg.inv(inner) * left[:, None, None]


def worst_errors(network: SineLoop) -> np.ndarray:
    """What sines of the band come to at the worst in a linear loop, (n,): every agent at a
    frequency and a phase of its own."""
    low, high, amplitude = network.band
    found = np.abs(responses(network, np.linspace(low, high, 801)))
    return amplitude * found.max(axis=0).sum(axis=1)


def reached_errors(network: SineLoop, seed: int) -> np.ndarray:
    """The largest |e_i| in the last periods of runs, (n,): two for every agent, all agents at the
    frequency to which that agent responds most, or each at one by chance, in phases that add up."""
    r = np.random.default_rng(seed)
    n = network.n
    low, high, _ = network.band
    grid = np.linspace(low, high, 101)
    found = responses(network, grid)
    frequencies = []
    phases = []
    for agent in range(n):
        common = np.full(n, np.abs(found[:, agent]).sum(axis=1).argmax())
        for places in (common, r.integers(0, len(grid), n)):
            frequencies.append(grid[places])
            phases.append(-np.angle(found[places, agent, np.arange(n)]))
    return _run(network, np.array(frequencies), np.array(phases), r)


def _run(network: SineLoop, w: np.ndarray, phase: np.ndarray, r: np.random.Generator) -> np.ndarray:
    """From starts in the region whose observers are where they come to without sines; w and phase
    are (runs, n)."""
    weights, pull = network.weights, network.pull
    A, C, W = network.A, network.C, network.W
    h = network.problem.coupling.numpy_function()
    xi = r.uniform(-1, 1, (*w.shape, len(A)))
    state = (r.uniform(-1, 1, w.shape), xi, xi.copy())

    def change(t: float, x: np.ndarray, xi: np.ndarray, hat: np.ndarray) -> tuple[np.ndarray, ...]:
        d = xi @ C[0] + network.band[2] * np.sin(w * t + phase)
        dhat = hat @ C[0]
        heard = x[:, None, :] - x[:, :, None]
        pulls = h(heard.reshape(-1, 1)).reshape(heard.shape)
        moved = (weights * pulls).sum(axis=2) - pull * x - dhat + d
        return moved, xi @ A.T, hat @ A.T + (d - dhat)[..., None] * W[:, 0]

    slowest = 2 * np.pi / w.min()
    largest = np.zeros(network.n)
    for k in range(int((SETTLED + PERIODS * slowest) / STEP)):
        t = k * STEP
        k1 = change(t, *state)
        k2 = change(t + STEP / 2, *_moved(state, k1, STEP / 2))
        k3 = change(t + STEP / 2, *_moved(state, k2, STEP / 2))
        k4 = change(t + STEP, *_moved(state, k3, STEP))
        for part, weight in ((k1, 1), (k2, 2), (k3, 2), (k4, 1)):
            state = _moved(state, part, STEP * weight / 6)
        if t > SETTLED:
            largest = np.maximum(largest, np.abs(state[0]).max(axis=0))
    return largest


def _moved(state: Any, slope: Any, step: float) -> Any:
    return tuple(x + step * y for x, y in zip(state, slope, strict=True))
