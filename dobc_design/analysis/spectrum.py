"""How fast the estimate follows: the eigenvalues of A - W C (eq. 17) in floating point.

A diagnostic, not a proof; whether A - W C is Hurwitz is decided by ``exact.polynomial``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dobc_design._checks import require_shape, require_square
from dobc_design.exact.matrix import Matrix, multiply, subtract, to_float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectrumResult:
    """Eigenvalues of A - W C, slowest first, and the decay rate they give; both in 1/s."""

    eigenvalues: tuple[complex, ...]
    rate: float

    def __str__(self) -> str:
        word = "decays at" if self.rate > 0 else "does not decay: rate"
        return f"the estimation error {word} {self.rate:.4g} 1/s"


def check_spectrum(A: Matrix, C: Matrix, W: Matrix) -> SpectrumResult:
    """Compute the eigenvalues of A - W C and the decay rate they give.

    Shapes: A (q, q), C (m, q), W (q, m).  Units: 1/s.
    Returns: eigenvalues and rate = -max Re; negative means divergence.
    Raises: ShapeError if the shapes do not fit.
    Source: paper, eq. (17).  A diagnostic, not a proof.
    """
    import control  # takes a second to import

    q = require_square(A, name="A")
    m, _ = require_shape(C, (None, q), name="C", because="one column per exosystem state")
    because = "one row per exosystem state, one column per disturbance component"
    require_shape(W, (q, m), name="W", because=because)
    dynamics = to_float(subtract(A, multiply(W, C)))
    # python-control wants an input and an output; neither moves the poles.
    system = control.ss(dynamics, np.zeros((q, 1)), np.zeros((1, q)), 0, remove_useless_states=False)
    poles = sorted(np.asarray(system.poles()).tolist(), key=lambda s: (-s.real, s.imag))
    return SpectrumResult(eigenvalues=tuple(complex(s) for s in poles), rate=-float(poles[0].real))
