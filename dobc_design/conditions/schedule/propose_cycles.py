"""Proposals for weights that move under a guarantee: rates, weights at the beginning of each phase,
and their way.

G(x): the largest weights, times exp(rate t), that a phase hands over when its predecessors begin
with x and fall as fast as their rows allow.  Where iterates of x = max (1, G(x)) settle, they
serve.  Floating point; no proofs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import partial
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from dobc_design._checks import noun
from dobc_design.conditions.numbers import rounded_up
from dobc_design.conditions.separable.claim import ErrorBound
from dobc_design.conditions.separable.coordinates import enclosed_ranges
from dobc_design.conditions.separable.propose_coordinates import (
    Agents,
    Gains,
    Rows,
    candidates,
    in_floats,
)
from dobc_design.conditions.separable.propose_observer import with_kappa
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array, Matrix, largest_entry, row_norm, to_float
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.exact.work import spend
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.loop.timing import Timing

from .chords import Chords
from .claim import Cycles, Weights
from .cycles import why_not
from .rows import MovingRows, heard_from, heard_last, rows_of_phases

STEEPEST = 1e6  # weights at most, the least at a beginning 1
FAR = 5.0  # and times rho, where couplings are not linear
SIZES = (1e-6, 0.5, 1.0)  # of rho, at which rows are looked at
ITERATIONS = 400  # of x = max (1, G(x)), which are cheap where it is linear
FOLLOWED = 6
SETTLED = 1e-7
#: Parts of the estimated rate; by which part of their speed and of that rate weights fall more
#: slowly; and how much a chord may bend.
TRIED = (
    (0.98, 0.0002, 0.0001),
    (0.94, 0.0002, 0.0001),
    (0.87, 0.0002, 0.0001),
    (0.8, 0.0005, 0.0003),
    (0.65, 0.002, 0.001),
    (0.5, 0.005, 0.005),
    (0.4, 0.01, 0.01),
    (0.25, 0.02, 0.02),
    (0.15, 0.05, 0.05),
    (0.04, 0.2, 0.2),
)
#: The same where couplings are not linear: rows with little room take the second program long.
TRIED_CURVED = (
    (0.94, 0.002, 0.001),
    (0.87, 0.002, 0.001),
    (0.8, 0.005, 0.003),
    (0.65, 0.01, 0.01),
    (0.5, 0.02, 0.02),
    (0.4, 0.03, 0.03),
    (0.25, 0.05, 0.05),
    (0.15, 0.05, 0.05),
    (0.04, 0.1, 0.1),
)
ROOM = 0.998  # of a rate, that is claimed
HANDED = 1  # steps of work for what one phase hands over
SUCCESSORS = 10  # phases that take over, for one more step
ENDS = 24  # parts of the times at which a phase may end
MOST_STEPS = 500
MOST_COORDINATES = 3
ROUNDS = 4  # of weights and gains in turn, and at least of a sequence
WIDER = 1.05  # than the largest weights seen
# times that a phase without an end is doubled until its rows hold with weights at rest
TAILS = 8
NEARLY = 0.95  # of the largest weights: iterates that come so far do not settle
ROUNDED_UP = 1 + 1e-10  # weights, before they are written with eleven digits

Way = list[tuple[Fraction, Array]]  # times (s) from the beginning of a phase, and weights there


def _steepest(rho: Fraction | None) -> float:
    """The largest weight that is tried, where the least at a beginning is 1."""
    return STEEPEST if rho is None else max(FAR, FAR / float(rho))


@noun(eq=False)
class _Turned:
    """Rows of a mode in coordinates z = T e, for fixed gains."""

    rows: Rows

    @classmethod
    def of(cls, loop: Loop, T: Matrix, gains: Gains) -> dict[str, _Turned]:
        """By mode."""
        agents = Agents.of(loop, most=loop.n)
        turned = to_float(T)
        found = dict[str, _Turned]()
        for mode, arcs in zip(loop.modes, agents.modes, strict=True):
            alone = replace(agents, modes=(arcs,))
            found[mode] = cls(rows=Rows.of(alone, turned, gains))
        return found

    def matrix(self) -> Array:
        """What the slopes are for weights of 1, as a matrix."""
        _, sparse = self.rows.chosen(self.rows.agents.ones)
        return np.asarray(sparse.toarray())

    def pull(self, v: Array, _: Sequence[float], __: Array) -> Array:
        """The slopes (count, n m) that the rows ask of weights v (count, n m)."""
        found = self.rows.largest(v.reshape(len(v), -1, len(self.rows.T)))
        return np.asarray(found.reshape(v.shape))


class _Beginning(NamedTuple):
    """All that the way of weights through a phase depends on."""

    mode: str
    shortest: Fraction
    longest: Fraction | None
    rate: float
    start: bytes


@noun(eq=False)
class _Flow:
    """How the weights of a phase fall."""

    phase: Phase
    rows: MovingRows | _Turned
    sizes: tuple[float, ...]
    slack: float
    pace: float  # 1/s, about the rate
    bend: float
    timing: Timing | None = None
    known: dict[_Beginning, Way | None] = field(default_factory=dict)

    def asked(self, past: Any, v: Array, t: Fraction = ZERO) -> Array:
        """The slopes (count, n) that rows ask of weights (count, n) where neighbours may still read
        ``past`` ones, and a little more."""
        found = self.rows.pull(v, self.sizes, np.maximum(past, v))
        return np.asarray(found + self.slack * (np.abs(found) + self.pace * v))

    def way(self, start: Array, rate: float) -> Way | None:
        """Until its longest time; without one until the weights keep their place.  None if none is
        found."""
        phase = self.phase
        key = _Beginning(phase.mode, phase.shortest, phase.longest, rate, start.tobytes())
        if key not in self.known:
            self.known[key] = self._way(start, rate)
        return self.known[key]

    def _way(self, start: Array, rate: float) -> Way | None:
        shortest = self.phase.shortest
        longest = self.phase.longest
        # About as fine as the ends of phases are compared.
        step = float(shortest) / ENDS
        chords = Chords(
            bend=self.bend,
            pace=self.pace,
            step=step,
            floor=1.0,
            longest=step if self.timing else math.inf,
        )
        way = [(ZERO, start)]
        if self.timing is not None:
            way = [(-self.timing.delay, start[0]), (ZERO, start[1])]
        nodes = _ends(shortest, longest or shortest)
        for k in range(TAILS):
            if not self._follow(way, nodes, chords):
                return None
            _, last = way[-1]
            delay = ZERO if self.timing is None else self.timing.delay
            past = self._past(way) * math.exp(rate * delay)
            if longest is not None or np.all(self.asked(past, last[None])[0] <= -rate * last):
                return way
            nodes = [shortest * 2 ** (k + 1)]
        return None

    def _past(self, way: Way) -> Any:
        times, v = zip(*way, strict=True)
        return heard_last(v, times, self.timing)

    def _follow(self, way: Way, nodes: Sequence[Fraction], chords: Chords) -> bool:
        """Go on until the last of some times, by way of the others; False where it gets stuck."""
        for node in nodes:
            while way[-1][0] < node:
                now, point = way[-1]
                asked = partial(self.asked, self._past(way))
                found = chords.next(point, now, node, asked)
                if found is None or len(way) > MOST_STEPS:
                    return False
                way.append(found)
        return True


def propose(
    loop: Loop,
    W: Matrix | None,
    *,
    rho: Fraction | None,
    error: ErrorBound | None,
    late: bool = False,
) -> Cycles | None:
    """The fastest claim that is proved for weights whose least at the beginning of phases is 1;
    ``late``: with the readings that the problem states."""
    widest = (ONE if rho is None else rho) * Fraction(_steepest(rho))
    # Tables reach as far as the largest weights that are tried.
    found = rows_of_phases(loop, widest)
    rows = {mode: each for mode, each in found.items() if each is not None}
    linear = _Linear.at_the_target(loop)
    if len(rows) < len(found) or linear is None:
        return None
    sizes: tuple[float, ...] = (1.0,)
    if rho is not None:
        sizes = tuple(part * float(rho) for part in SIZES)
    timing = loop.timing if late else None
    search = _Search(rows=rows, linear=linear, sizes=sizes, rho=rho, error=error, timing=timing)
    return next((each for each in search.drafts() if why_not(loop, W, each) is None), None)


def propose_in_coordinates(
    loop: Loop,
    W: Matrix | None,
    *,
    box: tuple[Fraction, Fraction] | None,
    observed: Callable[[Matrix], ErrorBound | None],
) -> Cycles | None:
    """The same in coordinates z = T e, for starts |e|_inf, |eps_i| <= those of ``box``; None:
    linear couplings."""
    agents = Agents.of(loop, most=loop.n)
    near = agents.gains_near(float(box[0] if box else 1))
    if near is None:
        return None
    for T in _fastest_coordinates(loop, agents, near):
        error = observed(T)
        if loop.groups and error is None:
            continue
        rho = None
        if box is not None:
            radius, disturbance = box
            rho = rounded_up(row_norm(T) * radius + 2 * disturbance * _share(error), digits=6)
        claim = _claim_in(loop, W, T, rho, error)
        if claim is not None:
            return claim
    return None


def _fastest_coordinates(loop: Loop, agents: Agents, near: Gains) -> list[Matrix]:
    """Some T in which weights may fall, those first in which they fall fastest, about."""
    phases = loop.guarantee.phases
    rates = dict[Matrix, float]()
    for T in candidates(agents, near):
        linear = _Linear.of(phases, _Turned.of(loop, T, near))
        rates[T] = linear.estimate()
    falling = [T for T, rate in rates.items() if rate > 0]
    return sorted(falling, key=lambda T: -rates[T])[:MOST_COORDINATES]


def _claim_in(
    loop: Loop, W: Matrix | None, T: Matrix, rho: Fraction | None, error: ErrorBound | None
) -> Cycles | None:
    """A proved claim in coordinates: gains belong to weights that are known only afterwards, so
    both are found in turn."""
    phases = loop.guarantee.phases
    tallest = np.ones(loop.size)
    rounds = 1 if rho is None else ROUNDS
    for _ in range(rounds):
        v = tuple(rounded_up(Fraction(x), digits=6) for x in tallest.tolist())
        try:
            ranges = enclosed_ranges(loop, T, v, rho)
        except (UndefinedError, SpecError):
            return None
        rows = _Turned.of(loop, T, in_floats(ranges))
        linear = _Linear.of(phases, rows)
        search = _Search(rows=rows, linear=linear, sizes=(1.0,), rho=rho, error=error)
        draft = next(search.drafts(), None)
        if draft is None:
            return None
        claim = replace(draft, T=T, ranges=enclosed_ranges(loop, T, draft.tallest, rho))
        if why_not(loop, W, claim) is None:
            return claim
        seen = np.array([float(x) for x in draft.tallest])
        tallest = np.maximum(tallest, WIDER * seen)
    return None


def _share(error: ErrorBound | None) -> Fraction:
    """What an estimation error of 1 adds to V."""
    return ZERO if error is None else error.kappa * root_above(error.size, unit=10**6)


@noun(eq=False)
class _Search:
    """What weights are looked for: the rows of each mode, for s times the weights, s in ``sizes``;
    rho and the observer's part of the claim."""

    rows: Mapping[str, MovingRows | _Turned]
    linear: _Linear
    sizes: tuple[float, ...]
    rho: Fraction | None
    error: ErrorBound | None
    timing: Timing | None = None

    def drafts(self) -> Iterator[Cycles]:
        """Claims for these rows, the fastest first."""
        top = self.linear.estimate()
        if not top > 0:
            return
        most = top if self.error is None else min(top, float(self.error.beta))
        coarse = self.timing is not None or self.rho is not None
        for part, slack, bend in TRIED_CURVED if coarse else TRIED:
            # The fastest first, with the finest chords.
            rate = part * most
            flows = self._flows(pace=top, slack=slack, bend=bend)
            faster = (1 + part) / 2 * most
            x = self._beginnings(flows, rate, faster)
            claim = None if x is None else self._claim(flows, x, rate)
            if claim is not None:
                yield claim

    def _flows(self, *, pace: float, slack: float, bend: float) -> list[_Flow]:
        """One for each phase; what is known of one serves those that are alike."""
        known: dict[_Beginning, Way | None] = {}
        return [
            _Flow(
                phase=phase,
                rows=self.rows[phase.mode],
                sizes=self.sizes,
                slack=slack,
                pace=pace,
                bend=bend,
                timing=self.timing,
                known=known,
            )
            for phase in self.linear.phases
        ]

    def _beginnings(self, flows: Sequence[_Flow], rate: float, faster: float) -> list[Array] | None:
        """The weights with which phases begin; None where they do not settle."""
        phases = self.linear.phases
        most = _steepest(self.rho)
        steps = 10 * ITERATIONS
        if _in_turn(phases):
            steps = max(ROUNDS, 10 * steps // len(phases))
        # Near the target first, where a phase is a matrix, at a rate that leaves room.
        ones = [np.ones(self.linear.size) for _ in phases]
        near = partial(self.linear.handed, rate=faster)
        x = _settled(phases, near, ones, most=most, steps=steps)
        if x is None:
            return None
        if self.timing is not None:
            x = [np.array([each, each]) for each in x]
        followed = partial(_handed, flows, rate=rate)
        return _settled(phases, followed, x, most=most, steps=FOLLOWED * (5 if self.timing else 1))

    @np.errstate(all="ignore")
    def _claim(self, flows: Sequence[_Flow], x: Sequence[Array], rate: float) -> Cycles | None:
        phases = list[Weights]()
        for flow, start in zip(flows, x, strict=True):
            way = flow.way(start, rate)
            if way is None:
                return None
            # without what was before
            way = [(t, v) for t, v in way if t >= 0]
            times = tuple(t for t, _ in way)
            v = tuple(_written(point) for _, point in way)
            phases.append(Weights(times=times, v=v))
        # A little less than the chords fall by, for the digits that are cut.
        claimed = Fraction(f"{rate * ROOM:.6g}")
        late = self.timing is not None
        claim = Cycles(phases=tuple(phases), rate=claimed, rho=self.rho, late=late)
        if self.error is None:
            return claim
        return replace(claim, error=with_kappa(self.error, rate=claimed, least=claim.least))


def _written(point: Array) -> tuple[Fraction, ...]:
    """Weights as they are claimed, with few digits, rounded up about."""
    return tuple(Fraction(f"{x * ROUNDED_UP:.11g}") for x in point.tolist())


def late_rate(loop: Loop) -> float:
    """About the largest rate (1/s) near the target; 0 where none is seen."""
    linear = _Linear.at_the_target(loop)
    return 0.0 if linear is None else linear.estimate()


def _ends(first: Fraction, last: Fraction) -> list[Fraction]:
    """Times at which a phase may end, as close as its weights are then compared."""
    if first == last:
        return [first]
    return [first + (last - first) * k / ENDS for k in range(ENDS + 1)]


def _most(times: Array, v: Array, rate: float) -> Array:
    """exp(rate t) v(t) at most, for v (count, n), between two times with the larger v and the later
    one."""
    larger = np.vstack([v[:1], np.maximum(v[:-1], v[1:])])
    grown = np.exp(rate * times)[:, None] * larger
    return np.asarray(np.max(grown, axis=0))


def _handed(flows: Sequence[_Flow], p: int, start: Array, rate: float) -> Array | None:
    """The largest weights, times exp(rate t), that phase p hands over when it begins with these."""
    way = flows[p].way(start, rate)
    if way is None:
        return None
    phase = flows[p].phase
    times = np.array([float(t) for t, _ in way])
    v = np.array([v for _, v in way])
    ends = times >= float(phase.shortest)
    found = _most(times[ends], v[ends], rate)
    timing = flows[p].timing
    if timing is None:
        return found
    first = heard_from([t for t, _ in way], phase.shortest, timing)
    last = np.minimum(times + float(timing.delay), float(phase.longest or math.inf))
    return np.array([_most(last[first:], v[first:], rate), found])


class _Maps(NamedTuple):
    """Times (s) at which a phase may end, and the maps (count, size, size) until then."""

    times: Array
    maps: Array


@noun(eq=False)
class _Linear:
    """The same for the linearisation at the target: products of matrices, for phases of finite and
    of any length."""

    phases: Sequence[Phase]
    ways: Sequence[_Maps]  # of each phase

    @classmethod
    def at_the_target(cls, loop: Loop) -> _Linear | None:
        """By the slopes of one component, which are those of all; None where there are none."""
        found = dict[str, Array]()
        m = loop.m
        phases = loop.guarantee.phases
        K = pull_matrix(loop)
        for mode in {phase.mode for phase in phases}:
            jacobian = consensus_jacobian(loop, mode)
            if jacobian is None:
                return None
            found[mode] = np.asarray((jacobian - K).todense())[::m, ::m]
        return cls.along(phases, found)

    @classmethod
    def of(cls, phases: Sequence[Phase], rows: Mapping[str, _Turned]) -> _Linear:
        """By rows in coordinates."""
        return cls.along(phases, {mode: each.matrix() for mode, each in rows.items()})

    @classmethod
    def along(cls, phases: Sequence[Phase], M: Mapping[str, Array]) -> _Linear:
        """By the matrix of every mode; phases that are alike share their maps."""
        known: dict[tuple[str, Fraction, Fraction], _Maps] = {}
        ways = list[_Maps]()
        for phase in phases:
            last = phase.shortest * 2 if phase.longest is None else phase.longest
            key = (phase.mode, phase.shortest, last)
            if key not in known:
                known[key] = _maps(M[phase.mode], _ends(phase.shortest, last))
            ways.append(known[key])
        return cls(phases=phases, ways=ways)

    @property
    def size(self) -> int:
        """How many weights there are."""
        return int(self.ways[0].maps.shape[-1])

    def handed(self, p: int, start: Array, rate: float) -> Array:
        """The largest weights, times exp(rate t), that phase p hands over when it begins with
        these."""
        way = self.ways[p]
        return _most(way.times, way.maps @ start, rate)

    def estimate(self) -> float:
        """About the largest rate: how fast weights shrink that phases hand over, per second."""
        if _in_turn(self.phases):
            return self._of_one_round()
        mean = float(np.mean([way.times[-1] for way in self.ways]))
        shrinking = list(self._spreading())
        # The first steps depend on where the weights began.
        late = shrinking[len(shrinking) // 2 :]
        if not math.isfinite(sum(late)):
            return 0.0
        return sum(late) / len(late) / mean

    @np.errstate(all="ignore")  # a round may leave the floats
    def _of_one_round(self) -> float:
        """The same where each phase has one end: by the spectral radius of the map of a round."""
        whole = np.eye(self.size)
        lost = 0.0
        for way in self.ways:
            spend(HANDED)
            whole = way.maps[-1] @ whole
            size = largest_entry(whole)
            if not (size > 0 and math.isfinite(size)):
                return 0.0
            whole = whole / size
            lost -= math.log(size)
        radius = largest_entry(np.linalg.eigvals(whole))
        length = sum(float(way.times[-1]) for way in self.ways)
        return (lost - math.log(radius)) / length if radius > 0 else 0.0

    def _spreading(self) -> Iterator[float]:
        """How far weights shrink when every phase hands over at once, as a logarithm."""
        n = self.size
        x = [np.ones(n) for _ in self.phases]
        work = sum(_work(phase) for phase in self.phases)
        for _ in range(ITERATIONS):
            # Only directions matter: sizes are taken out, or they would leave the floats.
            spend(work)
            found = [np.zeros(n) for _ in self.phases]
            for p, phase in enumerate(self.phases):
                handed = self.handed(p, x[p], 0.0)
                for q in phase.successors:
                    found[q] = np.maximum(found[q], handed)
            size = max(float(each.max()) for each in found)
            if size > 0:
                yield -math.log(size)
                x = [each / size for each in found]
            else:
                yield math.inf


def _work(phase: Phase) -> int:
    """Steps of work for what a phase hands over: with a dwell time to every other mode."""
    return HANDED + len(phase.successors) // SUCCESSORS


def _in_turn(phases: Sequence[Phase]) -> bool:
    """Whether it is said which phase follows which."""
    count = len(phases)
    return all(phase.successors == ((p + 1) % count,) for p, phase in enumerate(phases))


@np.errstate(all="ignore")
def _maps(M: Array, ends: Sequence[Fraction]) -> _Maps:
    """The maps exp(M t) until every time at which a phase may end, ENDS equal steps apart."""
    spend(HANDED * len(ends))
    times = np.array([float(t) for t in ends])
    first = expm(M * times[0])
    step = expm(M * ((times[-1] - times[0]) / ENDS))
    maps = accumulate([step] * (len(times) - 1), np.matmul, initial=first)
    return _Maps(times, np.array(list(maps)))


@np.errstate(all="ignore")  # near the ends of the floats
def _settled(
    phases: Sequence[Phase],
    handed: Callable[[int, Array], Array | None],
    x: Sequence[Array],
    *,
    most: float,
    steps: int,
) -> list[Array] | None:
    """x >= max (1, G(x)), from a smaller one, phase after phase; None if it grows too far."""
    x = list(x)
    for _ in range(steps):
        settled = True
        for p, phase in enumerate(phases):
            spend(_work(phase))
            found = handed(p, x[p])
            if found is None or float(found.max()) > NEARLY * most:
                return None
            for q in phase.successors:
                settled = settled and bool(np.all(found <= x[q] * (1 + SETTLED)))
                x[q] = np.maximum(x[q], found)
        if settled:
            return x
    return None
