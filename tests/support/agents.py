"""Agents with dynamics: problems with known answers, random ones, and the whole loop written out by
hand from theory, section 13."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from networks import around, floats, jacobian_by_hand, network_of, random_arcs
from scipy.linalg import solve_continuous_are

import dobc_design as dd
from dobc_design import Dynamics, Exosystem, Observer, Problem
from dobc_design.errors import SpecError

RING = network_of([["a", "b"], ["b", "c"], ["c", "a"]])
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
SINE: dict[str, Any] = {"A": [[0, 2], [-2, 0]]}


def double_integrators() -> dd.Problem:
    """p'' = u + d, m = 2, p = 1: linear couplings, gains that are numbers, no u0."""
    given: dict[str, Any] = {"name": "carts", "network": RING, "dynamics": DOUBLE}
    given["exosystem"] = dd.Exosystem(**SINE, C=[[1, 0]])
    given["observer"] = dd.Observer(W=[["16/5"], ["12/5"]])
    given["simulation"] = {"t_final": 6, "xi0": ["0.4", "0.3"]}
    gains = {"a": 2, "b": 1}
    return dd.Problem(coupling="y1 + 2*y2", target=[1, 0], gains=gains, **given)


def three_states() -> dd.Problem:
    """m = 3, p = 2: u0 and offsets are not 0, couplings saturate, B is no part of the identity, W
    acts on x."""
    A = [[0, 1, 0], [-1, "-1/2", "1/4"], [0, "1/2", -1]]
    given: dict[str, Any] = {"name": "plants", "network": RING}
    B = [[0, 0], [2, 0], [1, 1]]
    given["dynamics"] = Dynamics(A=A, B=B)
    given["coupling"] = ["tanh(y1 + y2)", "y3 + y2*y3**2"]
    gain = [[1, 2, 0], [0, 0, 1]]
    given["gains"] = {"a": gain}
    C = [[1, 0], ["1/2", 1]]
    given["exosystem"] = dd.Exosystem(**SINE, C=C)
    W = [[0, 1, "1/2"], ["1/3", 0, 2]]
    given["observer"] = dd.Observer(W=W)
    given["simulation"] = {"t_final": 4}
    target = [1, 0, 2]
    offsets = {"c": [1, 0, 1]}
    return dd.Problem(target=target, offsets=offsets, **given)


def pendulums() -> dd.Problem:
    """p'' = -p^3 - p'/2 + u + d: f in place of A, which u0 balances at the target."""
    B = [[0], [1]]
    nodes = Dynamics(f=["x2", "-x1**3 - x2/2"], B=B)
    return double_integrators().replace(name="pendulums", dynamics=nodes, gains={"a": 3})


def resonators() -> dd.Problem:
    """m = 2, p = 1: f has the smooth functions of the grammar, no component of it is a state, B is
    no part of the identity, and W acts on x."""
    smooth = "exp(x1)*cos(x2) + cosh(x1) - 2/(1 + x2**2) + x1*atan(x2) + x1**2*asinh(x2)"
    smooth += " + sqrt(1 + x1**2) - 1"
    pull = f"-2*sin(x1) - x2 - log(1 + x1**2)*sinh(x2) - ({smooth})/4"
    B = [[1], [2]]
    nodes = Dynamics(f=["x2 - tanh(x1)/2", pull], B=B)
    W = [[0, "8/5"], [1, "1/5"]]
    observer = dd.Observer(W=W)
    other = {"target": [0, 0], "observer": observer}
    return pendulums().replace(name="resonators", dynamics=nodes, **other)


def felt(problem: dd.Problem, e: Any) -> Any:
    """The couplings of all agents, (n, p), for e (n, m); the problems above, by hand."""
    arcs = {0: 1, 1: 2, 2: 0}  # a hears b, b hears c, c hears a
    differences = [e[arcs[i]] - e[i] for i in range(3)]
    y = np.array(differences)
    if problem.name != "plants":
        return y[:, [0]] + 2 * y[:, [1]]
    first = np.tanh(y[:, 0] + y[:, 1])
    product = y[:, 1] * y[:, 2] ** 2
    second = y[:, 2] + product
    return np.stack([first, second], axis=1)


