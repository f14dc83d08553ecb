"""The search for starts that contradict: at random, at corners and edges, and by Newton's method.

Without a certificate: does every start asked for converge?  With one: does V of the certified set
decay as certified from its whole boundary?  What is found is a suspect; only a proved equilibrium
refutes, and only a region.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.random import Generator, default_rng

from dobc_design._checks import noun
from dobc_design._show.progress import Reports, report_to
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.equilibrium.decide import LARGEST, Equilibrium, refuting_check
from dobc_design.conditions.equilibrium.propose import (
    distance_of,
    largest,
    point_of,
    proved_equilibria,
)
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Array, largest_entry
from dobc_design.exact.reading import Texts
from dobc_design.loop.arrays import Gain, chosen_gain
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import positive, seconds, whole
from dobc_design.simulation.starts import CORNERS, EDGES, RANDOM, asked_box
from dobc_design.simulation.switches import ModeTable
from dobc_design.simulation.trials import (
    Arena,
    Batch,
    Effort,
    Trials,
    make_arena,
    run_starts,
    settling_horizon,
)

from .levels import Boundary, Certified, Level, StartSet, level_of
from .paces import drawn_signals
from .suspect import LEAVES, RESTS, STAYS_AWAY, Falsification, Suspect

RUNS = 500
TOLERANCE = 1e-9
# of the runs; the rest is at random
SHARES = {CORNERS: 0.2, EDGES: 0.2}
MOST_AGAIN = 16  # runs that stall and are repeated ...
LONGER = 4.0  # ... for so many times as long
SAME_END = 1e-3  # relative distance of ends that are one
MOST_SUSPECTS = 50
NEWTON_STARTS = 48
BEYOND, FLOOR = 1e-6, 1e-7  # by which V may exceed its bound: relative, and as a part of the level
SPENT = 1e-5  # V below this part of its start no longer counts for the observed rate


@noun
class Question:
    """What is searched: the arguments of ``falsify``, which says what they mean."""

    runs: int = RUNS
    seed: int | None = None
    radius: float | None = None
    disturbance: float | None = None
    certified: Certified | None = None
    t_final: float | None = None

    def checked(self) -> Question:
        """The same in plain numbers.  Raises: SpecError for a wrong argument."""
        runs = whole(self.runs, "runs", least=1)
        seed = None if self.seed is None else whole(self.seed, "seed", least=0)
        bounded = self.radius is not None or self.disturbance is not None
        if self.certified is not None and bounded:
            message = "says where to start; radius and disturbance must be left out with it."
            raise wrong("certified", message, "Leave one of them out.")
        radius = self.radius
        if radius is not None:
            radius = positive(radius, "radius", example="2")
        return replace(self, runs=runs, seed=seed, radius=radius)


def search_starts(
    problem: Problem,
    question: Question,
    *,
    gain: Gain | None = None,
    progress: Reports[str] = None,
) -> Falsification:
    """Search with ``gain`` (q, m) in place of observer.W; modes are constant or switch at random.
    Raises: SpecError for a wrong argument."""
    problem.require("the search for starts that fail")
    question = question.checked()
    seed = question.seed
    if seed is None:
        seed = problem.simulation.seed
    if question.t_final is None:
        horizon = settling_horizon(problem)
    else:
        horizon = seconds(question.t_final, "t_final", example="20")
    with np.errstate(all="ignore"):
        arena = make_arena(problem, gain)
        loop = arena.loop
        level = None
        starts: StartSet
        if question.certified is None:
            starts = asked_box(
                problem, loop, radius=question.radius, disturbance=question.disturbance
            )
        else:
            W = chosen_gain(loop_of(problem), gain)
            level = level_of(problem, question.certified, W)
            starts = Boundary(level=level, loop=loop)
        search = _Search(
            arena=arena,
            starts=starts,
            level=level,
            horizon=horizon,
            seed=seed,
            say=report_to(progress),
        )
        return search.run(question.runs)


@noun(eq=False)
class _Search:
    arena: Arena
    starts: StartSet
    level: Level | None
    horizon: float
    seed: int
    say: Progress

    @property
    def problem(self) -> Problem:
        return self.arena.problem

    def run(self, count: int) -> Falsification:
        """Search with so many runs."""
        rng = default_rng(self.seed)
        self.say("simulating random starts, corners and edges")
        trials = self.simulate(self.drawn(rng, count))
        leaving = self.beyond(trials)
        self.say("repeating what stalls")
        away = self.stay_away(trials)
        self.say("looking for equilibria")
        proved = self.equilibria(trials, rng)
        suspects = [*map(self.resting, proved), *leaving, *away]
        return self.result(trials, suspects[:MOST_SUSPECTS], proved)

    def drawn(self, rng: Generator, count: int) -> Batch:
        """Starts of every kind."""
        counts = {kind: int(share * count) for kind, share in SHARES.items()}
        counts[RANDOM] = count - sum(counts.values())
        pairs = [self.starts.draw(rng, each, kind) for kind, each in counts.items() if each]
        e, eps = zip(*pairs, strict=True)
        return Batch(
            e=np.concatenate(e, axis=1),
            eps=np.concatenate(eps, axis=2),
            switches=self.signals(rng, count),
        )

    def signals(self, rng: Generator, count: int) -> ModeTable:
        """The switches of runs that may be repeated for longer."""
        return drawn_signals(rng, count, self.problem, self.horizon, longer=LONGER)

    def simulate(self, starts: Batch, *, longer: float = 1.0) -> Trials:
        """Run the starts, and follow V where there is one."""
        effort = Effort(horizon=longer * self.horizon, tolerance=TOLERANCE)
        value = None if self.level is None else self.level.value
        return run_starts(self.arena, starts, effort, value=value)

    def beyond(self, trials: Trials) -> list[Suspect]:
        """Runs in which V exceeds its certified bound, the worst first."""
        if self.level is None:
            return []
        values = trials.values
        # a certified V is below this bound at all times
        decay = np.exp(-self.level.rate * trials.times)
        bound = values[0] * decay[:, None] * (1 + BEYOND) + FLOOR
        seen = np.where(np.isnan(values), np.inf, values)
        over = np.nanmax(seen - bound, axis=0)
        bad = np.flatnonzero((over > 0) & ~trials.unfinished)
        order = np.argsort(-over[bad], kind="stable")
        return [self.suspect(LEAVES, trials, run) for run in bad[order].tolist()]

    def stay_away(self, trials: Trials) -> list[Suspect]:
        """Runs that stall and still do when they last longer, the farthest first; one of those that
        end at one place."""
        stalled = np.flatnonzero(trials.stalled)
        if not len(stalled):
            return []
        # a run that ended early has diverged
        last = np.nan_to_num(trials.error[-1, stalled], nan=np.inf)
        farthest = stalled[np.argsort(-last, kind="stable")]
        # slow runs look like those that rest: only more time tells them apart
        again = self.simulate(trials.starts.of(farthest[:MOST_AGAIN]), longer=LONGER)
        found = []
        ends: list[Array] = []
        for run in np.flatnonzero(again.stalled).tolist():
            end = again.ends[:, run]
            if not any(_is_same(end, other) for other in ends):
                ends.append(end)
                found.append(self.suspect(STAYS_AWAY, again, run))
        return sorted(found, key=lambda suspect: -suspect.final_error)

    def equilibria(self, trials: Trials, rng: Generator) -> list[Equilibrium]:
        """Equilibria within the set of starts, proved: from where runs stall, and from other
        starts."""
        # linear couplings have the target alone, or a whole space
        loop = loop_of(self.problem)
        if loop.is_linear or loop.size > LARGEST:
            return []
        # the same effort for one mode and for many
        count = max(1, NEWTON_STARTS // len(self.arena.modes))
        stalled = trials.resting_points
        found = []
        for mode in self.arena.modes:
            corners, _ = self.starts.draw(rng, count, CORNERS)
            others, _ = self.starts.draw(rng, count, RANDOM)
            points = [*stalled[:count], *corners.T, *others.T]
            found += proved_equilibria(loop, mode, points, holds=self.starts.holds)
        return sorted(found, key=distance_of)

    def suspect(self, kind: str, trials: Trials, run: int) -> Suspect:
        """What became of one run."""
        starts = trials.starts
        e = starts.e[:, run]
        error = trials.error[:, run]
        eps = starts.eps[:, :, run].copy()
        final = float("inf")
        if not trials.diverged[run]:
            final = float(error[~np.isnan(error)][-1])
        end = trials.ends[:, run]
        # of a run that diverged only the start is known
        if not np.isfinite(end).all():
            end = e
        return Suspect(
            kind=kind,
            start=self.states(e, eps),
            eps=eps,
            final_error=final,
            times=trials.times.copy(),
            error=error.copy(),
            labels=self.farthest(end),
            modes=starts.switches.named(run, self.arena.modes),
        )

    def states(self, e: Array, eps: Array) -> Array:
        """x (n, m) of errors (n m,), those of estimates where these stand in place of states."""
        loop = self.arena.loop
        x = e.reshape(loop.goal.shape) + loop.goal
        sensed = loop.sensed
        return x + eps @ sensed.x.T if sensed is not None and sensed.estimated else x

    def resting(self, claim: Equilibrium) -> Suspect:
        """A proved equilibrium: the agents start there with eps = 0 and stay."""
        loop = self.arena.loop
        e = point_of(claim)
        eps = np.zeros((loop.n, loop.q))
        size = largest(e)
        return Suspect(
            kind=RESTS,
            start=self.states(e, eps),
            eps=eps,
            final_error=size,
            times=np.array([0.0, self.horizon]),
            error=np.array([size, size]),
            labels=self.farthest(e),
            modes=((0.0, claim.mode),),
            equilibrium=claim,
        )

    def farthest(self, e: Array) -> Texts:
        """The agents that are at least half as far from the target as the farthest, in the order of
        labels."""
        sizes = np.abs(e).reshape(self.arena.loop.n, -1).max(axis=1)
        far = np.flatnonzero(sizes >= sizes.max() / 2)
        return tuple(self.problem.network.labels[agent] for agent in far)

    def result(
        self, trials: Trials, suspects: list[Suspect], proved: list[Equilibrium]
    ) -> Falsification:
        """The outcome of all of it."""
        notes = []
        unfinished = int(trials.unfinished.sum())
        if unfinished:
            notes.append(f"{unfinished} runs took too many steps; nothing is said about them.")
        # where a disturbance was asked for that no run has
        if self.starts.has_disturbance and not trials.starts.eps.any():
            notes.append(
                "The observer is too fast for its closed form: every run starts with xihat = xi."
            )
        loop = loop_of(self.problem)
        # the first equilibrium that refutes the region asked for
        refuting = (refuting_check(loop, claim) for claim in proved)
        certified = None
        observed = None
        if self.level is not None:
            certified = self.level.rate
            observed = _observed_rate(trials)
        return Falsification(
            name=self.problem.name,
            target=self.starts.words,
            tried=len(trials),
            unfinished=unfinished,
            suspects=tuple(suspects),
            proved=tuple(proved),
            check=next(filter(None, refuting), None),
            horizon=self.horizon,
            seed=self.seed,
            certified_rate=certified,
            observed_rate=observed,
            notes=tuple(notes),
        )


def _is_same(end: Array, other: Array) -> bool:
    """Whether two runs end at one place."""
    return largest_entry(end - other) <= SAME_END * (1 + largest_entry(end))


def _observed_rate(trials: Trials) -> float | None:
    """The slowest average decay of V over a run, up to where it is spent (1/s)."""
    values = trials.values
    # up to where V is spent; below that integration errors decay no more
    counts = np.sum(values > SPENT * values[0], axis=0)
    rates = []
    for run in np.flatnonzero((counts > 1) & ~trials.unfinished):
        last = int(counts[run]) - 1
        left = values[last, run] / values[0, run]
        rates.append(-math.log(left) / trials.times[last])
    return min(rates, default=None)
