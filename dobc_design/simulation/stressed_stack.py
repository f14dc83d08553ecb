"""Many runs under one stress in continuous time, side by side: ``stressed`` with the runs as a last axis.

The observer's error obeys eps' = (A - W C) eps - W v, v being the disturbance that no exosystem knows, whatever
saturates, fails or is lost, and noise that is drawn anew makes it jump by -W times the difference.  So d and dhat are
known in closed form, and only e is integrated.  All runs wait for each other where noise is drawn, packets are
exchanged or agents fail; in between every run has its own steps and switches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dobc_design.simulation.agents_stack import Crew, StressedRuns
from dobc_design.simulation.closed_form import ClosedForm, make_closed_form
from dobc_design.simulation.columns import DONE, Ends, RightHandSide, Stretch, Visit, farthest_of, integrate_stretch
from dobc_design.simulation.field import Loop
from dobc_design.simulation.integrate import Progress
from dobc_design.simulation.sampled import sample_instants
from dobc_design.simulation.stacked import MOST_STEPS, outputs
from dobc_design.simulation.stress import Stress
from dobc_design.simulation.switches import Array, IndexArray

Estimate = Callable[[int, IndexArray, Array], None]
LEAST_STEPS = 1000  # of one run between two instants at which all wait, before it is handed back


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forms:
    """C xi and C eps in closed form.

    ``inner`` is the observer's error with the unmodelled disturbance as further states, [eps; sines; cosines], and
    ``moves`` the same without C; both reach as far as eps goes without a jump.  None where there is nothing of a kind.
    """

    outer: ClosedForm | None
    inner: ClosedForm | None
    moves: ClosedForm | None


def make_forms(loop: Loop, stress: Stress, horizon: float, *, heeds: bool) -> Forms | None:
    """Prepare the closed forms up to ``horizon`` in s; None if one of them is out of reach."""
    q, m = loop.q, loop.m
    if q == 0:
        return Forms(outer=None, inner=None, moves=None)
    outer, inner, moves = make_closed_form(loop.A, loop.C, horizon), None, None
    if heeds:
        extra = 2 * m if stress.disturbance else 0
        if extra and loop.own is not None:  # the sines would act on other agents' exosystems as well
            return None
        F, C = np.zeros((q + extra, q + extra)), np.zeros((m, q + extra))
        F[:q, :q], C[:, :q] = loop.F, loop.C
        if extra:
            F[:q, q : q + m] = -loop.W
            F[q : q + m, q + m :] = stress.frequency * np.eye(m)
            F[q + m :, q : q + m] = -stress.frequency * np.eye(m)
        reach = min(horizon, stress.draws) if stress.noise and stress.draws is not None else horizon
        inner, moves = make_closed_form(F, C, reach), make_closed_form(F, np.eye(len(F)), reach)
    if outer is None or (heeds and (inner is None or moves is None)):
        return None
    return Forms(outer=outer, inner=inner, moves=moves)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Present:
    """What holds between two instants at which all runs wait.  Shapes: chosen (k,), places among the R runs of the
    crew; noise (n, m, R); xi (n, q, R); eps (n, q or more, R) as it was at ``since`` s."""

    crew: Crew
    forms: Forms
    chosen: IndexArray
    noise: Array
    xi: Array
    eps: Array
    since: float

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        """e' of the full loop, where the closed forms give d and dhat."""
        crew, chosen, heard = self.crew, self.chosen[runs], None
        links, noise = crew.heard.links[mode], self.noise.take(chosen, axis=2)
        if crew.stress.exchanges is not None:
            heard = crew.heard.values[crew.heard.places[mode]].take(chosen, axis=2)

        def derivative(e: Array, force: Array) -> Array:
            measured = e.reshape(noise.shape) + noise
            d, dhat = force.reshape(2, *noise.shape)
            arrived = crew.said(measured, chosen)[links.speakers] if heard is None else heard
            result = links.felt(measured, arrived)
            result += crew.control(measured, dhat, chosen)
            result += d
            return result.reshape(e.shape)

        return derivative

    def forces(self, times: Array, runs: IndexArray) -> Array:
        """d, then dhat: (S, 2 n m, k)."""
        crew, forms, chosen = self.crew, self.forms, self.chosen[runs]
        d = np.zeros((len(times), *crew.shape, len(chosen)))
        if forms.outer is not None:
            d = outputs(forms.outer.many(times), self.xi.take(chosen, axis=2))
        dhat = np.zeros_like(d)
        if forms.inner is not None:
            dhat = d - outputs(forms.inner.many(times - self.since), self.eps.take(chosen, axis=2))
        if crew.stress.disturbance:
            angle = crew.stress.frequency * times[:, None, None, :] + crew.phase.take(chosen, axis=2)
            d = d + crew.stress.disturbance * np.sin(angle)
        return np.concatenate([d, dhat], axis=1).reshape(len(times), -1, len(chosen))

    def both(self, time: float) -> tuple[Array, Array]:
        """d and dhat of the chosen runs at one time, (n, m, k) each."""
        found = self.forces(np.full((1, len(self.chosen)), time), np.arange(len(self.chosen)))
        d, dhat = found.reshape(2, *self.crew.shape, len(self.chosen))
        return d, dhat

    def switched(self, runs: IndexArray, modes: IndexArray) -> None:
        """Nothing is kept of links that are gone."""
        self.crew.heard.tune(self.chosen[runs], modes)


