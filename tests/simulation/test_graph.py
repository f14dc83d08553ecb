"""h(e) in blocks, and compiled couplings, against plain loops over the arcs."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.coupling.coupling import make_coupling
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.simulation import graph as graph_module
from dobc_design.simulation.graph import compile_coupling, make_graph

EXPRESSIONS = [
    "exp(y) - 1 + y",
    "tanh(2*y)",
    "y + y**3",
    "y**5 - y**7 + 3*y",
    "2*sin(y) + atan(y)",
    "clip(y, -1/2, 1/3) + y",
    "max(y, 2*y, 0) + min(y, 0)",
    "abs(y) + y",
    "sqrt(1 + y**2) - 1",
    "log(1 + y**2)/(1 + y**2)",
    "-y/(2 + cos(y))",
    "sinh(y) - tan(y/9) + cosh(y) - 1",
    "y*(3/(1 + y**4))",
    "pi*y",
    "y**12 + y*(1 + y**2)**-3",
    "0*y",
    "y",
    "-(-y)",
    "y**1 - 3*y",
    "y**1 + y**2 - y",
    "(y + y)*(y - 3*y) + y",
    "exp(1)*y + log(2)*y",
    "(2 - 1)*y",
]


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_a_compiled_coupling_is_the_coupling(text: str):
    coupling = make_coupling(text, dimension=1)
    y = np.random.default_rng(0).normal(size=(200, 1))
    kept = y.copy()
    np.testing.assert_allclose(compile_coupling(coupling)(y), coupling.value(y), rtol=1e-13, atol=1e-15)
    assert np.array_equal(y, kept)


def test_a_compiled_vector_coupling_sees_the_components_of_a_difference():
    coupling = make_coupling(["y1*y2 + y1", "sin(y2) - y1"], dimension=2)
    y = np.random.default_rng(0).normal(size=(50, 2, 3))
    wanted = np.stack([coupling.value(y[..., k]) for k in range(3)], axis=-1)
    np.testing.assert_allclose(compile_coupling(coupling)(y), wanted, rtol=1e-13)


def test_a_sum_of_many_terms_is_compiled_without_recursion():
    text = "y" + " + y" * 480
    found = compile_coupling(make_coupling(text, dimension=1))(np.array([[2.0]]))
    assert found.tolist() == [[962.0]]


def random_problem(n: int, arcs: int, *, m: int, seed: int) -> Problem:
    """Weights, agents without arcs, a hub, exceptions."""
    rng = np.random.default_rng(seed)
    pairs = {(1, j) for j in range(2, n // 2)} | {tuple(p) for p in rng.integers(1, n - 2, size=(arcs, 2)).tolist()}
    rows = [(i, j, int(rng.integers(1, 9))) for i, j in sorted(pairs) if i != j]
    h = "exp(y) - 1 + y" if m == 1 else ["y1 + y1*y2", "sin(y2) - y1"]
    other = "2*y" if m == 1 else ["y2", "y1"]
    special = {(i - 1, j - 1): other for i, j, _ in rows[::7]}
    network = Network.from_arcs(rows, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, exceptions=special, target=[0] * m)


def by_hand(problem: Problem, e):
    """(1), arc by arc."""
    total = np.zeros_like(e)
    for i, j, w in problem.network.modes["G"]:
        total[i] += float(w) * problem.coupling_of(i, j).value(e[j] - e[i])
    return total


@pytest.mark.parametrize(("n", "arcs", "m"), [(5, 4, 1), (40, 200, 1), (30, 100, 2)])
@pytest.mark.parametrize("runs", [1, 3, 5000])
def test_what_agents_feel_is_the_sum_over_their_arcs(n: int, arcs: int, m: int, runs: int):
    """(9); 5000 runs need several blocks even for few arcs."""
    problem = random_problem(n, arcs, m=m, seed=n)
    e = np.random.default_rng(1).normal(size=(n, m, runs))
    found = make_graph(problem, "G", runs=runs)(e.reshape(n * m, runs))
    for k in (0, runs - 1):
        wanted = by_hand(problem, e[..., k])
        np.testing.assert_allclose(found[:, k].reshape(n, m), wanted, rtol=1e-12, atol=1e-12)
        alone = make_graph(problem, "G", runs=runs)(np.ascontiguousarray(e[..., k]).reshape(n * m, 1))
        np.testing.assert_allclose(alone.reshape(n, m), wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("size", [1, 7, 100, 10_000])
def test_hubs_and_others_feel_the_same_in_blocks_of_any_size(size: int, monkeypatch):
    """Agent 1 hears most of the others: far more arcs than a block has slots, or than a block has room for."""
    monkeypatch.setattr(graph_module, "BLOCK", size)
    problem = random_problem(120, 300, m=1, seed=5)
    e = np.random.default_rng(1).normal(size=(120, 1))
    found = make_graph(problem, "G")(e)
    np.testing.assert_allclose(found, by_hand(problem, e), rtol=1e-12, atol=1e-12)


def test_many_arcs_are_worked_through_in_blocks_with_the_same_sum(monkeypatch):
    monkeypatch.setattr(graph_module, "BLOCK", 100)
    problem = random_problem(300, 3000, m=1, seed=0)
    graph = make_graph(problem, "G")
    assert len(graph.blocks) > 20
    e = np.random.default_rng(1).normal(size=300)
    np.testing.assert_allclose(graph(e), by_hand(problem, e[:, None])[:, 0], rtol=1e-11, atol=1e-11)


def test_columns_do_not_disturb_each_other():
    problem = random_problem(30, 100, m=2, seed=2)
    e = np.random.default_rng(1).normal(size=(60, 4))
    graph = make_graph(problem, "G", runs=4)
    alone = graph(e)
    e[:, 1] = np.nan
    again = graph(e)
    assert np.array_equal(alone[:, [0, 2, 3]], again[:, [0, 2, 3]])
