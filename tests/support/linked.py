"""Problems by their arcs, the way a test writes them, and their linear loops written out."""

from typing import Any

import numpy as np

from dobc_design import Network, Problem


def linked(arcs: Any, n: int | None = None, **given: Any) -> Problem:
    """[i, j] is agent i listening to agent j; h = y unless another ``coupling`` is given."""
    return Problem(
        **{"network": Network.from_arcs(arcs, arrow="listens_to", agents=n), "coupling": "y"}
        | given
    )


def loop_by_hand(problem: Problem, mode: str | None = None, *, slope: float = 1.0) -> np.ndarray:
    """J - K of a mode (the first one), arc by arc, for h'(0) = slope and gains that are numbers."""
    M = np.zeros((problem.n, problem.n))
    for i, j, w in problem.network.modes[mode or next(iter(problem.network.modes))]:
        M[i, j] += slope * float(w)
        M[i, i] -= slope * float(w)
    for i, k in problem.pinning.gains.items():
        M[i, i] -= float(k[0][0])
    return M
