"""The slowest direction of a network in which some agents are held: a Perron vector, in floating point."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from fractions import Fraction

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.claim import ModeJacobian
from dobc_design.solvers.program import Array

DENSE = 400  # agents up to which all eigenvalues are computed
STEPS = 3000  # of the power method above


def slowest_direction(
    mode: ModeJacobian, component: int, pinned: Collection[int], caps: Mapping[int, Fraction], *, size: int
) -> tuple[float, Array] | None:
    """The rate (1/s), about, and the direction (n) >= 0 that decays no faster with gains on the ``pinned`` agents.

    Gains without a cap hold their agents at 0; the others stand at their cap.  None if nobody is left, or the gains
    of the arcs are not finite.
    """
    gains = np.array([float(gain[component][component].midpoint) for gain in mode.gains])
    listeners, speakers = mode.arcs.listeners, mode.arcs.speakers
    values = gains[mode.kind] if len(gains) else np.zeros(0)
    held = np.zeros(size)
    for i in pinned:
        held[i] = float(caps.get(i, 0))
    rows = np.setdiff1d(np.arange(size), [i for i in pinned if i not in caps])
    if not len(rows) or not np.all(np.isfinite(values)):
        return None
    diagonal = -np.bincount(listeners, weights=values, minlength=size) - held
    matrix = sparse.csr_array(sparse.coo_array((values, (listeners, speakers)), shape=(size, size)))
    matrix = sparse.csr_array((matrix + sparse.diags_array(diagonal)).tocsr()[rows][:, rows])
    top, vector = _perron(matrix)
    whole = np.zeros(size)
    whole[rows] = vector
    return -top, whole


def slow_directions(
    mode: ModeJacobian, component: int, pinned: Collection[int], caps: Mapping[int, Fraction], *, size: int
) -> Iterator[list[float]]:
    """Directions worth an exact look: the Perron vector, and the agent alone that is pulled least."""
    found = slowest_direction(mode, component, pinned, caps, size=size)
    if found is None:
        return
    yield found[1].tolist()
    gains = np.array([float(gain[component][component].midpoint) for gain in mode.gains])
    pull = np.bincount(mode.arcs.listeners, weights=gains[mode.kind] if len(gains) else None, minlength=size)
    pull = pull.astype(float)
    for i in pinned:
        pull[i] = pull[i] + float(caps[i]) if i in caps else np.inf
    alone = np.zeros(size)
    alone[int(np.argmin(pull))] = 1.0
    yield alone.tolist()


def _perron(matrix: sparse.csr_array) -> tuple[float, Array]:
    """The eigenvalue with the largest real part of a matrix that is >= 0 off its diagonal, and its vector >= 0."""
    size = matrix.shape[0]
    if size <= DENSE:
        values, vectors = np.linalg.eig(matrix.toarray())
        best = int(np.argmax(values.real))
        vector = np.abs(vectors[:, best].real)
        return float(values[best].real), np.where(vector > 1e-9 * np.max(vector, initial=0.0), vector, 0.0)
    shift = float(np.max(-matrix.diagonal(), initial=0.0)) + 1.0
    vector = np.ones(size)
    for _ in range(STEPS):
        after = matrix @ vector + shift * vector
        vector = after / np.max(after)
    after = matrix @ vector
    return float(np.max(after / vector)), vector
