"""Lambda(J) at the consensus in float64, straight from the problem, with whole arrays of arcs.

The statement is ``claim.lemma1``, which is exact and takes a Fraction for every arc; this is
the same matrix for eigenvalue estimates, a hundred times faster.  Where slopes are irrational it holds the
middle of their enclosures, as the exact one does.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.exact.interval import Interval
from dobc_design.problem.arcs import coupling_places
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array


def float_lambda(problem: Problem, mode: str, *, pins: bool = True) -> Any:
    """Lambda = J + J' - (K + K') of one mode as a SciPy array in coordinate form, entries not yet summed.

    Shapes: (n m, n m).  Entries beyond the floats are infinite.  ``pins`` False leaves K out.
    Raises: exact.interval.UndefinedError if a coupling has no derivative at 0.
    """
    n, m = problem.n, problem.m
    gains, listeners, speakers = _arc_gains(problem, mode)
    rows, columns = np.concatenate([listeners, listeners]), np.concatenate([speakers, listeners])
    blocks = np.concatenate([gains, -gains])
    if pins:
        agents, held = _pin_gains(problem)
        rows, columns = np.concatenate([rows, agents]), np.concatenate([columns, agents])
        blocks = np.concatenate([blocks, -held])
    if m == 1:
        i, j, values = rows, columns, blocks.ravel()
    else:
        within = np.arange(m)
        i = np.broadcast_to(rows[:, None, None] * m + within[:, None], blocks.shape).ravel()
        j = np.broadcast_to(columns[:, None, None] * m + within, blocks.shape).ravel()
        values = blocks.ravel()
    places = (np.concatenate([i, j]), np.concatenate([j, i]))
    return sparse.coo_array((np.concatenate([values, values]), places), shape=(n * m, n * m))


def _arc_gains(problem: Problem, mode: str) -> tuple[Array, Any, Any]:
    """h'(0) of every arc with its weight, (arcs, m, m), and the two ends of the arcs."""
    arcs = problem.network.modes[mode]
    slopes = np.array([_middles(coupling.jacobian_at_zero()) for coupling in problem.couplings])
    weights = _weights(arcs.weights)[:, None, None]
    return _weighted(weights, slopes[coupling_places(problem, arcs)]), arcs.listeners, arcs.speakers


def _weighted(weights: Array, slopes: Array) -> Array:
    """The products; inf beyond the floats, which no estimate survives and the exact side does not need."""
    with np.errstate(over="ignore", invalid="ignore"):
        gains: Array = weights * slopes
    return gains


def _pin_gains(problem: Problem) -> tuple[Any, Array]:
    gains = problem.pinning.gains
    blocks = [[[nearest(x) for x in row] for row in gain] for gain in gains.values()]
    agents = np.fromiter(gains, dtype=np.int64, count=len(gains))
    return agents, np.array(blocks, dtype=np.float64).reshape(len(gains), problem.m, problem.m)


def _middles(rows: Sequence[Sequence[Interval]]) -> list[list[float]]:
    return [[nearest((entry.lo + entry.hi) / 2) for entry in row] for row in rows]


def _weights(weights: Sequence[Fraction]) -> Array:
    """The weights as floats; arcs with the same weight mostly share one object, which is converted once."""
    if weights and weights.count(weights[0]) == len(weights):
        return np.full(len(weights), nearest(weights[0]))
    places = list(map(id, weights))
    floats = {place: nearest(weight) for place, weight in dict(zip(places, weights, strict=True)).items()}
    return np.fromiter(map(floats.__getitem__, places), dtype=np.float64, count=len(places))


def nearest(x: Fraction) -> float:
    """The nearest float, or an infinity beyond them."""
    try:
        return float(x)
    except OverflowError:
        return float("inf") if x > 0 else float("-inf")
