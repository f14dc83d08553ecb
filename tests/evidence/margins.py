"""Tolerances and inputs against simulations with couplings and formulas of this page alone."""

from fractions import Fraction
from typing import Any

import numpy as np
from evidence.row import Row
from networks import network_of
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dobc_design import Check, Problem, load_problem
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.margins.stage import inputs_stage, margins_stage
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.loop.make import loop_of

Array = NDArray[np.float64]
COUPLINGS = {
    "exp(y) - 1 + y": lambda y: np.exp(y) - 1 + y,
    "tanh(y)": np.tanh,
    "y": lambda y: y,
    "sin(y)": np.sin,
}
CORNERS, STEP, TIME = 50, 0.01, 6.0  # of one problem; s


def tolerances(count: int, seed: int) -> Row:
    """Random corners of the weights and gains that are tolerated, from corners of the set: none
    leaves it.  Beside it the smallest error, by bisection, for which a simulated corner does
    leave."""
    failures = []
    ratios = []
    met = 0
    number = seed
    while met < count and number < seed + 4 * count:
        h = tuple(COUPLINGS)[number % len(COUPLINGS)]
        problem = _problem(number, h)
        number = number + 1
        checks = _checks(problem)
        if "tolerance" not in checks:
            continue
        claim = checks["tolerance"].claim
        base = checks["max-separable"].claim
        d = float(claim.errors.weights)
        rng = np.random.default_rng(number)
        for _ in range(min(CORNERS, count - met)):
            met += 1
            if _leaves(problem, h, base, d, d, rng) > 1 + 1e-9:
                failures.append(f"{number - 1}: a corner leaves the set")
        low = d
        high = min(8 * d, 0.999)
        worst = [_leaves(problem, h, base, high, high, None, side) > 1 + 1e-6 for side in (1, -1)]
        if any(worst):
            for _ in range(12):
                middle = (low + high) / 2
                bad = any(
                    _leaves(problem, h, base, middle, middle, None, side) > 1 + 1e-6
                    for side in (1, -1)
                )
                low, high = (low, middle) if bad else (middle, high)
            ratios.append(high / d)
    notes = [f"smallest error that fails / tolerated one, {len(ratios)} problems: {_three(ratios)}"]
    return Row(
        "tolerated errors of weights and gains: no corner leaves the set",
        met,
        failures,
        notes,
        least=count,
    )


def inputs(count: int, seed: int) -> Row:
    """paper-fixed, starts on the boundary of the certified set and inside it: the largest |u_i|
    beside the bound."""
    problem = load_problem("paper-fixed").replace(actuators={})
    checks = _checks(problem)
    claim = checks["actuators"].claim
    base = checks["max-separable"].claim
    W = observer_gain(loop_of(problem))
    n = problem.n
    rng = np.random.default_rng(seed)
    v = np.array([float(x) for x in base.v])
    k = np.array([5.0 if i in (0, 5) else 0.0 for i in range(n)])
    A = np.array([[0.0, 2.0], [-2.0, 0.0]])
    C = np.array([1.0, 0.0])
    F = A - np.outer(np.array(W, dtype=float)[:, 0], C)
    P = np.array(base.error.P, dtype=float)
    arcs = problem.network.modes["Ga"]
    rho = float(base.rho)
    kappa = float(base.error.kappa)
    i = arcs.listeners
    j = arcs.speakers
    onto = np.eye(n)[arcs.listeners]
    split = rng.choice((0.0, 1.0, 0.5), size=(count, 1))
    e = rho * split * v * rng.choice((-1, 1), size=(count, n))
    away = rng.normal(size=(count, n, 2))
    norms = np.sqrt(np.einsum("rni,ij,rnj->rn", away, P, away))[..., None]
    # E at the start, at most
    first = float(checks["actuators"].domain.disturbance) * float(base.error.size) ** 0.5
    eps = np.minimum(rho * (1 - split) / kappa, first)[..., None] * away / norms
    xi0 = np.array([float(x) for x in problem.simulation.xi0[0]])
    most = np.zeros(n)

    def field(e: Array, eps: Array) -> tuple[Array, Array]:
        y = e[:, j] - e[:, i]
        return (np.exp(y) - 1 + y) @ onto - k * e + eps @ C, eps @ F.T

    t = 0.0
    while t < TIME:
        # of Runge and Kutta; starts are stiff
        step = min(STEP, 0.5 / (np.max(np.exp(e[:, j] - e[:, i])) + 6))
        d = xi0[0] * np.cos(2 * t) + xi0[1] * np.sin(2 * t)
        most = np.maximum(most, np.max(np.abs(-k * e - d + eps @ C), axis=0))
        a = field(e, eps)
        b = field(e + step / 2 * a[0], eps + step / 2 * a[1])
        c = field(e + step / 2 * b[0], eps + step / 2 * b[1])
        z = field(e + step * c[0], eps + step * c[1])
        e, eps = (
            x + step / 6 * (p + 2 * q + 2 * r + s)
            for x, p, q, r, s in zip((e, eps), a, b, c, z, strict=True)
        )
        t += step
    bounds = np.array([float(claim.inputs[label]) for label in problem.network.labels])
    failures = [
        f"agent {i + 1}: {most[i]:.6g} > {bounds[i]:.6g}"
        for i in range(n)
        if not most[i] <= bounds[i]
    ]
    notes = [
        f"largest input simulated {np.max(most):.5g}, bound {np.max(bounds):.5g}; share "
        f"{_three(most / bounds)}"
    ]
    return Row("inputs on the certified set: none exceeds its bound", count, failures, notes)


