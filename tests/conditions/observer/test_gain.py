"""The designed observer gain: the rate it promises is there exactly, for every kind of exosystem."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np
import pytest

from dobc_design.conditions.observer.gain import design_gain
from dobc_design.conditions.observer.scaling import decimal_exponent, natural_units, scaled_exosystem
from dobc_design.exact.matrix import add, identity, multiply, scale, subtract, to_float
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.problem.exosystems import Exosystem
from dobc_design.verdict import Verdict

CONSTANT = Exosystem(A=[[0]], C=[[1]])
RAMP = Exosystem(A=[[0, 1], [0, 0]], C=[[1, 0]])
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
STANDARD = {"constant": CONSTANT, "ramp": RAMP, "harmonic": HARMONIC}


def reaches(exosystem: Exosystem, W, rate: Fraction) -> bool:
    """Routh's test of A - WC + rate I."""
    error = subtract(exosystem.A, multiply(W, exosystem.C))
    return decide_hurwitz(add(error, scale(rate, identity(exosystem.order)))).verdict is Verdict.PROVED


def harmonics(*frequencies, outputs=((1, 0),)) -> Exosystem:
    """One oscillator for each frequency; every row of ``outputs`` is repeated over them."""
    q = 2 * len(frequencies)
    A = [[0] * q for _ in range(q)]
    for k, w in enumerate(frequencies):
        A[2 * k][2 * k + 1], A[2 * k + 1][2 * k] = w, -Fraction(w)
    return Exosystem(A=A, C=[list(row) * len(frequencies) for row in outputs])


@pytest.mark.parametrize("name", STANDARD)
def test_the_default_is_half_the_rate_of_the_kalman_gain(name):
    """python-control's lqe with unit weights, to three digits."""
    import control

    exosystem = STANDARD[name]
    q, m = exosystem.order, exosystem.outputs
    _, _, poles = control.lqe(to_float(exosystem.A), np.eye(q), to_float(exosystem.C), np.eye(q), np.eye(m))
    found = design_gain(exosystem)
    assert float(found.rate) == pytest.approx(-np.max(poles.real) / 2, rel=6e-3)
    assert reaches(exosystem, found.W, found.rate)
    assert "half that of the Kalman gain" in found.note


@pytest.mark.parametrize("name", STANDARD)
@pytest.mark.parametrize("rate", ["1/100", "1/10", "1", "3", "10", "100", "10000"])
def test_the_rate_asked_is_reached_exactly(name, rate):
    found = design_gain(STANDARD[name], rate=Fraction(rate))
    assert found.rate == Fraction(rate)
    assert reaches(STANDARD[name], found.W, Fraction(rate))
    assert found.note.endswith("as asked.")


@pytest.mark.parametrize("name", STANDARD)
def test_the_gain_can_be_read(name):
    """At most three significant digits, decimal fractions."""
    for row in design_gain(STANDARD[name]).W:
        for x in row:
            assert 10**6 % x.denominator == 0
            assert len(str(abs(x.numerator)).rstrip("0")) <= 3


@pytest.mark.parametrize("name", STANDARD)
@pytest.mark.parametrize("factor", ["1/10000", "1/100", "100", "10000", "1/1000000", "1000000"])
@pytest.mark.parametrize("what", ["A", "C", "both"])
def test_badly_scaled_exosystems_get_a_gain(name, factor, what):
    one = Fraction(1)
    time, output = {"A": (Fraction(factor), one), "C": (one, Fraction(factor)), "both": (Fraction(factor),) * 2}[what]
    exosystem = Exosystem(A=scale(time, STANDARD[name].A), C=scale(output, STANDARD[name].C))
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
        Exosystem(A=[[int(j == i + 1) for j in range(8)] for i in range(8)], C=[[1] + [0] * 7]),  # t^7
        Exosystem(A=[[0, 1, 1, 0], [-1, 0, 0, 1], [0, 0, 0, 1], [0, 0, -1, 0]], C=[[1, 0, 0, 0]]),  # double, one chain
        Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]]),  # double and half of it unseen
        Exosystem(A=[[3, 1], [0, 3]], C=[[1, 0]]),  # unstable, double
        Exosystem(A=[[0, 1], [100, 0]], C=[[1, 0]]),
        Exosystem(A=[[-5]], C=[[0]]),
        Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0], [0, 0]]),
        Exosystem(A=[[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]], C=[[1, 0, 0, 0], [0, 0, 1, 0]]),
        Exosystem(A=[[0] * 3] * 3, C=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        Exosystem(A=[[0] * 2] * 2, C=[[1, "1/1000"], ["1/1000", "1/1000000000"]]),  # almost one signal seen twice
    ],
)
def test_hard_pairs_get_a_gain(exosystem):
    found = design_gain(exosystem)
    assert reaches(exosystem, found.W, found.rate)


