"""How well the disturbance can be seen: observability of (A, C) in floating point (eq. 12).

Diagnostics, not proofs: ranks and margins of float matrices.  Decisions are made in ``exact.observability``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import require_shape, require_square
from dobc_design.exact.matrix import Matrix, to_float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeMargin:
    """An eigenvalue of A (1/s) and the smallest singular value of [A - eigenvalue I; C]; 0 means unseen."""

    eigenvalue: complex
    margin: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservabilityResult:
    """Rank and singular values of the observability matrix, and the Popov-Belevitch-Hautus margin of each mode.

    ``rank`` is numerical (python-control's matrix, NumPy's default tolerance), None if the matrix overflows;
    ``order`` is q.
    """

    order: int
    rank: int | None
    singular_values: tuple[float, ...]
    modes: tuple[ModeMargin, ...]

    @property
    def margin(self) -> float:
        """The smallest margin of all modes."""
        return min(mode.margin for mode in self.modes)

    def __str__(self) -> str:
        rank = "unknown" if self.rank is None else self.rank
        return f"rank {rank} of {self.order}, smallest mode margin {self.margin:.4g}"


def check_observability(A: Matrix, C: Matrix) -> ObservabilityResult:
    """Compute rank, singular values and mode margins of the pair (A, C).

    Shapes: A (q, q), C (m, q).
    Raises: ShapeError if the shapes do not fit.
    Source: paper, (12) and (17); the margins are those of the Popov-Belevitch-Hautus test.  A diagnostic, not a
    proof: eigenvalues that coincide are found with an error much larger than rounding.
    """
    import control  # takes a second to import

    q = require_square(A, name="A")
    require_shape(C, (None, q), name="C", because="one column per exosystem state")
    dynamics, output = to_float(A), to_float(C)
    with np.errstate(all="ignore"):
        matrix = np.asarray(control.obsv(dynamics, output))
    finite = bool(np.isfinite(matrix).all())  # powers of A may overflow; the margins do not need them
    eigenvalues = np.linalg.eigvals(dynamics)
    return ObservabilityResult(
        order=q,
        rank=int(np.linalg.matrix_rank(matrix)) if finite else None,
        singular_values=tuple(np.linalg.svd(matrix, compute_uv=False).tolist()) if finite else (),
        modes=tuple(ModeMargin(eigenvalue=complex(s), margin=_margin(dynamics, output, s)) for s in eigenvalues),
    )


def _margin(A: NDArray[np.float64], C: NDArray[np.float64], eigenvalue: complex) -> float:
    pencil = np.vstack([A - eigenvalue * np.eye(len(A)), C])
    return float(np.linalg.svd(pencil, compute_uv=False)[-1])
