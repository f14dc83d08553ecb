"""Pairs (P, Q = P W): readable ones first, and a ladder at the end that cannot fail."""

from __future__ import annotations

import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from certified import certified
from scipy import linalg

import dobc_design as dd
from dobc_design.conditions.observer import pair as pair_module
from dobc_design.conditions.observer.gain import design_gain
from dobc_design.conditions.observer.pair import lyapunov, propose_pairs
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import add, identity, is_symmetric, multiply, scale, to_float, transpose
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.exosystems import Exosystem
from dobc_design.verdict import Verdict

PAPER_GAIN = ((Fraction(16, 5),), (Fraction(12, 5),))


def random_matrix(seed: int):
    r = Random(seed)
    q = r.randint(1, 6)
    return tuple(tuple(Fraction(r.randint(-6, 6), r.choice((1, 2, 3))) for _ in range(q)) for _ in range(q))


@pytest.mark.parametrize("seed", range(30))
def test_the_lyapunov_equation_is_solved_exactly(seed):
    """E'P + P E = -I, put in again; and the same numbers from scipy.linalg."""
    E = random_matrix(seed)
    P = lyapunov(E)
    spectrum = np.linalg.eigvals(to_float(E))
    if P is None:  # no unique solution: two eigenvalues add up to 0
        assert np.min(np.abs(spectrum[:, None] + spectrum[None, :])) < 1e-6
        return
    assert is_symmetric(P)
    assert add(multiply(transpose(E), P), multiply(P, E)) == scale(-1, identity(len(E)))
    ours = to_float(P)
    theirs = linalg.solve_continuous_lyapunov(to_float(E).T, -np.eye(len(E)))
    assert np.allclose(ours, theirs, rtol=1e-6, atol=1e-8 * np.max(np.abs(ours)))


@pytest.mark.parametrize("seed", range(30))
def test_p_of_the_equation_is_positive_iff_the_matrix_is_hurwitz(seed):
    """Lyapunov's theorem, with eigenvalues as the oracle."""
    E = random_matrix(seed)
    P = lyapunov(E)
    if P is not None:
        stable = bool(np.max(np.linalg.eigvals(to_float(E)).real) < 0)
        assert (decide_positive_definite(SparseSymmetric.from_dense(P)).verdict is Verdict.PROVED) is stable


@pytest.mark.parametrize("E", [[[0]], [[0, 1], [-1, 0]], [[1, 0], [0, -1]]])
def test_an_equation_without_a_unique_solution_has_none(E):
    assert lyapunov(tuple(tuple(map(Fraction, row)) for row in E)) is None


def test_the_paper_example_gets_a_p_that_can_be_read():
    P = certified("paper-fixed").claims.P
    assert P is not None
    assert all(1000 % x.denominator == 0 and abs(x.numerator) < 1000 for row in P for x in row)


def test_every_proposal_has_q_equal_to_p_w(harmonic):
    pairs = list(propose_pairs(harmonic, PAPER_GAIN, bound=-0.5, decay=1.6))
    assert len(pairs) > 15
    for P, Q, _ in pairs:
        assert is_symmetric(P)
        assert multiply(P, PAPER_GAIN) == Q


def test_a_gain_that_does_not_work_gets_no_pair_that_does(harmonic):
    """A - WC with W = 0 is marginal: no Lyapunov equation, and nothing to propose."""
    zero = ((Fraction(0),), (Fraction(0),))
    assert list(propose_pairs(harmonic, zero, bound=-0.5, decay=0.0)) == []


@pytest.mark.parametrize("pins", [{1: "1/1000000"}, {1: "1/1000"}, {1: 1}, {1: 10**6}])
@pytest.mark.parametrize("factor", ["1/10000", "1/100", "1", "100", "10000"])
def test_wherever_lambda_is_negative_the_theorem_is_proved(cycle, pins, factor):
    """The Decision theorem, for margins of Lambda from 1e-7 up and exosystems scaled from 1e-4 to 1e4."""
    exosystem = Exosystem(A=[[0, Fraction(factor)], [-Fraction(factor), 0]], C=[[factor, 0]])
    problem = cycle(4, pins=pins, exosystem=exosystem)
    certificate = dd.certify(problem)
    assert certificate.check("theorem1").verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


@pytest.mark.parametrize("m", [2, 3])
def test_several_components_are_proved_together(cycle, m):
    A = [[0] * (2 * m) for _ in range(2 * m)]
    for i in range(m):
        A[2 * i][2 * i + 1], A[2 * i + 1][2 * i] = i + 1, -i - 1
    C = [[int(j == 2 * i) for j in range(2 * m)] for i in range(m)]
    problem = cycle(3, exosystem=Exosystem(A=A, C=C), coupling="tanh(y)")
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_state_that_c_does_not_see_stays_in_p(cycle):
    """Detectable, not observable: P must still be positive definite on what is hidden."""
    exosystem = Exosystem(A=[[0, 0], [0, -1]], C=[[1, 0]])
    certificate = dd.certify(cycle(3, exosystem=exosystem))
    assert certificate.check("theorem1").verdict is Verdict.PROVED


def test_eight_exosystem_states_are_proved(cycle):
    q = 8
    A = [[0] * q for _ in range(q)]
    for k in range(4):
        A[2 * k][2 * k + 1], A[2 * k + 1][2 * k] = k + 1, -k - 1
    exosystem = Exosystem(A=A, C=[[1, 0] * 4])
    assert design_gain(exosystem).W is not None
    assert dd.certify(cycle(3, exosystem=exosystem)).check("theorem1").verdict is Verdict.PROVED


@pytest.mark.parametrize(("digits", "exact"), [(20, True), (80, False)])
def test_no_exact_equation_is_solved_that_would_take_hours(digits, exact, monkeypatch):
    """36 unknowns, times the bits of a common denominator of 64 numbers: about 150 000 and 610 000."""
    asked = []
    monkeypatch.setattr(pair_module, "lyapunov", asked.append)
    A = [[Fraction(-20 * (i == j)) + Fraction(1, 10**digits + 7 * i + j) for j in range(8)] for i in range(8)]
    pairs = list(propose_pairs(Exosystem(A=A, C=[[1] * 8]), ((Fraction(0),),) * 8, bound=math.nan, decay=1.0))
    assert pairs == []
    assert bool(asked) is exact