def matrices(problem: dd.Problem) -> dict[str, Any]:
    """A, B, B+, the exosystem's S and C, W on x (q, m), gains (n, p, m), goals (n, m) and u0 (n,
    p)."""

    pendulum = [[0, 1], [-3, "-0.5"]]
    resonator = [["-0.5", 1], ["-2.25", -1]]
    slopes = {"pendulums": pendulum, "resonators": resonator}
    found: dict[str, Any] = {}
    found["A"] = A = floats(problem.dynamics.A or slopes[problem.name])
    found["B"] = B = floats(problem.dynamics.B)
    found["left"] = left = np.linalg.pinv(B)
    found["S"] = floats(problem.exosystem.A)
    found["C"] = floats(problem.exosystem.C)
    W = floats(problem.observer.W)
    of_states = W.shape[1] == B.shape[1]
    found["W"] = W @ left if of_states else W
    shape = (problem.n, B.shape[1], len(A))
    found["K"] = K = np.zeros(shape)
    for i, gain in problem.pinning.gains.items():
        K[i] = floats(gain)
    goal_rows = [problem.goal_of(i) for i in range(problem.n)]
    found["goals"] = goals = floats(goal_rows)
    own = drift(problem)
    inputs = [np.linalg.lstsq(B, -own(goal), rcond=None)[0] for goal in goals]
    found["u0"] = np.array(inputs)
    return found


def drift(problem: dd.Problem) -> Callable[..., Any]:
    """A x or f(x) for x (..., m)."""
    if problem.name == "pendulums":
        return lambda x: np.stack([x[..., 1], -(x[..., 0] ** 3) - x[..., 1] / 2], axis=-1)
    if problem.name == "resonators":
        return resonance
    A = floats(problem.dynamics.A)
    return lambda x: x @ A.T


def resonance(x: Any) -> Any:
    """f of ``resonators``."""
    a = x[..., 0]
    b = x[..., 1]
    wave = np.exp(a) * np.cos(b)
    parts = wave + np.cosh(a)
    smooth = parts - 2 / (1 + b**2)
    first_part = smooth + a * np.arctan(b)
    second_part = a**2 * np.arcsinh(b)
    smooth = first_part + second_part
    smooth = smooth + np.sqrt(1 + a**2) - 1
    spring = -2 * np.sin(a) - b
    friction = np.log1p(a**2) * np.sinh(b)
    pull = spring - friction - smooth / 4
    velocity = np.tanh(a) / 2
    slope = [b - velocity, pull]
    return np.stack(slope, axis=-1)


