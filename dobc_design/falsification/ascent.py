"""Gradient ascent over starts: whatever is large after some time is made larger.

The derivatives are those of CasADi's RK4 (``model.model``); where a step ends is simulated again by others.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dobc_design.falsification.levels import Level
from dobc_design.falsification.starts import Pair, StartSet
from dobc_design.model.model import Flow

Array = NDArray[np.float64]
Objective = Callable[[Array], tuple[float, Array]]

EVALUATIONS = 24  # steps of one ascent
FIRST_STEP, LEAST_STEP = 0.2, 1e-3  # relative to the reach of the set
GROWTH, SHRINKAGE = 1.5, 0.4


def final_error(rows: int) -> Objective:
    """Log of |e| at the end and its gradient by the state; ``rows`` numbers of the state are e."""

    def objective(end: Array) -> tuple[float, Array]:
        size = float(np.linalg.norm(end[:rows]))
        weight = np.zeros_like(end)
        weight[:rows] = end[:rows] / max(size, 1e-300) ** 2
        return float(np.log(max(size, 1e-300))), weight

    return objective


def final_level(level: Level, rows: int, q: int) -> Objective:
    """Log of V at the end and a (sub)gradient."""

    def objective(end: Array) -> tuple[float, Array]:
        e, eps = end[:rows], end[rows:].reshape(-1, q) if q else np.zeros((1, 0))
        size = float(level.value(e[:, None], eps[:, :, None])[0])
        if not size > 0:
            return -np.inf, np.zeros_like(end)
        along, along_eps = level.gradient(e, eps)
        return float(np.log(size)), np.concatenate([along, along_eps.ravel() if q else []]) / size

    return objective


def ascend(flow: Flow, starts: StartSet, start: Pair, objective: Objective) -> Pair:
    """A start that ends farther away than ``start``, e (n m,) and eps (n, q); ``start`` itself if none is found.

    Steps follow the gradient in units of the set's reach and are projected back into the set; deterministic.
    """
    lengths = np.concatenate([part.ravel() for part in starts.reach])
    shape = start[1].shape
    best = np.concatenate([start[0], start[1].ravel()])
    value, weight = _evaluated(flow, best, objective)
    gradient, step = _gradient(flow, best, weight), FIRST_STEP
    for _ in range(EVALUATIONS):
        scaled = gradient * lengths
        largest = float(np.max(np.abs(scaled), initial=0.0))
        if not 0 < largest < np.inf or step < LEAST_STEP:
            break
        moved = best + step * lengths * scaled / largest
        e, eps = starts.project(moved[: flow.rows, None], moved[flow.rows :].reshape(shape)[:, :, None])
        moved = np.concatenate([e[:, 0], eps[:, :, 0].ravel()])
        found, weight = _evaluated(flow, moved, objective)
        if found > value:
            best, value, gradient, step = moved, found, _gradient(flow, moved, weight), step * GROWTH
        else:
            step *= SHRINKAGE
    return best[: flow.rows], best[flow.rows :].reshape(shape)


def _evaluated(flow: Flow, start: Array, objective: Objective) -> tuple[float, Array]:
    """The objective at the end of the flow and its gradient there; -inf where the flow is not finite."""
    end = flow.end(start)
    return objective(end) if np.isfinite(end).all() else (-np.inf, np.zeros_like(start))


def _gradient(flow: Flow, start: Array, weight: Array) -> Array:
    """The gradient by the start; 0 where it is not finite, which ends the ascent."""
    gradient = flow.pull(start, weight)[1]
    return gradient if np.isfinite(gradient).all() else np.zeros_like(start)
