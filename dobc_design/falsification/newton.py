"""Where the agents may rest: roots of h(e) - K e in floating point, from given points.

Levenberg and Marquardt's damping around Newton's method.  ``conditions.equilibrium.decide`` proves roots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.model.model import build_model
from dobc_design.problem.arrays import no_gain, pinning_matrix
from dobc_design.problem.problem import Problem

Array = NDArray[np.float64]

STEPS = 60
CLOSE = 1e-11  # |F|_inf of a root, relative to the slopes and to the size of e
AT_TARGET = 1e-4  # |e|_inf below which a root is the target, relative to the farthest point
SAME = 1e-6  # relative distance of roots that are one
MOST_DAMPING = 1e8


class Rest:
    """F(e) = h(e) - K e of one mode and its derivative, from CasADi."""

    def __init__(self, problem: Problem, mode: str) -> None:
        model = build_model(problem, mode, gain=no_gain(problem))  # eps = 0
        self._h, self._jacobian = model.h, model.jacobian
        self._K = np.asarray(pinning_matrix(problem).toarray())

    def value(self, e: Array) -> Array:
        """F(e), (n m,)."""
        return np.asarray(np.asarray(self._h(e)).ravel() - self._K @ e)

    def slope(self, e: Array) -> Array:
        """dF/de, (n m, n m)."""
        found: Any = self._jacobian(e)
        return np.asarray(found.full() - self._K)


def find_roots(problem: Problem, mode: str, points: Sequence[Array]) -> Iterator[Array]:
    """Roots other than the target that the points lead to, each once, as they are found."""
    rest, known = Rest(problem, mode), list[Array]()
    least = AT_TARGET * max((float(np.max(np.abs(point))) for point in points), default=0.0)
    for point in points:
        root = _root(rest, point, least)
        if root is None:
            continue
        if all(np.max(np.abs(root - other)) > SAME * np.max(np.abs(root)) for other in known):
            known.append(root)
            yield root


def _root(rest: Rest, start: Array, least: float) -> Array | None:
    """A root with |e|_inf > ``least``, or None."""
    e, value = start, rest.value(start)
    size, damping = float(np.linalg.norm(value)), 1e-3
    for _ in range(STEPS):
        reach = float(np.max(np.abs(e)))
        if not np.isfinite(size) or reach <= least:
            return None
        J = rest.slope(e)
        if not np.isfinite(J).all():
            return None
        if np.max(np.abs(value)) <= CLOSE * np.abs(J).sum(axis=1).max() * reach:
            return e
        step = _step(J, value, damping * size)
        moved = e - step
        there = rest.value(moved)
        found = float(np.linalg.norm(there))
        if found < size:
            e, value, size, damping = moved, there, found, damping / 5
        elif damping > MOST_DAMPING:
            return None
        else:
            damping *= 5
    return None


def _step(J: Array, value: Array, damping: float) -> Array:
    """(J'J + damping I)^-1 J' value; the damping goes to 0 with the residual, so that the end is Newton's."""
    normal = J.T @ J
    normal[np.diag_indices_from(normal)] += max(damping, 1e-15 * float(np.trace(normal)) / len(normal), 1e-300)
    try:
        return np.asarray(np.linalg.solve(normal, J.T @ value))
    except np.linalg.LinAlgError:
        return np.zeros_like(value)
