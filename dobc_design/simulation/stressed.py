"""Runs under a stress in continuous time, side by side or one alone: the full loop as printed.

All runs wait for each other where noise is drawn, packets are exchanged or agents fail; in between
they are columns of one array.  What agents do: ``agents.py``; sampled loops: ``sampled.py``.
"""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from dobc_design.errors import refused
from dobc_design.exact.matrix import Array
from dobc_design.problem.network import IndexArray

from .agents import Agents, StressedRuns
from .columns import DONE, MOST_STEPS, Ends, March, RightHandSide
from .field import act, full_pattern, largest
from .integrate import FARTHEST, Integration, Outcome, Piece, Plan, Progress, Samples
from .mobile import Modes
from .outputs import moved, with_disturbances
from .switches import ModeTable, table_of

MOST_SAMPLES = 1_000_000
LEAST_STEPS = 1000  # of one run between two instants at which all wait, before it is handed back
ALONE = np.zeros(1, dtype=np.int64)
Visit = Callable[[IndexArray, IndexArray, Array, Array], None]


def sample_instants(period: float, horizon: float, *, name: str = "period") -> Array:
    """The multiples of ``period``, the argument ``name``, up to the horizon, in s.  Raises:
    SpecError for too many."""
    count = horizon / period
    if count > MOST_SAMPLES:
        what = "samples" if name == "period" else "exchanges"
        message = f"{count:.3g} {what} are too many, at most {MOST_SAMPLES} are simulated."
        raise refused(name, message, f"Choose a longer {name} or a shorter horizon.")
    instants = period * np.arange(int(count) + 2)
    return np.asarray(instants[instants <= horizon], dtype=np.float64)


