"""Matrices of a loop at the consensus, in floating point: for proposals and pictures, no proof."""

from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.matrix import Array, to_float
from dobc_design.problem.network import IndexArray

from .arcs import arc_table
from .loop import Loop

WIDEST_SLOPE = Fraction(1, 10**6)


def pull_matrix(loop: Loop) -> sp.csr_array:
    """Return the block diagonal of what pulls each node to the fixed one, (n m, n m)."""
    gains = loop.pulls.gains
    nodes = np.fromiter(gains, dtype=np.int64, count=len(gains))
    blocks = np.array([to_float(k) for k in gains.values()]).reshape(-1, loop.m, loop.m)
    return block_sparse(blocks, nodes, nodes, size=loop.n)


def consensus_jacobian(loop: Loop, mode: str) -> sp.csr_array | None:
    """Return dh/de at e = 0 (n m, n m), of midpoints of slopes; None where a function has a kink at
    0, or where slopes move with a leader."""
    if loop.slopes_move:
        return None
    # Different functions are few: their slopes are taken once each.
    table = arc_table(loop, mode)
    slopes = {}
    for place in np.unique(table.coupling).tolist():
        found = _slope(loop.functions[place])
        if found is None:
            return None
        slopes[place] = found
    n = loop.n
    different = to_float((table.weights,))[0]
    weights = different[table.weight]
    # What a node loses is added up by function first.
    own, back = np.unique(table.coupling * n + table.listeners, return_inverse=True)
    # The sign of an arc is that of what is heard.
    lost = -np.bincount(back, weights=np.abs(weights), minlength=len(own))
    # What a fixed node adds is on the diagonal alone: its error is 0.
    between = table.speakers < n
    kinds = np.concatenate([table.coupling[between], own // n])
    if not len(kinds):
        return sp.csr_array((loop.size, loop.size))
    rows = np.concatenate([table.listeners[between], own % n])
    columns = np.concatenate([table.speakers[between], own % n])
    factors = np.concatenate([weights[between], lost])
    numbers, which = np.unique(kinds, return_inverse=True)
    slopes_of_kinds = np.array([slopes[number] for number in numbers.tolist()])
    blocks = factors[:, None, None] * slopes_of_kinds[which]
    return block_sparse(blocks, rows, columns, size=n)


def _slope(function: Coupling) -> Array | None:
    """The middle of the slopes at 0, (m, m); None where they are not close, as at a kink."""
    middles = []
    for row in function.jacobian_at_zero():
        if any(entry.width > WIDEST_SLOPE * (1 + entry.magnitude) for entry in row):
            return None
        middles.append(tuple(entry.midpoint for entry in row))
    return to_float(tuple(middles))


def block_sparse(
    blocks: Array, rows: IndexArray, columns: IndexArray, *, size: int
) -> sp.csr_array:
    """Add up blocks (count, p, m) at block places of a sparse matrix (size p, size m); zeros are
    left out."""
    _, p, m = blocks.shape
    within_rows = np.arange(p)[:, None]
    within_columns = np.arange(m)
    i = np.broadcast_to(rows[:, None, None] * p + within_rows, blocks.shape)
    j = np.broadcast_to(columns[:, None, None] * m + within_columns, blocks.shape)
    places = (i.ravel(), j.ravel())
    result = sp.csr_array((blocks.ravel(), places), shape=(size * p, size * m))
    result.eliminate_zeros()
    return result
