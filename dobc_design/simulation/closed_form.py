"""C exp(F t) at many times: the disturbance (F = A) and the observer's error (F = A - W C) in closed form (17).

Around anchors a quarter of 1/|F| apart the exponential is a Taylor polynomial with a remainder below rounding;
the anchors themselves come from doubling.  No eigenvectors: a double pole is a matrix like any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]
TERMS = 11  # (1/8)^11 / 11! < 2^-57: anchors are at most 1/(8 |F|) away
TERMS_OF_STEP = 20  # (1/4)^20 / 20! < 2^-100
MOST_ANCHORS = 100_000
MOST_NUMBERS = 1 << 24  # of the table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """C exp(F t) for 0 <= t <= the horizon it was made for.

    Shapes: F (q, q) in 1/s, C (p, q).  ``table`` (TERMS, anchors, p q) holds the scaled derivatives at the anchors.
    """

    F: Array
    C: Array
    spacing: float
    table: Array

    def at(self, time: float) -> Array:
        """C exp(F t), (p, q)."""
        number = min(round(time / self.spacing), self.table.shape[1] - 1)
        offset = time - number * self.spacing
        powers = offset ** np.arange(TERMS)
        return np.asarray(powers @ self.table[:, number]).reshape(self.C.shape)

    def many(self, times: Array) -> Array:
        """C exp(F t) for an array of times: (p, q, *times.shape)."""
        flat = times.ravel()
        numbers = np.minimum(np.rint(flat / self.spacing).astype(np.int64), self.table.shape[1] - 1)
        offsets = (flat - numbers * self.spacing)[:, None]
        total = self.table[-1].take(numbers, axis=0)
        for term in self.table[-2::-1]:
            total *= offsets
            total += term.take(numbers, axis=0)
        return np.ascontiguousarray(total.T).reshape(*self.C.shape, *times.shape)


def make_closed_form(F: Array, C: Array, horizon: float) -> ClosedForm | None:
    """Prepare C exp(F t) up to ``horizon`` in s; None where a table would be too long or not finite.

    That happens when |F| times the horizon is very large: the observer is then stiff, and the caller
    integrates the full loop instead.
    """
    if not (np.isfinite(F).all() and np.isfinite(C).all()):
        return None
    size = max(float(np.linalg.norm(F, 1)), 1e-6 / horizon)
    spacing = 1 / (4 * size)
    ratio = horizon / spacing
    if not ratio < min(MOST_ANCHORS, MOST_NUMBERS / (TERMS * C.size)):
        return None
    anchors = int(np.ceil(ratio)) + 1
    start = _powers(F, spacing, anchors)
    derivatives = [C]
    for k in range(1, TERMS):
        derivatives.append(derivatives[-1] @ F / k)
    with np.errstate(all="ignore"):
        table = np.stack([(each @ start).reshape(anchors, C.size) for each in derivatives])
    return ClosedForm(F=F, C=C, spacing=spacing, table=table) if np.isfinite(table).all() else None


def _powers(F: Array, spacing: float, count: int) -> Array:
    """exp(F spacing k) for k < count, (count, q, q), by doubling.

    In extended precision where the machine has it: SciPy's expm alone is off by 1e-12 for |F t| of about 100.
    """
    with np.errstate(all="ignore"):
        small: Any = F.astype(np.longdouble) * np.longdouble(spacing)
        term: Any = np.eye(len(F), dtype=np.longdouble)
        step: Any = np.eye(len(F), dtype=np.longdouble)
        for k in range(1, TERMS_OF_STEP):
            term = term @ small / k
            step = step + term
        powers: Any = np.eye(len(F), dtype=np.longdouble)[None]
        while len(powers) < count:
            powers = np.concatenate([powers, powers @ step])
            step = step @ step
        return np.asarray(powers[:count], dtype=np.float64)


def evolve(F: Array, start: Array, times: Array) -> Array:
    """exp(F t) applied to every row of ``start``: the solution of xi_i' = F xi_i.

    Shapes: F (q, q), start (n, q), times (T,).  Returns: (T, n, q); entries beyond the floats are inf or nan.
    """
    if len(F) == 0:
        return np.zeros((len(times), *start.shape))
    closed = make_closed_form(F, np.eye(len(F)), float(times[-1])) if times[-1] > 0 else None
    powers = expm(F[None] * times[:, None, None]) if closed is None else np.moveaxis(closed.many(times), -1, 0)
    return np.asarray(start[None] @ np.swapaxes(powers, 1, 2))
