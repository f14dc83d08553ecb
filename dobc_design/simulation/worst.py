"""The worst that is allowed, for the linearised loop: signs of a disturbance, and rounds of modes
under a guarantee."""

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import pairwise, product

import numpy as np
from scipy.linalg import block_diag, expm

from dobc_design._checks import positional
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import nearest
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.make import errors_of
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem

from .field import ClosedLoop
from .signals import Periodic
from .sines import Band, Sines

FREQUENCIES = 41  # of a band that are tried
STEPS = 500  # stretches of constant sign in a run
LARGEST = 600  # states of [e; eps] up to which the sensitivity is computed; beyond, all signs are +
# compared of one length; these times (n m)^3
LONGEST_ROUND, MOST_ROUNDS, MOST_WORK = 8, 1000, 10**9
SLOWER = 1e-9  # 1/s by which a longer round has to decay more slowly than a shorter one

Turn = tuple[int, float]  # a mode by its place, and how long it lasts in s


@positional(eq=False)
class Signs:
    """+size and -size by stretch, agent, component and run: ``values`` (STEPS, n, m, R); a stretch
    takes ``length`` s."""

    values: Array
    length: float

    def at(self, times: float | Array, chosen: IndexArray | slice) -> Array:
        """The signs at times (k,) of the runs ``chosen``, as many or one: (n, m, k)."""
        stretches = (np.atleast_1d(times) / self.length).astype(np.int64)
        places = np.minimum(stretches, STEPS - 1)
        runs = np.arange(self.values.shape[3])[chosen]
        places, runs = np.broadcast_arrays(places, runs)
        return np.moveaxis(self.values[places, :, :, runs], 0, -1)

    def integral(self, begin: float, end: float) -> Array:
        """Their integral between two times, (n, m, R)."""
        edges = self.length * np.arange(STEPS + 1)
        # the last sign holds for ever
        edges[-1] = np.inf
        # of every stretch the part between the two times
        overlap = np.minimum(edges[1:], end) - np.maximum(edges[:-1], begin)
        return np.tensordot(np.maximum(overlap, 0.0), self.values, axes=1)


class Worst:
    """What drives one agent most in each run, whose turn it is (the seed modulo n), as far as the
    loop can be driven, linearised in the first mode: z' = M z + (residual by agent and input)."""

    def __init__(
        self, problem: Problem, loop: ClosedLoop, seeds: Sequence[int], *, observed: bool
    ) -> None:
        self.ports = (loop.n, len(loop.output), len(seeds))
        self.M: Array | None = None
        slopes = consensus_jacobian(errors_of(problem), next(iter(problem.network.modes)))
        q = loop.q if observed else 0
        size = loop.n * (loop.m + q)
        if slopes is None or size > LARGEST:
            return
        pulled = slopes.toarray() - loop.K.toarray()
        if q:
            self.M, self.entry = _with_observer(loop, pulled)
        else:
            self.M = pulled
            self.entry = np.eye(len(pulled))
        if loop.plant is not None:
            self.entry = self.entry @ np.kron(np.eye(loop.n), loop.plant.B)
        rows = np.eye(len(pulled), size)
        if loop.sensed is not None and loop.sensed.estimated:  # of x, not of xhat
            rows[:, len(pulled) :] = np.kron(np.eye(loop.n), loop.sensed.x)
        self.rows = rows[[seed % len(pulled) for seed in seeds]]

    def signs(self, size: float, *, horizon: float) -> Signs:
        """Those of the impulse response, from every residual to the agent, reversed in time: they
        attain its largest error at the horizon."""
        length = horizon / STEPS
        values = np.full((STEPS, *self.ports), size)
        if self.M is None:
            return Signs(values, length)
        rows = self.rows
        step = expm(self.M * length)
        for k in range(STEPS):
            # how much the end moves with every residual in this stretch
            response = (rows @ self.entry).reshape(len(rows), self.ports[0], -1)
            response = np.moveaxis(response, 0, -1)
            values[STEPS - 1 - k] = np.where(response < 0, -size, size)
            rows = rows @ step
        return Signs(values, length)

    def sines(self, band: Band) -> Sines:
        """At the frequency of the band to which the agent responds most, with the phases at which
        all residuals add up."""
        low, high, size = band
        best = np.zeros(self.ports)
        frequency = np.full(self.ports, low)
        if self.M is not None:
            most = np.full(self.ports[2], -1.0)
            for w in np.linspace(low, high, FREQUENCIES):
                passed = np.linalg.solve(1j * w * np.eye(len(self.M)) - self.M, self.entry)
                response = np.moveaxis((self.rows @ passed).reshape(-1, *self.ports[:2]), 0, -1)
                gain = np.abs(response).sum(axis=(0, 1))
                more = gain > most
                most = np.maximum(gain, most)
                best[..., more] = -np.angle(response[..., more])
                frequency[..., more] = w
        return Sines(size=size, frequency=frequency, phase=best)


