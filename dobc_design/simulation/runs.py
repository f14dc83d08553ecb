"""Runs of the closed loop (1), (12), (13), (19) with any switching signal: one, or many side by
side.

The observer's error is known in closed form, so by default only e is integrated; the full loop as
printed is the reference, and is taken where the closed form is out of reach.  Run r of an ensemble
has the seed ``seed + r``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.bounds import keeps_guarantee
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.arrays import Array
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem
from dobc_design.problem.uncertainty import ABSOLUTE, RELATIVE
from dobc_design.simulation import integrate
from dobc_design.simulation import setting as settings
from dobc_design.simulation import trajectory as measures
from dobc_design.simulation._arguments import whole
from dobc_design.simulation.columns import COLUMN_NUMBERS, Stack, padded
from dobc_design.simulation.field import ClosedForm, Network, evolve, network_of
from dobc_design.simulation.integrate import Progress
from dobc_design.simulation.sampled import Stepper, run_sampled_alone
from dobc_design.simulation.setting import Options, Setting, Stress
from dobc_design.simulation.signals import Mobile, Signal, signal_of, signal_to_json
from dobc_design.simulation.stressed import StressedRuns, run_alone, run_stressed
from dobc_design.simulation.switches import Modes, Nearby, Planned
from dobc_design.simulation.trajectory import Trajectory
from dobc_design.simulation.worst import worst_signal

if TYPE_CHECKING:
    from dobc_design.plotting.runs import Envelope

MOST_KEPT = 100_000_000  # samples of all runs of an ensemble, two numbers of each: 1.6 GB
# whose states an ensemble keeps, and how many numbers at most
DRAWN_RUNS, MOST_STATES = 5, 2_000_000
MOST_ARCS_COMPARED = 5000  # of all modes, up to which a run records of which problem it is


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Ensemble(measures.Simulated):
    """Runs that differ by their seeds: starts and switches.  Arrays cannot be written to.

    Shapes: seeds (R,); times (T,) in s; error and estimation_error (R, T), |e|_inf and |d -
    dhat|_inf, nan from where a run that diverged had ended; diverged (R,); ended (R,) in s;
    switches (R,), how often a run switched; goal (n, m); lengths (R,), the Euclidean |e| of all
    agents at the start; disturbances (R,), the largest |xi_i - xihat_i| there; states (S, T, n, m),
    x of the first runs, which the figure shows (at most 5, none of very large networks); leader (S,
    T, m), that of these runs, 0 without one. ``reasons`` says by run why it ended early; ``signal``
    and ``stress`` are JSON, ``observer`` as in ``simulate``. ``simulate(problem, seed=seeds[r],
    ...)`` gives run r again, in full.
    """

    name: str
    mode: str
    labels: tuple[str, ...]
    t_final: float
    seeds: IndexArray
    times: Array
    error: Array
    estimation_error: Array
    diverged: NDArray[np.bool_]
    ended: Array
    switches: IndexArray
    reasons: dict[int, str]
    goal: Array
    method: str
    notes: tuple[str, ...]
    signal: str
    observer: str
    stress: str
    lengths: Array
    disturbances: Array
    states: Array
    leader: Array
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
        """Over all starts the largest |e|_inf, Euclidean |e| of all agents stacked, and |xi_i -
        xihat_i|."""
        return (
            float(self.error[:, 0].max()),
            float(self.lengths.max()),
            float(self.disturbances.max()),
        )

    @property
    def final_error(self) -> Array:
        """|e|_inf at the end of every run, (R,)."""
        return measures.final_errors(self.error)

    def quantiles(self, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> Array:
        """Quantiles of |e|_inf over the runs at every sample: (levels, T); a run that diverged
        counts as infinite."""
        return np.stack([measures.quantile(self.error, level) for level in levels])

    def summary(self) -> dict[str, Any]:
        """The numbers of ``dobc simulate --json``, without its files."""
        return measures.summary(self.times, self.error, self.diverged)

    def plot(
        self,
        *,
        certificate: Certificate | None = None,
        envelope: Envelope | None = None,
        ax: Any = None,
    ) -> Any:
        """States of the first runs, quantile bands of all errors.  The arguments are those of
        ``Trajectory.plot``."""
        from dobc_design.plotting.runs import ensemble_sheet, plot_bands

        bound = measures.bound_of(self, certificate, envelope)
        return ensemble_sheet(self, envelope=bound) if ax is None else plot_bands(ax, self, bound)

    def intervals(self, confidence: float = 0.95) -> dict[str, tuple[float, float] | None]:
        """Confidence intervals for a random run: median final error, probability of divergence.

        Free of assumptions on distributions (order statistics; Clopper and Pearson).  None: too few
        runs.
        """
        final, bad = np.where(self.diverged, np.inf, self.final_error), int(self.diverged.sum())
        return {
            "median_final_error": measures.quantile_interval(final, 0.5, confidence),
            "probability_of_divergence": measures.proportion_interval(bad, len(self), confidence),
        }

    def save(self, path: str | PathLike[str], *, force: bool = True) -> Path:
        """Write the arrays to ``path``, an .npz file for ``numpy.load``.  Raises: SpecError."""
        return measures.save_arrays(Path(path), self.to_bytes(), force=force)

    def to_bytes(self) -> bytes:
        """What ``save`` writes."""
        words = (
            "name",
            "mode",
            "labels",
            "t_final",
            "notes",
            "signal",
            "method",
            "observer",
            "stress",
        )
        facts = {name: getattr(self, name) for name in words} | {
            "format": "dobc-ensemble",
            "version": 1,
        }
        about = np.array(json.dumps(facts, ensure_ascii=False))
        return measures.arrays_bytes({"about": about} | self._arrays())

    def _card(self) -> Card:
        bad, final = int(self.diverged.sum()) or "none", np.sort(self.final_error)
        ends = f"{bad} diverged, final |e|_inf {final[0]:.3g} to {final[-1]:.3g}"
        text = f'{len(self)} runs of {self.t_final:.4g} s, mode "{self.mode}", {ends}'
        return Card(title=self.name, text=text, lines=self.notes)


@overload
def simulate(
    problem: Source, *, runs: None = None, progress: Reports[float] = None, **given: Unpack[Options]
) -> Trajectory: ...


@overload
def simulate(
    problem: Source, *, runs: int | None, progress: Reports[float] = None, **given: Unpack[Options]
) -> Trajectory | Ensemble: ...


@shows_progress
def simulate(
    problem: Source,
    *,
    runs: int | None = None,
    mode: str | None = None,
    signal: Signal | None = None,
    start: settings.Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = "closed-form",
    tolerance: float = 1e-9,
    stress: Stress | Literal["worst"] | None = None,
    progress: Reports[float] = None,
) -> Trajectory | Ensemble:
    """Simulate the closed loop (1), (12), (13), (19): one run, or ``runs`` of them with the seeds
    seed, seed + 1, ...

    The modes follow ``signal``; without it ``mode``; without both the problem's [switching].  A
    missing W is designed first, as ``certify`` does, and a note says so.  ``start``: x by agent and
    component, (n, m), or a mapping with "x", "xi" and "xihat", or a .csv or .npz file; by default x
    is drawn from the region by ``seed``, and xihat = 0. ``t_final`` (s) and ``seed`` default to the
    problem's.  ``samples``: how many, or the times from 0 on in s. ``observer``: "closed-form"
    integrates e with eps known, "full-loop" all equations as printed, "off" leaves the disturbance
    uncompensated.  ``tolerance`` of the integrator is relative.  ``stress``: noise, limits, losses
    and failures; "worst": what [uncertainty], [actuators] and the guarantee "dwell" allow, at its
    worst.  ``progress``: True for a bar, or a function of the part done, 0 to 1.
    Returns: a Trajectory, or with ``runs`` an Ensemble; ``diverged`` says what had to stop early,
    and ``reason`` why.
    Raises: SpecError for a wrong argument.
    Example:
        >>> run = dd.simulate("clock-sync", t_final=30, samples=61)
        >>> run.x.shape, run.diverged, run.final_error < 0.3
        ((61, 10, 1), False, True)
    """
    problem = as_integrators(load_problem(problem))
    remarks: list[str] = []
    if (
        stress == "worst"
        and signal is None
        and mode is None
        and (signal := worst_signal(problem)) is not None
    ):
        remarks.append(
            "Signal: of short rounds that keep the guarantee, one under which the "
            "linearised loop decays slowest."
        )
        stress = settings.worst_stress(problem, needed=False)
    elif signal is None and mode is None:
        signal, remark = signal_of(problem)
        remarks += [] if remark is None else [remark]
    if problem.groups and problem.joint_observer.W is None and observer != "off":
        remarks.append("No W was given: it was designed.")
    if stress is None:
        remarks += _left_out(problem)
    gain = None if observer == "off" else observer_gain(problem)
    given = Options(
        mode=mode,
        signal=signal,
        start=start,
        t_final=t_final,
        seed=seed,
        samples=samples,
        stress=stress,
    )
    given |= {"observer": observer, "tolerance": tolerance}
    setting = settings.make_setting(problem, gain=gain, **given)
    if not keeps_guarantee(problem, json.loads(signal_to_json(setting.signal))):
        remarks.append("The signal need not keep the guarantee of [switching].")
    setting, mark = replace(setting, notes=(*remarks, *setting.notes)), fingerprint(problem, gain)
    if runs is None:
        return replace(run_once(setting, progress=report_to(progress)), loop_sha256=mark)
    return replace(run_many(setting, runs, progress=report_to(progress)), loop_sha256=mark)


def _left_out(problem: Problem) -> list[str]:
    """What the file states about the plant, of which a run without stress knows nothing."""
    own, limits = problem.uncertainty, problem.actuators
    tables = (
        ["[uncertainty]"]
        if own is not None and any(getattr(own, x) for x in (*RELATIVE, *ABSOLUTE))
        else []
    )
    tables += ["[actuators]"] if limits is not None and limits.limit else []
    if not tables:
        return []
    applied = problem.leader is None and settings.worst_stress(problem, needed=False) != Stress()
    by_stress = (
        "; `dobc stress FILE --worst` applies the limits, disturbance and noise" if applied else ""
    )
    return [f"Not simulated: what {' and '.join(tables)} of the file states{by_stress}."]


def fingerprint(problem: Problem, gain: Matrix | None) -> str:
    """What ties a run to certificates of its problem; "" for large networks, where it would cost
    more than the run."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    return loop_sha256(problem, gain) if arcs <= MOST_ARCS_COMPARED else ""


