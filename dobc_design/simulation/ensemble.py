"""Many simulated runs of one problem: side by side in chunks that bound the memory, and what they say together.

Run r has the seed ``seed + r``, so it does not depend on how many runs there are nor on the chunks.  An ensemble
illustrates; however many runs converge, nothing is proved.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.problem.arrays import ArcGroup, Gain
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import Array, whole
from dobc_design.simulation.columns import COLLAPSED, ESCAPED, HANDED_BACK, Ends, Stack, integrate_stack, padded
from dobc_design.simulation.field import ClosedForm, network_of
from dobc_design.simulation.integrate import FARTHEST, Progress
from dobc_design.simulation.run import run_once
from dobc_design.simulation.sampled import Sample, run_sampled
from dobc_design.simulation.setting import (
    Options,
    Setting,
    Start,
    closed_form_of,
    describe,
    groups_for,
    is_stiff,
    make_setting,
    moves_by_state,
    switches_for,
)
from dobc_design.simulation.signals import signal_to_json
from dobc_design.simulation.stress import Stress, stress_to_json
from dobc_design.simulation.stressed import StressedRuns, run_stressed
from dobc_design.simulation.switches import IndexArray, Switches
from dobc_design.simulation.trajectory import (
    Bounding,
    bound_of,
    final_errors,
    proportion_interval,
    quantile,
    quantile_interval,
    save_arrays,
    summary,
)

if TYPE_CHECKING:
    from dobc_design.plotting.look import Sheet
    from dobc_design.plotting.runs import Envelope

COLUMN_NUMBERS = 1 << 15  # states n m of the runs of one chunk; some 60 arrays of this size are in use
MOST_STORED = 1 << 28  # numbers of an ensemble that keeps its states: 2 GiB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ensemble(Shown):
    """Runs that differ by their seeds: starts and switches.  Arrays cannot be written to.

    Shapes: seeds (R,); times (T,) in s; error and estimation_error (R, T), |e|_inf and |d - dhat|_inf, nan from where
    a run that diverged had ended; diverged (R,); ended (R,) in s; switches (R,), how often a run switched;
    states (R, T, n, m) or None where nobody asked for them; goal (n, m); lengths (R,), the Euclidean |e| of all agents
    at the start; disturbances (R,), the largest |xi_i - xihat_i| there.  ``reasons`` says by run why it ended early;
    ``signal`` and ``stress`` are JSON, ``observer`` as in ``simulate``.
    ``simulate(problem, seed=seeds[r], ...)`` gives run r again, in full.
    """

    name: str
    mode: str
    labels: tuple[str, ...]
    t_final: float
    seeds: NDArray[np.int64]
    times: Array
    error: Array
    estimation_error: Array
    diverged: NDArray[np.bool_]
    ended: Array
    switches: NDArray[np.int64]
    reasons: dict[int, str]
    goal: Array
    states: Array | None
    method: str
    notes: tuple[str, ...]
    signal: str
    observer: str
    stress: str
    lengths: Array
    disturbances: Array
    loop_sha256: str = ""  # of the problem and W; "" where they were not recorded

    def __post_init__(self) -> None:
        for array in self._arrays().values():
            array.setflags(write=False)

    def _arrays(self) -> dict[str, Any]:
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}

    def __len__(self) -> int:
        return len(self.seeds)

    def start_size(self) -> tuple[float, float, float]:
        """Over all starts the largest |e|_inf, Euclidean |e| of all agents stacked, and |xi_i - xihat_i|."""
        return float(self.error[:, 0].max()), float(self.lengths.max()), float(self.disturbances.max())

    @property
    def final_error(self) -> Array:
        """|e|_inf at the end of every run, (R,)."""
        return final_errors(self.error)

    def quantiles(self, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
        """Quantiles of |e|_inf over the runs at every sample: (levels, T); a run that diverged counts as infinite."""
        return np.stack([quantile(self.error, level) for level in levels])

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return summary(self.times, self.error, self.diverged)

    def plot(self, *, certificate: Bounding | None = None, envelope: Envelope | None = None) -> Sheet:
        """Quantile bands of the errors over all runs.  ``certificate``, ``envelope``: as in ``Trajectory.plot``."""
        from dobc_design.plotting.runs import ensemble_sheet

        return ensemble_sheet(self, envelope=bound_of(self, certificate, envelope))

    def intervals(self, confidence: float = 0.95) -> dict[str, tuple[float, float] | None]:
        """Confidence intervals for a random run: median final error, probability of divergence.

        Free of assumptions on distributions (order statistics; Clopper and Pearson).  None: too few runs.
        """
        final = np.where(self.diverged, np.inf, self.final_error)
        return {
            "median_final_error": quantile_interval(final, 0.5, confidence),
            "probability_of_divergence": proportion_interval(int(self.diverged.sum()), len(self), confidence),
        }

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the arrays to ``path``, an .npz file for ``numpy.load``.  Raises: SpecError."""
        words = ("name", "mode", "labels", "t_final", "notes", "signal", "method", "observer", "stress")
        facts = {name: getattr(self, name) for name in words} | {"format": "dobc-ensemble", "version": 1}
        about = np.array(json.dumps(facts, ensure_ascii=False))
        return save_arrays(Path(path), {"about": about} | self._arrays(), force=force)

    def __str__(self) -> str:
        return f"{self.name}: {self._summary}"

    def __repr__(self) -> str:
        return f"<Ensemble of {self.name}: {self._summary}>"

    def _card(self) -> Card:
        return Card(title=self.name, text=self._summary, lines=self.notes)

    @property
    def _summary(self) -> str:
        bad = int(self.diverged.sum())
        final = np.sort(self.final_error)
        return (
            f'{len(self)} runs of {self.t_final:.4g} s, mode "{self.mode}",'
            f" {'none' if bad == 0 else bad} diverged, final |e|_inf {final[0]:.3g} to {final[-1]:.3g}"
        )


