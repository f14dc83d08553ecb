"""The worst that is allowed, for the linearised loop: signs of a disturbance, and rounds of modes
under a guarantee."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np
from scipy.linalg import block_diag, expm

from dobc_design.conditions.schedule.cycles import phases_of
from dobc_design.exact.number import nearest
from dobc_design.problem.arrays import Array, consensus_jacobian, pinning_matrix
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import Loop
from dobc_design.simulation.signals import Periodic

STEPS = 500  # stretches of constant sign in a run
LARGEST = 600  # states of [e; eps] up to which the sensitivity is computed; beyond, all signs are +
# compared of one length; these times (n m)^3
LONGEST_ROUND, MOST_ROUNDS, MOST_WORK = 8, 1000, 10**9


@dataclass(frozen=True, slots=True, eq=False)
class Signs:
    """+1 and -1 by stretch, agent, component and run: ``values`` (STEPS, n, m, R); a stretch takes
    ``length`` s."""

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


def worst_signs(
    problem: Problem, loop: Loop, *, horizon: float, seeds: Sequence[int], observed: bool
) -> Signs:
    """For each run the signs of the impulse response, from every residual to the agent whose turn
    it is (the seed modulo n), reversed in time: they attain the largest error at the horizon of the
    loop, linearised in the first mode."""
    n, m, q = loop.n, loop.m, loop.q if observed else 0
    size, length = n * (m + q), horizon / STEPS
    values = np.ones((STEPS, n, len(loop.output), len(seeds)))
    slopes = consensus_jacobian(problem, next(iter(problem.network.modes)))
    if slopes is None or size > LARGEST:
        return Signs(values, length)
    M = np.zeros((size, size))
    M[: n * m, : n * m] = slopes.toarray() - loop.K.toarray()
    entry = np.eye(n * m)
    if q:
        M[: n * m, n * m :], M[n * m :, n * m :] = (
            np.kron(np.eye(n), loop.C),
            np.kron(np.eye(n), loop.F),
        )
        gains = [loop.W] * n if loop.W.ndim == 2 else list(loop.W)
        entry = np.vstack([entry, -block_diag(*gains)])
    if loop.plant is not None:
        entry = entry @ np.kron(np.eye(n), loop.plant.B)
    rows = np.eye(n * m, size)[[seed % (n * m) for seed in seeds]]
    step = expm(M * length)
    for k in range(STEPS):
        response = (rows @ entry).reshape(len(seeds), n, -1)
        values[STEPS - 1 - k] = np.where(np.moveaxis(response, 0, -1) < 0, -1.0, 1.0)
        rows = rows @ step
    return Signs(values, length)


def worst_signal(problem: Problem) -> Periodic | None:
    """Of short rounds with the shortest and longest times of the guarantee "dwell" (without a
    longest: 1, 2 and 4 times the shortest, or a mode for ever), the one under which e, linearised,
    decays most slowly.  None without this guarantee, with too many agents or modes, and where a
    coupling has no slope at the target."""
    phases, own = phases_of(problem), problem.switching
    most = min(MOST_ROUNDS, MOST_WORK // (problem.n * problem.m) ** 3)
    if not phases or own is None or own.guarantee != "dwell" or (2 * len(phases)) ** 2 > most:
        return None
    slopes = [consensus_jacobian(problem, phase.mode) for phase in phases]
    flows = [(each - pinning_matrix(problem)).toarray() for each in slopes if each is not None]
    if len(flows) < len(phases):
        return None
    first, last = nearest(phases[0].shortest), phases[0].longest
    ends = (
        [first, 2 * first, 4 * first] if last is None else list({first: None, nearest(last): None})
    )
    steps = {(p, end): expm(flow * end) for p, flow in enumerate(flows) for end in ends}
    slowest, found = -np.inf, None
    for turns in _rounds(len(phases), ends, least=1 if last is None else 2, most=most):
        way = reduce(np.matmul, [steps[turn] for turn in reversed(turns)])
        growth = float(np.abs(np.linalg.eigvals(way)).max())
        pace = np.log(max(growth, np.finfo(float).tiny)) / sum(end for _, end in turns)
        if pace > slowest + 1e-9:  # of equal ones the shortest
            order = tuple(phases[p].mode for p, _ in turns)
            slowest, found = pace, Periodic(dwell=tuple(end for _, end in turns), order=order)
    return found


def _rounds(
    modes: int, ends: Sequence[float], *, least: int, most: int
) -> Iterator[tuple[tuple[int, float], ...]]:
    """Rounds (mode, s) of one or of neighbours that differ, as long as there are not too many of
    one length."""
    for length in range(least, LONGEST_ROUND + 1):
        if (len(ends) * (modes - 1)) ** length > most:
            return
        for order in product(range(modes), repeat=length):
            if order[0] == min(order) and (
                length == 1 or all(order[k] != order[k - 1] for k in range(length))
            ):
                yield from (
                    tuple(zip(order, lasting, strict=True))
                    for lasting in product(ends, repeat=length)
                )
