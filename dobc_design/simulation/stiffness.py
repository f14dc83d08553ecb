"""Is the loop stiff?  An estimate before the run, and Hairer's test while it runs.

An explicit method takes steps of a few times the fastest time constant, however smooth the solution is.  Where that
would cost very many steps, an implicit method is cheaper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from dobc_design.problem.arrays import ArcGroup
from dobc_design.simulation.field import Loop

Array = NDArray[np.float64]

STIFF = 2e4  # horizon times fastest decay from which on the implicit method is taken at once
BOUNDARY = 6.1  # |h lambda| on the boundary of stability of DOP853 (Hairer, Norsett, Wanner, section IV.2)
PATIENCE = 15  # steps on that boundary after which the loop counts as stiff, if ...
MANY = 3000  # ... so many steps would be left


def fastest_decay(loop: Loop, groups: Sequence[ArcGroup]) -> float:
    """A bound on the fastest decay of e at the consensus, 1/s: the largest row sum of |J| + |K| (Gershgorin).

    A coupling with a kink at 0 counts with the steeper side.
    """
    rows = np.asarray(abs(loop.K).sum(axis=1)).reshape(loop.n, loop.m)
    for group in groups:
        slopes = group.coupling.jacobian_at_zero()
        steepest = np.array([min(1e300, float(sum(entry.magnitude for entry in row))) for row in slopes])
        strength = np.bincount(group.listeners, weights=group.weights, minlength=loop.n)
        rows = rows + 2 * strength[:, None] * steepest
    return float(rows.max())


def observer_decay(loop: Loop) -> float:
    """The fastest decay of the observer's error, 1/s."""
    observer = loop.F
    if not loop.q or not np.isfinite(observer).all():
        return 0.0
    return float(-np.linalg.eigvals(observer).real.min())


class StiffnessTest:
    """Counts the steps of an explicit solver that end on the boundary of stability."""

    def __init__(self) -> None:
        self.on_boundary = 0
        self.inside = 0

    def is_stiff(self, solver: Any, end: float) -> bool:
        """Look at the step just taken; True once the loop has shown itself stiff and much is left to be done."""
        if not isinstance(solver, DOP853) or solver.h_previous is None:
            return False
        step = abs(solver.h_previous)
        if (end - solver.t) < MANY * step:
            return False
        stages = solver.n_stages
        last = solver.y_old + solver.h_previous * (solver.K[: stages - 1].T @ solver.A[stages - 1, : stages - 1])
        distance = float(np.linalg.norm(solver.y - last))
        change = float(np.linalg.norm(solver.f - solver.K[stages - 1]))
        if distance > 0 and step * change > BOUNDARY * distance:
            self.on_boundary, self.inside = self.on_boundary + 1, 0
        else:
            self.inside += 1
            self.on_boundary = 0 if self.inside >= 6 else self.on_boundary
        return self.on_boundary >= PATIENCE
