"""The three answers a question of mathematics can get here: proved, refuted, undecided.

A Verdict has no truth value on purpose: ``if verdict`` would read "undecided" as yes or as no.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NoReturn


class Verdict(Enum):
    """Outcome of a decision; the value is the word used in JSON and in text."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"

    def __bool__(self) -> NoReturn:
        raise TypeError("a Verdict has three values; write `verdict is Verdict.PROVED`")

    def __str__(self) -> str:
        return self.value

    @classmethod
    def all_of(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """Return the verdict on "all of these hold".

        One refuted refutes; otherwise one undecided leaves it undecided; of none at all, proved.
        """
        found = set(verdicts)
        if cls.REFUTED in found:
            return cls.REFUTED
        return cls.UNDECIDED if cls.UNDECIDED in found else cls.PROVED
