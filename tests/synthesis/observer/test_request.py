"""Requests and regions are exact, and wrong ones are refused with the key and a cure."""

from __future__ import annotations

from fractions import Fraction

import pytest

from dobc_design.errors import SpecError
from dobc_design.synthesis.observer.request import (
    Cone,
    Disk,
    HalfPlane,
    NoiseLimit,
    common_interval,
    read_observer_request,
)


def test_numbers_are_read_as_typed():
    request = read_observer_request(rate=0.1, region=Cone(damping=0.7), noise=2.5)
    assert request.rate == Fraction(1, 10)
    assert request.regions[0].damping == Fraction(7, 10)
    assert request.noise == (NoiseLimit(channel="measurement", norm="hinf", bound="5/2"),)


def test_the_rate_is_a_half_plane_before_the_regions():
    request = read_observer_request(rate=2, region=[Disk(centre=-3, radius=1)])
    assert request.all_regions == (HalfPlane(left_of=-2), Disk(centre=-3, radius=1))
    assert read_observer_request().all_regions == (HalfPlane(left_of=0),)


@pytest.mark.parametrize(
    ("regions", "expected"),
    [
        ([HalfPlane(left_of=-1)], (None, -1)),
        ([HalfPlane(right_of=-9), Cone(damping="1/2")], (-9, 0)),
        ([HalfPlane(left_of=-3), Disk(centre=0, radius=2)], None),
        ([HalfPlane(left_of=-2), Disk(centre=0, radius=2)], (-2, -2)),
    ],
)
def test_the_common_part_is_seen_on_the_real_axis(regions, expected):
    assert common_interval(tuple(regions)) == expected


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (HalfPlane, "one side, left_of or right_of; got neither"),
        (lambda: HalfPlane(left_of=1, right_of=0), "got both"),
        (lambda: Disk(centre=0, radius=0), "region.radius must be > 0"),
        (lambda: Cone(damping=1), "region.damping must lie between 0 and 1"),
        (lambda: Cone(damping=0), "region.damping must lie between 0 and 1"),
        (lambda: read_observer_request(region="left"), "HalfPlane, a Disk or a Cone"),
        (lambda: read_observer_request(rate=0), "rate must be > 0"),
        (lambda: read_observer_request(digits=0), "digits must be an integer from 1 to 15"),
        (lambda: read_observer_request(period=0), "period must be > 0"),
        (lambda: read_observer_request(period=1, noise=1), "noise cannot be asked of a sampled observer"),
        (lambda: read_observer_request(period=1, region=Cone(damping="1/2")), "must be a Disk for a sampled observer"),
        (lambda: NoiseLimit(bound=1, channel="wind"), "noise.channel must be one of"),
        (lambda: NoiseLimit(bound=1, norm="h3"), "noise.norm must be one of"),
        (lambda: NoiseLimit(bound=0), "noise must be > 0"),
        (lambda: read_observer_request(noise="loud"), "noise must be a number"),
    ],
)
def test_wrong_requests_name_their_key(call, match):
    with pytest.raises(SpecError, match=match):
        call()