def simulate_many(
    problem: Problem,
    *,
    runs: int,
    gain: Gain | None = None,
    states: bool = False,
    progress: Progress | None = None,
    **given: Unpack[Options],
) -> Ensemble:
    """Simulate ``runs`` runs with the seeds seed, seed + 1, ...: each with its own start and its own switches.

    Arguments as in ``run.simulate``.  ``states`` keeps x at every sample, not the errors alone.
    Returns: an Ensemble.  Raises: SpecError for a wrong argument.
    """
    return run_many(make_setting(problem, gain=gain, **given), runs, states=states, progress=progress)


def run_many(setting: Setting, runs: int, *, states: bool = False, progress: Progress | None = None) -> Ensemble:
    """The same for checked arguments."""
    problem, runs = setting.problem, whole(runs, "runs", least=1)
    if states and runs * len(setting.times) * problem.n * problem.m > MOST_STORED:
        raise SpecError(
            f"states of {runs} runs at {len(setting.times)} samples would take more than {MOST_STORED >> 27} GiB.",
            key="states",
            cure="Ask for fewer samples or runs, or keep the errors only.",
        )
    with np.errstate(all="ignore"):
        return _Collector(setting, runs, states=states, progress=progress).run()


class _Collector:
    """Puts what the runs come to into the arrays of an ensemble."""

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
        setting, stress = self.setting, self.setting.stress
        self.report(0.0)
        closed = closed_form_of(setting) if stress is None and setting.observer != "full-loop" else None
        reason = self.reason_for_single_runs(closed)
        if reason:
            self.notes.append(f"The runs were made one by one, because {reason}.")
            self.method = ""
            for run in range(self.runs):
                self.single(run)
                self.report((run + 1) / self.runs)
        elif stress is not None:
            self.stressed_chunks(stress)
        else:
            self.chunks(closed)
        return self.result()

    def reason_for_single_runs(self, closed: ClosedForm | None) -> str:
        """Why the runs cannot be stacked; "" if they can."""
        setting, stress = self.setting, self.setting.stress
        if moves_by_state(setting):
            return "every run has graphs of its own"
        if stress is not None and stress.period is not None:
            return ""
        if stress is None and setting.observer == "full-loop":
            return "the full loop was asked for"
        if stress is None and setting.loop.q and closed is None:
            return "the observer is too fast for its closed form"
        return "the loop is stiff" if is_stiff(setting, closed=stress is None) else ""

    def chunked(self, room: int) -> Iterator[tuple[range, list[Switches]]]:
        """So many runs at a time, with their switches; a given motion gives all runs the same."""
        shared = switches_for(self.setting, self.setting.seed)
        size = max(1, min(self.runs, room))
        for first in range(0, self.runs, size):
            chosen = range(first, min(self.runs, first + size))
            seeds = (self.setting.seed + run for run in chosen)
            yield chosen, [shared if shared.graphs else switches_for(self.setting, seed) for seed in seeds]

    def groups(self) -> Callable[[int], Sequence[ArcGroup]]:
        """The arcs of a mode by its index."""
        return groups_for(self.setting, switches_for(self.setting, self.setting.seed))

    def chunks(self, closed: ClosedForm | None) -> None:
        """Calm runs side by side, a bounded number at a time."""
        setting, loop, groups = self.setting, self.setting.loop, self.groups()
        room = COLUMN_NUMBERS // (loop.n * loop.m)
        networks = cache(lambda mode: network_of(loop, groups(mode), runs=max(1, min(self.runs, room))))
        for chosen, switches in self.chunked(room):
            starts, rows = [setting.starts.draw(setting.seed + run) for run in chosen], slice(chosen.start, chosen.stop)
            self.note_starts(chosen, starts)
            e = np.stack([(start.x - loop.goal).ravel() for start in starts], axis=1)
            eps = np.stack([start.xi - start.xihat for start in starts], axis=2)
            times, modes = padded(switches)
            stack = Stack(
                loop=loop, networks=networks, closed=closed, e=e, eps=eps, switch_times=times, switch_modes=modes
            )

            def visit(sample: IndexArray, run: IndexArray, e: Array, first: int = chosen.start) -> None:
                self.put(sample, first + run, e.reshape(loop.n, loop.m, -1))

            ends = integrate_stack(stack, setting.times, tolerance=setting.tolerance, visit=visit)
            self.estimation[rows] = 0.0
            for place, weight in enumerate([] if closed is None else np.moveaxis(closed.many(setting.times), 2, 0)):
                gaps = np.tensordot(weight, eps, axes=(1, 1))
                self.estimation[rows, place] = np.abs(gaps).max(axis=(0, 1))
            self.note_ends(chosen, ends, switches)
            self.report(chosen.stop / self.runs)

    def stressed_chunks(self, stress: Stress) -> None:
        """Runs under a stress side by side, a bounded number at a time."""
        setting, loop, groups = self.setting, self.setting.loop, self.groups()
        graphs = switches_for(setting, setting.seed).graphs
        arcs = sum(graph.shape[1] for graph in graphs) or sum(map(len, setting.problem.network.modes.values()))
        room = min(COLUMN_NUMBERS // (loop.n * loop.m), 8 * COLUMN_NUMBERS // (max(1, arcs) * loop.m))
        for chosen, switches in self.chunked(room):
            seeds = [setting.seed + run for run in chosen]
            starts = [setting.starts.draw(seed) for seed in seeds]
            runs = StressedRuns(
                setting=setting, stress=stress, groups=groups, starts=starts, seeds=seeds, switches=switches
            )
            self.note_starts(chosen, runs.starts)

            def part(done: float, chosen: range = chosen) -> None:
                self.report((chosen.start + done * len(chosen)) / self.runs)

            if stress.period is not None:
                self.method = f"exact steps of {stress.period:g} s, side by side"
                self.sampled(chosen, runs, part)
                continue

            def visit(sample: IndexArray, run: IndexArray, e: Array, gap: Array, first: int = chosen.start) -> None:
                self.put(sample, first + run, e, gap)

            ends = run_stressed(runs, visit=visit, progress=part)
            self.note_ends(chosen, ends, switches)

    def sampled(self, chosen: range, runs: StressedRuns, part: Progress) -> None:
        """Sampled runs side by side, and how they ended."""
        loop, times, rows = self.setting.loop, self.setting.times, np.arange(chosen.start, chosen.stop)

        def visit(number: int, sample: Sample) -> None:
            self.put(np.full(len(rows), number), rows, sample.x - loop.goal[..., None], sample.d - sample.dhat)

        ends = run_sampled(runs, visit=visit, progress=part)
        self.count_switches(chosen, times[ends.counts - 1], runs.switches)
        for row, reason in ends.reasons.items():
            self.end(chosen[row], float(times[ends.counts[row] - 1]), reason)

    def put(self, sample: IndexArray, run: IndexArray, e: Array, gap: Array | None = None) -> None:
        """Errors e and d - dhat (n, m, k) of runs at their samples, (k,) each."""
        self.error[run, sample] = np.abs(e).max(axis=(0, 1))
        if gap is not None:
            self.estimation[run, sample] = np.abs(gap).max(axis=(0, 1))
        if self.states is not None:
            self.states[run, sample] = np.moveaxis(e, 2, 0) + self.setting.loop.goal

    def end(self, run: int, time: float, reason: str) -> None:
        """A run ended early."""
        self.ended[run], self.reasons[run] = time, reason
        late = self.setting.times > time
        self.error[run, late] = self.estimation[run, late] = np.nan
        if self.states is not None:
            self.states[run, late] = np.nan

    def note_starts(self, chosen: range, starts: Sequence[Start]) -> None:
        """How far away the runs begin."""
        for run, start in zip(chosen, starts, strict=True):
            self.lengths[run] = np.linalg.norm(start.x - self.setting.loop.goal)
            self.disturbances[run] = np.linalg.norm(start.xi - start.xihat, axis=1).max(initial=0.0)

    def count_switches(self, chosen: range, ended: Array, switches: Sequence[Switches]) -> None:
        """How often every run switched before it ended."""
        found = [np.searchsorted(each.times, time, side="right") for each, time in zip(switches, ended, strict=True)]
        self.count[chosen.start : chosen.stop] = np.array(found) - 1

    def note_ends(self, chosen: range, ends: Ends, switches: Sequence[Switches]) -> None:
        """Reasons for early ends; runs that came back are made one by one."""
        self.count_switches(chosen, ends.times, switches)
        for row in np.flatnonzero(ends.states >= ESCAPED):
            run, time = chosen[row], float(ends.times[row])
            if ends.states[row] == HANDED_BACK:
                self.single(run)
                continue
            words = f"|e|_inf exceeded {FARTHEST:.0e} times its start at"
            if ends.states[row] == COLLAPSED:
                words = "the step size collapsed or the state overflowed just after"
            self.end(run, time, f"{words} t = {time:.6g} s")

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
