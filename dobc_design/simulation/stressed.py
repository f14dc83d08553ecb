"""The full loop under a stress in continuous time: runs side by side, the last axis, or one run as a stack of one.

The state is [x; xi; z] as in ``field``.  All runs wait for each other where noise is drawn, packets are exchanged or
agents fail; in between everything is smooth but for saturation, which the step size control deals with, and every run
has its own steps and switches.  Many runs go through ``columns``; one goes through ``integrate``, for which a loop may
be stiff, and graphs may follow from the states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dobc_design.simulation._arguments import Array
from dobc_design.simulation.agents import Crew, StressedRuns
from dobc_design.simulation.columns import (
    DONE,
    MOST_STEPS,
    Ends,
    RightHandSide,
    Stretch,
    farthest_of,
    integrate_stretch,
    padded,
)
from dobc_design.simulation.field import act, full_pattern
from dobc_design.simulation.integrate import Moving, Outcome, Progress, Scheduled, Segment, Stay, integrate
from dobc_design.simulation.sampled import sample_instants
from dobc_design.simulation.switches import IndexArray

LEAST_STEPS = 1000  # of one run between two instants at which all wait, before it is handed back
ALONE = np.zeros(1, dtype=np.int64)
Visit = Callable[[IndexArray, IndexArray, Array, Array], None]


class Loops:
    """The loops of all runs between two instants at which they wait: the columns of ``columns``.

    ``alive`` (k,): which of the runs still go; ``noise`` (n, m, R) holds since the last instant.
    """

    def __init__(self, runs: StressedRuns, horizon: float) -> None:
        draws = runs.stress.draws
        instants = np.zeros(0) if draws is None else sample_instants(draws, horizon, name="exchange")
        self.instants = instants[instants < horizon]
        self.failures = sorted({failure.time for failure in runs.failing.values() if failure.time < horizon})
        self.loop, self.crew = runs.loop, Crew(runs, self.instants, keep=True)
        self.goal, self.alive, self.next = runs.loop.goal[..., None], np.arange(len(runs.seeds)), 0
        self.noise = np.zeros_like(self.crew.phase)
        self.start = self.joined(
            x := runs.stacked("x"), runs.stacked("xi"), runs.stacked("xihat") - act(runs.loop.W, x)
        )

    def split(self, y: Array) -> tuple[Array, Array, Array]:
        """States (N, k) as x (n, m, k), xi and z (n, q, k)."""
        n, m, q, many = self.loop.n, self.loop.m, self.loop.q, y.shape[1]
        x, xi, z = y[: n * m], y[n * m : n * (m + q)], y[n * (m + q) :]
        return x.reshape(n, m, many), xi.reshape(n, q, many), z.reshape(n, q, many)

    def joined(self, *parts: Array) -> Array:
        """The other way."""
        return np.concatenate([part.reshape(-1, part.shape[2]) for part in parts])

    def known(self, x: Array, z: Array, noise: Array) -> tuple[Array, Array]:
        """What the agents know: measured errors and xihat."""
        measured = x + noise
        return measured - self.goal, z + act(self.loop.W, measured)

    def wait(self, time: float, y: Array, modes: IndexArray) -> None:
        """All runs have come to a time, in these modes (R,): draw, fail and exchange what is due."""
        crew, due = self.crew, self.next < len(self.instants) and self.instants[self.next] <= time
        if due:
            self.noise = crew.noise(self.next)
        x, _, z = self.split(y)
        e, xihat = self.known(x, z, self.noise)
        crew.fail(time, e, act(self.loop.C, xihat))
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
            felt = links.felt(e, arrived) + crew.control(e, act(loop.C, xihat), chosen)
            x_dot = felt + act(loop.C, xi)
            if len(force):
                x_dot += force.reshape(x_dot.shape)
            return self.joined(x_dot, act(loop.A, xi), act(loop.F, xihat) - act(loop.W, felt))

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """The disturbance that no exosystem knows, (S, n m, k); nothing without one."""
        if not self.crew.stress.disturbance:
            return np.zeros((len(times), 0, len(runs)))
        extra = self.crew.extra(times[:, None, None, :], self.alive[runs])
        return extra.reshape(len(times), -1, len(runs))

    def size(self, y: Array) -> Array:
        """|e|_inf, (k,)."""
        return np.asarray(np.abs(self.split(y)[0] - self.goal).max(axis=(0, 1)))

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept of links that are gone."""
        self.crew.heard.tune(self.alive[runs], modes)

    def gap(self, y: Array, times: Array, chosen: IndexArray) -> Array:
        """d - dhat of the chosen runs at these times, (n, m, k)."""
        x, xi, z = self.split(y)
        d = act(self.loop.C, xi) + (self.crew.extra(times, chosen) if self.crew.stress.disturbance else 0.0)
        if not self.crew.heeds:
            return np.asarray(d)
        return np.asarray(d - act(self.loop.C, self.known(x, z, self.noise[..., chosen])[1]))


