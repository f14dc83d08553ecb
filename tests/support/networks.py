"""Networks that tests share: by their arcs, for max-separable certificates with a slow oracle for
their rows, for designs without pins and W, and as pandapower writes them."""

import json
from collections.abc import Callable
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np

from dobc_design import Exosystem, Network, Problem


def network_of(arcs: Any, n: Any = None) -> Network:
    """[i, j] is agent i listening to agent j; ``n``: how many agents, or their labels."""
    return Network.from_arcs(arcs, arrow="listens_to", agents=n)


def random_arcs(r: Any, n: int, density: float, weight: Callable[[], Any] | None = None) -> Any:
    """Every agent may listen to every other; ``weight`` draws the weight of each arc."""
    arcs = []
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            if i != j and r.random() < density:
                arcs.append([i, j] if weight is None else [i, j, weight()])
    return arcs


def around(n: int, *weight: Any) -> list[Any]:
    """Arcs by which agent i listens to agent i + 1, the last to the first."""
    found = []
    for i in range(1, n + 1):
        found.append([i, i % n + 1, *weight])
    return found


def linked(arcs: Any, n: Any = None, coupling: Any = "y", **given: Any) -> Problem:
    return Problem(**{"network": network_of(arcs, n), "coupling": coupling} | given)


def floats(rows: Any) -> Any:
    return np.array([[float(x) for x in row] for row in rows])


def float_gains(problem: Problem) -> np.ndarray:
    """k_i of every agent; scalar gains only."""
    gains = np.zeros(problem.n)
    for agent, k in problem.pinning.gains.items():
        gains[agent] = float(k[0][0])
    return gains


def jacobian_by_hand(problem: Problem, mode: str | None, slope: float) -> np.ndarray:
    """J of a mode (the first one), arc by arc."""
    J = np.zeros((problem.n, problem.n))
    for i, j, w in problem.network.modes[mode or next(iter(problem.network.modes))]:
        J[i, j] += slope * float(w)
        J[i, i] -= slope * float(w)
    return J


def loop_by_hand(problem: Problem, mode: str | None = None, *, slope: float = 1.0) -> np.ndarray:
    """J - K of a mode, for h'(0) = slope and gains that are numbers."""
    return jacobian_by_hand(problem, mode, slope) - np.diag(float_gains(problem))


PAPER = "exp(y) - 1 + y"
MONOTONE = (PAPER, "tanh(y)", "y + y**3", "atan(2*y)", "y", "sinh(y)/2", "y + sin(y)/2")
TURNING = ("sin(y)", "y*exp((1 - y**2)/2)", "y/(1 + y**2)")


def cycle(n: int = 10, *, gains: Any = None, h: str = PAPER, **more: Any) -> Problem:
    """Agent i listens to agent i + 1, the last to the first; the first is pinned with k = 5."""
    return linked(around(n), n, h, gains={1: 5} if gains is None else gains, target=0, **more)


def listening(arcs: Any, h: Any, *, n: int | None = None, **more: Any) -> Problem:
    return linked(arcs, n, h, **more)


def pair(h: str, *, k: Any = 5, weight: Any = 1) -> Problem:
    """Agent 1 is pinned and hears nobody, agent 2 hears agent 1."""
    arcs = [[2, 1, weight]]
    return listening(arcs, h, n=2, gains={1: k}, target=0)


def random_network(
    r: Random, *, n: int, modes: int, density: float = 0.4, weights: Any = (1,)
) -> Network:
    """Every agent may listen to every other, by modes."""
    arcs = {}
    for k in range(modes):
        arcs[f"G{k}"] = random_arcs(r, n, density, lambda: r.choice(weights))
    return network_of(arcs, n)


