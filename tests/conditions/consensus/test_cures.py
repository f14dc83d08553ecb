"""Proposals of gains as people type them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from exact_oracle import Oracle

from dobc_design.conditions.consensus.cures import (
    PinProposal,
    on_present_pins,
    one_more,
    rounded_up,
    scale_needed,
    several_more,
)
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


@pytest.mark.parametrize(
    ("value", "typed"),
    [
        ("0.99", "0.99"),
        ("1.001", "1.01"),
        ("0.2609", "0.261"),
        ("9.99", "10"),
        ("1234", "1240"),
        ("2.5e-7", "2.5e-7"),
        ("3.01e20", "3.01e20"),
        ("1e-300", "1e-300"),
    ],
)
def test_gains_are_rounded_up_to_two_digits_or_three(value, typed):
    assert rounded_up(Fraction(value)) == Fraction(typed)


def test_rounding_never_asks_for_two_percent_more_and_never_for_less():
    for k in range(1, 2000):
        exact = Fraction(k, 777)
        assert exact <= rounded_up(exact) <= exact * Fraction(102, 100)


def test_a_proposal_is_rounded_after_it_is_raised():
    proposal = PinProposal(gains={3: 1.0, 1: 0.0, 2: 0.5})
    assert proposal.rounded(factor=1.1) == {2: Fraction("0.56"), 3: Fraction("1.11")}


def test_the_last_proposal_pins_everybody_and_always_does():
    """Gershgorin: whatever the couplings are."""
    network = Network.from_arcs([[1, 2], [2, 3], [3, 1]], arrow="listens_to")
    for h in ("y", "-y", "y**3", ["y1 - 3*y2", "y2 + y1"]):
        problem = Problem(network=network, coupling=h, target=0 if isinstance(h, str) else [0, 0])
        last = list(several_more(problem))[-1]
        assert set(last.gains) == {0, 1, 2}
        matrix = np.array(Oracle(problem).lambda_("G"), dtype=float)
        held = np.repeat([last.gains[i] for i in range(3)], problem.m)
        assert np.linalg.eigvalsh(matrix - 2 * np.diag(held))[-1] < 0


def test_without_pins_there_is_nothing_on_the_present_ones():
    problem = Problem(network=Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"), coupling="y")
    assert list(on_present_pins(problem)) == []
    assert [proposal.added for proposal in one_more(problem)] == [(0,)]


def test_the_factor_for_a_pair_is_where_lambda_plus_the_border_becomes_singular():
    problem = Problem(
        network=Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling=["y1 + y2", "y2"],
        target=[0, 0],
        gains=2,
    )
    S = ((Fraction(2), Fraction(1)), (Fraction(1), Fraction(5)))
    factor = scale_needed(problem, S)
    matrix = np.array(Oracle(problem).lambda_("G"), dtype=float)
    border = np.kron(np.eye(2), np.array(S, dtype=float))
    assert np.linalg.eigvalsh(matrix + border / (factor * 1.0001))[-1] < 0
    assert np.linalg.eigvalsh(matrix + border / (factor * 0.9999))[-1] > 0
    loose = Problem(network=problem.network, coupling="y", target=[0, 0])
    assert scale_needed(loose, S) is None
