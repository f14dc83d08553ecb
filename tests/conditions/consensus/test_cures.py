"""Proposals of gains as people type them, and which agents to pin: symmetric networks, closed
groups, every subset."""

from fractions import Fraction
from itertools import permutations
from random import Random

import numpy as np
import pytest
from networks import linked
from oracles.theorems import Oracle
from texts import exact_matrix, vector

from dobc_design.conditions.consensus import cures
from dobc_design.conditions.consensus.cures import best_single, rounded_up, scale_needed
from dobc_design.conditions.consensus.pinning import network_blocks, smallest_gains
from dobc_design.loop.make import loop_of


def blocks_of(arcs, n=None, *, weighted=False, **more):
    loop = loop_of(linked(arcs, n, **more))
    return network_blocks(loop, weighted=weighted)


def proposed(blocks, agents) -> list[cures.PinProposal]:
    proposal = cures.PinProposal(gains={})
    return list(cures.gains_on(blocks, agents, proposal))


def test_gains_are_rounded_up_to_two_digits_or_three_and_never_by_two_percent():
    values = vector("0.99 1.001 0.2609 9.99 1234 2.5e-7 3.01e20 1e-300")
    typed = vector("0.99 1.01 0.261 10 1240 2.5e-7 3.01e20 1e-300")
    for value, shown in zip(values, typed, strict=True):
        assert rounded_up(Fraction(value)) == Fraction(shown)
    for k in range(1, 2000):
        exact = Fraction(k, 777)
        assert exact <= rounded_up(exact) <= exact * Fraction(102, 100)


def test_a_proposal_is_rounded_after_it_is_raised():
    gains = {3: 1.0, 1: 0.0, 2: 0.5}
    proposal = cures.PinProposal(gains=gains)
    expected = {2: Fraction("0.56"), 3: Fraction("1.11")}
    assert proposal.rounded(factor=1.1) == expected


def test_the_last_proposal_pins_everybody_and_always_does(monkeypatch):
    """Gershgorin: whatever the couplings are; the proposals before it are not looked at."""
    before = cures.gains_on
    monkeypatch.setattr(cures, "gains_on", lambda *arguments: iter(()))
    for h in ("y", "-y", "y**3", ["y1 - 3*y2", "y2 + y1"]):
        arcs = [[1, 2], [2, 3], [3, 1]]
        problem = linked(arcs, coupling=h)
        last = list(cures.several_more(loop_of(problem)))[-1]
        assert set(last.gains) == {0, 1, 2}
        matrix = np.array(Oracle(problem).lambda_("G"), dtype=float)
        held = np.repeat([last.gains[i] for i in range(3)], problem.m)
        found = np.linalg.eigvalsh(matrix - 2 * np.diag(held))
        assert found[-1] < 0
    # without pins there is nothing on the present ones
    monkeypatch.setattr(cures, "gains_on", before)
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs)
    assert list(cures.on_present_pins(loop_of(problem))) == []
    found = [proposal.added for proposal in cures.one_more(loop_of(problem))]
    assert found == [(0,)]


def test_gains_for_a_faster_decay_are_not_larger_than_the_couplings():
    """A cycle held at one agent, slope 1: k = b + (1 - b)^-(n - 1) - 1 up to b = 1; 1/2 is halved
    until k <= 2."""
    for n, b in ((4, 0.25), (6, 0.125)):
        cycle = [[i, i % n + 1] for i in range(1, n + 1)]
        blocks = blocks_of(cycle, n, weighted=True)
        (found,) = proposed(blocks, [0])
        k = b + (1 - b) ** (1 - n) - 1
        larger = 2 * b + (1 - 2 * b) ** (1 - n) - 1
        assert k < blocks.scale == 2 < larger
        assert found.gains == pytest.approx({0: k} | dict.fromkeys(range(1, n), 0), rel=1e-6)
        assert found.rate == pytest.approx(b, rel=0.05)
        assert found.rate < b
        # any rate can be had
        (every,) = proposed(blocks, range(n))
        assert every.gains == pytest.approx(dict.fromkeys(range(n), 1 / 4))
    # repelling: without gains it is not even stable
    arcs = [[1, 2], [2, 1]]
    least, faster = proposed(blocks_of(arcs, coupling="-y"), [0, 1])
    assert least.smallest
    assert least.gains == pytest.approx({0: 2, 1: 2})
    assert not faster.smallest
    assert min(faster.gains.values()) > 2.1


def test_without_couplings_near_the_target_gains_are_those_for_half_a_rate_that_any_gain_has():
    """Slope 0: each agent decays at its own k. There is no size of couplings to stay below."""
    cases = (([], "y"), ([[1, 2], [2, 1]], "y**3"))
    for arcs, h in cases:
        blocks = blocks_of(arcs, 2, coupling=h, weighted=True)
        assert blocks.scale == 0
        (found,) = proposed(blocks, [0, 1])
        assert found.gains == pytest.approx({0: 1, 1: 1})
        assert 0.98 < found.rate < 1
    # agent 2 is not held
    assert proposed(blocks, [0]) == []


def test_the_factor_for_a_pair_is_where_lambda_plus_the_border_becomes_singular():
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling=["y1 + y2", "y2"], gains=2)
    S = exact_matrix("2 1; 1 5")
    factor = scale_needed(loop_of(problem), S)
    matrix = np.array(Oracle(problem).lambda_("G"), dtype=float)
    border = np.kron(np.eye(2), np.array(S, dtype=float))
    above = matrix + border / (factor * 1.0001)
    below = matrix + border / (factor * 0.9999)
    assert np.linalg.eigvalsh(above)[-1] < 0 < np.linalg.eigvalsh(below)[-1]
    arcs = [[1, 2], [2, 1]]
    free = linked(arcs, target=[0, 0])
    assert scale_needed(loop_of(free), S) is None


@pytest.mark.parametrize("seed", range(12))
def test_the_best_single_agent_is_the_best_of_all_that_were_tried_by_hand(seed):
    r = Random(seed)
    n = r.randint(3, 7)
    arcs = []
    for i, j in permutations(range(1, n + 1), 2):
        if r.random() < 0.5:
            arcs.append([i, j, r.randint(1, 4)])
    loop = loop_of(linked(arcs, n))
    blocks = network_blocks(loop)
    able = {}
    for agent in range(n):
        gains = smallest_gains(blocks, [agent])
        if gains is not None:
            able[agent] = float(sum(gains))
    found = best_single(blocks, loop)
    assert bool(found) is bool(able)
    if found:
        assert able[found[0]] == pytest.approx(min(able.values()), rel=1e-5, abs=1e-8)
