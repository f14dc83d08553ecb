"""Problems with [dynamics], and their loop written out from theory, section 13, without the
package's arithmetic."""

from collections.abc import Callable
from typing import Any

import numpy as np

import dobc_design as dd
from dobc_design.problem.dynamics import Dynamics

RING = dd.Network.from_arcs([["a", "b"], ["b", "c"], ["c", "a"]], arrow="listens_to")
SINE: dict[str, Any] = {"A": [[0, 2], [-2, 0]]}


def double_integrators() -> dd.Problem:
    """p'' = u + d, m = 2, p = 1: linear couplings, gains that are numbers, no u0."""
    return dd.Problem(
        name="carts",
        network=RING,
        dynamics=Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]]),
        coupling="y1 + 2*y2",
        target=[1, 0],
        gains={"a": 2, "b": 1},
        exosystem=dd.Exosystem(**SINE, C=[[1, 0]]),
        observer=dd.Observer(W=[["16/5"], ["12/5"]]),
        simulation={"t_final": 6, "xi0": ["0.4", "0.3"]},
    )


def three_states() -> dd.Problem:
    """m = 3, p = 2: u0 and offsets are not 0, couplings saturate, B is no part of the identity, W
    acts on x."""
    return dd.Problem(
        name="plants",
        network=RING,
        dynamics=Dynamics(
            A=[[0, 1, 0], [-1, "-1/2", "1/4"], [0, "1/2", -1]], B=[[0, 0], [2, 0], [1, 1]]
        ),
        coupling=["tanh(y1 + y2)", "y3 + y2*y3**2"],
        target=[1, 0, 2],
        gains={"a": [[1, 2, 0], [0, 0, 1]]},
        offsets={"c": [1, 0, 1]},
        exosystem=dd.Exosystem(**SINE, C=[[1, 0], ["1/2", 1]]),
        observer=dd.Observer(W=[[0, 1, "1/2"], ["1/3", 0, 2]]),
        simulation={"t_final": 4},
    )


def pendulums() -> dd.Problem:
    """p'' = -p^3 - p'/2 + u + d: f in place of A, which u0 balances at the target."""
    nodes = Dynamics(f=["x2", "-x1**3 - x2/2"], B=[[0], [1]])
    return double_integrators().replace(name="pendulums", dynamics=nodes, gains={"a": 3})


def resonators() -> dd.Problem:
    """m = 2, p = 1: f has the smooth functions of the grammar, no component of it is a state, B is
    no part of the identity, and W acts on x."""
    smooth = (
        "exp(x1)*cos(x2) + cosh(x1) - 2/(1 + x2**2) + x1*atan(x2) + x1**2*asinh(x2) + sqrt(1 + "
        "x1**2) - 1"
    )
    nodes = Dynamics(
        f=["x2 - tanh(x1)/2", f"-2*sin(x1) - x2 - log(1 + x1**2)*sinh(x2) - ({smooth})/4"],
        B=[[1], [2]],
    )
    other = {"target": [0, 0], "observer": dd.Observer(W=[[0, "8/5"], [1, "1/5"]])}
    return pendulums().replace(name="resonators", dynamics=nodes, **other)


def felt(problem: dd.Problem, e: Any) -> Any:
    """The couplings of all agents, (n, p), for e (n, m); the problems above, by hand."""
    arcs = {0: 1, 1: 2, 2: 0}  # a hears b, b hears c, c hears a
    y = np.array([e[arcs[i]] - e[i] for i in range(3)])
    if problem.name != "plants":
        return y[:, [0]] + 2 * y[:, [1]]
    return np.stack([np.tanh(y[:, 0] + y[:, 1]), y[:, 2] + y[:, 1] * y[:, 2] ** 2], axis=1)


def matrices(problem: dd.Problem) -> dict[str, Any]:
    """A, B, B+, the exosystem's S and C, W on x (q, m), gains (n, p, m), goals (n, m) and u0 (n,
    p)."""

    def floats(rows: Any) -> Any:
        return np.array([[float(x) for x in row] for row in rows])

    slopes = {"pendulums": [[0, 1], [-3, "-0.5"]], "resonators": [["-0.5", 1], ["-2.25", -1]]}
    A, B = floats(problem.dynamics.A or slopes[problem.name]), floats(problem.dynamics.B)
    S, C, W = floats(problem.exosystem.A), floats(problem.exosystem.C), floats(problem.observer.W)
    left = np.linalg.pinv(B)
    goals = floats([problem.goal_of(i) for i in range(problem.n)])
    K = np.zeros((problem.n, B.shape[1], len(A)))
    for i, gain in problem.pinning.gains.items():
        K[i] = floats(gain)
    W = W @ left if W.shape[1] == B.shape[1] else W
    u0 = np.array([np.linalg.lstsq(B, -drift(problem)(goal), rcond=None)[0] for goal in goals])
    return {"A": A, "B": B, "left": left, "S": S, "C": C, "W": W, "K": K, "goals": goals, "u0": u0}


def drift(problem: dd.Problem) -> Callable[..., Any]:
    """A x or f(x) for x (..., m)."""
    if problem.name == "pendulums":
        return lambda x: np.stack([x[..., 1], -(x[..., 0] ** 3) - x[..., 1] / 2], axis=-1)
    if problem.name == "resonators":
        return resonance
    A = np.array([[float(x) for x in row] for row in problem.dynamics.A])
    return lambda x: x @ A.T


def resonance(x: Any) -> Any:
    """f of ``resonators``."""
    a, b = x[..., 0], x[..., 1]
    smooth = (
        np.exp(a) * np.cos(b)
        + np.cosh(a)
        - 2 / (1 + b**2)
        + a * np.arctan(b)
        + a**2 * np.arcsinh(b)
    )
    smooth = smooth + np.sqrt(1 + a**2) - 1
    pull = -2 * np.sin(a) - b - np.log1p(a**2) * np.sinh(b) - smooth / 4
    return np.stack([b - np.tanh(a) / 2, pull], axis=-1)


def full_loop(
    problem: dd.Problem, limit: float = np.inf
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(1), (12), (13), (19) for x (n, m), xi, z (n, q) in one vector: the slope at (t, state), and
    u (n, p) there."""
    data, n = matrices(problem), problem.n
    B, S, C, W = (data[name] for name in ("B", "S", "C", "W"))
    own, m, q = drift(problem), len(B), len(S)

    def cut(state: Any) -> Any:
        parts = np.split(state, [n * m, n * (m + q)])
        return parts[0].reshape(n, m), parts[1].reshape(n, q), parts[2].reshape(n, q)

    def control(state: Any) -> Any:
        x, _, z = cut(state)
        e, xihat = x - data["goals"], z + x @ W.T
        u = -np.einsum("ipm,im->ip", data["K"], e) - xihat @ C.T + data["u0"]
        return np.clip(u, -limit, limit)

    def slope(time: float, state: Any) -> Any:
        x, xi, z = cut(state)
        v = felt(problem, x - data["goals"]) + control(state)
        x_dot = own(x) + (v + xi @ C.T) @ B.T
        z_dot = (z + x @ W.T) @ (S - W @ B @ C).T - (own(x) + v @ B.T) @ W.T
        return np.concatenate([x_dot.ravel(), (xi @ S.T).ravel(), z_dot.ravel()])

    return slope, control
