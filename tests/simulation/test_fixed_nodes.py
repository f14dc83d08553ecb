"""Runs between fixed nodes: where they end, and never outside of what is certified.

Oracles: -L_FF^-1 L_FL by NumPy, and a Runge-Kutta method written here.
"""

from __future__ import annotations

import numpy as np
import pytest
from published import FIRST, opinions

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.loop.limits import mean_weights
from dobc_design.report.write import render_report
from dobc_design.verdict import Verdict

PATH = [[1, "a"], [1, 2], [2, 1], [2, 3], [3, 2], [3, "b"]]


def between(arcs, fixed, coupling="y", **more) -> dd.Problem:
    network = dd.Network.from_arcs(arcs, arrow="listens_to", fixed=tuple(fixed))
    return dd.Problem(network=network, coupling=coupling, goal="containment", fixed=fixed, **more)


def random_problem(rng: np.random.Generator, **more) -> tuple[dd.Problem, np.ndarray, np.ndarray]:
    """A digraph whose agents hear three fixed nodes, directly or through others; its L_FF and
    L_FL."""
    n = int(rng.integers(2, 9))
    names = ["a", "b", "c"]
    arcs = []
    L = np.zeros((n, n + 3))
    for i in range(n):
        # everyone hears an earlier one or a fixed node, so that all are reached
        first = int(rng.choice([*range(i), n, n + 1, n + 2]))
        others = {j for j in range(n + 3) if j != i and rng.random() < 0.2}
        for j in {first, *others}:
            weight = int(rng.integers(1, 5))
            arcs.append([i + 1, names[j - n] if j >= n else j + 1, weight])
            L[i, i] += weight
            L[i, j] -= weight
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=n, fixed=names)
    fixed = dict(zip(names, rng.integers(-5, 6, size=3).tolist(), strict=True))
    problem = dd.Problem(network=network, coupling="y", goal="containment", fixed=fixed, **more)
    return problem, L[:, :n], L[:, n:]


def test_a_path_of_three_ends_at_quarters():
    """(3/4, 1/4), (1/2, 1/2), (1/4, 3/4), theory, section 14; exactly."""
    weights = mean_weights(between(PATH, {"a": 0, "b": 1}))
    assert [list(map(float, row)) for row in weights] == [[0.75, 0.25], [0.5, 0.5], [0.25, 0.75]]


