"""Problems and exosystems that several tests of the designs share."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from dobc_design.problem.exosystem import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


@pytest.fixture
def harmonic() -> Exosystem:
    """The paper's pair (A, C): a sine of 2 rad/s."""
    return HARMONIC


@pytest.fixture
def cycle():
    """A directed cycle of n agents, the paper's coupling, chosen pins."""

    def make(
        n: int = 4, *, pins: Any = None, exosystem: Exosystem = HARMONIC, coupling: Any = "exp(y) - 1 + y"
    ) -> Problem:
        return Problem(
            network=Network.from_arcs([[i, i % n + 1] for i in range(1, n + 1)], arrow="listens_to", agents=n),
            coupling=coupling,
            gains={1: 3} if pins is None else pins,
            exosystem=exosystem,
            target=[0] * exosystem.outputs,
        )

    return make


@pytest.fixture
def separable():
    """Random problems with m = 1, or Lambda = Lambda_n (x) I_m: one h for all components, gains that are numbers."""

    def make(seed: int, *, modes: int, m: int = 1) -> Problem:
        r = Random(f"{seed} {modes} {m}")
        n = r.randint(2, 4)
        arcs = {
            f"G{k}": [[i, j, r.choice((1, "1/2", 2))] for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
            for k in range(modes)
        }
        arcs = {name: [arc for arc in every if r.random() < 0.7] for name, every in arcs.items()}
        C = [[1 if j == 2 * i else 0 for j in range(2 * m)] for i in range(m)]
        A = [[0] * (2 * m) for _ in range(2 * m)]
        for i in range(m):
            A[2 * i][2 * i + 1], A[2 * i + 1][2 * i] = r.choice((1, 2)), -1
        return Problem(
            network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
            coupling=r.choice(("y", "tanh(2*y)", "exp(y) - 1 + y", "y/3 + y**3")),
            gains={i: r.choice((2, 3, 5, "9/2")) for i in range(1, n + 1) if r.random() < 0.8},
            exosystem=Exosystem(A=A, C=C),
            target=[0] * m,
        )

    return make