def run_once(
    setting: Setting, *, seed: int | None = None, progress: Progress | None = None
) -> Trajectory:
    """One run, with this seed for its start and its switches."""
    problem, loop, signal, stress = setting.problem, setting.loop, setting.signal, setting.stress
    seed = setting.seed if seed is None else seed
    modes: Modes
    # Trial steps overflow far from the target; the integrator rejects them, and nobody needs a
    # warning.
    with np.errstate(all="ignore"):
        start = setting.starts.draw(seed)
        if isinstance(signal, Mobile) and signal.motion is None:
            modes = Nearby(signal, problem, setting.horizon)
        else:
            drawn = settings.switches_for(setting, seed)
            modes = Planned(drawn, partial(settings.groups_for, setting, drawn), setting.horizon)
        if not setting.is_full:
            run, parts = _calm(setting, start, modes, progress)
        else:
            moving = isinstance(modes, Nearby)
            graphs: dict[str, Any] = {"nearby": modes} if moving else {"switches": [modes.switches]}
            runs = StressedRuns(
                setting=setting, groups=modes.groups, starts=[start], seeds=[seed], **graphs
            )
            sampled = stress is not None and stress.period is not None
            run, parts = (
                run_sampled_alone(runs, progress) if sampled else run_alone(runs, modes, progress)
            )
    switches = modes.switches
    if run.reason:  # those up to where the run ended
        count = int(np.searchsorted(switches.times, float(run.times[-1]), side="right"))
        switches = replace(
            switches, times=switches.times[:count].copy(), modes=switches.modes[:count].copy()
        )
    return Trajectory(
        **_facts(setting),
        seed=seed,
        goal=loop.goal.copy(),
        times=run.times,
        diverged=bool(run.reason),
        reason=run.reason,
        method=run.method,
        evaluations=run.evaluations,
        notes=(*setting.notes, *run.notes, *(() if stress is None else (f"Stress: {stress}.",))),
        switches=switches,
        **parts,
    )


