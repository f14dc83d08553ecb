"""Estimates in floats of what a gain W does: decay, damping, norms of the three channels, peak of the transient."""

from __future__ import annotations

import numpy as np

from dobc_design.conditions.observer.propose import h2_norm, hinf_norm, transient_peak
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.problem.exosystem import Exosystem
from dobc_design.solvers.program import Array


def estimate_observer(exosystem: Exosystem, W: Matrix) -> dict[str, float]:
    """Rate (1/s), damping, "hinf <channel>", "h2 <channel>", peak; nothing where floats fail."""
    try:
        A, C, gain = to_float(exosystem.A), to_float(exosystem.C), to_float(W)
        F = A - gain @ C
        poles = np.linalg.eigvals(F)
        result = {"rate": float(-np.max(poles.real)), "peak": transient_peak(F)}
        sizes = np.where(np.abs(poles) > 0, np.abs(poles), 1.0)
        result["damping"] = float(np.min(-poles.real / sizes))
        for name, (B, output, D) in channels(F, C, gain).items():
            result[f"hinf {name}"] = hinf_norm(F, B, output, D)
            result[f"h2 {name}"] = h2_norm(F, B, output, D)
    except (SpecError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return {}
    return result


def channels(F: Array, C: Array, W: Array) -> dict[str, tuple[Array, Array, Array]]:
    """B, C, D of each channel, with F = A - W C (``norms`` has the same, exactly)."""
    m, q = C.shape
    return {
        "measurement": (W, C @ F, C @ W),
        "disturbance": (W, C, np.zeros((m, m))),
        "exosystem": (np.eye(q), C, np.zeros((m, q))),
    }
