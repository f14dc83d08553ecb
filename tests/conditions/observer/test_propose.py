"""Exact pole placement: a gain whenever (A, C) is detectable, found without floating point."""

import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from certified import certified
from texts import exact_matrix, exosystem_of, matrix

import dobc_design as dd
from dobc_design import Exosystem, Verdict
from dobc_design.conditions.observer import propose
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.observer.propose import (
    design_gain,
    placed_gains,
    propose_pairs,
)
from dobc_design.exact.matrix import add, identity, is_symmetric, multiply, scale, to_float
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import characteristic_polynomial, decide_hurwitz


def reaches(exosystem: Exosystem, W, rate: Fraction) -> bool:
    """Routh's test of A - WC + rate I."""
    shift = scale(rate, identity(exosystem.order))
    error = add(error_matrix(exosystem, W), shift)
    return decide_hurwitz(error).verdict is Verdict.PROVED


CONSTANT = exosystem_of("0", "1")
RAMP = exosystem_of("0 1; 0 0", "1 0")
HARMONIC = exosystem_of("0 2; -2 0", "1 0")
STANDARD = {"constant": CONSTANT, "ramp": RAMP, "harmonic": HARMONIC}


def random_exosystem(seed: int) -> Exosystem:
    """Sparse small integers, so that defective, hidden and repeated modes are common."""
    r = Random(seed)
    q = r.randint(1, 7)
    m = r.randint(1, 2)
    A = []
    for _ in range(q):
        row = [r.randint(-2, 2) * (r.random() < 0.5) for _ in range(q)]
        A.append(row)
    C = []
    for _ in range(m):
        C.append([r.randint(-1, 1) * (r.random() < 0.5) for _ in range(q)])
    return Exosystem(A=A, C=C)


@pytest.mark.parametrize("seed", [k for k in range(30) if k != 19])  # 19 takes long
def test_a_detectable_pair_has_a_placed_gain_and_an_undetectable_one_has_none(seed: int):
    """Theory, section 2: some W makes A - WC Hurwitz iff (A, C) is detectable."""
    exosystem = random_exosystem(seed)
    *_, W = placed_gains(exosystem, rate=Fraction(0))
    detectable = decide_detectable(exosystem.A, exosystem.C).verdict is Verdict.PROVED
    assert reaches(exosystem, W, Fraction(0)) is detectable
    found = design_gain(exosystem)
    assert (found.W is not None) is detectable
    if detectable:
        assert reaches(exosystem, found.W, found.rate)


def test_all_poles_stand_at_one_place():
    """One output, all observable: det(sI - A + WC) = (s + 3)^4 for the rate 2.  Where C sees
    nothing, W is 0."""
    chain = exosystem_of("0 1 0 0; 0 0 1 0; 0 0 0 1; 0 0 0 0", "1 0 0 0")
    *_, W = placed_gains(chain, rate=Fraction(2))
    found = characteristic_polynomial(error_matrix(chain, W))
    assert found == (1, 12, 54, 108, 81)
    *_, W = placed_gains(exosystem_of("-1", "0"), rate=Fraction(0))
    assert W == ((0,),)


PAPER_GAIN = exact_matrix("16/5; 12/5")


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
    zero = exact_matrix("0; 0")
    found = propose_pairs(harmonic, zero, bound=-0.5, decay=0.0)
    assert list(found) == []


@pytest.mark.parametrize("pins", [{1: "1/1000000"}, {1: 10**6}])
@pytest.mark.parametrize("factor", ["1/10000", "10000"])
def test_wherever_lambda_is_negative_the_theorem_is_proved(cycle, pins, factor):
    """The Decision theorem, for margins of Lambda from 1e-7 up and exosystems scaled from 1e-4 to
    1e4."""
    first = [0, Fraction(factor)]
    second = [-Fraction(factor), 0]
    C = [[factor, 0]]
    exosystem = Exosystem(A=[first, second], C=C)
    problem = cycle(4, pins=pins, exosystem=exosystem)
    certificate = dd.certify(problem)
    assert certificate.check("theorem1").verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_state_that_c_does_not_see_stays_in_p(cycle):
    """Detectable, not observable: P must still be positive definite on what is hidden."""
    exosystem = exosystem_of("0 0; 0 -1", "1 0")
    certificate = dd.certify(cycle(3, exosystem=exosystem))
    assert certificate.check("theorem1").verdict is Verdict.PROVED


@pytest.mark.parametrize(("digits", "exact"), [(20, True), (80, False)])
def test_no_exact_equation_is_solved_that_would_take_hours(digits, exact, monkeypatch):
    """36 unknowns, times the bits of a common denominator of 64 numbers: about 150 000 and 610
    000."""
    asked = []
    monkeypatch.setattr(propose, "solve_lyapunov", lambda F, N: asked.append(F))
    A = []
    for i in range(8):
        row = [Fraction(1, 10**digits + 7 * i + j) for j in range(8)]
        A.append(row)
    for i in range(8):
        A[i][i] -= 20
    exosystem = Exosystem(A=A, C=[[1] * 8])
    zero = exact_matrix("0") * 8
    pairs = list(propose_pairs(exosystem, zero, bound=math.nan, decay=1.0))
    assert pairs == []
    assert bool(asked) is exact


def harmonics(*frequencies, outputs=((1, 0),)) -> Exosystem:
    """One oscillator for each frequency; every row of ``outputs`` is repeated over them."""
    q = 2 * len(frequencies)
    A = [[0] * q for _ in range(q)]
    for k, w in enumerate(frequencies):
        first = 2 * k
        A[first][first + 1] = w
        A[first + 1][first] = -Fraction(w)
    C = [list(row) * len(frequencies) for row in outputs]
    return Exosystem(A=A, C=C)


