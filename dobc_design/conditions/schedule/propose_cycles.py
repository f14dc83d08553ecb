"""Proposals for weights that move under a guarantee: rates, weights at the beginning of each phase, and their way.

G(x): the largest weights, times exp(rate t), that a phase hands over when its predecessors begin with x and fall as
fast as their rows allow.  Where iterates of x = max (1, G(x)) settle, they serve.  Floating point; no proofs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from dobc_design.conditions.schedule.cycles import Cycles, Phase, Weights, phases_of, why_not
from dobc_design.conditions.schedule.rows import MovingRows, moving_rows
from dobc_design.conditions.separable.claim import ErrorBound
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.arrays import consensus_jacobian, pinning_matrix
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

STEEPEST: Final = 1e6  # weights at most, the least at a beginning 1
FAR: Final = 5.0  # and times rho, where couplings are not linear
SIZES: Final = (0.0, 0.5, 1.0)  # of rho, at which rows are looked at
ITERATIONS: Final = 400  # of x = max (1, G(x)), which are cheap where it is linear
FOLLOWED: Final = 6
SETTLED: Final = 1e-7
#: Parts of the estimated rate, and by how much weights fall more slowly than they might, as a part of their speed and
#: of that rate.
TRIED: Final = (
    (0.96, 0.005),
    (0.93, 0.01),
    (0.87, 0.02),
    (0.8, 0.03),
    (0.65, 0.05),
    (0.4, 0.1),
    (0.15, 0.2),
    (0.04, 0.3),
)
ROOM: Final = 0.998  # of a rate, that is claimed
EARLY: Final = 4.0  # times that, more at the beginning of a phase, where it bends
LONG: Final = 4.0  # times that bend, as short as a phase may be for that
STEPS: Final = 8  # of a phase at least
ENDS: Final = 24  # parts of the times at which it may end
MOST_STEPS: Final = 1000
TAILS: Final = 8  # times that a phase without an end is doubled until its rows hold with weights at rest
ACCURACY: Final = 1e-7
LOOKED_AT: Final = (0.0, 0.5, 1.0)  # parts of a segment


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Flow:
    """How the weights of a phase fall."""

    phase: Phase
    rows: MovingRows
    sizes: tuple[float, ...]
    slack: float
    pace: float  # 1/s, about the rate

    def slopes(self, v: Array, early: float = 0.0) -> Array:
        found = self.rows.pull(np.maximum(v, 0.0), self.sizes)
        return np.asarray(found + self.slack * (1 + EARLY * early) * (np.abs(found) + self.pace * v))

    def path(self, start: Array, end: float) -> Any:
        """Weights over [0, end] as a function of time."""
        options = {"method": "LSODA", "dense_output": True, "rtol": ACCURACY, "atol": ACCURACY * float(start.max())}
        fast = float(np.max(np.abs(self.slopes(start)) / start))
        early = max(0.0, 1 - LONG / (fast * end))
        return solve_ivp(lambda t, v: self.slopes(v, early * math.exp(-fast * t)), (0.0, end), start, **options).sol

    def end(self, start: Array, rate: float) -> float | None:
        """The last time (s) that is followed; None if a phase without one never keeps its weights."""
        if self.phase.longest is not None:
            return float(self.phase.longest)
        for k in range(TAILS):
            end = float(self.phase.shortest) * 2**k
            v = self.path(start, end)(end)
            if np.all(self.slopes(v) <= -rate * v):
                return float(end)
        return None


@np.errstate(all="ignore")
def propose(problem: Problem, W: Matrix | None, *, rho: Fraction | None, error: ErrorBound | None) -> Iterator[Cycles]:
    """Claims that are proved for weights whose least at the beginning of phases is 1, the fastest first."""
    phases, reach = phases_of(problem), Fraction(1) if rho is None else rho
    steepest = STEEPEST if rho is None else max(FAR, FAR / float(rho))
    rows = {phase.mode: moving_rows(problem, reach * Fraction(steepest), [phase.mode]) for phase in phases}
    known = {mode: found for mode, found in rows.items() if found is not None}
    if len(known) < len(rows):
        return
    sizes = (1.0,) if rho is None else tuple(part * float(rho) for part in SIZES)
    linear, top = _Linear.of(problem, phases), late_rate(problem)
    if linear is None or not top > 0:
        return
    for part, slack in TRIED:
        most = top if error is None else min(top, float(error.beta))
        rate, faster = part * most, (1 + part) / 2 * most
        flows = [_Flow(phase=phase, rows=known[phase.mode], sizes=sizes, slack=slack, pace=top) for phase in phases]
        ones = [np.ones(problem.n) for _ in phases]
        x = _settled(partial(linear.step, rate=faster), ones, most=steepest, steps=10 * ITERATIONS)
        x = None if x is None else _settled(partial(_step, flows, rate=rate), x, most=steepest, steps=FOLLOWED)
        claim = None if x is None else _claim(flows, x, rate, rho, error)
        if claim is not None and why_not(problem, W, claim) is None:
            yield claim
            return


def late_rate(problem: Problem) -> float:
    """About the largest rate (1/s) near the target; 0 where none is seen."""
    linear = _Linear.of(problem, phases_of(problem))
    return 0.0 if linear is None else linear.estimate(problem.n)


def _handed(flow: _Flow, start: Array, rate: float) -> Array | None:
    """The largest exp(rate t) v(t) over the times at which the phase may end."""
    if (end := flow.end(start, rate)) is None:
        return None
    path = flow.path(start, end)
    return _most([(t, path(t)) for t in _ends(float(flow.phase.shortest), end)], rate)


def _ends(first: float, last: float) -> list[float]:
    """Times at which a phase may end, as close as its weights are then compared."""
    return [first] if first == last else [float(t) for t in np.linspace(first, last, ENDS + 1)]


def _most(way: Sequence[tuple[float, Array]], rate: float) -> Array:
    """exp(rate t) v(t) at most, between two times with the larger v and the later one."""
    later = [math.exp(rate * b) * np.maximum(v, w) for (_, v), (b, w) in pairwise(way)]
    return np.asarray(np.max([math.exp(rate * way[0][0]) * way[0][1], *later], axis=0))


def _step(flows: Sequence[_Flow], x: Sequence[Array], rate: float) -> list[Array] | None:
    """G(x)."""
    found = [np.zeros_like(each) for each in x]
    for flow, start in zip(flows, x, strict=True):
        handed = _handed(flow, start, rate)
        if handed is None:
            return None
        for q in flow.phase.successors:
            found[q] = np.maximum(found[q], handed)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linear:
    """The same for the linearisation at the target: products of matrices, for phases of finite and of any length."""

    phases: Sequence[Phase]
    ways: Sequence[Sequence[tuple[float, Array]]]  # of each phase: times at which it may end, and the map until then

    @classmethod
    def of(cls, problem: Problem, phases: Sequence[Phase]) -> _Linear | None:
        ways, m = list[list[tuple[float, Array]]](), problem.m
        for phase in phases:
            jacobian = consensus_jacobian(problem, phase.mode)
            if jacobian is None:
                return None
            M = np.asarray((jacobian - pinning_matrix(problem)).todense())[::m, ::m]
            first = float(phase.shortest)
            last = first * 2 if phase.longest is None else float(phase.longest)
            ways.append([(t, expm(M * t)) for t in _ends(first, last)])
        return cls(phases=phases, ways=ways)

    def step(self, x: Sequence[Array], rate: float) -> list[Array]:
        """G(x)."""
        found = [np.zeros_like(each) for each in x]
        for phase, way, start in zip(self.phases, self.ways, x, strict=True):
            handed = _most([(t, each @ start) for t, each in way], rate)
            for q in phase.successors:
                found[q] = np.maximum(found[q], handed)
        return found

    def estimate(self, n: int) -> float:
        """About the largest rate: how fast G shrinks at rate 0, per second."""
        x, shrinking = [np.ones(n) for _ in self.phases], list[float]()
        for _ in range(ITERATIONS):
            found = self.step(x, 0.0)
            size = max(float(each.max()) for each in found)
            if not size > 0:
                return 0.0
            shrinking.append(-math.log(size))
            x = [each / size for each in found]
        mean = sum(way[-1][0] for way in self.ways) / len(self.ways)
        return sum(shrinking[ITERATIONS // 2 :]) / (ITERATIONS - ITERATIONS // 2) / mean


def _settled(step: Any, x: list[Array], *, most: float, steps: int) -> list[Array] | None:
    """x >= max (1, G(x)), from a smaller one; None if it grows too far."""
    for _ in range(steps):
        found = step(x)
        if found is None or max(float(each.max()) for each in found) > 0.95 * most:
            return None
        if all(np.all(new <= old * (1 + SETTLED)) for new, old in zip(found, x, strict=True)):
            return x
        x = [np.maximum(old, new) for old, new in zip(x, found, strict=True)]
    return None


def _claim(
    flows: Sequence[_Flow], x: Sequence[Array], rate: float, rho: Fraction | None, error: ErrorBound | None
) -> Cycles | None:
    phases = []
    for flow, start in zip(flows, x, strict=True):
        end = flow.end(start, rate)
        times = None if end is None else _times(flow, path := flow.path(start, end), end)
        if times is None:
            return None
        exact = [Fraction(f"{t:.9g}") for t in times]
        fixed = {float(each): each for each in (flow.phase.shortest, flow.phase.longest) if each is not None}
        exact = [fixed.get(t, each) for t, each in zip(times, exact, strict=True)]
        v = tuple(tuple(Fraction(f"{x * (1 + 1e-8):.9g}") for x in path(t).tolist()) for t in times)
        phases.append(Weights(times=tuple(exact), v=v))
    claimed = Fraction(f"{rate * ROOM:.6g}")
    if error is not None:
        least = min(x for each in phases for v in each.v for x in v)
        kappa = Fraction(math.ceil(10**6 / ((error.beta - claimed) * least)), 10**6)
        error = ErrorBound(P=error.P, beta=error.beta, kappa=kappa, size=error.size)
    return Cycles(phases=tuple(phases), rate=claimed, rho=rho, error=error)


def _times(flow: _Flow, path: Any, end: float) -> list[float] | None:
    """Times at which the chords of the path keep the rows, as far as is seen; the shortest time of the phase is one."""
    times, nodes = [0.0], _ends(float(flow.phase.shortest), end)
    step = end / STEPS
    while times[-1] < end:
        now = times[-1]
        until = next(t for t in nodes if t > now)
        step = min(2 * step, end / STEPS)
        while not _fits(flow, path, now, min(now + step, until)):
            step /= 2
            if step < end / MOST_STEPS**2:
                return None
        after = min(now + step, until)
        times.append(until if until - after < 1e-6 * end else after)  # no piece of rounding size is left over
        if len(times) > MOST_STEPS:
            return None
    return times


def _fits(flow: _Flow, path: Any, start: float, end: float) -> bool:
    before, after = path(start), path(end)
    slope = (after - before) / (end - start)
    chord = (before + part * (after - before) for part in LOOKED_AT)
    return all(np.all(flow.rows.pull(v, flow.sizes) <= slope + ACCURACY * np.abs(slope)) for v in chord)
