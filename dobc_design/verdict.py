"""The three answers a question of mathematics can get here: proved, refuted, undecided.

A Verdict has no truth value on purpose: ``if verdict`` would read "undecided" as yes or as no.  It
equals its word; comparing it with any other text is an error, so that a slip is never silently
false.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NoReturn

from ._show.cards import Card, html_of


class _Framed:
    """Shows itself in Jupyter; a class of its own, because an Enum reserves names like
    _repr_html_."""

    def _repr_html_(self) -> str:
        return html_of(Card(title="Verdict:", verdict=str(self)))


class Verdict(_Framed, Enum):
    """Outcome of a decision; the value is the word used in JSON and in text."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"

    def __bool__(self) -> NoReturn:
        raise TypeError("a Verdict has three values; write `verdict is Verdict.PROVED`")

    def __eq__(self, other: object) -> bool:
        if isinstance(other, str) and other not in ("proved", "refuted", "undecided"):
            raise ValueError(
                f'a Verdict is "proved", "refuted" or "undecided"; it was compared with {other!r}'
            )
        return self is other or self.value == other

    def __hash__(self) -> int:
        return hash(self.value)

    def __str__(self) -> str:
        return self.value

    @classmethod
    def all_of(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """Return the verdict on "all of these hold".

        One refuted refutes; otherwise one undecided leaves it undecided; of none at all, proved.
        Example:
            >>> dd.Verdict.all_of([dd.Verdict.PROVED, dd.Verdict.UNDECIDED]).value
            'undecided'
        """
        found = set(verdicts)
        if cls.REFUTED in found:
            return cls.REFUTED
        return cls.UNDECIDED if cls.UNDECIDED in found else cls.PROVED


class Decided:
    """What has a verdict, and says whether that is PROVED."""

    __slots__ = ()
    verdict: Verdict

    @property
    def is_proved(self) -> bool:
        """Whether it is proved; false where it is refuted or undecided."""
        return self.verdict is Verdict.PROVED