def run_stressed(
    runs: StressedRuns, times: Array, *, tolerance: float, visit: Visit, progress: Progress | None = None
) -> Ends:
    """Integrate all runs over ``times`` (from 0 to the horizon).

    ``visit(sample, run, e, gap)`` gets the places of samples and runs, both (k,), and there e and d - dhat (n, m, k).
    Raises: SpecError for too many exchanges.
    """
    horizon, report = float(times[-1]), progress or (lambda part: None)
    loops, (switch_times, switch_modes) = Loops(runs, horizon), padded(runs.switches)
    y, everyone = loops.start, loops.alive
    farthest = farthest_of(loops.size(y))
    begins = np.unique([0.0, *loops.instants, *loops.failures])
    states, ended, steps = np.full(len(everyone), DONE), np.full(len(everyone), horizon), None
    place = np.zeros(len(everyone), dtype=np.int64)

    def seen(sample: IndexArray, run: IndexArray, state: Array) -> None:
        chosen = loops.alive[run]
        visit(sample, chosen, loops.split(state)[0] - loops.goal, loops.gap(state, times[sample], chosen))

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
        columns = np.minimum(place[:, None] + np.arange((upto - place).max() + 2), switch_times.shape[1] - 1)[alive]
        stretch = Stretch(
            columns=loops,
            begin=begin,
            end=end,
            e=y[:, alive],
            farthest=farthest[alive],
            switch_times=switch_times[alive[:, None], columns],
            switch_modes=switch_modes[alive[:, None], columns],
            steps=steps,
            most=max(LEAST_STEPS, MOST_STEPS // len(begins)),
        )
        found = integrate_stretch(stretch, times, tolerance=tolerance, visit=seen)
        y[:, alive], states[alive], ended[alive] = found.e, found.states, found.times
        going = found.states == DONE
        loops.alive, steps = alive[going], found.steps[going]
        report(end / horizon)
        if not going.any():
            break
    return Ends(states=states, times=ended, e=y, steps=np.zeros(len(states)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Alone:
    """A stack of one run as a plan of ``integrate``."""

    loops: Loops
    modes: Scheduled | Moving
    noises: list[Array]  # (n, m) each, in the order of the instants

    def segment(self, time: float, state: Array) -> Segment:
        """The stretch that begins here, up to the next switch, exchange or failure."""
        loops, heard = self.loops, self.loops.crew.heard
        stay = self.modes.stay(time, self.positions(state))
        if isinstance(self.modes, Moving):
            heard.move(stay.mode, self.modes.groups(stay.mode), loops.next)
        loops.wait(time, state[:, None], np.array([stay.mode]))
        if loops.next > len(self.noises):
            self.noises.append(loops.noise[..., 0])
        part = loops.part(stay.mode, ALONE)

        def derivative(time: float, state: Array) -> Array:
            return part(state[:, None], loops.forces(np.array([[time]]), ALONE)[0])[:, 0]

        end = min([stay.end, *loops.instants[loops.next : loops.next + 1], *(t for t in loops.failures if t > time)])
        links = heard.links[stay.mode]
        return Segment(
            derivative=derivative,
            pattern=lambda: full_pattern(loops.loop, links.groups),
            stay=Stay(mode=stay.mode, end=float(end), change=stay.change),
        )

    def positions(self, state: Array) -> Array:
        """x (n, m)."""
        return self.loops.loop.split(state)[0]

    def error(self, state: Array) -> float:
        """|e|_inf."""
        return float(self.loops.size(state[:, None])[0])


def run_alone(
    runs: StressedRuns,
    modes: Scheduled | Moving,
    times: Array,
    *,
    tolerance: float,
    implicit: bool,
    progress: Progress | None = None,
) -> Outcome:
    """Integrate a stack of one run, and put down what happened at ``times``."""
    loops, noise = Loops(runs, float(times[-1])), np.zeros(1)
    plan, crew = _Alone(loops=loops, modes=modes, noises=[]), loops.crew
    run = integrate(plan, loops.start[:, 0], times, tolerance=tolerance, implicit=implicit, progress=progress)
    x, xi, z = loops.split(run.states.T)  # samples in place of runs
    if runs.stress.noise:
        noise = np.stack(plan.noises, axis=2)[..., np.searchsorted(loops.instants, run.times, side="right") - 1]
    e, xihat = loops.known(x, z, noise)
    dhat = act(runs.loop.C, xihat)
    u = crew.command(e, dhat)
    for agent, (last, _) in crew.stopped.items():
        u[agent][:, run.times >= runs.failing[agent].time] = last
    d = act(runs.loop.C, xi) + (crew.extra(run.times) if runs.stress.disturbance else 0.0)
    parts = {"x": x, "xi": xi, "d": d, "u": u} | crew.heeded(xihat, dhat)
    return Outcome(
        times=run.times,
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=tuple(run.notes),
        **{name: np.moveaxis(array, 2, 0).copy() for name, array in parts.items()},
    )
