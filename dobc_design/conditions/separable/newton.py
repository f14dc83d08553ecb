"""The least v of the rows of the max-separable certificate at one rate, by Newton's method (theory, section 5).

The rows bound each v_i from below by the others, so the solutions above a bound have a least one.  One sparse solve per
step, for any size.  Nothing here is a proof.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.conditions.separable.field import Field
from dobc_design.solvers.program import Array

LARGEST_V = 1e6
STEPS = 60
# Networks of more agents are large: less accuracy is worth the time.
FEW_AGENTS = 2000
# A factorisation is cheap for few agents, and where the network is little more than lines and rings.
FACTORED_AGENTS, FEW_ENTRIES = 500, 4
# Accuracy and steps of the iteration elsewhere.  It converges slowly only at rates next to one that is out of reach.
ACCURACY, ROUGH, MOST_ITERATIONS = 1e-4, 0.03, 150
# Newton's residual as a part of the terms, and how far a step may fall where it has to rise, by rounding.
TIGHT, LOOSE = (1e-12, 1e-9), (1e-6, 1e-2)
# Steps of inverse iteration for the rate of linear couplings.
ROUNDS = 4


def linear_rate(field: Field) -> float:
    """An estimate of the largest rate that the couplings would have if they were linear, with their slopes at 0 (1/s).

    No v has more for any s: next to 0 the rows are those of these slopes.  Symmetric ones are estimated from above.
    """
    v = np.ones(field.size)
    _, jacobian, _ = field.rows(v, alpha=0.0)
    everybody = np.ones(field.size, dtype=bool)
    found = float(np.max(field.gains))
    for _ in range(ROUNDS):
        step = _solve(jacobian, v, everybody, accuracy=ROUGH)
        if step is None or not np.all(step > 0):
            break
        v = step / np.max(step)
        found = min(found, float(-(v @ (jacobian @ v)) / (v @ v)))
    return found


def least_solution(
    field: Field, *, alpha: float, start: Array, lower: Array | float = 1.0, accuracy: tuple[float, float] | None = None
) -> Array | None:
    """The least v >= ``lower`` whose rows hold with rate alpha, about; None if Newton's method finds none.

    ``start`` lies below it: the solution for a smaller alpha does.
    """
    v = start.copy()
    close, drop = accuracy or (TIGHT if field.size <= FACTORED_AGENTS else LOOSE)
    for _ in range(STEPS):
        residual, jacobian, scale = field.rows(v, alpha=alpha)
        if np.all(residual <= close * scale):
            return v
        active = (residual > 0) | (v > lower)
        step = _solve(jacobian, residual, active)
        if step is None:
            return None
        proposed = np.maximum(lower, v + step)
        raised = residual > 0
        # A solution lies above: where a row fails, v has to rise; a step down there means there is none.
        if np.any(proposed[raised] < v[raised] * (1 - drop)) or not np.all(np.isfinite(proposed)):
            return None
        proposed = np.minimum(proposed, 2 * v)
        if np.max(proposed) > LARGEST_V:
            return None
        if np.allclose(proposed, v, rtol=1e-15, atol=0.0):
            return v if np.all(residual <= 1e3 * close * scale) else None
        v = proposed
    return None


def _solve(jacobian: Any, residual: Array, active: Any, *, accuracy: float = ACCURACY) -> Array | None:
    """One Newton step on the active agents; None if their matrix is singular."""
    places = np.flatnonzero(active)
    block = sparse.csr_array(jacobian[places][:, places])
    right = -residual[places]
    with np.errstate(all="ignore"):
        if len(places) > FACTORED_AGENTS and block.nnz > FEW_ENTRIES * len(places):
            solution = _iterated(block, right, accuracy)
        else:
            solution = _factorised(block, right)
    if solution is None:
        return None
    step = np.zeros(len(residual))
    step[places] = solution
    return step


def _factorised(block: Any, right: Array) -> Array | None:
    try:
        return np.asarray(sparse.linalg.splu(sparse.csc_array(block)).solve(right))
    except RuntimeError:  # exactly singular
        return None


def _iterated(block: Any, right: Array, accuracy: float) -> Array | None:
    """Solve by BiCGSTAB with Jacobi scaling: factors of scale-free networks would fill in."""
    diagonal = block.diagonal()
    if np.any(diagonal >= 0):
        return None
    scaled = sparse.csr_array(sparse.diags_array(1 / diagonal) @ block)
    solution, status = sparse.linalg.bicgstab(scaled, right / diagonal, rtol=accuracy, maxiter=MOST_ITERATIONS)
    return np.asarray(solution) if status == 0 and np.all(np.isfinite(solution)) else None
