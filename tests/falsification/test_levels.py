"""Certified sets: V against its definition, and starts on their boundaries."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from regional_problems import cycle, identity

from dobc_design import Exosystem, Group, Network, Observer, Problem
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.errors import SpecError
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.falsification.levels import Boundary, level_of
from dobc_design.simulation.field import make_closed_loop
from dobc_design.simulation.starts import CORNERS, EDGES, RANDOM, asked_box

F = Fraction
SINE = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]])
P = ((F(2), F(1, 2)), (F(1, 2), F(1)))
V = (F(1), F(2), F(3))
LOADED = ErrorBound(P=P, beta=F(3), kappa=F(1, 2), size=F(3))
SEPARABLE = Separable(v=V, alpha=F(1), rho=F(4), error=LOADED)
FULL = SparseSymmetric(3, {(0, 0): F(2), (0, 1): F(1, 2), (1, 1): F(1), (2, 2): F(3)})
Q = ((F(1),), (F(1),))
LURE = Lure(P_e=FULL, ranges=(), radius=F(1), level=F(5), rate=F(1, 4), P=P, Q=Q)

WEIGHTS = (F(2), F(1), F(3))
DIAGONAL = SparseSymmetric(3, {(i, i): d for i, d in enumerate(WEIGHTS)})
ARC_WISE = ArcWise(P_e=DIAGONAL, d=WEIGHTS, a={}, b={}, level=F(5), rate=F(1, 4), P=P, Q=Q)


def problem(q: int = 2) -> Problem:
    arcs = [[2, 1], [3, 2]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    alone = Problem(network=network, coupling="tanh(y)", gains={1: 1})
    if not q:
        return alone
    observer = Observer(W=[[1], [0]])
    return alone.replace(exosystem=SINE, observer=observer)


def separable_value(e: np.ndarray, eps: np.ndarray) -> float:
    """(N + kappa E) / rho, from the definition."""
    weight = np.array(P, dtype=float)
    N = max(abs(e[i]) / (i + 1) for i in range(3))
    E = max(float(row @ weight @ row) ** 0.5 for row in eps)
    return (N + E / 2) / 4


def lure_value(e: np.ndarray, eps: np.ndarray) -> float:
    """Root of V / level."""
    rows = [[2, 0.5, 0], [0.5, 1, 0], [0, 0, 3]]
    M = np.array(rows)
    weight = np.array(P, dtype=float)
    of_observers = sum(row @ weight @ row for row in eps)
    total = e @ M @ e + of_observers
    return float(total / 5) ** 0.5


def arc_wise_value(e: np.ndarray, eps: np.ndarray) -> float:
    """Root of V / level."""
    weight = np.array(P, dtype=float)
    total = sum(d * x * x for d, x in zip((2, 1, 3), e, strict=True))
    total += sum(row @ weight @ row for row in eps)
    return float(total / 5) ** 0.5


VALUES = [(SEPARABLE, separable_value), (LURE, lure_value), (ARC_WISE, arc_wise_value)]


@pytest.mark.parametrize(("claim", "truth"), VALUES)
def test_v_is_that_of_the_definition(claim, truth):
    level = level_of(problem(), claim)
    rng = np.random.default_rng(0)
    e = rng.normal(size=(3, 20))
    eps = rng.normal(size=(3, 2, 20))
    values = level.value(e, eps)
    for run in range(20):
        errors = eps[:, :, run]
        expected = truth(e[:, run], errors)
        assert values[run] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("kind", [RANDOM, CORNERS, EDGES])
@pytest.mark.parametrize(("claim", "truth"), VALUES)
def test_starts_lie_on_the_boundary_some_of_them_without_a_disturbance(claim, truth, kind: str):
    level = level_of(problem(), claim)
    loop = make_closed_loop(problem(), None)
    starts = Boundary(level=level, loop=loop)
    e, eps = starts.draw(np.random.default_rng(1), 60, kind)
    for run in range(60):
        errors = eps[:, :, run]
        found = truth(e[:, run], errors)
        assert found == pytest.approx(1.0, rel=1e-12)
    without_errors = np.all(eps == 0, axis=(0, 1))
    without = without_errors.sum()
    assert 5 < without < 50


def test_starts_of_what_holds_everywhere_without_a_matrix_and_of_another_problem():
    claim = Lure(P_e=FULL, ranges=(), radius=F(1), level=F(5))
    level = level_of(problem(), claim)
    loop = make_closed_loop(problem(), None)
    starts = Boundary(level=level, loop=loop)
    drawn = starts.draw(np.random.default_rng(1), 10, RANDOM)
    assert not np.any(drawn[1])
    everywhere = Separable(v=V, alpha=F(1), rho=None)
    known = np.zeros((3, 0, 1))
    first = np.array([[1.0], [0.0], [0.0]])
    assert level_of(problem(0), everywhere).value(first, known) == [1.0]
    linear = Lure(P_e=identity(3), ranges=(), radius=None, level=None)
    last = np.array([[0.0], [0.0], [1.0]])
    assert level_of(problem(0), linear).value(last, known) == [1.0]
    with pytest.raises(SpecError, match="weights v for this problem"):
        level_of(cycle(5, 3), SEPARABLE)
    with pytest.raises(SpecError, match="P_e of 5 rows"):
        level_of(cycle(5, 3), LURE)


def test_starts_keep_to_the_states_of_the_own_group():
    """Agents 1 and 3 have places 0 and 1, agent 2 has place 2."""
    rows = [[1, 1, 0], [0, 0, 1], [1, 1, 0]]
    own = np.array(rows, dtype=bool)
    constant = Exosystem(A=[[0]], C=[[1]])
    observer_of_sines = Observer(W=[[1], [0]])
    sines = Group(agents=[1, 3], exosystem=SINE, observer=observer_of_sines)
    observer_of_other = Observer(W=[[1]])
    other = Group(agents=[2], exosystem=constant, observer=observer_of_other)
    given = problem(0).replace(groups=[sines, other])
    diagonal = [F(2), F(1), F(3)]
    P = np.diag(diagonal).tolist()
    error = ErrorBound(P=P, beta=F(3), kappa=F(1), size=F(3))
    claim = replace(SEPARABLE, error=error)
    level = level_of(given, claim)
    loop = make_closed_loop(given, None)
    box = asked_box(given, loop, radius=2.0, disturbance=0.5)
    edge = Boundary(level=level, loop=loop)
    for starts in (box, edge):
        _, eps = starts.draw(np.random.default_rng(2), 30, RANDOM)
        assert np.all(eps[~own] == 0)
        assert np.any(eps[own] != 0)
