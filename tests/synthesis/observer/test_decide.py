"""Exact decisions: the paper's W at its borders, norms in closed form and by python-control, what
no W can do."""

import math
from fractions import Fraction
from functools import partial
from random import Random

import numpy as np
import pytest
from oracles.observers import control_norm, sampled_in_floats

from dobc_design import Exosystem, Verdict, exosystems
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.observer.propose import hinf_norm
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import matrix, scale, to_float
from dobc_design.exact.number import ONE
from dobc_design.exact.polynomial import characteristic_polynomial, decide_hurwitz
from dobc_design.loop.timing import Timing, sampled
from dobc_design.synthesis.observer.claim import (
    CHANNELS,
    Cone,
    Disk,
    HalfPlane,
    NoiseLimit,
    ObserverRequest,
    read_observer_request,
)
from dobc_design.synthesis.observer.decide import (
    StateSpace,
    channel,
    damping_holds,
    gain_statements,
    h2_squared,
    hinf_below,
    hurwitz_statement,
    largest_hidden_rate,
    noise_statement,
    rate_holds,
    region_statement,
    roots_inside,
    sampled_statements,
    why_impossible,
)

PAPER = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
W = matrix([["16/5"], ["12/5"]])
F = error_matrix(PAPER, W)
TINY = Fraction(1, 10**12)
CONSTANT = exosystems.constant()


