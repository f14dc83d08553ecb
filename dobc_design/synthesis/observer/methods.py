"""Gains by the two textbook methods: Kalman's optimum and pole placement, both through python-control.

On the same footing as the inequalities: proposals in floats, to be rounded and proved.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design.solvers.program import Array
from dobc_design.synthesis.observer.gain_optimum import regions_hold
from dobc_design.synthesis.observer.spectral_regions import Disk, SpectralRegion, common_interval

# How far the spectrum is shifted beyond what is asked, in parts of the rate.
SHIFTS = (0.0, 1.0, 1.05, 1.5, 2.0)
SPREAD = (0.0, 1e-3, 1e-2, 0.1)
# Ratios of process to measurement noise, tried from fast to slow.
RATIOS = tuple(10.0 ** (k / 2) for k in range(6, -13, -1))


def kalman_gain(A: Array, C: Array, *, process: float = 1.0, sampled: bool = False) -> Array | None:
    """python-control's lqe (or dlqe) with G = I, process noise ``process`` I and measurement noise I; None if it fails.

    Shapes: A (q, q), C (m, q), W (q, m).  For dlqe the gain is that of the predictor.
    """
    import control  # takes a second to import

    q, m = len(A), len(C)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            solve = control.dlqe if sampled else control.lqe
            gain = np.asarray(solve(A, np.eye(q), C, process * np.eye(q), np.eye(m))[0], dtype=float)
    except (ValueError, ArithmeticError, linalg.LinAlgError):
        return None
    gain = gain.reshape(q, m)
    return gain if np.all(np.isfinite(gain)) else None


def kalman_gains(
    A: Array, C: Array, regions: Sequence[SpectralRegion], *, sampled: bool
) -> Iterator[tuple[Array, str]]:
    """The Kalman gain with unit weights, then those of A + shift I, or of A / radius, which decay faster."""
    plain = kalman_gain(A, C, sampled=sampled)
    if plain is not None:
        yield plain, "Kalman gain with unit weights"
    if sampled:
        radius = min((float(r.radius) for r in regions if isinstance(r, Disk) and not r.centre), default=1.0)
        for factor in (1.0, 0.95, 0.7):
            gain = kalman_gain(A / (radius * factor), C, sampled=True)
            if gain is not None:
                yield radius * factor * gain, "Kalman gain of A / exp(-rate T)"
        return
    common = common_interval(tuple(regions))
    rate = 0.0 if common is None or common[1] is None else -float(common[1])
    for shift in SHIFTS[1:] if rate else ():
        gain = kalman_gain(A + shift * rate * np.eye(len(A)), C)
        if gain is not None:
            yield gain, f"Kalman gain of A + {shift:g} rate I"


def placed(A: Array, C: Array, poles: Array) -> Array | None:
    """control.place of the transposed pair: W (q, m) with the spectrum of A - W C at ``poles``; None if it fails."""
    import control  # takes a second to import

    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # that robust placement has not converged does not matter here
            gain = np.asarray(control.place(A.T, C.T, poles), dtype=float).T
    except (ValueError, ArithmeticError, linalg.LinAlgError):
        return None
    return gain if np.all(np.isfinite(gain)) else None


def placed_candidates(A: Array, C: Array, regions: Sequence[SpectralRegion]) -> Iterator[tuple[Array, str]]:
    """Poles of A moved into the regions, kept apart, and then real ones; every choice a little deeper inside."""
    common = common_interval(tuple(regions))
    if common is None:
        return
    own: Any = np.linalg.eigvals(A)
    size = max(float(np.max(np.abs(own), initial=0.0)), *(abs(float(x)) for x in common if x is not None), 1e-9)
    high = size if common[1] is None else float(common[1])
    low = high - 2 * size if common[0] is None else float(common[0])
    for depth in (0.02, 0.1, 0.3, 0.5):
        middle = high - depth * (high - low)
        for spread in SPREAD:
            apart = np.array([1 + spread * k for k in _pair_numbers(own)])
            poles = []
            for z in middle + (own - own.real) * apart + (apart - 1) * (low - high) / 4:
                poles.append(_inside(complex(z), regions, middle))
            gain = placed(A, C, np.array(poles))
            if gain is not None:
                yield gain, "pole placement"
        gain = placed(A, C, np.linspace(middle, middle + (low - high) * min(depth, 0.2), len(A)))
        if gain is not None:
            yield gain, "pole placement, real poles"


def _pair_numbers(poles: Any) -> list[int]:
    """The same number for both members of a conjugate pair, others counted on."""
    numbers: list[int] = []
    seen: list[tuple[float, float]] = []
    for z in poles:
        key = (round(float(z.real), 9), round(abs(float(z.imag)), 9))
        numbers.append(seen.index(key) if key in seen and z.imag else len(seen))
        seen.append(key)
    return numbers


def _inside(z: complex, regions: Sequence[SpectralRegion], middle: float) -> complex:
    for _ in range(200):
        if regions_hold(regions, z):
            break
        z = middle + 0.97 * (z - middle)
    return z
