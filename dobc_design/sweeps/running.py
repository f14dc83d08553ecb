"""``sweep``: every case of a plan, each once, in parallel; what is done stays done.

The order of the cases is shuffled, always in the same way, so that what is behind stands for what is ahead: the time
left is honest, and a sweep that was stopped has looked everywhere a little.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from random import Random
from typing import Any

from dobc_design.errors import SolverError, SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import shown
from dobc_design.problem.problem import Problem
from dobc_design.sweeps.case import Outcome, build, to_be_done_again
from dobc_design.sweeps.engines import run_dask, run_here, run_joblib
from dobc_design.sweeps.journal import Journal
from dobc_design.sweeps.plan import Case, Plan, make_plan
from dobc_design.sweeps.result import SweepResult
from dobc_design.sweeps.storage import export_tables
from dobc_design.sweeps.tasks import Task
from dobc_design.sweeps.time_left import Clock, State

Progress = Callable[[State], None]
LONGEST = 366 * 24 * 3600  # s


def sweep(
    problem: Problem | str | PathLike[str],
    over: Mapping[str, Any] | Sequence[str],
    *,
    task: str = "certify",
    samples: int | None = None,
    seed: int = 0,
    runs: int = 1,
    everything: bool = False,
    out: str | PathLike[str] | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    time_limit: float | str | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> SweepResult:
    """Certify or simulate a problem with some of its keys varied.

    ``over``: key of the problem file -> values: a sequence, or text as in ``dobc sweep``: ``"1:5:9"``, ``"tanh(y),y"``,
    ``"~uniform(0.1,1)"`` (drawn ``samples`` times with ``seed``); see ``axes``.  Listed values make a grid.
    ``task``: "certify" (with ``everything`` as there) or "simulate" (``runs`` runs of each case).
    ``out``: a folder; every finished case is written there at once, and a sweep that was stopped goes on from there
    when it is started again.  A folder of another sweep is refused, unless ``force`` begins anew.
    ``jobs``: processes, by default one per processor; 1 is this process.  A program that is run as a file needs
    ``if __name__ == "__main__":`` around the call for more than one.  ``cluster``: the address of a Dask scheduler, or
    "local" for a cluster of ``jobs`` processes here.  ``time_limit``: seconds after which a case is given up, recorded
    as failed, and the rest goes on; with it one job is another process, too.  A later sweep with a longer limit does
    such cases again.  ``progress`` is called with the state after every case.
    Returns: a SweepResult; a case that fails is in it with its error.
    Raises: SpecError for a wrong argument, and if no case at all gives a problem; CertificateError, SolverError when
    the machine or the cluster fails, what is finished being kept.
    Example:
        >>> dd.sweep("clock-sync", {"pinning.gains.gateway": [0, 2]}, jobs=1).column("verdict")
        ['refuted', 'proved']
    """
    if jobs is not None and (type(jobs) is not int or jobs < 1):
        raise SpecError(f"jobs must be a whole number >= 1; got {shown(jobs)}.", key="jobs", cure="Correct it.")
    limit = _read_limit(time_limit)
    plan = make_plan(problem, over, task=Task(kind=task, everything=everything, runs=runs), samples=samples, seed=seed)
    _require_one(plan)
    if out is None:
        done: dict[int, Outcome] = {}
        _run(plan, done, lambda line: done.update({line["case"]: line}), jobs, cluster, limit, progress)
        return SweepResult(plan=plan, lines=_ordered(done))
    folder = Path(out)
    with Journal(folder, plan, anew=force) as journal:
        _run(plan, journal.done, journal.append, jobs, cluster, limit, progress)
        result = SweepResult(plan=plan, lines=_ordered(journal.done), folder=folder)
        export_tables(folder, result.rows, result.columns)
    return result


def _ordered(done: Mapping[int, Outcome]) -> tuple[Outcome, ...]:
    return tuple(done[number] for number in sorted(done))


def _run(
    plan: Plan,
    done: dict[int, Outcome],
    keep: Callable[[Outcome], None],
    jobs: int | None,
    cluster: str | None,
    limit: float | None,
    progress: Progress | None,
) -> None:
    """Do what is not done, and hand every outcome to ``keep``, which adds it to ``done``."""
    for number in [number for number, line in done.items() if to_be_done_again(line, limit)]:
        del done[number]
    order = list(range(len(plan)))
    Random(0).shuffle(order)
    cases = [plan.case(number) for number in order if number not in done]
    resumed, failed = len(done), sum(line["error"] is not None for line in done.values())
    clock, began, idle = Clock(), time.monotonic(), 0.0

    def report() -> None:
        if progress is not None:
            elapsed = time.monotonic() - began
            progress(
                State(
                    total=len(plan),
                    done=len(done),
                    resumed=resumed,
                    failed=failed,
                    elapsed=elapsed,
                    left=clock.left(len(plan) - len(done), elapsed=elapsed - idle),
                )
            )

    report()
    for outcome in _outcomes(plan, cases, jobs, cluster, limit):
        if clock.count == 0:  # processes start and libraries load once: no part of the pace
            idle = max(0.0, time.monotonic() - began - outcome["seconds"])
        keep(outcome)
        clock.add(outcome["seconds"])
        failed += outcome["error"] is not None
        report()
    if len(done) < len(plan):  # whatever an engine does, a result is whole
        raise SolverError(
            f"{len(plan) - len(done)} of {len(plan)} cases came back without an answer.",
            key="sweep",
            cure="Finished cases are kept; run the same sweep again.",
        )


def _read_limit(given: Any) -> float | None:
    """The time limit of a case in s.  Raises: SpecError."""
    if given is None:
        return None
    limit = parse_number(given, key="time_limit")
    if not 0 < limit <= LONGEST:
        raise SpecError(
            f"time_limit must be a number of seconds > 0, at most {LONGEST} (a year); got {shown(given)}.",
            key="time_limit",
            cure="For example 600; without it a case may take as long as it does.",
        )
    return float(limit)


def _outcomes(
    plan: Plan, cases: Sequence[Case], jobs: int | None, cluster: str | None, limit: float | None
) -> Iterator[Outcome]:
    from joblib import cpu_count

    count = min(jobs or cpu_count(), max(1, len(cases)))
    if not cases:
        return iter(())
    if cluster is not None:
        return run_dask(plan, cases, address=cluster, jobs=count, limit=limit)
    if count == 1 and limit is None:
        return run_here(plan, cases)
    return run_joblib(plan, cases, jobs=count, limit=limit)


def _require_one(plan: Plan) -> None:
    """Refuse a sweep of which no case gives a problem: the mistake lies in what is varied.  Raises: SpecError."""
    first: SpecError | None = None
    for number in range(len(plan)):
        try:
            build(plan.base, plan.axes, plan.case(number))
            return
        except SpecError as error:
            first = first or error
    if first is not None:
        raise first