class StressedColumns:
    """The full loop of runs as columns: x (n, m, R), xi (n, q, R) and z = xihat - W x, one below
    the other.  Their derivative is that between two instants at which all wait: ``noise`` (n, m, R)
    since the last of them, ``next`` the number of the next; ``alive`` (k,): the runs under way."""

    def __init__(self, runs: StressedRuns, agents: Agents | None = None) -> None:
        self.loop = with_disturbances(runs.setting.loop)
        horizon = runs.setting.horizon
        draws = runs.stress.draws
        # without exchanges and noise nobody waits
        instants = np.zeros(0)
        if draws is not None:
            instants = sample_instants(draws, horizon, name="exchange")
        self.instants = instants[instants < horizon]
        times = {failure.time for failure in runs.stress.failures}
        self.failures = sorted(time for time in times if time < horizon)
        timing = runs.setting.exact.timing
        #: What acts is so late (s), and ``left`` is what then remains of an error of the estimate.
        self.ahead = 0.0 if timing is None else float(timing.ahead)
        left = expm(self.loop.A * self.ahead) @ expm(-self.loop.F * self.ahead)
        self.left = self.loop.output @ left
        self.acts = not self.ahead
        self.agents = agents or Agents(runs, self.instants, keep=True)
        self.goal = self.loop.goal[..., None]
        self.alive = np.arange(len(runs.seeds))
        self.next = 0
        self.noise = np.zeros((*self.agents.shape, len(runs.seeds)))
        self.own: Array = self.noise  # errors as agents know them, where these are held
        x, xi, z = runs.begin()
        if self.loop.sensed is None:
            # xihat jumps whenever noise is drawn anew; z does not
            z = z - act(self.loop.W, x)
        self.start = self.joined(x, xi, z)

    def joined(self, *parts: Array) -> Array:
        """States (N, k) of x (n, m, k), xi and z (n, q, k), which ``loop.split`` undoes."""
        return np.concatenate([part.reshape(-1, part.shape[2]) for part in parts])

    def known(self, x: Array, z: Array, noise: Array) -> tuple[Array, Array]:
        """What the agents know: measured errors and xihat."""
        measured = x + noise
        sensed = self.loop.sensed
        if sensed is None:
            return measured - self.goal, z + act(self.loop.W, measured)
        return act(sensed.x, z) if sensed.estimated else measured - self.goal, z

    def dhat(self, xi: Array, xihat: Array) -> Array:
        """The estimate of d that acts: that of ``ahead`` s ago, predicted.  As eps' = F eps, the
        one of now says what it was."""
        C = self.loop.output
        return act(C, xi) - act(self.left, xi - xihat) if self.ahead else act(C, xihat)

    def wait(self, time: float, y: Array, modes: IndexArray) -> None:
        """All runs have come to a time, in these modes (R,): draw, fail and exchange what is
        due."""
        agents = self.agents
        due = self.next < len(self.instants) and self.instants[self.next] <= time
        if due:
            self.noise = agents.noise(self.next)
        # of all runs, those that have ended included: their numbers are not used
        x, _, z = self.loop.split(y)
        e, xihat = self.known(x, z, self.noise)
        # first, so that a frozen agent sends what it measured at this instant
        if self.failures:
            agents.fail(time, e, act(self.loop.output, xihat), modes)
        if agents.stress.exchanges is not None:
            if due:
                agents.heard.exchange(self.next, agents.said(e))
                self.own = agents.heard.own(e)
            else:
                agents.heard.tune(np.arange(len(modes)), modes)
        self.next += due
        # the first input that was computed
        self.acts = time >= self.ahead * (1 - 1e-9)

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        """The derivative of runs, named by their places among the living, in one mode."""
        agents = self.agents
        heard = agents.heard
        loop = self.loop
        chosen = self.alive[runs]
        noise = self.noise.take(chosen, axis=2)
        links = heard.links[mode]
        modes = np.full(len(runs), mode)
        # what was heard last; without exchanges everything is heard at once
        held = None
        if agents.stress.exchanges is not None:
            held = heard.values[heard.places[mode]].take(chosen, axis=2)

        def reactions(known: Array, arrived: Array) -> tuple[Array, Array]:
            return links.felt(known, arrived), agents.pulled(known, modes)

        still = None  # what nothing changes up to the next instant
        if heard.holds_own and held is not None:
            still = reactions(self.own[..., chosen], held)

        def derivative(y: Array, force: Array) -> Array:
            x, xi, z = self.loop.split(y)
            e, xihat = self.known(x, z, noise)
            felt, pulled = still or reactions(
                # without exchanges neighbours are heard as they are now
                e,
                agents.said(e, chosen)[links.speakers] if held is None else held,
            )
            u = agents.control(pulled, self.dhat(xi, xihat), chosen)
            if not self.acts:
                felt, u = 0 * felt, 0 * u
            d = act(loop.output, xi)
            if len(force):
                d = d + force.reshape(d.shape)
            x_dot = felt + loop.moved(u + d, x - self.goal)
            # the observer takes what is measured for the state, and knows the applied input
            if loop.sensed is None:
                seen = felt + loop.moved(u, e)
                z_dot = act(loop.F, xihat) - act(loop.W, seen)
            else:
                pushed = felt + loop.moved(u, 0 * e)
                z_dot = moved(loop.sensed, z, pushed, x + noise - self.goal)
            return self.joined(x_dot, act(loop.A, xi), z_dot)

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """The disturbance that no exosystem knows, (S, n p, k); nothing without one."""
        if not self.agents.stress.acts:
            return np.zeros((len(times), 0, len(runs)))
        extra = self.agents.extra(times[:, None, None, :], self.alive[runs])
        return extra.reshape(len(times), -1, len(runs))

    def size(self, y: Array) -> Array:
        """|e|_inf of states, (k,)."""
        return largest(self.loop.split(y)[0] - self.goal)

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept of links that are gone."""
        self.agents.heard.tune(self.alive[runs], modes)

    def gap(self, y: Array, times: Array, chosen: IndexArray) -> Array:
        """d - dhat of the chosen runs at these times, (n, p, k)."""
        x, xi, z = self.loop.split(y)
        C = self.loop.output
        d = act(C, xi) + self.agents.extra(times, chosen)
        if not self.agents.estimates:
            return d
        _, xihat = self.known(x, z, self.noise[..., chosen])
        return d - self.dhat(xi, xihat)


class Together:
    """Runs side by side from one instant at which all wait to the next; ``visit`` gets places of
    samples and runs (k,), e (n, m, k) and d - dhat (n, p, k).

    ``y`` (N, R): their states; ``place`` (R,): the switch that each has passed last.
    """

    def __init__(self, runs: StressedRuns, visit: Visit) -> None:
        self.setting = runs.setting
        self.times = runs.setting.times
        self.horizon = runs.setting.horizon
        self.visit = visit
        self.columns = StressedColumns(runs)
        self.switches = table_of(runs.switches)
        self.y = self.columns.start
        self.farthest = FARTHEST * np.maximum(1.0, self.columns.size(self.y))
        # everything that happens in all runs at once
        self.begins = np.unique([0.0, *self.columns.instants, *self.columns.failures])
        count = len(runs.seeds)
        self.everyone = np.arange(count)
        self.place = np.zeros(count, dtype=np.int64)
        # how they ended: as they do until something else is known
        self.states = np.full(count, DONE)
        self.ended = np.full(count, self.horizon)
        self.steps: Array | None = None

    def run(self, progress: Progress) -> Ends:
        """Integrate all runs to the horizon, or to where each of them ends."""
        for begin, end in pairwise([*self.begins.tolist(), self.horizon]):
            self.go_on(begin, end)
            progress(end / self.horizon)
            if not len(self.columns.alive):
                break
        none = np.zeros(len(self.states))
        return Ends(states=self.states, times=self.ended, e=self.y, steps=none)

    def go_on(self, begin: float, end: float) -> None:
        """From one instant to the next."""
        y = self.y
        columns = self.columns
        columns.wait(begin, y, self.switches.modes[self.everyone, self.place])
        alive = columns.alive
        # with the noise that holds from now on
        for sample in np.flatnonzero(self.times == begin):
            places = np.full(len(alive), sample)
            self.seen(places, np.arange(len(alive)), y[:, alive])
        found = March(
            columns=columns,
            start=y[:, alive],
            begin=begin,
            end=end,
            switches=self.switches_until(end).of(alive),
            farthest=self.farthest[alive],
            first=self.steps,
            # the steps of a run are shared among its stretches
            most=max(LEAST_STEPS, MOST_STEPS // len(self.begins)),
            tolerance=self.setting.tolerance,
            samples=self.times,
            visit=self.seen,
        ).run()
        y[:, alive] = found.e
        # of those that had ended before nothing changes
        self.states[alive] = found.states
        self.ended[alive] = found.times
        going = found.states == DONE
        columns.alive = alive[going]
        self.steps = found.steps[going]

    def switches_until(self, end: float) -> ModeTable:
        """The switches from the last that each run has passed to the first after ``end``; up to
        there they are passed then."""
        times = self.switches.times
        first = self.place
        while True:
            passed = times[self.everyone, self.place + 1] <= end
            if not passed.any():
                break
            self.place = self.place + passed
        # the next switch, too: a run has to know when its mode ends
        width = (self.place - first).max() + 2
        # runs with fewer switches repeat their last one, which never comes
        places = np.minimum(first[:, None] + np.arange(width), times.shape[1] - 1)
        rows = self.everyone[:, None]
        return ModeTable(times=times[rows, places], modes=self.switches.modes[rows, places])

    def seen(self, sample: IndexArray, run: IndexArray, state: Array) -> None:
        columns = self.columns
        chosen = columns.alive[run]
        e = columns.loop.split(state)[0] - columns.goal
        gap = columns.gap(state, self.times[sample], chosen)
        self.visit(sample, chosen, e, gap)


def run_alone(runs: StressedRuns, modes: Modes, progress: Progress) -> Outcome:
    """Integrate a stack of one run, and put down what happened at the times of its setting."""
    setting = runs.setting
    alone = _Alone(runs, modes)
    plan = Plan(setting.loop.goal, alone.positions, alone.segment)
    integration = Integration(
        plan=plan,
        state=alone.columns.start[:, 0],
        times=setting.times,
        tolerance=setting.tolerance,
        implicit=setting.is_stiff(closed=False),
        report=progress,
    )
    run = integration.run()
    return Outcome(run=run, samples=alone.samples(run.times, run.states))


class _Alone:
    """One run under a stress, piece by piece.  ``noises`` and ``owns``: (n, m) each, in the order
    of the instants."""

    def __init__(self, runs: StressedRuns, modes: Modes) -> None:
        self.columns = StressedColumns(runs)
        self.modes = modes
        self.noises: list[Array] = []
        self.owns: list[Array] = []

    def positions(self, state: Array) -> Array:
        return self.columns.loop.split(state[:, None])[0][..., 0]

    def segment(self, time: float, state: Array) -> Piece:
        """Up to the next switch, exchange or failure."""
        columns = self.columns
        heard = columns.agents.heard
        stay = self.modes.stay(time, self.positions(state))
        mode = stay.mode
        heard.move(mode, columns.next)
        columns.wait(time, state[:, None], np.array([mode]))
        # a switch between two exchanges draws nothing
        if columns.next > len(self.noises):
            self.noises.append(columns.noise[..., 0])
            self.owns.append(columns.own[..., 0])
        part = columns.part(mode, ALONE)

        def derivative(time: float, state: Array) -> Array:
            force = columns.forces(np.array([[time]]), ALONE)[0]
            return part(state[:, None], force)[:, 0]

        ends = [stay.end, *columns.instants[columns.next : columns.next + 1]]
        ends += [failure for failure in columns.failures if failure > time]
        pattern = partial(full_pattern, columns.loop, heard.links[mode].groups)
        return Piece(derivative, pattern, stay._replace(end=float(min(ends))))

    def samples(self, times: Array, states: Array) -> Samples:
        """What was seen at the times (T,) of the states (T, N)."""
        columns = self.columns
        C = columns.loop.output
        agents = columns.agents
        x, xi, z = columns.loop.split(states.T)  # samples in place of runs
        # broadcast: no noise is the same for all agents
        noise = np.zeros(1)
        # a run may end at an instant, before anything happens there
        past = np.searchsorted(columns.instants, times, side="right")
        last = np.minimum(past, columns.next) - 1
        if agents.stress.noise:
            noise = np.stack(self.noises, axis=2)[..., last]
        e, xihat = columns.known(x, z, noise)
        if agents.heard.holds_own:
            e = np.stack(self.owns, axis=2)[..., last]
        dhat = columns.dhat(xi, xihat)
        u = agents.command(agents.pulled(e, self.modes.switches.at(times)), dhat)
        u[..., times < columns.ahead * (1 - 1e-9)] = 0
        # u was computed as if all agents worked
        for agent, left in agents.stopped.items():
            u[agent][:, times >= agents.failing[agent].time] = left.input
        d = act(C, xi) + agents.extra(times)
        of_xi = columns.loop.of_xi
        xihat = agents.believed(xihat[:, of_xi])
        seen = (x, xi[:, of_xi], xihat, d, agents.believed(dhat), u)
        # (n, m, T) as (T, n, m), a copy
        return Samples(*(np.moveaxis(array, 2, 0).copy() for array in seen))
