"""A certified settling time in rows and words: which certificate takes over when, and what each stage allows.

Handed over by whoever has proved it; computes nothing but what a number needs to be shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dobc_design.conditions.schedule.checks import StageTiming
from dobc_design.conditions.schedule.decide import stage_rate
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.exact.number import float_above, float_below
from dobc_design.report.region_words import lower, upper

HEADS: Final = ("stage", "certificate", "from t =", "level V ≤", "so |e|∞ ≤", "rate in 1/s", "held for", "late by")
NONE: Final = "–"
_KINDS: Final = {False: "max-separable", True: "quadratic"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRow:
    """One stage, ready to be shown; everything is plain text."""

    number: str
    kind: str
    start: str
    level: str
    bound: str
    rate: str
    held: str
    late: str

    @property
    def cells(self) -> tuple[str, ...]:
        """In the order of HEADS."""
        return (self.number, self.kind, self.start, self.level, self.bound, self.rate, self.held, self.late)


def stage_rows(settling: Settling, timings: Sequence[StageTiming]) -> list[StageRow]:
    """The stages in the order in which they take over; ``timings``: one per stage, or none at all."""
    timings = timings or [StageTiming()] * len(settling.stages)
    return [
        StageRow(
            number=str(place + 1),
            kind=_KINDS[stage.is_quadratic],
            start=f"{upper(float_above(stage.start))} s",
            level=upper(float_above(stage.level)),
            bound=upper(float_above(stage.level * stage.height)),
            rate=lower(float_below(stage_rate(stage.certificate))),
            held=NONE if timing.sampling is None else f"{lower(timing.sampling.period)} s",
            late=NONE if timing.delay is None else f"{lower(timing.delay.delay)} s",
        )
        for place, (stage, timing) in enumerate(zip(settling.stages, timings, strict=True))
    ]


def settling_view(settling: Settling | None, timings: Sequence[StageTiming]) -> dict[str, Any] | None:
    """What the page and the Markdown text show; None without a proved settling time."""
    if settling is None or settling.time is None:
        return None
    return {
        "heads": HEADS,
        "rows": stage_rows(settling, timings),
        "sentence": settling_sentence(settling),
        "stages": _stages_sentence(settling),
        "timing": timing_sentence(timings),
    }


def settling_sentence(settling: Settling) -> str:
    """The whole claim; a time is never shown shorter than it is, nor the box of starts larger."""
    errors = f" and |εᵢ| ≤ {lower(settling.disturbance)} for every i" if settling.disturbance else ""
    count = len(settling.stages)
    return (
        f"From every start with |e|∞ ≤ {lower(settling.radius)}{errors} it is proved that |e(t)|∞ ≤"
        f" {upper(float_above(settling.tolerance))} for all t ≥ {upper(settling.time or 0.0)} s,"
        f" {'by one certificate' if count == 1 else f'by {count} certificates in turn'}."
    )


def _stages_sentence(settling: Settling) -> str:
    if len(settling.stages) == 1:
        return "One certificate serves all the way."
    return (
        "Each stage is a certificate of its own. It takes over at the time given, when the one before has brought the"
        " error so far down that this is inside its own region; every bound goes on to hold afterwards."
    )


def timing_sentence(timings: Sequence[StageTiming]) -> str | None:
    """What the last two columns mean, and how far they are proved; None where nothing is said."""
    if not any(timing.sampling or timing.delay for timing in timings):
        return None
    return (
        "Held for: couplings and pinning may be held so long between samples while the error is in that stage’s box."
        " Late by: messages may be late by so much, and half of that stage’s rate is left. Both hold for a loop that is"
        " in the box and were decided exactly when this was written; the certificate holds them for its whole region"
        " only. Quadratic stages say nothing about either."
    )


def envelope_alt(settling: Settling) -> str:
    """The picture of the envelope in words."""
    time = settling.time
    return (
        f"Certified bound of |e|∞ over time: from {upper(float(settling.envelope(0.0)))} down to"
        f" {lower(settling.tolerance)} at {'–' if time is None else upper(time)} s, in {len(settling.stages)} stage(s)."
    )
