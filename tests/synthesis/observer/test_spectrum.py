"""Regions of the spectrum of A - W C: the paper's W at its exact borders, and sampled observers."""

from __future__ import annotations

import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from scipy import linalg

from dobc_design.exact.matrix import identity, matrix, to_float
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.problem import exosystems
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.decide import (
    damping_holds,
    error_matrix,
    hurwitz_statement,
    images,
    rate_holds,
    region_statement,
    sampled_matrix,
    sampled_statements,
    spectrum_inside,
)
from dobc_design.synthesis.observer.request import Cone, Disk, HalfPlane
from dobc_design.verdict import Verdict

PAPER = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
W = matrix([["16/5"], ["12/5"]])
F = error_matrix(PAPER, W)
TINY = Fraction(1, 10**12)


def test_the_paper_gain_decays_at_eight_fifths_and_no_faster():
    """Theory, known answers: eigenvalues -8/5 +- (2/5) sqrt(39) i."""
    assert rate_holds(F, Fraction(8, 5))
    assert not rate_holds(F, Fraction(8, 5) + TINY)


def test_a_border_is_reported():
    assert "with one on its border" in region_statement(F, HalfPlane(left_of="-8/5")).text
    assert "none on its border" in region_statement(F, HalfPlane(left_of="-1.5")).text
    refuted = region_statement(F, HalfPlane(left_of="-1.7"))
    assert refuted.verdict is Verdict.REFUTED
    assert refuted.exact["polynomial"] == "s^2 + 16/5 s + 44/5"


def test_the_paper_gain_has_the_damping_four_over_root_fifty_five():
    """|s|^2 = 44/5 and Re s = -8/5, so damping^2 = 16/55; the bound is irrational, so both neighbours are tested."""
    below = Fraction(math.isqrt(16 * 10**24 // 55), 10**12)
    assert below**2 < Fraction(16, 55) < (below + TINY) ** 2
    assert damping_holds(F, below)
    assert not damping_holds(F, below + TINY)


def test_the_paper_gain_lies_in_its_disk_exactly():
    """|s|^2 = 44/5 about 0; about -8/5 the radius is (2/5) sqrt(39)."""
    radius = Fraction(math.isqrt(156 * 10**24 // 25), 10**12)
    assert spectrum_inside(F, Disk(centre="-8/5", radius=radius + TINY)) == (True, True)
    assert spectrum_inside(F, Disk(centre="-8/5", radius=radius)) == (False, False)
    assert spectrum_inside(F, HalfPlane(right_of="-8/5")) == (True, False)
    assert spectrum_inside(F, HalfPlane(right_of=Fraction(-8, 5) + TINY)) == (False, False)


def test_each_region_has_its_image():
    polynomial = characteristic_polynomial(identity(2))
    assert [len(images(region, polynomial)[0]) for region in (HalfPlane(left_of=0), Disk(centre=0, radius=2))] == [3, 3]
    assert len(images(Cone(damping="1/2"), polynomial)[0]) == 5


def test_hurwitz_is_strict():
    assert hurwitz_statement(F).verdict is Verdict.PROVED
    refuted = hurwitz_statement(PAPER.A)
    assert refuted.verdict is Verdict.REFUTED
    assert "does not follow" in refuted.text


@pytest.mark.parametrize("seed", range(20))
def test_random_gains_agree_with_floating_point_away_from_the_border(seed):
    r = Random(seed)
    q = r.randint(1, 5)
    E = matrix([[Fraction(r.randint(-30, 10), 10) for _ in range(q)] for _ in range(q)])
    poles = np.linalg.eigvals(to_float(E))
    for region, inside in (
        (HalfPlane(left_of="-0.3"), np.max(poles.real) - (-0.3)),
        (Disk(centre=-2, radius="2.5"), np.max(np.abs(poles + 2)) - 2.5),
        (Cone(damping="0.4"), np.max(poles.real + 0.4 * np.abs(poles))),
    ):
        if abs(inside) > 1e-6:
            assert spectrum_inside(E, region)[0] == (inside < 0)


def sampled_in_floats(exosystem, gain, period):
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    q = len(A)
    block = linalg.expm(np.block([[A, np.eye(q)], [np.zeros((q, 2 * q))]]) * period)
    return block[:q, :q] - to_float(gain) @ (C @ block[:q, q:] / period)


def test_the_sampled_error_is_that_of_scipy():
    exosystem = exosystems.total(exosystems.ramp(), exosystems.harmonics(3))
    gain = matrix([["0.3"], ["0.2"], ["0.1"], ["-0.4"]])
    found = sampled_matrix(exosystem, gain, Fraction(1, 4))
    expected = sampled_in_floats(exosystem, gain, 0.25)
    assert [[float(x.midpoint) for x in row] for row in found] == pytest.approx(expected)
    assert max(x.width for row in found for x in row) < Fraction(1, 2**100)


def test_a_sampled_constant_converges_for_gains_between_zero_and_two():
    """Ad = 1, Cd = 1: the error is multiplied by 1 - W."""
    constant = exosystems.constant()
    for gain, verdict in (
        ("1", Verdict.PROVED),
        ("1.999999", Verdict.PROVED),
        ("2.000001", Verdict.REFUTED),
        ("-0.1", Verdict.REFUTED),
    ):
        found = sampled_statements(constant, matrix([[gain]]), period=Fraction(1), rate=None, regions=())
        assert [statement.verdict for statement in found] == [verdict]


def test_the_sampled_rate_is_decided_to_many_digits():
    """1 - W = exp(-rate T) with rate T = 1: W on either side of 1 - 1/e."""
    edge = Fraction(1 - math.exp(-1))
    for gain, verdict in ((edge + TINY, Verdict.PROVED), (edge - TINY, Verdict.REFUTED)):
        found = sampled_statements(
            exosystems.constant(), ((gain,),), period=Fraction(1, 2), rate=Fraction(2), regions=()
        )
        assert [s.verdict for s in found] == [Verdict.PROVED, verdict]


def test_a_pole_on_the_circle_is_never_proved():
    """W = 0 leaves the harmonic on the unit circle, where an enclosure cannot decide."""
    found = sampled_statements(PAPER, matrix([[0], [0]]), period=Fraction(1, 10), rate=None, regions=())
    assert found[0].verdict is not Verdict.PROVED


def test_disks_of_the_sampled_plane_are_decided():
    disk = [Disk(centre="1/2", radius="1/4")]
    for gain, verdict in (("1/2", Verdict.PROVED), ("0.8", Verdict.REFUTED)):
        found = sampled_statements(exosystems.constant(), matrix([[gain]]), period=Fraction(1), rate=None, regions=disk)
        assert found[-1].verdict is verdict
