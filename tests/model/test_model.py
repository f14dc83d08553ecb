"""The CasADi model: equations (1), (9), (11), (12), (13), (19), (22)."""

import re
import time
from itertools import permutations

import numpy as np
import pytest
from networks import network_of

from dobc_design import Exosystem, Observer, Problem, load_problem
from dobc_design.loop.arrays import goals, pinning_matrix
from dobc_design.model.model import build_model

SCALAR = re.split(
    r";\s",
    """exp(y) - 1 + y; log(1 + y**2) + y; sin(y); cos(2*y) - 1; tan(y/4); 3*tanh(y); atan(y);
    sinh(y)/2; cosh(y) - 1;
sqrt(1 + y**2) - 1; y + abs(y)/2; min(y, 2*y); max(y, y/3); clip(y, -1, 1); y**3 + y/(1 + y**2);
-pi*y**5/9;
y*(2 + y)**-2""",
)
VECTOR = [
    ["y1 + y1*y2", "sin(y2) - exp(y1) + 1"],
    ["0", "y1**2 + 3*y2"],
    ["tanh(y1)*cosh(y2)", "y2/(1 + y1**2)", "max(y3, y1 - y2)"],
]


def random_problem(coupling, seed: int, *, q: int = 2, n: int = 5, **settings) -> Problem:
    """A random weighted digraph with an exosystem, matrix gains, offsets and one exception."""
    rng = np.random.default_rng(seed)
    m = len(coupling) if isinstance(coupling, list) else settings.pop("m", 1)
    arcs = []
    for i, j in permutations(range(n), 2):
        if rng.random() < 0.5:
            arcs.append([i, j, int(rng.integers(1, 4))])
    arcs = arcs or [[0, 1, 2]]
    special = "2*y + y**2"
    if m > 1:
        special = ["2*y1 + y1**2", *(f"y{c + 1}" for c in range(1, m))]
    asymmetric = [[2 if c == d else c - d for d in range(m)] for c in range(m)]

    def entries(rows: int, columns: int) -> list[list[float]]:
        return rng.integers(-9, 10, size=(rows, columns)).tolist()

    return Problem(
        network=network_of(arcs, [*range(n)]),
        coupling=coupling,
        exceptions={(arcs[0][0], arcs[0][1]): special},
        target=entries(1, m)[0],
        gains={0: 3, 1: asymmetric},
        exosystem=Exosystem(A=entries(q, q), C=entries(m, q)) if q else None,
        observer=Observer(W=entries(q, m)) if q else None,
        offsets={2: entries(1, m)[0]},
        **settings,
    )


def coupling_sum(problem: Problem, mode: str, e: np.ndarray) -> np.ndarray:
    """h(e) of (9), arc by arc, with the couplings' own NumPy functions."""
    total = np.zeros((problem.n, problem.m))
    agents = e.reshape(problem.n, problem.m)
    for i, j, weight in problem.network.modes[mode]:
        h = problem.coupling_of(i, j).value(agents[j] - agents[i])
        total[i] += float(weight) * h
    return total.ravel()


def column(value) -> np.ndarray:
    return np.asarray(value).ravel()


COUPLINGS = [*SCALAR, *VECTOR]
IDS = [text if isinstance(text, str) else "; ".join(text) for text in COUPLINGS]


@pytest.mark.parametrize(("seed", "coupling"), [*enumerate(COUPLINGS)], ids=IDS)
def test_h_is_the_sum_over_the_arcs_of_the_listener(seed: int, coupling):
    problem = random_problem(coupling, seed)
    e = np.random.default_rng(seed).uniform(-0.9, 0.9, problem.n * problem.m)
    found = column(build_model(problem).h(e))
    np.testing.assert_allclose(found, coupling_sum(problem, "G", e), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("seed", "coupling"), [*enumerate(COUPLINGS)], ids=IDS)
