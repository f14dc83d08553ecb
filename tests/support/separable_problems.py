"""Networks that the tests of the max-separable certificate share, and a slow oracle for its
rows."""

from fractions import Fraction
from random import Random
from typing import Any

import numpy as np

from dobc_design import Network, Problem

PAPER = "exp(y) - 1 + y"
MONOTONE = (PAPER, "tanh(y)", "y + y**3", "atan(2*y)", "y", "sinh(y)/2", "y + sin(y)/2")
TURNING = ("sin(y)", "y*exp((1 - y**2)/2)", "y/(1 + y**2)")


def cycle(n: int = 10, *, gains: Any = None, h: str = PAPER, **more: Any) -> Problem:
    """Agent i listens to agent i + 1, the last to the first; the first is pinned with k = 5."""
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    return listening(arcs, h, n=n, gains={1: 5} if gains is None else gains, target=0, **more)


def listening(arcs: Any, h: Any, *, n: int | None = None, **more: Any) -> Problem:
    """The first of each arc hears the second."""
    return Problem(
        network=Network.from_arcs(arcs, arrow="listens_to", agents=n), coupling=h, **more
    )


def pair(h: str, *, k: Any = 5, weight: Any = 1) -> Problem:
    """Agent 1 is pinned and hears nobody, agent 2 hears agent 1."""
    return listening([[2, 1, weight]], h, n=2, gains={1: k}, target=0)


def random_network(
    r: Random, *, n: int, modes: int, density: float = 0.4, weights: Any = (1,)
) -> Network:
    """Every agent but the first may listen to every other."""
    arcs = {
        f"G{k}": [
            [i, j, r.choice(weights)]
            for i in range(1, n + 1)
            for j in range(1, n + 1)
            if i != j and r.random() < density
        ]
        for k in range(modes)
    }
    return Network.from_arcs(arcs, arrow="listens_to", agents=n)


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
    network = random_network(r, n=n, modes=modes, density=0.5, weights=(1, "1/2", 2))
    if held:
        arcs = {
            name: [[i + 1, j + 1, w] for i, j, w in each]
            + [[i + 1, i, 1] for i in range(1, n) if not any(k == i and j < i for k, j, _ in each)]
            for name, each in network.modes.items()
        }
        network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    h, other = r.choice(couplings), r.choice(couplings)
    codes = sorted(network.arc_codes())
    special = {(codes[0] // n, codes[0] % n): other} if codes else {}
    gains = {1: 5} | {i: r.choice((1, 3, "9/2")) for i in range(2, n + 1) if r.random() < 0.3}
    return Problem(network=network, coupling=h, exceptions=special, gains=gains, target=0, **more)


def float_gains(problem: Problem) -> np.ndarray:
    """k_i of every agent; scalar gains only."""
    gains = np.zeros(problem.n)
    for agent, k in problem.pinning.gains.items():
        gains[agent] = float(k[0][0])
    return gains


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
                y = np.linspace(-s * (height[i] + height[j]), s * (height[j] - height[i]), samples)
                h = problem.coupling_of(i, j).numpy_function()
                total[i] += float(weight) * np.max(face * h((face * y)[:, None]))
            worst = max(worst, float(np.max(total / s - (gains - alpha) * height)))
    return worst


def fractions(*values: Any) -> tuple[Fraction, ...]:
    return tuple(Fraction(str(value)) for value in values)
