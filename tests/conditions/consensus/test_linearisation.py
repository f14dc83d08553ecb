"""Unstable roots of J - K: exact counts, and the shortcut for couplings that cannot be unstable."""

from __future__ import annotations

from random import Random

import numpy as np
from campaigns import a_problem
from exact_oracle import Oracle
from random_problems import WEIGHTS

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.linearisation import LARGEST, linearisation, unstable_roots
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def test_the_linearisation_is_the_jacobian_minus_the_gains():
    for seed in range(80):
        problem = a_problem(seed)
        oracle, statements = Oracle(problem), state_theorems(problem)
        for mode in oracle.modes if oracle.smooth else ():
            if oracle.exact_in(mode):
                assert [list(row) for row in linearisation(statements, mode)] == oracle.loop(mode)


def test_counts_agree_with_the_factors_found_by_sympy():
    """Random slopes of both signs, full matrices, matrix gains; multiple roots and roots on the axis occur."""
    seen = set()
    for seed in range(80):
        r = Random(seed)
        n, m = r.randint(1, 4), r.choice((1, 2))
        arcs = [[i + 1, j + 1] for i in range(n) for j in range(n) if i != j and r.random() < 0.5]
        names = [f"y{d + 1}" for d in range(m)] if m > 1 else ["y"]
        problem = Problem(
            network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
            target=[0] * m,
            coupling=[" + ".join(f"({r.randint(-3, 3)})*{y}" for y in names) for _ in range(m)],
            gains={1: r.choice((0, 1, 3)), n: [[1, 2], [-2, 0]] if m == 2 else 1} if n > 1 else None,
        )
        roots = unstable_roots(state_theorems(problem), "G")
        assert roots == Oracle(problem).unstable_roots("G")
        seen.add(roots)
    assert seen >= {0, 1, 2, 3}


def test_irrational_slopes_are_not_examined():
    """0 is "not examined": h = -y e with a weak pin is unstable, and nothing is claimed."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    for h, roots in (("-3*y", 1), ("-y*exp(1)", 0)):
        statements = state_theorems(Problem(network=network, coupling=h, gains={1: "1/100"}))
        assert unstable_roots(statements, "G") == roots


def test_diagonal_slopes_that_are_not_negative_with_scalar_gains_are_never_unstable():
    """The shortcut. Gershgorin: row i c has the diagonal -(sum g + k) <= 0 and the off-diagonal sum g, so every
    disc lies in Re <= 0. Weights, several slopes per component and isolated agents included."""
    for seed in range(200):
        r = Random(seed)
        n, m = r.randint(1, 6), r.choice((1, 2, 3))
        arcs = [[i + 1, j + 1, r.choice(WEIGHTS)] for i in range(n) for j in range(n) if i != j and r.random() < 0.4]
        slopes = [f"{r.randint(0, 3)}*y{c + 1}" if m > 1 else f"{r.randint(0, 3)}*y" for c in range(m)]
        problem = Problem(
            network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
            coupling=slopes,
            target=[0] * m,
            gains={i + 1: r.choice((0, 1, 3)) for i in range(n)},
        )
        statements = state_theorems(problem)
        assert statements.jacobians.modes[0].is_nonnegative_diagonal
        assert problem.pinning.is_scalar
        assert unstable_roots(statements, "G") == 0
        eigenvalues = np.linalg.eigvals(np.array(Oracle(problem).loop("G"), dtype=float))
        assert eigenvalues.real.max() < 1e-6


def test_the_shortcut_needs_scalar_gains():
    """Slopes diag(9, 0) one way and diag(0, 9) the other, skew gains: diagonal slopes >= 0, and yet unstable."""
    arcs = Network.from_arcs([[2, 1], [1, 2]], arrow="listens_to", agents=2)

    def roots(k1, k2):
        problem = Problem(
            network=arcs,
            coupling=["9*y1", "0*y2"],
            exceptions={(0, 1): ["0*y1", "9*y2"]},
            target=[0, 0],
            gains={1: k1, 2: k2},
        )
        statements = state_theorems(problem)
        assert statements.jacobians.modes[0].is_nonnegative_diagonal
        eigenvalues = np.linalg.eigvals(np.array(Oracle(problem).loop("G"), dtype=float))
        assert unstable_roots(statements, "G") == np.sum(eigenvalues.real > 1e-9)
        return unstable_roots(statements, "G")

    assert roots([[0, -4], [4, 0]], [[0, 4], [-4, 0]]) == 1
    assert roots(4, 4) == 0


def test_large_networks_are_not_examined():
    n = LARGEST + 1
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    problem = Problem(network=Network.from_arcs(arcs, arrow="listens_to"), coupling="-y", gains="1/10")
    assert unstable_roots(state_theorems(problem), "G") == 0
