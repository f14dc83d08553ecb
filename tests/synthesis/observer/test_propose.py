"""What floating point proposes: the inequalities by eigenvalues and python-control, norms and
estimates."""

import math

import numpy as np
import pytest

from dobc_design.conditions.observer.propose import hinf_norm, transient_peak


def test_norms_are_infinite_zero_or_largest_at_infinity_where_they_should():
    """What does not decay; a system without input; and s/(s + 1) = 1 - 1/(s + 1)."""
    one = np.eye(1)
    zero = np.zeros((1, 1))
    for F in (one, zero):
        found = hinf_norm(F, one, one, zero)
        assert found == transient_peak(F) == math.inf
    assert hinf_norm(-one, zero, one, zero) == 0
    found = hinf_norm(-one, one, -one, one)
    assert found == pytest.approx(1, rel=1e-9)


def test_the_peak_of_a_shear_is_that_of_its_formula():
    """F = [[-1, k], [0, -1]]: exp(Ft) = exp(-t) [[1, kt], [0, 1]]."""
    k = 10.0
    t = np.linspace(0, 8, 20001)
    shear = (k * t) ** 2 / 2 + 1
    growth = np.sqrt(shear + np.sqrt(shear**2 - 1))
    expected = np.max(np.exp(-t) * growth)
    shear_matrix = [[-1.0, k], [0.0, -1.0]]
    found = transient_peak(np.array(shear_matrix))
    assert found == pytest.approx(expected, rel=1e-3)
