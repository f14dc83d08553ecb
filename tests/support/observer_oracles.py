"""Norms and sampled errors of an observer by python-control and SciPy."""

import numpy as np
from scipy import linalg

from dobc_design.exact.matrix import to_float
from dobc_design.synthesis.observer.decide import StateSpace


def sampled_in_floats(exosystem, gain, period):
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    q = len(A)
    block = linalg.expm(np.block([[A, np.eye(q)], [np.zeros((q, 2 * q))]]) * period)
    return block[:q, :q] - to_float(gain) @ (C @ block[:q, q:] / period)


def control_norm(system: StateSpace, kind) -> float:
    """python-control's norm; it wants as many inputs as outputs, so zeros are added, which change
    no norm."""
    import control

    F, B, C, D = (to_float(x) for x in (system.F, system.B, system.C, system.D))
    size = max(B.shape[1], C.shape[0])
    wide, tall, both = np.zeros((len(F), size)), np.zeros((size, len(F))), np.zeros((size, size))
    wide[:, : B.shape[1]], tall[: C.shape[0]], both[: D.shape[0], : D.shape[1]] = B, C, D
    return float(
        control.norm(control.ss(F, wide, tall, both, remove_useless_states=False), kind, tol=1e-10)
    )
