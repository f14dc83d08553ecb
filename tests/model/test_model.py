"""The CasADi model: equations (1), (9), (11), (12), (13), (19), (22)."""

import re
import time
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from networks import linked

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


def random_problem(coupling, seed: int, *, q: int = 2) -> Problem:
    """A random weighted digraph with an exosystem, matrix gains, offsets and one exception."""
    rng = np.random.default_rng(seed)
    agents = range(5)
    m = len(coupling) if isinstance(coupling, list) else 1
    arcs = []
    for i, j in permutations(agents, 2):
        if rng.random() < 0.5:
            arcs.append([i, j, int(rng.integers(1, 4))])

    def entries(rows: int, columns: int) -> list[list[float]]:
        return rng.integers(-9, 10, size=(rows, columns)).tolist()

    given: dict[str, Any] = {}
    listener, speaker, _ = arcs[0]
    special = ["2*y1 + y1**2"]
    special += [f"y{c}" for c in range(2, m + 1)]
    given["exceptions"] = {(listener, speaker): special}
    (given["target"],) = entries(1, m)
    # 2 on the diagonal, and a skew-symmetric rest
    places = np.arange(m)
    diagonal = 2 * np.eye(m, dtype=int)
    differences = np.subtract.outer(places, places)
    asymmetric = diagonal + differences
    given["gains"] = {0: 3, 1: asymmetric.tolist()}
    if q:
        given["exosystem"] = Exosystem(A=entries(q, q), C=entries(m, q))
        given["observer"] = Observer(W=entries(q, m))
    given["offsets"] = {2: entries(1, m)[0]}
    return linked(arcs, [*agents], coupling, **given)


def coupling_sum(problem: Problem, mode: str, e: np.ndarray) -> np.ndarray:
    """h(e) of (9), arc by arc, with the couplings' own NumPy functions."""
    total = np.zeros((problem.n, problem.m))
    agents = e.reshape(problem.n, problem.m)
    for i, j, weight in problem.network.modes[mode]:
        y = agents[j] - agents[i]
        h = problem.coupling_of(i, j).value(y)
        total[i] += float(weight) * h
    return total.ravel()


def column(value) -> np.ndarray:
    return np.asarray(value).ravel()


COUPLINGS = [*SCALAR, *VECTOR]
IDS = [text if isinstance(text, str) else "; ".join(text) for text in COUPLINGS]


@pytest.mark.parametrize(("seed", "coupling"), [*enumerate(COUPLINGS)], ids=IDS)
def test_h_is_the_sum_over_the_arcs_of_the_listener(seed: int, coupling):
    problem = random_problem(coupling, seed)
    rng = np.random.default_rng(seed)
    e = rng.uniform(-0.9, 0.9, problem.n * problem.m)
    found = column(build_model(problem).h(e))
    expected = coupling_sum(problem, "G", e)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("seed", "coupling"), [*enumerate(COUPLINGS)], ids=IDS)
def test_the_jacobian_agrees_with_finite_differences(seed: int, coupling):
    """(11)."""
    problem = random_problem(coupling, seed)
    size = problem.n * problem.m
    rng = np.random.default_rng(seed + 100)
    e = rng.uniform(-0.9, 0.9, size)
    differences = []
    for step in 1e-6 * np.eye(size):
        ahead = coupling_sum(problem, "G", e + step)
        back = coupling_sum(problem, "G", e - step)
        differences.append((ahead - back) / 2e-6)
    exact = np.asarray(build_model(problem).jacobian(e).full())
    np.testing.assert_allclose(exact, np.column_stack(differences), rtol=1e-6, atol=1e-6)


def all_close(found, expected, tolerance=1e-10) -> None:
    for got, wanted in zip(found, expected, strict=True):
        np.testing.assert_allclose(column(got), wanted, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("coupling", ["exp(y) - 1 + y", *VECTOR])
@pytest.mark.parametrize("q", [0, 1, 3])
def test_the_loop_agrees_with_the_equations_written_out_with_kronecker_products(coupling, q: int):
    """(1), (12), (13), (19) with I_n (x) ., as the paper writes them."""
    problem = random_problem(coupling, q, q=q)
    n = problem.n
    m = problem.m
    rng = np.random.default_rng(q)
    model = build_model(problem)

    def of_all(matrix) -> np.ndarray:
        return np.kron(np.eye(n), np.array(matrix, dtype=float))

    A = np.zeros((0, 0))
    C = np.zeros((n * m, 0))
    W = C.T
    if q:
        A = of_all(problem.exosystem.A)
        C = of_all(problem.exosystem.C)
        W = of_all(problem.observer.W)
    goal = goals(problem).ravel()
    e = rng.uniform(-0.9, 0.9, n * m)
    x = goal + e
    xi = rng.normal(size=n * q)
    z = rng.normal(size=n * q)
    xihat = z + W @ x
    dhat = C @ xihat
    u = -pinning_matrix(problem).toarray() @ e - dhat
    h = coupling_sum(problem, "G", e)
    x_dot = h + u + C @ xi
    xi_dot = A @ xi
    z_dot = (A - W @ C) @ xihat - W @ (h + u)

    all_close([model.controller(x, dhat)], [u])
    all_close(model.observer(z, x, u), [z_dot, xihat, dhat])
    all_close(model.closed_loop(x, xi, z), [x_dot, xi_dot, z_dot])
    # (22) is the closed loop in the coordinates e = x - goal and eps = xi - xihat.
    eps_dot = xi_dot - z_dot - W @ x_dot
    all_close(model.error_dynamics(e, xi - xihat), [x_dot, eps_dot], tolerance=1e-9)


def test_each_mode_has_its_own_arcs_and_without_any_still_its_pins():
    problem = load_problem("paper-switching")
    e = np.arange(10.0) / 10
    for mode in problem.network.modes:
        found = column(build_model(problem, mode).h(e))
        np.testing.assert_allclose(found, coupling_sum(problem, mode, e))
    assert build_model(problem).mode == "Ga"
    model = build_model(linked({"a": []}, 2, gains=2))
    at_goal = column(model.h([1.0, 2.0]))
    assert at_goal.tolist() == [0, 0]
    e_dot, _ = model.error_dynamics([1.0, 2.0], [])
    assert column(e_dot).tolist() == [-2, -4]


def test_a_thousand_agents_are_built_in_a_few_seconds():
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, 1000, size=(6000, 2)).tolist()
    different = {(i, j) for i, j in pairs if i != j}
    arcs = sorted(different)
    A = [[0, 2], [-2, 0]]
    C = [[1, 0]]
    sine = Exosystem(A=A, C=C)
    observer = Observer(W=[[3], [2]])
    given: dict[str, Any] = {"exosystem": sine, "observer": observer}
    problem = linked(arcs, [*range(1000)], "exp(y) - 1 + y", gains=1, **given)
    start = time.process_time()
    model = build_model(problem)
    taken = time.process_time() - start
    assert taken < 10
    e = rng.uniform(-1, 1, 1000)
    listeners, speakers = np.array(arcs).T
    y = e[speakers] - e[listeners]
    felt = np.expm1(y) + y
    wanted = np.bincount(listeners, felt, 1000)
    found = column(model.h(e))
    np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-12)
