"""The smallest gain for a region: closed forms, and nothing better among thousands of feasible neighbours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dobc_design.exact.matrix import to_float
from dobc_design.problem import exosystems
from dobc_design.synthesis.observer.candidates import Plant, contracted, fastest_gain
from dobc_design.synthesis.observer.gain_bound import propose_multipliers
from dobc_design.synthesis.observer.gain_optimum import gain_for_polynomial, smallest_gain
from dobc_design.synthesis.observer.impossible import least_gain_squared
from dobc_design.synthesis.observer.spectral_conditions import gain_rows
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, HalfPlane

SHAPES = {
    "harmonic": exosystems.harmonics(2),
    "ramp": exosystems.ramp(),
    "parabola": exosystems.polynomial(2),
    "two": exosystems.harmonics([1, 3]),
    "periodic": exosystems.periodic(1, harmonics_kept=2),
}
REGIONS = {
    "rate": [HalfPlane(left_of=-1)],
    "cone": [HalfPlane(left_of=-1), Cone(damping="0.8")],
    "disk": [HalfPlane(left_of="-1/2"), Disk(centre=-2, radius="1.6")],
    "strip": [HalfPlane(left_of=-2), HalfPlane(right_of=-3), Cone(damping="1/2")],
}


def pair(exosystem):
    return to_float(exosystem.A), to_float(exosystem.C)


def inside(regions, poles, slack=0.0) -> bool:
    """Every pole in every closed region, written out here and not taken from the code."""
    for region in regions:
        for s in poles:
            if isinstance(region, Disk):
                out = abs(s - float(region.centre)) - float(region.radius)
            elif isinstance(region, Cone):
                out = float(region.damping) * abs(s) + s.real
            elif region.left_of is not None:
                out = s.real - float(region.left_of)
            else:
                out = float(region.right_of) - s.real
            if out > slack:
                return False
    return True


@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0, 3.0, 10.0])
def test_a_harmonic_has_its_smallest_gain_in_closed_form(rate):
    """s^2 + w1 s + 4 + 2 w2 with Re <= -rate: w1 >= 2 rate, and w2 = rate^2/2 - 2 from the rate 2 on."""
    found = smallest_gain(*pair(SHAPES["harmonic"]), [HalfPlane(left_of=-rate)])
    assert found.size == pytest.approx(math.hypot(2 * rate, max(0.0, rate**2 / 2 - 2)), rel=1e-9)


def test_two_constants_seen_apart_need_the_rate_in_each():
    """tr W >= 2 rate, so |W| >= sqrt(2) rate, and W = rate I has that."""
    A, C = pair(exosystems.stacked(exosystems.constant(), exosystems.constant()))
    found = smallest_gain(A, C, [HalfPlane(left_of=-3)])
    assert pytest.approx(3 * np.eye(2), abs=1e-4) == found.W
    assert found.size == pytest.approx(3 * math.sqrt(2), rel=1e-6)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_polynomial_disturbance_has_all_poles_at_the_rate(degree):
    """In observer form W holds the coefficients, all of which grow with every root: (s + 2)^(degree + 1)."""
    found = smallest_gain(*pair(exosystems.polynomial(degree)), [HalfPlane(left_of=-2)])
    assert found.W.ravel() == pytest.approx([math.comb(degree + 1, k) * 2.0**k for k in range(1, degree + 2)], rel=1e-6)


def test_a_cone_is_met_at_its_border_in_closed_form():
    """Poles -1 +- i sqrt(1/z^2 - 1): w1 = 2 and 4 + 2 w2 = 1/z^2."""
    found = smallest_gain(*pair(SHAPES["harmonic"]), [HalfPlane(left_of=-1), Cone(damping="0.8")])
    assert found.W.ravel() == pytest.approx([2, (1 / 0.64 - 4) / 2], rel=1e-6)


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("shape", SHAPES)
def test_no_feasible_neighbour_is_smaller(shape, region):
    """2000 perturbations of each kind: of W itself, and of the poles within the regions, from tiny to large."""
    A, C = pair(SHAPES[shape])
    regions = REGIONS[region]
    found = smallest_gain(A, C, regions)
    q = len(A)
    poles = np.linalg.eigvals(A - found.W @ C)
    assert inside(regions, poles, slack=3e-3 * np.max(np.abs(poles)))  # eigenvalues that meet are badly conditioned
    r = np.random.default_rng(1)
    feasible = 0
    for k in range(4000):
        size = 10 ** r.uniform(-7, 0.3)
        if k % 2:
            W = found.W + found.size * size * r.normal(size=found.W.shape)
            if not inside(regions, np.linalg.eigvals(A - W @ C)):
                continue
        else:
            moved = poles + size * (r.normal(size=q) + 1j * r.normal(size=q))
            half = [complex(z) for z in moved[: q // 2]]
            spectrum = [w for z in half for w in (z, z.conjugate())] + [complex(moved[-1].real)] * (q % 2)
            if k % 4 == 0:
                spectrum = [complex(z.real) for z in spectrum]
            spectrum = [pushed(regions, z) for z in spectrum]
            polynomial = np.real(np.poly(spectrum))
            W = gain_for_polynomial(A, C, polynomial, seed=0)
            assert np.poly(A - W @ C) == pytest.approx(polynomial, rel=1e-6, abs=1e-6 * np.max(polynomial))
        feasible += 1
        assert np.linalg.norm(W) >= found.size * (1 - 1e-6)
    assert feasible >= 2000


def pushed(regions, z: complex) -> complex:
    """A point on the way from z to a real point of all regions that lies in them."""
    low = max((float(x) for x, _ in (g.real_ends for g in regions) if x is not None), default=-5.0)
    high = min((float(x) for _, x in (g.real_ends for g in regions) if x is not None), default=0.0)
    middle = (low + high) / 2
    outer, inner = 0.0, 1.0
    if inside(regions, [z]):
        return z
    for _ in range(60):
        part = (outer + inner) / 2
        if inside(regions, [z + part * (middle - z)]):
            inner = part
        else:
            outer = part
    return z + inner * (middle - z)


@pytest.mark.parametrize("shape", ["harmonic", "ramp", "parabola"])
def test_the_proved_bound_meets_the_optimum_where_it_is_tight(shape):
    """Up to order 2 nonnegative coefficients are Hurwitz; for s^3 the optimum has the coefficients of (s + 1)^3."""
    rows = gain_rows(SHAPES[shape], REGIONS["rate"])
    bound = math.sqrt(least_gain_squared(rows, propose_multipliers(rows)))
    found = smallest_gain(*pair(SHAPES[shape]), REGIONS["rate"])
    assert bound <= found.size * (1 + 1e-9)
    assert bound == pytest.approx(found.size, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("region", REGIONS)
def test_the_proved_bound_never_exceeds_the_optimum(shape, region):
    rows = gain_rows(SHAPES[shape], REGIONS[region])
    found = smallest_gain(*pair(SHAPES[shape]), REGIONS[region])
    assert math.sqrt(least_gain_squared(rows, propose_multipliers(rows))) <= found.size * (1 + 1e-9)


@pytest.mark.parametrize("limit", [0.5, 3.0, 6.5, 52.0])
def test_the_fastest_gain_inverts_the_smallest(limit):
    """Of a harmonic of 2 rad/s: 2 rate up to 4, then the root of (2 rate)^2 + (rate^2/2 - 2)^2 = rate^2/2 + 2."""
    A, C = pair(SHAPES["harmonic"])
    plant = Plant(A=A, C=C, T=np.eye(2), regions=(HalfPlane(left_of=0),), sampled=False)
    rate, found = fastest_gain(plant, limit=limit)
    assert found.size <= limit
    assert rate == pytest.approx(limit / 2 if limit <= 4 else math.sqrt(2 * limit - 4), rel=1e-6)


def test_no_gain_is_found_where_the_regions_have_no_common_point():
    assert smallest_gain(*pair(SHAPES["harmonic"]), [HalfPlane(left_of=-3), Disk(centre=0, radius=2)]) is None


def test_contracted_regions_lie_inside():
    regions = (HalfPlane(left_of=-1), HalfPlane(right_of=-4), Disk(centre=-2, radius=2), Cone(damping="1/2"))
    smaller = contracted(regions, 0.1)
    assert smaller[0].left_of < -1
    assert smaller[1].right_of > -4
    assert smaller[2].radius < 2
    assert smaller[3].damping > 0.5
    assert contracted(regions, 0.0) == regions