def test_the_paper_gain_has_its_rate_damping_and_disk_exactly():
    assert hurwitz_statement(F).verdict is Verdict.PROVED
    assert hurwitz_statement(PAPER.A).verdict is Verdict.REFUTED
    # Theory, known answers: eigenvalues -8/5 +- (2/5) sqrt(39) i.
    assert rate_holds(F, Fraction(8, 5))
    assert not rate_holds(F, Fraction(8, 5) + TINY)
    assert "with one on its border" in region_statement(F, HalfPlane(left_of="-8/5")).text
    assert "none on its border" in region_statement(F, HalfPlane(left_of="-1.5")).text
    refuted = region_statement(F, HalfPlane(left_of="-1.7"))
    assert refuted.verdict == Verdict.REFUTED
    assert refuted.exact["polynomial"] == "s^2 + 16/5 s + 44/5"
    # |s|^2 = 44/5 and Re s = -8/5, so damping^2 = 16/55; the bound is irrational, so both
    # neighbours are tested.
    below = Fraction(math.isqrt(16 * 10**24 // 55), 10**12)
    assert below**2 < Fraction(16, 55) < (below + TINY) ** 2
    assert damping_holds(F, below)
    assert not damping_holds(F, below + TINY)
    # |s|^2 = 44/5 about 0; about -8/5 the radius is (2/5) sqrt(39).
    radius = Fraction(math.isqrt(156 * 10**24 // 25), 10**12)
    polynomial = characteristic_polynomial(F)
    around = Disk(centre="-8/5", radius=radius + TINY)
    assert roots_inside(polynomial, around) == (True, True)
    around = Disk(centre="-8/5", radius=radius)
    assert roots_inside(polynomial, around) == (False, False)
    right = HalfPlane(right_of="-8/5")
    assert roots_inside(polynomial, right) == (True, False)
    right_of = Fraction(-8, 5) + TINY
    right = HalfPlane(right_of=right_of)
    assert roots_inside(polynomial, right) == (False, False)


@pytest.mark.parametrize("seed", range(20))
def test_random_gains_agree_with_floating_point_away_from_the_border(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    rows = []
    for _ in range(q):
        row = [Fraction(r.randint(-30, 10), 10) for _ in range(q)]
        rows.append(row)
    E = matrix(rows)
    poles = np.linalg.eigvals(to_float(E))
    disk = Disk(centre=-2, radius="2.5")
    beyond_the_disk = np.max(np.abs(poles + 2)) - 2.5
    beyond_the_cone = np.max(poles.real + 0.4 * np.abs(poles))
    beyond_the_half_plane = np.max(poles.real) + 0.3
    outside = {
        HalfPlane(left_of="-0.3"): beyond_the_half_plane,
        disk: beyond_the_disk,
        Cone(damping="0.4"): beyond_the_cone,
    }
    polynomial = characteristic_polynomial(E)
    for region, distance in outside.items():
        if abs(distance) > 1e-6:
            assert roots_inside(polynomial, region)[0] == (distance < 0)


def test_the_sampled_error_is_that_of_scipy():
    exosystem = exosystems.total(exosystems.ramp(), exosystems.harmonics(3))
    rows = [["0.3"], ["0.2"], ["0.1"], ["-0.4"]]
    gain = matrix(rows)
    timing = Timing(period=Fraction(1, 4), sampled=True)
    found = sampled(exosystem, timing).error(scale(4, gain), timing.period)
    expected = sampled_in_floats(exosystem, gain, 0.25)
    answer = [[float(x.midpoint) for x in row] for row in found]
    assert answer == pytest.approx(expected)
    widest = max(x.width for row in found for x in row)
    allowed = Fraction(1, 2**100)
    assert widest < allowed


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [
        ("1", Verdict.PROVED),
        ("1.999999", Verdict.PROVED),
        ("2.000001", Verdict.REFUTED),
        ("-0.1", Verdict.REFUTED),
    ],
)
def test_a_sampled_constant_converges_for_gains_between_zero_and_two(gain, verdict):
    """Ad = 1, Cd = 1: the error is multiplied by 1 - W."""
    W = matrix([[gain]])
    (found,) = sampled_statements(CONSTANT, W, ObserverRequest(period=ONE))
    assert found.verdict is verdict


def test_the_sampled_rate_is_decided_to_many_digits():
    """1 - W = exp(-rate T) with rate T = 1: W on either side of 1 - 1/e."""
    edge = Fraction(1 - math.exp(-1))

    def decided(gain: Fraction) -> list[Verdict]:
        asked = ObserverRequest(rate=Fraction(2), period=Fraction(1, 2))
        found = sampled_statements(CONSTANT, ((gain,),), asked)
        return [each.verdict for each in found]

    assert decided(edge + TINY) == [Verdict.PROVED, Verdict.PROVED]
    assert decided(edge - TINY) == [Verdict.PROVED, Verdict.REFUTED]


def test_disks_of_the_sampled_plane_are_decided_and_a_pole_on_the_circle_is_never_proved():
    """W = 0 leaves the harmonic on the unit circle, where an enclosure cannot decide."""
    nothing = matrix([[0], [0]])
    found = sampled_statements(PAPER, nothing, ObserverRequest(period=Fraction(1, 10)))
    assert found[0].verdict is not Verdict.PROVED
    regions = (Disk(centre="1/2", radius="1/4"),)
    asked = ObserverRequest(regions=regions, period=ONE)
    for gain, verdict in (("1/2", Verdict.PROVED), ("0.8", Verdict.REFUTED)):
        W = matrix([[gain]])
        found = sampled_statements(CONSTANT, W, asked)
        assert found[-1].verdict is verdict


def random_system(seed: int) -> StateSpace:
    r = Random(seed)

    def draw(rows, columns, shift=0):
        found = []
        for i in range(rows):
            row = []
            for _ in range(columns):
                row.append(Fraction(r.randint(-20, 20), 10))
            if shift:
                row[i] -= shift
            found.append(row)
        return matrix(found)

    while True:
        q = r.randint(1, 5)
        u = r.randint(1, 3)
        y = r.randint(1, 3)
        D = draw(y, u) if seed % 2 else matrix([[0] * u] * y)
        F = draw(q, q, shift=3)
        system = StateSpace(F=F, B=draw(q, u), C=draw(y, q), D=D)
        if decide_hurwitz(system.F).verdict is Verdict.PROVED:
            return system


@pytest.mark.parametrize("seed", range(20))
def test_random_systems_have_the_norms_of_python_control(seed):
    """H-infinity is proved just above python-control's value and refuted just below; H2 is
    exact."""
    system = random_system(seed)
    expected = control_norm(system, "inf")
    matrices = (system.F, system.B, system.C, system.D)
    floats = map(to_float, matrices)
    assert hinf_norm(*floats) == pytest.approx(expected, rel=1e-6)
    assert hinf_below(system, Fraction(expected * (1 + 1e-6)))
    assert not hinf_below(system, Fraction(expected * (1 - 1e-6)))
    square = h2_squared(system)
    if seed % 2:
        assert square is None or not any(x for row in system.D for x in row)
    else:
        assert math.sqrt(square) == pytest.approx(control_norm(system, 2), rel=1e-6)


@pytest.mark.parametrize("w", ["1/3", "1", "7"])
def test_the_norms_of_a_constant_are_known(w):
    """F = -w: w/(s+w) has H2^2 = w/2 and norm 1; w s/(s+w) has norm w; 1/(s+w) has H2^2 = 1/(2w)
    and norm 1/w."""
    gain = matrix([[w]])
    x = Fraction(w)
    d = channel(CONSTANT, gain, "disturbance")
    e = channel(CONSTANT, gain, "exosystem")
    n = channel(CONSTANT, gain, "measurement")
    assert h2_squared(d) == x / 2
    assert h2_squared(e) == 1 / (2 * x)
    assert h2_squared(n) is None
    of_d = (d, Fraction(1))
    of_e = (e, 1 / x)
    cases = (of_d, of_e, (n, x))
    for system, norm in cases:
        assert hinf_below(system, norm + TINY)
        assert not hinf_below(system, norm)
        assert not hinf_below(system, norm - TINY)
        assert not hinf_below(system, Fraction(-1))
    grows = channel(CONSTANT, matrix([[0]]), "disturbance")  # or rather does not decay
    assert h2_squared(grows) is None
    assert not hinf_below(grows, Fraction(10**9))


def test_the_measurement_channel_of_a_harmonic_peaks_where_calculus_says():
    """W = (2, 0) at 2 rad/s: |G|^2 = 4 x^2/(x^2 - 4x + 16), x = w^2, is largest at x = 8: 16/3."""
    gain = matrix([[2], [0]])
    system = channel(exosystems.harmonics(2), gain, "measurement")
    square = Fraction(16, 3)
    root = math.isqrt(int(square * 10**24))
    below = Fraction(root, 10**12)
    assert not hinf_below(system, below)
    assert hinf_below(system, below + TINY)


def test_statements_say_what_holds_and_what_does_not():
    gain = matrix([[2]])
    h2 = partial(NoiseLimit, norm="h2")
    exactly = h2(channel="disturbance", bound=1)
    for limit in (exactly, NoiseLimit(channel="measurement", bound="2.000000001")):
        found = noise_statement(CONSTANT, gain, limit)
        assert found.verdict is Verdict.PROVED
        assert "it is false" not in found.text
    too_tight = h2(channel="disturbance", bound="0.999999999")
    noise = NoiseLimit(channel="measurement", bound=2)
    loose = h2(channel="measurement", bound=1000)
    cases = (too_tight, noise, loose)
    for limit in cases:
        found = noise_statement(CONSTANT, gain, limit)
        assert found.verdict is Verdict.REFUTED
        assert "it is false" in found.text
    assert noise_statement(CONSTANT, gain, exactly).exact["h2_squared"] == "1"


def test_channels_are_transfer_functions_of_the_simulated_observer():
    """At one frequency: C (sI - F)^-1 W, s times it, and C (sI - F)^-1, computed directly."""
    exosystem = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 1], [0, 1]])
    gain = matrix([[2, "1/2"], ["1/3", 3]])
    A = to_float(exosystem.A)
    C = to_float(exosystem.C)
    W = to_float(gain)
    s = 1.7j
    scaled_identity = s * np.eye(2)
    resolvent = np.linalg.inv(scaled_identity - (A - W @ C))
    from_measurement = s * C @ resolvent @ W
    expected = {
        "measurement": from_measurement,
        "disturbance": C @ resolvent @ W,
        "exosystem": C @ resolvent,
    }
    for name in CHANNELS:
        x = channel(exosystem, gain, name)
        shifted = s * np.eye(2) - to_float(x.F)
        states = np.linalg.inv(shifted) @ to_float(x.B)
        value = to_float(x.C) @ states + to_float(x.D)
        assert value == pytest.approx(expected[name])
    with pytest.raises(SpecError, match="channel must be one of"):
        channel(exosystem, gain, "wind")


HARMONIC = exosystems.harmonics(2)
HALF_SEEN = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]])


