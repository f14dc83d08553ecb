"""``sweep``: every case of a plan, each once, in parallel through joblib; what is done stays done.

The order of the cases is shuffled, always in the same way, so that what is behind stands for what
is ahead: the time left is honest, and a sweep that was stopped has looked everywhere a little.
"""

import ctypes
import hashlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import TimeoutError as NoAnswer  # what joblib raises
from os import PathLike
from pathlib import Path
from random import Random
from typing import Any, TypeVar

from dobc_design import __version__
from dobc_design._checks import noun
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.errors import DobcError, SpecError, refused
from dobc_design.exact.reading import Document, Table, shown
from dobc_design.exact.work import read_time_limit
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.load import Source
from dobc_design.simulation._arguments import whole

from .axes import Over
from .plan import Plan, Task, make_plan
from .result import TIME, Journal, Outcome, SweepResult, to_be_done_again

Backend = Document  # what joblib is to work with: processes of this machine, or a cluster
LOKY: Backend = {"backend": "loky", "inner_max_num_threads": 1}
LOCAL = "local"  # the name of a cluster on this machine
GRACE = 60.0  # s, beside the limit twice, that a case may take to hear that its time is over

DIED = "The worker died while running this case: out of memory, killed, or a fault in a library."

Result = TypeVar("Result")


@noun
class State:
    """Where a sweep stands.  ``resumed`` of the ``done`` cases were there before."""

    total: int
    done: int
    resumed: int
    failed: int

    def __str__(self) -> str:
        before = f", {self.resumed} of them from before" if self.resumed else ""
        return (
            f"{self.done} of {self.total} "
            f"cases{before}{f', {self.failed} failed' if self.failed else ''}"
        )


Progress = Callable[[State], None]


@shows_progress
def sweep(
    problem: Source,
    over: Over,
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
    progress: Reports[State] = None,
) -> SweepResult:
    """Certify or simulate a problem with some of its keys varied.

    ``over``: key of the problem file -> values: a sequence, or text as in ``dobc sweep``:
    ``"1:5:9"``, ``"tanh(y),y"``, ``"~uniform(0.1,1)"`` (drawn ``samples`` times with ``seed``); see
    ``axes``.  Listed values make a grid. ``task``: "certify" (with ``everything`` as there) or
    "simulate" (``runs`` runs of each case). ``out``: a folder; every finished case is written there
    at once, and a sweep that was stopped goes on from there when it is started again.  A folder of
    another sweep is refused, unless ``force`` begins anew. ``jobs``: processes, by default one per
    processor; 1 is this process.  A program that is run as a file needs ``if __name__ ==
    "__main__":`` around the call for more than one.  ``cluster``: the address of a Dask scheduler,
    or "local" for a cluster of ``jobs`` processes here.  ``time_limit``: seconds after which a case
    is given up, recorded as failed, and the rest goes on; with it one job is another process, too.
    A later sweep with a longer limit does such cases again.  ``progress``: True for a bar, or a
    function of the state after every case.
    Returns: a SweepResult; a case that fails is in it with its error.
    Raises: SpecError for a wrong argument, and if no case at all gives a problem; CertificateError,
    SolverError when the machine or the cluster fails, what is finished being kept.
    Example:
        >>> dd.sweep("clock-sync", {"pinning.gains.gateway": [0, 2]}, jobs=1).column("verdict")
        ['refuted', 'proved']
    """
    if jobs is not None:
        whole(jobs, "jobs", least=1)
    limit = None if time_limit is None else read_time_limit(time_limit)
    plan = make_plan(
        problem,
        over,
        task=Task(kind=task, everything=everything, runs=runs),
        samples=samples,
        seed=seed,
    )
    _require_one(plan)
    folder = None if out is None else Path(out)
    # A cluster that is not there is refused before anything is written, or with ``force`` replaced.
    with (
        _backend(cluster, jobs, len(plan)) as backend,
        Journal(folder, plan, anew=force) as journal,
    ):
        _run(
            journal,
            jobs=jobs,
            backend=backend,
            limit=None if limit is None else float(limit),
            progress=report_to(progress),
        )
        result = SweepResult(plan=plan, lines=journal.lines, folder=folder)
        if folder is not None:
            result.save(folder / "results.csv", force=True)
            with suppress(SpecError):  # without the extra "store" the CSV file holds everything
                result.save(folder / "results.parquet", force=True)
    return result


