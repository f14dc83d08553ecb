"""Work that is counted, so that every stage ends: steps of about 20 microseconds, not seconds.

A stage opens ``at_most``, loops inside ``spend``; what is spent does not depend on caches, so the
same input ends at the same place.  A clock enters only where a user asks for one (``until``).
Elsewhere nothing is limited.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from dobc_design.errors import SpecError

from .number import parse_number
from .reading import shown

LONGEST: Final = 366 * 24 * 3600  # s
SHORTEST: Final = 1e-3  # s
AFTERWARDS: Final = 0.1  # of the limit, for the second program


def read_time_limit(value: Any, *, key: str = "time_limit") -> Fraction:
    """A number of seconds > 0, at most a year.  Raises: SpecError with ``key`` for anything
    else."""
    seconds = parse_number(value, key)
    if not 0 < seconds <= LONGEST:
        message = (
            f"{key} must be a number of seconds > 0, at most {LONGEST} (a year); got "
            f"{shown(value)}."
        )
        raise SpecError(
            message, key=key, cure="For example 600; without it nothing is cut off by a clock."
        )
    return seconds


class WorkLimitError(Exception):
    """A stage may not go on; the text is the reason of its undecided check."""


@dataclass(slots=True)
class _Account:
    granted: int
    left: int


#: What one stage of `certify` may take.
STAGE: Final = 300_000
_ACCOUNT: Final[ContextVar[_Account | None]] = ContextVar("account", default=None)
# The seconds that were given, and when they end.
_CLOCK: Final[ContextVar[tuple[float, float] | None]] = ContextVar("clock", default=None)


@contextmanager
def at_most(steps: int) -> Iterator[None]:
    """Let the calls inside spend so many steps, about 20 microseconds each."""
    token = _ACCOUNT.set(_Account(steps, steps))
    try:
        yield
    finally:
        _ACCOUNT.reset(token)


@contextmanager
def until(seconds: float | None) -> Iterator[None]:
    """Let the accounts inside end so many seconds from now; None: as without it.  A clock outside
    that ends earlier stays."""
    clock = _CLOCK.get()
    if seconds is not None:
        own = seconds, time.monotonic() + seconds
        # A limit inside never lengthens the one around it.
        clock = own if clock is None or own[1] < clock[1] else clock
    token = _CLOCK.set(clock)
    try:
        yield
    finally:
        _CLOCK.reset(token)


def out_of_time() -> str | None:
    """Why nothing new may begin, where the time limit is over; else None."""
    clock = _CLOCK.get()
    if clock is None or time.monotonic() < clock[1]:
        return None
    return f"left out or cut off, because the time limit of {clock[0]:g} s is over."


def time_limit() -> float | None:
    """The seconds that were given; None without a clock."""
    clock = _CLOCK.get()
    return None if clock is None else clock[0]


def last_call() -> float | None:
    """When (``time.monotonic``) what only repeats a decision has to end; None without a clock."""
    clock = _CLOCK.get()
    return None if clock is None else clock[1] + clock[0] * AFTERWARDS


def seconds_left(most: float = math.inf) -> float:
    """How long a call of a library may still take, at most ``most``; > 0, so that every library
    takes it."""
    clock = _CLOCK.get()
    return most if clock is None else min(most, max(clock[1] - time.monotonic(), SHORTEST))


def exhausted() -> str | None:
    """Why the open account gives nothing more; None while it does, and without one."""
    account = _ACCOUNT.get()
    if account is None:
        return None
    if account.left < 0:
        return f"cut off after {account.granted} steps of work, the most that one stage may take."
    return out_of_time()


def spend(steps: int) -> None:
    """Take steps from the open account.  Raises: WorkLimitError where it is used up, or the time
    is.

    A loop over vectors of any length spends by its passes, not by their lengths: what grows like
    the problem ends.
    """
    account = _ACCOUNT.get()
    if account is not None:
        account.left -= steps
        if (why := exhausted()) is not None:
            raise WorkLimitError(why)
