"""What the agents of many runs measure, say, hear and command under one stress: the runs are the last axis.

Random numbers come from streams of each run's own, so that noise, losses and phases do not depend on each other nor on
the other runs.  A packet holds the measured state less the formation offset and target; a listener that got none feels
nothing on that arc.  What is heard is kept by arc, for all modes together.  What fails, fails in all runs at one time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dobc_design.problem.arrays import ArcGroup
from dobc_design.simulation._arguments import Array
from dobc_design.simulation.field import Loop
from dobc_design.simulation.graph import Links
from dobc_design.simulation.setting import Start
from dobc_design.simulation.stress import Failure, Stress
from dobc_design.simulation.switches import IndexArray, Nearby, Switches

NOISE, LOSS, PHASE = 2, 3, 4  # streams beside that of the switches
BLOCK = 32  # instants whose random numbers are drawn at once


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressedRuns:
    """Runs side by side: a start, a seed and the switches of each; ``failing`` by the agent's index.

    ``groups`` gives the arcs of a mode by its index; ``heeds``: whether estimates are used.  ``nearby``, of a single
    run only: the graphs follow from its states, and nothing is known of the switches beforehand.
    """

    loop: Loop
    stress: Stress
    failing: dict[int, Failure]
    heeds: bool
    groups: Callable[[int], Sequence[ArcGroup]]
    starts: Sequence[Start]
    seeds: Sequence[int]
    switches: Sequence[Switches]
    nearby: Nearby | None = None

    def stacked(self, part: str) -> Array:
        """x, xi or xihat of all starts, (n, m or q, R)."""
        return np.stack([getattr(start, part) for start in self.starts], axis=2)


class Crew:
    """The agents of all runs.  Errors e are measured ones, (n, m, R): x plus noise, less the goal.

    ``instants`` are the times in s at which noise is drawn and packets are exchanged.  ``heard`` is what listeners
    hold; ``stopped`` what failed agents command and say from then on, (m, R) each, nan for silence.
    """

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        self.loop, self.stress, self.failing, self.heeds = runs.loop, runs.stress, runs.failing, runs.heeds
        self.shape, self.count = (runs.loop.n, runs.loop.m), len(instants)
        self.heard = Heard(runs, instants, keep=keep)
        self.noises = [np.random.default_rng([seed, NOISE]) for seed in runs.seeds]
        phases = [np.random.default_rng([seed, PHASE]).uniform(0, 2 * np.pi, size=self.shape) for seed in runs.seeds]
        self.phase = np.stack(phases, axis=2)
        self.drawn: Array = np.zeros((0, *self.phase.shape))
        self.stopped: dict[int, tuple[Array, Array]] = {}

    def noise(self, k: int) -> Array:
        """The noise that holds from the k-th instant on, (n, m, R); instants come in order."""
        if not self.stress.noise:
            return np.zeros_like(self.phase)
        if k % BLOCK == 0:
            size = (min(BLOCK, self.count - k), *self.shape)
            self.drawn = np.stack([rng.standard_normal(size) for rng in self.noises], axis=3)
        return np.asarray(self.stress.noise * self.drawn[k % BLOCK])

    def command(self, e: Array, dhat: Array) -> Array:
        """The input of agents that work: (19), limited."""
        u = np.asarray(-(self.loop.K @ e.reshape(-1, e.shape[2])).reshape(e.shape))
        if self.heeds:
            u = u - dhat
        bound = self.stress.saturation
        return u if bound is None else np.asarray(np.clip(u, -bound, bound))

    def control(self, e: Array, dhat: Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """The input that is applied in all or the chosen runs."""
        u = self.command(e, dhat)
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

    def extra(self, times: float | Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """The disturbance that no exosystem knows, (n, m, R); times (R,), or any number of them for a single run."""
        return np.asarray(self.stress.disturbance * np.sin(self.stress.frequency * times + self.phase[..., chosen]))

    def extra_integral(self, begin: float, end: float) -> Array:
        """Its integral between two times, (n, m, R)."""
        half = (end - begin) / 2
        # The mean value times the length: no cancellation where the frequency is small.
        shrink = np.sinc(self.stress.frequency * half / np.pi)
        middle = np.sin(self.stress.frequency * (begin + half) + self.phase)
        return np.asarray(self.stress.disturbance * 2 * half * shrink * middle)

    def heeded(self, xihat: Array, dhat: Array) -> dict[str, Array]:
        """The estimates by name; 0 where nobody uses them."""
        if not self.heeds:
            xihat, dhat = np.zeros_like(xihat), np.zeros_like(dhat)
        return {"xihat": xihat, "dhat": dhat}


class Heard:
    """What listeners hold of speakers, for the arcs of all modes at once: ``values`` (arcs, m, R), nan for nothing.

    ``keep``: whether it is needed between the instants, also where no packet is lost.
    """

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        loop, self.loss, self.keep, many = runs.loop, runs.stress.loss, keep, len(runs.seeds)
        self.n, self.m = loop.n, loop.m
        self.codes, self.values = np.zeros(0, dtype=np.int64), np.zeros((0, loop.m, many))
        self.rngs = [np.random.default_rng([seed, LOSS]) for seed in runs.seeds]
        self.mode = np.full(many, -1)
        self.drawn: Array = np.zeros((0, 0, 0))
        self.block = BLOCK if runs.nearby is None else 1
        if runs.nearby is None:
            used = np.unique(np.concatenate([each.modes for each in runs.switches])).tolist()
            self.modes: IndexArray = np.array(
                [each.at(instants) for each in runs.switches], dtype=np.min_scalar_type(used[-1])
            )
            self.learn({mode: Links(runs.groups(mode), loop.n, loop.m) for mode in used})
        else:
            self.modes, self.links = np.zeros((1, len(instants)), dtype=np.int64), dict[int, Links]()

    def learn(self, links: dict[int, Links]) -> None:
        """These are the arcs of the modes from now on; what is held on arcs that stay is kept."""
        codes = np.unique(np.concatenate([each.codes for each in links.values()]))
        values = np.full((len(codes), *self.values.shape[1:]), np.nan)
        values[np.isin(codes, self.codes)] = self.values[np.isin(self.codes, codes)]
        self.codes, self.values, self.links = codes, values, links
        self.places = {mode: np.searchsorted(codes, each.codes) for mode, each in links.items()}

    def move(self, mode: int, groups: Sequence[ArcGroup], k: int) -> None:
        """The graph of a single run, known by its number, at the k-th instant or after the one before."""
        if mode not in self.links:
            self.learn({mode: Links(groups, self.n, self.m)})
        self.modes[0, k : k + 1] = mode

    def draw(self, k: int) -> None:
        """One number for every arc and run at the next instants from the k-th on: (instants, arcs, R)."""
        modes: IndexArray = self.modes[:, k : k + self.block]
        counts = np.zeros_like(modes, dtype=np.int64)
        for mode, places in self.places.items():
            counts[modes == mode] = len(places)
        self.drawn = np.empty((counts.shape[1], int(counts.max()), len(counts)))
        for run, rng in enumerate(self.rngs):
            used = np.arange(self.drawn.shape[1]) < counts[run][:, None]
            self.drawn[used, run] = rng.random(int(counts[run].sum()))

    def exchange(self, k: int, said: Array) -> list[tuple[Links, IndexArray | slice, Array]]:
        """At the k-th instant every speaker sends what it says, (n, m, R); instants come in order.

        Returns: by mode the arcs, the runs, and what is held on these arcs in these runs, (arcs, m, runs).
        """
        modes, found = self.modes[:, k], []
        if self.loss and k % self.block == 0:
            self.draw(k)
        self.tune(np.arange(len(modes)), modes)
        for mode in np.unique(modes).tolist():
            columns, links, places = np.flatnonzero(modes == mode), self.links[mode], self.places[mode]
            every = slice(None) if len(columns) == len(modes) else columns
            held = said[..., every][links.speakers]
            if self.loss:
                drawn = self.drawn[k % self.block][: len(places), every]
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
