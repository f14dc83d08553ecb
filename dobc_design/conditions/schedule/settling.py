"""A proved settling time, and the bound of |e| until then and after.

It evaluates what ``decide`` has proved, and proves nothing itself.
"""

import bisect
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import overload

import numpy as np

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ZERO, float_above
from dobc_design.exact.reading import Texts
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import timing_words
from dobc_design.verdict import Verdict

from .claim import ARC_WISE, QUADRATIC, SCHEDULE, SEPARABLE, Cycles, Descent, Tube
from .decide import bound_after, rate_near

CALLED = {
    SEPARABLE: "a max-separable certificate",
    QUADRATIC: "a quadratic certificate",
    ARC_WISE: "an arc-wise certificate",
    SCHEDULE: "weights that keep to the guarantee",
}


def guarantee_of(loop: Loop, claim: Descent) -> str | None:
    """Which signals a claim is about, in words; None for arbitrary switching."""
    # A tube follows the modes only where the guarantee says which one is on at which time.
    timed = loop.guarantee.round is not None and len(claim.tube.times) > 1
    if timed or isinstance(claim.certificate, Cycles):
        return loop.guarantee.in_words()
    return None


def proved_reason(loop: Loop, claim: Descent) -> str:
    """What a proved claim says, in a sentence."""
    signals = guarantee_of(loop, claim)
    about = "" if signals is None else f"for {signals}: "
    if loop.timing is not None:
        about += f"with {timing_words(loop.timing)} "
    how = f"by {CALLED[claim.kind]}."
    if claim.tube.ends:
        until = f"{float(claim.tube.ends):.6g} s"
        how = f"by a box that moves until {until} and then {CALLED[claim.kind]}."
    tolerance = f"{float(claim.tolerance):.4g}"
    return f"{about}|e(t)|_inf <= {tolerance} for all t >= {float(claim.time):.6g} s, {how}"


@noun
class Stage(Shown):
    """A part of the way: its ``kind``, from ``start`` (s) on, the ``bound`` of |e|_inf there, its
    rate (1/s)."""

    kind: str
    start: Fraction
    bound: Fraction
    rate: Fraction | None

    def cells(self) -> Texts:
        """As text: kind, start (s), bound of |e|_inf there, rate (1/s)."""
        start = significant_away_from_zero(self.start, 6)
        bound = significant_away_from_zero(self.bound)
        rate = "" if self.rate is None else significant_towards_zero(self.rate)
        return (self.kind, start, bound, rate)


@noun
class Settling(Shown):
    """A settling time: |e(t)|_inf <= tolerance for all t >= time, from |e(0)|_inf <= radius,
    |eps_i(0)| <= disturbance.

    PROVED with a ``claim``, for arbitrary switching among the modes or, in words, the signals of a
    ``guarantee``; UNDECIDED without one.  ``single``: what one certificate for the whole box gives;
    None if none is proved.
    """

    verdict: Verdict
    reason: str
    problem_name: str
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    claim: Descent | None = None
    single: Descent | None = None
    guarantee: str | None = None
    unit: str = ""  # of the states, where all components share one

    @property
    def time(self) -> float | None:
        """The certified settling time in s, rounded up; None if nothing is proved."""
        return None if self.claim is None else float_above(self.claim.time)

    @property
    def single_time(self) -> float | None:
        """The same with one certificate at one rate, in s, rounded up; None if there is none."""
        return None if self.single is None else float_above(self.single.time)

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The tube, if it has any length, and the certificate that takes over; empty if nothing is
        proved."""
        claim = self.claim
        if claim is None:
            return ()
        tube = claim.tube
        last = Stage(
            kind=claim.kind,
            start=tube.ends,
            bound=claim.level * claim.height,
            rate=rate_near(claim.certificate) or None,
        )
        if not tube.ends:
            return (last,)
        moving = Stage(kind="moving box", start=ZERO, bound=max(tube.widths(0)), rate=None)
        return (moving, last)

    @overload
    def envelope(self, t: float) -> float: ...

    @overload
    def envelope(self, t: Sequence[float] | Array) -> Array: ...

    def envelope(self, t: float | Sequence[float] | Array) -> float | Array:
        """A bound of |e(t)|_inf, rounded up, at t >= 0 in s: a number or an array of times.  It is
        that of the box until the end of the tube, then that of the certificate, which may begin
        with more than the last box. Raises: SpecError for a time that is negative or not finite, or
        if nothing is proved."""
        if self.claim is None:
            what = "there is no envelope, because nothing is proved."
            raise SpecError(what, key="t", cure=self.reason)
        if isinstance(t, (int, float)):
            return _bound(self.claim, float(t))
        return np.array([_bound(self.claim, float(each)) for each in t], dtype=np.float64)

    def curve(self, *, until: float | None = None, samples: int = 400) -> tuple[Array, Array]:
        """Times (s) and bounds of |e|_inf, both (samples,), from 0 to ``until`` (the settling
        time), for plotting."""
        last = (self.time or 0.0) if until is None else until
        times = np.linspace(0.0, last, samples)
        return times, self.envelope(times)

    def rows(self) -> list[Texts]:
        """The stages as text: number, kind, start (s), bound of |e|_inf there, rate (1/s)."""
        return [(str(k), *stage.cells()) for k, stage in enumerate(self.stages, start=1)]

    def __repr__(self) -> str:
        lines = [f"Settling of {self.problem_name}: {self.verdict.value}. {self.reason}"]
        if self.single_time is not None and self.time is not None:
            lines.append(f"One certificate for the whole box gives {self.single_time:.6g} s.")
        if self.stages:
            heads = ("stage", "certificate", "from (s)", "|e| <=", "rate (1/s)")
            for a, b, c, d, e in (heads, *self.rows()):
                lines.append(f"{a:>5}  {b:<13}  {c:>9}  {d:>9}  {e:>10}")
        return "\n".join(lines)

    def _card(self) -> Card:
        return Card(
            title=f"Settling of {self.problem_name}",
            verdict=self.verdict.value,
            text=self.reason,
            heads=("stage", "certificate", "from (s)", "|e| ≤", "rate (1/s)"),
            rows=self.rows(),
        )


def _bound(claim: Descent, t: float) -> float:
    """A bound of |e(t)|_inf, rounded up."""
    if not (math.isfinite(t) and t >= 0):
        raise SpecError(f"t must be a time >= 0 in s; got {t}.", key="t")
    when = Fraction(t)
    if when < claim.tube.ends:
        return float_above(_width_at(claim.tube, when))
    return float_above(bound_after(claim, when).hi)


def _width_at(tube: Tube, when: Fraction) -> Fraction:
    """The largest entry of the box at a time before the end of the tube, exactly."""
    k = bisect.bisect_right(tube.times, when) - 1
    before, after = tube.times[k : k + 2]
    part = (when - before) / (after - before)
    widest = ZERO
    for face in (tube.upper, tube.lower):
        for a, b in zip(face[k], face[k + 1], strict=True):
            widest = max(widest, a + part * (b - a))
    return widest