@pytest.mark.parametrize("number", ["1e399", "1e200", "1e-200", "1e-399"])
def test_numbers_at_the_ends_of_the_floats_get_a_gain(number):
    for exosystem in (
        Exosystem(A=[[number]], C=[[1]]),
        Exosystem(A=[[0]], C=[[number]]),
        Exosystem(A=[[number]], C=[[number]]),
        Exosystem(A=[[0, number], [f"-{number}", 0]], C=[[1, 0]]),
    ):
        found = design_gain(exosystem)
        assert found.W is not None
        assert reaches(exosystem, found.W, found.rate)
    assert "about 1e3" in design_gain(CONSTANT, rate=Fraction("1e399")).note


def test_a_rate_beyond_what_is_hidden_from_c_is_said_and_given_up():
    """The second state is not seen and decays at 1 1/s: 2 and 1 itself cannot be exceeded, 0.99 can."""
    exosystem = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]])
    for rate in (2, 1):
        found = design_gain(exosystem, rate=Fraction(rate))
        assert found.note.startswith(f"the rate asked, {rate} 1/s, cannot be reached")
        assert found.rate == Fraction(1, 2)
        assert reaches(exosystem, found.W, found.rate)
    found = design_gain(exosystem, rate=Fraction(99, 100))
    assert found.rate == Fraction(99, 100)
    assert reaches(exosystem, found.W, Fraction(99, 100))


@pytest.mark.parametrize(
    ("A", "C"),
    [
        ([[0]], [[0]]),
        ([[0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 2], [0, 0, -2, 0]], [[1, 0, 1, 0]]),
        ([[1, 0], [0, -1]], [[0, 1]]),
    ],
)
def test_an_undetectable_pair_has_no_gain(A, C):
    """Theory, known answers: A = [0], C = [0], and two equal oscillators seen as one."""
    found = design_gain(Exosystem(A=A, C=C), rate=Fraction(1))
    assert found.W is None
    assert found.rate is None
    assert "not detectable" in found.note


@pytest.mark.parametrize("seed", range(60))
def test_random_detectable_pairs_get_a_gain(seed):
    r = Random(seed)
    q, m = r.randint(1, 8), r.choice((1, 2, 3))
    size = r.choice((Fraction(1), Fraction(1, 100), Fraction(100)))
    A = [[size * r.randint(-3, 3) if r.random() < 0.6 else 0 for _ in range(q)] for _ in range(q)]
    C = [[r.choice((0, 1, -1, 2)) for _ in range(q)] for _ in range(m)]
    exosystem = Exosystem(A=A, C=C)
    found = design_gain(exosystem)
    if decide_detectable(exosystem.A, exosystem.C).verdict is Verdict.PROVED:
        assert found.W is not None
        assert (len(found.W), len(found.W[0])) == (q, m)
        assert reaches(exosystem, found.W, found.rate)
    else:
        assert found.W is None


def test_the_same_pair_gets_the_same_gain():
    assert design_gain(harmonics(1, 2)) == design_gain(harmonics(1, 2))


def test_units_turn_a_gain_back_exactly():
    """A - WC = a (A1 - W1 C1) with W = (a/c) W1; here the scaled numbers are floats, so nothing is rounded."""
    exosystem = Exosystem(A=[[0, 4000], [-4000, 0]], C=[["1/1024", 0]])
    time, output = natural_units(exosystem, rate=Fraction(1))
    units = scaled_exosystem(exosystem, time=Fraction(1000), output=Fraction(1, 1024))
    assert (float(time), float(output)) == pytest.approx((1e4, 1e-3), rel=0.95)
    W1 = ((Fraction(3),), (Fraction(1),))
    W = scale(units.gain, W1)
    left = subtract(exosystem.A, multiply(W, exosystem.C))
    right = scale(units.time, subtract(units.exosystem.A, multiply(W1, units.exosystem.C)))
    assert left == right


@pytest.mark.parametrize(("x", "exponent"), [("1", 0), ("1000", 3), ("1e-6", -6), ("3e250", 250), ("1e-399", -399)])
def test_the_decimal_exponent_of_numbers_of_any_length(x, exponent):
    assert abs(decimal_exponent(Fraction(x)) - exponent) <= 1
