"""A certified settling time and envelope of |e(t)|: the noun that ``certify_settling`` returns.

It evaluates what ``decide`` has proved, with outward rounding, and decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.conditions.schedule.claim import Stage, Staging
from dobc_design.conditions.schedule.decide import decayed, stage_rate
from dobc_design.errors import SpecError
from dobc_design.exact.number import float_above
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Settling(Shown):
    """A settling time: |e(t)|_inf <= tolerance for all t >= time, from |e(0)|_inf <= radius, |eps_i(0)| <= disturbance.

    PROVED with a ``staging``, for arbitrary switching among the modes; UNDECIDED without one.  ``single``: what one
    certificate for the whole box gives, for comparison; None if none is proved.
    """

    verdict: Verdict
    reason: str
    problem_name: str
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    staging: Staging | None = None
    single: Staging | None = None

    @property
    def time(self) -> float | None:
        """The certified settling time in s, rounded up; None if nothing is proved."""
        return None if self.staging is None else float_above(self.staging.time)

    @property
    def single_time(self) -> float | None:
        """The same with one certificate at one rate, in s, rounded up; None if there is none."""
        return None if self.single is None else float_above(self.single.time)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages in the order in which they take over; empty if nothing is proved."""
        return () if self.staging is None else self.staging.stages

    @overload
    def envelope(self, t: float) -> float: ...

    @overload
    def envelope(self, t: Sequence[float] | Array) -> Array: ...

    def envelope(self, t: float | Sequence[float] | Array) -> float | Array:
        """A bound of |e(t)|_inf, rounded up, at t >= 0 in s: a number or an array of times.

        Every stage's bound holds from its start on, so the least of them counts; it never rises.
        Raises: SpecError for a time that is negative or not finite, or if nothing is proved.
        """
        if not self.stages:
            raise SpecError("there is no envelope, because nothing is proved.", key="t", cure=self.reason)
        if isinstance(t, (int, float)):
            return self._bound(float(t))
        return np.array([self._bound(float(each)) for each in t], dtype=np.float64)

    def curve(self, *, until: float | None = None, samples: int = 400) -> tuple[Array, Array]:
        """Times (s) and bounds of |e|_inf, both (samples,), from 0 to ``until`` (the settling time), for plotting."""
        end = (self.time or 0.0) if until is None else until
        times = np.linspace(0.0, end, samples)
        return times, self.envelope(times)

    def _bound(self, t: float) -> float:
        if not (math.isfinite(t) and t >= 0):
            raise SpecError(f"t must be a time >= 0 in s; got {t}.", key="t")
        when = Fraction(t)
        bounds = (decayed(stage, when).hi * stage.height for stage in self.stages if stage.start <= when)
        return float_above(min(bounds))

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """The stages as text: number, kind, start (s), bound of |e|_inf there, rate (1/s)."""
        return [
            (
                str(k + 1),
                "quadratic" if stage.is_quadratic else "max-separable",
                significant_away_from_zero(stage.start, 6),
                significant_away_from_zero(stage.level * stage.height),
                significant_towards_zero(stage_rate(stage.certificate)),
            )
            for k, stage in enumerate(self.stages)
        ]

    def __repr__(self) -> str:
        lines = [f"Settling of {self.problem_name}: {self.verdict.value}. {self.reason}"]
        if self.single_time is not None and self.time is not None:
            lines.append(f"One certificate for the whole box gives {self.single_time:.6g} s.")
        if self.stages:
            lines += [f"{'stage':>5}  {'certificate':<13}  {'from (s)':>9}  {'|e| <=':>9}  {'rate (1/s)':>10}"]
            lines += [f"{a:>5}  {b:<13}  {c:>9}  {d:>9}  {e:>10}" for a, b, c, d, e in self.rows()]
        return "\n".join(lines)

    def _card(self) -> Card:
        return Card(
            title=f"Settling of {self.problem_name}",
            verdict=self.verdict.value,
            text=self.reason,
            heads=("stage", "certificate", "from (s)", "|e| ≤", "rate (1/s)"),
            rows=self.rows(),
        )
