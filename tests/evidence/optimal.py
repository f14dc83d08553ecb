"""Optimal designs against random feasible neighbours: none may be better by more than a millionth.

Whether a neighbour is feasible, and what it is worth, is decided over the rationals by code of this page alone:
elimination, Routh's determinants, Lyapunov's equation.  Floats only choose which neighbours are worth deciding.
"""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from evidence.pinning import _digraph
from evidence.row import Row
from exact_oracle import positive_definite

import dobc_design as dd
from dobc_design import Network, Problem

BETTER = Fraction(1, 10**6)
PROBLEMS = 10  # about; where one has few feasible neighbours, more
TRIES = 60  # neighbours looked at for one that counts
RATE = Fraction(1, 5)
Rows = list[list[Fraction]]


def pinning(count: int, seed: int) -> Row:
    """Gains at the consensus: one mode, one mode with caps, two modes; half of them on some agents only."""
    return _compare("smallest gains: no feasible neighbour is cheaper by 1e-6", count, seed, _gains_at_the_consensus)


def boxes(count: int, seed: int) -> Row:
    """Gains of max-separable certificates, linear couplings: feasible iff a nonsymmetric Z-matrix is an M-matrix."""
    return _compare("gains of boxes: no feasible neighbour is cheaper by 1e-6", count, seed, _gains_of_boxes)


# One problem: how far its optimum may be undercut, a draw of a neighbour, and its exact value (None: not feasible).
Case = tuple[str, Fraction, Callable[[], Any], Callable[[Any], Fraction | None]]


def _compare(what: str, count: int, seed: int, cases: Callable[[Random], Iterator[Case]]) -> Row:
    failures, met, designs = [], 0, 0
    each = -(-count // PROBLEMS)
    for number in range(4 * PROBLEMS):
        if met >= count:
            break
        r = Random(seed + number)
        for name, optimum, draw, value in cases(r):
            here, designs = 0, designs + 1
            for _ in range(TRIES * each):
                if here >= each or met >= count:
                    break
                found = value(draw())
                if found is None:
                    continue
                here += 1
                met += 1
                if found < optimum * (1 - BETTER):
                    failures.append(f"{seed + number}, {name}: {float(found):.9g} in place of {float(optimum):.9g}")
    return Row(what, met, failures, [f"{designs} designs, feasible neighbours only"], least=count)


def _gains_at_the_consensus(r: Random) -> Iterator[Case]:
    n, kind = r.randint(4, 7), r.choice(("one", "caps", "two"))
    parts = [_digraph(r, n, density=0.3, cycle=True).network.modes["G"] for _ in range(2 if kind == "two" else 1)]
    labels = tuple(str(i) for i in range(1, n + 1))
    problem = Problem(network=Network(labels=labels, modes={f"G{k}": p for k, p in enumerate(parts)}), coupling="y")
    allowed = labels if r.random() < 0.5 else labels[: r.randint(n - 2, n)]
    cost = {label: Fraction(r.randint(1, 8), 4) for label in labels}
    asked: dict[str, Any] = {"rate": RATE / 10, "allowed": allowed, "cost": cost, "digits": 12, "conservative": True}
    design = dd.design_pinning(problem, **asked)
    cap = None
    if kind == "caps" and design.cost:
        cap = max(design.gains.values()) * Fraction(9, 10)
        capped = dd.design_pinning(problem, **asked, max_gain=cap)
        design, cap = (capped, cap) if capped.cost is not None else (design, None)
    if design.cost is None:
        return
    tables = [_symmetric(problem, mode, asked["rate"]) for mode in problem.network.modes]

    def value(gains: dict[str, Fraction]) -> Fraction | None:
        if cap is not None and max(gains.values()) > cap:
            return None
        diagonal = [2 * gains.get(label, Fraction(0)) for label in labels]
        held = [_with_diagonal(table, diagonal) for table in tables]
        if not all(_pivots_are_positive(table) for table in held):
            return None
        return sum((cost[label] * k for label, k in gains.items()), Fraction(0))

    yield kind, design.cost, _neighbours(r, design.gains, allowed), value


def _gains_of_boxes(r: Random) -> Iterator[Case]:
    n = r.randint(4, 7)
    problem = _digraph(r, n, density=0.3, cycle=True)
    labels = problem.network.labels
    allowed = labels[: r.randint(1, n)]
    design = dd.design_pinning(problem, rate=RATE / 4, allowed=allowed, region=1, digits=9)
    if design.cost is None:
        return
    flow = _rows_of_arcs(problem, "G")

    def value(gains: dict[str, Fraction]) -> Fraction | None:
        # Rows hold for some v > 0 iff D + K - rate I - A is an M-matrix: all pivots of an elimination are positive.
        diagonal = [gains.get(label, Fraction(0)) - RATE / 4 for label in labels]
        return sum(gains.values(), Fraction(0)) if _pivots_are_positive(_with_diagonal(flow, diagonal)) else None

    yield "box", design.cost, _neighbours(r, design.gains, allowed), value


def _neighbours(r: Random, gains: Any, allowed: Sequence[str]) -> Callable[[], dict[str, Fraction]]:
    """Gains with some raised and some lowered, by steps of every size."""
    top = float(max(gains.values()))

    def draw() -> dict[str, Fraction]:
        width = top * 10.0 ** r.uniform(-7, -0.3)
        lift = r.random()
        drawn = {each: max(0.0, float(gains.get(each, 0)) + width * (r.gauss(0, 1) + lift)) for each in allowed}
        return {label: Fraction(round(x * 10**9), 10**9) for label, x in drawn.items()}

    return draw


def _rows_of_arcs(problem: Problem, mode: str) -> Rows:
    """D - A: row i has the weights that i listens with, for h = y."""
    n = problem.n
    table = [[Fraction(0)] * n for _ in range(n)]
    for i, j, weight in problem.network.modes[mode]:
        table[i][i] += weight
        table[i][j] -= weight
    return table


def _symmetric(problem: Problem, mode: str, rate: Fraction) -> Rows:
    """S = -(J + J') - 2 rate I for h = y."""
    flow = _rows_of_arcs(problem, mode)
    n = range(problem.n)
    return [[flow[i][j] + flow[j][i] - (2 * rate if i == j else 0) for j in n] for i in n]


def _with_diagonal(table: Rows, extra: Sequence[Fraction]) -> Rows:
    return [[x + (extra[i] if i == j else 0) for j, x in enumerate(row)] for i, row in enumerate(table)]


def _pivots_are_positive(table: Rows) -> bool:
    """Elimination without exchanges: definite if symmetric, an M-matrix if all other entries are <= 0."""
    if np.min(np.linalg.eigvals(np.array(table, dtype=float)).real) < -1e-6:
        return False  # not near: saves the exact elimination, and is not counted
    return positive_definite(table)