def test_a_group_of_four_with_stubborn_agents_ends_as_was_published():
    """Friedkin and Johnsen 1999: 60, 60, 75, 75."""
    weights = mean_weights(opinions())
    found = [float(sum(w * x for w, x in zip(row, FIRST, strict=True))) for row in weights]
    assert [round(x) for x in found] == [60, 60, 75, 75]
    np.testing.assert_allclose(found, [60.020849, 59.983966, 75, 74.986205], atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_random_networks_end_where_numpy_says(seed):
    rng = np.random.default_rng(seed)
    for _ in range(10):
        problem, among, heard = random_problem(rng, simulation={"t_final": 400})
        values = np.array([float(place[0][0]) for place in problem.fixed.values()])
        expected = -np.linalg.solve(among, heard) @ values
        weights = mean_weights(problem)
        if weights is None:  # all three at one place are a target
            assert len(set(values)) == 1
            continue
        exact = np.array([[float(w) for w in row] for row in weights])
        np.testing.assert_allclose(exact, -np.linalg.solve(among, heard), atol=1e-12)
        np.testing.assert_allclose(exact.sum(axis=1), 1)
    run = dd.simulate(problem)
    np.testing.assert_allclose(run.x[-1, :, 0], expected, atol=1e-6)
    assert run.error()[-1] < 1e-6


@pytest.mark.parametrize("seed", range(2))
def test_random_linear_networks_are_proved_by_both_programs(seed):
    problem, _, _ = random_problem(np.random.default_rng(100 + seed))
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


@pytest.mark.parametrize(
    "coupling",
    ["tanh(y)", *(pytest.param(h, marks=pytest.mark.slow) for h in ("y", "y + y**3/10"))],
)
def test_no_run_between_moving_leaders_is_later_than_certified(coupling):
    """Sines with even seeds, jumps with odd ones; starts at the corners of the region as well."""
    fixed = {"a": {"between": [-1, 0]}, "b": {"between": [1, 2]}}
    region = {"initial_states": [-3, 4]}
    problem = between(PATH, fixed, coupling, region=region, simulation={"t_final": 6})
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    rate, factor = certificate.rate, certificate.factor
    for seed in (0, 1, 3):
        start = {"x": [[-3], [4], [-3]]} if seed < 2 else None
        run = dd.simulate(problem, seed=seed, start=start)
        error = run.error()
        bound = factor * error[0] * np.exp(-rate * run.times)
        assert (error <= bound + 1e-7).all()


def test_leaders_that_stay_at_the_ends_away_from_an_agent_are_no_worse():
    """Adversarial: both leaders are at all times at the end that the widest agent is pushed to;
    Runge and Kutta's method, written here."""
    problem = between(
        PATH,
        {"a": {"between": [-1, 0]}, "b": {"between": [1, 2]}},
        "tanh(y)",
        region={"initial_states": [-3, 4]},
    )
    certificate = dd.certify(problem)

    def derivative(x):
        end = 2.0 if np.argmax([x.max() - 2, -1 - x.min()]) == 0 else -1.0
        a, b = np.clip(end, -1, 0), np.clip(end, 1, 2)
        h = np.tanh
        return np.array(
            [
                h(a - x[0]) + h(x[1] - x[0]),
                h(x[0] - x[1]) + h(x[2] - x[1]),
                h(x[1] - x[2]) + h(b - x[2]),
            ]
        )

    for start in ([4.0, 4.0, 4.0], [-3.0, -3.0, -3.0], [4.0, -3.0, 4.0]):
        x = np.array(start)
        first = max(x.max() - 2, -1 - x.min())
        for step in range(1, 1201):
            k1 = derivative(x)
            k2 = derivative(x + 0.005 * k1)
            x = x + 0.01 * k2
            far = max(x.max() - 2, -1 - x.min(), 0)
            most = certificate.factor * first * np.exp(-certificate.rate * 0.01 * step)
            assert far <= most + 1e-4


def test_agents_end_between_leaders_in_every_component():
    fixed = {"a": [0, 10], "b": {"between": [[1, 2], [12, 13]]}}
    problem = between(PATH, fixed, simulation={"t_final": 30})
    run = dd.simulate(problem, seed=1)
    assert run.x.shape[2] == 2
    assert run.error()[-1] < 1e-6
    assert (run.x[-1, :, 0] <= 2).all() and (run.x[-1, :, 1] >= 10).all()


def test_many_runs_side_by_side_are_those_made_alone():
    problem = between(PATH, {"a": 0, "b": 4}, "tanh(y)", region={"initial_states": [-2, 8]})
    many = dd.simulate(problem, runs=3)
    for run in range(3):
        alone = dd.simulate(problem, seed=int(many.seeds[run]))
        np.testing.assert_allclose(many.error[run], alone.error(), atol=1e-7)


def test_a_stored_run_knows_where_there_is_no_error(tmp_path):
    run = dd.simulate(between(PATH, {"a": 0, "b": 4}))
    again = dd.load_trajectory(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(again.errors(), run.errors())


def test_a_stress_is_refused_where_nodes_are_fixed():
    problem = between(PATH, {"a": 0, "b": 4})
    with pytest.raises(SpecError, match="not available yet for networks with fixed nodes"):
        dd.simulate(problem, stress=dd.Stress(saturation=1))


def test_the_report_says_where_agents_end_and_speaks_of_no_target():
    certificate = dd.certify(between(PATH, {"a": 0, "b": 4}))
    page = render_report(certificate)["report.html"].decode("utf-8")
    assert "1 (3/4 a + 1/4 b)" in page
    assert "a rests at 0; b rests at 4" in page
    for words in ("goes to its goal", "Pinning gains", "the target"):
        assert words not in page


def test_check_says_where_agents_end_or_whom_they_do_not_hear():
    told = str(dd.describe(between(PATH, {"a": 0, "b": 4})))
    assert "Goal: all agents end between the fixed nodes: a rests at 0, b rests at 4." in told
    assert "Agent 1 ends at 1 (3/4 a + 1/4 b)." in told
    apart = str(dd.describe(between([[1, "a"], [2, 1], [2, "b"]], {"a": 0, "b": 4}, "tanh(y)")))
    assert "Not reached from b: 1." in apart