def _require_one(plan: Plan) -> None:
    """Refuse a sweep of which no case gives a problem: the mistake lies in what is varied.  Raises:
    SpecError."""
    first: SpecError | None = None
    for case in range(len(plan)):
        try:
            plan.problem(case)
            return
        except SpecError as error:
            first = first or error
    if first is not None:
        raise first


def _run(
    journal: Journal, *, jobs: int | None, backend: Backend, limit: float | None, progress: Progress
) -> None:
    """Do the cases that are not done, or were given up and get more time now."""
    plan, done = journal.plan, journal.done
    for case, line in list(done.items()):
        if to_be_done_again(line, limit):
            del done[case]
    order = list(range(len(plan)))
    Random(0).shuffle(order)
    left = [case for case in order if case not in done]
    resumed = len(done)
    failed = sum(line["error"] is not None for line in done.values())

    def report() -> None:
        progress(State(total=len(plan), done=len(done), resumed=resumed, failed=failed))

    report()
    for line in outcomes(plan, left, jobs=jobs, backend=backend, limit=limit):
        journal.append(line)
        failed += line["error"] is not None
        report()


class TooLong(KeyboardInterrupt):
    """A case is over its time.  An interrupt, because handlers of errors on the way let interrupts
    pass."""


def within(limit: float | None, work: Callable[[], Result]) -> Result:
    """Do ``work`` and return its result; raise TooLong in it after ``limit`` s, once C code comes
    back."""
    if limit is None:
        return work()
    thread, error = ctypes.c_ulong(threading.get_ident()), ctypes.py_object(TooLong)
    timer = threading.Timer(limit, ctypes.pythonapi.PyThreadState_SetAsyncExc, (thread, error))
    timer.daemon = True
    timer.start()
    try:
        return work()
    finally:
        timer.cancel()
        timer.join()  # it may be ringing: nothing comes later


def run_case(plan: Plan, case: int, limit: float | None = None) -> Outcome:
    """Build and do one case within ``limit`` seconds; the line of the journal.  Whatever goes wrong
    in a case is its result: a wrong problem, a solver, a lack of memory.  Never raises but for
    interrupts."""
    plan.task.prepare()
    started = time.perf_counter()
    found: Outcome = {}

    def work() -> None:
        problem = plan.problem(case)
        depends_on = [problem_sha256(problem), plan.task.to_json(), __version__]
        identity = json.dumps(depends_on, sort_keys=True)
        found["id"] = hashlib.sha256(identity.encode("utf-8")).hexdigest()
        found["result"] = plan.task.run(problem)

    try:
        within(limit, work)
    except TooLong:
        found["error"] = _too_long(limit)
    except DobcError as error:
        first = error.errors[0] if isinstance(error, SpecError) else error
        found["error"] = _error(first.kind, first.message, key=first.key, cure=first.cure)
    except MemoryError:
        found["error"] = _error("memory", "The machine ran out of memory.")
    except Exception as error:  # noqa: BLE001 - one case that breaks must not end the others
        message = f"Internal error ({type(error).__name__}: {str(error)[:200]})."
        found["error"] = _error("internal", message)
    return _line(plan, case) | found | {"seconds": round(time.perf_counter() - started, 6)}


def _line(plan: Plan, case: int) -> Outcome:
    values = list(plan.values(case))
    return {
        "case": case,
        "id": None,
        "values": values,
        "result": None,
        "error": None,
        "seconds": 0.0,
    }


def _error(kind: str, message: str, *, key: str | None = None, cure: str | None = None) -> Document:
    return {"kind": kind, "key": key, "message": message, "cure": cure}


def _too_long(limit: float | None) -> Document:
    cure = "The same sweep with a longer time limit, or none, does it again."
    return _error(TIME, f"The case was given up after {limit:g} s, the time limit.", cure=cure)


