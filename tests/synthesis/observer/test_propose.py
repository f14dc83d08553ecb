"""What floating point proposes: the inequalities by eigenvalues and python-control, norms and estimates."""

import math

import numpy as np
import pytest
from scipy import linalg

from dobc_design.conditions.observer.propose import hinf_norm, transient_peak
from dobc_design.exact.matrix import matrix, to_float
from dobc_design.problem import exosystems
from dobc_design.synthesis.observer.claim import Cone, Disk, HalfPlane, NoiseLimit
from dobc_design.synthesis.observer.propose import estimate_observer, lmi_gain

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


@pytest.mark.parametrize("channel", ["disturbance", "exosystem"])
@pytest.mark.parametrize(("norm", "bound"), [("hinf", "1.5"), ("h2", "1.6")])
def test_norms_stay_below_their_bounds(channel, norm, bound):
    W = gain(regions=[STABLE], noise=[NoiseLimit(channel=channel, norm=norm, bound=bound)])
    F, B, output, D = parts(channel, W)
    gramian = linalg.solve_continuous_lyapunov(F, -B @ B.T)
    value = math.sqrt(np.trace(output @ gramian @ output.T)) if norm == "h2" else hinf_norm(F, B, output, D)
    assert 0 < value <= float(bound) * (1 + 1e-6)


def test_a_norm_below_what_any_observer_has_is_not_reached_whatever_the_solver_says():
    """The disturbance channel is 1 at the exosystem's own frequencies."""
    W = lmi_gain(A, C, [STABLE], noise=[NoiseLimit(channel="disturbance", bound="0.99")])
    assert W is None or hinf_norm(*parts("disturbance", W)) > 1 - 1e-6


def test_norms_are_infinite_zero_or_largest_at_infinity_where_they_should():
    """What does not decay; a system without input; and s/(s + 1) = 1 - 1/(s + 1)."""
    one, zero = np.eye(1), np.zeros((1, 1))
    assert all(hinf_norm(F, one, one, zero) == transient_peak(F) == math.inf for F in (one, zero))
    assert hinf_norm(-one, zero, one, zero) == 0
    assert hinf_norm(-one, one, -one, one) == pytest.approx(1, rel=1e-9)


def test_the_peak_of_a_shear_is_that_of_its_formula():
    """F = [[-1, k], [0, -1]]: exp(Ft) = exp(-t) [[1, kt], [0, 1]]."""
    k = 10.0
    t = np.linspace(0, 8, 20001)
    shear = (k * t) ** 2 / 2 + 1
    expected = np.max(np.exp(-t) * np.sqrt(shear + np.sqrt(shear**2 - 1)))
    assert transient_peak(np.array([[-1.0, k], [0.0, -1.0]])) == pytest.approx(expected, rel=1e-3)


def test_estimates_of_the_paper_gain_are_its_known_answers():
    """Eigenvalues -8/5 +- (2/5) sqrt(39) i; numbers beyond the floats have none."""
    found = estimate_observer(exosystems.harmonics(2), matrix([["16/5"], ["12/5"]]))
    assert found["rate"] == pytest.approx(1.6)
    assert found["damping"] == pytest.approx(4 / math.sqrt(55))
    assert estimate_observer(exosystems.constant(), matrix([["1e399"]])) == {}