def _checks(problem: Problem) -> dict[str, Check]:
    asked = read_region(
        loop_of(problem), observer_gain(loop_of(problem)), domain=NEAR_TARGET, everything=True
    )
    checks = separable_stage(asked, lambda stage: None)
    checks += margins_stage(asked, checks, lambda stage: None)
    checks += inputs_stage(asked, checks, lambda stage: None)
    return {check.id: check for check in checks if check.claim}


def _problem(seed: int, h: str) -> Problem:
    """A few agents, the first pinned, each hearing one with a smaller number and perhaps others."""
    rng = np.random.default_rng(seed)
    arcs = []
    n = int(rng.integers(3, 7))
    for i in range(2, n + 1):
        others = {int(rng.integers(1, i)), int(rng.integers(1, n + 1))} - {i}
        arcs += [[i, j, Fraction(int(rng.integers(1, 9)), 4)] for j in sorted(others)]
    network = network_of(arcs, n)
    region: Any = {"initial_states": ["-0.5", "0.5"]}
    return Problem(
        network=network, coupling=h, gains={1: int(rng.integers(1, 6))}, target=0, region=region
    )


def _leaves(
    problem: Problem, h: str, base: Any, dw: float, dk: float, rng: Any, side: int = 1
) -> float:
    """The largest N / rho of a run from a corner of the set; ``rng`` None: the corner and the
    weights that are worst for a coupling that rises."""
    arcs = next(iter(problem.network.modes.values()))
    v = np.array([float(x) for x in base.v])
    function = COUPLINGS[h]
    i = arcs.listeners
    j = arcs.speakers
    w = np.array([float(x) for x in arcs.weights])
    gains = np.array(
        [float(problem.pinning.gains[a][0][0]) if a == 0 else 0.0 for a in range(problem.n)]
    )
    n = problem.n
    if rng is None:
        w = w * np.where(v[j] > v[i], 1 + dw, 1 - dw)
        gains = gains * (1 - dk)
        signs = np.full(n, side)
    else:
        w = w * (1 + dw * rng.choice((-1, 1), size=len(w)))
        gains = gains * (1 + dk * rng.choice((-1, 1), size=n))
        signs = rng.choice((-1, 1), size=n)

    def field(t: float, e: Array) -> Array:
        return np.bincount(i, w * function(e[j] - e[i]), n) - gains * e

    run = solve_ivp(field, (0, 2), float(base.rho) * v * signs, rtol=1e-10, atol=1e-12)
    return float(np.max(np.abs(run.y).T / v) / float(base.rho))


def _three(numbers: Any) -> str:
    found = np.sort(np.asarray(numbers, dtype=float))
    return (
        "none"
        if not len(found)
        else f"least {found[0]:.3f}, median {np.median(found):.3f}, most {found[-1]:.3f}"
    )
