"""Proposals: the box followed in time, the certificate that takes over, and quadratic ones near the target."""

from fractions import Fraction

import numpy as np
import pytest
from lure_cases import HARMONIC, PAPER_GAIN, is_proved
from lure_cases import cycle as quadratic_cycle
from separable_problems import cycle, pair

from dobc_design.conditions.schedule import propose
from dobc_design.conditions.schedule.decide import open_segments, rate_near
from dobc_design.conditions.schedule.propose import Asked, approach
from dobc_design.conditions.separable.decide import largest_rate
from dobc_design.conditions.separable.propose import propose_separable, propose_vectors
from dobc_design.exact.matrix import to_float

F = Fraction


def asked(radius: int | Fraction, tolerance: Fraction) -> Asked:
    return Asked(radius=F(radius), disturbance=F(0), tolerance=tolerance)


def test_the_box_falls_like_the_agent_that_hears_nobody():
    """e_1 = 2 exp(-5 t), which no chord crosses; up to the slack of the rows."""
    problem = pair("exp(y) - 1 + y", k=5)
    tube, last = next(approach(problem, None, asked(2, F(1, 100)), limit=None))
    found = [(float(t), float(box[0])) for t, box in zip(tube.times, tube.upper, strict=True) if t <= 1]
    assert all(1 - 1e-9 <= face / (2 * np.exp(-5 * t)) <= 1.4 for t, face in found)
    assert 0.5 < rate_near(last) <= 2  # of e_2, whose coupling has the slope 2


def test_a_tube_begins_with_the_starts_and_every_segment_is_proved():
    problem = cycle(3)
    tube, _ = next(approach(problem, None, asked(2, F(1, 10)), limit=None))
    assert tube.upper[0] == tube.lower[0] == (2, 2, 2)
    assert open_segments(problem, tube, disturbance=F(0)) == []


def test_nothing_is_proposed_where_the_box_does_not_shrink():
    """From |e| <= 4 sin holds no box; without pins none shrinks."""
    assert not list(approach(cycle(3, h="sin(y)"), None, asked(4, F(1, 10)), limit=None))
    assert not list(approach(cycle(gains={}), None, asked(1, F(1, 10)), limit=None))
    assert not list(approach(cycle(3, exosystem=HARMONIC), None, asked(1, F(1, 10)), limit=None))  # without W


def test_vectors_for_a_part_of_the_rate_are_flatter_and_have_it():
    problem = cycle()
    best = propose_separable(problem, rho=2.0)
    full, half = propose_vectors(problem, rho=2.0, parts=(1.0, 0.5))
    assert np.max(half) < np.max(full)
    rate = largest_rate(problem, tuple(F(round(x * 10**6), 10**6) for x in half.tolist()), rho=F(2))
    assert float(rate) == pytest.approx(0.5 * best.rate, rel=0.03)


def test_quadratic_certificates_are_faster_at_smaller_radii_and_each_is_proved():
    problem = quadratic_cycle(3, {1: 5}, exosystem=HARMONIC)
    found = list(propose._quadratic(problem, PAPER_GAIN, [0.1, 0.5, 1.0], 0.1))
    assert [lure.radius for lure in found] == [F(1, 10), F(1, 2), 1]
    assert sorted((lure.rate for lure in found), reverse=True) == [lure.rate for lure in found]
    assert all(is_proved(problem, lure) for lure in found)
    assert list(propose._quadratic(problem, PAPER_GAIN, [0.1], 50.0)) == []  # none is as fast


def test_quadratic_certificates_of_a_linear_loop_reach_nearly_its_spectral_abscissa():
    (lure,) = propose._quadratic(pair("y", k=5), None, [1.0], 0.1)
    assert lure.radius is None
    assert 0.9 < float(lure.rate) <= 1  # e_2' = e_1 - e_2
    assert np.linalg.eigvalsh(to_float(lure.P_e.to_dense()))[0] > 0
