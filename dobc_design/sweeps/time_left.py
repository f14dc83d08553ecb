"""How long a sweep will take still, said honestly: as an interval, and not before there is something to go by.

Cases are done in a shuffled order, so that those behind are a random sample of those ahead.  With k durations of mean
a and variance s2, and R cases ahead, the work ahead has mean R a and variance R s2 + R^2 s2 / k; divided by the number
of cases that run at once, as it was seen, this is the time left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

FEWEST = 5  # finished cases before anything is said
WIDTH = 2.0  # standard deviations to either side


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Where a sweep stands.  ``resumed`` of the ``done`` cases were there before; ``left`` in s, least and most."""

    total: int
    done: int
    resumed: int
    failed: int
    elapsed: float
    left: tuple[float, float] | None

    def __str__(self) -> str:
        parts = [f"{self.done} of {self.total} cases"]
        if self.resumed:
            parts.append(f"{self.resumed} of them from before")
        if self.failed:
            parts.append(f"{self.failed} failed")
        return f"{', '.join(parts)}; {self.time_left}"

    @property
    def time_left(self) -> str:
        """The time left in words."""
        if self.done == self.total:
            return f"finished after {duration(self.elapsed)}"
        if self.left is None:
            return "time left not known yet"
        low, high = (duration(value) for value in self.left)
        return f"about {high} left" if low == high else f"{low} to {high} left"


class Clock:
    """Durations of finished cases, gathered; ``left`` says how long the rest takes."""

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self.square = 0.0  # sum of squared deviations (Welford)

    def add(self, seconds: float) -> None:
        """One case took so long."""
        self.count += 1
        before = self.mean
        self.mean += (seconds - before) / self.count
        self.square += (seconds - before) * (seconds - self.mean)

    def left(self, ahead: int, *, elapsed: float) -> tuple[float, float] | None:
        """Seconds until ``ahead`` more cases are done, least and most; ``elapsed`` since the first began."""
        if self.count < FEWEST or elapsed <= 0 or self.mean <= 0:
            return None
        pace = elapsed / self.count  # with everything that costs time beside the cases themselves
        deviation = math.sqrt(self.square / (self.count - 1)) / self.mean  # in relation to the mean
        spread = WIDTH * deviation * math.sqrt(1 / ahead + 1 / self.count) if ahead else 0.0
        return ahead * pace * max(0.0, 1 - spread), ahead * pace * (1 + spread)


def duration(seconds: float) -> str:
    """A duration with as many digits as anybody wants to read: 8 s, 3 min, 2 h 10 min."""
    whole = max(0, round(seconds))
    if whole < 90:
        return f"{whole if whole < 10 else 5 * round(whole / 5)} s"
    minutes = round(whole / 60)
    if minutes < 90:
        return f"{minutes} min"
    hours, rest = divmod(10 * round(minutes / 10), 60)
    return f"{hours} h {rest} min" if rest and hours < 24 else f"{round(seconds / 3600)} h"
