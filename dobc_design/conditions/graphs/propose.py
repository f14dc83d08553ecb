"""Weights and matrices worth trying for a Markov chain, and the rates that they give, in floating
point; whether they hold is decided by ``decide`` alone."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.propose import decay_of, decay_rate
from dobc_design.conditions.numbers import MANY_AGENTS, last_found, rounded_down
from dobc_design.conditions.separable.claim import holding_gains
from dobc_design.exact.matrix import Array, Matrix, Vector, largest_entry, to_float
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.arcs import arc_table
from dobc_design.loop.loop import Loop
from dobc_design.solvers.program import factored, round_matrix

from .claim import MEAN, SQUARE, Kept

BISECTIONS = 14
SMALLEST = 1e-9  # rate that counts (1/s)
SAFE = 1 - 1e-6  # of a rate that floats show
STEADY = 0.999  # of the best rate
MOST_ROWS = 12  # n m, for the mean square
MOST_UNKNOWNS = 1000
WEIGHT_DIGITS = 15
FORM_DIGITS = 12


def mean_claim(loop: Loop, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Weights of every mode and the rate that they give, about; None where the means do not
    decay."""
    M = _mean_matrix(loop, generator)
    w = _weights(M, 0.0)
    if w is None:
        return None
    # The best rate lies between.
    low = float(np.min(M @ w / w))
    high = float(np.min(M.diagonal()))
    _, w = last_found(
        lambda rate, _: _weights(M, rate), w, low, high, steps=BISECTIONS, middle=_geometric_middle
    )
    # Floats showed the rows; a little less than their rate is left to exact arithmetic.
    rate = _observed(loop, W, float(np.min(M @ w / w)) * SAFE)
    if rate <= SMALLEST:
        return None
    parts = w.reshape(len(loop.modes), loop.n)
    each = {mode: _written(part) for mode, part in zip(loop.modes, parts, strict=True)}
    return Kept(kind=MEAN, rate=rounded_down(rate), w=each)


def _mean_matrix(loop: Loop, generator: Matrix) -> Any:
    """The sparse M for which the rows of all modes together are M w >= rate w."""
    n = loop.n
    slopes = np.array([float(each.jacobian_at_zero()[0][0].midpoint) for each in loop.functions])
    gains = to_float((holding_gains(loop),))[0]
    blocks = []
    for mode, arcs in loop.modes.items():
        table = arc_table(loop, mode)
        entries = to_float((table.weights,))[0][table.weight] * slopes[table.coupling]
        places = table.listeners, table.speakers
        A = sparse.csr_array((entries, places), shape=(n, loop.nodes))[:, :n]
        sure = np.where(arcs.uncertain, 0.0, entries)  # what an agent gives away for certain
        away = np.bincount(table.listeners, weights=sure, minlength=n)
        blocks.append((A - sparse.diags_array(away + gains)).T)
    chain = sparse.kron(sparse.csr_array(to_float(generator)), sparse.eye_array(n))
    return sparse.csr_array(-(sparse.block_diag(blocks) + chain))


def _geometric_middle(low: float, high: float) -> float:
    return math.sqrt(max(low, SMALLEST) * high)


def _written(w: Array) -> Vector | Doubles:
    """Weights of one mode as they are claimed: decimals, or floats for large networks."""
    if len(w) > MANY_AGENTS:
        return Doubles(w)
    return tuple(Fraction(f"{x:.{WEIGHT_DIGITS}g}") for x in w.tolist())


def _weights(M: Any, rate: float) -> Any:
    """(M - rate I)^-1 1, up to a factor; None where that is not positive: M does not have the
    rate."""
    size = M.shape[0]
    try:
        w = factored(M - rate * sparse.eye_array(size)).solve(np.ones(size))
    except RuntimeError:  # singular
        return None
    w = w / largest_entry(w)
    return w if np.all(w > 0) else None


def square_claim(loop: Loop, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Matrices of every mode for nearly the best rate; None for larger networks, and where none are
    found."""
    size = loop.size
    if size > MOST_ROWS or len(loop.modes) * size**2 > MOST_UNKNOWNS:
        return None
    statements = state_theorems(loop)
    unit = np.eye(size)
    blocks = []
    for mode in loop.modes:
        part = linear_part(statements, mode)
        if part is None:
            return None
        A = to_float(part)
        blocks.append(np.kron(A.T, unit) + np.kron(unit, A.T))
    # T is how E[e e'] of every mode changes, stacked: it decays as fast as the slowest eigenvalue.
    T: Any = linalg.block_diag(*blocks) + np.kron(to_float(generator), np.eye(size**2))
    rate = _observed(loop, W, decay_of(T) / 2 * STEADY)
    if rate <= SMALLEST:
        return None
    # The P with -I on the right side, which is positive as long as the rate is below the slowest.
    wanted = -np.tile(unit.ravel(), len(blocks))
    solved = np.linalg.solve(T + 2 * rate * np.eye(len(T)), wanted).reshape(-1, size, size)
    forms = [round_matrix((each + each.T) / 2, FORM_DIGITS) for each in solved]
    by_mode = dict(zip(loop.modes, forms, strict=True))
    return Kept(kind=SQUARE, rate=rounded_down(rate), P=by_mode)


def _observed(loop: Loop, W: Matrix | None, rate: float) -> float:
    """The rate, below that of the estimation error."""
    exosystem = loop.joint_exosystem
    if exosystem is None or W is None:
        return rate
    return min(rate, decay_rate(exosystem, W) * SAFE)
