"""The slopes dh/de at the consensus (11), against SymPy's derivatives."""

from __future__ import annotations

from fractions import Fraction

import pytest
from exact_oracle import key, slope
from random_problems import CURVED, IRRATIONAL, LINEAR, PLANE_CURVED, PLANE_LINEAR, SPACE_LINEAR

from dobc_design.conditions.consensus.claim import jacobians_at_consensus, state_theorems
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem

EVERY = [(h, 1) for h in (*LINEAR, *CURVED, *IRRATIONAL)]
EVERY += [(h, 2) for h in (*PLANE_LINEAR, *PLANE_CURVED, *CURVED)] + [(h, 3) for h in (*SPACE_LINEAR, *IRRATIONAL)]


def one_arc(h, m, weight=1):
    network = Network.from_arcs([[1, 2, weight]], arrow="listens_to")
    return Problem(network=network, coupling=h, target=[0] * m)


@pytest.mark.parametrize(("h", "m"), EVERY)
def test_slopes_enclose_the_derivative_and_are_points_where_it_is_rational(h, m):
    """h'(0) times the weight; SymPy's value to 80 digits lies inside, the width is below 2^-100."""
    weight = Fraction(7, 5)
    jacobians = jacobians_at_consensus(one_arc(h, m, weight))
    expected, linear, rational = slope(key(h), m)
    (gain,) = jacobians.modes[0].gains
    for c in range(m):
        for d in range(m):
            entry = gain[c][d]
            true = weight * expected[c][d]
            assert entry.lo - Fraction(1, 10**70) <= true <= entry.hi + Fraction(1, 10**70)
            assert entry.width < Fraction(1, 2**100)
    assert jacobians.modes[0].is_point is rational
    assert jacobians.domain == ("global" if linear else "consensus")


def test_only_exactly_linear_couplings_are_global():
    """One nonlinear exception among linear arcs makes the statement local."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    linear = Problem(network=network, coupling="y*exp(1)", exceptions={(0, 1): "pi*y"})
    curved = Problem(network=network, coupling="y", exceptions={(0, 1): "y + y**3/1000000"})
    hidden = Problem(network=network, coupling="y + y**2 - y**2")
    assert state_theorems(linear).domain == "global"
    assert state_theorems(curved).domain == "consensus"
    assert state_theorems(hidden).domain == "consensus"  # linear, but not recognised: the safe side


def test_arcs_that_are_alike_share_a_gain_and_exceptions_have_their_own():
    network = Network.from_arcs({"A": [[1, 2], [2, 3], [3, 1, 2]], "B": [[1, 2]]}, arrow="listens_to")
    problem = Problem(network=network, coupling="2*y", exceptions={(0, 1): "3*y"})
    first, second = jacobians_at_consensus(problem).modes
    assert [first.gains[kind][0][0].lo for kind in first.kind] == [3, 2, 4]
    assert [second.gains[kind][0][0].lo for kind in second.kind] == [3]


@pytest.mark.parametrize("h", ["abs(y)", "min(y, 2*y)", "max(y, 0)", "clip(y, -1, 1)"])
def test_couplings_with_kinks_are_outside_the_theorems(h):
    """Lemma 1 asks for a continuously differentiable h (deviations, 9)."""
    statements = state_theorems(one_arc(h, 1))
    assert statements.inapplicable.startswith("does not apply:")
    assert not statements.lambdas
    assert statements.domain == "consensus"


def test_one_exception_with_a_kink_is_enough():
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to")
    problem = Problem(network=network, coupling="y", exceptions={(0, 1): "abs(y)"})
    assert state_theorems(problem).inapplicable is not None


@pytest.mark.parametrize(
    ("h", "m", "answer"),
    [("y", 1, True), ("y**3", 1, True), ("-y", 1, False), ("sin(pi*y)", 2, True), (["y1 + y2", "y2"], 2, False)],
)
def test_nonnegative_diagonal_slopes_are_recognised(h, m, answer):
    assert jacobians_at_consensus(one_arc(h, m)).modes[0].is_nonnegative_diagonal is answer
