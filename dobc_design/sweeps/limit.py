"""A limit on the time of one case: one that hangs is given up, and the others go on.

First an exception is raised in the thread of the case, which ends whatever is written in Python.  A library that does
not come back from a call never sees it; in a process of its own the case then ends together with the process.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import threading
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")
ENDED = 1  # exit code of a process that is ended for a case
GRACE = 1.0  # s, beside the limit once more, from the exception to the end of the process


class TooLong(KeyboardInterrupt):
    """A case is over its time.  An interrupt, because handlers of errors on the way let interrupts pass."""


def within(limit: float | None, work: Callable[[], Result], *, alone: bool) -> Result:
    """Do ``work`` and return its result; ``limit`` in s, None for none.

    ``alone``: this process does nothing else and may be ended when the exception is not heard.
    Raises: TooLong.
    """
    if limit is None:
        return work()
    alarm = _Alarm(limit, alone=alone)
    try:
        try:
            alarm.start()
            return work()
        finally:
            alarm.stop()
    finally:
        alarm.stop()  # again: the exception may have come while the first one was at work


class _Alarm:
    """Rings in the thread that makes it, unless it is stopped; once it is stopped, nothing comes any more."""

    def __init__(self, limit: float, *, alone: bool) -> None:
        self.limit, self.alone, self.thread = limit, alone, threading.get_ident()
        self.timer = threading.Timer(limit, self._ring)
        self.timer.daemon = True

    def start(self) -> None:
        if self.alone:  # a thread of C, which needs no turn in Python
            self.null = open(os.devnull, "w", encoding="ascii")  # noqa: SIM115 - closed by stop
            faulthandler.dump_traceback_later(2 * self.limit + GRACE, exit=True, file=self.null)
        self.timer.start()

    def _ring(self) -> None:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.thread), ctypes.py_object(TooLong))

    def stop(self) -> None:
        self.timer.cancel()
        if self.timer.is_alive():
            self.timer.join()
        if self.alone:
            faulthandler.cancel_dump_traceback_later()
            self.null.close()
