"""The right-hand sides: the symbolic closed loop, and what agents feel."""

import re

import casadi as ca
import numpy as np
import pytest

from dobc_design import Exosystem, Network, Observer, Problem, build_model, load_problem
from dobc_design.coupling.coupling import make_coupling
from dobc_design.loop.arrays import error_arcs
from dobc_design.loop.make import loop_of
from dobc_design.simulation import field as fields
from dobc_design.simulation.agents import StressedRuns
from dobc_design.simulation.setting import make_setting
from dobc_design.simulation.stressed import ALONE, StressedColumns


def mixed() -> Problem:
    """m = 2, q = 3, weights, an exception, matrix gains, offsets: nothing is symmetric."""
    arcs = [[1, 2, 3], [2, 3], [3, 1, "1/2"], [4, 1]]
    A = [[0, 1, 2], [3, -4, 5], [6, 7, -8]]
    C = [[1, 2, 0], [0, 3, 1]]
    W = [[1, 2], [3, 4], [5, 6]]
    turning = [[1, 2], [-2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to")
    exceptions = {(1, 2): ["exp(y1) - 1", "2*y2"]}
    gains = {"1": 3, "4": turning}
    exosystem = Exosystem(A=A, C=C)
    offsets = {"2": [1, 0], "3": [0, "1/3"]}
    return Problem(
        network=network,
        coupling=["y1 + y1*y2", "sin(y2) - y1"],
        exceptions=exceptions,
        target=[1, -2],
        gains=gains,
        exosystem=exosystem,
        observer=Observer(W=W),
        offsets=offsets,
    )


def without_disturbance() -> Problem:
    arcs = [[1, 2], [2, 1], [1, 3]]
    network = Network.from_arcs(arcs, arrow="listens_to")
    return Problem(network=network, coupling="exp(y) - 1 + y", target=[0, 1], gains={"3": 2})


PROBLEMS = [mixed(), without_disturbance(), load_problem("paper-fixed")]
IDS = ["mixed", "without disturbance", "paper-fixed"]


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_the_full_loop_is_the_symbolic_closed_loop(problem: Problem):
    mode = next(iter(problem.network.modes))
    setting = make_setting(problem, gain=None, mode=mode)
    switches = setting.switches(0)
    starts = [setting.starts.draw(0)]
    runs = StressedRuns(setting=setting, starts=starts, seeds=[0], switches=[switches])
    derivative = StressedColumns(runs).part(0, ALONE)
    model = build_model(problem)
    rng = np.random.default_rng(0)
    for _ in range(5):
        size = problem.n * (problem.m + 2 * problem.q)
        state = rng.normal(size=size)
        parts = [part.ravel() for part in setting.loop.split(state[:, None])]
        symbols = model.closed_loop(*parts)
        slope = ca.vertcat(*symbols)
        wanted = np.asarray(slope).ravel()
        nothing = np.zeros((0, 1))
        found = derivative(state[:, None], nothing)[:, 0]
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("problem", PROBLEMS, ids=IDS)
def test_the_pattern_covers_the_jacobian_of_the_closed_loop(problem: Problem):
    mode = next(iter(problem.network.modes))
    groups = error_arcs(loop_of(problem), mode)
    symbols = []
    for width in (problem.m, problem.q, problem.q):
        symbols.append(ca.SX.sym("s", problem.n * width))
    closed_loop = ca.vertcat(*build_model(problem).closed_loop(*symbols))
    variables = ca.vertcat(*symbols)
    jacobian = ca.jacobian(closed_loop, variables)
    rows, columns = jacobian.sparsity().get_triplet()
    loop = fields.make_closed_loop(problem, None)
    found = fields.full_pattern(loop, groups)
    pattern = found.toarray() != 0
    assert pattern.shape == (closed_loop.numel(),) * 2
    assert pattern[rows, columns].all()


EXPRESSIONS = re.split(
    r";\s",
    """exp(y) - 1 + y; tanh(2*y); y + y**3; y**5 - y**7 + 3*y; 2*sin(y) + atan(y); clip(y, -1/2,
    1/3) + y;
max(y, 2*y, 0) + min(y, 0); abs(y) + y; sqrt(1 + y**2) - 1; log(1 + y**2)/(1 + y**2); -y/(2 +
cos(y));
sinh(y) - tan(y/9) + cosh(y) - 1; y*(3/(1 + y**4)); pi*y; y**12 + y*(1 + y**2)**-3; 0*y; y; -(-y);
y**1 - 3*y;
y**1 + y**2 - y; (y + y)*(y - 3*y) + y; exp(1)*y + log(2)*y; (2 - 1)*y""",
)


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_a_compiled_coupling_is_the_coupling(text: str):
    coupling = make_coupling(text, dimension=1)
    y = np.random.default_rng(0).normal(size=(200, 1))
    kept = y.copy()
    found = fields.compile_coupling(coupling)(y)
    np.testing.assert_allclose(found, coupling.value(y), rtol=1e-13, atol=1e-15)
    assert np.array_equal(y, kept)


def test_a_sum_of_many_terms_is_compiled_without_recursion():
    text = "y" + " + y" * 480
    h = fields.compile_coupling(make_coupling(text, dimension=1))
    found = h(np.array([[2.0]])).tolist()
    assert found == [[962.0]]


def random_problem(n: int, arcs: int, *, m: int, seed: int) -> Problem:
    """Weights, agents without arcs, a hub, exceptions."""
    rng = np.random.default_rng(seed)
    hub = [(1, j) for j in range(2, n // 2)]
    drawn = rng.integers(1, n - 2, size=(arcs, 2))
    others = map(tuple, drawn.tolist())
    rows = []
    for i, j in sorted({*hub, *others}):
        if i != j:
            weight = int(rng.integers(1, 9))
            arc = (i, j, weight)
            rows.append(arc)
    h = "exp(y) - 1 + y"
    other = "2*y"
    if m == 2:
        h = ["y1 + y1*y2", "sin(y2) - y1"]
        other = ["y2", "y1"]
    special = {}
    for i, j, _ in rows[::7]:
        special[i - 1, j - 1] = other
    network = Network.from_arcs(rows, arrow="listens_to", agents=n)
    return Problem(network=network, coupling=h, exceptions=special, target=[0] * m)


def by_hand(problem: Problem, e):
    """(1), arc by arc."""
    total = np.zeros_like(e)
    for i, j, w in problem.network.modes["G"]:
        difference = e[j] - e[i]
        pull = problem.coupling_of(i, j).value(difference)
        total[i] += float(w) * pull
    return total


def graph(problem: Problem, runs: int = 1) -> fields.Network:
    """Without pins, so that h(e) - K e is h(e)."""
    loop = fields.make_closed_loop(problem, None)
    groups = error_arcs(loop_of(problem), "G")
    return fields.network_of(loop, groups, runs=runs)


@pytest.mark.parametrize(("n", "arcs", "m"), [(5, 4, 1), (40, 200, 1), (30, 100, 2)])
@pytest.mark.parametrize("runs", [1, 3, 5000])
def test_what_agents_feel_is_the_sum_over_their_arcs(n: int, arcs: int, m: int, runs: int):
    """(9); 5000 runs need several blocks even for few arcs."""
    problem = random_problem(n, arcs, m=m, seed=n)
    rng = np.random.default_rng(1)
    shape = (n, m, runs)
    e = rng.normal(size=shape)
    found = graph(problem, runs)(e.reshape(n * m, runs))
    for k in (0, runs - 1):
        wanted = by_hand(problem, e[..., k])
        actual = found[:, k].reshape(n, m)
        np.testing.assert_allclose(actual, wanted, rtol=1e-12, atol=1e-12)
        column = np.ascontiguousarray(e[..., k])
        flat = column.reshape(n * m, 1)
        alone = graph(problem, runs)(flat)
        np.testing.assert_allclose(alone.reshape(n, m), wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("size", [1, 7, 100, 10_000])
def test_hubs_and_others_feel_the_same_in_blocks_of_any_size(size: int, monkeypatch):
    """Agent 1 hears most of the others: far more arcs than a block has slots, or than a block has
    room for."""
    monkeypatch.setattr(fields, "BLOCK", size)
    problem = random_problem(120, 300, m=1, seed=5)
    e = np.random.default_rng(1).normal(size=(120, 1))
    found = graph(problem)(e)
    np.testing.assert_allclose(found, by_hand(problem, e), rtol=1e-12, atol=1e-12)
