"""Runs of a setting: one by itself, calm, under a stress or sampled; or many, side by side where
that can be, and what they come to as an ensemble.

Run r of many has the seed ``seed + r``, with its own start and its own switches.
"""

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from dobc_design._checks import noun
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Texts
from dobc_design.problem.network import IndexArray

from ._arguments import whole
from .agents import StressedRuns
from .closed_form import ClosedForm, evolve
from .columns import COLUMN_NUMBERS, CalmColumns
from .field import Active, Networks, largest, network_of
from .integrate import Integration, Outcome, Progress, Samples, errors, silent
from .measures import length_of_pairs
from .mobile import Modes, Nearby
from .outputs import with_disturbances
from .sampled import Stepper, run_sampled_alone
from .setting import WITHOUT, Setting
from .signals import Mobile
from .starts import Start
from .stressed import Together, run_alone
from .switches import Planned, Switches, table_of
from .trajectory import SAMPLED, Ensemble, Trajectory

MOST_KEPT = 100_000_000  # samples of all runs of an ensemble, two numbers of each: 1.6 GB
# whose states an ensemble keeps, and how many numbers at most
DRAWN_RUNS, MOST_STATES = 5, 2_000_000
ARCS = 8  # COLUMN_NUMBERS so many times: arcs of the runs of a chunk that hold what they heard


def run_once(
    setting: Setting, *, seed: int | None = None, progress: Progress = silent
) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    seed = setting.seed if seed is None else seed
    setting = setting.of_seed(seed)
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a
    # warning.
    with np.errstate(all="ignore"):
        start = setting.starts.draw(seed)
        modes = _modes(setting, seed)
        if setting.is_full:
            outcome = _full(setting, start, seed, modes, progress)
        else:
            outcome = _calm(setting, start, modes, progress)
    return _trajectory(setting, seed, modes, outcome)


def _trajectory(setting: Setting, seed: int, modes: Modes, outcome: Outcome) -> Trajectory:
    """The run as it is shown."""
    run = outcome.run
    seen = outcome.samples
    switches = modes.switches
    if run.reason:  # those up to where the run ended
        switches = switches.until(float(run.times[-1]))
    return Trajectory(
        **setting.facts,
        **{name: getattr(seen, name) for name in SAMPLED},
        seed=seed,
        times=run.times,
        diverged=bool(run.reason),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=(*setting.notes, *run.notes, *setting.stress_notes),
        switches=switches,
        leader=np.zeros(0) if seen.leader is None else seen.leader,
    )


def _modes(setting: Setting, seed: int) -> Modes:
    """The modes of the run of one seed."""
    signal = setting.signal
    if isinstance(signal, Mobile) and signal.motion is None:
        return Nearby(signal, setting.exact, setting.horizon)
    drawn = setting.switches(seed)
    return Planned(drawn, partial(setting.groups_of, drawn), setting.horizon)


def _full(setting: Setting, start: Start, seed: int, modes: Modes, progress: Progress) -> Outcome:
    """A run of the full loop as printed, or under a stress: a stack of one."""
    runs = StressedRuns(
        setting=setting,
        starts=[start],
        seeds=[seed],
        switches=[modes.switches],
        nearby=modes if isinstance(modes, Nearby) else None,
    )
    if setting.stress.period is not None:
        return run_sampled_alone(runs, progress)
    return run_alone(runs, modes, progress)


def _calm(setting: Setting, start: Start, modes: Modes, progress: Progress) -> Outcome:
    """A run without stress: e with eps in closed form, else both of them."""
    loop = setting.loop
    F = setting.residual_matrix
    eps0 = start.eps
    closed = setting.closed_form()
    both = loop.q > 0 and closed is None
    # xihat = xi - eps: nothing else of the observer has to be integrated
    e0 = start.state(loop)
    state = np.concatenate([e0, eps0.ravel()]) if both else e0
    integration = Integration(
        plan=errors(loop, modes, closed, eps0, F),
        state=state,
        times=setting.times,
        tolerance=setting.tolerance,
        implicit=setting.is_stiff(closed=not both),
        report=progress,
    )
    run = integration.run()
    if both:
        note = "The observer is too fast for its closed form: its error was integrated as well."
        run.notes.append(note)
    cut = len(e0)
    xi = evolve(with_disturbances(loop).A, start.xi, run.times)
    eps = run.states[:, cut:].reshape(xi.shape) if both else evolve(F, eps0, run.times)
    active = Active(modes.switches.names, modes.switches.at(run.times))
    return Outcome(run=run, samples=_samples(setting, run.states[:, :cut], xi, eps, active))