AROUND = Disk(centre=0, radius=2)


def disturbance(bound) -> NoiseLimit:
    return NoiseLimit(channel="disturbance", bound=bound)


def reason(exosystem, **asked):
    return why_impossible(exosystem, read_observer_request(**asked))


@pytest.mark.parametrize(
    ("exosystem", "possible", "impossible", "kind"),
    [
        (HALF_SEEN, {"rate": 1}, {"rate": "1.000000000001"}, "rate"),
        (
            HALF_SEEN,
            {"region": Disk(centre=-2, radius=1)},
            {"region": Disk(centre=-2, radius="0.999999")},
            "region",
        ),
        (HARMONIC, {"rate": 2, "region": AROUND}, {"rate": "2.000001", "region": AROUND}, "region"),
        (
            HARMONIC,
            {"region": HalfPlane(right_of="-1e-9")},
            {"region": HalfPlane(right_of=0)},
            "region",
        ),
        (HARMONIC, {"noise": "2.000001"}, {"noise": 2}, "noise"),
        (HARMONIC, {"rate": 2, "noise": "4.000001"}, {"rate": 2, "noise": 4}, "noise"),
        (HARMONIC, {"region": AROUND, "noise": "4.1"}, {"region": AROUND, "noise": 2}, "noise"),
        (HARMONIC, {"noise": disturbance("1.000001")}, {"noise": disturbance(1)}, "noise"),
    ],
)
def test_a_request_is_refuted_beyond_its_border_and_not_before(
    exosystem, possible, impossible, kind
):
    """The borders: the hidden eigenvalue -1; empty intersections; |s| = 2; C W = 4; G(2i) = 1."""
    assert reason(exosystem, **possible) is None
    found = reason(exosystem, **impossible)
    assert found.verdict is Verdict.REFUTED
    assert found.kind == kind


