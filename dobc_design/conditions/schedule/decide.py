"""A tube and the certificate that takes over, decided: every row, the start, the hand-over and the tolerance.

The statement and its proof are in ``claim``.  Rows are decided in floats with outward bounds, exponentials are
enclosed, all else is rational.  Also the noun that ``certify_settling`` returns, which evaluates what was proved.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.cards import Card, Shown
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, verify_lure
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.schedule.claim import QUADRATIC, SEPARABLE, ZERO, Descent, Tube
from dobc_design.conditions.schedule.rows import Box, MovingRows, moving_rows
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import composite_rate, error_bound_obstacle, verify_composite
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.interval import Interval, exp, sqrt
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.number import float_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]
FARTHEST: Final = 10_000  # exp(-x) beyond is bounded by exp(-FARTHEST)


def why_not(problem: Problem, W: Matrix | None, claim: Descent) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    needs = _needs(problem, W, claim)
    return next((words for holds, words in needs if not holds), None)


def open_segments(
    problem: Problem, tube: Tube, *, disturbance: Fraction, rows: MovingRows | None = None
) -> list[int] | None:
    """The segments of a tube whose rows are not proved; None where rows cannot be decided.  ``rows``: those of the
    problem, where they are known as far out as the tube."""
    most = max(x for face in (tube.upper, tube.lower) for box in face for x in box)
    rows = moving_rows(problem, most) if rows is None or rows.most < most else rows
    if rows is None:
        return None
    load = np.array([float_above(noise(tube, disturbance, time).hi) for time in tube.times])
    return rows.open_segments(Box.of(tube.upper, tube.lower), tube.times, load)


def noise(tube: Tube, disturbance: Fraction, time: Fraction) -> Interval:
    """Enclose the bound of |C eps_i| and E from ``time`` (s) on; 0 without an exosystem."""
    if tube.error is None:
        return Interval.point(ZERO)
    return shrunk(disturbance, tube.error.beta, time) * sqrt(Interval.point(tube.error.size))


def level_at_the_end(problem: Problem, claim: Descent) -> Interval:
    """Enclose the largest size W that the certificate may have at the end of the tube; its square if quadratic."""
    tube, own = claim.tube, claim.certificate
    left, widths = noise(tube, claim.disturbance, tube.ends), tube.widths(-1)
    if isinstance(own, Separable):
        size = Interval.point(max(b / v for b, v in zip(widths, own.v, strict=True)))
        return size if own.error is None else size + left * own.error.kappa
    b, P_e = [x for x in widths for _ in range(problem.m)], own.P_e.entries
    total = sum((abs(x) * b[i] * b[j] * (1 + (i != j)) for (i, j), x in P_e.items()), ZERO)
    return (left * claim.stretch) ** 2 * problem.n + total


def rate_near(certificate: Separable | Lure) -> Fraction:
    """The rate (1/s) at which the size of a certificate decays."""
    return composite_rate(certificate) if isinstance(certificate, Separable) else certificate.rate


def shrunk(value: Fraction, rate: Fraction, time: Fraction) -> Interval:
    """Enclose value exp(-rate time) for value, rate, time >= 0."""
    power = rate * time
    if power > FARTHEST:
        return Interval(ZERO, (exp(Interval.point(Fraction(-FARTHEST))) * value).hi)
    return exp(Interval.point(-power)) * value


def _needs(problem: Problem, W: Matrix | None, claim: Descent) -> Iterator[tuple[bool, str]]:
    """What has to hold, in turn, and the words if it does not."""
    tube, exosystem = claim.tube, problem.joint_exosystem
    yield len(tube.upper[0]) == problem.n, f"a box must have {problem.n} entries, one per agent."
    yield (tube.error is not None) == (exosystem is not None), "P, beta and size belong to an [exosystem]."
    if exosystem is not None:
        yield W is not None, "with an [exosystem] it needs an observer gain W."
        if W is not None and tube.error is not None:
            obstacle = error_bound_obstacle(exosystem, W, tube.error)
            yield obstacle is None and tube.error.beta > 0, f"the observer error of the tube: {obstacle}"
    else:
        yield claim.disturbance == 0, "without an [exosystem] there is no observer error."
    yield min(tube.upper[0] + tube.lower[0]) >= claim.radius, "its first box does not hold all starts."
    mixing = any(
        x for k in problem.pinning.gains.values() for c, row in enumerate(k) for d, x in enumerate(row) if c != d
    )
    yield not mixing or tube.upper == tube.lower, "with gains that mix components its faces have to be alike."
    if len(tube.times) > 1:
        left = open_segments(problem, tube, disturbance=claim.disturbance)
        yield left is not None, "its rows cannot be decided: a coupling is not defined, or turns too often."
        if left:
            yield False, f"a row does not hold between {float(tube.times[left[0]]):.6g} s and the next time."
    yield from _last(problem, W, claim)
    end = shrunk(claim.level, rate_near(claim.certificate), claim.time - tube.ends) * claim.height
    yield end.hi <= claim.tolerance, "it does not bring |e|_inf down to the tolerance by the time claimed."


def _last(problem: Problem, W: Matrix | None, claim: Descent) -> Iterator[tuple[bool, str]]:
    """The certificate that takes over, and that the last box lies in its level set."""
    own, error = claim.certificate, claim.tube.error
    if isinstance(own, Separable):
        yield claim.stretch == 1, "stretch of a max-separable certificate is 1."
        answer = verify_composite(problem, W, own)
        yield answer.verdict is Verdict.PROVED, answer.reason
        if own.error is not None and error is not None:
            same = (own.error.P, own.error.beta, own.error.size) == (error.P, error.beta, error.size)
            yield same, "the certificate and the tube have different P."
        yield claim.height >= max(own.v), "height must be at least max v."
        yield own.rho is None or claim.level <= own.rho, "its level set reaches beyond the box of its rows."
        square = claim.level
    else:
        yield own.rate > 0, "its rate must be > 0."
        decision = verify_lure(problem, own)
        yield decision.verdict is Verdict.PROVED, decision.reason
        yield (own.P is None) == (error is None), "with an [exosystem] the certificate needs a pair P, Q."
        if own.P is not None and own.Q is not None and W is not None and error is not None:
            yield multiply(own.P, W) == own.Q, "its pair (P, Q) belongs to another W: Q must equal P W."
            gap = SparseSymmetric.from_dense(error.P).scaled(claim.stretch**2)
            gap += SparseSymmetric.from_dense(own.P).negated()
            fits = decide_positive_semidefinite(gap).verdict is Verdict.PROVED
            yield fits, "stretch^2 P (of the tube) - P is not semidefinite."
        tallest = max(diagonal_of_inverse(own.P_e))
        yield claim.height**2 >= tallest, "height^2 must be at least every diagonal entry of P_e^-1."
        square = claim.level**2
        places = () if own.radius is None else relied_differences(problem)
        inside = all(square * width <= (own.radius or ZERO) ** 2 for width in differences(own.P_e, places))
        yield inside, "its level set reaches beyond its radius."
    yield square >= level_at_the_end(problem, claim).hi, "the last box of the tube does not lie in its level set."


def proved_reason(claim: Descent) -> str:
    """What a proved claim says, in a sentence."""
    kind = "a quadratic" if claim.is_quadratic else "a max-separable"
    how = f"by {kind} certificate."
    if claim.tube.ends:
        how = f"by a box that moves until {float(claim.tube.ends):.6g} s and then {how[3:]}"
    return f"|e(t)|_inf <= {float(claim.tolerance):.4g} for all t >= {float(claim.time):.6g} s, {how}"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Stage(Shown):
    """A part of the way: its ``kind``, from ``start`` (s) on, the ``bound`` of |e|_inf there, its rate (1/s)."""

    kind: str
    start: Fraction
    bound: Fraction
    rate: Fraction | None

    @property
    def is_quadratic(self) -> bool:
        return self.kind == QUADRATIC


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Settling(Shown):
    """A settling time: |e(t)|_inf <= tolerance for all t >= time, from |e(0)|_inf <= radius, |eps_i(0)| <= disturbance.

    PROVED with a ``claim``, for arbitrary switching among the modes; UNDECIDED without one.  ``single``: what one
    certificate for the whole box gives, for comparison; None if none is proved.
    """

    verdict: Verdict
    reason: str
    problem_name: str
    radius: Fraction
    disturbance: Fraction
    tolerance: Fraction
    claim: Descent | None = None
    single: Descent | None = None

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
        """The tube, if it has any length, and the certificate that takes over; empty if nothing is proved."""
        if self.claim is None:
            return ()
        claim, tube = self.claim, self.claim.tube
        last = Stage(
            kind=QUADRATIC if claim.is_quadratic else SEPARABLE,
            start=tube.ends,
            bound=claim.level * claim.height,
            rate=rate_near(claim.certificate),
        )
        if not tube.ends:
            return (last,)
        return Stage(kind="moving box", start=ZERO, bound=max(tube.widths(0)), rate=None), last

    @overload
    def envelope(self, t: float) -> float: ...

    @overload
    def envelope(self, t: Sequence[float] | Array) -> Array: ...

    def envelope(self, t: float | Sequence[float] | Array) -> float | Array:
        """A bound of |e(t)|_inf, rounded up, at t >= 0 in s: a number or an array of times.  It is that of the box
        until the end of the tube, then that of the certificate, which may begin with more than the last box. Raises:
        SpecError for a time that is negative or not finite, or if nothing is proved."""
        if self.claim is None:
            raise SpecError("there is no envelope, because nothing is proved.", key="t", cure=self.reason)
        if isinstance(t, (int, float)):
            return _bound(self.claim, float(t))
        return np.array([_bound(self.claim, float(each)) for each in t], dtype=np.float64)

    def curve(self, *, until: float | None = None, samples: int = 400) -> tuple[Array, Array]:
        """Times (s) and bounds of |e|_inf, both (samples,), from 0 to ``until`` (the settling time), for plotting."""
        times = np.linspace(0.0, (self.time or 0.0) if until is None else until, samples)
        return times, self.envelope(times)

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """The stages as text: number, kind, start (s), bound of |e|_inf there, rate (1/s)."""
        found = []
        for k, stage in enumerate(self.stages):
            start, bound = significant_away_from_zero(stage.start, 6), significant_away_from_zero(stage.bound)
            rate = "" if stage.rate is None else significant_towards_zero(stage.rate)
            found.append((str(k + 1), stage.kind, start, bound, rate))
        return found

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
            max(a + part * (b - a) for before, after in faces for a, b in zip(before, after, strict=True))
        )
    left = shrunk(claim.level, rate_near(claim.certificate), when - tube.ends) * claim.height
    return float_above(left.hi)
