"""One line of the evidence table."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """What was compared, how often, how often it failed; ``notes`` are sentences with the numbers
    behind it.

    ``failures`` holds one text per failure, enough to repeat the case (its seed).
    """

    what: str
    count: int
    failures: Sequence[str]
    notes: Sequence[str] = ()
    least: int = 0  # a count below this is a failure too

    @property
    def ok(self) -> bool:
        return not self.failures and self.count >= self.least
