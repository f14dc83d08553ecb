"""The inequalities for (P, Q): what they promise holds for W = P^-1 Q, seen from the eigenvalues and python-control."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.conditions.observer.propose import h2_norm, hinf_norm, transient_peak
from dobc_design.exact.matrix import to_float
from dobc_design.problem import exosystems
from dobc_design.synthesis.observer.estimates import channels
from dobc_design.synthesis.observer.lmi import solve_lmi
from dobc_design.synthesis.observer.request import NoiseLimit
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, HalfPlane

TWO = exosystems.harmonics([1, 3])
A, C = to_float(TWO.A), to_float(TWO.C)
STABLE = HalfPlane(left_of=0)


def gain(time=1.0, **asked):
    answer = solve_lmi(A, C, time=time, **asked)
    assert answer.found
    return time * np.linalg.solve(answer.values["P"], answer.values["Q"]), answer.values["P"]


@pytest.mark.parametrize("time", [1.0, 3.0])
@pytest.mark.parametrize(
    ("region", "distance"),
    [
        (HalfPlane(left_of=-1), lambda s: np.max(s.real) + 1),
        (Disk(centre=-2, radius="3/2"), lambda s: np.max(np.abs(s + 2)) - 1.5),
        (Cone(damping="0.7"), lambda s: np.max(s.real + 0.7 * np.abs(s))),
    ],
)
def test_the_spectrum_lies_in_the_region_whatever_the_unit_of_time(region, distance, time):
    W, _ = gain(time, regions=[HalfPlane(left_of="-1/2"), region])
    assert distance(np.linalg.eigvals(A - W @ C)) < 1e-6
    assert distance(np.linalg.eigvals(A)) > 0.1


def test_a_bound_on_the_fastest_pole_is_kept():
    W, _ = gain(regions=[HalfPlane(left_of=-1), HalfPlane(right_of="-1.5")])
    assert np.min(np.linalg.eigvals(A - W @ C).real) > -1.5 - 1e-6


def test_the_gain_and_the_peak_are_bounded():
    regions = [HalfPlane(left_of="-1/10")]
    W, _ = gain(regions=regions, gain=1.0)
    assert np.linalg.norm(W) <= 1 + 1e-6
    W, P = gain(regions=regions, peak=2.0)
    values = np.linalg.eigvalsh(P)
    assert values[-1] / values[0] <= 4 + 1e-6
    assert transient_peak(A - W @ C) <= 2


@pytest.mark.parametrize("time", [1.0, 3.0])
@pytest.mark.parametrize(
    ("channel", "norm", "bound"),
    [
        ("disturbance", "hinf", "1.2"),
        ("exosystem", "hinf", "1.5"),
        ("disturbance", "h2", "1.2"),
        ("exosystem", "h2", "1.6"),
    ],
)
def test_norms_stay_below_their_bounds(channel, norm, bound, time):
    W, _ = gain(time, regions=[STABLE], noise=[NoiseLimit(channel=channel, norm=norm, bound=bound)])
    F = A - W @ C
    value = (h2_norm if norm == "h2" else hinf_norm)(F, *channels(F, C, W)[channel])
    assert 0 < value <= float(bound) * (1 + 1e-6)


def test_a_norm_below_what_any_observer_has_is_not_reached_whatever_the_solver_says():
    """The disturbance channel is 1 at the exosystem's own frequencies."""
    answer = solve_lmi(A, C, [STABLE], noise=[NoiseLimit(channel="disturbance", bound="0.99")])
    assert answer.status != "Solved"
    if answer.found:
        W = np.linalg.solve(answer.values["P"], answer.values["Q"])
        F = A - W @ C
        assert hinf_norm(F, *channels(F, C, W)["disturbance"]) > 1 - 1e-6
