"""Joint connectivity, after published examples: no graph reaches every agent, their union over a
period does.

The theorems are theirs, the numbers are ours, because theirs are not quoted: chains, weights and
gains of 1, 1 s each.
"""

import numpy as np
import pytest
from scipy.linalg import expm

from dobc_design import Network, Problem, Switching, Verdict, certify

#: Jadbabaie, Lin and Morse 2003, followers that are jointly linked to a leader: undirected links of
#: a chain, in two halves.  Ren and Beard 2005, a spanning tree in the union only: a chain of
#: directed arcs, one at a time.
EXAMPLES = {
    "leader": (3, {"A": [(2, 1)], "B": [(3, 2)]}, True),
    "long leader": (6, {"A": [(2, 1), (4, 3), (6, 5)], "B": [(3, 2), (5, 4)]}, True),
    "spanning tree": (5, {"A": [(2, 1)], "B": [(3, 2)], "C": [(4, 3)], "D": [(5, 4)]}, False),
}


def example(name: str) -> tuple[int, dict[str, list[tuple[int, int]]]]:
    n, modes, undirected = EXAMPLES[name]
    return n, {mode: arcs + [(j, i) for i, j in arcs] * undirected for mode, arcs in modes.items()}


def stated(name: str, sequence: list[str]) -> Problem:
    n, modes = example(name)
    network = Network.from_arcs(modes, arrow="listens_to", agents=n)
    turns = Switching(guarantee="sequence", sequence=sequence, dwell=1)
    return Problem(network=network, coupling="y", gains={1: 1}, switching=turns)


def true_rate(name: str) -> float:
    """1/s, by the exact flow over a period: agent 1 hears the leader all the time."""
    n, modes = example(name)
    flow = np.eye(n)
    for arcs in modes.values():
        unpinned = [0.0] * (n - 1)
        diagonal = [-1.0, *unpinned]
        M = np.diag(diagonal)
        for i, j in arcs:
            M[i - 1, j - 1] += 1
            M[i - 1, i - 1] -= 1
        flow = expm(M) @ flow
    sizes = np.abs(np.linalg.eigvals(flow))
    growth = float(np.log(sizes.max()))
    return -growth / len(modes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rate", "least"), [("leader", 0.12007, 0.6), ("spanning tree", 0.25, 0.9)]
)
def test_what_is_jointly_connected_is_proved_with_a_rate(name: str, rate: float, least: float):
    modes = list(EXAMPLES[name][1])
    found = certify(stated(name, modes))
    assert found.verdict is Verdict.PROVED
    assert found.claims.covered_by == "schedule"
    assert true_rate(name) == pytest.approx(rate, rel=1e-4)
    assert least * rate <= float(found.rate) <= true_rate(name)


@pytest.mark.slow
def test_a_long_chain_of_followers_is_proved_by_its_graphs_alone():
    """Its true rate is 0.028 1/s, far slower than the agents within a phase; no weights are
    found."""
    never_all = stated("long leader", ["A", "B"])
    assert certify(never_all).verdict is Verdict.PROVED
    assert true_rate("long leader") == pytest.approx(0.028081, rel=1e-4)


@pytest.mark.parametrize("name", EXAMPLES)
def test_with_a_graph_left_out_the_rest_is_refuted(name: str):
    all_but_one = sorted(EXAMPLES[name][1])[:-1]
    certificate = certify(stated(name, all_but_one))
    assert certificate.verdict is Verdict.REFUTED
