"""A tube and the certificate that takes over, decided: every row, the start, the hand-over and the
tolerance.

The statement and its proof are in ``claim``.  Rows are decided in floats with outward bounds,
exponentials are enclosed, all else is rational.  Also the noun that ``certify_settling`` returns,
which evaluates what was proved.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, verify_lure
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.reason import pins_obstacle
from dobc_design.conditions.schedule.claim import (
    ONE,
    QUADRATIC,
    SCHEDULE,
    SEPARABLE,
    ZERO,
    Descent,
    Last,
    Tube,
)
from dobc_design.conditions.schedule.cycles import Cycles, shrunk
from dobc_design.conditions.schedule.cycles import why_not as why_not_cycles
from dobc_design.conditions.schedule.rows import Box, MovingRows, moving_rows
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import (
    composite_rate,
    error_bound_obstacle,
    verify_composite,
)
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.interval import Interval, sqrt
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.number import float_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]
FINEST: Final = 16
CALLED: Final = {
    SEPARABLE: "a max-separable certificate",
    QUADRATIC: "a quadratic certificate",
    SCHEDULE: "weights that keep to the guarantee",
}


def why_not(loop: Loop, W: Matrix | None, claim: Descent) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    needs = _needs(loop, W, claim)
    return next((words for holds, words in needs if not holds), None)


def open_segments(loop: Loop, tube: Tube, *, disturbance: Fraction) -> list[int] | None:
    """The segments of a tube whose rows are not proved; None where rows cannot be decided."""
    boxes, on = Box.of(tube.upper, tube.lower), loop.guarantee.modes_on(tube.times)
    most = max(x for face in (tube.upper, tube.lower) for box in face for x in box)
    rows = RowsBySize(loop, most)
    load = np.array([float_above(noise(tube, disturbance, time).hi) for time in tube.times])
    sizes = boxes.above.max(axis=(1, 2))
    groups: dict[tuple[str | None, int], list[int]] = {}
    for k, mode in enumerate(on):
        groups.setdefault((mode, rows.level(max(sizes[k], sizes[k + 1]))), []).append(k)
    left = list[int]()
    for (mode, level), own in groups.items():
        found = None if mode is None else rows.get(mode, level)
        if found is None and mode is not None:
            return None
        left += own if found is None else found.open_segments(boxes, tube.times, load, only=own)
    return sorted(left)


@dataclass(frozen=True, slots=True)
class RowsBySize:
    """Moving rows of a mode, or under "" of all modes, for boxes up to ``most``, in tables as wide
    as boxes need."""

    loop: Loop
    most: Fraction
    known: dict[tuple[str, int], MovingRows | None] = field(default_factory=dict)

    def level(self, size: float) -> int:
        """The finest tables that reach as far as a box of this size."""
        return max((k for k in range(FINEST) if self._reach(k) >= size), default=0)

    def get(self, mode: str, level: int = 0) -> MovingRows | None:
        """As ``moving_rows``."""
        if (mode, level) not in self.known:
            modes = [mode] if mode else None
            self.known[mode, level] = moving_rows(self.loop, self._reach(level), modes)
        return self.known[mode, level]

    def _reach(self, level: int) -> Fraction:
        return self.most / Fraction(4) ** level


def noise(tube: Tube, disturbance: Fraction, time: Fraction) -> Interval:
    """Enclose the bound of |C eps_i| and E from ``time`` (s) on; 0 without an exosystem."""
    if tube.error is None:
        return Interval.point(ZERO)
    return shrunk(disturbance, tube.error.beta, time) * sqrt(Interval.point(tube.error.size))


def level_at_the_end(loop: Loop, claim: Descent) -> Interval:
    """Enclose the largest size W that the certificate may have at the end of the tube; its square
    if quadratic."""
    tube, own = claim.tube, claim.certificate
    left, widths = noise(tube, claim.disturbance, tube.ends), tube.widths(-1)
    if not isinstance(own, Lure):
        size = Interval.point(
            max(b / v for b, v in zip(widths, weights_then(loop, claim), strict=True))
        )
        return size if own.error is None else size + left * own.error.kappa
    b, P_e = [x for x in widths for _ in range(loop.m)], own.P_e.entries
    total = sum((abs(x) * b[i] * b[j] * (1 + (i != j)) for (i, j), x in P_e.items()), ZERO)
    return (left * claim.stretch) ** 2 * loop.n + total


def weights_then(loop: Loop, claim: Descent) -> Sequence[Fraction]:
    """The weights v (n,) with which a certificate that is not quadratic takes over."""
    own, turns = claim.certificate, loop.guarantee.round
    if isinstance(own, Separable):
        return tuple(own.v)
    if isinstance(own, Lure) or turns is None or len(own.phases) != len(turns.phases):
        return (ONE,) * loop.n
    return own.phases[turns.at(claim.tube.ends)[0]].v[0]


def rate_near(certificate: Last) -> Fraction:
    """The rate (1/s) at which the size of a certificate decays; 0 where it is only known to
    stay."""
    return (
        composite_rate(certificate)
        if isinstance(certificate, Separable)
        else certificate.rate or ZERO
    )


def bound_after(claim: Descent, time: Fraction) -> Interval:
    """Enclose a bound of |e|_inf from ``time`` (s) on, not before the end of the tube."""
    return (
        shrunk(claim.level, rate_near(claim.certificate), max(ZERO, time - counted_from(claim)))
        * claim.height
    )


def counted_from(claim: Descent) -> Fraction:
    """When (s) the size begins to decay: weights that move fall phase by phase, and one may have
    begun just now."""
    own = claim.certificate
    waits = [each.times[-1] for each in own.phases] if isinstance(own, Cycles) else []
    return claim.tube.ends + max(waits, default=ZERO)


def _needs(loop: Loop, W: Matrix | None, claim: Descent) -> Iterator[tuple[bool, str]]:
    """What has to hold, in turn, and the words if it does not."""
    yield not loop.pins.curved, str(pins_obstacle(loop))
    tube, exosystem = claim.tube, loop.joint_exosystem
    yield len(tube.upper[0]) == loop.n, f"a box must have {loop.n} entries, one per agent."
    yield (
        (tube.error is not None) == (exosystem is not None),
        "P, beta and size belong to an [exosystem].",
    )
    if exosystem is not None:
        yield W is not None, "with an [exosystem] it needs an observer gain W."
        if W is not None and tube.error is not None:
            obstacle = error_bound_obstacle(exosystem, W, tube.error)
            yield (
                obstacle is None and tube.error.beta > 0,
                f"the observer error of the tube: {obstacle}",
            )
    else:
        yield claim.disturbance == 0, "without an [exosystem] there is no observer error."
    yield (
        min(tube.upper[0] + tube.lower[0]) >= claim.radius,
        "its first box does not hold all starts.",
    )
    mixing = any(
        x
        for k in loop.pulls.gains.values()
        for c, row in enumerate(k)
        for d, x in enumerate(row)
        if c != d
    )
    yield (
        not mixing or tube.upper == tube.lower,
        "with gains that mix components its faces have to be alike.",
    )
    if len(tube.times) > 1:
        left = open_segments(loop, tube, disturbance=claim.disturbance)
        yield (
            left is not None,
            "its rows cannot be decided: a coupling is not defined, or turns too often.",
        )
        if left:
            yield (
                False,
                f"a row does not hold between {float(tube.times[left[0]]):.6g} s and the "
                "next time.",
            )
    yield from _last(loop, W, claim)
    yield (
        bound_after(claim, claim.time).hi <= claim.tolerance,
        "it does not bring |e|_inf down to the tolerance by the time claimed.",
    )


def _last(loop: Loop, W: Matrix | None, claim: Descent) -> Iterator[tuple[bool, str]]:
    """The certificate that takes over, and that the last box lies in its level set."""
    own, error = claim.certificate, claim.tube.error
    if not isinstance(own, Lure):
        yield claim.stretch == 1, "stretch is 1 unless the certificate is quadratic."
        if isinstance(own, Separable):
            answer = verify_composite(loop, W, own)
            yield answer.verdict is Verdict.PROVED, answer.reason
            tallest = max(own.v)
        else:
            reason = why_not_cycles(loop, W, own)
            yield reason is None, f"the weights under the guarantee: {reason}"
            tallest = own.most
            turns = loop.guarantee.round
            begun = turns is not None and turns.at(claim.tube.ends)[1] == claim.tube.ends
            yield not own.phases or begun, "weights that move take over only where a phase begins."
        if own.error is not None and error is not None:
            same = (own.error.P, own.error.beta, own.error.size) == (
                error.P,
                error.beta,
                error.size,
            )
            yield same, "the certificate and the tube have different P."
        yield claim.height >= tallest, "height must be at least max v."
        yield (
            own.rho is None or claim.level <= own.rho,
            "its level set reaches beyond the box of its rows.",
        )
        square = claim.level
    else:
        yield own.rate > 0, "its rate must be > 0."
        decision = verify_lure(loop, own)
        yield decision.verdict is Verdict.PROVED, decision.reason
        yield (
            (own.P is None) == (error is None),
            "with an [exosystem] the certificate needs a pair P, Q.",
        )
        if own.P is not None and own.Q is not None and W is not None and error is not None:
            yield (
                multiply(own.P, W) == own.Q,
                "its pair (P, Q) belongs to another W: Q must equal P W.",
            )
            gap = SparseSymmetric.from_dense(error.P).scaled(claim.stretch**2)
            gap += SparseSymmetric.from_dense(own.P).negated()
            fits = decide_positive_semidefinite(gap).verdict is Verdict.PROVED
            yield fits, "stretch^2 P (of the tube) - P is not semidefinite."
        tallest = max(diagonal_of_inverse(own.P_e))
        yield (
            claim.height**2 >= tallest,
            "height^2 must be at least every diagonal entry of P_e^-1.",
        )
        square = claim.level**2
        places = () if own.radius is None else relied_differences(loop)
        inside = all(
            square * width <= (own.radius or ZERO) ** 2 for width in differences(own.P_e, places)
        )
        yield inside, "its level set reaches beyond its radius."
    yield (
        square >= level_at_the_end(loop, claim).hi,
        "the last box of the tube does not lie in its level set.",
    )


def guarantee_of(loop: Loop, claim: Descent) -> str | None:
    """Which signals a claim is about, in words; None for arbitrary switching."""
    timed = loop.guarantee.round is not None and len(claim.tube.times) > 1
    return loop.guarantee.in_words() if timed or isinstance(claim.certificate, Cycles) else None


def proved_reason(loop: Loop, claim: Descent) -> str:
    """What a proved claim says, in a sentence."""
    signals = guarantee_of(loop, claim)
    how = f"by {CALLED[claim.kind]}."
    if claim.tube.ends:
        how = f"by a box that moves until {float(claim.tube.ends):.6g} s and then {how[3:]}"
    about = "" if signals is None else f"for {signals}: "
    return (
        f"{about}|e(t)|_inf <= {float(claim.tolerance):.4g} for all t >= "
        f"{float(claim.time):.6g} s, {how}"
    )


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Stage(Shown):
    """A part of the way: its ``kind``, from ``start`` (s) on, the ``bound`` of |e|_inf there, its
    rate (1/s)."""

    kind: str
    start: Fraction
    bound: Fraction
    rate: Fraction | None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
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
        if self.claim is None:
            return ()
        claim, tube = self.claim, self.claim.tube
        last = Stage(
            kind=claim.kind,
            start=tube.ends,
            bound=claim.level * claim.height,
            rate=rate_near(claim.certificate) or None,
        )
        if not tube.ends:
            return (last,)
        return Stage(kind="moving box", start=ZERO, bound=max(tube.widths(0)), rate=None), last

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
            raise SpecError(
                "there is no envelope, because nothing is proved.", key="t", cure=self.reason
            )
        if isinstance(t, (int, float)):
            return _bound(self.claim, float(t))
        return np.array([_bound(self.claim, float(each)) for each in t], dtype=np.float64)

    def curve(self, *, until: float | None = None, samples: int = 400) -> tuple[Array, Array]:
        """Times (s) and bounds of |e|_inf, both (samples,), from 0 to ``until`` (the settling
        time), for plotting."""
        times = np.linspace(0.0, (self.time or 0.0) if until is None else until, samples)
        return times, self.envelope(times)

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """The stages as text: number, kind, start (s), bound of |e|_inf there, rate (1/s)."""
        found = []
        for k, stage in enumerate(self.stages):
            start, bound = (
                significant_away_from_zero(stage.start, 6),
                significant_away_from_zero(stage.bound),
            )
            rate = "" if stage.rate is None else significant_towards_zero(stage.rate)
            found.append((str(k + 1), stage.kind, start, bound, rate))
        return found

    def __repr__(self) -> str:
        lines = [f"Settling of {self.problem_name}: {self.verdict.value}. {self.reason}"]
        if self.single_time is not None and self.time is not None:
            lines.append(f"One certificate for the whole box gives {self.single_time:.6g} s.")
        if self.stages:
            lines += [
                f"{'stage':>5}  {'certificate':<13}  {'from (s)':>9}  {'|e| <=':>9}  "
                f"{'rate (1/s)':>10}"
            ]
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


def _bound(claim: Descent, t: float) -> float:
    """A bound of |e(t)|_inf, rounded up."""
    if not (math.isfinite(t) and t >= 0):
        raise SpecError(f"t must be a time >= 0 in s; got {t}.", key="t")
    when, tube = Fraction(t), claim.tube
    if when < tube.ends:
        k = bisect.bisect_right(tube.times, when) - 1
        part = (when - tube.times[k]) / (tube.times[k + 1] - tube.times[k])
        faces = ((face[k], face[k + 1]) for face in (tube.upper, tube.lower))
        return float_above(
            max(
                a + part * (b - a)
                for before, after in faces
                for a, b in zip(before, after, strict=True)
            )
        )
    return float_above(bound_after(claim, when).hi)