def _samples(setting: Setting, states: Array, xi: Array, eps: Array, active: Active) -> Samples:
    """What is seen of the errors, flat and those of a leader after them: (T, n m) or more."""
    loop = with_disturbances(setting.loop)
    e, s = np.split(states, [loop.size], axis=1)
    e = e.reshape(-1, loop.n, loop.m)
    x = e + loop.goal
    if loop.lead:
        x = x + s[:, None]
    if loop.sensed is not None and loop.sensed.estimated:
        x = x + eps @ loop.sensed.x.T
    xihat = np.zeros_like(xi) if setting.observer == WITHOUT else xi - eps
    dhat = xihat @ loop.output.T
    return Samples(
        x=x,
        xi=xi[..., loop.of_xi],
        xihat=xihat[..., loop.of_xi],
        d=xi @ loop.output.T,
        dhat=dhat,
        u=loop.control(e, dhat, active),
        leader=s if loop.lead else None,
    )


def run_many(setting: Setting, runs: int, *, progress: Progress = silent) -> Ensemble:
    """``runs`` runs with the seeds seed, seed + 1, ...: each with its own start and its own
    switches."""
    # refused before anything is made
    most = MOST_KEPT // len(setting.times)
    if whole(runs, "runs", least=1) > most:
        message = f"must be at most {most} with {len(setting.times)} samples of each; got {runs}."
        cure = "Make several ensembles with other seeds, or ask for fewer samples."
        raise wrong("runs", message, cure)
    with np.errstate(all="ignore"):
        return _Collector(setting=setting, runs=runs, report=progress).run()


def _why_one_by_one(setting: Setting, closed: ClosedForm | None) -> str:
    """Why the runs cannot be made side by side, or ""."""
    if setting.is_moving:
        return "every run has graphs of its own"
    if setting.loop.moves:
        return "fixed nodes move"
    if setting.exact.sensed:
        return "states are estimated"
    if setting.stress.period is not None:
        return ""
    if setting.stress.worst and setting.stress.disturbance:
        return "the disturbance of every run switches at times of its own"
    if setting.loop.q and closed is None and not setting.is_full:
        return "the observer is too fast for its closed form"
    return "the loop is stiff" if setting.is_stiff(closed=not setting.is_full) else ""


