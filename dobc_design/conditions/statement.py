"""One exact statement about a designed observer, decided: what it says, the verdict, the numbers
that show it."""

from collections.abc import Mapping
from dataclasses import field
from functools import partial
from typing import Any

from dobc_design._checks import noun
from dobc_design._show.cards import Shown
from dobc_design.verdict import Decided, Verdict


@noun
class Statement(Shown, Decided):
    """What was decided, and how.  ``kind``: "detectable", "hurwitz", "rate", "region", "gain",
    "noise", "lyapunov", "peak", "sampled" or a reason for impossibility.  ``text`` is a sentence;
    ``exact`` holds exact values as text."""

    kind: str
    text: str
    verdict: Verdict
    exact: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.verdict.value}: {self.text}"

    def to_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "text": self.text,
            "verdict": self.verdict.value,
            "exact": dict(self.exact),
        }


def _stated(verdict: Verdict, kind: str, text: str, /, **exact: str) -> Statement:
    return Statement(kind=kind, text=text, verdict=verdict, exact=exact)


proved = partial(_stated, Verdict.PROVED)
refuted = partial(_stated, Verdict.REFUTED)
undecided = partial(_stated, Verdict.UNDECIDED)