def full_loop(
    problem: dd.Problem, limit: float = np.inf
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(1), (12), (13), (19) for x (n, m), xi, z (n, q) in one vector: the slope at (t, state), and
    u (n, p) there."""
    data = matrices(problem)
    n = problem.n
    names = ("B", "S", "C", "W")
    B, S, C, W = (data[name] for name in names)
    own = drift(problem)
    m = len(B)
    q = len(S)

    def cut(state: Any) -> Any:
        parts = np.split(state, [n * m, n * (m + q)])
        return parts[0].reshape(n, m), parts[1].reshape(n, q), parts[2].reshape(n, q)

    def control(state: Any) -> Any:
        x, _, z = cut(state)
        e = x - data["goals"]
        xihat = z + x @ W.T
        feedback = -np.einsum("ipm,im->ip", data["K"], e)
        u = feedback - xihat @ C.T + data["u0"]
        return np.clip(u, -limit, limit)

    def slope(time: float, state: Any) -> Any:
        x, xi, z = cut(state)
        v = felt(problem, x - data["goals"]) + control(state)
        x_dot = own(x) + (v + xi @ C.T) @ B.T
        error_matrix = (S - W @ B @ C).T
        estimate = (z + x @ W.T) @ error_matrix
        z_dot = estimate - (own(x) + v @ B.T) @ W.T
        xi_dot = (xi @ S.T).ravel()
        return np.concatenate([x_dot.ravel(), xi_dot, z_dot.ravel()])

    return slope, control


EDGE = 1e-6  # of the largest real part, within which a verdict may be undecided
#: p'' = -a M p - b M p' on the directed 10-cycle: pins, the gain of the arcs, and b^2/a at which
#: the loop is stable (Yu, Chen, Cao 2010; theory, section 13).
THRESHOLDS = (({1: 3}, 2, 1.399166), ({1: 5, 6: 5}, 2, 0.637488), ({1: 1}, 1, 3.148023))


def second_order(pins: dict[int, int], gain: int, ratio: float, n: int = 10) -> Problem:
    """a = 1, b^2 = ``ratio``."""
    b = Fraction(round(ratio**0.5 * 10**6), 10**6)
    network = network_of(around(n, gain), n)
    return Problem(network=network, coupling=f"y1 + {b}*y2", gains=pins, dynamics=DOUBLE)


def random_agents(r: Random) -> Problem:
    """2 to 12 agents with 2 to 4 states and 1 or 2 inputs, with or without a disturbance, one
    mode."""
    while True:
        n = r.randint(2, 12)
        m = r.randint(2, 4)
        p = r.randint(1, 2)

        def table(rows: int, columns: int, most: int = 4) -> list[list[Fraction]]:
            found = []
            for _ in range(rows):
                found.append([Fraction(r.randint(-most, most), 2) for _ in range(columns)])
            return found

        A = table(m, m)
        shift = Fraction(r.randint(0, 24), 2)
        for i, row in enumerate(A):
            row[i] -= shift
        texts = []
        for row in table(p, m, 2):
            texts.append(" + ".join(f"({x})*y{c + 1}" for c, x in enumerate(row)))
        arcs = random_arcs(r, n, 0.3, lambda: r.randint(1, 3))
        gains = {}
        for i in range(1, n + 1):
            if r.random() < 0.4:
                gains[i] = table(p, m)
        more: dict[str, Any] = {}
        if r.random() < 0.5:
            C = [[1, 0], [0, 1]][:p]
            more["exosystem"] = Exosystem(A=[[0, 2], [-2, 0]], C=C)
            if r.random() < 0.5:
                W = table(2, r.choice((p, m)), 8)
                more["observer"] = Observer(W=W)
        try:
            dynamics = Dynamics(A=A, B=table(m, p))
            network = network_of(arcs or [[1, 2]], n)
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
    n = problem.n
    m = problem.m
    q = problem.q
    A = floats(problem.dynamics.A)
    B = floats(problem.dynamics.B)
    slopes = problem.coupling.jacobian_at_zero()
    entries = [[float(x.lo) for x in row] for row in slopes]
    H = np.array(entries)
    L = jacobian_by_hand(problem, None, 1.0)
    alone = np.kron(np.eye(n), A)
    coupled = np.kron(L, B @ H)
    known = alone + coupled
    for i, K in problem.pinning.gains.items():
        known[i * m : i * m + m, i * m : i * m + m] -= B @ floats(K)
    if not q:
        return known
    every = np.eye(n)
    flow = np.kron(every, floats(problem.exosystem.A))
    BC = np.kron(every, B @ floats(problem.exosystem.C))
    own = np.kron(every, floats(W))
    eye = np.eye(n * q)
    none = np.zeros((n * m, n * q))
    zeros = none.T
    first = [known - BC @ own, BC, -BC]
    second = [zeros, flow, 0 * eye]
    third = [flow @ own - own @ known, 0 * eye, flow]
    whole = np.block([first, second, third])
    first_row = [np.eye(n * m), none, none]
    turn = np.block([first_row, [-own, eye, -eye], [zeros, eye, 0 * eye]])
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
        M = loop_matrix(problem, certificate.claims.W)
        eigenvalues = np.linalg.eigvals(M)
        worst = float(eigenvalues.real.max())
        wanted = "proved" if worst < 0 else "refuted"
        if abs(worst) < EDGE:
            wanted = "at the edge"
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
        n = r.randint(3, 12 if part else 60)
        m = r.randint(2, 4)
        A_rows = [[r.randint(-2, 2) for _ in range(m)] for _ in range(m)]
        A = np.array(A_rows, dtype=float)
        B_rows = [[r.randint(-2, 2)] for _ in range(m)]
        B = np.array(B_rows, dtype=float)
        powers = []
        for k in range(m):
            powers.append(np.linalg.matrix_power(A, k) @ B)
        uncontrollable = np.linalg.matrix_rank(np.hstack(powers)) < m
        if uncontrollable or np.linalg.eigvals(A).real.max() < EDGE:
            continue
        arcs = []
        for i in range(2, n + 1):
            arcs.append([i, r.randint(1, i - 1)])
        further = ([n, 1], [n, 2])
        arcs += [each for each in further if each not in arcs and n > 3]
        R = solve_continuous_are(A, B, np.eye(m), np.eye(1))
        rows = []
        for x in (B.T @ R)[0]:
            rows.append(Fraction(round(float(x) * 1000), 1000))
        kappa = Fraction(11, 20)
        H = np.array([rows], dtype=float)
        if part:
            degrees = set()
            for k in range(1, n + 1):
                degrees.add(max(1, sum(i == k for i, _ in arcs)))
            low, high = 0.0, 0.55
            while high - low > 1e-9:
                middle = (low + high) / 2
                worst = max(np.linalg.eigvals(A - mu * middle * B @ H).real.max() for mu in degrees)
                if worst < 0:
                    high = middle
                else:
                    low = middle
            kappa = Fraction(round(high * part * 10**6), 10**6)
        text = " + ".join(f"({kappa * x})*y{c + 1}" for c, x in enumerate(rows))
        dynamics = Dynamics(A=A.astype(int).tolist(), B=B.astype(int).tolist())
        network = network_of(arcs, n)
        parts: dict[str, Any] = {
            "network": network,
            "dynamics": dynamics,
            "name": f"riccati-{seed}",
        }
        yield Problem(coupling=text, gains={1: 1}, **parts)