@pytest.mark.parametrize("name", STANDARD)
def test_the_default_is_half_the_rate_of_the_kalman_gain(name):
    """python-control's lqe with unit weights, to three digits."""
    import control

    exosystem = STANDARD[name]
    noise = np.eye(exosystem.order)
    A = to_float(exosystem.A)
    C = to_float(exosystem.C)
    output_noise = np.eye(exosystem.outputs)
    _, _, poles = control.lqe(A, noise, C, noise, output_noise)
    found = design_gain(exosystem)
    expected = -np.max(poles.real) / 2
    assert float(found.rate) == pytest.approx(expected, rel=6e-3)
    assert reaches(exosystem, found.W, found.rate)
    assert "half that of the Kalman gain" in found.note
    # at most three significant digits, decimal fractions
    for row in found.W:
        for x in row:
            assert 10**6 % x.denominator == 0
            answer = str(abs(x.numerator)).rstrip("0")
            assert len(answer) <= 3


@pytest.mark.parametrize("name", STANDARD)
@pytest.mark.parametrize("rate", ["1/100", "1", "3", "10000"])
def test_the_rate_asked_is_reached_exactly(name, rate):
    found = design_gain(STANDARD[name], rate=Fraction(rate))
    assert found.rate == Fraction(rate)
    assert reaches(STANDARD[name], found.W, Fraction(rate))
    assert found.note.endswith("as asked.")


@pytest.mark.parametrize("name", STANDARD)
@pytest.mark.parametrize("factor", ["1/1000000", "1000000"])
@pytest.mark.parametrize("what", ["A", "C", "both"])
def test_badly_scaled_exosystems_get_a_gain(name, factor, what):
    time = Fraction(1) if what == "C" else Fraction(factor)
    output = Fraction(1) if what == "A" else Fraction(factor)
    C = scale(output, STANDARD[name].C)
    A = scale(time, STANDARD[name].A)
    exosystem = Exosystem(A=A, C=C)
    found = design_gain(exosystem)
    assert reaches(exosystem, found.W, found.rate)
    faster = design_gain(exosystem, rate=time)
    assert faster.rate == time
    assert reaches(exosystem, faster.W, time)


@pytest.mark.parametrize(
    "exosystem",
    [
        harmonics(1, 2, 3, 4),
        harmonics(1, "1.1", "1.2", "1.3"),
        harmonics(1, 2, 3, outputs=((1, 0), (0, 1))),
        harmonics("1/10", 1, 10, 100),
        harmonics(1, 1000),
        # t^7
        Exosystem(A=[[int(j == i + 1) for j in range(8)] for i in range(8)], C=[[1] + [0] * 7]),
        # double, one chain
        exosystem_of("0 1 1 0; -1 0 0 1; 0 0 0 1; 0 0 -1 0", "1 0 0 0"),
        exosystem_of("-1 0; 0 -1", "1 0"),  # double and half of it unseen
        exosystem_of("3 1; 0 3", "1 0"),  # unstable, double
        exosystem_of("0 1; 100 0", "1 0"),
        exosystem_of("-5", "0"),
        exosystem_of("0 2; -2 0", "1 0; 0 0"),
        exosystem_of("0 1 0 0; 0 0 0 0; 0 0 0 1; 0 0 0 0", "1 0 0 0; 0 0 1 0"),
        Exosystem(A=[[0] * 3] * 3, C=matrix("1 0 0; 0 1 0; 0 0 1")),
        # almost one signal seen twice
        Exosystem(A=[[0] * 2] * 2, C=matrix("1 1/1000; 1/1000 1/1000000000")),
    ],
)
def test_hard_pairs_get_a_gain(exosystem):
    found = design_gain(exosystem)
    assert reaches(exosystem, found.W, found.rate)
    assert design_gain(exosystem) == found


@pytest.mark.parametrize("number", ["1e399", "1e200", "1e-200", "1e-399"])
def test_numbers_at_the_ends_of_the_floats_get_a_gain(number):
    unstable = Exosystem(A=[[number]], C=[[1]])
    large_output = Exosystem(A=[[0]], C=[[number]])
    A = [[0, number], [f"-{number}", 0]]
    oscillator = Exosystem(A=A, C=matrix("1 0"))
    large = Exosystem(A=[[number]], C=[[number]])
    cases = (unstable, large_output, large, oscillator)
    for exosystem in cases:
        found = design_gain(exosystem)
        assert found.W is not None
        assert reaches(exosystem, found.W, found.rate)
    assert "about 1e3" in design_gain(CONSTANT, rate=Fraction("1e399")).note


def test_a_rate_beyond_what_is_hidden_from_c_is_said_and_given_up():
    """The second state is not seen and decays at 1 1/s: 2 and 1 itself cannot be exceeded, 0.99
    can."""
    exosystem = exosystem_of("-1 0; 0 -1", "1 0")
    for rate in (2, 1):
        found = design_gain(exosystem, rate=Fraction(rate))
        assert found.note.startswith(f"the rate asked, {rate} 1/s, cannot be reached")
        assert found.rate == Fraction(1, 2)
        assert reaches(exosystem, found.W, found.rate)
    found = design_gain(exosystem, rate=Fraction(99, 100))
    assert found.rate == Fraction(99, 100)
    assert reaches(exosystem, found.W, found.rate)