def test_the_jacobian_agrees_with_finite_differences(seed: int, coupling):
    """(11)."""
    problem = random_problem(coupling, seed)
    size, step = problem.n * problem.m, 1e-6
    e = np.random.default_rng(seed + 100).uniform(-0.9, 0.9, size)
    differences = []
    for unit in np.eye(size):
        ahead = coupling_sum(problem, "G", e + step * unit)
        back = coupling_sum(problem, "G", e - step * unit)
        differences.append((ahead - back) / (2 * step))
    exact = np.asarray(build_model(problem).jacobian(e).full())
    np.testing.assert_allclose(exact, np.column_stack(differences), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("coupling", ["exp(y) - 1 + y", *VECTOR])
@pytest.mark.parametrize("q", [0, 1, 3])
def test_the_loop_agrees_with_the_equations_written_out_with_kronecker_products(coupling, q: int):
    """(1), (12), (13), (19) with I_n (x) ., as the paper writes them."""
    problem = random_problem(coupling, q, q=q)
    n, m = problem.n, problem.m
    rng = np.random.default_rng(q)
    model = build_model(problem)
    A, C, W = np.zeros((0, 0)), np.zeros((m, 0)), np.zeros((0, m))
    if q:
        A = np.array(problem.exosystem.A, dtype=float)
        C = np.array(problem.exosystem.C, dtype=float)
        W = np.array(problem.observer.W, dtype=float)
    each = np.eye(n)
    goal = goals(problem).ravel()
    x = goal + rng.uniform(-0.9, 0.9, n * m)
    xi = rng.normal(size=n * q)
    z = rng.normal(size=n * q)
    xihat = z + np.kron(each, W) @ x
    dhat = np.kron(each, C) @ xihat
    u = -pinning_matrix(problem).toarray() @ (x - goal) - dhat
    h = coupling_sum(problem, "G", x - goal)
    z_dot = np.kron(each, A - W @ C) @ xihat - np.kron(each, W) @ (h + u)

    close = {"rtol": 1e-10, "atol": 1e-10}
    np.testing.assert_allclose(column(model.controller(x, dhat)), u, **close)
    for got, wanted in zip(model.observer(z, x, u), (z_dot, xihat, dhat), strict=True):
        np.testing.assert_allclose(column(got), wanted, **close)
    x_dot, xi_dot, z_dot_closed = model.closed_loop(x, xi, z)
    np.testing.assert_allclose(column(x_dot), h + u + np.kron(each, C) @ xi, **close)
    np.testing.assert_allclose(column(xi_dot), np.kron(each, A) @ xi, **close)
    np.testing.assert_allclose(column(z_dot_closed), z_dot, **close)

    # (22) is the closed loop in the coordinates e = x - goal and eps = xi - xihat.
    e_dot, eps_dot = model.error_dynamics(x - goal, xi - xihat)
    np.testing.assert_allclose(column(e_dot), column(x_dot), **close)
    moved = column(xi_dot) - column(z_dot_closed) - np.kron(each, W) @ column(x_dot)
    np.testing.assert_allclose(column(eps_dot), moved, rtol=1e-9, atol=1e-9)


def test_each_mode_has_its_own_arcs_and_without_any_still_its_pins():
    problem = load_problem("paper-switching")
    e = np.arange(10.0) / 10
    for mode in problem.network.modes:
        found = column(build_model(problem, mode).h(e))
        np.testing.assert_allclose(found, coupling_sum(problem, mode, e))
    assert build_model(problem).mode == "Ga"
    lonely = network_of({"a": []}, 2)
    model = build_model(Problem(network=lonely, coupling="y", gains=2))
    assert column(model.h([1.0, 2.0])).tolist() == [0, 0]
    e_dot, _ = model.error_dynamics([1.0, 2.0], [])
    assert column(e_dot).tolist() == [-2, -4]


def test_a_thousand_agents_are_built_in_a_few_seconds():
    rng = np.random.default_rng(0)
    arcs = {(int(i), int(j)) for i, j in rng.integers(0, 1000, size=(6000, 2)) if i != j}
    network = network_of(sorted(arcs), [*range(1000)])
    problem = Problem(
        network=network,
        coupling="exp(y) - 1 + y",
        gains=1,
        exosystem=Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        observer=Observer(W=[[3], [2]]),
    )
    start = time.process_time()
    model = build_model(problem)
    assert time.process_time() - start < 10
    e = rng.uniform(-1, 1, 1000)
    listeners, speakers = np.array(sorted(arcs)).T
    y = e[speakers] - e[listeners]
    wanted = np.bincount(listeners, np.expm1(y) + y, 1000)
    np.testing.assert_allclose(column(model.h(e)), wanted, rtol=1e-10, atol=1e-12)
