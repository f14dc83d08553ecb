"""Runs of the closed loop, and what breaks it first.  Nothing is proved here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, overload

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import certified_period
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem

if TYPE_CHECKING:
    from dobc_design.simulation.breaking import Breaking
    from dobc_design.simulation.ensemble import Ensemble
    from dobc_design.simulation.signal_files import Signal
    from dobc_design.simulation.starts import Given
    from dobc_design.simulation.stress import Stress
    from dobc_design.simulation.trajectory import Trajectory

MOST_ARCS_COMPARED = 5000  # of all modes, up to which a run records of which problem it is


@overload
def simulate(
    problem: Problem | str | PathLike[str],
    *,
    runs: None = None,
    mode: str | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = ...,
    tolerance: float = ...,
    stress: Stress | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory: ...


@overload
def simulate(
    problem: Problem | str | PathLike[str],
    *,
    runs: int | None,
    mode: str | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = ...,
    tolerance: float = ...,
    stress: Stress | None = None,
    progress: Callable[[float], None] | None = None,
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
    progress: Callable[[float], None] | None = None,
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
    from dobc_design.simulation.ensembles import simulate_many
    from dobc_design.simulation.run import simulate as run
    from dobc_design.simulation.signal_files import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    remarks: list[str] = []
    if signal is None and mode is None:
        signal, remark = signal_of(problem)
        remarks += [] if remark is None else [remark]
    if problem.groups and problem.joint_observer.W is None and observer != "off":
        remarks.append("No W was given: it was designed.")
    gain = None if observer == "off" else observer_gain(problem)
    if runs is None:
        done = run(
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
            progress=progress,
        )
        return replace(done, notes=(*remarks, *done.notes), loop_sha256=fingerprint(problem, gain))
    many = simulate_many(
        problem,
        runs=runs,
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
        progress=progress,
    )
    return replace(many, notes=(*remarks, *many.notes), loop_sha256=fingerprint(problem, gain))


def fingerprint(problem: Problem, gain: Matrix | None) -> str:
    """What ties a run to certificates of its problem; "" for large networks, where it would cost more than the run."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    return loop_sha256(problem, gain) if arcs <= MOST_ARCS_COMPARED else ""


def what_breaks_first(
    problem: Problem | str | PathLike[str],
    *,
    options: Sequence[str] | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    tolerance: float = 0.1,
    certificate: Certificate | None = None,
    progress: Callable[[float], None] | None = None,
) -> Breaking:
    """Make noise, disturbance, saturation, sampling, packet loss and failures worse, each until the loop breaks.

    ``options``: some of these (default all).  ``certificate``: its certified sampling period, where it has one, stands
    beside the longest that was seen to work.  A run breaks if its late error is above ``tolerance`` times that at the
    start.  ``signal``, ``start``, ``t_final`` (s), ``seed`` and ``progress`` are as in ``simulate``.
    Returns: a Breaking, the data of one figure.  Raises: SpecError.
    """
    from dobc_design.simulation.breaking import OPTIONS
    from dobc_design.simulation.breaking import what_breaks_first as run
    from dobc_design.simulation.signal_files import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    chosen, remark = (signal, None) if signal is not None else signal_of(problem)
    found = run(
        problem,
        options=OPTIONS if options is None else options,
        signal=chosen,
        start=start,
        t_final=t_final,
        seed=seed,
        gain=observer_gain(problem),
        tolerance=tolerance,
        certified=None if certificate is None else _certified(certificate),
        progress=progress,
    )
    if remark is None:
        return found
    return replace(found, calm=replace(found.calm, notes=(remark, *found.calm.notes)))


def _certified(certificate: Certificate) -> float | None:
    period = certified_period(certificate.problem, certificate.claims)
    return None if period is None else float(period)
