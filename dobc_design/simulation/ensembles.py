"""Running many simulations of one problem: side by side in chunks that bound the memory.

Run r has the seed ``seed + r``, so it does not depend on how many runs there are nor on the chunks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.problem.arrays import Gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import whole
from dobc_design.simulation.agents_stack import StressedRuns
from dobc_design.simulation.closed_form import ClosedForm
from dobc_design.simulation.columns import COLLAPSED, ESCAPED, HANDED_BACK, Ends
from dobc_design.simulation.ensemble import Ensemble
from dobc_design.simulation.field import Network, network_of
from dobc_design.simulation.integrate import FARTHEST
from dobc_design.simulation.mobile import Mobile
from dobc_design.simulation.run import run_once
from dobc_design.simulation.sampled_stack import SampledEnds, run_sampled_stack
from dobc_design.simulation.setting import (
    TOLERANCE,
    Progress,
    Setting,
    closed_form_of,
    describe,
    groups_for,
    is_stiff,
    make_setting,
    switches_for,
)
from dobc_design.simulation.signal_files import Signal, signal_to_json
from dobc_design.simulation.stacked import Stack, integrate_stack
from dobc_design.simulation.starts import Given
from dobc_design.simulation.stress import Stress, stress_to_json
from dobc_design.simulation.stressed_stack import Forms, make_forms, run_stressed_stack
from dobc_design.simulation.switches import Array, IndexArray, Switches

Networks = Callable[[int], Network]

COLUMN_NUMBERS = 1 << 15  # states n m of the runs of one chunk; some 60 arrays of this size are in use
MOST_STORED = 1 << 28  # numbers of an ensemble that keeps its states: 2 GiB


def simulate_many(
    problem: Problem,
    *,
    runs: int,
    mode: str | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    gain: Gain | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = "closed-form",
    tolerance: float = TOLERANCE,
    states: bool = False,
    stress: Stress | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate ``runs`` runs with the seeds seed, seed + 1, ...: each with its own start and its own switches.

    Arguments as in ``simulate``.  ``states`` keeps x at every sample, not the errors alone.
    Returns: an Ensemble.  Raises: SpecError for a wrong argument.
    """
    whole(runs, "runs", least=1)
    setting = make_setting(
        problem,
        mode=mode,
        signal=signal,
        start=start,
        t_final=t_final,
        seed=seed,
        gain=gain,
        samples=samples,
        observer=observer,
        tolerance=tolerance,
        stress=stress,
    )
    if states and runs * len(setting.times) * problem.n * problem.m > MOST_STORED:
        raise SpecError(
            f"states of {runs} runs at {len(setting.times)} samples would take more than {MOST_STORED >> 27} GiB.",
            key="states",
            cure="Ask for fewer samples or runs, or keep the errors only.",
        )
    with np.errstate(all="ignore"):
        return _Collector(setting, runs, states=states, progress=progress).run()


