"""Certified sets and other sets of starts, how they are searched, and many starts run side by side,
in floats.

Starts are e (n m, R) and eps (n, q, R), a column for each run.  Every V is positive homogeneous of
degree 1 in them, so that a factor brings every start but 0 to the boundary of a certified set.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of
from dobc_design.conditions.check import Check
from dobc_design.conditions.graphs.decide import generator_of
from dobc_design.conditions.kinds import ids_of
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.schedule.cycles import Phase, phases_of
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import composite_rate
from dobc_design.errors import SpecError, wrong
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.problem.arrays import Array, Gain, arc_groups, consensus_jacobian, pinning_matrix
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem
from dobc_design.simulation.columns import (
    COLLAPSED,
    COLUMN_NUMBERS,
    ESCAPED,
    HANDED_BACK,
    MOST_STEPS,
    Stack,
    padded,
)
from dobc_design.simulation.field import Loop, Network, make_closed_form, make_loop, network_of
from dobc_design.simulation.signals import Markov
from dobc_design.simulation.switches import Switches, scheduled_switches
from dobc_design.verdict import Verdict

Pair = tuple[Array, Array]
BoolArray = NDArray[np.bool_]
Certified = Separable | Lure | Check

RANDOM, CORNERS, EDGES = "random", "corners", "edges"
EVERYWHERE = 1.0  # the level that stands for a certificate that holds everywhere
TINY = 1e-300
AWAY = 1.0  # without a region: at most this far from the goal, in every component
MOST_ENUMERATED = 8  # components up to which all corners are taken in turn
SAMPLES = 121
TIME_CONSTANTS = 12.0  # of the slowest decay at the consensus that a run lasts
LONGEST = 20.0  # times the horizon of the problem at most
LARGEST_SPECTRUM = 300  # rows up to which the slowest decay is estimated
NEAR = 1e-3  # of the start: a run that ends closer has converged
STALLED = 0.8  # the part of its error halfway that a run still has at the end


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxLevel:
    """V = max_k |e_k| / height_k + max_i |eps_i|_P, height (n m,), scaled so that it is 1 on the
    boundary.  ``rate`` in 1/s: V(t) <= V(0) exp(-rate t) is certified while V <= 1.  ``P`` (q, q)
    is the observer's matrix, scaled like V; None where the certificate is about eps = 0 only.  With
    ``T`` (m, m) it is T e_i that the heights belong to."""

    name: str
    rate: float
    height: Array
    P: Array | None
    T: Array | None = None

    @property
    def lengths(self) -> Array:
        """How far the set reaches from side to side, about, by component of e: (n m,)."""
        return (
            np.asarray(2 * self.height)
            if self.T is None
            else 2 * turned(np.abs(inverse(self.T)), self.height)
        )

    def value(self, e: Array, eps: Array) -> Array:
        """V of states e (n m, R) and eps (n, q, R): (R,)."""
        sides = np.abs(turned(self.T, e)) / self.height[:, None]
        return np.asarray(sides.max(axis=0) + observer_norms(self.P, eps).max(axis=0, initial=0.0))

    def gradient(self, e: Array, eps: Array) -> Pair:
        """A (sub)gradient of V at one state e (n m,), eps (n, q) with V > 0."""
        along, along_eps = np.zeros_like(e), np.zeros_like(eps)
        z = turned(self.T, e)
        place = int(np.argmax(np.abs(z) / self.height))
        along[place] = np.sign(z[place]) / self.height[place]
        own = observer_norms(self.P, eps[:, :, None])[:, 0]
        if self.P is not None and own.max(initial=0.0) > 0:
            agent = int(np.argmax(own))
            along_eps[agent] = self.P @ eps[agent] / own[agent]
        return along if self.T is None else turned(self.T.T, along), along_eps

    def directions(self, standard: Array) -> Array:
        """Errors (n m, R) that are spread over the set, from standard ones."""
        return turned(None if self.T is None else inverse(self.T), standard * self.height[:, None])


def inverse(T: Array) -> Array:
    """T^-1."""
    return np.asarray(np.linalg.inv(T), dtype=float)


def turned(T: Array | None, e: Array) -> Array:
    """T e_i of every agent, for e (n m,) or (n m, R); e itself without T."""
    return e if T is None else np.asarray((T @ e.reshape(-1, len(T), e[0].size)).reshape(e.shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ellipsoid:
    """V = root of e'P_e e + sum |eps_i|_P^2, P_e (n m, n m); everything else as in ``BoxLevel``."""

    name: str
    rate: float
    P_e: Array
    P: Array | None

    @property
    def lengths(self) -> Array:
        return np.asarray(2 / np.sqrt(np.maximum(np.diag(self.P_e), TINY)))

    def value(self, e: Array, eps: Array) -> Array:
        squares = np.maximum(0.0, np.sum((self.P_e @ e) * e, axis=0))
        return np.asarray(np.sqrt(squares + np.sum(observer_norms(self.P, eps) ** 2, axis=0)))

    def gradient(self, e: Array, eps: Array) -> Pair:
        size = float(self.value(e[:, None], eps[:, :, None])[0])
        along_eps = np.zeros_like(eps) if self.P is None else eps @ self.P / size
        return np.asarray(self.P_e @ e / size), np.asarray(along_eps)

    def directions(self, standard: Array) -> Array:
        values, vectors = np.linalg.eigh(self.P_e)
        return np.asarray(vectors @ (standard / np.sqrt(np.maximum(values, TINY))[:, None]))


