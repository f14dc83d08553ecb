"""Floating-point estimates against NumPy on the full matrices, and the float Lambda against the
exact one."""

import numpy as np
import pytest
from networks import linked
from random_problems import random_problem
from scipy import sparse
from texts import exact_matrix

from dobc_design import Problem, Verdict, certify
from dobc_design.conditions.consensus import propose
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.propose import (
    DENSE,
    MOST_PRODUCTS,
    decay_rate,
    dominating_vector,
    float_lambda,
    lambda_tops,
    largest_eigenvalue,
    pair_margin,
    pair_rate,
    witness_directions,
)
from dobc_design.exact.matrix import to_float
from dobc_design.loop.make import loop_of

PAPER_GAIN = exact_matrix("16/5; 12/5")
PAPER_P = exact_matrix("1/2 -1/4; -1/4 1/3")


def dense(matrix) -> np.ndarray:
    """An exact sparse matrix as a float array."""
    return np.array(matrix.to_dense(), dtype=float)


H = "exp(y) - 1 + y"


def ring(n: int, **given) -> Problem:
    given.setdefault("gains", dict.fromkeys(range(1, n + 1, 10), 3))
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    return linked(arcs, n, coupling=H, **given)


def table_of(problem: Problem, mode: str = "G"):
    return float_lambda(loop_of(problem), mode)


def directions_of(problem: Problem, mode: str = "G"):
    return witness_directions(loop_of(problem), mode)


def highest(matrix) -> float:
    """The largest eigenvalue, by NumPy."""
    return np.linalg.eigvalsh(matrix)[-1]


@pytest.mark.parametrize("seed", range(40))
def test_the_float_lambda_is_the_exact_one(seed):
    """theorems.conditions.lemma1 states it: weights, exceptions, matrix gains, vectors, irrational
    slopes."""
    problem = random_problem(seed)
    for mode, pencil in state_theorems(loop_of(problem)).lambdas.items():
        found = table_of(problem, mode).toarray()
        assert np.allclose(found, dense(pencil.constant), rtol=1e-14, atol=1e-14)


def slow(value):
    return pytest.param(value, marks=pytest.mark.slow)


@pytest.mark.parametrize("n", [DENSE, slow(DENSE - 1), slow(DENSE + 1), slow(DENSE + 50)])
def test_both_sides_of_the_switch_agree_with_numpy(n):
    table = table_of(ring(n))
    top = largest_eigenvalue(table)
    full = table.toarray()
    assert top.value == pytest.approx(highest(full), abs=1e-7)
    assert np.array_equal(largest_eigenvalue(table).vector, top.vector)  # it can be repeated
    found = np.linalg.norm(full @ top.vector - top.value * top.vector)
    assert found < 1e-5


def test_the_largest_eigenvalue_of_the_paper_cycle():
    """Theory, known answers: one pin k = 3 gives -0.153544, all pinned k gives -2 k."""
    cases = (({1: 3}, -0.153544), (3, -6), (None, 0))
    for gains, value in cases:
        table = table_of(ring(10, gains=gains))
        top = largest_eigenvalue(table)
        assert top.value == pytest.approx(value, abs=5e-7)


def test_a_direction_without_the_symmetry_of_the_start_is_found():
    """The top vector is antisymmetric: from a start of ones only rounding errors lead there."""
    n = DENSE + 100
    half = n // 2
    arrays = [np.ones(half), -np.ones(half)]
    sign = np.concatenate(arrays)
    own = -np.linspace(1, 2, half)
    whole = np.diag(np.concatenate([own, own])) + 5 * np.outer(sign, sign) / n
    matrix = sparse.csr_array(whole)
    top = largest_eigenvalue(matrix)
    assert top.value == pytest.approx(highest(matrix.toarray()), rel=1e-7)


