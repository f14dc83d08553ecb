"""Who carries a direction that is not held, in labels and in words; every vector multiplied out by the oracle."""

from __future__ import annotations

from fractions import Fraction

import pytest
from exact_oracle import Oracle, form

from dobc_design.certification.certify import certify
from dobc_design.conditions.check import Check, Fix, main_cure, main_fix, other_cures
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import carriers, group_directions, unpinned_witness
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


def problem_of(arcs, **changes):
    given = {"network": Network.from_arcs(arcs, arrow="listens_to"), "coupling": "y"}
    return Problem(**given | changes)


def lemma_of(problem):
    return certify(problem).check("lemma1")


def test_of_unreached_agents_those_are_shown_that_suffice_and_all_are_named():
    """4 hears 5 hears 6 hears nobody: moving 6 alone is enough."""
    problem = problem_of([[2, 1], [3, 2], [4, 5], [5, 6]], gains={1: 5})
    lemma = lemma_of(problem)
    assert lemma.reason.startswith("agents 4, 5 and 6 hear no pinned agent, so nothing holds them:")
    assert lemma.witness.labels == ("6",)
    assert lemma.witness.values == ("0", "0", "0", "0", "0", "1")


def test_a_slow_direction_is_told_by_those_who_carry_it():
    """3 hears 7 four times, 7 hears 3 once: (1, 1) has J + J' = [[-8, 5], [5, -2]], not negative along it."""
    problem = problem_of([[1, 3], [3, 7, 4], [7, 3], [3, 1], [7, 1, "1/100"]], gains={1: 100})
    lemma = lemma_of(problem)
    assert lemma.witness.labels == ("3", "7")
    assert "the slowest direction is carried by agents 3 and 7" in lemma.reason
    assert "No gain on the present pins changes that." in lemma.reason
    v = [Fraction(x) for x in lemma.witness.values]
    assert form(Oracle(problem).lambda_("G"), v) >= 0
    assert all(x.denominator == 1 and abs(x) <= 9 for x in v)


def test_a_direction_that_gains_leave_free_is_that_of_the_group():
    problem = problem_of([[1, 2], [2, 1]], target=[0, 0], gains={1: [[0, 0], [0, 1]]})
    (direction,) = group_directions(problem, problem.network.modes["G"])
    assert direction == [1, 0, 1, 0]
    assert lemma_of(problem).witness.values == ("1", "0", "1", "0")
    assert group_directions(problem_of([[1, 2], [2, 1]], gains={1: 1}), problem.network.modes["G"]) == []


def test_that_no_gains_on_the_present_pins_can_do_is_shown_by_agents_without_a_pin():
    problem = problem_of([[1, 2], [2, 3]], gains={1: 5})
    matrices = {"G": enclosed_lambda(state_theorems(problem), "G")}
    mode, vector = unpinned_witness(problem, matrices, {})
    assert (mode, carriers(problem, vector)) == ("G", ("3",))
    assert form(Oracle(problem).lambda_("G"), list(vector)) >= 0


def test_where_larger_gains_do_there_is_no_such_witness():
    """1 hears 2 with weight 3: Lambda = [[-6, 3], [3, -1]] fails, but k_2 > 3/4 does."""
    problem = problem_of([[1, 2, 3]], gains={2: "1/2"})
    matrices = {"G": enclosed_lambda(state_theorems(problem), "G")}
    assert unpinned_witness(problem, matrices, {"G": [[1.0, 2.0]]}) is None
    assert lemma_of(problem).witness.labels == ("1", "2")


def check(id, verdict=Verdict.REFUTED, **changes):
    fix = Fix(kind="pinning", set=changes, text=id) if changes else None
    return Check(id=id, verdict=verdict, domain="global", reason="", fix=fix)


def test_the_main_cure_is_that_of_the_theorem_and_parts_of_it_are_not_told_again():
    small, whole = check("lemma1", a=1), check("theorem1", a=1, b=2)
    other = check("observability", c=3)
    checks = [check("hurwitz"), other, small, whole]
    assert main_cure(checks) is whole
    assert main_fix(checks) is whole.fix
    assert other_cures(checks) == [other]


@pytest.mark.parametrize("checks", [[], [check("theorem1")], [check("observability", a=1)]])
def test_without_a_cure_of_what_is_asked_there_is_no_main_one(checks):
    assert main_fix(checks) is None
