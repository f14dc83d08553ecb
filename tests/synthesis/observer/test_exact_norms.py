"""H2 and H-infinity of the observer's channels: closed forms exactly, and python-control's own norms."""

from __future__ import annotations

import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import matrix, to_float
from dobc_design.exact.polynomial import decide_hurwitz
from dobc_design.problem import exosystems
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.decide import (
    StateSpace,
    channel,
    h2_squared,
    hinf_below,
    noise_statement,
    root_above,
)
from dobc_design.synthesis.observer.request import CHANNELS, NoiseLimit
from dobc_design.verdict import Verdict

CONSTANT = exosystems.constant()
TINY = Fraction(1, 10**12)


def control_norm(system: StateSpace, kind) -> float:
    """python-control's norm; it wants as many inputs as outputs, so zeros are added, which change no norm."""
    import control

    F, B, C, D = (to_float(x) for x in (system.F, system.B, system.C, system.D))
    size = max(B.shape[1], C.shape[0])
    wide, tall, both = np.zeros((len(F), size)), np.zeros((size, len(F))), np.zeros((size, size))
    wide[:, : B.shape[1]], tall[: C.shape[0]], both[: D.shape[0], : D.shape[1]] = B, C, D
    return float(control.norm(control.ss(F, wide, tall, both, remove_useless_states=False), kind, tol=1e-10))


def random_system(seed: int) -> StateSpace:
    r = Random(seed)
    while True:
        q, u, y = r.randint(1, 5), r.randint(1, 3), r.randint(1, 3)

        def draw(rows, columns, shift=0):
            return matrix(
                [[Fraction(r.randint(-20, 20), 10) - shift * (i == j) for j in range(columns)] for i in range(rows)]
            )

        feedthrough = draw(y, u) if seed % 2 else matrix([[0] * u] * y)
        system = StateSpace(F=draw(q, q, shift=3), B=draw(q, u), C=draw(y, q), D=feedthrough)
        if decide_hurwitz(system.F).verdict is Verdict.PROVED:
            return system


@pytest.mark.parametrize("seed", range(50))
def test_fifty_random_systems_have_the_norms_of_python_control(seed):
    """H-infinity is proved just above python-control's value and refuted just below; H2 is exact."""
    system = random_system(seed)
    expected = control_norm(system, "inf")
    assert hinf_below(system, Fraction(expected * (1 + 1e-6)))
    assert not hinf_below(system, Fraction(expected * (1 - 1e-6)))
    square = h2_squared(system)
    if seed % 2:
        assert square is None or not any(x for row in system.D for x in row)
    else:
        assert math.sqrt(square) == pytest.approx(control_norm(system, 2), rel=1e-6)


@pytest.mark.parametrize("w", ["1/3", "1", "7"])
def test_the_norms_of_a_constant_are_known(w):
    """F = -w: w/(s+w) has H2^2 = w/2 and norm 1; w s/(s+w) has norm w; 1/(s+w) has H2^2 = 1/(2w) and norm 1/w."""
    gain, x = matrix([[w]]), Fraction(w)
    d, e, n = (channel(CONSTANT, gain, name) for name in ("disturbance", "exosystem", "measurement"))
    assert h2_squared(d) == x / 2
    assert h2_squared(e) == 1 / (2 * x)
    assert h2_squared(n) is None
    for system, norm in ((d, Fraction(1)), (e, 1 / x), (n, x)):
        assert hinf_below(system, norm + TINY)
        assert not hinf_below(system, norm)
        assert not hinf_below(system, norm - TINY)


def test_the_measurement_channel_of_a_harmonic_peaks_where_calculus_says():
    """W = (2, 0) at 2 rad/s: |G|^2 = 4 x^2/(x^2 - 4x + 16), x = w^2, is largest at x = 8: 16/3."""
    system = channel(exosystems.harmonics(2), matrix([[2], [0]]), "measurement")
    square = Fraction(16, 3)
    below = Fraction(math.isqrt(int(square * 10**24)), 10**12)
    assert not hinf_below(system, below)
    assert hinf_below(system, below + TINY)


def test_an_error_that_does_not_decay_has_no_norm():
    system = channel(CONSTANT, matrix([[0]]), "disturbance")
    assert h2_squared(system) is None
    assert not hinf_below(system, Fraction(10**9))
    assert not hinf_below(channel(CONSTANT, matrix([[1]]), "disturbance"), Fraction(-1))


def test_statements_say_what_holds_and_what_does_not():
    gain = matrix([[2]])
    cases = (
        (NoiseLimit(channel="disturbance", norm="h2", bound=1), Verdict.PROVED),
        (NoiseLimit(channel="disturbance", norm="h2", bound="0.999999999"), Verdict.REFUTED),
        (NoiseLimit(channel="measurement", bound="2.000000001"), Verdict.PROVED),
        (NoiseLimit(channel="measurement", bound=2), Verdict.REFUTED),
        (NoiseLimit(channel="measurement", norm="h2", bound=1000), Verdict.REFUTED),
    )
    for limit, verdict in cases:
        found = noise_statement(CONSTANT, gain, limit)
        assert found.verdict is verdict
        assert ("it is false" in found.text) == (verdict is Verdict.REFUTED)
    assert noise_statement(CONSTANT, gain, cases[0][0]).exact["h2_squared"] == "1"


def test_channels_are_transfer_functions_of_the_simulated_observer():
    """At one frequency: C (sI - F)^-1 W, s times it, and C (sI - F)^-1, computed directly."""
    exosystem = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 1], [0, 1]])
    gain = matrix([[2, "1/2"], ["1/3", 3]])
    A, C, W = to_float(exosystem.A), to_float(exosystem.C), to_float(gain)
    s = 1.7j
    resolvent = np.linalg.inv(s * np.eye(2) - (A - W @ C))
    expected = {"measurement": s * C @ resolvent @ W, "disturbance": C @ resolvent @ W, "exosystem": C @ resolvent}
    for name in CHANNELS:
        x = channel(exosystem, gain, name)
        value = to_float(x.C) @ np.linalg.inv(s * np.eye(2) - to_float(x.F)) @ to_float(x.B) + to_float(x.D)
        assert value == pytest.approx(expected[name])
    with pytest.raises(SpecError, match="channel must be one of"):
        channel(exosystem, gain, "wind")


@pytest.mark.parametrize("square", ["0", "1/9", "2", "1e-30", "1e30"])
def test_roots_are_rounded_up(square):
    root = root_above(Fraction(square))
    assert Fraction(root) ** 2 >= Fraction(square)
    assert Fraction(root) ** 2 <= Fraction(square) * (1 + Fraction(1, 10**14))
