"""Inputs as bad as [uncertainty] allows: signs that drive one agent as far as the linearised loop can be driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, expm

from dobc_design.problem.arrays import Array, consensus_jacobian
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import Loop

STEPS = 500  # stretches of constant sign in a run
LARGEST = 600  # states of [e; eps] up to which the sensitivity is computed; beyond, all signs are +


@dataclass(frozen=True, slots=True, eq=False)
class Signs:
    """+1 and -1 by stretch, agent, component and run: ``values`` (STEPS, n, m, R); a stretch takes ``length`` s."""

    values: Array
    length: float

    def at(self, times: float | Array, chosen: IndexArray) -> Array:
        """The signs at times (k,) of the runs ``chosen``, as many or one: (n, m, k)."""
        places = np.minimum((np.atleast_1d(times) / self.length).astype(np.int64), STEPS - 1)
        places, runs = np.broadcast_arrays(places, chosen)
        return np.moveaxis(self.values[places, :, :, runs], 0, -1)

    def integral(self, begin: float, end: float) -> Array:
        """Their integral between two times, (n, m, R)."""
        edges = self.length * np.arange(STEPS + 1)
        edges[-1] = np.inf
        overlap = np.minimum(edges[1:], end) - np.maximum(edges[:-1], begin)
        return np.tensordot(np.maximum(overlap, 0.0), self.values, axes=1)


def worst_signs(problem: Problem, loop: Loop, *, horizon: float, seeds: Sequence[int], observed: bool) -> Signs:
    """For each run the signs of the impulse response, from every residual to the agent whose turn it is (the seed
    modulo n), reversed in time: they attain the largest error at the horizon of the loop, linearised in the first
    mode."""
    n, m, q = loop.n, loop.m, loop.q if observed else 0
    size, length = n * (m + q), horizon / STEPS
    values = np.ones((STEPS, n, m, len(seeds)))
    slopes = consensus_jacobian(problem, next(iter(problem.network.modes)))
    if slopes is None or size > LARGEST:
        return Signs(values, length)
    M = np.zeros((size, size))
    M[: n * m, : n * m] = slopes.toarray() - loop.K.toarray()
    entry = np.eye(n * m)
    if q:
        M[: n * m, n * m :], M[n * m :, n * m :] = np.kron(np.eye(n), loop.C), np.kron(np.eye(n), loop.F)
        gains = [loop.W] * n if loop.W.ndim == 2 else list(loop.W)
        entry = np.vstack([entry, -block_diag(*gains)])
    rows = np.eye(n * m, size)[[seed % (n * m) for seed in seeds]]
    step = expm(M * length)
    for k in range(STEPS):
        response = (rows @ entry).reshape(len(seeds), n, m)
        values[STEPS - 1 - k] = np.where(np.moveaxis(response, 0, -1) < 0, -1.0, 1.0)
        rows = rows @ step
    return Signs(values, length)
