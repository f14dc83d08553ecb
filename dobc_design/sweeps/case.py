"""One case, done: in this process or in a worker, always the same function with the same arguments.

Whatever goes wrong in a case is its result: a wrong problem, a solver, a lack of memory.  Nothing is raised.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

from dobc_design import __version__
from dobc_design.errors import DobcError, SpecError
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.file import read_problem_tables
from dobc_design.problem.problem import Problem
from dobc_design.sweeps.axes import Axis
from dobc_design.sweeps.keys import with_changes
from dobc_design.sweeps.limit import TooLong, within
from dobc_design.sweeps.plan import Base, Case
from dobc_design.sweeps.tasks import Task
from dobc_design.sweeps.values import read_value

Outcome = dict[str, Any]  # what the journal holds of a case
TIME = "time"  # kind of error of a case that was given up
WATCH = 1.0  # s between looks at whether the parent is still there
_GONE = 70  # exit code of a worker whose parent is gone; nobody reads it

_HELD = threading.Lock()


def build(base: Base, axes: tuple[Axis, ...], case: Case) -> Problem:
    """The problem of a case.  Raises: SpecError."""
    changes = {path: read_value(text) for axis, text in zip(axes, case.values, strict=True) for path in axis.keys}
    folder = None if base.folder is None else Path(base.folder)
    return read_problem_tables(with_changes(base.document, changes), folder=folder, default_name=base.name)


def run_case(
    base: Base, axes: tuple[Axis, ...], task: Task, case: Case, limit: float | None = None, alone: bool = False
) -> Outcome:
    """Build and do one case; the line of the journal.  Never raises but for interrupts.

    ``limit`` in s; ``alone``: the process may be ended with a case that does not keep it.
    """
    task.prepare()
    started = time.perf_counter()
    line: Outcome = {
        "case": case.number,
        "id": None,
        "values": list(case.values),
        "result": None,
        "error": None,
        "seconds": 0.0,
    }
    given = json.dumps([axis.name for axis in axes] + list(case.values), ensure_ascii=False)
    about = hashlib.sha256(given.encode("utf-8")).hexdigest()  # of a case that gives no problem
    made: list[Problem] = []

    def work() -> dict[str, Any]:
        made.append(build(base, axes, case))
        return task.run(made[0])

    try:
        line["result"] = within(limit, work, alone=alone)
    except TooLong:
        line["error"] = _too_long(limit)
    except DobcError as error:
        first = error.errors[0] if isinstance(error, SpecError) else error
        line["error"] = {"kind": first.kind, "key": first.key, "message": first.message, "cure": first.cure}
    except MemoryError:
        line["error"] = _error("memory", "The machine ran out of memory.")
    except Exception as error:  # noqa: BLE001 - one case that breaks must not end the others
        line["error"] = _error("internal", f"Internal error ({type(error).__name__}: {str(error)[:200]}).")
    about = problem_sha256(made[0]) if made else about
    identity = json.dumps([about, task.to_json(), __version__], sort_keys=True)
    line["id"] = hashlib.sha256(identity.encode("utf-8")).hexdigest()
    line["seconds"] = round(time.perf_counter() - started, 6)
    return line


def run_in_worker(
    base: Base, axes: tuple[Axis, ...], task: Task, case: Case, parent: int, limit: float | None
) -> Outcome:
    """``run_case`` in another process, which ends when ``parent``, the process that started it, is gone."""
    _watch(parent)
    return run_case(base, axes, task, case, limit, True)


def lost(case: Case, message: str) -> Outcome:
    """The line of a case whose worker died of it."""
    return {
        "case": case.number,
        "id": None,
        "values": list(case.values),
        "result": None,
        "error": _error("worker", message),
        "seconds": 0.0,
    }


def overdue(case: Case, limit: float) -> Outcome:
    """The line of a case that did not end with its time, but with its worker."""
    return lost(case, "") | {"error": _too_long(limit), "seconds": limit}


def to_be_done_again(line: Outcome, limit: float | None) -> bool:
    """Whether a case was given up for its time, and would get more of it now."""
    given_up = line["error"] is not None and line["error"].get("kind") == TIME
    return given_up and (limit is None or limit > line["seconds"])


def _too_long(limit: float | None) -> dict[str, Any]:
    message = f"The case was given up after {limit:g} s, the time limit."
    return _error(TIME, message) | {"cure": "The same sweep with a longer time limit, or none, does it again."}


def _error(kind: str, message: str) -> dict[str, Any]:
    return {"kind": kind, "key": None, "message": message, "cure": None}


def _watch(parent: int) -> None:
    """Once in every worker: Ctrl-C is the parent's business, and without a parent there is nothing to do."""
    if not _HELD.acquire(blocking=False):  # it has been done
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(_GONE)

    if os.name != "nt":  # Windows ends nobody's children and gives them no new parent
        threading.Thread(target=look, name="parent", daemon=True).start()
