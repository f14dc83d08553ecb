"""Gains of a coupling on a box, sampled in floats: thousands of times as fast as enclosures, and never believed.

What is found with them is proved with enclosures afterwards, which may be a little wider.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np

from dobc_design.conditions.consensus.propose import nearest
from dobc_design.conditions.quadratic.sectors import GainRange
from dobc_design.coupling.coupling import Coupling
from dobc_design.solvers.program import Array

Gains = tuple[Array, Array]  # lowest and highest, (couplings, m, m)

POINTS: Final = 401
SCATTERED: Final = 600  # points in a box of several dimensions, besides its corners
WIDER: Final = 2e-5  # about what enclosures are widened and rounded by
_STEP: Final = 1e-6


def sample_gains(couplings: Sequence[Coupling], radius: float) -> Gains | None:
    """Lowest and highest gains of every coupling on |y_c| <= radius; None where one is not finite."""
    found = [_by_component(each, radius) if each.by_component else _of_vectors(each, radius) for each in couplings]
    low, high = np.array([pair[0] for pair in found]), np.array([pair[1] for pair in found])
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        return None
    margin = WIDER * np.where(high > low, np.maximum(np.abs(low), np.abs(high)), 0.0)
    return low - margin, high + margin


def range_gains(ranges: Sequence[GainRange], count: int, m: int) -> Gains:
    """The same arrays from enclosures; zero where a coupling is not used."""
    low, high = np.zeros((count, m, m)), np.zeros((count, m, m))
    for each in ranges:
        low[each.coupling] = [[nearest(gain.lo) for gain in row] for row in each.entries]
        high[each.coupling] = [[nearest(gain.hi) for gain in row] for row in each.entries]
    return low, high


def _by_component(coupling: Coupling, radius: float) -> Gains:
    """H(y)/y on a grid, and the slopes at 0."""
    y = np.linspace(-radius, radius, POINTS)
    y = y[np.abs(y) > 1e-9 * radius]
    m = coupling.dimension
    with np.errstate(all="ignore"):
        gains = coupling.value(np.repeat(y[:, None], m, axis=1))[:, 0] / y
    slope = coupling.jacobian_at_zero()[0][0]
    low = min(float(np.min(gains)), nearest(slope.lo))
    high = max(float(np.max(gains)), nearest(slope.hi))
    if coupling.is_linear:
        low = high = nearest(slope.midpoint)
    return low * np.eye(m), high * np.eye(m)


def _of_vectors(coupling: Coupling, radius: float) -> Gains:
    """Central differences at the corners, the centre and scattered points."""
    m = coupling.dimension
    corners = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=m))) if m <= 4 else np.zeros((1, m))
    scattered = np.random.default_rng(0).uniform(-1, 1, (SCATTERED, m))
    points = radius * np.concatenate([corners, scattered]) * (1 - _STEP)
    low, high = np.zeros((m, m)), np.zeros((m, m))
    for d in range(m):
        step = np.zeros(m)
        step[d] = _STEP * radius
        with np.errstate(all="ignore"):
            slopes = (coupling.value(points + step) - coupling.value(points - step)) / (2 * _STEP * radius)
        low[:, d], high[:, d] = np.min(slopes, axis=0), np.max(slopes, axis=0)
    flat = high - low < 1e-7 * (np.abs(high) + np.abs(low) + 1e-300)
    middle = (low + high) / 2
    return np.where(flat, middle, low), np.where(flat, middle, high)
