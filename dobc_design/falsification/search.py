"""The search for starts that contradict: at random, at corners and edges, uphill, and by Newton's
method.

Without a certificate: does every start asked for converge?  With one: does V of the certified set
decay as certified from its whole boundary?  What is found is a suspect; only a proved equilibrium
refutes, and only a region.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from scipy import optimize

from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check, surviving
from dobc_design.conditions.coverage import Progress
from dobc_design.conditions.equilibrium.decide import (
    LARGEST,
    Equilibrium,
    enclose_equilibrium,
    refuting_check,
)
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.conditions.schedule.cycles import may_stay
from dobc_design.errors import wrong
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, spend
from dobc_design.falsification import starts as sets
from dobc_design.falsification.starts import (
    CORNERS,
    EDGES,
    RANDOM,
    Certified,
    Level,
    Pair,
    Runs,
    Signals,
    StartSet,
)
from dobc_design.falsification.suspect import LEAVES, RESTS, STAYS_AWAY, Falsification, Suspect
from dobc_design.model.model import Flow, build_flow, build_model
from dobc_design.problem.arrays import Array, Gain, chosen_gain, no_gain, pinning_matrix, unreached
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import positive, seconds, whole
from dobc_design.simulation.integrate import fastest_decay

Objective = Callable[[Array], tuple[float, Array]]

RUNS = 500
TOLERANCE = 1e-9
# of the runs; a fifth at most goes uphill, the rest is at random
SHARES = {CORNERS: 0.2, EDGES: 0.2}
MOST_ASCENTS = 12
MOST_AGAIN = 16  # runs that stall and are repeated ...
LONGER = 4.0  # ... for so many times as long
SAME_END = 1e-3  # relative distance of ends that are one
MOST_SUSPECTS = 50
NEWTON_STARTS = 48
BEYOND, FLOOR = 1e-6, 1e-7  # by which V may exceed its bound: relative, and as a part of the level
SPENT = 1e-5  # V below this part of its start no longer counts for the observed rate
MOST_STEPS, LEAST_STEPS = 2000, 60  # of the flow that is climbed ...
MOST_WORK = 40_000  # ... and steps times states
ASCENT_PART = 0.25  # of the horizon that it lasts
STEEPER = 3.0  # couplings may be so many times as steep far out as at the target
EVALUATIONS = 24  # steps of one ascent
FIRST_STEP, LEAST_STEP = 0.2, 1e-3  # relative to the reach of the set
GROWTH, SHRINKAGE = 1.5, 0.4


@shows_progress
def falsify(
    problem: Source,
    *,
    runs: int = RUNS,
    seed: int | None = None,
    radius: float | None = None,
    disturbance: float | None = None,
    certified: Certificate | Certified | None = None,
    t_final: float | None = None,
    progress: Reports[str] = None,
) -> Falsification:
    """Search for starts that do not converge, or that leave a certified set; and prove second
    equilibria.

    Starts: the region asked for; with ``radius`` the box |e|_inf <= radius; without both |e|_inf <=
    1; with ``certified`` the boundary of a certified set: that of a certificate, of one of its
    checks, or of a claim of theorems.separable, theorems.lure or theorems.shell.  ``disturbance``
    bounds |eps_i|.  ``runs`` starts are simulated: corners, edges, random ones, and the worst of
    them after gradient ascent through CasADi.  ``t_final`` in s; ``progress``: as in ``certify``.
    The same ``seed`` gives the same search.  A missing W is designed first, as ``certify`` does.
    Returns: a Falsification with suspects, which prove nothing, and equilibria, each proved in a
    box by interval arithmetic.  Raises: SpecError for a wrong argument.
    """
    problem = as_integrators(load_problem(problem))
    gain = observer_gain(problem)
    if isinstance(certified, Certificate):
        gain, certified = certified.claims.W, sets.regional_check(certified)
        if certified is None:
            message = "must hold a proved check of a region; this certificate has none."
            raise wrong(
                "certified", message, "Ask for a [region], or give certify everything=True."
            )
    given: dict[str, Any] = {
        "radius": radius,
        "disturbance": disturbance,
        "certified": certified,
        "t_final": t_final,
    }
    return search_starts(problem, runs=runs, seed=seed, gain=gain, progress=progress, **given)


def search_starts(
    problem: Problem,
    *,
    runs: int = RUNS,
    seed: int | None = None,
    radius: float | None = None,
    disturbance: float | None = None,
    certified: Certified | None = None,
    t_final: float | None = None,
    gain: Gain | None = None,
    progress: Reports[str] = None,
) -> Falsification:
    """The same with ``gain`` (q, m) in place of observer.W; modes are constant or switch at
    random."""
    problem.require_no_leader("the search for starts that fail")
    whole(runs, "runs", least=1)
    seed = problem.simulation.seed if seed is None else whole(seed, "seed", least=0)
    if certified is not None and (radius is not None or disturbance is not None):
        message = "says where to start; radius and disturbance must be left out with it."
        raise wrong("certified", message, "Leave one of them out.")
    radius = None if radius is None else positive(radius, "radius", example="2")
    horizon = (
        sets.settling_horizon(problem)
        if t_final is None
        else seconds(t_final, "t_final", example="20")
    )
    say = report_to(progress)
    with np.errstate(all="ignore"):
        arena = sets.make_arena(problem, gain)
        level = (
            None
            if certified is None
            else sets.level_of(problem, certified, chosen_gain(problem, gain))
        )
        starts: StartSet = sets.asked_box(
            problem, arena.loop, radius=radius, disturbance=disturbance
        )
        if level is not None:
            starts = sets.Boundary(level=level, loop=arena.loop)
        search = _Search(
            arena=arena, starts=starts, level=level, horizon=horizon, gain=gain, seed=seed, say=say
        )
        return search.run(runs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    arena: sets.Arena
    starts: StartSet
    level: Level | None
    horizon: float
    gain: Gain | None
    seed: int
    say: Progress

    @property
    def problem(self) -> Problem:
        return self.arena.problem

    def run(self, count: int) -> Falsification:
        rng = np.random.default_rng(self.seed)
        uphill = min(MOST_ASCENTS, count // 5) if self.problem.n * self.problem.m <= LARGEST else 0
        self.say("simulating random starts, corners and edges")
        count -= uphill
        counts = {kind: int(share * count) for kind, share in SHARES.items()}
        counts[RANDOM] = count - sum(counts.values())
        parts = [self.starts.draw(rng, each, kind) for kind, each in counts.items() if each]
        e, eps = (
            np.concatenate([e for e, _ in parts], axis=1),
            np.concatenate([eps for _, eps in parts], axis=2),
        )
        signals = sets.drawn_signals(rng, count, self.problem, self.horizon, longer=LONGER)
        done = [first := self.simulate(e, eps, signals)]
        if uphill:
            self.say("climbing from the worst starts")
            done.append(self.climb(first, uphill))
        suspects = [suspect for runs in done for suspect in self.beyond(runs)]
        self.say("repeating what stalls")
        away = self.stay_away(done)
        self.say("looking for equilibria")
        proved = self.equilibria(done, rng)
        suspects = [*map(self.resting, proved), *suspects, *away]
        return self.result(done, suspects[:MOST_SUSPECTS], proved)

    def simulate(self, e: Array, eps: Array, signals: Signals, *, longer: float = 1.0) -> Runs:
        horizon = longer * self.horizon
        return sets.run_starts(
            self.arena, e, eps, signals, horizon=horizon, tolerance=TOLERANCE, level=self.level
        )

    def badness(self, runs: Runs) -> Array:
        """What the ascent begins with: how far V is above its bound, or |e| at the end; (R,)."""
        if self.level is None:
            last = np.where(np.isnan(runs.error[-1]), np.inf, runs.error[-1])
            return np.where(runs.unfinished, -np.inf, last)
        growth = np.log(np.maximum(runs.values, 1e-300) / np.maximum(runs.values[0], 1e-300))
        early = np.where(
            runs.values > SPENT * runs.values[0],
            growth + self.level.rate * runs.times[:, None],
            -np.inf,
        )
        return np.asarray(np.max(early[1:], axis=0))

    def climb(self, runs: Runs, count: int) -> Runs:
        """Gradient ascent from the worst starts, each in the mode that it began in; simulated
        again."""
        worst = np.argsort(-self.badness(runs), kind="stable")[:count]
        rows, q, modes = len(runs.e), self.arena.loop.q, runs.signals.modes[worst, 0]
        objective = (
            partial(final_error, rows)
            if self.level is None
            else partial(final_level, self.level, rows, q)
        )
        flows = {mode: self.flow(mode) for mode in dict.fromkeys(modes.tolist())}
        found = [
            ascend(flows[mode], self.starts, (runs.e[:, run], runs.eps[:, :, run]), objective)
            for run, mode in zip(worst.tolist(), modes.tolist(), strict=True)
        ]
        e, eps = (
            np.stack([e for e, _ in found], axis=1),
            np.stack([eps for _, eps in found], axis=2),
        )
        if not all(may_stay(self.problem, mode) for mode in self.arena.modes):
            rng = np.random.default_rng(self.seed)
            return self.simulate(
                e, eps, sets.drawn_signals(rng, count, self.problem, self.horizon, longer=LONGER)
            )
        return self.simulate(e, eps, sets.constant_signals(modes))

    def flow(self, mode: int) -> Flow:
        loop = self.arena.loop
        fastest = STEEPER * fastest_decay(loop, self.arena.networks(mode).groups)
        if loop.q:
            fastest = max(fastest, float(np.linalg.norm(loop.F, 2)))
        most = max(LEAST_STEPS, min(MOST_STEPS, MOST_WORK // (loop.n * (loop.m + loop.q))))
        horizon = min(ASCENT_PART * self.horizon, most / fastest)
        steps = min(most, max(LEAST_STEPS, math.ceil(horizon * fastest)))
        return build_flow(
            self.problem, self.arena.modes[mode], horizon=horizon, steps=steps, gain=self.gain
        )

    def beyond(self, runs: Runs) -> list[Suspect]:
        if self.level is None:
            return []
        bound = (
            runs.values[0] * np.exp(-self.level.rate * runs.times)[:, None] * (1 + BEYOND) + FLOOR
        )
        over = np.nanmax(np.where(np.isnan(runs.values), np.inf, runs.values) - bound, axis=0)
        bad = np.flatnonzero((over > 0) & ~runs.unfinished)
        return [
            self.suspect(LEAVES, runs, int(run))
            for run in bad[np.argsort(-over[bad], kind="stable")]
        ]

    def stay_away(self, done: list[Runs]) -> list[Suspect]:
        """Runs that stall and still do when they last longer; one of those that end at one
        place."""
        found: list[Suspect] = []
        for runs in done:
            worst = np.argsort(-self.badness(runs), kind="stable")
            chosen = worst[runs.stalled[worst]][:MOST_AGAIN]
            if not len(chosen):
                continue
            signals = Signals(times=runs.signals.times[chosen], modes=runs.signals.modes[chosen])
            longer = self.simulate(
                runs.e[:, chosen], runs.eps[:, :, chosen], signals, longer=LONGER
            )
            ends: list[Array] = []
            for run in np.flatnonzero(longer.stalled).tolist():
                end = longer.ends[:, run]
                if not any(
                    np.max(np.abs(end - other)) <= SAME_END * (1 + np.max(np.abs(end)))
                    for other in ends
                ):
                    ends.append(end)
                    found.append(self.suspect(STAYS_AWAY, longer, run))
        return sorted(found, key=lambda suspect: -suspect.final_error)

    def equilibria(self, done: list[Runs], rng: np.random.Generator) -> list[Equilibrium]:
        """Equilibria within the set of starts, proved: from where runs stall, and from other
        starts."""
        problem = self.problem
        if problem.is_linear or problem.n * problem.m > LARGEST:
            return []
        count = max(1, NEWTON_STARTS // len(self.arena.modes))
        stalled = [end for runs in done for end in runs.ends.T[runs.stalled & ~runs.diverged]]
        found: list[Equilibrium] = []
        for mode in self.arena.modes:
            others = np.concatenate(
                [self.starts.draw(rng, count, kind)[0] for kind in (CORNERS, RANDOM)], axis=1
            )
            found += proved_equilibria(
                problem, mode, [*stalled[:count], *others.T], starts=self.starts
            )
        return sorted(found, key=lambda claim: float(np.max(np.abs(point_of(claim)))))

    def suspect(self, kind: str, runs: Runs, run: int) -> Suspect:
        loop, error = self.arena.loop, runs.error[:, run]
        known = error[~np.isnan(error)]
        end = runs.ends[:, run] if np.isfinite(runs.ends[:, run]).all() else runs.e[:, run]
        return Suspect(
            kind=kind,
            start=runs.e[:, run].reshape(loop.n, loop.m) + loop.goal,
            eps=runs.eps[:, :, run].copy(),
            final_error=float("inf") if runs.diverged[run] else float(known[-1]),
            times=runs.times.copy(),
            error=error.copy(),
            labels=self.farthest(end),
            modes=runs.signals.of(run, self.arena.modes),
        )

    def resting(self, claim: Equilibrium) -> Suspect:
        """A proved equilibrium: the agents start there with eps = 0 and stay."""
        loop, e = self.arena.loop, point_of(claim)
        size = float(np.max(np.abs(e)))
        return Suspect(
            kind=RESTS,
            start=e.reshape(loop.n, loop.m) + loop.goal,
            eps=np.zeros((loop.n, loop.q)),
            final_error=size,
            times=np.array([0.0, self.horizon]),
            error=np.array([size, size]),
            labels=self.farthest(e),
            modes=((0.0, claim.mode),),
            equilibrium=claim,
        )

    def farthest(self, e: Array) -> tuple[str, ...]:
        """The agents that are at least half as far from the target as the farthest, in the order of
        labels."""
        sizes = np.abs(e).reshape(self.arena.loop.n, -1).max(axis=1)
        return tuple(
            self.problem.network.labels[i] for i in np.flatnonzero(sizes >= sizes.max() / 2)
        )

    def result(
        self, done: list[Runs], suspects: list[Suspect], proved: list[Equilibrium]
    ) -> Falsification:
        notes = []
        unfinished = sum(int(runs.unfinished.sum()) for runs in done)
        if unfinished:
            notes.append(f"{unfinished} runs took too many steps; nothing is said about them.")
        if self.starts.reach[1].any() and not any(runs.eps.any() for runs in done):
            notes.append(
                "The observer is too fast for its closed form: every run starts with xihat = xi."
            )
        checks = (refuting_check(self.problem, claim) for claim in proved)
        return Falsification(
            name=self.problem.name,
            target=self.starts.words,
            tried=sum(runs.e.shape[1] for runs in done),
            unfinished=unfinished,
            suspects=tuple(suspects),
            proved=tuple(proved),
            check=next((each for each in checks if each is not None), None),
            horizon=self.horizon,
            seed=self.seed,
            certified_rate=None if self.level is None else self.level.rate,
            observed_rate=self.observed(done),
            notes=tuple(notes),
        )

    def observed(self, done: list[Runs]) -> float | None:
        """The slowest average decay of V over a run, up to where it is spent (1/s)."""
        if self.level is None:
            return None
        rates = []
        for runs in done:
            counts = np.sum(runs.values > SPENT * runs.values[0], axis=0)
            for run in np.flatnonzero((counts > 1) & ~runs.unfinished):
                last = int(counts[run]) - 1
                rates.append(
                    -math.log(runs.values[last, run] / runs.values[0, run]) / runs.times[last]
                )
        return min(rates, default=None)


def final_error(rows: int, end: Array) -> tuple[float, Array]:
    """Log of |e| at the end and its gradient by the state; ``rows`` numbers of the state are e."""
    size = float(np.linalg.norm(end[:rows]))
    weight = np.zeros_like(end)
    weight[:rows] = end[:rows] / max(size, 1e-300) ** 2
    return float(np.log(max(size, 1e-300))), weight


def final_level(level: Level, rows: int, q: int, end: Array) -> tuple[float, Array]:
    """Log of V at the end and a (sub)gradient."""
    e, eps = end[:rows], end[rows:].reshape(-1, q) if q else np.zeros((1, 0))
    size = float(level.value(e[:, None], eps[:, :, None])[0])
    if not size > 0:
        return -np.inf, np.zeros_like(end)
    along, along_eps = level.gradient(e, eps)
    return float(np.log(size)), np.concatenate([along, along_eps.ravel() if q else []]) / size


def ascend(flow: Flow, starts: StartSet, start: Pair, objective: Objective) -> Pair:
    """A start, e (n m,) and eps (n, q), that ends farther away than ``start``; ``start`` itself if
    none is found."""
    lengths = np.concatenate([part.ravel() for part in starts.reach])
    shape = start[1].shape
    best = np.concatenate([start[0], start[1].ravel()])

    def evaluated(at: Array) -> tuple[float, Array]:
        end = flow.end(at)
        return objective(end) if np.isfinite(end).all() else (-np.inf, np.zeros_like(at))

    def gradient_of(at: Array, weight: Array) -> Array:
        found = flow.pull(at, weight)[1]
        return found if np.isfinite(found).all() else np.zeros_like(at)  # 0 ends the ascent

    value, weight = evaluated(best)
    gradient, step = gradient_of(best, weight), FIRST_STEP
    for _ in range(EVALUATIONS):
        scaled = gradient * lengths
        largest = float(np.max(np.abs(scaled), initial=0.0))
        if not 0 < largest < np.inf or step < LEAST_STEP:
            break
        moved = best + step * lengths * scaled / largest
        e, eps = starts.project(
            moved[: flow.rows, None], moved[flow.rows :].reshape(shape)[:, :, None]
        )
        moved = np.concatenate([e[:, 0], eps[:, :, 0].ravel()])
        found, weight = evaluated(moved)
        if found > value:
            best, value, gradient, step = moved, found, gradient_of(moved, weight), step * GROWTH
        else:
            step *= SHRINKAGE
    return best[: flow.rows], best[flow.rows :].reshape(shape)


Vectors = Callable[[Array], Array]
STARTS, LEAST_STARTS = 48, 8  # of each kind: shared among the modes at most, in every mode at least
# starts of one kind times rows, or times arcs: a second or so in all
MOST_ROWS, MOST_ARCS = 1500, 60_000
MOST_PROVED = 4  # roots of one mode for which a proof is tried, the nearest to the target first
ROUGH = 1e-6  # tolerance of the runs, whose ends are only points to begin with
# most steps of each, and most steps times characters of the couplings
ROUGH_STEPS, ROUGH_WORK = 3000, 600_000
SAMPLES = 21
STEPS = 60
CLOSE = 1e-11  # |F|_inf of a root, relative to the slopes and to the size of e
RUNS_WORK, ROOT_WORK = 5000, 300  # steps of work for the runs of one mode, and for one root
AT_TARGET = 1e-4  # |e|_inf below which a root is the target, relative to the farthest point
SAME = 1e-6  # relative distance of roots that are one


def equilibrium_check(problem: Problem) -> Check | None:
    """Look for a second equilibrium in the region asked for; the check that refutes, or None, which
    says nothing.  It takes the work of one stage: of very many modes only the first are looked
    at."""
    known = problem.region is not None and problem.node is None and problem.leader is None
    if not known or problem.n * problem.m > LARGEST:
        return None
    best = None
    with surviving("the search for equilibria failed"), np.errstate(all="ignore"):
        found = list[Equilibrium]()
        with at_most(STAGE), suppress(WorkLimitError):
            for claim in _in_modes(problem):
                found.append(claim)
        best = min(found, key=lambda claim: float(np.max(np.abs(point_of(claim)))), default=None)
    return None if best is None else refuting_check(problem, best)


def _in_modes(problem: Problem) -> Iterator[Equilibrium]:
    """The nearest proved equilibrium of each mode that has one."""
    arena = sets.make_arena(problem, no_gain(problem))  # eps = 0
    box = sets.asked_box(problem, arena.loop, disturbance=0.0)
    arcs = sum(len(each) for each in problem.network.modes.values())
    shared = min(STARTS, MOST_ROWS // (problem.n * problem.m)) // len(arena.modes)
    count = max(LEAST_STARTS, min(shared, MOST_ARCS // max(1, arcs)))  # of one kind in one mode
    length = sum(len(text) for coupling in problem.couplings for text in coupling.texts)
    most = max(1, min(ROUGH_STEPS, ROUGH_WORK // length))
    horizon, rng = sets.settling_horizon(problem), np.random.default_rng(0)
    for number, mode in enumerate(arena.modes):
        if not may_stay(problem, mode) or unreached(problem, [problem.network.modes[mode]]):
            continue  # what rests in such a mode is moved by others: no refutation by the contract
        spend(RUNS_WORK)
        e = np.concatenate(
            [box.draw(rng, count, kind)[0] for kind in (sets.CORNERS, sets.RANDOM)], axis=1
        )
        none, constant = (
            np.zeros((problem.n, problem.q, 2 * count)),
            sets.constant_signals(np.full(2 * count, number)),
        )
        rough = partial(
            sets.run_starts, horizon=horizon, tolerance=ROUGH, samples=SAMPLES, most=most
        )
        runs = rough(arena, e, none, constant)
        points = [*runs.ends.T[runs.stalled & ~runs.diverged], *e.T]
        yield from proved_equilibria(problem, mode, points, starts=box, within_region=True, most=1)


def proved_equilibria(
    problem: Problem,
    mode: str,
    points: Sequence[Array],
    *,
    starts: sets.StartSet,
    within_region: bool = False,
    most: int = MOST_PROVED,
) -> list[Equilibrium]:
    """Proved equilibria of one mode in the set of starts that the points lead to, the nearest to
    the target first."""
    roots = [root for root in find_roots(problem, mode, points) if starts.holds(root)]
    roots.sort(key=lambda root: float(np.max(np.abs(root))))
    nearest = roots[:MOST_PROVED]
    enclose = partial(enclose_equilibrium, problem, mode, within_region=within_region)
    found = list(
        islice((claim for root in nearest if (claim := enclose(root.tolist())) is not None), most)
    )
    if found and found[0].is_point:  # one of many: the farthest shows the most
        farthest = enclose(roots[-1].tolist())
        return found if farthest is None else [farthest]
    return found


def point_of(claim: Equilibrium) -> Array:
    """The middle of the box as floats, (n m,)."""
    return np.array([float(c) for c in claim.middle])


def find_roots(problem: Problem, mode: str, points: Sequence[Array]) -> Iterator[Array]:
    """Roots other than the target that the points lead to, each once, as they are found."""
    # eps = 0
    model, K = build_model(problem, mode, gain=no_gain(problem)), pinning_matrix(problem).toarray()
    known = list[Array]()

    def value(e: Array) -> Array:
        return np.asarray(np.asarray(model.h(e)).ravel() - K @ e)

    def slope(e: Array) -> Array:
        return np.asarray(model.jacobian(e).full() - K)

    least = AT_TARGET * max((float(np.max(np.abs(point))) for point in points), default=0.0)
    for point in points:
        spend(ROOT_WORK)
        root = _root(value, slope, point, least)
        if root is not None and all(
            np.max(np.abs(root - other)) > SAME * np.max(np.abs(root)) for other in known
        ):
            known.append(root)
            yield root


def _root(value: Vectors, slope: Vectors, start: Array, least: float) -> Array | None:
    """A root with |e|_inf > ``least`` of a function with this derivative, or None."""
    found = optimize.root(
        value, start, jac=slope, method="lm", options={"maxiter": STEPS, "xtol": 0.0, "ftol": 0.0}
    )
    e, J, reach = found.x, slope(found.x), float(np.max(np.abs(found.x)))
    close = np.max(np.abs(value(e))) <= CLOSE * np.abs(J).sum(axis=1).max() * reach  # never for nan
    return np.asarray(e) if close and least < reach < np.inf else None