@pytest.mark.parametrize("factor", [1e-320, 1e307])
@pytest.mark.parametrize("n", [20, DENSE + 20])
def test_huge_and_tiny_entries_neither_over_nor_underflow(n, factor):
    diagonals = np.linspace(-1, -0.5, n)
    diagonal = sparse.diags_array(diagonals)
    table = sparse.csr_array(diagonal)
    scaled = sparse.csr_array(table * factor)
    accuracy = 1e-2 if factor < 1e-300 else 1e-6
    assert largest_eigenvalue(scaled).value == pytest.approx(-0.5 * factor, rel=accuracy)
    for entry in (np.inf, -np.inf, np.nan):  # no numbers, no estimate
        whole = np.array([[entry, 0.0], [0.0, 1.0]])
        top = largest_eigenvalue(sparse.csr_array(whole))
        assert np.isnan(top.value)
        assert not np.any(top.vector)


def test_without_convergence_the_dense_solver_steps_in(monkeypatch):
    calls = []

    def fail(*arguments, **settings):
        calls.append((settings["ncv"], settings["tol"]))
        raise sparse.linalg.ArpackNoConvergence("no convergence", np.array([]), np.zeros((0, 0)))

    monkeypatch.setattr(sparse.linalg, "eigsh", fail)
    table = table_of(ring(DENSE + 20))
    assert largest_eigenvalue(table).value == pytest.approx(highest(table.toarray()), abs=1e-9)
    assert calls == list(propose.LANCZOS)  # the second attempt has more vectors and less precision
    # too large for that: no estimate, no exception
    monkeypatch.setattr(propose, "LARGEST_DENSE", DENSE)
    assert np.isnan(largest_eigenvalue(table).value)
    nothing = np.array([]), np.zeros((3, 0))
    # nor does the dense solver
    cases = (lambda *_, **__: fail(ncv=None, tol=None), lambda *_, **__: nothing)
    for answer in cases:
        monkeypatch.setattr(propose.linalg, "eigh", answer)
        assert np.isnan(largest_eigenvalue(table_of(ring(3))).value)


def full_psi(problem, P, Q, rate: float) -> np.ndarray:
    """Psi + 2 rate diag(I, I (x) P), assembled by Kronecker products."""
    n = problem.n
    top = dense(state_theorems(loop_of(problem)).lambdas["G"].constant)
    A = to_float(problem.exosystem.A)
    C = to_float(problem.exosystem.C)
    omega = P @ A + A.T @ P - Q @ C - C.T @ Q.T
    border = np.kron(np.eye(n), C)
    corner = top + 2 * rate * np.eye(len(top))
    arrays = [[corner, border], [border.T, np.kron(np.eye(n), omega + 2 * rate * P)]]
    return np.block(arrays)


@pytest.mark.parametrize("factor", [1, 3, 30, 1000])
def test_margin_and_rate_of_a_pair_are_those_of_the_full_matrix(cycle, factor):
    problem = cycle(5, pins=3)
    P = factor * to_float(PAPER_P)
    Q = P @ to_float(PAPER_GAIN)
    tops = lambda_tops(state_theorems(loop_of(problem)))
    margin = pair_margin(tops, P, Q, problem.exosystem)
    rate = pair_rate(tops, P, Q, problem.exosystem)
    # theory, known answers: S = 9/8 for the printed pair
    assert margin == pytest.approx(6 - 9 / (8 * factor))
    assert rate > 0
    found = highest(full_psi(problem, P, Q, rate * 0.999))
    assert found < 0
    found = highest(full_psi(problem, P, Q, rate * 1.001))
    assert found > 0
    shifted = full_psi(problem, P, Q, 0.0)
    shifted[:5, :5] += margin * np.eye(5)
    assert highest(shifted) == pytest.approx(0, abs=1e-9)


def test_the_decay_of_the_paper_gain(harmonic):
    """Theory, known answers: the eigenvalues of A - WC are -8/5 +- (2/5) sqrt(39) i."""
    assert decay_rate(harmonic, PAPER_GAIN) == pytest.approx(1.6)
    found = decay_rate(harmonic, exact_matrix("0; 0"))
    assert found == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("special", [{}, {(1, 0): "2*y"}])
def test_weights_beyond_the_floats_give_no_warning_and_no_estimate(special):
    """A warning in this package is an error in these tests; certify must go on without an
    estimate."""
    arcs = [[1, 2, "1e300"], [2, 1]]
    steep = "100000000000000000000*y"
    problem = linked(arcs, coupling=steep, exceptions=special, gains=1)
    assert not np.all(np.isfinite(table_of(problem).toarray()))
    # 4 (a + 1)(b + 1) < (a + b)^2
    found = certify(problem).check("lemma1", "G")
    assert found.verdict is Verdict.REFUTED


