"""Observability, detectability and the observer error, decided; rates at their edge."""

import math
from fractions import Fraction
from functools import cache
from itertools import islice

import sympy as sp
from networks import linked
from oracles.theorems import Oracle, hurwitz
from random_problems import random_problem
from texts import exact_matrix, exosystem_of, matrix

from dobc_design import Exosystem, Observer, Verdict
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.observer.decide import (
    detectability_check,
    hurwitz_check,
    hurwitz_with_rate,
    observability_check,
    observable_part_decays,
)
from dobc_design.loop.make import loop_of

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


@cache
def problems():
    """The first random problems with an exosystem."""
    drawn = (random_problem(seed) for seed in range(1000, 1400))
    return list(islice((problem for problem in drawn if problem.exosystem is not None), 25))


def test_verdicts_agree_with_sympy_and_lyapunov():
    seen = set()
    for problem in problems():
        oracle = Oracle(problem)
        exosystem = problem.exosystem
        observable = oracle.hidden().rows == 0
        detectable = oracle.detectable()
        assert observability_check(exosystem).verdict is (PROVED if observable else REFUTED)
        assert detectability_check(exosystem).verdict is (PROVED if detectable else REFUTED)
        seen.add((observable, detectable))
        if problem.observer.W is not None:
            W = [list(row) for row in problem.observer.W]
            decays = hurwitz(oracle.error(W))
            found = hurwitz_check(exosystem, problem.observer.W)
            assert found.verdict is (PROVED if decays else REFUTED)
            found = observable_part_decays(exosystem, problem.observer.W, None)
            assert found is oracle.seen_error_decays(W)
    expected = {(True, True), (False, True), (False, False)}
    assert seen == expected


def test_the_suggested_reduction_generates_the_same_disturbances():
    """C_o A_o^k T = C A^k for every k: the fix of an unobservable pair loses nothing that acts."""
    count = 0
    for problem in problems():
        check = observability_check(problem.exosystem)
        if check.verdict is PROVED or check.fix.set == {"exosystem": None}:
            continue
        count += 1
        given = (problem.exosystem.A, problem.exosystem.C)
        suggested = (check.fix.set["exosystem.A"], check.fix.set["exosystem.C"])
        matrices = (*given, *suggested)
        A, C, A_o, C_o = (
            sp.Matrix([[sp.Rational(str(x)) for x in row] for row in M]) for M in matrices
        )
        seen = sp.Matrix.vstack(*(C * A**k for k in range(A.rows)))
        kept = sp.Matrix.vstack(*(C_o * A_o**k for k in range(A.rows)))
        assert kept.rank() == A_o.rows == seen.rank()
        found = sp.Matrix.hstack(seen, kept).rank()
        assert found == seen.rank()  # one T turns kept into seen
    assert count >= 3


def test_the_reduction_keeps_what_the_problem_says_of_states():
    """W becomes T W, so that W = I shows T; |T eps| <= |T| |eps|, to six decimals."""
    A = [[0] * 3] * 3
    exosystem = Exosystem(A=A, C=matrix("3 4 0; 1 0 0"))
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/10"}
    given = {"exosystem": exosystem, "target": [0, 0], "region": region}
    columns = []
    for k in (0, 1):
        W = []
        for row in range(3):
            W.append([int(row == column == k) for column in range(2)])
        arcs = [[1, 2]]
        loop = loop_of(linked(arcs, observer=Observer(W=W), **given))
        change = observability_check(exosystem, loop).fix.set
        columns.append([Fraction(str(row[k])) for row in change["observer.W"]])
    # T does not see the third state
    size = math.sqrt(sum(x * x for column in columns for x in column))
    bound = float(change["region.initial_disturbance"])
    assert size / 10 <= bound <= size / 10 + 1e-6
    unseen = exosystem_of("0", "0; 0")
    for own in (given["region"], None):
        settings = given | {"exosystem": unseen, "region": own}
        problem = linked([[1, 2]], **settings)
        change = observability_check(unseen, loop_of(problem)).fix.set
        assert ("region.initial_disturbance" in change) is (own is not None)


def test_rates_are_strict_at_the_edge():
    """A - WC = -2: every rate below 2 holds, 2 does not (an eigenvalue lies on the line)."""
    error = exact_matrix("-2")
    rate = Fraction(2) - Fraction(1, 10**30)
    assert hurwitz_with_rate(error, rate)
    assert not hurwitz_with_rate(error, Fraction(2))
    check = hurwitz_check(exosystem_of("-2", "0"), exact_matrix("0"), estimate=2.5)
    assert 0 < check.rate < 2
    found = hurwitz_check(exosystem_of("-2", "0"), exact_matrix("0"), estimate=2.0)
    assert found.rate > 1.99999


def test_a_defective_error_on_the_axis_is_refuted():
    """Double integrator with W = 0; and a rotation, where NumPy's real parts are rounding
    errors."""
    double_integrator = [[0, 1], [0, 0]]
    oscillator = [[0, 1], [-1, 0]]
    cases = (double_integrator, oscillator)
    for A in cases:
        exosystem = Exosystem(A=A, C=matrix("1 0"))
        check = hurwitz_check(exosystem, exact_matrix("0; 0"))
        assert check.verdict is REFUTED
        assert check.fix.set == {"observer.W": None}


def test_without_a_gain_it_says_whether_one_exists():
    hidden, free = (hurwitz_check(Exosystem(A=[[0]], C=[[c]]), None) for c in (0, 1))
    assert "none exists" in hidden.reason
    assert hidden.fix.set == {"exosystem": None}
    assert "none was found" in free.reason
    assert free.fix is None


def test_agents_are_named_in_words():
    assert name_agents(["4"]) == "agent 4"
    assert name_agents(["4", "5", "6"]) == "agents 4, 5 and 6"
    labels = [str(i) for i in range(20)]
    assert name_agents(labels).endswith("and 12 more")
