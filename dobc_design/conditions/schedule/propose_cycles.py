"""Proposals for weights that move under a guarantee: rates, weights at the beginning of each phase,
and their way.

G(x): the largest weights, times exp(rate t), that a phase hands over when its predecessors begin
with x and fall as fast as their rows allow.  Where iterates of x = max (1, G(x)) settle, they
serve.  Floating point; no proofs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import accumulate, islice
from typing import Any, Final

import numpy as np
from scipy.linalg import expm

from dobc_design.conditions.numbers import rounded_up
from dobc_design.conditions.schedule.cycles import ZERO, Cycles, Weights, why_not
from dobc_design.conditions.schedule.rows import MovingRows, moving_rows
from dobc_design.conditions.separable.claim import ErrorBound
from dobc_design.conditions.separable.coordinates import enclosed_ranges
from dobc_design.conditions.separable.propose_coordinates import (
    Agents,
    Gains,
    candidates,
    in_floats,
)
from dobc_design.conditions.separable.propose_observer import with_kappa
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.number import root_above
from dobc_design.exact.work import spend
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import consensus_jacobian, pull_matrix
from dobc_design.solvers.program import Array

ACCURACY: Final = 1e-7  # of a point, as a part of what it falls by
CLOSE: Final = 0.999  # of a goal, which a chord does not miss by more
MOST_HALVINGS: Final = 40
MOST_NEWTON: Final = 12
CHORD: Final = 40  # steps of work for an attempt at a chord

#: The slopes that are asked for at points (count, size), at one time (s).
Asked = Callable[[Array, Fraction], Array]


@dataclass(slots=True, kw_only=True, eq=False)
class Chords:
    """``bend``: by how much the slopes at both ends of a chord may differ, times its length, as a
    part of the entry, or the ``floor`` if it is less; without one of the largest entry.  ``pace``
    (1/s): the rate that measures accuracy."""

    bend: float
    pace: float
    step: float
    floor: float | None = None
    change: Array | None = None  # of the slopes with the point

    def next(
        self,
        point: Array,
        now: Fraction,
        until: Fraction | None,
        asked: Asked,
        *,
        lands: float | None = None,
    ) -> tuple[Fraction, Array] | None:
        """The end of the next chord, at most ``until``, and where its largest entry falls just
        below ``lands``."""
        before = asked(point[None], now)[0]
        for _ in range(MOST_HALVINGS):
            spend(CHORD)
            after = now + Fraction(f"{self.step:.4g}")
            if until is not None and after + (after - now) > until:  # no sliver is left over
                after = until if after >= until else now + (until - now) / 2
            length, found = float(after - now), self._end(point, before, now, after, asked)
            bent = math.inf
            if found is not None:
                scale = found[0].max() if self.floor is None else np.maximum(found[0], self.floor)
                bent = float(np.max(np.abs(found[1] - before) / scale)) * length
            if found is None or not bent <= 2 * self.bend:
                self.step = length / 2
                continue
            top, left = float(point.max()), float(found[0].max())
            if lands is None or left >= lands * CLOSE or top <= lands:
                self.step = length * min(2.0, math.sqrt(self.bend / max(bent, self.bend / 4)))
                return after, found[0]
            self.step = length * (top - lands) / (top - left)
        return None

    def _end(
        self, point: Array, before: Array, now: Fraction, after: Fraction, asked: Asked
    ) -> tuple[Array, Array] | None:
        """The end of a chord and the slopes asked for there, by Newton's method; None if it does
        not settle."""
        length, found, last = float(after - now), point.copy(), math.inf
        for _ in range(MOST_NEWTON):
            there = asked(found[None], after)[0]
            missed = point + length * np.maximum(before, there) - found
            left = float(np.max(np.abs(missed) / found))
            if left <= ACCURACY * length * self.pace:
                return found, there
            if self.change is None or not left <= last / 4:
                widths = 1e-6 * found
                self.change = (asked(found + np.diag(widths), after) - there).T / widths
            last = left
            J = np.where((there >= before)[:, None], self.change, 0.0)
            found = np.maximum(
                found + np.linalg.solve(np.eye(len(point)) - length * J, missed), found / 4
            )
        return None


STEEPEST: Final = 1e6  # weights at most, the least at a beginning 1
FAR: Final = 5.0  # and times rho, where couplings are not linear
SIZES: Final = (1e-6, 0.5, 1.0)  # of rho, at which rows are looked at
ITERATIONS: Final = 400  # of x = max (1, G(x)), which are cheap where it is linear
FOLLOWED: Final = 6
SETTLED: Final = 1e-7
#: Parts of the estimated rate; by which part of their speed and of that rate weights fall more
#: slowly; and how much a chord may bend.
TRIED: Final = (
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
TRIED_CURVED: Final = (
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
ROOM: Final = 0.998  # of a rate, that is claimed
HANDED: Final = 1  # steps of work for what one phase hands over
SUCCESSORS: Final = 10  # phases that take over, for one more step
ENDS: Final = 24  # parts of the times at which a phase may end
MOST_STEPS: Final = 500
MOST_COORDINATES: Final = 3
ROUNDS: Final = 4  # of weights and gains in turn, and at least of a sequence
WIDER: Final = 1.05  # than the largest weights seen
# times that a phase without an end is doubled until its rows hold with weights at rest
TAILS: Final = 8

Way = list[tuple[Fraction, Array]]  # times (s) from the beginning of a phase, and weights there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Turned:
    """Rows of a mode in coordinates z = T e, for fixed gains."""

    agents: Agents
    T: Array
    gains: Gains

    @classmethod
    def of(cls, loop: Loop, T: Matrix, gains: Gains) -> dict[str, _Turned]:
        agents = Agents.of(loop, most=loop.n)
        each = zip(loop.modes, agents.modes, strict=True)
        return {
            mode: cls(agents=replace(agents, modes=(arcs,)), T=to_float(T), gains=gains)
            for mode, arcs in each
        }

    def matrix(self) -> Array:
        """What the slopes are for weights of 1, as a matrix."""
        ones = np.ones((self.agents.size, len(self.T)))
        return np.asarray(self.agents.rows(self.T, self.gains, ones)[1].toarray())

    def pull(self, v: Array, _: Sequence[float]) -> Array:
        """The slopes (count, n m) that the rows ask of weights v (count, n m)."""
        found = self.agents.largest(self.T, self.gains, v.reshape(len(v), -1, len(self.T)))
        return np.asarray(found.reshape(v.shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Flow:
    """How the weights of a phase fall."""

    phase: Phase
    rows: MovingRows | _Turned
    sizes: tuple[float, ...]
    slack: float
    pace: float  # 1/s, about the rate
    bend: float
    known: dict[tuple[str, Fraction, Fraction | None, float, bytes], Way | None] = field(
        default_factory=dict
    )

    def asked(self, v: Array, t: Fraction = ZERO) -> Array:
        """The slopes (count, n) that rows ask of weights (count, n), and a little more."""
        found = self.rows.pull(v, self.sizes)
        return np.asarray(found + self.slack * (np.abs(found) + self.pace * v))

    def way(self, start: Array, rate: float) -> Way | None:
        """Until its longest time; without one until the weights keep their place.  None if none is
        found."""
        key = self.phase.mode, self.phase.shortest, self.phase.longest, rate, start.tobytes()
        if key not in self.known:
            self.known[key] = self._way(start, rate)
        return self.known[key]

    def _way(self, start: Array, rate: float) -> Way | None:
        nodes = _ends(self.phase.shortest, self.phase.longest or self.phase.shortest)
        way, last = [(ZERO, start)], self.phase.longest
        chords = Chords(
            bend=self.bend, pace=self.pace, step=float(self.phase.shortest) / ENDS, floor=1.0
        )
        for k in range(TAILS):
            for node in nodes:
                while way[-1][0] < node:
                    found = chords.next(way[-1][1], way[-1][0], node, self.asked)
                    if found is None or len(way) > MOST_STEPS:
                        return None
                    way.append(found)
            if last is not None or np.all(self.asked(way[-1][1][None])[0] <= -rate * way[-1][1]):
                return way
            nodes = [self.phase.shortest * 2 ** (k + 1)]
        return None


def propose(
    loop: Loop, W: Matrix | None, *, rho: Fraction | None, error: ErrorBound | None
) -> Iterator[Cycles]:
    """Claims that are proved for weights whose least at the beginning of phases is 1, the fastest
    first."""
    phases, reach = loop.guarantee.phases, Fraction(1) if rho is None else rho
    steepest = STEEPEST if rho is None else max(FAR, FAR / float(rho))
    modes = dict.fromkeys(phase.mode for phase in phases)
    rows = {mode: moving_rows(loop, reach * Fraction(steepest), [mode]) for mode in modes}
    known = {mode: found for mode, found in rows.items() if found is not None}
    if len(known) < len(rows):
        return
    sizes = (1.0,) if rho is None else tuple(part * float(rho) for part in SIZES)
    linear = _Linear.at_the_target(loop, phases)
    claims = (
        () if linear is None else _drafts(phases, known, linear, sizes=sizes, rho=rho, error=error)
    )
    yield from islice((claim for claim in claims if why_not(loop, W, claim) is None), 1)


def propose_in_coordinates(
    loop: Loop,
    W: Matrix | None,
    *,
    box: tuple[Fraction, Fraction] | None,
    observed: Callable[[Matrix], ErrorBound | None],
) -> Iterator[Cycles]:
    """The same in coordinates z = T e, for starts |e|_inf, |eps_i| <= those of ``box``; None:
    linear couplings."""
    phases, agents = loop.guarantee.phases, Agents.of(loop, most=loop.n)
    ones, found = np.ones((loop.n, loop.m)), dict[Matrix, float]()
    near = agents.gains_at(np.eye(loop.m), ones, float(box[0] if box else 1))
    if near is None:
        return
    for T in candidates(agents, near):
        if T is not None and T not in found:
            found[T] = _Linear.of(phases, _Turned.of(loop, T, near)).estimate(loop.n * loop.m)
    for T in sorted((T for T in found if found[T] > 0), key=lambda T: -found[T])[:MOST_COORDINATES]:
        error, size = observed(T), max(sum(map(abs, row), ZERO) for row in T)
        if loop.groups and error is None:
            continue
        far = (
            None
            if box is None
            else rounded_up(size * box[0] + 2 * box[1] * _share(error), digits=6)
        )
        tallest = np.ones(loop.n * loop.m)
        for _ in range(1 if box is None else ROUNDS):
            v = tuple(rounded_up(Fraction(x), digits=6) for x in tallest.tolist())
            try:
                ranges = enclosed_ranges(loop, T, v, far)
            except (UndefinedError, SpecError):
                break
            rows = _Turned.of(loop, T, in_floats(ranges))
            drafts = _drafts(
                phases, rows, _Linear.of(phases, rows), sizes=(1.0,), rho=far, error=error
            )
            draft = next(drafts, None)
            if draft is None:
                break
            claim = replace(draft, T=T, ranges=enclosed_ranges(loop, T, draft.tallest, far))
            if why_not(loop, W, claim) is None:
                yield claim
                return
            tallest = np.maximum(tallest, WIDER * np.array([float(x) for x in draft.tallest]))


def _share(error: ErrorBound | None) -> Fraction:
    """What an estimation error of 1 adds to V."""
    return ZERO if error is None else error.kappa * root_above(error.size, unit=10**6)


def _drafts(
    phases: Sequence[Phase],
    known: Mapping[str, MovingRows | _Turned],
    linear: _Linear,
    *,
    sizes: tuple[float, ...],
    rho: Fraction | None,
    error: ErrorBound | None,
) -> Iterator[Cycles]:
    """Claims for these rows, the fastest first."""
    size = linear.ways[0][1].shape[-1]
    top, steepest = linear.estimate(size), STEEPEST if rho is None else max(FAR, FAR / float(rho))
    for part, slack, bend in TRIED if rho is None else TRIED_CURVED:
        most = top if error is None else min(top, float(error.beta))
        rate, faster = part * most, (1 + part) / 2 * most
        if not top > 0:
            return
        ways: dict[Any, Way | None] = {}  # the same in phases that are alike
        flows = [
            _Flow(
                phase=phase,
                rows=known[phase.mode],
                sizes=sizes,
                slack=slack,
                pace=top,
                bend=bend,
                known=ways,
            )
            for phase in phases
        ]
        ones = [np.ones(size) for _ in phases]
        steps = 10 * ITERATIONS
        steps = max(ROUNDS, 10 * steps // len(phases)) if _in_turn(phases) else steps
        x = _settled(phases, partial(linear.handed, rate=faster), ones, most=steepest, steps=steps)
        if x is not None:
            x = _settled(
                phases, partial(_handed, flows, rate=rate), x, most=steepest, steps=FOLLOWED
            )
        claim = None if x is None else _claim(flows, x, rate, rho, error)
        if claim is not None:
            yield claim


def late_rate(loop: Loop) -> float:
    """About the largest rate (1/s) near the target; 0 where none is seen."""
    linear = _Linear.at_the_target(loop, loop.guarantee.phases)
    return 0.0 if linear is None else linear.estimate(loop.n)


def _ends(first: Fraction, last: Fraction) -> list[Fraction]:
    """Times at which a phase may end, as close as its weights are then compared."""
    return (
        [first] if first == last else [first + (last - first) * k / ENDS for k in range(ENDS + 1)]
    )


def _most(times: Array, v: Array, rate: float) -> Array:
    """exp(rate t) v(t) at most, for v (count, n), between two times with the larger v and the later
    one."""
    larger = np.vstack([v[:1], np.maximum(v[:-1], v[1:])])
    return np.asarray(np.max(np.exp(rate * times)[:, None] * larger, axis=0))


def _handed(flows: Sequence[_Flow], p: int, start: Array, rate: float) -> Array | None:
    """The largest weights, times exp(rate t), that phase p hands over when it begins with these."""
    way = flows[p].way(start, rate)
    if way is None:
        return None
    ends = [each for each in way if each[0] >= flows[p].phase.shortest]
    return _most(np.array([float(t) for t, _ in ends]), np.array([v for _, v in ends]), rate)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linear:
    """The same for the linearisation at the target: products of matrices, for phases of finite and
    of any length."""

    phases: Sequence[Phase]
    # of each phase: times (s) at which it may end, and the maps until then
    ways: Sequence[tuple[Array, Array]]

    @classmethod
    def at_the_target(cls, loop: Loop, phases: Sequence[Phase]) -> _Linear | None:
        found, m, K = dict[str, Array](), loop.m, pull_matrix(loop)
        for mode in {phase.mode for phase in phases}:
            jacobian = consensus_jacobian(loop, mode)
            if jacobian is None:
                return None
            found[mode] = np.asarray((jacobian - K).todense())[::m, ::m]
        return cls.along(phases, found)

    @classmethod
    def of(cls, phases: Sequence[Phase], rows: Mapping[str, _Turned]) -> _Linear:
        return cls.along(phases, {mode: each.matrix() for mode, each in rows.items()})

    @classmethod
    def along(cls, phases: Sequence[Phase], M: Mapping[str, Array]) -> _Linear:
        known: dict[tuple[str, Fraction, Fraction], tuple[Array, Array]] = {}
        ways = list[tuple[Array, Array]]()
        for phase in phases:
            last = phase.shortest * 2 if phase.longest is None else phase.longest
            key = phase.mode, phase.shortest, last
            if key not in known:
                known[key] = _maps(M[phase.mode], _ends(phase.shortest, last))
            ways.append(known[key])
        return cls(phases=phases, ways=ways)

    def handed(self, p: int, start: Array, rate: float) -> Array:
        """The largest weights, times exp(rate t), that phase p hands over when it begins with
        these."""
        times, maps = self.ways[p]
        return _most(times, maps @ start, rate)

    def estimate(self, n: int) -> float:
        """About the largest rate: how fast weights shrink that phases hand over, per second."""
        if _in_turn(self.phases):
            return self._of_one_round()
        mean = float(np.mean([times[-1] for times, _ in self.ways]))
        shrinking = list(self._spreading(n))
        late = shrinking[len(shrinking) // 2 :]
        return sum(late) / len(late) / mean if math.isfinite(sum(late)) else 0.0

    @np.errstate(all="ignore")  # a round may leave the floats
    def _of_one_round(self) -> float:
        """The same where each phase has one end: by the spectral radius of the map of a round."""
        whole, lost = np.eye(self.ways[0][1].shape[-1]), 0.0
        for _, maps in self.ways:
            spend(HANDED)
            whole = maps[-1] @ whole
            size = float(np.abs(whole).max())
            if not (size > 0 and math.isfinite(size)):
                return 0.0
            whole, lost = whole / size, lost - math.log(size)
        radius = float(np.abs(np.linalg.eigvals(whole)).max())
        length = sum(float(times[-1]) for times, _ in self.ways)
        return (lost - math.log(radius)) / length if radius > 0 else 0.0

    def _spreading(self, n: int) -> Iterator[float]:
        """How far weights shrink when every phase hands over at once, as a logarithm."""
        x = [np.ones(n) for _ in self.phases]
        for _ in range(ITERATIONS):
            spend(sum(_work(phase) for phase in self.phases))
            found = [np.zeros(n) for _ in self.phases]
            for p, phase in enumerate(self.phases):
                handed = self.handed(p, x[p], 0.0)
                for q in phase.successors:
                    found[q] = np.maximum(found[q], handed)
            size = max(float(each.max()) for each in found)
            yield -math.log(size) if size > 0 else math.inf
            x = [each / size for each in found] if size > 0 else x


def _work(phase: Phase) -> int:
    """Steps of work for what a phase hands over: with a dwell time to every other mode."""
    return HANDED + len(phase.successors) // SUCCESSORS


def _in_turn(phases: Sequence[Phase]) -> bool:
    """Whether it is said which phase follows which."""
    return all(phase.successors == ((p + 1) % len(phases),) for p, phase in enumerate(phases))


@np.errstate(all="ignore")
def _maps(M: Array, ends: Sequence[Fraction]) -> tuple[Array, Array]:
    """Times (s) at which a phase may end, and the maps exp(M t) until then."""
    spend(HANDED * len(ends))
    times = np.array([float(t) for t in ends])
    first, part = (expm(M * t) for t in (times[0], (times[-1] - times[0]) / ENDS))
    maps = accumulate([part] * (len(times) - 1), np.matmul, initial=first)
    return times, np.array(list(maps))


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
            if found is None or float(found.max()) > 0.95 * most:
                return None
            for q in phase.successors:
                settled = settled and bool(np.all(found <= x[q] * (1 + SETTLED)))
                x[q] = np.maximum(x[q], found)
        if settled:
            return x
    return None


@np.errstate(all="ignore")
def _claim(
    flows: Sequence[_Flow],
    x: Sequence[Array],
    rate: float,
    rho: Fraction | None,
    error: ErrorBound | None,
) -> Cycles | None:
    phases = []
    for flow, start in zip(flows, x, strict=True):
        way = flow.way(start, rate)
        if way is None:
            return None
        v = tuple(
            tuple(Fraction(f"{x * (1 + 1e-10):.11g}") for x in point.tolist()) for _, point in way
        )
        phases.append(Weights(times=tuple(t for t, _ in way), v=v))
    claimed = Fraction(f"{rate * ROOM:.6g}")
    if error is not None:
        least = min(x for each in phases for v in each.v for x in v)
        error = with_kappa(error, rate=claimed, least=least)
    return Cycles(phases=tuple(phases), rate=claimed, rho=rho, error=error)