Level = BoxLevel | Ellipsoid


def observer_norms(P: Array | None, eps: Array) -> Array:
    """|eps_i|_P of every agent and run, (n, R), for eps (n, q, R); 0 without a P."""
    if P is None:
        return np.zeros((eps.shape[0], eps.shape[2]))
    return np.asarray(np.sqrt(np.maximum(0.0, np.einsum("nar,ab,nbr->nr", eps, P, eps))))


def level_of(problem: Problem, certified: Certified, W: Matrix | None = None) -> Level:
    """The set of a claim, or of a proved check about ``W``; up to V = 1 if it holds everywhere.
    Raises: SpecError."""
    cure = "Give the certificate of this very problem."
    if isinstance(certified, Check):
        certified = _claim_of(problem, certified, W)
    if isinstance(certified, Separable):
        T, count = (
            None if certified.T is None else to_float(certified.T),
            problem.n * len(certified.T or (1,)),
        )
        if len(certified.v) != count:
            raise wrong(
                "certified",
                f"must have {count} weights v for this problem; got {len(certified.v)}.",
                cure,
            )
        rho, error, P = (
            EVERYWHERE if certified.rho is None else float(certified.rho),
            certified.error,
            None,
        )
        if error is not None:
            P = to_float(error.P) * (float(error.kappa) / rho) ** 2
        height = np.repeat([float(v) for v in certified.v], problem.m if T is None else 1) * rho
        return BoxLevel(
            name="max-separable", rate=float(composite_rate(certified)), height=height, P=P, T=T
        )
    rows = problem.n * problem.m
    if certified.P_e.size != rows:
        raise wrong("certified", f"must have a P_e of {rows} rows; got {certified.P_e.size}.", cure)
    size = EVERYWHERE if certified.level is None else float(certified.level)
    P = None if certified.P is None else to_float(certified.P) / size
    return Ellipsoid(
        name="lure", rate=float(certified.rate), P_e=to_float(certified.P_e.to_dense()) / size, P=P
    )


def _claim_of(problem: Problem, check: Check, W: Matrix | None) -> Separable | Lure:
    """What a proved check of a region claims."""
    known = ids_of("region")
    if check.verdict is not Verdict.PROVED or check.id not in known or check.claim is None:
        message = (
            f"must be a proved check of a region ({', '.join(known)}); got "
            f"{check.verdict.value} {check.title}."
        )
        raise wrong("certified", message, "Ask for a [region], or give certify everything=True.")
    try:
        claim = claim_of(check, problem, W)
    except (KeyError, TypeError, ValueError) as error:
        message = f"certified: the check {check.title} does not fit this problem ({error})."
        raise SpecError(
            message, key="certified", cure="Give the certificate of this very problem."
        ) from error
    if not isinstance(claim, Separable | Lure):
        raise SpecError(
            f"certified: the check {check.title} names no set of starts.", key="certified"
        )
    return claim


SIGNALS = ("schedule", "markov")  # about some signals only


