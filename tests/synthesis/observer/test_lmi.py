"""The inequalities for (P, Q): what they promise holds for W = P^-1 Q, seen from the eigenvalues and python-control."""

from __future__ import annotations

import numpy as np
import pytest

from dobc_design.conditions.observer.norms import h2_norm, hinf_norm
from dobc_design.exact.matrix import to_float
from dobc_design.problem import exosystems
from dobc_design.synthesis.observer.propose import lmi_gain
from dobc_design.synthesis.observer.request import Cone, Disk, HalfPlane, NoiseLimit

TWO = exosystems.harmonics([1, 3])
A, C = to_float(TWO.A), to_float(TWO.C)
STABLE = HalfPlane(left_of=0)


def gain(**asked):
    W = lmi_gain(A, C, **asked)
    assert W is not None
    return W


def parts(channel, W):
    """F, B, C, D of C (sI - F)^-1 W, or of C (sI - F)^-1."""
    B = W if channel == "disturbance" else np.eye(len(A))
    return A - W @ C, B, C, np.zeros((len(C), B.shape[1]))


@pytest.mark.parametrize(
    ("region", "distance"),
    [
        (HalfPlane(left_of=-1), lambda s: np.max(s.real) + 1),
        (Disk(centre=-2, radius="3/2"), lambda s: np.max(np.abs(s + 2)) - 1.5),
        (Cone(damping="0.7"), lambda s: np.max(s.real + 0.7 * np.abs(s))),
    ],
)
def test_the_spectrum_lies_in_the_region(region, distance):
    W = gain(regions=[HalfPlane(left_of="-1/2"), region])
    assert distance(np.linalg.eigvals(A - W @ C)) < 1e-6
    assert distance(np.linalg.eigvals(A)) > 0.1


def test_a_bound_on_the_fastest_pole_is_kept():
    W = gain(regions=[HalfPlane(left_of=-1), HalfPlane(right_of="-1.5")])
    assert np.min(np.linalg.eigvals(A - W @ C).real) > -1.5 - 1e-6


@pytest.mark.parametrize(
    ("channel", "norm", "bound"),
    [
        ("disturbance", "hinf", "1.2"),
        ("exosystem", "hinf", "1.5"),
        ("disturbance", "h2", "1.2"),
        ("exosystem", "h2", "1.6"),
    ],
)
def test_norms_stay_below_their_bounds(channel, norm, bound):
    W = gain(regions=[STABLE], noise=[NoiseLimit(channel=channel, norm=norm, bound=bound)])
    value = (h2_norm if norm == "h2" else hinf_norm)(*parts(channel, W))
    assert 0 < value <= float(bound) * (1 + 1e-6)


def test_a_norm_below_what_any_observer_has_is_not_reached_whatever_the_solver_says():
    """The disturbance channel is 1 at the exosystem's own frequencies."""
    W = lmi_gain(A, C, [STABLE], noise=[NoiseLimit(channel="disturbance", bound="0.99")])
    assert W is None or hinf_norm(*parts("disturbance", W)) > 1 - 1e-6
