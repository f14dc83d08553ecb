"""Who does the cases: this process, other processes through joblib, or a cluster through Dask.

An engine is a generator of outcomes, in any order, each once.  A worker that dies takes at most the cases with it that
it had in hand: they are done again, and only a case that kills a worker on its own is given up, and recorded.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any

from dobc_design.errors import SolverError, SpecError
from dobc_design.sweeps.axes import Axis
from dobc_design.sweeps.case import Outcome, lost, overdue, run_case, run_in_worker
from dobc_design.sweeps.limit import ENDED
from dobc_design.sweeps.plan import Base, Case, Plan
from dobc_design.sweeps.tasks import Task

UNDER_WAY = ("pending", "lost")  # statuses of what Dask will still bring
LOCAL = "local"  # the name of a cluster on this machine
AHEAD = 2  # cases per worker that a cluster is handed before the first of them is done
_DIED = "The worker died while it was at this case: out of memory, killed, or a fault in a library."
_OR_HUNG = "The worker died while it was at this case, or hung in a library for longer than the time limit."

Work = tuple[Base, tuple[Axis, ...], Task]


def run_here(plan: Plan, cases: Sequence[Case]) -> Iterator[Outcome]:
    """One after the other, in this process."""
    for case in cases:
        yield run_case(plan.base, plan.axes, plan.task, case)


def run_joblib(plan: Plan, cases: Sequence[Case], *, jobs: int, limit: float | None = None) -> Iterator[Outcome]:
    """In ``jobs`` processes; ``limit`` in s on every case."""
    work: Work = (plan.base, plan.axes, plan.task)
    ahead = {case.number: case for case in cases}
    while ahead:
        begun: dict[int, Case] = {}
        try:
            for outcome in _joblib_once(work, list(ahead.values()), begun, jobs=jobs, limit=limit):
                del ahead[outcome["case"]]
                yield outcome
        except BrokenProcessPool:
            # Some worker died. Whoever was in hand is a suspect; each is done alone, and only the culprit dies again.
            suspects = [case for number, case in begun.items() if number in ahead]
            for case in suspects:
                del ahead[case.number]
                yield _alone(work, case, limit)


def _joblib_once(
    work: Work, cases: Sequence[Case], begun: dict[int, Case], *, jobs: int, limit: float | None
) -> Iterator[Outcome]:
    from joblib import Parallel, delayed, parallel_config

    parent = os.getpid()

    def calls() -> Iterator[Any]:
        for case in cases:
            begun[case.number] = case
            yield delayed(run_in_worker)(*work, case, parent, limit)

    with parallel_config(backend="loky", inner_max_num_threads=1):
        pool = Parallel(  # with one job joblib would do the work here; two of which one is idle are other processes
            n_jobs=max(2, jobs),
            return_as="generator_unordered",
            batch_size=1,
            pre_dispatch=1 if jobs == 1 else AHEAD * jobs,
        )
        with _deaf():
            outcomes = pool(calls())  # the workers start here
        yield from outcomes


def _alone(work: Work, case: Case, limit: float | None) -> Outcome:
    began = time.monotonic()
    try:
        return next(_joblib_once(work, [case], {}, jobs=1, limit=limit))
    except BrokenProcessPool as error:
        late = limit is not None and time.monotonic() - began > limit
        if limit is not None and late and f"EXIT({ENDED})" in str(error):  # joblib names the exit codes of its workers
            return overdue(case, limit)
        return lost(case, _DIED)


class _deaf:  # noqa: N801 - used like a function
    """A moment in which processes begin that are to live and die with this one, not with its terminal.

    They inherit that Ctrl-C and the end of the terminal are ignored; each looks itself whether its parent is gone.
    joblib's cleaner of shared memory, one of them, is also to do its work without a word when the parent is killed.
    """

    def __enter__(self) -> None:
        self.handlers: dict[int, Any] = {}
        self.warnings = os.environ.get("PYTHONWARNINGS")
        quiet = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"
        os.environ["PYTHONWARNINGS"] = quiet if self.warnings is None else f"{self.warnings},{quiet}"
        try:
            for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
                before = signal.signal(number, signal.SIG_IGN)
                self.handlers.setdefault(number, before)
        except ValueError:  # not the main thread
            return

    def __exit__(self, *error: object) -> None:
        for number, handler in self.handlers.items():
            signal.signal(number, handler)
        if self.warnings is None:
            os.environ.pop("PYTHONWARNINGS", None)
        else:
            os.environ["PYTHONWARNINGS"] = self.warnings


def run_dask(
    plan: Plan, cases: Sequence[Case], *, address: str, jobs: int, limit: float | None = None
) -> Iterator[Outcome]:
    """On the cluster at ``address``, or with "local" on one of ``jobs`` processes that lives as long as this.

    ``limit`` in s on every case; processes of a cluster that is not ours are not ended for it.
    Raises: SpecError without the extra "cluster" or a scheduler at that address; SolverError when it is lost.
    """
    distributed = _distributed()
    with _client(distributed, address, jobs=jobs) as client:
        _same_version(client)
        # Every case carries its problem with it: what is scattered is lost with the worker that holds the last copy.
        work: Work = (plan.base, plan.axes, plan.task)
        queue = iter(cases)
        futures: dict[Any, Case] = {}
        suspects: list[Case] = []

        def submit(some: Iterable[Case]) -> list[Any]:
            new = {client.submit(run_case, *work, case, limit, address == LOCAL, pure=False): case for case in some}
            futures.update(new)
            return list(new)

        done = distributed.as_completed(submit(islice(queue, AHEAD * max(1, sum(client.ncores().values())))))
        for future in done:
            if future.status in UNDER_WAY:  # its worker died with the result in hand, and others do it again
                done.add(future)
                continue
            case = futures.pop(future)
            if _killed(distributed, future):
                suspects.append(case)  # Dask blames all cases that the worker had, begun or not
            else:
                yield _outcome(future)
            for each in submit(islice(queue, 1)):
                done.add(each)
        for case in suspects:  # each with nothing beside it: only the culprit is killed again
            (future,) = submit([case])
            while future.status in UNDER_WAY:
                distributed.wait([future])
            fatal = _killed(distributed, future)
            yield lost(case, _DIED if limit is None else _OR_HUNG) if fatal else _outcome(future)


def _killed(distributed: Any, future: Any) -> bool:
    return future.status == "error" and isinstance(future.exception(), distributed.KilledWorker)


def _outcome(future: Any) -> Outcome:
    if future.status == "finished":
        outcome: Outcome = future.result()
        return outcome
    raise SolverError(
        "the cluster was lost: its scheduler does not answer, or gave up a case.",
        key="--cluster",
        cure="Finished cases are kept; run the same command again.",
    )


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise SpecError(
            "a cluster needs the extra packages of dobc_design[cluster], which are not installed.",
            key="--cluster",
            cure="`dobc doctor` says how to install them; without --cluster this machine's processors are used.",
        ) from None
    return distributed


def _client(distributed: Any, address: str, *, jobs: int) -> Any:
    if address == LOCAL:
        with _deaf():
            cluster = distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs="CRITICAL"
            )
        cluster.scheduler.allowed_failures = 0  # the suspects are done again here, one by one
        return _Owned(distributed.Client(cluster), cluster)
    try:
        return distributed.Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise SpecError(
            f"there is no Dask scheduler at {address[:100]!r} ({type(error).__name__}).",
            key="--cluster",
            cure="Start one with `dask scheduler`, or say --cluster local.",
        ) from error


class _Owned:
    """A client whose cluster ends with it."""

    def __init__(self, client: Any, cluster: Any) -> None:
        self.client, self.cluster = client, cluster

    def __enter__(self) -> Any:
        return self.client

    def __exit__(self, *error: object) -> None:
        self.client.close()
        self.cluster.close()


def _same_version(client: Any) -> None:
    """Refuse workers that lack the package, or have another version of it: their numbers would be others."""
    from dobc_design import __version__

    if not client.ncores():
        client.wait_for_workers(1, timeout=30)
    found = client.run(_version_here, on_error="return")
    for worker, version in found.items():
        if version != __version__:
            what = f"dobc_design {version}" if isinstance(version, str) else "no dobc_design"
            raise SpecError(
                f"the worker {worker} has {what}; this program is {__version__}.",
                key="--cluster",
                cure="Install the same version on all machines of the cluster.",
            )


def _version_here() -> str:
    from dobc_design import __version__

    return __version__
