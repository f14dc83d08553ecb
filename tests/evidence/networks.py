"""Random small problems to which the theorems apply: rational slopes, an exosystem, 1 to 4 modes, m = 1 or 2."""

from __future__ import annotations

from fractions import Fraction
from random import Random
from typing import Any

from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

SCALAR = ("y", "tanh(y)", "exp(y) - 1 + y", "y/3", "2*y - y**3", "sin(y)/2", "-y/8", "7*y/2")
PLANE = (["y1 + y2/2", "y2 - y1/3"], ["sin(y1) + y2**2", "3*y2"], ["2*y1 - y2", "y1 + tanh(y2)"])


def network_problem(seed: int, *, separable: bool) -> Problem:
    """``separable``: m = 1, or Lambda = Lambda_n (x) I_m (one h for all components, gains that are numbers)."""
    r = Random(seed)
    m, n = r.choice((1, 2)), r.randint(2, 5)
    modes = {f"G{k}": _arcs(r, n) for k in range(r.randint(1, 4))}
    h: Any = r.choice(SCALAR) if separable or m == 1 or r.random() < 0.3 else r.choice(PLANE)
    gains: dict[str, Any] = {}
    for agent in range(1, n + 1):
        if r.random() < 0.75:
            k = Fraction(r.randint(1, 12), r.choice((1, 2, 3)))
            turn = Fraction(r.randint(-2, 2))
            gains[str(agent)] = k if separable or m == 1 else [[k, turn], [-turn, k + 1]]
    return Problem(
        name=f"network-{seed}",
        network=Network.from_arcs(modes, arrow="listens_to", agents=n),
        coupling=h,
        target=[0] * m,
        gains=gains,
        exosystem=_exosystem(r, m),
    )


def _arcs(r: Random, n: int) -> list[list[Any]]:
    pairs = [(i, i % n + 1) for i in range(1, n + 1)] if r.random() < 0.4 else []
    pairs = pairs or [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j and r.random() < 0.5]
    return [[i, j, Fraction(r.randint(1, 6), r.choice((1, 2, 5)))] if r.random() < 0.5 else [i, j] for i, j in pairs]


def _exosystem(r: Random, m: int) -> Exosystem:
    """Observable by construction or by chance; q = 1 to 3."""
    kind = r.choice(("constant", "harmonic", "ramp", "random"))
    q = {"constant": 1, "harmonic": 2, "ramp": 2, "random": 3}[kind]
    A: list[list[Any]] = [[0] * q for _ in range(q)]
    if kind == "harmonic":
        A = [[0, r.choice((1, 2, "1/2"))], [-1, 0]]
    elif kind == "ramp":
        A = [[0, 1], [0, 0]]
    elif kind == "random":
        A = [[Fraction(r.randint(-3, 2), 2) for _ in range(q)] for _ in range(q)]
    C = [[1] + [r.choice((0, 1)) for _ in range(q - 1)]]
    return Exosystem(A=A, C=C + [[r.choice((0, 1, -1)) for _ in range(q)] for _ in range(m - 1)])
