"""Small problems without pins and without W, for designs that take a moment."""

from random import Random
from typing import Any

import numpy as np

from dobc_design import Exosystem, Network, Problem

CONSTANT = Exosystem(A=[[0]], C=[[1]])
# C never sees the second state, which does not decay
HIDDEN = Exosystem(A=[[0, 0], [0, 0]], C=[[1, 0]])


def problem_of(arcs: Any, n: int | None = None, coupling: Any = "y", **changes: Any) -> Problem:
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(**{"network": network, "coupling": coupling} | changes)


def digraph(
    r: Random, n: int, *, density: float = 0.3, cycle: bool = True, **changes: Any
) -> Problem:
    """Random arcs with random gains, on top of a cycle."""
    pairs = {(i, i % n + 1) for i in range(1, n + 1)} if cycle else set()
    pairs |= {
        (i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < density
    }
    return problem_of([[i, j, round(r.uniform(0.1, 5), 2)] for i, j in sorted(pairs)], n, **changes)


def ring(n: int = 4, *, coupling: str = "y", **changes: Any) -> Problem:
    """Agent i listens to i + 1, the last one to the first."""
    return problem_of(
        [[i, i % n + 1] for i in range(1, n + 1)], n, coupling, **{"name": "ring"} | changes
    )


def star(n: int = 4, **changes: Any) -> Problem:
    """Everybody listens to agent 1, who listens to nobody."""
    return problem_of([[i, 1] for i in range(2, n + 1)], n, **{"name": "star"} | changes)


def two_leaders(**changes: Any) -> Problem:
    """3 listens to 1 and 2, who listen to nobody."""
    return problem_of([[3, 1], [3, 2]], 3, **{"name": "two-leaders"} | changes)


BOX = {"initial_states": [-1, 1]}
NOISY_BOX = {"initial_states": [-1, 1], "initial_disturbance": "0.1"}


def linear_rate(problem: Problem, gains: dict[int, float]) -> float:
    """The decay rate of the loop of the first mode, linearised with h'(0) = 1, by eigenvalues."""
    M = np.diag([-float(gains.get(i, 0)) for i in range(problem.n)])
    for i, j, weight in next(iter(problem.network.modes.values())):
        M[i, j] += float(weight)
        M[i, i] -= float(weight)
    return -float(np.max(np.linalg.eigvals(M).real))
