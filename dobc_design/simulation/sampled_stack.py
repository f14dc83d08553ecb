"""Many sampled runs under one stress side by side: ``sampled`` with the runs as a last axis.

All runs share the sampling instants; each has its own start, switches, noise, losses and phases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design.simulation.agents_stack import Crew, StressedRuns
from dobc_design.simulation.integrate import FARTHEST, Progress
from dobc_design.simulation.sampled import discretised, integral, sample_instants
from dobc_design.simulation.switches import Array, IndexArray

Visit = Callable[[int, Array, Array], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledEnds:
    """How many of the samples each run reached, (R,), and why it ended early, by run."""

    counts: IndexArray
    reasons: dict[int, str]


def run_sampled_stack(
    runs: StressedRuns, times: Array, *, visit: Visit, progress: Progress | None = None
) -> SampledEnds:
    """Step all runs from sample to sample over ``times`` (from 0 to the horizon).

    ``visit(sample, x, gap)`` gets x and d - dhat of all runs there, both (n, m, R), also of those that ended before.
    Raises: SpecError for too many samples.
    """
    return _Stepper(runs, times, visit, progress or (lambda part: None)).run()


class _Stepper:
    def __init__(self, runs: StressedRuns, times: Array, visit: Visit, report: Progress) -> None:
        self.runs, self.loop, self.times, self.visit, self.report = runs, runs.loop, times, visit, report
        stress, loop = runs.stress, runs.loop
        self.period = float(stress.period or 0.0)
        self.instants = sample_instants(self.period, float(times[-1]))
        self.owner = np.searchsorted(self.instants, times, side="right") - 1
        gain = None if stress.sampled_gain is None else np.asarray(stress.sampled_gain)
        self.discrete = discretised(loop, self.period, gain)
        self.x, self.xi, self.xihat = (
            np.stack([getattr(start, name) for start in runs.starts], axis=2) for name in ("x", "xi", "xihat")
        )
        self.crew = Crew(runs, self.instants, keep=False)
        self.goal = loop.goal[..., None]
        self.before, self.held = self.x, np.zeros_like(self.x)
        self.farthest = FARTHEST * np.maximum(1.0, np.abs(self.x - self.goal).max(axis=(0, 1)))
        self.counts = np.full(len(runs.seeds), len(times))
        self.reasons: dict[int, str] = {}
        self.going: NDArray[np.bool_] = np.ones(len(runs.seeds), dtype=bool)

    def run(self) -> SampledEnds:
        """From the first sample to the last."""
        transition, mean = integral(self.loop.A, self.times - self.instants[self.owner])
        done = 0
        for k, instant in enumerate(self.instants.tolist()):
            measured, felt, u, dhat = self.compute(k, instant)
            last = int(np.searchsorted(self.owner, k, side="right"))
            values = [self.sample(instant, s, felt + u, dhat, transition[s], mean[s]) for s in range(done, last)]
            wrong = self.going & ~np.all([np.isfinite(x).all(axis=(0, 1)) for x, _ in values], axis=0)
            self.end(wrong, max(1, done), f"a coupling overflows or is undefined at t = {instant:.6g} s")
            for s, (x, gap) in enumerate(values, start=done):
                self.visit(s, self.x if s == 0 else x, gap)
            done = last
            if k + 1 < len(self.instants):
                until = float(self.instants[k + 1])
                self.step(felt + u, measured, until)
                far = self.going & ~(np.abs(self.x - self.goal).max(axis=(0, 1)) <= self.farthest)
                self.end(far, done, f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {until:.6g} s")
            if not self.going.any():
                break
            if k % 64 == 0:
                self.report(instant / float(self.times[-1]))
        self.report(1.0)
        return SampledEnds(counts=self.counts, reasons=self.reasons)

    def compute(self, k: int, instant: float) -> tuple[Array, Array, Array, Array]:
        """Measured states, and what is held from this instant on: couplings, input, estimate."""
        crew, measured = self.crew, self.x
        if crew.stress.noise:
            measured = self.x + crew.noise(k)
        if k:
            innovation = (measured - self.before) / self.period - self.held - self.discrete.Cd @ self.xihat
            self.xihat = self.discrete.Ad @ self.xihat + self.discrete.L @ innovation
        e, dhat = measured - self.goal, self.discrete.Cd @ self.xihat
        crew.fail(instant, e, dhat)
        felt = np.zeros_like(e)
        for links, columns, held in crew.heard.exchange(k, crew.said(e)):
            felt[..., columns] = links.felt(e[..., columns], held)
        return measured, felt, crew.control(e, dhat), dhat

    def sample(
        self, instant: float, s: int, held: Array, dhat: Array, transition: Array, mean: Array
    ) -> tuple[Array, Array]:
        """x and d - dhat at the s-th sample."""
        time = float(self.times[s])
        x = self.x + (time - instant) * held + self.loop.C @ (mean @ self.xi)
        d = self.loop.C @ (transition @ self.xi)
        stress = self.runs.stress
        if stress.disturbance:
            x = x + self.crew.extra_integral(instant, time)
            d = d + stress.disturbance * np.sin(stress.frequency * time + self.crew.phase)
        return x, d - (dhat if self.runs.heeds else 0.0)

    def step(self, held: Array, measured: Array, until: float) -> None:
        """Go to the next instant."""
        self.before, self.held = measured, held
        x = self.x + self.period * (held + self.discrete.Cd @ self.xi)
        self.x = x + self.crew.extra_integral(until - self.period, until) if self.runs.stress.disturbance else x
        self.xi = self.discrete.Ad @ self.xi

    def end(self, which: NDArray[np.bool_], count: int, reason: str) -> None:
        """Runs that end here keep their first ``count`` samples."""
        for run in np.flatnonzero(which).tolist():
            self.counts[run], self.reasons[run] = count, reason
        self.going = self.going & ~which
