"""``simulate``: runs of the closed loop (1), (12), (13), (19) with any switching signal.

The observer's error is known in closed form, so by default only e is integrated; the full loop as
printed is the reference, and is taken where the closed form is out of reach.  Runs are made in
``execution.py``.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, Unpack, overload

from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.bounds import keeps_guarantee
from dobc_design.conditions.observer.propose import observer_gain, with_observer
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.problem.uncertainty import BOUNDS, RELATIVE

from .execution import run_many, run_once
from .setting import TOLERANCE, WITHOUT, Options, make_setting
from .signals import Signal, signal_of, signal_to_json
from .starts import Given
from .stress import Stress, worst_stress
from .trajectory import Ensemble, Trajectory
from .worst import worst_signal

MOST_ARCS_COMPARED = 5000  # of all modes, up to which a run records of which problem it is


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
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    samples: int | Sequence[float] | None = None,
    observer: str = "closed-form",
    tolerance: float = TOLERANCE,
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
    and failures; "worst": what [uncertainty], [actuators], [readings] and the guarantee allow, at
    its worst.  What [readings] and [processor] state is in every run, ages and losses by chance.
    ``progress``: True for a bar, or a function of the part done, 0 to 1.
    Returns: a Trajectory, or with ``runs`` an Ensemble; ``diverged`` says what had to stop early,
    and ``reason`` why.
    Raises: SpecError for a wrong argument.
    Example:
        >>> run = dd.simulate("clock-sync", t_final=30, samples=61)
        >>> run.x.shape, run.diverged, run.final_error < 0.3
        ((61, 10, 1), False, True)
    """
    problem = with_observer(load_problem(problem))
    remarks = []
    if signal is None and mode is None:
        if stress == "worst":
            signal = worst_signal(problem)
        if signal is not None:
            remarks.append(
                "Signal: of short rounds that keep the guarantee, one under which the linearised "
                "loop decays slowest."
            )
            stress = worst_stress(problem)  # none is needed: the signal is bad enough
        else:
            signal, remark = signal_of(problem)
            remarks += [] if remark is None else [remark]
    if problem.groups and problem.joint_observer.W is None and observer != WITHOUT:
        remarks.append("No W was given: it was designed.")
    if stress is None:
        remarks += _left_out(problem)
    if loop_of(problem).saturates:
        remarks.append("Inputs saturate at the limits of [actuators].")
    gain = None if observer == WITHOUT else observer_gain(loop_of(problem))
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
    if not keeps_guarantee(loop_of(problem), json.loads(signal_to_json(setting.signal))):
        remarks.append("The signal need not keep the guarantee of [switching].")
    setting = replace(setting, notes=(*remarks, *setting.notes))
    mark = fingerprint(problem, gain)
    report = report_to(progress)
    if runs is None:
        return replace(run_once(setting, progress=report), loop_sha256=mark)
    return replace(run_many(setting, runs, progress=report), loop_sha256=mark)


def _left_out(problem: Problem) -> list[str]:
    """What the file states about the plant, of which a run without stress knows nothing."""
    tables = []
    allowed = problem.uncertainty
    if allowed is not None and any(getattr(allowed, key) for key in (*RELATIVE, *BOUNDS)):
        tables.append("[uncertainty]")
    actuators = problem.actuators
    if actuators is not None and actuators.limit and not actuators.saturates:
        tables.append("[actuators]")
    if not tables:
        return []
    applied = ""
    if problem.leader is None and worst_stress(problem) != Stress():
        applied = "; `dobc stress FILE --worst` applies the limits, disturbance and noise"
    return [f"Not simulated: what {' and '.join(tables)} of the file states{applied}."]


def fingerprint(problem: Problem, gain: Matrix | None) -> str:
    """What ties a run to certificates of its problem; "" for large networks, where it would cost
    more than the run."""
    arcs = sum(len(each) for each in problem.network.modes.values())
    return loop_sha256(problem, gain) if arcs <= MOST_ARCS_COMPARED else ""
