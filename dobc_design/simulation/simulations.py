"""Runs of the closed loop.  Nothing is proved here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Unpack, overload

from dobc_design.conditions.observer.gain import observer_gain
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem

if TYPE_CHECKING:
    from dobc_design.simulation.ensemble import Ensemble
    from dobc_design.simulation.setting import Given, Options
    from dobc_design.simulation.signals import Signal
    from dobc_design.simulation.stress import Stress
    from dobc_design.simulation.trajectory import Trajectory

MOST_ARCS_COMPARED = 5000  # of all modes, up to which a run records of which problem it is
Progress = Callable[[float], None]


@overload
def simulate(
    problem: Problem | str | PathLike[str],
    *,
    runs: None = None,
    progress: Progress | None = None,
    **given: Unpack[Options],
) -> Trajectory: ...


@overload
def simulate(
    problem: Problem | str | PathLike[str],
    *,
    runs: int | None,
    progress: Progress | None = None,
    **given: Unpack[Options],
) -> Trajectory | Ensemble: ...


def simulate(
    problem: Problem | str | PathLike[str],
    *,
    runs: int | None = None,
    mode: str | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = "closed-form",
    tolerance: float = 1e-9,
    stress: Stress | None = None,
    progress: Progress | None = None,
) -> Trajectory | Ensemble:
    """Simulate the closed loop (1), (12), (13), (19): one run, or ``runs`` of them with the seeds seed, seed + 1, ...

    The modes follow ``signal``; without it ``mode``; without both the problem's [switching].  A missing W is designed
    first, as ``certify`` does, and a note says so.  ``start``: x by agent and component, (n, m), or a mapping with
    "x", "xi" and "xihat", or a .csv or .npz file; by default x is drawn from the region by ``seed``, and xihat = 0.
    ``t_final`` (s) and ``seed`` default to the problem's.  ``samples``: how many, or the times from 0 on in s.
    ``observer``: "closed-form" integrates e with eps known, "full-loop" all equations as printed, "off" leaves the
    disturbance uncompensated.  ``tolerance`` of the integrator is relative.  ``stress``: noise, limits, losses and
    failures.  ``progress`` is called with the part that is done, from 0 to 1.
    Returns: a Trajectory, or with ``runs`` an Ensemble; ``diverged`` says what had to stop early, and ``reason`` why.
    Raises: SpecError for a wrong argument.
    Example:
        >>> run = dd.simulate("clock-sync", t_final=30, samples=61)
        >>> run.x.shape, run.diverged, run.final_error < 0.3
        ((61, 10, 1), False, True)
    """
    from dobc_design.simulation.ensemble import run_many
    from dobc_design.simulation.run import run_once
    from dobc_design.simulation.setting import make_setting
    from dobc_design.simulation.signals import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    remarks: list[str] = []
    if signal is None and mode is None:
        signal, remark = signal_of(problem)
        remarks += [] if remark is None else [remark]
    if problem.groups and problem.joint_observer.W is None and observer != "off":
        remarks.append("No W was given: it was designed.")
    gain = None if observer == "off" else observer_gain(problem)
    setting = make_setting(
        problem,
        gain=gain,
        mode=mode,
        signal=signal,
        start=start,
        t_final=t_final,
        seed=seed,
        samples=samples,
        observer=observer,
        tolerance=tolerance,
        stress=stress,
    )
    setting, mark = replace(setting, notes=(*remarks, *setting.notes)), fingerprint(problem, gain)
    if runs is None:
        return replace(run_once(setting, setting.seed, progress=progress), loop_sha256=mark)
    return replace(run_many(setting, runs, progress=progress), loop_sha256=mark)


def fingerprint(problem: Problem, gain: Matrix | None) -> str:
    """What ties a run to certificates of its problem; "" for large networks, where it would cost more than the run."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    return loop_sha256(problem, gain) if arcs <= MOST_ARCS_COMPARED else ""
