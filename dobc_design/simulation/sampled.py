"""The loop with everything computed at the multiples of a period T and held between: solved
exactly, step by step.

At k T every agent computes v_k = couplings + input and holds it; between samples x' = v_k + d,
which is integrated in closed form.  The observer is the exact discretisation: with Ad = exp(A T)
and the mean output Cd = C (1/T) int_0^T exp(A s) ds, the measured mean (x_(k+1) - x_k)/T - v_k is
Cd xi_k exactly, and

    xihat_(k+1) = Ad xihat_k + L ((x_(k+1) - x_k)/T - v_k - Cd xihat_k),     dhat_k = Cd xihat_k.

So eps_(k+1) = (Ad - L Cd) eps_k, free of the network as (17) is, and the mean of d - dhat over a
period is Cd eps_k. L = int_0^T exp((A - W C) s) ds W, unless it is given.  Between samples d - dhat
keeps a ripple that shrinks with T.

Agents with linear [dynamics] move by x_(k+1) = Phi x_k + G v_k + N xi_k, exactly, G = R B, R =
int_0^T exp(A_x s) ds; with watch G = I the same holds of watch (x_(k+1) - Phi x_k) - v_k and Cd =
watch N.  What N xi_k does beside G Cd xi_k, a ripple of higher order in T, is not cancelled.  Phi x
+ G v is x + R (A_x x + B v): with f(x) in place of A_x x, A_x its slopes at the target, f(x) - A_x
x is held over a period, an error of order T^2.  That is the model of the observer; the agents
themselves are integrated between samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from dobc_design.errors import ShapeError, wrong
from dobc_design.problem.arrays import Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.columns import RightHandSide, Stretch
from dobc_design.simulation.field import Loop, act
from dobc_design.simulation.integrate import FARTHEST, Outcome, Progress, Run, Samples
from dobc_design.simulation.stressed import LEAST_STEPS, Crew, Loops, StressedRuns, sample_instants


def flow(loop: Loop, times: float | Array) -> Array:
    """What so much time (s) adds to x with v held: a matrix (..., m, m + q) of x' - d at its begin,
    and of xi."""
    m = loop.m
    block = np.zeros((2 * m + loop.q, 2 * m + loop.q))
    block[:m, m : 2 * m], block[:m, 2 * m :], block[2 * m :, 2 * m :] = np.eye(m), loop.C, loop.A
    block[:m, :m] = 0.0 if loop.plant is None else loop.plant.A
    return np.asarray(
        expm(block * np.asarray(times, dtype=np.float64)[..., None, None])[..., :m, m:]
    )


def flown(added: Array, x: Array, speed: Array, xi: Array) -> Array:
    """x (n, m, R) after that time."""
    return np.asarray(x + act(added, np.concatenate([speed, xi], axis=1)))


def discretised(loop: Loop, period: float, gain: Array | None = None) -> tuple[Array, Array, Array]:
    """watch (p, m), Cd (p, q) and L (q, p), or (n, q, p), for ``period`` in s.  Raises: ShapeError
    for a wrong gain."""
    added = flow(loop, period)
    B = np.eye(loop.m) if loop.plant is None else loop.plant.B
    if gain is None:
        gain = integral(loop.F, period)[1] @ loop.W @ B
    else:
        check_sampled_gain(gain.shape, q=loop.q, m=B.shape[1], grouped=loop.own is not None)
    left = np.linalg.pinv(B)
    watch = np.linalg.solve(left @ added[:, : loop.m] @ B, left)
    return watch, watch @ added[:, loop.m :], gain


def check_sampled_gain(shape: tuple[int, ...], *, q: int, m: int, grouped: bool) -> None:
    """Refuse a gain of another shape than (q, m), or one for agents with different exosystems.
    Raises: ShapeError."""
    if grouped:
        message = (
            "is one gain for all agents, and the groups of exosystem.groups have different ones."
        )
        raise wrong("sampled_gain", message, "Leave it out: the W of every group is discretised.")
    if shape != (q, m):
        message = f"must have shape ({q}, {m}), one row per exosystem state; got {shape}."
        raise wrong(
            "sampled_gain",
            message,
            "design_observer(problem, period=...).W has it.",
            kind=ShapeError,
        )


def integral(A: Array, times: float | Array) -> tuple[Array, Array]:
    """exp(A t) and its integral from 0 to t, (..., q, q) each (Van Loan 1978)."""
    q, t = len(A), np.asarray(times, dtype=np.float64)[..., None, None]
    block = np.zeros((2 * q, 2 * q))
    block[:q, :q], block[:q, q:] = A, np.eye(q)
    both = expm(block * t) if q else np.zeros((*np.shape(times), 0, 0))
    return both[..., :q, :q], both[..., :q, q:]


class Between(Loops):
    """The agents between two samples: couplings ``felt`` (n, m, R) and inputs ``u`` (n, p, R) are
    held, z is xihat."""

    felt: Array
    u: Array

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        chosen = self.alive[runs]
        felt, u = self.felt[..., chosen], self.u[..., chosen]

        def derivative(y: Array, force: Array) -> Array:
            x, xi, z = self.split(y)
            d = act(self.loop.output, xi) + (force.reshape(u.shape) if len(force) else 0.0)
            return self.joined(
                felt + self.loop.moved(u + d, x - self.goal), act(self.loop.A, xi), 0 * z
            )

        return derivative


def run_sampled_alone(runs: StressedRuns, progress: Progress | None) -> Outcome:
    """Step a stack of one run from sample to sample."""
    seen: list[Samples] = []
    stepper = Stepper(
        runs, lambda number, sample: seen.append(sample), progress or (lambda part: None)
    )
    counts, reasons = stepper.run()
    count, method = int(counts[0]), stepper.method
    parts = {name: np.stack([each[name][..., 0] for each in seen[:count]]) for name in seen[0]}
    times, evaluations = stepper.times[:count].copy(), len(stepper.instants)
    states, reason = np.zeros((count, 0)), reasons.get(0, "")
    return Run(
        times=times, states=states, reason=reason, method=method, evaluations=evaluations
    ), parts


class Stepper:
    """Steps all runs; ``visit`` gets the place of a time, and x, d, dhat, u (n, m, R), xi, xihat
    (n, q, R) by name."""

    def __init__(
        self, runs: StressedRuns, visit: Callable[[int, Samples], None], report: Progress
    ) -> None:
        self.loop, self.times, self.nearby = runs.setting.loop, runs.setting.times, runs.nearby
        self.visit, self.report = visit, report
        self.period = float(runs.stress.period or 0.0)
        self.instants = sample_instants(self.period, runs.setting.horizon)
        self.owner = np.searchsorted(self.instants, self.times, side="right") - 1
        gain = runs.stress.sampled_gain
        self.flow = flow(self.loop, self.period)
        own = None if gain is None else np.asarray(gain)
        self.watch, self.Cd, self.L = discretised(self.loop, self.period, own)
        self.Ad = integral(self.loop.A, self.period)[0]
        self.x, self.xi, self.xihat = (runs.stacked(part) for part in ("x", "xi", "xihat"))
        self.crew, self.tolerance = Crew(runs, self.instants, keep=False), runs.setting.tolerance
        self.method, self.between = f"exact steps of {self.period:g} s", None
        if self.loop.plant is not None and (self.loop.bend is not None or runs.stress.disturbance):
            self.method = f"DOP853 between samples, every {self.period:g} s"
            self.between = Between(runs, runs.setting.horizon, self.crew)
            self.steps = np.full(len(runs.seeds), self.period)
        self.goal = self.loop.goal[..., None]
        self.before, self.held = self.x, np.zeros_like(self.x)
        self.farthest = FARTHEST * np.maximum(1.0, self.size())
        self.counts = np.full(len(runs.seeds), len(self.times))
        self.reasons: dict[int, str] = {}
        self.going: NDArray[np.bool_] = np.ones(len(runs.seeds), dtype=bool)

    def size(self) -> Array:
        return np.asarray(np.abs(self.x - self.goal).max(axis=(0, 1)))

    def run(self) -> tuple[IndexArray, dict[int, str]]:
        """How many samples each run reached, (R,), and why some ended early.  Raises: SpecError for
        too many."""
        since = self.times - self.instants[self.owner]
        transition, added = integral(self.loop.A, since)[0], flow(self.loop, since)
        done = 0
        for k, instant in enumerate(self.instants.tolist()):
            measured, felt, u, dhat = self.compute(k, instant)
            last = int(np.searchsorted(self.owner, k, side="right"))
            times = [*self.times[done:last].tolist(), *self.instants[k + 1 : k + 2].tolist()]
            if self.between is None:
                path = self.exact(instant, times, [*added[done:last], self.flow], felt, u)
            else:
                path = iter(self.integrated(self.between, instant, np.array(times), felt, u))
            for s, x in zip(range(done, last), path, strict=False):
                time = float(self.times[s])
                bad = self.going & ~np.isfinite(x).all(axis=(0, 1))
                self.end(
                    bad,
                    max(1, done),
                    f"a coupling overflows or is undefined at t = {instant:.6g} s",
                )
                xi = act(transition[s], self.xi)
                d = act(self.loop.output, xi) + self.crew.extra(time)
                parts = {"x": self.x if s == 0 else x, "xi": xi, "d": d, "u": u}
                self.visit(s, parts | self.crew.heeded(self.xihat, dhat))
            done = last
            if k + 1 < len(self.instants):
                self.before, self.held = measured, felt + self.loop.moved(u, measured - self.goal)
                self.x, self.xi = next(path), act(self.Ad, self.xi)
                far = self.going & ~(self.size() <= self.farthest)
                self.end(
                    far,
                    done,
                    f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {times[-1]:.6g} s",
                )
            if not self.going.any():
                break
            if k % 64 == 0:
                self.report(instant / float(self.times[-1]))
        self.report(1.0)
        return self.counts, self.reasons

    def exact(
        self, begin: float, times: list[float], flows: list[Array], felt: Array, u: Array
    ) -> Iterator[Array]:
        """x (n, m, R) at times from ``begin`` on, in closed form, with couplings (n, m, R) and
        inputs held."""
        speed, x = felt + self.loop.moved(u, self.x - self.goal), self.x
        for time, added in zip(times, flows, strict=False):
            yield flown(added, x, speed, self.xi) + self.crew.extra_integral(begin, time)

    def integrated(
        self, loops: Between, begin: float, times: Array, felt: Array, u: Array
    ) -> Array:
        """The same (T, n, m, R), integrated; nan after a run has ended, and of those that had ended
        before."""
        loops.felt, loops.u, loops.alive = felt, u, np.flatnonzero(self.going)
        path = np.full((len(times), *self.x.shape), np.nan)
        path[times == begin] = self.x

        def visit(sample: IndexArray, run: IndexArray, y: Array) -> None:
            path[sample, :, :, loops.alive[run]] = np.moveaxis(loops.split(y)[0], 2, 0)

        if len(times) and times[-1] > begin:
            start, count = (
                loops.joined(self.x, self.xi, self.xihat)[:, loops.alive],
                (len(loops.alive), 1),
            )
            found = Stretch(
                loops,
                start,
                times,
                begin=begin,
                end=times[-1],
                farthest=self.farthest[loops.alive],
                switches=(np.zeros(count), np.zeros(count, dtype=np.int64)),
                steps=self.steps[loops.alive],
                most=LEAST_STEPS,
                tolerance=self.tolerance,
                visit=visit,
            ).run()
            self.steps[loops.alive] = found.steps
            for place, reason in found.reasons().items():
                which, kept = (
                    np.arange(len(self.going)) == loops.alive[place],
                    self.times <= found.times[place],
                )
                words = (
                    reason
                    or f"agents are too stiff for {LEAST_STEPS} steps to the sample after t = "
                    f"{begin:.6g} s"
                )
                self.end(which & self.going, int(np.count_nonzero(kept)), words)
        return path

    def compute(self, k: int, instant: float) -> tuple[Array, Array, Array, Array]:
        """Measured states, and what is held from this instant on: couplings, input, estimate."""
        crew = self.crew
        if self.nearby is not None:
            mode = self.nearby.look(instant, self.x[..., 0])
            crew.heard.move(mode, self.nearby.groups(mode), k)
        measured = self.x + crew.noise(k)
        if k:
            expected = flown(self.flow, self.before, self.held, np.zeros_like(self.xihat))
            innovation = act(self.watch, measured - expected) - act(self.Cd, self.xihat)
            self.xihat = act(self.Ad, self.xihat) + act(self.L, innovation)
        e, dhat = measured - self.goal, act(self.Cd, self.xihat)
        crew.fail(instant, e, dhat)
        felt = np.zeros_like(e)
        for links, columns, held in crew.heard.exchange(k, crew.said(e)):
            felt[..., columns] = links.felt(e[..., columns], held)
        return measured, felt, crew.control(e, dhat), dhat

    def end(self, which: NDArray[np.bool_], count: int, reason: str) -> None:
        """Runs that end here keep their first ``count`` samples."""
        for run in np.flatnonzero(which).tolist():
            self.counts[run], self.reasons[run] = count, reason
        self.going = self.going & ~which