def _with_observer(loop: ClosedLoop, pulled: Array) -> tuple[Array, Array]:
    """The matrix of [e; eps] with that of e in it, and where a residual enters: at e, and through W
    at eps."""
    n = loop.n
    cut = len(pulled)
    own = np.eye(n)
    M = np.zeros((cut + n * loop.q, cut + n * loop.q))
    M[:cut, :cut] = pulled
    M[:cut, cut:] = np.kron(own, loop.C)
    M[cut:, cut:] = np.kron(own, loop.F)
    gain = -loop.W
    direct = 1
    if loop.sensed is not None:
        # an error of the estimate, which is acted on or not
        gain = loop.sensed.entry
        direct = not loop.sensed.estimated
    gains = [gain] * n if gain.ndim == 2 else list(gain)
    return M, np.vstack([direct * np.eye(cut), block_diag(*gains)])


def worst_signal(problem: Problem) -> Periodic | None:
    """Of short rounds with the shortest and longest times of the guarantee "dwell" (without a
    longest: 1, 2 and 4 times the shortest, or a mode for ever), the one under which e, linearised,
    decays most slowly.  None without this guarantee, with too many agents or modes, and where a
    coupling has no slope at the target."""
    loop = errors_of(problem)
    phases = loop.guarantee.phases
    own = problem.switching
    most = min(MOST_ROUNDS, MOST_WORK // (problem.n * problem.m) ** 3)
    if not phases or own is None or own.guarantee != "dwell" or (2 * len(phases)) ** 2 > most:
        return None
    slopes = [consensus_jacobian(loop, phase.mode) for phase in phases]
    pulls = pull_matrix(loop)
    flows = [(each - pulls).toarray() for each in slopes if each is not None]
    if len(flows) < len(phases):
        return None
    ends = _stays(phases[0])
    least = 1 if phases[0].longest is None else 2
    steps = {(p, end): expm(flow * end) for p, flow in enumerate(flows) for end in ends}
    slowest = -np.inf
    found = None
    for turns in _rounds(len(phases), ends, least=least, most=most):
        lasting = [end for _, end in turns]
        # the last turn acts last, so it stands first in the product
        way = reduce(np.matmul, [steps[turn] for turn in reversed(turns)])
        growth = float(np.abs(np.linalg.eigvals(way)).max())
        # how fast errors grow over the round, in 1/s
        pace = np.log(max(growth, np.finfo(float).tiny)) / sum(lasting)
        if pace > slowest + SLOWER:
            slowest = pace
            order = tuple(phases[p].mode for p, _ in turns)
            found = Periodic(dwell=tuple(lasting), order=order)
    return found


def _stays(phase: Phase) -> list[float]:
    """How long a mode may last, in s: the lengths that are tried."""
    shortest = nearest(phase.shortest)
    if phase.longest is None:
        return [shortest, 2 * shortest, 4 * shortest]
    longest = nearest(phase.longest)
    return [shortest] if longest == shortest else [shortest, longest]


def _rounds(
    modes: int, ends: Sequence[float], *, least: int, most: int
) -> Iterator[tuple[Turn, ...]]:
    """Rounds of one mode or of neighbours that differ, as long as there are not too many of one
    length."""
    for length in range(least, LONGEST_ROUND + 1):
        if (len(ends) * (modes - 1)) ** length > most:
            return
        for order in product(range(modes), repeat=length):
            # the same round begins at every one of its modes; it is taken from the smallest
            if order[0] != min(order) or not _changes(order):
                continue
            for lasting in product(ends, repeat=length):
                yield tuple(zip(order, lasting, strict=True))


def _changes(order: tuple[int, ...]) -> bool:
    """Whether every mode is followed by another one, round and round."""
    turns = pairwise((*order, order[0]))
    return len(order) == 1 or all(mode != following for mode, following in turns)