def test_small_norms_of_a_decaying_exosystem_and_a_cone_alone_are_never_impossible():
    """With A Hurwitz W = 0 is a good observer."""
    decaying = Exosystem(A=[[-1]], C=[[1]])
    assert reason(decaying, noise=disturbance("1/10")) is None
    waves = exosystems.harmonics([1, 2, 3])
    found = reason(waves, region=Cone(damping="0.99"), rate=100)
    assert found is None


@pytest.mark.parametrize(
    ("polynomial", "expected"),
    [
        ((1,), None),
        ((1, 1), 1),
        ((1, 3, 2), 1),
        ((1, 0, 4), None),
        ((1, "1/3"), "1/3"),
        ((1, 2, 5), 1),
    ],
)
def test_the_hidden_rate_is_found(polynomial, expected):
    found = largest_hidden_rate(tuple(Fraction(x) for x in polynomial))
    assert found == (None if expected is None else Fraction(expected))


def test_an_irrational_hidden_rate_is_bounded_from_below():
    """s^2 + 3 s + 1: the slower root is (3 - sqrt 5)/2 = 0.381966."""
    polynomial = (Fraction(1), Fraction(3), Fraction(1))
    found = largest_hidden_rate(polynomial)
    assert found**2 - 3 * found + 1 >= 0
    assert float(found) == pytest.approx(0.3819660113, rel=1e-8)
    assert found < Fraction("0.38196601126")


def test_the_bounds_on_noise_are_decided_for_a_sampled_observer_too():
    """A = 0, C = 1: 1/(s + W) is 1/W at 0, and stays below a bound above that."""
    for bound, verdict in (("11/10", Verdict.PROVED), ("9/10", Verdict.REFUTED)):
        limit = NoiseLimit(channel="exosystem", norm="hinf", bound=Fraction(bound))
        request = ObserverRequest(period=Fraction(1, 10), noise=(limit,))
        *_, found = gain_statements(CONSTANT, matrix([[1]]), request)
        assert found.kind == "noise"
        assert found.verdict == verdict