def _facts(setting: Setting) -> dict[str, Any]:
    """What one run and many say alike about what was asked for."""
    problem, stress = (
        setting.problem,
        "" if setting.stress is None else settings.stress_to_json(setting.stress),
    )
    facts = {
        "name": problem.name,
        "labels": problem.network.labels,
        "t_final": setting.horizon,
        "stress": stress,
    }
    facts |= {
        "mode": settings.describe(setting.signal, problem),
        "signal": signal_to_json(setting.signal),
    }
    return facts | {"observer": setting.observer}


def _calm(
    setting: Setting, start: settings.Start, modes: Modes, progress: Progress | None
) -> integrate.Outcome:
    """A run without stress: e with eps in closed form, else both of them."""
    loop, off, eps0 = setting.loop, setting.observer == "off", start.xi - start.xihat
    closed, F = settings.closed_form_of(setting), loop.A if off else loop.F
    e0 = np.concatenate(
        [(start.x - loop.goal - (start.s if len(start.s) else 0.0)).ravel(), start.s]
    )
    along = loop.q > 0 and closed is None
    plan, flat = (
        integrate.errors(loop, modes, closed, eps0, F),
        np.concatenate([e0, eps0.ravel()]) if along else e0,
    )
    implicit, tolerance = settings.is_stiff(setting, closed=not along), setting.tolerance
    run = integrate.Integration(
        plan, flat, setting.times, tolerance=tolerance, implicit=implicit, progress=progress
    ).run()
    e, s = np.split(run.states[:, : len(e0)], [loop.n * loop.m], axis=1)
    e = e.reshape(-1, loop.n, loop.m)
    x = e + loop.goal + (s[:, None] if loop.lead else 0.0)
    xi = evolve(loop.A, start.xi, run.times)
    eps = run.states[:, len(e0) :].reshape(xi.shape) if along else evolve(F, eps0, run.times)
    xihat = np.zeros_like(xi) if off else xi - eps
    if along:
        run.notes.append(
            "The observer is too fast for its closed form: its error was integrated as well."
        )
    dhat = xihat @ loop.output.T
    u = loop.control(e, dhat)
    led = {"leader": s} if loop.lead else {}
    return run, {
        "x": x,
        "xi": xi,
        "xihat": xihat,
        "d": xi @ loop.output.T,
        "dhat": dhat,
        "u": u,
        **led,
    }