def random_problem(
    seed: int,
    *,
    couplings: Any = MONOTONE,
    modes: int = 2,
    n: int | None = None,
    held: bool = False,
    **more: Any,
) -> Problem:
    """Some agents pinned, weights, and an arc with a coupling of its own where there are several.

    ``held``: in every mode each agent hears one with a smaller number, and the first is pinned.
    """
    r = Random(f"separable {seed} {modes}")
    n = n or r.randint(3, 6)
    weights_drawn = (1, "1/2", 2)
    network = random_network(r, n=n, modes=modes, density=0.5, weights=weights_drawn)
    if held:
        arcs = {}
        for name, each in network.modes.items():
            arcs[name] = [[i + 1, j + 1, w] for i, j, w in each]
            leading = {i for i, j, _ in each if j < i}
            arcs[name] += [[i + 1, i, 1] for i in range(1, n) if i not in leading]
        network = network_of(arcs, n)
    h = r.choice(couplings)
    other = r.choice(couplings)
    codes = sorted(network.arc_codes())
    special = {(codes[0] // n, codes[0] % n): other} if codes else {}
    followers = range(2, n + 1)
    others = {i: r.choice((1, 3, "9/2")) for i in followers if r.random() < 0.3}
    gains = {1: 5} | others
    return Problem(network=network, coupling=h, exceptions=special, gains=gains, target=0, **more)


def sampled_rows(problem: Problem, v: Any, *, s: float, alpha: float, samples: int = 2001) -> float:
    """The largest row at one s, divided by s: sup over samples of every interval; all modes and
    both faces."""
    worst = -np.inf
    height = np.array([float(x) for x in v])
    gains = float_gains(problem)
    for arcs in problem.network.modes.values():
        for face in (1, -1):
            total = np.zeros(problem.n)
            for i, j, weight in arcs:
                lowest = -s * (height[i] + height[j])
                highest = s * (height[j] - height[i])
                y = np.linspace(lowest, highest, samples)
                h = problem.coupling_of(i, j).numpy_function()
                values = face * h((face * y)[:, None])
                total[i] += float(weight) * np.max(values)
            held = (gains - alpha) * height
            largest = np.max(total / s - held)
            worst = max(worst, float(largest))
    return worst


def fractions(*values: Any) -> tuple[Fraction, ...]:
    return tuple(Fraction(str(value)) for value in values)


CONSTANT = Exosystem(A=[[0]], C=[[1]])
# C never sees the second state, which does not decay
HIDDEN = Exosystem(A=[[0, 0], [0, 0]], C=[[1, 0]])


def digraph(
    r: Random, n: int, *, density: float = 0.3, cycle: bool = True, **changes: Any
) -> Problem:
    """Random arcs with random gains, on top of a cycle."""
    pairs = set(map(tuple, random_arcs(r, n, density)))
    if cycle:
        pairs |= set(map(tuple, around(n)))
    arcs = [[i, j, round(r.uniform(0.1, 5), 2)] for i, j in sorted(pairs)]
    return linked(arcs, n, **changes)


def ring(n: int = 4, *, coupling: str = "y", **changes: Any) -> Problem:
    """Agent i listens to i + 1, the last one to the first."""
    return linked(around(n), n, coupling, **{"name": "ring"} | changes)


def star(n: int = 4, **changes: Any) -> Problem:
    """Everybody listens to agent 1, who listens to nobody."""
    followers = range(2, n + 1)
    arcs = [[i, 1] for i in followers]
    return linked(arcs, n, **{"name": "star"} | changes)


def two_leaders(**changes: Any) -> Problem:
    """3 listens to 1 and 2, who listen to nobody."""
    arcs = [[3, 1], [3, 2]]
    settings = {"name": "two-leaders"} | changes
    return linked(arcs, 3, **settings)


BOX = {"initial_states": [-1, 1]}
NOISY_BOX = {"initial_states": [-1, 1], "initial_disturbance": "0.1"}


def linear_rate(problem: Problem, gains: dict[int, float]) -> float:
    """The decay rate of the loop of the first mode, linearised with h'(0) = 1, by eigenvalues."""
    held = [float(gains.get(i, 0)) for i in range(problem.n)]
    K = np.diag(held)
    M = jacobian_by_hand(problem, None, 1.0) - K
    return -float(np.max(np.linalg.eigvals(M).real))


def frame(columns: list[str], rows: list[list[object]]) -> dict[str, str]:
    index = list(range(len(rows)))
    table = {"columns": columns, "index": index, "data": rows}
    return {"_module": "pandas.core.frame", "_class": "DataFrame", "_object": json.dumps(table)}


def tables(**changes: tuple[list[str], list[list[object]]]) -> bytes:
    """A network of three buses and two lines."""
    line = ["from_bus", "to_bus", "length_km", "x_ohm_per_km", "parallel", "in_service"]
    bus_rows = [[10.0, True], [10.0, True], [10.0, True]]
    buses = (["vn_kv", "in_service"], bus_rows)
    lines = (line, [[0, 1, 2.0, 5.0, 2, True], [1, 2, 1.0, 10.0, 1, True]])
    parts = {"bus": buses, "line": lines, "ext_grid": (["bus", "in_service"], [[0, True]])}
    inside: dict[str, Any] = {"sn_mva": 1.0}
    for name, (columns, rows) in (parts | changes).items():
        inside[name] = frame(columns, rows)
    whole = {"_module": "pandapower.auxiliary", "_class": "pandapowerNet", "_object": inside}
    return json.dumps(whole).encode()
