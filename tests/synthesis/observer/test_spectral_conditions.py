"""Necessary rows hold for every gain whose spectrum was put into the regions, and fail for some that is outside."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest

from dobc_design.exact.matrix import identity, matrix, multiply, subtract
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.problem import exosystems
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.spectral_conditions import gain_rows, images
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, HalfPlane


def value(row, W) -> Fraction:
    entries = [x for line in W for x in line]
    return sum((g * x for g, x in zip(row.gradient, entries, strict=True)), row.constant)


def test_the_rows_of_a_harmonic_are_those_of_its_quadratic():
    """A - WC has s^2 + w1 s + 4 + 2 w2; at s - 1 the coefficients are w1 - 2 and 5 - w1 + 2 w2."""
    rows = gain_rows(exosystems.harmonics(2), [HalfPlane(left_of=-1)])
    assert [(row.gradient, row.constant) for row in rows] == [((1, 0), -2), ((-1, 2), 5)]


def test_the_trace_gives_the_only_row_for_several_outputs():
    """tr(WC) - tr A - q rate >= 0; disks are not affine and give none."""
    exosystem = exosystems.stacked(exosystems.harmonics(1), exosystems.ramp())
    rows = gain_rows(exosystem, [HalfPlane(left_of=-2), Disk(centre=-3, radius=1)])
    assert [(row.gradient, row.constant) for row in rows] == [((1, 0, 0, 0, 0, 1, 0, 0), -8)]


@pytest.mark.parametrize("seed", range(20))
def test_rows_hold_for_drawn_spectra_inside_the_regions(seed):
    """In observer form, A - WC has the polynomial s^3 + w1 s^2 + w2 s + w3, so W is read off drawn roots."""
    r = Random(seed)
    exosystem = Exosystem(A=[[0, 1, 0], [0, 0, 1], [0, 0, 0]], C=[[1, 0, 0]])
    regions = [HalfPlane(left_of=-1), HalfPlane(right_of=-4), Disk(centre=-2, radius=2), Cone(damping="1/2")]
    a, b, c = (Fraction(r.randint(10, 40), 10) for _ in range(3))  # real roots in [-4, -1], the last pair complex
    half = min(b - 1, 4 - b, b) / 4
    quadratic = (2 * b, b * b + half * half)
    W = matrix([[a + quadratic[0]], [a * quadratic[0] + quadratic[1]], [a * quadratic[1]]])
    assert characteristic_polynomial(subtract(exosystem.A, multiply(W, exosystem.C)))[1:] == (W[0][0], W[1][0], W[2][0])
    rows = gain_rows(exosystem, regions)
    assert rows
    assert all(value(row, W) >= 0 for row in rows)
    assert any(value(row, matrix([[0], [0], [0]])) < 0 for row in rows)
    assert c > 0


def test_an_unseen_exosystem_has_no_rows():
    assert gain_rows(Exosystem(A=[[-1]], C=[[0]]), [HalfPlane(left_of=-1)]) == ()


def test_each_region_has_its_image():
    polynomial = characteristic_polynomial(identity(2))
    assert [len(images(region, polynomial)[0]) for region in (HalfPlane(left_of=0), Disk(centre=0, radius=2))] == [3, 3]
    assert len(images(Cone(damping="1/2"), polynomial)[0]) == 5
