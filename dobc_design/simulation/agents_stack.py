"""What the agents of many runs measure, say, hear and command under one stress: ``agents`` and ``air`` with the runs
as a last axis.

Every run has its own streams of random numbers, the same as by itself.  What agents hear is kept by arc, for all modes
together.  What fails, fails in all runs at the same time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dobc_design.problem.arrays import ArcGroup
from dobc_design.simulation.agents import LOSS, NOISE, PHASE
from dobc_design.simulation.air import Links
from dobc_design.simulation.field import Loop
from dobc_design.simulation.starts import Start
from dobc_design.simulation.stress import Failure, Stress
from dobc_design.simulation.switches import Array, IndexArray, Switches

BLOCK = 32  # instants whose random numbers are drawn at once


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressedRuns:
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


class Crew:
    """The agents of all runs.  Errors e are measured ones, (n, m, R): x plus noise, less the goal.

    ``instants`` are the times in s at which noise is drawn and packets are exchanged.  ``heard`` is what listeners
    hold; ``stopped`` what failed agents command and say from then on, (m, R) each, nan for silence.
    """

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        self.loop, self.stress, self.failing, self.heeds = runs.loop, runs.stress, runs.failing, runs.heeds
        self.shape = (runs.loop.n, runs.loop.m)
        self.many, self.count = len(runs.seeds), len(instants)
        self.heard = Heard(runs, instants, keep=keep)
        self.noises = [np.random.default_rng([seed, NOISE]) for seed in runs.seeds]
        phases = [np.random.default_rng([seed, PHASE]).uniform(0, 2 * np.pi, size=self.shape) for seed in runs.seeds]
        self.phase = np.stack(phases, axis=2)
        self.drawn: Array = np.zeros((0, *self.shape, self.many))
        self.stopped: dict[int, tuple[Array, Array]] = {}

    def noise(self, k: int) -> Array:
        """The noise that holds from the k-th instant on; instants come in order."""
        if k % BLOCK == 0:
            size = (min(BLOCK, self.count - k), *self.shape)
            self.drawn = np.stack([rng.standard_normal(size) for rng in self.noises], axis=3)
        return np.asarray(self.stress.noise * self.drawn[k % BLOCK])

    def control(self, e: Array, dhat: Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """The input that is applied in all or the chosen runs, (19) and what the stress makes of it."""
        u = np.asarray(-(self.loop.K @ e.reshape(-1, e.shape[2])).reshape(e.shape))
        if self.heeds:
            u = u - dhat
        if self.stress.saturation is not None:
            u = np.clip(u, -self.stress.saturation, self.stress.saturation)
        for agent, (last, _) in self.stopped.items():
            u[agent] = last[:, chosen]
        return u

    def fail(self, instant: float, e: Array, dhat: Array) -> None:
        """Note what is left of the agents whose time has come, in all runs at once."""
        due = [i for i, failure in self.failing.items() if failure.time <= instant and i not in self.stopped]
        if due:
            u = self.control(e, dhat)
            for i in due:
                nothing = np.zeros_like(u[i])
                frozen = self.failing[i].kind == "freeze"
                self.stopped[i] = (u[i].copy(), e[i].copy()) if frozen else (nothing, nothing + np.nan)

    def said(self, e: Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """What can be heard of the agents: measured errors, old ones of frozen agents, nan of vanished ones."""
        if not self.stopped:
            return e
        said = e.copy()
        for agent, (_, words) in self.stopped.items():
            said[agent] = words[:, chosen]
        return said

    def extra_integral(self, begin: float, end: float) -> Array:
        """What the unmodelled disturbance adds to x between two times, (n, m, R); as in ``agents``."""
        half = (end - begin) / 2
        shrink = np.sinc(self.stress.frequency * half / np.pi)
        middle = np.sin(self.stress.frequency * (begin + half) + self.phase)
        return np.asarray(self.stress.disturbance * 2 * half * shrink * middle)


class Heard:
    """What listeners hold of speakers, for the arcs of all modes at once: ``values`` (arcs, m, R), nan for nothing.

    ``keep``: whether it is needed between the instants, also where no packet is lost.
    """

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        loop, self.loss, self.keep = runs.loop, runs.stress.loss, keep
        used = np.unique(np.concatenate([each.modes for each in runs.switches])).tolist()
        self.links = {mode: Links(runs.groups(mode), loop.n, loop.m) for mode in used}
        self.codes = np.unique(np.concatenate([links.codes for links in self.links.values()]))
        self.places = {mode: np.searchsorted(self.codes, links.codes) for mode, links in self.links.items()}
        self.values = np.full((len(self.codes), loop.m, len(runs.seeds)), np.nan)
        self.rngs = [np.random.default_rng([seed, LOSS]) for seed in runs.seeds]
        self.modes = np.empty((len(runs.seeds), len(instants)), dtype=np.min_scalar_type(used[-1]))
        for row, each in zip(self.modes, runs.switches, strict=True):
            row[:] = each.at(instants)
        self.mode = np.full(len(runs.seeds), -1)
        self.drawn: Array = np.zeros((0, 0, 0))

    def draw(self, k: int) -> None:
        """One number for every arc and run at the next instants from the k-th on: (instants, arcs, R)."""
        sizes = np.array([len(self.places.get(mode, ())) for mode in range(max(self.places) + 1)])
        counts = sizes[self.modes[:, k : k + BLOCK]]
        self.drawn = np.empty((counts.shape[1], int(sizes.max()), len(counts)))
        for run, rng in enumerate(self.rngs):
            used = np.arange(self.drawn.shape[1]) < counts[run][:, None]
            self.drawn[used, run] = rng.random(int(counts[run].sum()))

    def exchange(self, k: int, said: Array) -> list[tuple[Links, IndexArray | slice, Array]]:
        """At the k-th instant every speaker sends what it says, (n, m, R); instants come in order.

        Returns: by mode the arcs, the runs, and what is held on these arcs in these runs, (arcs, m, runs).
        """
        modes, found = self.modes[:, k], []
        if self.loss and k % BLOCK == 0:
            self.draw(k)
        self.tune(np.arange(len(modes)), modes)
        for mode in np.unique(modes).tolist():
            columns, links, places = np.flatnonzero(modes == mode), self.links[mode], self.places[mode]
            every = slice(None) if len(columns) == len(modes) else columns
            held = said[..., every][links.speakers]
            if self.loss:
                drawn = self.drawn[k % BLOCK][: len(places), every]
                arrived = (drawn >= self.loss) | np.isnan(held).any(axis=1)  # who is silent for ever is noticed
                held = np.where(arrived[:, None], held, self.values[places][..., every])
            if self.loss or self.keep:
                self.values[places[:, None], :, columns] = np.moveaxis(held, 2, 1)
            found.append((links, every, held))
        return found

    def tune(self, runs: IndexArray, modes: IndexArray) -> None:
        """Some runs are in these modes now: nothing is kept of links that are gone."""
        for mode in np.unique(modes).tolist():
            columns = runs[modes == mode]
            changed = columns[self.mode[columns] != mode]
            if len(changed):
                gone = np.setdiff1d(np.arange(len(self.codes)), self.places[mode])
                self.values[gone[:, None], :, changed] = np.nan
                self.mode[changed] = mode
