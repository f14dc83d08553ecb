"""C exp(F t) in floats, at any number of times: what the observer's error and the disturbance do.

Both are linear and know nothing of the network, so they need no integrator.  exp(F t) stands at
equally spaced anchors, made by repeated squaring in extended precision; between two anchors a
Taylor polynomial is exact to the last bit.
"""

from typing import Any

import numpy as np
from scipy.linalg import expm

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array

TERMS = 11  # (1/8)^11 / 11! < 2^-57: anchors are at most 1/(8 |F|) away
TERMS_OF_STEP = 20  # (1/4)^20 / 20! < 2^-100
MOST_ANCHORS = 100_000
MOST_NUMBERS = 1 << 24  # of the table


@noun(eq=False)
class ClosedForm:
    """C exp(F t), (p, q), up to a horizon; ``table`` (TERMS, anchors, p q): scaled derivatives at
    the anchors."""

    F: Array
    C: Array
    spacing: float
    table: Array

    def at(self, time: float) -> Array:
        """C exp(F t), (p, q)."""
        return self.many(np.array(time))

    def many(self, times: Array) -> Array:
        """C exp(F t) for an array of times: (p, q, *times.shape)."""
        flat = times.ravel()
        numbers = np.minimum(np.rint(flat / self.spacing).astype(np.int64), self.table.shape[1] - 1)
        offsets = (flat - numbers * self.spacing)[:, None]
        # Horner's rule, the highest derivative first
        total = self.table[-1].take(numbers, axis=0)
        for term in self.table[-2::-1]:
            total *= offsets
            total += term.take(numbers, axis=0)
        return np.ascontiguousarray(total.T).reshape(*self.C.shape, *times.shape)


def make_closed_form(F: Array, C: Array, horizon: float) -> ClosedForm | None:
    """Prepare C exp(F t) up to ``horizon`` in s; None where |F| times the horizon is too large, or
    not finite."""
    if not (np.isfinite(F).all() and np.isfinite(C).all()):
        return None
    # between anchors |F t| stays below 1/8, for which TERMS are chosen
    spacing = 1 / (4 * max(float(np.linalg.norm(F, 1)), 1e-6 / horizon))
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
    if not np.isfinite(table).all():
        return None
    return ClosedForm(F=F, C=C, spacing=spacing, table=table)


def _powers(F: Array, spacing: float, count: int) -> Array:
    """exp(F spacing k), k < count, in extended precision: SciPy's expm alone is off by 1e-12 for |F
    t| of about 100."""
    with np.errstate(all="ignore"):
        small: Any = F.astype(np.longdouble) * np.longdouble(spacing)
        one: Any = np.eye(len(F), dtype=np.longdouble)
        term = one
        step = one
        for k in range(1, TERMS_OF_STEP):
            term = term @ small / k
            step = step + term
        powers = one[None]
        # ``step`` is exp(F spacing len(powers)) here, and squared whenever the powers double
        while len(powers) < count:
            powers = np.concatenate([powers, powers @ step])
            step = step @ step
        return np.asarray(powers[:count], dtype=np.float64)


def evolve(F: Array, start: Array, times: Array) -> Array:
    """exp(F t) applied to every row of ``start`` (n, q) at times (T,): (T, n, q); inf or nan beyond
    the floats."""
    if len(F) == 0:
        return np.zeros((len(times), *start.shape))
    closed = None
    if times[-1] > 0:
        closed = make_closed_form(F, np.eye(len(F)), float(times[-1]))
    if closed is None:
        powers = expm(F[None] * times[:, None, None])
    else:
        powers = np.moveaxis(closed.many(times), -1, 0)
    return np.asarray(start[None] @ np.swapaxes(powers, 1, 2))
