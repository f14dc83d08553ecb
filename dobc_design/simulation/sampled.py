"""The loop with everything computed at the multiples of a period T and held between: solved exactly, step by step.

At k T every agent computes v_k = couplings + input and holds it; between samples x' = v_k + d, which is integrated in
closed form.  The observer is the exact discretisation: with Ad = exp(A T) and the mean output
Cd = C (1/T) int_0^T exp(A s) ds, the measured mean (x_(k+1) - x_k)/T - v_k is Cd xi_k exactly, and

    xihat_(k+1) = Ad xihat_k + L ((x_(k+1) - x_k)/T - v_k - Cd xihat_k),     dhat_k = Cd xihat_k.

So eps_(k+1) = (Ad - L Cd) eps_k, free of the network as (17) is, and the mean of d - dhat over a period is Cd eps_k.
L = int_0^T exp((A - W C) s) ds W, unless it is given.  Between samples d - dhat keeps a ripple that shrinks with T.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from dobc_design.errors import ShapeError, wrong
from dobc_design.problem.arrays import Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.field import Loop, act
from dobc_design.simulation.integrate import FARTHEST, Outcome, Progress, Run, Samples
from dobc_design.simulation.stressed import Crew, StressedRuns, sample_instants


def discretised(loop: Loop, period: float, gain: Array | None = None) -> tuple[Array, Array, Array]:
    """Ad (q, q), Cd (m, q) and L (q, m), or (n, q, m), for ``period`` in s.  Raises: ShapeError for a wrong gain,
    SpecError for agents with [dynamics]."""
    if loop.plant is not None:
        what = "is not known for agents with [dynamics]: between samples they move by A, too."
        raise wrong(
            "stress.period", what, "Leave the period out; `exchange` gives the time between exchanges of states."
        )
    if gain is None:
        gain = integral(loop.F, period)[1] @ loop.W
    else:
        check_sampled_gain(gain.shape, q=loop.q, m=loop.m, grouped=loop.own is not None)
    transition, total = integral(loop.A, period)
    return transition, loop.C @ (total / period), gain


def check_sampled_gain(shape: tuple[int, ...], *, q: int, m: int, grouped: bool) -> None:
    """Refuse a gain of another shape than (q, m), or one for agents with different exosystems.  Raises: ShapeError."""
    if grouped:
        message = "is one gain for all agents, and the groups of exosystem.groups have different ones."
        raise wrong("sampled_gain", message, "Leave it out: the W of every group is discretised.")
    if shape != (q, m):
        message = f"must have shape ({q}, {m}), one row per exosystem state; got {shape}."
        raise wrong("sampled_gain", message, "design_observer(problem, period=...).W has it.", kind=ShapeError)


def integral(A: Array, times: float | Array) -> tuple[Array, Array]:
    """exp(A t) and its integral from 0 to t, (..., q, q) each (Van Loan 1978)."""
    q, t = len(A), np.asarray(times, dtype=np.float64)[..., None, None]
    block = np.zeros((2 * q, 2 * q))
    block[:q, :q], block[:q, q:] = A, np.eye(q)
    both = expm(block * t) if q else np.zeros((*np.shape(times), 0, 0))
    return both[..., :q, :q], both[..., :q, q:]


def run_sampled_alone(runs: StressedRuns, progress: Progress | None) -> Outcome:
    """Step a stack of one run from sample to sample."""
    seen: list[Samples] = []
    stepper = Stepper(runs, lambda number, sample: seen.append(sample), progress or (lambda part: None))
    counts, reasons = stepper.run()
    count, method = int(counts[0]), f"exact steps of {stepper.period:g} s"
    parts = {name: np.stack([each[name][..., 0] for each in seen[:count]]) for name in seen[0]}
    times, evaluations = stepper.times[:count].copy(), len(stepper.instants)
    states, reason = np.zeros((count, 0)), reasons.get(0, "")
    return Run(times=times, states=states, reason=reason, method=method, evaluations=evaluations), parts


class Stepper:
    """Steps all runs; ``visit`` gets the place of a time, and x, d, dhat, u (n, m, R), xi, xihat (n, q, R) by name."""

    def __init__(self, runs: StressedRuns, visit: Callable[[int, Samples], None], report: Progress) -> None:
        self.loop, self.times, self.nearby = runs.setting.loop, runs.setting.times, runs.nearby
        self.visit, self.report = visit, report
        self.period = float(runs.stress.period or 0.0)
        self.instants = sample_instants(self.period, runs.setting.horizon)
        self.owner = np.searchsorted(self.instants, self.times, side="right") - 1
        gain = runs.stress.sampled_gain
        self.Ad, self.Cd, self.L = discretised(self.loop, self.period, None if gain is None else np.asarray(gain))
        self.x, self.xi, self.xihat = (runs.stacked(part) for part in ("x", "xi", "xihat"))
        self.crew = Crew(runs, self.instants, keep=False)
        self.goal = self.loop.goal[..., None]
        self.before, self.held = self.x, np.zeros_like(self.x)
        self.farthest = FARTHEST * np.maximum(1.0, self.size())
        self.counts = np.full(len(runs.seeds), len(self.times))
        self.reasons: dict[int, str] = {}
        self.going: NDArray[np.bool_] = np.ones(len(runs.seeds), dtype=bool)

    def size(self) -> Array:
        return np.asarray(np.abs(self.x - self.goal).max(axis=(0, 1)))

    def run(self) -> tuple[IndexArray, dict[int, str]]:
        """How many samples each run reached, (R,), and why some ended early.  Raises: SpecError for too many."""
        transition, mean = integral(self.loop.A, self.times - self.instants[self.owner])
        done = 0
        for k, instant in enumerate(self.instants.tolist()):
            measured, felt, u, dhat = self.compute(k, instant)
            held, last = felt + u, int(np.searchsorted(self.owner, k, side="right"))
            for s in range(done, last):
                time = float(self.times[s])
                drift = act(self.loop.C, act(mean[s], self.xi))
                x = self.x + (time - instant) * held + drift + self.crew.extra_integral(instant, time)
                bad = self.going & ~np.isfinite(x).all(axis=(0, 1))
                self.end(bad, max(1, done), f"a coupling overflows or is undefined at t = {instant:.6g} s")
                xi, x = act(transition[s], self.xi), self.x if s == 0 else x
                d = act(self.loop.C, xi) + self.crew.extra(time)
                self.visit(s, {"x": x, "xi": xi, "d": d, "u": u} | self.crew.heeded(self.xihat, dhat))
            done = last
            if k + 1 < len(self.instants):
                until = float(self.instants[k + 1])
                self.before, self.held = measured, held
                drift = self.period * (held + act(self.Cd, self.xi))
                self.x = self.x + drift + self.crew.extra_integral(until - self.period, until)
                self.xi = act(self.Ad, self.xi)
                far = self.going & ~(self.size() <= self.farthest)
                self.end(far, done, f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {until:.6g} s")
            if not self.going.any():
                break
            if k % 64 == 0:
                self.report(instant / float(self.times[-1]))
        self.report(1.0)
        return self.counts, self.reasons

    def compute(self, k: int, instant: float) -> tuple[Array, Array, Array, Array]:
        """Measured states, and what is held from this instant on: couplings, input, estimate."""
        crew = self.crew
        if self.nearby is not None:
            mode = self.nearby.look(instant, self.x[..., 0])
            crew.heard.move(mode, self.nearby.groups(mode), k)
        measured = self.x + crew.noise(k)
        if k:
            innovation = (measured - self.before) / self.period - self.held - act(self.Cd, self.xihat)
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