def moved(vector, m):
    return {place // m for place, x in enumerate(vector) if x}


def test_a_leader_without_a_pin_and_a_cycle_without_one_are_directions_and_what_is_held_has_none(
    cycle, monkeypatch
):
    arcs = [[1, 2], [2, 3]]
    problem = linked(arcs, gains={1: 5})
    directions = directions_of(problem)
    assert moved(directions[0], 1) == {2}
    directions = directions_of(cycle(8, pins={}))
    found = [moved(each, 1) for each in directions]
    assert found == [set(range(8))]
    assert np.ptp(directions[0]) < 1e-9
    assert directions_of(cycle(5)) == []
    monkeypatch.setattr(propose, "LARGEST_SEARCHED", 3)  # too large to look at
    assert directions_of(cycle(5, pins={})) == []


@pytest.mark.parametrize("seed", [75, 253, 295])
def test_of_no_direction_an_agent_can_be_left_out(seed):
    """The largest eigenvalue of Lambda, on the agents that move, is not negative, and on all but
    one of them it is."""
    problem = random_problem(seed)
    several = 0
    for mode in problem.network.modes:
        table = table_of(problem, mode).toarray()

        def top(agents, table=table, m=problem.m):
            rows = [agent * m + c for agent in agents for c in range(m)]
            return highest(table[np.ix_(rows, rows)])

        for each in directions_of(problem, mode):
            agents = moved(each, problem.m)
            assert top(agents) > -1e-8
            if len(agents) > 1:
                several += 1
                for agent in agents:
                    assert top(agents - {agent}) < 0
    assert several


def wide_ring(n, *, step=10, arcs=None):
    """Both neighbours are heard; every so many agents one is pinned (step 0: none)."""
    arcs = arcs or [[i, (i + k) % n or n] for i in range(1, n + 1) for k in (1, n - 1)]
    gains = None
    if step:
        gains = dict.fromkeys(range(1, n + 1, step), 3)
    return linked(arcs, n, coupling=H, gains=gains)


@pytest.mark.parametrize("step", [1, 10, 300])
def test_the_bound_is_close_to_the_least_eigenvalue_and_not_beyond(step):
    """-Lambda of a ring of 1200; the vector itself shows the bound."""
    table = table_of(wide_ring(1200, step=step)).tocsr()
    found = dominating_vector(table)
    least = -sparse.linalg.eigsh(table.tocsc(), k=1, sigma=1e-3, return_eigenvectors=False)[0]
    assert 0.95 * least <= found.least <= least * (1 + 1e-9)
    assert (found.vector > 0).all()
    answer = np.min(-(table @ found.vector) / found.vector)
    assert answer == pytest.approx(found.least, rel=1e-6)
    assert found.first <= found.products


def test_few_products_are_enough_and_one_pin_is_left_to_a_factorisation():
    """design.md: 250 for the first bound.  With one pin conjugate gradients would need half as many
    as agents."""
    found = dominating_vector(table_of(wide_ring(4000)))
    assert found.first <= 250
    assert found.products <= MOST_PRODUCTS + 5
    table = table_of(wide_ring(8000, step=8000))
    found = dominating_vector(table)
    assert 0 < found.least < 4 * np.pi**2 / 8000**2 * 4
    assert found.products < 1000


def test_without_a_pin_there_is_a_direction_and_no_bound():
    """All agents moved together: v' Lambda v = 0."""
    table = table_of(wide_ring(1200, step=0)).tocsr()
    found = dominating_vector(table)
    assert not found.least > 0
    v = found.vector
    assert v @ (table @ v) >= -1e-9 * (v @ v)

    arcs = [[i, i + 1] for i in range(1, 1000)]  # the last agent hears nobody
    problem = wide_ring(1001, arcs=arcs, step=960)
    found = dominating_vector(table_of(problem))
    assert not found.least > 0
    assert found.vector.any()
    # no floats
    whole = np.array([[-np.inf, 0.0], [0.0, -1.0]])
    answer = dominating_vector(sparse.csr_array(whole))
    assert answer is None
