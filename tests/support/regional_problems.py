"""Problems of the regional certificates, with derivatives written out in NumPy, and problems with
equilibria beside the target, known in closed form or by mpmath at 50 digits."""

from fractions import Fraction
from random import Random
from typing import Any

import mpmath
import numpy as np
from couplings import exact
from networks import around, linked, random_arcs
from scipy.integrate import solve_ivp

from dobc_design import Exosystem, Problem, Verdict
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import verify_lure
from dobc_design.exact.matrix import to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of

PAPER = "exp(y) - 1 + y"
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
PAPER_GAIN = ((Fraction(16, 5),), (Fraction(12, 5),))


def cycle(
    n: int, gains: Any, *, coupling: str = PAPER, exosystem: Exosystem | None = None
) -> Problem:
    """Agent i listens to agent i + 1."""
    return linked(around(n), n, coupling, gains=gains, exosystem=exosystem)


def random_problem(
    seed: int, *, m: int = 1, coupling: Any = "tanh(y)", modes: int = 1, pin: float = 0.7
) -> Problem:
    """A few agents, random arcs with weights, random pins."""
    r = Random(f"lure {seed} {m} {modes}")
    n = r.randint(2, 4)
    arcs = {}
    for k in range(modes):
        arcs[f"G{k}"] = random_arcs(r, n, 0.6, lambda: r.choice((1, "1/2", 2)))
    gains = {i: r.choice((1, 2, "9/2")) for i in range(1, n + 1) if r.random() < pin}
    return linked(arcs, n, coupling, gains=gains, target=[0] * m)


def identity(size: int) -> SparseSymmetric:
    diagonal = {(i, i): Fraction(1) for i in range(size)}
    return SparseSymmetric(size, diagonal)


def is_proved(problem: Problem, lure: Lure) -> bool:
    return verify_lure(loop_of(problem), lure).verdict is Verdict.PROVED


def pins(problem: Problem) -> np.ndarray:
    """K (n m, n m)."""
    m = problem.m
    K = np.zeros((problem.n * m,) * 2)
    for i, gain in problem.pinning.gains.items():
        K[i * m : i * m + m, i * m : i * m + m] = np.array(gain, dtype=float)
    return K


def field(problem: Problem, mode: str, e: np.ndarray) -> np.ndarray:
    """h(e) - K e, arc by arc; e (..., n m)."""
    runs = e.shape[:-1]
    x = e.reshape(*runs, problem.n, problem.m)
    total = np.zeros_like(x)
    for listener, speaker, weight in problem.network.modes[mode]:
        h = problem.coupling_of(listener, speaker)
        of_speaker = x[..., speaker, :]
        of_listener = x[..., listener, :]
        total[..., listener, :] += float(weight) * h.value(of_speaker - of_listener)
    return total.reshape(e.shape) - e @ pins(problem).T


def values_along(problem: Problem, lure: Lure, level: Fraction, times: np.ndarray) -> np.ndarray:
    """V at the times of 50 runs of (22) from random starts with V = level, (runs, times); ten of
    them with eps = 0.

    All runs in one integration by SciPy, with the gain of the certificate.
    """
    size = problem.n * problem.m
    q = problem.q
    metric = np.zeros((size + problem.n * q,) * 2)
    metric[:size, :size] = to_float(lure.P_e.to_dense())
    F = np.zeros((q, q))
    C = np.zeros((problem.m, q))
    if lure.P is not None:
        one = np.eye(problem.n)
        metric[size:, size:] = np.kron(one, to_float(lure.P))
        C = to_float(problem.exosystem.C)
        A = to_float(problem.exosystem.A)
        gain = np.linalg.solve(to_float(lure.P), to_float(lure.Q))
        F = A - gain @ C
    directions = np.random.default_rng(0).standard_normal((50, len(metric)))
    directions[:10, size:] = 0
    sizes = np.sqrt(np.einsum("ri,ij,rj->r", directions, metric, directions))
    starts = directions / sizes[:, None] * float(level) ** 0.5

    def slope(t: float, flat: np.ndarray) -> np.ndarray:
        state = flat.reshape(starts.shape)
        e = state[:, :size]
        errors = state[:, size:]
        eps = errors.reshape(len(starts), problem.n, q)
        free = field(problem, "G", e)
        driven = (eps @ C.T).reshape(e.shape)
        e_dot = free + driven
        eps_dot = (eps @ F.T).reshape(len(starts), problem.n * q)
        return np.concatenate([e_dot, eps_dot], axis=1).ravel()

    with np.errstate(all="ignore"):  # trial steps of the integrator may overflow
        close: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11, "method": "DOP853"}
        span = (0, times[-1])
        run = solve_ivp(slope, span, starts.ravel(), t_eval=times, **close)
    states = run.y.reshape(*starts.shape, len(times))
    return np.einsum("rit,ij,rjt->rt", states, metric, states)


FOLDED = "y - 3/2*max(0, y - 1) - 3/2*min(0, y + 1)"  # rises to 1 at y = 1, falls to 0 at y = 3


def listening_pair(
    h: Any = "sin(y)", *, gains: Any = "1/10", target: Any = 0, reach: Any = 5, **more: Any
) -> Problem:
    """Two agents that listen to each other."""
    region = None
    if reach is not None:
        region = {"initial_states": reach if isinstance(reach, list) else [-reach, reach]}
    given = {"gains": gains, "target": target, "region": region}
    arcs = [[1, 2], [2, 1]]
    return linked(arcs, 2, h, **given, **more)


def half_difference(guess: float, k: float = 0.1) -> Fraction:
    """e_2 = -e_1 = y/2 with 2 sin y + k y = 0 near ``guess``: both agents of the pair pinned with
    k."""
    with mpmath.workdps(50):
        y = mpmath.findroot(lambda y: 2 * mpmath.sin(y) + mpmath.mpf(k) * y, guess)
        return exact(y / 2)


def random_folded(seed: int, *, m: int = 1, exceptions: bool = True) -> Problem:
    """Weights, an arc with a coupling of its own, matrix gains for m > 1, offsets."""
    r = Random(f"equilibria {seed} {m}")
    n = r.randint(2, 5)
    arcs = []
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            if i != j and (j == i % n + 1 or r.random() < 0.4):
                weight = r.choice((1, "1/2", 2))
                arc = [i, j, weight]
                arcs.append(arc)
    h: Any = r.choice(("sin(y)", FOLDED, "y*exp(1 - y**2)", "clip(y, -1, 1)", "exp(y) - 1 + y"))
    if m > 1 and r.random() < 0.5:
        h = [f"sin(y{c + 1}) + y{(c + 1) % m + 1}/4" for c in range(m)]
    gains: Any = {i: r.choice(("1/10", "1/2", 3)) for i in range(1, n + 1) if r.random() < 0.7}
    if m > 1:
        gains = {i: _twisted(m, k) for i, k in gains.items()}
    first = arcs[0][:2]
    other = {(first[0] - 1, first[1] - 1): "tanh(2*y)"} if exceptions else None
    region = {"initial_states": [-9, 9]}
    given = {"gains": gains, "target": [1] * m, "region": region}
    offset = [r.randint(-2, 2) for _ in range(m)]
    offsets = {1: offset}
    return linked(arcs, n, h, exceptions=other, offsets=offsets, **given)


def _twisted(m: int, k: Any) -> list[list[Any]]:
    """k on the diagonal and 1/20 of a skew matrix beside it."""
    rows = []
    for c in range(m):
        below = ["-1/20"] * c + [k]
        above = ["1/20"] * (m - c - 1)
        rows.append(below + above)
    return rows
