"""Small problems without pins and without W, for designs that take a moment."""

from __future__ import annotations

from typing import Any

from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

CONSTANT = Exosystem(A=[[0]], C=[[1]])
HIDDEN = Exosystem(A=[[0, 0], [0, 0]], C=[[1, 0]])  # C never sees the second state, which does not decay


def ring(n: int = 4, *, coupling: str = "y", **changes: Any) -> Problem:
    """Agent i listens to i + 1, the last one to the first."""
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(**{"name": "ring", "network": network, "coupling": coupling} | changes)


def star(n: int = 4, **changes: Any) -> Problem:
    """Everybody listens to agent 1, who listens to nobody."""
    network = Network.from_arcs([[i, 1] for i in range(2, n + 1)], arrow="listens_to", agents=n)
    return Problem(**{"name": "star", "network": network, "coupling": "y"} | changes)


def two_leaders(**changes: Any) -> Problem:
    """3 listens to 1 and 2, who listen to nobody."""
    network = Network.from_arcs([[3, 1], [3, 2]], arrow="listens_to", agents=3)
    return Problem(**{"name": "two-leaders", "network": network, "coupling": "y"} | changes)


BOX = {"initial_states": [-1, 1]}
NOISY_BOX = {"initial_states": [-1, 1], "initial_disturbance": "0.1"}
