"""Lemma 1 and the theorems where agents have different exosystems: known answers, and the whole
Psi."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from certified import certified, consensus_claims
from networks import linked
from oracles.groups import GroupsOracle
from oracles.theorems import negative_definite
from reports import html_report

from dobc_design import Exosystem, Problem, Verdict, certify, simulate, verify
from dobc_design.certification.recheck import expected_checks
from dobc_design.conditions.check import Values
from dobc_design.conditions.consensus.claim import Pair, state_theorems
from dobc_design.conditions.consensus.decide import psi_is_negative
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import verify_lure
from dobc_design.exact.matrix import multiply, scale
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of
from dobc_design.problem.groups import Group, Observer, block_diagonal
from dobc_design.problem.load import read_problem_text

OSCILLATOR, CONSTANT = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]), Exosystem(A=[[0]], C=[[1]])
PRINTED = Observer(W=[["16/5"], ["12/5"]], P=[["1/2", "-1/4"], ["-1/4", "1/3"]])  # S = 9/8
HALF = Observer(W=[[2]], P=[["1/2"]])  # Omega0 = -2 P W = -2, S = 1/2


def grouped(arcs: object, *systems: tuple[Exosystem, Observer], **given: Any) -> Problem:
    """One exosystem and observer for each of the agents 1, 2, ..."""
    parts = enumerate(systems, start=1)
    groups = []
    for i, (exosystem, observer) in parts:
        groups.append(Group(agents=[i], exosystem=exosystem, observer=observer))
    settings = {"gains": 1, "groups": groups} | given
    return linked(arcs, len(groups), **settings)


def two(first: object, second: object, *, swapped: bool = False) -> Problem:
    """Two agents that hear nobody, Lambda = diag(-2 k1, -2 k2)."""
    pairs = [(OSCILLATOR, PRINTED), (CONSTANT, HALF)]
    gains = {1: first, 2: second}
    return grouped([], *(pairs[::-1] if swapped else pairs), gains=gains)


SWINGS = """
target = [0, 0]
[network]
agents = 2
arrow = "listens_to"
[network.modes]
g = [[1, 2], [2, 1]]
[dynamics]
f = ["x2", "-x2"]
B = [[0], [1]]
[coupling]
h = "sin(y1)"
[pinning]
gains = { 1 = [[1, 1]] }
[[exosystem.groups]]
agents = [2]
frequencies = 1
"""


@pytest.mark.parametrize("more", ["", "[[exosystem.groups]]\nagents = [1]\nconstant = true\n"])
def test_a_report_holds_for_dynamics_with_exosystems_of_different_orders_or_none(more: str):
    """B C of the report is block diagonal: one B for each group."""
    problem = read_problem_text((SWINGS + more).encode(), folder=Path())
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, problem).holds
    assert "B C" in html_report(certificate)
    runs = simulate(problem, t_final=1)
    assert not runs.diverged


def test_an_agent_without_a_disturbance_has_no_block_of_s():
    """Closed form: lambda_max = -2 k_i + S_i with S_1 = 9/8 and S_2 = 0, so that any k_2 > 0
    does."""
    group = Group(agents=[1], exosystem=OSCILLATOR, observer=PRINTED)
    just_above = ("0.5626", "1/1000", Verdict.PROVED)
    at_the_bound = ("9/16", "1/1000", Verdict.REFUTED)
    unpinned = ("0.5626", 0, Verdict.REFUTED)
    for first, second, verdict in (
        just_above,
        at_the_bound,
        unpinned,
    ):
        gains = {1: first, 2: second}
        problem = linked([], 2, gains=gains, groups=[group])
        claims = consensus_claims(problem)
        found = {check.id: check.verdict for check in claims.checks}
        assert found["theorem1-printed"] is verdict
        assert verify(claims, problem).holds


def test_psi_has_no_rows_for_an_agent_without_a_disturbance():
    groups = [Group(agents=[1], exosystem=OSCILLATOR, observer=PRINTED)]
    problem = linked([], 2, gains=1, groups=groups)
    (psi,) = state_theorems(loop_of(problem)).psi()
    assert psi.size == 2 + 2


@pytest.mark.parametrize(
    ("first", "second", "swapped", "verdict"),
    [
        # 2 k1 > 9/8 and 2 k2 > 1/2: each agent has its own S
        ("0.5626", "0.2501", False, Verdict.PROVED),
        ("9/16", "0.2501", False, Verdict.REFUTED),
        ("0.5626", "1/4", False, Verdict.REFUTED),
        ("0.5626", "0.2501", True, Verdict.REFUTED),
        ("0.2501", "0.5626", True, Verdict.PROVED),
    ],
)
def test_the_printed_p_of_every_group_has_to_suit_the_gains_of_its_own_agents(
    first, second, swapped, verdict
):
    """Closed form: -2 k_i + S of the group < 0.  One S for all, 9/8, would refuse k2 = 0.2501."""
    problem = two(first, second, swapped=swapped)
    claims = consensus_claims(problem)
    found = {check.id: check.verdict for check in claims.checks}
    assert found["theorem1-printed"] == verdict
    assert found["theorem1"] == Verdict.PROVED
    assert verify(claims, problem).holds


def test_psi_and_s_of_groups_are_those_of_the_whole_matrix():
    problem = two(1, 1, swapped=True)
    theorems = state_theorems(loop_of(problem))
    (pencil,) = theorems.psi(rate=Fraction(1, 3))
    first_Q = ((Fraction(1),),)
    entry = (Fraction(1),)
    second_Q = (entry, (Fraction(0),))
    values = {"P[1]": HALF.P, "Q[1]": first_Q, "P[2]": PRINTED.P, "Q[2]": second_Q}
    P = block_diagonal([HALF.P or (), PRINTED.P or ()])
    Q = block_diagonal([((Fraction(1),),), ((Fraction(1),), (Fraction(0),))])
    filled = {name: value or () for name, value in values.items()}
    own = pencil.at(filled).to_dense()
    found = GroupsOracle(problem).lambda_("G")
    expected = [[-2, 0], [0, -2]]
    assert found == expected
    pair = Pair(P=P, Q=Q)
    assert [list(row) for row in own] == whole_psi(problem, pair, rate=Fraction(1, 3))
    exact = certify(two(1, 1)).check("theorem1-printed").exact
    assert exact["S"] == [["9/8", "0"], ["0", "1/2"]]
    assert "bound" not in exact
    systems = []
    for i, p in ((1, "1/2"), (2, "1/3")):
        systems.append((Exosystem(A=[[-i]], C=[[1]]), Observer(W=[[1]], P=[[p]])))
    # S = 1/(2 (i + 1) p) = 1/2 for both
    exact = certify(grouped([], *systems)).check("theorem1-printed").exact
    assert exact["bound"] == "-1/2"


def whole_psi(problem: Problem, pair: Pair, *, rate: Fraction) -> list[list[Fraction]]:
    """(18), written out entry by entry from the agents' lists in problem.json."""
    both = (pair.P, pair.Q)
    P, Q = ([list(row) for row in M] for M in both)
    return GroupsOracle(problem).psi("G", P, Q, margin=Fraction(0), rate=rate)