def run_stressed_stack(
    runs: StressedRuns,
    forms: Forms,
    times: Array,
    *,
    tolerance: float,
    visit: Visit,
    estimate: Estimate,
    progress: Progress | None = None,
) -> Ends:
    """Integrate all runs over ``times`` (from 0 to the horizon).

    ``visit`` as in ``stacked``; ``estimate(sample, runs, gap)`` gets |d - dhat|_inf of the runs that got there, (k,).
    Raises: SpecError for too many exchanges.
    """
    return _Walker(runs, forms, times, tolerance=tolerance, visit=visit, estimate=estimate).run(progress)


class _Walker:
    """All runs, from one instant at which they wait to the next."""

    def __init__(
        self, runs: StressedRuns, forms: Forms, times: Array, *, tolerance: float, visit: Visit, estimate: Estimate
    ) -> None:
        self.forms, self.times, self.tolerance, self.visit, self.estimate = forms, times, tolerance, visit, estimate
        self.horizon, draws, many = float(times[-1]), runs.stress.draws, len(runs.seeds)
        instants = np.zeros(0) if draws is None else sample_instants(draws, self.horizon, name="exchange")
        self.instants = instants[instants < self.horizon]
        self.failures = {failure.time for failure in runs.failing.values()}
        self.crew = Crew(runs, self.instants, keep=True)
        self.switches = runs.switches
        longest = max(map(len, runs.switches)) + 1
        self.switch_times = np.full((many, longest), np.inf)
        self.switch_modes = np.zeros((many, longest), dtype=np.int64)
        for row, each in enumerate(runs.switches):
            self.switch_times[row, : len(each)], self.switch_modes[row, : len(each)] = each.times, each.modes
        goal = runs.loop.goal[..., None]
        x, self.xi, xihat = (
            np.stack([getattr(start, name) for start in runs.starts], axis=2) for name in ("x", "xi", "xihat")
        )
        self.e, self.noise, self.since = (x - goal).reshape(-1, many), np.zeros_like(x), 0.0
        self.eps = self.xi - xihat
        if forms.inner is not None and runs.stress.disturbance:
            waves = [runs.stress.disturbance * wave(self.crew.phase) for wave in (np.sin, np.cos)]
            self.eps = np.concatenate([self.eps, *waves], axis=1)
        self.place, self.alive = np.zeros(many, dtype=np.int64), np.arange(many)
        self.farthest = farthest_of(self.e)

    def run(self, progress: Progress | None) -> Ends:
        """From the start to the horizon."""
        report = progress or (lambda part: None)
        begins = np.unique([0.0, *self.instants, *(t for t in self.failures if t < self.horizon)])
        states, ended = np.full(len(self.alive), DONE), np.full(len(self.alive), self.horizon)
        self.visit(np.zeros_like(self.alive), self.alive, self.e)
        steps, exchange = None, 0
        for begin, end in pairwise([*begins.tolist(), self.horizon]):
            due = exchange < len(self.instants) and self.instants[exchange] <= begin
            present = self.wait(begin, exchange if due else None)
            exchange += due
            self.sample(present, begin, end)
            window = self.window(begin, end)
            alive = self.alive
            stretch = Stretch(
                columns=present,
                begin=begin,
                end=end,
                e=self.e[:, alive],
                farthest=self.farthest[alive],
                switch_times=window[0],
                switch_modes=window[1],
                steps=steps,
                most=max(LEAST_STEPS, MOST_STEPS // len(begins)),
            )
            found = integrate_stretch(stretch, self.times, tolerance=self.tolerance, visit=self.visitor(alive))
            self.e[:, alive], states[alive], ended[alive] = found.e, found.states, found.times
            going = found.states == DONE
            self.alive, steps = alive[going], found.steps[going]
            report(end / self.horizon)
            if not len(self.alive):
                break
        return Ends(states=states, times=ended, e=self.e, steps=np.zeros(len(states)))

    def visitor(self, alive: IndexArray) -> Visit:
        """``visit`` for runs that are named by their places among those that are still going."""
        return lambda sample, run, e: self.visit(sample, alive[run], e)

    def wait(self, begin: float, exchange: int | None) -> _Present:
        """All runs have come to ``begin``: draw, fail, exchange (the k-th time, if it is due)."""
        crew, everyone = self.crew, np.arange(self.e.shape[1])
        if exchange is not None and crew.stress.noise:
            self.jump(begin, crew.noise(exchange))
        measured = self.e.reshape(self.noise.shape) + self.noise
        if begin in self.failures:
            crew.fail(begin, measured, self.present(everyone).both(begin)[1])
        if crew.stress.exchanges is not None:
            if exchange is not None:
                crew.heard.exchange(exchange, crew.said(measured))
            else:
                modes = [int(each.at(np.array([begin]))[0]) for each in self.switches]
                crew.heard.tune(everyone, np.array(modes))
        return self.present(self.alive)

    def present(self, chosen: IndexArray) -> _Present:
        """What holds now."""
        return _Present(
            crew=self.crew,
            forms=self.forms,
            chosen=chosen,
            noise=self.noise,
            xi=self.xi,
            eps=self.eps,
            since=self.since,
        )

    def jump(self, begin: float, noise: Array) -> None:
        """New noise holds, and the observer's error jumps with it."""
        loop, moves = self.crew.loop, self.forms.moves
        if moves is not None:
            eps = moves.at(begin - self.since) @ self.eps if begin > self.since else self.eps.copy()
            eps[:, : loop.q] -= loop.W @ (noise - self.noise)
            self.eps, self.since = eps, begin
        self.noise = noise

    def sample(self, present: _Present, begin: float, end: float) -> None:
        """How far the estimates are off until ``end``, where others may hold."""
        first, last = np.searchsorted(self.times, [begin, end], side="left").tolist()
        for sample in range(first, len(self.times) if end >= self.horizon else last):
            d, dhat = present.both(float(self.times[sample]))
            self.estimate(sample, present.chosen, np.abs(d - dhat).max(axis=(0, 1)))

    def window(self, begin: float, end: float) -> tuple[Array, IndexArray]:
        """The switches that matter before ``end``, of the runs that are still going: times and modes, (k, S)."""
        rows = np.arange(len(self.place))
        while (passed := self.switch_times[rows, self.place + 1] <= begin).any():
            self.place = self.place + passed
        upto = self.place.copy()
        while (more := self.switch_times[rows, upto + 1] < end).any():
            upto = upto + more
        width = int((upto - self.place).max()) + 2
        columns = np.minimum(self.place[:, None] + np.arange(width), self.switch_times.shape[1] - 1)[self.alive]
        return self.switch_times[self.alive[:, None], columns], self.switch_modes[self.alive[:, None], columns]