@dataclass(kw_only=True, eq=False)
class _Collector:
    """Puts what the runs come to into the arrays of an ensemble."""

    setting: Setting
    runs: int
    report: Progress

    def __post_init__(self) -> None:
        setting = self.setting
        runs = self.runs
        self.method = "DOP853, side by side"
        self.reasons: dict[int, str] = {}
        shape = (len(setting.times), setting.loop.n, setting.loop.m)
        # the states of all runs would take too much memory
        drawn = min(runs, DRAWN_RUNS, MOST_STATES // int(np.prod(shape)))
        self.states = np.full((drawn, *shape), np.nan)
        self.leader = np.zeros((drawn, shape[0], shape[2]))
        self.error = np.full((runs, shape[0]), np.nan)
        self.estimation = np.full((runs, shape[0]), np.nan)
        self.ended = np.full(runs, setting.horizon)
        self.count = np.zeros(runs, dtype=np.int64)
        self.lengths = np.zeros(runs)
        self.disturbances = np.zeros(runs)

    def run(self) -> Ensemble:
        """Make all runs."""
        setting = self.setting
        notes = [*setting.notes, *setting.stress_notes]
        self.report(0.0)
        # the full loop integrates the observer as well
        closed = None if setting.is_full else setting.closed_form()
        reason = _why_one_by_one(setting, closed)
        if reason:
            notes.append(f"The runs were made one by one, because {reason}.")
            self.method = ""
            for run in range(self.runs):
                self.alone(run)
                self.report((run + 1) / self.runs)
        else:
            self.side_by_side(closed)
        return self.ensemble(tuple(notes))

    def ensemble(self, notes: Texts) -> Ensemble:
        """What was collected."""
        setting = self.setting
        # whoever has a reason ended early
        diverged = np.zeros(self.runs, dtype=bool)
        diverged[list(self.reasons)] = True
        if self.runs > 1 and np.allclose(self.error, self.error[0], equal_nan=True):
            notes = (*notes, "All runs are alike: nothing in them is drawn at random.")
        return Ensemble(
            **setting.facts,
            seeds=setting.seed + np.arange(self.runs),
            times=setting.times,
            error=self.error,
            estimation_error=self.estimation,
            diverged=diverged,
            ended=self.ended,
            switches=self.count,
            reasons=dict(sorted(self.reasons.items())),
            method=self.method,
            notes=notes,
            lengths=self.lengths,
            disturbances=self.disturbances,
            states=self.states,
            leader=self.leader,
        )

    def side_by_side(self, closed: ClosedForm | None) -> None:
        """All runs, a bounded number at a time; a given motion gives all of them the same
        switches."""
        setting = self.setting
        shared = setting.switches(setting.seed)
        groups = partial(setting.groups_of, shared)
        size = self.chunk_size(shared)
        # the blocks of a network fit the number of runs; all chunks share them
        networks = cache(lambda mode: network_of(setting.loop, groups(mode), runs=size))
        for first in range(0, self.runs, size):
            chosen = np.arange(first, min(self.runs, first + size))
            seeds = (setting.seed + chosen).tolist()
            switches = [shared] * len(seeds)
            if not shared.graphs:
                switches = [setting.switches(seed) for seed in seeds]
            runs = StressedRuns(
                setting=setting,
                starts=[setting.starts.draw(seed) for seed in seeds],
                seeds=seeds,
                switches=switches,
            )
            chunk = _Chunk(collector=self, chosen=chosen, runs=runs)
            chunk.put_starts()
            if not setting.is_full:
                chunk.calm(closed, networks)
            elif setting.stress.period is not None:
                chunk.sampled()
            else:
                chunk.stressed()

    def chunk_size(self, shared: Switches) -> int:
        """How many runs are made at once."""
        setting = self.setting
        loop = setting.loop
        room = COLUMN_NUMBERS // loop.size
        if setting.is_full:
            modes = setting.problem.network.modes.values()
            arcs = sum(each.shape[1] for each in shared.graphs) or sum(map(len, modes))
            room = min(room, ARCS * COLUMN_NUMBERS // (max(1, arcs) * loop.m))
        return max(1, min(self.runs, room))

    def alone(self, run: int) -> None:
        """Make one run by itself."""
        done = run_once(self.setting, seed=self.setting.seed + run)
        # samples that were reached; steps after them, of a run that diverged, are left out
        count = int(np.searchsorted(self.setting.times, done.times[-1], side="right"))
        self.error[run] = np.nan
        self.error[run, :count] = done.error()[:count]
        self.estimation[run] = np.nan
        self.estimation[run, :count] = done.estimation_error()[:count]
        # a slice: the states of later runs are not kept
        self.states[run : run + 1] = np.nan
        self.states[run : run + 1, :count] = done.x[:count]
        self.leader[run : run + 1, :count] = done.leader[:count]
        self.ended[run] = done.times[-1]
        self.count[run] = len(done.switches) - 1
        _, self.lengths[run], self.disturbances[run] = done.start_size()
        if done.diverged:
            self.reasons[run] = done.reason
        # every method once, in the order of the runs
        names = self.method.split("; ") if self.method else []
        if done.method:
            names += done.method.split("; ")
        self.method = "; ".join(dict.fromkeys(names))


@noun(eq=False)
class _Chunk:
    """Runs that are made at once: ``chosen`` (k,) are their places in the ensemble."""

    collector: _Collector
    chosen: IndexArray
    runs: StressedRuns

    @property
    def setting(self) -> Setting:
        return self.collector.setting

    def put_starts(self) -> None:
        """How large the starts are."""
        loop = self.setting.loop
        for run, start in zip(self.chosen, self.runs.starts, strict=True):
            e = start.errors(loop)
            length = length_of_pairs(e, loop.sides) if loop.sides.size else np.linalg.norm(e)
            self.collector.lengths[run] = length
            eps = np.linalg.norm(start.eps, axis=1)
            self.collector.disturbances[run] = eps.max(initial=0.0)

    def report(self, part: float) -> None:
        """So much of the chunk is done."""
        done = int(self.chosen[0]) + part * len(self.chosen)
        self.collector.report(done / self.collector.runs)

    def calm(self, closed: ClosedForm | None, networks: Networks) -> None:
        """Without stress: e alone, eps in closed form."""
        setting = self.setting
        eps = self.runs.stacked("eps")
        columns = CalmColumns(
            loop=setting.loop,
            networks=networks,
            closed=closed,
            e=np.stack([start.state(setting.loop) for start in self.runs.starts], axis=1),
            eps=eps,
            switches=table_of(self.runs.switches),
        )
        self.put_estimation(closed, eps)
        ends = columns.integrate(setting.times, tolerance=setting.tolerance, visit=self.put_errors)
        self.report(1.0)
        self.put_ends(ends.times, ends.reasons())

    def put_estimation(self, closed: ClosedForm | None, eps: Array) -> None:
        """|d - dhat|_inf at all samples, which does not depend on the network."""
        setting = self.setting
        estimation = self.collector.estimation
        estimation[self.chosen] = 0.0
        if closed is None:
            return
        weights = np.moveaxis(closed.many(setting.times), 2, 0)
        if setting.loop.plant is not None:  # from states to inputs
            weights = np.linalg.pinv(setting.loop.plant.B) @ weights
        for place, weight in enumerate(weights):
            gap = np.tensordot(weight, eps, axes=(1, 1))
            estimation[self.chosen, place] = largest(gap)

    def stressed(self) -> None:
        """Under a stress in continuous time, or the full loop."""
        ends = Together(self.runs, self.put).run(self.report)
        self.put_ends(ends.times, ends.reasons())

    def sampled(self) -> None:
        """From sample to sample."""
        every = np.arange(len(self.chosen))
        goal = self.setting.loop.goal[..., None]

        def visit(number: int, seen: Samples) -> None:
            places = np.full(len(every), number)
            self.put(places, every, seen.x - goal, seen.d - seen.dhat)

        stepper = Stepper(self.runs, visit, self.report)
        self.collector.method = f"{stepper.method}, side by side"
        stepper.run()
        self.put_ends(self.setting.times[stepper.counts - 1], stepper.reasons)

    def put(self, sample: IndexArray, run: IndexArray, e: Array, gap: Array) -> None:
        """Errors e and d - dhat, (n, m, k) each, of runs of the chunk at their samples, (k,)
        each."""
        self.put_errors(sample, run, e)
        self.collector.estimation[self.chosen[run], sample] = largest(gap)

    def put_errors(self, sample: IndexArray, run: IndexArray, e: Array) -> None:
        """Errors alone; or flat, and a leader after them, (n m, k) or more."""
        collector = self.collector
        loop = self.setting.loop
        e, s = np.split(e.reshape(-1, len(run)), [loop.size])
        runs = self.chosen[run]
        far = loop.far(e.reshape(loop.n, loop.m, -1))
        collector.error[runs, sample] = far.max(axis=(0, 1))
        # of the first runs the states are kept, too
        own = runs < len(collector.states)
        kept = (runs[own], sample[own])
        if len(s):
            collector.leader[kept] = s[:, own].T
        leader = collector.leader[kept]
        states = e[:, own].T.reshape(-1, loop.n, loop.m) + loop.goal
        collector.states[kept] = states + leader[:, None]

    def put_ends(self, times: Array, reasons: dict[int, str]) -> None:
        """When the runs ended, in s, (k,), and why some did early; those that were handed back, ""
        in place of a reason, are made alone."""
        collector = self.collector
        for row, switches in enumerate(self.runs.switches):
            passed = np.searchsorted(switches.times, times[row], side="right")
            collector.count[self.chosen[row]] = passed - 1
        for row, reason in reasons.items():
            run = int(self.chosen[row])
            if not reason:
                collector.alone(run)
                continue
            time = times[row]
            # what an integrator left there belongs to no state of the run
            late = self.setting.times > time
            collector.ended[run] = time
            collector.reasons[run] = reason
            collector.error[run, late] = np.nan
            collector.estimation[run, late] = np.nan
            collector.states[run : run + 1, late] = np.nan
