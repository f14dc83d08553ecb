"""Norms in floats, against python-control's own, and the peak of the transient."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dobc_design.conditions.observer.norms import h2_norm, hinf_norm, transient_peak
from dobc_design.exact.matrix import matrix
from dobc_design.problem import exosystems
from dobc_design.synthesis.observer.propose import estimate_observer


@pytest.mark.parametrize("seed", range(50))
def test_norms_of_fifty_random_systems_are_those_of_python_control(seed):
    import control

    r = np.random.default_rng(seed)
    q, u = int(r.integers(1, 8)), int(r.integers(1, 4))
    F = r.normal(size=(q, q))
    F -= (np.max(np.linalg.eigvals(F).real) + r.uniform(0.05, 1)) * np.eye(q)
    B, C, D = r.normal(size=(q, u)), r.normal(size=(u, q)), r.normal(size=(u, u)) * (seed % 2)
    system = control.ss(F, B, C, D, remove_useless_states=False)
    assert hinf_norm(F, B, C, D) == pytest.approx(control.norm(system, "inf", tol=1e-10), rel=1e-6)
    if seed % 2 == 0:
        assert h2_norm(F, B, C, D) == pytest.approx(control.norm(system, 2), rel=1e-6)
    else:
        assert h2_norm(F, B, C, D) == math.inf


def test_what_grows_has_no_norm():
    one, zero = np.eye(1), np.zeros((1, 1))
    for F in (one, zero):
        assert hinf_norm(F, one, one, zero) == h2_norm(F, one, one, zero) == transient_peak(F) == math.inf


def test_a_system_without_input_has_the_norm_zero():
    one, zero = np.eye(1), np.zeros((1, 1))
    assert hinf_norm(-one, zero, one, zero) == 0
    assert h2_norm(-one, zero, one, zero) == 0


def test_a_gain_that_is_largest_at_infinity_is_found():
    """s/(s + 1) = 1 - 1/(s + 1)."""
    one = np.eye(1)
    assert hinf_norm(-one, one, -one, one) == pytest.approx(1, rel=1e-9)


def test_the_peak_of_a_shear_is_that_of_its_formula():
    """F = [[-1, k], [0, -1]]: exp(Ft) = exp(-t) [[1, kt], [0, 1]]."""
    k = 10.0
    t = np.linspace(0, 8, 20001)
    shear = (k * t) ** 2 / 2 + 1
    expected = np.max(np.exp(-t) * np.sqrt(shear + np.sqrt(shear**2 - 1)))
    assert transient_peak(np.array([[-1.0, k], [0.0, -1.0]])) == pytest.approx(expected, rel=1e-3)


def test_estimates_of_the_paper_gain_are_its_known_answers():
    """Eigenvalues -8/5 +- (2/5) sqrt(39) i."""
    found = estimate_observer(exosystems.harmonics(2), matrix([["16/5"], ["12/5"]]))
    assert found["rate"] == pytest.approx(1.6)
    assert found["damping"] == pytest.approx(4 / math.sqrt(55))


def test_estimates_of_numbers_beyond_the_floats_are_absent():
    assert estimate_observer(exosystems.constant(), matrix([["1e399"]])) == {}
