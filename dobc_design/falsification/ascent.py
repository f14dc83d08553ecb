"""Uphill from a start: gradient ascent through the flow of the loop, by CasADi's derivatives."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dobc_design.loop.matrices import Array
from dobc_design.model.flow import Flow
from dobc_design.simulation.starts import TINY, Pair

from .levels import Level, StartSet


class Height(NamedTuple):
    """How far away a state at the end of a run is, and the gradient of that by the state."""

    value: float
    slope: Array


Objective = Callable[[Array], Height]

EVALUATIONS = 24  # steps of one ascent
FIRST_STEP, LEAST_STEP = 0.2, 1e-3  # relative to the reach of the set
GROWTH, SHRINKAGE = 1.5, 0.4


def final_error(rows: int, end: Array) -> Height:
    """Log of |e| at the end; ``rows`` numbers of the state are e."""
    size = max(float(np.linalg.norm(end[:rows])), TINY)
    slope = np.zeros_like(end)
    slope[:rows] = end[:rows] / size**2
    return Height(float(np.log(size)), slope)


def final_level(level: Level, rows: int, q: int, end: Array) -> Height:
    """Log of V at the end, with a (sub)gradient."""
    e = end[:rows]
    eps = end[rows:].reshape(-1, q) if q else np.zeros((1, 0))
    size = float(level.value(e[:, None], eps[:, :, None])[0])
    if not size > 0:
        return Height(-np.inf, np.zeros_like(end))
    along, along_eps = level.gradient(e, eps)
    slope = np.concatenate([along, along_eps.ravel() if q else []]) / size
    return Height(float(np.log(size)), slope)


def ascend(flow: Flow, starts: StartSet, start: Pair, objective: Objective) -> Pair:
    """A start, e (n m,) and eps (n, q), that ends farther away than ``start``; ``start`` itself if
    none is found."""
    rows = flow.rows
    e, eps = start
    # how far each number of a start may move
    lengths = np.concatenate([part.ravel() for part in starts.reach])

    def projected(at: Array) -> Array:
        moved = at[:rows, None], at[rows:].reshape(eps.shape)[:, :, None]
        inside, inside_eps = starts.project(*moved)
        return np.concatenate([inside[:, 0], inside_eps[:, :, 0].ravel()])

    best = np.concatenate([e, eps.ravel()])
    height = _height(flow, objective, best)
    gradient = _gradient(flow, best, height)
    step = FIRST_STEP
    for _ in range(EVALUATIONS):
        # in units of the reach, so that large and small components move alike
        scaled = gradient * lengths
        largest = float(np.max(np.abs(scaled), initial=0.0))
        if not 0 < largest < np.inf or step < LEAST_STEP:
            break
        moved = projected(best + step * lengths * scaled / largest)
        found = _height(flow, objective, moved)
        # longer steps as long as they lead uphill, shorter ones after one that did not
        if found.value > height.value:
            best = moved
            height = found
            gradient = _gradient(flow, moved, found)
            step *= GROWTH
        else:
            step *= SHRINKAGE
    return best[:rows], best[rows:].reshape(eps.shape)


def _height(flow: Flow, objective: Objective, start: Array) -> Height:
    """That of the end of the run from here; -inf where it overflows."""
    end = flow.end(start)
    if not np.isfinite(end).all():
        return Height(-np.inf, np.zeros_like(start))
    return objective(end)


def _gradient(flow: Flow, start: Array, height: Height) -> Array:
    """The gradient by the start."""
    found = flow.pull(start, height.slope)[1]
    return found if np.isfinite(found).all() else np.zeros_like(start)  # 0 ends the ascent