def regional_check(certificate: Certificate) -> Check | None:
    """The proved check of a region that covers what is asked, else the first one; None without
    one.  One whose sets move with time is none."""
    regional = [
        check
        for check in certificate.checks
        if check.kind.role == "region" and check.id not in SIGNALS
    ]
    proved = [check for check in regional if check.verdict is Verdict.PROVED]
    covering = (check for check in proved if check.id == certificate.claims.covered_by)
    return next(covering, proved[0] if proved else None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """low <= e <= high, both (n m,), and |eps_i| <= radius for every agent of the loop."""

    words: str
    loop: Loop
    low: Array
    high: Array
    radius: float

    @property
    def reach(self) -> Pair:
        """How far the set reaches from side to side, by number of e and of eps."""
        return self.high - self.low, 2 * self.radius * _owned(self.loop)

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        part, own = unit_cube(rng, len(self.low), count, kind), _owned(self.loop)
        e = self.low[:, None] + (self.high - self.low)[:, None] * (part + 1) / 2
        sizes = np.maximum(1.0, own.sum(axis=1))[:, None, None]
        lengths = rng.random((len(own), 1, count)) ** (1 / sizes) if kind == RANDOM else 1.0
        return e, self.radius * lengths * sphere(rng, own, count)

    def project(self, e: Array, eps: Array) -> Pair:
        eps = eps * _owned(self.loop)[:, :, None]
        factor = np.minimum(
            1.0, self.radius / np.maximum(np.linalg.norm(eps, axis=1, keepdims=True), TINY)
        )
        return np.clip(e, self.low[:, None], self.high[:, None]), eps * factor

    def holds(self, e: Array) -> bool:
        """Whether e (n m,) with eps = 0 is in the set, but for rounding."""
        slack = 1e-9 * (1 + np.abs(self.high) + np.abs(self.low))
        return bool(np.all((self.low - slack <= e) & (e <= self.high + slack)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundary:
    """V = 1 for a certified set; a third of the starts has eps = 0.  Everything as in ``Box``."""

    level: Level
    loop: Loop

    @property
    def words(self) -> str:
        return f"the boundary of the {self.level.name} set"

    @property
    def reach(self) -> Pair:
        width = (
            0.0
            if self.level.P is None
            else 2 / np.sqrt(max(TINY, float(np.trace(self.level.P)) / self.loop.q))
        )
        return self.level.lengths, width * _owned(self.loop)

    def draw(self, rng: np.random.Generator, count: int, kind: str) -> Pair:
        rows, own = self.loop.n * self.loop.m, _owned(self.loop)
        part = (
            rng.standard_normal((rows, count))
            if kind == RANDOM
            else unit_cube(rng, rows, count, kind)
        )
        e = self.level.directions(part)
        eps = sphere(rng, own, count) * rng.random((self.loop.n, 1, count))
        sizes, sizes_eps = self.level.value(e, 0 * eps), self.level.value(0 * e, eps)
        share = rng.random(count) * (rng.random(count) < 2 / 3)
        if self.level.P is None:
            share, eps = np.zeros(count), 0 * eps
        e = e * ((1 - share) / np.maximum(sizes, TINY))
        return self.project(e, eps * (share / np.maximum(sizes_eps, TINY)))

    def project(self, e: Array, eps: Array) -> Pair:
        eps = np.zeros_like(eps) if self.level.P is None else eps * _owned(self.loop)[:, :, None]
        size = np.maximum(self.level.value(e, eps), TINY)
        return e / size, eps / size

    def holds(self, e: Array) -> bool:
        return bool(
            self.level.value(e[:, None], np.zeros((self.loop.n, self.loop.q, 1)))[0] <= 1 + 1e-9
        )


StartSet = Box | Boundary


def asked_box(
    problem: Problem, loop: Loop, *, radius: float | None = None, disturbance: float | None = None
) -> Box:
    """|e|_inf <= radius, else the region, else |e|_inf <= 1; |eps_i| as asked, else the region's,
    else 0."""
    region, goal = problem.region, loop.goal.ravel()
    if radius is None and region is not None:
        low, high = np.tile(to_float(region.initial_states), (problem.n, 1)).T - goal
        words = "the region"
    else:
        far = AWAY if radius is None else radius
        low, high, words = (
            np.full(len(goal), -far),
            np.full(len(goal), far),
            f"|e|_inf <= {far:.4g}",
        )
    if disturbance is None:
        disturbance = 0.0 if region is None else float(region.initial_disturbance or 0)
    return Box(words=words, low=low, high=high, radius=disturbance, loop=loop)


def _owned(loop: Loop) -> Array:
    """1 where a number of eps is the agent's own, (n, q)."""
    return np.ones((loop.n, loop.q)) if loop.own is None else loop.own.astype(np.float64)


def unit_cube(rng: np.random.Generator, rows: int, count: int, kind: str) -> Array:
    """Points of [-1, 1]^rows, (rows, count): anywhere, at corners (all where there are few), or on
    sides."""
    inside = rng.uniform(-1, 1, (rows, count))
    signs = rng.choice((-1.0, 1.0), (rows, count))
    if kind == RANDOM:
        return inside
    if kind == EDGES:
        at_end = rng.random((rows, count)) < rng.random(count)
        at_end[rng.integers(rows, size=count), np.arange(count)] = True
        return np.where(at_end, signs, inside)
    if rows <= MOST_ENUMERATED:
        every = np.array(list(itertools.product((-1.0, 1.0), repeat=rows))).T
        signs[:, : every.shape[1]] = every[:, :count]
    else:
        signs[:, :2] = np.array([-1.0, 1.0])[:count]
    return signs


def sphere(rng: np.random.Generator, own: Array, count: int) -> Array:
    """Unit vectors of the numbers that are an agent's own, (n, q, count) for ``own`` (n, q)."""
    directions = rng.standard_normal((*own.shape, count)) * own[:, :, None]
    return np.asarray(
        directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), TINY)
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arena:
    """The loop of a problem, ready to be run from many starts.  ``modes`` are the names of the
    modes."""

    problem: Problem
    loop: Loop
    modes: tuple[str, ...]
    networks: Callable[[int], Network]


def make_arena(problem: Problem, gain: Gain | None) -> Arena:
    """Prepare the loop; ``gain`` (q, m) is W.  Raises: SpecError if there is an exosystem and no
    W."""
    loop, names = make_loop(problem, gain), tuple(problem.network.modes)
    size = max(1, COLUMN_NUMBERS // (loop.n * loop.m))
    networks = cache(lambda mode: network_of(loop, arc_groups(problem, names[mode]), runs=size))
    return Arena(problem=problem, loop=loop, modes=names, networks=networks)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signals:
    """The active modes of R runs by index: times and modes (R, S), padded with inf and 0."""

    times: Array
    modes: IndexArray

    def of(self, run: int, names: tuple[str, ...]) -> tuple[tuple[float, str], ...]:
        pairs = zip(self.times[run].tolist(), self.modes[run].tolist(), strict=True)
        return tuple((time, names[mode]) for time, mode in pairs if time != np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runs:
    """What became of R starts: error and values (T, R) are |e|_inf and V, or nan; states (R,) as in
    ``columns``."""

    times: Array
    error: Array
    values: Array
    ends: Array
    states: IndexArray
    e: Array
    eps: Array
    signals: Signals

    @property
    def unfinished(self) -> BoolArray:
        """Runs that took too many steps, about which nothing is said."""
        return np.asarray(self.states == HANDED_BACK)

    @property
    def diverged(self) -> BoolArray:
        return np.asarray((self.states == ESCAPED) | (self.states == COLLAPSED))

    @property
    def stalled(self) -> BoolArray:
        """Runs that diverged, or that end far away without having come closer in the second
        half."""
        count = len(self.times)
        last = np.max(self.error[-count // 10 :], axis=0, initial=0.0)
        middle = np.max(self.error[int(0.45 * count) : int(0.55 * count) + 1], axis=0, initial=0.0)
        with np.errstate(invalid="ignore"):
            away = (last > NEAR * self.error[0]) & (last > STALLED * middle)
        return np.asarray((self.diverged | away) & ~self.unfinished)


def settling_horizon(problem: Problem) -> float:
    """How long a run should last (s): the problem's horizon, or longer where the consensus is
    slow."""
    horizon = float(problem.simulation.t_final)
    if problem.n * problem.m > LARGEST_SPECTRUM:
        return horizon
    jacobians = (consensus_jacobian(problem, mode) for mode in problem.network.modes)
    loops = [
        each.toarray() - pinning_matrix(problem).toarray() for each in jacobians if each is not None
    ]
    slowest = min((-float(np.linalg.eigvals(each).real.max()) for each in loops), default=np.inf)
    return (
        float(min(max(horizon, TIME_CONSTANTS / slowest), LONGEST * horizon))
        if slowest > 0
        else horizon
    )


def constant_signals(modes: IndexArray) -> Signals:
    """Each run in one mode (R,) all the time."""
    return Signals(times=np.zeros((len(modes), 1)), modes=modes[:, None].astype(np.int64))


def drawn_signals(
    rng: np.random.Generator, count: int, problem: Problem, horizon: float, *, longer: float = 1.0
) -> Signals:
    """Every third run in one mode, the modes in turn; the others switch at random, at quite
    different paces.  Under a guarantee all keep it, for ``longer`` horizons: modes last as short or
    as long as they may, or as a chain draws."""
    names, phases, generator = (
        tuple(problem.network.modes),
        phases_of(problem),
        generator_of(problem),
    )
    if phases or generator is not None:
        rows = [
            _kept(rng, problem, phases, longer * horizon) for _ in range(count if phases else 0)
        ]
        rates = tuple(tuple(map(float, row)) for row in generator or ())
        for _ in range(count if rates else 0):
            chain = Markov(generator=rates, start=str(rng.choice(names)))
            rows.append(
                scheduled_switches(chain, names, longer * horizon, int(rng.integers(2**32)))
            )
        times, active = padded(rows)
        return Signals(times=times, modes=active)
    modes = len(names)
    first = np.arange(count) % modes
    if modes == 1:
        return constant_signals(first)
    paces = rng.choice((5, 20, 80), count)
    longest = 2 * int(paces.max(initial=1))
    steps = rng.exponential(size=(count, longest)) * (horizon / paces)[:, None]
    times = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, axis=1)], axis=1)
    chosen = np.concatenate([first[:, None], rng.integers(modes, size=(count, longest))], axis=1)
    fixed = np.arange(count) // modes % 3 == 0
    times[:, 1:][fixed] = np.inf
    times[times >= horizon] = np.inf
    return Signals(times=times, modes=np.where(np.isinf(times), 0, chosen))


def _kept(
    rng: np.random.Generator, problem: Problem, phases: Sequence[Phase], horizon: float
) -> Switches:
    """The switches of a signal that keeps the phases of the guarantee."""
    names, times, modes, at = tuple(problem.network.modes), list[float](), list[int](), 0.0
    place = int(rng.choice([p for p, phase in enumerate(phases) if phase.first]))
    while at < horizon:
        phase = phases[place]
        times.append(at)
        modes.append(names.index(phase.mode))
        shortest = float(phase.shortest)
        longest = (
            float(rng.choice((2 * shortest, horizon)))
            if phase.longest is None
            else float(phase.longest)
        )
        at, place = at + float(rng.choice((shortest, longest))), int(rng.choice(phase.successors))
    return Switches(times=np.array(times), modes=np.array(modes), names=names)


def run_starts(
    arena: Arena,
    e: Array,
    eps: Array,
    signals: Signals,
    *,
    horizon: float,
    tolerance: float,
    samples: int = SAMPLES,
    level: Level | None = None,
    most: int = MOST_STEPS,
) -> Runs:
    """Simulate every start; V of ``level`` is followed.  Where the observer is too fast, eps = 0
    from the start."""
    loop, count, times = arena.loop, e.shape[1], np.linspace(0.0, horizon, samples)
    closed = make_closed_form(loop.F, loop.C, horizon) if loop.q else None
    states = make_closed_form(loop.F, np.eye(loop.q), horizon) if loop.q else None
    if closed is None or states is None:
        eps = np.zeros_like(eps)
    error, values = np.full((2, samples, count), np.nan)
    ends, outcome = np.full_like(e, np.nan), np.zeros(count, dtype=np.int64)
    weights = None if states is None else np.moveaxis(states.many(times), 2, 0)
    size = max(1, COLUMN_NUMBERS // (loop.n * loop.m))
    for begin in range(0, count, size):
        part = np.arange(begin, min(count, begin + size))

        def visit(
            sample: IndexArray, run: IndexArray, state: Array, part: IndexArray = part
        ) -> None:
            run = part[run]
            error[sample, run] = np.abs(state).max(axis=0)
            if level is not None:
                there = eps[:, :, run]
                if weights is not None:
                    there = np.einsum("kab,nbk->nak", weights[sample], there)
                values[sample, run] = level.value(state, there)
            last = sample == samples - 1
            ends[:, run[last]] = state[:, last]

        some, switches = eps[:, :, part], (signals.times[part], signals.modes[part])
        stack = Stack(
            loop=loop,
            networks=arena.networks,
            closed=closed,
            e=e[:, part],
            eps=some,
            switches=switches,
        )
        with np.errstate(all="ignore"):
            outcome[part] = stack.integrate(
                times, tolerance=tolerance, visit=visit, most=most
            ).states
    return Runs(
        times=times,
        error=error,
        values=values,
        ends=ends,
        states=outcome,
        e=e,
        eps=eps,
        signals=signals,
    )
