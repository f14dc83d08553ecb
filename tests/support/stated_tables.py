"""Problems with stated tables, [uncertainty] and [actuators]: random ones that can or cannot be
kept for a reason in closed form, and what a disturbance can do at most.

Nothing of the package decides here: closed loops are built from the arcs, impulse responses come
from SciPy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from networks import network_of
from scipy import linalg

from dobc_design import Exosystem, Observer, Problem, certify
from dobc_design.exact.matrix import matrix, to_float
from dobc_design.problem.dynamics import Dynamics
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
    """Three to five agents in a tree, the first pinned, in every second case another one as
    well."""
    n = r.randint(3, 5)
    arcs = []
    for i in range(2, n + 1):
        speaker = r.randint(1, i - 1)
        arc = [i, speaker, F(r.randint(2, 6), 2)]
        arcs.append(arc)
    first_gain = r.randint(4, 8)
    held = {1: F(first_gain, 2)}
    gains = held | ({n: F(r.randint(4, 8), 2)} if r.random() < 0.5 else {})
    h = "tanh(y)" if saturating else r.choice(list(RISING))
    network = network_of(arcs, n)
    return {"network": network, "coupling": h, "gains": gains, "target": 0, "name": "stated"}


def seen(r: Random) -> dict[str, Any]:
    """A constant and a sine of 2 rad/s, or the sine alone, with an observer, and the region with
    its errors."""
    sines = r.random() < 0.5
    exosystem, W = (harmonics([2]), ["16/5", "12/5"]) if sines else (constant(), ["3"])
    errors = F(r.randint(1, 4), 20)
    region = {"initial_states": [-R, R], "initial_disturbance": errors}
    observer = Observer(W=[[w] for w in W])
    return {"exosystem": exosystem, "observer": observer, "region": region}


BOX = {"region": {"initial_states": [-R, R]}}


def limit_below_the_disturbance(r: Random, more: dict[str, Any]) -> Stated:
    amplitude = F(r.randint(4, 20), 4)
    table = {"limit": amplitude * r.randint(20, 95) / 100, "amplitude": amplitude}
    problem = Problem(**network(r), **seen(r), actuators=table, **more)
    return Stated(problem, "limit", "the disturbance alone needs more")


def limit_below_the_start(r: Random, more: dict[str, Any]) -> Stated:
    parts = network(r) | BOX
    needed = parts["gains"][1] * R
    least = needed * r.randint(50, 97)
    limits = {"1": least / 100}
    problem = Problem(**parts, actuators={"limit": limits}, **more)
    return Stated(problem, "limit", "agent 1 needs k R at its start")


def limit_between(r: Random, more: dict[str, Any]) -> Stated:
    """Each of the two tables can be kept alone: k R fits into the limit, and any error of gains is
    tolerated."""
    parts = network(r) | BOX
    error = F(r.randint(10, 30), 100)
    base = parts["gains"][1] * R
    factor = 1 + error * r.randint(1, 19) / 20
    limit = {"limit": {"1": base * factor}}
    table = more.pop("uncertainty", {}) | {"gains": error}
    problem = Problem(**parts, actuators=limit, uncertainty=table, **more)
    return Stated(problem, "limit, gains", "agent 1 needs k (1 + error) R at its start")


def repelling(r: Random, more: dict[str, Any]) -> Stated:
    """e_1 - e_2 grows where 2 w (1 + error) > k (1 - error); with noise, where the claim is about
    where agents end, without a bound only if the coupling has none."""
    k = F(r.randint(8, 16), 2)
    w = F(r.randint(2, 6), 4)
    largest = (k - 2 * w) / (k + 2 * w)
    error = largest + (1 - largest) * r.randint(2, 30) / 100
    arcs = [[1, 2, w], [2, 1, w]]
    pair = network_of(arcs, 2)
    h = "-y" if more else r.choice(["-y", "-tanh(y)"])
    where = {} if r.random() < 0.5 else BOX
    table = more.pop("uncertainty", {}) | {"weights": error, "gains": error}
    problem = Problem(
        network=pair,
        coupling=h,
        gains=k,
        target=0,
        name="stated",
        uncertainty=table,
        **where,
        **more,
    )
    return Stated(problem, "weights, gains", f"two agents come apart from {float(largest):.3g} on")


def entries_of_a_gain(r: Random, more: dict[str, Any]) -> Stated:
    """[[1, c], [c, 1]] is indefinite where 1 - d < c (1 + d)."""
    c = F(r.randint(3, 7), 10)
    largest = (1 - c) / (1 + c)
    given = more.pop("uncertainty", {})
    table = given | {"gains": largest + (1 - largest) * r.randint(2, 30) / 100}
    one = network_of([], 1)
    gains = {1: [[1, c], [c, 1]]}
    problem = Problem(
        network=one,
        coupling="y",
        gains=gains,
        target=[0, 0],
        name="stated",
        uncertainty=table,
        **more,
    )
    return Stated(problem, "gains", f"the gain is indefinite from {float(largest):.3g} on")


def more_than_a_coupling(r: Random, more: dict[str, Any]) -> Stated:
    """An agent that is held by w tanh alone, against a constant push of more than w."""
    w = F(r.randint(2, 8), 4)
    chain = network_of([[2, 1, w]], 2)
    given = more.pop("uncertainty", {})
    table = given | {"disturbance": w * r.randint(101, 150) / 100}
    problem = Problem(
        network=chain,
        coupling="tanh(y)",
        gains={1: 20},
        target=0,
        name="stated",
        uncertainty=table,
        **BOX,
        **more,
    )
    return Stated(problem, "disturbance", "the coupling gives less than what acts")


def weaker_than_stated(r: Random, more: dict[str, Any]) -> Stated:
    """Each alone can be kept: w tanh holds against 3/4 w, and any error of its weight is
    tolerated."""
    w = F(r.randint(2, 8), 4)
    chain = network_of([[2, 1, w]], 2)
    given = more.pop("uncertainty", {})
    table = given | {"disturbance": w * 3 / 4, "weights": F(r.randint(26, 40), 100)}
    problem = Problem(
        network=chain,
        coupling="tanh(y)",
        gains={1: 20},
        target=0,
        name="stated",
        uncertainty=table,
        **BOX,
        **more,
    )
    return Stated(problem, "disturbance, weights", "the weakest coupling gives less than what acts")


ALONE = (
    limit_below_the_disturbance,
    limit_below_the_start,
    repelling,
    entries_of_a_gain,
    more_than_a_coupling,
)
TOGETHER = (limit_between, weaker_than_stated)


def broken(seed: int) -> Stated:
    """Tables that cannot be kept; in every third problem two or three, one of them or all together
    too much."""
    r = Random(f"stated tables {seed}")
    if seed % 3:
        return r.choice(ALONE)(r, {})
    maker: Callable[[Random, dict[str, Any]], Stated] = r.choice(TOGETHER + ALONE)
    small_errors = {"measurement": F(1, 1000)}
    small: dict[str, Any] = {"uncertainty": small_errors}
    if maker in (limit_below_the_disturbance, limit_below_the_start, limit_between):
        small["uncertainty"] |= {"weights": F(1, 100), "disturbance": F(1, 1000)}
    elif maker is not entries_of_a_gain:
        small["actuators"] = {"limit": 1000}
    found = maker(r, small)
    return Stated(found.problem, f"{found.tables} and others", found.why)


def kept(seed: int) -> Stated:
    """Tables with room: limits of three times what starts and disturbance need, small errors, weak
    inputs."""
    r = Random(f"tables that are kept {seed}")
    parts = network(r)
    watched = r.random() < 0.5
    parts |= seen(r) if watched else BOX
    named = {}
    kinds = {1: ["limit"], 2: ["relative"], 0: ["absolute"]}
    wanted = kinds[seed % 3]
    if seed % 4 == 0:
        wanted = ["limit", "relative", "absolute"]
    if "relative" in wanted:
        weights = F(r.randint(1, 4), 100)
        named |= {"weights": weights, "gains": F(r.randint(1, 4), 100)}
    if "absolute" in wanted:
        disturbance = F(r.randint(1, 4), 100)
        named |= {"disturbance": disturbance, "measurement": F(r.randint(0, 2), 1000)}
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


def linear_problem(
    n: int,
    modes: Mapping[str, Sequence[tuple[int, int, str]]],
    gains: Mapping[str, Any],
    **more: Any,
) -> Problem:
    """Agents 1 to n; an arc (i, j, w), from 0: i listens to j."""
    arcs = {name: [[i + 1, j + 1, w] for i, j, w in each] for name, each in modes.items()}
    network = network_of(arcs, n)
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
    n = problem.n
    q = problem.q
    (arcs,) = problem.network.modes.values()
    L = np.zeros((n, n))
    K = np.zeros((n, n))
    for i, j, w in arcs:
        slopes = problem.coupling_of(i, j).jacobian_at_zero()[0]
        slope_at_zero = float(slopes[0].lo)
        slope = float(w) * slope_at_zero
        L[i, i] += slope
        L[i, j] -= slope
    for i, k in problem.pinning.gains.items():
        K[i, i] = float(k[0][0])
    one = np.eye(n)
    A = -L - K
    no_drift = np.zeros((n, n * q))
    columns = [one, no_drift, -K]
    B = np.hstack(columns)
    if q:
        exosystem = problem.joint_exosystem
        W = to_float(certify(problem.replace(uncertainty=None)).claims.W)
        C = to_float(exosystem.C)
        F = to_float(exosystem.A) - W @ C
        first = [A, np.kron(one, C)]
        zeros = np.zeros((n * q, n))
        second = [zeros, np.kron(one, F)]
        A = np.block([first, second])
        fed_back = float((C @ W)[0, 0])
        B[:, -n:] -= fed_back * one
        noise = -np.kron(one, F @ W) - np.kron(L, W)
        of_drift = -np.kron(one, W)
        row = [of_drift, np.eye(n * q), noise]
        rows = [B, np.hstack(row)]
        B = np.vstack(rows)
    plant = problem.uncertainty
    on_states = (plant.disturbance, n)
    on_drift = (plant.drift, n * q)
    counts = (on_states, on_drift, (plant.measurement, n))
    parts = [np.full(count, float(limit)) for limit, count in counts]
    limits = np.concatenate(parts)
    return Loop(A, B, limits, n)


def responses(loop: Loop, *, points: int = 6000) -> tuple[np.ndarray, float]:
    """What e gains from inputs that are 1 for one step and 0 afterwards, (points, n, inputs), and
    the step (s)."""
    real_parts = np.linalg.eigvals(loop.A).real
    largest = -np.max(real_parts)
    slowest = float(largest)
    size = len(loop.A)
    step = 16 / slowest / points
    inputs = loop.B.shape[1]
    upper = [loop.A, loop.B]
    lower = [np.zeros((inputs, size + inputs))]
    rows = [upper, lower]
    joint = linalg.expm(step * np.block(rows))
    phi = joint[:size, :size]
    Z = joint[:size, size:]
    found = []
    for _ in range(points):
        found.append(Z[: loop.n])
        Z = phi @ Z
    return np.array(found), step


def gain_of(problem: Problem) -> np.ndarray:
    """The largest |e_i| that inputs within the limits reach in a linear loop: those that are
    constant on each of many short steps, so that it is never above the L-infinity gain."""
    loop = loop_of(problem)
    absolute = np.abs(responses(loop)[0])
    return np.sum(absolute @ loop.limits, axis=0)


def second_order(seed: int) -> tuple[Problem, Loop]:
    """Two to five double integrators with drag, p'' = sum of w (p_j - p_i) - c p' - k p + d + w, in
    a tree: the problem and the loop of (p, p', eps), written out from theory, section 13."""
    r = Random(f"accuracy of second order {seed}")
    n = r.randint(2, 5)
    drag = r.randint(8, 12)
    k = r.randint(1, 2)
    arcs = []
    for i in range(1, n):
        arcs.append((i, r.randrange(i), f"{r.randint(2, 4)}/2"))
    L = np.zeros((n, n))
    one = np.eye(n)
    for i, j, w in arcs:
        L[i, i] += float(Fraction(w))
        L[i, j] -= float(Fraction(w))
    L[0, 0] += k
    rows = [[0 * one, one], [-L, -drag * one]]
    A = np.block(rows)
    B = np.vstack([0 * one, one])
    more: dict[str, Any] = {}
    plant = {"disturbance": f"{r.randint(1, 9)}/10"}
    if seed % 2:
        first_gain = r.randint(20, 40) / 10
        plant["drift"], a, b = "1/20", first_gain, r.randint(10, 30) / 10
        F_rows = [[-a, 1], [-1 - b, 0]]
        F = np.array(F_rows)
        A_rows = [[0, 1], [-1, 0]]
        exosystem = Exosystem(A=A_rows, C=[[1, 0]])
        observer = Observer(W=[[f"{a}"], [f"{b}"]])
        more = {"exosystem": exosystem, "observer": observer}
        C = np.array([[1.0, 0.0]])
        W = np.array([[a], [b]])
        zeros = np.zeros((n, 2 * n))
        border_rows = [zeros, np.kron(one, C)]
        border = np.vstack(border_rows)
        lower_zeros = np.zeros((2 * n,) * 2)
        lower = [lower_zeros, np.kron(one, F)]
        rows_of_A = [[A, border], lower]
        A = np.block(rows_of_A)
        shape = (2 * n, 2 * n)
        upper_B = [B, np.zeros(shape)]
        lower_B = [-np.kron(one, W), np.eye(2 * n)]
        B = np.block([upper_B, lower_B])
    of_states = [float(Fraction(plant["disturbance"]))] * n
    of_drift = [0.05] * (2 * n * (seed % 2))
    limits = of_states + of_drift
    gains = {"1": [[k, 0]]}
    A_of_agents = [[0, 1], [0, -drag]]
    dynamics = Dynamics(A=A_of_agents, B=[[0], [1]])
    problem = linear_problem(
        n,
        {"a": arcs},
        gains,
        coupling="y1",
        uncertainty=plant,
        dynamics=dynamics,
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
        f = r.randint(5, 40)
        g = r.randint(5, 60)
        A_rows = matrix([[0, f"{f}/10"], [f"-{f}/10", 0]])
        C_row = matrix([[1, 0]])
        exosystem = Exosystem(A=A_rows, C=C_row)
        more = {"exosystem": exosystem}
        more["observer"] = Observer(W=matrix([[f"{g}/10"], [f"{r.randint(0, g)}/10"]]))
    plant = {
        "disturbance": f"{r.randint(1, 20)}/10",
        "measurement": f"{r.choice((0, 0, 1))}/50",
        "drift": "1/20",
    }
    sorted_arcs = sorted(arcs.items())
    listed = [(i, j, f"{w}/8") for (i, j), w in sorted_arcs]
    return linear_problem(n, {"a": listed}, gains, uncertainty=plant, **more)


def exact_gain(seed: int) -> tuple[Problem, np.ndarray]:
    """A random linear problem and its exact L-infinity gain."""
    problem = random_linear(seed)
    return problem, gain_of(problem)


def final_errors(problem: Problem, *, seed: int, runs: int = 3) -> np.ndarray:
    """The largest |e_i| at the end of runs of the loop as it is, with its own couplings, whose
    inputs are bang-bang along the impulse responses of the linearised loop for a few agents."""
    loop = loop_of(problem)
    n = problem.n
    q = problem.q
    H, step = responses(loop, points=3000)
    (arcs,) = problem.network.modes.values()
    i = arcs.listeners
    j = arcs.speakers
    weights = np.array([float(w) for w in arcs.weights])
    h = problem.coupling.numpy_function()
    A = loop.A
    B = loop.B
    slope = float(problem.coupling.jacobian_at_zero()[0][0].lo)
    W = np.zeros((q, 1)) if not q else -B[n : n + q, :1]

    def rest(y: np.ndarray) -> np.ndarray:
        """What the couplings add to their linear part, by arc."""
        felt = h(y[:, None])[:, 0]
        return weights * (felt - slope * y)

    def field(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        y = x[j] - x[i]
        noise = u[n + n * q :]
        acts = rest(y)
        seen = rest(y + noise[j] - noise[i])
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
            half_way = x + step / 2 * field(x, u)
            x = x + step * field(half_way, u)
        worst[agent] = max(worst[agent], abs(x[agent]))
    return worst
