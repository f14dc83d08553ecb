"""Runs under a stress, side by side: what agents measure, say, hear and command, and the full loop
in continuous time.

The runs are the last axis, and one run is a stack of one.  Random numbers come from streams of each
run's own.  A packet holds the measured state less the formation offset and target; a listener that
got none feels nothing on that arc.  All runs wait for each other where noise is drawn, packets are
exchanged or agents fail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.problem.arrays import ArcGroup, Array
from dobc_design.problem.network import IndexArray
from dobc_design.simulation.columns import DONE, MOST_STEPS, Ends, RightHandSide, Stretch, padded
from dobc_design.simulation.field import Links, act, full_pattern
from dobc_design.simulation.integrate import FARTHEST, Integration, Outcome, Piece, Plan, Progress
from dobc_design.simulation.setting import Setting, Start, Stress, is_stiff
from dobc_design.simulation.switches import Modes, Nearby, Switches
from dobc_design.simulation.worst import worst_signs

NOISE, LOSS, PHASE = 2, 3, 4  # streams beside that of the switches
BLOCK = 32  # instants whose random numbers are drawn at once
MOST_SAMPLES = 1_000_000
LEAST_STEPS = 1000  # of one run between two instants at which all wait, before it is handed back
ALONE = np.zeros(1, dtype=np.int64)
Visit = Callable[[IndexArray, IndexArray, Array, Array], None]


def sample_instants(period: float, horizon: float, *, name: str = "period") -> Array:
    """The multiples of ``period``, the argument ``name``, up to the horizon, in s.  Raises:
    SpecError for too many."""
    count, what = horizon / period, "samples" if name == "period" else "exchanges"
    if count > MOST_SAMPLES:
        message = f"{count:.3g} {what} are too many, at most {MOST_SAMPLES} are simulated."
        raise SpecError(message, key=name, cure=f"Choose a longer {name} or a shorter horizon.")
    instants = period * np.arange(int(count) + 2)
    return np.asarray(instants[instants <= horizon], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressedRuns:
    """Runs side by side; ``nearby``, of a single run only: graphs follow from its states instead of
    ``switches``."""

    setting: Setting
    groups: Callable[[int], Sequence[ArcGroup]]
    starts: Sequence[Start]
    seeds: Sequence[int]
    switches: Sequence[Switches] = ()
    nearby: Nearby | None = None

    @property
    def stress(self) -> Stress:
        return self.setting.stress or Stress()

    def stacked(self, part: str) -> Array:
        """x, xi or xihat of all starts, (n, m or q, R)."""
        return np.stack([getattr(start, part) for start in self.starts], axis=2)


class Crew:
    """The agents of all runs; errors e (n, m, R) are measured ones; ``stopped``: what failed ones
    command and say."""

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        self.loop, self.stress, self.heeds = (
            runs.setting.loop,
            runs.stress,
            runs.setting.observer != "off",
        )
        self.failing = runs.stress.failing(runs.setting.problem)  # by the agent's index
        self.shape, self.count = (self.loop.n, self.loop.m), len(instants)
        ports = (self.loop.n, len(self.loop.output))
        self.heard = Heard(runs, instants, keep=keep)
        self.noises = [np.random.default_rng([seed, NOISE]) for seed in runs.seeds]
        phases = [
            np.random.default_rng([seed, PHASE]).uniform(0, 2 * np.pi, size=ports)
            for seed in runs.seeds
        ]
        self.phase = np.stack(phases, axis=2)
        self.drawn: Array = np.zeros((0, *self.shape, len(runs.seeds)))
        problem, horizon = runs.setting.problem, runs.setting.horizon
        self.signs = None
        if runs.stress.worst:
            self.signs = worst_signs(
                problem, self.loop, horizon=horizon, seeds=runs.seeds, observed=self.heeds
            )
        self.limit: float | Array | None = runs.stress.saturation
        if runs.stress.worst and problem.actuators is not None and self.limit is None:
            limits = [problem.actuators.limit_of(label) for label in problem.network.labels]
            self.limit = np.array([np.inf if x is None else float(x) for x in limits])[
                :, None, None
            ]
        self.stopped: dict[int, tuple[Array, Array]] = {}

    def noise(self, k: int) -> Array:
        """The noise that holds from the k-th instant on, (n, m, R); instants come in order."""
        if not self.stress.noise:
            return np.zeros((*self.shape, len(self.noises)))
        if k % BLOCK == 0:
            size = (min(BLOCK, self.count - k), *self.shape)
            self.drawn = np.stack([rng.standard_normal(size) for rng in self.noises], axis=3)
            self.drawn = np.sign(self.drawn) if self.stress.worst else self.drawn
        return np.asarray(self.stress.noise * self.drawn[k % BLOCK])

    def command(self, e: Array, dhat: Array) -> Array:
        """The input of agents that work: (19), limited."""
        u = np.moveaxis(
            self.loop.control(np.moveaxis(e, 2, 0), np.moveaxis(dhat * self.heeds, 2, 0)), 0, 2
        )
        return u if self.limit is None else np.asarray(np.clip(u, -self.limit, self.limit))

    def control(self, e: Array, dhat: Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """The input that is applied in all or the chosen runs."""
        u = self.command(e, dhat)
        for agent, (last, _) in self.stopped.items():
            u[agent] = last[:, chosen]
        return u

    def fail(self, instant: float, e: Array, dhat: Array) -> None:
        """Note what is left of the agents whose time has come, in all runs at once."""
        due = [
            i
            for i, failure in self.failing.items()
            if failure.time <= instant and i not in self.stopped
        ]
        if due:
            u = self.control(e, dhat)
            for i in due:
                nothing = np.zeros_like(u[i])
                frozen = self.failing[i].kind == "freeze"
                self.stopped[i] = (
                    (u[i].copy(), e[i].copy()) if frozen else (nothing, nothing + np.nan)
                )

    def said(self, e: Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """What can be heard of the agents: measured errors, old ones of frozen agents, nan of
        vanished ones."""
        if not self.stopped:
            return e
        said = e.copy()
        for agent, (_, words) in self.stopped.items():
            said[agent] = words[:, chosen]
        return said

    def extra(self, times: float | Array, chosen: IndexArray | slice = slice(None)) -> Array:
        """The disturbance that no exosystem knows, (n, p, R); times (R,), or any number of them for
        a single run."""
        if not self.stress.disturbance:
            return np.zeros_like(times + self.phase[..., chosen])
        if self.signs is not None:
            return self.stress.disturbance * self.signs.at(
                times, np.arange(self.phase.shape[2])[chosen]
            )
        return np.asarray(
            self.stress.disturbance
            * np.sin(self.stress.frequency * times + self.phase[..., chosen])
        )

    def extra_integral(self, begin: float, end: float) -> Array:
        """Its integral between two times, (n, m, R), or 0."""
        if not self.stress.disturbance:
            return np.zeros(1)
        if self.signs is not None:
            return self.stress.disturbance * self.signs.integral(begin, end)
        half = (end - begin) / 2
        # The mean value times the length: no cancellation where the frequency is small.
        shrink = np.sinc(self.stress.frequency * half / np.pi)
        middle = np.sin(self.stress.frequency * (begin + half) + self.phase)
        return np.asarray(self.stress.disturbance * 2 * half * shrink * middle)

    def heeded(self, xihat: Array, dhat: Array) -> dict[str, Array]:
        if not self.heeds:
            xihat, dhat = np.zeros_like(xihat), np.zeros_like(dhat)
        return {"xihat": xihat, "dhat": dhat}


class Heard:
    """What listeners hold on all arcs: ``values`` (arcs, m, R), nan for nothing; ``keep``: also
    between instants."""

    def __init__(self, runs: StressedRuns, instants: Array, *, keep: bool) -> None:
        loop, self.loss, self.keep, many = (
            runs.setting.loop,
            runs.stress.loss,
            keep,
            len(runs.seeds),
        )
        self.n, self.m = loop.n, loop.m
        self.codes, self.values = np.zeros(0, dtype=np.int64), np.zeros((0, loop.m, many))
        self.rngs = [np.random.default_rng([seed, LOSS]) for seed in runs.seeds]
        self.mode = np.full(many, -1)
        self.drawn: Array = np.zeros((0, 0, 0))
        self.block = BLOCK if runs.nearby is None else 1
        if runs.nearby is None:
            used = np.unique(np.concatenate([each.modes for each in runs.switches])).tolist()
            kind = np.min_scalar_type(used[-1])
            self.modes: IndexArray = np.array(
                [each.at(instants) for each in runs.switches], dtype=kind
            )
            self.learn({mode: Links(runs.groups(mode), loop.n, loop.m) for mode in used})
        else:
            self.modes, self.links = (
                np.zeros((1, len(instants)), dtype=np.int64),
                dict[int, Links](),
            )

    def learn(self, links: dict[int, Links]) -> None:
        """These are the arcs of the modes from now on; what is held on arcs that stay is kept."""
        codes = np.unique(np.concatenate([each.codes for each in links.values()]))
        values = np.full((len(codes), *self.values.shape[1:]), np.nan)
        values[np.isin(codes, self.codes)] = self.values[np.isin(self.codes, codes)]
        self.codes, self.values, self.links = codes, values, links
        self.places = {mode: np.searchsorted(codes, each.codes) for mode, each in links.items()}

    def move(self, mode: int, groups: Sequence[ArcGroup], k: int) -> None:
        """The graph of a single run, known by its number, at the k-th instant or after the one
        before."""
        if mode not in self.links:
            self.learn({mode: Links(groups, self.n, self.m)})
        self.modes[0, k : k + 1] = mode

    def draw(self, k: int) -> None:
        """One number for every arc and run at the next instants from the k-th on: (instants, arcs,
        R)."""
        modes: IndexArray = self.modes[:, k : k + self.block]
        counts = np.zeros_like(modes, dtype=np.int64)
        for mode, places in self.places.items():
            counts[modes == mode] = len(places)
        self.drawn = np.empty((counts.shape[1], int(counts.max()), len(counts)))
        for run, rng in enumerate(self.rngs):
            used = np.arange(self.drawn.shape[1]) < counts[run][:, None]
            self.drawn[used, run] = rng.random(int(counts[run].sum()))

    def exchange(self, k: int, said: Array) -> list[tuple[Links, IndexArray | slice, Array]]:
        """Every speaker sends what it says, (n, m, R); by mode arcs, runs, and what is held there,
        (arcs, m, runs)."""
        modes, found = self.modes[:, k], []
        if self.loss and k % self.block == 0:
            self.draw(k)
        self.tune(np.arange(len(modes)), modes)
        for mode in np.unique(modes).tolist():
            columns, links, places = (
                np.flatnonzero(modes == mode),
                self.links[mode],
                self.places[mode],
            )
            every = slice(None) if len(columns) == len(modes) else columns
            held = said[..., every][links.speakers]
            if self.loss:
                drawn = self.drawn[k % self.block][: len(places), every]
                # who is silent for ever is noticed
                arrived = (drawn >= self.loss) | np.isnan(held).any(axis=1)
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


class Loops:
    """The columns between instants at which all wait: the runs ``alive`` (k,), ``noise`` (n, m, R)
    since the last."""

    def __init__(self, runs: StressedRuns, horizon: float, crew: Crew | None = None) -> None:
        draws, self.loop = runs.stress.draws, runs.setting.loop
        instants = (
            np.zeros(0) if draws is None else sample_instants(draws, horizon, name="exchange")
        )
        self.instants = instants[instants < horizon]
        self.failures = sorted(
            {failure.time for failure in runs.stress.failures if failure.time < horizon}
        )
        self.crew = crew or Crew(runs, self.instants, keep=True)
        self.goal, self.alive, self.next = self.loop.goal[..., None], np.arange(len(runs.seeds)), 0
        self.noise = np.zeros((*self.crew.shape, len(runs.seeds)))
        x, xi, xihat = (runs.stacked(part) for part in ("x", "xi", "xihat"))
        self.start = self.joined(x, xi, xihat - act(self.loop.W, x))

    def split(self, y: Array) -> tuple[Array, Array, Array]:
        """States (N, k) as x (n, m, k), xi and z (n, q, k)."""
        n, m, q, many = self.loop.n, self.loop.m, self.loop.q, y.shape[1]
        x, xi, z = y[: n * m], y[n * m : n * (m + q)], y[n * (m + q) :]
        return x.reshape(n, m, many), xi.reshape(n, q, many), z.reshape(n, q, many)

    def joined(self, *parts: Array) -> Array:
        return np.concatenate([part.reshape(-1, part.shape[2]) for part in parts])

    def known(self, x: Array, z: Array, noise: Array) -> tuple[Array, Array]:
        """What the agents know: measured errors and xihat."""
        measured = x + noise
        return measured - self.goal, z + act(self.loop.W, measured)

    def wait(self, time: float, y: Array, modes: IndexArray) -> None:
        """All runs have come to a time, in these modes (R,): draw, fail and exchange what is
        due."""
        crew, due = self.crew, self.next < len(self.instants) and self.instants[self.next] <= time
        if due:
            self.noise = crew.noise(self.next)
        x, _, z = self.split(y)
        e, xihat = self.known(x, z, self.noise)
        crew.fail(time, e, act(self.loop.output, xihat))
        if crew.stress.exchanges is not None:
            if due:
                crew.heard.exchange(self.next, crew.said(e))
            else:
                crew.heard.tune(np.arange(len(modes)), modes)
        self.next += due

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        """The derivative of runs, named by their places among the living, in one mode."""
        crew, loop, chosen, heard = self.crew, self.loop, self.alive[runs], None
        links, noise = crew.heard.links[mode], self.noise.take(chosen, axis=2)
        if crew.stress.exchanges is not None:
            heard = crew.heard.values[crew.heard.places[mode]].take(chosen, axis=2)

        def derivative(y: Array, force: Array) -> Array:
            x, xi, z = self.split(y)
            e, xihat = self.known(x, z, noise)
            arrived = crew.said(e, chosen)[links.speakers] if heard is None else heard
            felt, u = links.felt(e, arrived), crew.control(e, act(loop.output, xihat), chosen)
            d = act(loop.output, xi)
            if len(force):
                d = d + force.reshape(d.shape)
            x_dot = felt + loop.moved(u + d, x - self.goal)
            seen = felt + loop.moved(u, e)
            return self.joined(x_dot, act(loop.A, xi), act(loop.F, xihat) - act(loop.W, seen))

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """The disturbance that no exosystem knows, (S, n p, k); nothing without one."""
        if not self.crew.stress.disturbance:
            return np.zeros((len(times), 0, len(runs)))
        return self.crew.extra(times[:, None, None, :], self.alive[runs]).reshape(
            len(times), -1, len(runs)
        )

    def size(self, y: Array) -> Array:
        return np.asarray(np.abs(self.split(y)[0] - self.goal).max(axis=(0, 1)))

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        self.crew.heard.tune(self.alive[runs], modes)

    def gap(self, y: Array, times: Array, chosen: IndexArray) -> Array:
        """d - dhat of the chosen runs at these times, (n, p, k)."""
        x, xi, z = self.split(y)
        C, xihat = self.loop.output, self.known(x, z, self.noise[..., chosen])[1]
        d = act(C, xi) + self.crew.extra(times, chosen)
        return np.asarray(d - act(C, xihat)) if self.crew.heeds else d


def run_stressed(runs: StressedRuns, *, visit: Visit, progress: Progress) -> Ends:
    """Integrate all runs; ``visit`` gets places of samples and runs (k,), e (n, m, k) and d - dhat
    (n, p, k)."""
    times, horizon = runs.setting.times, runs.setting.horizon
    loops, (switch_times, switch_modes) = Loops(runs, horizon), padded(runs.switches)
    y, everyone = loops.start, loops.alive
    farthest = FARTHEST * np.maximum(1.0, loops.size(y))
    begins = np.unique([0.0, *loops.instants, *loops.failures])
    states, ended, steps = np.full(len(everyone), DONE), np.full(len(everyone), horizon), None
    place = np.zeros(len(everyone), dtype=np.int64)

    def seen(sample: IndexArray, run: IndexArray, state: Array) -> None:
        chosen = loops.alive[run]
        visit(
            sample,
            chosen,
            loops.split(state)[0] - loops.goal,
            loops.gap(state, times[sample], chosen),
        )

    for begin, end in pairwise([*begins.tolist(), horizon]):
        while (passed := switch_times[everyone, place + 1] <= begin).any():
            place = place + passed
        loops.wait(begin, y, switch_modes[everyone, place])
        alive = loops.alive
        for sample in np.flatnonzero(times == begin):  # with the noise that holds from now on
            seen(np.full(len(alive), sample), np.arange(len(alive)), y[:, alive])
        upto = place
        while (more := switch_times[everyone, upto + 1] < end).any():
            upto = upto + more
        columns = np.minimum(
            place[:, None] + np.arange((upto - place).max() + 2), switch_times.shape[1] - 1
        )[alive]
        stretch = Stretch(
            loops,
            y[:, alive],
            times,
            begin=begin,
            end=end,
            farthest=farthest[alive],
            switches=(switch_times[alive[:, None], columns], switch_modes[alive[:, None], columns]),
            steps=steps,
            most=max(LEAST_STEPS, MOST_STEPS // len(begins)),
            tolerance=runs.setting.tolerance,
            visit=seen,
        )
        found = stretch.run()
        y[:, alive], states[alive], ended[alive] = found.e, found.states, found.times
        going = found.states == DONE
        loops.alive, steps = alive[going], found.steps[going]
        progress(end / horizon)
        if not going.any():
            break
    return Ends(states=states, times=ended, e=y, steps=np.zeros(len(states)))


def run_alone(runs: StressedRuns, modes: Modes, progress: Progress | None) -> Outcome:
    """Integrate a stack of one run, and put down what happened at the times of its setting."""
    # (n, m) each, in the order of the instants
    setting, noise, noises = runs.setting, np.zeros(1), list[Array]()
    loops = Loops(runs, setting.horizon)
    crew, implicit = loops.crew, is_stiff(setting, closed=False)

    def positions(state: Array) -> Array:
        return loops.loop.split(state)[0]

    def segment(time: float, state: Array) -> Piece:
        """Up to the next switch, exchange or failure."""
        stay = modes.stay(time, positions(state))
        if isinstance(modes, Nearby):
            crew.heard.move(stay.mode, modes.groups(stay.mode), loops.next)
        loops.wait(time, state[:, None], np.array([stay.mode]))
        if loops.next > len(noises):
            noises.append(loops.noise[..., 0])
        part, links = loops.part(stay.mode, ALONE), crew.heard.links[stay.mode]

        def derivative(time: float, state: Array) -> Array:
            return part(state[:, None], loops.forces(np.array([[time]]), ALONE)[0])[:, 0]

        end = min(
            [
                stay.end,
                *loops.instants[loops.next : loops.next + 1],
                *(t for t in loops.failures if t > time),
            ]
        )
        return (
            derivative,
            lambda: full_pattern(loops.loop, links.groups),
            stay._replace(end=float(end)),
        )

    plan = Plan(loops.loop.goal, positions, segment)
    start, tolerance = loops.start[:, 0], setting.tolerance
    run = Integration(
        plan, start, setting.times, tolerance=tolerance, implicit=implicit, progress=progress
    ).run()
    x, xi, z = loops.split(run.states.T)  # samples in place of runs
    if runs.stress.noise:
        noise = np.stack(noises, axis=2)[
            ..., np.searchsorted(loops.instants, run.times, side="right") - 1
        ]
    e, xihat = loops.known(x, z, noise)
    dhat = act(loops.loop.output, xihat)
    u = crew.command(e, dhat)
    for agent, (last, _) in crew.stopped.items():
        u[agent][:, run.times >= crew.failing[agent].time] = last
    d = act(loops.loop.output, xi) + crew.extra(run.times)
    parts = {"x": x, "xi": xi, "d": d, "u": u} | crew.heeded(xihat, dhat)
    return run, {name: np.moveaxis(array, 2, 0).copy() for name, array in parts.items()}
