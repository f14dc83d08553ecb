"""What agents measure, say, hear and command under a stress, in all runs side by side.

The runs are the last axis, and one run is a stack of one.  Random numbers come from streams of each
run's own.  A packet holds the measured state less the formation offset and target; a listener that
got none feels nothing on that arc.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.random import Generator, default_rng

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array
from dobc_design.loop.arrays import ArcGroups, between_agents
from dobc_design.loop.timing import Timing
from dobc_design.problem.network import IndexArray

from .field import Active, Links, act
from .mobile import Nearby
from .setting import WITHOUT, Setting
from .sines import Band, Sines, drawn_sines
from .starts import Start
from .stress import Stress
from .switches import Switches
from .worst import Signs, Worst

NOISE, LOSS, PHASE, AGES = 2, 3, 4, 6  # streams beside that of the switches
BLOCK = 32  # instants whose random numbers are drawn at once
OLDEST = 1000  # instants that are remembered
STATED_LOSS = 0.5  # of packets, where only a number of them in a row is stated
ALL = slice(None)
Chosen = IndexArray | slice


@noun(eq=False)
class StressedRuns:
    """Runs side by side; ``nearby``, of a single run only: graphs follow from its states instead of
    ``switches``."""

    setting: Setting
    starts: Sequence[Start]
    seeds: Sequence[int]
    switches: Sequence[Switches]
    nearby: Nearby | None = None

    @property
    def stress(self) -> Stress:
        return self.setting.stress

    def groups(self, mode: int) -> ArcGroups:
        """The arcs of a mode by its index, without pins: they are no messages, and their part of
        the input saturates."""
        if self.nearby is not None:
            return self.nearby.groups(mode)
        # all runs have the same graphs
        groups = self.setting.groups_of(self.switches[0], mode)
        return between_agents(groups, self.setting.loop.n)

    def streams(self, number: int) -> list[Generator]:
        """One stream of random numbers of each run."""
        return [default_rng([seed, number]) for seed in self.seeds]

    def begin(self) -> tuple[Array, Array, Array]:
        """x, xi and xihat at first, (n, m or q, R); where outputs are measured z, and zhat less the
        goal."""
        x, xi, xihat = (self.stacked(part) for part in ("x", "xi", "xihat"))
        loop = self.setting.loop
        if loop.sensed is not None:
            x = act(loop.sensed.x, xi)
            xihat = xihat - act(loop.sensed.entry, loop.goal[..., None])
        return x, xi, xihat

    def stacked(self, part: str) -> Array:
        """x, xi, xihat or eps of all starts, (n, m or q, R)."""
        return np.stack([getattr(start, part) for start in self.starts], axis=2)


class Left(NamedTuple):
    """What an agent that failed still does in all runs: its input (p, R), and what it says (m,
    R)."""

    input: Array
    words: Array


class Agents:
    """The agents of all runs at the ``instants`` of their exchanges; errors e (n, m, R) are
    measured ones.  ``keep``: what is heard is held between the instants.  ``stopped``: the agents
    that have failed, by index."""

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        setting = runs.setting
        self.loop = setting.loop
        self.stress = runs.stress
        self.estimates = setting.observer != WITHOUT
        self.names = runs.switches[0].names
        self.failing = runs.stress.failing(setting.problem)  # by the agent's index
        self.stopped: dict[int, Left] = {}
        self.shape = (self.loop.n, self.loop.m)
        self.count = len(instants)
        self.heard = Heard(runs, instants, keep=keep)
        self.limit = _limit(runs)
        # random numbers of the noise, and of the disturbance
        self.noises = runs.streams(NOISE)
        self.drawn: Array = np.zeros((0, *self.shape, len(runs.seeds)))
        self.ports = (self.loop.n, len(self.loop.output), len(runs.seeds))
        self.forces = _forces(runs, self.ports[:2], estimates=self.estimates)

    def noise(self, k: int) -> Array:
        """The noise that holds from the k-th instant on, (n, m, R); instants come in order."""
        if not self.stress.noise:
            return np.zeros((*self.shape, len(self.noises)))
        # one run draws the same numbers alone and beside others
        if k % BLOCK == 0:
            size = (min(BLOCK, self.count - k), *self.shape)
            self.drawn = np.stack([rng.standard_normal(size) for rng in self.noises], axis=3)
            if self.stress.worst:
                self.drawn = np.sign(self.drawn)
        noise = np.asarray(self.stress.noise * self.drawn[k % BLOCK])
        sensed = self.loop.sensed
        if sensed is None:
            return noise
        # of states, where it shows in the outputs as it is drawn
        return act(np.asarray(np.linalg.pinv(sensed.H), dtype=float), noise[:, : len(sensed.H)])

    def pulled(self, e: Array, modes: IndexArray) -> Array:
        """The input of agents without an estimate, (n, p, R); ``modes`` (R,) are on, by index."""
        active = Active(self.names, modes)
        nothing = np.zeros((e.shape[2], *self.ports[:2]))
        return self.loop.control(e.transpose(2, 0, 1), nothing, active).transpose(1, 2, 0)

    def command(self, pulled: Array, dhat: Array) -> Array:
        """The input of agents that work: (19), limited."""
        u = pulled - dhat * self.estimates
        return u if self.limit is None else np.asarray(np.clip(u, -self.limit, self.limit))

    def control(self, pulled: Array, dhat: Array, chosen: Chosen = ALL) -> Array:
        """The input that is applied in all or the chosen runs."""
        u = self.command(pulled, dhat)
        for agent, left in self.stopped.items():
            u[agent] = left.input[:, chosen]
        return u

    def fail(self, instant: float, e: Array, dhat: Array, modes: IndexArray) -> None:
        """Note what is left of the agents whose time has come, in all runs at once."""
        due = []
        for agent, failure in self.failing.items():
            if failure.time <= instant and agent not in self.stopped:
                due.append(agent)
        if not due:
            return
        # what the agents that fail now command last
        u = self.control(self.pulled(e, modes), dhat)
        for agent in due:
            if self.failing[agent].kind == "freeze":
                self.stopped[agent] = Left(u[agent].copy(), e[agent].copy())
            else:
                self.stopped[agent] = Left(np.zeros_like(u[agent]), np.full_like(e[agent], np.nan))

    def said(self, e: Array, chosen: Chosen = ALL) -> Array:
        """What can be heard of the agents: measured errors, old ones of frozen agents, nan of
        vanished ones."""
        if not self.stopped:
            return e
        said = e.copy()
        for agent, left in self.stopped.items():
            said[agent] = left.words[:, chosen]
        return said

    def extra(self, times: float | Array, chosen: Chosen = ALL) -> Array:
        """The disturbance that no exosystem knows, (n, p, R); times (R,), or any number of them for
        a single run."""
        found = np.zeros_like(times + np.zeros(self.ports)[..., chosen])
        for force in self.forces:
            found = found + force.at(times, chosen)
        return found

    def extra_integral(self, begin: float, end: float) -> Array:
        """Its integral between two times, (n, m, R), or 0."""
        found: Array = np.zeros(1)
        for force in self.forces:
            found = found + force.integral(begin, end)
        return found

    def believed(self, estimate: Array) -> Array:
        """An estimate of xi or d as it is acted on: 0 where nothing is estimated."""
        return estimate if self.estimates else np.zeros_like(estimate)


def _forces(runs: StressedRuns, ports: tuple[int, int], *, estimates: bool) -> list[Sines | Signs]:
    """What acts beside the disturbance of the exosystem on every agent and input (n, p)."""
    stress = runs.stress
    if not stress.acts:
        return []
    streams = runs.streams(PHASE)
    forces: list[Sines | Signs] = []
    if stress.worst:
        worst = Worst(runs.setting.problem, runs.setting.loop, runs.seeds, observed=estimates)
        if stress.disturbance:
            forces.append(worst.signs(stress.disturbance, horizon=runs.setting.horizon))
        return [*forces, *(worst.sines(_felt(runs, band)) for band in stress.bands)]
    if stress.disturbance:
        # every agent and input has a phase of its own
        phases = [rng.uniform(0, 2 * np.pi, size=ports) for rng in streams]
        phase = np.stack(phases, axis=2)
        frequency = np.full_like(phase, stress.frequency)
        forces.append(Sines(size=stress.disturbance, frequency=frequency, phase=phase))
    return [*forces, *(drawn_sines(_felt(runs, band), streams, ports) for band in stress.bands)]


def _felt(runs: StressedRuns, band: tuple[float, float, float]) -> Band:
    """A band with the amplitude of every agent, (n, 1, 1): 0 of those without a disturbance."""
    low, high, amplitude = band
    problem = runs.setting.problem
    felt = {agent for group in problem.groups for agent in group.agents}
    own = [amplitude * (label in felt) for label in problem.network.labels]
    return low, high, np.array(own)[:, None, None]


def _limit(runs: StressedRuns) -> float | Array | None:
    """The bound of |u|: one for all agents, or (n, 1, 1), where inputs saturate or at the worst
    that of [actuators]."""
    common = runs.stress.saturation
    problem = runs.setting.problem
    table = problem.actuators
    if table is None or not (table.saturates or (runs.stress.worst and common is None)):
        return common
    # agents without a limit of their own are not limited
    limits = [table.limit_of(label) for label in problem.network.labels]
    found = np.array([np.inf if limit is None else float(limit) for limit in limits])
    if common is not None:
        found = np.minimum(found, common)
    return found[:, None, None]


class Heard:
    """What listeners hold on all arcs: ``values`` (arcs, m, R), nan for nothing; ``keep``: also
    between instants.  As late, rarely and wrongly as [readings] allows, by chance or at the worst:
    what moves an agent away from its goal most, and what holds it back least."""

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        loop = runs.setting.loop
        many = len(runs.seeds)
        self.runs = runs
        stress = runs.stress
        timing = runs.setting.exact.timing or Timing()
        if stress.period:  # commands of a sampled loop wait themselves
            timing = timing.at_once
        self.event = float(timing.event)
        self.worst = stress.worst
        oldest, own = _oldest(timing, stress.period, stress.exchanges)
        constant = Timing(delay=timing.ahead)
        self.least, _ = _oldest(constant, stress.period, stress.exchanges)
        self.loss = stress.loss
        self.lost = 0  # so many in a row at most; 0: any
        if self.worst:
            oldest += timing.lost
        elif timing.lost and not self.loss:
            self.lost = timing.lost
            self.loss = STATED_LOSS
        self.past: deque[Array] = deque(maxlen=oldest + 1)  # the newest last
        self.own_past: deque[Array] = deque(maxlen=own + 1)
        # whether an agent knows itself as it was at the last instant, or before
        self.holds_own = timing.period > 0 or own > 0
        self.ages = runs.streams(AGES)
        self.at_random: Array = np.zeros((3, loop.n, many))
        self.keep = keep
        self.codes = np.zeros(0, dtype=np.int64)
        self.values = np.zeros((0, loop.m, many))
        self.missed = np.zeros((0, many), dtype=np.int64)  # in a row
        self.links: dict[int, Links] = {}
        self.mode = np.full(many, -1)
        self.rngs = runs.streams(LOSS)
        self.drawn: Array = np.zeros((0, 0, 0))
        self.block = BLOCK
        self.modes: IndexArray = np.zeros((1, len(instants)), dtype=np.int64)
        if runs.nearby is not None:
            self.block = 1  # how many arcs there will be is not known before
            return
        used = np.unique(np.concatenate([each.modes for each in runs.switches])).tolist()
        small = np.min_scalar_type(used[-1])  # a number for every run and instant
        self.modes = np.array([each.at(instants) for each in runs.switches], dtype=small)
        self.learn(used)

    def learn(self, modes: Sequence[int]) -> None:
        """The graphs are those of the modes from now on; what is held on arcs that stay is kept."""
        n = self.runs.setting.loop.n
        links = {mode: Links(self.runs.groups(mode), n) for mode in modes}
        # arcs of all modes have one place each, so that what is held survives a switch
        codes = np.unique(np.concatenate([each.codes for each in links.values()]))
        values = np.full((len(codes), *self.values.shape[1:]), np.nan)
        stay = np.isin(self.codes, codes)
        values[np.isin(codes, self.codes)] = self.values[stay]
        self.codes = codes
        self.values = values
        self.missed = np.zeros((len(codes), values.shape[2]), dtype=np.int64)
        self.links = links
        self.places = {mode: np.searchsorted(codes, each.codes) for mode, each in links.items()}

    def move(self, mode: int, k: int) -> None:
        """The graph of a single run, known by its number, at the k-th instant or after the one
        before."""
        if mode not in self.links:
            self.learn([mode])
        self.modes[0, k : k + 1] = mode

    def draw(self, k: int) -> None:
        """One number for every arc and run at the next instants from the k-th on: (instants, arcs,
        R)."""
        modes: IndexArray = self.modes[:, k : k + self.block]
        # a run draws for the arcs that it has: its numbers do not depend on other runs
        counts = np.zeros_like(modes, dtype=np.int64)
        for mode, places in self.places.items():
            counts[modes == mode] = len(places)
        self.drawn = np.empty((counts.shape[1], int(counts.max()), len(counts)))
        arcs = np.arange(self.drawn.shape[1])
        for run, rng in enumerate(self.rngs):
            used = arcs < counts[run][:, None]
            self.drawn[used, run] = rng.random(int(counts[run].sum()))

    def exchange(self, k: int, said: Array) -> list[Exchanged]:
        """Every speaker sends what it says, (n, m, R), at the k-th instant."""
        modes = self.modes[:, k]
        if self.loss and k % self.block == 0:
            self.draw(k)
        self.tune(np.arange(len(modes)), modes)
        if self.event and self.past and not self.worst:
            # what is close to what was said last is not said
            moved = ~(np.abs(said - self.past[-1]) <= self.event * np.abs(said))
            said = np.where(moved, said, self.past[-1])
        self.past.append(said)
        if max(self.past.maxlen or 0, self.own_past.maxlen or 0) > 1:
            n = len(said)
            self.at_random = np.stack([rng.random((3, n)) for rng in self.ages], axis=2)
        return [self.exchange_in(mode, k) for mode in np.unique(modes).tolist()]

    def own(self, e: Array) -> Array:
        """What agents know of themselves from now on, of the errors e (n, m, R) of all instants."""
        if self.own_past.maxlen == 1:
            return e
        self.own_past.append(e)
        past = self.late(self.own_past)
        if self.worst:
            return np.asarray(np.where(e > 0, past.min(axis=0), past.max(axis=0)))
        return _taken(past, self.at_random[2], np.arange(len(e)))

    def late(self, past: Sequence[Array]) -> Array:
        """Of the past, the newest last, what may act now, (T, n, m, R)."""
        return np.stack(past)[: max(1, len(past) - self.least)]

    def said(self, links: Links) -> Array:
        """What arrives on the arcs, (arcs, m, R)."""
        speakers, listeners = links.speakers, links.listeners
        if self.past.maxlen == 1 and not self.event:
            return np.asarray(self.past[0][speakers])
        past = self.late(self.past)
        if self.worst:
            room = self.event * np.abs(past)
            high = (past + room).max(axis=0)[speakers]
            low = (past - room).min(axis=0)[speakers]
            return np.asarray(np.where(past[-1][listeners] > 0, high, low))
        # a number of every arc that does not depend on which arcs there are
        drawn = (self.at_random[0][listeners] + self.at_random[1][speakers]) % 1
        return _taken(past, drawn, speakers)

    def exchange_in(self, mode: int, k: int) -> Exchanged:
        """The same in the runs that are in one mode."""
        modes = self.modes[:, k]
        columns = np.flatnonzero(modes == mode)
        every = ALL if len(columns) == len(modes) else columns  # a slice is no copy
        links = self.links[mode]
        places = self.places[mode]
        held = self.said(links)[..., every]
        if self.loss:
            # drawn for a block of instants at once, which is faster
            drawn = self.drawn[k % self.block][: len(places), every]
            # who is silent for ever is noticed
            arrived = (drawn >= self.loss) | np.isnan(held).any(axis=1)
            kept = self.values[places][..., every]
            if self.lost:
                missed = self.missed[places][:, every]
                arrived |= (missed >= self.lost) | np.isnan(kept).any(axis=1)
                self.missed[places[:, None], columns] = np.where(arrived, 0, missed + 1)
            held = np.where(arrived[:, None], held, kept)
        if self.loss or self.keep:
            self.values[places[:, None], :, columns] = np.moveaxis(held, 2, 1)
        return Exchanged(links, every, held)

    def tune(self, runs: IndexArray, modes: IndexArray) -> None:
        """Some runs are in these modes now: nothing is kept of links that are gone."""
        for mode in np.unique(modes).tolist():
            columns = runs[modes == mode]
            changed = columns[self.mode[columns] != mode]
            if len(changed):
                # an arc that comes back later begins with nothing
                gone = np.setdiff1d(np.arange(len(self.codes)), self.places[mode])
                self.values[gone[:, None], :, changed] = np.nan
                self.mode[changed] = mode


def _oldest(timing: Timing, period: float | None, step: float | None) -> tuple[int, int]:
    """The largest ages of what is heard and of what an agent knows of itself, in instants."""
    if step is None:
        return 0, 0
    ages = (timing.delay, timing.own_delay)
    if timing.period or period is not None:
        tick = timing.period or Fraction(step)
        heard, own = (math.ceil(age / tick) for age in ages)
    else:
        # what is used up to the next instant is one older there
        heard, own = (max(0, math.floor(float(age) / step) - 1) for age in ages)
    return min(heard, OLDEST), min(own, OLDEST)


def _taken(past: Array, drawn: Array, agents: IndexArray) -> Array:
    """Of the past (T, n, m, R) what ``drawn`` (k, R), from 0 to 1, says of the agents (k,):
    (k, m, R)."""
    places = (drawn * len(past)).astype(np.int64)
    runs = np.arange(past.shape[3])
    return np.moveaxis(past[places, agents[:, None], :, runs], 2, 1)


class Exchanged(NamedTuple):
    """The arcs of a mode, the runs that are in it, and what is held there, (arcs, m, runs)."""

    links: Links
    runs: Chosen
    held: Array
