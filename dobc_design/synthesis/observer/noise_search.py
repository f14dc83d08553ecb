"""A gain W that keeps bounds on norms: direct search in W, for limits that no linear matrix inequality expresses.

The largest of norm/bound, |W|/limit and the excess of the spectrum over its regions is made smaller by Nelder and
Mead's method from several starts, until it is below 1. A proposal, as everything here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import optimize

from dobc_design.conditions.observer.propose import h2_norm, hinf_norm
from dobc_design.solvers.program import Array
from dobc_design.synthesis.observer.estimates import channels
from dobc_design.synthesis.observer.request import NoiseLimit
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, SpectralRegion

ENOUGH = 1 - 1e-4  # stop here: room for rounding
EVALUATIONS = 400  # per entry of W


class _Enough(Exception):
    """Raised inside the search when a point is good enough; carries it."""

    def __init__(self, W: Array) -> None:
        super().__init__()
        self.W = W


def quiet_gain(
    A: Array,
    C: Array,
    regions: Sequence[SpectralRegion],
    limits: Sequence[NoiseLimit],
    *,
    starts: Sequence[Array],
    gain: float | None = None,
) -> Array | None:
    """Look for W (q, m) with the spectrum of A - W C in the regions, all norms below their limits and |W| <= gain."""
    q, m = C.shape[1], C.shape[0]
    scale = max(1e-12, *(float(np.linalg.norm(W)) for W in starts)) if starts else 1.0

    def worst(x: Array) -> float:
        W = x.reshape(q, m) * scale
        value = _worst(A, C, W, regions, limits, gain)
        if value <= ENOUGH:
            raise _Enough(W)
        return value

    for start in starts:
        options = {"maxfev": EVALUATIONS * q * m, "xatol": 1e-7, "fatol": 1e-8, "adaptive": q * m > 4}
        try:
            with np.errstate(all="ignore"):
                optimize.minimize(worst, start.ravel() / scale, method="Nelder-Mead", options=options)
        except _Enough as found:
            return found.W
        except (np.linalg.LinAlgError, ValueError):
            continue
    return None


def _worst(
    A: Array, C: Array, W: Array, regions: Sequence[SpectralRegion], limits: Sequence[NoiseLimit], gain: float | None
) -> float:
    F = A - W @ C
    poles: Any = np.linalg.eigvals(F)
    size = max(1e-12, float(np.max(np.abs(poles))))
    outside = max(max(excess(region, complex(s)) for s in poles) for region in regions) / size
    if np.max(poles.real) >= 0:
        return 3.0 + outside
    values = [1.0 + outside] if outside > 0 else [0.0]
    if gain is not None:
        values.append(float(np.linalg.norm(W)) / gain)
    for limit in limits:
        norm = hinf_norm if limit.norm == "hinf" else h2_norm
        values.append(norm(F, *channels(F, C, W)[limit.channel]) / float(limit.bound))
    return min(max(values), 1e6)


def excess(region: SpectralRegion, s: complex) -> float:
    """How far a point lies outside a region (1/s); negative inside."""
    if isinstance(region, Disk):
        return abs(s - float(region.centre)) - float(region.radius)
    if isinstance(region, Cone):
        return float(region.damping) * abs(s) + s.real
    low, high = region.real_ends
    return s.real - float(high) if high is not None else float(low or 0) - s.real
