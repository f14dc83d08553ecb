"""Gains for the true local rate (V = e'De): closed forms, eigenvalues, exhaustive search, against V
= e'e."""

from fractions import Fraction
from itertools import combinations
from random import Random

import numpy as np
import pytest
from networks import digraph, linear_rate, linked, loop_by_hand, ring

import dobc_design as dd
from dobc_design import Network, Problem, Verdict
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.pinning import for_rate, network_blocks, smallest_gains
from dobc_design.conditions.weighted.decide import network_holds
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of


def by_index(design):
    index = design.problem.network.index
    return {index[label]: float(k) for label, k in design.gains.items()}


@pytest.mark.parametrize("beta", ["0.1", "0.185974", "1"])
def test_one_pin_of_the_ten_ring_takes_the_gain_of_the_characteristic_polynomial(beta):
    """Slope 2: (2 + k - beta) (2 - beta)^9 = 2^10; k = 3 gives 0.185974."""
    problem = ring(10, coupling="2*tanh(y)")
    design = dd.design_pinning(problem, rate=beta, allowed=["1"])
    closed = 2**10 / (2 - float(beta)) ** 9 - 2 + float(beta)
    assert design.verdict == Verdict.PROVED
    assert design.method == "weighted"
    assert design.lower_bound is None
    assert float(design.gains["1"]) == pytest.approx(closed, rel=2e-3)
    assert design.gains["1"] >= closed
    assert "the true local rate" in design.reason


def test_a_chain_decays_at_the_gain_of_its_head_and_at_no_more_than_2():
    arcs = [[i + 1, i] for i in range(1, 5)]
    chain = linked(arcs, 5, "2*y")
    held = dd.design_pinning(chain, rate="1.99", pins="fewest")
    found = {label: float(k) for label, k in held.gains.items()}
    assert found == pytest.approx({"1": 1.99}, rel=3e-2)
    assert any("No fewer than 1" in each.text for each in held.statements)
    plain = dd.design_pinning(chain, rate="1.99", allowed=["1"], conservative=True)
    assert plain.verdict is Verdict.REFUTED
    found = dd.design_pinning(chain, rate="2.01", allowed=["1"])
    assert found.verdict is Verdict.REFUTED


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 10])  # 1 and, by the plain V, 10 are refuted
def test_gains_reach_the_rate_tightly_and_cost_no_more_than_for_the_plain_v(seed):
    r = Random(seed)
    problem = digraph(r, r.randint(3, 8), cycle=seed % 2 == 0)
    drawn = r.sample(problem.network.labels, r.randint(2, problem.n))
    allowed = sorted(drawn)
    design, plain = (
        dd.design_pinning(problem, rate="1/10", allowed=allowed, digits=8, conservative=which)
        for which in (False, True)
    )
    assert plain.cost is None or design.cost <= plain.cost * (1 + Fraction(1, 10**6))
    if design.verdict is not Verdict.PROVED:
        return
    assert set(design.gains) <= set(allowed)
    gains = by_index(design)
    assert 0.1 <= linear_rate(problem, gains) < 0.1001
    less = {i: k * 0.999 for i, k in gains.items()}
    assert linear_rate(problem, less) < 0.1
    statements = state_theorems(loop_of(design.problem))
    assert network_holds(design.weights, statements, rate=Fraction(1, 10))
    assert not network_holds(design.weights, statements, rate=Fraction(1002, 10000))


@pytest.mark.parametrize("seed", range(6))
def test_at_the_optimum_every_pin_raises_the_rate_alike(seed):
    """With a cycle M is irreducible: u_i w_i of the Perron vectors is the same on pinned agents,
    and less elsewhere."""
    problem = digraph(Random(seed), 6)
    design = dd.design_pinning(problem, rate="3/10", digits=12)
    gains = by_index(design)
    diagonal = [gains.get(i, 0.0) for i in range(6)]
    M = -loop_by_hand(problem) + np.diag(diagonal)
    gradient = np.ones(6)
    for matrix in (M, M.T):
        values, vectors = np.linalg.eig(matrix)
        gradient *= np.abs(vectors[:, np.argmin(values.real)])
    pinned = gradient[list(gains)]
    expected = np.full(len(gains), pinned[0])
    assert pinned == pytest.approx(expected, rel=1e-3)
    assert np.all(gradient <= pinned[0] * 1.001)


@pytest.mark.parametrize("seed", [1, 2, 6])  # 1 is refuted
def test_the_chosen_agents_are_as_cheap_as_those_of_exhaustive_search(seed):
    r = Random(seed)
    problem = digraph(r, r.randint(4, 8), density=0.2, cycle=False)
    pins = r.randint(1, 3)
    design = dd.design_pinning(problem, rate="1/5", pins=pins, digits=9)
    blocks = for_rate(network_blocks(loop_of(problem), weighted=True), 0.2)
    costs = []
    for F in combinations(range(problem.n), pins):
        if (k := smallest_gains(blocks, F)) is not None:
            costs.append(float(k.sum()))
    if costs:
        assert float(design.cost) == pytest.approx(min(costs), rel=1e-4)
    else:
        assert design.verdict is Verdict.REFUTED
        sets = combinations(range(problem.n), pins)
        assert all(linear_rate(problem, dict.fromkeys(F, 1e9)) < 0.2 for F in sets)


def test_several_modes_share_weights_or_fall_back_to_the_plain_v():
    r = Random(3)
    modes = {name: digraph(r, 5).network.modes["G"] for name in ("A", "B")}
    network = Network(labels=tuple("12345"), modes=modes)
    problem = Problem(network=network, coupling="y")
    design, plain = (
        dd.design_pinning(problem, rate="1/5", conservative=which) for which in (False, True)
    )
    assert design.verdict is Verdict.PROVED
    assert design.method == "weighted"
    assert design.cost < plain.cost
    D = np.diag([float(x) for x in design.weights.D])
    for mode in modes:
        diagonal = [by_index(design).get(i, 0.0) for i in range(5)]
        M = -loop_by_hand(problem, mode) + np.diag(diagonal)
        N = D @ (M - 0.2 * np.eye(5))
        found = np.linalg.eigvalsh(N + N.T).min()
        assert found > 0
    # each hears the other in one of two modes: by symmetry weights do not help
    arcs = {"A": [[1, 2, 3]], "B": [[2, 1, 3]]}
    crossed = linked(arcs, 2)
    fallback = dd.design_pinning(crossed, rate="1/5")
    assert fallback.verdict == Verdict.PROVED
    assert fallback.method == "consensus"
    assert fallback.lower_bound is None
    assert fallback.reason.endswith("by V = e'e.")


def test_an_undirected_network_keeps_the_bound_of_the_plain_v_which_has_the_true_rate():
    arcs = [[1, 2], [2, 1], [2, 3], [3, 2]]
    path = linked(arcs, 3)
    design = dd.design_pinning(path, rate="1/10", pins=1)
    assert design.method == "consensus"
    assert design.lower_bound is not None
    found = linear_rate(path, by_index(design))
    assert found == pytest.approx(0.1, rel=1e-3)


def test_conservative_must_be_true_or_false():
    with pytest.raises(SpecError, match="conservative must be true or false; got 'yes'"):
        dd.design_pinning(ring(3), rate=1, conservative="yes")