class _Collector:
    def __init__(self, setting: Setting, runs: int, *, states: bool, progress: Progress | None) -> None:
        self.setting, self.runs, self.report = setting, runs, progress or (lambda part: None)
        shape = (runs, len(setting.times))
        self.error, self.estimation = np.full(shape, np.nan), np.full(shape, np.nan)
        loop = setting.loop
        self.states = np.full((*shape, loop.n, loop.m), np.nan) if states else None
        self.ended, self.count = np.full(runs, setting.horizon), np.zeros(runs, dtype=np.int64)
        self.lengths, self.disturbances = np.zeros(runs), np.zeros(runs)
        self.reasons: dict[int, str] = {}
        self.notes = [*setting.notes, *([] if setting.stress is None else [f"Stress: {setting.stress}."])]
        self.method = "DOP853, side by side"

    def run(self) -> Ensemble:
        """All runs, side by side where that is possible."""
        setting = self.setting
        self.report(0.0)
        closed = None if setting.observer == "full-loop" else closed_form_of(setting)
        heeds, forms = setting.observer != "off", None
        stress = setting.stress
        if stress is not None and stress.period is None:
            forms = make_forms(setting.loop, stress, setting.horizon, heeds=heeds)
        reason = self.reason_for_single_runs(closed, forms)
        if reason:
            self.notes.append(f"The runs were made one by one, because {reason}.")
            self.method = ""
            for run in range(self.runs):
                self.single(run)
                self.report((run + 1) / self.runs)
        elif stress is not None:
            self.stressed_chunks(stress, forms)
        else:
            self.chunks(closed)
        return self.result()

    def reason_for_single_runs(self, closed: ClosedForm | None, forms: Forms | None) -> str:
        """Why the runs cannot be stacked; "" if they can."""
        setting, stress = self.setting, self.setting.stress
        if self.moves_by_state():
            return "every run has graphs of its own"
        if setting.loop.own is not None and stress is not None and stress.period is None and stress.disturbance:
            return "the agents have different exosystems, and none of them knows the disturbance that was added"
        if stress is not None and stress.period is not None:
            return ""
        if setting.observer == "full-loop":
            return "the full loop was asked for"
        if setting.loop.q and (closed if stress is None else forms) is None:
            return "the observer is too fast for its closed form"
        return "the loop is stiff" if is_stiff(setting, closed=True) else ""

    def moves_by_state(self) -> bool:
        """Whether the graphs follow from the states."""
        return isinstance(self.setting.signal, Mobile) and self.setting.signal.motion is None

    def stressed_chunks(self, stress: Stress, forms: Forms | None) -> None:
        """Runs under a stress side by side, a bounded number at a time; sampled ones need no ``forms``."""
        setting, loop = self.setting, self.setting.loop
        shared = switches_for(setting, setting.seed)
        arcs = sum(graph.shape[1] for graph in shared.graphs) or sum(map(len, setting.problem.network.modes.values()))
        room = min(COLUMN_NUMBERS // (loop.n * loop.m), 8 * COLUMN_NUMBERS // (max(1, arcs) * loop.m))
        size, groups = max(1, min(self.runs, room)), groups_for(setting, shared)
        for first in range(0, self.runs, size):
            chosen = range(first, min(self.runs, first + size))
            seeds = [setting.seed + run for run in chosen]
            runs = StressedRuns(
                loop=loop,
                stress=stress,
                failing=stress.failing(setting.problem),
                heeds=setting.observer != "off",
                groups=groups,
                starts=[setting.starts.draw(seed) for seed in seeds],
                seeds=seeds,
                switches=[shared if shared.graphs else switches_for(setting, seed) for seed in seeds],
            )
            self.note_starts(chosen, runs)
            if forms is None:
                self.method = f"exact steps of {stress.period:g} s, side by side"
                ends = run_sampled_stack(
                    runs, setting.times, visit=self.sampled_visitor(chosen), progress=self.part_of(chosen)
                )
                self.note_sampled_ends(chosen, ends, runs)
            else:
                stopped = run_stressed_stack(
                    runs,
                    forms,
                    setting.times,
                    tolerance=setting.tolerance,
                    visit=self.visitor(chosen),
                    estimate=self.estimator(chosen),
                    progress=self.part_of(chosen),
                )
                self.note_ends(chosen, stopped, runs.switches)

    def estimator(self, chosen: range) -> Callable[[int, IndexArray, Array], None]:
        """What puts the errors of estimates into their places."""

        def estimate(sample: int, run: IndexArray, gap: Array) -> None:
            self.estimation[chosen.start + run, sample] = gap

        return estimate

    def part_of(self, chosen: range) -> Progress:
        """Report how much of all runs is done when a part of the chosen ones is."""
        return lambda part: self.report((chosen.start + part * len(chosen)) / self.runs)

    def note_starts(self, chosen: range, runs: StressedRuns) -> None:
        """How far away the runs begin."""
        for run, start in zip(chosen, runs.starts, strict=True):
            self.lengths[run] = np.linalg.norm(start.x - self.setting.loop.goal)
            self.disturbances[run] = np.linalg.norm(start.xi - start.xihat, axis=1).max(initial=0.0)

    def sampled_visitor(self, chosen: range) -> Callable[[int, Array, Array], None]:
        """What puts samples into their places."""
        rows, goal = slice(chosen.start, chosen.stop), self.setting.loop.goal[..., None]

        def visit(sample: int, x: Array, gap: Array) -> None:
            self.error[rows, sample] = np.abs(x - goal).max(axis=(0, 1))
            self.estimation[rows, sample] = np.abs(gap).max(axis=(0, 1))
            if self.states is not None:
                self.states[rows, sample] = np.moveaxis(x, 2, 0)

        return visit

    def note_sampled_ends(self, chosen: range, ends: SampledEnds, runs: StressedRuns) -> None:
        """Reasons for early ends, and how often every run switched."""
        for row, run in enumerate(chosen):
            count, times = int(ends.counts[row]), runs.switches[row].times
            self.count[run] = np.searchsorted(times, self.setting.times[count - 1], side="right") - 1
            if row in ends.reasons:
                self.reasons[run], self.ended[run] = ends.reasons[row], self.setting.times[count - 1]
                self.error[run, count:] = self.estimation[run, count:] = np.nan
                if self.states is not None:
                    self.states[run, count:] = np.nan
            else:
                self.count[run] = len(times) - 1

    def chunks(self, closed: ClosedForm | None) -> None:
        """Side by side, a bounded number of runs at a time."""
        loop = self.setting.loop
        size = max(1, min(self.runs, COLUMN_NUMBERS // (loop.n * loop.m)))
        shared: Switches | None = None
        if isinstance(self.setting.signal, Mobile):  # a given motion: the same for all runs
            shared = switches_for(self.setting, self.setting.seed)
        groups = groups_for(self.setting, shared or switches_for(self.setting, self.setting.seed))

        @cache
        def networks(mode: int) -> Network:
            return network_of(loop, groups(mode), runs=size)

        for first in range(0, self.runs, size):
            chosen = range(first, min(self.runs, first + size))
            switches = [shared or switches_for(self.setting, self.setting.seed + run) for run in chosen]
            stack = self.stack(chosen, switches, closed, networks)
            ends = integrate_stack(
                stack, self.setting.times, tolerance=self.setting.tolerance, visit=self.visitor(chosen)
            )
            self.estimate(chosen, stack)
            self.note_ends(chosen, ends, switches)
            self.report((chosen[-1] + 1) / self.runs)

    def stack(self, chosen: range, switches: list[Switches], closed: ClosedForm | None, networks: Networks) -> Stack:
        """The starts and switches of some runs as columns."""
        loop = self.setting.loop
        starts = [self.setting.starts.draw(self.setting.seed + run) for run in chosen]
        longest = max(map(len, switches))
        times, modes = np.full((len(chosen), longest), np.inf), np.zeros((len(chosen), longest), dtype=np.int64)
        for row, each in enumerate(switches):
            times[row, : len(each)], modes[row, : len(each)] = each.times, each.modes
        e = np.stack([(start.x - loop.goal).ravel() for start in starts], axis=1)
        eps = np.stack([start.xi - start.xihat for start in starts], axis=2)
        self.lengths[chosen.start : chosen.stop] = np.linalg.norm(e, axis=0)
        self.disturbances[chosen.start : chosen.stop] = np.linalg.norm(eps, axis=1).max(axis=0, initial=0.0)
        return Stack(loop=loop, networks=networks, closed=closed, e=e, eps=eps, switch_times=times, switch_modes=modes)

    def visitor(self, chosen: range) -> Callable[[IndexArray, IndexArray, Array], None]:
        """What puts samples into their places."""
        loop = self.setting.loop

        def visit(sample: IndexArray, run: IndexArray, e: Array) -> None:
            self.error[chosen.start + run, sample] = np.abs(e).max(axis=0)
            if self.states is not None:
                self.states[chosen.start + run, sample] = e.T.reshape(-1, loop.n, loop.m) + loop.goal

        return visit

    def estimate(self, chosen: range, stack: Stack) -> None:
        """|d - dhat|_inf in closed form."""
        rows = slice(chosen.start, chosen.stop)
        self.estimation[rows] = 0.0
        if stack.closed is None:
            return
        weights = stack.closed.many(self.setting.times)
        for place in range(len(self.setting.times)):
            gaps = np.tensordot(weights[:, :, place], stack.eps, axes=(1, 1))
            self.estimation[rows, place] = np.abs(gaps).max(axis=(0, 1))

    def note_ends(self, chosen: range, ends: Ends, switches: Sequence[Switches]) -> None:
        """How often every run switched, and reasons for early ends; runs that came back are made one by one."""
        self.count[chosen.start : chosen.stop] = [
            np.searchsorted(each.times, time, side="right") - 1 for each, time in zip(switches, ends.times, strict=True)
        ]
        for row in np.flatnonzero(ends.states >= ESCAPED):
            run, time = chosen[row], float(ends.times[row])
            if ends.states[row] == HANDED_BACK:
                self.single(run)
                continue
            self.ended[run] = time
            words = f"|e|_inf exceeded {FARTHEST:.0e} times its start at"
            if ends.states[row] == COLLAPSED:
                words = "the step size collapsed or the state overflowed just after"
            self.reasons[run] = f"{words} t = {time:.6g} s"
            late = self.setting.times > time
            self.error[run, late] = self.estimation[run, late] = np.nan

    def single(self, run: int) -> None:
        """One run by itself."""
        done = run_once(self.setting, self.setting.seed + run)
        count = int(np.searchsorted(self.setting.times, done.times[-1], side="right"))
        self.error[run], self.estimation[run] = np.nan, np.nan
        self.error[run, :count] = done.error()[:count]
        self.estimation[run, :count] = done.estimation_error()[:count]
        if self.states is not None:
            self.states[run, :count] = done.x[:count]
        self.ended[run], self.count[run] = done.times[-1], len(done.switches) - 1
        _, self.lengths[run], self.disturbances[run] = done.start_size()
        if done.diverged:
            self.reasons[run] = done.reason
        names = [name for name in (self.method, done.method) if name]
        self.method = "; ".join(dict.fromkeys("; ".join(names).split("; ")))

    def result(self) -> Ensemble:
        """Everything as one noun."""
        setting, problem = self.setting, self.setting.problem
        diverged = np.zeros(self.runs, dtype=bool)
        diverged[list(self.reasons)] = True
        return Ensemble(
            name=problem.name,
            mode=describe(setting.signal, problem),
            labels=problem.network.labels,
            t_final=setting.horizon,
            seeds=setting.seed + np.arange(self.runs),
            times=setting.times,
            error=self.error,
            estimation_error=self.estimation,
            diverged=diverged,
            ended=self.ended,
            switches=self.count,
            reasons=dict(sorted(self.reasons.items())),
            goal=setting.loop.goal,
            states=self.states,
            method=self.method,
            notes=tuple(self.notes),
            signal=signal_to_json(setting.signal),
            observer=setting.observer,
            stress="" if setting.stress is None else stress_to_json(setting.stress),
            lengths=self.lengths,
            disturbances=self.disturbances,
        )
