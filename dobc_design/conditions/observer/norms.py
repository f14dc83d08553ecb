"""H2 and H-infinity norms of state-space systems, and the peak of exp(F t), in floats: estimates to be decided exactly.

H2: tr C X C' with F X + X F' + B B' = 0. H-infinity: two-step bisection on the Hamiltonian matrix (Bruinsma and
Steinbuch 1990). An estimate that cannot be had is nan.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design.solvers.program import Array

TOLERANCE = 1e-10
STEPS = 60
SMALLEST = 1e-140  # its square is still a float
SAMPLES = 400
AROUND = (0.3, 0.7, 1.0, 1.4, 3.0, 10.0)  # frequencies tried, in parts of the size of each pole


def h2_norm(F: Array, B: Array, C: Array, D: Array) -> float:
    """The H2 norm of C (sI - F)^-1 B + D; inf if D is not 0 or F is not Hurwitz.

    Shapes: F (q, q), B (q, u), C (y, q), D (y, u).
    """
    if np.any(D) or not _hurwitz(F):
        return math.inf
    X = linalg.solve_continuous_lyapunov(F, -B @ B.T)
    return math.sqrt(max(0.0, float(np.trace(C @ X @ C.T))))


def hinf_norm(F: Array, B: Array, C: Array, D: Array) -> float:
    """The H-infinity norm of C (sI - F)^-1 B + D, the largest gain over the frequencies; inf if F is not Hurwitz."""
    if not _hurwitz(F):
        return math.inf
    poles = np.linalg.eigvals(F)
    tried = [0.0, *(float(x) * abs(z) for z in poles for x in AROUND), *np.abs(poles.imag).tolist()]
    low = max([_gain(F, B, C, D, w) for w in tried] + [float(np.linalg.norm(D, 2))])
    if low < SMALLEST:
        return low
    for _ in range(STEPS):
        level = (1 + 2 * TOLERANCE) * low
        crossings = _crossings(F, B, C, D, level)
        if not len(crossings):
            return low
        # With D not 0 the gain may stay above the level up to infinity: look beyond the last crossing as well.
        middles = np.array([*(crossings[1:] + crossings[:-1]) / 2, crossings[0] / 2, 2 * crossings[-1]])
        better = max(_gain(F, B, C, D, float(w)) for w in middles)
        if better <= level:
            return max(low, better)
        low = better
    return low


def transient_peak(F: Array) -> float:
    """The largest |exp(F t)| (spectral norm) over a grid of t >= 0: how far the error swings out; inf if it grows."""
    if not _hurwitz(F):
        return math.inf
    slowest = float(-np.max(np.linalg.eigvals(F).real))
    step = linalg.expm(F * (8.0 / slowest / SAMPLES))
    peak, power = 1.0, np.eye(len(F))
    for _ in range(SAMPLES):
        power = step @ power
        peak = max(peak, float(np.linalg.norm(power, 2)))
    return peak


def _hurwitz(F: Array) -> bool:
    return bool(np.all(np.isfinite(F))) and float(np.max(np.linalg.eigvals(F).real)) < 0


def _gain(F: Array, B: Array, C: Array, D: Array, frequency: float) -> float:
    value: Any = C @ np.linalg.solve(1j * frequency * np.eye(len(F)) - F, B.astype(complex)) + D
    return float(np.linalg.norm(value, 2))


def _crossings(F: Array, B: Array, C: Array, D: Array, level: float) -> Array:
    """Frequencies at which a singular value crosses the level: imaginary eigenvalues of the Hamiltonian matrix."""
    room = level**2 * np.eye(B.shape[1]) - D.T @ D
    R = np.linalg.inv(room)
    closed = F + B @ R @ D.T @ C
    hamiltonian = np.block([[closed, B @ R @ B.T], [-C.T @ (np.eye(len(C)) + D @ R @ D.T) @ C, -closed.T]])
    values = np.linalg.eigvals(hamiltonian)
    scale = max(1.0, float(np.max(np.abs(values))))
    return np.sort(values.imag[(np.abs(values.real) < 1e-8 * scale) & (values.imag >= 0)])