def run_many(setting: Setting, runs: int, *, progress: Progress | None = None) -> Ensemble:
    """``runs`` runs with the seeds seed, seed + 1, ...: each with its own start and its own
    switches."""
    most = MOST_KEPT // len(setting.times)
    if whole(runs, "runs", least=1) > most:
        message = f"must be at most {most} with {len(setting.times)} samples of each; got {runs}."
        raise wrong(
            "runs", message, "Make several ensembles with other seeds, or ask for fewer samples."
        )
    with np.errstate(all="ignore"):
        return _Collector(setting, runs, progress or (lambda part: None)).run()


class _Collector:
    """Puts what the runs come to into the arrays of an ensemble."""

    def __init__(self, setting: Setting, runs: int, report: Progress) -> None:
        self.setting, self.runs, self.report = setting, runs, report
        self.error, self.estimation = np.full((2, runs, len(setting.times)), np.nan)
        self.ended, self.count = np.full(runs, setting.horizon), np.zeros(runs, dtype=np.int64)
        self.lengths, self.disturbances = np.zeros((2, runs))
        shape = (len(setting.times), setting.loop.n, setting.loop.m)
        self.states = np.full(
            (min(runs, DRAWN_RUNS, MOST_STATES // int(np.prod(shape))), *shape), np.nan
        )
        self.leader = np.zeros((len(self.states), shape[0], shape[2]))
        self.reasons: dict[int, str] = {}
        self.method = "DOP853, side by side"

    def run(self) -> Ensemble:
        setting, stress = self.setting, self.setting.stress
        notes = [*setting.notes, *([] if stress is None else [f"Stress: {stress}."])]
        self.report(0.0)
        closed = None if setting.is_full else settings.closed_form_of(setting)
        reason = self.reason_for_single_runs(closed)
        if reason:
            notes.append(f"The runs were made one by one, because {reason}.")
            self.method = ""
            for run in range(self.runs):
                self.single(run)
                self.report((run + 1) / self.runs)
        else:
            self.chunks(closed)
        diverged = np.zeros(self.runs, dtype=bool)
        diverged[list(self.reasons)] = True
        return Ensemble(
            **_facts(setting),
            seeds=setting.seed + np.arange(self.runs),
            times=setting.times,
            error=self.error,
            estimation_error=self.estimation,
            diverged=diverged,
            ended=self.ended,
            switches=self.count,
            reasons=dict(sorted(self.reasons.items())),
            goal=setting.loop.goal,
            method=self.method,
            notes=tuple(notes),
            lengths=self.lengths,
            disturbances=self.disturbances,
            states=self.states,
            leader=self.leader,
        )

    def reason_for_single_runs(self, closed: ClosedForm | None) -> str:
        setting, stress = self.setting, self.setting.stress
        if isinstance(setting.signal, Mobile) and setting.signal.motion is None:
            return "every run has graphs of its own"
        if stress is not None and stress.period is not None:
            return ""
        if stress is not None and stress.worst:
            return "the disturbance of every run switches at times of its own"
        if setting.loop.q and closed is None and not setting.is_full:
            return "the observer is too fast for its closed form"
        return "the loop is stiff" if settings.is_stiff(setting, closed=not setting.is_full) else ""

    def chunks(self, closed: ClosedForm | None) -> None:
        """Runs side by side, a bounded number at a time; a given motion gives all of them the same
        switches."""
        setting, loop, stress = self.setting, self.setting.loop, self.setting.stress
        shared = settings.switches_for(setting, setting.seed)
        groups, room = (
            partial(settings.groups_for, setting, shared),
            COLUMN_NUMBERS // (loop.n * loop.m),
        )
        if setting.is_full:
            arcs = sum(each.shape[1] for each in shared.graphs) or sum(
                map(len, setting.problem.network.modes.values())
            )
            room = min(room, 8 * COLUMN_NUMBERS // (max(1, arcs) * loop.m))
        size = max(1, min(self.runs, room))
        networks = cache(lambda mode: network_of(loop, groups(mode), runs=size))
        for first in range(0, self.runs, size):
            chosen = np.arange(first, min(self.runs, first + size))
            seeds = (setting.seed + chosen).tolist()
            starts = [setting.starts.draw(seed) for seed in seeds]
            switches = [
                shared if shared.graphs else settings.switches_for(setting, seed) for seed in seeds
            ]
            runs = StressedRuns(
                setting=setting, groups=groups, starts=starts, seeds=seeds, switches=switches
            )
            for run, start in zip(chosen, starts, strict=True):
                self.lengths[run] = np.linalg.norm(
                    start.x - loop.goal - (start.s if loop.lead else 0.0)
                )
                self.disturbances[run] = np.linalg.norm(start.xi - start.xihat, axis=1).max(
                    initial=0.0
                )

            def part(done: float, chosen: IndexArray = chosen) -> None:
                self.report((int(chosen[0]) + done * len(chosen)) / self.runs)

            if not setting.is_full:
                ended, reasons = self.calm(chosen, runs, closed, networks)
                part(1.0)
            elif stress is None or stress.period is None:
                ends = run_stressed(runs, visit=partial(self.put, chosen), progress=part)
                ended, reasons = ends.times, ends.reasons()
            else:
                ended, reasons = self.sampled(chosen, runs, part)
            for row, each in enumerate(switches):
                self.count[chosen[row]] = np.searchsorted(each.times, ended[row], side="right") - 1
            for row, reason in reasons.items():
                if reason:
                    late = setting.times > ended[row]
                    self.ended[chosen[row]], self.reasons[int(chosen[row])] = ended[row], reason
                    self.error[chosen[row], late] = self.estimation[chosen[row], late] = np.nan
                    self.states[chosen[row] : chosen[row] + 1, late] = np.nan
                else:
                    self.single(int(chosen[row]))

    def calm(
        self,
        chosen: IndexArray,
        runs: StressedRuns,
        closed: ClosedForm | None,
        networks: Callable[[int], Network],
    ) -> tuple[Array, dict[int, str]]:
        setting, loop = self.setting, self.setting.loop
        e, eps = (
            runs.stacked("x") - loop.goal[..., None],
            runs.stacked("xi") - runs.stacked("xihat"),
        )
        s = np.stack([start.s for start in runs.starts], axis=1)
        columns = np.concatenate([(e - s if loop.lead else e).reshape(loop.n * loop.m, -1), s])
        stack = Stack(
            loop=loop,
            networks=networks,
            closed=closed,
            e=columns,
            eps=eps,
            switches=padded(runs.switches),
        )
        self.estimation[chosen] = 0.0
        weights: Any = [] if closed is None else np.moveaxis(closed.many(setting.times), 2, 0)
        for place, weight in enumerate(
            weights
            if loop.plant is None or closed is None
            else np.linalg.pinv(loop.plant.B) @ weights
        ):
            self.estimation[chosen, place] = np.abs(np.tensordot(weight, eps, axes=(1, 1))).max(
                axis=(0, 1)
            )

        def visit(sample: IndexArray, run: IndexArray, e: Array) -> None:
            self.put(chosen, sample, run, e)

        ends = stack.integrate(setting.times, tolerance=setting.tolerance, visit=visit)
        return ends.times, ends.reasons()

    def sampled(
        self, chosen: IndexArray, runs: StressedRuns, part: Progress
    ) -> tuple[Array, dict[int, str]]:
        every, goal = np.arange(len(chosen)), self.setting.loop.goal[..., None]

        def visit(number: int, sample: integrate.Samples) -> None:
            self.put(
                chosen,
                np.full(len(every), number),
                every,
                sample["x"] - goal,
                sample["d"] - sample["dhat"],
            )

        stepper = Stepper(runs, visit, part)
        self.method, (counts, reasons) = f"{stepper.method}, side by side", stepper.run()
        return self.setting.times[counts - 1], reasons

    def put(
        self,
        chosen: IndexArray,
        sample: IndexArray,
        run: IndexArray,
        e: Array,
        gap: Array | None = None,
    ) -> None:
        """Errors e and d - dhat (n, m, k) of runs at their samples, (k,) each; or e flat, and a
        leader after it."""
        loop, own = self.setting.loop, chosen[run] < len(self.states)
        e, s = np.split(e.reshape(-1, len(run)), [loop.n * loop.m])
        self.error[chosen[run], sample] = np.abs(e).max(axis=0)
        if len(s):
            self.leader[chosen[run][own], sample[own]] = s[:, own].T
        states = e[:, own].T.reshape(-1, loop.n, loop.m) + loop.goal
        self.states[chosen[run][own], sample[own]] = (
            states + self.leader[chosen[run][own], sample[own]][:, None]
        )
        if gap is not None:
            self.estimation[chosen[run], sample] = np.abs(gap).max(axis=(0, 1))

    def single(self, run: int) -> None:
        done = run_once(self.setting, seed=self.setting.seed + run)
        count = int(np.searchsorted(self.setting.times, done.times[-1], side="right"))
        self.error[run], self.estimation[run] = np.nan, np.nan
        self.error[run, :count] = done.error()[:count]
        self.estimation[run, :count] = done.estimation_error()[:count]
        self.states[run : run + 1] = np.nan
        self.states[run : run + 1, :count] = done.x[:count]
        self.leader[run : run + 1, :count] = done.leader[:count]
        self.ended[run], self.count[run] = done.times[-1], len(done.switches) - 1
        _, self.lengths[run], self.disturbances[run] = done.start_size()
        if done.diverged:
            self.reasons[run] = done.reason
        names = [name for name in (self.method, done.method) if name]
        self.method = "; ".join(dict.fromkeys("; ".join(names).split("; ")))
