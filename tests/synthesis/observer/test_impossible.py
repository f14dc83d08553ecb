"""Impossible requests: each reason is a proof, and its twin just across the border is not refuted."""

from __future__ import annotations

from fractions import Fraction

import pytest

from dobc_design.problem import exosystems
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.decide import largest_hidden_rate, why_impossible
from dobc_design.synthesis.observer.request import Cone, Disk, HalfPlane, NoiseLimit, read_observer_request
from dobc_design.verdict import Verdict

HARMONIC = exosystems.harmonics(2)
HALF_SEEN = Exosystem(A=[[-1, 0], [0, -1]], C=[[1, 0]])


def reason(exosystem, **asked):
    return why_impossible(exosystem, read_observer_request(**asked))


@pytest.mark.parametrize(
    ("exosystem", "possible", "impossible", "kind"),
    [
        (HALF_SEEN, {"rate": 1}, {"rate": "1.000000000001"}, "rate"),
        (HALF_SEEN, {"region": Disk(centre=-2, radius=1)}, {"region": Disk(centre=-2, radius="0.999999")}, "region"),
        (
            HARMONIC,
            {"rate": 2, "region": Disk(centre=0, radius=2)},
            {"rate": "2.000001", "region": Disk(centre=0, radius=2)},
            "region",
        ),
        (HARMONIC, {"region": HalfPlane(right_of="-1e-9")}, {"region": HalfPlane(right_of=0)}, "region"),
        (HARMONIC, {"noise": "2.000001"}, {"noise": 2}, "noise"),
        (
            HARMONIC,
            {"noise": NoiseLimit(channel="disturbance", bound="1.000001")},
            {"noise": NoiseLimit(channel="disturbance", bound=1)},
            "noise",
        ),
    ],
)
def test_a_request_is_refuted_beyond_its_border_and_not_before(exosystem, possible, impossible, kind):
    """The borders: the hidden eigenvalue -1; empty intersections; |s| = 2; G(2i) = 1."""
    assert reason(exosystem, **possible) is None
    found = reason(exosystem, **impossible)
    assert found.verdict is Verdict.REFUTED
    assert found.kind == kind


def test_an_undetectable_mode_is_named_by_its_polynomial():
    """Theory, known answers: two equal oscillators seen as one hide s^2 + 4."""
    two = Exosystem(A=[[0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 2], [0, 0, -2, 0]], C=[[1, 0, 1, 0]])
    found = reason(two, rate=1)
    assert found.kind == "detectable"
    assert found.exact["polynomial"] == "s^2 + 4"


def test_a_decaying_exosystem_allows_small_norms():
    """With A Hurwitz W = 0 is a good observer, so nothing is impossible."""
    assert reason(Exosystem(A=[[-1]], C=[[1]]), noise=NoiseLimit(channel="disturbance", bound="1/10")) is None


def test_a_cone_alone_is_never_impossible():
    assert reason(exosystems.harmonics([1, 2, 3]), region=Cone(damping="0.99"), rate=100) is None


@pytest.mark.parametrize(
    ("polynomial", "expected"),
    [((1,), None), ((1, 1), 1), ((1, 3, 2), 1), ((1, 0, 4), None), ((1, "1/3"), "1/3"), ((1, 2, 5), 1)],
)
def test_the_hidden_rate_is_found(polynomial, expected):
    found = largest_hidden_rate(tuple(Fraction(x) for x in polynomial))
    assert found == (None if expected is None else Fraction(expected))


def test_an_irrational_hidden_rate_is_bounded_from_below():
    """s^2 + 3 s + 1: the slower root is (3 - sqrt 5)/2 = 0.381966."""
    found = largest_hidden_rate((Fraction(1), Fraction(3), Fraction(1)))
    assert found**2 - 3 * found + 1 >= 0
    assert float(found) == pytest.approx(0.3819660113, rel=1e-8)
    assert found < Fraction("0.38196601126")
