"""Many sampled runs under one stress side by side: ``sampled`` with the runs as a last axis.

All runs share the sampling instants and what fails when; each has its own start, switches, noise, losses and phases,
from the same streams of random numbers as a run by itself.  What agents hear is kept by arc, for all modes together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design.model.arrays import ArcGroup
from dobc_design.simulate.agents import LOSS, NOISE, PHASE
from dobc_design.simulate.air import Links
from dobc_design.simulate.field import Loop
from dobc_design.simulate.integrate import FARTHEST, Progress
from dobc_design.simulate.sampled import discretised, integral, sample_instants
from dobc_design.simulate.starts import Start
from dobc_design.simulate.stress import Failure, Stress
from dobc_design.simulate.switches import Array, IndexArray, Switches

Visit = Callable[[int, Array, Array], None]
BLOCK = 32  # instants whose random numbers are drawn at once


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledRuns:
    """Runs side by side: a start, a seed and the switches of each; ``failing`` by the agent's index.

    ``groups`` gives the arcs of a mode by its index; ``heeds``: whether estimates are used.
    """

    loop: Loop
    stress: Stress
    failing: dict[int, Failure]
    heeds: bool
    groups: Callable[[int], Sequence[ArcGroup]]
    starts: Sequence[Start]
    seeds: Sequence[int]
    switches: Sequence[Switches]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledEnds:
    """How many of the samples each run reached, (R,), and why it ended early, by run."""

    counts: IndexArray
    reasons: dict[int, str]


def run_sampled_stack(
    runs: SampledRuns, times: Array, *, visit: Visit, progress: Progress | None = None
) -> SampledEnds:
    """Step all runs from sample to sample over ``times`` (from 0 to the horizon).

    ``visit(sample, x, gap)`` gets x and d - dhat of all runs there, both (n, m, R), also of those that ended before.
    Raises: SpecError for too many samples.
    """
    return _Stepper(runs, times, visit, progress or (lambda part: None)).run()


class _Heard:
    """What listeners hold of speakers, for the arcs of all modes at once: ``values`` (arcs, m, R), nan for nothing."""

    def __init__(self, runs: SampledRuns, modes: IndexArray) -> None:
        loop, self.loss = runs.loop, runs.stress.loss
        self.links = {mode: Links(runs.groups(mode), loop.n, loop.m) for mode in np.unique(modes).tolist()}
        self.codes = np.unique(np.concatenate([links.codes for links in self.links.values()]))
        self.places = {mode: np.searchsorted(self.codes, links.codes) for mode, links in self.links.items()}
        self.values = np.full((len(self.codes), loop.m, len(runs.seeds)), np.nan)
        self.rngs = [np.random.default_rng([seed, LOSS]) for seed in runs.seeds]
        self.modes, self.mode = modes, np.full(len(runs.seeds), -1)
        self.drawn: Array = np.zeros((0, 0, 0))

    def draw(self, k: int) -> None:
        """One number for every arc and run at the next instants from the k-th on: (instants, arcs, R)."""
        sizes = np.array([len(self.places.get(mode, ())) for mode in range(int(self.modes.max()) + 1)])
        counts = sizes[self.modes[:, k : k + BLOCK]]
        self.drawn = np.empty((counts.shape[1], int(sizes.max()), len(counts)))
        for run, rng in enumerate(self.rngs):
            used = np.arange(self.drawn.shape[1]) < counts[run][:, None]
            self.drawn[used, run] = rng.random(int(counts[run].sum()))

    def exchange(self, k: int, said: Array, own: Array) -> Array:
        """At the k-th instant every speaker sends what it says; returns what listeners feel.  said, own (n, m, R)."""
        felt, modes = np.zeros_like(own), self.modes[:, k]
        if self.loss and k % BLOCK == 0:
            self.draw(k)
        for mode in np.unique(modes).tolist():
            columns, links, places = np.flatnonzero(modes == mode), self.links[mode], self.places[mode]
            every = slice(None) if len(columns) == len(modes) else columns
            changed = columns[self.mode[columns] != mode]
            if len(changed):  # nothing is kept of links that are gone
                gone = np.setdiff1d(np.arange(len(self.codes)), places)
                self.values[gone[:, None], :, changed] = np.nan
            sent = said[..., every][links.speakers]
            held = sent
            if self.loss:
                drawn = self.drawn[k % BLOCK][: len(places), every]
                arrived = (drawn >= self.loss) | np.isnan(sent).any(axis=1)  # who is silent for ever is noticed
                held = np.where(arrived[:, None], sent, self.values[places][..., every])
                self.values[places[:, None], :, columns] = np.moveaxis(held, 2, 1)
            felt[..., every] = links.felt(own[..., every], held)
        self.mode = modes
        return felt


class _Stepper:
    def __init__(self, runs: SampledRuns, times: Array, visit: Visit, report: Progress) -> None:
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
        self.noises = [np.random.default_rng([seed, NOISE]) for seed in runs.seeds]
        shape = (loop.n, loop.m)
        self.phase = np.stack(
            [np.random.default_rng([seed, PHASE]).uniform(0, 2 * np.pi, size=shape) for seed in runs.seeds], axis=2
        )
        self.heard = _Heard(runs, np.stack([each.at(self.instants) for each in runs.switches]))
        self.noise: Array = np.zeros((0, *self.x.shape))
        self.goal = loop.goal[..., None]
        self.before, self.held = self.x, np.zeros_like(self.x)
        self.farthest = FARTHEST * np.maximum(1.0, np.abs(self.x - self.goal).max(axis=(0, 1)))
        self.stopped: dict[int, tuple[Array | float, Array | float]] = {}
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
        measured = self.x
        if self.runs.stress.noise:
            if k % BLOCK == 0:
                many = (min(BLOCK, len(self.instants) - k), *self.x.shape[:2])
                self.noise = np.stack([rng.standard_normal(many) for rng in self.noises], axis=3)
            measured = self.x + self.runs.stress.noise * self.noise[k % BLOCK]
        if k:
            innovation = (measured - self.before) / self.period - self.held - self.discrete.Cd @ self.xihat
            self.xihat = self.discrete.Ad @ self.xihat + self.discrete.L @ innovation
        e, dhat = measured - self.goal, self.discrete.Cd @ self.xihat
        self.fail(instant, e, dhat)
        said = e
        if self.stopped:
            said = e.copy()
            for agent, (_, words) in self.stopped.items():
                said[agent] = words
        felt = self.heard.exchange(k, said, e)
        return measured, felt, self.control(e, dhat), dhat

    def control(self, e: Array, dhat: Array) -> Array:
        """The input that is applied, (19) and what the stress makes of it."""
        stress = self.runs.stress
        u = np.asarray(-(self.loop.K @ e.reshape(-1, e.shape[2])).reshape(e.shape))
        if self.runs.heeds:
            u = u - dhat
        if stress.saturation is not None:
            u = np.clip(u, -stress.saturation, stress.saturation)
        for agent, (last, _) in self.stopped.items():
            u[agent] = last
        return u

    def fail(self, instant: float, e: Array, dhat: Array) -> None:
        """Note what is left of the agents whose time has come, in all runs at once."""
        failing = self.runs.failing
        due = [i for i, failure in failing.items() if failure.time <= instant and i not in self.stopped]
        if due:
            u = self.control(e, dhat)
            for i in due:
                self.stopped[i] = (u[i].copy(), e[i].copy()) if failing[i].kind == "freeze" else (0.0, np.nan)

    def sample(
        self, instant: float, s: int, held: Array, dhat: Array, transition: Array, mean: Array
    ) -> tuple[Array, Array]:
        """x and d - dhat at the s-th sample."""
        time = float(self.times[s])
        x = self.x + (time - instant) * held + self.loop.C @ (mean @ self.xi)
        d = self.loop.C @ (transition @ self.xi)
        stress = self.runs.stress
        if stress.disturbance:
            x = x + self.extra_integral(instant, time)
            d = d + stress.disturbance * np.sin(stress.frequency * time + self.phase)
        return x, d - (dhat if self.runs.heeds else 0.0)

    def step(self, held: Array, measured: Array, until: float) -> None:
        """Go to the next instant."""
        self.before, self.held = measured, held
        x = self.x + self.period * (held + self.discrete.Cd @ self.xi)
        self.x = x + self.extra_integral(until - self.period, until) if self.runs.stress.disturbance else x
        self.xi = self.discrete.Ad @ self.xi

    def extra_integral(self, begin: float, end: float) -> Array:
        """What the unmodelled disturbance adds to x between two times, (n, m, R); as in ``agents``."""
        stress, half = self.runs.stress, (end - begin) / 2
        shrink = np.sinc(stress.frequency * half / np.pi)
        middle = np.sin(stress.frequency * (begin + half) + self.phase)
        return np.asarray(stress.disturbance * 2 * half * shrink * middle)

    def end(self, which: NDArray[np.bool_], count: int, reason: str) -> None:
        """Runs that end here keep their first ``count`` samples."""
        for run in np.flatnonzero(which).tolist():
            self.counts[run], self.reasons[run] = count, reason
        self.going = self.going & ~which