@pytest.mark.parametrize("rate", [Fraction(0), Fraction(1, 20)])
def test_psi_of_groups_is_decided_as_the_whole_matrix_is(rate):
    """A directed cycle of three with two groups; the pair crosses the boundary as it is scaled
    up."""
    of_the_oscillator = Observer(W=PRINTED.W)
    outer = Group(agents=[1, 3], exosystem=OSCILLATOR, observer=of_the_oscillator)
    of_the_constant = Observer(W=HALF.W)
    inner = Group(agents=[2], exosystem=CONSTANT, observer=of_the_constant)
    arcs = [[1, 2], [2, 3], [3, 1]]
    gains = {1: 1, 2: "1/3"}
    problem = linked(arcs, gains=gains, groups=[outer, inner])
    P = block_diagonal([PRINTED.P, HALF.P])
    entry = (Fraction(1),)
    second_Q = (entry, (Fraction(0),))
    first_Q = ((Fraction(1),),)
    Q = block_diagonal([second_Q, first_Q])
    exosystem = problem.joint_exosystem
    statements = state_theorems(loop_of(problem))
    outcomes = []
    for factor in (1, 2, 4, 8, 16, 64):
        P_scaled = scale(Fraction(factor), P)
        Q_scaled = scale(Fraction(factor), Q)
        pair = Pair(P=P_scaled, Q=Q_scaled)
        outcomes.append(negative_definite(whole_psi(problem, pair, rate=rate)))
        assert psi_is_negative(statements, exosystem, pair, rate=rate) is outcomes[-1]
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {True, False}


def test_each_group_has_checks_of_its_own_and_the_slowest_gives_the_rate():
    problem = two(5, 5)
    certificate = certify(problem)
    wanted = []
    for group in "12":
        for id in ("observability", "detectability", "hurwitz"):
            wanted.append((id, None, group))
    reached = ("reachability", "G", None)
    lemma = ("lemma1", "G", None)
    wanted += [reached, lemma, ("theorem1-printed", None, None)]
    found = set(expected_checks(loop_of(problem)))
    expected = {*wanted, ("theorem1", None, None)}
    assert found == expected
    more = {("theorem1-weighted", None, None), ("tolerance", None, None)}
    ids = {(c.id, c.mode, c.group) for c in certificate.checks}
    own_checks = expected_checks(loop_of(problem))
    expected_ids = {*own_checks, *more}
    assert ids == expected_ids
    rates = {}
    for check in certificate.checks:
        if check.id == "hurwitz":
            rates[check.group] = check.rate
    assert rates["1"] == pytest.approx(1.6, rel=1e-3)
    assert rates["2"] == pytest.approx(2, rel=1e-3)
    assert certificate.rate < 1.6