def outcomes(
    plan: Plan, cases: Sequence[int], *, jobs: int | None, backend: Backend, limit: float | None
) -> Iterator[Outcome]:
    """The lines of the cases by joblib, each as soon as it is there.  When a worker dies, or hangs
    in a library, what was in hand is done again one by one; only a case that ends so on its own is
    given up, and recorded."""
    from joblib import cpu_count, delayed

    if not cases:
        return
    pool = _pool(min(jobs or cpu_count(), len(cases)), backend, limit)

    def calls(batch: Sequence[int], begun: list[int]) -> Iterator[Any]:
        for case in batch:
            begun.append(case)
            yield delayed(run_case)(plan, case, limit)

    left = dict.fromkeys(cases)
    suspects: list[int] = []  # in hand when a worker was lost
    while left:
        batch = suspects[:1] or list(left)
        begun: list[int] = []
        try:
            with _deaf():
                lines = pool(calls(batch, begun))
            for line in lines:
                del left[line["case"]]
                yield line
        except (BrokenProcessPool, NoAnswer) as error:
            suspects = begun
            if len(batch) == 1:
                del left[batch[0]]
                yield _line(plan, batch[0]) | _lost(error, limit)
        suspects = [case for case in suspects if case in left]


def _pool(jobs: int, backend: Backend, limit: float | None) -> Any:
    from joblib import Parallel, parallel_config

    # One job that may be ended is done in another process: two, of which one is idle.
    apart = jobs == 1 and limit is not None
    processes = 2 if apart else jobs
    if backend != LOKY:  # as many as the cluster has
        processes = -1
    with parallel_config(**backend):
        return Parallel(
            n_jobs=processes,
            pre_dispatch=1 if apart else "2 * n_jobs",
            return_as="generator_unordered",
            batch_size=1,
            # from one finished case to the next
            timeout=None if limit is None else 2 * limit + GRACE,
            initializer=_begin_worker,
            initargs=(os.getpid(),),
        )


def _lost(error: Exception, limit: float | None) -> Outcome:
    """What is recorded of a case whose worker gave no answer in time, or died."""
    if isinstance(error, NoAnswer):
        return {"error": _too_long(limit), "seconds": limit}
    return {"error": _error("worker", DIED)}


@contextmanager
def _deaf() -> Iterator[None]:
    """A moment in which processes begin that are to leave Ctrl-C to this one."""
    before = signal.getsignal(signal.SIGINT)
    own = threading.current_thread() is threading.main_thread()  # to which signals come
    if own:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        if own:
            signal.signal(signal.SIGINT, before)


def _begin_worker(parent: int) -> None:
    """Once in every worker: Ctrl-C is the parent's business, and without a parent there is nothing
    to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os._exit(1)

    threading.Thread(target=look, daemon=True).start()


@contextmanager
def _backend(cluster: str | None, jobs: int | None, cases: int) -> Iterator[Backend]:
    """What joblib is to work with: processes of this machine, a Dask cluster at an address, or
    "local": one begun here.
    Raises: SpecError without the extra "cluster" or a scheduler at that address, and for workers of
    another version."""
    if cluster is None:
        yield LOKY
        return
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        cure = (
            "`dobc doctor` says how to install them; without --cluster this machine's processors "
        )
        raise refused(
            "--cluster",
            "a cluster needs the extra packages of dobc_design[cluster], which are not installed.",
            f"{cure}are used.",
        ) from None
    with ExitStack() as stack:
        try:
            address = cluster
            if cluster == LOCAL:
                from joblib import cpu_count

                with _deaf():
                    own = LocalCluster(
                        n_workers=min(jobs or cpu_count(), cases),
                        threads_per_worker=1,
                        dashboard_address=None,
                        silence_logs=50,
                    )
                address = stack.enter_context(own)
            client = stack.enter_context(Client(address, timeout="10s"))
            client.wait_for_workers(1, timeout=30)
        except (OSError, ValueError) as error:  # a TimeoutError among them
            raise refused(
                "--cluster",
                f"there is no Dask scheduler at {shown(cluster)}.",
                "Start one with `dask scheduler`, or say --cluster local.",
            ) from error
        _require_this_version(client.run(_version, on_error="return"))
        yield {"backend": "dask"}


def _require_this_version(found: Table) -> None:
    """Raise SpecError unless every worker has this program: its numbers would be others."""
    for worker, version in found.items():
        if version != __version__:
            message = f"the worker {worker} has another dobc_design, or none; this program is "
            raise refused(
                "--cluster",
                f"{message}{__version__}.",
                "Install the same version on all machines of the cluster.",
            )


def _version() -> str:
    return __version__