def hidden(A: object, C: object, observer: Observer) -> Problem:
    seen = (CONSTANT, Observer(W=[[2]]))
    second = (Exosystem(A=A, C=C), observer)
    return grouped([], seen, second)


def test_a_group_with_an_undetectable_exosystem_refutes_the_theorem_and_leaves_the_rest_open():
    """Decision: Psi < 0 is possible iff Lambda < 0 and every group is detectable."""
    problem = hidden([[0]], [[0]], Observer())
    certificate = certify(problem)
    theorem = certificate.check("theorem1")
    assert theorem.verdict is Verdict.REFUTED
    assert theorem.exact == {"block": "detectability", "group": "2"}
    assert certificate.verdict is Verdict.UNDECIDED
    left = {check.group: check for check in certificate.checks if check.id == "hurwitz"}
    assert "the group of agent 2 has no gain W" in left["1"].reason
    assert verify(certificate, problem).holds
    slower = hidden([[-1]], [[0]], Observer())  # the same, but what is hidden dies out
    assert certify(slower).verdict is Verdict.PROVED


@pytest.mark.parametrize("name", ["W", "P"])
def test_a_matrix_with_an_entry_between_two_groups_is_refused(name):
    problem = hidden([[0]], [[1]], Observer())
    certificate = certify(problem)
    first, *rest = getattr(certificate.claims, name)
    wrong = Fraction(1, 10**9)
    first_row = (first[0], wrong)
    changed = (first_row, *rest)
    forged = replace(certificate.claims, **{name: changed})
    assert not verify(forged, problem).holds


def test_a_region_is_proved_with_the_observers_of_all_groups():
    """Max-separable; its twin has kappa = 1/(beta min v), with which the observer error could raise
    V."""

    def region(disturbance: object) -> Problem:
        first = (CONSTANT, Observer(W=[[3]]))
        second = (OSCILLATOR, Observer(W=PRINTED.W))
        systems = first, second
        region = {"initial_states": [-1, 1], "initial_disturbance": disturbance}
        arcs = [[1, 2], [2, 1]]
        return grouped(arcs, *systems, coupling="exp(y) - 1 + y", gains=2, region=region)

    problem = region("0.5")
    certificate = certify(problem)
    assert certificate.covered_by == "max-separable"
    assert verify(certificate, problem).holds
    claim = dict(certificate.check("max-separable").exact)
    smallest = min(map(Fraction, claim["v"]))
    largest = Fraction(claim["beta"]) * smallest
    kappa = str(1 / largest)
    claim_with_kappa = Values(claim | {"kappa": kappa})
    weaker = replace(certificate.check("max-separable"), claim=claim_with_kappa)
    checks = tuple(weaker if check.id == weaker.id else check for check in certificate.checks)
    assert not verify(replace(certificate.claims, checks=checks), problem).holds


def test_a_quadratic_certificate_takes_s_of_every_agents_own_group():
    """P_e = I and -2 k_i + S of the group < 0, with S = 9/8 and 1/2; twin: the groups change
    places."""
    P = block_diagonal([PRINTED.P, HALF.P])
    for swapped, verdict in ((False, Verdict.PROVED), (True, Verdict.REFUTED)):
        problem = two("0.5626", "0.2501", swapped=swapped)
        own = block_diagonal([HALF.P, PRINTED.P]) if swapped else P
        ones = {(0, 0): Fraction(1), (1, 1): Fraction(1)}
        one = SparseSymmetric(2, ones)
        Q = multiply(own, problem.joint_observer.W)
        lure = Lure(P_e=one, ranges=(), radius=None, level=None, multipliers={"G": ()}, P=own, Q=Q)
        assert verify_lure(loop_of(problem), lure).verdict is verdict
    certificate = certified(two(1, 1), everything=True)
    assert certificate.check("lure").verdict is Verdict.PROVED
    assert verify(certificate, two(1, 1)).holds


@pytest.mark.slow
def test_a_faster_quadratic_certificate_is_looked_for_beside_an_agent_without_a_disturbance():
    group = Group(agents=("2",), exosystem=Exosystem(A=[[0]], C=[[1]]), observer=Observer(W=[[8]]))
    region = {"initial_states": ["-1/5", "1/5"], "initial_disturbance": "1/10"}
    problem = linked([[2, 1]], 2, gains={1: 1, 2: 1}, groups=[group], region=region)
    check = certify(problem, everything=True).check("lure")
    assert check.is_proved
    assert check.rate is not None
